"""Pivoted QR of kernels, by Householder reflections over a trailing lane axis (compiled).

Matrices are small, and what is written here overwrites what it is handed.  In one lane a reflection keeps to the rows of its
column: most columns of a chain of loops share none with it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import by_address
from flexinv.typing import Array

# Pivots over the longest column: above SURE one counts, below NONE it repeats others (rounding of 1e-16 in some tens of
# columns); between them singular values decide, whose own limit, 1e-10, lies well inside.
SURE_PIVOT, NO_PIVOT = 1e-7, 1e-13


@by_address
class Factor(NamedTuple):
    """Q R of one matrix in each lane, by Householder reflections; lanes share pivots and rank.

    a : (columns, rows, lanes) the columns of the matrices, then reflections and R
    beta, diagonal, sizes : (columns, lanes) of the reflections, of R, squares of what is left of each column
    scale, sums : (lanes,) one over the square of the longest column, scratch; order : (columns,) of the pivots
    rows : (columns,) the rows that are exchanged with those of the pivots' places before each reflection
    ends : (columns, 2) in one lane, below the pivots' places, the first row that is not zero, and the one after the last
    """

    a: Array
    beta: Array
    diagonal: Array
    sizes: Array
    scale: Array
    sums: Array
    order: NDArray[np.int64]
    rows: NDArray[np.int64]
    ends: NDArray[np.int64]

    @classmethod
    def of(cls, columns: int, rows: int, lanes: int = 1) -> Factor:
        """Return arrays for matrices (rows, columns) [-]."""
        beta, diagonal, sizes = np.zeros((3, columns, lanes))
        scale, sums = np.zeros((2, lanes))
        order, places = np.zeros((2, columns), dtype=np.int64)
        ends = np.zeros((columns, 2), dtype=np.int64)
        return cls(np.zeros((columns, rows, lanes)), beta, diagonal, sizes, scale, sums, order, places, ends)


@jit_inner
def factorise(qr, columns):
    """Factor Q R of the first columns with pivoting, in place [any unit]; return the rank, -1 where it is in doubt.

    In one lane the largest entry of a pivot comes to its diagonal: a reflection then fills no rows but those of its column, and
    leaves alone the columns that share none with it, as most of a chain of loops do.
    """
    lanes = qr.scale.shape[0]
    for k in range(lanes):
        qr.scale[k] = 0.0
    for c in range(columns):
        qr.order[c] = c
        _measure(qr.a[c], qr.sizes[c])
        if lanes == 1:
            _find_ends(qr.a[c], qr.ends[c])
        for k in range(lanes):
            qr.scale[k] = max(qr.scale[k], qr.sizes[c, k])
    for k in range(lanes):
        qr.scale[k] = 1.0 / qr.scale[k] if qr.scale[k] > 0.0 else 0.0
    for j in range(columns):
        counts = _pivot(qr, j, columns)
        if counts < 1:
            return j if counts == 0 else -1
        own = qr.order[j]
        qr.rows[j] = _largest_row(qr.a[own], j, qr.ends[own]) if lanes == 1 else j
        for c in range(j, columns):
            _bring_up(qr.a[qr.order[c]], j, qr.rows[j], qr.ends[qr.order[c]])
        for k in range(lanes):
            norm, first = math.sqrt(qr.sizes[own, k]), qr.a[own, j, k]
            qr.diagonal[j, k] = -math.copysign(norm, first)
            qr.beta[j, k] = 1.0 / (norm * (norm + abs(first)))
            qr.a[own, j, k] = first - qr.diagonal[j, k]
        for c in range(j + 1, columns):
            other = qr.order[c]
            if lanes == 1:
                _reflect_one(qr.a[other], qr, j, qr.sizes[other], qr.ends[other])
            else:
                _reflect(qr.a[other], qr, j, qr.sizes[other])
    return columns


@jit_inner
def _find_ends(y, ends):
    """Set the first row of a column (rows, 1) that is not zero, and the one after the last."""
    ends[0], ends[1] = y.shape[0], 0
    for i in range(y.shape[0]):
        if y[i, 0] != 0.0:
            ends[0], ends[1] = min(ends[0], i), i + 1


@jit_inner
def _largest_row(y, j, ends):
    """Row of the largest entry of a column (rows, 1) from entry j on."""
    at = j
    for i in range(max(j + 1, ends[0]), ends[1]):
        if abs(y[i, 0]) > abs(y[at, 0]):
            at = i
    return at


@jit_inner
def _bring_up(y, j, i, ends):
    """Exchange the rows i and j of a column, and let its ends hold what has come to row i."""
    if i != j:
        if y.shape[1] == 1 and y[j, 0] != 0.0:
            ends[0], ends[1] = min(ends[0], i), max(ends[1], i + 1)
        _exchange_rows(y, i, j)


@jit_inner
def _exchange_rows(y, i, j):
    if i != j:
        for k in range(y.shape[1]):
            y[i, k], y[j, k] = y[j, k], y[i, k]


@jit_inner
def _measure(y, size):
    """Set the squares of a column."""
    for k in range(y.shape[1]):
        size[k] = 0.0
    for i in range(y.shape[0]):
        for k in range(y.shape[1]):
            size[k] += y[i, k] * y[i, k]


@jit_inner
def _pivot(qr, j, columns):
    """Bring the column with the most left, in its worst lane, to place j: 1 where it counts, 0 where none does, -1 in doubt."""
    best, at, most = -1.0, j, 0.0
    for c in range(j, columns):
        least = np.inf
        for k in range(qr.scale.shape[0]):
            part = qr.sizes[qr.order[c], k] * qr.scale[k]
            if part < least or part != part:  # a NaN stays
                least = part
            if part > most or part != part:
                most = part
        if least > best:
            best, at = least, c
    qr.order[j], qr.order[at] = qr.order[at], qr.order[j]
    if best > SURE_PIVOT * SURE_PIVOT:
        return 1
    return 0 if most <= NO_PIVOT * NO_PIVOT else -1


@jit_inner
def _reflect(y, qr, j, size):
    """y - beta v (v . y) from entry j on, reflection j; set the squares of what then follows entry j."""
    v, beta, sums, lanes = qr.a[qr.order[j]], qr.beta[j], qr.sums, y.shape[1]
    if lanes == 1:
        own = qr.order[j]
        _reflect_rows(y, qr, j, max(qr.ends[own, 0], j + 1), qr.ends[own, 1])
        return
    for k in range(lanes):
        sums[k] = 0.0
    for i in range(j, y.shape[0]):
        for k in range(lanes):
            sums[k] += v[i, k] * y[i, k]
    for k in range(lanes):
        sums[k] *= beta[k]
        size[k] = 0.0
        y[j, k] -= sums[k] * v[j, k]
    for i in range(j + 1, y.shape[0]):
        for k in range(lanes):
            y[i, k] -= sums[k] * v[i, k]
            size[k] += y[i, k] * y[i, k]


@jit_inner
def _reflect_one(y, qr, j, size, ends):
    """Reflect a column (rows, 1) of the matrix, which ends where ``ends`` says; one that shares no row stays as it is."""
    own = qr.order[j]
    first, last = max(qr.ends[own, 0], j + 1), qr.ends[own, 1]
    shared = _reflect_rows(y, qr, j, max(first, ends[0]), min(last, ends[1]))
    if shared != 0.0 and first < last:
        ends[0], ends[1] = min(ends[0], first), max(ends[1], last)
    if shared != 0.0 or y[j, 0] != 0.0:
        size[0] = 0.0
        for i in range(max(ends[0], j + 1), ends[1]):
            size[0] += y[i, 0] * y[i, 0]


@jit_inner
def _reflect_rows(y, qr, j, start, end):
    """Reflect a column (rows, 1) that shares the rows from ``start`` to before ``end``, beside j; return beta v . y."""
    own = qr.order[j]
    v, shared = qr.a[own], qr.a[own, j, 0] * y[j, 0]
    for i in range(start, end):
        shared += v[i, 0] * y[i, 0]
    shared *= qr.beta[j, 0]
    if shared != 0.0:
        y[j, 0] -= shared * v[j, 0]
        for i in range(max(qr.ends[own, 0], j + 1), qr.ends[own, 1]):
            y[i, 0] -= shared * v[i, 0]
    return shared


@jit_inner
def turn(qr, rank, y):
    """Replace y (rows, lanes) by Q y [any unit]."""
    for j in range(rank - 1, -1, -1):
        _reflect(y, qr, j, qr.sizes[qr.order[j]])
        _exchange_rows(y, j, qr.rows[j])


@jit_inner
def turn_back(qr, rank, y):
    """Replace y (rows, lanes) by Q^T y [any unit]."""
    for j in range(rank):
        _exchange_rows(y, j, qr.rows[j])
        _reflect(y, qr, j, qr.sizes[qr.order[j]])


@jit_inner
def solve_upper(qr, rank, y):
    """Solve R z = y (rows, lanes) in place of y [any unit]; z is in the order of the pivots."""
    for j in range(rank - 1, -1, -1):
        for k in range(y.shape[1]):
            y[j, k] /= qr.diagonal[j, k]
        for i in range(j):
            for k in range(y.shape[1]):
                y[i, k] -= qr.a[qr.order[j], i, k] * y[j, k]


@jit_inner
def solve_lower(qr, rank, y):
    """Solve R^T z = y (rows, lanes) in place of y [any unit]; y is in the order of the pivots."""
    for j in range(rank):
        for i in range(j):
            for k in range(y.shape[1]):
                y[j, k] -= qr.a[qr.order[j], i, k] * y[i, k]
        for k in range(y.shape[1]):
            y[j, k] /= qr.diagonal[j, k]
