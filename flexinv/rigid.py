"""Exact rigid kinematics: joint coordinates to the motion of every node (beams undeformed)."""

from __future__ import annotations

import numpy as np

from flexinv.joint import joint_motion
from flexinv.mechanism import Array
from flexinv.mesh import CONFIGURATIONS, VELOCITIES, Mesh
from flexinv.nodal import NodalMotion


def rigid_motion(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> NodalMotion:
    """Return the nodal motion [m, rad, s] of the undeformed mechanism for q (samples, nq), qd, qdd (samples, nv).

    Each node's pose, velocity and acceleration follow from its parent's by the equations at the head of `joint`.
    """
    motion = NodalMotion.empty(len(q), mesh.size)
    for node in range(mesh.size):
        _move(mesh, motion, node, q, qd, qdd)
    return motion


def _rotate(rotation: Array, vector: Array) -> Array:
    return np.einsum("sij,sj->si", rotation, vector)  # (sample, xyz)


def _back(rotation: Array, vector: Array) -> Array:
    return np.einsum("sji,sj->si", rotation, vector)  # (sample, xyz)


def _move(mesh: Mesh, motion: NodalMotion, node: int, q: Array, qd: Array, qdd: Array) -> None:
    """Set one node's motion from its parent's: first the joint frame A fixed in the parent, then the joint."""
    x, rotation, v, w, a, al = _joint_frame(mesh, motion, node)
    nq, nv = mesh.q_index[node], mesh.v_index[node]
    kind = int(mesh.kind[node])
    if nv >= 0:
        own_q, own_v = slice(nq, nq + CONFIGURATIONS[kind]), slice(nv, nv + VELOCITIES[kind])
        j = joint_motion(kind, mesh.axis[node], q[:, own_q], qd[:, own_v], qdd[:, own_v])
        wp = np.cross(w, j.p)
        x = x + _rotate(rotation, j.p)
        v = v + _rotate(rotation, wp + j.dp)
        a = a + _rotate(rotation, np.cross(al, j.p) + np.cross(w, wp) + 2 * np.cross(w, j.dp) + j.ddp)
        rotation = rotation @ j.rotation
        carried = _back(j.rotation, w)
        al = _back(j.rotation, al) + j.acceleration + np.cross(carried, j.rate)
        w = carried + j.rate
    motion.x[:, node], motion.rotation[:, node] = x, rotation
    motion.v[:, node], motion.omega[:, node] = v, w
    motion.a[:, node], motion.alpha[:, node] = a, al


def _joint_frame(mesh: Mesh, motion: NodalMotion, node: int) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Motion of the frame that the node's placement fixes in its parent."""
    samples, parent = len(motion.x), mesh.parent[node]
    r, turn = mesh.offset[node], mesh.rotation[node]
    if parent < 0:
        zero = np.zeros((samples, 3))
        return np.broadcast_to(r, (samples, 3)), np.broadcast_to(turn, (samples, 3, 3)), zero, zero, zero, zero
    rotation, w, al = motion.rotation[:, parent], motion.omega[:, parent], motion.alpha[:, parent]
    wr = np.cross(w, r)
    return (
        motion.x[:, parent] + rotation @ r,
        rotation @ turn,
        motion.v[:, parent] + _rotate(rotation, wr),
        w @ turn,
        motion.a[:, parent] + _rotate(rotation, np.cross(al, r) + np.cross(w, wr)),
        al @ turn,
    )
