"""Kinds of joint in one table: coordinates, units and motion subspace of each; all other modules ask it.

A joint moves its child by  p = p_0 + S_v q,  R = exp(S_w q):  the columns of its *motion subspace* S = (S_v, S_w) are the
translation and the rotation of the child for a unit of each velocity coordinate, in the child's own axes: constants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.typing import Array

# Kinds of connection between a node and its parent, as numbers for kernels.
RIGID, REVOLUTE, PRISMATIC, SPHERICAL, FREE, SECTION, CONTINUOUS, HELICAL, SHAPED = range(9)

# Layouts of the configuration coordinates: numbers of their own, cosine and sine, a quaternion, a position and a quaternion.
PLAIN = "plain"
CIRCLE = "circle"
ROTATION = "rotation"
POSE = "pose"


@dataclass(frozen=True)
class JointKind:
    """Data of a kind of joint.

    number : of its nodes, for kernels; q, v : suffixes of the names of its configuration and velocity coordinates
    units : "rad" or "m" of each velocity coordinate; layout : of the configuration coordinates
    repeats : a whole turn of a coordinate brings the child back to where it was
    """

    number: int
    q: tuple[str, ...]
    v: tuple[str, ...]
    units: tuple[str, ...]
    layout: str = PLAIN
    repeats: bool = False

    @property
    def scalar(self) -> bool:
        """Return True if each coordinate is one number, an angle [rad] or a length [m]."""
        return bool(self.v) and self.layout in (PLAIN, CIRCLE)

    @property
    def circle(self) -> bool:
        """Return True if the configuration is the cosine and the sine of one angle [-]."""
        return self.layout == CIRCLE

    @property
    def counts_turns(self) -> bool:
        """Return True if the coordinate is one number [rad], [m] that counts whole turns."""
        return self.layout == PLAIN and len(self.v) == 1

    @property
    def has_quaternion(self) -> bool:
        """Return True if the last four configuration coordinates are a quaternion x, y, z, w [-]."""
        return self.layout in (ROTATION, POSE)

    @property
    def translations(self) -> tuple[bool, ...]:
        """Return True for each velocity coordinate that is a translation [m], whose effort is a force [N]."""
        return tuple(unit == "m" for unit in self.units)


_ANGLES = ("rad", "rad", "rad")
_LENGTHS = ("m", "m", "m")
_QUATERNION = (".qx", ".qy", ".qz", ".qw")
_RATES = (".wx", ".wy", ".wz")
# The layout is Pinocchio's: a continuous joint is (cos, sin), a rotation is a quaternion x, y, z, w, a free joint is position
# then quaternion, and its velocity is linear then angular, in the child's frame.
KINDS: dict[str, JointKind] = {
    "revolute": JointKind(REVOLUTE, ("",), ("",), ("rad",), repeats=True),
    "continuous": JointKind(CONTINUOUS, (".cos", ".sin"), ("",), ("rad",), CIRCLE, repeats=True),
    "prismatic": JointKind(PRISMATIC, ("",), ("",), ("m",)),
    "helical": JointKind(HELICAL, ("",), ("",), ("rad",)),  # a turn of the screw does not bring the nut back
    "spherical": JointKind(SPHERICAL, _QUATERNION, _RATES, _ANGLES, ROTATION),
    "universal": JointKind(REVOLUTE, (".1", ".2"), (".1", ".2"), ("rad", "rad"), repeats=True),  # two nodes
    "fixed": JointKind(RIGID, (), (), ()),
    "free": JointKind(FREE, (".x", ".y", ".z", *_QUATERNION), (".vx", ".vy", ".vz", *_RATES), _LENGTHS + _ANGLES, POSE),
}
# Node kind -> number of configuration and of velocity coordinates.
CONFIGURATIONS = {RIGID: 0, SECTION: 0, SHAPED: 0} | {
    k.number: len(k.q) for k in KINDS.values() if k != KINDS["universal"]
}
VELOCITIES = {RIGID: 0, SECTION: 0, SHAPED: 0} | {k.number: len(k.v) for k in KINDS.values() if k != KINDS["universal"]}


def compute_motion_subspace(number: int, axis: Array, pitch: float = 0.0) -> tuple[Array, Array]:
    """Return S_v, S_w, (nv, 3) each [-] or [m/rad], of a node's joint about or along ``axis`` (3,) [-], in the child's frame.

    pitch : of a helical joint [m], its way along the axis for a whole turn about it
    """
    eye = np.eye(3)
    none = np.zeros((3, 3))
    if number == PRISMATIC:
        return axis[None], none[:1]
    if number == SPHERICAL:
        return none, eye
    if number == FREE:
        return np.vstack([eye, none]), np.vstack([none, eye])
    if number == HELICAL:
        return pitch / (2.0 * np.pi) * axis[None], axis[None]
    if number in (REVOLUTE, CONTINUOUS):
        return none[:1], axis[None]
    return none[:0], none[:0]
