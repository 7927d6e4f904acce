"""Steps in configuration space: q moved along a velocity, joint by joint (quaternions and (cos, sin) stay of unit length)."""

from __future__ import annotations

from collections.abc import Iterator
from math import perm

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import NDArray

from flexinv.kernels.memory import plain
from flexinv.kernels.so3 import from_quaternion, log_so3
from flexinv.kinematics.configuration import nodes_of, step_array
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.joint_kinds import CIRCLE, CONTINUOUS, FREE, KINDS, POSE, ROTATION, SPHERICAL
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.typing import Array


def moved(mechanism: Mechanism, q: Array, dv: Array) -> Array:
    """Return q (nq,) [rad], [m] after the increment ``dv`` (nv,) [rad], [m] of its velocity coordinates (body frame)."""
    out = np.array(q, dtype=float)
    step_array(nodes_of(build(mechanism)), out, plain(dv))
    return out


def difference(mechanism: Mechanism, q0: Array, q1: Array) -> Array:
    """Return the increment (nv,) [rad], [m] of the velocity coordinates from q0 (nq,) to q1: ``moved(m, q0, it)`` is q1."""
    out = np.zeros(mechanism.nv)
    for joint in mechanism.joints:
        own = mechanism.q_slices[joint.name]
        if joint.nv:
            out[mechanism.v_slices[joint.name]] = _difference_joint(joint, q0[own], q1[own])
    return out


def between(
    mechanism: Mechanism, first: list[Array], last: list[Array], duration: float, parts: int
) -> Iterator[tuple[Array, Array, Array]]:
    """Yield q (nq,), qd, qdd (nv,) [m, rad, s] at the ends of so many ``parts`` of the ``duration`` [s] between two instants.

    first, last : q, qd, qdd at its ends, which a polynomial of fifth degree in the increment of the coordinates meets; where a
        joint turns about an axis that changes, its rates are those of the coordinates up to the square of the increment
    """
    step = difference(mechanism, first[0], last[0])

    def powers(s: float, n: int) -> Array:
        """Derivatives of the powers of s."""
        return np.array([0.0 if k < n else perm(k, n) * s ** (k - n) for k in range(6)])

    places = (np.zeros_like(step), first), (step, last)
    ends = [part for place, (_, rate, change) in places for part in (place, duration * rate, duration**2 * change)]
    at_ends = [powers(s, n) for s in (0.0, 1.0) for n in range(3)]
    factors = np.linalg.solve(np.array(at_ends), np.stack(ends))  # (power, coordinate)
    for k in range(1, parts):
        value, rate, change = (powers(k / parts, n) @ factors for n in range(3))
        yield moved(mechanism, first[0], value), rate / duration, change / duration**2
    yield last[0], last[1], last[2]


def nearest_difference(mechanism: Mechanism, first: Array, last: Array) -> Array:
    """Return the increment (nv,) [rad], [m] as `difference` does, of angles within half a turn."""
    out = difference(mechanism, first, last)
    for joint in mechanism.joints:
        if KINDS[joint.kind].repeats and not KINDS[joint.kind].circle:
            own = mechanism.v_slices[joint.name]
            out[own] = (out[own] + np.pi) % (2 * np.pi) - np.pi
    return out


def slides(mechanism: Mechanism) -> NDArray[np.bool_]:
    """Return a mask (nv,) [-] of the velocity coordinates that are translations, not rotations."""
    return np.array([slide for joint in mechanism.joints for slide in KINDS[joint.kind].translations], dtype=bool)


def _difference_joint(joint: Joint, q0: Array, q1: Array) -> Array:
    layout = KINDS[joint.kind].layout
    if layout == CIRCLE:
        return np.array([np.arctan2(q0[0] * q1[1] - q0[1] * q1[0], q0 @ q1)])
    if layout == ROTATION:
        return log_so3(from_quaternion(q0).T @ from_quaternion(q1))
    if layout == POSE:
        turn = from_quaternion(q0[3:])
        return np.concatenate([turn.T @ (q1[:3] - q0[:3]), log_so3(turn.T @ from_quaternion(q1[3:]))])
    return np.asarray(q1 - q0)


def fill_passive(mesh: Mesh, motion: NodalMotion, passive: set[str], q: Array, qd: Array, qdd: Array) -> None:
    """Write the coordinates of the passive joints into q (samples, nq), qd, qdd (samples, nv) [rad or m, s].

    R_j = R_A^T R_B, w_j = w_B - R_j^T w_A, al_j = al_B - R_j^T al_A - (R_j^T w_A) x w_j, and likewise for p = R_A^T (x_B - x_A).
    """
    for name in passive & mesh.mechanism.joint_of.keys():
        span = mesh.mechanism.v_slices[name]
        for node in np.flatnonzero((mesh.v_index >= span.start) & (mesh.v_index < span.stop)):
            _fill(mesh, motion, int(node), q, qd, qdd)


def _fill(mesh: Mesh, motion: NodalMotion, node: int, q: Array, qd: Array, qdd: Array) -> None:
    kind, axis = int(mesh.kind[node]), mesh.axis[node]
    nq, nv = mesh.q_index[node], mesh.v_index[node]
    p, dp, ddp, turn, rate, acceleration = _relative(mesh, motion, node)
    if kind == SPHERICAL:
        q[:, nq : nq + 4] = _quaternion(turn, q[0, nq : nq + 4])
        qd[:, nv : nv + 3], qdd[:, nv : nv + 3] = rate, acceleration
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
    out = scipy.spatial.transform.Rotation.from_matrix(turn).as_quat()
    before = np.concatenate([first[None], out[:-1]])
    same = np.where(np.sum(out * before, axis=1) < 0, -1.0, 1.0)
    return np.asarray(out * np.cumprod(same)[:, None])
