"""Closures in the march: constraint equations between two nodes, their gradients, and the small border that they add.

Same equations as `closures`, one row each: position u . d = 0 or direction u . w = 0.  With the gradient g of a row (force on
node b and a in the world, moment in the node's own frame) the step solves

    K y - G^T dlambda = -(r - G^T lambda)          G y = -phi

by y = y_0 + K^-1 G^T dlambda on the tree, and the border  (G K^-1 G^T) dlambda = -phi - G y_0  with complete pivoting: rows
that add nothing (redundant constraints of planar loops) are found there and keep their multipliers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.closures import constraint_rows
from flexinv.compiled import jit_inner
from flexinv.mechanism import Array
from flexinv.mesh import Mesh
from flexinv.vectors import add, apply, cross, dot, mat, put, scale, sub, tapply, vec, vec_at

# A pivot of the border, scaled to a unit diagonal, below this belongs to a redundant row: rounding leaves 1e-14.
REDUNDANT_PIVOT = 1e-10
NONE = (0.0, 0.0, 0.0)
UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Ties(NamedTuple):
    """Constraint rows of all closures (see `closures.Rows`) and the arrays of the border.

    direction : (rows,); a, b : (rows,) nodes; place_a, place_b [m], u, w : (rows, 3) in the nodes' frames
    multiplier : (rows,) [N], [N m]; value : (rows,) phi, or phi'' when accelerations are solved for
    gradient : (rows, 12) by the motion of a (world, own frame) and of b
    sides : (rows, unknowns) -G^T by unknowns; border : (rows, rows + 1); order, step, kept : (rows,) scratch
    """

    direction: NDArray[np.bool_]
    a: NDArray[np.int64]
    b: NDArray[np.int64]
    place_a: Array
    place_b: Array
    u: Array
    w: Array
    multiplier: Array
    value: Array
    gradient: Array
    sides: Array
    border: Array
    order: NDArray[np.int64]
    step: Array
    kept: Array


def ties(mesh: Mesh, unknowns: int) -> Ties:
    """Return the constraint rows of a mesh's closures as compiled code takes them [m], [-]."""
    rows = constraint_rows(mesh)
    n = len(rows)
    return Ties(
        direction=rows.direction,
        a=rows.a,
        b=rows.b,
        place_a=rows.place_a,
        place_b=rows.place_b,
        u=rows.u,
        w=rows.w,
        multiplier=np.zeros(n),
        value=np.zeros(n),
        gradient=np.zeros((n, 12)),
        sides=np.zeros((n, unknowns)),
        border=np.zeros((n, n + 1)),
        order=np.zeros(n, dtype=np.int64),
        step=np.zeros(n),
        kept=np.zeros(n),
    )


@jit_inner
def _carried(n, f, vector):
    """A vector fixed in node n's frame and its two rates, world axes (n = -1: the world)."""
    if n < 0:
        return vector, NONE, NONE
    r, w, al = mat(f.r[n]), vec(f.w[n]), vec(f.al[n])
    spin = cross(w, vector)
    return apply(r, vector), apply(r, spin), apply(r, add(cross(al, vector), cross(w, spin)))


@jit_inner
def _origin(n, f, arm):
    """Position, velocity and acceleration of a closure's frame from the lever arm and its rates."""
    if n < 0:
        return arm
    return add(vec(f.x[n]), arm[0]), add(vec(f.v[n]), arm[1]), add(vec(f.a[n]), arm[2])


@jit_inner
def tie_rows(c, f, accelerations):
    """Set value and gradient of every row, and return nothing [m], [-]: phi, or phi'' = u''.w + 2 u'.w' + u.w''."""
    for k in range(len(c.a)):
        a, b = c.a[k], c.b[k]
        u = _carried(a, f, vec(c.u[k]))
        if c.direction[k]:
            w = _carried(b, f, vec(c.w[k]))
        else:
            xa, xb = _origin(a, f, _carried(a, f, vec(c.place_a[k]))), _origin(b, f, _carried(b, f, vec(c.place_b[k])))
            w = sub(xb[0], xa[0]), sub(xb[1], xa[1]), sub(xb[2], xa[2])
        if accelerations:
            c.value[k] = dot(u[2], w[0]) + 2 * dot(u[1], w[1]) + dot(u[0], w[2])
        else:
            c.value[k] = dot(u[0], w[0])
        _set_gradient(k, a, b, c, f, u[0], w[0])


