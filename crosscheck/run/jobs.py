"""Jobs of a run: what engines, adapters, studies and diagnoses are asked, each in a child process.

A job says what it is called, does its work, and makes the answer that stands for it where even that fails.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypedDict

from crosscheck.engines import Engine
from crosscheck.engines.base import Options as EngineOptions
from crosscheck.engines.job_files import CaseRequest, StudyRequest
from crosscheck.measures.limits import REFERENCE
from crosscheck.measures.record import Record
from crosscheck.run.abilities import Abilities, Pair, ask_abilities
from crosscheck.run.isolation import Attempt, ChildProcesses, ProcessEnd, ask, run_engine
from crosscheck.run.questions import CaseQuestions, Question
from crosscheck.run.work import Options, Study
from crosscheck.verdicts.plan import Task
from crosscheck.verdicts.refinement import RefinementHalvings


@dataclass(frozen=True)
class JsonAnswer:
    """Answer of a child process: its JSON value, None where there is none, and how the process ended."""

    value: Any
    ending: ProcessEnd


class ProcessOptions(TypedDict, total=False):
    """Options of the process of a run; afresh : it is not forked."""

    afresh: bool


@dataclass(frozen=True)
class EngineJob:
    """A run of one engine at one case; its subclasses say with which options."""

    task: Task
    engine: Engine
    kind: ClassVar[str]

    @property
    def label(self) -> str:
        """The name of the job: "four_bar/turn mujoco"."""
        return f"{'/'.join(self.case)} {self.engine.name}"

    @property
    def case(self) -> tuple[str, str]:
        """The names of mechanism and case."""
        return self.task.folder.name, self.task.case.name

    @property
    def key(self) -> tuple[str, str, str]:
        """The names of mechanism, case and engine."""
        return (*self.case, self.engine.name)

    def list_options(self) -> EngineOptions:
        """Return the options of the adapter that this kind of run adds."""
        return {"certificate": False}

    def list_process_options(self) -> ProcessOptions:
        """Return the options of the process that this kind of run adds."""
        return {}

    def run(self, options: Options, children: ChildProcesses) -> Attempt:
        """Run the engine and return its attempt."""
        task: CaseRequest = {
            "mechanism": str(self.task.folder.resolve()),
            "case": self.task.case.name,
            "options": {**options.engine, **self.list_options()},
            **self.list_process_options(),
        }
        return run_engine(self.engine, task, self.task.time, options.timeout, children)

    def make_failure(self, words: str) -> Attempt:
        """Return the attempt that stands for a run which something of ours kept from its end."""
        return Attempt(Record(engine=self.engine.name, status="error", message=words))


@dataclass(frozen=True)
class CaseRun(EngineJob):
    """The run whose record is compared with those of other engines."""

    kind = "run"

    def list_options(self) -> EngineOptions:
        """Return no further options: the run brings its certificate."""
        return {}


@dataclass(frozen=True)
class RepeatedRun(EngineJob):
    """A second run, which has to give what the first gave."""

    kind = "again"

    def list_process_options(self) -> ProcessOptions:
        """Return that the process shares nothing with the first, not even what it was forked from."""
        return {"afresh": True}


@dataclass(frozen=True)
class ShakenRun(EngineJob):
    """A run with the last digits of the input moved; way : of `crosscheck.verdicts.repeatability.SHAKEN`."""

    way: int
    kind = "shaken"

    def list_options(self) -> EngineOptions:
        """Return the options: which digits are moved, and that no error bars are wanted."""
        return {**super().list_options(), "shake": self.way, "error": False}


@dataclass(frozen=True)
class RefinedRun(EngineJob):
    """A run of the reference with finer steps and meshes."""

    halvings: RefinementHalvings
    kind = "finer"

    def list_options(self) -> EngineOptions:
        """Return the options: halvings of steps and meshes."""
        return {**super().list_options(), **self.halvings.options}


@dataclass(frozen=True)
class AbilitiesJob:
    """The question to an adapter: its name and version, and the cases that its engines can do."""

    engine: Engine
    pairs: tuple[Pair, ...]
    kind: ClassVar[str] = "abilities"

    @property
    def label(self) -> str:
        """The name of the job: "abilities of mujoco"."""
        return f"abilities of {self.engine.name}"

    def run(self, options: Options, children: ChildProcesses) -> Abilities:
        """Ask the adapter."""
        return ask_abilities(self.engine, self.pairs, children)

    def make_failure(self, words: str) -> Abilities:
        """Return the answer that stands for one which something of ours has lost."""
        return Abilities(None, message=words)


class JsonJob:
    """A job whose answer is JSON."""

    kind: ClassVar[str]

    @property
    def label(self) -> str:
        """The name of the job."""
        return self.kind

    @property
    def question(self) -> StudyRequest:
        """The job of the child process."""
        raise NotImplementedError

    @property
    def parts(self) -> int:
        """The number of time limits that it may take [-]."""
        return 1

    def run(self, options: Options, children: ChildProcesses) -> JsonAnswer:
        """Ask the child process."""
        return JsonAnswer(*ask(self.question, options.timeout * self.parts, children))

    def make_failure(self, words: str) -> JsonAnswer:
        """Return the answer that stands for one which something of ours has lost."""
        return JsonAnswer(None, ProcessEnd("error", words, "", 0.0))


@dataclass(frozen=True)
class StudyJob(JsonJob):
    """A table that a report carries beside the matrix."""

    study: Study
    kind = "study"

    @property
    def label(self) -> str:
        """The name of the job: "study robots"."""
        return f"study {self.study.name}"

    @property
    def question(self) -> StudyRequest:
        """The job of the child process: a function of a module, which may lie in a folder that is not installed."""
        study = self.study
        return {
            "kind": "study",
            "module": study.module,
            "function": study.function,
            "path": study.path,
            "options": dict(study.options),
        }


@dataclass(frozen=True)
class CauseJob(JsonJob):
    """The question for the cause of one engine's deviation in a case."""

    deviation: Question
    kind = "why"

    @property
    def label(self) -> str:
        """The name of the job: "why four_bar/turn mujoco"."""
        mechanism, case, engine, _ = self.deviation.place
        return f"why {mechanism}/{case} {engine}"

    @property
    def question(self) -> StudyRequest:
        """The job of the child process."""
        return self.deviation.job


