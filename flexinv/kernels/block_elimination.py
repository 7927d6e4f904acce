"""Linear systems of kernels, eliminated block by block in an order of least fill, with pivoting within a block (compiled).

The rows of a block belong together: those of one closure.  Blocks that are not coupled leave each other alone, so that the cost
of a chain of closures is linear.  With one block for all rows this is Gauss elimination with complete pivoting.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.dense import subtract
from flexinv.kernels.fronts import least_degree_order
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import by_address
from flexinv.typing import Array

Indices = NDArray[np.int64]
# What stands for the first pivot's row where two rows, of one closure in a plane, have been inverted as they are.
INVERTED = -2


@by_address
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


@by_address
class Pivots(NamedTuple):
    """Scratch: row and column (rows,) of the pivots, row -1 where none is left; over : (rows,) scales."""

    row: Indices
    column: Indices
    over: Array

    @classmethod
    def of(cls, rows: int) -> Pivots:
        """Return scratch for so many rows [-]."""
        row, column = np.zeros((2, rows), dtype=np.int64)
        return cls(row, column, np.zeros(rows))


def blocks_of(lengths: Sequence[int], coupled: NDArray[np.bool_]) -> Blocks:
    """Return the blocks of rows [-] with these numbers of rows, one behind the other.

    coupled : (what they share, blocks) which blocks have a part in it; those that do are coupled to each other
    """
    order, further = least_degree_order(coupled)
    turn = {block: k for k, block in enumerate(order)}
    ends = np.cumsum([0, *lengths]).astype(np.int64)
    beside = [sorted(turn[other] for other in others) for others in further]
    first = np.cumsum([0, *(len(others) for others in beside)]).astype(np.int64)
    whole = np.array([other for others in beside for other in others], dtype=np.int64)
    start, end = ends[:-1][order], ends[1:][order]
    looked_at = np.zeros((ends[-1], ends[-1]), dtype=bool)
    for b, others in enumerate(beside):
        for other in (b, *others):
            looked_at[start[b] : end[b], start[other] : end[other]] = True
    entry = np.argwhere(looked_at | looked_at.T).astype(np.int64)
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
        a, b, c, d = m[0, 0], m[0, 1], m[1, 0], m[1, 1]
        det = a * d - b * c
        if abs(det) > least * abs(a * d):  # both pivots, scaled, are
            m[0, 0], m[0, 1], m[1, 0], m[1, 1] = d / det, -b / det, -c / det, a / det
            pivots.row[0] = INVERTED
            return
    for k in range(m.shape[0]):
        over[k] = 1.0 / np.sqrt(abs(m[k, k])) if m[k, k] != 0.0 else 0.0
    for e in range(blocks.entry.shape[0]):
        i, j = blocks.entry[e, 0], blocks.entry[e, 1]
        m[i, j] *= over[i] * over[j]
    for block in range(blocks.start.shape[0]):
        _eliminate(m, blocks, block, least, pivots)


@jit_inner
def _eliminate(m, blocks, b, least, pivots):
    """Eliminate one block from itself and from those after it; factors stay where zeros would."""
    start, end, row, column = blocks.start[b], blocks.end[b], pivots.row, pivots.column
    for k in range(start, end):
        row[k], column[k] = k, k
    for k in range(start, end):
        p, q = k, k
        for i in range(k, end):
            for j in range(k, end):
                if abs(m[row[i], column[j]]) > abs(m[row[p], column[q]]):
                    p, q = i, j
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
    r, c = pivots.row[k], pivots.column[k]
    factor = m[i, c] / m[r, c]
    m[i, c] = factor
    if factor == 0.0:
        return
    for j in range(k + 1, blocks.end[b]):
        m[i, pivots.column[j]] -= factor * m[r, pivots.column[j]]
    for n in range(blocks.first[b], blocks.first[b + 1]):
        subtract(m[i], factor, m[r], blocks.start[blocks.beside[n]], blocks.end[blocks.beside[n]])


@jit_inner
def solve_blocks(m, blocks, pivots, right, x):
    """Solve for x (rows,) with the factors at hand [any unit]; ``right`` (rows,) is overwritten."""
    if m.shape[0] == 2 and pivots.row[0] == INVERTED:
        x[0], x[1] = m[0, 0] * right[0] + m[0, 1] * right[1], m[1, 0] * right[0] + m[1, 1] * right[1]
        return
    row, column = pivots.row, pivots.column
    for k in range(m.shape[0]):
        right[k] *= pivots.over[k]
    for b in range(blocks.start.shape[0]):
        for k in range(blocks.start[b], blocks.end[b]):
            if row[k] < 0:
                continue
            value, c = right[row[k]], column[k]  # as the elimination of pivot k has changed the rows
            for i in range(k + 1, blocks.end[b]):
                if row[i] >= 0:
                    right[row[i]] -= m[row[i], c] * value
            for n in range(blocks.first[b], blocks.first[b + 1]):
                for i in range(blocks.start[blocks.beside[n]], blocks.end[blocks.beside[n]]):
                    right[i] -= m[i, c] * value
    for b in range(blocks.start.shape[0] - 1, -1, -1):
        for k in range(blocks.end[b] - 1, blocks.start[b] - 1, -1):
            r, c = row[k], column[k]
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
    for k in range(m.shape[0]):
        x[k] *= pivots.over[k]
