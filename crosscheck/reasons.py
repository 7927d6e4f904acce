"""What stands beside the comparisons: certificates before them, and questions why after them (both in the parent)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from crosscheck.baseline import UNBLESSED
from crosscheck.certificate import Check, certificate, checks
from crosscheck.compare import Comparison
from crosscheck.plan import Plan, Task
from crosscheck.record import Record
from crosscheck.results import Diagnosis, Results

REFERENCE = "flexinv"
ASKED = ("deviation", "unjudged", "explained")  # verdicts after which a reader asks why


@dataclass(frozen=True)
class Question:
    """One deviation to be diagnosed.

    place : mechanism, case, engine, reference; options : what `crosscheck.diagnosis.diagnose` is called with
    """

    place: tuple[str, str, str, str]
    options: Mapping[str, str]

    @property
    def job(self) -> dict[str, Any]:
        """The job of the child process."""
        return {
            "kind": "study",
            "module": "crosscheck.diagnosis",
            "function": "diagnose",
            "options": dict(self.options),
        }


def certificates(task: Task, records: Mapping[str, Record]) -> tuple[Check, ...]:
    """Return every line of every engine's certificate against the reference's; an engine without one has one line."""
    reference = records.get(REFERENCE)
    if reference is None or reference.status != "ok":
        return ()
    ours = certificate(reference.certificate)
    found: list[Check] = []
    for name, record in records.items():
        if name == REFERENCE or record.status == "skipped" or not record.certificate:
            continue
        here = (task.folder.name, task.case.name, name)
        lines = checks(*here, certificate(record.certificate), ours)
        missing = str(record.certificate.get("problem", "the engine gives nothing that the reference has"))
        found += lines or (Check(*here, "no certificate", "-", False, words=missing),)
    return tuple(found)


def questions(results: Results, plan: Plan, out: Path) -> list[Question]:
    """Return one question for every engine whose efforts deviate from the reference's and were saved."""
    series = {(r.mechanism, r.case, r.engine): r.series for r in results.runs}
    folders = {(t.folder.name, t.case.name): t.folder for t in plan.tasks}
    found: dict[tuple[str, str, str], Question] = {}
    for row in filter(asked, results.comparisons):
        here = (row.mechanism, row.case)
        ours, theirs = (series.get((*here, e), "") for e in (row.engine, REFERENCE))
        if ours and theirs:
            found[*here, row.engine] = question(row, folders[here], out / ours, out / theirs)
    return list(found.values())


def asked(row: Comparison) -> bool:
    """Return whether a reader of a comparison asks why: efforts that differ from the reference's.

    What is inside its limit and only not blessed yet needs no reason.
    """
    measured = row.quantity == "torque" and row.reference == REFERENCE and row.maximum is not None
    return measured and row.verdict in ASKED and UNBLESSED not in row.message


def question(row: Comparison, folder: Path, ours: Path, theirs: Path) -> Question:
    """Return why a comparison deviates, as a question.

    folder : of the mechanism; ours, theirs : stems of the saved records of the engine and of the reference
    """
    saved = {"ours": str(ours.resolve()), "theirs": str(theirs.resolve())}
    options = {"folder": str(folder.resolve()), "case": row.case, "engine": row.engine, **saved}
    return Question((row.mechanism, row.case, row.engine, row.reference), options)


def diagnosis(question: Question, answer: Any, trouble: str) -> Diagnosis:
    """Return the diagnosis of a child's answer, or one that says why there is none."""
    if not isinstance(answer, Mapping):
        return Diagnosis(*question.place, words=f"not diagnosed: {trouble}")
    known = {f.name for f in fields(Diagnosis)}
    told: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in answer.items() if k in known}
    return Diagnosis(*question.place, **told)
