"""The border: a few more unknowns beside those of the tree, multipliers of closures and forces of springs (compiled).

With K of the tree, every row k of the border adds an unknown lambda_k, a column C_k (what the unknown does to the
residual) and an equation:

    K y - C dlambda = -r          A_k . y + e_k dlambda_k = -phi_k

solved by y = y_0 + K^-1 C dlambda on the tree, and the border  (A K^-1 C + e) dlambda = -phi - A y_0  with complete pivoting:
rows that add nothing (redundant constraints of planar loops, closures that do not act) are found there and keep their unknowns.
"""

from __future__ import annotations

import numpy as np

from flexinv.kernels.jit import jit_inner

# A pivot of the border, scaled to a unit diagonal, below this belongs to a redundant row: rounding leaves 1e-14.
REDUNDANT_PIVOT = 1e-10


@jit_inner
def solve_border(constraints, unit, y):
    """Find the increments of the border's unknowns and add what they do to y[0] [m], [rad].

    constraints : `dynamics.constraint_rows.Ties`; y : (1 + rows, unknowns), y_0 and then K^-1 C; ``unit`` scales the equations of
    constraints
    """
    rows = len(constraints.a)
    for i in range(rows):
        for j in range(rows):
            constraints.border[i, j] = -product(constraints.across[i], y[1 + j])
        constraints.border[i, i] -= constraints.give[i]
        constraints.border[i, rows] = product(constraints.across[i], y[0]) - constraints.value[i] / (
            unit if constraints.give[i] == 0.0 else 1.0
        )
        constraints.order[i] = i
    solve_pivoted(constraints, rows)
    for k in range(rows):
        constraints.multiplier[k] += constraints.step[k]
        for i in range(y.shape[1]):
            y[0, i] += constraints.step[k] * y[1 + k, i]


@jit_inner
def product(a, b):
    """Return a . b of two rows [any unit]."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@jit_inner
def solve_pivoted(constraints, rows):
    """Solve constraints.border (rows, rows + 1) for constraints.step [N], [N m], complete pivoting; redundant rows: zero.

    Overwrites constraints.border and constraints.value; constraints.order : (rows,) 0, 1, ...
    """
    m = constraints.border
    for k in range(rows):  # to a unit diagonal: closures of metres and of radians, stiff and soft, side by side
        constraints.step[k] = 1.0 / np.sqrt(abs(m[k, k])) if m[k, k] != 0.0 else 0.0
    for i in range(rows):
        m[i, rows] *= constraints.step[i]
        for j in range(rows):
            m[i, j] *= constraints.step[i] * constraints.step[j]
    for k in range(rows):
        constraints.value[k] = constraints.step[k]
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
        _exchange(m, constraints.order, rows, k, p, q)
        for i in range(k + 1, rows):
            factor = m[i, k] / m[k, k]
            for j in range(k, rows + 1):
                m[i, j] -= factor * m[k, j]
    for k in range(rows):
        constraints.step[k] = 0.0
    for k in range(rank - 1, -1, -1):
        value = m[k, rows]
        for j in range(k + 1, rank):
            value -= m[k, j] * constraints.step[constraints.order[j]]
        constraints.step[constraints.order[k]] = value / m[k, k]
    for k in range(rows):
        constraints.step[k] *= constraints.value[k]


@jit_inner
def _exchange(m, order, rows, k, p, q):
    if p != k:
        for j in range(rows + 1):
            m[k, j], m[p, j] = m[p, j], m[k, j]
    if q != k:
        for i in range(rows):
            m[i, k], m[i, q] = m[i, q], m[i, k]
        order[k], order[q] = order[q], order[k]
