"""Bands are as wide as what remains at the rate of the joint: a log of other rates has another mix, and is covered, too."""

from __future__ import annotations

from pathlib import Path

import logged_arm
import numpy as np
import pytest

from crosscheck.identification.bands import ChannelJudgement, Scatter, compute_margins, fit_scatter, judge, predict
from crosscheck.identification.estimation.fit import build_problem, fit
from crosscheck.identification.identify import read_machine
from crosscheck.identification.logs.log import Log
from crosscheck.identification.readings import make_run

SLOW, NEAR, FAR = 0.15, 0.8, 0.05  # [rad/s], noise beside it and far away [N m]
FORE = ("q1", "q2", "t1", "t2")


def test_the_law_of_what_remains_is_told_by_residuals() -> None:
    """2000 residuals tell a standard deviation to 5 % where a fifth of them lie."""
    true = Scatter(0.01, near=1.0, turn=0.04)
    random = np.random.default_rng(2)
    rate = random.uniform(0.0, 1.0, 2000)
    unsure = np.full_like(rate, 0.05)
    held = random.normal(size=len(rate)) * np.sqrt(true.evaluate_scatter(rate) ** 2 + unsure**2)
    scatter = fit_scatter(rate, held, unsure, 1.0, 0.01)
    assert scatter is not None
    for v in (0.02, 0.1, 0.5, 0.9):
        at = np.array([v])
        assert scatter.evaluate_scatter(at)[0] == pytest.approx(true.evaluate_scatter(at)[0], rel=0.25)


def test_what_chance_makes_of_one_scatter_is_no_law_of_rates() -> None:
    """Twenty logs of residuals that hang together by five: two numbers more are taken for nothing in one of them at most."""
    random, laws = np.random.default_rng(3), 0
    for _ in range(20):
        held = np.repeat(random.normal(size=40), 5)
        rate = np.repeat(random.uniform(0.0, 1.0, 40), 5)
        laws += fit_scatter(rate, held, np.zeros(200), 5.0, 0.01) is not None
    assert laws <= 3
    assert fit_scatter(np.zeros(20), np.full(20, 0.3), np.zeros(20), 1.0, 0.01) is None


def noisy(folder: Path, seed: int) -> Log:
    """A log of the arm whose torques are noisy where its joints are slow: rates [rad/s], torques [N m]."""
    table, random = logged_arm.frame(folder, seed, noise=0.0), np.random.default_rng(seed)
    columns = {name: table[name].to_numpy() for name in FORE}
    for angle, torque in (("q1", "t1"), ("q2", "t2")):
        rate = np.abs(np.gradient(columns[angle], 0.004))
        size = np.where(rate < SLOW, NEAR, FAR)
        columns[torque] = columns[torque] + size * random.normal(size=len(rate))
    return Log(f"run {seed}", table["time_s"].to_numpy(), columns)


def test_slow_and_fast_samples_of_other_logs_have_bands_of_their_own(tmp_path: Path) -> None:
    """With one scatter for all rates the fast ones had bands of 10 to 20 RMS errors, and 68 % of the slow ones lay inside."""
    base = logged_arm.write_arm(tmp_path / "arm")
    text = (base / "identify.toml").read_text()
    (base / "identify.toml").write_text(f"between_runs = 0\n{text}")
    machine = read_machine(base)
    one, *others = (make_run(machine, noisy(tmp_path, seed)) for seed in range(4))
    task = build_problem(machine, (one,))
    result = fit(task)
    margin = compute_margins(task, result)
    slow, fast = list[ChannelJudgement](), list[ChannelJudgement]()
    for run in others:
        rate, told = np.abs(run.motion.qd), predict(machine, result, margin, run)
        slow += judge(machine, run, told, run.counted & (rate < SLOW))
        fast += judge(machine, run, told, run.counted & (rate > 2.0 * SLOW))
    assert np.mean([row.coverage for row in slow]) > 0.75
    assert min(row.coverage for row in fast) > 0.9
    assert max(row.width for row in fast) < 8.0
