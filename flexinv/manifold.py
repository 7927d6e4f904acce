"""Steps in configuration space: q moved along a velocity, joint by joint (quaternions and (cos, sin) stay of unit length)."""

from __future__ import annotations

import numpy as np

from flexinv.mechanism import Array, Joint, Mechanism
from flexinv.rotations import from_quaternion


def moved(mechanism: Mechanism, q: Array, dv: Array) -> Array:
    """Return q (nq,) [rad], [m] after the increment ``dv`` (nv,) [rad], [m] of its velocity coordinates (body frame)."""
    out = q.copy()
    for joint in mechanism.joints:
        own, d = q[mechanism.q_slices[joint.name]], dv[mechanism.v_slices[joint.name]]
        if joint.nv and d.any():
            out[mechanism.q_slices[joint.name]] = _moved_joint(joint, own, d)
    return out


def exp_quaternion(psi: Array) -> Array:
    """Return the unit quaternions x, y, z, w, (..., 4) [-], of rotation vectors (..., 3) [rad]."""
    angle = np.linalg.norm(psi, axis=-1, keepdims=True)
    return np.concatenate([0.5 * np.sinc(angle / (2 * np.pi)) * psi, np.cos(0.5 * angle)], axis=-1)


def _moved_joint(joint: Joint, q: Array, d: Array) -> Array:
    if joint.kind == "continuous":
        c, s = np.cos(d[0]), np.sin(d[0])
        turned = np.array([q[0] * c - q[1] * s, q[0] * s + q[1] * c])
        return np.asarray(turned / np.hypot(*turned))
    if joint.kind == "spherical":
        return _turned(q, d)
    if joint.kind == "free":
        return np.concatenate([q[:3] + from_quaternion(q[3:]) @ d[:3], _turned(q[3:], d[3:])])
    return np.asarray(q + d)


def _turned(q: Array, d: Array) -> Array:
    """Quaternion product q * exp(d/2): the rotation R(q) exp(d)."""
    step = exp_quaternion(d)
    vector, scalar, own, real = step[:3], step[3], q[:3], q[3]
    product = real * vector + scalar * own + np.cross(own, vector)
    out = np.append(product, real * scalar - own @ vector)
    return np.asarray(out / np.linalg.norm(out))
