"""Inverse dynamics, the paper's second step: nodal accelerations and applied forces -> P -> joint torques, tau = L T P.

Stiffness and damping do not appear: they acted in the kinematics, and the trajectory carries the deformation.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flexinv.elements.joint_law import build_joint_laws, compute_moving_effort, compute_resisting_effort
from flexinv.errors import InputError
from flexinv.inverse.nodal_sums import Masses, fill_nodal_forces, fill_outboard_sums, fill_sums_in_frames
from flexinv.kernels.memory import make_contiguous
from flexinv.kinematics.mesh import Mesh, find_attachment_node
from flexinv.kinematics.nodal_motion import NodalMotion, read_scalar_coordinate
from flexinv.model.attachments import Spring
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Attachment, Mechanism
from flexinv.typing import Array, Indices


@dataclass(frozen=True)
class NodalForces:
    """P: what must act on every node so that it moves as it does.

    force : (samples, nodes, 3) [N], moment : (samples, nodes, 3) [N m] about the node; world frame
    """

    force: Array
    moment: Array

    def __add__(self, other: NodalForces | None) -> NodalForces:
        """Sum of two sets of nodal forces; None adds nothing."""
        return self if other is None else NodalForces(self.force + other.force, self.moment + other.moment)


@dataclass(frozen=True)
class SecondStep:
    """Result of the second step: torque (samples, nv) [N m], [N]; P of all nodes; joints' wrenches (`compute_local_wrenches`)."""

    torque: Array
    forces: NodalForces
    wrenches: dict[int, Array]


def compute_inverse_dynamics(
    mesh: Mesh, motion: NodalMotion, qd: Array, qdd: Array, applied: NodalForces | None = None, passive: bool = True
) -> SecondStep:
    """Return the effort of every joint coordinate, (samples, nv) [N m] or [N], for given nodal motion, call by call.

    P = M (a - g) - applied, summed inboard to joint wrenches, projected on the joint axes; plus the rotor's inertia, and with
    ``passive`` what damping and dry friction of the joint take from the actuator.  `TorqueFunction.nodal` runs this; it is the
    reference for the compiled passes: `evaluation.second_step` of solutions, `prepare` for rigid mechanisms.
    """
    forces = compute_nodal_forces(mesh, motion, applied)
    wrenches = compute_local_wrenches(mesh, motion, forces)
    tau = compute_projected_efforts(mesh, motion, forces, wrenches)
    return SecondStep(tau + compute_drive_efforts(mesh.mechanism, qd, qdd, passive), forces, wrenches)


def compute_nodal_forces(mesh: Mesh, motion: NodalMotion, applied: NodalForces | None = None) -> NodalForces:
    """Return P = M (a - g) [N] and Q = R (J al + w x J w) [N m] at every node and sample, less applied loads."""
    # (sample, node, xyz)
    force = np.empty(motion.a.shape)
    moment = np.empty(motion.a.shape)
    fill_nodal_forces(
        Masses(mesh.mass, mesh.inertia, make_contiguous(mesh.mechanism.gravity)), motion.frames, force, moment
    )
    return (
        NodalForces(force, moment) if applied is None else NodalForces(force - applied.force, moment - applied.moment)
    )


def compute_joint_wrenches(mesh: Mesh, motion: NodalMotion, forces: NodalForces) -> NodalForces:
    """Return for every node the sum of all nodal forces on and beyond it, moment about the node (world) [N], [N m].

    F_n = P_n + sum F_c,   M_n = Q_n + sum (M_c + (x_c - x_n) x F_c)   over the children c: suffix sums along the tree.
    """
    out = np.empty((*forces.force.shape[:2], 6))
    fill_outboard_sums(
        mesh.parent, make_contiguous(motion.x), make_contiguous(forces.force), make_contiguous(forces.moment), out
    )
    return NodalForces(out[..., :3], out[..., 3:])


def compute_local_wrenches(mesh: Mesh, motion: NodalMotion, forces: NodalForces) -> dict[int, Array]:
    """Return wrenches of `compute_joint_wrenches` of joints' nodes only, node -> (samples, 6) [N], [N m], in its own frame."""
    moves = np.flatnonzero(mesh.v_index >= 0)
    nodes = np.union1d(moves, np.array([*mesh.joint_node.values()], dtype=np.int64))
    return compute_wrenches_in_frames(mesh, motion, forces, nodes)


def compute_wrenches_in_frames(
    mesh: Mesh, motion: NodalMotion, forces: NodalForces, nodes: Indices
) -> dict[int, Array]:
    """Return wrenches of `compute_joint_wrenches` of some nodes, node -> (samples, 6) [N], [N m], each in its own frame."""
    wrenches = np.empty((len(nodes), len(motion.x), 6))
    line = np.empty((mesh.size, 6))
    parts = (make_contiguous(part) for part in (motion.x, motion.rotation, forces.force, forces.moment))
    fill_sums_in_frames(mesh.parent, nodes, *parts, line, wrenches)
    return dict(zip(nodes.tolist(), wrenches, strict=True))


