"""Costs of taking a joint of one tree for a joint of another: how far their axes lie apart at zero, how their masses differ.

Where axes stand at zero is a convention.  What is none is how an axis lies to the one before it: the least distance  a  of both
lines and the angle  alpha  between them, Denavit's and Hartenberg's link length and twist.  `PairCosts.compute_step_cost`
compares these.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from crosscheck.equivalence.tree import SCALARS, Tree
from crosscheck.lifting.rigid import compute_norm, cross
from flexinv.model.mechanism import Limits, Placement

IMPOSSIBLE = 1e6  # cost of a pair of joints of different kinds
PARALLEL = 1e-6  # sine of the angle between two axes, below which they have no common normal of their own


SMALL = 1e-4  # of the size of the machines: an arm that printed digits may have made
UNBOUND = 1e8  # a limit that large is none: formats that demand one are given such


def _compute_relative_gap(one: float, other: float) -> float:
    """Distance of two numbers over their sum [-]."""
    return abs(one - other) / ((abs(one) + abs(other)) or 1.0)


def _compute_limit_range(limits: Limits) -> float:
    """The way between the limits of a coordinate, wherever its zero is; 0 where one is missing [rad], [m]."""
    return limits.upper - limits.lower if max(abs(limits.upper), abs(limits.lower)) < UNBOUND else 0.0


@dataclass(frozen=True)
class PairCosts:
    """Two trees, and what a pair of their members costs."""

    first: Tree
    second: Tree

    @cached_property
    def poses(self) -> tuple[list[Placement], list[Placement]]:
        """Return the frames of both trees' members, all joints at zero [m]."""
        return self.first.compute_poses(), self.second.compute_poses()

    @cached_property
    def _axes(self) -> tuple[JointAxes, JointAxes]:
        return JointAxes(self.first, self.poses[0]), JointAxes(self.second, self.poses[1])

    @cached_property
    def size(self) -> float:
        """Return the extent of the machines [m]."""
        places = [pose.position for pose in (*self.poses[0], *self.poses[1])]
        return float(np.ptp(places, axis=0).max(initial=0.0)) or 1.0 if places else 1.0

    def compute_member_cost(self, a: int, b: int) -> float:
        """Return the cost [-] of taking two members for the same, whatever they carry."""
        one = self.first.members[a]
        two = self.second.members[b]
        if one.kind != two.kind:
            return IMPOSSIBLE
        return self._compute_axis_gap(a, b) + self._compute_mass_gap(a, b)

    def compute_step_cost(self, before: tuple[int, int], a: int, b: int) -> float:
        """Return the cost [-] of taking two members for the same, as they lie to a pair before them, -1 and -1 the world."""
        if self.first.members[a].kind != self.second.members[b].kind:
            return IMPOSSIBLE
        if before == (-1, -1):
            return self.compute_member_cost(a, b)
        one = self._axes[0].find_axis_distance(before[0], a)
        two = self._axes[1].find_axis_distance(before[1], b)
        return abs(one[0] - two[0]) / self.size + float(abs(np.sin(one[1] - two[1]))) + self._compute_mass_gap(a, b)

    def compute_invariant_cost(self, before: tuple[int, int], a: int, b: int) -> float:
        """Return the cost [-] of what two members show wherever the machines and the zeros stand.

        That is how their axes lie to those before them, -1 and -1 the world, their mass about their axes, ranges and dampers.
        """
        if self.first.members[a].kind != self.second.members[b].kind:
            return IMPOSSIBLE
        total = sum(
            _compute_relative_gap(x, y)
            for x, y in zip(self._list_member_features(0, a), self._list_member_features(1, b), strict=True)
        )
        return (
            total if before == (-1, -1) else total + self.compute_step_cost(before, a, b) - self._compute_mass_gap(a, b)
        )

    def _list_member_features(self, side: int, index: int) -> tuple[float, ...]:
        """Mass, moment of inertia about the axis or in all, distance of the centre of mass from the axis, range, damping."""
        member = (self.first, self.second)[side].members[index]
        turn = float(np.trace(member.tensor))
        arm = compute_norm(member.com)
        if member.kind in SCALARS:
            turn = float(member.axis @ member.tensor @ member.axis)
            arm = compute_norm(cross(member.axis, member.com))
        if member.kind in ("prismatic", "free"):  # the frame may be anywhere on the body
            arm = 0.0
        return (
            member.mass,
            turn,
            arm if arm > SMALL * self.size else 0.0,
            _compute_limit_range(member.limits),
            member.damping,
        )

    def _compute_mass_gap(self, a: int, b: int) -> float:
        one = self.first.members[a].mass
        two = self.second.members[b].mass
        return abs(one - two) / (one + two or 1.0)

    def _compute_axis_gap(self, a: int, b: int) -> float:
        """Distance of two axes at zero over the size of the machines, and the sine of the angle between them."""
        one = self.first.members[a]
        two = self.second.members[b]
        first = self.poses[0][a]
        second = self.poses[1][b]
        along = first.rotation @ one.axis
        other = second.rotation @ two.axis
        if one.kind not in SCALARS:
            return compute_norm(first.position - second.position) / self.size
        gap = second.position - first.position
        off = 0.0 if one.kind == "prismatic" else compute_norm(cross(along, gap))
        return off / self.size + compute_norm(cross(along, other))


@dataclass
class JointAxes:
    """Axes of the joints of a tree in space, all at zero; poses : the frames of its members, known : what `between` has found."""

    tree: Tree
    poses: list[Placement]
    known: dict[tuple[int, int], tuple[float, float]] = field(default_factory=dict)

    def find_axis_distance(self, before: int, index: int) -> tuple[float, float]:
        """Return distance [m] and angle [rad] of the axes of two joints; of joints without an axis, of their places."""
        if (before, index) not in self.known:
            self.known[before, index] = self._compute_axis_distance(before, index)
        return self.known[before, index]

    def _compute_axis_distance(self, before: int, index: int) -> tuple[float, float]:
        members = [self.tree.members[k] for k in (before, index)]
        gap = self.poses[index].position - self.poses[before].position
        if members[0].kind == "free":
            return 0.0, 0.0  # its frame may be anywhere on the body
        if any(member.kind not in SCALARS for member in members):
            return compute_norm(gap), 0.0
        one, two = (self.poses[k].rotation @ member.axis for k, member in zip((before, index), members, strict=True))
        normal = cross(one, two)
        sine = compute_norm(normal)
        turn = float(np.arctan2(sine, abs(one @ two)))
        if any(member.kind == "prismatic" for member in members):
            return 0.0, turn
        return float(abs(gap @ normal)) / sine if sine > PARALLEL else compute_norm(cross(one, gap)), turn
