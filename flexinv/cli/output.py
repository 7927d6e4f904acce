"""Options that commands share, and output of results: tables, in the format that the suffix of their file names."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click
import numpy as np

from flexinv.display.figures import check_matplotlib
from flexinv.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

T = TypeVar("T")
PLOTS = (".png", ".svg", ".pdf")
FILE = click.Path(path_type=Path, dir_okay=False)
MODEL = click.argument("model", type=click.Path(path_type=Path))
OVERWRITE = click.option("--overwrite", is_flag=True, help="Replace files that are there already.")
UNDEFORMED = click.option(
    "--undeformed", is_flag=True, help="Links that bend: begin undeformed; else in equilibrium under gravity."
)
ACCURACY = click.option(
    "--accuracy", type=float, help="Largest error of every torque and tip in parts of its range, for example 1e-4, in place of a "
    "step: steps and mesh are chosen for it, and error bars say what was reached.",
)  # fmt: skip


def parse_by_joint(option: str, texts: Sequence[str], read: Callable[[str], T], expected: str) -> dict[str, T]:
    """Return joint -> what is ``read`` [any unit] behind the equals sign of an option; InputError says what was ``expected``."""
    out = {}
    for text in texts:
        joint, _, value = text.partition("=")
        try:
            out[joint] = read(value)
        except ValueError:
            raise InputError(f"{option} {text}: expected {expected}") from None
    return out


def check_outputs(out: Path | None, overwrite: bool, others: Iterable[Path | None] = ()) -> None:
    """Raise InputError for files [-] that could not be written: before the work, not after it.

    Their folder is not there, or they are, and nobody said --overwrite; out : a table, whose suffix has to be known.
    """
    for path in (out, *others):
        if path is not None and not path.resolve().parent.is_dir():
            raise InputError(f"{path}: the folder {path.resolve().parent} does not exist; make it first")
        if path is not None and path.is_file() and not overwrite:
            raise InputError(f"{path} is there already: write another name, or --overwrite to replace it")
    suffix = "" if out is None else out.suffix.lower()
    if out is not None and suffix not in WRITERS:
        raise InputError(f"--out {out}: expected a name that ends in {', '.join(WRITERS)}")
    if suffix == ".parquet" and not any(map(importlib.util.find_spec, ("pyarrow", "fastparquet"))):
        raise InputError(f"--out {out}: .parquet needs pyarrow: write pip install pyarrow, or a name that ends in .csv")


def write(table: pd.DataFrame, out: Path) -> None:
    """Write a table, units in its headers [any unit], as the suffix of ``out`` says, and tell of it."""
    WRITERS[out.suffix.lower()](table, out)
    click.echo(f"wrote {out}")


def check_plot(plot: Path | None) -> None:
    """Raise InputError for a drawing [-] that could not be made."""
    if plot is None:
        return
    if plot.suffix not in PLOTS:
        raise InputError(f"--plot {plot}: expected a name that ends in {', '.join(PLOTS)}")
    check_matplotlib("--plot")


def write_table(table: pd.DataFrame | pd.Series, digits: int = 6, index: bool = False, missing: str = "NaN") -> None:
    """Print a table with so many ``digits`` [-], for a number that is none ``missing``."""
    rows = {"index": index} if table.ndim == 2 else {}
    click.echo(table.to_string(float_format=lambda x: f"{x:.{digits}g}", na_rep=missing, **rows))


def _write_json(table: pd.DataFrame, out: Path) -> None:  # column by column: a header and its numbers
    columns = {str(name): values.tolist() for name, values in table.reset_index().items()}
    out.write_text(json.dumps(columns), encoding="utf-8")


def _write_npz(table: pd.DataFrame, out: Path) -> None:
    with out.open("wb") as file:  # by name, numpy would add a suffix of its own
        np.savez(file, **{str(name): values.to_numpy() for name, values in table.reset_index().items()})


WRITERS: dict[str, Callable[[pd.DataFrame, Path], None]] = {
    ".csv": lambda table, out: table.to_csv(out), ".parquet": lambda table, out: table.reset_index().to_parquet(out, index=False),
    ".json": _write_json, ".npz": _write_npz,
}  # fmt: skip


def parse_numbers(text: str) -> list[float]:
    """Return numbers with commas between them [any unit]; ValueError for other words."""
    return [float(one) for one in text.split(",")]


def parse_start(text: str | None) -> list[float] | None:
    """Return the numbers of --start [rad], [m]; InputError for other words."""
    try:
        return None if text is None else parse_numbers(text)
    except ValueError:
        raise InputError(
            f"--start {text}: expected numbers [rad], [m], one for each of q, for example --start 0.5,-1"
        ) from None
