"""Step grids: equal steps between the instants at which a motion is not smooth, so that each of those is a sample."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flexinv.typing import Array

# Coarsest steps: so many in the run, and so many in the longest stretch of it that is smooth, unless that is too many in the run.
FEWEST_IN_RUN, FEWEST_IN_STRETCH, MOST_IN_RUN = 40, 16, 160
# After a jump of the acceleration what is stiff and damped settles: so many times the step is halved towards the jump.
# (From 14 on the accelerations of such short steps are rounding; with 7 a damped arm takes four times as long to 1e-5:
# docs/studies/accuracy.py.)
GRADES = 11
# Instants closer than this part of the run are one.
SAME = 1e-9


@dataclass(frozen=True)
class StepGrid:
    """Stretches of equal steps, ends : (stretches + 1,) [s], where they begin and end; counts : coarsest steps of each [-]."""

    ends: Array
    counts: tuple[int, ...]

    @property
    def total(self) -> int:
        """Return the number of coarsest steps [-]."""
        return sum(self.counts)

    def steps(self, finer: int) -> Array:
        """Return all instants [s] where ``finer`` steps [-] make a coarsest one."""
        parts = [
            first + (last - first) * (np.arange(finer * count) / (finer * count))
            for (first, last), count in zip(pairwise(self.ends), self.counts, strict=True)
        ]
        return np.concatenate([*parts, self.ends[-1:]])

    def seams(self, finer: int) -> tuple[int, ...]:
        """Return the samples [-] of `steps` at which one stretch ends and the next begins."""
        return tuple(int(k) for k in finer * np.cumsum(self.counts)[:-1])

    def spacing(self, finer: int) -> float:
        """Return the longest step [s] of `steps`."""
        return float((np.diff(self.ends) / np.array(self.counts)).max()) / finer


def step_grid(breaks: Iterable[float], jumps: Iterable[float], first: float, last: float) -> StepGrid:
    """Return the coarsest grid from ``first`` to ``last`` [s] that meets the ``breaks`` [s] between them.

    jumps : breaks [s] at which accelerations jump: after them steps are short and double; at all others stretches of equal
        steps are joined
    """
    span = last - first
    ends = _apart([first, *sorted(t for t in (*breaks, *jumps) if first < t < last), last], SAME * span)
    longest = min(span / FEWEST_IN_RUN, max(np.diff(ends).max() / FEWEST_IN_STRETCH, span / MOST_IN_RUN))
    sudden = [t for t in ends[:-1] if any(abs(t - jump) <= SAME * span for jump in jumps)]
    graded = [t + 2 * longest / 2**k for t in sudden for k in range(GRADES)]
    ends = _apart([first, *sorted({*ends[1:-1], *(t for t in graded if t < last)}), last], SAME * span)
    stretches = np.diff(ends)
    counts = [int(np.ceil(part / longest * (1 - SAME))) for part in stretches]
    kept, joined = [0], [counts[0]]
    for k in range(1, len(counts)):
        alike = abs(stretches[k] / counts[k] - stretches[k - 1] / counts[k - 1]) <= SAME * longest
        if alike and not any(abs(ends[k] - t) <= SAME * span for t in jumps):
            joined[-1] += counts[k]
        else:
            kept.append(k)
            joined.append(counts[k])
    return StepGrid(ends[[*kept, -1]], tuple(joined))


def _apart(times: list[float], least: float) -> Array:
    """Times [s] without those that are the same as one before, the last one kept."""
    kept = [times[0]]
    for t in times[1:-1]:
        if t - kept[-1] > least and times[-1] - t > least:
            kept.append(t)
    return np.array([*kept, times[-1]])
