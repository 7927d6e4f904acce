"""Rotations as theorems: exp and log are inverse, tangents are derivatives, series and closed forms meet."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from kernels import DIFFERENCE, all_coefficients, derivative, inverse_tangent_one
from scipy.spatial.transform import Rotation

from flexinv.kernels.so3 import (
    INVERSE_SERIES_LIMIT,
    SERIES_LIMIT,
    exp_so3,
    from_quaternion,
    log_so3,
    tangent3,
)

RNG = np.random.default_rng(5)
DIRECTIONS = RNG.normal(size=(20, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
ANGLES = (0.0, 1e-9, 1e-3, 0.4, 0.99, 1.01, 2.0, 3.0, 3.14)
# entries of size one after a dozen operations
ROUNDING = 12 * np.finfo(float).eps


def psi_of(angle: float) -> np.ndarray:
    return angle * DIRECTIONS


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_is_a_rotation_about_its_vector_by_its_length(angle: float) -> None:
    turns = exp_so3(psi_of(angle))
    np.testing.assert_allclose(np.swapaxes(turns, 1, 2) @ turns, np.tile(np.eye(3), (20, 1, 1)), atol=ROUNDING)
    for turn, axis in zip(turns, DIRECTIONS, strict=True):
        np.testing.assert_allclose(turn, Rotation.from_rotvec(angle * axis).as_matrix(), atol=ROUNDING)
        half = np.append(np.sin(angle / 2) * axis, np.cos(angle / 2))
        np.testing.assert_allclose(turn, from_quaternion(3.0 * half), atol=ROUNDING)  # any length


def test_log_undoes_exp() -> None:
    for angle in ANGLES:
        # near pi a rounding of R turns the axis by as much: log is no worse than its argument
        np.testing.assert_allclose(log_so3(exp_so3(psi_of(angle))), psi_of(angle), atol=np.pi * ROUNDING)


@pytest.mark.parametrize("axis", [*np.eye(3), *(-np.eye(3)), [0.6, 0.8, 0.0], [0.0, 0.6, -0.8], [0.8, 0.0, 0.6]])
def test_log_of_half_a_turn_is_half_a_turn(axis: list[float]) -> None:
    turn = 2.0 * np.outer(axis, axis) - np.eye(3)
    assert np.linalg.norm(log_so3(turn)) == pytest.approx(np.pi, rel=ROUNDING)
    np.testing.assert_allclose(exp_so3(log_so3(turn)), turn, atol=np.pi * ROUNDING)


def test_shapes_follow_the_argument_and_nothing_is_changed() -> None:
    psi = RNG.normal(size=(2, 4, 3))
    kept = psi.copy()
    turns = exp_so3(psi)
    assert turns.shape == (2, 4, 3, 3)
    assert log_so3(turns).shape == (2, 4, 3)
    assert (psi == kept).all()
    np.testing.assert_array_equal(turns[1, 2], exp_so3(psi[1, 2]))
    np.testing.assert_array_equal(exp_so3(psi[:, ::2]), turns[:, ::2])  # strides


def tangent_error(psi: np.ndarray, tangent: np.ndarray) -> float:
    """Largest error of the columns of H against R^T dR, by differences."""
    turned = exp_so3(psi).T
    worst = 0.0
    for k, column in enumerate(np.eye(3)):
        spin = turned @ derivative(lambda h, c=column: exp_so3(psi + h * c))
        body = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        worst = max(worst, float(np.abs(body - tangent[:, k]).max()))
    return worst


@pytest.mark.parametrize("angle", ANGLES)
def test_tangent_is_the_derivative_of_exp(angle: float) -> None:
    for psi in psi_of(angle):
        assert tangent_error(psi, tangent3(psi)) < DIFFERENCE
        inverse = np.zeros((3, 3))
        inverse_tangent_one(psi, inverse)
        # H^-1 grows as t/2 / sin(t/2) <= pi/2 here
        np.testing.assert_allclose(inverse @ tangent3(psi), np.eye(3), atol=np.pi * ROUNDING)


def test_a_wrong_tangent_is_found() -> None:
    psi = psi_of(0.4)[0]
    assert tangent_error(psi, tangent3(psi).T) > 0.1  # left instead of right
    assert tangent_error(psi, tangent3(psi) + 1e-10) > DIFFERENCE


def exact(s: float) -> list[float]:
    """A, A', A'', B, B', B'', c, c' with 60 digits."""
    with mpmath.workdps(60):
        at = mpmath.mpf(s)
        a = [mpmath.diff(lambda x: (1 - mpmath.cos(mpmath.sqrt(x))) / x, at, k) for k in range(3)]
        b = [mpmath.diff(lambda x: (1 - mpmath.sin(mpmath.sqrt(x)) / mpmath.sqrt(x)) / x, at, k) for k in range(3)]
        c = [
            mpmath.diff(lambda x: (1 - mpmath.sqrt(x) / 2 * mpmath.cot(mpmath.sqrt(x) / 2)) / x, at, k)
            for k in range(2)
        ]
        return [float(value) for value in (*a, *b, *c)]


LIMITS = [np.nextafter(SERIES_LIMIT, 0.0), SERIES_LIMIT, np.nextafter(INVERSE_SERIES_LIMIT, 0.0), INVERSE_SERIES_LIMIT]


@pytest.mark.parametrize("s", [1e-12, 0.3, 2.0, 6.25, *LIMITS])
def test_series_and_closed_forms_meet_at_the_limits(s: float) -> None:
    (got_a, got_c) = all_coefficients(s)
    # First neglected terms: of A 4^12 2!/26!, 2e-19; of c' 11 (2 pi)^-20, 1e-15.  Closed forms lose where they begin as many
    # eps as the value over s is larger than the derivative: B / (16 B'') = 27, c / c' = 60, a few times over.
    np.testing.assert_allclose([*got_a, *got_c], exact(s), rtol=1e-13)


def test_derivatives_of_coefficients_are_derivatives() -> None:
    for s in (0.1, 0.7, 2.0, 6.0):
        values = derivative(lambda h, s=s: np.concatenate(all_coefficients(s + h)))
        (_, a1, a2, _, b1, b2), (_, c1) = all_coefficients(s)
        assert np.abs(values[[0, 1, 3, 4, 6]] - [a1, a2, b1, b2, c1]).max() < DIFFERENCE
