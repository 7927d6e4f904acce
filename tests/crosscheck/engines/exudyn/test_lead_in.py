"""Loops that start in motion in Exudyn: a lead-in from rest, its polynomial, and what goes wrong without it."""

from __future__ import annotations

from dataclasses import replace

import loop_examples as examples
import numpy as np
import pytest
from loop_examples import Example

from crosscheck.engines.base import sample_times
from crosscheck.engines.exudyn import adapter as exudyn
from crosscheck.engines.exudyn import lead_in as exudyn_lead
from crosscheck.engines.exudyn import loops as exudyn_loops
from crosscheck.engines.pinocchio import adapter as pinocchio
from crosscheck.measures.record import Record, check
from flexinv.model.motion import Motion

# Of the range, with error bars of order h^4 after extrapolation: what loops that start at rest keep too.
NEAR = 1e-6
# Samples of a motion, every millisecond.
TIME = np.linspace(0.0, 0.4, 401)


def moving(example: Example, rate: float, acceleration: float) -> Example:
    """The example's crank at a speed and with an acceleration from the start on."""
    mechanism, case = example
    angle = 0.3 + rate * TIME + acceleration * TIME**2 / 2
    motion = Motion.from_samples(TIME, {"A": angle})
    return mechanism, replace(case, motion=motion, end=0.4, sample=0.02, step=0.02)


def off(record: Record, other: Record, quantity: str) -> float:
    names = [n for n in record.series if n.startswith(f"{quantity}/") and n in other.series]
    span = max(np.ptp(other.series[n].values) for n in names)
    return float(max(np.abs(record.series[n].values - other.series[n].values).max() for n in names) / span)


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "acceleration"), [(0.0, 8.0), (5.0, 0.0), (-3.0, 6.0)])
def test_a_loop_that_starts_in_motion(rate: float, acceleration: float) -> None:
    """Springs, dampers and forces with tables that go with the time, at every sample, the first one included."""
    example = moving(examples.loaded(), rate, acceleration)
    assert exudyn.unsupported(*example, "exudyn-dae") is None
    record = exudyn.run(*example, "exudyn-dae", {"step": 5e-4, "error": False})
    check(record, sample_times(example[1]))
    other = pinocchio.run(*example, "pinocchio", {})
    for quantity in ("torque", "tip"):
        assert off(record, other, quantity) < NEAR, quantity
    assert str(record.settings["start"]).startswith("in motion, led into from rest")
    assert record.settings["integrator"] == "TrapezoidalIndex2"


def test_without_a_lead_in_the_start_is_a_transient(monkeypatch: pytest.MonkeyPatch) -> None:
    example = moving(examples.four_bar(), 0.0, 8.0)
    other = pinocchio.run(*example, "pinocchio", {})
    monkeypatch.setattr(
        exudyn_loops, "build_history", lambda mechanism, case, step: exudyn_lead.ExtendedMotion(mechanism, case)
    )
    record = exudyn.run(*example, "exudyn-dae", {"step": 5e-4, "error": False})
    assert off(record, other, "torque") > 1e-3


@pytest.mark.parametrize("rate", [0.0, 5.0])
def test_the_lead_in_meets_the_motion(rate: float) -> None:
    """From rest, with speed, acceleration and jerk of the motion where it begins."""
    mechanism, case = moving(examples.four_bar(), rate, 8.0)
    history = exudyn_lead.build_history(mechanism, case, 1e-3)
    assert history.lead >= 0.1
    near = 1e-5
    before, after = history(np.array([-near])), history(np.array([near]))
    for derivative, (one, two) in enumerate(zip(before, after, strict=True)):
        change = 2 * near * (history(np.zeros(1))[derivative + 1][0, 0] if derivative < 2 else 0.0)
        # what is left are the next derivatives: of some (acceleration / lead^2) near^2 of the rates
        assert abs(two[0, 0] - one[0, 0] - change) < 1e-5 * 8.0
    start = history(np.array([-history.lead]))
    for part in start[1:]:
        assert abs(part[0, 0]) < 1e-12 * 8.0
    t = np.linspace(-history.lead, 0.0, 4001)
    q, qd, qdd = (part[:, 0] for part in history(t))
    np.testing.assert_allclose(np.gradient(q, t)[1:-1], qd[1:-1], rtol=0, atol=1e-5 * np.abs(qd).max())
    np.testing.assert_allclose(np.gradient(qd, t)[1:-1], qdd[1:-1], rtol=0, atol=1e-5 * np.abs(qdd).max())


def test_from_rest_there_is_none() -> None:
    assert exudyn_lead.build_history(*examples.four_bar(), 1e-3).lead == 0.0


def test_what_cannot_be_led_into() -> None:
    mechanism, case = examples.platform()
    turning = Motion.from_samples(TIME, {"free": np.array([[t, 0, 0, 0, 0, 0, 1] for t in TIME])})
    reason = exudyn.unsupported(mechanism, replace(case, motion=turning, end=0.4), "exudyn-dae")
    words = "starts in motion: Exudyn finds its initial accelerations without those of the motion and takes none from outside"
    assert reason == f"joint free {words}; a lead-in is there for joints of one coordinate"
