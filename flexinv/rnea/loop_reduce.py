"""Closed loops in space: columns of G, and elimination of a passive universal joint from a point constraint.

A point constraint exerts a force f at the arm r from a universal joint that has no drive and is in no other closure.  The
joint's axes move the point by z1 x r and z2 x r; their two equations determine f up to its component along r:

    f = (tau_2 z1 - tau_1 z2) / s + lambda u        s = (z1 x z2) . r,   u = r / s

as z2 . (z1 x r) = -s and z1 . (z2 x r) = s.  The first part is subtracted from the efforts tau of the other joints at
once, c . f; one row of G, u . c, remains instead of three.

A unit rate of a joint turns about z, or slides along it, and moves the point of B by c = z x (x_B - x), or z, a screw of lead h
by z x (x_B - x) + h z.  Columns of three positions and of directions beside them are set in one pass over the lanes:

    positions  c            directions  e . z, or 0            d' = sum c qd
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexinv.kernels.jit import jit_lane, jit_lanes
from flexinv.kernels.simd import into, plus, plus_cross, put_vec, row, times, vec_of
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.loop_allocation import LEAST_ENTRY, LEAST_PIVOT
from flexinv.rnea.loop_bodies import axes_of, components, cross, dot, minus
from flexinv.rnea.recursion import EFFORTS, EFFORTS_TURNING, RATES, RATES_TURNING

_VEC, _ONE, _FOUR = np.uint64(0), np.uint64(1), np.uint64(4)
# Of columns that stand side by side: how far rows are apart.
_ROW = row(layout.MOST_COLUMNS)


@jit_lane
def _motion(own, axis, at, k, signs):
    """The velocity of B's point per unit rate of a joint, over the mechanism's length."""
    z, arm = vec_of(axis, _VEC, k), minus(vec_of(own, layout.POINT, k), vec_of(at, _VEC, k))
    return plus_cross(times(signs[0], z), times(signs[1], z), arm)


@jit_lane
def _add_rate(own, k, speed, c):
    """Add to d'."""
    put_vec(own, layout.GAP_RATE, k, plus(vec_of(own, layout.GAP_RATE, k), times(speed, c)))


def moving(count: int) -> Any:
    """Return the kernel of a joint's size, its column in three positions and so many directions [-], and what it adds to d'.

    Loops over a constant are taken apart.
    """

    @jit_lane
    def lane(column, own, axis, at, rates, k, signs):
        c, z = _motion(own, axis, at, k, signs), vec_of(axis, _VEC, k)
        column[k] = dot(c, c) + (signs[2] * signs[2] if count else 0.0)
        for j in range(3):
            column[_ROW * (_ONE + np.uint64(j)) + k] = c[j]
        _add_rate(own, k, signs[3] * rates[k], c)
        for j in range(count):
            e = vec_of(own, layout.VECTORS + np.uint64(j) * layout.VECTOR, k)
            column[_ROW * (_FOUR + np.uint64(j)) + k] = signs[2] * dot(e, z)

    @jit_lanes
    def columns(column, own, axis, at, rates, lanes, numbers):
        signs = numbers[0], numbers[1], numbers[2], numbers[3]
        for k in range(lanes):
            lane(column, own, axis, at, rates, k, signs)

    return columns


_moving = layout.one_of_four(moving, 0)


@jit_lanes
def _moved(to, axis, at, own, rates, lanes, signs, turns):
    """Write the size of a column and c behind it, and add to d'; turns : what directions add to the size."""
    for k in range(lanes):
        c = _motion(own, axis, at, k, signs)
        put_vec(to, layout.ENTRIES, k, c)
        to[k] = dot(c, c) + turns
        _add_rate(own, k, signs[3] * rates[k], c)


@jit_lanes
def _along(to, e, moved, lanes, sign):
    """Entry sign e . moved of one row."""
    for k in range(lanes):
        to[k] = sign * dot(vec_of(e, _VEC, k), vec_of(moved, _VEC, k))


@jit_lanes
def _column(work, closure, column, own, lanes, numbers):
    """Set the entries of one column, row by row: along u of single positions, about e of directions."""
    z, to, entry, e = work[column.axis :], work[column.to :], column.entry, own[layout.VECTORS :]
    signs = numbers[0], numbers[1], numbers[2], numbers[3]
    positions, turns = closure.positions, signs[2] * signs[2] if closure.directions > _VEC else 0.0
    _moved(to, z, work[column.joint :], own, work[column.rate :], lanes, signs, turns)
    for j in range(positions + closure.directions):
        if j < positions:
            _along(work[entry:], e[j * layout.VECTOR :], to[layout.ENTRIES :], lanes, 1.0)
        else:
            _along(work[entry:], e[j * layout.VECTOR :], z, lanes, signs[2])
        entry += closure.stride


