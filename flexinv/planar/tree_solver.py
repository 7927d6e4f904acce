"""Linear solve on the tree in a plane, in two parts so that a linearisation can be kept: factors, and solutions with them.

As in `dynamics.tree_solver`, unknowns of an element's own blocks are condensed onto its first block, leaf elements first.  With S
the own linearisation and B how it varies with the first block's unknowns y_1 (B^T the other way round: the energy is the same),

    own unknowns = -S^-1 (r + B y_1),     D_1 <- D_1 - B^T S^-1 B,     r_1 <- r_1 - B^T S^-1 r

S^-1 is kept, transposed, and so are B and S^-1 B: products run along rows.
"""

from __future__ import annotations

from typing import NamedTuple

from flexinv.elements.planar_beam import compute_pair_stiffness
from flexinv.kernels.dense import ROWS_AT_ONCE, inverse_transposed, invert, subtract
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import (
    add_at,
    add_to,
    apply,
    madd,
    mat,
    msub,
    mul,
    put_at,
    put_mat,
    scale,
    tapply,
    transpose,
    vec,
    vec_at,
)
from flexinv.typing import Array, Indices

ZERO_MATRIX = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@send_by_address
class PlanarFactors(NamedTuple):
    """The linearisation of a planar mechanism on its tree, eliminated.

    rows : (elements,) number of own unknowns; row : (elements, count, columns) where those of each node stand among them
    unknowns : (elements, rows) number of the unknown
    inverse : (elements, rows, wide) S^-T; to_root : (elements, 3, rows) own rows by the root's pose; b, x : (elements, columns,
        rows) B^T and (S^-1 B)^T; root : (parts, columns, wide) inverses of the blocks on the world
    diagonal : (blocks, columns, columns); line (2, wide), found (elements, wide) : scratch
    """

    rows: Indices
    row: Indices
    unknowns: Indices
    inverse: Array
    to_root: Array
    b: Array
    x: Array
    root: Array
    diagonal: Array
    line: Array
    scratch: Array


@jit_inner
def add_element_stiffness(tree, elements, points, frames, factors):
    """Put the stiffness of all elements into their own linearisations, and what their roots feel into dwrench [N], [N m]."""
    for k in range(len(elements.order)):
        order = elements.order[k]
        root = elements.nodes[k, 0]
        block = factors.inverse[k]
        columns = tree.width[root]
        for r in range(3 * order, factors.rows[k]):
            for c in range(factors.rows[k]):
                block[r, c] = 0.0
                block[c, r] = 0.0
        for i in range(order):
            if columns > 0:
                stiffness = compute_pair_stiffness(k, i + 1, 0, elements, points)
                for a in range(3):  # all x first, then y, then theta
                    for c in range(3):
                        factors.to_root[k, c, a * order + i] = stiffness[a][c]
            for j in range(i + 1):
                stiffness = compute_pair_stiffness(k, i + 1, j + 1, elements, points)
                for a in range(3):
                    for c in range(3):
                        block[a * order + i, c * order + j] = stiffness[a][c]
                        block[c * order + j, a * order + i] = stiffness[a][c]
        of_root = compute_pair_stiffness(k, 0, 0, elements, points) if columns > 0 else ZERO_MATRIX
        for c in range(columns):
            add_to(frames.dwrench[root, c], apply(of_root, vec(frames.by_pose[root, c])))


@jit_inner
def compute_planar_factors(tree, elements, frames, factors):
    """Eliminate the linearisation, whose diagonal blocks stand in factors.diagonal [N/m], [N], [N m]."""
    for k in range(len(elements.order) - 1, -1, -1):
        if _is_small(k, tree, elements, factors):
            _solve_small_element(k, tree, elements, frames, factors)
        else:
            _solve_element_blocks(k, tree, elements, frames, factors)
    for part in range(len(tree.span) - 1):
        for r in range(tree.size[part]):
            for c in range(tree.size[part]):
                factors.root[part, c, r] = factors.diagonal[part, r, c]
        invert(factors.root[part], tree.size[part])


@jit_inner
def _is_small(k, tree, elements, factors):
    """Return True if an element has three own unknowns and hangs on three: matrices that stay in registers."""
    return factors.rows[k] == 3 and tree.width[elements.nodes[k, 0]] == 3


@jit_inner
def _solve_small_element(k, tree, elements, frames, factors):
    """`_solve_element_blocks` of a small element."""
    root = elements.nodes[k, 0]
    diagonal = factors.diagonal[tree.block[elements.nodes[k, 1]]]
    first = factors.diagonal[tree.block[root]]
    inverse = inverse_transposed(madd(mat(factors.inverse[k]), mat(diagonal)))
    b = mul(mat(frames.by_pose[root]), mat(factors.to_root[k]))
    x = mul(b, inverse)
    put_mat(factors.inverse[k], inverse)
    put_mat(factors.b[k], b)
    put_mat(factors.x[k], x)
    put_mat(first, msub(mat(first), mul(b, transpose(x))))


