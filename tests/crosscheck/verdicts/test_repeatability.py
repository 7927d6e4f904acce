"""Scatter: what an engine makes of the last digits of its input is measured, and is no deterioration; anything more is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from crosscheck.engines.shared.rounding import SHAKE, PerturbedMotion
from crosscheck.measures.record import Record, series
from crosscheck.verdicts import baseline
from crosscheck.verdicts.baseline import Baseline
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.repeatability import SHAKEN, add_scatter
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism

TIME = np.linspace(0.0, 1.0, 11)
BLESSED, NOW, LIMIT = 8.6e-8, 1.02e-7, 1e-6
ROW = Comparison("loop", "fold", "exudyn", "flexinv", "torque", "N m", "within", "", NOW, NOW, 1.0, limit=LIMIT)
NIGHT = Baseline({baseline.make_comparison_key(ROW): BLESSED}, "it was looked at", "2026-02-01T01:00:00+00:00", {})


def record(off: float) -> Record:
    """Efforts that are so far from zero at one sample [N m]."""
    return Record("exudyn", time=TIME, series=dict(series("torque/hub", "N m", off * (TIME == 0.5))))


REFERENCE = record(0.0)


def test_what_last_digits_change_is_no_deterioration() -> None:
    """Runs between 9.2e-8 and 1.08e-7, all by 1e-15 in the start: 1.02e-7 is not known to be worse than 8.6e-8 + noise."""
    assert baseline.is_worse(ROW, NIGHT)
    row = add_scatter(ROW, REFERENCE, [record(off) for off in (9.2e-8, 1.08e-7, 9.9e-8)])
    assert row.scatter == pytest.approx(1.08e-7 - 9.2e-8)
    result = baseline.judge_by_baseline(row, NIGHT)
    assert result.verdict == "within"
    assert "the last digits of the input alone change it by 2e-08" in result.message


@pytest.mark.parametrize(
    "shaken",
    [
        [],  # nobody asked
        [record(NOW)] * 4,  # an engine that does not care about last digits
        [record(NOW + 1e-9), record(NOW - 1e-9)],  # scatter of a tenth of what it is worse by
        [Record("exudyn", status="error", message="it fell")],  # what fails says nothing
        [replace(record(NOW), series={})],
    ],
)
def test_what_is_worse_by_more_is_a_deviation(shaken: list[Record]) -> None:
    result = baseline.judge_by_baseline(add_scatter(ROW, REFERENCE, shaken), NIGHT)
    assert result.verdict == "deviation"
    assert "worse than blessed" in result.message


def test_scatter_does_not_lift_a_limit() -> None:
    """Beyond its limit a comparison deviates however it scatters."""
    beyond = replace(ROW, maximum=1e-5, verdict="deviation")
    assert not baseline.is_worse(beyond, NIGHT)
    assert baseline.judge_by_baseline(replace(beyond, scatter=1.0), NIGHT).verdict == "deviation"


def test_inputs_are_moved_by_last_digits_only_and_in_other_ways(root: object) -> None:
    """Each way another start, all within eight units of the last digit; without noise from sample to sample."""
    folder = f"{root}/models/bricard"
    mechanism = load_mechanism(folder)
    motion = load_cases(folder, mechanism)["fold"].motion
    given = motion.evaluate(mechanism, TIME)[0][:, 0]
    starts = set()
    for way in SHAKEN:
        moved = PerturbedMotion(motion, way).evaluate(mechanism, TIME)[0][:, 0]
        starts.add(float(moved[0]))
        factor = moved[given != 0.0] / given[given != 0.0] - 1.0
        np.testing.assert_allclose(
            factor, factor[0], rtol=0, atol=3e-16
        )  # a rounding of the product, one of the quotient
        assert 0.0 < np.abs(factor[0]) <= SHAKE + 3e-16
    assert len(starts) == len(SHAKEN)
