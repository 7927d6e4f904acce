"""Block tridiagonal systems, one block row for every instant: Gauss elimination along time with partial pivoting (compiled).

Pivots are sought in the block row at hand and the one after it, which is all that a column reaches: growing and decaying
solutions stand side by side in a boundary-value problem, and a block may be singular by itself.
(LAPACK's band solver does the same; its threads wait for each other on blocks of this size.)
"""

from __future__ import annotations

import numpy as np

from flexinv.kernels.dense import eliminate
from flexinv.kernels.jit import jit
from flexinv.typing import Array


@jit
def _forward(whole, window):
    """Eliminate below the diagonal: block rows [below, own, above, right] become [own, after, one further, right] of a triangle.

    whole : (samples, n, 3 n + 1); window : (2 n, 3 n + 1) scratch: the block row at hand and the one after it
    """
    samples, n, wide = whole.shape
    for k in range(-1, samples):
        for i in range(n):  # what is left of the row after is where the next begins
            for j in range(2 * n):
                window[i, j] = window[n + i, n + j]
            for j in range(2 * n, wide - 1):
                window[i, j] = 0.0
            window[i, wide - 1] = window[n + i, wide - 1]
        if k + 1 < samples:
            for i in range(n):
                for j in range(wide):
                    window[n + i, j] = whole[k + 1, i, j]
        if k >= 0:
            eliminate(window, n, 2 * n if k + 1 < samples else n, wide)
            for i in range(n):
                for j in range(wide):
                    whole[k, i, j] = window[i, j]


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
    whole = np.concatenate([below, own, above, right[:, :, None]], axis=2) / largest[:, :, None]
    whole[-1, :, 2 * n : 3 * n] = 0.0
    x = np.zeros((samples + 2, n))
    _forward(whole, np.zeros((2 * n, 3 * n + 1)))
    _backward(whole, x)
    return x[:samples]
