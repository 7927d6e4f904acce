"""Extrapolation is exact for what its expansion holds, in the Lie algebra for rotations."""

from __future__ import annotations

import numpy as np
import pytest

from flexinv.analysis.extrapolation import compute_extrapolated_rotations, compute_weighted_sum, weights
from flexinv.kernels.so3 import exp_so3, log_so3


@pytest.mark.parametrize("finer", [(1, 2), (2, 3), (8, 12), (1, 2, 3), (4, 6, 8)])
def test_even_powers_cancel(finer: tuple[int, ...]) -> None:
    h, weight = 1.0 / np.array(finer), weights(finer)
    for power in range(0, 2 * len(finer), 2):
        wanted = 1.0 if power == 0 else 0.0
        assert abs(weight @ h**power - wanted) < 1e-13  # rounding of weights up to 10
    assert abs(weight @ h ** (2 * len(finer))) > 1e-9  # the next power stays


def test_rotations_extrapolate_to_the_order_of_all_else() -> None:
    """R(h) = R exp(a h^2 + b h^4): two of them leave h^4, where the sum of the matrices is no rotation."""
    turn, a, b = exp_so3(np.array([0.4, -1.2, 2.0])), np.array([0.3, 0.2, -0.5]), np.array([-0.2, 0.6, 0.1])

    def at(h: float) -> np.ndarray:
        return turn @ exp_so3(a * h**2 + b * h**4)

    left = []
    for h in (0.2, 0.1):
        pair = [at(h), at(h / 2)]
        extrapolated_rotations = compute_extrapolated_rotations(pair, weights((1, 2)))
        assert np.abs(extrapolated_rotations.T @ extrapolated_rotations - np.eye(3)).max() < 1e-15
        mixed = compute_weighted_sum(pair, weights((1, 2)))
        assert np.abs(mixed.T @ mixed - np.eye(3)).max() > 1e-6
        left.append(np.linalg.norm(log_so3(turn.T @ extrapolated_rotations)))
    assert abs(np.log2(left[0] / left[1]) - 4.0) < 0.1  # the next power adds some per cent
