"""Linear solve on the tree: elements are eliminated from leaves to root, so no fill appears and cost is linear.

An element couples its first block (that of its first node) with the blocks of its other nodes, and those belong
to it alone.  Condensing them onto the first block, leaf elements first, leaves the passive freedoms of block 0.
"""

from __future__ import annotations

from flexinv.dynamics.assembly import by_root
from flexinv.kernels.dense import solve_dense
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.vec3 import dot, vec


@jit_inner
def solve_tree(topology, elements, variation, work, y):
    """Solve linearisation y = -residual for all right sides; y (sides, unknowns) [m], [rad].

    Overwrites work.diagonal and work.residual (sides, unknowns).
    """
    sides = y.shape[0]
    for k in range(len(elements.order) - 1, -1, -1):
        _condense(topology, elements, variation, work, k, sides)
    roots, system = topology.size[0], work.system
    for r in range(roots):
        for c in range(roots):
            system[r, c] = work.diagonal[0, r, c]
        for side in range(sides):
            system[r, roots + side] = -work.residual[side, r]
    solve_dense(system, roots, roots + sides)
    for r in range(roots):
        for side in range(sides):
            y[side, r] = system[r, roots + side]
    for k in range(len(elements.order)):
        _expand(topology, elements, work, y, k)


@jit_inner
def _row(topology, nodes, i):
    """First row of node i among the unknowns of an element's own blocks; for i = count their number."""
    row = topology.size[0] - topology.size[0]  # zero, of the type of the sizes: one compiled version serves every call
    for q in range(1, i):
        row += topology.size[topology.block[nodes[q]]]
    return row


@jit_inner
def _condense(topology, elements, variation, work, k, sides):
    """Solve for the element's own blocks in terms of its first block, and add what they do to it."""
    nodes, count, system, tangent = elements.nodes[k], elements.order[k] + 1, work.system, work.tangent[k]
    rows, columns = _row(topology, nodes, count), topology.size[topology.block[nodes[0]]]
    for r in range(rows):
        for c in range(rows + columns + sides):
            system[r, c] = 0.0
    for i in range(1, count):
        b, at = topology.block[nodes[i]], _row(topology, nodes, i)
        for r in range(topology.size[b]):
            for c in range(topology.size[b]):
                system[at + r, at + c] = work.diagonal[b, r, c]
            for side in range(sides):
                system[at + r, rows + columns + side] = work.residual[side, topology.offset[b] + r]
        for q in range(1, count):
            if q != i:
                _copy_block(tangent, 6 * i, 6 * q, system, at, _row(topology, nodes, q))
        for r in range(6):
            for c in range(columns):
                system[at + r, rows + c] = by_root(tangent, 6 * i + r, nodes[0], c, variation)
    solve_dense(system, rows, rows + columns + sides)
    for r in range(rows):
        for c in range(columns + sides):
            work.solved[k, r, c] = system[r, rows + c]
    _add_to_first(topology, elements, variation, work, k, sides)


@jit_inner
def _copy_block(tangent, row, column, out, out_row, out_column):
    for r in range(6):
        for c in range(6):
            out[out_row + r, out_column + c] = tangent[row + r, column + c]


@jit_inner
def _add_to_first(topology, elements, variation, work, k, sides):
    """Subtract from the first block's linearisation and residuals what the eliminated unknowns do to it."""
    nodes, count, tangent = elements.nodes[k], elements.order[k] + 1, work.tangent[k]
    first = topology.block[nodes[0]]
    columns = topology.size[first]
    for i in range(1, count):
        at = _row(topology, nodes, i)
        for q in range(6):
            column = 6 * i + q
            by_x = tangent[0, column], tangent[1, column], tangent[2, column]
            by_t = tangent[3, column], tangent[4, column], tangent[5, column]
            for r in range(columns):
                back = dot(by_x, vec(variation.x[nodes[0], r])) + dot(by_t, vec(variation.t[nodes[0], r]))
                for c in range(columns):
                    work.diagonal[first, r, c] -= back * work.solved[k, at + q, c]
                for side in range(sides):
                    work.residual[side, topology.offset[first] + r] -= back * work.solved[k, at + q, columns + side]


@jit_inner
def _expand(topology, elements, work, y, k):
    """Unknowns of the element's own blocks, once those of its first block are known."""
    nodes, count = elements.nodes[k], elements.order[k] + 1
    first = topology.block[nodes[0]]
    columns, o = topology.size[first], topology.offset[first]
    for i in range(1, count):
        b, at = topology.block[nodes[i]], _row(topology, nodes, i)
        for r in range(topology.size[b]):
            for side in range(y.shape[0]):
                value = -work.solved[k, at + r, columns + side]
                for c in range(columns):
                    value -= work.solved[k, at + r, c] * y[side, o + c]
                y[side, topology.offset[b] + r] = value
