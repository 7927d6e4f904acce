"""Run every case in every engine, compare, and keep ``results.json`` true at every moment.

Threads drive child processes; this process imports no engine.  What finishes is written at once: a night that is
cut short leaves a report of everything that was done and a row for everything that was not.
"""

from __future__ import annotations

import contextlib
import time as clock
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from crosscheck import output_folder as owned
from crosscheck.engines import Engine, missing
from crosscheck.measures.record import Record, RecordError, load, save
from crosscheck.run.cluster import far, luggage, workers
from crosscheck.run.isolation import Attempt, Children, Ending, ask, run_engine
from crosscheck.run.questions import certificates, certified, diagnosis, questions
from crosscheck.run.result_rows import compare_all, run_row, study_row
from crosscheck.run.run_cache import Attempts
from crosscheck.studies import Study
from crosscheck.verdicts import baseline
from crosscheck.verdicts import results as store
from crosscheck.verdicts.baseline import Baseline
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.plan import Plan, Task, case_row
from crosscheck.verdicts.repeatability import SHAKEN, doubtful, repeated, scattered
from crosscheck.verdicts.results import CaseRow, EngineRow, Results, RunRow, StudyRow, slug

RESULTS = "results.json"
KEPT = "attempts"  # folder of what engines gave, until the run has finished
PAUSE = 2.0  # [s] between two writings of results.json at least
DESCRIBE = 120.0  # [s] to import an engine and ask its version: a cold disk takes some ten seconds


@dataclass(frozen=True)
class Options:
    """Options of a run: timeout [s] per engine and case, jobs at a time, options for the engines.

    scheduler : address of a Dask cluster, "" for this machine; resume : take what an interrupted run left in the folder
    baseline : the blessed night that judges beside the limits, or None; whole : everything runs, so what it misses is gone
    """

    timeout: float = 900.0
    jobs: int = 1
    engine: Mapping[str, Any] = field(default_factory=dict)
    scheduler: str = ""
    resume: bool = False
    baseline: Baseline | None = None
    whole: bool = False


@dataclass(frozen=True)
class Work:
    """Work of a run: cases, engines, studies and options."""

    plan: Plan
    engines: Mapping[str, Engine]
    studies: tuple[Study, ...] = ()
    options: Options = Options()


@dataclass(frozen=True)
class Event:
    """Something that finished, for a progress display."""

    label: str
    verdict: str
    message: str
    done: int
    total: int


Notify = Callable[[Event], None]
Job = tuple[str, Any, Any]  # kind, what, engine
# Kinds of jobs in which an engine runs: as it is, once more, and with the last digits of its input moved.
SHAKES = {f"shaken {way}": way for way in SHAKEN}
RUNS = ("run", "again", *SHAKES)


def run(work: Work, out: Path, notify: Notify = lambda event: None, command: str = "") -> Results:
    """Run what is to run and return its results, which stand in ``out/results.json`` as well.

    What an older run wrote into the folder is removed first, nothing else (`owned`).  Ctrl-C ends every child; what did not
    run becomes an error that says so.  Raises InputError where the folder is not ours, or another run writes there.
    """
    with owned.report(out):
        owned.begin(out, keep=KEPT if work.options.resume else "")
        return _run(work, out, notify, command)


def _run(work: Work, out: Path, notify: Notify, command: str) -> Results:
    options = work.options
    state = _State(work, out, notify, _opening(work, command))
    kept, children = Attempts(out / KEPT, work.engines), Children()
    with workers(options.scheduler, options.jobs) as pool, ThreadPoolExecutor(max(1, options.jobs)) as here:
        pending: dict[Future[Any], Job] = {}
        try:
            for job in state.jobs():
                if (found := _found(job, kept, options)) is not None:
                    state.take(job, found)
                else:
                    pending[_submit(pool, job, options, children)] = job
            _drain(pending, state, kept)
            pending = {_submit(pool, job, options, children): job for job in state.repeats()}
            _drain(pending, state, kept)
            state.repeated()
            pending = {here.submit(_do, job, options, children): job for job in state.questions()}
            _drain(pending, state, kept)
        except KeyboardInterrupt:
            children.stop()
            for future in pending:
                future.cancel()
            state.interrupted(pending)
    results = state.finish()
    if results.finished:
        with contextlib.suppress(OSError):
            owned.remove(out, below=KEPT)
    return results


