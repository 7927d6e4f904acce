"""The elimination along the tree solves the same equations as a dense solver, and those are the derivative of the residual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kernels import DIFFERENCE, derivative, eliminate
from planar_examples import damped
from scenes import PASSIVE_KINDS, MovingSolver, branching, hanging, scene

from flexinv.dynamics.constraint_rows import PULL
from flexinv.dynamics.linearization import fill
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

UNDAMPED = [*(branching(kind) for kind in PASSIVE_KINDS), *(hanging(kind) for kind in PASSIVE_KINDS)]
DAMPED = [damped(m, 300.0) for m in (branching("free"), branching("prismatic"), hanging("spherical"))]
MECHANISMS = [*UNDAMPED, *(replace(m, name=f"{m.name}, damped") for m in DAMPED)]
EPS = np.finfo(float).eps


def by_differences(case: MovingSolver) -> Array:
    """Derivative of the residual by all unknowns."""
    columns = [derivative(lambda h, e=e: case.at(e, h)[1]) for e in np.eye(len(case.d))]
    return np.array(columns).T


def assembled(case: MovingSolver) -> Array:
    """The linearisation as one dense matrix, from the blocks and element tangents of the march; springs keep their forces."""
    out, ties = np.zeros((1, len(case.d), len(case.d))), case.solver.border.ties
    fill(case.solver.system, 0, out)
    springs = ties.kind == PULL
    return np.asarray(out[0] + ties.sides[springs].T @ ties.across[springs])


@pytest.mark.parametrize("mechanism", MECHANISMS, ids=lambda m: m.name)
def test_the_linearisation_is_the_derivative_of_the_residual(mechanism: Mechanism) -> None:
    case = scene(mechanism)
    slopes = by_differences(case)
    case.at(np.zeros(len(case.d)), 0.0)
    exact = assembled(case)
    assert np.abs(slopes - exact).max() < DIFFERENCE * np.abs(exact).max()


@pytest.mark.slow
@pytest.mark.parametrize("mechanism", MECHANISMS, ids=lambda m: m.name)
def test_elimination_equals_the_dense_solution(mechanism: Mechanism) -> None:
    case = scene(mechanism)
    solver = case.solver
    residual = case.at(np.zeros(len(case.d)), 0.0)[1]
    matrix = assembled(case)
    solution = np.zeros((1, len(case.d)))
    eliminate(solver.topology, solver.elements, solver.variation, solver.work, solver.border.ties.layout, solution)
    y = solution[0]
    expected = np.linalg.solve(matrix, -residual)
    # backward stable solvers agree to the condition of the matrix
    assert np.abs(y - expected).max() < np.linalg.cond(matrix) * EPS * np.abs(expected).max()
    wrong = matrix.copy()
    wrong[-1, -1] += 1e-6 * np.abs(matrix).max()
    assert np.abs(y - np.linalg.solve(wrong, -residual)).max() > np.linalg.cond(matrix) * EPS * np.abs(expected).max()
