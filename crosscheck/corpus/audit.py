"""Audit of error bars: the same engines with twice the resolution, and how many of their values lie inside the first bars.

An engine that integrates in time, or meshes beams, runs again with half the step and half the mesh width.  Closed formulas have
no resolution: they run again with other last digits in their input, by a factor that stays instead of one that alternates.
The bars are those that the consensus is made of, with their floor.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck import output_folder as owned
from crosscheck.corpus.consensus import AGREES, CaseConsensus
from crosscheck.corpus.entry import CLASSES, find_class
from crosscheck.corpus.folder import format_json
from crosscheck.corpus.gather import read_records
from crosscheck.corpus.intervals import EngineValues, find_samples_inside, make_interval
from crosscheck.engines.shared.rounding import NAME as ROUNDING_BARS
from crosscheck.measures.record import Record
from crosscheck.run.runner import run
from crosscheck.run.work import Notify, Work
from crosscheck.verdicts.plan import Plan, Task

TARGET = 0.95  # of the values of the finer solution that have to lie inside the bars
AUDIT = "audit.json"
FINER = {"refinement": 1, "error": False, "certificate": False}
OTHER_DIGITS = {"shake": 1, "error": False, "certificate": False}


@dataclass(frozen=True)
class AuditRow:
    """Audit of the engines of a class: samples and those inside the bars, series, and the series that is worst off.

    kind : the class; how : what was finer
    """

    kind: str
    engine: str
    how: str
    series: int
    samples: int
    inside: int
    worst: str
    worst_share: float

    @property
    def share(self) -> float:
        """Return the share of samples inside the bars [-]."""
        return self.inside / self.samples if self.samples else 0.0


def run_audit(work: Work, cases: Sequence[CaseConsensus], folder: Path, notify: Notify) -> list[AuditRow]:
    """Run engines again and return the audit by class and engine; folder : scratch for the runs.

    Raises InputError as a run does.
    """
    found: dict[tuple[str, str, str], list[tuple[str, int, int]]] = {}
    for k, (how, part) in enumerate(split_work(work, cases)):
        place = folder / f"finer{k}"
        results = run(part, place, notify)
        for case in (c for c in cases if c.task.folder.name in {t.folder.name for t in part.plan.tasks}):
            for name, record in read_records(results, case.task, place).items():
                rows = found.setdefault((find_class(case.task.mechanism), name, how), [])
                rows += compare_with_finer_run(case, name, record)
    return [_add_rows(*key, rows) for key, rows in sorted(found.items(), key=_make_sort_key) if rows]


def split_work(work: Work, cases: Sequence[CaseConsensus]) -> Iterator[tuple[str, Work]]:
    """Yield what runs again: how it differs, and cases with the engines that agree there; cases with the same share a run."""
    asked: dict[tuple[str, tuple[str, ...]], list[Task]] = {}
    for case in cases:
        agree = sorted({v.engine for one in case.series for v in one.voices if v.part == AGREES})
        split: dict[str, list[str]] = {}
        for name in agree:
            if work.engines[name].settings is None:  # a record or a program gives what it gave
                split.setdefault(
                    "other last digits" if _has_closed_form(case.records[name]) else "half step and mesh", []
                ).append(name)
        for how, mine in split.items():
            asked.setdefault((how, tuple(mine)), []).append(case.task)
    for (how, names), tasks in asked.items():
        options: Mapping[str, Any] = OTHER_DIGITS if how == "other last digits" else FINER
        plain = tuple(replace(task, case=replace(task.case, limits=())) for task in tasks)  # nothing is judged here
        engines = {name: work.engines[name] for name in names}
        told = replace(work.options, engine=options, baseline=None, resume=False, asking=False)
        yield how, Work(Plan(plain), engines, (), told)


def _has_closed_form(record: Record) -> bool:
    return any(ROUNDING_BARS in line.get("how", {}) for line in record.budget.values())


def compare_with_finer_run(case: CaseConsensus, engine: str, finer: Record) -> Iterator[tuple[str, int, int]]:
    """Yield for every series on which an engine agrees: its name, the samples, and those of the finer run inside its bars [-]."""
    coarse = case.records[engine].series
    for one in case.series:
        agrees = any(v.engine == engine and v.part == AGREES for v in one.voices)
        if agrees and one.name in finer.series:
            base = coarse[one.name]
            bar = np.zeros_like(base.values) if base.error is None else base.error
            where = make_interval(EngineValues(engine, "", base.values, bar), one.size)
            within = find_samples_inside(finer.series[one.name].values, where)
            yield f"{case.task.folder.name}/{case.task.case.name} {one.name}", within.size, int(within.sum())


def _add_rows(kind: str, engine: str, how: str, rows: Sequence[tuple[str, int, int]]) -> AuditRow:
    worst = min(rows, key=lambda row: row[2] / row[1])
    samples = sum(row[1] for row in rows)
    within = sum(row[2] for row in rows)
    return AuditRow(kind, engine, how, len(rows), samples, within, worst[0], worst[2] / worst[1])


def _make_sort_key(item: tuple[tuple[str, str, str], Any]) -> tuple[int, str, str]:
    kind, engine, how = item[0]
    return CLASSES.index(kind), how, engine


def collect_by_class(audited: Iterable[AuditRow]) -> list[AuditRow]:
    """Return the audit of each class over all its engines [-]."""
    rows = list(audited)
    result = []
    for kind in CLASSES:
        mine = [one for one in rows if one.kind == kind]
        if mine:
            worst = min(mine, key=lambda one: one.worst_share)
            total = replace(worst, engine="all", how="", series=sum(x.series for x in mine))
            result.append(replace(total, samples=sum(x.samples for x in mine), inside=sum(x.inside for x in mine)))
    return result


def is_target_met(audited: Iterable[AuditRow]) -> bool:
    """Return True if in every class enough values lie inside the bars [-]."""
    totals = collect_by_class(audited)
    return bool(totals) and all(one.share >= TARGET for one in totals)


def write_audit(audited: Sequence[AuditRow], out: Path) -> None:
    """Write ``audit.json`` into a corpus that is ours.  Raises OSError."""
    rows = [{**vars(one), "share": one.share} for one in audited]
    totals = [
        {"kind": x.kind, "series": x.series, "samples": x.samples, "share": x.share} for x in collect_by_class(audited)
    ]
    owned.write(out / AUDIT, format_json({"target": TARGET, "classes": totals, "engines": rows}))
