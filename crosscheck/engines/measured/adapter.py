"""The measurement as an engine: a machine that made the motion of the case, and what was seen of it.

The case names a CSV file: ``time [s]`` first, then series as in records, each perhaps with its error bar:

    time [s], torque/hub [N m], torque/hub error [N m], deflection/boom/y [m]

Its times are the sample times of the case.  Joints without a drive have no effort: that is known without a sensor.
"""

from __future__ import annotations

import numpy as np

from crosscheck.engines.base import Options, sample_times
from crosscheck.measures.record import Record, torque_series
from crosscheck.measures.series_csv import check_names, check_times, list_all_series, read
from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism


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
    times = sample_times(case)
    check_times(case.measured, time, times, case.sample)
    check_names(case.measured, list_all_series(mechanism), found.values())
    idle = torque_series(mechanism, np.zeros((time.size, mechanism.nv)))
    still = {name for name, on in zip(mechanism.velocity_names, mechanism.actuated, strict=True) if not on}
    made = {name: one for name, one in idle.items() if name.partition("/")[2] in still} | found
    return Record(engine=engine, time=times, series=made, settings={"file": case.measured.name})
