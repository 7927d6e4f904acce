"""Mechanisms that open and close while they move: two arms reach, grasp, carry and release a bar."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from two_arms_example import (
    FROM,
    GRASP,
    RELEASE,
    START,
    STEP,
    TO,
    motion,
    two_arms,
)

import flexinv
from crosscheck.engines.pinocchio import adapter as pinocchio
from flexinv.constraints.closures import build_constraint_rows, compute_constraint_jacobian, list_phases
from flexinv.constraints.continuation import compute_mobility, find_closed_near, solve_closed_motion
from flexinv.files.load_cases import load_cases
from flexinv.inverse.inverse_dynamics import compute_nodal_forces, compute_projected_efforts
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.mechanism import Mechanism


@pytest.fixture(scope="module")
def carried() -> flexinv.Solution:
    return flexinv.solve(two_arms(), motion(), step=STEP, start=START)


def test_the_bar_lies_is_carried_and_lies_again(carried: flexinv.Solution) -> None:
    bar = carried.q[:, 6:]
    grasp, release = round(GRASP / STEP), round(RELEASE / STEP)
    assert abs(bar[: grasp + 1] - FROM).max() < 1e-12
    assert abs(bar[release:] - TO).max() < 1e-12
    assert np.ptp(bar[grasp:release, 1]) > 0.1
    assert abs(carried.unactuated).max() < 1e-10 * abs(carried.torque).max()  # rounding: the bar drives nothing


def test_open_phases_equal_the_arms_alone(carried: flexinv.Solution) -> None:
    """Before the grasp and after the release the torques are those of two open arms."""
    m = two_arms()
    alone = Mechanism("arms", m.links[:6], m.joints[:6], m.gravity)
    open_ = np.r_[0 : round(GRASP / STEP), round(RELEASE / STEP) : len(carried.time)]
    expected = flexinv.joint_torques(alone, carried.q[open_, :6], carried.qd[open_, :6], carried.qdd[open_, :6])
    assert abs(carried.torque[open_] - expected).max() < 1e-9 * np.ptp(expected)  # the bound; rounding is less


def test_the_closed_phase_equals_the_closed_mechanism_and_least_squares(carried: flexinv.Solution) -> None:
    """While they carry: motion and virtual work of the mechanism with both grips, shared by scipy-like least squares."""
    closed = two_arms(timed=False)
    mesh, move = build(closed), motion()
    span = slice(round(GRASP / STEP), round(RELEASE / STEP))
    time = carried.time[span]
    unknown = np.array([False] * 6 + [True] * 3)
    rows = build_constraint_rows(mesh)
    q, qd, qdd = solve_closed_motion(
        mesh, lambda t: move.evaluate(closed, t), time, unknown, rows, carried.q[span.start]
    )
    assert abs(q - carried.q[span]).max() < 1e-12
    nodes = compute_rigid_motion(mesh, q, qd, qdd)
    tree = compute_projected_efforts(mesh, nodes, compute_nodal_forces(mesh, nodes))
    g = compute_constraint_jacobian(mesh, nodes, rows)
    for k in range(0, len(time), 20):
        allowed = np.linalg.svd(g[k])[2][np.linalg.matrix_rank(g[k], tol=1e-9) :]
        least = np.linalg.lstsq(allowed[:, :6], allowed @ tree[k])[0]
        assert carried.torque[span][k] == pytest.approx(least, abs=1e-9 * abs(least).max())
    assert carried.loops is not None
    assert carried.loops.preload.shape[2] == 3  # six drives, three freedoms


def test_closures_act_only_in_their_intervals(carried: flexinv.Solution) -> None:
    assert carried.loops is not None
    grip, table = carried.loops.reaction["left"], carried.loops.reaction["lies"]
    held = (carried.time >= GRASP) & (carried.time < RELEASE)
    assert abs(grip[~held]).max() == 0.0
    assert abs(grip[held]).max() > 1.0
    lies = carried.time < GRASP
    assert table[lies, 1] == pytest.approx(4.0 * 9.81, rel=1e-12)  # the table carries the bar's weight
    assert abs(table[~lies]).max() == 0.0


def test_power_balances_through_the_switches(carried: flexinv.Solution) -> None:
    power = np.abs(carried.torque_all * carried.qd).sum(axis=1).max()
    # grips that the spline of the samples meets to 1e-9 only do that much work
    assert abs(carried.power_residual).max() < 1e-6 * power


def test_an_incompatible_grasp_is_an_error() -> None:
    with pytest.raises(
        flexinv.InputError,
        match=r"t = 0\.5 s: closure 'left' begins to act on frames that move .* with 1 rad/s.*impact = \"plastic\"",
    ):
        flexinv.solve(two_arms(), motion(hurry=2.0), step=STEP, start=START)


def test_a_switch_between_samples_is_an_error() -> None:
    m = two_arms()
    late = replace(m.closures[0], active=((0.0, 0.5013),))
    with pytest.raises(
        flexinv.InputError, match=r"closure 'lies': it switches at 0\.5013 s, between two samples.*write step = "
    ):
        flexinv.solve(replace(m, closures=(late, *m.closures[1:])), motion(), step=STEP, start=START)


def test_a_bar_that_nothing_holds_is_an_error() -> None:
    m = two_arms()
    gone = replace(m.closures[0], active=((0.0, 0.25),))
    with pytest.raises(
        flexinv.InputError, match=r"t = 0\.25 s: from here on 3 of the coordinates.*x, y, turn.*active_s"
    ):
        flexinv.solve(replace(m, closures=(gone, *m.closures[1:])), motion(), step=STEP, start=START)


def test_info_counts_the_freedoms_at_the_start() -> None:
    """Only the table acts then: nine coordinates less the bar's three in the plane."""
    mesh = build(two_arms())
    q = find_closed_near(mesh, np.array([2.0, -1.0, 0.0, 1.0, 1.0, 0.0, *FROM]))
    mobility = compute_mobility(mesh, q)
    assert (mobility.freedoms, mobility.constraints, mobility.redundant) == (6, 6, 3)


