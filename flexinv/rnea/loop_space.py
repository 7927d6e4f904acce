"""Closed loops in space, one sample a lane: residuals phi, phi', phi'' and rows G of the closures.

Rows are those of `closures`: position u . d, direction u . w, with u fixed in A and w in B, d = x_B - x_A.  A joint between the
ends moves the point of B, seen from A, by c = z x (x_B - x) or z, a screw of lead h by z x (x_B - x) + h z.  The recursion has
computed the accelerations of both ends, each in its own axes (gravity included); at x_B they are  a + al x r + w x (w x r).  So

    position    phi = u . d     phi' = u . d'      phi'' = u . (a_B - a_A - 2 w_A x d')              d' = sum c qd,   G = u . c
    direction   phi = u . w     phi' = e . w_AB    phi'' = e . al_AB + e' . w_AB     e = w x u,      G = e . z

Three positions fix a point: they may be taken along any axes, here the root's, and d' is none.

Where one end stands in the world, the other one, E, turns at w and al and accelerates by a, which the recursion has found in E's
axes; gravity makes the world's end accelerate by -g there.  With m fixed in E and f in the world, which in E's axes turns
backwards, f' = -w x f:

    phi = m . f      phi' = w . n      phi'' = al . n + (w . f) (m . w) - w^2 phi            n = m x f

A point constraint exerts a force f at the arm r from a universal joint that has no drive and is in no other closure.  The
joint's axes move the point by z1 x r and z2 x r; their two equations determine f up to its component along r:

    f = (tau_2 z1 - tau_1 z2) / s + lambda u        s = (z1 x z2) . r,   u = r / s

as z2 . (z1 x r) = -s and z1 . (z2 x r) = s.  The first part is subtracted from the efforts tau of the other joints at
once, c . f; one row of G, u . c, remains instead of three.

Columns of three positions, c, and of directions beside them, e . z or 0, are set in one pass over the lanes.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexinv.kernels.jit import jit_lane, jit_lanes
from flexinv.kernels.simd import cross, dot, into, minus, plus, plus_cross, put_vec, row, times, vec_of
from flexinv.kernels.vec3 import mat_at, vec, vec_at
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.loop_allocation import LEAST_ENTRY, LEAST_PIVOT, fill_coupling_columns, update_largest_squares
from flexinv.rnea.loop_bodies import add_squares, compute_components, move, read_body_axes
from flexinv.rnea.recursion import (
    EFFORTS_FREE,
    EFFORTS_TURNING,
    RATES_FREE,
    RATES_TURNING,
    compute_acceleration_at,
    read_state,
)

_NONE = (0.0, 0.0, 0.0)
_VEC = np.uint64(0)
_THREE = np.uint64(3)
_SIX = np.uint64(6)
_ONE = np.uint64(1)
_FOUR = np.uint64(4)
# Of columns that stand side by side: how far rows are apart.
_ROW = row(layout.MOST_COLUMNS)
# Constants of a closure: places of the ends in axes of the loop, the scale; arms of both in those of the recursion, and R of a
# body's axes as the loop takes them and as the recursion does, by columns.
_AT_A, _AT_B, _SCALE, _ARM_A, _ARM_B, _TURNED_A, _TURNED_B, _U = (np.uint64(i) for i in (0, 3, 6, 7, 10, 13, 22, 31))
# Those of one to the ground: the points of E and of the end that stands; the scale; -g; whether E is B; m, f of directions.
_AT, _THERE, _GROUND_SCALE, _REST, _IS_B, _PAIRS = (np.uint64(i) for i in (0, 3, 6, 7, 10, 11))


@jit_lane
def _compute_point(axes, place, k, seat):
    """The place of a point of a body."""
    return plus(vec_of(place, _VEC, k), into(read_body_axes(axes, k), seat))


@jit_lane
def _convert_to_root(axes, k, turned, v):
    """A vector of the recursion in the axes of the root."""
    return into(read_body_axes(axes, k), into(turned, v))


def _make_two_end_kernel(whole: bool) -> Any:
    """Return the kernel of two ends that move: the point of B; of three positions the squares of phi and phi''.

    Of fewer the gap and its second rate: A's acceleration is that of its body at the point of B, also where that is open.
    """

    @jit_lanes
    def fill_ends(end_a, end_b, closing, lanes, c):
        a, place_a, state_a = end_a
        b, place_b, state_b = end_b
        scale = c[_SCALE]
        at_a = vec_at(c, _AT_A)
        arm = vec_at(c, _ARM_A)
        turned_a = mat_at(c, _TURNED_A)
        at_b = vec_at(c, _AT_B)
        arm_b = vec_at(c, _ARM_B)
        turned_b = mat_at(c, _TURNED_B)
        for k in range(lanes):
            point = _compute_point(b, place_b, k, at_b)
            gap = minus(point, _compute_point(a, place_a, k, at_a))
            if not whole:
                arm = compute_components(
                    turned_a, compute_components(read_body_axes(a, k), minus(point, vec_of(place_a, _VEC, k)))
                )
            one = compute_acceleration_at(*read_state(state_a, k), arm)
            other = compute_acceleration_at(*read_state(state_b, k), arm_b)
            second = minus(_convert_to_root(b, k, turned_b, other), _convert_to_root(a, k, turned_a, one))
            put_vec(closing, layout.POINT, k, point)
            put_vec(closing, layout.GAP_RATE, k, _NONE)
            put_vec(closing, layout.SQUARES, k, (scale * dot(gap, gap), 0.0, dot(second, second)) if whole else _NONE)
            if not whole:
                put_vec(closing, layout.GAP, k, gap)
                put_vec(closing, layout.SECOND, k, second)

    return fill_ends


_whole = _make_two_end_kernel(True)
_partial = _make_two_end_kernel(False)


@jit_lanes
def _write_angular_rates(a, state_a, b, state_b, closing, lanes, c):
    """Write both ends' angular velocities and their relative angular acceleration, in the axes of the root."""
    turned_a = mat_at(c, _TURNED_A)
    turned_b = mat_at(c, _TURNED_B)
    for k in range(lanes):
        wa, al_a, _ = read_state(state_a, k)
        wb, al_b, _ = read_state(state_b, k)
        put_vec(closing, layout.SPIN_A, k, _convert_to_root(a, k, turned_a, wa))
        put_vec(closing, layout.SPIN_B, k, _convert_to_root(b, k, turned_b, wb))
        put_vec(
            closing,
            layout.TURNING_RATE,
            k,
            minus(_convert_to_root(b, k, turned_b, al_b), _convert_to_root(a, k, turned_a, al_a)),
        )


