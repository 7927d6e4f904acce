"""Certificate of a pair, line by line: masses, centre of mass, mass matrix, gravity, axes and drives of B against A.

The lines are those of `crosscheck.measures.certificate`; both sides are in A's coordinates.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from crosscheck.equivalence.alignment.member_alignment import MemberAlignment
from crosscheck.equivalence.efforts import States, evaluate_efforts, map_efforts_back, map_states, sample_states
from crosscheck.equivalence.tree import PASSIVE, SCALARS, Tree, build_mechanism
from crosscheck.lifting.rigid import move_inertia
from crosscheck.measures.certificate import EXACT, Check
from flexinv.model.mechanism import Array

PLACES = 4  # configurations, as in the certificate of an engine


def list_checks(first: Tree, second: Tree, alignments: Mapping[str, MemberAlignment]) -> tuple[Check, ...]:
    """Return the lines of a pair [unit of each line]; alignments : alignment by joint of the first."""
    names = {joint: second.members[seat.second].joint for joint, seat in alignments.items()}
    states = sample_states(first, count=(PLACES, 0))
    made = [*_list_body_checks(first, second, alignments)]
    if first.moving:
        made += [
            _make_check(
                "joint-space mass matrix",
                "kg m^2, kg",
                *_compute_both_efforts(first, second, alignments, names, states, True),
            ),
            _make_check(
                "gravity torque", "N m, N", *_compute_both_efforts(first, second, alignments, names, states, False)
            ),
        ]
    return (*made, *_list_axis_checks(first, second, alignments), *_list_drive_checks(first, second, alignments))


def _make_check(what: str, unit: str, ours: Array, theirs: Array, words: str = "") -> Check:
    error = float(np.abs(ours - theirs).max(initial=0.0))
    scale = float(np.abs(ours).max(initial=0.0))
    return Check("", "", "B", what, unit, error <= EXACT * (scale or 1.0), error, scale, EXACT, words)


def _list_body_checks(first: Tree, second: Tree, alignments: Mapping[str, MemberAlignment]) -> Iterator[Check]:
    masses = np.array([sum(m.mass for m in tree.members) for tree in (first, second)])
    yield _make_check("total mass", "kg", masses[:1], masses[1:])
    pairs = [
        (first.members[s.first], move_inertia(s.frame, second.members[s.second].inertia)) for s in alignments.values()
    ]
    for what, unit, name in (
        ("masses by joint", "kg", "mass"),
        ("centres of mass by joint", "m", "com"),
        ("inertias by joint", "kg m^2", "tensor"),
    ):
        gaps = [float(np.abs(np.asarray(getattr(a.inertia, name)) - getattr(b, name)).max()) for a, b in pairs]
        if gaps:
            k = int(np.argmax(gaps))
            a, b = (np.atleast_1d(np.asarray(getattr(x, name))) for x in (pairs[k][0].inertia, pairs[k][1]))
            yield _make_check(what, unit, a, b, pairs[k][0].name)


def _compute_both_efforts(
    first: Tree,
    second: Tree,
    alignments: Mapping[str, MemberAlignment],
    names: dict[str, str],
    states: States,
    inertia: bool,
) -> tuple[Array, Array]:
    """Mass matrix (columns of unit accelerations) or gravity effort of both, in A's coordinates."""
    none = np.zeros(3)
    one, two = (build_mechanism(t.replace_fields([(-1, "gravity", none)]) if inertia else t) for t in (first, second))
    quiet = [replace(m, joints=tuple(replace(j, stiffness=0.0) for j in m.joints)) for m in (one, two)]
    pushes = [
        states.apply_unit_acceleration(joint, k) for joint, rates in states.qd.items() for k in range(rates.shape[1])
    ] if inertia else [states.still]  # fmt: skip
    found = []
    for push in pushes:
        efforts = evaluate_efforts(quiet[0], push)
        theirs = map_efforts_back(
            evaluate_efforts(quiet[1], map_states(push, first, alignments), names), first, alignments
        )
        found.append([np.hstack([side[joint] for joint in states.qd]) for side in (efforts, theirs)])
    return np.array([a for a, _ in found]), np.array([b for _, b in found])


def _list_axis_checks(first: Tree, second: Tree, alignments: Mapping[str, MemberAlignment]) -> Iterator[Check]:
    gaps = {}
    for joint, seat in alignments.items():
        one = first.members[seat.first]
        two = second.members[seat.second]
        if one.kind in SCALARS and one.kind == two.kind:
            gaps[joint] = (one.axis, seat.sign * seat.frame.rotation @ two.axis)
    if gaps:
        worst = max(gaps, key=lambda name: float(np.abs(gaps[name][0] - gaps[name][1]).max()))
        yield _make_check("joint axes", "-", *gaps[worst], worst)


def _list_drive_checks(first: Tree, second: Tree, alignments: Mapping[str, MemberAlignment]) -> Iterator[Check]:
    for name in PASSIVE[:4]:
        values = np.array(
            [
                [getattr(t.members[k], name) for t, k in ((first, s.first), (second, s.second))]
                for s in alignments.values()
            ]
        )
        if values.size and values.any():
            k = int(np.argmax(np.abs(values[:, 0] - values[:, 1])))
            words = "joint " + name.replace("_", " ")
            yield _make_check(words, "N m s/rad, N m, kg m^2", values[k, :1], values[k, 1:], list(alignments)[k])