def _submit(pool: Executor, job: Job, options: Options, children: Children) -> Future[Any]:
    if options.scheduler:
        return pool.submit(far, _do, job, luggage(job[1]), replace(options, baseline=None))
    return pool.submit(_do, job, options, children)


def _found(job: Job, kept: Attempts, options: Options) -> Attempt | None:
    """Return the attempt that an interrupted run left of a job, where that is wanted."""
    kind, what, engine = job
    return kept.find(what, engine.name, options.engine) if options.resume and kind == "run" else None


def _drain(pending: dict[Future[Any], Job], state: _State, kept: Attempts) -> None:
    while pending:
        for future in wait(pending, return_when=FIRST_COMPLETED).done:
            job = pending[future]
            answer = _answer(future, job)
            state.take(job, answer)
            del pending[future]
            if job[0] == "run":
                with contextlib.suppress(OSError):  # a full disk: then there is nothing to resume from
                    kept.keep(job[1], job[2].name, answer, state.work.options.engine)


def _answer(future: Future[Any], job: Job) -> Any:
    """Return the answer of a job, or that it has none: the cluster lost it."""
    try:
        return future.result()
    except Exception as error:
        return _failed(job, error)


def _do(job: Job, options: Options, children: Children) -> Any:
    """Do one job in a child process (runs in a thread); where even that fails, say so and go on (a full disk)."""
    try:
        return _ask(job, options, children)
    except Exception as error:
        return _failed(job, error)


def _failed(job: Job, error: Exception) -> Any:
    words = f"the harness failed: {type(error).__name__}: {error}"
    if job[0] in RUNS:
        return Attempt(Record(engine=job[2].name, status="error", message=words))
    return None, Ending("error", words, "", 0.0)


def _ask(job: Job, options: Options, children: Children) -> Any:
    kind, what, engine = job
    if kind == "describe":
        return ask({"kind": "describe", "engine": what.name, **what.door}, DESCRIBE, children)
    if kind == "study":
        question = {"kind": "study", "module": what.module, "function": what.function, "options": dict(what.options)}
        return ask(question, options.timeout, children)
    if kind == "why":
        return ask(what.job, options.timeout, children)
    told = dict(options.engine) | ({"certificate": False} if kind != "run" else {})
    told |= {"shake": SHAKES[kind], "error": False} if kind in SHAKES else {}
    task = {"mechanism": str(what.folder.resolve()), "case": what.case.name, "options": told}
    return run_engine(engine, task, what.time, options.timeout, children)


