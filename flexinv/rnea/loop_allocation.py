"""Closed loops, one sample a lane: limits of a motion, and the allocation of the cut tree's efforts to the drives by G.

With passive coordinates p and drives a,  tau_a + G_a^T lambda = tau_tree,a  and  G_p^T lambda = tau_tree,p.  Gaussian
elimination with pairwise pivoting (always the smaller row by the larger) brings G_p to upper triangular form; then lambda follows
coordinate by coordinate.  Rows left over have entries of drives only.  Such a row B is an internal preload of the drives: with as
many drives as freedoms it vanishes (it repeats other rows); else tau_a minimises tau_a^T W tau_a, and its components along the
rows B are removed one after the other.  Where no rows are left over, the entries of the drives stay as they are: the row
operations are then applied in reverse to the multipliers.

The order of the row operations is a list of *steps*, the same for every sample (`elimination_order`).  Where a pivot
is too small next to its column, or a row that should vanish does not, the block is left to `allocation`.

Limits: phi^2, phi'^2 and phi''^2, over their scales, summed over all rows of a closure.  They are compared with the sums
|G| |qd| and |G| |qdd| of some samples of a block; where that is inconclusive, `allocation` checks all samples.
"""

from __future__ import annotations

import math

import numpy as np

from flexinv.kernels.jit import jit_lanes
from flexinv.kernels.simd import LANES, put_vec, row, times, vec_of
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.recursion import ACCELERATION_ROW, SPIN, SPIN_RATE
from flexinv.rnea.row_pairs import both, combine, pair, six_forces, solve_row, together, undo

# A pivot over its column's size is at least this, so that its errors are 1e-12 at most; else singular values decide.
LEAST_PIVOT = 1e-4
# ... and at least this over the mechanism's length: a column that is rounding (an axis through the point that is closed, some
# 1e-16) may be none, and no size of its own says so; errors of the multiplier are 1e-10 at most.
LEAST_ENTRY = 1e-6
# What is left of a row that repeats others, over the size of its column: rounding over the smallest pivot.  Singular values would
# count it if it were above 1e-10.
MOST_LEFT = 1e-11
# Rounding of how the ends of a closure accelerate, with all before it and less gravity, over that: some tens of sums.
ROUNDED = 1e-14
# Samples of a block whose sums |G| |qd| are taken.
SOME = np.uint64(4)
_ZERO, _ONE, _TWO, _THREE, _FIVE = np.uint64(0), np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(5)
_COLUMN, _MOST, _OWN = row(4), row(layout.MOST_TOGETHER + 1), row(9)
_SIX, _SIX_ROWS = row(6), row(36)


@jit_lanes
def _more(a, b):
    """The larger one, a NaN if there is one."""
    return a if b <= a else b


@jit_lanes
def geared(to, lanes, gear):
    """Set the column of a coupling [-]."""
    for k in range(lanes):
        to[k], to[layout.ENTRIES + k] = gear * gear, gear


@jit_lanes
def coupled(plan, fixed, work, own, lanes, closure, offset):
    """Set the squares of a coupling, phi = sum gear q - offset [rad], [m]."""
    for k in range(lanes):
        put_vec(own, layout.GAP, k, (-offset, 0.0, 0.0))
    for j in range(closure.columns):
        column = layout.column_at(plan, closure.first + j * layout.COLUMN_CELLS)
        gear, place, rate, kept = fixed[column.signs], column.axis, column.rate, column.acceleration
        for k in range(lanes):
            phi, phi1, phi2 = vec_of(own, layout.GAP, k)
            phi, phi1 = phi + gear * work[place + k], phi1 + gear * work[rate + k]
            put_vec(own, layout.GAP, k, (phi, phi1, phi2 + gear * work[kept + k]))
    for k in range(lanes):
        phi, phi1, phi2 = vec_of(own, layout.GAP, k)
        put_vec(own, layout.SQUARES, k, (phi * phi, phi1 * phi1, phi2 * phi2))


@jit_lanes
def clear(plan, work, lanes):
    """Set the entries that are zero at first [-]."""
    for i in range(plan[layout.FILLS + 1]):
        empty = work[plan[plan[layout.FILLS] + i] :]
        for k in range(lanes):
            empty[k] = 0.0


@jit_lanes
def _sums(plan, work, k, closure, j):
    """|G| |qd|, |G| |qdd| of one row in one lane."""
    speed = size = 0.0
    for i in range(closure.columns):
        column = layout.column_at(plan, closure.first + i * layout.COLUMN_CELLS)
        g = abs(work[column.entry + j * closure.stride + k])
        speed += g * abs(work[column.rate + k])
        size += g * abs(work[column.acceleration + k])
    return speed, size


