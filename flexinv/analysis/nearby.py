"""Largest values near each sample: a difference of two solutions crosses zero, so that an error bar is the largest nearby."""

from __future__ import annotations

import numpy as np

from flexinv.typing import Array

# Part of a run, on either side: a beam's first period is some tenth of its motion, so this is a fraction of an oscillation.
NEARBY = 0.02


def find_largest_nearby(values: Array, part: float = NEARBY) -> Array:
    """Return the largest values within a ``part`` of the run on either side of each sample.

    values : (samples, ...) [any unit]; maxima over windows of 1, 2, 4 ... samples, each of two of the one before
    """
    half = int(np.ceil(part * len(values)))
    outside = np.full((half, *values.shape[1:]), -np.inf)
    largest = np.concatenate([outside, values, outside])
    reach = 1
    width = 2 * half + 1
    while reach < width:
        more = min(reach, width - reach)
        largest = np.maximum(largest[:-more], largest[more:])
        reach = reach + more
    return largest
