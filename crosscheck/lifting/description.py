"""Description of a machine as it was lifted: the mechanism, the numbers of its drives, and the rest in words.

A *lift* is a function of an engine's adapter (`crosscheck.engines.base`): it takes a file, or a model of that engine in memory,
and returns a `Description`.  Nothing is repaired on the way: what the source says is in the mechanism, or is said to be dropped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from crosscheck.lifting.reader_dynamics import Feature, ReaderDynamics
from flexinv.model.mechanism import Mechanism

FORMATS = ("urdf", "mjcf", "sdf", "toml", "kit", "usd", "live")


@dataclass(frozen=True)
class ShapeMasses:
    """Masses of a link by its shapes [kg]: of those that its reader weighs, and of those that collide.

    groups : the first and the last of those that it weighs
    """

    weighed: float
    colliding: float
    groups: tuple[int, ...]


@dataclass(frozen=True)
class Description:
    """One description of a machine.

    label : what it is called in words and tables; format : one of ``FORMATS``; reader : what read it
    gears : by joint, the factor between an actuator and the joint [-], [1/rad]
    dropped : what the source says and the mechanism does not, a line each
    printed : by (element, quantity) half of the last printed digit [unit of the quantity]: what rounding explains
    precision : relative rounding of the reader's own numbers [-]
    root_stated, gravity_stated : False where the source does not say whether its root is held, or what pulls it, as a URDF
    features : what the source says, an engine does, and no mechanism can say: compared by name, and by what ``dynamics`` feels
    dynamics : the reader's own compiled model, in the coordinates of ``mechanism`` as it was lifted
    unproven : why there is no such model, "" where there is one, or where the mechanism is the source itself
    shape_masses : by link, where its mass is that of shapes and readers weigh different ones
    """

    label: str
    mechanism: Mechanism
    format: str
    reader: str = "flexinv"
    gears: Mapping[str, float] = field(default_factory=dict)
    dropped: tuple[str, ...] = ()
    printed: Mapping[tuple[str, str], float] = field(default_factory=dict)
    precision: float = 0.0
    file: Path | None = None
    root_stated: bool = True
    gravity_stated: bool = True
    features: tuple[Feature, ...] = ()
    dynamics: ReaderDynamics | None = None
    unproven: str = ""
    shape_masses: Mapping[str, ShapeMasses] = field(default_factory=dict)
