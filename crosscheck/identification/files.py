"""Files of `crosscheck identify`: prediction.csv, parameters.csv, days.csv, judged.csv, motions.csv."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from crosscheck.identification.bands import ChannelJudgement, Prediction
from crosscheck.identification.logs.motions import PartJudgement
from crosscheck.identification.machine import Machine
from crosscheck.identification.table import MACHINE, DayRow, Row


def write_prediction(machine: Machine, prediction: Prediction, file: Path) -> None:
    """Write time [s], and of every channel value, low and high end of its 90 % band [unit of the channel]."""
    columns: dict[str, object] = {"time_s": [repr(float(t)) for t in prediction.time]}  # with all its digits
    for k, channel in enumerate(machine.channels):
        for suffix, values in (("", prediction.value), (" low", prediction.low), (" high", prediction.high)):
            columns[f"{channel.name}{suffix} [{channel.unit}]"] = values[:, k]
    pd.DataFrame(columns).to_csv(file, index=False, float_format="%.9g")


def write_parameters(table: list[Row], file: Path) -> None:
    """Write every parameter with its 90 % interval [unit of each] and whether the log has told it."""
    frame = pd.DataFrame([vars(row) for row in table])
    frame = frame[["parameter", "place", "value", "low", "high", "unit", "identifiable"]]
    frame.to_csv(file, index=False, float_format="%.9g")


def write_days(rows: list[DayRow], file: Path) -> None:
    """Write every parameter that differs from day to day with its 90 % intervals [unit of each]: of each day, of the machine."""
    columns = ["parameter", "place", "day", "value", "low", "high", "unit"]
    frame = pd.DataFrame([vars(row) | {"day": row.day or MACHINE} for row in rows], columns=columns)
    frame.to_csv(file, index=False, float_format="%.9g")


def write_motions(parts: list[PartJudgement], file: Path) -> None:
    """Write how well each motion of each log is told, channel by channel: RMS errors [unit of the channel], parts inside [-]."""
    columns = ["log", "part", "start", "end", "channel", "unit", "samples", "rms", "left", "inside"]
    frame = pd.DataFrame([vars(row) | {"left": row.left} for row in parts], columns=columns)
    frame.rename(columns={"part": "motion", "start": "start_s", "end": "end_s"}).to_csv(
        file, index=False, float_format="%.6g"
    )


def write_judged(judgements: list[ChannelJudgement], judged: list[ChannelJudgement], file: Path) -> None:
    """Write what is explained and covered of every channel [-], RMS errors [unit of the channel]."""
    rows = [
        {"part": part} | vars(row) for part, some in (("identified", judgements), ("held out", judged)) for row in some
    ]
    frame = pd.DataFrame(rows)
    frame.replace([np.inf], np.nan).to_csv(file, index=False, float_format="%.6g")
