"""Memory for many arrays at once: a fresh page costs more time than the computation that fills it.

Arrays of one piece are one allocation, which the system's allocator keeps for the next call where it would give many small ones
back.  Within `begin_shared_memory` the calls of a thread take their pieces of larger ones: they last as long as any of their
arrays.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from itertools import accumulate
from threading import local

import numpy as np

from flexinv.typing import Array

LINE = 8  # numbers in a line of the cache: arrays begin at different ones, so that threads do not write into the same
# Numbers in a shared piece, 16 MiB: large enough for large pages, which NumPy asks for from 4 MiB on.
PIECE = 1 << 21
# The C library (glibc) gives memory back to the system when more than twice its largest freed piece is unused, and a call that
# takes some megabytes meets fresh pages every time.  A piece of 8 MiB that is freed once, untouched, lets it keep 16 MiB.
FREED_PIECE = 1 << 20
np.empty(FREED_PIECE)
# Of each thread the unused rest of its shared piece of memory, ``left``; nothing where every call has its own.
_PIECE = local()


def make_adjacent_arrays(*shapes: tuple[int, ...]) -> list[Array]:
    """Return arrays [any unit] of these shapes that stand one behind the other in memory, to be filled: nothing is in them."""
    size, places = _compute_places(shapes)
    left: Array | None = getattr(_PIECE, "left", None)
    if left is None or size > PIECE // 2:
        block = np.empty(size)
    else:
        left = np.empty(PIECE) if size > len(left) else left
        block = left[:size]
        _PIECE.left = left[size:]
    return [np.ndarray(shape, float, block, place) for shape, place in zip(shapes, places, strict=True)]


def make_aligned_zeros(*shape: int) -> Array:
    """Return zeros [any unit] that begin with a line of the cache: vectors of eight numbers then lie in one line, not in two."""
    size = math.prod(shape)
    block = np.zeros(size + LINE)
    first = -block.ctypes.data % (8 * LINE) // 8
    return block[first : first + size].reshape(shape)


def copy_aligned(values: Array) -> Array:
    """Return a copy [any unit] that begins with a line of the cache."""
    out = make_aligned_zeros(*values.shape)
    out[...] = values
    return out


def make_contiguous(a: Array) -> Array:
    """Return an array [any unit] as kernels take it, contiguous and writeable: itself, or a copy if it is not."""
    return a if a.flags.c_contiguous and a.flags.writeable else np.array(a, order="C")


@contextmanager
def begin_shared_memory() -> Iterator[None]:
    """Let the arrays of all calls that follow in this thread [any unit] stand in large pieces of memory, as far as they fit."""
    _PIECE.left = np.empty(0)
    try:
        yield
    finally:
        _PIECE.left = None


@lru_cache(maxsize=64)
def _compute_places(shapes: tuple[tuple[int, ...], ...]) -> tuple[int, list[int]]:
    """Numbers in all, and the bytes at which each array begins."""
    ends = list(accumulate(-(-math.prod(shape) // LINE) * LINE for shape in shapes))
    return ends[-1], [8 * first for first in (0, *ends[:-1])]
