"""Rotations: exponential, logarithm and their tangents, for one vector (compiled) and for arrays of them.

``R = exp_so3(psi)`` turns by ``|psi|`` about ``psi``.  The *right* tangent ``H`` maps a change of the rotation vector
to the body-frame increment, ``R^T dR = skew(H(psi) dpsi)``:

    H(psi) = I - (1 - cos t)/t^2 skew(psi) + (t - sin t)/t^3 skew(psi)^2,      t = |psi|

Small functions work on single ``(3,)`` vectors and are compiled; the public ones map them over leading axes.
Source: Bruels, Cardona, Arnold, *Lie group generalized-alpha time integration*, 2012, appendix A.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numba import njit
from numpy.typing import NDArray

from flexinv.vectors import skew3

Array = NDArray[np.float64]

# Power series in s = t^2: A = sum (-s)^k / (2k+2)!, B = sum (-s)^k / (2k+3)!, c = sum |B_2k| s^(k-1) / (2k)!.
# They replace the closed forms for small angles, where the second derivatives would cancel to nothing.  At the
# limits below the first neglected term and the cancellation of the closed form are both under 1e-13 relative.
_A = np.array([(-1.0) ** k / factorial(2 * k + 2) for k in range(12)])
_B = np.array([(-1.0) ** k / factorial(2 * k + 3) for k in range(12)])
_BERNOULLI = (1 / 6, 1 / 30, 1 / 42, 1 / 30, 5 / 66, 691 / 2730, 7 / 6, 3617 / 510, 43867 / 798, 174611 / 330)
_C = np.array([b / factorial(2 * k + 2) for k, b in enumerate(_BERNOULLI)])
SERIES_LIMIT = 1.0  # [rad^2] for A and B
INVERSE_SERIES_LIMIT = 0.25  # [rad^2] for c


@njit(cache=True)
def _series(c, s):
    """Value, first and second derivative of sum c_k s^k (Horner)."""
    value = first = second = 0.0
    for k in range(len(c) - 1, -1, -1):
        second = second * s + 2 * first
        first = first * s + value
        value = value * s + c[k]
    return value, first, second


@njit(cache=True)
def coefficients(s):
    """Return A = (1 - cos t)/t^2 and B = (t - sin t)/t^3 with first and second derivatives in s = t^2 [rad^2]."""
    if s < SERIES_LIMIT:
        a, a1, a2 = _series(_A, s)
        b, b1, b2 = _series(_B, s)
        return a, a1, a2, b, b1, b2
    t = np.sqrt(s)
    sin_t, cos_t = np.sin(t), np.cos(t)
    a = (1 - cos_t) / s
    a1 = (sin_t / (2 * t) - a) / s
    a2 = ((t * cos_t - sin_t) / (4 * t * s) - 2 * a1) / s
    b = (1 - sin_t / t) / s
    b1 = ((sin_t - t * cos_t) / (2 * t * s) - b) / s
    b2 = ((t * t * sin_t + 3 * t * cos_t - 3 * sin_t) / (4 * t * s * s) - 2 * b1) / s
    return a, a1, a2, b, b1, b2


@njit(cache=True)
def exp3(psi):
    """Return the (3, 3) rotation matrix of one rotation vector [rad]."""
    s = psi[0] * psi[0] + psi[1] * psi[1] + psi[2] * psi[2]
    a, _, _, b, _, _ = coefficients(s)
    k = 1 - s * b  # sin t / t
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = a * psi[i] * psi[j]
        out[i, i] += 1 - a * s
    out[0, 1] -= k * psi[2]
    out[1, 0] += k * psi[2]
    out[0, 2] += k * psi[1]
    out[2, 0] -= k * psi[1]
    out[1, 2] -= k * psi[0]
    out[2, 1] += k * psi[0]
    return out


@njit(cache=True)
def log3(r):
    """Return the rotation vector (3,) [rad] of one rotation matrix, |psi| <= pi, by way of the unit quaternion."""
    q = np.empty(4)  # x, y, z, w; the largest component first, so that nothing small is divided by
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    big = 3
    best = trace
    for i in range(3):
        if r[i, i] > best:
            best = r[i, i]
            big = i
    if big == 3:
        q[3] = 1 + trace
        q[0] = r[2, 1] - r[1, 2]
        q[1] = r[0, 2] - r[2, 0]
        q[2] = r[1, 0] - r[0, 1]
    else:
        i, j, k = big, (big + 1) % 3, (big + 2) % 3
        q[i] = 1 - trace + 2 * r[i, i]
        q[j] = r[j, i] + r[i, j]
        q[k] = r[k, i] + r[i, k]
        q[3] = r[k, j] - r[j, k]
    sine = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    if q[3] < 0:
        q = -q
    if sine == 0.0:
        return np.zeros(3)
    angle = 2 * np.arctan2(sine, q[3])
    return angle / sine * q[:3]


@njit(cache=True)
def tangent3(psi):
    """Return H(psi), (3, 3) [-]: body increment = H dpsi."""
    s = psi[0] * psi[0] + psi[1] * psi[1] + psi[2] * psi[2]
    a, _, _, b, _, _ = coefficients(s)
    k = skew3(psi)
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = -a * k[i, j] + b * psi[i] * psi[j]
        out[i, i] += 1 - b * s
    return out


@njit(cache=True)
def inverse_coefficient(s):
    """Return c = 1/t^2 - (1 + cos t)/(2 t sin t) and dc/ds, s = t^2 [rad^2]: H^-1 = I + skew/2 + c skew^2."""
    if s < INVERSE_SERIES_LIMIT:
        c, c1, _ = _series(_C, s)
        return c, c1
    t = np.sqrt(s)
    half = 0.5 * t
    cot = half / np.tan(half)
    c = (1 - cot) / s
    dcot_dt = cot / t - (half / np.sin(half)) ** 2 / t
    return c, (-dcot_dt / (2 * t) - c) / s


@njit(cache=True)
def inverse_tangent3(psi):
    """Return H(psi)^-1, (3, 3) [-], |psi| < 2 pi."""
    s = psi[0] * psi[0] + psi[1] * psi[1] + psi[2] * psi[2]
    c, _ = inverse_coefficient(s)
    k = skew3(psi)
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = 0.5 * k[i, j] + c * psi[i] * psi[j]
        out[i, i] += 1 - c * s
    return out


@njit(cache=True)
def _exp_many(psi):
    out = np.empty((psi.shape[0], 3, 3))
    for i in range(psi.shape[0]):
        out[i] = exp3(psi[i])
    return out


@njit(cache=True)
def _log_many(r):
    out = np.empty((r.shape[0], 3))
    for i in range(r.shape[0]):
        out[i] = log3(r[i])
    return out


def exp_so3(psi: Array) -> Array:
    """Return rotation matrices (..., 3, 3) [-] of rotation vectors ``psi`` (..., 3) [rad]."""
    psi = np.ascontiguousarray(psi, dtype=float)
    return np.asarray(_exp_many(psi.reshape(-1, 3))).reshape((*psi.shape, 3))


def log_so3(rotation: Array) -> Array:
    """Return rotation vectors (..., 3) [rad], at most pi long, of rotation matrices (..., 3, 3)."""
    rotation = np.ascontiguousarray(rotation, dtype=float)
    return np.asarray(_log_many(rotation.reshape(-1, 3, 3))).reshape(rotation.shape[:-1])


def from_quaternion(q: Array) -> Array:
    """Return rotation matrices (..., 3, 3) [-] of unit quaternions (..., 4), order x, y, z, w.

    R = I + 2 w skew(u) + 2 skew(u)^2 with the quaternion normalised first.
    """
    q = np.asarray(q, dtype=float)
    x, y, z, w = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)  # (..., row, column)


def about_axis(axis: Array, angle: Array) -> Array:
    """Return rotation matrices (samples, 3, 3) [-] about one unit ``axis`` (3,) by ``angle`` (samples,) [rad].

    R = cos a I + sin a skew(axis) + (1 - cos a) axis axis^T
    """
    return about_axis_cs(axis, np.cos(angle), np.sin(angle))


def about_axis_cs(axis: Array, cosine: Array, sine: Array) -> Array:
    """Return rotation matrices (samples, 3, 3) [-] about a unit ``axis`` from cosine and sine (samples,) [-]."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    c = np.asarray(cosine)[..., None, None]
    s = np.asarray(sine)[..., None, None]
    return c * np.eye(3) + s * k + (1 - c) * np.outer(axis, axis)
