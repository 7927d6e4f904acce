"""Alignment: which pose of B's frame in A's makes two members the same body, and which offsets and signs follow.

The frame of a link is a convention.  Of each member two poses are tried: the one that leaves both machines where they stand at
zero, and the one in which both frames are the same; the one that more of what can be seen agrees with is taken: own axis, centre
of mass, tensor, axes of what it carries.  A turn about the joint's own axis that is left over is an offset of its zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from crosscheck.equivalence.tree import SCALARS, Member, Tree
from crosscheck.lifting.rigid import angle, angle_about, between, inverse, moved, on, turned
from flexinv.model.mechanism import Array, Placement

SEEN = 1e-6  # relative: what agrees better than that is the same for the choice of an alignment
ROUGH = 1e-4  # relative: what printed digits leave open beside an offset of a zero
SAME = 1e-9  # relative: what agrees better than that is no difference


@dataclass(frozen=True)
class Aligned:
    """A member of A and the one of B that it is.

    frame : B's frame in A's [m]; shift : pose of B's zero in A's joint frame, the identity where zeros agree [m]
    sign : of B's coordinate in A's [-]; offset : A's coordinate where B's is zero [rad], [m]
    rest : of ``shift`` what no offset explains [m]: a joint that stands elsewhere
    """

    first: int
    second: int
    frame: Placement
    rest: Placement
    sign: float = 1.0
    offset: float = 0.0


def aligned(first: Tree, second: Tree, pairs: list[tuple[int, int]], size: float, zeros: bool = True) -> list[Aligned]:
    """Return the alignment of every pair of members, parents first; size : of the machines [m]; zeros : they may be turned."""
    found: dict[int, Aligned] = {}
    partner = dict(pairs)
    for a, b in pairs:
        carrier = first.members[a].parent
        before = found[carrier].frame if carrier >= 0 else Placement()
        found[a] = Pairing(first, second, partner, size, zeros).align(a, b, before)
    return list(found.values())


@dataclass(frozen=True)
class Pairing:
    """Two trees whose members are matched: partner by number in the first; zeros : poses with turned zeros are tried."""

    first: Tree
    second: Tree
    partner: dict[int, int]
    size: float
    zeros: bool = True

    def align(self, a: int, b: int, before: Placement) -> Aligned:
        """Return the alignment of one pair [m]; before : of the members that carry them."""
        one, two = self.first.members[a], self.second.members[b]
        standing = on(before, two.placement)  # B's joint frame in the frame of A's carrier
        still = between(one.placement, standing)
        choices = [still, Placement(), *self._hung_alike(a, b)]
        choices += self._turned_zeros(a, b, still) if self.zeros else ()
        best = max(choices, key=lambda frame: self._seen(a, b, self._on_axis(one, two, frame)))
        frame = self._on_axis(one, two, best)
        shift = on(between(one.placement, standing), inverse(frame))
        sign, offset, rest = _coordinate(one, two, frame, shift, self.size)
        return Aligned(a, b, frame, rest, sign, offset)

    def _on_axis(self, one: Member, two: Member, frame: Placement) -> Placement:
        """The frame moved across B's axis until that leads through A's origin: only its direction is then A's to change."""
        if one.kind not in ("revolute", "helical"):
            return Placement(np.zeros(3), frame.rotation) if one.kind == "spherical" else frame
        axis = frame.rotation @ two.axis
        return Placement(float(frame.position @ axis) * axis, frame.rotation)

    def _hung_alike(self, a: int, b: int) -> Iterator[Placement]:
        """Poses of a body that floats in which a joint that it carries stands where A has it: its own frame may be anywhere."""
        if self.first.members[a].kind == "free":
            for k in self.first.children(a):
                if k in self.partner:
                    yield on(self.first.members[k].placement, inverse(self.second.members[self.partner[k]].placement))

    def _turned_zeros(self, a: int, b: int, still: Placement) -> Iterator[Placement]:
        """Poses turned about the axis, or moved along it, until a centre of mass or a carried axis agrees."""
        one, two = self.first.members[a], self.second.members[b]
        if one.kind == "prismatic":
            gap = one.com - (still.position + still.rotation @ two.com)
            yield Placement(still.position + gap @ one.axis * one.axis, still.rotation)
        if one.kind != "revolute":
            return
        for ours, theirs in self._points(a, b):
            turn = _turn_between(one.axis, on(still, Placement(theirs)).position, ours, self.size)
            if turn is not None:
                yield on(Placement(rotation=turned(one.axis, turn)), still)
        for ours, theirs in self._directions(a, b):
            turn = _turn_between(one.axis, still.rotation @ theirs, ours, 1.0)
            if turn is not None:
                yield on(Placement(rotation=turned(one.axis, turn)), still)
                yield on(Placement(rotation=turned(one.axis, turn + np.pi)), still)

    def _points(self, a: int, b: int) -> Iterator[tuple[Array, Array]]:
        one, two = self.first.members[a], self.second.members[b]
        if one.mass and two.mass:
            yield one.com, two.com
        for k in self.first.children(a):
            if k in self.partner:
                yield self.first.members[k].placement.position, self.second.members[self.partner[k]].placement.position

    def _directions(self, a: int, b: int) -> Iterator[tuple[Array, Array]]:
        for k in self.first.children(a):
            if k in self.partner and self.first.members[k].kind in SCALARS:
                ours, theirs = self.first.members[k], self.second.members[self.partner[k]]
                yield ours.placement.rotation @ ours.axis, theirs.placement.rotation @ theirs.axis

    def _seen(self, a: int, b: int, frame: Placement) -> float:
        """Count the things that both members show and that agree in this pose."""
        one, two = self.first.members[a], self.second.members[b]
        score = 0.0
        if one.kind in SCALARS:
            score += _parallel(one.axis, frame.rotation @ two.axis)
        if one.mass and two.mass:
            there = moved(frame, two.inertia)
            score += float(np.linalg.norm(there.com - one.com) <= SEEN * self.size)
            largest = float(np.abs(one.tensor).max())
            score += float(np.abs(there.tensor - one.tensor).max() <= SEEN * largest) if largest else 0.0
        for k in self.first.children(a):
            if k in self.partner:
                score += self._carried(self.first.members[k], self.second.members[self.partner[k]], frame)
        return score

    def _carried(self, ours: Member, theirs: Member, frame: Placement) -> float:
        """Agreement of the line of a joint that both carry; of a fixed one, of its frame."""
        there = on(frame, theirs.placement)
        gap = there.position - ours.placement.position
        if ours.kind not in SCALARS:
            turn = angle(ours.placement.rotation.T @ there.rotation)
            return float(np.linalg.norm(gap) <= SEEN * self.size) + float(turn <= SEEN)
        along = ours.placement.rotation @ ours.axis
        score = _parallel(along, there.rotation @ theirs.axis)
        if ours.kind == "revolute":
            score += float(np.linalg.norm(np.cross(along, gap)) <= SEEN * self.size)
        return score


