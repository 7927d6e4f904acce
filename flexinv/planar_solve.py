"""Linear solve on the tree in a plane, in two parts so that a linearisation can be kept: factors, and solutions with them.

As in `eliminate`, the unknowns of an element's own blocks are condensed onto its first block, leaf elements first.  With S the
own linearisation and B how it varies with the first block's unknowns y_1 (B^T the other way round: the energy is the same),

    own unknowns = -S^-1 (r + B y_1),     D_1 <- D_1 - B^T S^-1 B,     r_1 <- r_1 - B^T S^-1 r

S^-1 is kept, transposed, and so are B and S^-1 B: products run along rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.compiled import jit_merged
from flexinv.mechanism import Array
from flexinv.planar_beam import element_stiffness


class PlanarFactors(NamedTuple):
    """The linearisation of a planar mechanism on its tree, eliminated.

    rows : (elements,) number of own unknowns; row : (elements, count, columns) where those of each node stand among them
    own : (elements, rows) number of the unknown
    inverse : (elements, rows, wide) S^-T; to_root : (elements, 3, rows) own rows by the root's pose; b, x : (elements, columns,
        rows) B^T and (S^-1 B)^T; root : (columns, wide) the same of block 0
    diagonal : (blocks, columns, columns); stiff : (9, count^2), line : (2, wide), scratch
    """

    rows: NDArray[np.int64]
    row: NDArray[np.int64]
    own: NDArray[np.int64]
    inverse: Array
    to_root: Array
    b: Array
    x: Array
    root: Array
    diagonal: Array
    stiff: Array
    line: Array


@jit_merged
def invert(a, size, line):
    """Replace a[:size, :size] by its inverse [any unit]; Gauss-Jordan, as rows of ``a`` are contiguous.

    A vanishing pivot leaves infinities, which the caller's test finds.  line : (2, size) scratch
    """
    row, column = line[0], line[1]
    for k in range(size):
        pivot = 1.0 / a[k, k]
        for i in range(size):
            column[i] = a[i, k]
            a[i, k] = 0.0
        a[k, k], column[k] = 1.0, 0.0
        for c in range(size):
            row[c] = pivot * a[k, c]
            a[k, c] = row[c]
        for i in range(size):
            _subtract(a[i], column[i], row, size)


@jit_merged
def _subtract(a, factor, b, size):
    for c in range(size):
        a[c] -= factor * b[c]


@jit_merged
def put_stiffness(t, e, p, f, q):
    """Put the stiffness of all elements into their own linearisations, and what their roots feel into dwrench [N], [N m]."""
    for k in range(len(e.order)):
        order, root, own = e.order[k], e.nodes[k, 0], q.inverse[k]
        count = order + 1
        element_stiffness(k, e, p, q.stiff)
        for r in range(3 * order, q.rows[k]):
            for c in range(q.rows[k]):
                own[r, c], own[c, r] = 0.0, 0.0
        for a in range(3):
            for b in range(3):
                table = q.stiff[3 * a + b]
                for i in range(order):
                    q.to_root[k, b, a * order + i] = table[(i + 1) * count]
                    for j in range(order):
                        own[a * order + i, b * order + j] = table[(i + 1) * count + j + 1]
                for c in range(t.size[t.block[root]]):
                    f.dwrench[root, c, a] += table[0] * f.by_pose[root, c, b]


@jit_merged
def factorise(t, e, f, q):
    """Eliminate the linearisation, whose diagonal blocks stand in q.diagonal [N/m], [N], [N m]."""
    for k in range(len(e.order) - 1, -1, -1):
        _condense(k, t, e, f, q)
    roots = t.size[0]
    for r in range(roots):
        for c in range(roots):
            q.root[c, r] = q.diagonal[0, r, c]
    invert(q.root, roots, q.line)


@jit_merged
def _condense(k, t, e, f, q):
    """Condense element k onto its first block."""
    nodes, rows, inverse, b, x = e.nodes[k], q.rows[k], q.inverse[k], q.b[k], q.x[k]
    root, first = nodes[0], t.block[nodes[0]]
    columns = t.size[first]
    for i in range(1, e.order[k] + 1):
        block, place = t.block[nodes[i]], q.row[k, i]
        for r in range(t.size[block]):
            for c in range(t.size[block]):
                inverse[place[c], place[r]] += q.diagonal[block, r, c]
    invert(inverse, rows, q.line)
    for c in range(columns):
        v1, v2, v3 = f.by_pose[root, c, 0], f.by_pose[root, c, 1], f.by_pose[root, c, 2]
        for r in range(rows):
            b[c, r] = q.to_root[k, 0, r] * v1 + q.to_root[k, 1, r] * v2 + q.to_root[k, 2, r] * v3
        _transposed_product(inverse, b[c], x[c], rows)
    for c in range(columns):
        for d in range(columns):
            total = 0.0
            for r in range(rows):
                total += b[d, r] * x[c, r]
            q.diagonal[first, d, c] -= total


@jit_merged
def _transposed_product(a, v, out, size):
    """out = a^T v, row by row."""
    for r in range(size):
        out[r] = 0.0
    for c in range(size):
        _subtract(out, -v[c], a[c], size)


@jit_merged
def solve(t, e, q, residual, y):
    """Solve linearisation y = -residual with the factors at hand; y (unknowns,) [m], [rad].  Overwrites residual."""
    line = q.line
    for k in range(len(e.order) - 1, -1, -1):
        rows, own, first = q.rows[k], q.own[k], t.block[e.nodes[k, 0]]
        for r in range(rows):
            line[0, r] = residual[own[r]]
        _transposed_product(q.inverse[k], line[0], line[1], rows)
        for r in range(rows):
            y[own[r]] = -line[1, r]
        for c in range(t.size[first]):
            total = 0.0
            for r in range(rows):
                total += q.b[k, c, r] * line[1, r]
            residual[t.offset[first] + c] -= total
    _transposed_product(q.root, residual, line[1], t.size[0])
    for r in range(t.size[0]):
        y[r] = -line[1, r]
    for k in range(len(e.order)):
        first = t.block[e.nodes[k, 0]]
        for c in range(t.size[first]):
            along = y[t.offset[first] + c]
            for r in range(q.rows[k]):
                y[q.own[k, r]] -= q.x[k, c, r] * along
