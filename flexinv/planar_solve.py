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

from flexinv.compiled import jit_inner
from flexinv.mechanism import Array
from flexinv.planar_beam import pair_stiffness
from flexinv.vectors import (
    add_to,
    apply,
    cross,
    dot,
    madd,
    mat,
    msub,
    mul,
    put,
    put_block,
    scale,
    tapply,
    transpose,
    vec_at,
)

NONE = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


class PlanarFactors(NamedTuple):
    """The linearisation of a planar mechanism on its tree, eliminated.

    rows : (elements,) number of own unknowns; row : (elements, count, columns) where those of each node stand among them
    own : (elements, rows) number of the unknown
    inverse : (elements, rows, wide) S^-T; to_root : (elements, 3, rows) own rows by the root's pose; b, x : (elements, columns,
        rows) B^T and (S^-1 B)^T; root : (columns, wide) the same of block 0
    diagonal : (blocks, columns, columns); line (2, wide), found (elements, wide) : scratch
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
    line: Array
    found: Array


@jit_inner
def invert(a, size, line):
    """Replace a[:size, :size] by its inverse [any unit]: Gauss-Jordan by three rows at a time, what is left by single ones.

    A vanishing pivot leaves infinities, which the caller's test finds.  line : (2, size) scratch
    """
    threes = size - size % 3
    for k in range(0, threes, 3):
        _sweep_three(a, k, size)
    for k in range(threes, size):
        _sweep(a, k, size, line[0], line[1])


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
def _sweep(a, k, size, row, column):
    """One step of Gauss-Jordan with the pivot row k; rows of ``a`` are contiguous."""
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


@jit_inner
def _subtract(a, factor, b, size):
    for c in range(size):
        a[c] -= factor * b[c]


@jit_inner
def put_stiffness(t, e, p, f, q):
    """Put the stiffness of all elements into their own linearisations, and what their roots feel into dwrench [N], [N m]."""
    for k in range(len(e.order)):
        order, root, own = e.order[k], e.nodes[k, 0], q.inverse[k]
        columns = t.size[t.block[root]]
        for r in range(3 * order, q.rows[k]):
            for c in range(q.rows[k]):
                own[r, c], own[c, r] = 0.0, 0.0
        for i in range(order):
            if columns > 0:
                _put_root(q.to_root[k], order, i, pair_stiffness(k, i + 1, 0, e, p))
            for j in range(i + 1):
                _put_pair(own, order, i, j, pair_stiffness(k, i + 1, j + 1, e, p))
        of_root = pair_stiffness(k, 0, 0, e, p) if columns > 0 else NONE
        for c in range(columns):
            add_to(f.dwrench[root, c], 0, apply(of_root, vec_at(f.by_pose[root, c], 0)))


@jit_inner
def _put_root(to_root, order, i, stiffness):
    """Write how the forces on node i vary with the root's pose, all x first, then y, then theta."""
    for a in range(3):
        put_column(to_root, a * order + i, stiffness[a])


@jit_inner
def put_column(m, c, v):
    """Write v into column c of m (3, columns) [any unit]."""
    m[0, c], m[1, c], m[2, c] = v


@jit_inner
def _put_pair(own, order, i, j, stiffness):
    """Write a pair of nodes into the matrix of an element, all x first, then y, then theta; the energy's is symmetric."""
    (xx, xy, xt), (yx, yy, yt), (tx, ty, tt) = stiffness
    y, theta = order, 2 * order
    own[i, j], own[i, y + j], own[i, theta + j] = xx, xy, xt
    own[y + i, j], own[y + i, y + j], own[y + i, theta + j] = yx, yy, yt
    own[theta + i, j], own[theta + i, y + j], own[theta + i, theta + j] = tx, ty, tt
    own[j, i], own[y + j, i], own[theta + j, i] = xx, xy, xt
    own[j, y + i], own[y + j, y + i], own[theta + j, y + i] = yx, yy, yt
    own[j, theta + i], own[y + j, theta + i], own[theta + j, theta + i] = tx, ty, tt


@jit_inner
def factorise(t, e, f, q):
    """Eliminate the linearisation, whose diagonal blocks stand in q.diagonal [N/m], [N], [N m]."""
    for k in range(len(e.order) - 1, -1, -1):
        if _is_small(k, t, e, q):
            _condense_small(k, t, e, f, q)
        else:
            _condense(k, t, e, f, q)
    roots = t.size[0]
    for r in range(roots):
        for c in range(roots):
            q.root[c, r] = q.diagonal[0, r, c]
    invert(q.root, roots, q.line)


@jit_inner
def _is_small(k, t, e, q):
    """Whether an element of order 1 has three own unknowns and hangs on three: matrices that stay in registers."""
    return q.rows[k] == 3 and t.size[t.block[e.nodes[k, 0]]] == 3


