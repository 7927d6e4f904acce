"""Closed loops in space: columns of G, and elimination of a passive universal joint from a point constraint.

A point constraint exerts a force f at the arm r from a universal joint that has no drive and is in no other closure.  The
joint's axes move the point by z1 x r and z2 x r; their two equations determine f up to its component along r:

    f = (tau_2 z1 - tau_1 z2) / s + lambda u        s = (z1 x z2) . r,   u = r / s

as z2 . (z1 x r) = -s and z1 . (z2 x r) = s.  The first part is subtracted from the efforts tau of the other joints at
once, c . f; one row of G, u . c, remains instead of three.

Columns of three positions and of directions beside them are set in one pass over the lanes.  A unit rate of a joint turns about
z, or slides along it, and moves the point of B by c = z x (x_B - x), or z, a screw of lead h by z x (x_B - x) + h z:

    positions  c            directions  e . z, or 0            d' = sum c qd
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexinv.kernels.jit import jit_lane, jit_lanes
from flexinv.kernels.simd import LANES, into, plus, plus_cross, put_vec, row, times, vec_of
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.loop_allocation import LEAST_ENTRY, LEAST_PIVOT, geared
from flexinv.rnea.loop_bodies import axes_of, cross, dot, minus
from flexinv.rnea.recursion import EFFORT as SLIDE_EFFORT
from flexinv.rnea.recursion import EFFORTS, EFFORTS_TURNING, FREE_ROWS, RATE, RATES, RATES_TURNING, SCALAR_ROWS

_BODY, _COLUMN, _CLOSURE, _VEC = row(layout.BODY_ROWS), row(4), layout.VECTORS, np.uint64(0)
_ZERO, _ONE, _THREE, _FOUR = np.uint64(0), np.uint64(1), np.uint64(3), np.uint64(4)
_FREE, _SCALAR, _SIX = row(FREE_ROWS), row(SCALAR_ROWS), row(6)
# Of columns that stand side by side: how far rows are apart, a column, and the closure with its vectors.
_ROW, _WHOLE_COLUMN = row(layout.MOST_COLUMNS), row(6 * layout.MOST_COLUMNS + 1)
_WHOLE_CLOSURE = row(layout.CLOSURE_ROWS + 9)


@jit_lane
def _put(column, own, k, c, more, speed):
    """Write the size of a column, its positions, and what it adds to d'."""
    column[k] = dot(c, c) + more
    for j in range(3):
        column[_ROW * (_ONE + np.uint64(j)) + k] = c[j]
    put_vec(own, layout.GAP_RATE, k, plus(vec_of(own, layout.GAP_RATE, k), times(speed, c)))


def turning(count: int) -> Any:
    """Return the kernel of a joint that turns, its column in so many directions [-]; loops over a constant are taken apart."""

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
    def columns(column, own, axis, at, rates, lanes, signs):
        factors = signs[0], signs[1], signs[2]
        for k in range(lanes):
            lane(column, own, axis, at, rates, k, factors)

    return columns


_turning = layout.one_of_four(turning, 0)


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
def _whole_column(work, closure, column, lanes, signs):
    """Set one column of a closure: its size and positions over the mechanism's length, directions."""
    axis, place, own, to, rates = column.axis, column.joint, closure.own, column.to, column.rate
    entries, own, z = work[to : to + _WHOLE_COLUMN], work[own : own + _WHOLE_CLOSURE], work[axis : axis + layout.VECTOR]
    at, rates, directions = work[place : place + layout.VECTOR], work[rates : rates + LANES], closure.directions
    if column.kind != layout.TURNING:
        _sliding(entries, own, z, rates, lanes, signs, directions)
    else:
        _turning(directions, entries, own, z, at, rates, lanes, signs)


