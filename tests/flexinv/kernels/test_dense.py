"""Dense solvers of kernels against LAPACK: elimination and inversion, and what they do where a rank is not full."""

from __future__ import annotations

import numpy as np
import pytest

from flexinv.kernels.dense import invert, invert_scaled, solve_dense
from flexinv.kernels.jit import jit
from flexinv.typing import Array

EPS = np.finfo(float).eps
# Backward stable solvers agree to the condition of the matrix; ten for values up to ten and sums of some tens of terms.
LEVEL = 10 * EPS


@jit
def inverted(a, size):
    """Inverse of the first ``size`` rows and columns in place."""
    invert(a, size)


@jit
def inverted_scaled(a, rows, least, over, left):
    """Inverse of what has pivots above ``least`` in place."""
    invert_scaled(a, rows, least, over, left)


@pytest.mark.parametrize("size", [0, 1, 2, 4, 5, 7, 24])
def test_elimination_equals_lapack(size: int) -> None:
    rng = np.random.default_rng(size)
    matrix, right = rng.normal(size=(size, size)), rng.normal(size=(size, 3))
    if size > 1:
        matrix[0, 0] = 0.0  # needs a row exchange
    room = np.hstack([matrix, right, np.ones((size, 2))])
    room = np.vstack([room, np.ones((2, room.shape[1]))])
    solve_dense(room, size, size + 3)
    condition = np.linalg.cond(matrix) if size else 1.0
    np.testing.assert_allclose(room[:size, size : size + 3], np.linalg.solve(matrix, right), atol=condition * LEVEL)
    assert (room[size:] == 1.0).all()  # what is beyond is not touched
    assert (room[:, size + 3 :] == 1.0).all()


def test_a_singular_matrix_gives_no_finite_solution() -> None:
    room = np.array([[1.0, 2.0, 1.0], [2.0, 4.0, 1.0]])
    solve_dense(room, 2, 3)
    assert not np.isfinite(room[:, 2]).any()


def stiff(size: int) -> Array:
    """A symmetric positive definite matrix of rows in metres and in radians: entries of 1e6 beside such of 1e-6."""
    part = np.random.default_rng(size).normal(size=(size, 2 * size))
    units = np.where(np.arange(size) % 2, 1e3, 1e-3)
    return np.asarray(units[:, None] * (part @ part.T) * units)


def unit_error(values: Array, expected: Array, matrix: Array) -> float:
    """Largest error of an inverse with the rows of the matrix scaled to a unit diagonal."""
    over = np.sqrt(np.diag(matrix))
    return float(np.abs((values - expected) * np.outer(over, over)).max(initial=0.0))


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 9, 20])
def test_inverses_equal_those_of_lapack(size: int) -> None:
    matrix = stiff(size)
    over = 1 / np.sqrt(np.diag(matrix))
    scaled = matrix * np.outer(over, over)
    expected, level = np.linalg.inv(scaled), np.linalg.cond(scaled) * LEVEL
    result, other = scaled.copy(), matrix.copy()
    inverted(result, size)
    assert np.abs(result - expected).max() < level * np.abs(expected).max()
    inverted_scaled(other, size, 1e-10, np.empty(size), np.empty(size, dtype=bool))
    assert unit_error(other, expected * np.outer(over, over), matrix) < level * np.abs(expected).max()


def test_rows_that_repeat_others_are_left_out() -> None:
    matrix = stiff(4)
    pick = np.array(
        [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0], [1.0, 0, 0, 0]]
    )  # the last is the first
    whole = pick @ matrix @ pick.T
    result = whole.copy()
    inverted_scaled(result, 5, 1e-10, np.empty(5), np.empty(5, dtype=bool))
    assert (result[0] == 0.0).all() != (result[4] == 0.0).all()  # one of the two
