"""Words of a table's header: which of them is the time, a unit, the name or the number of a joint.

A column belongs to the joint whose name stands in it, as a whole or without the words that all joints share; else to the one
that its number means, counted from 1 or from 0.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

from flexinv.model.joints import Joint

# How headers write times -> the unit.
TIMES = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "ms": "ms", "msec": "ms", "millis": "ms",
    "milliseconds": "ms", "us": "us", "µs": "us", "μs": "us", "usec": "us", "micros": "us", "microseconds": "us", "ns": "ns",
    "nsec": "ns", "nanos": "ns", "nanoseconds": "ns",
}  # fmt: skip
# How headers write units of efforts -> the unit.
EFFORT_UNITS = {
    "nm": "N m", "n m": "N m", "n·m": "N m", "n.m": "N m", "n-m": "N m", "n": "N", "a": "A", "amp": "A", "amps": "A",
    "ampere": "A", "mnm": "mN m",
}  # fmt: skip
TIME_WORDS = re.compile(
    r"^(t|time|timestamp|stamp|clock|tick)(?![a-z0-9])(?!_\d)|^time|[_ .](time|stamp)$|^(milli|micro|nano)s"
    r"|^(zeit|temps|tiempo|時間|時刻|时间)",
    re.IGNORECASE,
)
SLOW_SAMPLES = 0.5  # [s]: no motion of a machine is seen in samples that are farther apart
SHORT_NAME = 3  # letters: names as short as that stand in words that mean something else


def find_time_column(names: Sequence[str]) -> str:
    """Return the column that looks like times [s]; "time_s" where none does, which the reader of logs then misses in words."""
    like = [name for name in names if name == "time_s"] or [name for name in names if TIME_WORDS.search(name)]
    return like[0] if like else "time_s"


def find_time_unit(name: str, spacing: float) -> tuple[str, str]:
    """Return the unit of a column of times [-], and a doubt in words; spacing : of its samples as written [that unit]."""
    if unit := find_header_unit(name, TIMES, bare=True):
        return unit, ""
    if spacing < SLOW_SAMPLES:
        return "s", ""
    unit = next((one for one, factor in (("ms", 1e-3), ("us", 1e-6)) if spacing * factor < SLOW_SAMPLES), "ns")
    return unit, f"the header names no unit, and steps of {spacing:g} s would be slow: is it {unit}?"


def find_header_unit(name: str, units: Mapping[str, str], bare: bool = False) -> str:
    """Return the unit in brackets or at the end of a name [-], "" where there is none.

    units : how headers write them -> the unit; bare : the name may be nothing but a unit, as times are
    """
    brackets = ["".join(found) for found in re.findall(r"\[(.*?)\]|\((.*?)\)", name)]
    for inside in brackets:
        if unit := units.get(inside.strip().lower().replace("*", " "), ""):
            return unit
    parts = re.split(r"[_\s./]", re.sub(r"\[.*?\]|\(.*?\)", "", name).strip())
    last = parts[-1] if len(parts) > 1 or bare else ""
    if len(last) == 1 and not bare and last not in ("m", "A", "N", "V", "W", "°"):
        return ""
    return units.get(last.lower(), "")


def map_joint_names(joints: Sequence[Joint]) -> dict[str, tuple[str, ...]]:
    """Return by joint its name, and what is left of it without the words that all of them share [-]."""
    words = [j.name for j in joints]
    before = _find_common_prefix(words)
    after = _find_common_prefix([w[::-1] for w in words])
    out: dict[str, tuple[str, ...]] = {}
    for word in words:
        cuts = (word[: len(word) - len(after)], word[len(before) : len(word) - len(after)]) if len(joints) > 1 else ()
        bare = [cut.strip("_-. /") for cut in cuts]
        out[word] = tuple(dict.fromkeys((word, *(b for b in bare if len(b) > SHORT_NAME and not b.isdigit()))))
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
    edges = ("(?<![A-Za-z0-9])", "(?![A-Za-z0-9])") if len(word) <= SHORT_NAME else ("", "")
    before = edges[0] or (r"(?<!\d)" if word[0].isdigit() else "")
    behind = edges[1] or (r"(?!\d)" if word[-1].isdigit() else "")
    return re.compile(before + loose + behind, re.IGNORECASE)


def find_column_joint(column: str, names: Mapping[str, tuple[str, ...]]) -> str:
    """Return the joint whose name is the longest in a column [-]; "" where none is."""
    held = [
        (len(word), joint)
        for joint, words in names.items()
        for word in words
        if _make_word_pattern(word).search(column)
    ]
    return max(held)[1] if held else ""


def remove_words(column: str, words: Iterable[str]) -> str:
    """Return the name of a column without words in it [-], however they are joined."""
    for word in words:
        column = _make_word_pattern(word).sub("", column)
    return column


def match_by_number(joints: Sequence[Joint], columns: Sequence[str]) -> dict[str, list[str]]:
    """Return by joint the columns whose number means it [-]; nothing where numbers mean none."""
    numbers = _find_name_numbers(columns)
    digit_groups = [re.findall(r"\d+", j.name)[-1:] for j in joints]
    theirs = [int(one[0]) for one in digit_groups if one]
    seen = {n for n in numbers if n is not None}
    if len(set(theirs)) == len(joints) and seen <= set(theirs):
        called = dict(zip(theirs, joints, strict=True))
    elif 0 in seen and max(seen) < len(joints):
        called = dict(enumerate(joints))
    else:
        called = dict(enumerate(joints, 1))
    out: dict[str, list[str]] = {}
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
