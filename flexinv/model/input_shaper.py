"""Input shapers: a motion in a few parts, each later than the one before, that leave a mode nothing to swing by.

A shaped motion is the sum of parts of the plain one, q(t) = sum_i A_i q_0(t - t_i) with sum_i A_i = 1.  A mode of frequency w
[rad/s] and damping ratio z that rings by 1 after the plain motion rings after the shaped one by

    V(w, z) = exp(-z w t_n) |sum_i A_i exp((z + i sqrt(1 - z^2)) w t_i)|

(Singer and Seering 1990, doi:10.1115/1.2894142).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexinv.errors import InputError
from flexinv.model.by_value import ByValue
from flexinv.typing import Array
from flexinv.validation import check_number, convert_to_floats

SUM_ERROR = 1e-9  # what the parts may miss of 1 together, as numbers typed with ten digits do
ONE_TIME = 1e-9  # of the duration: parts that are closer to each other are one


@dataclass(frozen=True, eq=False)
class InputShaper(ByValue):
    """Parts of a motion and when each begins; make one with `make_shaper`, and a shaped motion with ``motion.shaped``.

    times : (parts,) [s], the first 0, increasing; parts : (parts,) [-], with the sum 1.  Raises InputError for others.
    """

    times: Array
    parts: Array

    def __post_init__(self) -> None:
        """Raise InputError unless there is a part for each time [s], in order, and their sum is 1 [-]."""
        for name in ("times", "parts"):
            values = np.array(convert_to_floats(name, getattr(self, name)))
            if values.ndim != 1 or not values.size or not np.isfinite(values).all():
                raise InputError(f"{name}: expected finite numbers in a row, got shape {values.shape}")
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        if self.times.shape != self.parts.shape:
            raise InputError(
                f"shaper: {self.times.size} times and {self.parts.size} parts; expected one part for each time"
            )
        if self.times[0] != 0.0 or np.any(np.diff(self.times) <= 0.0):
            raise InputError(f"times: {self.times.tolist()}; expected 0 first, then each later than the one before [s]")
        if abs(self.parts.sum() - 1.0) > SUM_ERROR:
            raise InputError(f"parts: their sum is {self.parts.sum():.12g}; expected 1; write parts / sum(parts)")

    @property
    def duration(self) -> float:
        """By how much a shaped motion takes longer [s]."""
        return float(self.times[-1])

    def compute_vibration(self, frequency: ArrayLike, ratio: float = 0.0) -> Array:
        """Return V [-], what modes of natural frequencies (...,) [Hz] keep of the vibration that the plain motion leaves.

        ratio : of damping [-], 0 to below 1.  Raises InputError for others.
        """
        given = np.asarray(convert_to_floats("frequency", frequency))
        return _compute_vibration(self.times, self.parts, 2.0 * np.pi * given, check_ratio(ratio))

    def join(self, other: InputShaper) -> InputShaper:
        """Return the shaper of both [s], [-], one after the other in any order: the convolution of their parts."""
        times = np.add.outer(self.times, other.times).ravel()
        parts = np.multiply.outer(self.parts, other.parts).ravel()
        order = np.argsort(times, kind="stable")
        times = times[order]
        parts = parts[order]
        first = np.concatenate([[True], np.diff(times) > ONE_TIME * max(times[-1], np.finfo(float).tiny)])
        sums = np.bincount(np.cumsum(first) - 1, weights=parts)
        return InputShaper(times[first], sums / sums.sum())


def check_ratio(ratio: float) -> float:
    """Return the damping ratio [-] of a mode that swings; raise InputError for others."""
    found = check_number("ratio", ratio, "a damping ratio from 0 to below 1 [-], for example 0.01")
    if not 0.0 <= found < 1.0:
        raise InputError(
            f"ratio = {found:g}: expected a damping ratio from 0 to below 1 [-]: what is damped more does not swing"
        )
    return found


def _compute_vibration(times: Array, parts: Array, w: Array, ratio: float) -> Array:
    """V (...,) [-] of modes w (...,) [rad/s], from ``times`` [s]."""
    phase = np.multiply.outer(w, times)
    damped = np.exp(ratio * (phase - phase[..., -1:])) * np.exp(1j * np.sqrt(1.0 - ratio**2) * phase)
    return np.asarray(np.abs(damped @ parts))
