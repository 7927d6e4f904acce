"""Questions for causes: which deviations are asked about, and with what (in the parent)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crosscheck.engines import ENGINES, Engine
from crosscheck.engines.job_files import StudyRequest
from crosscheck.measures.limits import REFERENCE
from crosscheck.verdicts.baseline import UNBLESSED
from crosscheck.verdicts.compare import COMPARED, Comparison
from crosscheck.verdicts.plan import Plan
from crosscheck.verdicts.results import Diagnosis, DiagnosisQuestion, Results, collect_row_values

ASKED = ("deviation", "unjudged", "explained", "skipped")  # verdicts after which a reader asks why


@dataclass(frozen=True)
class Question:
    """One deviation to be diagnosed.

    place : mechanism, case, engine, reference; options : what `crosscheck.causes.diagnosis.diagnose` is called with
    """

    place: tuple[str, str, str, str]
    options: DiagnosisQuestion

    @property
    def job(self) -> StudyRequest:
        """The job of the child process."""
        return {
            "kind": "study",
            "module": "crosscheck.causes.diagnosis",
            "function": "diagnose",
            "options": dict(self.options),
        }


@dataclass(frozen=True)
class CaseQuestions:
    """Deviations of several engines in one case, diagnosed in one process.

    What does not depend on their answers, the effects of all causes, is computed once there.
    """

    questions: tuple[Question, ...]

    @property
    def job(self) -> StudyRequest:
        """The job of the child process."""
        return {
            "kind": "study",
            "module": "crosscheck.causes.diagnosis",
            "function": "make_diagnoses",
            "options": {"asked": [dict(one.options) for one in self.questions]},
        }


def split_by_case(asked: Iterable[Question]) -> list[CaseQuestions]:
    """Return the questions of each case of which more than one engine deviates."""
    cases: dict[tuple[str, str], list[Question]] = {}
    for one in asked:
        cases.setdefault(one.place[:2], []).append(one)
    return [CaseQuestions(tuple(several)) for several in cases.values() if len(several) > 1]


def list_questions(
    results: Results, plan: Plan, out: Path, engines: Mapping[str, Engine] | None = None
) -> list[Question]:
    """Return one question for every engine that deviates from the reference, of efforts if they do, and was saved."""
    known = engines or {}
    series = {(r.mechanism, r.case, r.engine): r.series for r in results.runs}
    folders = {(t.folder.name, t.case.name): t.folder for t in plan.tasks}
    found: dict[tuple[str, str, str], Question] = {}
    rows = sorted(
        filter(needs_diagnosis, results.comparisons), key=lambda row: row.quantity == "torque"
    )  # efforts have the last word
    for row in rows:
        here = (row.mechanism, row.case)
        ours, theirs = (series.get((*here, e), "") for e in (row.engine, REFERENCE))
        if ours and theirs:
            found[*here, row.engine] = make_question(
                row, folders[here], out / ours, out / theirs, known.get(row.engine)
            )
    return list(found.values())


def needs_diagnosis(row: Comparison) -> bool:
    """Return True if a comparison calls for a diagnosis: efforts, or what causes are held against, that differ.

    What is inside its limit and only not blessed yet needs no reason.
    """
    measured = row.quantity in COMPARED and row.reference == REFERENCE and row.maximum is not None
    open_to_doubt = ASKED if row.quantity == "torque" else ASKED[:1]  # what bars explain of the rest is inside them
    return measured and row.verdict in open_to_doubt and UNBLESSED not in row.message


def make_question(row: Comparison, folder: Path, ours: Path, theirs: Path, engine: Engine | None = None) -> Question:
    """Return the question for the cause of a deviation.

    folder : of the mechanism; ours, theirs : stems of the saved records of the engine and of the reference
    engine : where it is not one of ours, so that it can be run again
    """
    options: DiagnosisQuestion = {
        "folder": str(folder.resolve()),
        "case": row.case,
        "engine": row.engine,
        "ours": str(ours.resolve()),
        "theirs": str(theirs.resolve()),
    }
    if engine is not None and engine.name not in ENGINES:
        options["door"] = engine.door
    return Question((row.mechanism, row.case, row.engine, row.reference), options)


def read_diagnosis(question: Question, answer: Any, trouble: str) -> Diagnosis:
    """Return the diagnosis of a child's answer, or one that says why there is none."""
    if not isinstance(answer, Mapping):
        return Diagnosis(*question.place, words=f"not diagnosed: {trouble}")
    return Diagnosis(*question.place, **collect_row_values(Diagnosis, answer))
