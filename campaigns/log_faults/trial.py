"""One fault, tried: a machine identified from a good log, a log with the fault, and what is named in it."""

from __future__ import annotations

import csv
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from campaigns.log_faults import logger_faults, machine_faults  # noqa: F401
from campaigns.log_faults.machines import WORLDS, Record, add_noise, run_machine, sample_day, sample_motion, write_log
from campaigns.log_faults.plants import apply_logger_faults, apply_machine_faults, parse_plants
from crosscheck.identification.causes.cause import NamedCause
from crosscheck.identification.causes.name_causes import find_causes
from crosscheck.identification.identify import Identification, identify
from crosscheck.identification.logs.log import Log, read_log
from flexinv.errors import InputError

HERE = Path(__file__).resolve().parent
GOOD = 12  # seed of the logs A


@dataclass(frozen=True)
class Row:
    """A row of faults.csv: what is planted, and the answers that are right.

    day : "same", or "other" with friction and offsets of another day; motion : "sines" or "moves"
    """

    number: int
    machine: str
    day: str
    motion: str
    seed: int
    faults: str
    right: str


@dataclass(frozen=True)
class Trial:
    """A row and its outcome: the causes that were named, or the words that refused the log; processor time [s]."""

    row: Row
    named: tuple[NamedCause, ...]
    refused: str
    seconds: float


def read_rows(file: Path = HERE / "faults.csv") -> list[Row]:
    """Return the rows of faults.csv [units of its answers]."""
    with file.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    return [Row(**{**row, "number": int(row["number"]), "seed": int(row["seed"])}) for row in rows]  # type: ignore[arg-type]


@cache
def fit_machine(name: str, day: str) -> Identification:
    """Return a machine as it is identified from its good log A [units of the parameters]; day : of log B, "same" or "other"."""
    world = WORLDS[name]
    random = np.random.default_rng(GOOD)
    good = add_noise(run_machine(world, sample_motion(world, random, moves=False)), world, random)
    with tempfile.TemporaryDirectory() as folder:
        file = write_log(name, good, Path(folder) / "A.csv")
        return identify(HERE / "models" / name, [file], days="one" if day == "same" else "files")


def make_record(row: Row, shift: int = 0) -> Record:
    """Return log B of a row [s, rad, N m] with its faults; ``shift`` is added to its seed."""
    random = np.random.default_rng(row.seed + shift)
    plants = parse_plants(row.faults)
    world = WORLDS[row.machine]
    if row.day == "other":
        world = sample_day(world, random)
    motion = sample_motion(world, random, row.motion == "moves")
    record = add_noise(run_machine(apply_machine_faults(world, plants), motion), world, random)
    return apply_logger_faults(record, plants, random)


def make_log(row: Row, shift: int = 0) -> Log:
    """Return log B of a row [units of its columns] as it is read from its file.  Raises InputError where it is refused."""
    with tempfile.TemporaryDirectory() as folder:
        return read_log(write_log(row.machine, make_record(row, shift), Path(folder) / f"B{row.number}.csv"))


def run_row(row: Row, shift: int = 0) -> Trial:
    """Run a row: its log B is made and its causes are named [units of the causes]; ``shift`` is added to its seed."""
    known = fit_machine(row.machine, row.day)
    begin = time.process_time()
    try:
        log = make_log(row, shift)
        begin = time.process_time()
        named = tuple(find_causes(known, log))
    except InputError as error:
        return Trial(row, (), str(error), time.process_time() - begin)
    return Trial(row, named, "", time.process_time() - begin)
