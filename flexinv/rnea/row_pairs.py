"""Closed loops, one sample a lane: rows of G whose entries stand side by side, combined in one pass (`loop_allocation`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexinv.kernels.jit import jit_lane, jit_lanes
from flexinv.kernels.simd import LANES, row
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


def _pairing(count: int) -> Any:
    """Both, of so many other entries before those in the pivot's column; loops over a constant are taken apart."""
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


_PAIR_1, _PAIR_2, _PAIR_3, _PAIR_4 = (_pairing(count) for count in range(1, layout.MOST_TOGETHER + 1))


def _joining(count: int) -> Any:
    """The same of three rows: the largest entry is the pivot."""
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


_JOIN_1, _JOIN_2, _JOIN_3, _JOIN_4 = (_joining(count) for count in range(1, layout.MOST_TOGETHER + 1))


@jit_lanes
def both(kind, one, other, third, lanes):
    """Combine two rows with the first one in one pass [any unit]."""
    if kind == layout.BOTH:
        _JOIN_1(one, other, third, lanes)
    elif kind == layout.BOTH + 1:
        _JOIN_2(one, other, third, lanes)
    elif kind == layout.BOTH + 2:
        _JOIN_3(one, other, third, lanes)
    else:
        _JOIN_4(one, other, third, lanes)


@jit_lanes
def together(kind, factor, one, other, lanes):
    """Combine two rows in one pass [any unit]."""
    if kind == layout.TOGETHER:
        _PAIR_1(factor, one, other, lanes)
    elif kind == layout.TOGETHER + 1:
        _PAIR_2(factor, one, other, lanes)
    elif kind == layout.TOGETHER + 2:
        _PAIR_3(factor, one, other, lanes)
    else:
        _PAIR_4(factor, one, other, lanes)


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
