"""The border: a few more unknowns beside those of the tree, multipliers of closures and forces of springs (compiled).

With K of the tree, every row k of the border adds an unknown lambda_k, a column C_k (what the unknown does to the
residual) and an equation:

    K y - C dlambda = -r          A_k . y + e_k dlambda_k = -phi_k

solved by y = y_0 + K^-1 C dlambda on the tree, and the border  (A K^-1 C + e) dlambda = -phi - A y_0  with complete pivoting:
rows that add nothing (redundant constraints of planar loops, closures that do not act) are found there and keep their unknowns.
"""

from __future__ import annotations

from flexinv.kernels.dense import solve_symmetric
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
    work = constraints.order, constraints.value
    solve_symmetric(constraints.border, rows, REDUNDANT_PIVOT, constraints.step, work)
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
