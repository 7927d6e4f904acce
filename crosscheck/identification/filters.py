"""Filters for measured signals: zero-phase low-pass for what is differentiated, and the lag of a sensor's own filter."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.typing import Array

Given = ParamSpec("Given")
Result = TypeVar("Result")

LONGEST_KEPT = 50_000  # samples of a signal that is kept, with its result: 128 of them take 100 MB
ORDER = 4  # of the Butterworth filter; forth and back it is 8


def make_signal_cache(most: int) -> Callable[[Callable[Given, Result]], Callable[Given, Result]]:
    """Return a decorator: a function of signals, given as bytes of their samples, keeps its last results.

    Undoing a fault leaves most signals of a log as they were.  Those of more than `LONGEST_KEPT` samples are not kept.
    most : results of the function that are kept [-]
    """

    def make_cached_function(function: Callable[Given, Result]) -> Callable[Given, Result]:
        kept = lru_cache(maxsize=most)(function)

        @wraps(function)
        def run_cached(*given: Given.args, **named: Given.kwargs) -> Result:
            is_long = any(isinstance(one, bytes) and len(one) > 8 * LONGEST_KEPT for one in given)
            return function(*given, **named) if is_long else kept(*given, **named)  # type: ignore[arg-type]

        return run_cached

    return make_cached_function


def low_pass(values: Array, spacing: float, bandwidth: float) -> Array:
    """Return a signal without what is faster than the bandwidth [Hz], without delay: Butterworth, forth and back.

    ``|H(f)| = 1 / (1 + (f / bandwidth)^8)``: half the amplitude at the bandwidth, 0.996 of it at half the bandwidth.

    values : (samples,) [any unit]; spacing : [s]; the ends are continued by a point reflection over two periods of the bandwidth
    """
    signal = np.asarray(values, dtype=np.float64)
    return _apply_kept_low_pass(signal.tobytes(), spacing, bandwidth).copy()


@make_signal_cache(128)
def _apply_kept_low_pass(values: bytes, spacing: float, bandwidth: float) -> Array:
    """The signal (samples,) behind the low-pass, as it is kept: whoever gives it away copies it."""
    return apply_low_pass_all(np.frombuffer(values)[:, None], spacing, bandwidth)[:, 0]


def apply_low_pass_all(values: Array, spacing: float, bandwidth: float) -> Array:
    """Return several signals (samples, signals) [any unit] without what is faster than the bandwidth [Hz], as `low_pass`."""
    out = np.zeros(np.shape(values))
    some = np.any(
        values, axis=0
    )  # what is zero stays zero: a difference quotient by one parameter has few other columns
    if some.any():
        x = np.asarray(values, dtype=np.float64)[:, some]
        pad = min(len(x) - 1, int(np.ceil(2.0 / (bandwidth * spacing))))
        sections = _build_filter_sections(spacing, bandwidth)
        out[:, some] = scipy.signal.sosfiltfilt(sections, x, axis=0, padtype="odd", padlen=pad)
    return out


@lru_cache(maxsize=32)
def _build_filter_sections(spacing: float, bandwidth: float) -> Array:
    """Second-order sections (2, 6)."""
    return np.asarray(scipy.signal.butter(ORDER, bandwidth, fs=1.0 / spacing, output="sos"))


def apply_lag(values: Array, spacing: float, frequency: float, damping: float) -> Array:
    """Return a signal after the second-order low-pass of a sensor, which stood still on its first value before.

    ``y'' + 2 damping w y' + w^2 y = w^2 x``, w = 2 pi frequency; exact for x that is linear between samples

    values : (samples,) [any unit]; spacing : [s]; frequency : [Hz]; damping : [-]
    """
    b, a, rest = _build_sampled_filter(spacing, frequency, damping)
    return np.asarray(scipy.signal.lfilter(b, a, values, zi=rest * values[0])[0])


@lru_cache(maxsize=8)
def _build_sampled_filter(spacing: float, frequency: float, damping: float) -> tuple[Array, Array, Array]:
    """Numerator, denominator, and the state in which the filter stands still on 1."""
    w = 2.0 * np.pi * frequency
    numerator, denominator, _ = scipy.signal.cont2discrete(([w * w], [1.0, 2.0 * damping * w, w * w]), spacing, "foh")
    b = np.ravel(numerator)
    a = np.ravel(denominator)
    return b, a, scipy.signal.lfilter_zi(b, a)


def undo_lag(values: Array, spacing: float, frequency: float, damping: float) -> Array:
    """Return the sensor's input, from the output of its second-order low-pass: ``x = y + 2 damping y' / w + y'' / w^2``.

    The values have to be smooth: differences of second order are taken, one-sided at the ends.

    values : (samples,) [any unit]; spacing : [s]; frequency : [Hz]; damping : [-]
    """
    w = 2.0 * np.pi * frequency
    rate = np.gradient(values, spacing, edge_order=2)
    return np.asarray(values + 2.0 * damping / w * rate + np.gradient(rate, spacing, edge_order=2) / w**2)
