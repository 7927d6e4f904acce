"""From a trajectory to a Solution: the paper's second step, and everything else that follows from nodal motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexinv.applied import joint_springs
from flexinv.balance import balance, base_reaction
from flexinv.differences import differenced
from flexinv.inverse import NodalForces, along_joints, drive_efforts, joint_wrenches, nodal_forces, own_wrenches
from flexinv.joint import joint_effort
from flexinv.mechanism import Array, Mechanism
from flexinv.mesh import VELOCITIES, Mesh
from flexinv.nodal import NodalMotion
from flexinv.rigid import rigid_motion
from flexinv.solution import Solution
from flexinv.solver import Trajectory
from flexinv.system import FRICTION_RATE


def evaluate(
    mesh: Mesh, trajectory: Trajectory, time: Array, q: Array, qd: Array, qdd: Array, passive: set[str],
    settings: dict[str, float | int | str | bool], applied: NodalForces | None = None, brought: Array | None = None,
) -> Solution:  # fmt: skip
    """The paper's second step [N], [N m], and everything else that follows from the nodal motion.

    applied : springs, given forces and closures; brought : (samples,) energy that impacts bring [J]
    """
    mechanism = mesh.mechanism
    motion = trajectory.motion
    if settings["incremental"]:
        motion = differenced(motion, float(settings["step"]))
    forces = nodal_forces(mesh, motion, applied)
    wrenches = own_wrenches(mesh, motion, forces)
    tau = along_joints(mesh, len(motion.x), wrenches)
    drive = drive_efforts(mechanism, qd, qdd, direction=_direction(mechanism, qd, passive)) + joint_springs(
        mechanism, q
    )
    base = base_reaction(mesh, motion, trajectory.wrench)
    wrench = {name: wrenches[node] for name, node in mesh.joint_node.items()}
    internal, stations = _internal(mesh, trajectory)
    return Solution(
        mechanism=mechanism, mesh=mesh, time=time, q=q, qd=qd, qdd=qdd,
        torque_all=tau + drive,
        reaction=_reaction(mesh, motion, trajectory.wrench) + drive,
        nodes=motion, forces=forces,
        tip=_tips(mesh, motion), deflection=_deflections(mesh, motion), wrench=wrench,
        internal=internal, internal_stations=stations,
        balance=balance(mesh, motion, forces, tau, qd, base, trajectory.energy, time, applied, brought),
        iterations=trajectory.iterations, settings=settings, notes=mechanism.notes,
    )  # fmt: skip


def rigid_trajectory(mesh: Mesh, q: Array, qd: Array, qdd: Array, applied: NodalForces | None = None) -> Trajectory:
    """Return the trajectory of a rigid mechanism [m, rad, s, N]: exact kinematics, nothing to march; wrenches are those of P."""
    motion = rigid_motion(mesh, q, qd, qdd)
    wrenches = joint_wrenches(mesh, motion, nodal_forces(mesh, motion, applied))
    moment = np.einsum("snji,snj->sni", motion.rotation, wrenches.moment)
    wrench = np.concatenate([wrenches.force, moment], axis=2)
    return replace(Trajectory.empty(len(q), mesh), motion=motion, wrench=wrench)


def _direction(mechanism: Mechanism, qd: Array, passive: set[str]) -> Array:
    """Direction of dry friction: the sign of the rate, smoothed as in the march where the joint is passive.

    There FRICTION_RATE decides how slowly a joint that should stick creeps, and how short the steps have to be: Newton takes
    changes of the rate of up to some 20 FRICTION_RATE in a step.  A pendulum that friction stops (tests/test_friction.py):

        FRICTION_RATE   creeps, at 3/4 of what holds   beside sharp friction   Newton converges at steps of
        1e-2 rad/s      8e-3 rad/s                     1e-3 rad                10, 4, 1 ms
        1e-3            9e-4                           1e-4                    4, 1 ms
        1e-4            not to be had                                          none of them
    """
    smooth = np.array([j.name in passive for j in mechanism.joints for _ in range(j.nv)], dtype=bool)
    return np.where(smooth, np.tanh(qd / FRICTION_RATE), np.sign(qd))


def _reaction(mesh: Mesh, motion: NodalMotion, wrench: Array) -> Array:
    """Joint efforts from the elastic side: wrench of each joint's own rigid part and the beams that start on it."""
    out = np.zeros((len(motion.x), mesh.mechanism.nv))
    for node in np.flatnonzero(mesh.v_index >= 0):
        kind, first = int(mesh.kind[node]), mesh.v_index[node]
        force = np.einsum("sji,sj->si", motion.rotation[:, node], wrench[:, node, :3])
        effort = joint_effort(kind, mesh.axis[node], force, wrench[:, node, 3:])
        out[:, first : first + VELOCITIES[kind]] = effort
    return out


def _tips(mesh: Mesh, motion: NodalMotion) -> dict[str, Array]:
    out = {}
    for joint in mesh.mechanism.joints:
        link = mesh.mechanism.link_of[joint.child]
        node = mesh.tip_node.get(link.name, mesh.joint_node[joint.name])
        point = np.zeros(3) if link.beam is not None else link.tip
        out[link.name] = motion.x[:, node] + motion.rotation[:, node] @ point
    return out


def _deflections(mesh: Mesh, motion: NodalMotion) -> dict[str, Array]:
    """Tip in the root section's frame less its place in the stress-free shape, (samples, 3) [m]."""
    out = {}
    for link in mesh.mechanism.beams:
        root, tip = mesh.root_node[link.name], mesh.tip_node[link.name]
        place, turn = np.zeros(3), np.eye(3)
        for node in mesh.section_nodes[link.name][1:]:
            place, turn = place + turn @ mesh.offset[node], turn @ mesh.rotation[node]
        seen = np.einsum("sji,sj->si", motion.rotation[:, root], motion.x[:, tip] - motion.x[:, root])
        out[link.name] = seen - place
    return out


def _internal(mesh: Mesh, trajectory: Trajectory) -> tuple[dict[str, Array], dict[str, Array]]:
    e, values, stations = mesh.elements, {}, {}
    for index, link in enumerate(mesh.mechanism.links):
        own = np.flatnonzero(e.link == index)
        if link.beam is not None and len(own):
            values[link.name] = _points(trajectory.internal, own, e.order[own])
            stations[link.name] = np.concatenate([e.station[k, : e.order[k]] for k in own])
    return values, stations


def _points(internal: Array, own: NDArray[np.int64], order: NDArray[np.int64]) -> Array:
    """All points of the elements ``own`` in a row, (samples, points, 6); not copied where they stand so in memory."""
    points = internal.shape[2]
    if np.all(order == points) and np.all(np.diff(own) == 1):
        return internal[:, own[0] : own[-1] + 1].reshape(len(internal), -1, 6)
    return np.concatenate([internal[:, k, :n] for k, n in zip(own, order, strict=True)], axis=1)
