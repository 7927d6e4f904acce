"""Pivoted QR of kernels, by Householder reflections over a trailing lane axis (compiled); a sparse one is `kernels.sparse_qr`.

Matrices are small, and what is written here overwrites what it is handed.
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
    """

    a: Array
    beta: Array
    diagonal: Array
    sizes: Array
    scale: Array
    sums: Array
    order: NDArray[np.int64]

    @classmethod
    def of(cls, columns: int, rows: int, lanes: int = 1) -> Factor:
        """Return arrays for matrices (rows, columns) [-]."""
        beta, diagonal, sizes = np.zeros((3, columns, lanes))
        scale, sums = np.zeros((2, lanes))
        order = np.zeros(columns, dtype=np.int64)
        return cls(np.zeros((columns, rows, lanes)), beta, diagonal, sizes, scale, sums, order)


@jit_inner
def factorise(qr, columns):
    """Factor Q R of the first columns with pivoting, in place [any unit]; return the rank, -1 where it is in doubt."""
    for c in range(columns):
        qr.order[c] = c
        measure(qr.a[c], 0, qr.sizes[c])
    set_scale(qr.sizes, columns, qr.scale)
    for j in range(columns):
        found = _pivot(qr, j, columns)
        if found < 1:
            return j if found == 0 else -1
        own = qr.order[j]
        set_reflection(qr.a[own], j, qr.sizes[own], qr.beta[j], qr.diagonal[j])
        for c in range(j + 1, columns):
            _reflect(qr.a[qr.order[c]], qr, j, qr.sizes[qr.order[c]])
    return columns


@jit_inner
def set_scale(sizes, columns, scale):
    """Set one over the largest of the first squares of columns, 0 where all are zero [any unit]."""
    for k in range(scale.shape[0]):
        scale[k] = 0.0
    for c in range(columns):
        for k in range(scale.shape[0]):
            scale[k] = max(scale[k], sizes[c, k])
    for k in range(scale.shape[0]):
        scale[k] = 1.0 / scale[k] if scale[k] > 0.0 else 0.0


@jit_inner
def measure(column, top, squares):
    """Set the squares of a column (rows, lanes) from row ``top`` on [any unit]."""
    for k in range(squares.shape[0]):
        squares[k] = 0.0
    for i in range(top, column.shape[0]):
        for k in range(squares.shape[0]):
            squares[k] += column[i, k] * column[i, k]


@jit_inner
def parts_left(squares, scale):
    """Return the least and the largest part of the longest column that lanes have left, squared [-]; a NaN stays."""
    least, most = np.inf, 0.0
    for k in range(scale.shape[0]):
        part = squares[k] * scale[k]
        if part < least or part != part:
            least = part
        if part > most or part != part:
            most = part
    return least, most


@jit_inner
def counts(least, most):
    """Return 1 where a column is independent in all lanes, 0 where it is in none, -1 in doubt, from its `parts_left` [-]."""
    if least > SURE_PIVOT * SURE_PIVOT:
        return 1
    return 0 if most <= NO_PIVOT * NO_PIVOT else -1


@jit_inner
def set_reflection(column, top, squares, beta, diagonal):
    """Turn a column (rows, lanes) into its reflection from row ``top`` on [any unit]; a lane that is zero stays as it is."""
    for k in range(squares.shape[0]):
        norm, head = math.sqrt(squares[k]), column[top, k]
        diagonal[k] = -math.copysign(norm, head)
        beta[k] = 1.0 / (norm * (norm + abs(head))) if norm > 0.0 else 0.0
        column[top, k] = head - diagonal[k]


@jit_inner
def _pivot(qr, j, columns):
    """Bring the column with the most left, in its worst lane, to place j; return whether it counts as `counts` does."""
    best, at, most = -1.0, j, 0.0
    for c in range(j, columns):
        least, largest = parts_left(qr.sizes[qr.order[c]], qr.scale)
        if largest > most or largest != largest:  # a NaN stays
            most = largest
        if least > best:
            best, at = least, c
    qr.order[j], qr.order[at] = qr.order[at], qr.order[j]
    return counts(best, most)


@jit_inner
def _reflect(y, qr, j, size):
    """y - beta v (v . y) from entry j on, reflection j; set the squares of what then follows entry j."""
    v, beta, sums, lanes = qr.a[qr.order[j]], qr.beta[j], qr.sums, y.shape[1]
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
def turn(qr, rank, y):
    """Replace y (rows, lanes) by Q y [any unit]."""
    for j in range(rank - 1, -1, -1):
        _reflect(y, qr, j, qr.sizes[qr.order[j]])


@jit_inner
def solve_lower(qr, rank, y):
    """Solve R^T z = y (rows, lanes) in place of y [any unit]; y is in the order of the pivots."""
    for j in range(rank):
        for i in range(j):
            for k in range(y.shape[1]):
                y[j, k] -= qr.a[qr.order[j], i, k] * y[i, k]
        for k in range(y.shape[1]):
            y[j, k] /= qr.diagonal[j, k]
