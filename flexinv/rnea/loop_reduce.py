"""Closed loops in space: columns of G, and elimination of a passive universal joint from a point constraint.

A point constraint exerts a force f at the arm r from a universal joint that has no drive and is in no other closure.  The
joint's axes move the point by z1 x r and z2 x r; their two equations determine f up to its component along r:

    f = (tau_2 z1 - tau_1 z2) / s + lambda u        s = (z1 x z2) . r,   u = r / s

as z2 . (z1 x r) = -s and z1 . (z2 x r) = s.  The first part is subtracted from the efforts tau of the other joints at
once, c . f; one row of G, u . c, remains instead of three.
"""

from __future__ import annotations

import numpy as np

from flexinv.kernels.jit import jit_lane, jit_lanes
from flexinv.kernels.simd import LANES, into, plus, plus_cross, put_vec, row, times, vec_of
from flexinv.rnea.loop_allocation import LEAST_ENTRY, LEAST_PIVOT, geared
from flexinv.rnea.loop_bodies import axes_of, cross, dot, minus
from flexinv.rnea.loop_jacobian import whole_column
from flexinv.rnea.loop_layout import (
    AXIS,
    BODY_ROWS,
    COLUMN_CELLS,
    COUNT,
    DIRECTIONS,
    EFFORT,
    ENTRIES,
    ENTRY,
    FIRST,
    FLOATING,
    FORCE,
    GAP_RATE,
    GEARED,
    JOINT,
    OWN,
    POINT,
    POSITIONS,
    PUSHING,
    QD,
    REDUCED,
    SIGNS,
    SIZE,
    SIZE_TOO,
    STRIDE,
    TO,
    TURNING,
    UNIT,
    VECTOR,
    VECTORS,
    WHOLE,
)
from flexinv.rnea.recursion import EFFORT as SLIDE_EFFORT
from flexinv.rnea.recursion import EFFORTS, EFFORTS_TURNING, FREE_ROWS, RATE, RATES, RATES_TURNING, SCALAR_ROWS

_BODY, _COLUMN, _CLOSURE, _VEC = row(BODY_ROWS), row(4), VECTORS, np.uint64(0)
_ZERO, _TWO, _THREE = np.uint64(0), np.uint64(2), np.uint64(3)
_FREE, _SCALAR, _SIX = row(FREE_ROWS), row(SCALAR_ROWS), row(6)


@jit_lanes
def _motion(to, joint, own, rates, lanes, signs, turns, more):
    """Write the velocity of B's point per unit rate of a joint (axis, place), over the mechanism's length, and its square.

    It is added to d', too.
    """
    (axis, at), sign, length = joint, signs[0], signs[2]
    if turns:
        for k in range(lanes):
            c = times(sign, cross(vec_of(axis, _VEC, k), minus(vec_of(own, POINT, k), vec_of(at, _VEC, k))))
            put_vec(to, ENTRIES, k, c)
            to[k] = dot(c, c) + more
            put_vec(own, GAP_RATE, k, plus(vec_of(own, GAP_RATE, k), times(length * rates[k], c)))
    else:
        for k in range(lanes):
            c = times(sign, vec_of(axis, _VEC, k))
            put_vec(to, ENTRIES, k, c)
            to[k] = dot(c, c)
            put_vec(own, GAP_RATE, k, plus(vec_of(own, GAP_RATE, k), times(length * rates[k], c)))


@jit_lanes
def _along(to, e, moved, lanes, sign):
    """Entry sign e . moved of one row."""
    for k in range(lanes):
        to[k] = sign * dot(vec_of(e, _VEC, k), vec_of(moved, _VEC, k))


@jit_lanes
def _column(work, closure, column, lanes, signs):
    """Set the entries of one column, row by row: along u of single positions, about e of directions."""
    axis, place, own, to, entry = column[AXIS], column[JOINT], closure[OWN], column[TO], column[ENTRY]
    positions, directions, turns = closure[POSITIONS], closure[DIRECTIONS], column[0] == TURNING
    e, z, moved = work[own + VECTORS :], work[axis : axis + VECTOR], work[to : to + _COLUMN]
    rates, more = work[column[QD] : column[QD] + LANES], 1.0 if directions > _ZERO else 0.0
    joint = z, work[place : place + VECTOR]
    _motion(moved, joint, work[own : own + _CLOSURE], rates, lanes, signs, turns, more)
    for j in range(positions):
        _along(work[entry : entry + LANES], e[j * VECTOR :], moved[ENTRIES:], lanes, 1.0)
        entry += closure[STRIDE]
    for j in range(positions, positions + directions):
        _along(work[entry : entry + LANES], e[j * VECTOR :], z, lanes, signs[1] if turns else 0.0)
        entry += closure[STRIDE]


@jit_lanes
def _force(own, axes, at, both_rates, efforts, lanes, signs):
    """u and f of the two axes of a universal joint, and d'; return how often the arm is nearly in their plane, or nearly none."""
    (axis, other), (rates, rates_too), (tau, tau_too) = axes, both_rates, efforts
    doubts, sign, length = 0, signs[0], signs[2]
    least = (LEAST_ENTRY * length) ** 2
    for k in range(lanes):
        z1, z2 = vec_of(axis, _VEC, k), vec_of(other, _VEC, k)
        r = times(sign, minus(vec_of(own, POINT, k), vec_of(at, _VEC, k)))
        square, s = dot(r, r), dot(cross(z1, z2), r)
        doubts += 0 if (s * s >= LEAST_PIVOT * LEAST_PIVOT * square) & (s * s >= least) else 1
        w = plus(times(rates[k], z1), times(rates_too[k], z2))
        along, along_too, inverse = dot(z1, r), dot(z2, r), 1.0 / s
        put_vec(own, UNIT, k, times(inverse, r))
        put_vec(own, FORCE, k, times(inverse, minus(times(tau_too[k], z1), times(tau[k], z2))))
        put_vec(own, GAP_RATE, k, times(length, cross(w, r)))
        own[SIZE + k], own[SIZE_TOO + k] = square - along * along, square - along_too * along_too
    return doubts


