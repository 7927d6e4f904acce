"""A night in which engines crash, return NaN and are missing: everything is written, nothing passes by mistake."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import rogue_engines as rogue
from crosscheck_examples import WICKED, Night, night_run, stopping, write_models

from crosscheck import output_folder as owned
from crosscheck.engines import ENGINES, Engine
from crosscheck.measures.certificate import Check
from crosscheck.measures.record import read_record
from crosscheck.report.write_report import ReportError, render
from crosscheck.run.isolation import ChildProcesses
from crosscheck.run.runner import run
from crosscheck.run.work import Options, Work
from crosscheck.verdicts import baseline
from crosscheck.verdicts import results as store
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.plan import Plan, discover, make_case_row
from crosscheck.verdicts.results import CaseRow, Results, RunRow, StudyRow
from flexinv.errors import InputError

NAMES = ["flexinv", "pinocchio", "fine", "killed", "nan", "absent"]


@pytest.fixture(scope="session")
def night(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Night:
    return night_run(root, tmp_path_factory.getbasetemp())


def test_every_engine_has_a_row_that_says_what_happened(night: Night) -> None:
    runs = {r.engine: r for r in night.results.runs}
    assert list(runs) == NAMES
    assert {n: r.status for n, r in runs.items()} == {
        **{"flexinv": "ok", "pinocchio": "ok", "fine": "ok"},
        **{"killed": "error", "nan": "error", "absent": "error"},
    }
    assert runs["killed"].message == "killed by signal 9 (SIGKILL)"
    assert "not finite" in runs["nan"].message
    assert "python -m pip install no-such-package" in runs["absent"].message


def test_verdicts_are_what_the_numbers_say(night: Night) -> None:
    verdicts = {(c.engine, c.quantity, c.unit): c.verdict for c in night.results.comparisons}
    assert {v for (engine, _, _), v in verdicts.items() if engine == "pinocchio"} == {"within"}
    assert verdicts["fine", "torque", "N m"] == "deviation"
    assert verdicts["fine", "tip", "m"] == "skipped"
    assert {v for (engine, _, _), v in verdicts.items() if engine in ("killed", "nan", "absent")} == {"error"}
    assert night.results.exit_code == 2


def test_the_engines_say_what_they_are(night: Night) -> None:
    engines = {e.name: e for e in night.results.engines}
    assert engines["fine"].abilities == "Does one thing wrong."
    assert not engines["absent"].present
    assert "no_such_package is not installed" in engines["absent"].message


def test_a_model_that_cannot_be_read_is_a_row(night: Night) -> None:
    (row,) = [c for c in night.results.cases if c.problem]
    assert row.mechanism == "broken"
    assert "mechanism.toml" in row.problem


def test_studies_are_tables_or_say_why_not(night: Night) -> None:
    studies = {s.name: s for s in night.results.studies}
    assert studies["rogue"].verdict == "deviation"
    assert [row["verdict"] for row in studies["rogue"].rows] == ["within", "deviation"]
    assert (studies["sad"].status, studies["sad"].verdict) == ("error", "error")
    assert "the archive is empty" in studies["sad"].message


def test_results_come_back_from_disk_as_they_were(night: Night) -> None:
    back = store.read(night.out / "results.json")
    assert json.loads(json.dumps(asdict(back))) == json.loads(json.dumps(asdict(night.results)))
    assert (back.exit_code, back.finished) == (2, True)
    with pytest.raises(ValueError, match="schema 1"):
        store.read(night.out / "series" / f"{night.results.cases[1].slug}" / "flexinv.json")


def test_series_are_on_disk(night: Night) -> None:
    for row in night.results.runs:
        if row.status == "ok":
            record = read_record(night.out / row.series)
            assert record.engine == row.engine
            assert record.series
        else:
            assert row.series == ""
    assert all(".." not in r.series and WICKED not in r.series for r in night.results.runs)


def test_the_run_says_on_what_it_ran(night: Night) -> None:
    assert night.results.machine["cores"]
    assert night.results.versions["numpy"] == np.__version__
    assert night.results.settings["timeout"] == 60.0
    assert night.results.elapsed > 0.0


# --- what makes a run good or bad -------------------------------------------------------------------------------------

SAME = Comparison("m", "c", "e", "flexinv", "torque", "N m", "within", maximum=0.0, scale=1.0, limit=1e-9)
GOOD = Results(
    "now", finished=True, cases=(CaseRow("m", "c"),), runs=(RunRow("m", "c", "e", "ok"),), comparisons=(SAME,)
)


@pytest.mark.parametrize(
    ("results", "code"),
    [
        (GOOD, 0),
        (replace(GOOD, runs=(RunRow("m", "c", "e", "skipped"),)), 0),
        (replace(GOOD, comparisons=()), 2),  # nothing was compared
        (replace(GOOD, certificates=(Check("m", "c", "e", "total mass", "kg", True),)), 0),
        (replace(GOOD, certificates=(Check("m", "c", "e", "total mass", "kg", False),)), 1),
        (replace(GOOD, certificates=(Check("m", "c", "e", "no certificate", "-", False),)), 0),
        (replace(GOOD, runs=(RunRow("m", "c", "e", "timeout"),)), 2),
        (replace(GOOD, runs=(RunRow("m", "c", "e", "error"),)), 2),
        (replace(GOOD, finished=False), 2),
        (replace(GOOD, cases=()), 2),
        (replace(GOOD, cases=(CaseRow("m", "", problem="torn"),)), 2),
        (replace(GOOD, studies=(StudyRow("s", "s", rows=({"verdict": "deviation"},)),)), 1),
        (replace(GOOD, studies=(StudyRow("s", "s", rows=({},)),)), 2),
        (replace(GOOD, studies=(StudyRow("s", "s", status="timeout"),)), 2),
        (replace(GOOD, studies=(StudyRow("s", "s", status="skipped"),)), 0),
    ],
)
def test_exit_codes(results: Results, code: int) -> None:
    assert results.exit_code == code


def verdicts(plan: Plan, out: Path, kind: str) -> dict[str, Comparison]:
    """Comparisons of a rogue with flexinv by quantity [torques in N m]."""
    results = run(
        Work(plan, {"flexinv": ENGINES["flexinv"], kind: rogue.engine(kind)}, (), Options(600.0, jobs=2)), out
    )
    assert results.exit_code == 1
    render(results, out)
    assert kind in (out / "summary.md").read_text().partition("## Where not")[2].partition("\n## ")[0]
    return {c.quantity: c for c in results.comparisons}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("noisy", "so that its error bars explain nothing: noisy differs from itself by"),
        ("steady", "steady states error bars of 0.032 by itself, which no run has shown: they explain nothing"),
    ],
)
def test_an_engine_that_scatters_does_not_pay_with_its_own_error_bar(
    kind: str, message: str, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
    torque = verdicts(plan, tmp_path / "out", kind)["torque"]
    bar = torque.stated_bar if kind == "steady" else torque.error_bar
    assert bar is not None
    assert torque.maximum is not None
    assert torque.maximum < bar < 0.1 * (torque.scale or 0.0)
    assert torque.verdict == "deviation"
    assert message in torque.message


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "verdict"), [("trembling", "within"), ("worsened", "deviation")])
def test_what_seems_worse_than_blessed_is_run_again_with_other_last_digits(
    kind: str, verdict: str, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both are 1.2e-13 of the range above their blessed value, noise is 1e-13; only one of them is so whatever its input is."""
    monkeypatch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
    engines = {"flexinv": ENGINES["flexinv"], kind: rogue.engine(kind)}
    first = run(Work(plan, engines, (), Options(600.0, jobs=2)), tmp_path / "first")
    known = {
        baseline.make_comparison_key(c): (c.fraction or 0.0) - 1.2e-13 * (c.quantity == "torque")
        for c in first.comparisons
    }
    night = baseline.Baseline(known, "as measured", first.started, {})
    again = run(Work(plan, engines, (), Options(600.0, jobs=2, baseline=night)), tmp_path / "again")
    torque = next(c for c in again.comparisons if c.quantity == "torque")
    assert torque.verdict == verdict
    assert torque.scatter is not None
    assert (torque.scatter > 2e-14) == (verdict == "within")
    assert all(c.scatter is None for c in again.comparisons if c.quantity != "torque")


