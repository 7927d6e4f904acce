"""Run every case in every engine, compare, and keep ``results.json`` true at every moment.

Threads drive child processes; this process imports no engine.  First every engine is asked, once, what it can do in all
cases; then what it can is done, the longest first.  What finishes is written at once: a night that is cut short leaves a
report of everything that was done and a row for everything that was not.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from crosscheck import output_folder as owned
from crosscheck.measures.record import Record
from crosscheck.run.abilities import Abilities, ask_abilities
from crosscheck.run.answer_cache import AnswerCache
from crosscheck.run.answer_stores import AnswerStores
from crosscheck.run.cluster import open_workers, read_task_files, run_on_worker
from crosscheck.run.forking import ForkServers
from crosscheck.run.isolation import Attempt, ChildProcesses, ProcessEnd, ask, run_engine
from crosscheck.run.questions import split_by_case
from crosscheck.run.result_rows import begin_results
from crosscheck.run.run_cache import AttemptFolder
from crosscheck.run.run_state import SHAKES, Job, RunState
from crosscheck.run.work import Notify, Options, Work
from crosscheck.verdicts.refinement import read_kind
from crosscheck.verdicts.results import Results

KEPT = "attempts"  # folder of what engines gave, until the run has finished
Tell = Callable[[str], None]  # is given a line that a reader at the terminal has to know
RUNS = ("run", "again", *SHAKES)  # kinds of jobs in which an engine runs, beside those of a finer reference


def run(
    work: Work, out: Path, notify: Notify = lambda event: None, command: str = "", tell: Tell = lambda line: None
) -> Results:
    """Run what is to run and return its results, which stand in ``out/results.json`` as well.

    What an older run wrote into the folder is removed first, nothing else (`owned`).  Ctrl-C ends every child; what did not
    run becomes an error that says so.  Raises InputError where the folder is not ours, or another run writes there.
    """
    with owned.open_report_folder(out):
        owned.begin(out, keep=KEPT if work.options.resume else "")
        return _run(work, out, notify, command, tell)


def _run(work: Work, out: Path, notify: Notify, command: str, tell: Tell) -> Results:
    options = work.options
    state = RunState(work, out, notify, begin_results(work, command))
    kept = AnswerCache(options.kept, options.engine) if options.kept is not None else None
    stores = AnswerStores(options, AttemptFolder(out / KEPT, work.engines), kept)
    servers = ForkServers()
    with open_workers(options.scheduler, options.jobs, tell) as pool, ThreadPoolExecutor(max(1, options.jobs)) as here:
        under_way = RunningJobs(pool, here, options, ChildProcesses(servers=servers), stores)
        try:
            _run_stages(state, under_way)
        except KeyboardInterrupt:
            under_way.end_processes()
            state.add_interrupted()
        except Exception as error:  # of ours: what has finished is reported all the same
            under_way.end_processes()
            state.add_failures(error)
        finally:
            servers.close()
    state.add_troubles(kept.trouble if kept is not None else (), servers.refusals)
    results = state.write_results()
    if kept is not None:
        kept.close(state.seconds)
    if results.finished:
        with contextlib.suppress(OSError):
            owned.remove(out, below=KEPT)
    return results


def _run_stages(state: RunState, under_way: RunningJobs) -> None:
    """Take what is kept, ask what engines can do, run what they can, then repeat and ask why where that is called for."""
    known_answers = under_way.take_known_answers(state, state.list_jobs())
    under_way.run_jobs(state, under_way.take_known_answers(state, state.list_ability_questions(known_answers)))
    able = sorted(
        under_way.take_refusals(state, known_answers),
        key=under_way.stores.find_expected_time,
        reverse=not under_way.options.climbing,
    )
    if under_way.options.climbing:
        under_way.run_jobs(state, [job for job in able if not state.is_of_reference(job)])
        able = under_way.take_refusals(
            state, state.list_compared_jobs(job for job in able if state.is_of_reference(job))
        )
    under_way.run_jobs(state, able)
    if not under_way.options.asking:
        return
    while finer := state.list_refinements():
        under_way.run_jobs(state, finer)
    under_way.run_jobs(state, state.list_repeats())
    state.judge_repeats()
    _ask_why(state, under_way)


def _ask_why(state: RunState, under_way: RunningJobs) -> None:
    """Have what deviates diagnosed, the engines of a case in one process; what that leaves open is asked alone."""
    known_answers = under_way.take_known_answers(state, state.list_cause_questions())
    together = split_by_case(question for _, question, _ in known_answers)
    under_way.run_jobs(state, [("why together", several, None) for several in together])
    answered = {(one.mechanism, one.case, one.engine) for one in state.results.diagnoses}
    under_way.run_jobs(state, [job for job in known_answers if job[1].place[:3] not in answered])


@dataclass
class RunningJobs:
    """The jobs under way: executors of engines and of what runs on this machine in any case, processes, and what is kept."""

    pool: Executor
    here: Executor
    options: Options
    children: ChildProcesses
    stores: AnswerStores
    pending: dict[Future[Any], Job] = field(default_factory=dict)

    def take_known_answers(self, state: RunState, jobs: Iterable[Job]) -> list[Job]:
        """Take the answers to jobs that are kept, and return the other jobs."""
        known_answers = []
        for job in jobs:
            if (found := self.stores.find(job)) is None:
                known_answers.append(job)
            else:
                state.take_or_fail(job, found)
        return known_answers

    def take_refusals(self, state: RunState, jobs: Iterable[Job]) -> list[Job]:
        """Take that engines cannot do cases, as they have said, and return the other jobs."""
        refusals = []
        for job in jobs:
            if (no := state.find_refusal(job)) is None:
                refusals.append(job)
            else:
                self.stores.add_answer(job, no)
                state.take_or_fail(job, no)
        return refusals

    def run_jobs(self, state: RunState, jobs: Iterable[Job]) -> None:
        """Do jobs, in their order as far as there are hands, and take and keep what each gives as it comes."""
        self.pending = {self._begin_job(job): job for job in jobs}
        while self.pending:
            for future in wait(self.pending, return_when=FIRST_COMPLETED).done:
                job = self.pending[future]
                answer = _read_answer(future, job)
                for part, said in _split_answer(job, answer):
                    self.stores.add_answer(part, said)  # first, so that a run resumes what an interruption finds told
                    state.take_or_fail(part, said)
                del self.pending[future]

    def _begin_job(self, job: Job) -> Future[Any]:
        if (_needs_engine(job[0]) or job[0] == "study") and self.options.scheduler:
            lean = replace(self.options, baseline=None)
            return self.pool.submit(run_on_worker, _run_job, job, read_task_files(job[1]), lean)
        pool = self.here if self.options.scheduler else self.pool
        return pool.submit(_run_job, job, self.options, self.children)

    def end_processes(self) -> None:
        """End every process, and start no more."""
        self.children.end_processes()
        for future in self.pending:
            future.cancel()


def _needs_engine(kind: str) -> bool:
    """Return True for the kinds of jobs in which an engine runs."""
    return kind in RUNS or read_kind(kind) is not None


def _split_answer(job: Job, answer: Any) -> list[tuple[Job, Any]]:
    """Return a job with its answer; of one that asks for several engines those that have an answer, each alone."""
    kind, what, _ = job
    if kind != "why together":
        return [(job, answer)]
    told, ending = answer
    answers = told["answers"] if told else []
    each = replace(ending, elapsed=ending.elapsed / max(len(answers), 1))
    pairs = zip(what.questions, answers, strict=False)
    return [(("why", question, None), (one, each)) for question, one in pairs if one is not None]


def _read_answer(future: Future[Any], job: Job) -> Any:
    """Return the answer of a job, or that it has none: the cluster lost it."""
    try:
        return future.result()
    except Exception as error:
        return _make_failure(job, error)


def _run_job(job: Job, options: Options, children: ChildProcesses) -> Any:
    """Do one job in a child process (runs in a thread); where even that fails, say so and go on (a full disk)."""
    try:
        return _ask(job, options, children)
    except Exception as error:
        return _make_failure(job, error)


def _make_failure(job: Job, error: Exception) -> Any:
    words = f"the harness failed: {type(error).__name__}: {error}"
    if _needs_engine(job[0]):
        return Attempt(Record(engine=job[2].name, status="error", message=words))
    if job[0] == "abilities":
        return Abilities(None, message=words)
    return None, ProcessEnd("error", words, "", 0.0)


def _ask(job: Job, options: Options, children: ChildProcesses) -> Any:
    kind, what, engine = job
    if kind == "abilities":
        return ask_abilities(what, engine, children)
    if kind == "study":
        question = {"kind": "study", "module": what.module, "function": what.function, "path": what.path}
        question |= {"options": dict(what.options)}
        return ask(question, options.timeout, children)
    if kind == "why":
        return ask(what.job, options.timeout, children)
    if kind == "why together":
        return ask(what.job, options.timeout * len(what.questions), children)
    told = dict(options.engine) | ({"certificate": False} if kind != "run" else {})
    told |= {"shake": SHAKES[kind], "error": False} if kind in SHAKES else {}
    told |= finer.options if (finer := read_kind(kind)) is not None else {}
    task = {"mechanism": str(what.folder.resolve()), "case": what.case.name, "options": told}
    if kind == "again":  # in a process that shares nothing with the first, not even what it was forked from
        task |= {"afresh": True}
    return run_engine(engine, task, what.time, options.timeout, children)
