"""Dense linear systems of kernels: Gauss elimination (LU), inversion (Gauss-Jordan) and pivoted QR over a trailing lane axis.

Matrices are small, and no thread or allocation is worth its while; what is written here overwrites what it is handed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import by_address
from flexinv.kernels.vec3 import cross, dot, put, scale, transpose, vec_at
from flexinv.typing import Array

# --------------------------------------------------------------------------------------------------- Gauss elimination


FOUR = 4  # rows that are subtracted at once: what they are subtracted from is read and written once, not four times


@jit
def solve_dense(a, size, wide):
    """Solve a[:size, :size] x = a[:size, size:wide] in place: x replaces the right sides [any unit].

    Gauss elimination with partial pivoting; a zero pivot leaves infinities, which the caller's test finds.
    """
    eliminate(a, size, size, wide)
    for k in range(size - 1, -1, -1):
        fours = k + 1 + (size - k - 1) // FOUR * FOUR
        for i in range(k + 1, fours, FOUR):
            subtract_four(a[k], a[k, i : i + FOUR], a[i : i + FOUR], size, wide)
        for i in range(fours, size):
            subtract(a[k], a[k, i], a[i], size, wide)
        over = 1.0 / a[k, k]
        for c in range(size, wide):
            a[k, c] *= over


@jit_inner
def eliminate(a, columns, rows, wide):
    """Bring the first columns of a[:rows, :wide] to a triangle, four at a time [any unit]; below it factors are left.

    The largest entry of a column from its diagonal on becomes the pivot.
    """
    fours = columns // FOUR * FOUR
    for k in range(0, fours, FOUR):
        last = k + FOUR
        for c in range(k, last):
            _eliminate_column(a, c, rows, (k, last, wide))
        for i in range(k + 1, last):
            for c in range(k, i):
                subtract(a[i], a[i, c], a[c], last, wide)
        for i in range(last, rows):
            subtract_four(a[i], a[i, k:last], a[k:last], last, wide)
    for c in range(fours, columns):
        _eliminate_column(a, c, rows, (c, wide, wide))


@jit_inner
def _eliminate_column(a, c, rows, columns):
    """Bring the largest entry of column c from row c on to the diagonal, and eliminate below it; its factors stay there.

    columns : first and last of those that are changed so far, and the last of a row
    """
    first, last, wide = columns
    pivot = c
    for i in range(c + 1, rows):
        if abs(a[i, c]) > abs(a[pivot, c]):
            pivot = i
    if pivot != c:
        for j in range(first, wide):
            a[c, j], a[pivot, j] = a[pivot, j], a[c, j]
    over = 1.0 / a[c, c]
    for i in range(c + 1, rows):
        a[i, c] *= over
        if a[i, c] != 0.0:
            subtract(a[i], a[i, c], a[c], c + 1, last)


@jit_inner
def subtract_four(row, factors, others, first, last):
    """Subtract multiples of four other rows from a row, from entry ``first`` to before ``last`` [any unit]."""
    p, q, r, s = factors[0], factors[1], factors[2], factors[3]
    for c in range(first, last):
        row[c] -= p * others[0, c] + q * others[1, c] + r * others[2, c] + s * others[3, c]


@jit_inner
def subtract(row, factor, other, first, last):
    """Subtract a multiple of another row from a row, from entry ``first`` to before ``last`` [any unit]."""
    for c in range(first, last):
        row[c] -= factor * other[c]


@jit_inner
def solve_symmetric(m, rows, least, x, work):
    """Solve m[:rows, :rows] x = m[:rows, rows] by complete pivoting, scaled to a unit diagonal [any unit].

    Rows and columns of metres and of radians stand side by side, so that pivots mean something only then.  Where none above
    ``least`` is left, what remains repeats other rows: its unknowns are zero.
    work : order (rows,) of integers and scales (rows,), scratch
    """
    order, over = work
    for k in range(rows):
        over[k] = 1.0 / np.sqrt(abs(m[k, k])) if m[k, k] != 0.0 else 0.0
        order[k] = k
    for i in range(rows):
        m[i, rows] *= over[i]
        for j in range(rows):
            m[i, j] *= over[i] * over[j]
    rank = rows
    for k in range(rows):
        p, q = k, k
        for i in range(k, rows):
            for j in range(k, rows):
                if abs(m[i, j]) > abs(m[p, q]):
                    p, q = i, j
        if not abs(m[p, q]) > least:
            rank = k
            break
        _exchange(m, order, rows, k, p, q)
        for i in range(k + 1, rows):
            subtract(m[i], m[i, k] / m[k, k], m[k], k, rows + 1)
    for k in range(rows):
        x[k] = 0.0
    for k in range(rank - 1, -1, -1):
        value = m[k, rows]
        for j in range(k + 1, rank):
            value -= m[k, j] * x[order[j]]
        x[order[k]] = value / m[k, k]
    for k in range(rows):
        x[k] *= over[k]


@jit_inner
def _exchange(m, order, rows, k, p, q):
    if p != k:
        for j in range(rows + 1):
            m[k, j], m[p, j] = m[p, j], m[k, j]
    if q != k:
        for i in range(rows):
            m[i, k], m[i, q] = m[i, q], m[i, k]
        order[k], order[q] = order[q], order[k]


# -------------------------------------------------------------------------------------------------------- Gauss-Jordan


@jit_inner
def invert(a, size):
    """Replace a[:size, :size] by its inverse [any unit]: Gauss-Jordan by three rows at a time, what is left by single ones.

    A vanishing pivot leaves infinities, which the caller's test finds.
    """
    threes = size - size % 3
    for k in range(0, threes, 3):
        _sweep_three(a, k, size)
    for k in range(threes, size):
        _sweep(a, k, size)


@jit_inner
def inverse_transposed(m):
    """Return the transposed inverse of a (3, 3) matrix [any unit]: its cofactors over its determinant."""
    x, y, z = cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])
    over = 1.0 / dot(m[0], x)
    return scale(over, x), scale(over, y), scale(over, z)


@jit_inner
def _sweep_three(a, k, size):
    """One step of Gauss-Jordan with the pivot rows k, k + 1, k + 2."""
    one, two, three = a[k], a[k + 1], a[k + 2]
    p, q, r = transpose(inverse_transposed((vec_at(one, k), vec_at(two, k), vec_at(three, k))))
    put(one, k, (1.0, 0.0, 0.0))
    put(two, k, (0.0, 1.0, 0.0))
    put(three, k, (0.0, 0.0, 1.0))
    for c in range(size):
        x, y, z = one[c], two[c], three[c]
        one[c] = p[0] * x + p[1] * y + p[2] * z
        two[c] = q[0] * x + q[1] * y + q[2] * z
        three[c] = r[0] * x + r[1] * y + r[2] * z
    for i in range(size):
        if i < k or i > k + 2:
            factors = vec_at(a[i], k)
            put(a[i], k, (0.0, 0.0, 0.0))
            _subtract_three(a[i], factors, one, two, three, size)


@jit_inner
def _subtract_three(row, factors, one, two, three, size):
    for c in range(size):
        row[c] -= factors[0] * one[c] + factors[1] * two[c] + factors[2] * three[c]


@jit_inner
def _sweep(a, k, size):
    """One step of Gauss-Jordan in place, with the pivot (k, k)."""
    over = 1.0 / a[k, k]
    a[k, k] = 1.0
    for c in range(size):
        a[k, c] *= over
    for i in range(size):
        if i != k:
            factor = a[i, k]
            a[i, k] = 0.0
            for c in range(size):
                a[i, c] -= factor * a[k, c]


@jit_inner
def invert_scaled(m, rows, least, over, left):
    """Replace m[:rows, :rows] by its inverse [any unit]: the rows with a pivot above ``least``, largest first, zero for others.

    Rows are scaled to a unit diagonal first: metres and radians stand side by side.  over, left : scratch
    """
    for i in range(rows):
        over[i], left[i] = 1.0 / np.sqrt(abs(m[i, i])) if m[i, i] != 0.0 else 0.0, True
    for i in range(rows):
        for j in range(rows):
            m[i, j] *= over[i] * over[j]
    for _ in range(rows):
        p, largest = 0, least
        for i in range(rows):
            if left[i] and abs(m[i, i]) > largest:
                p, largest = i, abs(m[i, i])
        if not largest > least:
            break
        left[p] = False
        _sweep(m, p, rows)
    for i in range(rows):
        for j in range(rows):
            m[i, j] = 0.0 if left[i] or left[j] else m[i, j] * over[i] * over[j]


# ---------------------------------------------------------------------------------------------------------- pivoted QR


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
        _reflect_rows(y, qr, j)
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
    """Reflect a column (rows, 1) likewise, by rows between the ends of both; one that shares none stays as it is."""
    own = qr.order[j]
    v, first, last = qr.a[own], max(qr.ends[own, 0], j + 1), qr.ends[own, 1]
    shared = v[j, 0] * y[j, 0]
    for i in range(max(first, ends[0]), min(last, ends[1])):
        shared += v[i, 0] * y[i, 0]
    shared *= qr.beta[j, 0]
    if shared != 0.0:
        y[j, 0] -= shared * v[j, 0]
        for i in range(first, last):
            y[i, 0] -= shared * v[i, 0]
        if first < last:
            ends[0], ends[1] = min(ends[0], first), max(ends[1], last)
    if shared != 0.0 or y[j, 0] != 0.0:
        size[0] = 0.0
        for i in range(max(ends[0], j + 1), ends[1]):
            size[0] += y[i, 0] * y[i, 0]


@jit_inner
def _reflect_rows(y, qr, j):
    """Reflect any column (rows, 1), by the rows of the reflection alone."""
    own = qr.order[j]
    v, first, last = qr.a[own], max(qr.ends[own, 0], j + 1), qr.ends[own, 1]
    shared = v[j, 0] * y[j, 0]
    for i in range(first, last):
        shared += v[i, 0] * y[i, 0]
    shared *= qr.beta[j, 0]
    if shared != 0.0:
        y[j, 0] -= shared * v[j, 0]
        for i in range(first, last):
            y[i, 0] -= shared * v[i, 0]


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
