"""Roots: a machine that floats may be told from any of its bodies; B is told anew from the one that A is told from.

Nothing that floats has a first body: a chain from the pelvis to the torso is one from the torso to the pelvis.  Each joint
between is turned about,  X -> X^-1, axis -> -axis,  so that its coordinate stays; the base has another body's coordinates.
Which body that is is told by the names of joints, and where these say little by what bodies and axes show.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.matching.costs import PairCosts
from crosscheck.equivalence.matching.match import ALMOST, match_by_name
from crosscheck.equivalence.matching.overlaid_trees import compute_subtree_cost, join_fixed_links
from crosscheck.equivalence.tree import build_tree
from crosscheck.lifting.assembly import list_depth_first
from crosscheck.lifting.rigid import apply_placement, inverse, move_inertia
from flexinv.model.mechanism import WORLD, Attachment, Joint, Link, Mechanism, Placement

TURNED = (
    "revolute",
    "continuous",
    "prismatic",
    "helical",
    "fixed",
)  # joints whose coordinate stays when they are turned about


@dataclass(frozen=True)
class RerootedMechanism:
    """B as told from A's root; links : those whose frames stand elsewhere for it; conventions : the convention that differs."""

    mechanism: Mechanism
    links: frozenset[str] = frozenset()
    conventions: tuple[Difference, ...] = ()


def match_roots(first: Mechanism, second: Mechanism, stated: Mapping[str, str]) -> RerootedMechanism:
    """Return the second mechanism told from the first's root, where both float and more joints then hang as in the first [m].

    stated : joints of the second by those of the first
    """
    ours = _find_free_base(first)
    theirs = _find_free_base(second)
    if ours is None or theirs is None or not (first.is_rigid and second.is_rigid):
        return RerootedMechanism(second)
    old = theirs.child
    root = _find_root(first, second, ours, theirs, stated)
    way = _list_path_joints(second, old, root)
    if root == old or not _can_turn(way):
        return RerootedMechanism(second)
    hints = ("the coordinates of its base are those of another body; the joints between count as before",)
    difference = Difference("convention", "root", "the tree", 1.0, "-", ours.child, old, hints=hints)
    return RerootedMechanism(_move_root(second, theirs, way), frozenset(joint.parent for joint in way), (difference,))


def _find_root(first: Mechanism, second: Mechanism, ours: Joint, theirs: Joint, stated: Mapping[str, str]) -> str:
    """The link of the second that is the root of the first: by names of joints, where these pair half of them, else by shape."""
    one = _list_moving_names(first, ours)
    two = _list_moving_names(second, theirs)
    pairs = {a: b for a, (b, _) in match_by_name(one, two, stated).items() if a in one and b in two}
    if 2 * len(pairs) >= max(len(one), len(two)):
        return _find_best_root(first, second, ours.child, theirs.child, pairs)
    return _find_similar_root(first, second, theirs)


def _list_moving_names(mechanism: Mechanism, base: Joint) -> list[str]:
    return [joint.name for joint in mechanism.joints if joint.nv and joint is not base]


def _can_turn(way: Iterable[Joint]) -> bool:
    """Return True if the coordinates of all joints of a way stay when they are turned about."""
    return all(joint.kind in TURNED and joint.station is None for joint in way)


def _find_free_base(mechanism: Mechanism) -> Joint | None:
    """The free joint that alone stands on the world; None for a machine that is held, and for several."""
    on_world = [joint for joint in mechanism.joints if joint.parent == WORLD]
    return on_world[0] if len(on_world) == 1 and on_world[0].kind == "free" else None


def _find_best_root(first: Mechanism, second: Mechanism, ours: str, theirs: str, pairs: Mapping[str, str]) -> str:
    """The link of the second from which the most joints hang as in the first; of several the one named so, else its own."""
    wanted = {pairs[a]: pairs.get(above, "") for a, above in _map_to_parent_joints(first, ours, set(pairs)).items()}
    scores = {}
    for link in second.links:
        above = _map_to_parent_joints(second, link.name, set(pairs.values()))
        same = sum(above.get(b) == carrier for b, carrier in wanted.items())
        scores[link.name] = (same, link.name == ours, link.name == theirs)
    return (
        max(scores, key=lambda name: scores[name])
        if scores[theirs][0] < max(scores.values())[0] or _is_ambiguous_joint(pairs)
        else theirs
    )


