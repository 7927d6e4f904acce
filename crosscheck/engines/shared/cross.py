"""Cross products of three components: the sums of `numpy.cross` to the bit, whose general axes take twenty times as long."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def cross(a: Array, b: Array) -> Array:
    """Return a x b, each (3,) [products of their units]."""
    x, y, z = a.tolist()
    u, v, w = b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def cross_columns(columns: Array, b: Array) -> Array:
    """Return the cross product of every column (3, columns) with b (3,) [products of their units]."""
    x, y, z = columns
    u, v, w = b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
