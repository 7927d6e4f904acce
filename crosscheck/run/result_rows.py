"""The rows of a report from what engines and studies gave: comparisons of a case, a run, its error budget, a table."""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from crosscheck.engines import describe_missing_package
from crosscheck.measures.limits import find, list_references, list_unused_limits
from crosscheck.measures.record import Record, RecordError, read_record
from crosscheck.measures.spectrum import RINGING, compute_ringing_spectrum, find_peaks
from crosscheck.run.isolation import Attempt
from crosscheck.run.jobs import JsonAnswer
from crosscheck.run.work import Study, Work
from crosscheck.verdicts import results as store
from crosscheck.verdicts.compare import Comparison, RecordPair, compare, split_by_unit
from crosscheck.verdicts.plan import Task, make_case_row
from crosscheck.verdicts.results import BudgetRow, CaseRow, EngineRow, Results, RunRow, StudyRow


def compare_all(task: Task, records: Mapping[str, Record]) -> tuple[list[Comparison], tuple[str, ...]]:
    """Return every comparison of one case, and the limits of engines of this run that none of them asked for."""
    rows = []
    used = []
    for name, record in records.items():
        for reference in list_references(task.case.limits, name):
            other = records.get(reference) or make_absent_record(reference)
            pair = RecordPair(task.folder.name, task.case, record, other, task.rest, datetime.date.today())
            rows += compare(pair)
            used += [find(task.case.limits, q, name, reference, record.version) for q in task.case.quantities]
    idle = list_unused_limits(task.case.limits, [limit for limit in used if limit is not None])
    here = [limit for limit in idle if not records.keys().isdisjoint(limit.engines)]
    return rows, tuple(f"{i.quantity}, engines {', '.join(i.engines)}, reference {i.reference}" for i in here)


def make_absent_record(reference: str) -> Record:
    """Return the record of a reference that is not part of this run."""
    return Record(engine=reference, status="skipped", message="is not part of this run")


def run_row(task: Task, attempt: Attempt) -> RunRow:
    """Return the row of a report about one run."""
    record = attempt.record
    spectra = {
        s.name: compute_ringing_spectrum(record.time, s.values, task.rest)
        for s in record.series.values()
        if s.quantity in RINGING
    }
    return RunRow(
        mechanism=task.folder.name,
        case=task.case.name,
        engine=record.engine,
        status=record.status,
        message=record.message,
        version=record.version,
        settings=dict(record.settings),
        wall_time=record.wall_time,
        elapsed=attempt.elapsed,
        model_hash=record.model_hash,
        printed=attempt.printed,
        peaks={name: find_peaks(*lines) for name, lines in spectra.items() if lines is not None},
        budget=tuple(list_budget_rows(record, task.case.quantities)),
        kept=attempt.kept,
    )


def list_budget_rows(record: Record, quantities: Iterable[str]) -> Iterator[BudgetRow]:
    """Yield the budget line of the series with the largest error bar [unit], for every quantity compared and unit."""
    for quantity in quantities:
        for unit, names in split_by_unit(record.series, quantity).items():
            known = [n for n in names if n in record.budget]
            if known:
                widest = max(known, key=lambda n: float(record.budget[n]["bar"]))
                yield {"quantity": quantity, "unit": unit, "series": widest, **record.budget[widest]}


def make_study_row(study: Study, answer: JsonAnswer) -> StudyRow:
    """Return the table of a study, or why there is none."""
    known = {f.name for f in dataclasses.fields(StudyRow)}
    ending = answer.ending
    value = answer.value
    row = StudyRow(study.name, study.title, printed=ending.printed, elapsed=ending.elapsed, kept=ending.kept)
    if ending.status != "ok":
        return replace(row, status=ending.status, message=ending.message)
    if not isinstance(value, dict) or not set(value) <= known or not (value.get("rows") or value.get("message")):
        return replace(row, status="error", message="the study gave no table")
    return replace(row, **store.collect_row_values(StudyRow, value))


UNREPEATED = Record("", status="error", message="interrupted")


def read_saved_record(stem: Path | None, engine: str) -> Record:
    """Return a record that was saved; what cannot be read any more cannot be repeated."""
    try:
        return read_record(stem) if stem is not None else Record(engine)
    except RecordError:
        return Record(engine)


def begin_results(work: Work, command: str) -> Results:
    """Return the results of a run before anything has run: its engines, cases, settings and machine."""
    plan = work.plan
    options = work.options
    broken = [CaseRow(name, "", problem=message) for name, message in plan.broken]
    rows = [
        EngineRow(e.name, (m := describe_missing_package(e)) is None, message=m or "") for e in work.engines.values()
    ]
    return Results(
        started=store.format_current_time(),
        command=command,
        settings={"timeout": options.timeout, "jobs": options.jobs, "options": dict(options.engine)},
        machine=store.describe_machine(),
        versions=store.list_versions(),
        engines=tuple(rows),
        cases=(*broken, *(make_case_row(task) for task in plan.tasks)),
    )
