"""Bases: where all that stands on the world is turned and moved together, that is one difference and not one of each joint.

A joint stands at X in the world of A at zero, and at X' with what its own place and those of fixed links before it differ by.
Where  T = X' X^-1  is the same for most joints, the machine of B is A's that stands elsewhere: x' = T x.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from crosscheck.equivalence.align import ROUGH, SAME
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.members import placement_text
from crosscheck.equivalence.tree import Tree
from crosscheck.lifting.rigid import angle, between, inverse, on
from flexinv.model.mechanism import Placement

BASE = "pose of base"
PLACES = ("position of joint", "orientation of joint")
JOINTS = 2  # from which on a common motion is no accident
FELT = "gravity has another direction in it"
UNFELT = "no torque feels it: gravity has the same direction in it"


def moved_base(first: Tree, found: list[Difference], size: float) -> list[Difference]:
    """Return the differences with the common motion of all that stands on the world as one [m], [rad]; size : of machines [m]."""
    places = [d for d in found if d.cause in PLACES]
    standing = [k for k in first.moving.values() if not _carried_by_moving(first, k)]
    own = {k: [d for d in places if {index for index, _, _ in d.changes} & _fixed_before(first, k)] for k in standing}
    if sum(bool(ds) for ds in own.values()) < JOINTS:
        return found
    before, after = first.poses(), first.changed(c for d in places for c in d.changes).poses()
    motions = {k: on(after[k], inverse(before[k])) for k in standing if own[k]}
    slack = {k: min(sum(d.printed for d in own[k]), ROUGH * size) + SAME * size for k in motions}
    alike = {k: [m for m in motions if _agree(motions[k], motions[m], slack[k] + slack[m], size)] for k in motions}
    best = max(alike, key=lambda k: len(alike[k]))
    if len(alike[best]) < JOINTS or 2 * len(alike[best]) <= len(standing):
        return found
    about = list(dict.fromkeys(d for m in alike[best] for d in own[m]))
    return [_one(first, motions[best], about), *(d for d in found if d not in about)]


def _carried_by_moving(tree: Tree, index: int) -> bool:
    parent = tree.members[index].parent
    return parent >= 0 and (tree.members[parent].kind != "fixed" or _carried_by_moving(tree, parent))


def _fixed_before(tree: Tree, index: int) -> set[int]:
    """A member and the fixed ones that carry it."""
    found = set()
    while index >= 0:
        found.add(index)
        index = tree.members[index].parent
    return found


def _agree(one: Placement, other: Placement, slack: float, size: float) -> bool:
    apart = between(one, other)
    return float(np.linalg.norm(apart.position)) <= slack * max(1.0, size) and angle(apart.rotation) <= slack


def _one(first: Tree, motion: Placement, about: Iterable[Difference]) -> Difference:
    """The difference that a motion of the base is: an angle [rad] where it turns, else a distance [m]."""
    about = list(about)
    way, turn = float(np.linalg.norm(motion.position)), angle(motion.rotation)
    size, unit = (turn, "rad") if turn > SAME else (way, "m")
    pull = motion.rotation @ first.gravity - first.gravity
    felt = float(np.linalg.norm(pull)) > SAME * float(np.linalg.norm(first.gravity))
    printed = max(d.printed for d in about if d.unit == unit)
    changes = tuple(change for d in about for change in d.changes)
    hints = (FELT if felt else UNFELT,)
    return Difference(
        "rigid", BASE, "the machine", size, unit, placement_text(Placement()), placement_text(motion), changes, hints,
        printed=printed, structural=True, motion=motion,
    )  # fmt: skip
