"""Closed loops, one sample a lane: limits of a motion, and the allocation of the cut tree's efforts to the drives by G.

With passive coordinates p and drives a,  tau_a + G_a^T lambda = tau_tree,a  and  G_p^T lambda = tau_tree,p.  Gaussian
elimination with pairwise pivoting (always the smaller row by the larger) brings G_p to upper triangular form; then lambda follows
coordinate by coordinate.  Rows left over have entries of drives only.  Such a row B is an internal preload of the drives: with as
many drives as freedoms it vanishes (it repeats other rows); else tau_a minimises tau_a^T W tau_a, and its components along the
rows B are removed one after the other.

Six forces along u_i at r_i hold a free body, sum lambda_i (u_i, r_i x u_i) = tau: rows of G of six entries, side by side, go in
one pass.  The entries of the drives stay as they are: the row operations are applied in reverse to the multipliers.

The order of the row operations is a list of *steps*, the same for every sample (`loop_plan`).  Where a pivot
is too small next to its column, or a row that should vanish does not, the block is left to `allocation`.

Limits: phi^2, phi'^2 and phi''^2, over their scales, summed over all rows of a closure.  They are compared with the sums
|G| |qd| and |G| |qdd| of some samples of a block; where that is inconclusive, `allocation` checks all samples.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flexinv.constraints.allocation import STILL_ACCELERATION, STILL_RATE
from flexinv.kernels.jit import jit_lane, jit_lanes
from flexinv.kernels.simd import LANES, dot, put_vec, row, vec_of
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.recursion import read_state

# A pivot over its column's size is at least this, so that its errors are 1e-12 at most; else singular values decide.
LEAST_PIVOT = 1e-4
# ... and at least this over the mechanism's length: a column that is rounding (an axis through the point that is closed, some
# 1e-16) may be none, and no size of its own says so; errors of the multiplier are 1e-10 at most.
LEAST_ENTRY = 1e-6
# Of a pivot's square over its column's size, and of the square itself.
LEAST_PART = LEAST_PIVOT * LEAST_PIVOT
LEAST_SQUARE = LEAST_ENTRY * LEAST_ENTRY
# What is left of a row that repeats others, over the size of its column: rounding over the smallest pivot.  Singular values would
# count it if it were above 1e-10.
REDUNDANT_ROW = 1e-11
# Rounding of how the ends of a closure accelerate, with all before it and less gravity, over that: some tens of sums.
ACCELERATION_ROUNDING = 1e-14
SOME = np.uint64(4)  # samples of a block whose sums |G| |qd| are taken
# Added to what may be as it was: else the compiler writes only the lanes that change, which takes several times as long.
_NOTHING = 0.0
_ZERO = np.uint64(0)
_ONE = np.uint64(1)
_TWO = np.uint64(2)
_THREE = np.uint64(3)
_FOUR = np.uint64(4)
_FIVE = np.uint64(5)
_NONE = (0.0, 0.0, 0.0)
_THREE_ROWS = row(3)
_SIX = tuple(row(layout.SIX * i) for i in range(layout.SIX))


@jit_lanes
def _find_larger(a, b):
    """The larger one, a NaN if there is one."""
    return a if b <= a else b


@jit_lanes
def fill_coupling_columns(plan, fixed, work, closing, lanes, closure, offset):
    """Set the columns [-] of a coupling and its squares, phi = sum gear q - offset [rad], [m]."""
    for k in range(lanes):
        put_vec(closing, layout.COUPLING_ROWS, k, (-offset, 0.0, 0.0))
    for j in range(closure.columns):
        column = layout.column_at(plan, closure.first + j)
        gear = fixed[column.signs]
        to = column.to
        place = column.axis
        rate = column.rate
        second = column.acceleration
        for k in range(lanes):
            work[to + k] = gear * gear
            work[to + layout.ENTRIES + k] = gear
            phi, phi1, phi2 = vec_of(closing, layout.COUPLING_ROWS, k)
            phi = phi + gear * work[place + k]
            phi1 = phi1 + gear * work[rate + k]
            put_vec(closing, layout.COUPLING_ROWS, k, (phi, phi1, phi2 + gear * work[second + k]))
    for k in range(lanes):
        phi, phi1, phi2 = vec_of(closing, layout.COUPLING_ROWS, k)
        put_vec(closing, layout.SQUARES, k, (phi * phi, phi1 * phi1, phi2 * phi2))


@jit_lanes
def _compute_row_sums(plan, work, k, closure, j):
    """|G| |qd|, |G| |qdd| of one row in one lane."""
    speed = size = 0.0
    for i in range(closure.columns):
        column = layout.column_at(plan, closure.first + i)
        g = abs(work[column.entry + j * closure.stride + k])
        speed += g * abs(work[column.rate + k])
        size += g * abs(work[column.acceleration + k])
    return speed, size


@jit_lanes
def _compute_position_sums(plan, work, k, closure, e):
    """The same of three positions together, or of the direction beside them whose vector stands at e."""
    speed = size = 0.0
    about = 1.0 if closure.directions > _ZERO else 0.0
    for j in range(closure.columns):
        one = layout.column_at(plan, closure.first + j)
        turns = 1.0 if one.kind == layout.TURNING else 0.0
        if e == _ZERO:
            g = math.sqrt(max(work[one.to + k] - turns * about, 0.0))
        else:
            g = turns * abs(dot(vec_of(work, e, k), vec_of(work, one.axis, k)))
        speed += g * abs(work[one.rate + k])
        size += g * abs(work[one.acceleration + k])
    return speed, size


@jit_lanes
def _compute_acceleration_size(state, k, length):
    """Estimate the size of an end's accelerations from the recursion, gravity among them."""
    w, al, a = read_state(state, k)
    return math.sqrt(dot(a, a)) + length * (math.sqrt(dot(al, al)) + dot(w, w))


