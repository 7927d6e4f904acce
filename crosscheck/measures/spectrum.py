"""Spectra of sampled signals: what a mechanism rings with once its motion has stopped."""

from __future__ import annotations

import numpy as np

from flexinv.typing import Array

RINGING = ("torque", "deflection")  # quantities whose spectrum is taken
FEWEST = 32  # [samples] of a hold phase below which the whole signal is taken
PADDING = 8  # the signal is padded with zeros to this many times its length: a smooth line, and a close peak
FLOOR = 1e-3  # of the largest amplitude: smaller peaks are not marked, a reader's eye has no use for them
MARKS = 6  # peaks marked at most, the largest ones
MAIN_LOBE = 2.0  # [bins] half-width of a Hann window's main lobe
# A hold phase that moves by less than this fraction of the whole signal's size is at rest, but for rounding.
STILL = 1e-9
CLEAR = 2.0  # a peak stands clear of the side lobes of larger ones by this factor, else it is one of them


def take_rest_part(time: Array, values: Array, rest: float) -> tuple[Array, Array]:
    """Return the part of a signal after ``rest`` [s], or all of it where that part is too short.

    time : (samples,) [s]; values : (samples,) [unit]
    """
    late = time >= rest
    if np.count_nonzero(late) < FEWEST:
        return time, values
    return time[late], values[late]


def compute_amplitude_spectrum(time: Array, values: Array) -> tuple[Array, Array]:
    """Return the one-sided amplitude spectrum ``2 |sum w (x - mean) exp(-2 pi i f t)| / sum w``, w a Hann window.

    time : (samples,) [s], evenly spaced; values : (samples,) [unit]; mean: weighted by w, so that f = 0 is empty
    returns : frequency [Hz] and amplitude [unit], each (lines,)
    """
    samples = time.size
    weights = np.hanning(samples + 1)[:-1]  # periodic
    moving = values - np.average(values, weights=weights)
    padded = np.fft.rfft(weights * moving, PADDING * samples)
    frequency = np.fft.rfftfreq(PADDING * samples, time[1] - time[0])
    return frequency, 2.0 * np.abs(padded) / weights.sum()


def find_peaks(frequency: Array, amplitude: Array) -> list[tuple[float, float]]:
    """Return frequency [Hz] and amplitude [unit] of the peaks of a padded spectrum, the largest first.

    A side lobe of a larger peak is none: d bins away from a peak of amplitude A a Hann window's lobes reach
    ``A / (pi d (d^2 - 1))`` (Harris 1978, "On the use of windows for harmonic analysis", equation 27); every peak has
    its image at the negative frequency.
    """
    top = amplitude.max(initial=0.0)
    if top == 0.0 or not np.isfinite(top):
        return []
    inner = amplitude[1:-1]
    found = 1 + np.flatnonzero((inner > amplitude[:-2]) & (inner > amplitude[2:]))
    found = found[amplitude[found] >= FLOOR * top]
    marks: list[int] = []
    for k in found[np.argsort(-amplitude[found])]:
        if amplitude[k] > CLEAR * sum(
            _compute_lobe_height(k - m, amplitude[m]) + _compute_lobe_height(k + m, amplitude[m]) for m in marks
        ):
            marks.append(int(k))
    return [_find_parabola_top(frequency, amplitude, k) for k in marks[:MARKS]]


def _compute_lobe_height(lines: int, amplitude: float) -> float:
    """Return the height of a peak of that amplitude ``lines`` of the padded spectrum away from it."""
    bins = abs(lines) / PADDING
    return np.inf if bins <= MAIN_LOBE else amplitude / (np.pi * bins * (bins**2 - 1.0))


def _find_parabola_top(frequency: Array, amplitude: Array, k: int) -> tuple[float, float]:
    """Return the top of the parabola through the logarithms of three neighbouring lines."""
    left, middle, right = np.log(amplitude[k - 1 : k + 2])
    shift = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return (
        float(frequency[k] + shift * (frequency[1] - frequency[0])),
        float(np.exp(middle - 0.25 * (left - right) * shift)),
    )


def compute_ringing_spectrum(time: Array, values: Array, rest: float) -> tuple[Array, Array] | None:
    """Return the amplitude spectrum after ``rest`` [s] as in ``compute_amplitude_spectrum``, or None where nothing moves there.

    time : (samples,) [s]; values : (samples,) [unit]
    """
    part = take_rest_part(time, values, rest)
    size = float(np.abs(values).max(initial=0.0))
    if part[0].size < FEWEST or float(np.ptp(part[1])) <= STILL * size:
        return None
    return compute_amplitude_spectrum(*part)


def find_dominant_frequency(time: Array, values: Array, rest: float) -> float | None:
    """Return the frequency [Hz] of the largest peak of the spectrum after ``rest`` [s]; None without a peak."""
    lines = compute_ringing_spectrum(time, values, rest)
    found = find_peaks(*lines) if lines is not None else []
    return found[0][0] if found else None
