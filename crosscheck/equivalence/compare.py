"""compare: two descriptions of a machine, and whether they are the same one; what differs is named, and proven by repair."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crosscheck.equivalence.alignment.align import aligned
from crosscheck.equivalence.alignment.bases import base_differences
from crosscheck.equivalence.alignment.seats import SAME, Aligned
from crosscheck.equivalence.beams.bending import Felt, felt
from crosscheck.equivalence.beams.held import held
from crosscheck.equivalence.beams.sections import Beams
from crosscheck.equivalence.certificates import lines
from crosscheck.equivalence.couplings import with_couplings
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.digits import Digits, Sheet
from crosscheck.equivalence.efforts import efforts, mapped, mapped_back, states_of
from crosscheck.equivalence.groups import BODY, alike, exchanged, missing_links, one_body, scaled
from crosscheck.equivalence.judge import Bench, Judged, judge, rounded
from crosscheck.equivalence.loops import loop_differences
from crosscheck.equivalence.matching.match import Match, match
from crosscheck.equivalence.matching.roots import rooted_alike
from crosscheck.equivalence.members import START, Pair, body_differences, drive_differences, joint_differences
from crosscheck.equivalence.output.advice import Sides, advice
from crosscheck.equivalence.proof import SAMPLES, SEED, prove
from crosscheck.equivalence.proving.features import Ground, ignored_words, starts_of, with_features
from crosscheck.equivalence.proving.provers import with_dynamics
from crosscheck.equivalence.reduce import Reduced, reduced
from crosscheck.equivalence.result import JUDGED, Comparison
from crosscheck.equivalence.sources import describe_pair
from crosscheck.equivalence.tree import Tree, tree_of
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
    families = checked(tolerance, judge)
    strict = check_flag("strict", strict)
    stated = check_renaming("match", match, "a table of names, joint of a -> joint of b", 'match={"elbow": "joint_3"}')
    first, second = describe_pair(a, b)
    found = replace(compared(first, second, tolerance, stated, tuple(ignore)), unproven=unproven)
    return replace(found, families=families, strict=strict, elapsed=clock.perf_counter() - begun)


def checked(tolerance: float, judge: Iterable[str]) -> tuple[str, ...]:
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
class Found:
    """Differences of two reduced trees, with the alignment of their members."""

    trees: Reduced
    seats: list[Aligned]
    differences: list[Difference]
    motion: Placement


def compared(
    first: Description,
    second: Description,
    tolerance: float,
    stated: Mapping[str, str],
    ignored: tuple[str, ...] = (),
) -> Comparison:
    """Return the comparison of two descriptions; tolerance : relative to the range of an effort [-].

    stated : joints of the second by those of the first; ignored : names of features that are left out
    """
    first = with_dynamics(first)
    second = with_dynamics(second)
    lifted = first, second
    proofs = prove(first), prove(second)
    rooted = rooted_alike(first.mechanism, second.mechanism, stated)
    second = replace(second, mechanism=rooted.mechanism)
    flexible = first.mechanism, second.mechanism
    first, second = (replace(side, mechanism=held(side.mechanism)) for side in (first, second))
    one, two = (tree_of(side.mechanism, side.gears) for side in (first, second))
    pairs = match(one, two, stated)
    beams = _beams(flexible, pairs)
    if any(True for _ in beams.both):
        second = replace(second, mechanism=held(beams.base()))
        two = tree_of(second.mechanism, second.gears)
    bent = felt(beams)
    size = max(_size(one), _size(two))
    printed = Digits(Sheet(one, first.printed), Sheet(two, second.printed))
    found = _least(one, two, dict(pairs.pairs), size, printed)
    trees = found.trees
    seats = {found.trees.first.members[s.first].joint: s for s in found.seats}
    moving = {joint: seats[joint] for joint in trees.first.moving if trees.first.moving[joint] in dict(trees.pairs)}
    placed = first.root_stated and second.root_stated
    told = [*rooted.found, *(d for d in found.differences if placed or d.cause != START)]
    rounding = SINGLE * max(first.precision, second.precision)
    every = with_couplings(one, two, pairs.pairs, moving, told, max(SAME, rounding))
    tied = first.mechanism, second.mechanism
    every += loop_differences(tied, (one, two), pairs.pairs, moving, size, found.motion, max(SAME, rounding))
    states = states_of(trees.first)
    names = {joint: trees.second.members[seat.second].joint for joint, seat in moving.items()}
    wanted: dict[str, Any] = {}
    if names:
        theirs = efforts(_cut(second.mechanism), mapped(states, trees.first, moving), names)
        wanted = mapped_back(theirs, trees.first, moving)
    bound = max(tolerance, rounding)
    judged = _with_beams(judge(Bench(trees.first, states, wanted), [*every, *bent.differences], bound), bent)
    if any(side.features or side.dynamics is not None for side in lifted):
        silent = trees.first.changed(c for d in every if not d.cause for c in d.changes)
        places = states_of(trees.first, SEED, (SAMPLES, 0))
        ground = Ground(trees.first, places, moving, names, starts_of(trees.first, silent), not rooted.links)
        judged = with_features(judged, lifted, ground, ignored, bound)
    sides = Sides((first, second), (trees.first, trees.second), {s.first: s for s in found.seats}, rooted.links)
    return Comparison(
        first=first.label, second=second.label, matched=pairs.words, judged=judged,
        certificate=lines(trees.first, trees.second, moving),
        notes=(*_notes(one, two, pairs, found), *beams.meshes(), *bent.notes),
        dropped=tuple((d.label, d.dropped) for d in (first, second) if d.dropped),
        advice=advice(judged, sides), tolerance=bound, bends=not all(side.is_rigid for side in flexible),
        proofs=tuple((side.label, proof) for side, proof in zip(lifted, proofs, strict=True)),
        ignored=tuple(ignored_words(lifted, ignored)), featured=any(side.features for side in lifted),
    )  # fmt: skip


def _beams(mechanisms: tuple[Mechanism, Mechanism], pairs: Match) -> Beams:
    """The beams of both, by links whose joints are matched."""
    first, second = mechanisms
    joints = {a: b for a, b in pairs.pairs.items() if a in first.joint_of and b in second.joint_of}
    fixed = {j.child for m in mechanisms for j in m.joints if j.kind == "fixed"}
    links = {first.joint_of[a].child: second.joint_of[b].child for a, b in joints.items()}
    links |= {name: name for name in fixed if name in first.link_of and name in second.link_of and name not in links}
    return Beams(first, second, links, joints)


def _with_beams(judged: Judged, bent: Felt) -> Judged:
    """The judgement with the torques of links that bend, where those differ more."""
    worst = max((judged.before, judged.before_effort, judged.worst_joint), bent.before)
    after = max(judged.after, bent.after[0])
    return replace(judged, before=worst[0], before_effort=worst[1], worst_joint=worst[2], after=after)


def _cut(mechanism: Mechanism) -> Mechanism:
    return replace(mechanism, closures=(), springs=(), forces=())


def _size(tree: Tree) -> float:
    places = np.array([pose.position for pose in tree.poses()] or np.zeros((1, 3)))
    return float(np.ptp(places, axis=0).max()) or 1.0


def _least(one: Tree, two: Tree, joints: dict[str, str], size: float, printed: Digits) -> Found:
    """The explanation with the fewest differences: fixed links kept or merged."""
    kept = _found(one, two, joints, True, size, printed)
    if not _count(kept) or all(member.kind != "fixed" for member in kept.trees.first.members):
        return kept
    whole = _found(one, two, joints, False, size, printed)
    return kept if _count(kept) <= _count(whole) else whole


def _count(found: Found) -> int:
    """Differences that are no rounding, beside those of links welded to the world, which merging loses."""
    held = {f"link {m.name}" for m in found.trees.first.members if m.kind == "fixed" and m.parent < 0}
    return sum(
        1 for d in found.differences if d.cause and d.family != "limits" and d.place not in held and not rounded(d)
    )


def _found(one: Tree, two: Tree, joints: dict[str, str], links: bool, size: float, printed: Digits) -> Found:
    trees = reduced(one, two, joints, links)
    alignment = aligned(trees.first, trees.second, trees.pairs, size)
    members = trees.first.members, trees.second.members
    pairs = [Pair(members[0][s.first], members[1][s.second], s, size, printed) for s in alignment.seats]
    found: list[Difference] = []
    for pair in pairs:
        own = [*body_differences(pair)]
        lost = missing_links(pair) if any(d.cause in BODY for d in own) else None
        found += [*joint_differences(pair), *([lost] if lost else one_body(pair) or own), *drive_differences(pair)]
    found = exchanged(trees.first, trees.second, pairs, found)
    base = base_differences(trees.first, trees.second, alignment.motion, pairs)
    found = [*trees.found, *base, *alike(scaled(trees.first, found))]
    return Found(trees, alignment.seats, found, alignment.motion)


def _notes(one: Tree, two: Tree, pairs: Match, found: Found) -> list[str]:
    """Conventions that change no coordinate: names, order, frames of links, merged links."""
    notes = []
    renamed = {a: b for a, b in pairs.pairs.items() if a != b}
    if renamed:
        notes.append("joints with other names: " + ", ".join(f"{a} is {b}" for a, b in list(renamed.items())[:12]))
    order = [pairs.pairs[joint] for joint in one.moving if joint in pairs.pairs]
    if order != [joint for joint in two.moving if joint in set(order)]:
        notes.append("coordinates in another order: map them by name")
    frames = [
        found.trees.first.members[s.first].name
        for s in found.seats
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
