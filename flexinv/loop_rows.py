"""Closed loops, one sample a lane: the matrix G of their rows, and the efforts of the cut tree shared out to the drives.

With passive coordinates p and drives a,  tau_a + G_a^T lambda = tau_tree,a  and  G_p^T lambda = tau_tree,p.  Rows are combined,
two and two and always the smaller by the larger, until G_p is upper triangular: then lambda follows coordinate by coordinate,
and what is left of rows beyond the passive coordinates has entries of drives only.  Such a row B is an effort that drives can
give against each other: none where there are as many drives as freedoms (the row vanishes, it repeats others); else tau_a is
that of least tau_a^T W tau_a, from which the parts along the rows B are taken one after the other.

Which rows are combined in which order is a list of *steps*, the same for every sample (`loop_steps`).  Where a pivot is too small
next to its column, or a row that should vanish does not, the block is left to `shares`.
"""

from __future__ import annotations

import numpy as np

from flexinv.compiled import jit_lanes
from flexinv.lanes import LANES, put_vec, row, times, vec_of
from flexinv.loop_lanes import (
    CHANGED,
    CLOSURE_CELLS,
    CLOSURES,
    COLUMN_CELLS,
    COLUMNS,
    COUPLED,
    FACTOR,
    FILLS,
    GEARED,
    LAMBDA,
    LARGEST,
    LIMITS,
    MOVED,
    POINT,
    SCRATCH,
    SQUARES,
    STEPS,
    TURNING,
    VECTOR,
    VECTORS,
    cross,
    dot,
    minus,
)

# A column: the square of its size, then its entries, row by row.
ENTRIES = row(1)
# Steps: a word for what is done, how many pairs of rows follow, and their offsets.
PAIR, SURE, EMPTY, SOLVE, NORM, INNER, PROJECT = range(7)
# A pivot over its column's size is at least this, so that its errors are 1e-12 at most; else singular values decide.
LEAST_PIVOT = 1e-4
# What is left of a row that repeats others, over the size of its column: rounding over the smallest pivot.  Singular values would
# count it if it were above 1e-10.
MOST_LEFT = 1e-11
# Samples of a block whose sums |G| |qd| are taken.
SOME = np.uint64(8)
_ZERO, _ONE, _TWO, _THREE = (np.uint64(i) for i in range(4))
_COLUMN, _VEC = row(4), np.uint64(0)


@jit_lanes
def _motion(to, axis, at, own, lanes, sign, turns, more):
    """What a unit rate of a joint moves the point of B by, z x (x_B - x) or z, and its square, to which comes that of turns."""
    if turns:
        for k in range(lanes):
            moved = times(sign, cross(vec_of(axis, _VEC, k), minus(vec_of(own, POINT, k), vec_of(at, _VEC, k))))
            put_vec(to, ENTRIES, k, moved)
            to[k] = dot(moved, moved) + more
    else:
        for k in range(lanes):
            moved = times(sign, vec_of(axis, _VEC, k))
            put_vec(to, ENTRIES, k, moved)
            to[k] = dot(moved, moved)


@jit_lanes
def _along(to, e, moved, lanes, sign):
    """Entry sign e . moved of one row."""
    for k in range(lanes):
        to[k] = sign * dot(vec_of(e, _VEC, k), vec_of(moved, _VEC, k))


@jit_lanes
def _column(work, scratch, lanes, column, signs):
    """Set the entries of one column."""
    kind, axis, place, own, to = column[0], column[1], column[2], column[3], column[4]
    positions, directions = column[5], column[6]
    whole, e, turns = positions == _ZERO, work[own + VECTORS :], kind == TURNING
    z, x = work[axis : axis + VECTOR], work[place : place + VECTOR]
    moved = work[to : to + _COLUMN] if whole else work[scratch : scratch + _COLUMN]
    _motion(moved, z, x, work[own : own + VECTOR], lanes, signs[0], turns, 1.0 if directions > _ZERO else 0.0)
    if not whole:
        size = work[to : to + LANES]
        for k in range(lanes):
            size[k] = moved[k]
    entry = to + ENTRIES + (VECTOR if whole else _ZERO)
    for j in range(positions):
        _along(work[entry : entry + LANES], e[j * VECTOR :], moved[ENTRIES:], lanes, 1.0)
        entry += LANES
    for j in range(positions, positions + directions):
        _along(work[entry : entry + LANES], e[j * VECTOR :], z, lanes, signs[1] if turns else 0.0)
        entry += LANES


