"""Lanes: one sample is one lane.  A quantity of ``LANES`` samples is a *row* of an array, a vector three rows.

Loops over the lanes are what the compiler turns into SIMD instructions: they have no branches, and rows are addressed by
unsigned offsets that are constants (signed ones would wrap around, unknown ones might overlap).  Products and sums fuse
(``contract``); nothing else of fast mathematics is allowed, so that NaN stays NaN and the reduction of angles keeps its digits.
"""

from __future__ import annotations

import numpy as np

from flexinv.kernels import vec3
from flexinv.kernels.jit import jit_lanes, jit_vector

# Samples of a block, which stays in the cache from its coordinates to its torques.  Rows of 17 lines of it, no power of two:
# those of 16 share four sets of the cache, and a single sample, which has one line of each row, takes up to 1.6 times as long.
BLOCK = 136
LANES = np.uint64(BLOCK)
_TWO = np.uint64(2 * BLOCK)


def row(index: int) -> np.uint64:
    """Return the offset of row number ``index`` [-]."""
    return np.uint64(index * BLOCK)


@jit_lanes
def vec_of(rows, first, k):
    """Return lane k of three rows from offset ``first`` on [any unit]."""
    return rows[first + k], rows[first + LANES + k], rows[first + _TWO + k]


@jit_lanes
def put_vec(rows, first, k, v):
    """Write a vector into lane k of three rows [any unit]."""
    rows[first + k] = v[0]
    rows[first + LANES + k] = v[1]
    rows[first + _TWO + k] = v[2]


# a + b, a - b, k v, a . b, a x b, and m^T v: the components of a vector of the parent in the child's frame, m = R_parent,child.
plus, minus, times, dot, cross, into = (
    jit_lanes(getattr(one, "py_func", one))
    for one in (vec3.add, vec3.sub, vec3.scale, vec3.dot, vec3.cross, vec3.tapply)
)


@jit_lanes
def plus_cross(a, u, v):
    """Return a + u x v [any unit]."""
    return a[0] + u[1] * v[2] - u[2] * v[1], a[1] + u[2] * v[0] - u[0] * v[2], a[2] + u[0] * v[1] - u[1] * v[0]


@jit_lanes
def plus_out_of(a, m, v):
    """Return a + m v: a vector of the child added to one of the parent, m = R_parent,child [any unit]."""
    return (
        a[0] + m[0][0] * v[0] + m[0][1] * v[1] + m[0][2] * v[2],
        a[1] + m[1][0] * v[0] + m[1][1] * v[1] + m[1][2] * v[2],
        a[2] + m[2][0] * v[0] + m[2][1] * v[1] + m[2][2] * v[2],
    )


@jit_lanes
def apply_rotation_z(c, s, v):
    """Return R_z v of a turn about z with cosine c and sine s [any unit]; with -s back, R_z^T v."""
    return c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]


@jit_lanes
def apply_rotation_x(c, s, v):
    """Return R_x v of a turn about x with cosine c and sine s [any unit]; with -s back, R_x^T v."""
    return v[0], c * v[1] - s * v[2], s * v[1] + c * v[2]


# pi/2 in three parts, the first two of 33 bits: their products with a number of quarter turns below 2^20 are exact.
_QUARTER = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
_PER_QUARTER = 6.36619772367581382433e-01
FAR_ANGLE = 1e6  # [rad], below 2^20 quarter turns: beyond it the library's own sine and cosine take over
# Sine and cosine on -pi/4 .. pi/4: sin r = r + r^3 S(r^2), cos r = 1 - r^2/2 + r^4 C(r^2), errors below 2^-58.
# Source: fdlibm, k_sin.c, k_cos.c, e_rem_pio2.c (Sun Microsystems, 1993).
_S = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
_C = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip


@jit_lanes
def cos_sin(angle):
    """Return cosine and sine [-] of an angle [rad] of at most ``FAR_ANGLE``, each to 2.2e-16, without branches."""
    n = np.rint(angle * _PER_QUARTER)
    r = ((angle - n * _QUARTER[0]) - n * _QUARTER[1]) - n * _QUARTER[2]
    z = r * r
    sine = r + r * z * (_S[0] + z * (_S[1] + z * (_S[2] + z * (_S[3] + z * (_S[4] + z * _S[5])))))
    half = 0.5 * z
    most = 1.0 - half
    rest = z * z * (_C[0] + z * (_C[1] + z * (_C[2] + z * (_C[3] + z * (_C[4] + z * _C[5])))))
    cosine = most + (((1.0 - most) - half) + rest)
    quarter = np.int32(n)
    odd = (quarter & 1) != 0
    c = sine if odd else cosine
    s = cosine if odd else sine
    return -c if ((quarter + 1) & 2) != 0 else c, -s if (quarter & 2) != 0 else s


# The same for marches, without fused products, which not every processor has: all round the steps alike.  (A last digit of a turn
# is one of a beam's length, which over many steps makes 5e-9 of the largest torque of a crank that drives a steel strip.)
cos_sin_unfused = jit_vector(getattr(cos_sin, "py_func", cos_sin))

ASTRAY = 1e-5  # how far the squares of a cosine and a sine may be from 1: as those of six digits, of single precision


@jit_lanes
def count_non_unit_lanes(rows, first, lanes):
    """Return the number of lanes in which two rows [-] are not the cosine and sine of one angle."""
    count = 0
    for k in range(lanes):
        c = rows[first + k]
        s = rows[first + LANES + k]
        count += 0 if abs(c * c + s * s - 1.0) <= ASTRAY else 1
    return count
