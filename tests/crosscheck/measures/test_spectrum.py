"""Spectra of signals whose frequencies are known."""

from __future__ import annotations

import numpy as np
import pytest

from crosscheck.measures.spectrum import compute_amplitude_spectrum, find_dominant_frequency, find_peaks, take_rest_part

TIME = np.arange(0.0, 1.0, 1e-3)


def tone(frequency: float, phase: float = 0.3) -> np.ndarray:
    return np.sin(2.0 * np.pi * frequency * TIME + phase)


@pytest.mark.parametrize("frequency", [10.0, 10.37, 33.333, 101.9])
@pytest.mark.parametrize("phase", [0.0, 1.0, 2.5])
def test_one_tone_gives_its_frequency_and_amplitude(frequency: float, phase: float) -> None:
    peaks = find_peaks(*compute_amplitude_spectrum(TIME, 5.0 + 0.2 * tone(frequency, phase)))
    assert len(peaks) == 1  # the window's side lobes are not taken for modes, nor is the constant
    # Leakage of the negative frequency at ten periods, 1/(pi d (d^2-1)) = 4e-5 of the peak at d = 20 bins, moves the
    # top of a parabola over lines an eighth of a bin apart by a thousandth of a bin, and a bin is 1 Hz here.
    assert peaks[0][0] == pytest.approx(frequency, abs=5e-3)
    assert peaks[0][1] == pytest.approx(0.2, rel=1e-3)


def test_two_modes_are_told_apart_from_side_lobes() -> None:
    peaks = find_peaks(*compute_amplitude_spectrum(TIME, tone(10.2) + 0.01 * tone(47.7)))
    assert [f for f, _ in peaks] == pytest.approx([10.2, 47.7], abs=0.02)
    assert peaks[1][1] == pytest.approx(0.01, rel=0.02)


def test_a_peak_within_a_lobe_of_a_larger_one_is_not_claimed() -> None:
    # 4.5 bins beside the large peak its side lobe has 1/(pi 4.5 (4.5^2 - 1)) = 3.7e-3 of it.
    assert len(find_peaks(*compute_amplitude_spectrum(TIME, tone(50.0) + 3.7e-3 * tone(54.5)))) == 1
    assert len(find_peaks(*compute_amplitude_spectrum(TIME, tone(50.0) + 3.7e-2 * tone(54.5)))) == 2


def test_the_hold_phase_is_taken_where_it_is_long_enough() -> None:
    values = np.where(TIME < 0.4, 100.0 * TIME, tone(25.0))
    assert take_rest_part(TIME, values, 0.4)[0][0] == pytest.approx(0.4)
    assert find_dominant_frequency(TIME, values, 0.4) == pytest.approx(25.0, abs=0.02)
    assert take_rest_part(TIME, values, 0.99)[0].size == TIME.size


def test_still_and_short_signals_have_no_frequency() -> None:
    assert find_peaks(*compute_amplitude_spectrum(TIME, np.zeros(TIME.size))) == []
    assert find_dominant_frequency(TIME, np.zeros(TIME.size), 0.0) is None
    assert find_dominant_frequency(TIME[:20], tone(50.0)[:20], 0.0) is None
