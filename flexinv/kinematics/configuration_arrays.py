"""Steps in configuration space: q moved along a velocity, joint by joint (quaternions and (cos, sin) stay of unit length)."""

from __future__ import annotations

from collections.abc import Iterator
from math import perm

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.memory import plain
from flexinv.kernels.so3 import from_quaternion, log_so3
from flexinv.kinematics.configuration import nodes_of, step_array
from flexinv.kinematics.mesh import build
from flexinv.model.joint_kinds import CIRCLE, KINDS, POSE, ROTATION
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
    ends = [
        np.zeros_like(step),
        duration * first[1],
        duration**2 * first[2],
        step,
        duration * last[1],
        duration**2 * last[2],
    ]
    at_ends = [[(0.0 if k < n else perm(k, n) * s ** (k - n)) for k in range(6)] for s in (0.0, 1.0) for n in range(3)]
    factors = np.linalg.solve(np.array(at_ends), np.stack(ends))  # (power, coordinate)
    for part in range(1, parts):
        s = part / parts
        value, rate, change = (
            np.array([(0.0 if k < n else perm(k, n) * s ** (k - n)) for k in range(6)]) @ factors for n in range(3)
        )
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


def exp_quaternion(psi: Array) -> Array:
    """Return the unit quaternions x, y, z, w, (..., 4) [-], of rotation vectors (..., 3) [rad]."""
    angle = np.linalg.norm(psi, axis=-1, keepdims=True)
    return np.concatenate([0.5 * np.sinc(angle / (2 * np.pi)) * psi, np.cos(0.5 * angle)], axis=-1)


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
