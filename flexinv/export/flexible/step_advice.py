"""A word on a step that is too long for the links of a library that bend, whose vibration it does not follow."""

from __future__ import annotations

import warnings

import numpy as np

from flexinv.errors import ConvergenceError, ModelWarning
from flexinv.linearized.natural_modes import natural_modes
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

# The march makes a period longer by (2 pi / n)^2 / 12 of it at n steps: 3 % at 10, where an amplitude is still followed.
FOLLOWED_STEPS = 10
ADVISED_STEPS = 20  # of a period: 0.8 %


def warn_of_long_step(mechanism: Mechanism, start: Array, step: float) -> None:
    """Give a ModelWarning where a step [s] is longer than a tenth of the slowest period at q (nq,) [rad], [m], drives held."""
    slowest = find_slowest_vibration(mechanism, start)
    if slowest * step * FOLLOWED_STEPS > 1.0:
        warnings.warn(
            f"export: mechanism {mechanism.name!r}: step = {step:g} s is too long for its links that bend, whose slowest "
            f"vibration has {slowest:.3g} Hz at the start: torques are those of links that give way slowly, and fast motions "
            f"find no solution; write {format_advised_step(slowest, step)}",
            ModelWarning,
            stacklevel=2,
        )


def format_advised_step(frequency: float, step: float) -> str:
    """Return in words a step [s] that follows a vibration of a frequency [Hz], at most a quarter of ``step``, as of `solve`."""
    longest = step / 4 if frequency == 0.0 else min(step / 4, 1.0 / (ADVISED_STEPS * frequency))
    return f"step = {longest:.1g}"


def find_slowest_vibration(mechanism: Mechanism, start: Array) -> float:
    """Return the lowest frequency [Hz] of the links that bend, drives held, at q (nq,) [rad], [m]; 0 where none is found."""
    try:
        found = natural_modes(mechanism, q=start, count=1).frequency
    except ConvergenceError:  # there is no rest position, of which the start speaks
        return 0.0
    return float(np.nan_to_num(found).max(initial=0.0))
