"""Rotations: exponential, logarithm and their tangents, for one vector (compiled) and for arrays of them.

``R = exp_so3(psi)`` turns by ``|psi|`` about ``psi``.  The *right* tangent ``H`` maps a change of the rotation vector
to the body-frame increment, ``R^T dR = skew(H(psi) dpsi)``:

    H(psi) = I - (1 - cos t)/t^2 skew(psi) + (t - sin t)/t^3 skew(psi)^2,      t = |psi|

The compiled functions work on single vectors as tuples (`vec3`); those for arrays map them over leading axes.
Source: Bruels, Cardona, Arnold, *Lie group generalized-alpha time integration*, 2012, appendix A.
"""

from __future__ import annotations

from math import factorial

import numpy as np

from flexinv.kernels.jit import jit, jit_vector
from flexinv.kernels.vec3 import dot, mat, put, put_mat, vec
from flexinv.typing import Array

# Power series in s = t^2: A = sum (-s)^k / (2k+2)!, B = sum (-s)^k / (2k+3)!, c = sum |B_2k| s^(k-1) / (2k)!.
# They replace the closed forms for small angles, where the second derivatives would cancel to nothing.  At the
# limits below the first neglected term and the cancellation of the closed form are both under 1e-13 relative.
_A = np.array([(-1.0) ** k / factorial(2 * k + 2) for k in range(12)])
_B = np.array([(-1.0) ** k / factorial(2 * k + 3) for k in range(12)])
_BERNOULLI = (1 / 6, 1 / 30, 1 / 42, 1 / 30, 5 / 66, 691 / 2730, 7 / 6, 3617 / 510, 43867 / 798, 174611 / 330)
_C = np.array([b / factorial(2 * k + 2) for k, b in enumerate(_BERNOULLI)])
SERIES_LIMIT = 4.0  # [rad^2] for A and B
INVERSE_SERIES_LIMIT = 1.0  # [rad^2] for c, whose series converges for s < 4 pi^2 only


@jit_vector
def _series(c, s):
    """Value, first and second derivative of sum c_k s^k (Horner)."""
    value = first = second = 0.0
    for k in range(len(c) - 1, -1, -1):
        second = second * s + 2 * first
        first = first * s + value
        value = value * s + c[k]
    return value, first, second


@jit
def coefficients(s):
    """Return A = (1 - cos t)/t^2 and B = (t - sin t)/t^3 with first and second derivatives in s = t^2 [rad^2]."""
    if s < SERIES_LIMIT:
        a, a1, a2 = _series(_A, s)
        b, b1, b2 = _series(_B, s)
        return a, a1, a2, b, b1, b2
    t = np.sqrt(s)
    sin_t = np.sin(t)
    cos_t = np.cos(t)
    a = (1 - cos_t) / s
    a1 = (sin_t / (2 * t) - a) / s
    a2 = ((t * cos_t - sin_t) / (4 * t * s) - 2 * a1) / s
    b = (1 - sin_t / t) / s
    b1 = ((sin_t - t * cos_t) / (2 * t * s) - b) / s
    b2 = ((t * t * sin_t + 3 * t * cos_t - 3 * sin_t) / (4 * t * s * s) - 2 * b1) / s
    return a, a1, a2, b, b1, b2


@jit
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


@jit_vector
def quadratic(psi, k0, k1, k2):
    """Return k0 I + k1 skew(psi) + k2 psi psi^T, as all maps of this module are [any unit]."""
    x, y, z = psi
    return (
        (k0 + k2 * x * x, k2 * x * y - k1 * z, k2 * x * z + k1 * y),
        (k2 * x * y + k1 * z, k0 + k2 * y * y, k2 * y * z - k1 * x),
        (k2 * x * z - k1 * y, k2 * y * z + k1 * x, k0 + k2 * z * z),
    )


@jit_vector
def exp_with(psi, q):
    """Return the rotation matrix exp(psi) = I + sin t / t skew + A skew^2 [-] from the coefficients q at psi [rad]."""
    a, _, _, b, _, _ = q
    s = dot(psi, psi)
    return quadratic(psi, 1 - a * s, 1 - b * s, a)


