"""Dresses of arguments: one value in many forms, each with the clean value that it stands for, or with none.

What stands for a clean value has to give its result; what stands for none has to be refused with words.  The conversion here is
NumPy's and Python's own, and knows nothing of flexinv's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd

Random = np.random.Generator
NOTHING: Any = type("Nothing", (), {"__repr__": lambda self: "nothing"})()


@dataclass(frozen=True)
class Dress:
    """One form of a value.

    name : of the form; make : from the value and random numbers to what is given and the clean value, or `NOTHING`
    taken : it has to be accepted wherever its clean value is
    """

    name: str
    make: Callable[[Any, Random], tuple[Any, Any]]
    taken: bool = False


class Tagged(np.ndarray[Any, Any]):
    """An array of somebody else's kind."""


def _same(form: Callable[[Any], Any]) -> Callable[[Any, Random], tuple[Any, Any]]:
    return lambda value, random: (form(value), value)


def _read(form: Callable[[Any], Any]) -> Callable[[Any, Random], tuple[Any, Any]]:
    """A form that rounds: its clean value is what NumPy reads of it."""

    def make(value: Any, random: Random) -> tuple[Any, Any]:
        given = form(value)
        return given, np.array(given, dtype=float)

    return make


def _none(form: Callable[[Any], Any]) -> Callable[[Any, Random], tuple[Any, Any]]:
    return lambda value, random: (form(value), NOTHING)


def _spoilt(number: float) -> Callable[[Any, Random], tuple[Any, Any]]:
    def make(value: Any, random: Random) -> tuple[Any, Any]:
        given = np.array(value, dtype=float)
        if given.size:
            given.flat[random.integers(given.size)] = number
        return given, NOTHING if given.size else value

    return make


def _hidden(value: Any, random: Random) -> tuple[Any, Any]:
    mask = np.zeros(np.shape(value), dtype=bool)
    if mask.size:
        mask.flat[random.integers(mask.size)] = True
    return np.ma.masked_array(value, mask), NOTHING if mask.size else value


def _unaligned(value: Any) -> Any:
    plain = np.ascontiguousarray(value, dtype=float)
    return np.ndarray(plain.shape, float, buffer=bytearray(b"\0" * 3 + plain.tobytes()), offset=3)


def _table(value: Any) -> Any:
    return pd.Series(value) if np.ndim(value) == 1 else pd.DataFrame(value) if np.ndim(value) == 2 else np.array(value)


