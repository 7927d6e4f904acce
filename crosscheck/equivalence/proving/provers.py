"""Provers: which engine's own model a description is held against, where its reader has none of its own.

A URDF that this project reads itself is held against Pinocchio's model of the same file, or MuJoCo's where Pinocchio is not
installed or refuses; then against those of packages that offer ``dynamics``.  A mechanism of ours is the source itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from crosscheck.doors.packages import installed
from crosscheck.engines import ENGINES, loaded, missing
from crosscheck.engines.base import offered
from crosscheck.lifting.description import Description
from flexinv.errors import InputError

OURS = ("toml", "kit", "live")  # formats in which a mechanism of ours is the source itself
FIRST = ("pinocchio", "mujoco")


def with_dynamics(description: Description) -> Description:
    """Return a description with an engine's own model of its file, or with the reason why there is none [-]."""
    if description.dynamics is not None or description.unproven:
        return description
    if description.reader != "flexinv":
        words = f"the reader {description.reader} does not tell the dynamics of its own model"
        return replace(description, unproven=words)
    if description.format in OURS or description.file is None:
        return description
    refused: list[str] = []
    for name, dynamics in _offering(description.format):
        try:
            return replace(description, dynamics=dynamics(description.file, description.mechanism))
        except InputError as error:
            refused.append(f"{name}: {' '.join(str(error).split())}")
    none = f"no engine is installed that has a model of its own of {description.format.upper()}"
    return replace(description, unproven="; ".join(refused) or none)


def _offering(kind: str) -> Iterator[tuple[str, Any]]:
    """Yield engines that read a format and offer the dynamics of their model of it, those first that most use."""
    engines = {**ENGINES, **installed()}
    names = [*FIRST, *(name for name in engines if name not in FIRST and "-" not in name)]
    for name in names:
        if name not in engines or name in ("measured", "flexinv") or missing(engines[name]) is not None:
            continue
        try:
            adapter: Any = loaded(engines[name].module)
        except ImportError:
            continue
        dynamics = offered(adapter, "dynamics")
        if dynamics is not None and kind in getattr(adapter, "READS", ("urdf", "mjcf")):
            yield name, dynamics
