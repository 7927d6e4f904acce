"""Frozen records: what their fields hold is checked when they are made, and nobody can write to it after."""

from __future__ import annotations

from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from flexinv.model import rules
from flexinv.model.by_value import ByValue, compute_hash

T = TypeVar("T", bound=np.generic)


class Frozen(ByValue):
    """Base of frozen dataclasses: what their fields hold is checked when they are made, and nobody can write to it after.

    Meshes, solvers and prepared functions are kept for a mechanism by its identity, so it must not change.
    RULES : field -> its rule (`rules`), which returns the value that is held: floats, read-only arrays of floats, tuples
    """

    RULES: ClassVar[rules.Rules] = {}
    # `owned_cache.freeze` need not look through a record whose arrays nobody can write to.
    ARRAYS_ARE_FROZEN: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Hold every value as its rule has it.  Raises InputError: the record, its field, what was given and expected."""
        where = self._describe_record()
        for name, rule in self.RULES.items():
            given = getattr(self, name)
            held = rule(where + name, given)
            if held is not given:
                object.__setattr__(self, name, held)
        self._replace_writable_arrays()
        self._check(where)

    def _describe_record(self) -> str:
        """Return the words before the name of a field in a message [-]."""
        name = getattr(self, "name", None)
        return f"{type(self).__name__} {name!r}: " if isinstance(name, str) else f"{type(self).__name__}: "

    def _check(self, where: str) -> None:
        """Raise InputError where fields contradict one another [any unit]; each of them keeps its rule."""

    def _replace_writable_arrays(self) -> None:
        """Replace every array that can be written to by a copy that cannot."""
        for name, value in list(vars(self).items()):
            if isinstance(value, np.ndarray) and value.flags.writeable:
                object.__setattr__(self, name, read_only(value))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take over what a pickle or a copy holds, and freeze it again."""
        self.__dict__.update(state)
        self._replace_writable_arrays()

    def __hash__(self) -> int:
        """Return the hash of the data [-]."""
        return compute_hash(self)


def read_only(values: NDArray[T]) -> NDArray[T]:
    """Return a copy of an array [any unit] that cannot be written to."""
    copy = values.copy()
    copy.flags.writeable = False
    return copy
