"""Motions in tables of any length, read in parts: times, positions, rates and accelerations of a mechanism, in SI.

A part holds ``rows`` samples; memory is that of a few parts, whatever the length of the file.  Numbers are read as they stand;
what the digits of the file leave open is measured at its beginning (`MotionSource.digits`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexinv.errors import InputError
from flexinv.files.csv_dialect import (
    CsvDialect,
    Share,
    find_nearest_csv,
    read_csv_dialect,
    read_csv_head,
    read_csv_parts,
)
from flexinv.files.header_words import SLOW_SAMPLES, TIMES, find_header_unit, find_time_unit
from flexinv.files.motion_columns import (
    SENSES,
    MotionColumn,
    MotionColumns,
    check_held_joints,
    list_place_suffixes,
    make_header,
    match_motion_columns,
)
from flexinv.files.regular_files import MISSING, describe_kind
from flexinv.files.toml_tables import make_input_error
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array
from flexinv.validation import check_finite_array, check_number

if TYPE_CHECKING:
    import pandas as pd

HEAD = 1000  # rows at the beginning whose digits are looked at
TURNS = 4.0 * np.pi  # [rad]: an angle without a unit that reaches farther may be in degrees
PLAIN_NUMBER = re.compile(r"\s*[-+]?\d*(?:[.,](\d*))?(?:[eE]([-+]?\d+))?\s*")
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # [s]


@dataclass(frozen=True)
class MotionPart:
    """Consecutive samples of a motion.

    first : number of the first one, from 0; time : (samples,) [s], None where the motion has none
    positions : (samples, places) [rad], [m], [-], a continuous joint by one angle; rates, accelerations : (samples, nv), or None
    """

    first: int
    time: Array | None
    positions: Array
    rates: Array | None
    accelerations: Array | None

    def take(self, some: slice) -> MotionPart:
        """Return some of its samples [rad], [m], [s], those of a slice without a step."""
        time, rates, accelerations = (
            None if values is None else values[some] for values in (self.time, self.rates, self.accelerations)
        )
        first = self.first + some.indices(len(self.positions))[0]
        return MotionPart(first, time, self.positions[some], rates, accelerations)


def join_parts(parts: Sequence[MotionPart]) -> MotionPart:
    """Return consecutive parts of a motion as one [rad], [m], [s]."""
    positions = np.concatenate([one.positions for one in parts])
    time, rates, accelerations = (
        _join_series(series)
        for series in (
            [one.time for one in parts],
            [one.rates for one in parts],
            [one.accelerations for one in parts],
        )
    )
    return MotionPart(parts[0].first, time, positions, rates, accelerations)


def _join_series(series: Sequence[Array | None]) -> Array | None:
    known = [values for values in series if values is not None]
    return np.concatenate(known) if known else None


@dataclass(frozen=True)
class MotionSource:
    """A motion in a file or a table, not yet read; made by `open_motion`.

    columns : what they are; hold : by joint the position where it stands [rad], [m]; spacing : of samples without times [s]
    digits : by sense (columns,) what rounding has left of each number at least [rad], [m], [1/s]; time_digit : of times [s]
    """

    label: str
    mechanism: Mechanism
    source: Path | pd.DataFrame
    columns: MotionColumns
    hold: Mapping[str, Array]
    spacing: float | None
    time_factor: float
    digits: Mapping[str, Array]
    time_digit: float
    dialect: CsvDialect | None = field(default=None, repr=False)

    @property
    def timed(self) -> bool:
        """Return True if times are known [s]."""
        return self.columns.time is not None or self.spacing is not None

    def read_parts(self, rows: int, progress: Share | None = None) -> Iterator[MotionPart]:
        """Yield the samples in parts of ``rows`` [-]; progress : called with the part of the file that is read [-].

        Raises InputError: a row with too many or too few cells, a cell that is no finite number, an angle without a unit that is
        too large for one in rad.
        """
        first = 0
        for frame in self._read_frames(rows, progress):
            yield self._convert_part(frame, first)
            first += len(frame)
        if not first:
            raise make_input_error(self.label, "no rows of numbers", "one or more samples", make_header(self.mechanism))

    def _read_frames(self, rows: int, progress: Share | None) -> Iterator[pd.DataFrame]:
        if not isinstance(self.source, Path):
            for first in range(0, len(self.source), rows):
                yield self.source.iloc[first : first + rows]
                if progress is not None:
                    progress(min(first + rows, len(self.source)) / len(self.source))
            return
        assert self.dialect is not None
        yield from read_csv_parts(self.source, self.dialect, rows, progress)

    def _convert_part(self, frame: pd.DataFrame, first: int) -> MotionPart:
        c = self.columns
        time: Array | None = None
        if c.time is not None:
            time = self._read_columns(frame, [c.time[0]], first)[:, 0] * self.time_factor
        elif self.spacing is not None:
            time = self.spacing * np.arange(first, first + len(frame), dtype=np.float64)
        given = self._read_sense(frame, c.positions, first)
        self._check_far(given, first)
        positions = self._fill_places(given)
        rates, accelerations = (
            self._fill_held(self._read_sense(frame, sense_columns, first), sense_columns) if sense_columns else None
            for sense_columns in (c.rates, c.accelerations)
        )
        return MotionPart(first, time, positions, rates, accelerations)

    def _fill_places(self, given: Array) -> Array:
        """Positions of all coordinates (samples, places): given ones, held ones, neutral ones of joints without a column."""
        moving = self.mechanism.moving_joints
        widths = [len(list_place_suffixes(joint)) for joint in moving]
        if given.shape[1] == sum(widths):
            return given
        named = {column.joint for column in self.columns.positions}
        parts = []
        taken = 0
        for joint, width in zip(moving, widths, strict=True):
            if joint.name in named:
                parts.append(given[:, taken : taken + width])
                taken += width
                continue
            place = np.zeros(width)
            place[-1] = 1.0 if KINDS[joint.kind].has_quaternion else 0.0
            parts.append(np.tile(self.hold.get(joint.name, place), (len(given), 1)))
        return np.hstack(parts)

    def _read_sense(self, frame: pd.DataFrame, columns: Sequence[MotionColumn], first: int) -> Array:
        values = self._read_columns(frame, [column.place for column in columns], first)
        factors = np.array([column.factor for column in columns])
        return values if np.all(factors == 1.0) else values * factors

    def _read_columns(self, frame: pd.DataFrame, places: list[int], first: int) -> Array:
        """Columns of a table (samples, columns) as they stand; InputError names the first cell that is no finite number."""
        try:
            values = np.ascontiguousarray(frame.iloc[:, places].to_numpy(dtype=np.float64))
        except (TypeError, ValueError):
            values = np.full((len(frame), len(places)), np.nan)
            for k, place in enumerate(places):
                values[:, k] = [_convert_cell(cell) for cell in frame.iloc[:, place]]
        if not np.isfinite(values).all():
            row, k = (int(i) for i in np.argwhere(~np.isfinite(values))[0])
            name = str(frame.columns[places[k]]).strip()
            given = frame.iloc[row, places[k]]
            cell = repr(given.item() if isinstance(given, np.generic) else given)
            raise make_input_error(
                f"{self.label}: row {first + row + 1} of numbers, column {name}", cell[:40], "a finite number",
                "the number, or leave the row out",
            )  # fmt: skip
        return values

    def _fill_held(self, values: Array, columns: Sequence[MotionColumn]) -> Array:
        """Rates or accelerations of all coordinates (samples, nv): zero of joints that are held."""
        if len(columns) == self.mechanism.nv:
            return values
        out = np.zeros((len(values), self.mechanism.nv))
        names = list(self.mechanism.velocity_names)
        out[:, [names.index(column.coordinate) for column in columns]] = values
        return out

    def _check_far(self, given: Array, first: int) -> None:
        """Refuse an angle without a unit that may be one in degrees."""
        for k, column in enumerate(self.columns.positions):
            joint = self.mechanism.joint_of[column.joint]
            if column.stated or joint.kind != "revolute":
                continue
            far = float(np.abs(given[:, k]).max(initial=0.0))
            if far > TURNS:
                raise make_input_error(
                    f"{self.label}: column {column.name}, rows from {first + 1}", f"{far:.4g} without a unit",
                    f"angles of joint {column.joint} in rad, or their unit in the header",
                    f"{column.name} [deg], or {column.name} [rad]",
                )  # fmt: skip


def open_motion(
    source: str | Path | pd.DataFrame, mechanism: Mechanism, hold: Mapping[str, Any] | None = None,
    spacing: float | None = None,
) -> MotionSource:  # fmt: skip
    """Open a motion of a mechanism: a CSV file, or a table in memory with the same headers [rad], [m], [s].

    hold : joint -> where it stands [rad], [m]; spacing : of samples without a column of times [s]
    Raises InputError, one for all columns that do not fit, and for a file that cannot be read.
    """
    stated = dict(hold or {})
    check_held_joints(stated, mechanism)
    held = {name: _check_held(name, value, mechanism) for name, value in stated.items()}
    label = str(source) if isinstance(source, str | Path) else "motion"
    dialect = None
    if isinstance(source, str | Path):
        given: Path | pd.DataFrame = Path(source)
        dialect = _open_csv(Path(source), mechanism)
        header = [name.removeprefix("#").strip() for name in dialect.header]
        head = read_csv_head(Path(source), dialect, HEAD)
    else:
        given = _convert_table(source)
        header = [str(name) for name in given.columns]
        head = given.iloc[:HEAD]
    columns = match_motion_columns(header, mechanism, held, f"{label}: line 1" if dialect else label)
    text = dialect is not None
    factor, time_digit = _read_time_unit(head, columns, label, text)
    sense_columns = {"position": columns.positions, "rate": columns.rates, "acceleration": columns.accelerations}
    digits = {
        sense: np.array([c.factor * _find_digit(head, c.place, text) for c in sense_columns[sense]]) for sense in SENSES
    }
    step = _check_spacing(spacing, columns, label)
    return MotionSource(label, mechanism, given, columns, held, step, factor, digits, time_digit, dialect)


def _check_spacing(spacing: float | None, columns: MotionColumns, label: str) -> float | None:
    if spacing is None:
        return None
    step = check_number("spacing", spacing, "the time between samples [s]")
    if not 0.0 < step < np.inf:
        raise InputError(f"spacing = {step:g} s: expected the time between samples, above 0 [s]")
    if columns.time is not None:
        raise InputError(f"{label}: spacing = {step:g} s beside the column {columns.time[1]!r}; write one of the two")
    return step


def _open_csv(path: Path, mechanism: Mechanism) -> CsvDialect:
    """The dialect of a file with a header."""
    _check_motion_file(path)
    dialect = read_csv_dialect(path)
    if all(PLAIN_NUMBER.fullmatch(name) for name in dialect.header):
        given = f"numbers, {','.join(dialect.header)[:60]}" if any(dialect.header) else "an empty line"
        raise make_input_error(f"{path}: line 1", given, "the names of the columns", make_header(mechanism))
    return dialect


def _check_motion_file(path: Path) -> None:
    words = describe_kind(path)
    if not words and path.name.lower().endswith((".csv", ".csv.gz", ".txt")):
        return
    near = find_nearest_csv(path)
    if words:
        said = "there is no such file" if words == MISSING else words
        raise make_input_error(str(path), said, "a motion as a CSV file", near or "the name of a file that exists")
    raise make_input_error(
        str(path), f"a file {path.suffix or 'without suffix'}", "a motion as .csv or .csv.gz", "motion.csv"
    )


def _check_held(name: str, value: Any, mechanism: Mechanism) -> Array:
    joint = mechanism.joint_of[name]
    width = len(list_place_suffixes(joint))
    return check_finite_array(
        f"hold: joint {name!r}", np.atleast_1d(np.asarray(value)), (width,), KINDS[joint.kind].units[0]
    )


def _convert_table(source: Any) -> pd.DataFrame:
    """A table with its index as a column, where that has a name: as flexinv's own frames have times."""
    import pandas as pd

    if not isinstance(source, pd.DataFrame):
        raise InputError(f"motion: expected the path of a CSV file or a pandas.DataFrame, got {type(source).__name__}")
    return source.reset_index() if source.index.name is not None else source