@pytest.mark.slow
def test_an_engine_with_another_mechanism_is_never_within(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
    rows = verdicts(plan, tmp_path / "out", "heavy")
    for row in rows.values():
        assert row.verdict == "deviation"
        assert row.message == "the certificate does not hold: heavy has another total mass"
        assert (row.fraction or 0.0) < 1e-12
    page = (tmp_path / "out" / "index.html").read_text()
    assert "1 certificate does not hold" in page
    assert "another mechanism: total mass" in page  # among what is wrong
    assert "another total mass" in page  # in the matrix
    (case,) = (tmp_path / "out" / "cases").glob("*.html")
    text = case.read_text()
    assert "<b>heavy</b> has another mechanism: total mass. Its comparisons are deviations" in text
    assert 'The <a href="#causes">difference of the efforts</a> says:' in text
    assert 'Its <a href="#certificates">certificate</a> does not hold, another mechanism: total mass' in text


# --- what goes wrong in the harness itself ----------------------------------------------------------------------------


@pytest.fixture
def plan(root: Path, tmp_path: Path) -> Plan:
    return discover(write_models(tmp_path / "models", root).parent)


def test_ctrl_c_leaves_a_row_for_everything(plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
    absent = Engine("absent", "rogue_engines", "no_such_package", "never")
    engines = {"absent": absent, "fine": rogue.engine("fine"), "hanging": rogue.engine("hanging")}
    results = run(Work(plan, engines, (), Options(60.0, jobs=1)), tmp_path / "out", stopping(1))
    assert {r.engine for r in results.runs} == set(engines)
    assert {r.status for r in results.runs} == {"error"}
    assert (results.exit_code, results.finished) == (2, False)
    assert store.read(tmp_path / "out" / "results.json").message == "interrupted before everything was run"


def test_a_full_disk_becomes_a_row(plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("crosscheck.run.isolation.tempfile.TemporaryDirectory", full)
    results = run(Work(plan, {"pinocchio": ENGINES["pinocchio"]}, (), Options(60.0)), tmp_path / "out")
    assert "No space left on device" in results.runs[0].message
    assert results.exit_code == 2


ABSENT = Engine("absent", "rogue_engines", "no_such_package", "never")


def test_an_older_report_is_replaced_and_nothing_else_is_touched(plan: Plan, tmp_path: Path) -> None:
    out = tmp_path / "out"
    work = Work(plan, {"pinocchio": ENGINES["pinocchio"]}, (), Options(60.0))
    run(work, out)
    (old,) = (out / "series").glob("*/pinocchio.npz")
    (out / "series" / "mine.csv").write_text("keep me")
    (out / "mine.txt").write_text("keep me")
    results = run(Work(plan, {"absent": ABSENT}, (), Options(60.0)), out)
    render(results, out)
    assert not old.exists()
    assert not old.parent.exists()
    assert (out / "series" / "mine.csv").read_text() == (out / "mine.txt").read_text() == "keep me"


@pytest.mark.parametrize("name", ["data/x.csv", "series/x.npz", "index.html", "attempts/x"])
def test_a_folder_with_somebody_elses_files_is_refused(name: str, plan: Plan, tmp_path: Path) -> None:
    file = tmp_path / "out" / name
    file.parent.mkdir(parents=True)
    file.write_text("keep me")
    with pytest.raises(InputError, match=f"holds {name}, which crosscheck did not write: write --out with a new"):
        run(Work(plan, {"absent": ABSENT}, (), Options(60.0)), tmp_path / "out")
    assert [f for f in (tmp_path / "out").rglob("*") if f.is_file()] == [file]
    assert file.read_text() == "keep me"


def test_what_somebody_put_where_a_page_would_be_is_not_overwritten(plan: Plan, tmp_path: Path) -> None:
    out = tmp_path / "out"
    results = run(Work(plan, {"absent": ABSENT}, (), Options(60.0)), out)
    (out / "index.html").write_text("keep me")
    with pytest.raises(ReportError, match=r"index\.html is there already, and crosscheck did not write it"):
        render(results, out)
    assert (out / "index.html").read_text() == "keep me"


def test_a_list_does_not_lead_out_of_its_folder(plan: Plan, tmp_path: Path) -> None:
    out, mine = tmp_path / "out", tmp_path / "mine"
    mine.mkdir()
    for name in ("a", "b"):
        (mine / name).write_text("keep me")
    run(Work(plan, {"absent": ABSENT}, (), Options(60.0)), out)
    (out / "link").symlink_to(mine)
    with (out / owned.LIST).open("a") as text:
        text.write("../mine/a\nlink/b\n" + str(mine / "a") + "\n")
    run(Work(plan, {"absent": ABSENT}, (), Options(60.0)), out)
    assert sorted(f.name for f in mine.iterdir()) == ["a", "b"]


def test_two_runs_in_one_folder_are_one_too_many(plan: Plan, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    hold = "import sys, filelock, time\nlock = filelock.FileLock(sys.argv[1])\nlock.acquire()\n"
    hold += "print('held', flush=True)\ntime.sleep(60)"
    other = subprocess.Popen([sys.executable, "-c", hold, str(out / owned.LOCK)], stdout=subprocess.PIPE, text=True)
    try:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        (out / owned.HOLDER).write_text('{"process": 4711, "started": "2026-03-01T01:00:00+00:00"}')
        with pytest.raises(
            owned.FolderBusy, match=r"another run writes into .* since 2026-03-01T01:00:00\+00:00 \(process 4711\)"
        ):
            run(Work(plan, {"absent": ABSENT}, (), Options(60.0)), out)
    finally:
        other.kill()
        other.communicate()
    assert run(Work(plan, {"absent": ABSENT}, (), Options(60.0)), out).finished


def test_a_folder_that_cannot_be_made_is_one_error(plan: Plan, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("keep me")
    with pytest.raises(InputError, match="cannot be written to: Not a directory"):
        run(Work(plan, {"absent": ABSENT}, (), Options(60.0)), tmp_path / "file" / "sub")


def test_stopped_children_do_not_start(plan: Plan) -> None:
    children = ChildProcesses()
    children.end_processes()
    with pytest.raises(InterruptedError):
        children.begin_process(["true"], Path("."), 1)


# --- what there is to run ---------------------------------------------------------------------------------------------


def test_names_and_patterns_choose(root: Path, tmp_path: Path) -> None:
    for name in ("left_arm", "right_arm", "leg"):
        write_models(tmp_path, root, name)
    chosen = [t.folder.name for t in discover(tmp_path, ["*_arm"]).tasks]
    assert chosen == ["left_arm", "right_arm"]
    assert [t.case.name for t in discover(tmp_path, ["leg/swing"]).tasks] == ["swing"]
    with pytest.raises(InputError, match="nothing to run is called 'tail'; mechanisms here: left_arm, leg, right_arm"):
        discover(tmp_path, ["tail"])
    with pytest.raises(InputError, match="nothing to run is called 'left_am'; write 'left_arm'; mechanisms here"):
        discover(tmp_path, ["left_am"])
    with pytest.raises(InputError, match="'leg/swig'; write 'leg/swing'; cases of leg: swing"):
        discover(tmp_path, ["leg/swig"])
    with pytest.raises(InputError, match="'leg/kick'; cases of leg: swing"):
        discover(tmp_path, ["leg/kick"])


def test_the_end_of_the_motion_is_found(plan: Plan) -> None:
    (task,) = plan.tasks
    assert task.rest == pytest.approx(0.5)
    assert task.time[-1] == pytest.approx(0.75)
    assert make_case_row(task).held
    assert not replace(make_case_row(task), rest=0.7).held


def test_a_missing_cases_file_is_a_broken_model(root: Path, tmp_path: Path) -> None:
    folder = write_models(tmp_path, root)
    shutil.move(folder / "cases.toml", folder / "cases.txt")
    plan = discover(tmp_path)
    assert not plan.tasks
    assert plan.broken[0][0] == "double_pendulum"


@pytest.mark.parametrize("name", ["a/../../b", "..", "<b>", "a b", "ä", "x" * 300, ""])
def test_slugs_are_safe_and_differ(name: str) -> None:
    slug = store.make_slug(name)
    assert slug.replace("-", "").replace("_", "").isalnum()
    assert len(slug) < 100
    assert slug != store.make_slug(name + "!")