@jit_lanes
def _motion(to, joint, own, rates, lanes, signs, turns, more):
    """Write the velocity of B's point per unit rate of a joint (axis, place), over the mechanism's length, and its square.

    It is added to d', too.
    """
    (axis, at), sign, length, lead = joint, signs[0], signs[2], signs[3]
    if turns:
        for k in range(lanes):
            z, arm = vec_of(axis, _VEC, k), minus(vec_of(own, layout.POINT, k), vec_of(at, _VEC, k))
            c = times(sign, plus_cross(times(lead, z), z, arm))
            put_vec(to, layout.ENTRIES, k, c)
            to[k] = dot(c, c) + more
            put_vec(own, layout.GAP_RATE, k, plus(vec_of(own, layout.GAP_RATE, k), times(length * rates[k], c)))
    else:
        for k in range(lanes):
            c = times(sign, vec_of(axis, _VEC, k))
            put_vec(to, layout.ENTRIES, k, c)
            to[k] = dot(c, c)
            put_vec(own, layout.GAP_RATE, k, plus(vec_of(own, layout.GAP_RATE, k), times(length * rates[k], c)))


@jit_lanes
def _along(to, e, moved, lanes, sign):
    """Entry sign e . moved of one row."""
    for k in range(lanes):
        to[k] = sign * dot(vec_of(e, _VEC, k), vec_of(moved, _VEC, k))


@jit_lanes
def _column(work, closure, column, lanes, signs):
    """Set the entries of one column, row by row: along u of single positions, about e of directions."""
    axis, place, own, to, entry = column.axis, column.joint, closure.own, column.to, column.entry
    positions, directions, turns = closure.positions, closure.directions, column.kind != layout.SLIDING
    e, z, moved = work[own + layout.VECTORS :], work[axis : axis + layout.VECTOR], work[to : to + _COLUMN]
    rates, more = work[column.rate : column.rate + LANES], 1.0 if directions > _ZERO else 0.0
    joint = z, work[place : place + layout.VECTOR]
    _motion(moved, joint, work[own : own + _CLOSURE], rates, lanes, signs, turns, more)
    for j in range(positions):
        _along(work[entry : entry + LANES], e[j * layout.VECTOR :], moved[layout.ENTRIES :], lanes, 1.0)
        entry += closure.stride
    for j in range(positions, positions + directions):
        _along(work[entry : entry + LANES], e[j * layout.VECTOR :], z, lanes, signs[1] if turns else 0.0)
        entry += closure.stride


@jit_lanes
def _force(own, axes, at, both_rates, efforts, lanes, signs):
    """u and f of the two axes of a universal joint, and d'; return how often the arm is nearly in their plane, or nearly none."""
    (axis, other), (rates, rates_too), (tau, tau_too) = axes, both_rates, efforts
    doubts, sign, length = 0, signs[0], signs[2]
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
def _nothing(one, other, lanes):
    """Nothing is left of two efforts."""
    for k in range(lanes):
        one[k] = other[k] = 0.0


@jit_lanes
def _reduce(work, closure, one, other, lanes, signs):
    """Take two columns from a closure; return how often that is in doubt."""
    first, second, place, own = one.axis, other.axis, one.joint, closure.own
    axes = work[first : first + layout.VECTOR], work[second : second + layout.VECTOR]
    at, own = work[place : place + layout.VECTOR], work[own : own + layout.VECTORS]
    first, second = one.rate, other.rate
    rates = work[first : first + LANES], work[second : second + LANES]
    first, second = one.effort, other.effort
    efforts = work[first : first + LANES], work[second : second + LANES]
    doubts = _force(own, axes, at, rates, efforts, lanes, signs)
    _nothing(efforts[0], efforts[1], lanes)
    return doubts


@jit_lanes
def _part(entry, effort, moved, own, lanes):
    """g = u . c of one column, and what the force does for its joint."""
    for k in range(lanes):
        c = vec_of(moved, layout.ENTRIES, k)
        entry[k] = dot(vec_of(own, layout.UNIT, k), c)
        effort[k] -= dot(vec_of(own, layout.FORCE, k), c)