@jit_lanes
def _force(own, axes, at, both_rates, efforts, lanes, signs):
    """u and f of the two axes of a universal joint, and d'; return how often the arm is nearly in their plane, or nearly none."""
    (axis, other), (rates, rates_too), (tau, tau_too) = axes, both_rates, efforts
    doubts, sign, length = 0, signs[1], signs[3]
    least = (LEAST_ENTRY * length) ** 2
    for k in range(lanes):
        z1, z2 = vec_of(axis, _VEC, k), vec_of(other, _VEC, k)
        r = times(sign, minus(vec_of(own, layout.POINT, k), vec_of(at, _VEC, k)))
        square, s = dot(r, r), dot(cross(z1, z2), r)
        doubts += 0 if (s * s >= LEAST_PIVOT * LEAST_PIVOT * square) & (s * s >= least) else 1
        w = plus(times(rates[k], z1), times(rates_too[k], z2))
        along, along_too, inverse = dot(z1, r), dot(z2, r), 1.0 / s
        put_vec(own, layout.UNIT, k, times(inverse, r))
        put_vec(own, layout.FORCE, k, times(inverse, minus(times(tau_too[k], z1), times(tau[k], z2))))
        put_vec(own, layout.GAP_RATE, k, times(length, cross(w, r)))
        own[layout.SIZE + k], own[layout.SIZE_TOO + k] = square - along * along, square - along_too * along_too
    return doubts


@jit_lanes
def _reduce(work, one, other, own, lanes, signs):
    """Take two columns from a closure; return how often that is in doubt."""
    axes, rates = (work[one.axis :], work[other.axis :]), (work[one.rate :], work[other.rate :])
    efforts = work[one.effort :], work[other.effort :]
    doubts = _force(own, axes, work[one.joint :], rates, efforts, lanes, signs)
    for k in range(lanes):
        efforts[0][k] = efforts[1][k] = 0.0
    return doubts


@jit_lanes
def _single(work, column, own, lanes, numbers):
    """The column of one coordinate, g = u . c, and what the force does for its joint."""
    moved, entry, effort = work[column.to :], work[column.entry :], work[column.effort :]
    signs = numbers[0], numbers[1], numbers[2], numbers[3]
    _moved(moved, work[column.axis :], work[column.joint :], own, work[column.rate :], lanes, signs, 0.0)
    for k in range(lanes):
        c = vec_of(moved, layout.ENTRIES, k)
        entry[k] = dot(vec_of(own, layout.UNIT, k), c)
        effort[k] -= dot(vec_of(own, layout.FORCE, k), c)


@jit_lanes
def _floating(entries, body, own, rows, lanes, signs):
    """The six columns of a free body that holds the point, r in its axes: u and f with their moments about its origin."""
    scale, sign, r = signs[0], signs[0] * signs[3], (signs[4], signs[5], signs[6])
    for k in range(lanes):
        axes = axes_of(body, k)
        along = times(scale, components(axes, vec_of(own, layout.UNIT, k)))
        pull = times(scale, components(axes, vec_of(own, layout.FORCE, k)))
        put_vec(entries, _VEC, k, along)
        put_vec(entries, layout.VECTOR, k, cross(r, along))
        put_vec(rows, EFFORTS, k, minus(vec_of(rows, EFFORTS, k), pull))
        put_vec(rows, EFFORTS_TURNING, k, minus(vec_of(rows, EFFORTS_TURNING, k), cross(r, pull)))
        _add_rate(own, k, sign, into(axes, plus_cross(vec_of(rows, RATES, k), vec_of(rows, RATES_TURNING, k), r)))


@jit_lanes
def columns(plan, fixed, work, closure, own, lanes):
    """Set the columns of one closure, positions over the mechanism's length [1/rad], [1/m], directions [-]; return doubts."""
    doubts, first = 0, _VEC
    if closure.reduced > _VEC:
        one = layout.column_at(plan, closure.first)
        other = layout.column_at(plan, closure.first + _ONE)
        doubts, first = _reduce(work, one, other, own, lanes, fixed[one.signs :]), np.uint64(2)
    for j in range(first, closure.columns):
        column = layout.column_at(plan, closure.first + j)
        axis, at, signs = work[column.axis :], work[column.joint :], fixed[column.signs :]
        if column.kind == layout.FLOATING:
            _floating(work[column.entry :], axis, own, at, lanes, signs)
            break  # the records of the other axes are there for their sums
        if closure.reduced > _VEC:
            _single(work, column, own, lanes, signs)
        elif closure.kind == layout.WHOLE:
            _moving(closure.directions, work[column.to :], own, axis, at, work[column.rate :], lanes, signs)
        else:
            _column(work, closure, column, own, lanes, signs)
    return doubts
