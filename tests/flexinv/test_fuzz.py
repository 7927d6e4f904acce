"""Sixty cases of the fuzz (`python tests/shared/fuzz.py` for ten thousand), and whether its judge sees what is wrong."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import fuzz
import fuzz_judge
import numpy as np
import pytest
from fuzz_grammar import example
from fuzz_judge import Wrong, closes, judged

import flexinv
from flexinv.model.mechanism import Body, Inertia, Joint, Link, Placement

SEED, HERE, CASES = 1, 10, 50


@pytest.mark.slow
def test_fifty_cases_in_a_process_of_their_own(tmp_path: Path) -> None:
    """Those that follow the ones that are judged in this process."""
    tally = fuzz.Tally()
    for now in fuzz.run(HERE, CASES, SEED, jobs=1, kept=tmp_path):
        tally = now
    assert sum(tally.asked.values()) == CASES
    assert not tally.failures, tally.report()
    assert tally.share >= fuzz.ANSWERED, tally.report()


def test_a_number_is_one_case() -> None:
    assert example(17, SEED) == example(17, SEED)
    assert example(17, SEED).mechanism != example(17, SEED + 1).mechanism


def test_ten_cases_are_judged() -> None:
    for number in range(HERE):
        verdict = judged(example(number, SEED))
        assert verdict.outcome != "failure", verdict.message


def test_joints_that_nothing_holds_are_linearised() -> None:
    """Without stiffness a shift of K by the smallest number that there is gave shapes beyond the largest."""
    verdict = judged(example(8652, SEED))
    assert verdict.outcome == "answer", verdict.message


@cache
def swing() -> flexinv.Solution:
    arm = flexinv.load_mechanism(Path(__file__).resolve().parents[2] / "models" / "flex_one_link")
    motion = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 1.0}, duration=0.2, hold=0.1, law="quintic")
    return flexinv.solve(arm, motion, step=1e-3)


def test_a_true_solution_closes() -> None:
    assert closes(swing()) < 1e-3


def test_a_march_that_loses_its_energy_is_an_error() -> None:
    """Three links that whirl lose an eighth of the energy; at a quarter of the step less than a thousandth."""
    chain = swinging()
    with pytest.raises(flexinv.ConvergenceError, match=r"the steps lose or make .* J of the .* J that are exchanged"):
        flexinv.simulate(chain, [0.0, 2.0], np.zeros((2, 3)), step=0.02, start={"j1": 2.5})
    fine = flexinv.simulate(chain, [0.0, 2.0], np.zeros((2, 3)), step=0.005, start={"j1": 2.5})
    assert fine.energy_error < 1e-3 * fine.energy_exchanged


def swinging() -> flexinv.Mechanism:
    """Three rods of half a metre, one at the end of the other."""
    rod = Body("rod", Inertia(1.0, np.array([0.25, 0.0, 0.0]), np.diag([1e-4, 0.02, 0.02])))
    names = ("world", "l1", "l2", "l3")
    joints = tuple(
        Joint(f"j{k}", "revolute", names[k - 1], names[k], Placement(np.array([0.5 * (k > 1), 0.0, 0.0])))
        for k in (1, 2, 3)
    )
    links = tuple(Link(name, (rod,)) for name in names[1:])
    return flexinv.Mechanism("chain", links, joints, gravity=np.array([0.0, -9.81, 0.0]))


def test_a_torque_that_is_wrong_is_seen() -> None:
    with pytest.raises(Wrong, match="account of energy"):
        closes(replace(swing(), torque_all=1.02 * swing().torque_all))


def test_a_balance_that_is_wrong_is_seen() -> None:
    s = swing()
    for part, says in (("power", "power balance"), ("momentum", "momentum balance"), ("work", "bar of energy")):
        off = replace(s.balance, **{part: getattr(s.balance, part) + 0.1})
        with pytest.raises(Wrong, match=says):
            closes(replace(s, balance=off))


def test_what_is_not_finite_is_seen() -> None:
    torque = swing().torque_all.copy()
    torque[3] = np.nan
    with pytest.raises(Wrong, match="not finite"):
        closes(replace(swing(), torque_all=torque))


def test_what_is_no_error_of_flexinv_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("planted")

    monkeypatch.setattr(fuzz_judge, "_called", broken)
    verdict = judged(example(0, SEED))
    assert verdict.outcome == "failure"
    assert verdict.message == "ZeroDivisionError: planted"


def test_a_process_that_dies_or_hangs_is_a_failure() -> None:
    worker = fuzz.Worker.begin(SEED)
    worker.since, worker.limit = -1.0, 0.0
    assert "no answer within" in fuzz._finished(worker)
    worker.process.kill()
    worker.process.join()
    assert "died" in fuzz._finished(worker)
    worker.end()
