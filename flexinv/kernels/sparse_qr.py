"""QR of sparse matrices in kernels, front by front over a trailing lane axis, by Householder reflections (compiled).

The columns are put in an order of least fill once (`fronts_of`).  A front takes rows in which its columns stand first, and what
the fronts before it have left of theirs; it eliminates its columns, brings the rest to a triangle, and passes that on
(multifrontal QR, T. A. Davis, Direct Methods for Sparse Linear Systems, SIAM 2006).  The cost of a chain of loops is linear.

A column of which the ones before it leave nothing depends on them: it is free, and R has no row for it.
A matrix with entries everywhere is one front.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexinv.kernels.fronts import Fronts
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.typing import Array, Indices

# What is left of a column over the longest column: above SURE_PIVOT it counts, below NO_PIVOT it repeats others (rounding of
# 1e-16 in some tens of columns); between them singular values decide, whose own limit, 1e-10, lies well inside.
SURE_PIVOT = 1e-7
NO_PIVOT = 1e-13


@send_by_address
class FrontFactors(NamedTuple):
    """Q R of one sparse matrix in each lane; lanes share which columns are free.

    values : (values, lanes) of all fronts, column by column: the matrix, then reflections and R
    sizes : (columns, lanes) squares of the columns of the matrix; scale : (lanes,) one over the square of the longest
    beta, diagonal : (columns of fronts, lanes) of the reflections and of R; pivot : (columns of fronts,) row of each, or -1
    top : (fronts,) rows of R; line : (rows of fronts, lanes), sums : (lanes,) scratch
    """

    values: Array
    sizes: Array
    scale: Array
    beta: Array
    diagonal: Array
    pivot: Indices
    top: Indices
    line: Array
    sums: Array

    @classmethod
    def build_for(cls, fronts: Fronts, lanes: int = 1) -> FrontFactors:
        """Return arrays for matrices with these fronts [-]."""
        columns = len(fronts.column)
        beta, diagonal = np.zeros((2, columns, lanes))
        scale, sums = np.zeros((2, lanes))
        return cls(
            np.zeros((int(fronts.start[-1]), lanes)), np.zeros((fronts.columns, lanes)), scale, beta, diagonal,
            np.zeros(columns, dtype=np.int64), np.zeros(len(fronts.parent), dtype=np.int64),
            np.zeros((int(fronts.begin[-1]), lanes)), sums,
        )  # fmt: skip


@jit_inner
def fill_zeros(qr):
    """Make the matrix zero [any unit]."""
    qr.values[:] = 0.0
    qr.sizes[:] = 0.0


@jit_inner
def write_entry(fronts, qr, e, lane, value):
    """Set entry number ``e`` of `Fronts.entry` [any unit], once after `fill_zeros`."""
    qr.values[fronts.entry[e, 2], lane] = value
    qr.sizes[fronts.entry[e, 1], lane] += value * value


@jit_inner
def factorise_qr(fronts, qr):
    """Factor Q R in place [any unit]; return the rank, -1 where it is in doubt."""
    rank = 0
    for k in range(qr.scale.shape[0]):
        longest = 0.0
        for c in range(qr.sizes.shape[0]):
            longest = max(longest, qr.sizes[c, k])
        qr.scale[k] = 1.0 / longest if longest > 0.0 else 0.0
    for f in range(fronts.parent.shape[0]):
        if not _factorise_front(fronts, qr, f):
            return -1
        rank += qr.top[f]
        if fronts.parent[f] >= 0:
            _copy_to_parent(fronts, qr, f)
    return rank


@jit_inner
def _factorise_front(fronts, qr, f):
    """Eliminate the own columns of a front, and bring the others to a triangle where they are fewer than its rows left."""
    first = fronts.first[f]
    pivots = fronts.pivots[f]
    rows = fronts.begin[f + 1] - fronts.begin[f]
    width = fronts.first[f + 1] - first
    top = 0
    tall = True
    for c in range(width):
        at = first + c
        qr.pivot[at] = -1
        if c == pivots:
            qr.top[f] = top
            tall = rows - top > width - pivots
        if not tall:
            continue
        place = _find_first_value(fronts, f, c)
        column = qr.values[place : place + rows]
        _compute_squares(column, top, qr.sums)
        if c < pivots:
            independence = _judge_independence(qr.sums, qr.scale)
            if independence < 0:
                return False
            if independence == 0:
                continue
        _compute_reflection(column, top, qr.sums, qr.beta[at], qr.diagonal[at])
        qr.pivot[at] = top
        for d in range(c + 1, width):
            place = _find_first_value(fronts, f, d)
            _reflect(qr.values[place : place + rows], column, qr.beta[at], top, qr.sums)
        top += 1
    if width == pivots:
        qr.top[f] = top
    return True


@jit_inner
def _compute_squares(column, top, squares):
    """Set the squares of a column (rows, lanes) from row ``top`` on."""
    squares[:] = 0.0
    for i in range(top, column.shape[0]):
        for k in range(squares.shape[0]):
            squares[k] += column[i, k] * column[i, k]


@jit_inner
def _judge_independence(squares, scale):
    """1 where a column is independent in all lanes, 0 where it is in none, -1 in doubt; from the squares of what is left."""
    least = np.inf
    most = 0.0
    for k in range(scale.shape[0]):
        part = squares[k] * scale[k]
        if part < least or part != part:  # a NaN stays
            least = part
        if part > most or part != part:
            most = part
    if least > SURE_PIVOT * SURE_PIVOT:
        return 1
    return 0 if most <= NO_PIVOT * NO_PIVOT else -1


@jit_inner
def _compute_reflection(column, top, squares, beta, diagonal):
    """Turn a column (rows, lanes) into its reflection from row ``top`` on; a lane that is zero stays as it is."""
    for k in range(squares.shape[0]):
        norm = math.sqrt(squares[k])
        head = column[top, k]
        diagonal[k] = -math.copysign(norm, head)
        beta[k] = 1.0 / (norm * (norm + abs(head))) if norm > 0.0 else 0.0
        column[top, k] = head - diagonal[k]


@jit_inner
def _find_first_value(fronts, f, c):
    """Place of the first value of column c of a front."""
    return fronts.start[f] + c * (fronts.begin[f + 1] - fronts.begin[f])


@jit_inner
def _reflect(y, v, beta, top, sums):
    """y - beta v (v . y) from row ``top`` on."""
    lanes = sums.shape[0]
    if lanes == 1:
        shared = 0.0
        for i in range(top, y.shape[0]):
            shared += v[i, 0] * y[i, 0]
        shared *= beta[0]
        for i in range(top, y.shape[0]):
            y[i, 0] -= shared * v[i, 0]
        return
    for k in range(lanes):
        sums[k] = 0.0
    for i in range(top, y.shape[0]):
        for k in range(lanes):
            sums[k] += v[i, k] * y[i, k]
    for k in range(lanes):
        sums[k] *= beta[k]
    for i in range(top, y.shape[0]):
        for k in range(lanes):
            y[i, k] -= sums[k] * v[i, k]


@jit_inner
def _count_remaining_rows(fronts, qr, f):
    """Number of rows that a front passes on."""
    width = fronts.first[f + 1] - fronts.first[f]
    rows = fronts.begin[f + 1] - fronts.begin[f]
    return min(rows - qr.top[f], width - fronts.pivots[f])


@jit_inner
def _copy_to_parent(fronts, qr, f):
    """Copy what a front has left to the front that takes it."""
    first = fronts.first[f]
    parent = fronts.parent[f]
    top = qr.top[f]
    for d in range(fronts.pivots[f], fronts.first[f + 1] - first):
        pivot = qr.pivot[first + d]
        front = qr.values[_find_first_value(fronts, f, d) :]
        to = qr.values[_find_first_value(fronts, parent, fronts.place[first + d]) + fronts.base[f] :]
        for r in range(_count_remaining_rows(fronts, qr, f)):
            for k in range(qr.scale.shape[0]):
                if pivot < 0 or top + r < pivot:
                    to[r, k] = front[top + r, k]
                else:
                    to[r, k] = qr.diagonal[first + d, k] if top + r == pivot else 0.0


@jit_inner
def solve_least_squares(fronts, qr, y, x):
    """Set x (columns, lanes) to R^-1 Q^T y of y (rows, lanes), zero at columns that are free [any unit]."""
    lanes = qr.scale.shape[0]
    for i in range(qr.line.shape[0]):
        for k in range(lanes):
            qr.line[i, k] = y[fronts.source[i], k] if fronts.source[i] >= 0 else 0.0
    for f in range(fronts.parent.shape[0]):
        first = fronts.first[f]
        part = qr.line[fronts.begin[f] : fronts.begin[f + 1]]
        for c in range(fronts.first[f + 1] - first):
            pivot = qr.pivot[first + c]
            if pivot >= 0:
                _reflect(part, qr.values[_find_first_value(fronts, f, c) :], qr.beta[first + c], pivot, qr.sums)
            if c < fronts.pivots[f]:
                for k in range(lanes):
                    x[fronts.column[first + c], k] = part[pivot, k] if pivot >= 0 else 0.0
        if fronts.parent[f] >= 0:
            to = qr.line[fronts.begin[fronts.parent[f]] + fronts.base[f] :]
            for r in range(_count_remaining_rows(fronts, qr, f)):
                for k in range(lanes):
                    to[r, k] = part[qr.top[f] + r, k]
    solve_upper(fronts, qr, x)


@jit_inner
def solve_least_norm(fronts, qr, x, y):
    """Set y (rows, lanes) to Q R^-T x of x (columns, lanes), of which free columns do not count [any unit]; x is overwritten."""
    solve_lower(fronts, qr, x)
    lanes = qr.scale.shape[0]
    for f in range(fronts.parent.shape[0] - 1, -1, -1):
        first = fronts.first[f]
        part = qr.line[fronts.begin[f] : fronts.begin[f + 1]]
        part[:] = 0.0
        for c in range(fronts.pivots[f]):
            if qr.pivot[first + c] >= 0:
                for k in range(lanes):
                    part[qr.pivot[first + c], k] = x[fronts.column[first + c], k]
        if fronts.parent[f] >= 0:
            to = qr.line[fronts.begin[fronts.parent[f]] + fronts.base[f] :]
            for r in range(_count_remaining_rows(fronts, qr, f)):
                for k in range(lanes):
                    part[qr.top[f] + r, k] = to[r, k]
        for c in range(fronts.first[f + 1] - first - 1, -1, -1):
            if qr.pivot[first + c] >= 0:
                _reflect(
                    part, qr.values[_find_first_value(fronts, f, c) :], qr.beta[first + c], qr.pivot[first + c], qr.sums
                )
        for i in range(part.shape[0]):
            source = fronts.source[fronts.begin[f] + i]
            if source >= 0:
                for k in range(lanes):
                    y[source, k] = part[i, k]


@jit_inner
def turn_beside(fronts, qr, number, y):
    """Set y (rows, lanes) to Q e of a unit vector e behind the columns [-]: a matrix of one front does not reach it."""
    y[:] = 0.0
    y[qr.top[0] + number] = 1.0
    for c in range(fronts.pivots[0] - 1, -1, -1):
        if qr.pivot[c] >= 0:
            _reflect(y, qr.values[_find_first_value(fronts, 0, c) :], qr.beta[c], qr.pivot[c], qr.sums)


@jit_inner
def solve_upper(fronts, qr, x):
    """Solve R z = x in place of x (columns, lanes) [any unit], for what stands at free columns, which stays."""
    for f in range(fronts.parent.shape[0] - 1, -1, -1):
        first = fronts.first[f]
        for c in range(fronts.pivots[f] - 1, -1, -1):
            pivot = qr.pivot[first + c]
            unknown = fronts.column[first + c]
            if pivot < 0:
                continue
            for d in range(c + 1, fronts.first[f + 1] - first):
                row = qr.values[_find_first_value(fronts, f, d) + pivot]
                other = fronts.column[first + d]
                for k in range(x.shape[1]):
                    x[unknown, k] -= row[k] * x[other, k]
            for k in range(x.shape[1]):
                x[unknown, k] /= qr.diagonal[first + c, k]


@jit_inner
def solve_lower(fronts, qr, x):
    """Solve R^T z = x in place of x (columns, lanes) [any unit]; what is left at free columns means nothing."""
    for f in range(fronts.parent.shape[0]):
        first = fronts.first[f]
        for c in range(fronts.pivots[f]):
            pivot = qr.pivot[first + c]
            unknown = fronts.column[first + c]
            if pivot < 0:
                continue
            for k in range(x.shape[1]):
                x[unknown, k] /= qr.diagonal[first + c, k]
            for d in range(c + 1, fronts.first[f + 1] - first):
                row = qr.values[_find_first_value(fronts, f, d) + pivot]
                other = fronts.column[first + d]
                for k in range(x.shape[1]):
                    x[other, k] -= row[k] * x[unknown, k]


NORM_STEPS = 5  # of the estimate of a norm: it seldom changes after the second


@jit_inner
def compute_condition_estimate(fronts, qr, x, sign):
    """Return an estimate of one matrix's condition number [-], full in rank: seldom below it, at most columns^1.5 times it.

    sqrt(columns) |R|_F |R^-1|_1, the last by Hager's method (N. J. Higham, ACM Trans. Math. Softw. 14, 1988, 381-396), whose
    estimates are bounds from below, seldom by more than a factor of three.  x, sign : (columns, 1) scratch
    """
    columns = x.shape[0]
    size = 0.0
    norm = 0.0
    if columns == 0:
        return 0.0
    for f in range(fronts.parent.shape[0]):
        first = fronts.first[f]
        for c in range(fronts.pivots[f]):
            size += qr.diagonal[first + c, 0] ** 2
            for d in range(c + 1, fronts.first[f + 1] - first):
                size += qr.values[_find_first_value(fronts, f, d) + qr.pivot[first + c], 0] ** 2
    x[:] = 1.0 / columns
    last = -1
    for _ in range(NORM_STEPS):
        solve_upper(fronts, qr, x)
        norm = max(norm, _compute_magnitude_sum(x))
        for i in range(columns):
            sign[i, 0] = math.copysign(1.0, x[i, 0])
        solve_lower(fronts, qr, sign)
        largest = 0
        for i in range(columns):
            if abs(sign[i, 0]) > abs(sign[largest, 0]):
                largest = i
        if largest == last:
            break
        last = largest
        x[:] = 0.0
        x[largest, 0] = 1.0
    for i in range(columns):  # signs that alternate find what the steps may miss
        x[i, 0] = (1.0 + i / max(columns - 1, 1)) * (1.0 if i % 2 == 0 else -1.0)
    solve_upper(fronts, qr, x)
    norm = max(norm, 2.0 * _compute_magnitude_sum(x) / (3.0 * columns))
    return math.sqrt(columns * size) * norm


@jit_inner
def _compute_magnitude_sum(x):
    total = 0.0
    for i in range(x.shape[0]):
        total += abs(x[i, 0])
    return total
