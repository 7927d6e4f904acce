"""compare: two descriptions of a machine, and whether they are the same one; what differs is named, and proven by repair."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
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
from crosscheck.equivalence.matching.roots import match_roots
from crosscheck.equivalence.members import (
    START,
    MemberPair,
    list_body_differences,
    list_drive_differences,
    list_joint_differences,
)
from crosscheck.equivalence.output.advice import ComparedDescriptions, collect_advice
from crosscheck.equivalence.proof import SAMPLES, SEED, prove
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
from flexinv.validation import check_flag, check_names, check_number, check_renaming, refuse

TOLERANCE = 1e-6  # relative to the range of an effort [-]
SINGLE = 30.0  # rounding errors of a reader that add up in an effort


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
class TreeComparison:
    """Differences of two reduced trees, with the alignment of their members."""

    trees: ReducedTrees
    alignments: list[MemberAlignment]
    differences: list[Difference]
    motion: Placement


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
    first = add_dynamics(first)
    second = add_dynamics(second)
    lifted = first, second
    proofs = prove(first), prove(second)
    rooted = match_roots(first.mechanism, second.mechanism, stated)
    second = replace(second, mechanism=rooted.mechanism)
    flexible = first.mechanism, second.mechanism
    first, second = (replace(side, mechanism=make_rigid_mechanism(side.mechanism)) for side in (first, second))
    one, two = (build_tree(side.mechanism, side.gears) for side in (first, second))
    pairs = match(one, two, stated)
    beams = _build_beams(flexible, pairs)
    if any(True for _ in beams.both):
        second = replace(second, mechanism=make_rigid_mechanism(beams.build_base_mechanism()))
        two = build_tree(second.mechanism, second.gears)
    bent = compute_beam_effects(beams)
    size = max(_compute_tree_size(one), _compute_tree_size(two))
    printed = PairedDigits(PrintedDigits(one, first.printed), PrintedDigits(two, second.printed))
    least_explanation = _find_least_explanation(one, two, dict(pairs.pairs), size, printed)
    trees = least_explanation.trees
    seats = {least_explanation.trees.first.members[s.first].joint: s for s in least_explanation.alignments}
    moving = {joint: seats[joint] for joint in trees.first.moving if trees.first.moving[joint] in dict(trees.pairs)}
    placed = first.root_stated and second.root_stated
    told = [*rooted.conventions, *(d for d in least_explanation.differences if placed or d.cause != START)]
    rounding = SINGLE * max(first.precision, second.precision)
    every = add_coupling_differences(one, two, pairs.pairs, moving, told, max(SAME, rounding))
    tied = first.mechanism, second.mechanism
    every += list_loop_differences(
        tied, (one, two), pairs.pairs, moving, size, least_explanation.motion, max(SAME, rounding)
    )
    states = sample_states(trees.first)
    names = {joint: trees.second.members[seat.second].joint for joint, seat in moving.items()}
    wanted: dict[str, Any] = {}
    if names:
        efforts = evaluate_efforts(_remove_loops(second.mechanism), map_states(states, trees.first, moving), names)
        wanted = map_efforts_back(efforts, trees.first, moving)
    bound = max(tolerance, rounding)
    judged = _add_beam_effects(
        judge(EffortProblem(trees.first, states, wanted), [*every, *bent.differences], bound), bent
    )
    if any(side.features or side.dynamics is not None for side in lifted):
        silent = trees.first.replace_fields(c for d in every if not d.cause for c in d.changes)
        places = sample_states(trees.first, SEED, (SAMPLES, 0))
        ground = CommonGround(
            trees.first, places, moving, names, find_start_poses(trees.first, silent), not rooted.links
        )
        judged = add_feature_differences(judged, lifted, ground, ignored, bound)
    sides = ComparedDescriptions(
        (first, second), (trees.first, trees.second), {s.first: s for s in least_explanation.alignments}, rooted.links
    )
    return Comparison(
        first=first.label, second=second.label, matched=pairs.words, judged=judged,
        certificate=list_checks(trees.first, trees.second, moving),
        notes=(*_describe_conventions(one, two, pairs, least_explanation), *beams.describe_other_meshes(), *bent.notes),
        dropped=tuple((d.label, d.dropped) for d in (first, second) if d.dropped),
        advice=collect_advice(judged, sides), tolerance=bound, bends=not all(side.is_rigid for side in flexible),
        proofs=tuple((side.label, proof) for side, proof in zip(lifted, proofs, strict=True)),
        ignored=tuple(describe_ignored(lifted, ignored)), featured=any(side.features for side in lifted),
    )  # fmt: skip


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


def _remove_loops(mechanism: Mechanism) -> Mechanism:
    return replace(mechanism, closures=(), springs=(), forces=())


def _compute_tree_size(tree: Tree) -> float:
    places = np.array([pose.position for pose in tree.compute_poses()] or np.zeros((1, 3)))
    return float(np.ptp(places, axis=0).max()) or 1.0


def _find_least_explanation(
    one: Tree, two: Tree, joints: dict[str, str], size: float, printed: PairedDigits
) -> TreeComparison:
    """The explanation with the fewest differences: fixed links kept or merged."""
    explanation = _find_explanation(one, two, joints, True, size, printed)
    if not _count(explanation) or all(member.kind != "fixed" for member in explanation.trees.first.members):
        return explanation
    whole = _find_explanation(one, two, joints, False, size, printed)
    return explanation if _count(explanation) <= _count(whole) else whole


def _count(comparison: TreeComparison) -> int:
    """Differences that are no rounding, beside those of links welded to the world, which merging loses."""
    held = {f"link {m.name}" for m in comparison.trees.first.members if m.kind == "fixed" and m.parent < 0}
    return sum(
        1
        for d in comparison.differences
        if d.cause and d.family != "limits" and d.place not in held and not is_rounding(d)
    )


def _find_explanation(
    one: Tree, two: Tree, joints: dict[str, str], links: bool, size: float, printed: PairedDigits
) -> TreeComparison:
    trees = build_matched_trees(one, two, joints, links)
    alignment = find_alignment(trees.first, trees.second, trees.pairs, size)
    members = trees.first.members, trees.second.members
    pairs = [MemberPair(members[0][s.first], members[1][s.second], s, size, printed) for s in alignment.alignments]
    found: list[Difference] = []
    for pair in pairs:
        own = [*list_body_differences(pair)]
        lost = find_missing_links(pair) if any(d.cause in BODY for d in own) else None
        found += [
            *list_joint_differences(pair),
            *([lost] if lost else find_differing_body(pair) or own),
            *list_drive_differences(pair),
        ]
    found = join_exchanged_bodies(trees.first, trees.second, pairs, found)
    base = list_base_differences(trees.first, trees.second, alignment.motion, pairs)
    found = [*trees.differences, *base, *join_equal_differences(join_scaled_differences(trees.first, found))]
    return TreeComparison(trees, alignment.alignments, found, alignment.motion)


def _describe_conventions(one: Tree, two: Tree, pairs: Match, comparison: TreeComparison) -> list[str]:
    """Conventions that change no coordinate: names, order, frames of links, merged links."""
    notes = []
    renamed = {a: b for a, b in pairs.pairs.items() if a != b}
    if renamed:
        notes.append("joints with other names: " + ", ".join(f"{a} is {b}" for a, b in list(renamed.items())[:12]))
    order = [pairs.pairs[joint] for joint in one.moving if joint in pairs.pairs]
    if order != [joint for joint in two.moving if joint in set(order)]:
        notes.append("coordinates in another order: map them by name")
    frames = [
        comparison.trees.first.members[s.first].name
        for s in comparison.alignments
        if np.abs(s.frame.position).max() > SAME or np.abs(s.frame.rotation - np.eye(3)).max() > SAME
    ]
    if frames:
        notes.append(f"link frames that stand elsewhere on the same body: {', '.join(frames[:12])}")
    names = [{m.name for m in tree.members if m.kind == "fixed"} for tree in (one, two)]
    for side, own, other in (
        ("A", names[0], {m.name for m in two.members}),
        ("B", names[1], {m.name for m in one.members}),
    ):
        if alone := sorted(own - other):
            notes.append(f"fixed links that only {side} names, merged for the comparison: {', '.join(alone[:12])}")
    return notes
