"""Linear solve on the tree: elements are eliminated from leaves to root, so no fill appears and cost is linear.

An element couples its first block (that of its first node) with the blocks of its other nodes, and those belong
to it alone.  Condensing them onto the first block, leaf elements first, leaves the passive freedoms of the blocks on the world.
The parts of a mechanism (`dynamics.dofs`) share nothing: each is solved for the right sides that have to do with it.
"""

from __future__ import annotations

from flexinv.dynamics.assembly import compute_root_derivative
from flexinv.kernels.dense import solve_dense
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.vec3 import dot, vec


@jit_inner
def solve_tree(topology, elements, variation, work, plan, first_only, y):
    """Solve linearisation y = -residual for the right sides of every part; y (sides, unknowns) [m], [rad].

    plan : `dynamics.constraint_rows.Layout`; first_only : the first side of each part only, the residual
    Overwrites work.diagonal and work.residual (sides, unknowns).
    """
    for k in range(len(elements.order) - 1, -1, -1):
        part = topology.part[topology.block[elements.nodes[k, 0]]]
        sides = plan.side[plan.first_side[part] : find_side_end(plan, part, first_only)]
        _solve_element_blocks(topology, elements, variation, work, k, sides)
    for part in range(len(topology.span) - 1):
        solve_block(topology, work, part, plan.side[plan.first_side[part] : find_side_end(plan, part, first_only)], y)
    for k in range(len(elements.order)):
        part = topology.part[topology.block[elements.nodes[k, 0]]]
        _solve_element_unknowns(
            topology, elements, work, y, k, plan.side[plan.first_side[part] : find_side_end(plan, part, first_only)]
        )


@jit_inner
def find_side_end(plan, part, first_only):
    """Return the end of the right sides of a part in plan.side [-]."""
    return plan.first_side[part] + 1 if first_only else plan.first_side[part + 1]


@jit_inner
def solve_block(topology, work, b, sides, y):
    """Solve diagonal y = -residual of one block for some right sides [m], [rad]."""
    size = topology.size[b]
    first = topology.offset[b]
    system = work.system
    for r in range(size):
        for c in range(size):
            system[r, c] = work.diagonal[b, r, c]
        for s in range(len(sides)):
            system[r, size + s] = -work.residual[sides[s], first + r]
    solve_dense(system, size, size + len(sides))
    for r in range(size):
        for s in range(len(sides)):
            y[sides[s], first + r] = system[r, size + s]


@jit_inner
def _find_first_row(topology, nodes, i):
    """First row of node i among the unknowns of an element's own blocks; for i = count their number."""
    row = topology.size[0] - topology.size[0]  # zero, of the type of the sizes: one compiled version serves every call
    for q in range(1, i):
        row += topology.width[nodes[q]]
    return row


@jit_inner
def _solve_element_blocks(topology, elements, variation, work, k, sides):
    """Solve for the element's own blocks in terms of its first block, and add what they do to it."""
    nodes = elements.nodes[k]
    count = elements.order[k] + 1
    system = work.system
    rows = _find_first_row(topology, nodes, count)
    columns = topology.width[nodes[0]]
    system[:rows, : rows + columns + len(sides)] = 0.0
    for i in range(1, count):
        _fill_block_rows(topology, nodes, count, variation, work, work.tangent[k], i, sides)
    solve_dense(system, rows, rows + columns + len(sides))
    for r in range(rows):
        for c in range(columns + len(sides)):
            work.solved[k, r, c] = system[r, rows + c]
    _add_to_first(topology, elements, variation, work, k, sides)


@jit_inner
def _fill_block_rows(topology, nodes, count, variation, work, tangent, i, sides):
    """Fill the rows of the block of node i: its own linearisation, other nodes', the first block's, and right sides."""
    system = work.system
    rows = _find_first_row(topology, nodes, count)
    columns = topology.width[nodes[0]]
    b = topology.block[nodes[i]]
    at = _find_first_row(topology, nodes, i)
    for r in range(topology.size[b]):
        for c in range(topology.size[b]):
            system[at + r, at + c] = work.diagonal[b, r, c]
        for s in range(len(sides)):
            system[at + r, rows + columns + s] = work.residual[sides[s], topology.offset[b] + r]
    for q in range(1, count):
        if q != i:
            beside = _find_first_row(topology, nodes, q)
            for r in range(6):
                for c in range(6):
                    system[at + r, beside + c] = tangent[6 * i + r, 6 * q + c]
    for r in range(6):
        for c in range(columns):
            system[at + r, rows + c] = compute_root_derivative(tangent, 6 * i + r, nodes[0], c, variation)


@jit_inner
def _add_to_first(topology, elements, variation, work, k, sides):
    """Subtract from the first block's linearisation and residuals what the eliminated unknowns do to it."""
    nodes = elements.nodes[k]
    count = elements.order[k] + 1
    tangent = work.tangent[k]
    first = topology.block[nodes[0]]
    columns = topology.size[first]
    for i in range(1, count):
        at = _find_first_row(topology, nodes, i)
        for q in range(6):
            column = 6 * i + q
            by_x = tangent[0, column], tangent[1, column], tangent[2, column]
            by_t = tangent[3, column], tangent[4, column], tangent[5, column]
            for r in range(columns):
                back = dot(by_x, vec(variation.x[nodes[0], r])) + dot(by_t, vec(variation.t[nodes[0], r]))
                for c in range(columns):
                    work.diagonal[first, r, c] -= back * work.solved[k, at + q, c]
                for s in range(len(sides)):
                    work.residual[sides[s], topology.offset[first] + r] -= back * work.solved[k, at + q, columns + s]


@jit_inner
def _solve_element_unknowns(topology, elements, work, y, k, sides):
    """Unknowns of the element's own blocks, once those of its first block are known."""
    nodes = elements.nodes[k]
    count = elements.order[k] + 1
    first = topology.block[nodes[0]]
    columns = topology.size[first]
    o = topology.offset[first]
    for i in range(1, count):
        b = topology.block[nodes[i]]
        at = _find_first_row(topology, nodes, i)
        for r in range(topology.size[b]):
            for s in range(len(sides)):
                value = -work.solved[k, at + r, columns + s]
                for c in range(columns):
                    value -= work.solved[k, at + r, c] * y[sides[s], o + c]
                y[sides[s], topology.offset[b] + r] = value