@jit_inner
def _condense_small(k, t, e, f, q):
    """`_condense` of a small element."""
    root = e.nodes[k, 0]
    own, first = q.diagonal[t.block[e.nodes[k, 1]]], q.diagonal[t.block[root]]
    inverse = inverse_transposed(madd(mat(q.inverse[k]), mat(own)))
    b = mul(mat(f.by_pose[root]), mat(q.to_root[k]))
    x = mul(b, inverse)
    put_block(q.inverse[k], 0, 0, inverse)
    put_block(q.b[k], 0, 0, b)
    put_block(q.x[k], 0, 0, x)
    put_block(first, 0, 0, msub(mat(first), mul(b, transpose(x))))


@jit_inner
def inverse_transposed(m):
    """Return the transposed inverse of a (3, 3) matrix [any unit]: its cofactors over its determinant."""
    x, y, z = cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])
    over = 1.0 / dot(m[0], x)
    return scale(over, x), scale(over, y), scale(over, z)


@jit_inner
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
        _transposed_product(inverse, b[c], x[c], rows)  # behind its rows b is zero
    for c in range(columns):
        for d in range(columns):
            q.diagonal[first, d, c] -= _dot(b[d], x[c], rows)


# Rows of a matrix that a product takes at a time: sums wait for each other a quarter as often.
FOUR = 4


@jit_inner
def _transposed_product(a, v, out, size):
    """out = a^T v; behind ``size`` rows of ``a`` and numbers of v and out are there, up to a multiple of FOUR, v and out zero."""
    for r in range(size):
        out[r] = 0.0
    for c in range(0, size, FOUR):
        p, q, s, t = v[c], v[c + 1], v[c + 2], v[c + 3]
        for r in range(size):
            out[r] += (p * a[c, r] + q * a[c + 1, r]) + (s * a[c + 2, r] + t * a[c + 3, r])
    for r in range(size, -(-size // FOUR) * FOUR):
        out[r] = 0.0


@jit_inner
def _few_rows(a, v, out, size):
    """The same where most of v is zero: closures are felt at their nodes only."""
    for r in range(-(-size // FOUR) * FOUR):
        out[r] = 0.0
    for c in range(size):
        if v[c] != 0.0:
            _subtract(out, -v[c], a[c], size)


@jit_inner
def _dot(a, b, size):
    """a . b, with zeros behind ``size`` up to a multiple of FOUR."""
    p, q, s, t = 0.0, 0.0, 0.0, 0.0
    for r in range(0, size, FOUR):
        p += a[r] * b[r]
        q += a[r + 1] * b[r + 1]
        s += a[r + 2] * b[r + 2]
        t += a[r + 3] * b[r + 3]
    return (p + q) + (s + t)


@jit_inner
def solve(t, e, q, residual, y, few):
    """Solve linearisation y = -residual with the factors at hand; y (unknowns,) [m], [rad].  Overwrites residual.

    few : whether most of the residual is zero
    """
    for k in range(len(e.order) - 1, -1, -1):
        first = t.offset[t.block[e.nodes[k, 0]]]
        if _is_small(k, t, e, q):
            own = tapply(mat(q.inverse[k]), vec_at(residual, q.own[k, 0]))
            put(y, q.own[k, 0], scale(-1.0, own))
            add_to(residual, first, scale(-1.0, apply(mat(q.b[k]), own)))
        else:
            _solve_own(k, t, e, q, residual, q.found[k], first, few)
    _fill(residual, t.size[0], q.line[0])
    _transposed_product(q.root, q.line[0], q.line[1], t.size[0])
    for r in range(t.size[0]):
        y[r] = -q.line[1, r]
    for k in range(len(e.order)):
        first = t.offset[t.block[e.nodes[k, 0]]]
        if _is_small(k, t, e, q):
            add_to(y, q.own[k, 0], scale(-1.0, tapply(mat(q.x[k]), vec_at(y, first))))
        else:
            found = q.found[k]
            for c in range(t.size[t.block[e.nodes[k, 0]]]):
                _subtract(found, -y[first + c], q.x[k, c], q.rows[k])
            for r in range(q.rows[k]):
                y[q.own[k, r]] = -found[r]


@jit_inner
def _fill(v, size, line):
    """Copy ``size`` numbers of v, and zeros behind them up to a multiple of FOUR."""
    for r in range(size):
        line[r] = v[r]
    for r in range(size, -(-size // FOUR) * FOUR):
        line[r] = 0.0


@jit_inner
def _solve_own(k, t, e, q, residual, found, first, few):
    """S^-1 r of an element, and what its own unknowns do to the residual of its first block while that stands still."""
    rows, own, line = q.rows[k], q.own[k], q.line[0]
    for r in range(rows):
        line[r] = residual[own[r]]
    for r in range(rows, -(-rows // FOUR) * FOUR):
        line[r] = 0.0
    if few:
        _few_rows(q.inverse[k], line, found, rows)
    else:
        _transposed_product(q.inverse[k], line, found, rows)
    for c in range(t.size[t.block[e.nodes[k, 0]]]):
        residual[first + c] -= _dot(q.b[k, c], found, rows)
