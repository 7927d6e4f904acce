"""Registry of engines: a name, the adapter module behind it, and the installation of the package that it drives.

An adapter is imported by name and late: a machine without an engine still runs the others.
"""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import dataclass
from typing import cast

from crosscheck.engines.base import Adapter


@dataclass(frozen=True)
class Engine:
    """One column of the report.

    module : the adapter; requires : the Python package that the adapter imports; install : how to get it
    native : an engine's own result where it is known to differ: its adapter names the cause in the record's message
    """

    name: str
    module: str
    requires: str
    install: str
    native: bool = False


def _engine(name: str, module: str, requires: str, package: str, native: bool = False) -> Engine:
    return Engine(name, f"crosscheck.engines.{module}", requires, f"python -m pip install {package}", native)


ENGINES: dict[str, Engine] = {
    e.name: e
    for e in (
        _engine("flexinv", "flexinv.adapter", "flexinv", "."),
        _engine("pinocchio", "pinocchio.adapter", "pinocchio", "pin"),
        _engine("mujoco", "mujoco.adapter", "mujoco", "mujoco"),
        _engine("mujoco-equality", "mujoco.adapter", "mujoco", "mujoco", native=True),
        _engine("mujoco-flex", "mujoco.flex", "mujoco", "mujoco"),
        _engine("exudyn", "exudyn.adapter", "exudyn", "exudyn"),
        _engine("exudyn-dae", "exudyn.adapter", "exudyn", "exudyn"),
        _engine("exudyn-ancf", "exudyn.adapter", "exudyn", "exudyn"),
        _engine("exudyn-ge", "exudyn.adapter", "exudyn", "exudyn"),
        _engine("measured", "measured.adapter", "numpy", "."),
    )
}


def missing(engine: Engine) -> str | None:
    """Return the advice to install the package that ``engine`` needs, or None when it is there (nothing is imported)."""
    if importlib.util.find_spec(engine.requires) is not None:
        return None
    return f"{engine.requires} is not installed; to install it: {engine.install}"


def adapter(engine: Engine) -> Adapter:
    """Import the adapter of ``engine``.  Raises ImportError where the engine is not installed."""
    return cast(Adapter, importlib.import_module(engine.module))
