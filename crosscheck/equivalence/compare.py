"""compare: two descriptions of a machine, and whether they are the same one; what differs is named, and proven by repair."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from crosscheck.equivalence.alignment.align import find_alignment
from crosscheck.equivalence.alignment.bases import list_base_differences
from crosscheck.equivalence.alignment.member_alignment import SAME, MemberAlignment
from crosscheck.equivalence.beams.bending import BeamEffects, compute_beam_effects
from crosscheck.equivalence.beams.rigid_beams import make_rigid_mechanism
from crosscheck.equivalence.beams.sections import MatchedBeams
from crosscheck.equivalence.certificates import list_checks
from crosscheck.equivalence.couplings import add_coupling_differences
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.digits import PairedDigits, PrintedDigits
from crosscheck.equivalence.efforts import evaluate_efforts, map_efforts_back, map_states, sample_states
from crosscheck.equivalence.groups import (
    BODY,
    find_differing_body,
    find_missing_links,
    join_equal_differences,
    join_exchanged_bodies,
    join_scaled_differences,
)
from crosscheck.equivalence.judge import EffortProblem, Judgement, is_rounding, judge
from crosscheck.equivalence.loops import list_loop_differences
from crosscheck.equivalence.matching.match import Match, match
from crosscheck.equivalence.matching.roots import RerootedMechanism, match_roots
from crosscheck.equivalence.members import (
    START,
    MemberPair,
    list_body_differences,
    list_drive_differences,
    list_joint_differences,
)
from crosscheck.equivalence.output.advice import ComparedDescriptions, collect_advice
from crosscheck.equivalence.proof import SAMPLES, SEED, prove, remove_ties
from crosscheck.equivalence.proving.features import (
    CommonGround,
    add_feature_differences,
    describe_ignored,
    find_start_poses,
)
from crosscheck.equivalence.proving.provers import add_dynamics
from crosscheck.equivalence.reduce import ReducedTrees, build_matched_trees
from crosscheck.equivalence.result import JUDGED, Comparison
from crosscheck.equivalence.sources import describe_pair
from crosscheck.equivalence.tree import Tree, build_tree
from crosscheck.lifting.description import Description
from flexinv.errors import InputError
from flexinv.model.mechanism import Mechanism, Placement
from flexinv.typing import Array
from flexinv.validation import check_flag, check_names, check_number, check_renaming, refuse

TOLERANCE = 1e-6  # relative to the range of an effort [-]
SINGLE = 30.0  # rounding errors of a reader that add up in an effort
SHOWN = 12  # names that a note has


def compare(
    a: Any,
    b: Any,
    tolerance: float = TOLERANCE,
    match: Mapping[str, str] | None = None,
    judge: Iterable[str] = JUDGED,
    strict: bool = False,
    ignore: Iterable[str] = (),
    unproven: bool = False,
) -> Comparison:
    """Compare two descriptions of a machine: the same or not, and what differs.

    a, b : files (``arm.urdf``, ``arm.xml``, ``arm.urdf@mujoco``, a folder of a mechanism or of a case kit), models in memory,
        mechanisms or `Description`s
    tolerance : of efforts, relative to their range [-]; match : joints of a by which joint of b they are
    judge : families of differences that count: "rigid", "beam", "drive", "feature", "convention", "limits"
    strict : count what no torque can tell and rounding of printed digits, too
    ignore : names of features that are left out, as "gravcomp"
    unproven : call equal what no reader's own model could be held against
    Raises InputError for what cannot be read, matched or compared.
    """
    begun = clock.perf_counter()
    families = check_comparison_options(tolerance, judge)
    strict = check_flag("strict", strict)
    stated = check_renaming("match", match, "a table of names, joint of a -> joint of b", 'match={"elbow": "joint_3"}')
    first, second = describe_pair(a, b)
    found = replace(compare_descriptions(first, second, tolerance, stated, tuple(ignore)), unproven=unproven)
    return replace(found, families=families, strict=strict, elapsed=clock.perf_counter() - begun)


def check_comparison_options(tolerance: float, judge: Iterable[str]) -> tuple[str, ...]:
    """Return the families of differences [-] that count.  Raises InputError for one unknown, or a tolerance that is none."""
    given = tuple(judge) if isinstance(judge, Iterable) and not isinstance(judge, str) else judge
    families = tuple(check_names("judge", given, "families of differences"))
    if unknown := [name for name in families if name not in JUDGED]:
        raise InputError(f"judge = {unknown[0]!r}: expected some of {', '.join(JUDGED)}")
    expected = "a positive number, relative to the range of an effort [-]"
    asked = check_number("tolerance", tolerance, expected)
    if not (np.isfinite(asked) and asked > 0.0):
        refuse("tolerance", tolerance, expected)
    return families


@dataclass(frozen=True)
class MatchedMachines:
    """Two descriptions told from one root, with rigid links, their trees, and the joints of both that are the same.

    effects : what bending differs in; bends : a link of either does; size : of the larger machine [m]
    """

    descriptions: tuple[Description, Description]
    trees: tuple[Tree, Tree]
    rooted: RerootedMechanism
    pairs: Match
    beams: MatchedBeams
    effects: BeamEffects
    bends: bool
    size: float

    @property
    def rounding(self) -> float:
        """Return the rounding of the readers' numbers in an effort [-]."""
        return SINGLE * max(side.precision for side in self.descriptions)

    @property
    def printed(self) -> PairedDigits:
        """Return the digits that both files print."""
        one, two = (PrintedDigits(tree, side.printed) for tree, side in zip(self.trees, self.descriptions, strict=True))
        return PairedDigits(one, two)