@jit_lanes
def _add_direction_squares(e, a, b, closing, lanes, u, w):
    """The squares of phi = u . w of one row, and e."""
    for k in range(lanes):
        wa = vec_of(closing, layout.SPIN_A, k)
        wb = vec_of(closing, layout.SPIN_B, k)
        us = into(read_body_axes(a, k), u)
        ws = into(read_body_axes(b, k), w)
        n = cross(ws, us)
        turning = minus(wb, wa)
        n1 = plus(cross(cross(wb, ws), us), cross(ws, cross(wa, us)))
        add_squares(
            closing, k, dot(us, ws), dot(n, turning), dot(n, vec_of(closing, layout.TURNING_RATE, k)) + dot(n1, turning)
        )
        put_vec(e, _VEC, k, n)


@jit_lanes
def _add_position_squares(e, closing, lanes, scale):
    """The squares of phi = u . d of one row."""
    for k in range(lanes):
        u = vec_of(e, _VEC, k)
        d1 = vec_of(closing, layout.GAP_RATE, k)
        second = minus(vec_of(closing, layout.SECOND, k), times(2.0, cross(vec_of(closing, layout.SPIN_A, k), d1)))
        add_squares(closing, k, scale * dot(u, vec_of(closing, layout.GAP, k)), dot(u, d1), dot(u, second))


