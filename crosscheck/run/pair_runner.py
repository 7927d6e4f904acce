"""One pair of engines on one case, for a test run: run what was not run yet, judge, and ask why.

Every answer is kept in a folder that the tests of a run share, so that however many ask, it is worked out once.
"""

from __future__ import annotations

import datetime
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from crosscheck.engines import ENGINES, Engine
from crosscheck.measures.certificate import Check
from crosscheck.measures.limits import REFERENCE
from crosscheck.measures.record import Record
from crosscheck.report.explanations import why
from crosscheck.run.isolation import Attempt, Children, ask, run_engine
from crosscheck.run.questions import asked, diagnosis, question
from crosscheck.run.run_cache import Attempts
from crosscheck.verdicts.baseline import METRICS, Baseline, by_baseline, find, is_worse
from crosscheck.verdicts.certificates import by_certificate, certificates
from crosscheck.verdicts.compare import Comparison, Pair, compare
from crosscheck.verdicts.plan import Task
from crosscheck.verdicts.refinement import Finer, renewed, wanted
from crosscheck.verdicts.repeatability import SHAKEN, by_repetition, doubtful, scattered
from crosscheck.verdicts.results import Diagnosis

FIRST: Mapping[str, Any] = {}
AGAIN: Mapping[str, Any] = {
    "certificate": False
}  # the same once more: what the engine's model is was said the first time


@dataclass(frozen=True)
class Shared:
    """Data shared by the tests of a run: folder of attempts, blessed night (None: limits alone), limit [s] of a process;

    engines : all that take part; children : processes, forked from prepared ones where it has them."""

    folder: Path
    baseline: Path | None
    limit: float
    engines: Mapping[str, Engine] = field(default_factory=dict)
    children: Children = field(default_factory=Children)

    @property
    def kept(self) -> Attempts:
        """The attempts."""
        return Attempts(self.folder, self.engines)


def compared(shared: Shared, task: Task, engine: Engine, reference: Engine) -> list[Comparison]:
    """Return every comparison of two engines in one case, judged as a run judges them.

    Raises BaselineError where the blessed night cannot be read.
    """
    ours, theirs = (_attempt(shared, task, one).record for one in (engine, reference))
    flexinv = _attempt(shared, task, ENGINES[REFERENCE]).record if reference.name != REFERENCE else theirs
    first = {reference.name: theirs, engine.name: ours}
    rows = compare(Pair(task.folder.name, task.case, ours, theirs, task.rest, datetime.date.today()))
    lines = certificates(task, {REFERENCE: flexinv, **first})
    rows = _refined(shared, task, first, by_certificate(rows, lines), lines)
    if any(map(doubtful, rows)):
        again = {one.name: _attempt(shared, task, one, AGAIN).record for one in (engine, reference)}
        rows = [by_repetition(row, first, again) if doubtful(row) else row for row in rows]
    known = blessed(shared.baseline)
    if any(is_worse(row, known) for row in rows):
        moved = [_attempt(shared, task, engine, {**AGAIN, "error": False, "shake": way}).record for way in SHAKEN]
        rows = [scattered(row, theirs, moved) if is_worse(row, known) else row for row in rows]
    return rows if known is None else [by_baseline(row, known) for row in rows]


def _refined(
    shared: Shared, task: Task, records: Mapping[str, Record], rows: list[Comparison], lines: Iterable[Check]
) -> list[Comparison]:
    """Return the comparisons of a pair, those that a coarse reference leaves open judged with finer ones."""
    had = Finer()
    reference = records.get(REFERENCE)
    while reference is not None and (one := wanted(rows, reference, had)) is not None:
        had = one
        reference = _attempt(shared, task, ENGINES[REFERENCE], {**AGAIN, **one.options}).record
        if reference.status != "ok":
            break
        others = [record for name, record in records.items() if name != REFERENCE]
        for other in others:
            pair = Pair(task.folder.name, task.case, other, reference, task.rest, datetime.date.today())
            rows = renewed(rows, by_certificate(compare(pair), lines))
    return rows


def blessed(folder: Path | None) -> Baseline | None:
    """Return the blessed night in a folder; without a folder None.  Raises BaselineError."""
    return None if folder is None else find(folder)


def beside(models: Path) -> Path | None:
    """Return the folder of the blessed night beside a folder of models, where there is one."""
    folder = models.parent / "reports" / "baseline"
    return folder if (folder / METRICS).is_file() else None


def cause(shared: Shared, task: Task, rows: Iterable[Comparison]) -> str:
    """Return the cause of different efforts among the comparisons of a pair, in a line; "" where they agree."""
    row = next(filter(asked, rows), None)
    if row is None:
        return ""
    file = shared.kept.stem(task, row.engine).with_suffix(".why")
    with shared.kept.alone(task, f"why {row.engine}"):
        if not file.is_file():
            file.write_text(json.dumps(asdict(_diagnosed(shared, task, row))), encoding="utf-8")
        return why(Diagnosis(**json.loads(file.read_text(encoding="utf-8"))))


def _diagnosed(shared: Shared, task: Task, row: Comparison) -> Diagnosis:
    ours, theirs = (shared.kept.stem(task, name) for name in (row.engine, row.reference))
    one = question(row, task.folder, ours, theirs, shared.engines.get(row.engine))
    answer, ending = ask(one.job, shared.limit, shared.children)
    return diagnosis(one, answer, ending.message)


def _attempt(shared: Shared, task: Task, engine: Engine, options: Mapping[str, Any] = FIRST) -> Attempt:
    what: dict[str, Any] = {"mechanism": str(task.folder.resolve()), "case": task.case.name, "options": dict(options)}
    with shared.kept.alone(task, engine.name):
        found = shared.kept.find(task, engine.name, options)
        if found is None:
            if options is AGAIN:  # in a process that shares nothing with the first, not even what it was forked from
                what["afresh"] = True
            found = run_engine(engine, what, task.time, shared.limit, shared.children)
            shared.kept.keep(task, engine.name, found, options)
    return found
