"""What engines can do is asked in one process per adapter; whatever happens to it, every case has its row."""

from __future__ import annotations

from pathlib import Path

import pytest
import rogue_engines as rogue
from crosscheck_examples import write_models

from crosscheck.engines import Engine
from crosscheck.run import abilities as asking
from crosscheck.run.abilities import LIMIT, ask_abilities, make_skipped_attempt
from crosscheck.run.isolation import ChildProcesses
from crosscheck.run.runner import run
from crosscheck.run.work import Options, Work
from crosscheck.verdicts.plan import Plan, discover
from crosscheck.verdicts.results import RunRow


def engine(kind: str) -> Engine:
    return Engine(kind, "rogue_answers", "numpy", "never")


@pytest.fixture
def plan(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Plan:
    monkeypatch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
    for name in ("left_arm", "right_arm"):
        write_models(tmp_path / "models", root, name)
    return discover(tmp_path / "models")


class CountingProcesses(ChildProcesses):
    """Child processes that count how many processes were begun."""

    begun = 0

    def begin(self, *words: object) -> object:  # type: ignore[override]
        self.begun += 1
        return super().begin(*words)  # type: ignore[arg-type]


def test_all_cases_are_asked_in_one_process(plan: Plan) -> None:
    children = CountingProcesses()
    pairs = [(task, engine(kind)) for task in plan.tasks for kind in ("fine", "refusing", "raising")]
    said = ask_abilities(engine("fine"), pairs, children)
    assert children.begun == 1
    assert said.described == {"version": "0.rogue", "abilities": "Does one thing wrong."}
    assert said.refused == {1: "has no legs", 4: "has no legs"}  # who raises is asked again when it runs
    assert said.message == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "why"),
    [("killed", "killed by signal 6 (SIGABRT)"), ("hanging", "stopped after the time limit of 5 s")],
)
def test_a_process_that_does_not_answer_leaves_what_it_said(
    kind: str, why: str, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asking, "LIMIT", 5.0 if kind == "hanging" else LIMIT)
    task = plan.tasks[0]
    pairs = [(task, engine(name)) for name in ("refusing", kind, "fine")]
    said = ask_abilities(engine("fine"), pairs, ChildProcesses())
    assert said.described is not None
    assert said.refused == {0: "has no legs"}
    assert said.message.startswith(f"asked in one process what it can do in all cases: {why}")
    assert said.message.endswith("; 2 cases were asked one by one")


def test_an_engine_that_cannot_be_imported_is_not_there(plan: Plan) -> None:
    gone = Engine("gone", "no_such_module", "numpy", "never")
    said = ask_abilities(gone, [(plan.tasks[0], gone)], ChildProcesses())
    assert said.described is None
    assert "No module named 'no_such_module'" in said.message


@pytest.fixture
def rows(plan: Plan, tmp_path: Path) -> dict[tuple[str, str], RunRow]:
    engines = {kind: engine(kind) for kind in ("fine", "refusing", "raising", "killed")}
    results = run(Work(plan, engines, (), Options(60.0)), tmp_path / "out")
    assert "killed by signal 6 (SIGABRT)" in next(e.message for e in results.engines if e.name == "fine")
    return {(r.mechanism, r.engine): r for r in results.runs}


def test_every_case_has_a_row_where_asking_crashed(rows: dict[tuple[str, str], RunRow]) -> None:
    assert len(rows) == 8
    for (_, name), row in rows.items():
        status = {"fine": "ok", "refusing": "skipped", "raising": "error", "killed": "error"}[name]
        assert row.status == status
        assert (row.message == "has no legs") == (name == "refusing")
    assert {rows[arm, "killed"].message for arm in ("left_arm", "right_arm")} == {"killed by signal 6 (SIGABRT)"}


def test_who_says_no_has_the_row_of_one_who_ran(plan: Plan) -> None:
    (task, _) = plan.tasks
    said = make_skipped_attempt(task, engine("refusing"), "has no legs", "0.rogue").record
    assert (said.status, said.message, said.version, said.engine) == ("skipped", "has no legs", "0.rogue", "refusing")
    assert said.model_hash
