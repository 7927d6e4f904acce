"""Jumps of angles: steps that stand out from all others, and those with which an encoder begins anew at the end of its range."""

from __future__ import annotations

import numpy as np

from flexinv.typing import Array

OUT = 10.0  # times as large as the steps around it and all but the largest hundredth: no drive moves a joint so
AROUND = 4  # steps before and after; the next ones belong to a jump that returns
TURN = 2.0 * np.pi
NEAR = 0.02  # relative, of a whole turn: the joint moves on while it is counted anew
WHOLE = 0.9  # of all that a column covers: a step from one end of the encoder's range to the other


def find_jumps(values: Array, quiet: float = 0.99) -> list[int]:
    """Return the numbers of the steps [-] of a column (samples,) [any unit] that stand out: from sample k to k + 1.

    |d_k| > `OUT` times each of: the steps around it, the ``quiet`` quantile of all steps [-], the smallest step that is no rest
    """
    steps = np.abs(np.diff(values))
    if not steps.any():
        return []
    least = OUT * max(float(np.quantile(steps, quiet)), float(steps[steps > 0.0].min()))
    return [k for k in np.flatnonzero(steps > least).tolist() if steps[k] > OUT * _find_largest_around(steps, k)]


def _find_largest_around(steps: Array, k: int) -> float:
    around = np.concatenate([steps[max(0, k - AROUND) : max(0, k - 1)], steps[k + 2 : k + AROUND + 1]])
    return float(around.max(initial=0.0))


def find_wrap_period(values: Array, k: int, turns: bool) -> float:
    """Return the period [rad], [m] by which a column (samples,) begins anew in its step k, 0 where that is another jump.

    turns : the column is an angle; the step is a whole turn then, or leads from one end of the column's range to the other and
    does not return at once
    """
    steps = np.abs(np.diff(values))
    size = float(steps[k])
    if turns and abs(size / TURN - 1.0) < NEAR:
        return TURN
    returns = max(steps[max(0, k - 1) : k].max(initial=0.0), steps[k + 1 : k + 2].max(initial=0.0)) > 0.5 * size
    return size if size > WHOLE * float(np.ptp(values)) and not returns else 0.0
