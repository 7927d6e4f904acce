"""Functions in pieces: where they turn and reach a level, against closed forms; corners and jumps do not overshoot."""

from __future__ import annotations

import numpy as np
import pytest

from flexinv.kernels.smooth_pieces import fit_pieces, join_samples

TIME_BAR = 1e-9  # of events where functions are given


def test_levels_of_a_sinusoid_are_reached_where_they_are() -> None:
    pieces = fit_pieces(lambda t: np.sin(3.0 * t)[:, None], [0.0, 2.0])
    assert pieces.find_crossing(0, 0.5) == pytest.approx(np.arcsin(0.5) / 3.0, abs=TIME_BAR)
    assert pieces.find_crossing(0, 1.0) == pytest.approx(np.pi / 6.0, abs=TIME_BAR)  # touched
    assert not pieces.has_value_above(0, 1.0)
    assert pieces.find_crossing(0, 1.0 + 1e-9) is None
    assert pieces.has_value_above(0, 1.0 - 1e-9)
    most, at = pieces.find_largest(0)
    assert most == pytest.approx(1.0, abs=1e-14)
    assert at == pytest.approx(np.pi / 6.0, abs=TIME_BAR)


def test_a_spike_between_breaks_is_seen() -> None:
    """A hundredth of the interval wide: halving finds it, as the tail of the coefficients says that something is there."""
    pieces = fit_pieces(lambda t: (1.0 / (1.0 + ((t - 0.3141) / 0.01) ** 2))[:, None], [0.0, 1.0])
    most, at = pieces.find_largest(0)
    assert most == pytest.approx(1.0, abs=1e-12)
    assert at == pytest.approx(0.3141, abs=TIME_BAR)


@pytest.mark.parametrize("power", [0, 1, 2])
def test_corners_and_jumps_are_found_without_overshoot(power: int) -> None:
    """0 before 1/3, (t - 1/3)^power after it: a jump, a corner, a corner of the rate."""

    def corner(t: np.ndarray) -> np.ndarray:
        return np.where(t < 1 / 3, 0.0, (t - 1 / 3) ** power)[:, None]

    pieces = fit_pieces(corner, [0.0, 1.0])
    assert pieces.find_largest(0)[0] == pytest.approx(1.0 if power == 0 else (2 / 3) ** power, abs=1e-12)
    level = 0.01**power if power else 0.5
    assert pieces.find_crossing(0, level) == pytest.approx(1 / 3 + (0.01 if power else 0.0), abs=TIME_BAR)


def test_noise_ends_the_halving() -> None:
    """Values known to 1e-12 of their size are no smoother in short pieces."""
    noise = np.random.default_rng(1)
    pieces = fit_pieces(lambda t: (np.cos(t) * (1.0 + 1e-12 * noise.normal(size=len(t))))[:, None], [0.0, 1.0])
    assert len(pieces.begin) < 16
    nothing = fit_pieces(lambda t: 1e-15 * noise.normal(size=(len(t), 1)), [0.0, 1.0], 1e-6)
    assert len(nothing.begin) < 16


def test_samples_are_joined_by_what_has_their_values_and_rates() -> None:
    time = np.linspace(0.0, 1.0, 4)
    values = [time[:, None] ** 5, 5 * time[:, None] ** 4, 20 * time[:, None] ** 3]
    joined = join_samples(time, values)
    assert joined.find_crossing(0, 0.5) == pytest.approx(0.5**0.2, abs=TIME_BAR)
    assert joined.rate.find_largest(0)[0] == pytest.approx(5.0, abs=1e-12)
