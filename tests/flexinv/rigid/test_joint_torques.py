"""joint_torques and the rigid half of inverse dynamics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexible_examples import spatial_tree
from loop_examples import loaded_tree

import flexinv
from flexinv.inverse.inverse_dynamics import compute_inverse_dynamics, compute_joint_wrenches, compute_nodal_forces
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_differenced_motion, compute_rigid_motion
from flexinv.model.mechanism import WORLD, Body, Inertia, Joint, Link, Mechanism, Placement


def _two_joints(**drive: float) -> Mechanism:
    rod = Inertia(2.0, np.array([0.5, 0.0, 0.0]), np.diag([0.0, 2 / 12, 2 / 12]))
    links = (Link("a", (Body("rod", rod),)), Link("b", (Body("rod", rod),)))
    joints = (
        Joint("one", "revolute", "world", "a", **drive),  # type: ignore[arg-type]
        Joint("two", "prismatic", "a", "b", Placement(np.array([1.0, 0, 0])), axis=np.array([1.0, 0, 0])),
    )
    return Mechanism("two", links, joints, gravity=np.array([0.0, -9.81, 0.0]))


def test_drive_efforts_are_part_of_what_the_actuator_gives() -> None:
    q, qd, qdd = np.array([[0.3, 0.1]]), np.array([[-2.0, 0.5]]), np.array([[4.0, 1.0]])
    plain = flexinv.joint_torques(_two_joints(), q, qd, qdd)
    full = flexinv.joint_torques(_two_joints(rotor_inertia=0.1, damping=0.7, friction=0.2), q, qd, qdd)
    bare = flexinv.joint_torques(_two_joints(rotor_inertia=0.1, damping=0.7, friction=0.2), q, qd, qdd, passive=False)
    assert full[0, 0] - plain[0, 0] == pytest.approx(0.1 * 4 - 0.7 * 2 - 0.2)
    assert bare[0, 0] - plain[0, 0] == pytest.approx(0.1 * 4)  # what rnea gives: with armature, without friction


def test_closed_form_of_a_rod_with_a_slide() -> None:
    """Rod 1 turns by q, rod 2 slides by r along it (c = 1.5 + r is the place of its centre):

    tau = (m/4 + J1 + J2 + m c^2) q'' + 2 m c r' q' + m g (1/2 + c) cos q,    f = m (r'' - c q'^2) + m g sin q
    """
    q, r, qd, rd, qdd, rdd = 0.4, 0.2, 1.3, -0.7, 2.1, 0.9
    m, inertia, g = 2.0, 2 / 12, 9.81
    c = 1.5 + r  # centre of rod 2 from the pivot
    tau = (m * 0.25 + inertia + inertia + m * c**2) * qdd + 2 * m * c * rd * qd + m * g * (0.5 + c) * np.cos(q)
    force = m * (rdd - c * qd**2) + m * g * np.sin(q)
    got = flexinv.joint_torques(_two_joints(), [q, r], [qd, rd], [qdd, rdd])
    assert got == pytest.approx([tau, force], rel=1e-14)


def test_blocks_do_not_show() -> None:
    """More samples than one block gives the same as sample by sample."""
    rng = np.random.default_rng(0)
    q, qd, qdd = rng.normal(size=(3, 1100, 2))
    together = flexinv.joint_torques(_two_joints(), q, qd, qdd)
    for k in (0, 511, 512, 1024, 1099):
        assert np.array_equal(flexinv.joint_torques(_two_joints(), q[k], qd[k], qdd[k]), together[k])


def test_undeformed_tree_moves_as_a_rigid_one() -> None:
    """Velocities and accelerations of all nodes are the derivatives of their poses (differences of second order)."""
    mesh = build(spatial_tree())
    rng = np.random.default_rng(1)
    q0, qd0, qdd0 = rng.normal(size=(3, mesh.mechanism.nv))
    step = 1e-4
    time = step * np.arange(-4, 5)[:, None]
    q, qd, qdd = q0 + qd0 * time + qdd0 * time**2 / 2, qd0 + qdd0 * time, np.tile(qdd0, (9, 1))
    exact = compute_rigid_motion(mesh, q, qd, qdd)
    differenced_motion = compute_differenced_motion(exact, step)
    for name in ("v", "omega", "a", "alpha"):
        a, b = getattr(exact, name)[4], getattr(differenced_motion, name)[4]
        assert abs(a - b).max() < 1e-5 * abs(a).max(), name  # h^2 times third derivatives; rounding 1e-16/h^2 = 1e-8


def test_the_tree_sum_equals_the_sum_over_nodes() -> None:
    """Suffix sums against the definition: moment_i = sum over nodes beyond i of (x_k - p_i) x P_k + Q_k."""
    mesh = build(spatial_tree())
    rng = np.random.default_rng(2)
    q, qd, qdd = rng.normal(size=(3, 1, mesh.mechanism.nv))
    motion = compute_rigid_motion(mesh, q, qd, qdd)
    tau = compute_inverse_dynamics(mesh, motion, qd, qdd, passive=False).torque
    base = mesh.joint_node["slew"]
    force = mesh.mass[:, None] * (motion.a[0] - mesh.mechanism.gravity)
    body = np.einsum("nij,nj->ni", mesh.inertia, motion.alpha[0]) + np.cross(
        motion.omega[0], np.einsum("nij,nj->ni", mesh.inertia, motion.omega[0])
    )
    moment = np.einsum("nij,nj->ni", motion.rotation[0], body) + np.cross(motion.x[0] - motion.x[0, base], force)
    axis = motion.rotation[0, base, :, 2]
    assert moment.sum(axis=0) @ axis + 0.01 * qdd[0, 0] == pytest.approx(tau[0, 0], rel=1e-13)


@pytest.mark.parametrize(
    ("q", "words"),
    [
        ([[0.0]], r"q has shape \(1, 1\).*needs \(samples, 2\): one, two"),
        ([[0.0, np.nan]], r"q\[0, 1\] is nan"),
        (np.zeros((3, 2)), r"\[3, 1, 1\] samples"),
    ],
)
def test_bad_arrays_are_explained(q: object, words: str) -> None:
    with pytest.raises(flexinv.InputError, match=words):
        flexinv.joint_torques(_two_joints(), q, np.zeros((1, 2)), np.zeros((1, 2)))  # type: ignore[arg-type]


def test_samples_of_a_sprung_continuous_joint_stand_for_themselves() -> None:
    """Nothing follows the angle from one sample to the next: their order does not matter."""
    mechanism = replace(loaded_tree()[0], forces=())
    angle, bend = np.random.default_rng(3).uniform(-np.pi, np.pi, (2, 50))
    q, still = np.stack([np.cos(angle), np.sin(angle), bend], axis=1), np.zeros((50, 2))
    tau = flexinv.joint_torques(mechanism, q, still, still)
    alone = [flexinv.joint_torques(mechanism, *sample) for sample in zip(q, still, still, strict=True)]
    assert abs(tau - alone).max() < 1e-13 * abs(tau).max()  # rounding


def test_nodal_forces_and_their_sums_are_those_of_the_definition() -> None:
    """Every sample and node against NumPy; arrays that are read-only, or not in one piece, too."""
    mesh = build(spatial_tree())
    rng = np.random.default_rng(4)
    motion = compute_rigid_motion(mesh, *rng.normal(size=(3, 5, mesh.mechanism.nv)))
    force = mesh.mass[:, None] * (motion.a - mesh.mechanism.gravity)
    body = np.einsum("nij,snj->sni", mesh.inertia, motion.alpha)
    body += np.cross(motion.omega, np.einsum("nij,snj->sni", mesh.inertia, motion.omega))
    moment = np.einsum("snij,snj->sni", motion.rotation, body)
    motion.a.flags.writeable = False
    odd = replace(motion, x=np.asfortranarray(motion.x), omega=np.asfortranarray(motion.omega))
    forces = compute_nodal_forces(mesh, odd)
    assert abs(forces.force - force).max() < 1e-14 * abs(force).max()  # rounding of a product
    assert abs(forces.moment - moment).max() < 1e-14 * abs(moment).max()  # and of sums of nine
    summed = compute_joint_wrenches(mesh, odd, forces)
    beyond = [[n] for n in range(mesh.size)]
    for n in range(mesh.size - 1, 0, -1):
        if mesh.parent[n] >= 0:
            beyond[mesh.parent[n]] += beyond[n]
    for n, nodes in enumerate(beyond):
        arms = motion.x[:, nodes] - motion.x[:, [n]]
        about = np.sum(moment[:, nodes] + np.cross(arms, force[:, nodes]), axis=1)
        assert (
            abs(summed.force[:, n] - force[:, nodes].sum(axis=1)).max() < 1e-13 * abs(force).max()
        )  # sums of some tens
        assert abs(summed.moment[:, n] - about).max() < 1e-13 * abs(summed.moment).max()


def test_axes_that_are_one_to_rounding_are_one() -> None:
    """The product of two such axes is rounding, along the axis itself as soon as across it: no frame may be built of it.

    A last digit of an axis changes efforts by as much, a few 1e-15 of their size; 1e-12 leaves room for sums over the chain.
    """
    rng = np.random.default_rng(3)
    body = Body("body", Inertia(1.0, np.array([0.1, 0.02, 0.03]), np.diag([0.01, 0.02, 0.025])))
    links = tuple(Link(f"link {k}", (body,)) for k in range(3))
    at = Placement(np.array([0.13, 0.02, 0.0]))
    for turn in range(200):
        axis = rng.normal(size=3) if turn % 2 else np.array([*rng.uniform(-2e-16, 2e-16, 2), 1.0])
        axis /= np.linalg.norm(axis)
        other = axis * (1.0 + rng.integers(-2, 3) * np.finfo(float).eps)
        torques = []
        for second in (axis, other):
            hinges = [
                Joint(f"joint {k}", "revolute", parent, f"link {k}", at, axis=own)
                for k, (parent, own) in enumerate(((WORLD, axis), ("link 0", second), ("link 1", axis)))
            ]
            mechanism = Mechanism("chain", links, tuple(hinges))
            torques.append(flexinv.joint_torques(mechanism, [[0.3, -0.5, 0.7]], [[1.0, -2.0, 0.5]], [[0.5, 1.0, -1.5]]))
        assert np.abs(torques[1] - torques[0]).max() <= 1e-12 * np.abs(torques[0]).max()