@jit_vector
def tangent_with(psi, q):
    """Return H(psi) = I - A skew + B skew^2 [-] from the coefficients q at psi [rad]: body increment = H dpsi."""
    a, _, _, b, _, _ = q
    return quadratic(psi, 1 - b * dot(psi, psi), -a, b)


@jit_vector
def exp(psi):
    """Return the rotation matrix of a rotation vector [rad]."""
    return exp_with(psi, coefficients(dot(psi, psi)))


@jit_vector
def inverse_tangent(psi):
    """Return H(psi)^-1 = I + skew/2 + c skew^2 [-], |psi| < 2 pi."""
    s = dot(psi, psi)
    c, _ = inverse_coefficient(s)
    return quadratic(psi, 1 - c * s, 0.5, c)


@jit_vector
def log(r):
    """Return the rotation vector [rad] of a rotation matrix, |psi| <= pi, by way of the quaternion (x, y, z), w.

    The largest component is taken from the diagonal, so that nothing small is divided by.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = r
    trace = xx + yy + zz
    if trace >= max(xx, yy, zz):
        x = zy - yz
        y = xz - zx
        z = yx - xy
        w = 1 + trace
    elif xx >= max(yy, zz):
        x = 1 + xx - yy - zz
        y = yx + xy
        z = zx + xz
        w = zy - yz
    elif yy >= zz:
        x = xy + yx
        y = 1 + yy - zz - xx
        z = zy + yz
        w = xz - zx
    else:
        x = xz + zx
        y = yz + zy
        z = 1 + zz - xx - yy
        w = yx - xy
    sine = np.sqrt(x * x + y * y + z * z)
    if sine == 0.0:
        return 0.0, 0.0, 0.0
    side = 1.0 if w >= 0 else -1.0  # of q and -q the one that turns by at most pi
    factor = side * 2 * np.arctan2(sine, side * w) / sine
    return factor * x, factor * y, factor * z


@jit
def _exp_many(psi, out):
    for i in range(psi.shape[0]):
        put_mat(out[i], exp(vec(psi[i])))


@jit
def _log_many(r, out):
    for i in range(r.shape[0]):
        put(out[i], log(mat(r[i])))


def exp_so3(psi: Array) -> Array:
    """Return rotation matrices (..., 3, 3) [-] of rotation vectors ``psi`` (..., 3) [rad]."""
    psi = np.array(psi, dtype=float, order="C")
    out = np.empty((*psi.shape, 3))
    _exp_many(psi.reshape(-1, 3), out.reshape(-1, 3, 3))
    return out


def log_so3(rotation: Array) -> Array:
    """Return rotation vectors (..., 3) [rad], at most pi long, of rotation matrices (..., 3, 3)."""
    rotation = np.array(rotation, dtype=float, order="C")
    out = np.empty(rotation.shape[:-1])
    _log_many(rotation.reshape(-1, 3, 3), out.reshape(-1, 3))
    return out


def tangent3(psi: Array) -> Array:
    """Return H(psi), (3, 3) [-], of one rotation vector (3,) [rad]: body increment = H dpsi."""
    a, _, _, b, _, _ = coefficients(float(psi @ psi))
    skew = np.cross(np.eye(3), psi)
    return np.asarray(np.eye(3) - a * skew + b * skew @ skew)


def find_vectors_across(axis: Array) -> tuple[Array, Array]:
    """Return two unit vectors (3,) [-] that make a right-handed frame with a unit ``axis`` (3,), which is its last."""
    across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    across /= np.linalg.norm(across)
    return across, np.cross(axis, across)


def from_quaternion(q: Array) -> Array:
    """Return rotation matrices (..., 3, 3) [-] of unit quaternions (..., 4), order x, y, z, w.

    R = I + 2 w skew(u) + 2 skew(u)^2 with the quaternion normalised first.
    """
    q = np.asarray(q, dtype=float)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    skew = np.cross(np.eye(3), q[..., None, :3])  # (..., row, column)
    return np.eye(3) + 2.0 * (q[..., 3, None, None] * skew + skew @ skew)