@jit_lanes
def _sums_of_sizes(plan, work, k, closure, e):
    """The same of three positions together, or of the direction beside them whose vector stands at e."""
    speed = size = 0.0
    about = 1.0 if closure.directions > _ZERO else 0.0
    for j in range(closure.sum_count):
        one = layout.sum_at(plan, closure.first_sum + j * layout.SUM_CELLS)
        turns, axis = float(one.turns), one.axis + k
        if e == _ZERO:
            g = math.sqrt(max(work[one.size + k] - turns * about, 0.0))
        else:
            v = work[e + k], work[e + LANES + k], work[e + _TWO * LANES + k]
            g = turns * abs(v[0] * work[axis] + v[1] * work[axis + LANES] + v[2] * work[axis + _TWO * LANES])
        speed += g * abs(work[one.rate + k])
        size += g * abs(work[one.acceleration + k])
    return speed, size


@jit_lanes
def _magnitude(work, first, k):
    x, y, z = work[first + k], work[first + LANES + k], work[first + _TWO * LANES + k]
    return math.sqrt(x * x + y * y + z * z)


@jit_lanes
def _acceleration(work, state, k, length):
    """About how large the accelerations of an end are that the recursion has found, gravity among them."""
    w = _magnitude(work, state + SPIN, k)
    return _magnitude(work, state + ACCELERATION_ROW, k) + length * (_magnitude(work, state + SPIN_RATE, k) + w * w)


@jit_lanes
def _hold_sums(plan, fixed, work, lanes, closure, limits):
    """Remember the largest sums of some lanes."""
    together, of_rows, length = closure.sum_count > _ZERO, closure.positions, fixed[_THREE]
    if closure.kind == layout.WHOLE:
        of_rows = _ONE if together else _TWO
    for some in range(SOME):
        k = (some * lanes) >> _TWO
        for j in range(of_rows + closure.directions):
            scale = length if j < of_rows and closure.kind != layout.COUPLED else 1.0
            if together:
                e = closure.own + layout.VECTORS + (j - _ONE) * layout.VECTOR if j > _ZERO else _ZERO
                speed, size = _sums_of_sizes(plan, work, k, closure, e)
            else:
                speed, size = _sums(plan, work, k, closure, j)
            limits[layout.LARGEST] = max(limits[layout.LARGEST], scale * speed)
            limits[layout.LARGEST + _ONE] = max(limits[layout.LARGEST + _ONE], scale * size)
        if closure.state_a > _ZERO:
            both = _acceleration(work, closure.state_a, k, length) + _acceleration(work, closure.state_b, k, length)
            limits[layout.LARGEST + _TWO] = max(limits[layout.LARGEST + _TWO], both)


@jit_lanes
def _most(limits, own, lanes):
    """Remember the largest squares of every lane."""
    for k in range(lanes):
        a, b, c = vec_of(own, layout.SQUARES, k)
        x, y, z = vec_of(limits, _ZERO, k)
        put_vec(limits, _ZERO, k, (_more(x, a), _more(y, b), _more(z, c)))


@jit_lanes
def _most_of_point(limits, own, lanes):
    """The same of three positions, the square of whose phi' is that of d'."""
    for k in range(lanes):
        (a, b, c), d1 = vec_of(own, layout.SQUARES, k), vec_of(own, layout.GAP_RATE, k)
        x, y, z = vec_of(limits, _ZERO, k)
        b += d1[0] * d1[0] + d1[1] * d1[1] + d1[2] * d1[2]
        put_vec(limits, _ZERO, k, (_more(x, a), _more(y, b), _more(z, c)))


@jit_lanes
def hold(plan, fixed, work, lanes, closure, sums, in_space):
    """Remember the largest squares of every lane, and where asked for the largest sums of some lanes [any unit]."""
    limits, own = work[plan[layout.LIMITS] : plan[layout.LIMITS] + _COLUMN], work[closure.own : closure.own + _OWN]
    if in_space and closure.kind == layout.WHOLE:
        _most_of_point(limits, own, lanes)
    else:
        _most(limits, own, lanes)
    if sums:
        _hold_sums(plan, fixed, work, lanes, closure, limits)


@jit_lanes
def _below(entry, size, lanes, part):
    """Count the entries whose square is below ``part`` of their column's, or next to nothing."""
    count = 0
    for k in range(lanes):
        square = entry[k] * entry[k]
        count += 0 if (square >= part * size[k]) & (square >= LEAST_ENTRY * LEAST_ENTRY) else 1
    return count


@jit_lanes
def _above(entry, size, lanes, part):
    """Count the entries whose square is above ``part`` of their column's."""
    count = 0
    for k in range(lanes):
        count += 0 if entry[k] * entry[k] <= part * size[k] else 1
    return count


@jit_lanes
def _take(multiplier, entry, effort, lanes):
    """Subtract the effort that a multiplier has along another coordinate."""
    for k in range(lanes):
        effort[k] -= multiplier[k] * entry[k]


@jit_lanes
def _multiply(scratch, to, one, other, lanes, weight, first):
    """Add weight one other to a sum, or begin it."""
    keep = 0.0 if first else 1.0
    for k in range(lanes):
        scratch[to + k] = keep * scratch[to + k] + weight * one[k] * other[k]


