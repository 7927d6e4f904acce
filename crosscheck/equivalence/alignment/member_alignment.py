"""Alignment of a member of B with the one of A that it is, and what of its joint's place is an offset of a zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosscheck.equivalence.tree import SCALARS, Member
from crosscheck.lifting.rigid import (
    apply_placement,
    compute_angle,
    compute_angle_about,
    compute_norm,
    compute_relative_pose,
    inverse,
    turned,
)
from flexinv.model.mechanism import Placement

SEEN = 1e-6  # relative: what agrees better than that is the same for the choice of an alignment
ROUGH = 1e-4  # [rad], relative: what printed digits leave open beside an offset of a zero
SAME = 1e-9  # relative: what agrees better than that is no difference
UNBOUND = 1e8  # [rad], [m]: a limit that large binds no machine
# What a turn may leave beside its part about the joint's axis, relative to that, where the part is told as a zero.  An axis drawn
# at random comes that near to the joint's once in 200, 1 - cos(APART) = 0.005: what is nearer is no accident.
APART = 0.1


@dataclass(frozen=True)
class MemberAlignment:
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


def make_joint_alignment(
    one: Member, two: Member, numbers: tuple[int, int], before: Placement, frame: Placement
) -> MemberAlignment:
    """Return the seat that follows of two poses of B's frames in A's, of a member's carrier and of its own [m]."""
    shift = apply_placement(
        compute_relative_pose(one.placement, apply_placement(before, two.placement)), inverse(frame)
    )
    sign, offset, rest = _fit_coordinate(one, two, frame, shift)
    return MemberAlignment(*numbers, frame, rest, sign, offset)


def _fit_coordinate(one: Member, two: Member, frame: Placement, shift: Placement) -> tuple[float, float, Placement]:
    """Sign and offset of a scalar coordinate, and what of the shift they leave: A's q = sign B's q + offset.

    shift = rest exp(a offset)  with B's axis a; where the rest is more than a small part of it, all of it is one difference,
    unless limits or the rest of a spring have moved by just that offset.
    """
    if one.kind not in SCALARS:
        return 1.0, 0.0, shift
    axis = frame.rotation @ two.axis
    sign = 1.0 if one.axis @ axis >= -SEEN else -1.0  # across each other, neither is the other one turned
    axis = sign * axis
    if one.kind == "prismatic":
        offset = float(axis @ shift.rotation.T @ shift.position)
        rest = apply_placement(shift, Placement(-offset * axis))
        left = compute_norm(rest.position)
    else:
        offset = compute_angle_about(shift.rotation, axis)
        if one.kind == "helical":
            offset = _add_pitch_turns(one, offset, float(axis @ shift.position))
        way = one.pitch * offset / (2 * np.pi) * axis if one.kind == "helical" else np.zeros(3)
        rest = apply_placement(shift, inverse(Placement(way, turned(axis, offset))))
        left = compute_angle(rest.rotation)
        offset = _add_whole_turns(one, two, sign, offset)
    told = left <= max(ROUGH, APART * abs(offset)) or _has_shifted_numbers(one, two, sign, offset)
    return (sign, offset, rest) if told else (sign, 0.0, shift)


def _add_pitch_turns(one: Member, offset: float, along: float) -> float:
    """The offset [rad] of a screw with the whole turns that its way along the axis says [m].

    Where that way is no whole number of pitches, the screw itself stands elsewhere: no turns are told by it, but that half a turn
    is one to the side that leaves less.
    """
    if not one.pitch:
        return offset
    turns = along / one.pitch - offset / (2 * np.pi)
    half = abs(abs(offset) - np.pi) <= ROUGH
    if abs(turns - round(turns)) <= ROUGH:
        return offset + 2 * np.pi * round(turns)
    other = -float(np.sign(offset))
    return offset + 2 * np.pi * other if half and abs(turns - other) < abs(turns) else offset


def _has_shifted_numbers(one: Member, two: Member, sign: float, offset: float) -> bool:
    """Return True where all that a joint states in its coordinate [rad], [m] has moved by an offset, and something has."""
    if abs(offset) <= ROUGH:
        return False
    coordinate_numbers = _list_coordinate_numbers(one, two, sign)
    return bool(coordinate_numbers) and all(
        abs(first - second - offset) <= ROUGH for first, second in coordinate_numbers
    )


def _list_coordinate_numbers(one: Member, two: Member, sign: float) -> list[tuple[float, float]]:
    """Numbers that both joints state in their coordinates, B's by A's sign [rad], [m]: the rest of a spring, limits that bind."""
    low, high = (two.limits.lower, two.limits.upper) if sign > 0.0 else (-two.limits.upper, -two.limits.lower)
    ends = (one.limits.lower, low), (one.limits.upper, high)
    found = [(a, b) for a, b in ends if max(abs(a), abs(b)) < UNBOUND]
    return [(one.rest, sign * two.rest), *found] if one.stiffness and two.stiffness else found


def _add_whole_turns(one: Member, two: Member, sign: float, offset: float) -> float:
    """The offset [rad] with as many whole turns as limits, or rests of springs, say: no frame shows them.

    A coordinate that only counts the other way, and whose limits are the same numbers in both files, has no other zero.
    """
    if one.kind != "revolute" or (abs(offset) <= ROUGH and has_same_limits(one, two)):
        return offset
    told = [first - second for first, second in _list_coordinate_numbers(one, two, sign)]
    turns = {round((way - offset) / (2 * np.pi)) for way in told}
    # Only where it is whole turns that they say: other limits are other limits.
    whole = len(turns) == 1 and all(
        abs((way - offset) / (2 * np.pi) - round((way - offset) / (2 * np.pi))) <= ROUGH for way in told
    )
    return offset + 2 * np.pi * turns.pop() if whole else offset


def is_same_as_printed(one: float, two: float) -> bool:
    """Compare two limits to the digits that are printed of them [rad], [m]."""
    return one == two or abs(one - two) <= ROUGH * max(abs(one), 1.0)


def has_same_limits(one: Member, two: Member) -> bool:
    """Return True where both files state the same numbers [rad], [m], however the coordinates count."""
    return is_same_as_printed(one.limits.lower, two.limits.lower) and is_same_as_printed(
        one.limits.upper, two.limits.upper
    )