@jit_lanes
def _nothing(one, other, lanes):
    """Nothing is left of two efforts."""
    for k in range(lanes):
        one[k] = other[k] = 0.0


@jit_lanes
def _reduce(work, closure, one, other, lanes, signs):
    """Take two columns from a closure; return how often that is in doubt."""
    first, second, place, own = one[AXIS], other[AXIS], one[JOINT], closure[OWN]
    axes = work[first : first + VECTOR], work[second : second + VECTOR]
    at, own = work[place : place + VECTOR], work[own : own + VECTORS]
    first, second = one[QD], other[QD]
    rates = work[first : first + LANES], work[second : second + LANES]
    first, second = one[EFFORT], other[EFFORT]
    efforts = work[first : first + LANES], work[second : second + LANES]
    doubts = _force(own, axes, at, rates, efforts, lanes, signs)
    _nothing(efforts[0], efforts[1], lanes)
    return doubts


@jit_lanes
def _part(entry, effort, moved, own, lanes):
    """g = u . c of one column, and what the force does for its joint."""
    for k in range(lanes):
        c = vec_of(moved, ENTRIES, k)
        entry[k] = dot(vec_of(own, UNIT, k), c)
        effort[k] -= dot(vec_of(own, FORCE, k), c)


@jit_lanes
def _single(work, closure, column, lanes, signs):
    """The column of one coordinate."""
    axis, place, to, entry, effort = column[AXIS], column[JOINT], column[TO], column[ENTRY], column[EFFORT]
    own, moved = work[closure[OWN] : closure[OWN] + _CLOSURE], work[to : to + _COLUMN]
    rates, turns = work[column[QD] : column[QD] + LANES], column[0] == TURNING
    joint = work[axis : axis + VECTOR], work[place : place + VECTOR]
    _motion(moved, joint, own, rates, lanes, signs, turns, 0.0)
    _part(work[entry : entry + LANES], work[effort : effort + LANES], moved, own, lanes)


@jit_lanes
def _pushing(entry, own, axis, rows, lanes, signs):
    """The column of a slide, c = d."""
    scale, sign = signs[0], signs[1]
    for k in range(lanes):
        d = vec_of(axis, _VEC, k)
        entry[k] = scale * dot(vec_of(own, UNIT, k), d)
        rows[SLIDE_EFFORT + k] -= scale * dot(vec_of(own, FORCE, k), d)
        put_vec(own, GAP_RATE, k, plus(vec_of(own, GAP_RATE, k), times(sign * rows[RATE + k], d)))


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
        along = times(scale, _along_axes(axes, vec_of(own, UNIT, k)))
        pull = times(scale, _along_axes(axes, vec_of(own, FORCE, k)))
        put_vec(entries, _VEC, k, along)
        put_vec(entries, VECTOR, k, cross(r, along))
        put_vec(rows, EFFORTS, k, minus(vec_of(rows, EFFORTS, k), pull))
        put_vec(rows, EFFORTS_TURNING, k, minus(vec_of(rows, EFFORTS_TURNING, k), cross(r, pull)))
        moved = into(axes, plus_cross(vec_of(rows, RATES, k), vec_of(rows, RATES_TURNING, k), r))
        put_vec(own, GAP_RATE, k, plus(vec_of(own, GAP_RATE, k), times(sign, moved)))


@jit_lanes
def _left(fixed, work, closure, column, lanes, signs):
    """Set the entries of a joint in the row that is left, and what the force does for it."""
    entry, rows, axes = column[ENTRY], column[JOINT], column[AXIS]
    own = work[closure[OWN] : closure[OWN] + _CLOSURE]
    if column[0] == FLOATING:
        c = fixed[column[TO] :]
        entries, rows = work[entry : entry + _SIX], work[rows : rows + _FREE]
        _floating(entries, work[axes : axes + _BODY], own, rows, lanes, signs, (c[0], c[1], c[2]))
    elif column[0] == PUSHING:
        _pushing(
            work[entry : entry + LANES], own, work[axes : axes + VECTOR], work[rows : rows + _SCALAR], lanes, signs
        )
    else:
        _single(work, closure, column, lanes, signs)


@jit_lanes
def columns(plan, fixed, work, closure, lanes):
    """Set the columns of one closure, positions over the mechanism's length [1/rad], [1/m], directions [-]; return doubts."""
    doubts, reduced = 0, closure[REDUCED] > _ZERO
    for j in range(closure[COUNT]):
        at = closure[FIRST] + j * COLUMN_CELLS
        column = plan[at : at + COLUMN_CELLS]
        signs = fixed[column[SIGNS] : column[SIGNS] + _THREE]
        if column[0] == GEARED:
            geared(work[column[TO] : column[TO] + _COLUMN], lanes, signs[0])
        elif not reduced and closure[0] == WHOLE:
            whole_column(work, closure, column, lanes, signs)
        elif not reduced:
            _column(work, closure, column, lanes, signs)
        elif j < _TWO:
            doubts += _reduce(work, closure, column, plan[at + COLUMN_CELLS :], lanes, signs) if j == _ZERO else 0
        else:
            _left(fixed, work, closure, column, lanes, signs)
    return doubts
