"""Closed loops, one sample a lane: rows of G whose entries stand side by side, combined in one pass (`loop_rows`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexinv.compiled import jit_lanes
from flexinv.lanes import LANES, row
from flexinv.loop_layout import CHANGED, FACTOR

# Where other entries stand side by side before the pivot's, so many at most: steps TOGETHER + how many there are - 1.
MOST_TOGETHER, TOGETHER = 4, 10


def _pairing(count: int) -> Any:
    """Both, of so many other entries before those in the pivot's column; loops over a constant are taken apart."""
    last = row(count)

    @jit_lanes
    def pair(factor, one, other, lanes):
        for k in range(lanes):
            a, b = one[last + k], other[last + k]
            changed = abs(b) > abs(a)
            pivot, rest = (b, a) if changed else (a, b)
            part = rest / pivot if pivot != 0.0 else 0.0
            one[last + k] = pivot
            factor[FACTOR + k] = part
            factor[CHANGED + k] = 1.0 if changed else 0.0
            for j in range(count):
                at = np.uint64(j) * LANES + k
                a, b = one[at], other[at]
                upper, lower = (b, a) if changed else (a, b)
                one[at], other[at] = upper, lower - part * upper

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