@dataclass(frozen=True)
class CaseCausesJob(JsonJob):
    """The questions for the causes of several engines in one case: what does not depend on their answers is computed once."""

    deviations: CaseQuestions
    kind = "why together"

    @property
    def question(self) -> StudyRequest:
        """The job of the child process."""
        return self.deviations.job

    @property
    def parts(self) -> int:
        """The number of time limits that it may take [-]: one for every engine."""
        return len(self.deviations.questions)

    def split_answer(self, answer: JsonAnswer) -> list[tuple[CauseJob, JsonAnswer]]:
        """Return the engines that have an answer, each with its own and its share of the time."""
        answers = answer.value["answers"] if answer.value else []
        ending = replace(answer.ending, elapsed=answer.ending.elapsed / max(len(answers), 1))
        pairs = zip(self.deviations.questions, answers, strict=False)
        return [(CauseJob(question), JsonAnswer(one, ending)) for question, one in pairs if one is not None]


Job = EngineJob | AbilitiesJob | StudyJob | CauseJob | CaseCausesJob
Answer = Attempt | Abilities | JsonAnswer


def is_of_reference(job: Job) -> bool:
    """Return True for the runs of the engine that others are compared with."""
    return isinstance(job, CaseRun) and job.engine.name == REFERENCE


def describe_harness_failure(error: Exception) -> str:
    """Return the words for something of ours that failed."""
    return f"the harness failed: {type(error).__name__}: {error}"
