"""Closed loops in the bench: chains of them, and the one that bends beside Exudyn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import loop_chains, torque_errors

MODELS = Path(__file__).resolve().parents[2] / "models"


def test_chains_of_loops_move_as_one_and_their_growth_is_asked() -> None:
    """All cranks of parallelograms stand alike; times have no limit here, only their growth has."""
    chain = loop_chains.build_four_bar_chain(3)
    solution = loop_chains.solve(chain, loop_chains.make_crank_motion(0.6), 0.05)
    assert np.abs(solution.q[:, :4] - solution.q[:, :1]).max() < 1e-12
    rows = loop_chains.run_study(loops=[1, 2], seconds=0.01)["rows"]
    assert {row["loops"] for row in rows} == {1, 2}
    asked = [row["metric"]["name"] for row in rows if "metric" in row]
    assert len(asked) == len(rows) // 2 == 4
    assert all(row["metric"]["upper"] == loop_chains.GROWTH for row in rows if "metric" in row)


@pytest.mark.slow
def test_exudyn_and_flexinv_give_the_torque_of_a_closed_loop_that_bends() -> None:
    """The march that is timed is that of the same mechanism: a mesh of 8 elements leaves 5e-4 of the peak (measured)."""
    arm = next(a for a in torque_errors.ARMS if a.model == "four_bar_flexible")
    mechanism, case = torque_errors.prepare_arm_case(arm, MODELS)
    end, samples = case.motion.duration, 20
    solution = loop_chains.solve(mechanism, case.motion, end / 4000, end=end, start=case.start)
    march = torque_errors.open_calls("exudyn").TorqueMarch(mechanism, case, "ancf", 8, 1000, end, samples)
    own, theirs = solution.torque[::200, 0], march.compute_torques()[:, mechanism.actuated][:, 0]
    assert np.abs(own - theirs).max() < 2e-3 * np.abs(own).max()
    march.make_runner()()
