"""Differences of closures: loops that only one description closes, and points and axes that stand elsewhere.

Links have other names and frames in another file, and fixed ones are merged.  So both ends of a closure are put into the frames
of the moving members that carry them: X and Y of its two frames at zero, B's mapped into A's.

    spherical     the points of X and Y
    revolute      their lines, and how far apart the points stand along them
    fixed         X Y^-1: which frames are used to say it is a convention
    others        both frames
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from crosscheck.equivalence.alignment.member_alignment import SAME, MemberAlignment
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.tree import Tree
from crosscheck.lifting.rigid import apply_placement, compute_angle, compute_relative_pose, inverse
from flexinv.model.mechanism import WORLD, Array, Attachment, Closure, Mechanism, Placement


@dataclass(frozen=True)
class MemberClosure:
    """A closure between two members of A, "" the world: kind, and its frames there [m]; axis (3,) [-] in both frames."""

    kind: str
    joints: tuple[str, str]
    first: Placement
    second: Placement
    axis: Array
    links: tuple[str, str]

    @property
    def key(self) -> tuple[str, tuple[str, str]]:
        """Return kind and joints [-], which have to agree for two of them to be compared."""
        return self.kind, self.joints

    @property
    def place(self) -> str:
        """Return the closure in words."""
        return f"{self.kind} closure of links {' and '.join(self.links)}"


@dataclass(frozen=True)
class ComparedMechanism:
    """A mechanism and its tree; joints by which A calls them; frames : of a member in A's, by joint of A, "" the world [m]."""

    mechanism: Mechanism
    tree: Tree
    names: Mapping[str, str]
    frames: Mapping[str, Placement]


def list_loop_differences(
    mechanisms: tuple[Mechanism, Mechanism],
    trees: tuple[Tree, Tree],
    pairs: Mapping[str, str],
    alignments: Mapping[str, MemberAlignment],
    size: float,
    motion: Placement,
    tolerance: float = SAME,
) -> Iterator[Difference]:
    """Yield loops that only one closes [-], and those of both whose points or axes differ [m], [rad].

    mechanisms, trees : of both, not reduced; pairs : joints of A by those of B; alignments : alignment by joint of A
    size : [m]; motion : of B's world in A's [m]
    tolerance : of points over the size [-] and of axes [rad]: rounding of the readers' numbers
    """
    frames = {"": motion} | {joint: seat.frame for joint, seat in alignments.items()}
    same_names = {joint: joint for joint in pairs}
    back = {second: first for first, second in pairs.items()}
    first = list(_list_closures(ComparedMechanism(mechanisms[0], trees[0], same_names, {})))
    second = list(_list_closures(ComparedMechanism(mechanisms[1], trees[1], back, frames)))
    for one in first:
        like = [other for other in second if other.key == one.key]
        if not like:
            yield _make_lone_difference("A", one)
            continue
        nearest = min(like, key=lambda other: sum(_compute_closure_gaps(one, other)))
        second.remove(nearest)
        yield from _compare_closures(one, nearest, size, tolerance)
    for other in second:
        yield _make_lone_difference("B", other)


def _make_lone_difference(side: str, one: MemberClosure) -> Difference:
    a, b = (one.place, "none") if side == "A" else ("none", one.place)
    return Difference("rigid", f"loop that only {side} closes", one.place, 1.0, "-", a, b, structural=True)


def _compare_closures(one: MemberClosure, other: MemberClosure, size: float, tolerance: float) -> Iterator[Difference]:
    way, turn = _compute_closure_gaps(one, other)
    if way > tolerance * size:
        shown = [" and ".join(map(_format_point, (tied.first, tied.second))) for tied in (one, other)]
        yield Difference("rigid", "point of closure", one.place, way, "m", shown[0], shown[1])
    if turn > tolerance:
        yield Difference("rigid", "axis of closure", one.place, turn, "rad", "", "")


def _format_point(end: Placement) -> str:
    return " ".join(f"{x:.9g}" for x in end.position)


def _compute_closure_gaps(one: MemberClosure, other: MemberClosure) -> tuple[float, float]:
    """Distance [m] and angle [rad] by which two closures of one kind differ."""
    if one.kind == "fixed":
        ways = [apply_placement(tied.first, inverse(tied.second)) for tied in (one, other)]
        apart = compute_relative_pose(*ways)
        return float(np.linalg.norm(apart.position)), compute_angle(apart.rotation)
    if one.kind == "revolute":
        return _compute_line_gaps(one, other)
    ends = ((one.first, other.first), (one.second, other.second))
    way = max(float(np.linalg.norm(b.position - a.position)) for a, b in ends)
    if one.kind == "spherical":
        return way, 0.0
    return way, max(compute_angle(a.rotation.T @ b.rotation) for a, b in ends)


def _compute_line_gaps(one: MemberClosure, other: MemberClosure) -> tuple[float, float]:
    """Distance [m] and angle [rad] of the lines about which two hinges turn; along them, how far apart the points stand."""
    ends = ((one.first, other.first), (one.second, other.second))
    gaps = [b.position - a.position for a, b in ends]
    lines = [(a.rotation @ one.axis, b.rotation @ other.axis) for a, b in ends]
    sign = 1.0 if lines[0][0] @ lines[0][1] >= 0.0 else -1.0  # a line may be said by either of its directions
    along = [float(gap @ u) for gap, (u, _) in zip(gaps, lines, strict=True)]
    off = [float(np.linalg.norm(np.cross(u, gap))) for gap, (u, _) in zip(gaps, lines, strict=True)]
    turns = [float(np.arctan2(np.linalg.norm(np.cross(u, w)), sign * (u @ w))) for u, w in lines]
    return max(*off, abs(along[0] - along[1])), max(turns)


def _list_closures(side: ComparedMechanism) -> Iterator[MemberClosure]:
    """Closures of one side, each with its ends in A's frames, the joint that comes first in the alphabet first."""
    poses = side.tree.compute_poses()
    number = {member.name: k for k, member in enumerate(side.tree.members)}
    for closure in side.mechanism.closures:
        if closure.kind == "coupling":
            continue
        ends = [_find_attachment(side, poses, number, at) for at in (closure.first, closure.second)]
        yield _make_ordered_closure(closure, ends)


def _make_ordered_closure(closure: Closure, ends: list[tuple[str, Placement]]) -> MemberClosure:
    links = (closure.first.link, closure.second.link)
    if ends[1][0] < ends[0][0]:
        ends = ends[::-1]
        links = links[::-1]
    return MemberClosure(closure.kind, (ends[0][0], ends[1][0]), ends[0][1], ends[1][1], closure.axis, links)


def _find_attachment(
    side: ComparedMechanism, poses: list[Placement], number: Mapping[str, int], at: Attachment
) -> tuple[str, Placement]:
    """The matched joint of A that carries an attachment, "" for the world, and its frame in that member of A [m]."""
    k = -1 if at.link == WORLD else number[at.link]
    place = at.placement if k < 0 else apply_placement(poses[k], at.placement)
    while k >= 0 and side.tree.members[k].joint not in side.names:
        k = side.tree.members[k].parent
    if k < 0:
        return "", apply_placement(side.frames.get("", Placement()), place)
    joint = side.names[side.tree.members[k].joint]
    within = compute_relative_pose(poses[k], place)
    return joint, apply_placement(side.frames[joint], within) if joint in side.frames else within
