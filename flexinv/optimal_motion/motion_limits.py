"""Limits that a motion has to keep at every instant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NoReturn

import numpy as np

from flexinv.errors import InputError
from flexinv.model.by_value import ByValue
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.validation import check_kind, check_mapping, check_names, check_number, find_nearest_word

LIMITED_BY_JOINT = ("torque", "rate", "acceleration", "jerk", "force", "moment")
SCALAR_JOINTS = ("torque", "rate", "acceleration", "jerk")  # limits of joints that have one coordinate


@dataclass(frozen=True)
class StrainLimit:
    """Largest strain of a beam's fibres along its axis, at the stations of ``Solution.strain`` and at the root.

    At the root, where a clamped beam bends most, it is that of the polynomial through the first element's stations.

    largest : [-]; y, z : distances of the outermost fibres from the axis of the beam along the axes of its section [m]
    """

    largest: float
    y: float
    z: float

    def __post_init__(self) -> None:
        """Raise InputError for numbers that are none, or not above 0 [-], [m]; one of the distances may be 0."""
        object.__setattr__(self, "largest", _check_positive("largest strain", self.largest))
        for name in ("y", "z"):
            distance = check_number(f"limits: strain: {name}", getattr(self, name), "a distance [m] of 0 or more")
            if not (np.isfinite(distance) and distance >= 0.0):
                raise InputError(f"limits: strain: {name} = {distance:g}: expected a finite distance [m] of 0 or more")
            object.__setattr__(self, name, distance)


@dataclass(frozen=True, eq=False)
class MotionLimits(ByValue):
    """Limits of a motion, the same in both directions.

    torque : joint -> largest effort of its drive [N m], [N]; None for the largest ones of the given motion
    rate, acceleration, jerk : joint -> largest of the joint [rad/s], [m/s] and their derivatives
    force, moment : joint -> largest size of the force [N], of the moment [N m] that it carries, along its axis included
    strain : beam -> `StrainLimit` of its fibres [-]
    path : link -> largest distance of its tip from the path that this takes in the given motion [m]
    residual : largest distance of any link's tip from its rest place after the end [m]; None for a hundredth of what the given
        motion leaves, or a ten thousandth of a tip's way
    """

    torque: Mapping[str, float] | None = None
    rate: Mapping[str, float] = field(default_factory=dict)
    acceleration: Mapping[str, float] = field(default_factory=dict)
    jerk: Mapping[str, float] = field(default_factory=dict)
    force: Mapping[str, float] = field(default_factory=dict)
    moment: Mapping[str, float] = field(default_factory=dict)
    strain: Mapping[str, StrainLimit] = field(default_factory=dict)
    path: Mapping[str, float] = field(default_factory=dict)
    residual: float | None = None

    def __post_init__(self) -> None:
        """Raise InputError for what is no table of joints and positive numbers [their own units]."""
        for name in LIMITED_BY_JOINT:
            if getattr(self, name) is None and name == "torque":
                continue
            self._check_table(name, "joint")
        self._check_table("path", "link")
        strains = check_mapping("strain", self.strain, "a table of beams and StrainLimit", "{'beam': StrainLimit(...)}")
        for limit in strains.values():
            check_kind("strain", limit, StrainLimit)
        object.__setattr__(self, "strain", dict(strains))
        if self.residual is not None:
            object.__setattr__(self, "residual", _check_positive("residual", self.residual))

    def _check_table(self, name: str, of: str) -> None:
        """Hold a table of names and positive numbers."""
        table = check_mapping(name, getattr(self, name), f"a table of {of}s and their limits", f"{{'{of}': 1.0}}")
        check_names(name, list(table), f"{of}s")
        checked = {str(one): _check_positive(f"{name} of {of} {one!r}", value) for one, value in table.items()}
        object.__setattr__(self, name, checked)

    @property
    def efforts(self) -> Mapping[str, float]:
        """``torque``, and no limits where it is None [N m], [N]."""
        return self.torque or {}

    @property
    def limits_time(self) -> bool:
        """Return True if one of these keeps a motion from taking no time at all [-]."""
        return self.torque is None or any(getattr(self, name) for name in (*LIMITED_BY_JOINT, "strain"))

    def find_limit(self, kind: str, name: str) -> float:
        """Return the limit of a joint, a beam or a link [N], [N m], [-], [m]."""
        limit = getattr(self, kind)[name]
        return float(limit.largest if isinstance(limit, StrainLimit) else limit)

    def draw_in(self, kind: str, name: str, part: float) -> MotionLimits:
        """Return the limits with one of them at a part of itself [-]."""
        table = dict(getattr(self, kind))
        limit = table[name]
        table[name] = replace(limit, largest=part * limit.largest) if isinstance(limit, StrainLimit) else part * limit
        drawn_in: dict[str, Any] = {kind: table}
        return replace(self, **drawn_in)

    def check_names(self, mechanism: Mechanism) -> None:
        """Raise InputError for joints, beams and links [-] that the mechanism does not have, and torques without a drive."""
        for name in LIMITED_BY_JOINT:
            for joint in getattr(self, name) or ():
                _check_limited_joint(mechanism, name, joint)
        beams = [link.name for link in mechanism.beams]
        tips = [joint.child for joint in mechanism.joints]
        for kind, what, known in (("strain", "beam", beams), ("path", "link", tips)):
            for name in getattr(self, kind):
                if name not in known:
                    _refuse_name(mechanism, f"{kind} of {what} {name!r}", name, known)


def _check_limited_joint(mechanism: Mechanism, name: str, joint: str) -> None:
    """Raise InputError for a joint that can have no such limit."""
    if joint not in mechanism.joint_of:
        _refuse_name(mechanism, f"{name} of joint {joint!r}", joint, list(mechanism.joint_of))
    found = mechanism.joint_of[joint]
    if name in SCALAR_JOINTS and not KINDS[found.kind].scalar:
        raise InputError(f"limits: {name} of joint {joint!r}, which has more than one coordinate; leave it out")
    if name == "torque" and not found.actuated:
        raise InputError(f"limits: torque of joint {joint!r}, which has no actuator; leave it out")


def _refuse_name(mechanism: Mechanism, where: str, name: str, known: Sequence[str]) -> NoReturn:
    """Raise InputError with the names that there are, and the nearest."""
    like = find_nearest_word(name, known)
    hint = f"; write {like!r}" if like else ""
    raise InputError(f"limits: {where}: '{mechanism.name}' has {', '.join(known) or 'none'}{hint}")


def _check_positive(name: str, value: object) -> float:
    """A number above 0 and finite [its own unit]."""
    number = check_number(f"limits: {name}", value, "a number above 0")
    if not (np.isfinite(number) and number > 0.0):
        raise InputError(f"limits: {name} = {number:g}: expected a finite number above 0; leave out what has no limit")
    return number