def compute_projected_efforts(
    mesh: Mesh, motion: NodalMotion, forces: NodalForces, wrenches: dict[int, Array] | None = None
) -> Array:
    """Return the efforts L T P of nodal forces along each joint coordinate, (samples, nv) [N m] or [N]: S^T (force, moment).

    wrenches : their sums on and beyond the joints' nodes, where they are known (`compute_local_wrenches`) [N], [N m]
    """
    wrenches = compute_local_wrenches(mesh, motion, forces) if wrenches is None else wrenches
    tau = np.zeros((len(motion.x), mesh.mechanism.nv))
    for node in np.flatnonzero(mesh.v_index >= 0).tolist():
        wrench = wrenches[node]
        first = mesh.v_index[node]
        count = mesh.freedoms[node]
        slide = mesh.slide[node, :count]
        turn = mesh.turn[node, :count]
        tau[:, first : first + count] = wrench[:, :3] @ slide.T + wrench[:, 3:] @ turn.T
    return tau


def compute_drive_efforts(
    mechanism: Mechanism, qd: Array, qdd: Array, passive: bool = True, direction: Array | None = None
) -> Array:
    """Return rotor_inertia qdd, if ``passive`` + damping qd + friction direction (sign(qd) or given), (samples, nv) [N m, N]."""
    law = build_joint_laws(mechanism)
    if not passive:
        return law.rotor * qdd
    effort = np.asarray(compute_moving_effort(law, qd, qdd))
    if np.any(law.friction):
        effort += compute_resisting_effort(
            law._replace(stiffness=0.0), 0.0, np.sign(qd) if direction is None else direction
        )
    return effort


def compute_internal_efforts(
    mechanism: Mechanism, q: Array, qd: Array, qdd: Array, direction: Array | None = None
) -> Array:
    """Return the efforts of `compute_drive_efforts` and of joints' springs, over whole turns, (samples, nv) [N m] or [N]."""
    return compute_drive_efforts(mechanism, qd, qdd, direction=direction) + compute_spring_efforts(mechanism, q)


def compute_applied_forces(mesh: Mesh, motion: NodalMotion, time: Array) -> NodalForces | None:
    """Return forces [N] and moments [N m] (world, about the nodes) of springs and given forces; None if there are none.

    spring: pull = stiffness (l - rest) or its law, + damping l', on both ends towards each other;
    force: table at ``time`` (samples,) [s]
    """
    m = mesh.mechanism
    if not (m.springs or m.forces):
        return None
    out = NodalForces(np.zeros_like(motion.x), np.zeros_like(motion.x))
    for spring in m.springs:
        gap, speed, _ = compute_spring_gap(mesh, motion, spring)
        length = np.linalg.norm(gap, axis=1, keepdims=True)
        along = gap / np.maximum(length, np.finfo(float).tiny)
        rate = np.sum(along * speed, axis=1, keepdims=True)
        pull = (spring.evaluate_pull(length) + spring.damping * rate) * along  # on the first end, towards the second
        for end, end_force in ((spring.first, pull), (spring.second, -pull)):
            _add(out, mesh, motion, end, end_force, np.zeros_like(pull))
    for force in m.forces:
        node = find_attachment_node(mesh, force.at)
        wrench = np.stack([np.interp(time, force.time, column) for column in force.wrench.T], axis=1)  # (sample, 6)
        push = wrench[:, :3]
        turn = wrench[:, 3:]
        if force.follower and node >= 0:
            axes = motion.rotation[:, node] @ force.at.placement.rotation
            push, turn = (np.einsum("sij,sj->si", axes, part) for part in (push, turn))
        _add(out, mesh, motion, force.at, push, turn)
    return out


def compute_spring_gap(mesh: Mesh, motion: NodalMotion, spring: Spring) -> tuple[Array, Array, Array]:
    """Return the vector from a spring's first end to its second and its two rates, world axes, (samples, 3) [m, s]."""
    ends = [
        motion.compute_point_motion(find_attachment_node(mesh, at), at.placement.position)
        for at in (spring.first, spring.second)
    ]
    gap, rate, second = (b - a for a, b in zip(*ends, strict=True))
    return gap, rate, second


def _add(out: NodalForces, mesh: Mesh, motion: NodalMotion, at: Attachment, force: Array, moment: Array) -> None:
    """Add a force and a moment (samples, 3) at an attachment, in the world, to those of its node."""
    node = find_attachment_node(mesh, at)
    if node >= 0:
        out.force[:, node] += force
        out.moment[:, node] += moment + np.cross(motion.rotation[:, node] @ at.placement.position, force)


