"""Frozen data for real: the arrays of a mechanism can no more be written to than its other fields."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", bound=np.generic)


class Frozen:
    """Base of frozen dataclasses with arrays: each instance holds copies of its own that nobody can write to.

    Meshes, solvers and prepared functions are kept for a mechanism by its identity, so it must not change.
    """

    def __post_init__(self) -> None:
        """Replace every array that can be written to by a copy that cannot."""
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray) and value.flags.writeable:
                object.__setattr__(self, field.name, read_only(value))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take over what a pickle or a copy holds, and freeze it again."""
        self.__dict__.update(state)
        self.__post_init__()


def read_only(values: NDArray[T]) -> NDArray[T]:
    """Return a copy of an array [any unit] that cannot be written to."""
    copy = values.copy()
    copy.flags.writeable = False
    return copy