@jit_lanes
def update_largest_squares(plan, fixed, work, lanes, closure, sums, in_space):
    """Remember the largest squares of every lane, and where asked for the largest sums of some lanes [any unit].

    Of three positions in space the square of phi' is that of d'.
    """
    limits = work[plan[layout.LIMITS] :]
    closing = work[closure.offset :]
    together = in_space and closure.kind == layout.WHOLE
    for k in range(lanes):
        a, b, c = vec_of(closing, layout.SQUARES, k)
        x, y, z = vec_of(limits, _ZERO, k)
        if together:
            d1 = vec_of(closing, layout.GAP_RATE, k)
            b += dot(d1, d1)
        put_vec(limits, _ZERO, k, (_find_larger(x, a), _find_larger(y, b), _find_larger(z, c)))
    if sums:
        largest = limits[layout.LARGEST :]
        length = fixed[_THREE]
        for some in range(SOME):
            _update_largest_sums(plan, work, (some * lanes) >> _TWO, closure, largest, length, together)


@jit_lanes
def _choose_pivot(scratch, one, other, lanes):
    """Make the larger of two entries the pivot; keep the factor by which the smaller one goes, whether they change places [-]."""
    for k in range(lanes):
        a = one[k]
        b = other[k]
        changed = abs(b) > abs(a)
        pivot, rest = (b, a) if changed else (a, b)
        one[k] = pivot + _NOTHING
        scratch[layout.FACTOR + k] = rest / pivot if pivot != 0.0 else 0.0
        scratch[layout.CHANGED + k] = 1.0 if changed else 0.0


@jit_lanes
def _update_entries(scratch, one, other, lanes):
    """Combine two other entries of these rows [any unit]."""
    for k in range(lanes):
        a = one[k]
        b = other[k]
        pivot, rest = (b, a) if scratch[layout.CHANGED + k] != 0.0 else (a, b)
        one[k] = pivot + _NOTHING
        other[k] = rest - scratch[layout.FACTOR + k] * pivot


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


@jit_lane
def _compute_scaled_difference(v, factor, w):
    """v - factor w of six numbers."""
    a = v[0] - factor * w[0]
    b = v[1] - factor * w[1]
    c = v[2] - factor * w[2]
    return a, b, c, v[3] - factor * w[3], v[4] - factor * w[4], v[5] - factor * w[5]


@jit_lane
def _compute_pivot_rows(one, other, last):
    """Two rows combined, the larger entry the pivot; the factor of the other one, and whether they changed places."""
    changed = abs(other[last]) > abs(one[last])
    one, other = (other, one) if changed else (one, other)
    factor = other[last] / one[last] if one[last] != 0.0 else 0.0
    return one, _compute_scaled_difference(other, factor, one), (factor, changed)


