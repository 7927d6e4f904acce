"""State of a run: results and records so far, and what they ask for next; only the main thread touches it."""

from __future__ import annotations

import contextlib
import math
import time as clock
import traceback
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from crosscheck import output_folder as owned
from crosscheck.engines import Engine, describe_missing_package
from crosscheck.measures.certificate import Check
from crosscheck.measures.limits import REFERENCE
from crosscheck.measures.record import Record, save
from crosscheck.run.abilities import Abilities, make_skipped_attempt
from crosscheck.run.isolation import Attempt
from crosscheck.run.jobs import (
    AbilitiesJob,
    Answer,
    CaseRun,
    CauseJob,
    Job,
    JsonAnswer,
    RefinedRun,
    RepeatedRun,
    ShakenRun,
    StudyJob,
    describe_harness_failure,
)
from crosscheck.run.questions import list_questions, read_diagnosis
from crosscheck.run.result_rows import UNREPEATED, compare_all, make_study_row, read_saved_record, run_row
from crosscheck.run.work import Event, Notify, Work
from crosscheck.verdicts import baseline
from crosscheck.verdicts import results as store
from crosscheck.verdicts.certificates import judge_by_certificate, list_certificate_lines
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.plan import Task
from crosscheck.verdicts.refinement import (
    RefinementHalvings,
    find_wanted_refinement,
    is_open,
    update_open_rows,
)
from crosscheck.verdicts.repeatability import SHAKEN, add_scatter, is_doubtful, judge_by_repetition
from crosscheck.verdicts.results import Diagnosis, Results, RunRow, StudyRow, make_slug
from crosscheck.verdicts.scope import Scope
from crosscheck.verdicts.signals import Key as SignalKey
from crosscheck.verdicts.signals import Signal, describe_signals

RESULTS = "results.json"
INTERRUPTED = "interrupted"
UNCOMPARED = "nothing is compared with it here: no other engine came to an answer"
PAUSE = 2.0  # [s] between two writings of results.json at least
RARELY = 20.0  # times as long as a writing takes: no more than a twentieth of a run is spent on it


