"""Linear solve on the tree: elements are eliminated from leaves to root, so no fill appears and cost is linear.

An element couples its first block (that of its first node) with the blocks of its other nodes, and those belong
to it alone.  Condensing them onto the first block, leaf elements first, leaves the passive freedoms of block 0.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def solve_tree(t, e, d, work, y):
    """Solve linearisation y = -residual; y (unknowns,) [m], [rad].  Overwrites work.diagonal, work.residual."""
    for k in range(len(e.order) - 1, -1, -1):
        _condense(t, e, d, work, k)
    roots = t.size[0]
    if roots > 0:
        y[:roots] = np.linalg.solve(work.diagonal[0, :roots, :roots].copy(), -work.residual[:roots])
    for k in range(len(e.order)):
        _expand(t, e, work, y, k)


@njit(cache=True)
def _condense(t, e, d, work, k):
    """Solve for the element's own blocks in terms of its first block, and add what they do to it."""
    nodes, count = e.nodes[k], e.order[k] + 1
    root = nodes[0]
    first = t.block[root]
    columns = t.size[first]
    rows = 0
    for i in range(1, count):
        rows += t.size[t.block[nodes[i]]]
    matrix, right = np.zeros((rows, rows)), np.zeros((rows, columns + 1))
    back = np.zeros((columns, rows))
    tangent = work.tangent[k]
    at = 0
    for i in range(1, count):
        b = t.block[nodes[i]]
        n, o = t.size[b], t.offset[b]
        matrix[at : at + n, at : at + n] = work.diagonal[b, :n, :n]
        right[at : at + n, columns] = work.residual[o : o + n]
        _couple_first(tangent, 6 * i, at, d.x[root], d.t[root], columns, right, back)
        to = 0
        for q in range(1, count):
            if q != i:
                matrix[at : at + 6, to : to + 6] = tangent[6 * i : 6 * i + 6, 6 * q : 6 * q + 6]
            to += t.size[t.block[nodes[q]]]
        at += n
    solved = np.linalg.solve(matrix, right)
    work.solved[k, :rows, : columns + 1] = solved
    if columns > 0:
        effect = back @ solved
        work.diagonal[first, :columns, :columns] -= effect[:, :columns]
        work.residual[t.offset[first] : t.offset[first] + columns] -= effect[:, columns]


@njit(cache=True)
def _couple_first(tangent, row, at, dx, dt, columns, right, back):
    """Blocks between a node (row, at) and the element's root, whose motion is (dx, dt) per unknown of its block."""
    for c in range(columns):
        for i in range(6):
            down = up = 0.0
            for q in range(3):
                down += tangent[row + i, q] * dx[c, q] + tangent[row + i, 3 + q] * dt[c, q]
                up += dx[c, q] * tangent[q, row + i] + dt[c, q] * tangent[3 + q, row + i]
            right[at + i, c] = down
            back[c, at + i] = up


@njit(cache=True)
def _expand(t, e, work, y, k):
    """Unknowns of the element's own blocks, once those of its first block are known."""
    nodes, count = e.nodes[k], e.order[k] + 1
    first = t.block[nodes[0]]
    columns, o = t.size[first], t.offset[first]
    at = 0
    for i in range(1, count):
        b = t.block[nodes[i]]
        for r in range(t.size[b]):
            value = -work.solved[k, at + r, columns]
            for c in range(columns):
                value -= work.solved[k, at + r, c] * y[o + c]
            y[t.offset[b] + r] = value
        at += t.size[b]
