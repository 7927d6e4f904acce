"""Validation of arguments: one InputError names the argument, what was given, what was expected, what to write.

Arguments are checked once, where they come in: those of verbs by the functions here, fields of records by rules that are made of
them (`model.rules`).  That numbers agree with one another is checked by the functions that use them.
"""

from __future__ import annotations

import difflib
import operator
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from numbers import Real
from os import PathLike, fspath
from reprlib import Repr
from typing import Any, NoReturn, TypeVar, cast

import numpy as np

from flexinv.errors import InputError
from flexinv.typing import Array

T = TypeVar("T")
LARGEST_INTEGER = int(np.iinfo(np.int64).max)
ARRAY_TYPE = np.ndarray
FLOAT_TYPE = np.dtype(np.float64)
_PLAIN = (int, float, complex, str, bytes, type(None), np.generic)
# What arrays hold instead of real numbers, by NumPy's letters.
_WRONG = {"c": ("complex ones", "; write their .real if that is meant")}
_WRONG["b"] = "True and False", "; write 1.0 and 0.0 if that is meant"
_WRONG["M"] = "dates", "; write seconds, (t - t[0]) / np.timedelta64(1, 's')"
_WRONG["m"] = "spans of time", "; write seconds, t / np.timedelta64(1, 's')"
# How what is asked for is made.
_MADE = {
    "Mechanism": "flexinv.load_mechanism('models/ur5')",
    "Motion": "flexinv.Motion.point_to_point({'joint': 0.0}, {'joint': 1.0}, duration=1.0)",
    "Path": "flexinv.Path.line(start, end, duration=1.0)",
    "Load": "flexinv.Load('link', force=[0, 0, -1])",
    "Solution": "flexinv.solve(mechanism, motion, step=1e-3)",
    "Regressor": "flexinv.torque_regressor(mechanism, q, qd, qdd)",
}


class _ShortRepr(Repr):
    """Values in a few words, also those within lists and tables."""

    def repr_instance(self, value: Any, level: int) -> str:
        """Return a number as it is, and what kind of thing all else is."""
        if isinstance(value, np.ndarray) and value.ndim:
            return f"an array of shape {value.shape}"
        if isinstance(value, type):
            return f"the class {value.__name__}"
        if isinstance(value, PathLike):
            return repr(fspath(value))
        if isinstance(value, _PLAIN):
            return super().repr_instance(value, level)
        kind = type(value).__name__
        return f"a{'n' * (kind[0] in 'aeiou')} {kind}"


_WORDS = _ShortRepr()
_WORDS.maxstring = _WORDS.maxother = 80  # paths among them
shown = _WORDS.repr


def refuse(name: str, value: object, expected: str, write: str = "") -> NoReturn:
    """Raise the InputError of an argument [any unit]."""
    raise InputError(f"{name} = {shown(value)}: expected {expected}" + (f"; write {write}" if write else ""))


def check_whole_number(name: str, value: object, least: int, expected: str = "") -> int:
    """Return a whole number [-], ``least`` or more; of floats none is, whole or not."""
    result = None
    if not isinstance(value, bool | np.bool_):
        with suppress(TypeError):
            result = operator.index(value)  # type: ignore[arg-type]
    if result is None or result < least:
        meant = _convert_to_float(value, text=True) if result is None else None
        write = f"{meant:.0f}" if meant is not None and meant >= least and meant.is_integer() else ""
        kind = "a whole number: " if result is None else ""
        refuse(name, value, kind + (expected or f"{least} or more"), write)
    if result > LARGEST_INTEGER:
        refuse(name, value, f"a whole number of {LARGEST_INTEGER} at most")
    return result


def resolve_index(name: str, value: object, count: int) -> int:
    """Return the number of one of ``count`` [-], counted from the end where it is below 0."""
    expected = f"a number from 0 to {count - 1}, or from -{count} to -1 counted from the end"
    index = check_whole_number(name, value, -count, expected)
    if index >= count:
        refuse(name, value, expected)
    return index


def check_number(name: str, value: object, expected: str) -> float:
    """Return a real number [any unit] as a float; neither a text nor a truth is one."""
    result = _convert_to_float(value)
    if result is None:
        meant = _convert_to_float(value, text=True)
        refuse(name, value, expected, "" if meant is None else f"{meant:g}")
    return result


def check_seconds(name: str, value: object, expected: str, zero: bool = False) -> float:
    """Return a time above 0 [s], with ``zero`` also 0; raise InputError for others."""
    time = check_number(name, value, expected)
    if not (np.isfinite(time) and (time > 0.0 or (zero and time == 0.0))):
        raise InputError(f"{name} = {time} s: expected {expected}")
    return time


def _convert_to_float(value: object, text: bool = False) -> float | None:
    """A number as a float, of a text only if asked for; None where it is none."""
    with suppress(TypeError, ValueError, OverflowError):
        if (isinstance(value, Real) and not isinstance(value, bool)) or (text and isinstance(value, str)):
            return float(value)
        if hasattr(value, "__array__") and not np.ma.is_masked(value):
            array = np.asarray(value)
            return float(array) if array.ndim == 0 and array.dtype.kind in "iuf" else None
    return None