def _find_similar_root(first: Mechanism, second: Mechanism, base: Joint) -> str:
    """The link of the second from which its tree is most like the first, by what bodies and axes show; in doubt its own."""
    one = join_fixed_links(build_tree(first, {}))[0]
    costs: dict[str, float] = {}
    for link in (base.child, *(joint.child for joint in second.joints if joint.nv and joint is not base)):
        way = _list_path_joints(second, base.child, link)
        if _can_turn(way):
            told = _move_root(second, base, way) if way else second
            two = join_fixed_links(build_tree(told, {}))[0]
            costs[link] = compute_subtree_cost(PairCosts(one, two), (-1, -1), 0, 0)
    least = min(costs, key=lambda name: costs[name])
    return least if costs[least] < costs[base.child] - ALMOST else base.child


def _is_ambiguous_joint(pairs: Mapping[str, str]) -> bool:
    """Return True for one joint only, from both of whose ends it hangs alike: then names say which is the root."""
    return len(pairs) == 1


def _map_to_parent_joints(mechanism: Mechanism, root: str, among: set[str]) -> dict[str, str]:
    """By joint the next one towards a root, "" where there is none; both of some joints only."""
    touching: dict[str, list[Joint]] = {}
    for joint in mechanism.joints:
        for end in (joint.parent, joint.child):
            touching.setdefault(end, []).append(joint)
    result: dict[str, str] = {}
    seen = {WORLD, root}
    stack = [(root, "")]
    while stack:
        link, carrier = stack.pop()
        for joint in touching.get(link, ()):
            other = joint.child if joint.parent == link else joint.parent
            if other in seen:
                continue
            seen.add(other)
            if joint.name in among:
                result[joint.name] = carrier
            stack.append((other, joint.name if joint.name in among else carrier))
    return result


def _list_path_joints(mechanism: Mechanism, root: str, link: str) -> list[Joint]:
    """The joints from the root to a link."""
    carried = {joint.child: joint for joint in mechanism.joints}
    found: list[Joint] = []
    while link != root:
        found.append(carried[link])
        link = carried[link].parent
    return found[::-1]


def _move_root(mechanism: Mechanism, base: Joint, way: list[Joint]) -> Mechanism:
    """The same machine with the joints of a way from its root turned about; links before them have their frames at them [m]."""
    back = {joint.parent: inverse(joint.placement) for joint in way}
    pose = base.placement
    for joint in way:
        pose = apply_placement(pose, joint.placement)
    turned = {id(joint): made for joint, made in zip(way, _list_reversed_joints(way, back), strict=True)}
    joints = [replace(base, child=way[-1].child, placement=pose)]
    for joint in mechanism.joints:
        if joint is not base:
            at = apply_placement(back.get(joint.parent, Placement()), joint.placement)
            joints.append(turned.get(id(joint)) or replace(joint, placement=at))
    ends = ((one, _end(one.first, back), _end(one.second, back)) for one in mechanism.closures)
    return replace(
        mechanism, links=tuple(_list_moved_links(mechanism.links, back)), joints=list_depth_first(joints),
        closures=tuple(replace(one, first=a, second=b) for one, a, b in ends), springs=(), forces=(),
    )  # fmt: skip


def _list_reversed_joints(way: list[Joint], back: Mapping[str, Placement]) -> Iterator[Joint]:
    for joint in way:
        at = back.get(joint.child, Placement())  # the link that now carries it stands at the next joint of the way
        yield replace(joint, parent=joint.child, child=joint.parent, placement=at, axis=-joint.axis)


def _list_moved_links(links: Iterable[Link], back: Mapping[str, Placement]) -> Iterator[Link]:
    for link in links:
        at = back.get(link.name)
        bodies = (
            link.bodies if at is None else tuple(replace(b, inertia=move_inertia(at, b.inertia)) for b in link.bodies)
        )
        yield replace(link, bodies=bodies)


def _end(end: Attachment, back: Mapping[str, Placement]) -> Attachment:
    at = back.get(end.link)
    return end if at is None else replace(end, placement=apply_placement(at, end.placement))
