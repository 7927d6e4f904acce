"""Where numbers of others or something of ours fail, what has finished is reported: rows, results.json, and every other page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import rogue_engines as rogue
from crosscheck_examples import stopping, write_models

from crosscheck import output_folder as owned
from crosscheck.engines import ENGINES, Engine
from crosscheck.report.write_report import ReportError, render
from crosscheck.run.runner import run
from crosscheck.run.work import Options, Work
from crosscheck.verdicts import results as store
from crosscheck.verdicts.plan import Plan, discover
from crosscheck.verdicts.results import Results, RunRow


@pytest.fixture
def plan(root: Path, tmp_path: Path) -> Plan:
    write_models(tmp_path / "models", root)
    return discover(tmp_path / "models")


@pytest.mark.parametrize(("kind", "words"), [("runaway", "values of 1e+308 N m"), ("wide", "error bars of 1e+308 N m")])
def test_a_number_that_cannot_be_squared_is_a_row(
    kind: str, words: str, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
    engines = {"flexinv": ENGINES["flexinv"], kind: rogue.engine(kind), "pinocchio": ENGINES["pinocchio"]}
    results = run(Work(plan, engines, (), Options(60.0)), tmp_path / "out")
    (row,) = [r for r in results.runs if r.engine == kind]
    assert row.status == "error"
    assert words in row.message
    assert "the computation has run away" in row.message
    assert results.finished
    assert {c.verdict for c in results.comparisons if c.engine == "pinocchio"} == {"within"}
    render(results, tmp_path / "out")


def test_a_certificate_with_a_number_that_cannot_be_squared_does_not_hold(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
    engines = {"flexinv": ENGINES["flexinv"], "massive": rogue.engine("massive")}
    results = run(Work(plan, engines, (), Options(60.0)), tmp_path / "out")
    (line,) = [c for c in results.certificates if c.engine == "massive" and c.what == "total mass"]
    assert (line.holds, line.words) == (False, "a number of 1e+308, expected at most 1e+100")
    assert store.read(tmp_path / "out" / "results.json").certificates == results.certificates


def break_comparison(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ArithmeticError("something of ours")

    monkeypatch.setattr("crosscheck.run.run_state.compare_all", fail)


def test_where_something_of_ours_fails_what_is_finished_is_reported(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A comparison that raises is an error of its case; runs, series and pages are there, and the failure is in words."""
    break_comparison(monkeypatch)
    engines = {"flexinv": ENGINES["flexinv"], "pinocchio": ENGINES["pinocchio"]}
    results = run(Work(plan, engines, (), Options(60.0)), tmp_path / "out")
    assert {r.status for r in results.runs} == {"ok"}
    words = "the harness failed: ArithmeticError: something of ours"
    assert {(c.verdict, c.message) for c in results.comparisons} == {("error", words)}
    assert (results.exit_code, results.finished) == (2, False)
    assert results.message == f"the comparison of double_pendulum/swing: {words}"
    assert "in fail" in results.settings["failure of the comparison of double_pendulum/swing"]
    render(results, tmp_path / "out")


def test_a_run_that_cannot_be_taken_is_an_error_of_its_own(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ArithmeticError("something of ours")

    monkeypatch.setattr("crosscheck.run.run_state.run_row", fail)
    results = run(Work(plan, {"pinocchio": ENGINES["pinocchio"]}, (), Options(60.0)), tmp_path / "out")
    (row,) = results.runs
    assert (row.status, row.message) == ("error", "the harness failed: ArithmeticError: something of ours")
    assert results.exit_code == 2


def test_stages_that_fail_leave_a_row_for_everything(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ArithmeticError("something of ours")

    monkeypatch.setattr("crosscheck.run.run_state.RunState.list_repeats", fail)
    results = run(Work(plan, {"pinocchio": ENGINES["pinocchio"]}, (), Options(60.0)), tmp_path / "out")
    assert results.message == "the run ended early: the harness failed: ArithmeticError: something of ours"
    assert [r.status for r in results.runs] == ["ok"]
    assert store.read(tmp_path / "out" / "results.json").message == results.message


def test_numbers_that_json_cannot_say_stand_as_null_and_are_counted(tmp_path: Path) -> None:
    row = RunRow("m", "c", "e", "ok", peaks={"torque/j": [(1.0, float("inf"))]})
    (tmp_path / "out").mkdir()
    with owned.open_report_folder(tmp_path / "out"):
        store.write(Results("now", finished=True, runs=(row,)), tmp_path / "out" / "results.json")
    plain = json.loads((tmp_path / "out" / "results.json").read_text())
    assert plain["message"] == "numbers that are not finite stand as null: 1, the first is runs[0].peaks.torque/j[0][1]"
    assert plain["exit_code"] == 2
    assert plain["runs"][0]["peaks"]["torque/j"] == [[1.0, None]]


def test_a_page_that_fails_costs_no_other_page(plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results = run(Work(plan, {"pinocchio": ENGINES["pinocchio"]}, (), Options(60.0)), tmp_path / "out")

    def fail(*_: object) -> None:
        raise ArithmeticError("something of ours")

    monkeypatch.setattr("crosscheck.report.html.build_case_view", fail)
    with pytest.raises(ReportError, match=r"cases/double_pendulum-swing\S*.html: ArithmeticError: something of ours"):
        render(results, tmp_path / "out")
    assert (tmp_path / "out" / "index.html").is_file()
    assert (tmp_path / "out" / "junit.xml").is_file()


def test_after_ctrl_c_results_are_written_once_however_many_engines_there_are(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
    monkeypatch.setattr("crosscheck.run.run_state.PAUSE", 0.0)  # [s]: every row would be written at once
    monkeypatch.setattr("crosscheck.run.run_state.RARELY", 0.0)
    written: list[int] = []
    write = store.write

    def counting(results: Results, file: Path) -> None:
        written.append(len(results.runs))
        write(results, file)

    monkeypatch.setattr("crosscheck.run.run_state.store.write", counting)
    many = {f"absent {k}": Engine(f"absent {k}", "rogue_engines", "no_such_package", "never") for k in range(20)}
    run(Work(plan, many | {"fine": rogue.engine("fine")}, (), Options(60.0, jobs=1)), tmp_path / "out", stopping(1))
    assert written[-1] == 21
    assert len(written) <= 4  # those before the interruption, and one for all rows that did not run
