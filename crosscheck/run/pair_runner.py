"""One pair of engines on one case, for a test run: run what was not run yet, judge, and ask why.

Every answer is kept in a folder that the tests of a run share, so that however many ask, it is worked out once.
"""

from __future__ import annotations

import datetime
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from crosscheck.engines import ENGINES, Engine
from crosscheck.engines.base import Options as EngineOptions
from crosscheck.engines.job_files import CaseRequest
from crosscheck.measures.certificate import Check
from crosscheck.measures.limits import REFERENCE
from crosscheck.measures.record import Record
from crosscheck.report.explanations import describe_diagnosis
from crosscheck.run.isolation import Attempt, ChildProcesses, ask, run_engine
from crosscheck.run.questions import make_question, needs_diagnosis, read_diagnosis
from crosscheck.run.run_cache import AttemptFolder
from crosscheck.verdicts.baseline import METRICS, Baseline, find, is_worse, judge_by_baseline
from crosscheck.verdicts.certificates import judge_by_certificate, list_certificate_lines
from crosscheck.verdicts.compare import Comparison, RecordPair, compare
from crosscheck.verdicts.plan import Task
from crosscheck.verdicts.refinement import RefinementHalvings, find_wanted_refinement, update_open_rows
from crosscheck.verdicts.repeatability import SHAKEN, add_scatter, is_doubtful, judge_by_repetition
from crosscheck.verdicts.results import Diagnosis

FIRST: EngineOptions = {}
AGAIN: EngineOptions = {"certificate": False}  # the same once more: what the engine's model is was said the first time


@dataclass(frozen=True)
class RunContext:
    """Data shared by the tests of a run: folder of attempts, blessed night (None: limits alone), limit [s] of a process;

    engines : all that take part; children : processes, forked from prepared ones where it has them."""

    folder: Path
    baseline: Path | None
    limit: float
    engines: Mapping[str, Engine] = field(default_factory=dict)
    children: ChildProcesses = field(default_factory=ChildProcesses)

    @property
    def kept(self) -> AttemptFolder:
        """The attempts."""
        return AttemptFolder(self.folder, self.engines)


def compare_engines(shared: RunContext, task: Task, engine: Engine, reference: Engine) -> list[Comparison]:
    """Return every comparison of two engines in one case, judged as a run judges them.

    Raises BaselineError where the blessed night cannot be read.
    """
    ours, theirs = (_run_attempt(shared, task, one).record for one in (engine, reference))
    flexinv = _run_attempt(shared, task, ENGINES[REFERENCE]).record if reference.name != REFERENCE else theirs
    first = {reference.name: theirs, engine.name: ours}
    rows = compare(RecordPair(task.folder.name, task.case, ours, theirs, task.rest, datetime.date.today()))
    lines = list_certificate_lines(task, {REFERENCE: flexinv, **first})
    rows = _compare_with_finer(shared, task, first, judge_by_certificate(rows, lines), lines)
    rows = _judge_doubtful(shared, task, (engine, reference), first, rows)
    known = read_blessed_night(shared.baseline)
    if known is None:
        return rows
    if any(is_worse(row, known) for row in rows):
        moved = [_run_attempt(shared, task, engine, {**AGAIN, "error": False, "shake": way}).record for way in SHAKEN]
        rows = [add_scatter(row, theirs, moved) if is_worse(row, known) else row for row in rows]
    return [judge_by_baseline(row, known) for row in rows]


def _judge_doubtful(
    shared: RunContext, task: Task, engines: Iterable[Engine], first: Mapping[str, Record], rows: list[Comparison]
) -> list[Comparison]:
    """Return the comparisons of a pair, doubtful ones judged by running both once more."""
    if not any(map(is_doubtful, rows)):
        return rows
    again = {one.name: _run_attempt(shared, task, one, AGAIN).record for one in engines}
    return [judge_by_repetition(row, first, again) if is_doubtful(row) else row for row in rows]


def _compare_with_finer(
    shared: RunContext, task: Task, records: Mapping[str, Record], rows: list[Comparison], lines: Iterable[Check]
) -> list[Comparison]:
    """Return the comparisons of a pair, those that a coarse reference leaves open judged with finer ones."""
    had = RefinementHalvings()
    reference = records.get(REFERENCE)
    while reference is not None and (one := find_wanted_refinement(rows, reference, had)) is not None:
        had = one
        reference = _run_attempt(shared, task, ENGINES[REFERENCE], {**AGAIN, **one.options}).record
        if reference.status != "ok":
            break
        others = [record for name, record in records.items() if name != REFERENCE]
        for other in others:
            pair = RecordPair(task.folder.name, task.case, other, reference, task.rest, datetime.date.today())
            rows = update_open_rows(rows, judge_by_certificate(compare(pair), lines))
    return rows


def read_blessed_night(folder: Path | None) -> Baseline | None:
    """Return the blessed night in a folder; without a folder None.  Raises BaselineError."""
    return None if folder is None else find(folder)


def find_blessed_folder(models: Path) -> Path | None:
    """Return the folder of the blessed night beside a folder of models, where there is one."""
    folder = models.parent / "reports" / "baseline"
    return folder if (folder / METRICS).is_file() else None


def describe_pair_cause(shared: RunContext, task: Task, rows: Iterable[Comparison]) -> str:
    """Return the cause of different efforts among the comparisons of a pair, in a line; "" where they agree."""
    row = next(filter(needs_diagnosis, rows), None)
    if row is None:
        return ""
    file = shared.kept.make_record_path(task, row.engine).with_suffix(".why")
    with shared.kept.take_lock(task, f"why {row.engine}"):
        if not file.is_file():
            file.write_text(json.dumps(asdict(_find_diagnosis(shared, task, row))), encoding="utf-8")
        return describe_diagnosis(Diagnosis(**json.loads(file.read_text(encoding="utf-8"))))


def _find_diagnosis(shared: RunContext, task: Task, row: Comparison) -> Diagnosis:
    ours, theirs = (shared.kept.make_record_path(task, name) for name in (row.engine, row.reference))
    one = make_question(row, task.folder, ours, theirs, shared.engines.get(row.engine))
    answer, ending = ask(one.job, shared.limit, shared.children)
    return read_diagnosis(one, answer, ending.message)


def _run_attempt(shared: RunContext, task: Task, engine: Engine, options: EngineOptions = FIRST) -> Attempt:
    what: CaseRequest = {"mechanism": str(task.folder.resolve()), "case": task.case.name, "options": dict(options)}
    with shared.kept.take_lock(task, engine.name):
        result = shared.kept.find(task, engine.name, options)
        if result is None:
            if options is AGAIN:  # in a process that shares nothing with the first, not even what it was forked from
                what["afresh"] = True
            result = run_engine(engine, what, task.time, shared.limit, shared.children)
            shared.kept.add_answer(task, engine.name, result, options)
    return result