@jit_lanes
def _single(work, closure, column, lanes, signs):
    """The column of one coordinate."""
    axis, place, to, entry, effort = column.axis, column.joint, column.to, column.entry, column.effort
    own, moved = work[closure.own : closure.own + _CLOSURE], work[to : to + _COLUMN]
    rates, turns = work[column.rate : column.rate + LANES], column.kind != layout.SLIDING
    joint = work[axis : axis + layout.VECTOR], work[place : place + layout.VECTOR]
    _motion(moved, joint, own, rates, lanes, signs, turns, 0.0)
    _part(work[entry : entry + LANES], work[effort : effort + LANES], moved, own, lanes)


@jit_lanes
def _pushing(entry, own, axis, rows, lanes, signs):
    """The column of a slide, c = d."""
    scale, sign = signs[0], signs[1]
    for k in range(lanes):
        d = vec_of(axis, _VEC, k)
        entry[k] = scale * dot(vec_of(own, layout.UNIT, k), d)
        rows[SLIDE_EFFORT + k] -= scale * dot(vec_of(own, layout.FORCE, k), d)
        put_vec(own, layout.GAP_RATE, k, plus(vec_of(own, layout.GAP_RATE, k), times(sign * rows[RATE + k], d)))


@jit_lane
def _along_axes(axes, v):
    """The components of a vector of the root in the axes of a body."""
    return dot(axes[0], v), dot(axes[1], v), dot(axes[2], v)


@jit_lanes
def _floating(entries, body, own, rows, lanes, signs, r):
    """The six columns of a free body that holds the point, r in its axes: u and f with their moments about its origin."""
    scale, sign = signs[0], signs[1]
    for k in range(lanes):
        axes = axes_of(body, k)
        along = times(scale, _along_axes(axes, vec_of(own, layout.UNIT, k)))
        pull = times(scale, _along_axes(axes, vec_of(own, layout.FORCE, k)))
        put_vec(entries, _VEC, k, along)
        put_vec(entries, layout.VECTOR, k, cross(r, along))
        put_vec(rows, EFFORTS, k, minus(vec_of(rows, EFFORTS, k), pull))
        put_vec(rows, EFFORTS_TURNING, k, minus(vec_of(rows, EFFORTS_TURNING, k), cross(r, pull)))
        moved = into(axes, plus_cross(vec_of(rows, RATES, k), vec_of(rows, RATES_TURNING, k), r))
        put_vec(own, layout.GAP_RATE, k, plus(vec_of(own, layout.GAP_RATE, k), times(sign, moved)))


@jit_lanes
def _left(fixed, work, closure, column, lanes, signs):
    """Set the entries of a joint in the row that is left, and what the force does for it."""
    entry, rows, axes = column.entry, column.joint, column.axis
    own = work[closure.own : closure.own + _CLOSURE]
    if column.kind == layout.FLOATING:
        c = fixed[column.to :]
        entries, rows = work[entry : entry + _SIX], work[rows : rows + _FREE]
        _floating(entries, work[axes : axes + _BODY], own, rows, lanes, signs, (c[0], c[1], c[2]))
    elif column.kind == layout.PUSHING:
        _pushing(
            work[entry : entry + LANES],
            own,
            work[axes : axes + layout.VECTOR],
            work[rows : rows + _SCALAR],
            lanes,
            signs,
        )
    else:
        _single(work, closure, column, lanes, signs)


@jit_lanes
def columns(plan, fixed, work, closure, lanes):
    """Set the columns of one closure, positions over the mechanism's length [1/rad], [1/m], directions [-]; return doubts."""
    doubts, reduced = 0, closure.reduced > _ZERO
    for j in range(closure.columns):
        at = closure.first + j * layout.COLUMN_CELLS
        column = layout.column_at(plan, at)
        signs = fixed[column.signs : column.signs + _FOUR]
        if column.kind == layout.GEARED:
            geared(work[column.to : column.to + _COLUMN], lanes, signs[0])
        elif not reduced and closure.kind == layout.WHOLE:
            _whole_column(work, closure, column, lanes, signs)
        elif not reduced:
            _column(work, closure, column, lanes, signs)
        elif j == _ZERO:
            doubts += _reduce(work, closure, column, layout.column_at(plan, at + layout.COLUMN_CELLS), lanes, signs)
        elif j > _ONE:
            _left(fixed, work, closure, column, lanes, signs)
    return doubts
