"""Even times: signals that come at times of their own, each taken between its samples at one pace.

A signal is a cubic spline through its samples; one whose steps are very unlike, or that lacks a number, is linear between them: a
spline through two samples at nearly the same time swings far out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.typing import Array

Signal = tuple[Array, dict[str, Array]]  # times [s], and columns at these
GAP = 10.0  # times the usual step: longer silence is a gap
SHORTEST = 0.25  # times the usual step: a spline follows steps between this and the next
LONGEST = 4.0


def take_even_times(signals: Sequence[Signal]) -> tuple[Array, dict[str, Array]]:
    """Return even times (samples,) [s] at the pace of the signal with the most samples, and all columns there [unit of each].

    signals : times that increase, and columns; a column has no number (nan) where its signal is silent for `GAP` usual steps
    """
    quickest = max(signals, key=lambda signal: len(signal[0]))[0]
    spacing = float(np.median(np.diff(quickest)))
    even = quickest[0] + spacing * np.arange(int((quickest[-1] - quickest[0]) / spacing + 1e-6) + 1)
    columns: dict[str, Array] = {}
    for at, samples in signals:
        usual = float(np.median(np.diff(at)))
        k = np.clip(np.searchsorted(at, even), 1, len(at) - 1)
        silent = (at[k] - at[k - 1] > GAP * usual) | (even < at[0] - usual) | (even > at[-1] + usual)
        columns |= {name: np.where(silent, np.nan, values) for name, values in _list_values(at, samples, even)}
    return even, columns


def _list_values(at: Array, columns: dict[str, Array], even: Array) -> Iterator[tuple[str, Array]]:
    """Columns at even times; before the first sample and after the last one their values."""
    steps = np.diff(at) / np.median(np.diff(at))
    smooth = len(at) > 3 and steps.min() > SHORTEST and steps.max() < LONGEST
    inside = np.clip(even, at[0], at[-1])
    for name, values in columns.items():
        if smooth and np.isfinite(values).all():
            yield name, np.asarray(scipy.interpolate.CubicSpline(at, values)(inside))
        else:
            yield name, np.interp(even, at, values)