def compute_spring_efforts(mechanism: Mechanism, q: Array, history: bool = True) -> Array:
    """Return the efforts of the actuators against springs in the joints, stiffness (q - rest), (samples, nv) [N m] or [N].

    history : q (samples, nq) is a motion, along which the angle of a continuous joint is followed over whole turns;
        else each sample stands for itself, with its angle in -pi .. pi
    """
    out = np.zeros((len(q), mechanism.nv))
    laws = build_joint_laws(mechanism)._replace(friction=0.0)
    for joint in mechanism.joints:
        if joint.stiffness:
            coordinates = q[:, mechanism.q_slices[joint.name]]
            v = mechanism.v_slices[joint.name].start
            place = read_scalar_coordinate(joint, coordinates, history)
            out[:, v] = compute_resisting_effort(laws._replace(stiffness=joint.stiffness, rest=joint.rest), place, 0.0)
    return out


def compute_winding_efforts(mechanism: Mechanism, q: Array, wound: dict[str, float]) -> Array:
    """Return the efforts that springs of continuous joints add where q (samples, nq) goes on from whole turns, (nv,) [N m].

    wound : by joint the angle to which it was wound before [rad]; it is set to that of the last sample
    """
    out = np.zeros(mechanism.nv)
    for joint in mechanism.joints:
        if KINDS[joint.kind].circle and joint.stiffness:
            angle = read_scalar_coordinate(joint, q[:, mechanism.q_slices[joint.name]])
            turns = 2 * np.pi * np.round((wound.get(joint.name, angle[0]) - angle[0]) / (2 * np.pi))
            wound[joint.name] = float(angle[-1] + turns)
            out[mechanism.v_slices[joint.name].start] = joint.stiffness * turns
    return out


def check_constant(mechanism: Mechanism) -> None:
    """Raise InputError if a given force [N] depends on time, which a single configuration does not have."""
    varying = [f.name for f in mechanism.forces if len(f.time) > 1]
    if varying:
        advice = "write flexinv.solve(mechanism, motion, step=...)"
        raise InputError(f"mechanism '{mechanism.name}': force '{varying[0]}' depends on time; {advice}")


@dataclass(frozen=True)
class Factors:
    """tau = L T P of one sample, the three factors apart.

    P : (6 n,) nodal forces [N] and moments [N m] of all nodes, world frame
    T : (6 rows, 6 n) [-] block rows for each pair (link step j, node k): diag(R_j^T, R_j^T)
    L : (nv, 6 rows) [m] and [-] lever arms and directions, row by row in the frame of each step
    """

    L: Array
    T: Array
    P: Array


def compute_torque_factors(mesh: Mesh, motion: NodalMotion, forces: NodalForces, sample: int) -> Factors:
    """Return L, T and P of one sample [m], [-], [N]: ``L @ T @ P`` is the joint effort before drive efforts.

    For joint i and node k on or beyond it, the arm x_k - p_i is the sum of the steps along the path i -> k; each step r_j is
    taken in the frame of the node j that it starts from, so L holds lengths of members only:
    row (i; j, k) = [(a_i x r_j)^T, d a_i^T], with d = 1 for the last step (the node itself).  Prismatic: [d a_i^T, 0].
    Source: the paper, eqs. (2)-(3), in the letters of NOTATION.md.
    """
    x = motion.x[sample]
    rotation = motion.rotation[sample]
    steps = []  # (j, k, the node after j on the way to k, the joints with this step on their way)
    for k in range(mesh.size):
        if mesh.mass[k] or mesh.inertia[k].any():
            if mesh.v_index[k] >= 0:  # the joint node itself carries mass
                steps.append((k, k, k, [k]))
            for following, j in pairwise(_list_inboard_nodes(mesh, k)):
                joints = [i for i in _list_inboard_nodes(mesh, j) if mesh.v_index[i] >= 0]
                steps += [(j, k, following, joints)] if joints else []
    t = np.zeros((6 * len(steps), 6 * mesh.size))
    length = np.zeros((mesh.mechanism.nv, 6 * len(steps)))
    for n, (j, k, following, joints) in enumerate(sorted(steps)):
        for row in (0, 3):
            t[6 * n + row : 6 * n + row + 3, 6 * k + row : 6 * k + row + 3] = rotation[j].T
        arm = rotation[j].T @ (x[following] - x[j])
        last = 1.0 if following == k else 0.0
        for i in joints:
            rows = slice(mesh.v_index[i], mesh.v_index[i] + mesh.freedoms[i])
            axes = (part[i, : mesh.freedoms[i]] @ rotation[i].T @ rotation[j] for part in (mesh.turn, mesh.slide))
            turn, slide = axes  # of joint i in frame j (freedom, xyz)
            length[rows, 6 * n : 6 * n + 6] = np.hstack([np.cross(turn, arm) + last * slide, last * turn])
    p = np.concatenate([forces.force[sample], forces.moment[sample]], axis=1).ravel()
    return Factors(length, t, p)


def _list_inboard_nodes(mesh: Mesh, node: int) -> list[int]:
    """The nodes from one down to the root."""
    out = [node]
    while (parent := int(mesh.parent[out[-1]])) >= 0:
        out.append(parent)
    return out
