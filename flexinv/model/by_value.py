"""Equality by value: records are equal when their data are, so that copies and pickles equal their originals.

Python's own comparison of data classes ends at their first array, whose truth is none.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import fields, is_dataclass
from functools import partial
from types import FunctionType
from typing import Any

import numpy as np


def is_same(one: Any, other: Any) -> bool:
    """Return True if two values [any unit] hold the same data: arrays by shape and numbers, records field by field."""
    if one is other:
        return True
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return _is_same_array(one, other)
    if type(one) is not type(other):
        return bool(one == other) if isinstance(one, int | float) and isinstance(other, int | float) else False
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(is_same, one, other))
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(is_same(value, other[key]) for key, value in one.items())
    data = _take_data(one)
    return _is_same_plain(one, other) if data is one else is_same(data, _take_data(other))


def _take_data(value: Any) -> Any:
    """The parts of a record; a value that compares by itself is its own data."""
    if isinstance(value, BaseException):
        return value.args
    if isinstance(value, partial):
        return value.func, value.args, value.keywords
    if is_dataclass(value):
        return [getattr(value, field.name) for field in fields(value) if field.compare]
    kind: Any = type(value)
    if kind.__eq__ is object.__eq__ and hasattr(value, "__dict__") and not isinstance(value, FunctionType):
        return vars(value)
    return value


def _is_same_plain(one: Any, other: Any) -> bool:
    return bool(one == other) or bool(one != one and other != other)


def _is_same_array(one: Any, other: Any) -> bool:
    if not (isinstance(one, np.ndarray) and isinstance(other, np.ndarray)) or one.dtype.kind != other.dtype.kind:
        return False
    return np.array_equal(one, other, equal_nan=one.dtype.kind in "fc")


def compute_hash(value: Any) -> int:
    """Return a hash [-] that is the same for all values that `is_same` calls equal."""
    if isinstance(value, np.ndarray):
        return hash((value.shape, (value + 0.0).tobytes()))  # minus zero is zero
    if isinstance(value, tuple | list):
        return hash(tuple(map(compute_hash, value)))
    if isinstance(value, Mapping):
        return hash(frozenset((key, compute_hash(part)) for key, part in value.items()))
    if is_dataclass(value):
        return hash(tuple(compute_hash(getattr(value, field.name)) for field in fields(value) if field.compare))
    return hash(value) if isinstance(value, Hashable) else 0


class ByValue:
    """Base of data classes (``eq=False``) that are equal when their data are; they are no keys of tables."""

    def __eq__(self, other: object) -> bool:
        """Return True if another record of this class holds the same data [any unit]."""
        if type(self) is not type(other):
            return NotImplemented
        return is_same(self, other)

    def __hash__(self) -> int:
        """Raise a TypeError: their arrays can be written to [-]."""
        raise TypeError(f"unhashable type: {type(self).__name__!r}, whose arrays can be written to")
