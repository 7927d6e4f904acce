"""Compiled doors to kernels that Python cannot call, and the central difference that tests compare with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexinv.dynamics.generalized_alpha import end_step, prepare_step, update_rates
from flexinv.dynamics.loads import evaluate_pull
from flexinv.dynamics.tree_solver import solve_tree
from flexinv.elements.beam import fill_relative_poses, fill_relative_rates
from flexinv.elements.beam_element import (
    fill_damped_tangent,
    fill_element_forces,
    fill_element_gradient,
    fill_element_tangent,
)
from flexinv.kernels.jit import jit, jit_blocks
from flexinv.kernels.simd import LANES
from flexinv.kernels.so3 import coefficients, inverse_coefficient, inverse_tangent
from flexinv.kernels.vec3 import put_mat, vec
from flexinv.rnea.loop_allocation import solve_row, solve_six_forces
from flexinv.typing import Array

__all__ = [
    "all_coefficients", "damped_element", "derivative", "element", "eliminate", "fill_pulls",
    "inverse_tangent_one", "oscillate", "six", "solved_by",
]  # fmt: skip

STEP = 1e-3
# Error of `derivative` relative to the size of f and its derivatives: rounding 1.5 eps/STEP is 3e-13 for f known to an
# eps, a few operations make it ten; truncation STEP^4/30 f^(5) is 3e-14 times a fifth derivative.
DIFFERENCE = 5e-12


def derivative(f: Callable[[float], Array]) -> Array:
    """f'(0) by the fourth-order central difference."""
    near, far = f(STEP) - f(-STEP), f(2 * STEP) - f(-2 * STEP)
    return np.asarray((8 * near - far) / (12 * STEP))


@jit
def fill_pulls(laws, k, lengths, out):
    """Pull and slope of spring k at lengths, a row each."""
    for i in range(len(lengths)):
        out[i, 0], out[i, 1] = evaluate_pull(laws, k, lengths[i])


@jit
def element(k, count, e, z, internal, tangent):
    """Evaluate one element whose poses stand in z; return its energy."""
    fill_relative_poses(count, z)
    energy, _ = fill_element_gradient(k, count, e, z, None, internal, True)
    fill_element_forces(count, z)
    fill_element_tangent(count, z, tangent)
    return energy


@jit
def damped_element(k, count, e, z, y, nodes, d, internal, tangent):
    """Evaluate one damped element whose poses stand in z, velocities in y; return its energy and dissipated power."""
    fill_relative_poses(count, z)
    fill_relative_rates(count, z, y)
    stored, gone = fill_element_gradient(k, count, e, z, y, internal, True)
    fill_element_forces(count, z)
    fill_damped_tangent(count, z, y, nodes, d, tangent)
    return stored, gone


@jit
def eliminate(t, e, d, work, plan, y):
    """Solve the linearisation on the tree for the residual."""
    solve_tree(t, e, d, work, plan, True, y)


@jit
def inverse_tangent_one(psi, out):
    """H(psi)^-1 into out (3, 3)."""
    put_mat(out, inverse_tangent(vec(psi)))


@jit
def all_coefficients(s):
    """A, A', A'', B, B', B'', c, c' at s."""
    return coefficients(s), inverse_coefficient(s)


@jit_blocks
def six(multipliers, efforts, entries, least):
    """Solve sum lambda_i row_i = efforts for six rows, a block of samples each; return how many are in doubt."""
    few = (least, least, least, least, least, least)
    return solve_six_forces(multipliers, efforts, entries, LANES, few)


@jit
def oscillate(t, c, s, x, squared):
    """Steps of u' = -squared x for every unknown; x (steps + 1, unknowns) holds the start in its first row."""
    for step in range(1, x.shape[0]):
        prepare_step(c, s)
        for k in range(x.shape[1]):
            s.d[k] -= (s.du[k] + squared * (x[step - 1, k] + s.d[k])) / (c.ca + squared)
        update_rates(c, s)
        for k in range(x.shape[1]):
            x[step, k] = x[step - 1, k] + s.d[k]
        end_step(t, c, s)


@jit_blocks
def solved_by(multiplier, pivot, effort, size, part, least):
    """Set multipliers by pivots; return how many are too small."""
    return solve_row(multiplier, pivot, effort, size, LANES, part, least)