@dataclass(frozen=True)
class TreeComparison:
    """Differences of two reduced trees, with the alignment of their members."""

    trees: ReducedTrees
    alignments: list[MemberAlignment]
    differences: list[Difference]
    motion: Placement

    @cached_property
    def moving(self) -> dict[str, MemberAlignment]:
        """Return alignments by joint of the first, of those that move in both."""
        tree = self.trees.first
        by_joint = {tree.members[one.first].joint: one for one in self.alignments}
        matched = dict(self.trees.pairs)
        return {joint: by_joint[joint] for joint in tree.moving if tree.moving[joint] in matched}

    @cached_property
    def names(self) -> dict[str, str]:
        """Return the joints of the second by those of the first, of those that move in both."""
        return {joint: self.trees.second.members[one.second].joint for joint, one in self.moving.items()}


def compare_descriptions(
    first: Description,
    second: Description,
    tolerance: float,
    stated: Mapping[str, str],
    ignored: tuple[str, ...] = (),
) -> Comparison:
    """Return the comparison of two descriptions; tolerance : relative to the range of an effort [-].

    stated : joints of the second by those of the first; ignored : names of features that are left out
    """
    lifted = add_dynamics(first), add_dynamics(second)
    proofs = prove(lifted[0]), prove(lifted[1])
    machines = _match_machines(lifted, stated)
    explanation = _find_least_explanation(machines)
    differences = _collect_differences(machines, explanation)
    bound = max(tolerance, machines.rounding)
    judged = _judge_efforts(machines, explanation, differences, bound)
    if any(side.features or side.dynamics is not None for side in lifted):
        ground = _find_common_ground(machines, explanation, differences)
        judged = add_feature_differences(judged, lifted, ground, ignored, bound)
    trees = explanation.trees
    alignments = {one.first: one for one in explanation.alignments}
    sides = ComparedDescriptions(machines.descriptions, (trees.first, trees.second), alignments, machines.rooted.links)
    return Comparison(
        first=first.label,
        second=second.label,
        matched=machines.pairs.words,
        judged=judged,
        certificate=list_checks(trees.first, trees.second, explanation.moving),
        notes=tuple(_list_notes(machines, explanation)),
        dropped=tuple((side.label, side.dropped) for side in lifted if side.dropped),
        advice=collect_advice(judged, sides),
        tolerance=bound,
        bends=machines.bends,
        proofs=tuple((side.label, proof) for side, proof in zip(lifted, proofs, strict=True)),
        ignored=tuple(describe_ignored(lifted, ignored)),
        featured=any(side.features for side in lifted),
    )


