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
class ArgumentForm:
    """One form of a value.

    name : of the form; make : from the value and random numbers to what is given and the clean value, or `NOTHING`
    taken : it has to be accepted wherever its clean value is
    """

    name: str
    make: Callable[[Any, Random], tuple[Any, Any]]
    taken: bool = False


class ForeignArray(np.ndarray[Any, Any]):
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
    ArgumentForm("list", _same(lambda a: a.tolist()), True),
    ArgumentForm("tuple", _same(lambda a: tuple(a.tolist())), True),
    ArgumentForm("bytes reversed", _same(lambda a: a.astype(">f8")), True),
    ArgumentForm("unaligned", _same(_unaligned), True),
    ArgumentForm("columns first", _same(np.asfortranarray), True),
    ArgumentForm("strided", _same(lambda a: np.repeat(a, 2, axis=0)[::2]), True),
    ArgumentForm("backwards", _same(lambda a: a[::-1].copy()[::-1]), True),
    ArgumentForm("read-only", _same(lambda a: np.frombuffer(a.tobytes()).reshape(a.shape)), True),
    ArgumentForm("pandas", _same(_table), True),
    ArgumentForm("objects", _same(lambda a: a.astype(object)), True),
    ArgumentForm("long", _same(lambda a: a.astype(np.longdouble)), True),
    ArgumentForm("nothing masked", _same(np.ma.masked_array), True),
    ArgumentForm("of a kind", _same(lambda a: a.view(ForeignArray)), True),
    ArgumentForm("single precision", _read(lambda a: a.astype(np.float32)), True),
    ArgumentForm("single, reversed", _read(lambda a: a.astype(">f4")), True),
    ArgumentForm("integers", _read(lambda a: np.rint(a).astype(int)), True),
    ArgumentForm("unsigned", _read(lambda a: np.abs(np.rint(a)).astype(np.uint8)), True),
    ArgumentForm("masked", _hidden),
    ArgumentForm("complex", _none(lambda a: a.astype(complex))),
    ArgumentForm("dates", _none(lambda a: np.rint(1e3 * a).astype("M8[s]"))),
    ArgumentForm("spans", _none(lambda a: np.rint(1e3 * a).astype("m8[s]"))),
    ArgumentForm("texts", _none(lambda a: a.astype(str))),
    ArgumentForm("truths", _none(lambda a: a > 0)),
    ArgumentForm("not a number", _spoilt(np.nan)),
    ArgumentForm("infinite", _spoilt(np.inf)),
    ArgumentForm("one axis more", _none(lambda a: np.array(a)[None, None])),
    ArgumentForm("one more", _none(lambda a: np.concatenate([a.ravel(), [0.5]]))),
    ArgumentForm("none of it", _none(lambda a: None)),
    ArgumentForm("a text", _none(lambda a: "0.1")),
    ArgumentForm("a table", _none(lambda a: {"a": 1.0})),
    ArgumentForm("ragged", _none(lambda a: [[0.0], [0.0, 1.0]])),
    ArgumentForm("an object", _none(lambda a: object())),
    ArgumentForm("with nothing in it", _none(lambda a: [None] * max(len(a), 1))),
)
NUMBER = (
    ArgumentForm("float64", _same(np.float64), True),
    ArgumentForm("0-d", _same(np.array), True),
    ArgumentForm("single precision", lambda x, random: (np.float32(x), float(np.float32(x))), True),
    ArgumentForm("fraction", lambda x, random: (Fraction(x), x), True),
    ArgumentForm("0-d, reversed", _same(lambda x: np.array(x, dtype=">f8")), True),
    ArgumentForm("text", _none(str)),
    ArgumentForm("truth", _none(lambda x: True)),
    ArgumentForm("complex", _none(lambda x: x + 1j)),
    ArgumentForm("not a number", _none(lambda x: np.nan)),
    ArgumentForm("list", _none(lambda x: [x])),
    ArgumentForm("two", _none(lambda x: np.array([x, x]))),
    ArgumentForm("date", _none(lambda x: np.datetime64(3, "s"))),
    ArgumentForm("span", _none(lambda x: np.timedelta64(3, "s"))),
    ArgumentForm("masked", _none(lambda x: np.ma.masked)),
    ArgumentForm("object", _none(lambda x: object())),
    ArgumentForm("table", _none(lambda x: {})),
    ArgumentForm("nothing", _none(lambda x: None)),
)
WHOLE = (
    ArgumentForm("int64", _same(np.int64), True),
    ArgumentForm("small", _same(np.int16), True),
    ArgumentForm("0-d", _same(np.array), True),
    ArgumentForm("float", _none(lambda n: n + 0.5)),
    ArgumentForm("text", _none(str)),
    ArgumentForm("truth", _none(lambda n: True)),
    ArgumentForm("huge", _none(lambda n: 10**30)),
    ArgumentForm("below zero", _none(lambda n: -7)),
    ArgumentForm("list", _none(lambda n: [n])),
    ArgumentForm("object", _none(lambda n: object())),
    ArgumentForm("not a number", _none(lambda n: np.nan)),
)
FLAG = (
    ArgumentForm("NumPy's", _same(np.bool_), True),
    ArgumentForm("one", _none(lambda t: 1)),
    ArgumentForm("text", _none(lambda t: "no")),
    ArgumentForm("list", _none(lambda t: [])),
    ArgumentForm("array", _none(lambda t: np.array([True, False]))),
    ArgumentForm("float", _none(lambda t: 0.0)),
)
CHOICE = (
    ArgumentForm("NumPy's", _same(np.str_), True),
    ArgumentForm("another", _none(lambda t: t + "s")),
    ArgumentForm("number", _none(lambda t: 3)),
    ArgumentForm("list", _none(lambda t: [t])),
    ArgumentForm("bytes", _none(lambda t: t.encode())),
    ArgumentForm("object", _none(lambda t: object())),
    ArgumentForm("array", _none(lambda t: np.array([t, t]))),
)
NAMES = (
    ArgumentForm("tuple", _same(tuple), True),
    ArgumentForm("array", _same(np.array), True),
    ArgumentForm("text", _none(lambda names: names[0] if names else "hub")),
    ArgumentForm("numbers", _none(lambda names: [3])),
    ArgumentForm("unknown", _none(lambda names: ["nobody"])),
    ArgumentForm("number", _none(lambda names: 3)),
    ArgumentForm("object", _none(lambda names: object())),
    ArgumentForm("lists", _none(lambda names: [["hub"]])),
)
THING = (
    ArgumentForm("number", _none(lambda thing: 3)),
    ArgumentForm("text", _none(lambda thing: "thing")),
    ArgumentForm("class", _none(type)),
    ArgumentForm("table", _none(lambda thing: {})),
    ArgumentForm("list", _none(lambda thing: [thing])),
    ArgumentForm("object", _none(lambda thing: object())),
    ArgumentForm("array", _none(lambda thing: np.zeros(3))),
)
TEXT = (
    ArgumentForm("number", _none(lambda t: 3)),
    ArgumentForm("bytes", _none(lambda t: b"a")),
    ArgumentForm("list", _none(lambda t: [t])),
    ArgumentForm("object", _none(lambda t: object())),
)


