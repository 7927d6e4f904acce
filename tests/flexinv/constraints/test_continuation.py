"""Rigid closed loops as theorems: closed, consistent, balanced, shared out with least effort; bad ones named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from flexible_examples import observed_order
from four_bar_example import START, TURN, four_bar
from loop_examples import Example, loaded, loaded_tree

import flexinv
from flexinv.constraints.allocation import split_efforts
from flexinv.constraints.continuation import compute_mobility
from flexinv.kernels.so3 import exp_so3
from flexinv.model.mechanism import Mechanism, Placement


@pytest.fixture(scope="module")
def turned() -> flexinv.Solution:
    return flexinv.solve(four_bar(), TURN, step=5e-3, start=START)


def test_loop_is_closed_and_rates_are_derivatives(turned: flexinv.Solution) -> None:
    coupler_end, rocker_end = turned.tip["coupler"], turned.tip["rocker"]
    assert abs(coupler_end - rocker_end).max() < 1e-13  # Newton to rounding
    inner = (turned.q[2:] - turned.q[:-2]) / 1e-2
    assert abs(inner - turned.qd[1:-1]).max() < 2e-3 * abs(turned.qd).max()  # h^2 q'''/6 at h = 5e-3
    again = (turned.qd[2:] - turned.qd[:-2]) / 1e-2
    assert abs(again - turned.qdd[1:-1]).max() < 1e-2 * abs(turned.qdd).max()


def test_passive_joints_take_nothing_and_power_balances(turned: flexinv.Solution) -> None:
    scale = abs(turned.torque).max()
    assert abs(turned.unactuated).max() < 1e-13 * scale  # rounding of a small linear solve
    assert abs(turned.power_residual).max() < 1e-12 * scale * abs(turned.qd).max()
    work = np.trapezoid(turned.torque[:, 0] * turned.qd[:, 0], turned.time)
    assert abs(work) < 1e-3 * np.trapezoid(
        abs(turned.torque[:, 0] * turned.qd[:, 0]), turned.time
    )  # from rest to rest, closed


def test_torque_is_the_virtual_work_of_the_loop(turned: flexinv.Solution) -> None:
    """Independent of G: tau = sum over nodes P . dx/dq_A + Q . dphi/dq_A with the velocities of the closed loop per unit rate."""
    m = turned.mechanism
    moving = abs(turned.qd[:, 0]) > 1.0
    rate = turned.qd[moving, 0][:, None, None]
    mesh, nodes = turned.mesh, turned.nodes
    inertia = mesh.mass[:, None] * (nodes.a - m.gravity)
    spin = np.einsum("nij,snj->sni", mesh.inertia, nodes.omega)
    moment = np.einsum("nij,snj->sni", mesh.inertia, nodes.alpha) + np.cross(nodes.omega, spin)
    virtual = (inertia[moving] * nodes.v[moving] / rate).sum(axis=(1, 2)) + (
        moment[moving] * nodes.omega[moving] / rate
    ).sum(axis=(1, 2))
    assert virtual == pytest.approx(turned.torque[moving, 0], abs=1e-12 * abs(turned.torque).max())  # rounding


def test_closure_reaction_balances_the_rocker(turned: flexinv.Solution) -> None:
    """Moments on the rocker about D: inertia and weight = the closure's force at its end (planar, nothing else acts)."""
    force = turned.loops.reaction["C"][:, :3]  # type: ignore[union-attr] # in the rocker's own axes: x along, y across
    angle, qdd = turned.q[:, 2], turned.qdd[:, 2]
    needed = 0.4 * 0.4**2 / 3 * qdd + 0.4 * 9.81 * 0.2 * np.cos(angle)
    assert 0.4 * force[:, 1] == pytest.approx(needed, abs=1e-12 * abs(needed).max())  # rounding