@jit_inner
def _set_gradient(k, a, b, c, f, u, w):
    """phi' = g_a . (v_a, w_a) + g_b . (v_b, w_b), angular velocities in the nodes' own frames."""
    ra = mat(f.r[a]) if a >= 0 else UNIT
    rb = mat(f.r[b]) if b >= 0 else UNIT
    on_a = cross(vec(c.u[k]), tapply(ra, w))
    if c.direction[k]:
        put(c.gradient[k], 0, NONE)
        put(c.gradient[k], 3, on_a)
        put(c.gradient[k], 6, NONE)
        put(c.gradient[k], 9, cross(vec(c.w[k]), tapply(rb, u)))
        return
    put(c.gradient[k], 0, scale(-1.0, u))
    put(c.gradient[k], 3, sub(on_a, cross(vec(c.place_a[k]), tapply(ra, u))))
    put(c.gradient[k], 6, u)
    put(c.gradient[k], 9, cross(vec(c.place_b[k]), tapply(rb, u)))


@jit_inner
def add_ties(c, wrench):
    """Take the forces of the multipliers off the wrenches of their nodes, r - G^T lambda [N], [N m]."""
    for k in range(len(c.a)):
        for i in range(6):
            if c.a[k] >= 0:
                wrench[c.a[k], i] -= c.multiplier[k] * c.gradient[k, i]
            if c.b[k] >= 0:
                wrench[c.b[k], i] -= c.multiplier[k] * c.gradient[k, 6 + i]


@jit_inner
def tie_sides(t, c, d, residual):
    """Put -G^T, by unknowns, into the right sides 1.. of the solve [N], [N m] per unit multiplier."""
    for k in range(len(c.a)):
        for i in range(residual.shape[1]):
            c.sides[k, i] = 0.0
        _add_side(t, c.a[k], d, c.gradient[k], 0, c.sides[k])
        _add_side(t, c.b[k], d, c.gradient[k], 6, c.sides[k])
        for i in range(residual.shape[1]):
            residual[1 + k, i] = c.sides[k, i]


@jit_inner
def _add_side(t, n, d, gradient, first, side):
    if n < 0:
        return
    block = t.block[n]
    for k in range(t.size[block]):
        along = dot(vec_at(gradient, first), vec(d.x[n, k])) + dot(vec_at(gradient, first + 3), vec(d.t[n, k]))
        side[t.offset[block] + k] -= along


@jit_inner
def solve_border(c, unit, y):
    """Find the multipliers' increments and add what they do to y[0] [m], [rad].

    y : (1 + rows, unknowns), y_0 and then K^-1 G^T; ``unit`` scales phi
    """
    rows = len(c.a)
    for i in range(rows):
        for j in range(rows):
            c.border[i, j] = -_product(c.sides[i], y[1 + j])
        c.border[i, rows] = -c.value[i] / unit + _product(c.sides[i], y[0])
        c.order[i] = i
    _solve_pivoted(c, rows)
    for k in range(rows):
        c.multiplier[k] += c.step[k]
        for i in range(y.shape[1]):
            y[0, i] += c.step[k] * y[1 + k, i]


@jit_inner
def _product(a, b):
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@jit_inner
def _solve_pivoted(c, rows):
    """Gauss elimination of the border with complete pivoting; what adds nothing gets a zero step."""
    m = c.border
    for k in range(rows):  # to a unit diagonal: closures of metres and of radians, stiff and soft, side by side
        c.step[k] = 1.0 / np.sqrt(abs(m[k, k])) if m[k, k] != 0.0 else 0.0
    for i in range(rows):
        m[i, rows] *= c.step[i]
        for j in range(rows):
            m[i, j] *= c.step[i] * c.step[j]
    for k in range(rows):
        c.value[k] = c.step[k]
    rank = rows
    for k in range(rows):
        p, q = k, k
        for i in range(k, rows):
            for j in range(k, rows):
                if abs(m[i, j]) > abs(m[p, q]):
                    p, q = i, j
        if not abs(m[p, q]) > REDUNDANT_PIVOT:
            rank = k
            break
        _exchange(m, c.order, rows, k, p, q)
        for i in range(k + 1, rows):
            factor = m[i, k] / m[k, k]
            for j in range(k, rows + 1):
                m[i, j] -= factor * m[k, j]
    for k in range(rows):
        c.step[k] = 0.0
    for k in range(rank - 1, -1, -1):
        value = m[k, rows]
        for j in range(k + 1, rank):
            value -= m[k, j] * c.step[c.order[j]]
        c.step[c.order[k]] = value / m[k, k]
    for k in range(rows):
        c.step[k] *= c.value[k]


@jit_inner
def _exchange(m, order, rows, k, p, q):
    if p != k:
        for j in range(rows + 1):
            m[k, j], m[p, j] = m[p, j], m[k, j]
    if q != k:
        for i in range(rows):
            m[i, k], m[i, q] = m[i, q], m[i, k]
        order[k], order[q] = order[q], order[k]
