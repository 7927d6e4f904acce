"""Jobs of a run: what each asks of its process, its name, and the answer that stands for it where something of ours fails."""

from __future__ import annotations

from pathlib import Path

import pytest

from crosscheck.engines import ENGINES
from crosscheck.run.abilities import Abilities
from crosscheck.run.isolation import ProcessEnd
from crosscheck.run.jobs import (
    AbilitiesJob,
    CaseCausesJob,
    CaseRun,
    CauseJob,
    EngineJob,
    Job,
    JsonAnswer,
    RefinedRun,
    RepeatedRun,
    ShakenRun,
    StudyJob,
    describe_harness_failure,
    is_of_reference,
)
from crosscheck.run.questions import CaseQuestions, Question
from crosscheck.run.run_state import RunState
from crosscheck.run.work import Work
from crosscheck.studies import STUDIES
from crosscheck.verdicts.plan import Plan, Task, discover
from crosscheck.verdicts.refinement import RefinementHalvings
from crosscheck.verdicts.results import Results

FAILURE = "the harness failed: ZeroDivisionError: something of ours"


@pytest.fixture
def task(root: Path) -> Task:
    (task,) = discover(root / "models", ["double_pendulum/swing"]).tasks
    return task


def ask(engine: str) -> Question:
    return Question(("double_pendulum", "swing", engine, "flexinv"), {"engine": engine})


def list_jobs(task: Task) -> list[Job]:
    mujoco = ENGINES["mujoco"]
    return [
        CaseRun(task, mujoco),
        RepeatedRun(task, mujoco),
        ShakenRun(task, mujoco, 2),
        RefinedRun(task, ENGINES["flexinv"], RefinementHalvings(2, 1)),
        AbilitiesJob(mujoco, ((task, mujoco),)),
        StudyJob(STUDIES["robots"]),
        CauseJob(ask("mujoco")),
        CaseCausesJob(CaseQuestions((ask("mujoco"), ask("pinocchio")))),
    ]


def test_kinds_of_runs_differ_in_what_they_ask(task: Task) -> None:
    run, again, shaken, refined = (job for job in list_jobs(task) if isinstance(job, EngineJob))
    assert run.list_options() == {}
    assert again.list_options() == {"certificate": False}
    assert again.list_process_options() == {"afresh": True}
    assert shaken.list_options() == {"certificate": False, "shake": 2, "error": False}
    assert refined.list_options() == {"certificate": False, "finer_step": 2, "finer_mesh": 1}
    assert not any(job.list_process_options() for job in (run, shaken, refined))


def test_the_run_of_the_reference_is_known_by_its_engine(task: Task) -> None:
    assert is_of_reference(CaseRun(task, ENGINES["flexinv"]))
    assert [job.label for job in list_jobs(task) if is_of_reference(job)] == []


def test_jobs_have_names_of_their_own(task: Task) -> None:
    names = [f"{job.kind} {job.label}" for job in list_jobs(task)]
    assert len(set(names)) == len(names)
    assert names[0] == "run double_pendulum/swing mujoco"


def test_what_stands_for_a_job_that_failed_is_taken_as_its_answer(task: Task, tmp_path: Path) -> None:
    """And the answer of another kind of job is refused: nothing of a run is lost by a mistake of ours without a word."""
    error = ZeroDivisionError("something of ours")
    for job in list_jobs(task):
        answer = job.make_failure(describe_harness_failure(error))
        engines = {name: ENGINES[name] for name in ("flexinv", "mujoco")}
        work = Work(Plan((task,)), engines, (STUDIES["robots"],))
        state = RunState(work, tmp_path, lambda event: None, Results("now"))
        wrong = Abilities(None) if isinstance(answer, JsonAnswer) else JsonAnswer(None, ProcessEnd("ok", "", "", 0.0))
        with pytest.raises(TypeError, match=f"is no answer to a {type(job).__name__}"):
            state.take(job, wrong)
        if isinstance(job, CaseCausesJob):  # its answer is split first, and what has none is asked alone
            assert isinstance(answer, JsonAnswer)
            assert job.split_answer(answer) == []
            continue
        state.take(job, answer)
        if isinstance(job, CaseRun):
            assert [row.message for row in state.results.runs] == [FAILURE]
        if isinstance(job, StudyJob):
            assert [row.message for row in state.results.studies] == [FAILURE]


def test_diagnoses_of_one_process_are_shared_out() -> None:
    several = CaseCausesJob(CaseQuestions((ask("mujoco"), ask("pinocchio"), ask("exudyn"))))
    assert several.parts == 3
    shares = several.split_answer(JsonAnswer({"answers": [{"cause": "a"}, None]}, ProcessEnd("ok", "", "", 8.0)))
    assert [(job.deviation.place[2], answer.value, answer.ending.elapsed) for job, answer in shares] == [
        ("mujoco", {"cause": "a"}, 4.0)
    ]
