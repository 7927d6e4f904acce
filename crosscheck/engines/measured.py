"""The measurement as an engine: a machine that made the motion of the case, and what was seen of it.

The case names a CSV file: ``time [s]`` first, then series as in records, each perhaps with its error bar:

    time [s], torque/hub [N m], torque/hub error [N m], deflection/boom/y [m]

Its times are the sample times of the case.  Joints without a drive have no effort: that is known without a sensor.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.base import Options, sample_times
from crosscheck.record import Record, Series, series, torque_series
from flexinv.errors import InputError
from flexinv.files.case import Case
from flexinv.mechanism import Mechanism

Array = NDArray[np.float64]
HEADER = re.compile(r"(?P<name>[^\s\[\]]+)(?P<bar> error)? \[(?P<unit>[^\[\]]+)\]")
TIME = "time [s]"


def version() -> str:
    """Return the version of this reader: the measurement has none."""
    return "1"


def abilities() -> str:
    """Return one sentence: what a measurement can do here."""
    return "what was measured on a machine that made the motion, where a case names such a record"


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return why there is nothing to compare with, or None where there is."""
    return "nobody measured this case" if case.measured is None else None


def run(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
    """Return the measured series on the sample times of the case [units of the file]."""
    if case.measured is None:
        raise InputError(f"case {case.name} names no record; write measured = with a CSV file")
    time, found = read(case.measured)
    wanted = sample_times(case)
    # Times are written with three decimals or more.
    if time.shape != wanted.shape or np.abs(time - wanted).max() > 5e-4:
        raise InputError(
            f"{case.measured}: column {TIME} has {time.size} times, not the {wanted.size} of the case, "
            f"0 to {wanted[-1]:g} s every {case.sample:g} s"
        )
    idle = torque_series(mechanism, np.zeros((time.size, mechanism.nv)))
    still = {name for name, on in zip(mechanism.velocity_names, mechanism.actuated, strict=True) if not on}
    made = {name: one for name, one in idle.items() if name.partition("/")[2] in still} | found
    return Record(engine=engine, time=wanted, series=made, settings={"file": case.measured.name})


def read(path: Path) -> tuple[Array, dict[str, Series]]:
    """Read times [s] and series with their error bars, by name.  Raises InputError that names the column."""
    with path.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    header = [cell.strip() for cell in rows[0]] if rows else []
    if not header or header[0] != TIME:
        raise InputError(f"{path}: the first column is {header[0] if header else 'missing'!r}, expected {TIME!r}")
    heads = [HEADER.fullmatch(cell) for cell in header]
    if None in heads:
        wrong = header[heads.index(None)]
        raise InputError(f"{path}: column {wrong!r}: expected a series and its unit; write 'torque/hub [N m]'")
    try:
        table = np.array(rows[1:], dtype=np.float64)
    except ValueError as error:
        raise InputError(f"{path}: {error}; expected a number in every cell") from None
    columns = {m.group("name", "bar"): (m["unit"], table[:, k]) for k, m in enumerate(heads) if m is not None and k}
    found: dict[str, Series] = {}
    for (name, bar), (unit, values) in columns.items():
        if bar is None:
            found |= series(name, unit, values, columns.get((name, " error"), (unit, None))[1])
        elif (name, None) not in columns:
            raise InputError(f"{path}: column '{name} error [{unit}]' has no column '{name} [{unit}]' beside it")
    return table[:, 0], found
