"""Memory for many arrays at once: a fresh page costs more than what a march computes in the time of filling it.

Arrays of one piece are one allocation, which the system's allocator keeps for the next call where it threw many small ones away.
"""

from __future__ import annotations

import math

import numpy as np

from flexinv.mechanism import Array

# Numbers in a line of the cache: arrays begin at different ones, so that threads do not write into the same.
LINE = 8


def together(*shapes: tuple[int, ...]) -> list[Array]:
    """Return arrays [any unit] of these shapes that stand one behind the other in memory, to be filled: nothing is in them."""
    sizes = [math.prod(shape) for shape in shapes]
    block, first, arrays = np.empty(sum(-(-size // LINE) * LINE for size in sizes)), 0, []
    for shape, size in zip(shapes, sizes, strict=True):
        arrays.append(block[first : first + size].reshape(shape))
        first += -(-size // LINE) * LINE
    return arrays
