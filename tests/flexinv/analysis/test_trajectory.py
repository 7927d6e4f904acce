"""The flexible march as theorems: rigid limits, orders, balances, invariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexible_examples import HALF_TURN, LENGTH, STRIP, TREE_MOTION, arm, observed_order, spatial_tree, torque_range

import flexinv
from flexinv.analysis.evaluation import FirstStep, run_second_step
from flexinv.analysis.task import Settings, Task
from flexinv.analysis.trajectory import integrate_flexible_motion
from flexinv.dynamics.system import Trajectory
from flexinv.inverse.inverse_dynamics import compute_inverse_dynamics
from flexinv.kernels.so3 import exp_so3
from flexinv.kinematics.mesh import build
from flexinv.model.mechanism import Body, Inertia, Joint, Link, Mechanism, Placement


def _rod_chain() -> Mechanism:
    rod = Inertia(0.215, np.array([0.2, 0.0, 0.0]), np.diag([1e-5, 0.00287, 0.00287]))
    links = tuple(Link(f"l{k}", (Body("rod", rod),)) for k in range(3))
    tip = Placement(np.array([0.4, 0.0, 0.0]), exp_so3(np.array([0.4, 0.0, 0.0])))
    joints = tuple(
        Joint(f"j{k}", "revolute", "world" if k == 0 else f"l{k - 1}", f"l{k}", Placement() if k == 0 else tip)
        for k in range(3)
    )
    return Mechanism("rods", links, joints)


@pytest.mark.parametrize("law", ["quintic", "bang-bang"])
@pytest.mark.parametrize("rho", [0.5, 0.99])
def test_rigid_links_through_the_march_give_the_exact_torque_at_every_step(law: str, rho: float) -> None:
    """No transient at the start nor at jumps: prescribed joints are eliminated, nothing is left to ring."""
    mechanism = _rod_chain()
    move = flexinv.Motion.point_to_point(np.zeros(3), [1.2, -0.9, 0.7], 0.5, hold=0.1, law=law)
    time = 1e-3 * np.arange(601)

    def before(t):  # type: ignore[no-untyped-def]
        return move.evaluate(mechanism, t, "left")

    def after(t):  # type: ignore[no-untyped-def]
        return move.evaluate(mechanism, t, "right")

    mesh = build(mechanism)
    (first,) = integrate_flexible_motion(Task(mesh, time, before, after, set(), Settings(1e-3, rho), move.jumps))
    q, qd, qdd = after(time)
    tau = compute_inverse_dynamics(mesh, first.trajectory.motion, qd, qdd).torque
    exact = flexinv.joint_torques(mechanism, q, qd, qdd)
    assert abs(tau - exact).max() <= 1e-12 * np.ptp(exact)  # rounding of some hundred operations
    assert abs(tau[:5] - exact[:5]).max() <= 1e-12 * np.ptp(exact)


def test_time_order_is_two() -> None:
    finest = flexinv.solve(arm(), HALF_TURN, step=3.125e-5).torque
    errors = []
    for halving in (0, 1, 2):
        step = 1e-3 / 2**halving
        torque = flexinv.solve(arm(), HALF_TURN, step=step).torque
        errors.append(float(np.sqrt(np.mean((torque - finest[:: round(step / 3.125e-5)]) ** 2))))
    # rms, as peaks of the fast modes come and go with the phase; 2 +- 0.15: the reference itself carries 0.4 % of the first error
    assert 1.85 < observed_order(errors) < 2.15


@pytest.mark.parametrize(
    ("order", "meshes", "expected"), [(1, (8, 16, 32), 2.0), (2, (2, 4, 8), 4.0), (3, (1, 2, 4), 6.0)]
)
def test_mesh_order_of_the_static_spatial_bend(order: int, meshes: tuple[int, ...], expected: float) -> None:
    """Nodal displacements of an element of order p with p Gauss points converge as h^(2p) (superconvergence)."""
    tips = []
    for elements in (*meshes, 64 // order):
        mechanism = replace(arm(elements, order), joints=(Joint("hub", "fixed", "world", "link"),))
        loads = [flexinv.Load("link", force=[0.0, 1.5, 8.0], moment=[0.05, 0.0, 0.0])]
        tips.append(flexinv.statics(mechanism, loads).tip["link"][0])
    errors = [float(np.linalg.norm(tip - tips[-1])) for tip in tips[:-1]]
    assert abs(observed_order(errors) - expected) < 0.35  # pre-asymptotic; orders differ by 2


@pytest.mark.parametrize(("elements", "order"), [(4, 1), (1, 4)])
def test_rigid_limit_is_the_rigid_link_with_the_same_lumped_mass(elements: int, order: int) -> None:
    """As EI grows the torque tends to that of the rigid link carrying the element's lumped mass, as 1/EI.

    The move is a polynomial with five derivatives zero at its ends: it leaves no vibration behind, whose torque would fall as
    1/sqrt(EI) only.
    """
    time = np.linspace(0, 0.5, 1001)
    s = time / 0.5
    smooth = s**6 * (462 - 1980 * s + 3465 * s**2 - 3080 * s**3 + 1386 * s**4 - 252 * s**5)
    move = flexinv.Motion.from_samples(time, smooth[:, None])
    differences = []
    for stiffer in (10.0, 100.0):
        mechanism = arm(elements, order, section=replace(STRIP, stiffness=stiffer * STRIP.stiffness))
        tau = flexinv.solve(mechanism, move, step=5e-4).torque
        _, _, qdd = move.evaluate(mechanism, 5e-4 * np.arange(1001))
        lumped = _lumped_inertia(mechanism) * qdd
        differences.append(abs(tau - lumped).max() / abs(lumped).max())
    assert differences[1] == pytest.approx(0.1 * differences[0], rel=0.1)  # 1/EI, next term (1/EI)^2 is a tenth of it
    assert differences[1] < 2e-3


def _lumped_inertia(mechanism: Mechanism) -> float:
    """About the hub: sum m_i x_i^2 + J_i over the lumped nodes [kg m^2]."""
    mesh = build(mechanism)
    x = np.zeros(mesh.size)
    for node in range(1, mesh.size):
        x[node] = x[mesh.parent[node]] + mesh.offset[node, 0]
    return float((mesh.mass * x**2 + mesh.inertia[:, 2, 2]).sum())


def test_lumped_inertia_of_order_two_and_more_is_the_rods() -> None:
    """GLL lumping of order >= 2 integrates x^2 exactly: the inertia of the rod; order 1 exceeds it by 3.1 % on 4 elements."""
    rod = 0.056 * LENGTH**3 / 3 + 1.77e-8 * LENGTH
    assert _lumped_inertia(arm(1, 4)) == pytest.approx(rod, rel=1e-13)  # rounding
    assert _lumped_inertia(arm(1, 2)) == pytest.approx(rod, rel=1e-13)
    assert _lumped_inertia(arm(4, 1)) / rod - 1 == pytest.approx(1 / 32, rel=1e-3)  # 1 / (2 n^2)


def test_balances_of_a_spatial_tree() -> None:
    s = flexinv.solve(spatial_tree(), TREE_MOTION, step=1e-3, initial="static")
    force = np.abs(s.wrench["slew"][:, :3]).max()
    # Elastic forces are differences of strains times EA = 1.45e6 N: their rounding, a few ulp of 1, is 1e-9 N.
    assert abs(s.momentum_residual).max() < 1e-9 * force + 1e-8
    power = np.abs(s.torque_all * s.qd).sum(axis=1).max()
    assert abs(s.power_residual).max() < 1e-8 * power
    assert abs(s.torque_all - s.reaction).max() < 1e-8 * torque_range(s.torque_all)


def test_work_balance_closes_with_the_time_error() -> None:
    """Nodal forces are the gradient of the energy, so in space too only time steps are left: second order."""
    errors = []
    for step in (1e-3, 5e-4, 2.5e-4):
        s = flexinv.solve(spatial_tree(), TREE_MOTION, step=step, initial="static", spectral_radius=0.9)
        errors.append(abs(s.balance.work).max())
    assert 1.7 < observed_order(errors) < 2.3
    assert errors[-1] < 1e-3 * np.ptp(s.balance.kinetic)


def test_a_missing_force_breaks_the_balances() -> None:
    """The checks can fail: with nodal forces that leave gravity out, both balances are off by what gravity does."""
    s = flexinv.solve(spatial_tree(), TREE_MOTION, step=2e-3, initial="static")
    weightless = build(replace(s.mechanism, gravity=np.zeros(3)))
    elastic = Trajectory.make_zero(
        len(s.time), s.mesh
    )  # the reaction of the base as it was, on the node that hangs on it
    push, turn = s.forces.force.sum(axis=1), (np.cross(s.nodes.x, s.forces.force) + s.forces.moment).sum(axis=1)
    (root,) = np.flatnonzero(s.mesh.parent < 0)
    push, turn = push + s.momentum_residual[:, :3], turn + s.momentum_residual[:, 3:]
    own = np.einsum("sji,sj->si", s.nodes.rotation[:, root], turn - np.cross(s.nodes.x[:, root], push))
    elastic.wrench[:, root] = np.hstack([push, own])
    elastic.energy[:, :2] = np.stack([s.balance.elastic, np.gradient(s.balance.elastic, s.time)], axis=1)
    first = FirstStep(Trajectory(*s.nodes.parts, *elastic[6:]), s.time, (s.q, s.qd, s.qdd))
    result = run_second_step(weightless, first)
    weight = 9.81 * s.mesh.mass.sum()
    assert abs(result.momentum[:, 2] - weight).max() < 1e-6 * weight  # rounding of EA, as above
    assert abs(result.power).max() > 1e3 * abs(s.power_residual).max()


def test_torque_does_not_depend_on_the_observer() -> None:
    """Turn and shift the world: same torques (to the rounding of EA times ulp)."""
    tree = spatial_tree()
    turn, shift = exp_so3(np.array([0.7, -1.1, 0.4])), np.array([3.0, -2.0, 1.0])
    first = tree.joints[0]
    placed = Placement(shift + turn @ first.placement.position, turn @ first.placement.rotation)
    turned = replace(tree, joints=(replace(first, placement=placed), *tree.joints[1:]), gravity=turn @ tree.gravity)
    a = flexinv.solve(tree, TREE_MOTION, step=2e-3, initial="static").torque_all
    b = flexinv.solve(turned, TREE_MOTION, step=2e-3, initial="static").torque_all
    assert abs(a - b).max() < 1e-7 * torque_range(a)


def test_static_start_is_at_rest() -> None:
    """Held under gravity after a static start nothing moves; from the undeformed shape it swings."""
    drooping = replace(arm(gravity=(0.0, -9.81, 0.0)))
    hold = flexinv.Motion.point_to_point([0.0], [0.0], 0.2)
    still = flexinv.solve(drooping, hold, step=1e-3, initial="static")
    swings = flexinv.solve(drooping, hold, step=1e-3)
    assert np.ptp(still.torque) < 1e-8 * abs(still.torque).max()
    assert np.ptp(swings.torque) > 0.5 * abs(still.torque).max()


def test_a_finer_mesh_of_attachments_changes_nothing() -> None:
    """A massless link half way along the beam cuts its element; the torque stays within the mesh's error."""
    beam = arm(2, 4)
    extra = Link("flag")
    cut = replace(
        beam, links=(*beam.links, extra), joints=(*beam.joints, Joint("flag", "fixed", "link", "flag", station=0.3))
    )
    plain = flexinv.solve(beam, HALF_TURN, step=1e-3).torque
    flagged = flexinv.solve(cut, HALF_TURN, step=1e-3).torque
    assert abs(plain - flagged).max() < 2e-3 * torque_range(plain)


def test_too_coarse_an_element_is_named() -> None:
    soft = replace(STRIP, stiffness=STRIP.stiffness * np.array([1, 1, 1, 1, 1, 1e-3]))
    with pytest.raises(flexinv.ConvergenceError, match=r"link 'link'.*t = .*use more elements|Newton's increment"):
        flexinv.solve(arm(1, 1, section=soft), HALF_TURN, step=1e-3)
