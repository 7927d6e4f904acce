"""Types that all modules share: arrays of floats, masks, indices, and position, velocity and acceleration of something."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]
# A quantity and its first two derivatives by time.
Triple = tuple[Array, Array, Array]
