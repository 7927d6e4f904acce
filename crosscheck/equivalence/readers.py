"""Table of readers: what each engine's own reader makes of one file, against the reader that knows its format best."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NotRequired, TypedDict, TypeVar

from crosscheck.equivalence.compare import TOLERANCE, check_comparison_options, compare_descriptions
from crosscheck.equivalence.result import JUDGED, Comparison, ComparisonEntry
from crosscheck.equivalence.sources import describe, describe_pair, find_format, is_xml, list_readers
from crosscheck.lifting.usd import SUFFIXES as USD_SUFFIXES
from flexinv.errors import InputError

# By format the reader that the others are compared with: the format's own compiler, where there is one; else the first that
# reads the file.
T = TypeVar("T")
REFERENCE = {"urdf": "flexinv", "mjcf": "mujoco", "sdf": "drake"}


class ReaderEntry(TypedDict):
    """A row as JSON values."""

    reader: str
    joints: str
    mass: str
    result: str
    words: str
    dropped: list[str]
    comparison: NotRequired[ComparisonEntry]


@dataclass(frozen=True)
class ReaderRow:
    """One row: a reader, its moving joints, their mass [kg], and what differs from the first reader; words where it refuses.

    dropped : what the reader leaves out or takes for granted, a line each
    """

    reader: str
    joints: str
    mass: str
    result: str
    refusal: str
    comparison: Comparison | None = None
    dropped: tuple[str, ...] = ()

    @property
    def plain(self) -> ReaderEntry:
        """Return the row as JSON values."""
        entry: ReaderEntry = {
            "reader": self.reader,
            "joints": self.joints,
            "mass": self.mass,
            "result": self.result,
            "words": self.refusal,
            "dropped": list(self.dropped),
        }
        if self.comparison is not None:
            entry["comparison"] = self.comparison.plain
        return entry


@dataclass(frozen=True)
class ComparisonSettings:
    """Settings of a comparison of readers: tolerance of efforts relative to their range [-], families that count, strictness.

    ignored : names of features that are left out; unproven : none needs to be held against a reader's own model
    """

    tolerance: float = TOLERANCE
    families: tuple[str, ...] = JUDGED
    strict: bool = False
    ignored: tuple[str, ...] = ()
    unproven: bool = False


def run_function_here(function: Callable[..., T], file: str, *arguments: Any) -> T:
    """Return the answer of a function to a file, called in this process."""
    return function(file, *arguments)


def compare_readers(
    file: str,
    target: str = "all",
    measure: ComparisonSettings | None = None,
    way: Callable[..., Any] = run_function_here,
) -> list[ReaderRow]:
    """Return a row for every reader of a file, first that which the others are held against; what one refuses is in its row.

    target : "all", or engines by comma; way : to call a function for a file, such as in a process of its own
    Raises InputError for a file that nobody has a reader for.
    """
    measure = measure or ComparisonSettings()
    check_comparison_options(measure.tolerance, measure.families)
    kind, known = way(_find_format_and_readers, file)
    names = known if target == "all" else [name.strip() for name in target.split(",") if name.strip()]
    if not names and target != "all":
        raise InputError(
            f"--readers {target!r}: expected 'all', or engines by comma; here {', '.join(known)} read {kind.upper()}"
        )
    first = _find_reference_reader(file, list(dict.fromkeys([*_list_preferred_readers(kind, known), *known])), way)
    return [
        _compare_reader_safely(file, first, name, measure, way) for name in (first, *(n for n in names if n != first))
    ]


def _find_format_and_readers(file: str) -> tuple[str, list[str]]:
    """The format of a file, and the engines that have a reader of their own for it.  Raises InputError where there is none."""
    path = Path(file)
    if not path.is_file():
        describe(file)  # says what is wrong
    if path.is_dir() or not (is_xml(path) or path.suffix.lower() in USD_SUFFIXES):
        raise InputError(
            f"{path}: no engine has a reader of its own for it; expected a URDF, MJCF, SDF or USD for --readers"
        )
    kind = find_format(path)
    known = list_readers(kind)
    if not (known or REFERENCE.get(kind)):
        describe(file)  # says which reader to install, or reads it by the only one, which is no engine's
        raise InputError(
            f"{path}: {kind.upper()} has one reader here, which is no engine's; there is nothing to compare it with"
        )
    return kind, known


def _list_preferred_readers(kind: str, known: list[str]) -> list[str]:
    """The reader that knows a format best, if it is there; flexinv's own always is."""
    best = REFERENCE.get(kind)
    return [best] if best == "flexinv" or best in known else []


def _find_reference_reader(file: str, names: list[str], way: Callable[..., Any]) -> str:
    """The first reader that reads the file; the first of all where none does."""
    for name in names:
        with contextlib.suppress(InputError):
            if not way(_describe_refusal, file, name):
                return name
    return names[0]


def _compare_reader_safely(
    file: str, first: str, name: str, measure: ComparisonSettings, way: Callable[..., Any]
) -> ReaderRow:
    """The row of a reader; one that dies or comes to no end is its row alone."""
    try:
        row: ReaderRow = way(_compare_reader, file, first, name, measure)
    except InputError as error:
        return ReaderRow(name, "", "", "cannot", " ".join(str(error).split()))
    return row


def _describe_refusal(file: str, name: str) -> str:
    """The reason of a reader for not reading a file, "" where it does; any exception is its own."""
    try:
        describe(f"{file}@{name}")
    except InputError as error:
        return " ".join(str(error).split())
    except Exception as error:
        return f"{file}: the reader {name} fails: {type(error).__name__}: {' '.join(str(error).split())}"
    return ""


def _compare_reader(file: str, first: str, name: str, measure: ComparisonSettings) -> ReaderRow:
    if refusal := _describe_refusal(file, name):
        return ReaderRow(name, "", "", "cannot", refusal)
    try:
        one, two = describe_pair(f"{file}@{first}", f"{file}@{name}")
        found = compare_descriptions(one, two, measure.tolerance, {}, measure.ignored)
    except InputError as error:
        return ReaderRow(name, "", "", "cannot", " ".join(str(error).split()))
    found = replace(found, families=measure.families, strict=measure.strict, unproven=measure.unproven)
    moving = [joint for joint in two.mechanism.joints if joint.nv]
    mass = sum(body.inertia.mass for link in two.mechanism.links for body in link.bodies)
    told = [*found.doubts, *(d.words for d in found.differences[:6])]
    words = "; ".join(told) or "; ".join(found.notes[:2])
    return ReaderRow(name, str(len(moving)), f"{mass:.6g}", found.state, words, found, two.dropped)
