"""Series as CSV, for programs of any language: ``time [s],torque/hub [N m],torque/hub error [N m]``.

The first column is the time; then one column per series, its name and its unit in brackets, and for each perhaps the half-width
of its error bar, called ``NAME error``.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from crosscheck.measures.record import RESULTANTS, WRENCH, WRENCH_UNITS, XYZ, Series, list_effort_units, series
from flexinv.errors import InputError
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array
from flexinv.validation import find_nearest_word

HEADER = re.compile(r"(?P<name>[^\s\[\]]+)(?P<bar> error)? \[(?P<unit>[^\[\]]+)\]")
TIME = "time [s]"
LONGEST = 100  # [characters] of a name or a cell that a message repeats
LARGEST = 1 << 28  # [bytes]: a hundred series of a hundred thousand samples
# Of the time from sample to sample: a signal changes by no more than this part of what it changes from one to the next,
# and a grid that is written with the digits of its spacing has its times to rounding.
SAME_TIME = 1e-3
ANY = re.compile(r"^(internal/[^/]+)/[^/]+/")  # of an internal force the station is the writer's choice
STATION = "STATION"  # stands for any in the names that are known: internal/BEAM/STATION/bending_y


def read(path: Path) -> tuple[Array, dict[str, Series]]:
    """Read times [s] and series with their error bars, by name.  Raises InputError that names the column or the row."""
    rows = _read_cells(path)
    header = [cell.strip() for cell in rows[0]] if rows else []
    heads = _parse_header(path, header)
    table = _read_numbers(path, header, rows[1:])
    columns = {(name, bar): (unit, table[:, k]) for k, (name, bar, unit) in enumerate(heads) if k}
    found: dict[str, Series] = {}
    for (name, bar), (unit, values) in columns.items():
        if bar is None:
            found |= series(name, unit, values, columns.get((name, " error"), (unit, None))[1])
        elif (name, None) not in columns:
            raise InputError(f"{path}: column '{name} error [{unit}]' has no column '{name} [{unit}]' beside it")
        elif columns[name, None][0] != unit:
            raise InputError(f"{path}: column '{name} error [{unit}]' expected [{columns[name, None][0]}]")
    return table[:, 0], found


def _parse_header(path: Path, header: list[str]) -> list[tuple[str, str | None, str]]:
    """Return name, " error" or None, and unit of every column.  Raises InputError for what is none, or is there twice."""
    if not header or header[0] != TIME:
        seen = f"the first column is {_format_quoted(header[0])}" if header else "there is no header"
        commas = "; write commas between the columns" if header and re.search(r"[;\t]", header[0]) else ""
        raise InputError(f"{path}: {seen}, expected {TIME!r}{commas}")
    heads: list[tuple[str, str | None, str]] = []
    for cell in header:
        match = HEADER.fullmatch(cell)
        if match is None:
            raise InputError(
                f"{path}: column {_format_quoted(cell)}: expected a series and its unit; write 'torque/hub [N m]'"
            )
        heads.append((match["name"], match["bar"], match["unit"]))
    names = Counter((name, bar) for name, bar, _ in heads)
    if twice := [name + (bar or "") for (name, bar), count in names.items() if count > 1]:
        raise InputError(f"{path}: column {_format_quoted(twice[0])} is there twice; expected each once")
    return heads


def _read_cells(path: Path) -> list[list[str]]:
    try:
        if (size := path.stat().st_size) > LARGEST:
            raise InputError(f"{path} has {size / 1e6:.0f} MB, expected at most {LARGEST / 1e6:.0f} MB")
        with path.open(encoding="utf-8-sig", newline="") as stream:  # spreadsheets begin a file with a mark
            return list(csv.reader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path} cannot be read: {error}") from error


def _read_numbers(path: Path, header: list[str], rows: list[list[str]]) -> Array:
    """Return the numbers of a table (rows, columns) [unit of each]; the first row without as many cells is named."""
    rows = [row for row in rows if row]  # an empty line at the end is none
    for k, row in enumerate(rows):
        if len(row) != len(header):
            raise InputError(f"{path}: row {k + 2} has {len(row)} cells, the header {len(header)}")
    try:
        if all(_is_plain(cell) for row in rows for cell in row):
            return np.array(rows, dtype=np.float64).reshape(len(rows), len(header))
    except ValueError:
        pass
    k, one, cell = next(wrong for wrong in _list_text_cells(header, rows))
    raise InputError(f"{path}: row {k}, column {_format_quoted(one)}: {_format_quoted(cell)} is no number")


def _is_plain(cell: str) -> bool:
    """Return False for what Python alone takes for a number: 1_000, and digits of other scripts."""
    return cell.isascii() and "_" not in cell


def _format_quoted(text: str) -> str:
    """A text in quotes, cut where it is long."""
    return repr(text if len(text) <= LONGEST else f"{text[:LONGEST]}...")


def _list_text_cells(header: list[str], rows: list[list[str]]) -> Iterator[tuple[int, str, str]]:
    """Yield row, column and text of each cell that is no number."""
    for k, row in enumerate(rows):
        for one, cell in zip(header, row, strict=True):
            try:
                np.array([cell], dtype=np.float64)
            except ValueError:
                yield k + 2, one, cell
                continue
            if not _is_plain(cell):
                yield k + 2, one, cell


def check_times(path: Path, time: Array, wanted: Array, sample: float) -> None:
    """Raise InputError unless the times [s] of a file are those of the case, up to the digits of a number."""
    given = f"0 to {wanted[-1]:g} s every {sample:g} s"
    if time.shape != wanted.shape:
        raise InputError(f"{path}: column {TIME} has {time.size} times, not the {wanted.size} of the case, {given}")
    off = np.abs(time - wanted)
    if not off.max() <= SAME_TIME * sample:
        k = int(np.flatnonzero(~(off <= SAME_TIME * sample))[0])
        raise InputError(
            f"{path}: column {TIME}, row {k + 2}: {time[k]:.9g} s, where the case has {wanted[k]:.9g} s ({given}); "
            "give sample_s and end_s of the record, or interpolate the record to these times (and write enough digits)"
        )


def check_names(path: Path, known: Mapping[str, str], series: Iterable[Series]) -> None:
    """Raise InputError where a column is called as nothing of the mechanism is, or is in another unit.

    known : name -> unit of all that there may be: what is called otherwise would be compared with nothing
    """
    for one in series:
        plain = ANY.sub(rf"\1/{STATION}/", one.name)
        if plain not in known:
            near = find_nearest_word(one.name, sorted(known))
            raise InputError(
                f"{path}: column {_format_quoted(one.name)}: the mechanism has no such series; "
                + (f"write {near!r}" if near else f"it has {', '.join(sorted(known))}")
            )
        if one.unit != known[plain]:
            raise InputError(f"{path}: column {one.name!r} is in {one.unit}, expected {known[plain]}")


def write(path: Path, time: Array, series: Iterable[Series]) -> None:
    """Write times [s] and series with their error bars, every number with all its digits.  Raises OSError."""
    header = [TIME]
    columns = [time]
    for one in series:
        header.append(f"{one.name} [{one.unit}]")
        columns.append(one.values)
        if one.error is not None:
            header.append(f"{one.name} error [{one.unit}]")
            columns.append(one.error)
    write_table(path, header, np.stack(columns, axis=1))


def write_table(path: Path, header: Iterable[str], values: Array) -> None:
    """Write a table (rows, columns) [unit of each column] below its header, numbers as the shortest text that gives them back."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        lines = csv.writer(stream, lineterminator="\n")
        lines.writerow(header)
        lines.writerows([[repr(x) for x in row] for row in np.asarray(values, dtype=np.float64).tolist()])


def list_all_series(mechanism: Mechanism) -> dict[str, str]:
    """Return names and units of all series that a record of a mechanism may have; STATION stands for any in internal ones."""
    beams = [link.name for link in mechanism.beams]
    sections = [f"{beam}/{STATION}" for beam in beams]
    wrench = dict(zip(WRENCH, WRENCH_UNITS, strict=True))
    place = dict.fromkeys(XYZ, "m")
    efforts = zip(mechanism.velocity_names, list_effort_units(mechanism), strict=True)
    return {
        **{f"torque/{name}": unit for name, unit in efforts},
        **_list_part_units("wrench", [joint.name for joint in mechanism.joints], wrench),
        **_list_part_units("reaction", [closure.name for closure in mechanism.closures], wrench),
        **_list_part_units("tip", [link.name for link in mechanism.links], place),
        **_list_part_units("deflection", beams, place),
        **{f"axial/{beam}": "N" for beam in beams},
        **_list_part_units("internal", sections, dict(zip(RESULTANTS, WRENCH_UNITS, strict=True))),
    }


def _list_part_units(quantity: str, owners: list[str], parts: dict[str, str]) -> dict[str, str]:
    return {f"{quantity}/{owner}/{part}": unit for owner in owners for part, unit in parts.items()}
