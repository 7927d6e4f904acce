"""The least size of each cause that a log would show: below it a fault hides in what remains, however one looks at it.

A fault of the size phi is planted; told is the size at which undoing it lets the cost fall by what counts as evidence.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.identification.causes.rounds import CauseRound
from flexinv.typing import Array

TIMES = 1e-3 * np.array(
    [0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 20.0]
)  # [s] of delays and lags that are planted
REACH = 1e6  # times the cause's step: a size beyond it is none


@dataclass(frozen=True)
class DetectionLimit:
    """The least size [unit] of a cause that this log would show; inf where it shows none that was tried."""

    name: str
    place: str
    unit: str
    size: float

    @property
    def words(self) -> str:
        """The same in words [-]."""
        if np.isinf(self.size):
            return f"{self.name} of {self.place}: none up to {1e3 * TIMES[-1]:g} ms would be seen"
        return f"{self.name} of {self.place}: {self.size:.2g} {self.unit}".removesuffix(" -")


def find_least_sizes(here: CauseRound, at: Array, evidence: float) -> list[DetectionLimit]:
    """Return the least sizes [unit of each] that have so much evidence [-] in a log, but of angles' delays and rare causes.

    at : sizes of the causes that were named
    """
    out = []
    level = here.compute_weighed_residual(at)
    for k, cause in enumerate(here.causes):
        if at[k] or cause.rare or (cause.moves and cause.tries):
            continue
        size = (
            _find_size_by_trial(here, at, k, level, evidence)
            if cause.tries
            else _find_size_by_slope(here, at, k, level, evidence)
        )
        out.append(DetectionLimit(cause.name, cause.place, cause.unit, size))
    return out


def describe_least_sizes(some: list[DetectionLimit]) -> Iterator[str]:
    """Yield one sentence for each cause, with its places [unit of each]."""
    for name in dict.fromkeys(one.name for one in some):
        limits = [one for one in some if one.name == name]
        sizes = ", ".join(f"{o.place} {'–' if np.isinf(o.size) else format(o.size, '.2g')}" for o in limits)
        yield f"{name} [{limits[0].unit}]: {sizes}"


def _find_size_by_trial(here: CauseRound, at: Array, k: int, level: Array, evidence: float) -> float:
    one = np.eye(len(at))[k]
    for size in TIMES:
        if here.drop(here.compute_weighed_residual(at - size * one), level) > evidence:
            return float(size)
    return float("inf")


def _find_size_by_slope(here: CauseRound, at: Array, k: int, level: Array, evidence: float) -> float:
    cause = here.causes[k]
    slope = (here.compute_weighed_residual(at + cause.step * np.eye(len(at))[k]) - level) / cause.step
    slope = slope - level * float(slope @ level) / max(float(level @ level), 1e-300)

    def drop(log_size: float) -> float:
        return here.drop(level + np.exp(log_size) * slope, level) - evidence

    low = np.log(1e-6 * cause.step)
    high = np.log(REACH * cause.step)
    if not slope.any() or drop(high) < 0.0:
        return float("inf")
    return float(np.exp(scipy.optimize.brentq(drop, low, high, xtol=1e-3)))
