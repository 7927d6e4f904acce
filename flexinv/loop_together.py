"""Closed loops, one sample a lane: rows of G whose entries stand side by side, combined in one pass (`loop_rows`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexinv.compiled import jit_lane, jit_lanes
from flexinv.lanes import LANES, row
from flexinv.loop_layout import CHANGED, FACTOR

# Where other entries stand side by side before the pivot's, so many at most: steps TOGETHER + how many there are - 1.
MOST_TOGETHER, TOGETHER = 4, 10


@jit_lane
def larger(a, b):
    """Return the larger of two entries, the factor [-] by which the smaller one goes, and whether the rows change places."""
    changed = abs(b) > abs(a)
    pivot, rest = (b, a) if changed else (a, b)
    return pivot, rest / pivot if pivot != 0.0 else 0.0, changed


@jit_lane
def combined(a, b, factor, changed):
    """Return another entry of both rows [any unit]."""
    upper, lower = (b, a) if changed else (a, b)
    return upper, lower - factor * upper


def _pairing(count: int) -> Any:
    """Both, of so many other entries before those in the pivot's column; loops over a constant are taken apart."""
    last = row(count)

    @jit_lane
    def lane(factor, one, other, k):
        one[last + k], part, changed = larger(one[last + k], other[last + k])
        factor[FACTOR + k], factor[CHANGED + k] = part, 1.0 if changed else 0.0
        for j in range(count):
            at = np.uint64(j) * LANES + k
            upper, other[at] = combined(one[at], other[at], part, changed)
            one[at] = (
                upper + 0.0
            )  # as it is, the compiler writes only lanes that change: that takes several times as long

    @jit_lanes
    def pair(factor, one, other, lanes):
        for k in range(lanes):
            lane(factor, one, other, k)

    return pair


_PAIR_1, _PAIR_2, _PAIR_3, _PAIR_4 = (_pairing(count) for count in range(1, MOST_TOGETHER + 1))


@jit_lanes
def together(kind, factor, one, other, lanes):
    """Combine two rows in one pass [any unit]."""
    if kind == TOGETHER:
        _PAIR_1(factor, one, other, lanes)
    elif kind == TOGETHER + 1:
        _PAIR_2(factor, one, other, lanes)
    elif kind == TOGETHER + 2:
        _PAIR_3(factor, one, other, lanes)
    else:
        _PAIR_4(factor, one, other, lanes)