def _one_in(dresses: tuple[ArgumentForm, ...]) -> Callable[[Any, Random], tuple[Any, Any]]:
    """One of the values of a table by joint is dressed."""

    def make(table: Any, random: Random) -> tuple[Any, Any]:
        name = list(table)[random.integers(len(table))]
        given, clean = dresses[random.integers(len(dresses))].make(table[name], random)
        return {**table, name: given}, NOTHING if clean is NOTHING else {**table, name: clean}

    return make


# An angle may stand alone or as the one coordinate of its joint.
_ANGLE = tuple(dress for dress in NUMBER if dress.name not in ("list",))
BY_JOINT = (
    ArgumentForm("one value", _one_in(_ANGLE)),
    ArgumentForm("one infinite", lambda table, random: ({**table, next(iter(table)): np.inf}, NOTHING)),
    ArgumentForm("proxy", _same(MappingProxyType), True),
    ArgumentForm("unknown", _none(lambda table: {**table, "nobody": 0.1})),
    ArgumentForm("unknown number", _none(lambda table: {**table, 3: 0.1})),
    ArgumentForm("text", _none(lambda table: "hub")),
    ArgumentForm("number", _none(lambda table: 3)),
    ArgumentForm("list", _none(lambda table: [0.1] * 9)),
    ArgumentForm("object", _none(lambda table: object())),
    ArgumentForm("two values", _none(lambda table: {**table, next(iter(table)): [0.1] * 9})),
)
RENAMING = (
    ArgumentForm("proxy", _same(MappingProxyType), True),
    ArgumentForm("a number for a name", _none(lambda table: dict.fromkeys(table, 3))),
    ArgumentForm("a number by a name", _none(lambda table: {**table, 3: "elbow"})),
    ArgumentForm("a list for a name", _none(lambda table: {name: ["elbow"] for name in table})),
    ArgumentForm("text", _none(lambda table: "elbow")),
    ArgumentForm("list", _none(list)),
    ArgumentForm("object", _none(lambda table: object())),
)
KINDS: Mapping[str, tuple[ArgumentForm, ...]] = {
    "numbers": NUMBERS, "number": NUMBER, "whole": WHOLE, "flag": FLAG, "choice": CHOICE, "names": NAMES, "thing": THING,
    "text": TEXT, "by joint": BY_JOINT, "renaming": RENAMING,
}  # fmt: skip
