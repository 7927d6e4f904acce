"""The border: a few more unknowns beside those of the tree, multipliers of closures and forces of springs (compiled).

With K of the tree, every row k of the border adds an unknown lambda_k, a column C_k (what the unknown does to the
residual) and an equation:

    K y - C dlambda = -r          A_k . y + e_k dlambda_k = -phi_k

solved by y = y_0 + K^-1 C dlambda on the tree, and the border  (A K^-1 C + e) dlambda = -phi - A y_0  with complete pivoting:
rows that add nothing (redundant constraints of planar loops, closures that do not act) are found there and keep their unknowns.
"""

from __future__ import annotations

import numpy as np

from flexinv.compiled import jit_inner

# A pivot of the border, scaled to a unit diagonal, below this belongs to a redundant row: rounding leaves 1e-14.
REDUNDANT_PIVOT = 1e-10


@jit_inner
def solve_border(c, unit, y):
    """Find the increments of the border's unknowns and add what they do to y[0] [m], [rad].

    c : `ties.Ties`; y : (1 + rows, unknowns), y_0 and then K^-1 C; ``unit`` scales the equations of constraints
    """
    rows = len(c.a)
    for i in range(rows):
        for j in range(rows):
            c.border[i, j] = -product(c.across[i], y[1 + j])
        c.border[i, i] -= c.give[i]
        c.border[i, rows] = product(c.across[i], y[0]) - c.value[i] / (unit if c.give[i] == 0.0 else 1.0)
        c.order[i] = i
    solve_pivoted(c, rows)
    for k in range(rows):
        c.multiplier[k] += c.step[k]
        for i in range(y.shape[1]):
            y[0, i] += c.step[k] * y[1 + k, i]


@jit_inner
def product(a, b):
    """Return a . b of two rows [any unit]."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@jit_inner
def solve_pivoted(c, rows):
    """Solve c.border (rows, rows + 1) for c.step [N], [N m], with complete pivoting; what adds nothing gets a zero step.

    Overwrites c.border and c.value; c.order : (rows,) 0, 1, ...
    """
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
