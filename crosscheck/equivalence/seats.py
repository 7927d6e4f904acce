"""Seats: how a member of B sits on the one of A that it is, and what of its joint's place is an offset of a zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosscheck.equivalence.tree import SCALARS, Member
from crosscheck.lifting.rigid import angle, angle_about, between, inverse, on, turned
from flexinv.model.mechanism import Placement

SEEN = 1e-6  # relative: what agrees better than that is the same for the choice of an alignment
ROUGH = 1e-4  # [rad], relative: what printed digits leave open beside an offset of a zero
SAME = 1e-9  # relative: what agrees better than that is no difference
APART = 0.1  # of a turn or way that its part about or along the axis leaves, below which that part is told as a zero


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


def joined(one: Member, two: Member, numbers: tuple[int, int], before: Placement, frame: Placement) -> Aligned:
    """Return what follows of two poses of B's frames in A's, of a member's carrier and of its own [m]."""
    shift = on(between(one.placement, on(before, two.placement)), inverse(frame))
    sign, offset, rest = _coordinate(one, two, frame, shift)
    return Aligned(*numbers, frame, rest, sign, offset)


def _coordinate(one: Member, two: Member, frame: Placement, shift: Placement) -> tuple[float, float, Placement]:
    """Sign and offset of a scalar coordinate, and what of the shift they leave: A's q = sign B's q + offset.

    shift = rest exp(a offset)  with B's axis a; where the rest is more than a small part of it, all of it is one difference.
    """
    if one.kind not in SCALARS:
        return 1.0, 0.0, shift
    axis = frame.rotation @ two.axis
    sign = 1.0 if one.axis @ axis >= -SEEN else -1.0  # across each other, neither is the other one turned
    axis = sign * axis
    if one.kind == "prismatic":
        offset = float(axis @ shift.rotation.T @ shift.position)
        rest = on(shift, Placement(-offset * axis))
        left = float(np.linalg.norm(rest.position))
    else:
        offset = angle_about(shift.rotation, axis)
        way = one.pitch * offset / (2 * np.pi) * axis if one.kind == "helical" else np.zeros(3)
        rest = on(shift, inverse(Placement(way, turned(axis, offset))))
        left = angle(rest.rotation)
    return (sign, offset, rest) if left <= max(ROUGH, APART * abs(offset)) else (sign, 0.0, shift)