def _make_solver(before: Any) -> Any:
    """Return the solution of one row of six more than ``before``: multipliers, True if pivots are large enough.

    The first row is combined with all others; when these have theirs, the row operations are undone.
    """
    take, undo, solve = before

    @jit_lane
    def apply_elimination(one, rows, last):
        one, other, how = _compute_pivot_rows(one, rows[0], last)
        one, others, hows = take(one, rows[1:], last)
        return one, (other, *others), (how, *hows)

    @jit_lane
    def apply_back_transform(one, found, hows):
        one, others = undo(one, found[1:], hows[1:])
        factor, changed = hows[0]
        other = found[0]
        one -= factor * other
        one, other = (other, one) if changed else (one, other)
        return one, (other, *others)

    @jit_lane
    def solve_rows(rows, tau, least, last):
        one, others, hows = take(rows[0], rows[1:], last)
        multiplier = tau[last] / one[last]
        found, enough = solve(others, _compute_scaled_difference(tau, multiplier, one), least, last - 1)
        multiplier, found = undo(multiplier, found, hows)
        return (multiplier, *found), enough & (abs(one[last]) >= least[last])

    return apply_elimination, apply_back_transform, solve_rows


_SOLVING = (
    jit_lane(lambda one, rows, last: (one, (), ())),
    jit_lane(lambda one, found, hows: (one, ())),
    jit_lane(lambda rows, tau, least, last: ((), True)),
)
for _ in range(layout.SIX):
    _SOLVING = _make_solver(_SOLVING)
_six_solved = _SOLVING[2]


@jit_lane
def _read_six_rows(rows, first, k):
    """Lane k of six rows."""
    return vec_of(rows, first, k) + vec_of(rows, first + _THREE_ROWS, k)


@jit_lanes
def solve_six_forces(found, efforts, entries, lanes, least):
    """Set the multipliers [N] of six rows, which leave no efforts; return how often a pivot is below its ``least``."""
    doubts = 0
    for k in range(lanes):
        rows = (
            _read_six_rows(entries, _SIX[0], k), _read_six_rows(entries, _SIX[1], k), _read_six_rows(entries, _SIX[2], k),
            _read_six_rows(entries, _SIX[3], k), _read_six_rows(entries, _SIX[4], k), _read_six_rows(entries, _SIX[5], k),
        )  # fmt: skip
        multipliers, enough = _six_solved(rows, _read_six_rows(efforts, _SIX[0], k), least, layout.SIX - 1)
        put_vec(found, _SIX[0], k, multipliers[:3])
        put_vec(found, _THREE_ROWS, k, multipliers[3:])
        put_vec(efforts, _SIX[0], k, _NONE)
        put_vec(efforts, _THREE_ROWS, k, _NONE)
        doubts += 0 if enough else 1
    return doubts


@jit_lanes
def _update_largest_sums(plan, work, k, closure, largest, length, together):
    """The largest sums so far of all rows of a closure, and of how its ends accelerate, in one lane."""
    of_rows = closure.positions
    if closure.kind == layout.WHOLE:
        of_rows = _ONE if together else _TWO
    for j in range(of_rows + closure.directions):
        scale = length if j < of_rows and closure.kind != layout.COUPLED else 1.0
        if together:
            e = closure.offset + layout.VECTORS + (j - _ONE) * layout.VECTOR if j > _ZERO else _ZERO
            speed, size = _compute_position_sums(plan, work, k, closure, e)
        else:
            speed, size = _compute_row_sums(plan, work, k, closure, j)
        largest[0] = max(largest[0], scale * speed)
        largest[1] = max(largest[1], scale * size)
    if closure.state_a > _ZERO:
        one = _compute_acceleration_size(work[closure.state_a :], k, length)
        other = _compute_acceleration_size(work[closure.state_b :], k, length)
        largest[2] = max(largest[2], one + other)


@jit_lanes
def convert_efforts(plan, fixed, work, lanes):
    """Turn efforts of the cut tree into those of the drives [N m], [N]; return how often a rank is in doubt."""
    _write_zeros(plan, work, lanes)
    scratch = work[plan[layout.SCRATCH] :]
    at = plan[layout.STEPS]
    doubts = 0
    for _ in range(plan[layout.STEPS + 1]):
        if plan[at] == layout.ALL_SIX:
            doubts += _solve_free_body(plan, work, at, lanes)
        else:
            doubts += _begin_step(plan, work, scratch, at, lanes)
            _update_pairs(plan, fixed, work, scratch, at, lanes)
        at += _FIVE + _TWO * plan[at + _ONE]
    return doubts


@jit_lanes
def _write_zeros(plan, work, lanes):
    """Clear the entries that are zero at first."""
    for i in range(plan[layout.FILLS + 1]):
        empty = work[plan[plan[layout.FILLS] + i] :]
        for k in range(lanes):
            empty[k] = 0.0


