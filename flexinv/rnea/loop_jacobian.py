"""Closed loops in space: columns of G for three positions and directions beside them, in one pass over the lanes.

A unit rate of a joint turns about z, or slides along it, and moves the point of B by c = z x (x_B - x), or z:

    positions  c            directions  e . z, or 0            d' = sum c qd
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexinv.kernels.jit import jit_lane, jit_lanes
from flexinv.kernels.simd import LANES, plus, put_vec, row, times, vec_of
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.loop_bodies import cross, dot, minus

_ROW, _VEC, _ONE, _THREE, _FOUR = row(layout.MOST_COLUMNS), np.uint64(0), np.uint64(1), np.uint64(3), np.uint64(4)
_COLUMN, _CLOSURE = row(6 * layout.MOST_COLUMNS + 1), row(layout.CLOSURE_ROWS + 9)


@jit_lane
def _put(column, own, k, c, more, speed):
    """Write the size of a column, its positions, and what it adds to d'."""
    column[k] = dot(c, c) + more
    for j in range(3):
        column[_ROW * (_ONE + np.uint64(j)) + k] = c[j]
    put_vec(own, layout.GAP_RATE, k, plus(vec_of(own, layout.GAP_RATE, k), times(speed, c)))


def _turning(count: int) -> Any:
    """The column of a joint that turns, in so many directions; loops over a constant are taken apart."""

    @jit_lane
    def lane(column, own, axis, at, rates, k, factors):
        over, sign, length = factors
        z = vec_of(axis, _VEC, k)
        c = times(over, cross(z, minus(vec_of(own, layout.POINT, k), vec_of(at, _VEC, k))))
        _put(column, own, k, c, 1.0 if count else 0.0, length * rates[k])
        for j in range(count):
            e = vec_of(own, layout.VECTORS + np.uint64(j) * layout.VECTOR, k)
            column[_ROW * (_FOUR + np.uint64(j)) + k] = sign * dot(e, z)

    @jit_lanes
    def turning(column, own, axis, at, rates, lanes, signs):
        factors = signs[0], signs[1], signs[2]
        for k in range(lanes):
            lane(column, own, axis, at, rates, k, factors)

    return turning


_TURNING_0, _TURNING_1, _TURNING_2, _TURNING_3 = (_turning(count) for count in range(4))


@jit_lanes
def _sliding(column, own, axis, rates, lanes, signs, directions):
    """The column of a joint that slides: it turns nothing."""
    over, length = signs[0], signs[2]
    for k in range(lanes):
        _put(column, own, k, times(over, vec_of(axis, _VEC, k)), 0.0, length * rates[k])
    for j in range(directions):
        entry = column[_ROW * (_FOUR + j) :]
        for k in range(lanes):
            entry[k] = 0.0


@jit_lanes
def whole_column(work, closure, column, lanes, signs):
    """Set one column of a closure: its size and positions over the mechanism's length [1/rad], [1/m], directions [-]."""
    axis, place, own, to, rates = column.axis, column.joint, closure.own, column.to, column.rate
    entries, own, z = work[to : to + _COLUMN], work[own : own + _CLOSURE], work[axis : axis + layout.VECTOR]
    at, rates, directions = work[place : place + layout.VECTOR], work[rates : rates + LANES], closure.directions
    if column.kind != layout.TURNING:
        _sliding(entries, own, z, rates, lanes, signs, directions)
    elif directions == 0:
        _TURNING_0(entries, own, z, at, rates, lanes, signs)
    elif directions == 1:
        _TURNING_1(entries, own, z, at, rates, lanes, signs)
    elif directions == 2:
        _TURNING_2(entries, own, z, at, rates, lanes, signs)
    else:
        _TURNING_3(entries, own, z, at, rates, lanes, signs)
