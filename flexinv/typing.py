"""Types that all modules share: arrays of floats, masks, indices, and position, velocity and acceleration of something."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]
Complex = NDArray[np.complex128]
# Values that are real or complex, as a problem has them.
RealOrComplex = NDArray[Any]
# Places in a table, as kernels count them that have no negative ones.
Unsigned = NDArray[np.uint64]
# A sparse matrix of SciPy, which has no types of its own.
Sparse = Any
# A quantity and its first two derivatives by time.
Triple = tuple[Array, Array, Array]