def test_mobility_counts_redundant_constraints() -> None:
    s = flexinv.solve(four_bar(), TURN, step=0.1, start=START)
    assert vars(compute_mobility(s.mesh, s.q[0])) == {"freedoms": 1, "constraints": 5, "redundant": 3}
    skew = replace(four_bar(kind="spherical"))
    s = flexinv.solve(skew, TURN, step=0.1, start=START)
    assert vars(compute_mobility(s.mesh, s.q[0])) == {"freedoms": 1, "constraints": 3, "redundant": 1}


def test_redundant_constraints_change_nothing() -> None:
    """Revolute (three redundant rows) and spherical closure give the same planar torque."""
    a = flexinv.solve(four_bar(), TURN, step=0.02, start=START).torque
    b = flexinv.solve(four_bar(kind="spherical"), TURN, step=0.02, start=START).torque
    assert abs(a - b).max() < 1e-12 * abs(a).max()  # rounding of the pseudo-inverse


def test_observer_does_not_matter() -> None:
    m = four_bar()
    turn, shift = exp_so3(np.array([0.4, 0.9, -0.3])), np.array([1.0, 2.0, 3.0])
    moved = tuple(
        replace(j, placement=Placement(shift + turn @ j.placement.position, turn @ j.placement.rotation))
        if j.parent == "world"
        else j
        for j in m.joints
    )
    other = replace(m, joints=moved, gravity=turn @ m.gravity)
    a = flexinv.solve(m, TURN, step=0.02, start=START).torque
    b = flexinv.solve(other, TURN, step=0.02, start=START).torque
    assert abs(a - b).max() < 1e-11 * abs(a).max()  # rounding; the world frame is 4 m away


def test_two_drives_share_with_least_norm() -> None:
    """Crank and rocker both driven: the shares equal scipy's least squares, and the preload space is theirs."""
    m = four_bar()
    both = replace(m, joints=(m.joints[0], m.joints[1], replace(m.joints[2], actuated=True)))
    one = flexinv.solve(m, TURN, step=0.05, start=START)
    two = flexinv.solve(both, TURN, step=0.05, start=START)
    loops = two.loops
    assert loops is not None
    for k in range(len(two.time)):
        ratio = np.array([1.0, two.qd[k, 2] / two.qd[k, 0]]) if two.qd[k, 0] else None
        if ratio is not None:
            assert two.torque[k] == pytest.approx(np.linalg.lstsq(ratio[None], one.torque[k])[0], abs=1e-11)
        space = loops.preload[k]
        assert space.shape == (3, 1)
        assert abs(space.T @ two.torque_all[k]).max() < 1e-11  # least norm: no part along the preload


def test_share_out_weights_the_drives() -> None:
    g = np.array([[[1.0, -1.0]]])  # q1 = q2
    shares = split_efforts(g, np.array([[3.0, 0.0]]), np.array([True, True]), weight=np.array([1.0, 2.0]))
    assert shares.tau[0] == pytest.approx([2.0, 1.0])  # minimum of a^2 + 2 b^2 with a + b = 3


def test_weights_of_joints_share_out_the_work() -> None:
    """Against scipy's least squares of the efforts scaled by the root of their weights."""
    m = four_bar()
    heavy = replace(m.joints[0], weight=9.0)
    both = replace(m, joints=(heavy, m.joints[1], replace(m.joints[2], actuated=True)))
    one = flexinv.solve(m, TURN, step=0.05, start=START)
    two = flexinv.solve(both, TURN, step=0.05, start=START)
    root = np.array([3.0, 1.0])
    for k in range(1, len(two.time) - 1):
        ratio = np.array([[1.0, two.qd[k, 2] / two.qd[k, 0]]]) / root
        assert two.torque[k] == pytest.approx(np.linalg.lstsq(ratio, one.torque[k])[0] / root, abs=1e-11)


def _dead_point() -> tuple[Mechanism, flexinv.Motion]:
    """A parallelogram driven through its flat position: two branches meet."""
    m = four_bar(0.2, 0.45, 0.2, 0.45)
    return m, flexinv.Motion.point_to_point({"A": 1.0}, {"A": -1.0}, 1.0)