@jit_inner
def _solve_element_blocks(k, tree, elements, frames, factors):
    """Condense element k onto its first block."""
    nodes = elements.nodes[k]
    rows = factors.rows[k]
    inverse = factors.inverse[k]
    b = factors.b[k]
    x = factors.x[k]
    root = nodes[0]
    first = tree.block[nodes[0]]
    columns = tree.size[first]
    for i in range(1, elements.order[k] + 1):
        block = tree.block[nodes[i]]
        place = factors.row[k, i]
        for r in range(tree.size[block]):
            for c in range(tree.size[block]):
                inverse[place[c], place[r]] += factors.diagonal[block, r, c]
    invert(inverse, rows)
    for c in range(columns):
        v1 = frames.by_pose[root, c, 0]
        v2 = frames.by_pose[root, c, 1]
        v3 = frames.by_pose[root, c, 2]
        for r in range(rows):
            b[c, r] = factors.to_root[k, 0, r] * v1 + factors.to_root[k, 1, r] * v2 + factors.to_root[k, 2, r] * v3
        _compute_transposed_product(inverse, b[c], x[c], rows)  # behind its rows b is zero
    for c in range(columns):
        for d in range(columns):
            factors.diagonal[first, d, c] -= _dot(b[d], x[c], rows)


@jit_inner
def _compute_transposed_product(a, v, out, size):
    """out = a^T v; behind ``size`` rows of ``a``, and of v and out, there are zeros up to a multiple of ROWS_AT_ONCE."""
    out[:size] = 0.0
    for c in range(0, size, ROWS_AT_ONCE):
        p = v[c]
        q = v[c + 1]
        s = v[c + 2]
        t = v[c + 3]
        if p == 0.0 and q == 0.0 and s == 0.0 and t == 0.0:  # closures are felt at their nodes only
            continue
        for r in range(size):
            out[r] += (p * a[c, r] + q * a[c + 1, r]) + (s * a[c + 2, r] + t * a[c + 3, r])
    for r in range(size, -(-size // ROWS_AT_ONCE) * ROWS_AT_ONCE):
        out[r] = 0.0


@jit_inner
def _dot(a, b, size):
    """a . b, with zeros behind ``size`` up to a multiple of ROWS_AT_ONCE."""
    p = 0.0
    q = 0.0
    s = 0.0
    t = 0.0
    for r in range(0, size, ROWS_AT_ONCE):
        p += a[r] * b[r]
        q += a[r + 1] * b[r + 1]
        s += a[r + 2] * b[r + 2]
        t += a[r + 3] * b[r + 3]
    return (p + q) + (s + t)


@jit_inner
def solve_tree(tree, elements, factors, residual, y):
    """Solve linearisation y = -residual with the factors at hand; y (unknowns,) [m], [rad].  Overwrites residual."""
    for part in range(len(tree.span) - 1):
        solve_part(tree, elements, factors, part, residual, y)


@jit_inner
def solve_part(tree, elements, factors, part, residual, y):
    """Do so for one part of the mechanism [m], [rad]."""
    for n in range(tree.first_element[part + 1] - 1, tree.first_element[part] - 1, -1):
        _update_residual(tree.element[n], tree, elements, factors, residual, y)
    _solve_world_block(tree, factors, part, residual, y)
    for n in range(tree.first_element[part], tree.first_element[part + 1]):
        _add_root_motion(tree.element[n], tree, elements, factors, y)


@jit_inner
def _update_residual(k, tree, elements, factors, residual, y):
    """Solve for an element's own unknowns while its first block stands still, and bring what they do to that."""
    first = tree.first[elements.nodes[k, 0]]
    if _is_small(k, tree, elements, factors):
        solved = tapply(mat(factors.inverse[k]), vec_at(residual, factors.unknowns[k, 0]))
        put_at(y, factors.unknowns[k, 0], scale(-1.0, solved))
        add_at(residual, first, scale(-1.0, apply(mat(factors.b[k]), solved)))
    else:
        _solve_own(k, tree, elements, factors, residual, factors.scratch[k], first)


@jit_inner
def _solve_world_block(tree, factors, part, residual, y):
    """Solve for the block on the world."""
    size = tree.size[part]
    start = tree.offset[part]
    line = factors.line
    for r in range(size):
        line[0, r] = residual[start + r]
    for r in range(size, -(-size // ROWS_AT_ONCE) * ROWS_AT_ONCE):
        line[0, r] = 0.0
    _compute_transposed_product(factors.root[part], line[0], line[1], size)
    for r in range(size):
        y[start + r] = -line[1, r]


@jit_inner
def _add_root_motion(k, tree, elements, factors, y):
    """Add to an element's own unknowns what its first block moves them by."""
    first = tree.first[elements.nodes[k, 0]]
    if _is_small(k, tree, elements, factors):
        add_at(y, factors.unknowns[k, 0], scale(-1.0, tapply(mat(factors.x[k]), vec_at(y, first))))
    else:
        found = factors.scratch[k]
        for c in range(tree.width[elements.nodes[k, 0]]):
            subtract(found, -y[first + c], factors.x[k, c], 0, factors.rows[k])
        for r in range(factors.rows[k]):
            y[factors.unknowns[k, r]] = -found[r]


@jit_inner
def _solve_own(k, tree, elements, factors, residual, found, first):
    """S^-1 r of an element, and what its own unknowns do to the residual of its first block while that stands still."""
    rows = factors.rows[k]
    unknowns = factors.unknowns[k]
    line = factors.line[0]
    for r in range(rows):
        line[r] = residual[unknowns[r]]
    for r in range(rows, -(-rows // ROWS_AT_ONCE) * ROWS_AT_ONCE):
        line[r] = 0.0
    _compute_transposed_product(factors.inverse[k], line, found, rows)
    for c in range(tree.width[elements.nodes[k, 0]]):
        residual[first + c] -= _dot(factors.b[k, c], found, rows)
