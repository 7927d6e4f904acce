"""Certificates before the comparisons, and questions for causes after them (both in the parent)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from crosscheck.engines import ENGINES, Engine
from crosscheck.measures.certificate import Check, certificate, checks
from crosscheck.measures.limits import BY_DISCRETISATION
from crosscheck.measures.record import Record
from crosscheck.verdicts.baseline import UNBLESSED
from crosscheck.verdicts.compare import COMPARED, Comparison
from crosscheck.verdicts.plan import Plan, Task
from crosscheck.verdicts.results import NO_CERTIFICATE, Diagnosis, Results, fails

REFERENCE = "flexinv"
ASKED = ("deviation", "unjudged", "explained")  # verdicts after which a reader asks why


@dataclass(frozen=True)
class Question:
    """One deviation to be diagnosed.

    place : mechanism, case, engine, reference; options : what `crosscheck.causes.diagnosis.diagnose` is called with
    """

    place: tuple[str, str, str, str]
    options: Mapping[str, Any]

    @property
    def job(self) -> dict[str, Any]:
        """The job of the child process."""
        return {
            "kind": "study",
            "module": "crosscheck.causes.diagnosis",
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
        found += lines or (Check(*here, NO_CERTIFICATE, "-", False, words=missing),)
    return tuple(found)


def certified(rows: Iterable[Comparison], lines: Iterable[Check]) -> list[Comparison]:
    """Return the comparisons, those of engines whose certificate does not hold as deviations: they have another mechanism.

    Where an engine has no certificate nothing is known, and nothing changes.
    """
    failed: dict[tuple[str, str, str], list[str]] = {}
    for line in lines:
        if fails(line):
            failed.setdefault((line.mechanism, line.case, line.engine), []).append(line.what)
    return [_certified(row, failed) for row in rows]


def _certified(row: Comparison, failed: Mapping[tuple[str, str, str], list[str]]) -> Comparison:
    found = {e: failed.get((row.mechanism, row.case, e)) for e in (row.engine, row.reference)}
    parts = [f"{engine} has another {', '.join(what)}" for engine, what in found.items() if what]
    if not parts or row.verdict in ("skipped", "error"):
        return row
    words = f"the certificate does not hold: {'; '.join(parts)}"
    verdict = row.verdict if row.verdict == "unjudged" else "deviation"
    return replace(
        row,
        verdict=verdict,
        message="; ".join(filter(None, [row.message.removeprefix(BY_DISCRETISATION), words])),
        uncertified=words,
    )


def questions(results: Results, plan: Plan, out: Path, engines: Mapping[str, Engine] | None = None) -> list[Question]:
    """Return one question for every engine that deviates from the reference, of efforts if they do, and was saved."""
    known = engines or {}
    series = {(r.mechanism, r.case, r.engine): r.series for r in results.runs}
    folders = {(t.folder.name, t.case.name): t.folder for t in plan.tasks}
    found: dict[tuple[str, str, str], Question] = {}
    rows = sorted(
        filter(asked, results.comparisons), key=lambda row: row.quantity == "torque"
    )  # efforts have the last word
    for row in rows:
        here = (row.mechanism, row.case)
        ours, theirs = (series.get((*here, e), "") for e in (row.engine, REFERENCE))
        if ours and theirs:
            found[*here, row.engine] = question(row, folders[here], out / ours, out / theirs, known.get(row.engine))
    return list(found.values())


def asked(row: Comparison) -> bool:
    """Return True if a comparison calls for a diagnosis: efforts, or what causes are held against, that differ.

    What is inside its limit and only not blessed yet needs no reason.
    """
    measured = row.quantity in COMPARED and row.reference == REFERENCE and row.maximum is not None
    open_to_doubt = ASKED if row.quantity == "torque" else ASKED[:1]  # what bars explain of the rest is inside them
    return measured and row.verdict in open_to_doubt and UNBLESSED not in row.message


def question(row: Comparison, folder: Path, ours: Path, theirs: Path, engine: Engine | None = None) -> Question:
    """Return the question for the cause of a deviation.

    folder : of the mechanism; ours, theirs : stems of the saved records of the engine and of the reference
    engine : where it is not one of ours, so that it can be run again
    """
    saved = {"ours": str(ours.resolve()), "theirs": str(theirs.resolve())}
    options = {"folder": str(folder.resolve()), "case": row.case, "engine": row.engine, **saved}
    door = {"door": engine.door} if engine is not None and engine.name not in ENGINES else {}
    return Question((row.mechanism, row.case, row.engine, row.reference), {**options, **door})


def diagnosis(question: Question, answer: Any, trouble: str) -> Diagnosis:
    """Return the diagnosis of a child's answer, or one that says why there is none."""
    if not isinstance(answer, Mapping):
        return Diagnosis(*question.place, words=f"not diagnosed: {trouble}")
    known = {f.name for f in fields(Diagnosis)}
    told: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in answer.items() if k in known}
    return Diagnosis(*question.place, **told)
