"""Noise is told by residuals as large as it was before parameters had made up for a part of it."""

from __future__ import annotations

import numpy as np
import pytest

from crosscheck.identification.estimation.noise import compute_autocovariance, compute_noise, count_agreeing_samples
from flexinv.typing import Array

SAMPLES, COUNT, KEEP, LOGS = 240, 12, 0.8, 400
LEVEL = 1.0 / (1.0 - KEEP)  # square root of the long-run variance of the noise below over that of its news


def slow(random: np.random.Generator) -> Array:
    """Noise that keeps a part from sample to sample, e_k = KEEP e_(k-1) + news."""
    out = random.normal(size=SAMPLES)
    out[0] /= np.sqrt(1.0 - KEEP**2)
    for k in range(1, SAMPLES):
        out[k] += KEEP * out[k - 1]
    return out


def harmonics() -> Array:
    """Slopes that are as slow as what parameters do: sines and cosines of the lowest frequencies."""
    turn = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
    waves = [f((k + 1) * turn) for k in range(COUNT // 2) for f in (np.sin, np.cos)]
    return np.column_stack(waves)


def levels(slopes: Array, root: Array) -> tuple[float, float]:
    """Mean long-run level s n^0.5 that residuals of least squares tell, without and with what the parameters take."""
    random, own = np.random.default_rng(5), []
    project = slopes @ np.linalg.pinv(slopes)
    for _ in range(LOGS):
        e = slow(random)
        r = e - project @ e
        plain, told = compute_noise([r], [np.zeros_like(slopes)], root), compute_noise([r], [slopes], root)
        own.append([1.0 / plain.weight[0], 1.0 / told.weight[0]])
    without, with_ = np.mean(own, axis=0)
    return float(without), float(with_)


@pytest.mark.parametrize("count", [4, 12, 20])
def test_what_parameters_take_is_given_back(count: int) -> None:
    """Effects as slow as the noise: of 20 in 240 samples residuals show 0.58 of the level, and a tenth at most is missing."""
    slopes = np.column_stack([slow(np.random.default_rng(7 + k)) for k in range(count)])
    without, with_ = levels(slopes, 1e-3 * np.eye(count))
    assert without < (0.9 if count < 10 else 0.75) * LEVEL
    assert with_ == pytest.approx(LEVEL, rel=0.1)


def test_where_parameters_take_all_that_is_slow_a_part_is_given_back() -> None:
    """Nothing is left in their band to tell its level; what is beside it tells more than what is left of all."""
    without, with_ = levels(harmonics(), 1e-3 * np.eye(COUNT))
    assert 1.3 * without < with_ < LEVEL


def test_parameters_that_the_log_does_not_move_take_nothing() -> None:
    r = slow(np.random.default_rng(1))
    plain = compute_noise([r], [np.zeros((SAMPLES, 2))], np.eye(2))
    known = compute_noise([r], [harmonics()[:, :2]], 1e6 * np.eye(2))  # their priors hold them
    assert known.weight == pytest.approx(plain.weight, rel=1e-6)


def test_a_constant_is_large_and_says_nothing_of_neighbours() -> None:
    r = np.random.default_rng(2).normal(size=SAMPLES)
    plain, moved = (compute_noise([one], [np.zeros((SAMPLES, 1))], np.eye(1)) for one in (r, r - r.mean() + 100.0))
    assert moved.agree == pytest.approx(plain.agree)
    assert moved.spread[0] == pytest.approx(100.0, rel=1e-3)


def test_a_channel_without_noise_has_neighbours_that_do_not_agree() -> None:
    assert compute_noise([np.full(SAMPLES, 3.0)], [np.zeros((SAMPLES, 1))], np.eye(1)).agree[0] == 1.0
    assert count_agreeing_samples(np.zeros(SAMPLES)) == 1.0


def test_the_autocovariance_is_the_sum_of_its_definition() -> None:
    r = np.random.default_rng(3).normal(size=30)
    x = r - r.mean()
    direct = [float(x[: 30 - lag] @ x[lag:]) / 30 for lag in range(30)]
    assert np.allclose(compute_autocovariance(r), direct, atol=1e-14)


def test_slow_residuals_beside_wide_priors_leave_a_noise_that_is_a_number() -> None:
    """Few samples of news, and priors that move readings by more than is left: nothing is taken off what remains.

    Without that its variance, 1, less 1.3 of what was known before, had no root, and the search ended with an error.
    """
    random = np.random.default_rng(0)
    walk = np.cumsum(random.normal(size=300))
    walk = (walk - walk.mean()) / walk.std()
    place = (np.arange(300) + 0.5) / 300
    slopes = 0.3 * np.cos(np.pi * np.arange(1, 41) * place[:, None])
    noise = compute_noise([walk], [slopes], np.eye(40))
    assert noise.spread == pytest.approx([1.0])
    assert noise.agree[0] == pytest.approx(count_agreeing_samples(walk))
