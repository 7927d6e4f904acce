"""Coordinates of passive joints, from the nodal motion that time integration has found."""

from __future__ import annotations

import numpy as np

from flexinv.kernels.so3 import log_so3
from flexinv.kinematics.configuration_arrays import exp_quaternion
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.joint_kinds import CONTINUOUS, FREE, SPHERICAL
from flexinv.typing import Array


def fill_passive(mesh: Mesh, motion: NodalMotion, passive: set[str], q: Array, qd: Array, qdd: Array) -> None:
    """Write the coordinates of the passive joints into q (samples, nq), qd, qdd (samples, nv) [rad or m, s].

    R_j = R_A^T R_B, w_j = w_B - R_j^T w_A, al_j = al_B - R_j^T al_A - (R_j^T w_A) x w_j, and likewise for p = R_A^T (x_B - x_A).
    """
    for joint in mesh.mechanism.joints:
        if joint.name in passive:
            span = mesh.mechanism.v_slices[joint.name]
            for node in np.flatnonzero((mesh.v_index >= span.start) & (mesh.v_index < span.stop)):
                _fill(mesh, motion, int(node), q, qd, qdd)


def _fill(mesh: Mesh, motion: NodalMotion, node: int, q: Array, qd: Array, qdd: Array) -> None:
    kind, axis = int(mesh.kind[node]), mesh.axis[node]
    nq, nv = mesh.q_index[node], mesh.v_index[node]
    p, dp, ddp, turn, rate, acceleration = _relative(mesh, motion, node)
    if kind == SPHERICAL:
        q[:, nq : nq + 4], qd[:, nv : nv + 3], qdd[:, nv : nv + 3] = (
            _quaternion(turn, q[0, nq : nq + 4]),
            rate,
            acceleration,
        )
    elif kind == FREE:
        v = np.einsum("sji,sj->si", turn, dp)  # (sample, xyz), child's frame
        dv = np.einsum("sji,sj->si", turn, ddp) - np.cross(rate, v)
        q[:, nq : nq + 7] = np.hstack([p, _quaternion(turn, q[0, nq + 3 : nq + 7])])
        qd[:, nv : nv + 6], qdd[:, nv : nv + 6] = np.hstack([v, rate]), np.hstack([dv, acceleration])
    elif not mesh.turn[node].any():
        q[:, nq], qd[:, nv], qdd[:, nv] = p @ axis, dp @ axis, ddp @ axis
    else:
        angle = np.unwrap(log_so3(turn) @ axis)
        if kind == CONTINUOUS:
            q[:, nq], q[:, nq + 1] = np.cos(angle), np.sin(angle)
        else:
            q[:, nq] = angle + 2 * np.pi * np.round((q[0, nq] - angle[0]) / (2 * np.pi))
        qd[:, nv], qdd[:, nv] = rate @ axis, acceleration @ axis


def _relative(mesh: Mesh, motion: NodalMotion, node: int) -> tuple[Array, ...]:
    """Joint motion of one node in the joint frame: p, p', p'' and R_j, with rates in the node's frame."""
    placed, offset, parent = mesh.rotation[node], mesh.offset[node], mesh.parent[node]
    x, r = motion.x[:, node], motion.rotation[:, node]
    v, w, a, al = motion.v[:, node], motion.omega[:, node], motion.a[:, node], motion.alpha[:, node]
    if parent < 0:
        return (x - offset) @ placed, v @ placed, a @ placed, placed.T @ r, w, al
    rm, wm, alm = motion.rotation[:, parent], motion.omega[:, parent], motion.alpha[:, parent]

    def back(vector: Array) -> Array:
        return np.asarray(np.einsum("sji,sj->si", rm, vector))  # (sample, xyz), parent's frame

    p = back(x - motion.x[:, parent])
    dp = back(v - motion.v[:, parent]) - np.cross(wm, p)
    ddp = back(a - motion.a[:, parent]) - np.cross(alm, p) - np.cross(wm, np.cross(wm, p)) - 2 * np.cross(wm, dp)
    whole = np.einsum("sji,sjk->sik", rm, r)  # R_A,B with the placement
    carried = np.einsum("sji,sj->si", whole, wm)
    rate = w - carried
    acceleration = al - np.einsum("sji,sj->si", whole, alm) - np.cross(carried, rate)
    return (p - offset) @ placed, dp @ placed, ddp @ placed, placed.T @ whole, rate, acceleration


def _quaternion(turn: Array, first: Array) -> Array:
    """Unit quaternions x, y, z, w (samples, 4), without sign jumps from the ``first`` on along the samples."""
    out = exp_quaternion(log_so3(turn))
    before = np.concatenate([first[None], out[:-1]])
    same = np.where(np.sum(out * before, axis=1) < 0, -1.0, 1.0)
    return np.asarray(out * np.cumprod(same)[:, None])
