"""Products of single (3,) vectors and (3, 3) matrices, compiled: what the element and the tree are written in."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def cross3(a, b):
    """Return a x b for two (3,) vectors [any unit]."""
    out = np.empty(3)
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


@njit(cache=True)
def skew3(a):
    """Return the (3, 3) matrix of a x [any unit]."""
    out = np.zeros((3, 3))
    out[0, 1], out[0, 2], out[1, 2] = -a[2], a[1], -a[0]
    out[1, 0], out[2, 0], out[2, 1] = a[2], -a[1], a[0]
    return out


@njit(cache=True)
def mul3(a, b):
    """Return a @ b for (3, 3) matrices [any unit]."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return out


@njit(cache=True)
def tmul3(a, b):
    """Return a^T @ b for (3, 3) matrices [any unit]."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = a[0, i] * b[0, j] + a[1, i] * b[1, j] + a[2, i] * b[2, j]
    return out


@njit(cache=True)
def apply3(a, v):
    """Return a @ v for a (3, 3) matrix and a vector [any unit]."""
    out = np.empty(3)
    for i in range(3):
        out[i] = a[i, 0] * v[0] + a[i, 1] * v[1] + a[i, 2] * v[2]
    return out


@njit(cache=True)
def tapply3(a, v):
    """Return a^T @ v for a (3, 3) matrix and a vector [any unit]."""
    out = np.empty(3)
    for i in range(3):
        out[i] = a[0, i] * v[0] + a[1, i] * v[1] + a[2, i] * v[2]
    return out


@njit(cache=True)
def dot3(a, b):
    """Return a . b for (3,) vectors [any unit]."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
