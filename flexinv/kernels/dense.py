"""Linear systems of kernels: dense by Gauss and Gauss-Jordan, block tridiagonal, and by blocks of rows in an order of least fill.

Matrices are small, and no thread or allocation is worth its while; what is written here overwrites what it is handed.
QR is in `kernels.sparse_qr`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexinv.kernels.fronts import find_least_degree_order
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import ZERO, cross, dot, put_at, scale, transpose, vec_at
from flexinv.typing import Array, Indices, Mask

# --------------------------------------------------------------------------------------------------- Gauss elimination

# Rows that are subtracted, or multiplied, at once: what takes them is read and written once, and waits once, not four times.
ROWS_AT_ONCE = 4


@jit
def solve_dense(a, size, wide):
    """Solve a[:size, :size] x = a[:size, size:wide] in place: x replaces the right sides [any unit].

    Gauss elimination with partial pivoting; a zero pivot leaves infinities, which the caller's test finds.
    """
    eliminate(a, size, size, wide)
    for k in range(size - 1, -1, -1):
        fours = k + 1 + (size - k - 1) // ROWS_AT_ONCE * ROWS_AT_ONCE
        for i in range(k + 1, fours, ROWS_AT_ONCE):
            subtract_four(a[k], a[k, i : i + ROWS_AT_ONCE], a[i : i + ROWS_AT_ONCE], size, wide)
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
    fours = columns // ROWS_AT_ONCE * ROWS_AT_ONCE
    for k in range(0, fours, ROWS_AT_ONCE):
        last = k + ROWS_AT_ONCE
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
    p = factors[0]
    q = factors[1]
    r = factors[2]
    s = factors[3]
    for c in range(first, last):
        row[c] -= p * others[0, c] + q * others[1, c] + r * others[2, c] + s * others[3, c]


@jit_inner
def subtract(row, factor, other, first, last):
    """Subtract a multiple of another row from a row, from entry ``first`` to before ``last`` [any unit]."""
    for c in range(first, last):
        row[c] -= factor * other[c]


# -------------------------------------------------------------------------------------------------------- Gauss-Jordan


@jit_inner
def invert(a, size):
    """Replace a[:size, :size] by its inverse [any unit]: Gauss-Jordan by three rows at a time, what is left by single ones.

    A vanishing pivot leaves infinities, which the caller's test finds.
    """
    threes = size - size % 3
    for k in range(0, threes, 3):
        one = a[k]
        two = a[k + 1]
        three = a[k + 2]
        p, q, r = transpose(inverse_transposed((vec_at(one, k), vec_at(two, k), vec_at(three, k))))
        put_at(one, k, (1.0, 0.0, 0.0))
        put_at(two, k, (0.0, 1.0, 0.0))
        put_at(three, k, (0.0, 0.0, 1.0))
        for c in range(size):
            v = one[c], two[c], three[c]
            one[c] = dot(p, v)
            two[c] = dot(q, v)
            three[c] = dot(r, v)
        for i in range(size):
            if i < k or i > k + 2:
                x, y, z = vec_at(a[i], k)
                put_at(a[i], k, ZERO)
                for c in range(size):
                    a[i, c] -= x * one[c] + y * two[c] + z * three[c]
    for k in range(threes, size):
        _sweep(a, k, size)


@jit_inner
def inverse_transposed(m):
    """Return the transposed inverse of a (3, 3) matrix [any unit]: its cofactors over its determinant."""
    x = cross(m[1], m[2])
    y = cross(m[2], m[0])
    z = cross(m[0], m[1])
    over = 1.0 / dot(m[0], x)
    return scale(over, x), scale(over, y), scale(over, z)


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
            subtract(a[i], factor, a[k], 0, size)


@jit_inner
def invert_scaled(m, rows, least, over, left):
    """Replace m[:rows, :rows] by its inverse [any unit]: the rows with a pivot above ``least``, largest first, zero for others.

    Rows are scaled to a unit diagonal first: metres and radians stand side by side.  over, left : scratch
    """
    for i in range(rows):
        over[i] = 1.0 / np.sqrt(abs(m[i, i])) if m[i, i] != 0.0 else 0.0
        left[i] = True
    for i in range(rows):
        for j in range(rows):
            m[i, j] *= over[i] * over[j]
    for _ in range(rows):
        p = _find_pivot(m, rows, least, left)
        if p < 0:
            break
        left[p] = False
        _sweep(m, p, rows)
    for i in range(rows):
        for j in range(rows):
            m[i, j] = 0.0 if left[i] or left[j] else m[i, j] * over[i] * over[j]


# ------------------------------------------------------------------- block tridiagonal: one block row for every instant


@jit_inner
def _find_pivot(m, rows, least, left):
    """The row that is left with the largest diagonal entry above ``least``, -1 without one."""
    p = -1
    largest = least
    for i in range(rows):
        if left[i] and abs(m[i, i]) > largest:
            p = i
            largest = abs(m[i, i])
    return p


@jit
def _solve_rows(whole, window, x):
    """Eliminate below the diagonal: rows [below, diagonal, above, right] become [diagonal, after, one more, right] of a triangle.

    Then fill x (samples + 2, n), whose last two rows are zero, from the triangle.
    whole : (samples, n, 3 n + 1); window : (2 n, 3 n + 1) scratch: the block row at hand and the one after it
    """
    samples, n, wide = whole.shape
    for k in range(-1, samples):
        for i in range(n):  # what is left of the row after is where the next begins
            for j in range(2 * n):
                window[i, j] = window[n + i, n + j]
            window[i, 2 * n : wide - 1] = 0.0
            window[i, wide - 1] = window[n + i, wide - 1]
        if k + 1 < samples:
            _copy_rows(whole[k + 1], window[n:], n, wide)
        if k >= 0:
            eliminate(window, n, 2 * n if k + 1 < samples else n, wide)
            _copy_rows(window, whole[k], n, wide)
    for k in range(samples - 1, -1, -1):
        for i in range(n - 1, -1, -1):
            value = whole[k, i, 3 * n]
            for j in range(n):
                value -= whole[k, i, n + j] * x[k + 1, j] + whole[k, i, 2 * n + j] * x[k + 2, j]
            for j in range(i + 1, n):
                value -= whole[k, i, j] * x[k, j]
            x[k, i] = value / whole[k, i, i]


def solve_tridiagonal(below: Array, diagonal: Array, above: Array, right: Array) -> Array:
    """Return x (samples, n) of  below_k x_(k-1) + own_k x_k + above_k x_(k+1) = right_k  [any unit].

    below, diagonal, above : (samples, n, n), the first ``below`` and the last ``above`` without meaning; right : (samples, n).
    Rows are scaled to a largest entry of one first.  Elimination goes along time with partial pivoting: pivots are sought in the
    block row at hand and the one after it, which is all that a column reaches, as growing and decaying solutions stand side by
    side in a boundary-value problem, and a block may be singular by itself.  A singular system gives values that are not finite.
    (LAPACK's band solver does the same; its threads wait for each other on blocks of this size.)
    """
    samples, n = right.shape
    largest = np.maximum.reduce([np.abs(part).max(axis=2) for part in (below, diagonal, above)])
    whole = np.concatenate([below, diagonal, above, right[:, :, None]], axis=2) / largest[:, :, None]
    whole[-1, :, 2 * n : 3 * n] = 0.0
    x = np.zeros((samples + 2, n))
    _solve_rows(whole, np.zeros((2 * n, 3 * n + 1)), x)
    return x[:samples]


# ---------------------------------------------------------------------------------- by blocks, with pivoting within a block
# The rows of a block belong together: those of one closure.  Blocks that are not coupled leave each other alone, so that the cost
# of a chain of closures is linear.  With one block for all rows this is Gauss elimination with complete pivoting.

INVERTED = -2  # for the first pivot's row where two rows, of one closure in a plane, have been inverted as they are


@send_by_address
class Blocks(NamedTuple):
    """Blocks of rows, in the order in which they are eliminated.

    start, end : (blocks,) first row of each, and the one behind its last; first : (blocks + 1,) of each in ``beside``
    beside : blocks after each that it is coupled to by the time it is eliminated
    entry : (entries, 2) row and column of every entry that is looked at
    """

    start: Indices
    end: Indices
    first: Indices
    beside: Indices
    entry: Indices


@send_by_address
class Pivots(NamedTuple):
    """Scratch: row and column (rows,) of the pivots, row -1 where none is left; over : (rows,) scales."""

    row: Indices
    column: Indices
    over: Array

    @classmethod
    def build_for(cls, rows: int) -> Pivots:
        """Return scratch for so many rows [-]."""
        row, column = np.zeros((2, rows), dtype=np.int64)
        return cls(row, column, np.zeros(rows))


def build_blocks(lengths: Sequence[int], coupled: Mask) -> Blocks:
    """Return the blocks of rows [-] with these numbers of rows, one behind the other.

    coupled : (what they share, blocks) which blocks have a part in it; those that do are coupled to each other
    """
    order, further = find_least_degree_order(coupled)
    turn = {block: k for k, block in enumerate(order)}
    ends = np.cumsum([0, *lengths]).astype(np.int64)
    beside = [sorted(turn[other] for other in others) for others in further]
    first = np.cumsum([0, *(len(others) for others in beside)]).astype(np.int64)
    whole = np.array([other for others in beside for other in others], dtype=np.int64)
    start = ends[:-1][order]
    end = ends[1:][order]
    looked_at = np.zeros((ends[-1], ends[-1]), dtype=bool)
    for b, others in enumerate(beside):
        for other in (b, *others):
            looked_at[start[b] : end[b], start[other] : end[other]] = True
    # One layout of memory for trees and loops, or every kernel that takes a system is compiled for each.
    entry = np.ascontiguousarray(np.argwhere(looked_at | looked_at.T), dtype=np.int64)
    return Blocks(start, end, first, whole, entry)


@jit_inner
def factorise_blocks(m, blocks, least, pivots):
    """Factor m (rows, rows), scaled to a unit diagonal, in place [any unit].

    Rows and columns of metres and of radians stand side by side, so that pivots mean something only then.  Where none above
    ``least`` is left in a block, what remains of it repeats other rows: its unknowns are zero.  Entries between blocks that
    are not coupled are not looked at.
    """
    over = pivots.over
    if m.shape[0] == 2 and blocks.start.shape[0] == 1:
        a = m[0, 0]
        b = m[0, 1]
        c = m[1, 0]
        d = m[1, 1]
        det = a * d - b * c
        if abs(det) > least * abs(a * d):  # both pivots, scaled, are
            m[0, 0] = d / det
            m[0, 1] = -b / det
            m[1, 0] = -c / det
            m[1, 1] = a / det
            pivots.row[0] = INVERTED
            return
    for k in range(m.shape[0]):
        over[k] = 1.0 / np.sqrt(abs(m[k, k])) if m[k, k] != 0.0 else 0.0
    for e in range(blocks.entry.shape[0]):
        i = blocks.entry[e, 0]
        j = blocks.entry[e, 1]
        m[i, j] *= over[i] * over[j]
    for block in range(blocks.start.shape[0]):
        _eliminate_block(m, blocks, block, least, pivots)


@jit_inner
def _eliminate_block(m, blocks, b, least, pivots):
    """Eliminate one block from itself and from those after it; factors stay where zeros would."""
    start = blocks.start[b]
    end = blocks.end[b]
    row = pivots.row
    column = pivots.column
    for k in range(start, end):
        row[k] = k
        column[k] = k
    for k in range(start, end):
        p = k
        q = k
        for i in range(k, end):
            for j in range(k, end):
                if abs(m[row[i], column[j]]) > abs(m[row[p], column[q]]):
                    p = i
                    q = j
        if not abs(m[row[p], column[q]]) > least:
            for i in range(k, end):
                row[i] = -1
            return
        row[k], row[p] = row[p], row[k]
        column[k], column[q] = column[q], column[k]
        for i in range(k + 1, end):
            _subtract_row(m, blocks, b, row[i], k, pivots)
        for n in range(blocks.first[b], blocks.first[b + 1]):
            for i in range(blocks.start[blocks.beside[n]], blocks.end[blocks.beside[n]]):
                _subtract_row(m, blocks, b, i, k, pivots)


@jit_inner
def _subtract_row(m, blocks, b, i, k, pivots):
    """Subtract from row i what makes it zero in the column of pivot k of block b, where the block has entries."""
    r = pivots.row[k]
    c = pivots.column[k]
    factor = m[i, c] / m[r, c]
    m[i, c] = factor
    if factor == 0.0:
        return
    for j in range(k + 1, blocks.end[b]):
        m[i, pivots.column[j]] -= factor * m[r, pivots.column[j]]
    for n in range(blocks.first[b], blocks.first[b + 1]):
        subtract(m[i], factor, m[r], blocks.start[blocks.beside[n]], blocks.end[blocks.beside[n]])


@jit_inner
def _copy_rows(source, target, rows, columns):
    for i in range(rows):
        for j in range(columns):
            target[i, j] = source[i, j]


@jit_inner
def solve_blocks(m, blocks, pivots, right, x):
    """Solve for x (rows,) with the factors at hand [any unit]; ``right`` (rows,) is overwritten."""
    if m.shape[0] == 2 and pivots.row[0] == INVERTED:
        x[0] = m[0, 0] * right[0] + m[0, 1] * right[1]
        x[1] = m[1, 0] * right[0] + m[1, 1] * right[1]
        return
    for k in range(m.shape[0]):
        right[k] *= pivots.over[k]
    _update_right(m, blocks, pivots, right)
    _solve_triangle(m, blocks, pivots, right, x)
    for k in range(m.shape[0]):
        x[k] *= pivots.over[k]


@jit_inner
def _update_right(m, blocks, pivots, right):
    """Change the right side as the elimination of each pivot has changed the rows."""
    row = pivots.row
    for b in range(blocks.start.shape[0]):
        for k in range(blocks.start[b], blocks.end[b]):
            if row[k] < 0:
                continue
            value = right[row[k]]
            c = pivots.column[k]
            for i in range(k + 1, blocks.end[b]):
                if row[i] >= 0:
                    right[row[i]] -= m[row[i], c] * value
            for n in range(blocks.first[b], blocks.first[b + 1]):
                for i in range(blocks.start[blocks.beside[n]], blocks.end[blocks.beside[n]]):
                    right[i] -= m[i, c] * value


@jit_inner
def _solve_triangle(m, blocks, pivots, right, x):
    """Solve the triangle that the elimination has left, from its last pivot on; zero where there was none."""
    column = pivots.column
    for b in range(blocks.start.shape[0] - 1, -1, -1):
        for k in range(blocks.end[b] - 1, blocks.start[b] - 1, -1):
            r = pivots.row[k]
            c = column[k]
            if r < 0:
                x[c] = 0.0
                continue
            value = right[r]
            for j in range(k + 1, blocks.end[b]):
                value -= m[r, column[j]] * x[column[j]]
            for n in range(blocks.first[b], blocks.first[b + 1]):
                for j in range(blocks.start[blocks.beside[n]], blocks.end[blocks.beside[n]]):
                    value -= m[r, j] * x[j]
            x[c] = value / m[r, c]
