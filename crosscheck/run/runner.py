"""Run every case in every engine, compare, and keep ``results.json`` true at every moment.

Threads drive child processes; this process imports no engine.  First every engine is asked, once, what it can do in all
cases; then what it can is done, the longest first.  What finishes is written at once: a night that is cut short leaves a
report of everything that was done and a row for everything that was not.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

from crosscheck import output_folder as owned
from crosscheck.run.answer_cache import AnswerCache
from crosscheck.run.answer_stores import AnswerStores
from crosscheck.run.cluster import open_workers, read_task_files, run_on_worker
from crosscheck.run.forking import KEPT_SERVERS
from crosscheck.run.isolation import ChildProcesses
from crosscheck.run.jobs import (
    Answer,
    CaseCausesJob,
    CaseRun,
    EngineJob,
    Job,
    JsonAnswer,
    StudyJob,
    describe_harness_failure,
    is_of_reference,
)
from crosscheck.run.questions import split_by_case
from crosscheck.run.result_rows import begin_results
from crosscheck.run.run_cache import AttemptFolder
from crosscheck.run.run_state import RunState
from crosscheck.run.work import Notify, Options, Work
from crosscheck.verdicts.results import Results

KEPT = "attempts"  # folder of what engines gave, until the run has finished
AnyJob = TypeVar("AnyJob", bound=Job)
Tell = Callable[[str], None]  # is given a line that a reader at the terminal has to know


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
    with (
        KEPT_SERVERS.open_servers() as servers,
        open_workers(options.scheduler, options.jobs, tell) as pool,
        ThreadPoolExecutor(max(1, options.jobs)) as here,
    ):
        under_way = RunningJobs(pool, here, options, ChildProcesses(servers=servers), stores)
        try:
            _run_stages(state, under_way)
        except KeyboardInterrupt:
            under_way.end_processes()
            state.add_interrupted()
        except Exception as error:  # of ours: what has finished is reported all the same
            under_way.end_processes()
            state.add_failures(error)
        refusals = servers.refusals
    state.add_troubles(kept.trouble if kept is not None else (), refusals)
    results = state.write_results()
    if kept is not None:
        kept.close(state.seconds)
    if results.finished:
        with contextlib.suppress(OSError):
            owned.remove(out, below=KEPT)
    return results


def _run_stages(state: RunState, under_way: RunningJobs) -> None:
    """Take what is kept, ask what engines can do, run what they can, then repeat and ask why where that is called for."""
    left = under_way.take_known_answers(state, state.list_jobs())
    under_way.run_jobs(state, under_way.take_known_answers(state, state.list_ability_questions(left)))
    able = sorted(
        under_way.take_refusals(state, left),
        key=under_way.stores.find_expected_time,
        reverse=not under_way.options.climbing,
    )
    if under_way.options.climbing:
        under_way.run_jobs(state, [job for job in able if not is_of_reference(job)])
        references = [job for job in able if isinstance(job, CaseRun) and is_of_reference(job)]
        able = under_way.take_refusals(state, state.list_compared_jobs(references))
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
    left = under_way.take_known_answers(state, state.list_cause_questions())
    together = split_by_case(job.deviation for job in left)
    under_way.run_jobs(state, [CaseCausesJob(several) for several in together])
    answered = {(one.mechanism, one.case, one.engine) for one in state.results.diagnoses}
    under_way.run_jobs(state, [job for job in left if job.deviation.place[:3] not in answered])


@dataclass
class RunningJobs:
    """The jobs under way: executors of engines and of what runs on this machine in any case, processes, and what is kept."""

    pool: Executor
    here: Executor
    options: Options
    children: ChildProcesses
    stores: AnswerStores
    pending: dict[Future[Answer], Job] = field(default_factory=dict)

    def take_known_answers(self, state: RunState, jobs: Iterable[AnyJob]) -> list[AnyJob]:
        """Take the answers to jobs that are kept, and return the other jobs."""
        left = []
        for job in jobs:
            answer = self.stores.find(job)
            if answer is None:
                left.append(job)
            else:
                state.take_or_fail(job, answer)
        return left

    def take_refusals(self, state: RunState, jobs: Iterable[Job]) -> list[Job]:
        """Take that engines cannot do cases, as they have said, and return the other jobs."""
        left = []
        for job in jobs:
            refusal = state.find_refusal(job)
            if refusal is None:
                left.append(job)
            else:
                self.stores.add_answer(job, refusal)
                state.take_or_fail(job, refusal)
        return left

    def run_jobs(self, state: RunState, jobs: Iterable[Job]) -> None:
        """Do jobs, in their order as far as there are hands, and take and keep what each gives as it comes."""
        wanted = list(jobs)
        if wanted and not self.options.scheduler:
            self.children.begin_common()
        self.pending = {self._begin_job(job): job for job in wanted}
        while self.pending:
            for future in wait(self.pending, return_when=FIRST_COMPLETED).done:
                job = self.pending[future]
                answer = _read_answer(future, job)
                for part, said in _split_answer(job, answer):
                    self.stores.add_answer(part, said)  # first, so that a run resumes what an interruption finds told
                    state.take_or_fail(part, said)
                del self.pending[future]

    def _begin_job(self, job: Job) -> Future[Answer]:
        if not self.options.scheduler:
            return self.pool.submit(_run_job, job, self.options, self.children)
        if isinstance(job, EngineJob | StudyJob):
            lean = replace(self.options, baseline=None)
            return self.pool.submit(run_on_worker, _run_job, job, read_task_files(job), lean)
        return self.here.submit(_run_job, job, self.options, self.children)

    def end_processes(self) -> None:
        """End every process, and start no more."""
        self.children.end_processes()
        for future in self.pending:
            future.cancel()


def _split_answer(job: Job, answer: Answer) -> Sequence[tuple[Job, Answer]]:
    """Return a job with its answer; of one that asks for several engines those that have an answer, each alone."""
    if isinstance(job, CaseCausesJob) and isinstance(answer, JsonAnswer):
        return job.split_answer(answer)
    return [(job, answer)]


def _read_answer(future: Future[Answer], job: Job) -> Answer:
    """Return the answer of a job, or that it has none: the cluster lost it."""
    try:
        return future.result()
    except Exception as error:
        return job.make_failure(describe_harness_failure(error))


def _run_job(job: Job, options: Options, children: ChildProcesses) -> Answer:
    """Do one job in a child process (runs in a thread); where even that fails, say so and go on (a full disk)."""
    try:
        return job.run(options, children)
    except Exception as error:
        return job.make_failure(describe_harness_failure(error))
