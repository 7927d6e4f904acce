"""Registry of engines: a name, the adapter behind it, and the installation of the package that it drives.

Our own engines come through the same door as those of other packages, the entry points ``crosscheck.engines``
(`crosscheck.doors.packages`); the rows here are what a checkout has without installation.  An adapter is imported by name and
late: a machine without an engine still runs the others.
"""

from __future__ import annotations

import importlib
import importlib.util
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NotRequired, TypedDict, cast

from crosscheck.engines.base import Adapter
from flexinv.export.names import C_COMPILERS, COMPILER_PACKAGE
from flexinv.files.load_cases import Limit


class Door(TypedDict):
    """Place of an adapter: ``package.module`` or ``package.module:object``, a folder to import it from, settings of a door."""

    module: str
    path: NotRequired[str]
    settings: NotRequired[Mapping[str, Any]]


class NamedDoor(Door):
    """Place of an adapter, with the name of its engine.

    stamp : digests of what is behind the door, so that answers change with it
    """

    engine: str
    stamp: NotRequired[list[str]]


# Last digits that another processor computes otherwise (other orders of additions), 1e7 roundings.
ROUNDING = 1e-9
# What is solved for until an engine's own tolerance is reached, in one iteration more or less: between Zen 4 and Zen 5 values of
# models/ differ by at most 8e-7 of the range (two_arms by MuJoCo's solver of constraints, ur5 by Exudyn's Newton).
ITERATED = 1e-6


@dataclass(frozen=True)
class Engine:
    """One column of the report.

    module : the adapter, ``package.module`` or ``package.module:object``; requires : the Python package that it imports, "" for
        none; install : how to get it
    native : an engine's own result where it is known to differ: its adapter names the cause in the record's message
    same_steps : it makes the steps of the reference on the same mesh: its answers are held against what that gave, and not
        against what that tends to when it is refined
    exports : the adapter has a member ``export``; None of a Python object of others, which says that when it is asked
    settings : of a door: the adapter is what ``module.opened(name, folder of the mechanism, settings)`` returns; None: the module
    path : folder from which a module is imported that is not installed
    tools : commands, or Python packages that bring one, of which one has to be there; none: it needs no tool
    limits : stated where the engine is (crosscheck.toml), heard after those of the case
    repeats : part of a quantity's largest component to which values are the same on another processor [-]
    """

    name: str
    module: str
    requires: str
    install: str
    native: bool = False
    exports: bool | None = None
    settings: Mapping[str, Any] | None = None
    path: str = ""
    limits: tuple[Limit, ...] = field(default=())
    same_steps: bool = False
    tools: tuple[str, ...] = ()
    repeats: float = ROUNDING

    @property
    def has_tool(self) -> bool:
        """Return True if this machine has the tool that the engine needs, or it needs none."""
        return not self.tools or any(shutil.which(one) or importlib.util.find_spec(one) for one in self.tools)

    @property
    def adapter_key(self) -> str:
        """A name that engines share whose adapter is the same."""
        return self.module if self.settings is None else f"{self.module} {self.name}"

    @property
    def door(self) -> Door:
        """The adapter in a job of a child process (`open_adapter`)."""
        door: Door = {"module": self.module}
        if self.path:
            door["path"] = self.path
        if self.settings is not None:
            door["settings"] = dict(self.settings)
        return door


def _make_engine(
    name: str,
    module: str,
    requires: str,
    package: str,
    native: bool = False,
    exports: bool = True,
    limits: tuple[Limit, ...] = (),
    repeats: float = ROUNDING,
) -> Engine:
    install = f"python -m pip install {package}"
    place = f"crosscheck.engines.{module}"
    return Engine(name, place, requires, install, native, exports, limits=limits, repeats=repeats)


# Machine code of the same kernels, which no mechanism needs to state a limit for.
_EXPORTED = Limit(
    "torque",
    ("flexinv-c",),
    1e-9,
    "the machine code is flexinv's own; where steps are marched a position of another last digit is 7e-12 of the peak "
    "acceleration at a step of 5e-4 s, and goes on from there",
)


ENGINES: dict[str, Engine] = {
    e.name: e
    for e in (
        _make_engine("flexinv", "flexinv.adapter", "flexinv", ".", exports=False),
        _make_engine("pinocchio", "pinocchio.adapter", "pinocchio", "pin"),
        _make_engine("mujoco", "mujoco.adapter", "mujoco", "mujoco"),
        _make_engine("mujoco-equality", "mujoco.adapter", "mujoco", "mujoco", native=True, repeats=ITERATED),
        _make_engine("mujoco-flex", "mujoco.flex", "mujoco", "mujoco"),
        _make_engine("exudyn", "exudyn.adapter", "exudyn", "exudyn"),
        _make_engine("exudyn-dae", "exudyn.adapter", "exudyn", "exudyn", repeats=ITERATED),
        _make_engine("exudyn-ancf", "exudyn.adapter", "exudyn", "exudyn"),
        _make_engine("exudyn-ge", "exudyn.adapter", "exudyn", "exudyn"),
        replace(
            _make_engine("flexinv-c", "flexinv_c.adapter", "flexinv", ".", exports=False, limits=(_EXPORTED,)),
            same_steps=True,
            tools=(*C_COMPILERS, COMPILER_PACKAGE),
        ),
        _make_engine("measured", "measured.adapter", "numpy", ".", exports=False),
    )
}


def describe_missing_package(engine: Engine) -> str | None:
    """Return the advice to install the package that ``engine`` needs, or None when it is there (nothing is imported)."""
    if not engine.requires or importlib.util.find_spec(engine.requires) is not None:
        return None
    return f"{engine.requires} is not installed; to install it: {engine.install}"


def adapter(engine: Engine) -> Adapter:
    """Import the adapter of ``engine``.  Raises ImportError where the engine is not installed."""
    return resolve_adapter(engine.module)


def resolve_adapter(name: str) -> Adapter:
    """Import an adapter: a module, ``module:object``, or ``module:class``, of which one is made.  Raises ImportError."""
    module, _, attribute = name.partition(":")
    found: Any = importlib.import_module(module)
    for part in filter(None, attribute.split(".")):
        if not hasattr(found, part):
            raise ImportError(f"{module} has no {attribute!r}")
        found = getattr(found, part)
    return cast(Adapter, found() if isinstance(found, type) else found)


def add_import_path(path: str) -> None:
    """Let modules be imported from a folder, too, if one is named."""
    if path and path not in sys.path:
        sys.path.insert(0, path)


def open_adapter(door: Door, engine: str, mechanism: str = "") -> Adapter:
    """Return the adapter at a place; mechanism : folder of what an engine with settings is asked about."""
    add_import_path(door.get("path", ""))
    if "settings" not in door:
        return resolve_adapter(door["module"])
    module: Any = importlib.import_module(door["module"])
    return cast(Adapter, module.open_adapter(engine, mechanism, door["settings"]))
