"""Headers of logs: which column is the angle and the effort of which joint, by names, numbers and units, and what is doubtful.

A column belongs to the joint whose name stands in it; else to the one that its number means, counted from 1 or from 0; else,
where there are as many columns as joints, to the one in its place.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.identification.settings import ANGLES, EFFORTS
from flexinv.model.mechanism import Joint
from flexinv.typing import Array

# How headers write units -> unit of identify.toml; a rate is no angle.
UNITS = {
    "deg": "deg", "degs": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "rads": "rad", "radians": "rad",
    "mm": "mm", "m": "m", "nm": "N m", "n m": "N m", "n·m": "N m", "n.m": "N m", "n-m": "N m", "n": "N", "a": "A", "amp": "A",
    "amps": "A", "ampere": "A", "mnm": "mN m",
}  # fmt: skip
TIMES = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "ms": "ms", "msec": "ms", "millis": "ms",
    "milliseconds": "ms", "us": "us", "µs": "us", "μs": "us", "usec": "us", "micros": "us", "microseconds": "us", "ns": "ns",
    "nsec": "ns", "nanos": "ns", "nanoseconds": "ns",
}  # fmt: skip
RATES = re.compile(r"per_s|/s(?![a-z])|_s\b|rate|vel|speed|acc|qd|dq", re.IGNORECASE)
# What was asked for, what a controller makes of it, and what is told of the tool or of the room: no sensor of a joint.
TOLD = re.compile(
    r"ref|des|cmd|command|target|setpoint|error|goal|(?:q|tau|pos|torque|theta)_d(?![a-z])|_ext|tcp|pose|cart|temp|volt|limit",
    re.IGNORECASE,
)
SECOND = re.compile(r"link|secondary|output|joint_side", re.IGNORECASE)
ANGLE = re.compile(r"angle|pos|(?:^|[^a-z])q(?![a-z])|theta|phi|enc", re.IGNORECASE)
EFFORT = re.compile(
    r"torque|trq|effort|current|tau|force|moment|(?:^|[^a-z])(?:eff|i_?\d+|t\d+)(?![a-z])", re.IGNORECASE
)
TIME = re.compile(
    r"^(t|time|timestamp|stamp|clock)(?![a-z0-9])(?!_\d)|^time|[_ .]time$|^(milli|micro|nano)s", re.IGNORECASE
)
TURNS = 4.0 * np.pi  # [rad]: an angle without a unit that reaches farther is taken as degrees
SLOW = 0.5  # [s]: no motion of a machine is seen in samples that are farther apart
SHORT = 3  # letters: names as short as that stand in words that mean something else


@dataclass(frozen=True)
class Column:
    """A column of a log as a sensor of a joint; unit : as identify.toml writes it; why : doubts in words, "" without any."""

    name: str
    unit: str
    why: str = ""


Found = Mapping[str, Mapping[str, Column]]


def find_time_column(names: Sequence[str]) -> str:
    """Return the column that looks like times [s]; "time_s" where none does, which the reader of logs then misses in words."""
    like = [name for name in names if name == "time_s"] or [name for name in names if TIME.search(name)]
    return like[0] if like else "time_s"


def find_time_unit(name: str, spacing: float) -> tuple[str, str]:
    """Return the unit of a column of times [-], and a doubt in words; spacing : of its samples as written [that unit]."""
    if unit := _find_unit(name, TIMES):
        return unit, ""
    if spacing < SLOW:
        return "s", ""
    unit = next((one for one, factor in (("ms", 1e-3), ("us", 1e-6)) if spacing * factor < SLOW), "ns")
    return unit, f"the header names no unit, and steps of {spacing:g} s would be slow: is it {unit}?"


def match_joint_columns(joints: Sequence[Joint], columns: Mapping[str, Array]) -> dict[str, dict[str, Column]]:
    """Return by joint its columns "angle", "link_angle", "effort" [unit of each]; joints without any are left out."""
    names = _map_joint_names(joints)
    owners = {name: _find_column_joint(name, names) for name in columns}
    kinds: dict[str, list[Column]] = {"angle": [], "link_angle": [], "effort": []}
    for name, values in columns.items():
        if column_sense := _find_column_sense(name, _remove_words(name, names.get(owners[name], ())), values):
            kinds[column_sense[0]].append(column_sense[1])
    out: dict[str, dict[str, Column]] = {}
    for kind, every in kinds.items():
        for joint, own in _split_columns(joints, every, owners).items():
            slides = next(j for j in joints if j.name == joint).kind == "prismatic"
            fitting = [_resolve_unit(c, kind, slides) for c in own if _has_fitting_unit(c, kind, slides)]
            if fitting:
                out.setdefault(joint, {})[kind] = _choose_column(fitting, kind)
    return out


# --------------------------------------------------------------------------------------------------- what a column is


def _find_column_sense(name: str, rest: str, values: Array) -> tuple[str, Column] | None:
    """The sense of a column, and the column with its unit; rest : its name without that of its joint."""
    unit = _find_unit(rest, UNITS)
    if TOLD.search(rest):
        return None
    if not RATES.search(rest) and (unit in ANGLES or (not unit and ANGLE.search(rest))):
        kind = "link_angle" if SECOND.search(rest) else "angle"
        return kind, Column(name, unit) if unit else _resolve_angle_unit(name, values)
    if unit in EFFORTS or (not unit and EFFORT.search(rest) and not RATES.search(rest)):
        return "effort", Column(name, unit)
    return None


def _resolve_angle_unit(name: str, values: Array) -> Column:
    """A coordinate whose unit no header names."""
    far = float(np.nanmax(np.abs(values), initial=0.0))
    return Column(name, "", f"it reaches {far:.3g}" if far > TURNS else "")


def _resolve_unit(column: Column, kind: str, slides: bool) -> Column:
    """The column with a unit: where its header names none, that of the joint, with a doubt."""
    if column.unit:
        return column
    units = ("N", "N m") if kind == "effort" else ("m", "deg" if column.why else "rad")
    unit = units[0] if slides else units[1]
    reaches = f" and {column.why}" if column.why else ""
    return Column(column.name, unit, f"the header names no unit{reaches}: is it {unit}?")


def _has_fitting_unit(column: Column, kind: str, slides: bool) -> bool:
    return kind == "effort" or not column.unit or (column.unit in ("m", "mm")) == slides


def _choose_column(columns: list[Column], kind: str) -> Column:
    """The first; of efforts one whose header names a torque or a force before a current."""
    ordered = sorted(columns, key=lambda c: kind == "effort" and (c.unit == "A", bool(c.why)))
    chosen = ordered[0]
    others = [c.name for c in ordered[1:]]
    words = [chosen.why] if chosen.why else []
    if others:
        words.append(f"or is it {', '.join(others[:3])}?")
    return replace(chosen, why="; ".join(words))


def _find_unit(name: str, units: Mapping[str, str]) -> str:
    """The unit in brackets or at the end of a name; "" where there is none."""
    brackets = ["".join(found) for found in re.findall(r"\[(.*?)\]|\((.*?)\)", name)]
    for inside in brackets:
        if unit := units.get(inside.strip().lower().replace("*", " "), ""):
            return unit
    parts = re.split(r"[_\s./]", re.sub(r"\[.*?\]|\(.*?\)", "", name).strip())
    last = parts[-1] if len(parts) > 1 else "" if units is UNITS else parts[-1]
    if len(last) == 1 and units is UNITS and last not in ("m", "A", "N", "°"):
        return ""
    return units.get(last.lower(), "")


# ---------------------------------------------------------------------------------------------- whose column it is


def _map_joint_names(joints: Sequence[Joint]) -> dict[str, tuple[str, ...]]:
    """By joint its name, and what is left of it without the words that all of them share."""
    words = [j.name for j in joints]
    before = _find_common_prefix(words)
    after = _find_common_prefix([w[::-1] for w in words])
    out: dict[str, tuple[str, ...]] = {}
    for word in words:
        cuts = (word[: len(word) - len(after)], word[len(before) : len(word) - len(after)]) if len(joints) > 1 else ()
        bare = [cut.strip("_-. /") for cut in cuts]
        out[word] = tuple(dict.fromkeys((word, *(b for b in bare if len(b) > SHORT and not b.isdigit()))))
    return out


def _find_common_prefix(words: Sequence[str]) -> str:
    """The beginning that all words share, up to the last mark between words."""
    length = 0
    while words and all(len(w) > length and w[length] == words[0][length] for w in words):
        length += 1
    begin = words[0][:length] if words else ""
    return begin[: max((begin.rfind(mark) for mark in "_-./"), default=-1) + 1]


def _make_word_pattern(word: str) -> re.Pattern[str]:
    loose = r"[_\s.-]?".join(re.escape(part) for part in re.split(r"[_\s.-]", word))
    edges = ("(?<![A-Za-z0-9])", "(?![A-Za-z0-9])") if len(word) <= SHORT else ("", "")
    before = edges[0] or (r"(?<!\d)" if word[0].isdigit() else "")
    behind = edges[1] or (r"(?!\d)" if word[-1].isdigit() else "")
    return re.compile(before + loose + behind, re.IGNORECASE)


def _find_column_joint(column: str, names: Mapping[str, tuple[str, ...]]) -> str:
    """The joint whose name is the longest in a column; "" where none is."""
    held = [
        (len(word), joint)
        for joint, words in names.items()
        for word in words
        if _make_word_pattern(word).search(column)
    ]
    return max(held)[1] if held else ""


def _remove_words(column: str, words: Iterable[str]) -> str:
    for word in words:
        column = _make_word_pattern(word).sub("", column)
    return column


def _split_columns(
    joints: Sequence[Joint], columns: Sequence[Column], owners: Mapping[str, str]
) -> dict[str, list[Column]]:
    """By joint its columns of one kind."""
    out: dict[str, list[Column]] = {}
    left = [c for c in columns if not owners[c.name]]
    for column in columns:
        if owners[column.name]:
            out.setdefault(owners[column.name], []).append(column)
    if numbered := _match_by_number(joints, left):
        for joint, own in numbered.items():
            out.setdefault(joint, own)
    elif not out and len(left) == len(joints):
        words = "by its place among the columns"
        out |= {
            j.name: [replace(c, why=c.why or words) if len(joints) > 1 else c]
            for j, c in zip(joints, left, strict=True)
        }
    return out


def _match_by_number(joints: Sequence[Joint], columns: Sequence[Column]) -> dict[str, list[Column]]:
    """By joint the columns whose number means it; nothing where numbers mean none."""
    numbers = _find_name_numbers([c.name for c in columns])
    own = [re.findall(r"\d+", j.name)[-1:] for j in joints]
    theirs = [int(one[0]) for one in own if one]
    seen = {n for n in numbers if n is not None}
    if len(set(theirs)) == len(joints) and seen <= set(theirs):
        called = dict(zip(theirs, joints, strict=True))
    elif 0 in seen and max(seen) < len(joints):
        called = dict(enumerate(joints))
    else:
        called = dict(enumerate(joints, 1))
    out: dict[str, list[Column]] = {}
    for number, column in zip(numbers, columns, strict=True):
        if number in called:
            out.setdefault(called[number].name, []).append(column)
    return out


def _find_name_numbers(names: Sequence[str]) -> list[int | None]:
    """Of each name the number that tells the names apart: the place among its numbers where the most differ."""
    every = [re.findall(r"\d+", name) for name in names]
    most = max((len(found) for found in every), default=0)
    if not most:
        return [None] * len(names)
    place = max(range(most), key=lambda k: (len({found[k] for found in every if len(found) > k}), -k))
    return [int(found[place]) if len(found) > place else None for found in every]
