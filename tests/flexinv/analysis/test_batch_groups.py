"""Scenarios that are alike: who is, and that a march among others gives what `solve` gives alone."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from flexible_examples import HALF_TURN, STRIP, TREE_MOTION, arm, spatial_tree
from planar_examples import PAPER_CASES

import flexinv
from flexinv.analysis.solve_many import match_scenarios, prepare_all, solve_alike
from flexinv.dynamics.generalized_alpha import Scheme
from flexinv.kernels.records import join_records
from flexinv.model.mechanism import Mechanism

STEP = 2e-3
JERKY = flexinv.Motion.point_to_point([0.0], [1.0], 1.0, law="bang-bang")


def stiffer(m: Mechanism, factor: float) -> Mechanism:
    """The mechanism with all beams so many times as stiff [-]."""
    sections = [
        replace(link.beam.section, stiffness=factor * link.beam.section.stiffness) for link in m.beams if link.beam
    ]
    beams = {link.name: replace(link.beam, section=s) for link, s in zip(m.beams, sections, strict=True) if link.beam}
    return replace(m, links=tuple(replace(link, beam=beams.get(link.name)) for link in m.links))


def assert_same(one: flexinv.Solution, two: flexinv.Solution) -> None:
    """Every number of both, bit for bit."""
    for name in ("time", "q", "qd", "qdd", "torque_all", "reaction", "iterations"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    for part, other in ((one.nodes, two.nodes), (one.forces, two.forces), (one.balance, two.balance)):
        for field in fields(part):
            np.testing.assert_array_equal(getattr(part, field.name), getattr(other, field.name))
    for name in ("tip", "deflection", "wrench", "internal", "internal_stations"):
        mine, theirs = getattr(one, name), getattr(two, name)
        assert list(mine) == list(theirs)
        for key, values in mine.items():
            np.testing.assert_array_equal(values, theirs[key])
    assert one.settings == two.settings


def test_who_is_alike() -> None:
    """Numbers may differ, structure and grid may not; what marches otherwise, or not at all, is left to `solve`."""
    plain, coarse = arm(), arm(2, 1)
    scenarios = [
        (plain, HALF_TURN, {}), (stiffer(plain, 2.0), HALF_TURN, {}), (coarse, HALF_TURN, {}), (plain, HALF_TURN, {"end": 0.3}),
        (plain, HALF_TURN, {"tolerance": 1e-9}), (spatial_tree(), TREE_MOTION, {}), (plain, JERKY, {}),
        (plain, HALF_TURN, {"initial": "static"}), (plain, HALF_TURN, {"step": -1.0}), (coarse, HALF_TURN, {"step": STEP}),
        (plain, HALF_TURN, {"step": "2e-3"}),
    ]  # fmt: skip
    assert match_scenarios(prepare_all(scenarios, {"step": STEP})) == [[0, 1], [2, 9], [3], [4]]


@pytest.mark.parametrize("name", ["one link, 4 x order 1", "two links", "one link, damped"])
def test_each_gives_what_it_gives_alone(name: str) -> None:
    """Designs and motions that differ, on two threads: work spaces pass from one to the other."""
    mechanism, motion, _ = PAPER_CASES[name]()
    designs = [mechanism, stiffer(mechanism, 1.5), stiffer(mechanism, 0.7)]
    track = motion.tracks[0]
    ways = [motion, replace(motion, tracks=(replace(track, values=0.5 * track.values), *motion.tracks[1:]))]
    pairs = [(design, way) for design in designs for way in ways for _ in range(2)]
    done: list[int] = []
    batch = flexinv.solve_many(
        *(list(part) for part in zip(*pairs, strict=True)), STEP, threads=2, progress=done.append
    )
    assert done == [1] * len(pairs)
    for (design, way), result in zip(pairs, batch.all(), strict=True):
        assert result.mechanism is design
        assert_same(result, flexinv.solve(design, way, STEP))


def test_a_march_that_fails_says_what_it_says_alone_and_spoils_no_other() -> None:
    soft = arm(section=replace(STRIP, stiffness=STRIP.stiffness * np.array([1, 1, 1, 1, 1, 1e-3])))
    batch = flexinv.solve_many([arm(), soft, arm(), soft, arm()], HALF_TURN, STEP, threads=1)
    assert list(batch.errors) == [1, 3]
    with pytest.raises(flexinv.ConvergenceError) as alone:
        flexinv.solve(soft, HALF_TURN, STEP)
    assert str(batch.errors[3]) == str(alone.value)
    single = flexinv.solve(arm(), HALF_TURN, STEP)
    for k in (0, 2, 4):
        result = batch.solutions[k]
        assert result is not None
        assert_same(result, single)


def test_what_stops_a_thread_stops_all_and_is_raised() -> None:
    prepared = prepare_all([(arm(), HALF_TURN, {})] * 50, {"step": STEP})
    seen: list[int] = []

    def interrupted(_: int) -> None:
        seen.append(1)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solve_alike(list(prepared.values()), 2, interrupted)
    assert len(seen) <= 2  # one of each thread


def test_stacked_records_keep_their_order() -> None:
    one, two = (Scheme(*range(k, k + 9)) for k in (0, 1))
    both = join_records([one, two])
    assert isinstance(both, Scheme)
    assert [tuple(int(part[k]) for part in both) for k in (0, 1)] == [tuple(one), tuple(two)]