NUMBERS = (
    Dress("list", _same(lambda a: a.tolist()), True),
    Dress("tuple", _same(lambda a: tuple(a.tolist())), True),
    Dress("bytes reversed", _same(lambda a: a.astype(">f8")), True),
    Dress("unaligned", _same(_unaligned), True),
    Dress("columns first", _same(np.asfortranarray), True),
    Dress("strided", _same(lambda a: np.repeat(a, 2, axis=0)[::2]), True),
    Dress("backwards", _same(lambda a: a[::-1].copy()[::-1]), True),
    Dress("read-only", _same(lambda a: np.frombuffer(a.tobytes()).reshape(a.shape)), True),
    Dress("pandas", _same(_table), True),
    Dress("objects", _same(lambda a: a.astype(object)), True),
    Dress("long", _same(lambda a: a.astype(np.longdouble)), True),
    Dress("nothing masked", _same(np.ma.masked_array), True),
    Dress("of a kind", _same(lambda a: a.view(Tagged)), True),
    Dress("single precision", _read(lambda a: a.astype(np.float32)), True),
    Dress("single, reversed", _read(lambda a: a.astype(">f4")), True),
    Dress("integers", _read(lambda a: np.rint(a).astype(int)), True),
    Dress("unsigned", _read(lambda a: np.abs(np.rint(a)).astype(np.uint8)), True),
    Dress("masked", _hidden),
    Dress("complex", _none(lambda a: a.astype(complex))),
    Dress("dates", _none(lambda a: np.rint(1e3 * a).astype("M8[s]"))),
    Dress("spans", _none(lambda a: np.rint(1e3 * a).astype("m8[s]"))),
    Dress("texts", _none(lambda a: a.astype(str))),
    Dress("truths", _none(lambda a: a > 0)),
    Dress("not a number", _spoilt(np.nan)),
    Dress("infinite", _spoilt(np.inf)),
    Dress("one axis more", _none(lambda a: np.array(a)[None, None])),
    Dress("one more", _none(lambda a: np.concatenate([a.ravel(), [0.5]]))),
    Dress("none of it", _none(lambda a: None)),
    Dress("a text", _none(lambda a: "0.1")),
    Dress("a table", _none(lambda a: {"a": 1.0})),
    Dress("ragged", _none(lambda a: [[0.0], [0.0, 1.0]])),
    Dress("an object", _none(lambda a: object())),
    Dress("with nothing in it", _none(lambda a: [None] * max(len(a), 1))),
)
NUMBER = (
    Dress("float64", _same(np.float64), True),
    Dress("0-d", _same(np.array), True),
    Dress("single precision", lambda x, random: (np.float32(x), float(np.float32(x))), True),
    Dress("fraction", lambda x, random: (Fraction(x), x), True),
    Dress("0-d, reversed", _same(lambda x: np.array(x, dtype=">f8")), True),
    Dress("text", _none(str)),
    Dress("truth", _none(lambda x: True)),
    Dress("complex", _none(lambda x: x + 1j)),
    Dress("not a number", _none(lambda x: np.nan)),
    Dress("list", _none(lambda x: [x])),
    Dress("two", _none(lambda x: np.array([x, x]))),
    Dress("date", _none(lambda x: np.datetime64(3, "s"))),
    Dress("span", _none(lambda x: np.timedelta64(3, "s"))),
    Dress("masked", _none(lambda x: np.ma.masked)),
    Dress("object", _none(lambda x: object())),
    Dress("table", _none(lambda x: {})),
    Dress("nothing", _none(lambda x: None)),
)
WHOLE = (
    Dress("int64", _same(np.int64), True),
    Dress("small", _same(np.int16), True),
    Dress("0-d", _same(np.array), True),
    Dress("float", _none(lambda n: n + 0.5)),
    Dress("text", _none(str)),
    Dress("truth", _none(lambda n: True)),
    Dress("huge", _none(lambda n: 10**30)),
    Dress("below zero", _none(lambda n: -7)),
    Dress("list", _none(lambda n: [n])),
    Dress("object", _none(lambda n: object())),
    Dress("not a number", _none(lambda n: np.nan)),
)
FLAG = (
    Dress("NumPy's", _same(np.bool_), True),
    Dress("one", _none(lambda t: 1)),
    Dress("text", _none(lambda t: "no")),
    Dress("list", _none(lambda t: [])),
    Dress("array", _none(lambda t: np.array([True, False]))),
    Dress("float", _none(lambda t: 0.0)),
)
CHOICE = (
    Dress("NumPy's", _same(np.str_), True),
    Dress("another", _none(lambda t: t + "s")),
    Dress("number", _none(lambda t: 3)),
    Dress("list", _none(lambda t: [t])),
    Dress("bytes", _none(lambda t: t.encode())),
    Dress("object", _none(lambda t: object())),
    Dress("array", _none(lambda t: np.array([t, t]))),
)
NAMES = (
    Dress("tuple", _same(tuple), True),
    Dress("array", _same(np.array), True),
    Dress("text", _none(lambda names: names[0] if names else "hub")),
    Dress("numbers", _none(lambda names: [3])),
    Dress("unknown", _none(lambda names: ["nobody"])),
    Dress("number", _none(lambda names: 3)),
    Dress("object", _none(lambda names: object())),
    Dress("lists", _none(lambda names: [["hub"]])),
)
THING = (
    Dress("number", _none(lambda thing: 3)),
    Dress("text", _none(lambda thing: "thing")),
    Dress("class", _none(type)),
    Dress("table", _none(lambda thing: {})),
    Dress("list", _none(lambda thing: [thing])),
    Dress("object", _none(lambda thing: object())),
    Dress("array", _none(lambda thing: np.zeros(3))),
)
TEXT = (
    Dress("number", _none(lambda t: 3)),
    Dress("bytes", _none(lambda t: b"a")),
    Dress("list", _none(lambda t: [t])),
    Dress("object", _none(lambda t: object())),
)


def _one_in(dresses: tuple[Dress, ...]) -> Callable[[Any, Random], tuple[Any, Any]]:
    """One of the values of a table by joint is dressed."""

    def make(table: Any, random: Random) -> tuple[Any, Any]:
        name = list(table)[random.integers(len(table))]
        given, clean = dresses[random.integers(len(dresses))].make(table[name], random)
        return {**table, name: given}, NOTHING if clean is NOTHING else {**table, name: clean}

    return make


# An angle may stand alone or as the one coordinate of its joint.
_ANGLE = tuple(dress for dress in NUMBER if dress.name not in ("list",))
BY_JOINT = (
    Dress("one value", _one_in(_ANGLE)),
    Dress("one infinite", lambda table, random: ({**table, next(iter(table)): np.inf}, NOTHING)),
    Dress("proxy", _same(MappingProxyType), True),
    Dress("unknown", _none(lambda table: {**table, "nobody": 0.1})),
    Dress("unknown number", _none(lambda table: {**table, 3: 0.1})),
    Dress("text", _none(lambda table: "hub")),
    Dress("number", _none(lambda table: 3)),
    Dress("list", _none(lambda table: [0.1] * 9)),
    Dress("object", _none(lambda table: object())),
    Dress("two values", _none(lambda table: {**table, next(iter(table)): [0.1] * 9})),
)
RENAMING = (
    Dress("proxy", _same(MappingProxyType), True),
    Dress("a number for a name", _none(lambda table: dict.fromkeys(table, 3))),
    Dress("a number by a name", _none(lambda table: {**table, 3: "elbow"})),
    Dress("a list for a name", _none(lambda table: {name: ["elbow"] for name in table})),
    Dress("text", _none(lambda table: "elbow")),
    Dress("list", _none(list)),
    Dress("object", _none(lambda table: object())),
)
KINDS: Mapping[str, tuple[Dress, ...]] = {
    "numbers": NUMBERS, "number": NUMBER, "whole": WHOLE, "flag": FLAG, "choice": CHOICE, "names": NAMES, "thing": THING,
    "text": TEXT, "by joint": BY_JOINT, "renaming": RENAMING,
}  # fmt: skip
