"""What a drive shows above the bandwidth: the phase of its effort against its own acceleration."""

from __future__ import annotations

import numpy as np
import pytest

from crosscheck.identification.readings import apply_delay, apply_first_order_lag, remove_first_order_lag
from crosscheck.identification.responses.wide_response import build_expectation, compute_wide_response, join_responses
from flexinv.typing import Array

SPACING, BANDWIDTH, INERTIA = 0.004, 10.0, 0.3


def shaken(seed: int = 0, count: int = 3000) -> tuple[Array, Array]:
    """Angle [rad] and effort [N m] of a rotor that a noisy drive shakes, with a tenth of noise on the effort."""
    random = np.random.default_rng(seed)
    time = SPACING * np.arange(count)
    tones = [(f, random.uniform(0, 2 * np.pi)) for f in np.arange(10.0, 100.0, 0.37)]
    angle = sum(np.sin(2 * np.pi * f * time + phase) / (2 * np.pi * f) ** 2 for f, phase in tones)
    effort = INERTIA * sum(-np.sin(2 * np.pi * f * time + phase) for f, phase in tones)
    return np.asarray(angle), np.asarray(effort + 0.1 * np.std(effort) * random.normal(size=count))


@pytest.mark.parametrize("late", [0.0, 0.002, -0.003])
def test_a_delay_turns_the_phase_and_leaves_the_size(late: float) -> None:
    angle, effort = shaken()
    wide_response = compute_wide_response(angle, apply_delay(effort, SPACING, late), SPACING, BANDWIDTH)
    assert wide_response is not None
    inner = (
        wide_response.frequency < 60.0
    )  # a spline through samples knows the delayed signal far below the sampling rate only
    turned = wide_response.ratio[inner] * np.exp(2j * np.pi * wide_response.frequency[inner] * late)
    assert (
        np.abs(turned / INERTIA - 1.0).max() < 0.15
    )  # 0.1 of noise, on the average of 20 segments 0.03 each: five of them
    assert np.median(wide_response.coherence) > 0.95


def test_noise_alone_shows_no_coherence() -> None:
    angle, effort = shaken()
    wide_response = compute_wide_response(angle, np.random.default_rng(1).permutation(effort), SPACING, BANDWIDTH)
    assert wide_response is not None
    assert np.median(wide_response.coherence) < 0.2


def test_a_log_that_is_too_short_or_too_slow_shows_nothing() -> None:
    angle, effort = shaken(count=150)
    assert compute_wide_response(angle, effort, SPACING, BANDWIDTH) is None
    angle, effort = shaken()
    assert compute_wide_response(angle, effort, SPACING, 60.0) is None


def test_logs_together_say_what_is_expected() -> None:
    some = [compute_wide_response(*shaken(seed), SPACING, BANDWIDTH) for seed in (0, 1)]
    first, second = (one for one in some if one is not None)
    both = join_responses([first, second])
    assert both.segments == first.segments + second.segments
    expectation = build_expectation(first, [second])
    assert expectation.known
    assert np.abs(expectation.ratio / INERTIA - 1.0).max() < 0.15
    assert not build_expectation(first, []).known


def test_what_a_lag_makes_of_a_signal_is_undone() -> None:
    effort = shaken()[1] + 3.0
    again = remove_first_order_lag(apply_first_order_lag(effort, SPACING, 0.005), SPACING, 0.005)
    assert np.abs(again - effort).max() < 1e-9  # rounding, times what undoing amplifies
    assert remove_first_order_lag(effort, SPACING, 0.0) is effort