@jit_lanes
def geared(to, lanes, gear):
    """Set the column of a coupling [-]."""
    for k in range(lanes):
        to[k], to[ENTRIES + k] = gear * gear, gear


@jit_lanes
def clear(plan, work, lanes):
    """Set the entries that are zero at first [-]."""
    for i in range(plan[FILLS + 1]):
        empty = work[plan[plan[FILLS] + i] :]
        for k in range(lanes):
            empty[k] = 0.0


@jit_lanes
def entries(plan, fixed, work, lanes):
    """Set G, column by column: positions over the mechanism's length [1/rad], [1/m], directions [-]."""
    scratch = plan[SCRATCH] + MOVED
    for i in range(plan[COLUMNS + 1]):
        at = plan[COLUMNS] + i * COLUMN_CELLS
        column = plan[at : at + COLUMN_CELLS]
        signs = fixed[column[9] : column[9] + _TWO]
        if column[0] == GEARED:
            geared(work[column[4] : column[4] + _COLUMN], lanes, signs[0])
        else:
            _column(work, scratch, lanes, column, signs)
    clear(plan, work, lanes)


@jit_lanes
def _sums(plan, work, k, closure, entry):
    """|G| |qd|, |G| |qdd| + |G qdd| of one row in one lane: phi'' - G qdd is - G qdd of a motion that keeps the closure."""
    speed = size = turning = 0.0
    for j in range(closure[8]):
        at = closure[7] + j * COLUMN_CELLS
        g = work[plan[at + np.uint64(4)] + entry + k]
        second = g * work[plan[at + np.uint64(8)] + k]
        speed += abs(g * work[plan[at + np.uint64(7)] + k])
        size += abs(second)
        turning += second
    return speed, size + abs(turning)


@jit_lanes
def hold(plan, fixed, work, lanes, sums):
    """Remember the largest squares of every lane, and where asked for the largest sums of some lanes [any unit]."""
    limits = work[plan[LIMITS] : plan[LIMITS] + _COLUMN]
    for i in range(plan[CLOSURES + 1]):
        at = plan[CLOSURES] + i * CLOSURE_CELLS
        closure = plan[at : at + CLOSURE_CELLS]
        squares = work[closure[1] + SQUARES : closure[1] + SQUARES + VECTOR]
        for k in range(lanes):
            for j in range(3):
                row_of = np.uint64(j) * LANES + k
                value = squares[row_of]
                limits[row_of] = limits[row_of] if value <= limits[row_of] else value  # a NaN is the largest
        whole = _THREE if closure[5] == _ZERO else closure[5]
        for j in range(whole + closure[6] if sums else _ZERO):
            scale = fixed[_THREE] if j < whole and closure[0] != COUPLED else 1.0
            for some in range(SOME):
                speed, size = _sums(plan, work, (some * lanes) >> _THREE, closure, ENTRIES + j * LANES)
                limits[LARGEST] = max(limits[LARGEST], scale * speed)
                limits[LARGEST + _ONE] = max(limits[LARGEST + _ONE], scale * size)


@jit_lanes
def _pair(scratch, one, other, lanes):
    """The larger of two entries is the pivot: the factor by which the smaller one goes, and whether they change places."""
    for k in range(lanes):
        a, b = one[k], other[k]
        changed = abs(b) > abs(a)
        pivot, rest = (b, a) if changed else (a, b)
        one[k] = pivot
        scratch[FACTOR + k] = rest / pivot if pivot != 0.0 else 0.0
        scratch[CHANGED + k] = 1.0 if changed else 0.0