def test_a_dead_point_is_named() -> None:
    m, through = _dead_point()
    with pytest.raises(
        flexinv.ConvergenceError, match=r"t = 0\.\d+ s: (singular|the branch).*condition number .*drive another joint"
    ):
        flexinv.solve(m, through, step=0.05, start={"B": -1.0, "D": 1.0})


def test_a_position_out_of_reach_is_named() -> None:
    rocking = four_bar(0.5, 0.3, 0.3, 0.45)
    too_far = flexinv.Motion.point_to_point({"A": 0.5}, {"A": 3.0}, 1.0)
    with pytest.raises(
        flexinv.ConvergenceError, match=r"t = 0\.\d+ s: (singular|the branch of the closures cannot be followed)"
    ):
        flexinv.solve(rocking, too_far, step=0.01, start={"B": 1.0, "D": 2.5})


def test_loops_that_do_not_close_are_named() -> None:
    with pytest.raises(flexinv.ConvergenceError, match=r"t = 0 s: the loops do not close.*closure 'C'.*by 0\.6 m"):
        flexinv.solve(four_bar(0.1, 0.1, 0.1, 0.9), TURN, step=0.05, start=START)


def test_too_many_coordinates_are_named() -> None:
    twice = flexinv.Motion.point_to_point({"A": 0.3, "D": 1.8}, {"A": 1.0, "D": 2.0}, 1.0)
    with pytest.raises(
        flexinv.ConvergenceError, match=r"do not close.*where the motion puts A, D.*or give fewer coordinates a motion"
    ):
        flexinv.solve(four_bar(), twice, step=0.05, start={"B": 0.8})
    closed = flexinv.solve(four_bar(), TURN, step=0.05, start=START).q[0]
    fitting = flexinv.Motion.point_to_point({"A": 0.3, "D": closed[2]}, {"A": 1.0, "D": 2.0}, 1.0)
    with pytest.raises(flexinv.InputError, match="gives 2 of the coordinates, more than the mobility of 1"):
        flexinv.solve(four_bar(), fitting, step=0.05, start={"B": closed[1]})


def test_drives_that_do_not_suffice_are_named() -> None:
    m = four_bar()
    none = replace(m, joints=tuple(replace(j, actuated=False) for j in m.joints))
    with pytest.raises(flexinv.InputError, match=r"actuated joints cannot give this motion.*actuated = true"):
        flexinv.solve(none, TURN, step=0.05, start=START)


def test_both_branches_are_reachable() -> None:
    up = flexinv.solve(four_bar(), TURN, step=0.05, start=START)
    down = flexinv.solve(four_bar(), TURN, step=0.05, start={"B": -1.6, "D": -1.8})
    assert up.tip["rocker"][0, 1] > 0 > down.tip["rocker"][0, 1]


@pytest.mark.parametrize("example", [loaded, loaded_tree])
def test_work_of_springs_and_forces_is_counted(example: Callable[[], Example]) -> None:
    """Energy gained = work of drives, springs, dampers and forces, with the trapezoidal rule's second order."""
    mechanism, case = example()
    errors = []
    for step in (0.01, 0.005, 0.0025):
        s = flexinv.solve(mechanism, case.motion, step=step, start=case.start)
        errors.append(abs(s.balance.work).max())
    assert 1.9 < observed_order(errors) < 2.1


def test_error_bars_of_a_rigid_loop_are_rounding() -> None:
    """Closed formulas have no step: half of it gives the same torque."""
    s = flexinv.solve(four_bar(), TURN, step=0.05, start=START, error=True)
    assert s.torque_error is not None
    assert s.torque_error.shape == s.torque.shape
    assert s.torque_error.max() < 1e-11 * abs(s.torque).max()  # Newton to rounding, times the loop's condition
