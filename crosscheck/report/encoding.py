"""Numbers in a script: base64 of little-endian float32, enough for the eye."""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import ArrayLike


def convert_to_base64(values: ArrayLike) -> str:
    """Return base64 of the values [any unit] as little-endian float32, in C order."""
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode("ascii")