def make_ground_kernel(count: int) -> Any:
    """Return the kernel of a closure to the ground with so many directions: the point of B [m], e = w x u, the squares.

    e is n where E is B, whose vector is w; else it is -n, and what is given is -m.
    """

    @jit_lanes
    def fill_ends(closing, axes, place, state, lanes, c):
        at = vec_at(c, _AT)
        there = vec_at(c, _THERE)
        rest = vec_at(c, _REST)
        is_b = c[_IS_B]
        scale = c[_GROUND_SCALE]
        for k in range(lanes):
            frame = read_body_axes(axes, k)
            w, al, a = read_state(state, k)
            d = minus(plus(vec_of(place, _VEC, k), into(frame, at)), there)
            second = minus(into(frame, compute_acceleration_at(w, al, a, at)), rest)
            put_vec(closing, layout.POINT, k, plus(there, times(is_b, d)))
            put_vec(closing, layout.GAP_RATE, k, _NONE)
            squares = scale * dot(d, d), 0.0, dot(second, second)
            for j in range(count):
                pair = _PAIRS + _SIX * np.uint64(j)
                m = vec_at(c, pair)
                f = compute_components(frame, vec_at(c, pair + _THREE))
                n = cross(m, f)
                phi = dot(m, f)
                phi1 = dot(w, n)
                phi2 = dot(al, n) + dot(w, f) * dot(m, w) - dot(w, w) * phi
                squares = plus(squares, (phi * phi, phi1 * phi1, phi2 * phi2))
                put_vec(closing, layout.VECTORS + np.uint64(j) * layout.VECTOR, k, into(frame, n))
            put_vec(closing, layout.SQUARES, k, squares)

    return fill_ends


_from_ground = layout.make_choice_of_four(make_ground_kernel)


@jit_lanes
def _fill_ends(work, closure, closing, lanes, c):
    """Points, vectors and squares of one closure, but for what takes d'."""
    a = work[closure.axes_a :]
    b = work[closure.axes_b :]
    of_a = work[closure.state_a :]
    of_b = work[closure.state_b :]
    end_a = (a, work[closure.place_a :], of_a)
    end_b = (b, work[closure.place_b :], of_b)
    positions = closure.positions
    directions = closure.directions
    vectors = closing[layout.VECTORS :]
    if closure.ground != layout.NO_GROUND:
        axes, place, state = end_b if closure.ground == layout.A_STANDS else end_a
        _from_ground(directions, closing, axes, place, state, lanes, c)
        return
    if closure.kind == layout.WHOLE:
        _whole(end_a, end_b, closing, lanes, c)
    else:
        _partial(end_a, end_b, closing, lanes, c)
    if positions + directions > np.uint64(0):
        _write_angular_rates(a, of_a, b, of_b, closing, lanes, c)
    for j in range(positions):  # e = u
        u = vec_at(c, _U + _THREE * j)
        for k in range(lanes):
            put_vec(vectors, j * layout.VECTOR, k, into(read_body_axes(a, k), u))
    for j in range(directions):
        u = c[_U + _THREE * positions + _SIX * j :]
        _add_direction_squares(vectors[(positions + j) * layout.VECTOR :], a, b, closing, lanes, vec(u), vec_at(u, 3))


@jit_lane
def _compute_point_velocity(closing, axis, at, k, signs):
    """The velocity of B's point per unit rate of a joint, over the mechanism's length."""
    z = vec_of(axis, _VEC, k)
    arm = minus(vec_of(closing, layout.POINT, k), vec_of(at, _VEC, k))
    return plus_cross(times(signs[0], z), times(signs[1], z), arm)


@jit_lane
def _add_rate(closing, k, speed, c):
    """Add to d'."""
    put_vec(closing, layout.GAP_RATE, k, plus(vec_of(closing, layout.GAP_RATE, k), times(speed, c)))


