"""Faults of an answer's numbers: each takes times (samples,) [s] and values (samples, columns), and returns other values.

Sizes are parts of the range of a column where no unit is told.  ``size`` and ``column`` come from the list of planted faults.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Fault = Callable[..., np.ndarray]


def shifted(time, values, delay):
    """Return the values a time [s] late; before the first sample stands the first value."""
    late = time - delay
    return np.stack([np.interp(late, time, one) for one in values.T], axis=1)


def on_column(values, column, change):
    """Return the values with one column changed; all of them where ``column`` is negative."""
    made = values.copy()
    for k in range(values.shape[1]) if column < 0 else [column % values.shape[1]]:
        made[:, k] = change(values[:, k])
    return made


def span(one):
    """Return the range of a column."""
    return float(np.ptp(one))


def scale(time, values, size, column):
    """A factor 1 + size."""
    return on_column(values, column, lambda one: one * (1.0 + size))


def sign(time, values, size, column):
    """The other sign."""
    return on_column(values, column, lambda one: -one)


def offset(time, values, size, column):
    """A constant."""
    return on_column(values, column, lambda one: one + size * span(one))


def delay(time, values, size, column):
    """Late by size samples, interpolated between samples; early where negative."""
    return on_column(values, column, lambda one: shifted(time, one[:, None], size * (time[1] - time[0]))[:, 0])


def slow_clock(time, values, size, column):
    """A clock that runs slow by a part size of the time."""
    return on_column(values, column, lambda one: np.interp(time * (1.0 - size), time, one))


def noise(time, values, size, column):
    """White noise of a fixed seed."""
    dice = np.random.default_rng(34)
    return on_column(values, column, lambda one: one + size * span(one) * dice.standard_normal(one.size))


def drift(time, values, size, column):
    """An offset that grows with the time."""
    return on_column(values, column, lambda one: one + size * span(one) * time / time[-1])


def gain_drift(time, values, size, column):
    """A factor that grows with the time."""
    return on_column(values, column, lambda one: one * (1.0 + size * time / time[-1]))


def frozen(time, values, size, column):
    """The value of a third of the time held for a part size of all samples."""
    first = time.size // 3
    last = first + max(2, int(size * time.size))

    def held(one):
        made = one.copy()
        made[first:last] = one[first]
        return made

    return on_column(values, column, held)


def spike(time, values, size, column):
    """One sample beside the curve."""
    return on_column(values, column, lambda one: one + size * span(one) * (np.arange(one.size) == one.size // 3))


def swapped(time, values, size, column):
    """Columns in the opposite order."""
    return values[:, ::-1].copy()


def rolled(time, values, size, column):
    """Columns moved on by one."""
    return np.roll(values, 1, axis=1)


def coarse(time, values, size, column):
    """Every size-th sample, joined by straight lines."""
    k = np.unique(np.append(np.arange(0, time.size, int(size)), time.size - 1))
    return on_column(values, column, lambda one: np.interp(time, time[k], one[k]))


def stairs(time, values, size, column):
    """Every size-th sample, held until the next."""
    k = (np.arange(time.size) // int(size)) * int(size)
    return on_column(values, column, lambda one: one[k])


def quantised(time, values, size, column):
    """Steps of a converter."""
    return on_column(values, column, lambda one: np.round(one / (size * span(one))) * size * span(one))


def clipped(time, values, size, column):
    """A drive that gives a part 1 - size of the peak."""
    return on_column(
        values, column, lambda one: np.clip(one, -(1 - size) * abs(one).max(), (1 - size) * abs(one).max())
    )


def smoothed(time, values, size, column):
    """A moving mean over size samples."""
    window = np.ones(int(size)) / int(size)
    half = int(size) // 2
    return on_column(values, column, lambda one: np.convolve(np.pad(one, half, "edge"), window, "valid")[: one.size])


def lagged(time, values, size, column):
    """A filter of first order with a time constant of size samples."""

    def filtered(one):
        made = one.copy()
        for k in range(1, one.size):
            made[k] = made[k - 1] + (one[k] - made[k - 1]) / (1.0 + size)
        return made

    return on_column(values, column, filtered)


def backwards(time, values, size, column):
    """The motion told from its end."""
    return on_column(values, column, lambda one: one[::-1])


def zeroed(time, values, size, column):
    """Nothing after a part 1 - size of the time."""
    return on_column(values, column, lambda one: np.where(time > (1.0 - size) * time[-1], 0.0, one))


def rectified(time, values, size, column):
    """Absolute values."""
    return on_column(values, column, np.abs)


def half_precision(time, values, size, column):
    """Numbers of 16 bits."""
    return on_column(values, column, lambda one: one.astype(np.float16).astype(float))


def hum(time, values, size, column):
    """A sine of 50 Hz, sampled."""
    return on_column(values, column, lambda one: one + size * span(one) * np.sin(2 * np.pi * 50.0 * time + 0.3))


def crosstalk(time, values, size, column):
    """Each column carries a part of its neighbour."""
    return values + size * np.roll(values, 1, axis=1)


def mean_removed(time, values, size, column):
    """Columns without their mean."""
    return on_column(values, column, lambda one: one - one.mean())


def dead_zone(time, values, size, column):
    """Small values are zero."""
    return on_column(values, column, lambda one: np.where(abs(one) < size * abs(one).max(), 0.0, one))


def friction(time, values, size, column):
    """A constant that follows the sign of the value."""
    return on_column(values, column, lambda one: one + size * span(one) * np.sign(one))


def degrees(time, values, size, column):
    """N m per degree in place of radian."""
    return on_column(values, column, lambda one: one * np.pi / 180.0)


def pounds(time, values, size, column):
    """Pound-force foot in place of N m."""
    return on_column(values, column, lambda one: one / 1.3558179483)


def kilos(time, values, size, column):
    """Kilopond metre in place of N m."""
    return on_column(values, column, lambda one: one / 9.80665)


def milli(time, values, size, column):
    """mN m in place of N m."""
    return on_column(values, column, lambda one: one * 1e3)


def first_lost(time, values, size, column):
    """The first sample is missing, all others moved up, the last one told twice."""
    return on_column(values, column, lambda one: np.append(one[1:], one[-1]))


def square(time, values, size, column):
    """A part of second order: a gear that saturates."""
    return on_column(values, column, lambda one: one + size * one * abs(one) / abs(one).max())


def none(time, values, size, column):
    """Nothing."""
    return values


SIGNALS: dict[str, Fault] = {
    one.__name__: one
    for one in (
        none, scale, sign, offset, delay, slow_clock, noise, drift, gain_drift, frozen, spike, swapped, rolled, coarse, stairs,
        quantised, clipped, smoothed, lagged, backwards, zeroed, rectified, half_precision, hum, crosstalk, mean_removed,
        dead_zone, friction, degrees, pounds, kilos, milli, first_lost, square,
    )
}  # fmt: skip
