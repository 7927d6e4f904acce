"""Wide response: from a joint's acceleration to its effort above the bandwidth, where a drive shakes its own rotor.

H = S_ae / S_aa,   coherence^2 = |S_ae|^2 / (S_aa S_ee),   var(H / |H|) = (1 - coherence^2) / (n coherence^2)

S : spectra averaged over n segments (Hann, half overlapping) of raw columns [N m, N; rad/s^2, m/s^2].  Delays and lags, which are
next to nothing below the bandwidth, turn the phase of H by whole radians here.  Source: J. S. Bendat, A. G. Piersol, "Random
Data", 4th ed., Wiley 2010, sections 9.2.3 and 9.2.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import NDArray

from crosscheck.identification.filters import make_signal_cache
from flexinv.typing import Array

PERIODS = (3.0, 8.0)  # of the bandwidth in a segment, at least and at most
HIGHEST = 0.4  # of the sampling rate
# that make a good spectrum of a short log, and one at all
SEGMENTS = 13
LEAST = 6
SEEN = 0.2  # least coherence^2 of a frequency that says anything
NEIGHBOURS = 1.5  # frequencies that say the same behind a Hann window
PHASE = 0.5  # [rad] by which a rotor inertia alone misses the phase of a drive


@dataclass(frozen=True)
class WideResponse:
    """Spectra of a joint: of the acceleration, the effort, and both (frequencies,) at frequency [Hz], of so many segments."""

    frequency: Array
    acceleration: Array
    effort: Array
    both: NDArray[np.complex128]
    segments: float

    @property
    def ratio(self) -> NDArray[np.complex128]:
        """H (frequencies,) [kg m^2], [kg], or per ampere what the effort's column is in."""
        return np.asarray(self.both / self.acceleration)

    @property
    def coherence(self) -> Array:
        """Squared coherence (frequencies,) [-]."""
        return np.asarray(np.abs(self.both) ** 2 / (self.acceleration * self.effort + 1e-300))

    @property
    def variance(self) -> Array:
        """Variance of H over |H|^2 (frequencies,) [-]."""
        seen = np.clip(self.coherence, 1e-6, 1.0 - 1e-6)
        return np.asarray((1.0 - seen) / (seen * self.segments))


def compute_wide_response(angle: Array, effort: Array, spacing: float, bandwidth: float) -> WideResponse | None:
    """Return the response of an effort to its joint's acceleration above a bandwidth [Hz]; None where there is no room for one.

    angle, effort : (samples,) raw [rad], [m]; [any unit]; spacing : [s]
    """
    return _compute_response(angle.tobytes(), effort.tobytes(), spacing, bandwidth)


@make_signal_cache(64)
def _compute_response(columns: bytes, efforts: bytes, spacing: float, bandwidth: float) -> WideResponse | None:
    angle = np.frombuffer(columns)
    effort = np.frombuffer(efforts)
    least, most = (round(periods / (bandwidth * spacing)) for periods in PERIODS)
    count = max(least, min(most, 2 * len(angle) // (SEGMENTS + 1)))
    segments = 2 * len(angle) // max(count, 1) - 1
    if segments < LEAST or bandwidth > 0.5 * HIGHEST / spacing:
        return None
    bend = np.diff(angle, 2) / spacing**2
    a = _compute_segment_spectra(bend.tobytes(), count)
    e = _compute_segment_spectra(effort[1:-1].tobytes(), count)
    frequency = np.fft.rfftfreq(count, spacing)
    acceleration, other, both = (np.mean(s, axis=0) for s in (np.abs(a) ** 2, np.abs(e) ** 2, a.conj() * e))
    kept = (frequency >= bandwidth) & (frequency <= HIGHEST / spacing) & (acceleration > 0.0)
    if not kept.any():
        return None
    true = np.sinc(frequency[kept] * spacing) ** 2  # what a second difference makes of an acceleration
    return WideResponse(
        frequency[kept], acceleration[kept] / true**2, other[kept], both[kept] / true, segments / NEIGHBOURS
    )


@make_signal_cache(64)
def _compute_segment_spectra(values: bytes, count: int) -> NDArray[np.complex128]:
    """Spectra (segments, frequencies) of segments of so many samples, each without its mean."""
    parts = np.lib.stride_tricks.sliding_window_view(np.frombuffer(values), count)[:: count // 2]
    return np.asarray(
        np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * scipy.signal.windows.hann(count, sym=False))
    )


def join_responses(some: Sequence[WideResponse]) -> WideResponse:
    """Return the response of several logs, at the frequencies of the first one [Hz]."""
    first = some[0]

    def compute_weighted_mean(values: list[NDArray[np.complex128]]) -> NDArray[np.complex128]:
        parts = [np.interp(first.frequency, s.frequency, v) * s.segments for s, v in zip(some, values, strict=True)]
        return np.asarray(np.sum(parts, axis=0) / sum(s.segments for s in some))

    acceleration, other = (
        compute_weighted_mean([getattr(s, name) for s in some]).real for name in ("acceleration", "effort")
    )
    return WideResponse(
        first.frequency,
        acceleration,
        other,
        compute_weighted_mean([s.both for s in some]),
        sum(s.segments for s in some),
    )


@dataclass(frozen=True)
class ExpectedResponse:
    """Expectation of H (frequencies,), and its variance over |H|^2; ``known`` : its size and not only its phase."""

    frequency: Array
    ratio: NDArray[np.complex128]
    variance: Array
    known: bool


def build_expectation(response: WideResponse, before: Sequence[WideResponse]) -> ExpectedResponse:
    """Return the expectation of H: that of logs before, or in phase with the acceleration, as that of a rotor inertia is [-]."""
    if before:
        responses = join_responses(before)
        ratio = np.interp(response.frequency, responses.frequency, responses.ratio)
        variance = np.interp(response.frequency, responses.frequency, responses.variance)
        variance[np.interp(response.frequency, responses.frequency, responses.coherence) < SEEN] = np.inf
        return ExpectedResponse(response.frequency, ratio, variance, True)
    return ExpectedResponse(
        response.frequency,
        np.ones(len(response.frequency), dtype=complex),
        np.full(len(response.frequency), PHASE**2),
        False,
    )


def compute_response_error(response: WideResponse, expected_response: ExpectedResponse, weights: Array) -> Array:
    """Return the error of H, real and imaginary parts in turn (2 frequencies,) times weights (frequencies,) [-]."""
    ratio = response.ratio if expected_response.known else response.ratio / np.abs(response.ratio)
    if len(ratio) != len(weights):  # a clock that is set right moves the frequencies
        ratio = np.interp(expected_response.frequency, response.frequency, ratio)
    rest = (ratio / expected_response.ratio - 1.0) * weights
    return np.column_stack([rest.real, rest.imag]).ravel()


def compute_weights(response: WideResponse, expected_response: ExpectedResponse) -> Array:
    """Return one over the standard error of each difference (frequencies,) [-]; 0 where nothing is seen."""
    variance = 0.5 * (response.variance + expected_response.variance)
    return np.asarray(np.where(response.coherence < SEEN, 0.0, 1.0 / np.sqrt(variance)))