def make_column_kernel(count: int) -> Any:
    """Return the kernel of a joint's size, its column in three positions and so many directions [-], and what it adds to d'.

    Loops over a constant are taken apart.
    """

    @jit_lane
    def fill_lane(column, closing, axis, at, rates, k, signs):
        c = _compute_point_velocity(closing, axis, at, k, signs)
        z = vec_of(axis, _VEC, k)
        column[k] = dot(c, c) + (signs[2] * signs[2] if count else 0.0)
        for j in range(3):
            column[_ROW * (_ONE + np.uint64(j)) + k] = c[j]
        _add_rate(closing, k, signs[3] * rates[k], c)
        for j in range(count):
            e = vec_of(closing, layout.VECTORS + np.uint64(j) * layout.VECTOR, k)
            column[_ROW * (_FOUR + np.uint64(j)) + k] = signs[2] * dot(e, z)

    @jit_lanes
    def fill_lanes(column, closing, axis, at, rates, lanes, signs):
        for k in range(lanes):
            fill_lane(column, closing, axis, at, rates, k, signs)

    return fill_lanes


_whole_column = layout.make_choice_of_four(make_column_kernel)


@jit_lanes
def _write_column_size(to, axis, at, closing, rates, lanes, signs, turns):
    """Write the size of a column and c behind it, and add to d'; turns : what directions add to the size."""
    for k in range(lanes):
        c = _compute_point_velocity(closing, axis, at, k, signs)
        put_vec(to, layout.ENTRIES, k, c)
        to[k] = dot(c, c) + turns
        _add_rate(closing, k, signs[3] * rates[k], c)


@jit_lanes
def _fill_column(work, closure, column, closing, lanes, signs):
    """Set the entries of one column, row by row: along u of single positions, about e of directions."""
    z = work[column.axis :]
    to = work[column.to :]
    positions = closure.positions
    turns = signs[2] * signs[2] if closure.directions > _VEC else 0.0
    _write_column_size(to, z, work[column.joint :], closing, work[column.rate :], lanes, signs, turns)
    for j in range(positions + closure.directions):
        entry = work[column.entry + j * closure.stride :]
        e = closing[layout.VECTORS + j * layout.VECTOR :]
        moved, sign = (to[layout.ENTRIES :], 1.0) if j < positions else (z, signs[2])
        for k in range(lanes):
            entry[k] = sign * dot(vec_of(e, _VEC, k), vec_of(moved, _VEC, k))


@jit_lanes
def _remove_universal_joint(work, one, other, closing, lanes, signs):
    """Take both columns of a universal joint; set u, f, d'; return how often the arm is nearly in their plane, or nearly none."""
    axis = work[one.axis :]
    axis_too = work[other.axis :]
    rates = work[one.rate :]
    rates_too = work[other.rate :]
    tau = work[one.effort :]
    tau_too = work[other.effort :]
    at = work[one.joint :]
    doubts = 0
    sign = signs[1]
    length = signs[3]
    least = (LEAST_ENTRY * signs[3]) ** 2
    for k in range(lanes):
        z1 = vec_of(axis, _VEC, k)
        z2 = vec_of(axis_too, _VEC, k)
        r = times(sign, minus(vec_of(closing, layout.POINT, k), vec_of(at, _VEC, k)))
        square = dot(r, r)
        s = dot(cross(z1, z2), r)
        doubts += 0 if (s * s >= LEAST_PIVOT * LEAST_PIVOT * square) & (s * s >= least) else 1
        w = plus(times(rates[k], z1), times(rates_too[k], z2))
        along = dot(z1, r)
        along_too = dot(z2, r)
        inverse = 1.0 / s
        put_vec(closing, layout.UNIT_FORCE, k, times(inverse, r))
        put_vec(closing, layout.JOINT_FORCE, k, times(inverse, minus(times(tau_too[k], z1), times(tau[k], z2))))
        put_vec(closing, layout.GAP_RATE, k, times(length, cross(w, r)))
        closing[layout.SIZE + k] = square - along * along
        closing[layout.SIZE_TOO + k] = square - along_too * along_too
    for k in range(lanes):
        tau[k] = tau_too[k] = 0.0
    return doubts


