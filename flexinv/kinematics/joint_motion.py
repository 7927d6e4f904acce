"""Joints: relative pose, velocity and acceleration of every node in its parent's frame, for all samples at once.

``p``, ``p'``, ``p''`` are taken in the parent node's frame, rotation rates in the node's own frame; what a
node's placement and its joint do together is one relative motion, so that one rule walks the tree (`kinematics.tree.carry`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.so3 import about_axis, about_axis_cs, from_quaternion
from flexinv.kinematics.mesh import CONFIGURATIONS, CONTINUOUS, FREE, PRISMATIC, REVOLUTE, SPHERICAL, VELOCITIES, Mesh
from flexinv.typing import Array

# Joint motion as a function of time: time (samples,) [s] -> q (samples, nq), qd, qdd (samples, nv) [rad or m, s].
JointHistory = Callable[[Array], tuple[Array, Array, Array]]


class Relative(NamedTuple):
    """Motion of nodes relative to their parents.

    p, dp, ddp : (samples, nodes, 3) [m], [m/s], [m/s^2] in the parent's frame
    rotation : (samples, nodes, 3, 3), R_parent,node; rate, acceleration : (samples, nodes, 3) [rad/s], [rad/s^2], own frame
    """

    p: Array
    dp: Array
    ddp: Array
    rotation: Array
    rate: Array
    acceleration: Array


def relative_motion(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> Relative:
    """Return the motion of every node in its parent's frame [m, rad, s] for q (samples, nq), qd, qdd (samples, nv).

    Velocity of a free joint is linear then angular, both in the child's frame: p' = R_j v, p'' = R_j (v' + w x v).
    """
    samples = len(q)
    still = [np.zeros((samples, mesh.size, 3)) for _ in range(4)]
    p = np.tile(mesh.offset, (samples, 1, 1))
    rotation = np.tile(mesh.rotation, (samples, 1, 1, 1))
    out = Relative(p, still[0], still[1], rotation, still[2], still[3])
    for node in np.flatnonzero(mesh.v_index >= 0):
        kind, nq, nv = int(mesh.kind[node]), mesh.q_index[node], mesh.v_index[node]
        own_q, own_v = slice(nq, nq + CONFIGURATIONS[kind]), slice(nv, nv + VELOCITIES[kind])
        own = q[:, own_q], qd[:, own_v], qdd[:, own_v]
        _add_joint(out, int(node), kind, mesh.rotation[node], mesh.axis[node], *own)
    return out


def _add_joint(
    out: Relative, node: int, kind: int, placed: Array, axis: Array, q: Array, qd: Array, qdd: Array
) -> None:
    """Put one joint's motion on top of its node's placement, whose rotation is ``placed``."""
    if kind == PRISMATIC:
        direction = placed @ axis
        out.p[:, node] += q * direction
        out.dp[:, node], out.ddp[:, node] = qd * direction, qdd * direction
        return
    if kind == FREE:
        turn, v, w = from_quaternion(q[:, 3:]), qd[:, :3], qd[:, 3:]
        out.p[:, node] += q[:, :3] @ placed.T
        out.dp[:, node] = np.einsum("sij,sj->si", placed @ turn, v)  # (sample, xyz)
        out.ddp[:, node] = np.einsum("sij,sj->si", placed @ turn, qdd[:, :3] + np.cross(w, v))
        rate, acceleration = w, qdd[:, 3:]
    elif kind == SPHERICAL:
        turn, rate, acceleration = from_quaternion(q), qd, qdd
    else:
        turn = about_axis_cs(axis, q[:, 0], q[:, 1]) if kind == CONTINUOUS else about_axis(axis, q[:, 0])
        rate, acceleration = qd * axis, qdd * axis
    out.rotation[:, node] = placed @ turn
    out.rate[:, node], out.acceleration[:, node] = rate, acceleration


def joint_axes(kind: int, axis: Array) -> tuple[Array, Array]:
    """Return translation and rotation axes of a joint's freedoms, (nv, 3) each [-], in the child's frame."""
    eye, none = np.eye(3), np.zeros((3, 3))
    if kind == PRISMATIC:
        return axis[None], np.zeros((1, 3))
    if kind == SPHERICAL:
        return none, eye
    if kind == FREE:
        return np.vstack([eye, none]), np.vstack([none, eye])
    if kind in (REVOLUTE, CONTINUOUS):
        return np.zeros((1, 3)), axis[None]
    return np.zeros((0, 3)), np.zeros((0, 3))


def axes_of_nodes(mesh: Mesh) -> tuple[NDArray[np.int64], Array, Array]:
    """Return freedoms (nodes,), slide and turn (nodes, 6, 3) [-]: the axes of every node's joint in its own frame."""
    freedoms = np.zeros(mesh.size, dtype=np.int64)
    slide, turn = np.zeros((mesh.size, 6, 3)), np.zeros((mesh.size, 6, 3))
    for n in np.flatnonzero(mesh.v_index >= 0):
        freedoms[n] = count = VELOCITIES[int(mesh.kind[n])]
        slide[n, :count], turn[n, :count] = joint_axes(int(mesh.kind[n]), mesh.axis[n])
    return freedoms, slide, turn


def joint_effort(kind: int, axis: Array, force: Array, moment: Array) -> Array:
    """Return the components of a wrench along the joint's freedoms, (samples, nv) [N m] or [N].

    ``force`` [N] and ``moment`` [N m], (samples, 3), act on the child at its link frame, in that frame's axes.
    """
    sliding, turning = joint_axes(kind, axis)
    return force @ sliding.T + moment @ turning.T