def _parallel(one: Array, two: Array) -> float:
    return float(np.linalg.norm(np.cross(one, two)) <= SEEN)


def _turn_between(axis: Array, start: Array, end: Array, scale: float) -> float | None:
    """The angle [rad] about an axis from one vector to another; None where one of them lies along it."""
    u, v = start - (start @ axis) * axis, end - (end @ axis) * axis
    if min(np.linalg.norm(u), np.linalg.norm(v)) <= SEEN * scale:
        return None
    return float(np.arctan2(axis @ np.cross(u, v), u @ v))


def _coordinate(
    one: Member, two: Member, frame: Placement, shift: Placement, size: float
) -> tuple[float, float, Placement]:
    """Sign and offset of a scalar coordinate, and what of the shift they leave: A's q = sign B's q + offset.

    shift = rest exp(a offset)  with B's axis a; where the rest is more than rounding, all of the shift is one difference.
    """
    if one.kind not in SCALARS:
        return 1.0, 0.0, shift
    axis = frame.rotation @ two.axis
    sign = 1.0 if one.axis @ axis >= -SEEN else -1.0  # across each other, neither is the other one turned
    axis = sign * axis
    if one.kind == "prismatic":
        offset = float(axis @ shift.rotation.T @ shift.position)
        rest = on(shift, Placement(-offset * axis))
    else:
        offset = angle_about(shift.rotation, axis)
        rest = on(shift, Placement(rotation=turned(axis, -offset)))
    far = angle(rest.rotation) > ROUGH or np.linalg.norm(rest.position) > ROUGH * size
    return (sign, 0.0, shift) if far or one.kind == "helical" else (sign, offset, rest)
