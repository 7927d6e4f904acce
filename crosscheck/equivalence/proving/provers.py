"""Provers: which engine's own model a description is held against, where its reader has none of its own.

A URDF that this project reads itself is held against Pinocchio's model of the same file, or MuJoCo's where Pinocchio is not
installed or refuses; then against those of packages that offer ``dynamics``.  Pinocchio has no equations for joints that mimic
others: those are held against the first engine that has.  A mechanism of ours is the source itself.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Any

from crosscheck.doors.packages import list_installed_engines
from crosscheck.engines import ENGINES, describe_missing_package, resolve_adapter
from crosscheck.engines.base import offered
from crosscheck.lifting.description import Description
from crosscheck.lifting.reader_dynamics import ReaderDynamics
from flexinv.errors import InputError
from flexinv.typing import Array

OURS = ("toml", "kit", "live")  # formats in which a mechanism of ours is the source itself
FIRST = ("pinocchio", "mujoco")


def add_dynamics(description: Description) -> Description:
    """Return a description with an engine's own model of its file, or with the reason why there is none [-]."""
    if description.dynamics is not None or description.unproven:
        return description
    if description.reader != "flexinv":
        words = f"the reader {description.reader} does not tell the dynamics of its own model"
        return replace(description, unproven=words)
    if description.format in OURS or description.file is None:
        return description
    refused: list[str] = []
    reader = _find_dynamics(description, refused)
    if reader is not None:
        return replace(description, dynamics=reader)
    none = f"no engine is installed that has a model of its own of {description.format.upper()}"
    return replace(description, unproven="; ".join(refused) or none)


def _find_dynamics(description: Description, refused: list[str]) -> ReaderDynamics | None:
    """The first engine's model of the file, with the equations of closures of the first that has them; what refuses says why."""
    first: ReaderDynamics | None = None
    for name, dynamics in _list_offering_engines(description.format):
        try:
            reader: ReaderDynamics = dynamics(description.file, description.mechanism)
        except InputError as error:
            refused.append(f"{name}: {' '.join(str(error).split())}")
            continue
        if not description.mechanism.closures or reader.closing(description.mechanism.neutral) is not None:
            return reader if first is None else CombinedDynamics(first, reader)
        first = reader if first is None else first
    return first


@dataclass(frozen=True)
class CombinedDynamics:
    """`ReaderDynamics` of two engines: efforts of the one, equations of closures of the other."""

    moved: ReaderDynamics
    tied: ReaderDynamics

    @property
    def reader(self) -> str:
        """Return both engines with their versions [-]."""
        return f"{self.moved.reader}, its closures against {self.tied.reader}"

    @property
    def precision(self) -> float:
        """Return the relative rounding of the coarser arithmetic [-]."""
        return max(self.moved.precision, self.tied.precision)

    @property
    def start(self) -> Array | None:
        """Return the configuration (nq,) [rad], [m] near which loops close."""
        return self.tied.start

    def efforts(
        self, q: Array, qd: Array, qdd: Array, gravity: Array | None = None, without: Collection[str] = ()
    ) -> Array:
        """Return efforts (samples, nv) [N m], [N] of the first engine."""
        return self.moved.efforts(q, qd, qdd, gravity, without)

    def closing(self, q: Array, without: Collection[str] = ()) -> tuple[Array, Array] | None:
        """Return residual (rows,) [m], [rad] and Jacobian (rows, nv) of the second engine."""
        return self.tied.closing(q, without)


def _list_offering_engines(kind: str) -> Iterator[tuple[str, Any]]:
    """Yield engines that read a format and offer the dynamics of their model of it, those first that most use."""
    engines = {**ENGINES, **list_installed_engines()}
    names = [*FIRST, *(name for name in engines if name not in FIRST and "-" not in name)]
    for name in names:
        if (
            name not in engines
            or name in ("measured", "flexinv")
            or describe_missing_package(engines[name]) is not None
        ):
            continue
        try:
            adapter: Any = resolve_adapter(engines[name].module)
        except ImportError:
            continue
        dynamics = offered(adapter, "dynamics")
        if dynamics is not None and kind in getattr(adapter, "READS", ("urdf", "mjcf")):
            yield name, dynamics
