"""Closed loops, one sample a lane: rows of G whose entries stand side by side, combined in one pass (`loop_allocation`).

Six forces along u_i at r_i hold the body, sum lambda_i (u_i, r_i x u_i) = tau: rows of G of six entries, side by side.  They are
combined pairwise; the row operations are then applied in reverse to the multipliers.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexinv.kernels.jit import jit_lane, jit_lanes
from flexinv.kernels.simd import LANES, row, vec_of
from flexinv.rnea import loop_layout as layout

# Added to what may be as it was: else the compiler writes only the lanes that change, which takes several times as long.
_NOTHING = 0.0


@jit_lane
def larger(a, b):
    """Return the larger of two entries, the factor [-] by which the smaller one goes, and whether the rows change places."""
    changed = abs(b) > abs(a)
    pivot, rest = (b, a) if changed else (a, b)
    return pivot, rest / pivot if pivot != 0.0 else 0.0, changed


@jit_lane
def _over(pivot):
    """1 / pivot, 0 where there is none."""
    return 1.0 / pivot if pivot != 0.0 else 0.0


@jit_lane
def combined(a, b, factor, changed):
    """Return another entry of both rows [any unit]."""
    upper, lower = (b, a) if changed else (a, b)
    return upper, lower - factor * upper


@jit_lane
def _exchanged(a, b, changed):
    return (b, a) if changed else (a, b)


def pairing(count: int) -> Any:
    """Return the kernel that combines two rows of so many entries [-] before that in the pivot's column.

    Loops over a constant are taken apart.
    """
    last = row(count)

    @jit_lane
    def lane(factor, one, other, k):
        changed = abs(other[last + k]) > abs(one[last + k])
        pivot, rest = _exchanged(one[last + k], other[last + k], changed)
        one[last + k], part = pivot + _NOTHING, rest * _over(pivot)
        factor[layout.FACTOR + k], factor[layout.CHANGED + k] = part, 1.0 if changed else 0.0
        for j in range(count):
            at = np.uint64(j) * LANES + k
            upper, other[at] = combined(one[at], other[at], part, changed)
            one[at] = upper + _NOTHING

    @jit_lanes
    def pair(factor, one, other, lanes):
        for k in range(lanes):
            lane(factor, one, other, k)

    return pair


together = layout.one_of_four(pairing, 1)


def joining(count: int) -> Any:
    """Return the kernel that does so with three rows [any unit]: the largest entry is the pivot."""
    last = row(count)

    @jit_lane
    def lane(one, other, third, k):
        first = abs(other[last + k]) > abs(one[last + k])
        a, b = _exchanged(one[last + k], other[last + k], first)
        second = abs(third[last + k]) > abs(a)
        a, c = _exchanged(a, third[last + k], second)
        part = _over(a)
        one[last + k], b, c = a + _NOTHING, b * part, c * part
        for j in range(count):
            at = np.uint64(j) * LANES + k
            upper, lower = _exchanged(one[at], other[at], first)
            upper, lowest = _exchanged(upper, third[at], second)
            one[at], other[at], third[at] = upper + _NOTHING, lower - b * upper, lowest - c * upper

    @jit_lanes
    def join(one, other, third, lanes):
        for k in range(lanes):
            lane(one, other, third, k)

    return join


both = layout.one_of_four(joining, 1)


@jit_lanes
def pair(factor, one, other, lanes):
    """Make the larger of two entries the pivot; keep the factor by which the smaller one goes, whether they change places [-]."""
    for k in range(lanes):
        a, b = one[k], other[k]
        changed = abs(b) > abs(a)
        pivot, rest = (b, a) if changed else (a, b)
        one[k] = pivot
        factor[layout.FACTOR + k] = rest / pivot if pivot != 0.0 else 0.0
        factor[layout.CHANGED + k] = 1.0 if changed else 0.0


@jit_lanes
def combine(factor, one, other, lanes):
    """Combine two other entries of these rows [any unit]."""
    for k in range(lanes):
        a, b = one[k], other[k]
        changed = factor[layout.CHANGED + k] != 0.0
        pivot, rest = (b, a) if changed else (a, b)
        one[k], other[k] = pivot, rest - factor[layout.FACTOR + k] * pivot


@jit_lanes
def undo(factor, one, other, lanes):
    """Turn multipliers [N] of two combined rows into those of the rows before."""
    for k in range(lanes):
        a, b = one[k] - factor[layout.FACTOR + k] * other[k], other[k]
        changed = factor[layout.CHANGED + k] != 0.0
        one[k], other[k] = (b, a) if changed else (a, b)


@jit_lanes
def solve_row(multiplier, pivot, effort, size, lanes, part, least):
    """Set one multiplier more [N], which leaves its coordinate no effort; return how many pivots are too small.

    Their squares are held against so large a ``part`` of their column's size, and against the ``least``.
    """
    count = 0
    for k in range(lanes):
        square = pivot[k] * pivot[k]
        multiplier[k] = effort[k] / pivot[k]
        effort[k] = 0.0
        count += 0 if (square >= part * size[k]) & (square >= least) else 1
    return count


# ---------------------------------------------------------------------------- a free body that six closures hold

SIX = 6
_ROWS = tuple(row(SIX * i) for i in range(SIX))
_ONE, _TWO, _THREE, _FOUR, _FIVE = (row(i) for i in range(1, SIX))


@jit_lane
def _six(rows, first, k):
    """Lane k of six rows."""
    a, b = vec_of(rows, first, k), vec_of(rows, first + _THREE, k)
    return a[0], a[1], a[2], b[0], b[1], b[2]


@jit_lane
def _pair_1(a, b):
    pivot, f, c = larger(a[1], b[1])
    u, x = combined(a[0], b[0], f, c)
    return (u, pivot), (x,), (f, c)


@jit_lane
def _pair_2(a, b):
    pivot, f, c = larger(a[2], b[2])
    (u, x), (v, y) = combined(a[0], b[0], f, c), combined(a[1], b[1], f, c)
    return (u, v, pivot), (x, y), (f, c)


@jit_lane
def _pair_3(a, b):
    pivot, f, c = larger(a[3], b[3])
    (u, x), (v, y), (w, z) = combined(a[0], b[0], f, c), combined(a[1], b[1], f, c), combined(a[2], b[2], f, c)
    return (u, v, w, pivot), (x, y, z), (f, c)


@jit_lane
def _pair_4(a, b):
    pivot, f, c = larger(a[4], b[4])
    (u, x), (v, y), (w, z) = combined(a[0], b[0], f, c), combined(a[1], b[1], f, c), combined(a[2], b[2], f, c)
    t, s = combined(a[3], b[3], f, c)
    return (u, v, w, t, pivot), (x, y, z, s), (f, c)


@jit_lane
def _pair_5(a, b):
    pivot, f, c = larger(a[5], b[5])
    (u, x), (v, y), (w, z) = combined(a[0], b[0], f, c), combined(a[1], b[1], f, c), combined(a[2], b[2], f, c)
    (t, s), (q, r) = combined(a[3], b[3], f, c), combined(a[4], b[4], f, c)
    return (u, v, w, t, q, pivot), (x, y, z, s, r), (f, c)


@jit_lane
def _undone(how, one, other):
    """Multipliers of two rows before they were combined."""
    factor, changed = how
    one -= factor * other
    return (other, one) if changed else (one, other)


@jit_lane
def _solved(a, b, c, d, e, f, tau):
    """The multipliers of six rows, and the pivots from the last column to the first."""
    a, b, ab = _pair_5(a, b)
    a, c, ac = _pair_5(a, c)
    a, d, ad = _pair_5(a, d)
    a, e, ae = _pair_5(a, e)
    a, f, af = _pair_5(a, f)
    b, c, bc = _pair_4(b, c)
    b, d, bd = _pair_4(b, d)
    b, e, be = _pair_4(b, e)
    b, f, bf = _pair_4(b, f)
    c, d, cd = _pair_3(c, d)
    c, e, ce = _pair_3(c, e)
    c, f, cf = _pair_3(c, f)
    d, e, de = _pair_2(d, e)
    d, f, df = _pair_2(d, f)
    e, f, ef = _pair_1(e, f)
    p = tau[5] / a[5]
    q = (tau[4] - p * a[4]) / b[4]
    r = (tau[3] - p * a[3] - q * b[3]) / c[3]
    s = (tau[2] - p * a[2] - q * b[2] - r * c[2]) / d[2]
    t = (tau[1] - p * a[1] - q * b[1] - r * c[1] - s * d[1]) / e[1]
    u = (tau[0] - p * a[0] - q * b[0] - r * c[0] - s * d[0] - t * e[0]) / f[0]
    pivots = f[0], e[1], d[2], c[3], b[4], a[5]
    t, u = _undone(ef, t, u)
    s, u = _undone(df, s, u)
    s, t = _undone(de, s, t)
    r, u = _undone(cf, r, u)
    r, t = _undone(ce, r, t)
    r, s = _undone(cd, r, s)
    q, u = _undone(bf, q, u)
    q, t = _undone(be, q, t)
    q, s = _undone(bd, q, s)
    q, r = _undone(bc, q, r)
    p, u = _undone(af, p, u)
    p, t = _undone(ae, p, t)
    p, s = _undone(ad, p, s)
    p, r = _undone(ac, p, r)
    p, q = _undone(ab, p, q)
    return (p, q, r, s, t, u), pivots


@jit_lane
def _put(rows, k, v):
    """Write lane k of six rows."""
    rows[k], rows[_ONE + k], rows[_TWO + k] = v[0], v[1], v[2]
    rows[_THREE + k], rows[_FOUR + k], rows[_FIVE + k] = v[3], v[4], v[5]


@jit_lane
def _at_least(v, least):
    """Return True if no pivot is smaller than ``least``; False for a NaN."""
    first = (abs(v[0]) >= least[0]) & (abs(v[1]) >= least[1]) & (abs(v[2]) >= least[2])
    return first & (abs(v[3]) >= least[3]) & (abs(v[4]) >= least[4]) & (abs(v[5]) >= least[5])


@jit_lanes
def six_forces(multipliers, efforts, entries, lanes, least):
    """Set the multipliers [N] of six rows, which leave no efforts; return how often a pivot is below its ``least``."""
    doubts = 0
    for k in range(lanes):
        a, b, c = _six(entries, _ROWS[0], k), _six(entries, _ROWS[1], k), _six(entries, _ROWS[2], k)
        d, e, f = _six(entries, _ROWS[3], k), _six(entries, _ROWS[4], k), _six(entries, _ROWS[5], k)
        found, pivots = _solved(a, b, c, d, e, f, _six(efforts, _ROWS[0], k))
        _put(multipliers, k, found)
        _put(efforts, k, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        doubts += 0 if _at_least(pivots, least) else 1
    return doubts