def convert_to_floats(name: str, value: Any) -> Array:
    """Return numbers [any unit] as an array of floats, without a copy where they are one.

    Raises InputError for texts, truths, dates, complex numbers, other objects, and for entries that a mask hides.
    """
    if type(value) is ARRAY_TYPE and value.dtype is FLOAT_TYPE and value.flags.aligned:
        return value
    if np.ma.isMaskedArray(value) and np.ma.getmaskarray(value).any():
        hidden = np.count_nonzero(np.ma.getmaskarray(value))
        advice = "write .filled(...) with numbers for them, or leave these samples out"
        raise InputError(f"{name}: expected numbers, got a masked array of which {hidden} are hidden; {advice}")
    try:
        given = np.asarray(value)
        real = given.dtype.kind in "iuf"
        if given.dtype == object:  # others are not looked through one by one
            real = given.ndim > 0 and all(_is_real(one) or np.ndim(one) for one in given.ravel())
        if real:
            return np.require(given, dtype=float, requirements="A")
    except (TypeError, ValueError, OverflowError):  # lists of unequal length, among others
        raise InputError(f"{name}: expected numbers, got {shown(value)}; write lists of equal length") from None
    what, write = _WRONG.get(given.dtype.kind, (shown(value), ""))
    raise InputError(f"{name}: expected numbers, got {what}{write}")


def check_finite_array(name: str, value: Any, shape: tuple[int | None, ...], unit: str) -> Array:
    """Return finite numbers [any unit] of a shape as an array of floats; None in the shape is any number.

    Raises InputError as `convert_to_floats` does, and for another shape or a number that is not finite.
    """
    numbers = convert_to_floats(name, value)
    fits = len(numbers.shape) == len(shape)
    if not fits or any(wanted not in (None, length) for length, wanted in zip(numbers.shape, shape, strict=True)):
        refuse(name, value, f"finite numbers {format_shape(shape)} [{unit}]")
    if not np.isfinite(numbers).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(numbers))[0])
        place = f"{name}{list(where)}" if where else name
        raise InputError(f"{place} = {numbers[where]}: expected a finite number [{unit}]")
    return numbers


def format_shape(shape: tuple[int | None, ...]) -> str:
    """Return a shape [-] as it is written: (3,), (n, 6)."""
    sizes = ["n" if size is None else str(size) for size in shape]
    return f"({sizes[0]},)" if len(sizes) == 1 else f"({', '.join(sizes)})"


def _is_real(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def check_kind(name: str, value: object, kind: type[T], does: tuple[str, ...] = ()) -> T:
    """Return a value of a kind [-], or one with all the attributes that ``does`` names; raise InputError for others."""
    if isinstance(value, kind):
        return value
    if does and not isinstance(value, type) and all(hasattr(value, one) for one in does):
        return cast(T, value)
    path = kind.__name__ == "Mechanism" and isinstance(value, str | PathLike)
    write = f"flexinv.load_mechanism({shown(value)})" if path else _MADE.get(kind.__name__, "")
    refuse(name, value, f"a {kind.__name__}", write)


def check_kinds(name: str, values: Iterable[object], kind: type[T]) -> list[T]:
    """Return a list [-] of values that are all of a kind; raise InputError for others."""
    if isinstance(values, kind):
        refuse(name, values, f"a list, each a {kind.__name__}", f"[{name}]")
    if isinstance(values, str) or not isinstance(values, Iterable):
        refuse(name, values, f"a list, each a {kind.__name__}", f"[{_MADE.get(kind.__name__, '')}]")
    return [check_kind(f"{name}[{k}]", value, kind) for k, value in enumerate(values)]


def check_mapping(name: str, value: object, expected: str, write: str) -> Mapping[Any, Any]:
    """Return a mapping [-], an empty one for None."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        refuse(name, value, expected, write)
    return value


def check_renaming(name: str, value: object, expected: str, write: str) -> Mapping[str, str]:
    """Return a table of names by names [-], an empty one for None."""
    stated = check_mapping(name, value, expected, write)
    if not all(isinstance(one, str) for pair in stated.items() for one in pair):
        refuse(name, value, expected, write)
    return stated


def check_names(name: str, value: object, of: str) -> tuple[str, ...]:
    """Return the names [-] of a collection as plain texts: a single text is none, which would be read letter by letter."""
    if isinstance(value, str):
        refuse(name, value, f"a list of names of {of}", f"[{value!r}]")
    if not isinstance(value, Collection) or not all(isinstance(one, str) for one in value):
        refuse(name, value, f"a list of names of {of}")
    return tuple(map(str, value))


def check_choice(name: str, value: object, options: Mapping[str, str]) -> str:
    """Return a text that is one of the options [-], each with what it means; raise InputError for others."""
    if not isinstance(value, str) or value not in options:
        refuse(name, value, " or ".join(f"{one!r} ({means})" for one, means in options.items()))
    return str(value)


def check_flag(name: str, value: object) -> bool:
    """Return a truth [-]; a text such as "no" is none."""
    if not isinstance(value, bool | np.bool_):
        refuse(name, value, "True or False")
    return bool(value)


def check_callable(name: str, value: object, expected: str) -> None:
    """Raise InputError unless a value is None or can be called [-]."""
    if value is not None and not isinstance(value, Callable):  # type: ignore[arg-type]
        refuse(name, value, f"{expected}, or None")


def check_path(name: str, value: object, example: str) -> str | PathLike[str]:
    """Return the path of a file or a folder [-]."""
    if not isinstance(value, str | PathLike):
        refuse(name, value, f"the path of {example}")
    return value


def find_nearest_word(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that ``word`` is most like or begins (``gear``: ``gear_ratio``), None when there is none [-]."""
    words = list(known)
    found = difflib.get_close_matches(word, words, n=1, cutoff=0.6) or [k for k in words if k.startswith(f"{word}_")]
    return found[0] if found else None
