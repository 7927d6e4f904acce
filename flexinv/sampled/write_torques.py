"""write_torques: the efforts of a robot's joints for a motion in a file of any length, written part by part."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np
from numpy.typing import ArrayLike

from flexinv.analysis.solution import list_effort_labels
from flexinv.errors import InputError
from flexinv.files.csv_dialect import Share
from flexinv.model.mechanism import Mechanism
from flexinv.sampled.torque_run import ROWS, EffortRows, Friction, Payload, TorqueRequest, make_torque_run
from flexinv.typing import Array
from flexinv.validation import check_callable, check_flag, check_path, check_whole_number

if TYPE_CHECKING:
    import pandas as pd

LEAST_ROWS = 1_000
LINES = 2_000  # rows that become text at once


@dataclass(frozen=True)
class TorqueSummary:
    """Summary of a file that `write_torques` has written.

    file : where; labels : of its columns behind the first one; samples : rows [-]; peak, rms : of each column [N m], [N]
    used : of each column the part of the stated limit that its peak takes [-], nan where none is stated
    source : in words where rates and accelerations came from; left_out : columns of the motion that are none of it
    columns : coordinate -> header of its position's column
    """

    file: Path
    labels: tuple[str, ...]
    samples: int
    peak: Array
    rms: Array
    used: Array
    source: str
    left_out: tuple[str, ...]
    columns: Mapping[str, str]


def write_torques(
    robot: str | Path | Mechanism, motion: str | Path | pd.DataFrame, out: str | Path, *, payload: Payload | None = None,
    gravity: ArrayLike | None = None, friction: Friction = True, hold: Mapping[str, Any] | None = None,
    spacing: float | None = None, step: float | None = None, initial: str = "consistent", rows: int = ROWS,
    overwrite: bool = False, progress: Share | None = None,
) -> TorqueSummary:  # fmt: skip
    """Write the efforts of `torques` into a CSV file [N m], [N], [s], part by part: of any length in the memory of a part.

    rows : samples in memory at once [-], each some 1.5 kB for an arm of six joints with rates and accelerations.  A motion of an
        arm that bends, or of a loop whose passive joints it leaves out, is in memory as a whole; a tree's solution comes in parts
    overwrite : replace a file that is there; progress : called with the part of the work that is done [-]
    All else as for `torques`.  The file is there when all is done, or not at all.  Raises InputError, ConvergenceError.
    """
    target = _check_out(out, motion, check_flag("overwrite", overwrite))
    rows = check_whole_number("rows", rows, LEAST_ROWS, f"the samples in memory at once, {LEAST_ROWS} or more")
    check_callable("progress", progress, "a function of the part of the work that is done")
    request = TorqueRequest(payload, gravity, friction, hold, spacing, step, initial)
    run = make_torque_run(robot, motion, request, rows, progress)
    labels = tuple(list_effort_labels(run.mechanism))
    part = target.with_name(f"{target.name}.part{os.getpid()}")
    try:
        with part.open("w", encoding="utf-8", newline="") as stream:
            stream.write(",".join(["time [s]" if run.table.timed else "row", *labels]) + "\n")
            for one in run.compute():
                _write_rows(stream, one)
        part.replace(target)
    finally:
        part.unlink(missing_ok=True)
    c = run.table.columns
    source = "rates and accelerations given" if c.accelerations else "rates given, accelerations by a quintic spline"
    if not c.rates:
        source = "rates and accelerations by a quintic spline"
    named = {column.coordinate: column.name for column in c.positions}
    limits = np.array([joint.limits.effort for joint in run.mechanism.joints for _ in range(joint.nv)])
    used = np.where(np.isfinite(limits) & (limits > 0.0), run.peak / limits, np.nan)
    return TorqueSummary(target, labels, run.samples, run.peak, run.rms, used, source, c.left_out, named)


def _check_out(out: str | Path, motion: object, overwrite: bool) -> Path:
    target = Path(check_path("out", out, "a CSV file"))
    if isinstance(motion, str | Path) and target.resolve() == Path(motion).resolve():
        raise InputError(f"{target}: it is the motion itself; write another name for the efforts")
    if target.suffix.lower() != ".csv":
        raise InputError(f"{target}: expected a name that ends in .csv, which is written part by part")
    if not target.resolve().parent.is_dir():
        raise InputError(f"{target}: the folder {target.resolve().parent} does not exist; make it first")
    if target.exists() and not (overwrite and target.is_file()):
        raise InputError(
            f"{target} is there already: write another name, or --overwrite (overwrite=True) to replace it"
        )
    return target


def _write_rows(stream: TextIO, one: EffortRows) -> None:
    """Write rows as the shortest texts that give the same numbers back: many of them by one format."""
    start = np.arange(one.first, one.first + len(one.values)) if one.time is None else one.time
    table = np.column_stack([start, one.values])
    line = ",".join(["%d" if one.time is None else "%r", *["%r"] * one.values.shape[1]]) + "\n"
    for first in range(0, len(table), LINES):
        some = table[first : first + LINES]
        stream.write(line * len(some) % tuple(some.ravel().tolist()))
