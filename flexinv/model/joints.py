"""Joints and their drives as frozen data: what carries a link, what moves it, and its limits."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from flexinv.model import rules
from flexinv.model.frozen import Frozen
from flexinv.model.joint_kinds import KINDS, compute_motion_subspace
from flexinv.model.links import STATION, Placement
from flexinv.typing import Array


@dataclass(frozen=True, eq=False)
class Limits(Frozen):
    """Limits of the drive of a joint; infinite when not stated.

    effort : [N m] or [N]; velocity : [rad/s] or [m/s]; lower, upper : [rad] or [m]
    """

    effort: float = np.inf
    velocity: float = np.inf
    lower: float = -np.inf
    upper: float = np.inf

    RULES: ClassVar[rules.Rules] = {
        "effort": rules.make_real_rule("N m or N", 0.0, infinite=True),
        "velocity": rules.make_real_rule("rad/s or m/s", 0.0, infinite=True),
        "lower": rules.make_real_rule("rad or m", infinite=True),
        "upper": rules.make_real_rule("rad or m", infinite=True),
    }


@dataclass(frozen=True, eq=False)
class Drive(Frozen):
    """Motor, gear and elastic joint of a joint with one coordinate; the equations are in `motor_side`.

    ratio : [-], turns of the motor per turn of the joint, of one that slides [rad/m]; rotor_inertia : of the motor [kg m^2]
    stiffness, damping : of the elastic joint, on link side [N m/rad], [N m s/rad] or [N/m], [N s/m]; stiffness 0: rigid gear
    torque_constant : [N m/A], 0 unknown; viscous [N m s/rad], coulomb, static [N m], stribeck [rad/s] : friction of the motor
    moves : "link" or "motor", which of the two the joint's coordinate is (the motor's over the ratio)
    """

    ratio: float = 1.0
    rotor_inertia: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    torque_constant: float = 0.0
    viscous: float = 0.0
    coulomb: float = 0.0
    static: float = 0.0
    stribeck: float = 1.0
    moves: str = "link"

    RULES: ClassVar[rules.Rules] = {
        "ratio": rules.make_real_rule("- or rad/m"), "rotor_inertia": rules.make_real_rule("kg m^2", 0.0),
        "stiffness": rules.make_real_rule("N m/rad or N/m", 0.0), "damping": rules.make_real_rule("N m s/rad or N s/m", 0.0),
        "torque_constant": rules.make_real_rule("N m/A", 0.0), "viscous": rules.make_real_rule("N m s/rad", 0.0),
        "coulomb": rules.make_real_rule("N m", 0.0), "static": rules.make_real_rule("N m", 0.0),
        "stribeck": rules.make_real_rule("rad/s", 0.0, above=True), "moves": rules.make_option_rule(("link", "motor")),
    }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Joint(Frozen):
    """The joint that carries ``child``; its frame is ``placement`` in the frame of ``parent``.

    kind : a key of `joint_kinds.KINDS`
    station : on a beam parent the fraction 0..1 of the length whose section frame carries the joint, else None
    interface : of a meshed parent, whose frame carries the joint; "" for the parent's link frame
    axis : (3,) [-], unit, in the joint frame (first axis of a universal joint); second_axis : (3,), universal
    pitch : [m], helical: the way of the child along the axis for a whole turn about it (the screw's lead); negative: left-handed
    rotor_inertia : [kg m^2] or [kg], reflected to the joint; damping : [N m s/rad] or [N s/m];
    friction : [N m] or [N], dry: one number, the same for every velocity coordinate of the joint
    stiffness : [N m/rad] or [N/m] of a spring in the joint, without effort at ``rest`` [rad] or [m] (scalar joints)
    actuated : False leaves the joint to the dynamics, or its effort to ``Solution.unactuated``
    weight : [-] of the square of its effort where drives are redundant: the minimum of sum weight tau^2 is taken
    drive : motor, gear and elastic joint (`motor_side`)
    """

    name: str
    kind: str
    parent: str
    child: str
    placement: Placement = field(default_factory=Placement)
    station: float | None = None
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    second_axis: Array = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    rotor_inertia: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    actuated: bool = True
    weight: float = 1.0
    limits: Limits = field(default_factory=Limits)
    drive: Drive | None = None
    pitch: float = 0.0
    interface: str = ""

    RULES: ClassVar[rules.Rules] = {
        "name": rules.check_text,
        "kind": rules.make_option_rule(KINDS),
        "parent": rules.check_text,
        "child": rules.check_text,
        "placement": rules.make_kind_rule(Placement),
        "station": STATION,
        "axis": rules.check_unit_vector,
        "second_axis": rules.check_unit_vector,
        "rotor_inertia": rules.make_real_rule("kg m^2 or kg", 0.0),
        "damping": rules.make_real_rule("N m s/rad or N s/m", 0.0),
        "friction": rules.make_real_rule("N m or N", 0.0),
        "stiffness": rules.make_real_rule("N m/rad or N/m", 0.0),
        "rest": rules.make_real_rule("rad or m"),
        "actuated": rules.check_truth,
        "weight": rules.make_real_rule("-", 0.0, above=True),
        "limits": rules.make_kind_rule(Limits),
        "drive": rules.make_optional_rule(rules.make_kind_rule(Drive)),
        "pitch": rules.make_real_rule("m"),
        "interface": rules.check_text,
    }

    @property
    def nq(self) -> int:
        """Number of configuration coordinates [-]."""
        return len(KINDS[self.kind].q)

    @property
    def nv(self) -> int:
        """Number of velocity coordinates [-]."""
        return len(KINDS[self.kind].v)

    @property
    def axes(self) -> tuple[Array, ...]:
        """Axes (3,) [-] of the joint's nodes, one after the other: a universal joint is two revolute ones."""
        return (self.axis, self.second_axis) if self.kind == "universal" else (self.axis,)

    def compute_motion_subspace(self, axis: Array) -> tuple[Array, Array]:
        """Return the motion subspace S_v, S_w (coordinates, 3) [-] of the node with this one of the ``axes``."""
        return compute_motion_subspace(KINDS[self.kind].number, axis, self.pitch)