@dataclass
class RunState:
    """State of a run: results and records so far, why engines cannot do cases, and how long jobs took [s] by their labels.

    written : when results.json was written last, since the start [s]; pause : until it is written again at least [s]
    """

    work: Work
    out: Path
    notify: Notify
    results: Results
    start: float = field(default_factory=clock.monotonic)
    written: float = 0.0
    pause: float = field(default_factory=lambda: PAUSE)
    done: int = 0
    signals: dict[SignalKey, Signal] = field(default_factory=dict)
    records: dict[tuple[str, str], dict[str, Record]] = field(default_factory=dict)
    again: dict[tuple[str, str], dict[str, Record]] = field(default_factory=dict)
    shaken: dict[tuple[str, str, str], list[Record]] = field(default_factory=dict)
    finer: dict[tuple[str, str], tuple[RefinementHalvings, Record]] = field(default_factory=dict)
    refused: dict[tuple[str, str, str], Attempt] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def list_jobs(self) -> Iterator[CaseRun | StudyJob]:
        """Yield every engine at every case, and every study."""
        for task in self.work.plan.tasks:
            for engine in self.work.engines.values():
                yield CaseRun(task, engine)
        for study in self.work.studies:
            yield StudyJob(study)

    def list_ability_questions(self, left: Iterable[Job]) -> Iterator[AbilitiesJob]:
        """Yield what every adapter is asked before its engines run: what it is, and which of the cases it can do.

        left : the jobs that are to be done
        """
        pairs: dict[str, list[tuple[Task, Engine]]] = {}
        for job in left:
            if isinstance(job, CaseRun):
                pairs.setdefault(job.engine.adapter_key, []).append((job.task, job.engine))
        adapters = {e.adapter_key: e for e in self.work.engines.values() if describe_missing_package(e) is None}
        for key, engine in sorted(adapters.items()):
            yield AbilitiesJob(engine, tuple(pairs.get(key, ())))

    def find_refusal(self, job: Job) -> Attempt | None:
        """Return the attempt of an engine that has said that it cannot do a case, None where it can or has not said."""
        return self.refused.get(job.key) if isinstance(job, CaseRun) else None

    def list_compared_jobs(self, jobs: Iterable[CaseRun]) -> Iterator[CaseRun]:
        """Yield the runs of the reference, those that nothing is compared with as refused."""
        answered = {(run.mechanism, run.case) for run in self.results.runs if run.status == "ok"}
        for job in jobs:
            if job.case not in answered:
                self.refused[job.key] = make_skipped_attempt(job.task, job.engine, UNCOMPARED, "")
            yield job

    def list_refinements(self) -> list[RefinedRun]:
        """Return the runs of the reference, with finer steps and meshes, that comparisons need which are not judged yet."""
        engine = self.work.engines.get(REFERENCE)
        if engine is None:
            return []
        refinements = []
        for task in self.work.plan.tasks:
            key = task.folder.name, task.case.name
            rows = [row for row in self.results.comparisons if (row.mechanism, row.case) == key and is_open(row)]
            if not rows:
                continue
            had, record = self.finer.get(key) or (RefinementHalvings(), self._read_first_record(*key, REFERENCE))
            runs = [r for r in self.results.runs if (r.mechanism, r.case, r.engine) == (*key, REFERENCE)]
            elapsed = max((run.elapsed for run in runs), default=0.0)
            one = find_wanted_refinement(rows, record, had)
            if one is not None and elapsed * one.longer <= self.work.options.timeout:
                refinements.append(RefinedRun(task, engine, one))
        return refinements

    def _read_first_record(self, mechanism: str, case: str, engine: str) -> Record:
        """Return the record of a run as it was saved."""
        stems = {(r.mechanism, r.case, r.engine): self.out / r.series for r in self.results.runs if r.series}
        return read_saved_record(stems.get((mechanism, case, engine)), engine)

    def _judge_with_finer(self, task: Task, finer: RefinementHalvings, record: Record) -> None:
        """Judge open comparisons of a case anew, with a finer reference; where it failed they stay open."""
        key = task.folder.name, task.case.name
        if record.status != "ok":
            self.finer[key] = finer, Record(REFERENCE)  # nothing more is asked of it
            return
        self.finer[key] = finer, record
        engines = dict.fromkeys(
            row.engine for row in self.results.comparisons if (row.mechanism, row.case) == key and is_open(row)
        )
        records = {name: self._read_first_record(*key, name) for name in engines}
        fresh, _ = compare_all(task, {**records, REFERENCE: record})
        lines = [line for line in self.results.certificates if (line.mechanism, line.case) == key]
        rows = update_open_rows(self.results.comparisons, judge_by_certificate(fresh, lines))
        self.results = replace(self.results, comparisons=tuple(rows))

    def list_repeats(self) -> Iterator[RepeatedRun | ShakenRun]:
        """Yield the runs whose error bars explain a difference: they have to repeat; and those that seem worse than blessed."""
        rows = self.results.comparisons
        known = self.work.options.baseline
        wanted = {(c.mechanism, c.case, e) for c in rows if is_doubtful(c) for e in (c.engine, c.reference)}
        worse = {(c.mechanism, c.case, c.engine) for c in rows if baseline.is_worse(c, known)}
        for task in self.work.plan.tasks:
            for engine in self.work.engines.values():
                here = task.folder.name, task.case.name, engine.name
                if here in wanted:
                    yield RepeatedRun(task, engine)
                if here in worse:
                    yield from (ShakenRun(task, engine, way) for way in SHAKEN)

    def judge_repeats(self) -> None:
        """Judge what error bars explained by whether the engines repeat; state what last digits do where one seems worse."""
        rows = []
        for row in self.results.comparisons:
            if is_doubtful(row):
                again = self.again.get((row.mechanism, row.case), {})
                first = {e: self._read_first_record(row.mechanism, row.case, e) for e in (row.engine, row.reference)}
                row = judge_by_repetition(row, first, {e: again.get(e, UNREPEATED) for e in first})
            if baseline.is_worse(row, self.work.options.baseline):
                other = self._read_first_record(row.mechanism, row.case, row.reference)
                row = add_scatter(row, other, self.shaken.get((row.mechanism, row.case, row.engine), []))
            rows.append(row)
        self.results = replace(self.results, comparisons=tuple(rows))

    def list_cause_questions(self) -> Iterator[CauseJob]:
        """Yield what is asked once everything is compared: why engines deviate."""
        results = self._judge_by_baseline(None)
        yield from map(CauseJob, list_questions(results, self.work.plan, self.out, self.work.engines))

    def take(self, job: Job, answer: Answer) -> None:
        """Add one answer to the results."""
        match job, answer:
            case CaseRun(), Attempt():
                self._add_run(job, answer)
            case RefinedRun(), Attempt():
                self._judge_with_finer(job.task, job.halvings, answer.record)
            case RepeatedRun(), Attempt():
                self.again.setdefault(job.case, {})[job.engine.name] = answer.record
            case ShakenRun(), Attempt():
                self.shaken.setdefault(job.key, []).append(answer.record)
            case AbilitiesJob(), Abilities():
                self._add_abilities(job, answer)
            case StudyJob(), JsonAnswer():
                self._add_study(job, answer)
            case CauseJob(), JsonAnswer():
                diagnosis = read_diagnosis(job.deviation, answer.value, answer.ending.message)
                self.results = replace(self.results, diagnoses=(*self.results.diagnoses, diagnosis))
            case _:
                raise TypeError(f"{type(answer).__name__} is no answer to a {type(job).__name__}")
        self._write_results()

    def take_or_fail(self, job: Job, answer: Answer) -> None:
        """Add one answer to the results; where something of ours fails over it, that is an error of this job alone."""
        try:
            self.take(job, answer)
        except Exception as error:
            self._add_failure(f"run {job.label}" if isinstance(job, CaseRun) else job.label, error)
            if isinstance(job, CaseRun):
                self._add_failed_run(job, error)

    def add_failures(self, error: Exception) -> None:
        """Add a row for everything that did not come to its end because something of ours failed."""
        self._add_missing(f"not run: {describe_harness_failure(error)}")
        self._add_failure("the run ended early", error)

    def _add_failure(self, where: str, error: Exception) -> None:
        """Say in the results that something of ours failed, where, and in which line."""
        words = f"{where}: {describe_harness_failure(error)}"
        message = "; ".join(filter(None, [self.results.message, words]))
        trace = "".join(traceback.format_exception(error))
        settings = {**self.results.settings, f"failure of {where}": trace}
        self.results = replace(self.results, message=message, settings=settings)

    def _add_failed_run(self, job: CaseRun, error: Exception) -> None:
        """Make an error of the row of an engine, whose answer nothing is compared with."""
        attempt = job.make_failure(describe_harness_failure(error))
        others = [row for row in self.results.runs if (row.mechanism, row.case, row.engine) != job.key]
        failed = RunRow(*job.key, status="error", message=attempt.record.message)
        self.results = replace(self.results, runs=(*others, failed))
        self._add_record(job.task, attempt.record)

    def add_interrupted(self) -> None:
        """Add a row for everything that did not come to its end (what Ctrl-C met while it was taken has one already)."""
        self._add_missing(INTERRUPTED)
        self.results = replace(self.results, message="interrupted before everything was run")

    def _add_missing(self, words: str) -> None:
        """Add a row of an error with these words for every engine and study that has none; `finish` writes them."""
        self.pause = math.inf
        have = {(r.mechanism, r.case, r.engine) for r in self.results.runs} | {s.name for s in self.results.studies}
        for job in self.list_jobs():
            if isinstance(job, CaseRun) and job.key not in have:
                self.take_or_fail(job, job.make_failure(words))
            elif isinstance(job, StudyJob) and job.study.name not in have:
                row = StudyRow(job.study.name, job.study.title, status="error", message=words)
                self.results = replace(self.results, studies=(*self.results.studies, row))

    def add_troubles(self, trouble: Iterable[str], afresh: Mapping[str, str]) -> None:
        """Add what a reader has to know of kept answers, and of engines that are not forked, to the settings."""
        words = {"kept results": "; ".join(trouble)} if trouble else {}
        words |= {f"processes of {name}": f"each started afresh: {why}" for name, why in afresh.items()}
        self.results = replace(self.results, settings={**self.results.settings, **words})

    def write_results(self) -> Results:
        """Return the complete results, and write them; where that fails they say so."""
        order = list(self.work.engines)
        studies = [study.name for study in self.work.studies]
        cases = [(c.mechanism, c.case) for c in self.results.cases]

        def make_sort_key(row: RunRow | Comparison | Check | Diagnosis) -> tuple[int, int]:
            return cases.index((row.mechanism, row.case)), order.index(row.engine)

        self.results = replace(
            self.results,
            finished=not self.results.message,
            runs=tuple(sorted(self.results.runs, key=make_sort_key)),
            comparisons=tuple(sorted(self.results.comparisons, key=make_sort_key)),
            certificates=tuple(sorted(self.results.certificates, key=make_sort_key)),
            diagnoses=tuple(sorted(self.results.diagnoses, key=make_sort_key)),
            studies=tuple(sorted(self.results.studies, key=lambda row: studies.index(row.name))),
        )
        try:
            self.results = self._judge_by_baseline(self.work.options.scope if self.results.finished else None)
        except Exception as error:
            self._add_failure("the blessed night", error)
            self.results = replace(self.results, finished=False)
        try:
            self._write_results(at_once=True)
        except OSError as error:
            words = f"results.json could not be written: {error}"
            self.results = replace(
                self.results, finished=False, message="; ".join(filter(None, [self.results.message, words]))
            )
        return self.results

    def _judge_by_baseline(self, scope: Scope | None) -> Results:
        known = self.work.options.baseline
        return self.results if known is None else baseline.apply(self.results, known, scope, self.signals)

    def _add_run(self, job: CaseRun, attempt: Attempt) -> None:
        row = self._write_series(run_row(job.task, attempt), attempt.record)
        self.results = replace(self.results, runs=(*self.results.runs, row))
        if row.status == "ok":
            described = describe_signals(attempt.record, job.task.case.quantities)
            self.signals |= {(*job.key, name): one for name, one in described.items()}
        self._add_record(job.task, attempt.record)
        self._add_job_time(job.label, attempt.elapsed, attempt.kept)
        kept = f"unchanged since {attempt.kept}" if attempt.kept else ""
        self._send_event(job.label, row.verdict if row.status != "ok" else "ok", row.message or kept)

    def _add_record(self, task: Task, record: Record) -> None:
        """Add a record of a case; the last one has all of them compared, and where that fails the case says so."""
        case = task.folder.name, task.case.name
        records = self.records.setdefault(case, {})
        records[record.engine] = record
        if len(records) < len(self.work.engines):
            return
        del self.records[case]
        try:
            self._compare(task, records)
        except Exception as error:
            self._add_failure(f"the comparison of {'/'.join(case)}", error)
            words = describe_harness_failure(error)
            pairs = [(name, quantity) for name in records if name != REFERENCE for quantity in task.case.quantities]
            rows = [Comparison(*case, name, REFERENCE, quantity, "", "error", words) for name, quantity in pairs]
            self.results = replace(self.results, comparisons=(*self.results.comparisons, *rows))

    def _write_series(self, row: RunRow, record: Record) -> RunRow:
        """Write the series and return the row that says where they are, or why they could not be written."""
        if record.status != "ok":
            return row
        stem = f"series/{make_slug(f'{row.mechanism}-{row.case}')}/{make_slug(row.engine)}"
        try:
            (self.out / stem).parent.mkdir(parents=True, exist_ok=True)
            save(record, owned.add_record_to_list(self.out / stem))
        except OSError as error:
            return replace(row, status="error", message=f"its series could not be written: {error}")
        return replace(row, series=stem)

    def _compare(self, task: Task, records: Mapping[str, Record]) -> None:
        rows, idle = compare_all(task, records)
        lines = list_certificate_lines(task, records)
        cases = tuple(
            replace(c, unused_limits=idle) if (c.mechanism, c.case) == (task.folder.name, task.case.name) else c
            for c in self.results.cases
        )
        self.results = replace(
            self.results,
            cases=cases,
            comparisons=(*self.results.comparisons, *judge_by_certificate(rows, lines)),
            certificates=(*self.results.certificates, *lines),
        )

    def _add_abilities(self, job: AbilitiesJob, answer: Abilities) -> None:
        described = {"present": False} if answer.described is None else dict(answer.described)
        rows = []
        for row in self.results.engines:
            if self.work.engines[row.name].adapter_key == job.engine.adapter_key:
                row = replace(row, **described, message=answer.message or row.message)
            rows.append(row)
        self.results = replace(self.results, engines=tuple(rows))
        if answer.described is None:
            return
        for number, (task, engine) in enumerate(job.pairs):
            reason = answer.refused.get(number)
            if reason is not None:
                skipped = make_skipped_attempt(task, engine, reason, answer.described["version"])
                self.refused[task.folder.name, task.case.name, engine.name] = skipped

    def _add_study(self, job: StudyJob, answer: JsonAnswer) -> None:
        row = make_study_row(job.study, answer)
        self.results = replace(self.results, studies=(*self.results.studies, row))
        self._add_job_time(job.label, answer.ending.elapsed, answer.ending.kept)
        self._send_event(job.label, row.verdict, row.message)

    def _add_job_time(self, name: str, elapsed: float, kept: str) -> None:
        """Note how long a job took [s], where it ran."""
        if elapsed and not kept:
            self.seconds[name] = elapsed

    def _send_event(self, label: str, verdict: str, message: str) -> None:
        self.done += 1
        if self.pause == math.inf:  # what was not run is said once, by the report
            return
        total = len(self.work.plan.tasks) * len(self.work.engines) + len(self.work.studies)
        self.notify(Event(label, verdict, message, self.done, total))

    def _write_results(self, at_once: bool = False) -> None:
        elapsed = clock.monotonic() - self.start
        if not at_once and elapsed - self.written < self.pause:
            return
        self.results = replace(self.results, elapsed=elapsed)
        # A full disk must not end the night: what can be computed is computed, and the last writing tells.
        forgiven = () if at_once else (OSError,)
        with contextlib.suppress(*forgiven):
            store.write(self.results, self.out / RESULTS)
        self.written = clock.monotonic() - self.start
        self.pause = max(PAUSE, RARELY * (self.written - elapsed))
