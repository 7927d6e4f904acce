"""Exudyn's traps: what stops early, stalls, is not finite or writes where it should not becomes words or is closed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import exudyn as exu
import numpy as np
import pytest
import rigid_trees as trees

from crosscheck.engines.exudyn import adapter as exudyn
from crosscheck.engines.exudyn import integration as exudyn_solve
from crosscheck.engines.exudyn import run_in_time as exudyn_march
from crosscheck.engines.exudyn.integration import (
    ExudynFailure,
    NewtonStalled,
    Plan,
    Table,
    compute_step_size,
    compute_step_times,
    quiet,
)
from crosscheck.engines.exudyn.models import planar as exudyn_planar
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion

PLAN = Plan(end=0.1, step=1e-3, sample=0.01, index2=True, spectral_radius=0.5, tolerance=1e-9)


def pendulum() -> tuple[Mechanism, Case]:
    mechanism, _ = trees.double_pendulum()
    return mechanism, trees.case_of(Motion.point_to_point([0.0, 0.0], [1.0, -0.5], 0.1), 0.1, 0.01)


def test_the_step_divides_the_spacing_of_the_samples() -> None:
    assert compute_step_size(1e-3, 1e-4) == pytest.approx(1e-4, rel=1e-12)
    assert compute_step_size(5e-3, 3.75e-4) == pytest.approx(5e-3 / 14, rel=1e-12)
    assert compute_step_size(1e-3, 1.0) == 1e-3
    for wanted in (1e-4, 3.3e-4, 7e-6):
        ratio = 1e-3 / compute_step_size(1e-3, wanted)
        assert ratio == pytest.approx(round(ratio), rel=1e-12)
        assert compute_step_size(1e-3, wanted) <= wanted * (1 + 1e-9)


def test_a_time_between_the_steps_is_refused() -> None:
    table = Table(1e-3, np.arange(101.0))
    assert table(0.05 + 1e-12) == 50.0
    for time in (0.0505, -1e-3, 0.102):
        with pytest.raises(ExudynFailure, match=r"no multiple of 0\.001 s"):
            table(time)


def test_a_run_that_stops_early_is_a_failure() -> None:
    """Exudyn's time limit ends a run normally, with fewer rows."""
    mechanism, case = pendulum()
    before = exu.special.solver.timeout
    exu.special.solver.timeout = 1e-6
    try:
        with pytest.raises(ExudynFailure, match=r"\d+ of \d+ steps, the last at t = .* of 0\.1 s"):
            exudyn.run(mechanism, case, "exudyn-dae", {"step": 1e-5})
    finally:
        exu.special.solver.timeout = before


def test_newton_that_stalls_gives_the_reason_that_exudyn_keeps_to_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism, case = pendulum()
    monkeypatch.setattr(exudyn_march, "NEWTON", 1e-30)
    with pytest.raises(NewtonStalled, match=r"dynamicSolver failed: .*step size"):
        exudyn.run(mechanism, case, "exudyn-dae", {"step": 1e-3})


def test_a_stalled_run_is_repeated_and_the_record_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism, case = pendulum()
    whole = exudyn_planar.run

    def stubborn(drawing: exudyn_planar.Drawing, plan: Plan, *motion: np.ndarray) -> object:
        if plan.tolerance < 5e-9:
            raise NewtonStalled("as if")
        return whole(drawing, plan, *motion)

    monkeypatch.setattr(exudyn_planar, "run", stubborn)
    record = exudyn.run(mechanism, case, "exudyn-dae", {"step": 1e-3})
    assert record.settings["newton_tolerance"] == [pytest.approx(1e-8)] * 3  # of three refinements


def test_a_motion_that_is_not_finite_is_an_error_not_a_record() -> None:
    mechanism, case = pendulum()
    layout = exudyn_march.build_start_layout(mechanism, case)
    plane = exudyn_planar.find_plane(mechanism, layout)
    assert not isinstance(plane, str)
    q, qd, _ = case.motion.evaluate(mechanism, compute_step_times(PLAN))
    q, qd = np.where(compute_step_times(PLAN)[:, None] < 0.05, (q, qd), np.nan)
    for index2 in (True, False):
        drawing = exudyn_planar.build(mechanism, layout, plane, False, 1)
        with quiet(), pytest.raises(ExudynFailure, match=r"dynamicSolver failed"):
            exudyn_planar.run(drawing, replace(PLAN, index2=index2), q, qd)


def test_values_that_are_not_finite_are_found_with_their_time() -> None:
    class Sensor:
        def GetSensorStoredData(self, sensor: int) -> np.ndarray:
            data = np.stack([compute_step_times(PLAN), np.zeros(101)], axis=1)
            data[30, 1] = np.inf
            return data

    with pytest.raises(ExudynFailure, match=r"not finite, the first at t = 0\.03 s"):
        exudyn_solve._read(Sensor(), 0, PLAN)


def test_nothing_is_printed_or_written_and_the_switch_is_put_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    mechanism, case = pendulum()
    monkeypatch.chdir(tmp_path)
    before = exu.config.printToConsole
    exudyn.run(mechanism, replace(case, initial="static"), "exudyn-dae", {"step": 1e-3})
    assert exu.config.printToConsole == before
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


def test_reactions_at_rest_survive_a_hold() -> None:
    """A Jacobian kept from another position would let a mechanism at rest converge at once, to wrong reactions."""
    mechanism, p = trees.double_pendulum()
    motion = Motion.point_to_point([0.3, -0.4], [1.8, 0.9], 0.1, hold=0.1)
    record = exudyn.run(mechanism, trees.case_of(motion, 0.2, 0.01), "exudyn-dae", {"step": 1e-3})
    weight = p["g"] * ((p["m1"] * p["c1"] + p["m2"] * p["l1"]) * np.cos(1.8) + p["m2"] * p["c2"] * np.cos(1.8 + 0.9))
    held = record.series["torque/j1"].values[record.time > 0.1001]
    np.testing.assert_allclose(held, weight, rtol=0, atol=4e-4 * p["g"])  # index 2 drifts in place, (w h)^2 at 20 rad/s
    assert exudyn_solve.build_solver_settings(PLAN).timeIntegration.newton.modifiedNewtonJacUpdatePerStep
