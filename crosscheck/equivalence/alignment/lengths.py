"""Lengths of lists of differences: of two that explain as much, the one is taken that is shorter and whose sizes are smaller.

A difference of relative size x costs one line, and the digits that are needed to tell it:

    length(x)  =  0  where  x <= SEEN,      1 + log10(x / SEEN)  else

Conventions are told in half of that, and so are limits: those decide between zeros.  What a member shows of its frame is counted
and nothing more: a link that is round about its joint's axis adds the same length in every pose.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from crosscheck.equivalence.alignment.seats import ROUGH, SAME, SEEN, Aligned, joined
from crosscheck.equivalence.tree import SCALARS, Member, Tree
from crosscheck.lifting.rigid import angle, cross, moved, on, size_of
from flexinv.model.mechanism import Array, Inertia, Placement

HALF = 0.5  # of the length of a difference: how conventions and limits weigh
FRAME = 0.01  # length of a frame that stands elsewhere: what is said of it in a note
HINGES = ("revolute", "helical")


def length(size: float) -> float:
    """Return the length of a difference by its relative size [-]."""
    return 1.0 + float(np.log10(size / SEEN)) if size > SEEN else 0.0


@dataclass(frozen=True)
class Content:
    """A rigid part of both trees as it shows its frame: bodies, and joints that hang on it, in the frame of its first member.

    bodies : inertias of both [kg, m, kg m^2]; hung : kind, placements [m] and axes [-] of both
    """

    bodies: list[tuple[Inertia, Inertia]]
    hung: list[tuple[str, tuple[Placement, Array], tuple[Placement, Array]]]


@dataclass
class Lengths:
    """Two trees whose members are matched, partner by number in the first, and what differs in poses; size : of both [m]."""

    first: Tree
    second: Tree
    partner: dict[int, int]
    size: float
    known: dict[int, Content] = field(default_factory=dict)

    @property
    def nothing(self) -> float:
        """Return the length up to which nothing but a frame differs [-]."""
        return 1.5 * FRAME

    def of_joint(self, a: int, before: Placement, frame: Placement) -> float:
        """Return the length of what differs in a joint, where its carrier and its own frame stand so [m]."""
        one, two = self.first.members[a], self.second.members[self.partner[a]]
        seat = joined(one, two, (a, self.partner[a]), before, frame)
        apart = max(float(np.abs(frame.position).max()) / self.size, float(np.abs(frame.rotation - np.eye(3)).max()))
        total = FRAME if apart > SEEN else 0.0
        if one.kind == "free":
            return total
        way = size_of(seat.rest.position) / self.size
        total += length(way) + length(angle(seat.rest.rotation))
        if one.kind in SCALARS:
            total += length(size_of(cross(one.axis, frame.rotation @ two.axis))) + float(seat.sign < 0.0)
            total += HALF * length(abs(seat.offset) / (self.size if one.kind == "prismatic" else 1.0))
            total += self._of_bounds(one, two, seat)
        return total

    def _of_bounds(self, one: Member, two: Member, seat: Aligned) -> float:
        """The length of limits and rests of springs that do not agree in these coordinates."""
        total = 0.0
        ends = sorted((seat.sign * two.limits.lower + seat.offset, seat.sign * two.limits.upper + seat.offset))
        for ours, theirs in zip((one.limits.lower, one.limits.upper), ends, strict=True):
            if ours != theirs and not abs(ours - theirs) <= ROUGH * max(abs(ours), 1.0):
                total += HALF * length(min(abs(ours - theirs), 2 * np.pi))
        if one.stiffness and two.stiffness:
            total += length(abs(seat.sign * two.rest + seat.offset - one.rest))
        return total

    def of_body(self, a: int, frame: Placement) -> float:
        """Return the length of what differs in where a link's mass is, in a pose of B's frame in A's [m]."""
        one, two = self.first.members[a], self.second.members[self.partner[a]]
        return self._of_bodies(one.inertia, moved(frame, two.inertia))

    def _of_bodies(self, one: Inertia, there: Inertia) -> float:
        if not one.mass or not there.mass:
            return 0.0
        total = length(size_of(there.com - one.com) / self.size)
        largest = float(np.abs(one.tensor).max())
        return total + (length(float(np.abs(there.tensor - one.tensor).max()) / largest) if largest else 0.0)

    def of_content(self, a: int, frame: Placement) -> float:
        """Return the length of what differs in all that shows how a rigid part stands, in a pose of B's frame in A's [m]."""
        content = self.content(a)
        total = sum(self._of_bodies(one, moved(frame, two)) for one, two in content.bodies)
        return total + sum(self._of_hung(*hung, frame) for hung in content.hung)

    def _of_hung(
        self, kind: str, ours: tuple[Placement, Array], theirs: tuple[Placement, Array], frame: Placement
    ) -> float:
        gap = frame.position + frame.rotation @ theirs[0].position - ours[0].position
        if kind not in SCALARS:
            return length(size_of(gap) / self.size)
        along = ours[0].rotation @ ours[1]
        total = length(size_of(cross(along, frame.rotation @ (theirs[0].rotation @ theirs[1]))))
        return total + (length(size_of(cross(along, gap)) / self.size) if kind in HINGES else 0.0)

    def content(self, a: int) -> Content:
        """Return the bodies and joints by which a member and all that is fixed to it show how they stand, found once [kg, m]."""
        if a not in self.known:
            one, two = self.first.members[a], self.second.members[self.partner[a]]
            found = Content([(one.inertia, two.inertia)], [])
            self._gather(a, Placement(), Placement(), found)
            self.known[a] = found
        return self.known[a]

    def _gather(self, a: int, ours: Placement, theirs: Placement, found: Content) -> None:
        for c in self.first.children(a):
            if c not in self.partner:
                continue
            one, two = self.first.members[c], self.second.members[self.partner[c]]
            here, there = on(ours, one.placement), on(theirs, two.placement)
            if one.kind == "fixed":
                found.bodies.append((moved(here, one.inertia), moved(there, two.inertia)))
                self._gather(c, here, there, found)
            elif one.kind == two.kind:
                found.hung.append((one.kind, (here, one.axis), (there, two.axis)))

    def of_base(self, motion: Placement) -> float:
        """Return the length of a motion of the base, or of gravity where that is what differs [m]."""
        ours, theirs = self.first.gravity, self.second.gravity
        pull = max(size_of(ours), size_of(theirs)) or 1.0
        felt = length(size_of(motion.rotation @ theirs - ours) / pull)
        size = max(size_of(motion.position) / self.size, angle(motion.rotation))
        if size <= SAME:
            return felt
        changed = length(size_of(theirs - ours) / pull)
        # Gravity that stays the same in the world while the base turns is felt, and is the motion's: one difference.
        if felt:
            return length(size) + (felt if changed else FRAME)
        return HALF * length(size)
