"""CSV in any dialect: which mark stands between columns, which between digits, what columns are called; read in parts."""

from __future__ import annotations

import csv
import gzip
import warnings
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexinv.errors import InputError
from flexinv.files.toml_tables import make_input_error
from flexinv.validation import find_nearest_word

if TYPE_CHECKING:
    import pandas as pd

Share = Callable[[float], None]

LONGEST_LINE = 1 << 20  # [characters]
MARKS = ";\t,"


@dataclass(frozen=True)
class CsvDialect:
    """Dialect of a CSV file: header, mark between columns, mark before decimals."""

    header: tuple[str, ...]
    mark: str
    decimal: str


def read_csv_dialect(path: Path) -> CsvDialect:
    """Read the first two lines of a CSV file, packed by gzip or not [-].

    Commas, semicolons or tabs stand between columns; a decimal comma where no column is divided by commas.
    Raises InputError: no UTF-8, a line without end, a column that stands there twice.
    """
    opener: Any = gzip.open if path.name.endswith(".gz") else open
    try:
        with opener(path, "rt", encoding="utf-8-sig", newline="") as stream:
            first = stream.readline(LONGEST_LINE)
            second = stream.readline(LONGEST_LINE)
    except UnicodeDecodeError as error:
        raise InputError(f"{path.name}: the header is not UTF-8 ({error}); save it as UTF-8") from error
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path.name}: it cannot be read ({error}); write the log anew") from error
    if max(len(first), len(second)) >= LONGEST_LINE:
        raise InputError(f"{path.name}: a line of more than {LONGEST_LINE} characters; expected a line for each sample")
    mark = max(MARKS, key=lambda one: len(next(csv.reader([first], delimiter=one), [])))
    header = [cell.strip() for cell in next(csv.reader([first.strip()], delimiter=mark), [])]
    if doubled := sorted({cell for cell in header if header.count(cell) > 1}):
        raise InputError(f"{path.name}: column {doubled[0]!r} stands there twice; rename one of them")
    decimal = "," if mark != "," and "," in second and "." not in second else "."
    return CsvDialect(tuple(header), mark, decimal)


def read_csv_parts(path: Path, dialect: CsvDialect, rows: int, progress: Share | None = None) -> Iterator[pd.DataFrame]:
    """Yield the table of a file in parts of ``rows`` [-], columns in their places.

    progress : called with the part of the file that is read [-].  Raises InputError: rows with other numbers of cells.
    """
    import pandas as pd

    size = max(path.stat().st_size, 1)
    with path.open("rb") as stream:
        options: dict[str, Any] = {"header": 0, "index_col": False, "chunksize": rows, "low_memory": False}
        parts = _run_pandas(path, dialect, lambda: pd.read_csv(stream, **_make_options(path, dialect), **options))
        while (frame := _run_pandas(path, dialect, lambda: next(parts, None))) is not None:
            yield frame
            if progress is not None:
                progress(stream.tell() / size)


def read_csv_head(path: Path, dialect: CsvDialect, rows: int) -> pd.DataFrame:
    """Return the first ``rows`` [-] of a file as texts.  Raises InputError as `read_csv_parts` does."""
    import pandas as pd

    options: dict[str, Any] = {"header": 0, "index_col": False, "nrows": rows, "dtype": str, "keep_default_na": False}
    with path.open("rb") as stream:
        return _run_pandas(path, dialect, lambda: pd.read_csv(stream, **_make_options(path, dialect), **options))


def find_nearest_csv(path: Path) -> str | None:
    """Return the name of the CSV file beside a path that is most like its own [words], None where none is."""
    return find_nearest_word(path.name, sorted(p.name for p in path.parent.glob("*.csv")))


def make_exact_options() -> dict[str, Any]:
    """Return the options [-] with which pandas reads a number as Python does: before its version 3.1 it loses a last digit."""
    import pandas as pd

    version = tuple(map(int, pd.__version__.split(".")[:2]))
    return {} if version >= (3, 1) else {"float_precision": "round_trip"}


def _make_options(path: Path, dialect: CsvDialect) -> dict[str, Any]:
    packed = "gzip" if path.name.lower().endswith(".gz") else None
    marks = {"sep": dialect.mark, "decimal": dialect.decimal, "skipinitialspace": True}
    return {**marks, **make_exact_options(), "encoding": "utf-8-sig", "compression": packed}


def _run_pandas(path: Path, dialect: CsvDialect, take: Callable[[], Any]) -> Any:
    """The answer of a call of pandas; its complaints are InputError."""
    import pandas as pd

    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)
        try:
            return take()
        except (ValueError, OSError, EOFError, pd.errors.ParserWarning) as error:
            words = " ".join(str(error).split())[:200]
            expected = f"{len(dialect.header)} cells in each line, as in the first"
            raise make_input_error(str(path), f"no CSV: {words}", expected, "the file again, as UTF-8") from error
