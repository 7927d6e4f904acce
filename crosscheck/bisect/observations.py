"""Observations: what a script gave in one environment, by its exit code, by what it printed, or by a CSV that it wrote."""

from __future__ import annotations

import csv
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

import numpy as np

from crosscheck.bisect.script import ScriptEnd, find_last_words
from flexinv.typing import Array

NUMBER = r"[-+]?(?:\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?|nan|inf)"
LAST = "last"  # word of --number for the last number that is printed
LARGEST_TABLE = 1 << 26  # [bytes]


@dataclass(frozen=True)
class Reading:
    """Reading of a script: a number behind a word that it prints, or a CSV that it writes; neither: its exit code."""

    number: str = ""
    table: str = ""


class ObservationEntry(TypedDict):
    """An observation as JSON values; table : a list for each column."""

    reason: str
    code: int
    number: float | None
    names: list[str]
    table: list[list[float]]
    digest: str
    printed: str
    wall: float
    processor: float


@dataclass(frozen=True)
class Observation:
    """One run of a script: reason (why it cannot run, or ""), exit code, number, table, digest of what it printed and wrote.

    names : of the columns of numbers; table : (rows, columns); wall, processor : [s]; printed : the end of it
    """

    reason: str
    code: int
    number: float | None
    names: tuple[str, ...]
    table: Array
    digest: str
    printed: str
    wall: float
    processor: float

    @property
    def last_words(self) -> str:
        """The words that were printed last, to where errors are, else to where output is."""
        return find_last_words(self.printed)

    @property
    def plain(self) -> ObservationEntry:
        """Return the observation as JSON values."""
        return {
            "reason": self.reason,
            "code": self.code,
            "number": self.number,
            "names": list(self.names),
            "table": self.table.T.tolist(),
            "digest": self.digest,
            "printed": self.printed,
            "wall": self.wall,
            "processor": self.processor,
        }


def read_entry(entry: ObservationEntry) -> Observation:
    """Return the observation of its JSON values."""
    table = np.array(entry["table"], dtype=np.float64).T
    return Observation(**{**entry, "names": tuple(entry["names"]), "table": table})  # type: ignore[arg-type]


def make_failed_observation(reason: str) -> Observation:
    """Return the observation of a release that could not be tried at all."""
    return Observation(reason, 0, None, (), np.zeros((0, 0)), "", "", 0.0, 0.0)


def read_observation(end: ScriptEnd, folder: Path, reading: Reading) -> Observation:
    """Return the observation of a script; a number or a table that was asked for and is not there says that it cannot run."""
    reason = end.reason
    number = None
    names: tuple[str, ...] = ()
    table = np.zeros((0, 0))
    written = b""
    if not reason and reading.number:
        number = find_number(end.out, reading.number)
        wanted = "a number" if reading.number == LAST else f"a number behind {reading.number!r}"
        reason = "" if number is not None else _describe_missing(f"it printed no line with {wanted}", end)
    if not reason and reading.table:
        try:
            written = _read_table_file(folder, reading.table)
            names, table = parse_table(written.decode("utf-8-sig"))
        except (OSError, ValueError, csv.Error) as error:
            reason = _describe_missing(f"{reading.table}: {error}", end)
    digest = hashlib.sha256(repr((end.code, end.out)).encode() + written).hexdigest()
    printed = end.out + end.errors
    return Observation(reason, end.code, number, names, table, digest, printed[-4000:], end.wall, end.processor)


def _describe_missing(words: str, end: ScriptEnd) -> str:
    """Return the reason why a script gave nothing to read, with its exit code and last line where it failed."""
    last = find_last_words(end.errors)
    return words if end.code == 0 else f"{words}; exit code {end.code}{f': {last}' if last else ''}"


def find_number(printed: str, word: str) -> float | None:
    """Return the last number [any unit] behind a word, or of all for the word ``last``; None where there is none.

    Between word and number blanks, one of = and :, and a unit in brackets may stand.
    """
    before = "" if word == LAST else rf"{re.escape(word)}\s*(?:\[[^\]]*\]\s*)?[=:]?\s*"
    found = re.findall(rf"(?<![\w.]){before}({NUMBER})(?![\w.])", printed, flags=re.IGNORECASE if word == LAST else 0)
    return float(found[-1]) if found else None


def _read_table_file(folder: Path, name: str) -> bytes:
    """Return the bytes of a table.  Raises OSError where it is not there or leads elsewhere, ValueError where it is too large."""
    file = (folder / name).resolve()
    if not file.is_relative_to(folder.resolve()):
        raise OSError("expected a file in the script's own folder")
    if not file.is_file():
        raise OSError("it was not written")
    if file.stat().st_size > LARGEST_TABLE:
        raise ValueError(f"it has {file.stat().st_size / 1e6:.0f} MB, expected at most {LARGEST_TABLE / 1e6:.0f} MB")
    return file.read_bytes()


def parse_table(text: str) -> tuple[tuple[str, ...], Array]:
    """Return names and values (rows, columns) [any unit] of the columns of numbers.  Raises ValueError where there is none."""
    rows = [row for row in csv.reader(text.splitlines()) if row]
    if len(rows) < 2:
        raise ValueError("expected a line of names and at least one of numbers")
    head = rows[0]
    columns = {k: _convert_column([row[k] if k < len(row) else "" for row in rows[1:]]) for k in range(len(head))}
    numbers = {head[k].strip(): values for k, values in columns.items() if values is not None}
    if not numbers:
        raise ValueError("no column holds numbers alone")
    return tuple(numbers), np.column_stack(list(numbers.values()))


def _convert_column(cells: Sequence[str]) -> Array | None:
    """Return the cells of a column as numbers (rows,) [any unit]; None where one is none."""
    try:
        return np.array([float(cell) for cell in cells])
    except ValueError:
        return None
