"""Block tridiagonal systems, one block row for every instant: Gauss elimination along time with partial pivoting (compiled).

Pivots are sought in the block row at hand and the one after it, which is all that a column reaches: growing and decaying
solutions stand side by side in a boundary-value problem, and a block may be singular by itself.
(LAPACK's band solver does the same; its threads wait for each other on blocks of this size.)
"""

from __future__ import annotations

import numpy as np

from flexinv.kernels.dense import eliminate
from flexinv.kernels.jit import jit, jit_inner
from flexinv.typing import Array


@jit
def _forward(below, own, above, right, window, kept):
    """Eliminate below the diagonal; kept : (samples, n, 3 n + 1) rows of the triangle, window : (2 n, 3 n + 1) scratch."""
    samples, n = right.shape
    _load(window, 0, n, own[0], above[0], right[0])
    for k in range(samples):
        rows = n
        if k + 1 < samples:
            rows = 2 * n
            for i in range(n):
                for j in range(n):
                    window[n + i, j], window[n + i, n + j] = below[k + 1, i, j], own[k + 1, i, j]
                    window[n + i, 2 * n + j] = above[k + 1, i, j]
                window[n + i, 3 * n] = right[k + 1, i]
        eliminate(window, n, rows, 3 * n + 1)
        for i in range(n):
            for j in range(3 * n + 1):
                kept[k, i, j] = window[i, j]
        for i in range(n):  # what is left of the row after is where the next begins
            for j in range(2 * n):
                window[i, j] = window[n + i, n + j]
            for j in range(2 * n, 3 * n):
                window[i, j] = 0.0
            window[i, 3 * n] = window[n + i, 3 * n]


@jit_inner
def _load(window, first, n, own, above, right):
    for i in range(n):
        for j in range(n):
            window[first + i, j], window[first + i, n + j], window[first + i, 2 * n + j] = own[i, j], above[i, j], 0.0
        window[first + i, 3 * n] = right[i]


@jit
def _backward(kept, x):
    """Fill x (samples + 2, n), whose last two rows are zero, from the triangle."""
    samples, n = kept.shape[0], kept.shape[1]
    for k in range(samples - 1, -1, -1):
        for i in range(n - 1, -1, -1):
            value = kept[k, i, 3 * n]
            for j in range(n):
                value -= kept[k, i, n + j] * x[k + 1, j] + kept[k, i, 2 * n + j] * x[k + 2, j]
            for j in range(i + 1, n):
                value -= kept[k, i, j] * x[k, j]
            x[k, i] = value / kept[k, i, i]


def solve_tridiagonal(below: Array, own: Array, above: Array, right: Array) -> Array:
    """Return x (samples, n) of  below_k x_(k-1) + own_k x_k + above_k x_(k+1) = right_k  [any unit].

    below, own, above : (samples, n, n), the first ``below`` and the last ``above`` without meaning; right : (samples, n).
    Rows are scaled to a largest entry of one first.  A singular system gives values that are not finite.
    """
    samples, n = right.shape
    largest = np.maximum.reduce([np.abs(part).max(axis=2) for part in (below, own, above)])
    parts = [np.ascontiguousarray(part / largest[:, :, None]) for part in (below, own, above)]
    parts[2][-1] = 0.0
    window, kept, x = np.zeros((2 * n, 3 * n + 1)), np.empty((samples, n, 3 * n + 1)), np.zeros((samples + 2, n))
    _forward(*parts, right / largest, window, kept)
    _backward(kept, x)
    return x[:samples]
