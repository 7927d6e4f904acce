"""Causes of a change in a case of ours: what the certificate of the model and the cause of a deviation say of both releases."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from crosscheck.bisect.answer import ChangeReport
from crosscheck.bisect.bisection import Bisection
from crosscheck.bisect.cases import TIME, read_case_script
from crosscheck.bisect.criteria import compute_table_distance
from crosscheck.bisect.observations import Observation
from crosscheck.engines import ENGINES
from crosscheck.engines.job_files import CaseRequest
from crosscheck.measures.limits import REFERENCE
from crosscheck.measures.record import Record, save, torque_series
from crosscheck.run.isolation import ChildProcesses, ask, open_scratch_folder, run_engine
from crosscheck.verdicts.plan import Task
from flexinv.errors import InputError

OWN_COORDINATES = "its efforts stand in coordinates of its own, which the causes do not read"
LONGEST_DIAGNOSIS = 900.0  # [s]
# Of the range: in the same coordinates flexinv's efforts are the same numbers, in others they differ by as much as efforts do.
SAME_EFFORTS = 1e-6


def describe_case_change(task: Task, engine: str, bisection: Bisection, change: ChangeReport) -> str:
    """Return the words of the causes about both releases, each beside flexinv; "" where flexinv gives no answer."""
    with open_scratch_folder() as place:
        try:
            reference = run_reference(task, place)
        except InputError:
            return ""
        script = bisection.trials.question.script
        expected = read_case_script(Path(script.words[0]).parent, script.timeout).expected
        told = []
        for release in (change.before, change.after):
            observation = bisection.trials.trials[release].observations[0]
            words = ask_cause(task, (engine, release), observation, expected, reference, place)
            told.append(f"{engine} {release} beside {REFERENCE}: {words}")
    return "\n".join(told)


def run_reference(task: Task, place: Path) -> Record:
    """Return flexinv's record of a case, and save it in a folder.  Raises InputError where it gives none."""
    request: CaseRequest = {"mechanism": str(task.folder.resolve()), "case": task.case.name, "options": {}}
    reference = run_engine(ENGINES[REFERENCE], request, task.time, LONGEST_DIAGNOSIS, ChildProcesses()).record
    if reference.status != "ok":
        raise InputError(f"{REFERENCE} gives no efforts: {reference.message}")
    save(reference, place / REFERENCE)
    return reference


def ask_cause(
    task: Task,
    who: tuple[str, str],
    observation: Observation,
    expected: Observation,
    reference: Record,
    place: Path,
) -> str:
    """Return the diagnosis of the efforts of one release, in words.

    who : engine and release; expected : flexinv's efforts as the script has them; place : where flexinv's record is saved
    """
    names = task.mechanism.velocity_names
    engine, release = who
    if {*observation.names} != {TIME, *names} or len(observation.table) != len(reference.time):
        return OWN_COORDINATES
    if not _is_alike(expected, reference):
        return OWN_COORDINATES
    effort = observation.table[:, [observation.names.index(name) for name in names]]  # (sample, coordinate)
    record = replace(
        reference,
        engine=engine,
        version=release,
        series=torque_series(task.mechanism, effort),
        certificate={},
        budget={},
    )
    stem = place / "release"
    save(record, stem)
    options = {
        "folder": str(task.folder.resolve()),
        "case": task.case.name,
        "engine": engine,
        "ours": str(stem),
        "theirs": str(place / REFERENCE),
    }
    job = {"kind": "study", "module": "crosscheck.causes.diagnosis", "function": "diagnose", "options": options}
    answer, ending = ask(job, LONGEST_DIAGNOSIS, ChildProcesses())
    return str(answer["words"]) if isinstance(answer, dict) else f"not diagnosed: {ending.message}"


def _is_alike(expected: Observation, reference: Record) -> bool:
    """Return True if flexinv's efforts in a script are those of its record: a basis that is turned keeps the names."""
    known = {f"torque/{name}": expected.names.index(name) for name in expected.names if name != TIME}
    both = [name for name in known if name in reference.series]
    ours = np.column_stack([reference.series[name].values for name in both])
    theirs = expected.table[:, [known[name] for name in both]]
    return ours.shape == theirs.shape and compute_table_distance(theirs, ours, one_scale=True) <= SAME_EFFORTS
