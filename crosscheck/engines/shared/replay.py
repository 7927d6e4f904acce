"""Replay of torques on a free arm: the input that every engine gets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DriveTorques:
    """Torques of the drives over time, linear between the samples; the mechanism starts at rest.

    q : (nq,) where it starts [rad], [m]; spacing : of the samples [s]; torque : (samples, drives) [N m], [N]
    """

    q: Array
    spacing: float
    torque: Array

    def fill_efforts(self, actuated: NDArray[np.bool_]) -> Array:
        """Return the efforts of all velocity coordinates (samples, nv) [N m], [N], zero where there is no drive."""
        out = np.zeros((len(self.torque), len(actuated)))
        out[:, actuated] = self.torque
        return out
