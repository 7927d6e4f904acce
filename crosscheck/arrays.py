"""Arrays of numbers in a compressed file of NumPy's: never objects, which would be read back as programs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def write_arrays(file: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays by name [any unit] into ``file``, nothing else.  Raises ValueError where one holds objects.

    The keyword ``allow_pickle`` of ``numpy.savez_compressed`` says the same from NumPy 2.1 on; in 2.0 it is one more array.
    """
    for name, values in arrays.items():
        if np.asarray(values).dtype.hasobject:
            raise ValueError(f"{file.name}: the array {name!r} holds objects, expected numbers or texts of one length")
    named: dict[str, Any] = dict(arrays)  # typed so that no name is taken for a keyword
    np.savez_compressed(file, **named)
