"""Logs of machines: columns with times, read from CSV, Parquet or MAT files, and refused in words where they cannot be used."""

from __future__ import annotations

import gzip
import re
import warnings
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.identification.logs.bag import SUFFIXES, is_bag, read_bag_columns
from crosscheck.identification.logs.even_times import GAP, take_even_times
from crosscheck.identification.settings import TIMES
from flexinv.errors import InputError
from flexinv.files.csv_dialect import make_exact_options, read_csv_dialect
from flexinv.files.regular_files import MISSING, describe_kind
from flexinv.files.toml_tables import LONGEST_PATH
from flexinv.typing import Array
from flexinv.validation import find_nearest_word

LARGEST_FILE = 1 << 30  # [byte]
MOST_SAMPLES = 10_000_000  # what a packed file may swell to: three hours at 1 kHz
# Times are written with few decimals: their steps are even to a tenth.
EVEN = 0.1
PAUSE = 1.5  # times the usual step: a sample is missing
LARGEST_NUMBER = 1e30  # of any unit: the square of what no sensor measures still is a number


@dataclass(frozen=True)
class Log:
    """Samples of a machine at work, equally spaced.

    time : (samples,) [s]; columns : name -> (samples,) in the unit that identify.toml gives
    notes : what was done to the samples as they were written, in words
    pauses : (pauses, 2) [s] between which samples are missing, where the log was taken at even steps
    day : logs of one day have the same friction and offsets: of a log that was read its file, else "" and its name counts
    """

    name: str
    time: Array
    columns: dict[str, Array]
    notes: tuple[str, ...] = ()
    pauses: Array = field(default_factory=lambda: np.zeros((0, 2)))
    day: str = ""

    @property
    def spacing(self) -> float:
        """Time between samples [s]."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    def read_column(self, name: str) -> Array:
        """Return a column (samples,) [unit of identify.toml].  Raises InputError: none there, gaps, numbers too large."""
        if name not in self.columns:
            near = find_nearest_word(name, list(self.columns))
            raise InputError(
                f"{self.name}: no column {name!r}; it has {', '.join(list(self.columns)[:40])}; "
                f"write {near or 'one of these'} in identify.toml, or export that column"
            )
        values = self.columns[name]
        if bad := np.flatnonzero(~np.isfinite(values)).tolist():
            raise InputError(
                f"{self.name}: column {name!r} has no number at {self.time[bad[0]]:g} s ({len(bad)} of {len(values)} samples); "
                "fill the gap, or cut the log there"
            )
        if far := np.flatnonzero(np.abs(values) > LARGEST_NUMBER).tolist():
            raise InputError(
                f"{self.name}: column {name!r} is {values[far[0]]:g} at {self.time[far[0]]:g} s ({len(far)} of {len(values)} "
                f"samples), expected what a sensor measured, below {LARGEST_NUMBER:g}; mend the samples, or cut the log there"
            )
        return values

    def take_interval(self, start: float, end: float) -> Log:
        """Return the samples of [start, end) [s].  Raises InputError: fewer than 20 of them."""
        chosen = (self.time >= start - 1e-9) & (self.time < end - 1e-9)
        if chosen.sum() < 20:
            raise InputError(
                f"{self.name}: {start:g} to {end:g} s holds {int(chosen.sum())} samples, expected 20 or more; "
                f"the log goes from {self.time[0]:g} to {self.time[-1]:g} s"
            )
        columns = {k: v[chosen] for k, v in self.columns.items()}
        return Log(f"{self.name}[{start:g}:{end:g}]", self.time[chosen], columns, self.notes, self.pauses, self.day)


def read_log(source: str | Path, time: str = "time_s", unit: str = "s") -> Log:
    """Read a log [s]; ``source`` may end in ``@START:END``, which takes these seconds of it.

    time, unit : name of the column of times, and their unit: "s", "ms", "us" or "ns"
    Raises InputError: no such file, unknown format, columns missing or doubled, times that jump or run backwards.
    """
    text, _, part = str(source).partition("@")
    path = Path(text)
    _check_there(path)
    columns = _read_columns(path, time)
    if time not in columns:
        raise InputError(
            f"{path.name}: no column {time!r} of times [s]; it has {', '.join(list(columns)[:40])}; "
            'write time = "NAME" into identify.toml'
        )
    log = take_even_steps(Log(path.name, columns.pop(time) * TIMES[unit], columns, day=str(path.resolve())))
    if not part:
        return log
    try:
        start, end = (float(x) for x in part.split(":"))
    except ValueError as error:
        raise InputError(f"log {source}: @{part}, expected @START:END in seconds; write {text}@0:5") from error
    return log.take_interval(start, end)


def read_columns(source: str | Path) -> dict[str, Array]:
    """Return all columns of a log as they are written [any unit].  Raises InputError: no such file, unknown format."""
    path = Path(str(source).partition("@")[0])
    _check_there(path)
    return _read_columns(path, "time_s")


def _check_there(path: Path) -> None:
    words = describe_kind(path)
    if words and not (path.is_dir() and is_bag(path)):
        kinds = ".csv, .csv.gz, .parquet or .mat file, or of a bag of ROS"
        said = "there is no such file" if words == MISSING else f"it is {words}"
        raise InputError(f"log {str(path)[:LONGEST_PATH]}: {said}; write the path of a {kinds}")
    if not words and (size := path.stat().st_size) > LARGEST_FILE:
        advice = "cut it into logs of their own, or leave out columns"
        raise InputError(f"log {path}: {size} bytes, expected at most {LARGEST_FILE}; {advice}")


def _read_columns(path: Path, time: str) -> dict[str, Array]:
    if is_bag(path):
        return read_bag_columns(path, time)
    name = path.name.lower()
    if name.endswith((".csv", ".csv.gz")):
        return _convert_data_frame(path, _read_csv(path))
    if name.endswith(".parquet"):
        import pandas as pd

        try:
            frame = pd.read_parquet(path)
        except ImportError as error:
            raise InputError(f"{path.name}: Parquet needs pyarrow; write pip install pyarrow, or export CSV") from error
        except Exception as error:  # pyarrow raises whatever the damage of a file leads to
            words = " ".join(str(error).split())[:200]
            raise InputError(
                f"{path.name}: no Parquet that can be read ({words}); save it anew, or export CSV"
            ) from error
        return _convert_data_frame(path, frame)
    if name.endswith(".mat"):
        return _read_mat(path)
    raise InputError(
        f"{path.name}: format unknown; write .csv, .csv.gz, .parquet, .mat or a bag of ROS ({', '.join(SUFFIXES)})"
    )


def _read_csv(path: Path) -> Any:
    """The table of a CSV file in any dialect."""
    import pandas as pd

    dialect = read_csv_dialect(path)
    if not any(dialect.header):
        raise InputError(f"{path.name}: its first line is empty, expected the names of columns; export the log anew")
    options = {"sep": dialect.mark, "decimal": dialect.decimal, "encoding": "utf-8-sig", "skipinitialspace": True}
    options |= make_exact_options()
    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)
        try:
            frame = pd.read_csv(
                path, names=list(dialect.header), skiprows=1, nrows=MOST_SAMPLES + 1, index_col=False, **options
            )
        except (ValueError, OSError, EOFError, zlib.error, pd.errors.ParserWarning) as error:
            raise InputError(f"{path.name}: {_describe_csv_error(error, len(dialect.header))}") from error
    if len(frame) > MOST_SAMPLES:
        advice = "cut it into logs of their own, or take every tenth sample"
        raise InputError(f"{path.name}: more than {MOST_SAMPLES} samples; {advice}")
    return frame


def _describe_csv_error(error: Exception, count: int) -> str:
    """Words about a table of ``count`` columns that pandas refuses."""
    words = " ".join(str(error).split())[:200]
    if ragged := re.search(r"Expected \d+ fields in line (\d+), saw (\d+)", words):
        line, cells = ragged.groups()
        return f"line {line} has {cells} cells, expected {count} as the first line; mend or remove that line"
    if "Length of header" in words:
        return f"lines have more cells than the first line names columns ({count}); write a name for each column"
    if isinstance(error, EOFError | zlib.error | gzip.BadGzipFile):
        return f"the packed file is damaged or ends too early ({words}); copy it again, or pack it anew"
    return f"no CSV that can be read ({words}); save it anew as UTF-8"


def _convert_data_frame(path: Path, frame: Any) -> dict[str, Array]:
    import pandas as pd

    out: dict[str, Array] = {}
    for name in frame.columns:
        try:
            out[str(name)] = frame[name].to_numpy(dtype=np.float64)
        except (TypeError, ValueError):
            words = str(frame[name].iloc[0])
            if name == frame.columns[0] or not words:
                raise InputError(
                    f"{path.name}: column {name!r} holds words such as {words!r}, expected numbers"
                ) from None
            numbers = pd.to_numeric(frame[name], errors="coerce").to_numpy(dtype=np.float64)
            if np.isfinite(numbers).any():  # a word among numbers is a gap, and a column of words no signal
                out[str(name)] = numbers
    return out


def _read_mat(path: Path) -> dict[str, Array]:
    """Return the vectors of the longest common length; the columns of a matrix NAME are NAME_1, NAME_2 ... ."""
    numbers = _read_mat_arrays(path)
    count = max(max(v.shape) for v in numbers.values())
    out: dict[str, Array] = {}
    for name, values in numbers.items():
        if values.ndim == 1 and len(values) == count:
            out[name] = values
        elif values.ndim == 2 and count in values.shape:
            rows = values if values.shape[0] == count else values.T
            out |= {f"{name}_{k + 1}": np.ascontiguousarray(column) for k, column in enumerate(rows.T)}
    return out


def _read_mat_arrays(path: Path) -> dict[str, Array]:
    """Return all arrays of several numbers; raises InputError where there are none."""
    from scipy.io import loadmat

    try:
        raw = {k: np.squeeze(v) for k, v in loadmat(path).items() if not k.startswith("__") and np.size(v) > 1}
    except NotImplementedError as error:
        raise InputError(f"{path.name}: MAT file of version 7.3; save it with -v7 in MATLAB, or export CSV") from error
    except Exception as error:  # scipy raises whatever the damage of a file leads to
        raise InputError(f"{path.name}: no MAT file that can be read ({error}); save it anew, or export CSV") from error
    numbers = {k: v.astype(np.float64) for k, v in raw.items() if v.dtype.kind in "fiub"}
    if not numbers:
        raise InputError(f"{path.name}: no arrays of numbers at the top level; save vectors of equal length")
    return numbers


def take_even_steps(log: Log) -> Log:
    """Return the log [s] as it is where its steps are even; else at even times, which a note says.

    Raises InputError: times that jump, run backwards or are none.
    """
    _check_times(log)
    steps = np.diff(log.time)
    middle = float(np.median(steps))
    uneven = np.abs(steps - middle) > EVEN * middle
    if not uneven.any():
        return log
    if (gaps := steps > GAP * middle).any():
        k = int(np.argmax(gaps))
        raise InputError(
            f"{log.name}: times jump at {log.time[k]:g} s by {steps[k]:g} s, expected steps of {middle:g} s; "
            "resample the log evenly, or cut it there (LOG@START:END)"
        )
    time, columns = take_even_times([(log.time, log.columns)])
    found = f"{np.mean(uneven):.1%} of its steps are uneven ({steps.min():.3g} to {steps.max():.3g} s)"
    note = f"{log.name}: {found}: it was taken at even steps of {middle:.4g} s"
    paused = np.flatnonzero(steps > PAUSE * middle)
    pauses = np.column_stack([log.time[paused], log.time[paused + 1]])
    return replace(log, time=time, columns=columns, notes=(note,), pauses=pauses)


def _check_times(log: Log) -> None:
    time = log.time
    if len(time) < 20:
        raise InputError(f"{log.name}: {len(time)} samples, expected 20 or more, each with a time [s]")
    if not np.all(np.isfinite(time)):
        k = int(np.argmin(np.isfinite(time)))
        raise InputError(
            f"{log.name}: sample {k + 1} has no time, expected one in each line [s]; write it, or cut the log there"
        )
    steps = np.diff(time)
    if (steps <= 0).any():
        k = int(np.argmax(steps <= 0))
        raise InputError(
            f"{log.name}: times run backwards or stand still at sample {k + 1} ({time[k]:g} s, then {time[k + 1]:g} s); "
            "sort the log, or give its parts as logs of their own"
        )