@dataclass
class _State:
    """State of a run: results and records so far; only the main thread touches it."""

    work: Work
    out: Path
    notify: Notify
    results: Results
    start: float = field(default_factory=clock.monotonic)
    written: float = 0.0
    done: int = 0
    records: dict[tuple[str, str], dict[str, Record]] = field(default_factory=dict)
    again: dict[tuple[str, str], dict[str, Record]] = field(default_factory=dict)
    shaken: dict[tuple[str, str, str], list[Record]] = field(default_factory=dict)

    def jobs(self) -> Iterator[Job]:
        """Yield everything there is to do, case by case so that comparisons come early."""
        adapters = {e.adapter_key: e for e in self.work.engines.values() if missing(e) is None}
        for _, engine in sorted(adapters.items()):
            yield "describe", engine, None
        for task in self.work.plan.tasks:
            for engine in self.work.engines.values():
                yield "run", task, engine
        for study in self.work.studies:
            yield "study", study, None

    def repeats(self) -> Iterator[Job]:
        """Yield the runs whose error bars explain a difference: they have to repeat; and those that seem worse than blessed."""
        rows, known = self.results.comparisons, self.work.options.baseline
        wanted = {(c.mechanism, c.case, e) for c in rows if doubtful(c) for e in (c.engine, c.reference)}
        worse = {(c.mechanism, c.case, c.engine) for c in rows if baseline.is_worse(c, known)}
        for task in self.work.plan.tasks:
            for engine in self.work.engines.values():
                here = task.folder.name, task.case.name, engine.name
                for kind in (*(("again",) if here in wanted else ()), *(SHAKES if here in worse else ())):
                    yield kind, task, engine

    def repeated(self) -> None:
        """Judge what error bars explained by whether the engines repeat; state what last digits do where one seems worse."""
        stems = {(r.mechanism, r.case, r.engine): self.out / r.series for r in self.results.runs if r.series}
        rows = []
        for row in self.results.comparisons:
            if doubtful(row):
                again = self.again.get((row.mechanism, row.case), {})
                first = {e: _loaded(stems.get((row.mechanism, row.case, e)), e) for e in (row.engine, row.reference)}
                row = repeated(row, first, {e: again.get(e, UNREPEATED) for e in first})
            if baseline.is_worse(row, self.work.options.baseline):
                other = _loaded(stems.get((row.mechanism, row.case, row.reference)), row.reference)
                row = scattered(row, other, self.shaken.get((row.mechanism, row.case, row.engine), []))
            rows.append(row)
        self.results = replace(self.results, comparisons=tuple(rows))

    def questions(self) -> Iterator[Job]:
        """Yield what is asked once everything is compared: why engines deviate."""
        for question in questions(self._judged(whole=False), self.work.plan, self.out, self.work.engines):
            yield "why", question, None

    def take(self, job: Job, answer: Any) -> None:
        """Add one answer to the results."""
        kind, what, engine = job
        if kind == "describe":
            self._describe(what, *answer)
        elif kind == "study":
            self._study(what, *answer)
        elif kind == "why":
            found = diagnosis(what, answer[0], answer[1].message)
            self.results = replace(self.results, diagnoses=(*self.results.diagnoses, found))
        elif kind == "again":
            self.again.setdefault((what.folder.name, what.case.name), {})[engine.name] = answer.record
        elif kind in SHAKES:
            self.shaken.setdefault((what.folder.name, what.case.name, engine.name), []).append(answer.record)
        else:
            self._run(what, engine, answer)
        self._keep()

    def interrupted(self, pending: Mapping[Future[Any], Job]) -> None:
        """Add a row for everything that did not come to its end (what Ctrl-C met while it was taken has one already)."""
        have = {(r.mechanism, r.case, r.engine) for r in self.results.runs} | {s.name for s in self.results.studies}
        for kind, what, engine in pending.values():
            name = (what.folder.name, what.case.name, engine.name) if kind == "run" else getattr(what, "name", "")
            if name in have:
                continue
            if kind == "run":
                failed = Record(engine=engine.name, status="error", message="interrupted")
                self._run(what, engine, Attempt(failed))
            elif kind == "study":
                row = StudyRow(what.name, what.title, status="error", message="interrupted")
                self.results = replace(self.results, studies=(*self.results.studies, row))
        self.results = replace(self.results, message="interrupted before everything was run")

    def finish(self) -> Results:
        """Return the complete results, and write them; where that fails they say so."""
        order = list(self.work.engines)
        cases = [(c.mechanism, c.case) for c in self.results.cases]

        def place(row: RunRow | Comparison) -> tuple[int, int]:
            return cases.index((row.mechanism, row.case)), order.index(row.engine)

        self.results = replace(
            self.results,
            finished=not self.results.message,
            runs=tuple(sorted(self.results.runs, key=place)),
            comparisons=tuple(sorted(self.results.comparisons, key=place)),
        )
        self.results = self._judged(self.work.options.whole and self.results.finished)
        try:
            self._keep(at_once=True)
        except OSError as error:
            words = f"results.json could not be written: {error}"
            self.results = replace(
                self.results, finished=False, message="; ".join(filter(None, [self.results.message, words]))
            )
        return self.results

    def _judged(self, whole: bool) -> Results:
        known = self.work.options.baseline
        return self.results if known is None else baseline.apply(self.results, known, whole)

    def _run(self, task: Task, engine: Engine, attempt: Attempt) -> None:
        key = (task.folder.name, task.case.name)
        row = self._saved(run_row(task, attempt), attempt.record)
        self.results = replace(self.results, runs=(*self.results.runs, row))
        records = self.records.setdefault(key, {})
        records[engine.name] = attempt.record
        if len(records) == len(self.work.engines):
            self._compare(task, self.records.pop(key))
        self._tell(f"{key[0]}/{key[1]} {engine.name}", row.verdict if row.status != "ok" else "ok", row.message)

    def _saved(self, row: RunRow, record: Record) -> RunRow:
        """Write the series and return the row that says where they are, or why they could not be written."""
        if record.status != "ok":
            return row
        stem = f"series/{slug(f'{row.mechanism}-{row.case}')}/{slug(row.engine)}"
        try:
            (self.out / stem).parent.mkdir(parents=True, exist_ok=True)
            save(record, owned.claim_record(self.out / stem))
        except OSError as error:
            return replace(row, status="error", message=f"its series could not be written: {error}")
        return replace(row, series=stem)

    def _compare(self, task: Task, records: Mapping[str, Record]) -> None:
        rows, idle = compare_all(task, records)
        lines = certificates(task, records)
        cases = tuple(
            replace(c, unused_limits=idle) if (c.mechanism, c.case) == (task.folder.name, task.case.name) else c
            for c in self.results.cases
        )
        self.results = replace(
            self.results,
            cases=cases,
            comparisons=(*self.results.comparisons, *certified(rows, lines)),
            certificates=(*self.results.certificates, *lines),
        )

    def _describe(self, engine: Engine, answer: Any, ending: Any) -> None:
        rows = []
        for row in self.results.engines:
            if self.work.engines[row.name].adapter_key == engine.adapter_key:
                row = replace(row, **answer) if answer else replace(row, present=False, message=ending.message)
            rows.append(row)
        self.results = replace(self.results, engines=tuple(rows))

    def _study(self, study: Study, answer: Any, ending: Any) -> None:
        row = study_row(study, answer, ending)
        self.results = replace(self.results, studies=(*self.results.studies, row))
        self._tell(f"study {study.name}", row.verdict, row.message)

    def _tell(self, label: str, verdict: str, message: str) -> None:
        self.done += 1
        total = len(self.work.plan.tasks) * len(self.work.engines) + len(self.work.studies)
        self.notify(Event(label, verdict, message, self.done, total))

    def _keep(self, at_once: bool = False) -> None:
        elapsed = clock.monotonic() - self.start
        if at_once or elapsed - self.written >= PAUSE:
            self.results = replace(self.results, elapsed=elapsed)
            self.written = elapsed
            # A full disk must not end the night: what can be computed is computed, and the last writing tells.
            forgiven = () if at_once else (OSError,)
            with contextlib.suppress(*forgiven):
                store.write(self.results, self.out / RESULTS)


UNREPEATED = Record("", status="error", message="interrupted")


def _loaded(stem: Path | None, engine: str) -> Record:
    """Return a record that was saved; what cannot be read any more cannot be repeated."""
    try:
        return load(stem) if stem is not None else Record(engine)
    except RecordError:
        return Record(engine)


def _opening(work: Work, command: str) -> Results:
    plan, options = work.plan, work.options
    broken = [CaseRow(name, "", problem=message) for name, message in plan.broken]
    rows = [EngineRow(e.name, (m := missing(e)) is None, message=m or "") for e in work.engines.values()]
    return Results(
        started=store.now(),
        command=command,
        settings={"timeout": options.timeout, "jobs": options.jobs, "options": dict(options.engine)},
        machine=store.machine(),
        versions=store.versions(),
        engines=tuple(rows),
        cases=(*broken, *(case_row(task) for task in plan.tasks)),
    )
