"""Output of results: tables, in the format that the suffix of their file names."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from flexinv.errors import InputError


def check_out(out: Path | None) -> None:
    """Raise InputError for a file [-] that could not be written: before the work, not after it."""
    if out is None:
        return
    if out.suffix.lower() not in WRITERS:
        raise InputError(f"--out {out}: expected a name that ends in {', '.join(WRITERS)}")
    if out.suffix.lower() == ".parquet" and not any(map(importlib.util.find_spec, ("pyarrow", "fastparquet"))):
        raise InputError(f"--out {out}: .parquet needs pyarrow: write pip install pyarrow, or a name that ends in .csv")


def write(table: pd.DataFrame, out: Path) -> None:
    """Write a table, units in its headers [any unit], as the suffix of ``out`` says."""
    WRITERS[out.suffix.lower()](table, out)


def _csv(table: pd.DataFrame, out: Path) -> None:
    table.to_csv(out)


def _parquet(table: pd.DataFrame, out: Path) -> None:
    table.reset_index().to_parquet(out, index=False)


def _json(table: pd.DataFrame, out: Path) -> None:
    """Column by column: a header and its numbers."""
    columns = {str(name): values.tolist() for name, values in table.reset_index().items()}
    out.write_text(json.dumps(columns), encoding="utf-8")


def _npz(table: pd.DataFrame, out: Path) -> None:
    with out.open("wb") as file:  # by name, numpy would add a suffix of its own
        np.savez(file, **{str(name): values.to_numpy() for name, values in table.reset_index().items()})


WRITERS: dict[str, Callable[[pd.DataFrame, Path], None]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".json": _json,
    ".npz": _npz,
}


def every(sample: float, step: float, size: float) -> int:
    """Return of how many steps [-] of ``size`` [s] one is written: a case's ``sample`` [s], where it is not its ``step`` [s].

    Raises InputError where steps of that size do not come to the samples.
    """
    if sample == step:
        return 1
    count = max(round(sample / size), 1)
    if abs(count * size - sample) > 1e-9 * sample:  # what decimals of a step leave
        raise InputError(
            f"--step {size:g}: sample_s = {sample:g} s of the case is no multiple of it; write {sample / count:g}"
        )
    return count