def test_phases_of_a_grid() -> None:
    phases = list_phases(two_arms(), STEP * np.arange(301))
    assert [(p.first, p.last) for p in phases] == [(0, 100), (100, 200), (200, 301)]
    assert [p.active.tolist() for p in phases] == [
        [True, False, False, False],
        [False, True, True, False],
        [False, False, False, True],
    ]


def test_the_model_is_this_mechanism(root: Path) -> None:
    """models/two_arms and its samples are the mechanism and the motion of this file."""
    model = flexinv.load_mechanism(root / "models" / "two_arms")
    case = load_cases(root / "models" / "two_arms", model)["carry"]
    s = flexinv.solve(model, case.motion, step=case.step, start=case.start)
    here = flexinv.solve(two_arms(), motion(), step=case.step, start=START)
    # the same samples; the file says that they end at rest, which changes the spline near its ends only
    assert abs(s.torque - here.torque)[5:-5].max() < 1e-6 * np.ptp(here.torque)


def test_pinocchio_agrees_phase_by_phase_and_a_wrong_interval_is_seen(root: Path) -> None:
    model = flexinv.load_mechanism(root / "models" / "two_arms")
    case = load_cases(root / "models" / "two_arms", model)["carry"]
    solution = flexinv.solve(model, case.motion, step=case.step, start=case.start)
    result = pinocchio.run(model, case, "pinocchio", {})
    columns = np.stack([result.series[f"torque/{name}"].values for name in model.velocity_names], axis=1)
    scale = np.ptp(solution.torque_all)
    assert abs(columns - solution.torque_all).max() < 1e-10 * scale  # the bound for loops
    late = tuple(replace(c, active=((0.5, 0.9),)) if c.name == "right" else c for c in model.closures)
    other = pinocchio.run(replace(model, closures=late), case, "pinocchio", {})
    wrong = np.stack([other.series[f"torque/{name}"].values for name in model.velocity_names], axis=1)
    assert abs(wrong - solution.torque_all).max() > 1e-2 * scale  # one hand holds the bar alone for 0.1 s