@jit_lanes
def _count_small_pivots(pivot, size, lanes):
    """Count pivots that are too small beside their column's size."""
    count = 0
    for k in range(lanes):
        square = pivot[k] * pivot[k]
        count += 0 if (square >= LEAST_PART * size[k]) & (square >= LEAST_SQUARE) else 1
    return count


@jit_lanes
def _count_entries(entry, size, lanes):
    """Count entries of a row that should vanish and do not, beside their column's size."""
    count = 0
    for k in range(lanes):
        count += 0 if entry[k] * entry[k] <= REDUNDANT_ROW * REDUNDANT_ROW * size[k] else 1
    return count


@jit_lanes
def _solve_free_body(plan, work, at, lanes):
    """Solve for six forces on a free body; return how often a pivot is too small."""
    count = plan[at + _ONE]
    first = plan[at + _TWO]
    second = plan[at + _THREE]
    third = plan[at + _FOUR]
    limits = work[third + _SIX[1] :]  # sizes of the columns are constant
    for i in range(count):
        limits[i] = max(LEAST_PIVOT * math.sqrt(work[plan[at + _FIVE + _TWO * i]]), LEAST_ENTRY)
    few = limits[0], limits[1], limits[2], limits[3], limits[4], limits[5]
    return solve_six_forces(work[third:], work[second:], work[first:], lanes, few)


@jit_lanes
def _begin_step(plan, work, scratch, at, lanes):
    """Do the part of a step before its pairs; return how often a rank is in doubt."""
    kind = plan[at]
    one = work[plan[at + _TWO] :][:LANES]
    other = work[plan[at + _THREE] :][:LANES]
    if kind == layout.PAIR:
        _choose_pivot(scratch, one, other, lanes)
    elif kind == layout.SOLVE:
        size = work[plan[at + _FOUR] :][:LANES]
        return solve_row(scratch[:LANES], one, other, size, lanes, LEAST_PART, LEAST_SQUARE)
    elif kind == layout.CHECK_PIVOT:
        return _count_small_pivots(one, other, lanes)
    elif kind == layout.CHECK_EMPTY:
        return _count_entries(one, other, lanes)
    elif kind == layout.PROJECT:
        for k in range(lanes):  # the part along a row
            scratch[layout.LAMBDA + k] /= scratch[layout.SQUARE + k]
    return 0


@jit_lanes
def _update_pairs(plan, fixed, work, scratch, at, lanes):
    """Update the pairs of entries or efforts of the step at ``at``."""
    kind = plan[at]
    products = scratch[:LANES]
    if kind == layout.TAKE:
        products = work[plan[at + _FOUR] :][:LANES]
    elif kind == layout.NORM:
        products = scratch[layout.SQUARE :][:LANES]
    for i in range(plan[at + _ONE]):
        pair = at + _FIVE + _TWO * i
        one = work[plan[pair] :][:LANES]
        other = work[plan[pair + _ONE] :][:LANES]
        if kind == layout.PAIR:
            _update_entries(scratch, one, other, lanes)
        elif kind in (layout.NORM, layout.INNER):
            keep = 0.0 if i == 0 else 1.0
            weight = fixed[plan[at + _THREE] + i]
            for k in range(lanes):
                products[k] = keep * products[k] + weight * one[k] * other[k]
        else:  # the effort that a multiplier has along another coordinate
            for k in range(lanes):
                other[k] -= products[k] * one[k]


@jit_lanes
def is_unclear(plan, fixed, work, lanes):
    """Return True if the squares of a call, of all threads, are not clearly within the limits fixed[:3] [-] of the sums.

    What opens so slowly that `allocation` calls it still is within them; squares may have the length fixed[3] [m] in them.
    """
    speed = size = rounding = a = b = c = 0.0
    for i in range(work.shape[0]):
        limits = work[i, plan[layout.LIMITS] :]
        for k in range(lanes):
            a = _find_larger(a, limits[k])
            b = _find_larger(b, limits[LANES + k])
            c = _find_larger(c, limits[_TWO * LANES + k])
        largest = limits[layout.LARGEST :]
        speed = max(speed, largest[0])
        size = max(size, largest[1])
        rounding = max(rounding, ACCELERATION_ROUNDING * largest[2])
    still = min(fixed[_THREE], 1.0)
    most_rate = max(fixed[1] * speed, still * STILL_RATE)
    most_acceleration = max(fixed[2] * size, still * STILL_ACCELERATION) + rounding
    return not (a <= fixed[0] ** 2 and b <= most_rate**2 and c <= most_acceleration**2)