def _convert_cell(cell: object) -> float:
    try:
        return float(cell)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return np.nan


def _find_digit(head: pd.DataFrame, place: int, text: bool) -> float:
    """The worth of one unit of the last digit in a column of texts, as it stands; 0 of numbers, which have all their digits.

    A file in the notation 1.234e-05 rounds each number to another unit: their mean square counts.  Numbers that all are floats of
    32 bits carry these.
    """
    cells = head.iloc[:, place]
    matches = [PLAIN_NUMBER.fullmatch(str(cell)) for cell in cells]
    if not matches or not all(matches):
        return 0.0
    units = np.array([10.0 ** (int(m[2] or 0) - len(m[1] or "")) for m in matches if m])
    scientific = all(m[2] for m in matches if m)
    unit = float(np.sqrt(np.mean(units**2)) if scientific else units.min()) if text else 0.0
    values = np.array([_convert_cell(str(cell).replace(",", ".")) for cell in cells])
    single = values.astype(np.float32)
    if np.all(single == values) and np.mean(values.astype(np.float16) != values) > 0.5:
        unit = max(unit, float(np.spacing(np.abs(single).max())))
    return unit


def _read_time_unit(head: pd.DataFrame, columns: MotionColumns, label: str, text: bool) -> tuple[float, float]:
    """The size of the unit of times [s], and of their last digit [s]."""
    if columns.time is None:
        return 1.0, 0.0
    place, name = columns.time
    times = np.array([_convert_cell(str(cell).replace(",", ".")) for cell in head.iloc[:, place]])
    steps = np.diff(times)
    usual = float(np.median(steps)) if len(steps) and np.isfinite(steps).all() else 0.0
    unit, _ = find_time_unit(name, usual)
    if not find_header_unit(name, TIMES, bare=True) and usual >= SLOW_SAMPLES:
        given = f"steps of {usual:g}, and no unit in the header"
        raise make_input_error(f"{label}: column {name}", given, "the unit of the times", f"{name} [s], or {name} [ms]")
    return SECONDS[unit], SECONDS[unit] * _find_digit(head, place, text)
