"""Caches that belong to what they were computed from: results stay with a mesh, a mechanism or a motion, and go with it.

What is kept is handed out again and again, so that nobody may write into it: all its arrays are read-only (`make_read_only`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np

Owner = TypeVar("Owner")
Key = ParamSpec("Key")
Result = TypeVar("Result")

# The attribute in which an owner holds its results; the data of a frozen record are its fields, and this is none of them.
ATTRIBUTE = "_kept_results"


class _Results(dict[str, dict[Any, Any]]):
    """Results by function and key; a copy and a pickle of the owner begin without them."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _Results, ()


def make_read_only(result: Result) -> Result:
    """Make all arrays of a result [any unit] read-only in place, those in its tuples, lists, tables and data classes, too."""
    if isinstance(result, np.ndarray):
        result.flags.writeable = False
    elif isinstance(result, (tuple, list)):
        for part in result:
            make_read_only(part)
    elif isinstance(result, Mapping):
        for part in result.values():
            make_read_only(part)
    elif is_dataclass(result) and not getattr(result, "ARRAYS_ARE_FROZEN", False):
        for field in fields(result):
            make_read_only(getattr(result, field.name))
    return result


def make_owner_cache(
    most: int = 64, typed: bool = False, frozen: bool = True
) -> Callable[[Callable[Concatenate[Owner, Key], Result]], Callable[Concatenate[Owner, Key], Result]]:
    """Return a decorator: the first argument of a function keeps its last results, by the other arguments.

    These are hashable, or arrays [any unit], of which the numbers count; they are given by position, as the key is their order.
    most : results of one function that an owner keeps [-], the oldest goes first; typed : 2.0 is not 2, nor 1 True
    frozen : arrays of a result are made read-only; False for a result that has a work space
    The function that is returned raises a TypeError for arguments that are given by name.
    """

    def make_cached_function(
        function: Callable[Concatenate[Owner, Key], Result],
    ) -> Callable[Concatenate[Owner, Key], Result]:
        name = f"{function.__module__}.{function.__qualname__}"

        @wraps(function)
        def run_cached(owner: Owner, /, *key: Key.args, **named: Key.kwargs) -> Result:
            if named:
                raise TypeError(f"{function.__name__}: {', '.join(named)} by name: its arguments are given by position")
            results = owner.__dict__.get(ATTRIBUTE)
            if results is None:
                results = owner.__dict__.setdefault(ATTRIBUTE, _Results())
            by_arguments = results.setdefault(name, {})
            index: tuple[Any, ...] = tuple(map(type, key)) if typed else ()
            index += tuple((k.shape, k.dtype.char, k.tobytes()) if isinstance(k, np.ndarray) else k for k in key)
            try:
                return by_arguments[index]  # type: ignore[no-any-return]
            except KeyError:
                pass
            result = function(owner, *key, **named)
            found = by_arguments.setdefault(index, make_read_only(result) if frozen else result)
            for old in list(by_arguments)[: max(len(by_arguments) - most, 0)]:
                by_arguments.pop(old, None)
            return found  # type: ignore[no-any-return]

        return run_cached

    return make_cached_function
