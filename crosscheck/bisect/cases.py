"""Cases of ours as scripts that need one engine alone, so that they run where our adapters need a newer interface."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from pathlib import Path

from crosscheck.bisect.criteria import Criterion
from crosscheck.bisect.observations import Observation, Reading, parse_table
from crosscheck.bisect.script import Script
from crosscheck.engines import Engine
from crosscheck.measures.limits import REFERENCE, find, is_expired
from crosscheck.run.isolation import ChildProcesses
from crosscheck.run.reproduce import write_reproduction
from crosscheck.verdicts.plan import Task
from flexinv.errors import InputError

PROGRAM = "run.py"
COMPUTED = "computed.csv"
EXPECTED = "expected.csv"
TIME = "time"
# Distributions on the index by the engines that they bring.
PACKAGES = {
    "mujoco": "mujoco", "mujoco-equality": "mujoco", "mujoco-flex": "mujoco",
    "pinocchio": "pin",
    "exudyn": "exudyn", "exudyn-dae": "exudyn", "exudyn-ancf": "exudyn", "exudyn-ge": "exudyn",
}  # fmt: skip
BESIDE = ("numpy",)  # what the exported scripts need beside the engine


@dataclass(frozen=True)
class CaseScript:
    """A case as a script: folder of its files, the script, and the efforts that are expected (samples, 1 + nv) [s, N m, N]."""

    folder: Path
    script: Script
    expected: Observation


def resolve_engine(name: str) -> str:
    """Return the engine of a name, which may be that of its package: pin stands for pinocchio.  Raises InputError."""
    if name not in PACKAGES and name in PACKAGES.values():
        return next(engine for engine, package in PACKAGES.items() if package == name)
    find_package(name)
    return name


def find_package(engine: str) -> str:
    """Return the distribution that brings an engine.  Raises InputError where it is none of ours, or is no package."""
    if engine not in PACKAGES:
        raise InputError(f"no package of the index brings {engine!r}; expected one of {', '.join(PACKAGES)}")
    return PACKAGES[engine]


def write_case_script(
    task: Task, engine: Engine, folder: Path, timeout: float, children: ChildProcesses | None = None
) -> CaseScript:
    """Write a case for one engine into an empty folder.  Raises InputError where there is no export.

    timeout : [s] of a run; children : prepared processes, where there are several cases
    """
    write_reproduction(task, engine, folder, timeout, children)
    return read_case_script(folder, timeout)


def read_case_script(folder: Path, timeout: float) -> CaseScript:
    """Return the case that was exported into a folder.  timeout : [s] of a run"""
    files = tuple(sorted(file for file in folder.iterdir() if file.name not in (PROGRAM, "README.md")))
    names, table = parse_table((folder / EXPECTED).read_text(encoding="utf-8"))
    expected = Observation("", 0, None, names, table, "", "", 0.0, 0.0)
    return CaseScript(folder, Script((str(folder / PROGRAM),), files, timeout=timeout), expected)


def make_case_reading() -> Reading:
    """Return the reading of a case: the efforts that it has computed."""
    return Reading(table=COMPUTED)


def make_case_criterion(made: CaseScript, task: Task, engine: str, by_verdict: bool, tolerance: float) -> Criterion:
    """Return the criterion of a case: the limit of its verdict, or a tolerance about the first release [-].

    Raises InputError where a verdict is asked for, and the case states no limit of this engine.
    """
    columns = tuple(name for name in made.expected.names if name != TIME)
    if not by_verdict:
        return Criterion("same", tolerance=tolerance, columns=columns, one_scale=True)
    limit = find_case_limit(task, engine)
    if limit is None:
        raise InputError(
            f"{task.folder.name}/{task.case.name} states no limit of torque for {engine}: leave --verdict out, or let "
            "crosscheck verify propose one"
        )
    return Criterion("verdict", tolerance=limit, columns=columns, one_scale=True, expected=made.expected)


def find_case_limit(task: Task, engine: str) -> float | None:
    """Return the largest error of the efforts over their range [-] that a case allows an engine, None where it states none."""
    limit = find(task.case.limits, "torque", engine, REFERENCE)
    return None if limit is None or is_expired(limit, datetime.date.today()) else limit.maximum
