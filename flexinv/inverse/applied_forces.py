"""Applied forces on the nodes: springs between points, given forces and moments, and springs in joints."""

from __future__ import annotations

import numpy as np

from flexinv.elements.joint_law import laws_of, resisting_effort
from flexinv.errors import InputError
from flexinv.inverse.inverse_dynamics import NodalForces
from flexinv.kinematics.mesh import Mesh, attachment_node
from flexinv.kinematics.nodal_motion import NodalMotion, scalar_coordinate
from flexinv.model.mechanism import Attachment, Force, Mechanism, Spring
from flexinv.typing import Array


def applied_forces(mesh: Mesh, motion: NodalMotion, time: Array) -> NodalForces | None:
    """Return forces [N] and moments [N m] (world, about the nodes) of springs and given forces; None if there are none.

    spring: pull = stiffness (l - rest) or its law, + damping l', on both ends towards each other;
    force: table at ``time`` (samples,) [s]
    """
    m = mesh.mechanism
    if not (m.springs or m.forces):
        return None
    out = NodalForces(np.zeros_like(motion.x), np.zeros_like(motion.x))
    for spring in m.springs:
        _pull(mesh, motion, spring, out)
    for force in m.forces:
        _push(mesh, motion, force, time, out)
    return out


def _point(mesh: Mesh, motion: NodalMotion, at: Attachment) -> tuple[int, Array, Array, Array]:
    """Node, lever arm, position and velocity of an attachment's origin, (samples, 3) world."""
    node = attachment_node(mesh, at)
    place = at.placement.position
    if node < 0:
        still = np.zeros_like(motion.x[:, 0])
        return node, still, still + place, still
    arm = motion.rotation[:, node] @ place
    spin = np.einsum("sij,sj->si", motion.rotation[:, node], np.cross(motion.omega[:, node], place))
    return node, arm, motion.x[:, node] + arm, motion.v[:, node] + spin


def _pull(mesh: Mesh, motion: NodalMotion, spring: Spring, out: NodalForces) -> None:
    a, arm_a, xa, va = _point(mesh, motion, spring.first)
    b, arm_b, xb, vb = _point(mesh, motion, spring.second)
    gap = xb - xa
    length = np.linalg.norm(gap, axis=1, keepdims=True)
    along = gap / np.maximum(length, np.finfo(float).tiny)
    rate = np.sum(along * (vb - va), axis=1, keepdims=True)
    pull = (spring.pull(length) + spring.damping * rate) * along  # on a, towards b
    _add(out, a, arm_a, pull, np.zeros_like(pull))
    _add(out, b, arm_b, -pull, np.zeros_like(pull))


def _push(mesh: Mesh, motion: NodalMotion, force: Force, time: Array, out: NodalForces) -> None:
    node, arm, _, _ = _point(mesh, motion, force.at)
    wrench = np.stack([np.interp(time, force.time, column) for column in force.wrench.T], axis=1)  # (sample, 6)
    push, turn = wrench[:, :3], wrench[:, 3:]
    if force.follower and node >= 0:
        axes = motion.rotation[:, node] @ force.at.placement.rotation
        push, turn = (np.einsum("sij,sj->si", axes, part) for part in (push, turn))
    _add(out, node, arm, push, turn)


def _add(out: NodalForces, node: int, arm: Array, force: Array, moment: Array) -> None:
    if node >= 0:
        out.force[:, node] += force
        out.moment[:, node] += moment + np.cross(arm, force)


def joint_springs(mechanism: Mechanism, q: Array, history: bool = True) -> Array:
    """Return the efforts of the actuators against springs in the joints, stiffness (q - rest), (samples, nv) [N m] or [N].

    history : q (samples, nq) is a motion, along which the angle of a continuous joint is followed over whole turns;
        else each sample stands for itself, with its angle in -pi .. pi
    """
    out, laws = np.zeros((len(q), mechanism.nv)), laws_of(mechanism)._replace(friction=0.0)
    for joint in mechanism.joints:
        if joint.stiffness:
            own = q[:, mechanism.q_slices[joint.name]]
            place, v = scalar_coordinate(joint, own, history), mechanism.v_slices[joint.name].start
            out[:, v] = resisting_effort(laws._replace(stiffness=joint.stiffness, rest=joint.rest), place, 0.0)
    return out


def check_constant(mechanism: Mechanism) -> None:
    """Raise InputError if a given force [N] depends on time, which a single configuration does not have."""
    varying = [f.name for f in mechanism.forces if len(f.time) > 1]
    if varying:
        raise InputError(
            f"mechanism '{mechanism.name}': force '{varying[0]}' depends on time; "
            "write flexinv.solve(mechanism, motion, step=...)"
        )
