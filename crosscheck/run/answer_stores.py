"""Stores of answers: those of a run that was cut short, of all runs before, and the times that jobs take."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NotRequired, TypedDict

from crosscheck.measures.record import RecordError, read_record
from crosscheck.run.abilities import Abilities
from crosscheck.run.answer_cache import AnswerCache
from crosscheck.run.isolation import Attempt, ProcessEnd
from crosscheck.run.jobs import AbilitiesJob, Answer, CaseRun, CauseJob, EngineJob, Job, JsonAnswer, StudyJob
from crosscheck.run.questions import Question
from crosscheck.run.run_cache import AttemptFolder
from crosscheck.run.work import Options
from crosscheck.verdicts.plan import Task

# [s], rough: the beginning of a process; a step of a rigid link and of a beam; a study.  They only order what never ran.
BEGIN = 0.1
RIGID = 1e-5
BEAM = 2e-3
STUDY = 30.0


class KeptAnswer(TypedDict):
    """An answer as it is kept; answer : JSON of a study, a diagnosis or an adapter, printed, elapsed [s] : of its process."""

    answer: Any
    printed: NotRequired[str]
    elapsed: NotRequired[float]


@dataclass
class AnswerStores:
    """Answers of a run that was cut short (left), and of all runs before (kept, None: no such)."""

    options: Options
    interrupted_run: AttemptFolder
    cache: AnswerCache | None

    def find(self, job: Job) -> Answer | None:
        """Return the answer to a job where it is there and wanted, else None."""
        if isinstance(job, CaseRun) and self.options.resume:
            attempt = self.interrupted_run.find(job.task, job.engine.name, self.options.engine)
            if attempt is not None:
                return attempt
        if self.cache is None or self.options.fresh:
            return None
        if isinstance(job, CaseRun):
            return self.cache.find_attempt(job.task, job.engine)
        if isinstance(job, AbilitiesJob) and job.pairs:  # there is something to be asked
            return None
        dependencies = _list_dependencies(job, self.cache)
        values = None if dependencies is None else self.cache.find_values(job.kind, *dependencies)
        if values is None:
            return None
        if isinstance(job, AbilitiesJob):
            return Abilities(values["answer"])
        return JsonAnswer(values["answer"], ProcessEnd("ok", "", values["printed"], values["elapsed"], values["when"]))

    def add_answer(self, job: Job, answer: Answer) -> None:
        """Keep the answer to a job, for the case that this run is cut short, and for later runs."""
        if isinstance(job, CaseRun) and isinstance(answer, Attempt):
            with contextlib.suppress(OSError):  # a full disk: then there is nothing to resume from
                self.interrupted_run.add_answer(job.task, job.engine.name, answer, self.options.engine)
            if self.cache is not None:
                self.cache.add_answer(job.task, job.engine, answer)
            return
        values = _convert_answer(answer)
        if self.cache is None or not values:
            return
        dependencies = _list_dependencies(job, self.cache)
        if dependencies is not None:
            self.cache.add_values(values, job.kind, *dependencies)

    def find_expected_time(self, job: Job) -> float:
        """Return the time that a job may take [s]: as long as it took last, or an estimate."""
        known = self._times.get(job.label)
        if known is not None:
            return known
        return compute_estimated_time(job.task) if isinstance(job, EngineJob) else STUDY

    @cached_property
    def _times(self) -> Mapping[str, float]:
        return {} if self.cache is None else self.cache.read_times()


def compute_estimated_time(task: Task) -> float:
    """Return an estimate of the time that an engine takes for a case [s]."""
    steps = task.case.end / task.case.step
    return BEGIN + steps * (RIGID * len(task.mechanism.links) + BEAM * len(task.mechanism.beams))


def _convert_answer(answer: Answer) -> KeptAnswer | None:
    """Return the part of an answer that is kept beside attempts, None where it is none."""
    if isinstance(answer, Abilities):
        return {"answer": answer.described} if answer.described and not answer.message else None
    if isinstance(answer, JsonAnswer) and answer.ending.status == "ok":
        return {"answer": answer.value, "printed": answer.ending.printed, "elapsed": answer.ending.elapsed}
    return None


def _list_dependencies(job: Job, cache: AnswerCache) -> tuple[object, ...] | None:
    """Return the things that an answer depends on beside those that all answers depend on; None: it is not kept."""
    if isinstance(job, StudyJob):
        return cache.list_study_dependencies(job.study)
    if isinstance(job, CauseJob):
        return _list_question_dependencies(job.deviation, cache)
    if isinstance(job, AbilitiesJob):
        return job.engine.adapter_key, job.engine.door
    return None


def _list_question_dependencies(question: Question, cache: AnswerCache) -> tuple[object, ...] | None:
    """Return the things that an answer depends on: the case, and both records but for the time that they took."""
    options = question.options
    try:
        records = [read_record(Path(stem)) for stem in (options["ours"], options["theirs"])]
    except RecordError:
        return None
    folder = Path(options["folder"])
    rest = {key: value for key, value in options.items() if key not in ("ours", "theirs", "folder")}
    return folder.name, cache.contents(folder), rest, [replace(one, wall_time=0.0) for one in records]