@jit_lanes
def _fill_single_column(work, column, closing, lanes, signs):
    """The column of one coordinate, g = u . c, and what the force does for its joint."""
    to = work[column.to :]
    entry = work[column.entry :]
    effort = work[column.effort :]
    rates = work[column.rate :]
    axis = work[column.axis :]
    at = work[column.joint :]
    for k in range(lanes):
        c = _compute_point_velocity(closing, axis, at, k, signs)
        to[k] = dot(c, c)
        entry[k] = dot(vec_of(closing, layout.UNIT_FORCE, k), c)
        effort[k] -= dot(vec_of(closing, layout.JOINT_FORCE, k), c)
        _add_rate(closing, k, signs[3] * rates[k], c)


@jit_lanes
def _fill_floating_columns(entries, body, closing, rows, lanes, c):
    """The six columns of a free body that holds the point, r in its axes: u and f with their moments about its origin."""
    scale = c[0]
    sign = c[0] * c[3]
    r = vec_at(c, 4)
    for k in range(lanes):
        axes = read_body_axes(body, k)
        along = times(scale, compute_components(axes, vec_of(closing, layout.UNIT_FORCE, k)))
        pull = times(scale, compute_components(axes, vec_of(closing, layout.JOINT_FORCE, k)))
        put_vec(entries, _VEC, k, along)
        put_vec(entries, layout.VECTOR, k, cross(r, along))
        put_vec(rows, EFFORTS_FREE, k, minus(vec_of(rows, EFFORTS_FREE, k), pull))
        put_vec(rows, EFFORTS_TURNING, k, minus(vec_of(rows, EFFORTS_TURNING, k), cross(r, pull)))
        _add_rate(
            closing, k, sign, into(axes, plus_cross(vec_of(rows, RATES_FREE, k), vec_of(rows, RATES_TURNING, k), r))
        )


@jit_lanes
def fill_columns(plan, fixed, work, closure, closing, lanes):
    """Set the columns of one closure, positions over the mechanism's length [1/rad], [1/m], directions [-]; return doubts."""
    doubts = 0
    first = _VEC
    if closure.reduced > _VEC:
        one = layout.column_at(plan, closure.first)
        other = layout.column_at(plan, closure.first + _ONE)
        doubts = _remove_universal_joint(work, one, other, closing, lanes, fixed[one.signs :])
        first = np.uint64(2)
    for j in range(first, closure.columns):
        column = layout.column_at(plan, closure.first + j)
        axis = work[column.axis :]
        at = work[column.joint :]
        c = fixed[column.signs :]
        if column.kind == layout.FLOATING:
            _fill_floating_columns(work[column.entry :], axis, closing, at, lanes, c)
            break  # the records of the other axes are there for their sums
        signs = c[0], c[1], c[2], c[3]
        if closure.reduced > _VEC:
            _fill_single_column(work, column, closing, lanes, signs)
        elif closure.kind == layout.WHOLE:
            _whole_column(closure.directions, work[column.to :], closing, axis, at, work[column.rate :], lanes, signs)
        else:
            _fill_column(work, closure, column, closing, lanes, signs)
    return doubts


@jit_lanes
def fill_spatial_closures(plan, fixed, work, lanes, sums):
    """Set points [m] and G, and hold the squares of the closures; return how often reduced closures are in doubt.

    Closure after closure: rows of what is in one loop only are used again by the next.
    """
    doubts = 0
    for i in range(plan[layout.CLOSURE_RECORDS + 1]):
        closure = layout.closure_at(plan, i)
        c = fixed[closure.numbers :]
        closing = work[closure.offset :]
        move(plan, fixed, work, closure.first_body, closure.body_count, lanes)
        if closure.kind == layout.COUPLED:
            fill_coupling_columns(plan, fixed, work, closing, lanes, closure, c[0])
        else:
            _fill_ends(work, closure, closing, lanes, c)
            doubts += fill_columns(plan, fixed, work, closure, closing, lanes)
        if closure.kind == layout.PARTIAL:
            for j in range(closure.positions):
                _add_position_squares(closing[layout.VECTORS + j * layout.VECTOR :], closing, lanes, c[_SCALE])
        update_largest_squares(plan, fixed, work, lanes, closure, sums, True)
    return doubts