@jit_lanes
def _project(scratch, lanes):
    """The part along a row: the ratio of two sums."""
    for k in range(lanes):
        scratch[layout.LAMBDA + k] /= scratch[layout.SQUARE + k]


@jit_lanes
def _begin_step(kind, third, work, first, second, lanes):
    """Do the part of a step that comes before its pairs; return the number of samples in which a rank is in doubt."""
    one, other = work[first : first + LANES], work[second : second + LANES]
    if kind >= layout.TOGETHER:
        one, other = work[first : first + _MOST], work[second : second + _MOST]
        if kind >= layout.BOTH:
            both(kind - layout.BOTH, one, other, third, lanes)
        else:
            together(kind - layout.TOGETHER, third[: _TWO * LANES], one, other, lanes)
    elif kind == layout.PAIR:
        pair(third[: _TWO * LANES], one, other, lanes)
    elif kind == layout.UNDO:
        undo(third[: _TWO * LANES], one, other, lanes)
    elif kind == layout.CHECK_PIVOT:
        return _below(one, other, lanes, LEAST_PIVOT * LEAST_PIVOT)
    elif kind == layout.CHECK_EMPTY:
        return _above(one, other, lanes, MOST_LEFT * MOST_LEFT)
    elif kind == layout.PROJECT:
        _project(third, lanes)
    return 0


@jit_lanes
def _all_six(plan, work, at, first, second, third, lanes):
    """Six forces on a free body; sizes of the columns are constant."""
    size = (
        math.sqrt(work[plan[at]]), math.sqrt(work[plan[at + 2]]), math.sqrt(work[plan[at + 4]]),
        math.sqrt(work[plan[at + 6]]), math.sqrt(work[plan[at + 8]]), math.sqrt(work[plan[at + 10]]),
    )  # fmt: skip
    few = times(LEAST_PIVOT, size[:3]) + times(LEAST_PIVOT, size[3:])
    least = (
        max(few[0], LEAST_ENTRY), max(few[1], LEAST_ENTRY), max(few[2], LEAST_ENTRY),
        max(few[3], LEAST_ENTRY), max(few[4], LEAST_ENTRY), max(few[5], LEAST_ENTRY),
    )  # fmt: skip
    entries, efforts = work[first : first + _SIX_ROWS], work[second : second + _SIX]
    return six_forces(work[third : third + _SIX], efforts, entries, lanes, least)


@jit_lanes
def allocate(plan, fixed, work, lanes):
    """Turn efforts of the cut tree into those of the drives [N m], [N]; return how often a rank is in doubt."""
    scratch = work[plan[layout.SCRATCH] : plan[layout.SCRATCH] + _COLUMN]
    at, doubts = plan[layout.STEPS], 0
    for _ in range(plan[layout.STEPS + 1]):
        kind, count, first, second, third = plan[at], plan[at + _ONE], plan[at + _TWO], plan[at + _THREE], plan[at + 4]
        at += _FIVE
        own = work[third : third + _MOST]
        if kind == layout.ALL_SIX:
            doubts += _all_six(plan, work, at, first, second, third, lanes)
            at += _TWO * count
            continue
        if kind == layout.SOLVE:
            pivot, effort = work[first : first + LANES], work[second : second + LANES]
            part, least, size = LEAST_PIVOT * LEAST_PIVOT, LEAST_ENTRY * LEAST_ENTRY, work[plan[at] : plan[at] + LANES]
            doubts += solve_row(own[:LANES], pivot, effort, size, lanes, part, least)
            at, count = at + _TWO, count - _ONE
        else:
            doubts += _begin_step(kind, own, work, first, second, lanes)
        for i in range(count):
            one, other = plan[at], plan[at + _ONE]
            at += _TWO
            one, other = work[one : one + LANES], work[other : other + LANES]
            if kind == layout.PAIR:
                combine(own[: _TWO * LANES], one, other, lanes)
            elif kind in (layout.NORM, layout.INNER):
                _multiply(
                    scratch,
                    layout.SQUARE if kind == layout.NORM else layout.LAMBDA,
                    one,
                    other,
                    lanes,
                    fixed[second + i],
                    i == 0,
                )
            else:
                _take(own[:LANES], one, other, lanes)
    return doubts


@jit_lanes
def unclear(plan, fixed, work, lanes):
    """Return True if the squares of a call, of all threads, are not clearly within the limits fixed[:3] [-] of the sums."""
    speed = size = rounding = a = b = c = 0.0
    for i in range(work.shape[0]):
        own = work[i, plan[layout.LIMITS] :]
        for k in range(lanes):
            a, b, c = _more(a, own[k]), _more(b, own[LANES + k]), _more(c, own[_TWO * LANES + k])
        speed, size = max(speed, own[layout.LARGEST]), max(size, own[layout.LARGEST + _ONE])
        rounding = max(rounding, ROUNDED * own[layout.LARGEST + _TWO])
    return not (a <= fixed[0] ** 2 and b <= (fixed[1] * speed) ** 2 and c <= (fixed[2] * size + rounding) ** 2)
