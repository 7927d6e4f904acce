"""The measurement as an engine: a machine that made the motion of the case, and what was seen of it.

The case names a CSV file: ``time [s]`` first, then series as in records, each perhaps with its error bar:

    time [s], torque/hub [N m], torque/hub error [N m], deflection/boom/y [m]

Its times are the sample times of the case.  Joints without a drive have no effort: that is known without a sensor.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.base import Options, sample_times
from crosscheck.measures.record import RESULTANTS, WRENCH, XYZ, Record, Series, series, torque_series
from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism
from flexinv.validation import nearest

Array = NDArray[np.float64]
HEADER = re.compile(r"(?P<name>[^\s\[\]]+)(?P<bar> error)? \[(?P<unit>[^\[\]]+)\]")
TIME = "time [s]"
# Of the time from sample to sample: a signal changes by no more than this part of what it changes from one to the next,
# and a grid that is written with the digits of its spacing has its times to rounding.
SAME_TIME = 1e-3
STATION = "STATION"  # stands for any in internal/BEAM/STATION/bending_y


def version() -> str:
    """Return the version of this reader: the measurement has none."""
    return "1"


def abilities() -> str:
    """Return one sentence: what a measurement can do here."""
    return "what was measured on a machine that made the motion, where a case names such a record"


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why there is nothing to compare with, or None where there is."""
    return "nobody measured this case" if case.measured is None else None


def run(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
    """Return the measured series on the sample times of the case [units of the file]."""
    if case.measured is None:
        raise InputError(f"case {case.name} names no record; write measured = with a CSV file")
    time, found = read(case.measured)
    wanted = sample_times(case)
    _check_times(case.measured, time, wanted, case.sample)
    _check_names(case.measured, mechanism, found)
    idle = torque_series(mechanism, np.zeros((time.size, mechanism.nv)))
    still = {name for name, on in zip(mechanism.velocity_names, mechanism.actuated, strict=True) if not on}
    made = {name: one for name, one in idle.items() if name.partition("/")[2] in still} | found
    return Record(engine=engine, time=wanted, series=made, settings={"file": case.measured.name})


def _check_times(path: Path, time: Array, wanted: Array, sample: float) -> None:
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


def _check_names(path: Path, mechanism: Mechanism, found: Iterable[str]) -> None:
    """Raise InputError where a column is called as nothing of the mechanism is: it would be compared with nothing."""
    known = _names(mechanism)
    for name in found:
        if re.sub("^(internal/[^/]+)/[^/]+/", rf"\\1/{STATION}/", name) not in known:
            near = nearest(name, sorted(known))
            raise InputError(
                f"{path}: column {name!r}: the mechanism has no such series; "
                + (f"write {near!r}" if near else f"it has {', '.join(sorted(known))}")
            )


def _names(mechanism: Mechanism) -> set[str]:
    """Return the names of all series that a record of the mechanism may have (see `crosscheck.measures.record`)."""
    beams = [link.name for link in mechanism.beams]
    return {
        *(f"torque/{name}" for name in mechanism.velocity_names),
        *(f"wrench/{joint.name}/{part}" for joint in mechanism.joints for part in WRENCH),
        *(f"reaction/{closure.name}/{part}" for closure in mechanism.closures for part in WRENCH),
        *(f"tip/{link.name}/{axis}" for link in mechanism.links for axis in XYZ),
        *(f"deflection/{beam}/{axis}" for beam in beams for axis in XYZ),
        *(f"axial/{beam}" for beam in beams),
        *(f"internal/{beam}/{STATION}/{part}" for beam in beams for part in RESULTANTS),
    }


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