@jit_lanes
def _combine(scratch, one, other, lanes):
    """The same of two other entries of these rows."""
    for k in range(lanes):
        a, b = one[k], other[k]
        changed = scratch[CHANGED + k] != 0.0
        pivot, rest = (b, a) if changed else (a, b)
        one[k], other[k] = pivot, rest - scratch[FACTOR + k] * pivot


@jit_lanes
def _below(entry, size, lanes, part):
    """How many entries are not at least so large a part of their column's size."""
    count = 0
    for k in range(lanes):
        count += 0 if entry[k] * entry[k] >= part * size[k] else 1
    return count


@jit_lanes
def _above(entry, size, lanes, part):
    """How many entries are not at most so large a part of their column's size."""
    count = 0
    for k in range(lanes):
        count += 0 if entry[k] * entry[k] <= part * size[k] else 1
    return count


@jit_lanes
def _solve(scratch, pivot, effort, lanes):
    """One multiplier more; its coordinate has no effort left."""
    for k in range(lanes):
        scratch[LAMBDA + k] = effort[k] / pivot[k]
        effort[k] = 0.0


@jit_lanes
def _take(scratch, entry, effort, lanes):
    """What that multiplier does for another coordinate."""
    for k in range(lanes):
        effort[k] -= scratch[LAMBDA + k] * entry[k]


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
        scratch[LAMBDA + k] /= scratch[FACTOR + k]


@jit_lanes
def _begin_step(kind, scratch, one, other, lanes):
    """What a step does before its pairs; return how often a rank is in doubt."""
    if kind == PAIR:
        _pair(scratch, one, other, lanes)
    elif kind == SOLVE:
        _solve(scratch, one, other, lanes)
    elif kind == SURE:
        return _below(one, other, lanes, LEAST_PIVOT * LEAST_PIVOT)
    elif kind == EMPTY:
        return _above(one, other, lanes, MOST_LEFT * MOST_LEFT)
    elif kind == PROJECT:
        _project(scratch, lanes)
    return 0


@jit_lanes
def share(plan, fixed, work, lanes):
    """Turn efforts of the cut tree into those of the drives [N m], [N]; return how often a rank is in doubt."""
    scratch = work[plan[SCRATCH] : plan[SCRATCH] + _COLUMN]
    at, doubts = plan[STEPS], 0
    for _ in range(plan[STEPS + 1]):
        kind, count, first, second = plan[at], plan[at + _ONE], plan[at + _TWO], plan[at + _THREE]
        at += np.uint64(4)
        doubts += _begin_step(kind, scratch, work[first : first + LANES], work[second : second + LANES], lanes)
        for i in range(count):
            one, other = plan[at], plan[at + _ONE]
            at += _TWO
            one, other = work[one : one + LANES], work[other : other + LANES]
            if kind == PAIR:
                _combine(scratch, one, other, lanes)
            elif kind in (NORM, INNER):
                _multiply(scratch, FACTOR if kind == NORM else LAMBDA, one, other, lanes, fixed[second + i], i == 0)
            else:
                _take(scratch, one, other, lanes)
    return doubts


@jit_lanes
def unclear(plan, fixed, work, lanes):
    """Return whether the squares of a call are not clearly within the limits fixed[:3] [-] of the sums, of all threads."""
    speed = size = a = b = c = 0.0
    for i in range(work.shape[0]):
        own = work[i, plan[LIMITS] :]
        for k in range(lanes):
            a, b, c = _more(a, own[k]), _more(b, own[LANES + k]), _more(c, own[_TWO * LANES + k])
        speed, size = max(speed, own[LARGEST]), max(size, own[LARGEST + _ONE])
    return not (a <= fixed[0] ** 2 and b <= (fixed[1] * speed) ** 2 and c <= (fixed[2] * size) ** 2)


@jit_lanes
def _more(a, b):
    """The larger one, a NaN if there is one."""
    return a if b <= a else b
