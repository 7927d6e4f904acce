"""The parallel-axis theorem: what the inertia of a body gains where it is stated about another point than its centre of mass."""

from __future__ import annotations

import numpy as np

from flexinv.typing import Array


def compute_parallel_axis_term(mass: float, arm: Array) -> Array:
    """Return m (|c|^2 1 - c c^T), (3, 3) [kg m^2], of a mass [kg] at the ``arm`` c (3,) [m] from a point (Steiner).

    The tensor about that point is the tensor about the centre of mass and this term.  No entry is a difference of squares.
    """
    x, y, z = arm.tolist()
    return np.array(
        [
            [mass * (y * y + z * z), -mass * x * y, -mass * x * z],
            [-mass * x * y, mass * (x * x + z * z), -mass * y * z],
            [-mass * x * z, -mass * y * z, mass * (x * x + y * y)],
        ]
    )
