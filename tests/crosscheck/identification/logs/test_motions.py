"""Motions of a log, and how well each is told."""

from __future__ import annotations

from dataclasses import replace

import logged_arm
import numpy as np
import pytest
import spoiled_drives

from crosscheck.identification.bands import Prediction
from crosscheck.identification.identify import read_machine
from crosscheck.identification.logs.motions import PARTS, judge_motions, judge_over_time, list_motions
from crosscheck.identification.machine import Machine
from crosscheck.identification.readings import Run, make_run
from flexinv.typing import Array


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Machine, Run]:
    folder = tmp_path_factory.mktemp("motions")
    machine = read_machine(logged_arm.write_arm(folder))
    return machine, make_run(machine, spoiled_drives.make_log(folder))


def make_resting(run: Run, rests: list[tuple[float, float]]) -> Run:
    """Return a run in which all joints stand from and to these times [s], and move at 1 rad/s elsewhere."""
    rate = np.ones_like(run.motion.qd)
    for start, end in rests:
        rate[(run.time >= start) & (run.time <= end)] = 0.0
    return replace(run, motion=replace(run.motion, qd=rate))


def predict_with(run: Run, error: Array) -> Prediction:
    """Return a prediction that is off by ``error`` (samples, channels) [N m], with bands of +-1 N m."""
    assert run.measured is not None
    value = run.measured - error
    none = np.zeros_like(value)
    return Prediction(run.name, run.time, value, value - 1.0, value + 1.0, none, none, none, run.sliding)


@pytest.mark.parametrize(
    ("rests", "count"),
    [([], 1), ([(2.0, 2.5)], 2), ([(2.0, 2.05)], 1), ([(0.0, 1.0), (3.0, 3.2), (7.0, 8.0)], 2)],
)
def test_motions_go_from_rest_to_rest(made: tuple[Machine, Run], rests: list[tuple[float, float]], count: int) -> None:
    """A rest is 0.1 s; what stands at the ends of the log is no motion."""
    machine, run = made
    motions = list_motions(machine, make_resting(run, rests))
    assert len(motions) == count
    for start, end in rests:
        assert not any(start < 0.5 * (a + b) < end for a, b in motions)


def test_each_motion_has_its_own_error(made: tuple[Machine, Run]) -> None:
    """By hand: 2 N m off in the second motion alone, which no band of 1 N m holds."""
    machine, run = made
    resting = make_resting(run, [(3.8, 4.2)])
    error = 2.0 * np.repeat((run.time > 4.0)[:, None], 2, axis=1)
    rows = judge_motions(machine, [(resting, predict_with(resting, error))])
    assert [(row.part, row.channel) for row in rows] == [
        (1, "torque/shoulder"), (1, "torque/elbow"), (2, "torque/shoulder"), (2, "torque/elbow"),
    ]  # fmt: skip
    assert [row.rms for row in rows] == [0.0, 0.0, 2.0, 2.0]
    assert [row.inside for row in rows] == [1.0, 1.0, 0.0, 0.0]
    assert run.measured is not None
    assert rows[2].left == 2.0 / np.std(run.measured[run.counted[:, 0], 0])


def test_over_time_every_sample_is_in_one_part(made: tuple[Machine, Run]) -> None:
    """Ends belong to both neighbours: a sample more for each edge at most."""
    machine, run = made
    rows = judge_over_time(machine, [(run, predict_with(run, np.zeros((len(run.time), 2))))])
    for c, channel in enumerate(machine.channels):
        counted = sum(row.samples for row in rows if row.channel == channel.name)
        assert 0 <= counted - run.counted[:, c].sum() <= PARTS
