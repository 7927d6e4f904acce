"""Stores of answers: those of a run that was cut short, of all runs before, and the times that jobs take."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from crosscheck.measures.record import RecordError, read_record
from crosscheck.run.abilities import Abilities
from crosscheck.run.answer_cache import AnswerCache
from crosscheck.run.isolation import ProcessEnd
from crosscheck.run.questions import Question
from crosscheck.run.run_cache import AttemptFolder
from crosscheck.run.run_state import Job, make_job_label
from crosscheck.run.work import Options
from crosscheck.verdicts.plan import Task

# [s], rough: the beginning of a process; a step of a rigid link and of a beam; a study.  They only order what never ran.
BEGIN = 0.1
RIGID = 1e-5
BEAM = 2e-3
STUDY = 30.0


@dataclass
class AnswerStores:
    """Answers of a run that was cut short (left), and of all runs before (kept, None: no such)."""

    options: Options
    interrupted_run: AttemptFolder
    cache: AnswerCache | None

    def find(self, job: Job) -> Any:
        """Return the answer to a job where it is there and wanted, else None."""
        kind, what, engine = job
        if (
            kind == "run"
            and self.options.resume
            and (result := self.interrupted_run.find(what, engine.name, self.options.engine))
        ):
            return result
        if self.cache is None or self.options.fresh:
            return None
        if kind == "run":
            return self.cache.find_attempt(what, engine)
        if kind == "abilities" and engine:  # there is something to be asked
            return None
        if (things := self._list_dependencies(job)) is None or (words := self.cache.find_values(kind, *things)) is None:
            return None
        if kind == "abilities":
            return Abilities(words["answer"])
        return words["answer"], ProcessEnd("ok", "", words["printed"], words["elapsed"], words["when"])

    def add_answer(self, job: Job, answer: Any) -> None:
        """Keep the answer to a job, for the case that this run is cut short, and for later runs."""
        kind, what, engine = job
        if kind == "run":
            with contextlib.suppress(OSError):  # a full disk: then there is nothing to resume from
                self.interrupted_run.add_answer(what, engine.name, answer, self.options.engine)
        if self.cache is None:
            return
        if kind == "run":
            self.cache.add_answer(what, engine, answer)
        elif (told := _convert_answer(kind, answer)) and (things := self._list_dependencies(job)) is not None:
            self.cache.add_values(told, kind, *things)

    def _list_dependencies(self, job: Job) -> tuple[object, ...] | None:
        """Return the things that an answer depends on beside those that all answers depend on; None: it is not kept."""
        kind, what, _ = job
        if self.cache is not None and kind == "study":
            return self.cache.list_study_dependencies(what)
        if self.cache is not None and kind == "why":
            return _list_question_dependencies(what, self.cache)
        return (what.adapter_key, what.door) if kind == "abilities" else None

    def find_expected_time(self, job: Job) -> float:
        """Return the time that a job may take [s]: as long as it took last, or an estimate."""
        kind, what, engine = job
        known = self._times.get(make_job_label(kind, what, engine))
        if known is not None:
            return known
        return compute_estimated_time(what) if isinstance(what, Task) else STUDY

    @cached_property
    def _times(self) -> Mapping[str, float]:
        return {} if self.cache is None else self.cache.read_times()


def compute_estimated_time(task: Task) -> float:
    """Return an estimate of the time that an engine takes for a case [s]."""
    steps = task.case.end / task.case.step
    return BEGIN + steps * (RIGID * len(task.mechanism.links) + BEAM * len(task.mechanism.beams))


def _convert_answer(kind: str, answer: Any) -> dict[str, Any] | None:
    """Return the part of an answer that is kept, None where it is none."""
    if kind == "abilities":
        return {"answer": answer.described} if answer.described and not answer.message else None
    if kind not in ("study", "why") or answer[1].status != "ok":
        return None
    return {"answer": answer[0], "printed": answer[1].printed, "elapsed": answer[1].elapsed}


def _list_question_dependencies(question: Question, cache: AnswerCache) -> tuple[object, ...] | None:
    """Return the things that an answer depends on: the case, and both records but for the time that they took."""
    told = dict(question.options)
    try:
        records = [read_record(Path(told.pop(side))) for side in ("ours", "theirs")]
    except RecordError:
        return None
    folder = Path(told.pop("folder"))
    return folder.name, cache.contents(folder), told, [replace(one, wall_time=0.0) for one in records]
