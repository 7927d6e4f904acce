"""Limits that a motion has to keep at every instant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from flexinv.errors import InputError
from flexinv.model.by_value import ByValue
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.validation import check_mapping, check_names, check_number, find_nearest_word

LIMITED_BY_JOINT = ("torque", "rate", "acceleration", "jerk")


@dataclass(frozen=True, eq=False)
class MotionLimits(ByValue):
    """Limits of a motion, the same in both directions.

    torque : joint -> largest effort of its drive [N m], [N]; None for the largest ones of the given motion
    rate, acceleration, jerk : joint -> largest of the joint [rad/s], [m/s] and their derivatives
    residual : largest distance of any link's tip from its rest place after the end [m]; None for a hundredth of what the given
        motion leaves, or a ten thousandth of a tip's way
    """

    torque: Mapping[str, float] | None = None
    rate: Mapping[str, float] = field(default_factory=dict)
    acceleration: Mapping[str, float] = field(default_factory=dict)
    jerk: Mapping[str, float] = field(default_factory=dict)
    residual: float | None = None

    def __post_init__(self) -> None:
        """Raise InputError for what is no table of joints and positive numbers [their own units]."""
        for name in LIMITED_BY_JOINT:
            if getattr(self, name) is None and name == "torque":
                continue
            table = check_mapping(name, getattr(self, name), "a table of joints and their limits", "{'joint': 1.0}")
            check_names(name, list(table), "joints")
            checked = {
                str(joint): _check_positive(f"{name} of joint {joint!r}", value) for joint, value in table.items()
            }
            object.__setattr__(self, name, checked)
        if self.residual is not None:
            object.__setattr__(self, "residual", _check_positive("residual", self.residual))

    @property
    def efforts(self) -> Mapping[str, float]:
        """``torque``, and no limits where it is None [N m], [N]."""
        return self.torque or {}

    @property
    def limits_time(self) -> bool:
        """Return True if one of these keeps a motion from taking no time at all [-]."""
        return self.torque is None or any(getattr(self, name) for name in LIMITED_BY_JOINT)

    def check_joints(self, mechanism: Mechanism) -> None:
        """Raise InputError for joints [-] that the mechanism does not have, and for limits of torques without a drive."""
        for name in LIMITED_BY_JOINT:
            for joint in getattr(self, name) or ():
                _check_limited_joint(mechanism, name, joint)


def _check_limited_joint(mechanism: Mechanism, name: str, joint: str) -> None:
    """Raise InputError for a joint that can have no such limit."""
    if joint not in mechanism.joint_of:
        like = find_nearest_word(joint, mechanism.joint_of)
        hint = f"; write {like!r}" if like else ""
        known = ", ".join(mechanism.joint_of)
        raise InputError(f"limits: {name} of joint {joint!r}: '{mechanism.name}' has {known}{hint}")
    found = mechanism.joint_of[joint]
    if not KINDS[found.kind].scalar:
        raise InputError(f"limits: {name} of joint {joint!r}, which has more than one coordinate; leave it out")
    if name == "torque" and not found.actuated:
        raise InputError(f"limits: torque of joint {joint!r}, which has no actuator; leave it out")


def _check_positive(name: str, value: object) -> float:
    """A number above 0 and finite [its own unit]."""
    number = check_number(f"limits: {name}", value, "a number above 0")
    if not (np.isfinite(number) and number > 0.0):
        raise InputError(f"limits: {name} = {number:g}: expected a finite number above 0; leave out what has no limit")
    return number