def _match_machines(lifted: tuple[Description, Description], stated: Mapping[str, str]) -> MatchedMachines:
    """Match the joints of two descriptions, the second told from the root of the first, both with rigid links."""
    rooted = match_roots(lifted[0].mechanism, lifted[1].mechanism, stated)
    flexible = lifted[0].mechanism, rooted.mechanism
    first = replace(lifted[0], mechanism=make_rigid_mechanism(flexible[0]))
    second = replace(lifted[1], mechanism=make_rigid_mechanism(flexible[1]))
    one = build_tree(first.mechanism, first.gears)
    two = build_tree(second.mechanism, second.gears)
    pairs = match(one, two, stated)
    beams = _build_beams(flexible, pairs)
    if any(True for _ in beams.both):
        second = replace(second, mechanism=make_rigid_mechanism(beams.build_base_mechanism()))
        two = build_tree(second.mechanism, second.gears)
    return MatchedMachines(
        descriptions=(first, second),
        trees=(one, two),
        rooted=rooted,
        pairs=pairs,
        beams=beams,
        effects=compute_beam_effects(beams),
        bends=not all(mechanism.is_rigid for mechanism in flexible),
        size=max(_compute_tree_size(one), _compute_tree_size(two)),
    )


def _collect_differences(machines: MatchedMachines, explanation: TreeComparison) -> list[Difference]:
    """Collect the differences of roots, members, couplings and loops."""
    placed = all(side.root_stated for side in machines.descriptions)
    stated = [d for d in explanation.differences if placed or d.cause != START]
    tolerance = max(SAME, machines.rounding)
    pairs = machines.pairs.pairs
    moving = explanation.moving
    differences = add_coupling_differences(
        *machines.trees, pairs, moving, [*machines.rooted.conventions, *stated], tolerance
    )
    one, two = (side.mechanism for side in machines.descriptions)
    loops = list_loop_differences(
        (one, two), machines.trees, pairs, moving, machines.size, explanation.motion, tolerance
    )
    return [*differences, *loops]


def _judge_efforts(
    machines: MatchedMachines, explanation: TreeComparison, differences: list[Difference], bound: float
) -> Judgement:
    """Judge differences by the efforts of the second machine, in coordinates of the first."""
    tree = explanation.trees.first
    moving = explanation.moving
    states = sample_states(tree)
    wanted: Mapping[str, Array] = {}
    if moving:
        mechanism = remove_ties(machines.descriptions[1].mechanism)
        efforts = evaluate_efforts(mechanism, map_states(states, tree, moving), explanation.names)
        wanted = map_efforts_back(efforts, tree, moving)
    effects = machines.effects
    judgement = judge(EffortProblem(tree, states, wanted), [*differences, *effects.differences], bound)
    return _add_beam_effects(judgement, effects)


def _find_common_ground(
    machines: MatchedMachines, explanation: TreeComparison, differences: list[Difference]
) -> CommonGround:
    """Find where features of both are compared: states and coordinates of the first."""
    tree = explanation.trees.first
    silent = tree.replace_fields(c for d in differences if not d.cause for c in d.changes)
    states = sample_states(tree, SEED, (SAMPLES, 0))
    starts = find_start_poses(tree, silent)
    return CommonGround(tree, states, explanation.moving, explanation.names, starts, not machines.rooted.links)


def _build_beams(mechanisms: tuple[Mechanism, Mechanism], pairs: Match) -> MatchedBeams:
    """The beams of both, by links whose joints are matched."""
    first, second = mechanisms
    joints = {a: b for a, b in pairs.pairs.items() if a in first.joint_of and b in second.joint_of}
    fixed = {j.child for m in mechanisms for j in m.joints if j.kind == "fixed"}
    links = {first.joint_of[a].child: second.joint_of[b].child for a, b in joints.items()}
    links |= {name: name for name in fixed if name in first.link_of and name in second.link_of and name not in links}
    return MatchedBeams(first, second, links, joints)


def _add_beam_effects(judgement: Judgement, bent: BeamEffects) -> Judgement:
    """The judgement with the torques of links that bend, where those differ more."""
    worst = max((judgement.before, judgement.before_effort, judgement.worst_joint), bent.before)
    after = max(judgement.after, bent.after[0])
    return replace(judgement, before=worst[0], before_effort=worst[1], worst_joint=worst[2], after=after)


