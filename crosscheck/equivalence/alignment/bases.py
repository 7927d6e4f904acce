"""Bases: where all that stands on the world is turned and moved together, that is one difference and not one of each joint.

A joint stands at X in the world of A at zero, and at X' in that of B.  Where  X = T X'  with one T, the machine of B is A's that
stands elsewhere.  Where gravity keeps its direction in it no torque feels that, and it is a convention.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from crosscheck.equivalence.alignment.member_alignment import SAME
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.members import MemberPair, format_placement
from crosscheck.equivalence.tree import Tree
from crosscheck.lifting.rigid import compute_angle, inverse
from flexinv.model.mechanism import Array, Placement

BASE = "pose of base"
FELT = "gravity has another direction in it"
UNFELT = "no torque feels it: gravity has the same direction in it"


def list_base_differences(
    first: Tree, second: Tree, motion: Placement, pairs: Iterable[MemberPair]
) -> Iterator[Difference]:
    """Yield what differs of where both machines stand [m], [rad], and of gravity [m/s^2]; motion : of B's world in A's."""
    ours = first.gravity
    theirs = second.gravity
    there = motion.rotation @ second.gravity
    pull = max(float(np.linalg.norm(ours)), float(np.linalg.norm(theirs)))
    felt = float(np.linalg.norm(there - ours)) > SAME * pull
    other = float(np.linalg.norm(theirs - ours)) > SAME * pull
    way = float(np.linalg.norm(motion.position))
    turn = compute_angle(motion.rotation)
    if max(way, turn) > SAME:
        standing = [pair for pair in pairs if pair.one.parent < 0]
        size, unit = (turn, "rad") if turn > SAME else (way, "m")
        quantity = "rotation" if turn > SAME else "position"
        back = inverse(motion)
        yield Difference(
            "rigid" if felt else "convention", BASE, "the machine", size, unit, format_placement(Placement()),
            format_placement(back), ((-1, "gravity", there),) if felt else (), (FELT if felt else UNFELT,),
            printed=max((pair.compute_joint_rounding(quantity) for pair in standing), default=0.0), structural=True, motion=back,
        )  # fmt: skip
    if felt and other:
        size = float(np.linalg.norm(theirs - ours))
        yield Difference(
            "rigid",
            "gravity",
            "the world",
            size,
            "m/s^2",
            _format_gravity(ours),
            _format_gravity(theirs),
            _make_gravity_change(there),
        )


def _make_gravity_change(there: Array) -> tuple[tuple[int, str, Array], ...]:
    return ((-1, "gravity", there),)


def _format_gravity(gravity: Array) -> str:
    return " ".join(f"{x:.9g}" for x in gravity)
