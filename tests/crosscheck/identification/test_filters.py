"""Filters of measured signals: their gain, their lag, and that it can be undone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from crosscheck.identification.filters import LONGEST_KEPT, apply_lag, low_pass, undo_lag

H = 0.004
TIME = H * np.arange(2500)


@pytest.mark.parametrize(
    ("frequency", "left"), [(1.9, 1.0), (7.5, 1 / (1 + 0.5**8)), (15.0, 0.5), (33.0, 1 / (1 + 2.2**8))]
)
def test_the_low_pass_has_its_stated_gain_and_no_delay(frequency: float, left: float) -> None:
    """In the middle, far from the ends; the bilinear transform warps frequencies by (pi f h)^2 / 3, 0.02 of 33 Hz."""
    wave = np.sin(2 * np.pi * frequency * TIME)
    inner = slice(500, 2000)
    rest = low_pass(wave, H, 15.0)[inner] - left * wave[inner]
    assert np.abs(rest).max() < 2e-3  # 8 * 0.02 of the gain at 33 Hz, which is 1.8e-3; at 15 Hz 8 / 2 * 1e-4 of 0.5


def test_the_gauges_filter_is_its_differential_equation() -> None:
    """y'' + 2 d w y' + w^2 y = w^2 x of a sine that began at rest, by its steady answer once the start has died away."""
    frequency, damping, at = 2.0, 0.9, 1.9
    wave = np.sin(2 * np.pi * at * TIME)
    ratio = at / frequency
    answer = 1.0 / (1.0 - ratio**2 + 2j * damping * ratio)
    steady = np.abs(answer) * np.sin(2 * np.pi * at * TIME + np.angle(answer))
    # A sine drawn linearly between samples is smaller by (2 pi f h)^2 / 12 = 2e-4.
    assert np.abs(apply_lag(wave, H, frequency, damping) - steady)[1000:].max() < 3e-4
    assert apply_lag(np.full(50, 0.7), H, frequency, damping) == pytest.approx(0.7, abs=1e-12)  # it stood still before


def test_the_lag_can_be_undone() -> None:
    wave = np.exp(-(((TIME - 5.0) / 0.4) ** 2))
    back = undo_lag(apply_lag(wave, H, 2.0, 0.9), H, 2.0, 0.9)
    # Differences of second order, twice: (h / 0.4 s)^2 times the fourth derivative's size of some ten.
    assert np.abs(back - wave).max() < 1e-3


def test_the_low_pass_is_scipys_forth_and_back() -> None:
    """To rounding."""
    noise = np.random.default_rng(1).normal(size=400)
    section = butter(4, 15.0, fs=1.0 / H, output="sos")
    np.testing.assert_allclose(low_pass(noise, H, 15.0), sosfiltfilt(section, noise, padlen=34), rtol=0, atol=1e-13)


@pytest.mark.parametrize("count", [400, LONGEST_KEPT + 1])
def test_whoever_changes_a_filtered_signal_changes_no_other(count: int) -> None:
    """Short signals are kept from call to call, long ones are not; callers see no difference."""
    noise = np.random.default_rng(2).normal(size=count)
    first = low_pass(noise, H, 15.0)
    second = low_pass(noise, H, 15.0)
    first += 1.0
    np.testing.assert_array_equal(first - 1.0, second + 1.0 - 1.0)
    np.testing.assert_array_equal(low_pass(noise, H, 15.0), second)