def _compute_tree_size(tree: Tree) -> float:
    places = np.array([pose.position for pose in tree.compute_poses()] or np.zeros((1, 3)))
    return float(np.ptp(places, axis=0).max()) or 1.0


def _find_least_explanation(machines: MatchedMachines) -> TreeComparison:
    """The explanation with the fewest differences: fixed links kept or merged."""
    explanation = _find_explanation(machines, True)
    if not _count(explanation) or all(member.kind != "fixed" for member in explanation.trees.first.members):
        return explanation
    whole = _find_explanation(machines, False)
    return explanation if _count(explanation) <= _count(whole) else whole


def _count(comparison: TreeComparison) -> int:
    """Differences that are no rounding, beside those of links welded to the world, which merging loses."""
    held = {f"link {m.name}" for m in comparison.trees.first.members if m.kind == "fixed" and m.parent < 0}
    return sum(
        1
        for d in comparison.differences
        if d.cause and d.family != "limits" and d.place not in held and not is_rounding(d)
    )


def _find_explanation(machines: MatchedMachines, links: bool) -> TreeComparison:
    """Explain what differs in the members that match; links : fixed links of one name are members, too."""
    trees = build_matched_trees(*machines.trees, dict(machines.pairs.pairs), links)
    alignment = find_alignment(trees.first, trees.second, trees.pairs, machines.size)
    printed = machines.printed
    pairs = [
        MemberPair(trees.first.members[one.first], trees.second.members[one.second], one, machines.size, printed)
        for one in alignment.alignments
    ]
    found = [difference for pair in pairs for difference in _list_member_differences(pair)]
    found = join_exchanged_bodies(trees.first, trees.second, pairs, found)
    base = list_base_differences(trees.first, trees.second, alignment.motion, pairs)
    found = [*trees.differences, *base, *join_equal_differences(join_scaled_differences(trees.first, found))]
    return TreeComparison(trees, alignment.alignments, found, alignment.motion)


def _list_member_differences(pair: MemberPair) -> Iterator[Difference]:
    """Yield what differs in a member: its joint, its bodies as the fewest differences that say it, its drive."""
    differences = list(list_body_differences(pair))
    lost = find_missing_links(pair) if any(d.cause in BODY for d in differences) else None
    yield from list_joint_differences(pair)
    yield from [lost] if lost else find_differing_body(pair) or differences
    yield from list_drive_differences(pair)


def _list_notes(machines: MatchedMachines, explanation: TreeComparison) -> Iterator[str]:
    """Yield conventions that change no coordinate (names, order, frames of links, merged links), and what beams have to say."""
    yield from _describe_joint_names(machines)
    frames = [
        explanation.trees.first.members[one.first].name
        for one in explanation.alignments
        if np.abs(one.frame.position).max() > SAME or np.abs(one.frame.rotation - np.eye(3)).max() > SAME
    ]
    if frames:
        yield f"link frames that stand elsewhere on the same body: {', '.join(frames[:SHOWN])}"
    one, two = machines.trees
    yield from _describe_lone_links("A", one, two)
    yield from _describe_lone_links("B", two, one)
    yield from machines.beams.describe_other_meshes()
    yield from machines.effects.notes


def _describe_joint_names(machines: MatchedMachines) -> Iterator[str]:
    one, two = machines.trees
    pairs = machines.pairs.pairs
    renamed = [f"{a} is {b}" for a, b in pairs.items() if a != b]
    if renamed:
        yield "joints with other names: " + ", ".join(renamed[:SHOWN])
    order = [pairs[joint] for joint in one.moving if joint in pairs]
    if order != [joint for joint in two.moving if joint in order]:
        yield "coordinates in another order: map them by name"


def _describe_lone_links(side: str, tree: Tree, other: Tree) -> Iterator[str]:
    names = {member.name for member in tree.members if member.kind == "fixed"}
    if alone := sorted(names - {member.name for member in other.members}):
        yield f"fixed links that only {side} names, merged for the comparison: {', '.join(alone[:SHOWN])}"
