"""Rows of evidence above the bandwidth: what the wide responses of efforts are beside what they should be.

A row weighs one over its standard error.  What no delay, lag or gain takes away of a channel is how wrong the expectation is:
rows weigh less by it, and by the number of neighbours that miss alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.identification.estimation.noise import count_agreeing_samples
from crosscheck.identification.readings import Run
from crosscheck.identification.responses.wide_response import (
    ExpectedResponse,
    WideResponse,
    build_expectation,
    compute_response_error,
    compute_weights,
)
from flexinv.typing import Array

# Where the way to the best one starts [s], and what is one on it: [s], [s], of the logarithm [-].
DELAYS = np.arange(-0.02, 0.0201, 0.002)
LAGS = np.array([0.0, 0.005, 0.02])
SCALES = np.array([1e-3, 1e-3, 0.1])
STEPS = 60


@dataclass(frozen=True)
class WideRows:
    """A channel above the bandwidth: what is expected of it, weights (frequencies,), and how many of its rows are news [-]."""

    channel: int
    expected_response: ExpectedResponse
    weights: Array
    news: float

    def compute_rows(self, run: Run) -> Array:
        """Return the difference between the channel of a run and its expectation (rows,) [-]."""
        seen = run.wide[self.channel]
        return (
            np.zeros(2 * len(self.weights))
            if seen is None
            else compute_response_error(seen, self.expected_response, self.weights)
        )


def build_wide_rows(run: Run, before: Sequence[Run]) -> list[WideRows]:
    """Return the rows of efforts that show something above the bandwidth [-]; before : runs that tell what to expect."""
    out = []
    for c, seen in enumerate(run.wide):
        if seen is None:
            continue
        known = [w for w in (b.wide[c] for b in before if b.wide) if w is not None]
        expectation = build_expectation(seen, known)
        weight = compute_weights(seen, expectation)
        if (weight > 0.0).sum() < 10:
            continue
        best = _fit_delay_and_gain(seen, expectation, weight)
        alike = max(
            count_agreeing_samples(best[0::2]),
            count_agreeing_samples(best[1::2]),
            1.0 if expectation.known else _count_smoothed_lines(seen.frequency),
        )
        scale = max(1.0, float(np.mean(best[best != 0.0] ** 2)))
        news = 2.0 * float((weight > 0.0).sum()) / alike
        out.append(WideRows(c, expectation, weight / np.sqrt(scale * alike), news))
    return out


def _count_smoothed_lines(frequency: Array) -> float:
    """The number of frequencies [Hz] over which a drive that is more than its rotor misses alike: half an octave's [-]."""
    return len(frequency) / max(1.0, 2.0 * float(np.log2(frequency[-1] / frequency[0])))


def _fit_delay_and_gain(response: WideResponse, expected_response: ExpectedResponse, weight: Array) -> Array:
    """The differences (rows,) under the delay, lag and gain that leave least of them."""
    w = 2.0 * np.pi * response.frequency

    def compute_rest(x: Array) -> Array:
        delay, lag, gain = x * SCALES
        turned = np.exp(1j * w * delay) * (1.0 + 1j * w * lag) * (np.exp(-gain) if expected_response.known else 1.0)
        return compute_response_error(replace(response, both=response.both * turned), expected_response, weight)

    starts = [np.array([delay, lag, 0.0]) / SCALES for lag in LAGS for delay in DELAYS]
    start = min(starts, key=lambda x: float(np.sum(compute_rest(x) ** 2)))
    return compute_rest(scipy.optimize.least_squares(compute_rest, start, method="lm", max_nfev=STEPS).x)
