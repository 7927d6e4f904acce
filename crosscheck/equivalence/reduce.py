"""Reduction of two trees to members that match one to one: what moves in one only is held, other fixed links are merged."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.tree import Tree, join_into_carriers
from crosscheck.lifting.rigid import compute_relative_pose
from flexinv.model.mechanism import Placement


@dataclass(frozen=True)
class ReducedTrees:
    """Two trees with the same members: numbers of the second by those of the first, and what was held in which."""

    first: Tree
    second: Tree
    pairs: list[tuple[int, int]]
    differences: tuple[Difference, ...] = ()


def build_matched_trees(first: Tree, second: Tree, joints: dict[str, str], links: bool) -> ReducedTrees:
    """Return both trees with the members that match; links : keep fixed links that both have by name, too.

    joints : matched joints by joint of the first.  Joints that only one of them has are held at zero, which is a difference.
    """
    found = [
        *_list_unmatched_joints(first, second, joints, "A"),
        *_list_unmatched_joints(second, first, {b: a for a, b in joints.items()}, "B"),
    ]
    fixed = _match_fixed_links(first, second) if links else {}
    while True:
        one, numbers = join_into_carriers(first, _list_unmatched_members(first, set(joints), set(fixed)))
        two, theirs = join_into_carriers(
            second, _list_unmatched_members(second, set(joints.values()), set(fixed.values()))
        )
        pairs = {numbers[first.moving[a]]: theirs[second.moving[b]] for a, b in joints.items()}
        pairs |= {numbers[a]: theirs[b] for a, b in fixed.items()}
        wrong = [a for a, b in fixed.items() if _has_other_parent(one, two, pairs, numbers[a], theirs[b])]
        if not wrong:
            break
        fixed = {a: b for a, b in fixed.items() if a not in wrong}
    one, pairs, moved = _move_to_matched_parents(one, two, pairs)
    return ReducedTrees(one, two, sorted(pairs.items()), (*found, *moved))


def _list_unmatched_members(tree: Tree, joints: set[str], fixed: set[int]) -> list[int]:
    return [k for k, m in enumerate(tree.members) if (k not in fixed if m.kind == "fixed" else m.joint not in joints)]


def _match_fixed_links(first: Tree, second: Tree) -> dict[int, int]:
    """Fixed links of one name."""
    theirs = {member.name: k for k, member in enumerate(second.members) if member.kind == "fixed"}
    return {k: theirs[m.name] for k, m in enumerate(first.members) if m.kind == "fixed" and m.name in theirs}


def _has_other_parent(one: Tree, two: Tree, pairs: dict[int, int], a: int, b: int) -> bool:
    parent = one.members[a].parent
    other = two.members[b].parent
    return pairs.get(parent, -1) != other if parent >= 0 else other >= 0


def _list_unmatched_joints(tree: Tree, other: Tree, joints: dict[str, str], side: str) -> Iterator[Difference]:
    """Yield the joints that only one tree moves; what B has instead is said."""
    fixed = {member.joint for member in other.members if member.kind == "fixed"}
    there = "B" if side == "A" else "A"
    for name, k in tree.moving.items():
        if name in joints:
            continue
        kind = tree.members[k].kind
        without = "fixed" if name in fixed else "none"
        if name in other.moving and other.members[other.moving[name]].kind != kind:
            if side == "A":
                yield _make_kind_difference(name, kind, other.members[other.moving[name]].kind)
            continue
        a, b = (kind, without) if side == "A" else (without, kind)
        hint = f"{there} holds it" if name in fixed else f"{there} has no joint of this name, and none that could be it"
        yield Difference(
            "rigid",
            f"joint that moves in {side} only",
            f"joint {name}",
            1.0,
            "-",
            a,
            b,
            hints=(hint,),
            structural=True,
        )


def _make_kind_difference(name: str, first: str, second: str) -> Difference:
    """A joint of one name whose coordinates cannot be those of the other, such as a hinge and a ball: both are held."""
    hint = "their coordinates are none of one another: both are held at zero for the rest of the comparison"
    return Difference(
        "rigid", "kind of joint", f"joint {name}", 1.0, "-", first, second, hints=(hint,), structural=True
    )  # fmt: skip


def _move_to_matched_parents(
    one: Tree, two: Tree, pairs: dict[int, int]
) -> tuple[Tree, dict[int, int], list[Difference]]:
    """Hang members of the first where the second has them, at zero where they stood, in the second's order.

    Each that hangs elsewhere is a difference.  Returned are the tree, and the numbers of the second by those of the first.
    """
    back = {b: a for a, b in pairs.items()}
    found = []
    poses = one.compute_poses()
    members = []
    for other, index in sorted(back.items()):
        parent = two.members[other].parent
        carrier = back.get(parent, -1)
        member = one.members[index]
        if carrier != member.parent:
            a_name, b_name = (one.members[k].name if k >= 0 else "world" for k in (member.parent, carrier))
            where = f"joint {member.joint}"
            found.append(Difference("rigid", "parent of joint", where, 1.0, "-", a_name, b_name, structural=True))
            member = replace(
                member, placement=compute_relative_pose(poses[carrier] if carrier >= 0 else Placement(), poses[index])
            )
        members.append(replace(member, parent=parent))
    return replace(one, members=tuple(members)), {k: k for k in range(len(members))}, found
