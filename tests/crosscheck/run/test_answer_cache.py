"""Kept answers are taken while nothing that matters has changed, and only then; nothing that happens to them does harm."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rogue_engines as rogue
from crosscheck_examples import write_models

from crosscheck import output_folder
from crosscheck.engines import ENGINES, Engine
from crosscheck.measures.record import Record, torque_series
from crosscheck.report.write_report import render
from crosscheck.run import answer_cache, isolation, run_cache
from crosscheck.run.answer_cache import ENDING, AnswerCache, find_user_folder, is_traceable, remove_oldest_entries
from crosscheck.run.isolation import Attempt
from crosscheck.run.runner import run
from crosscheck.run.work import Event, Options, Work
from crosscheck.studies import Study
from crosscheck.verdicts.plan import Plan, Task, discover
from crosscheck.verdicts.results import Results


@pytest.fixture
def models(root: Path, tmp_path: Path) -> Path:
    return write_models(tmp_path / "models", root).parent


@pytest.fixture
def task(models: Path) -> Task:
    return discover(models).tasks[0]


@pytest.fixture
def good(task: Task) -> Attempt:
    """An attempt as an engine makes it (its numbers do not matter here)."""
    torque = np.linspace(0.0, 1.0, task.time.size)[:, None] * np.arange(1.0, task.mechanism.nv + 1.0)
    record = Record("pinocchio", time=task.time, series=torque_series(task.mechanism, torque), wall_time=0.1)
    return Attempt(record, "printed", 0.5)


PINOCCHIO = ENGINES["pinocchio"]


def test_what_was_kept_comes_back_with_its_time(task: Task, good: Attempt, tmp_path: Path) -> None:
    cache = AnswerCache(tmp_path / "kept")
    assert cache.find_attempt(task, PINOCCHIO) is None
    cache.add_answer(task, PINOCCHIO, good)
    attempt = AnswerCache(tmp_path / "kept").find_attempt(task, PINOCCHIO)
    assert attempt is not None
    assert attempt.kept
    assert (attempt.printed, attempt.elapsed) == ("printed", 0.5)
    for name, one in good.record.series.items():
        assert np.array_equal(attempt.record.series[name].values, one.values)
    assert cache.trouble == []


def test_a_study_depends_on_the_folders_that_it_names_and_not_on_words_that_are_no_path(tmp_path: Path) -> None:
    """Jobs of outside engines are longer in words than a file's name may be."""
    (tmp_path / "one.csv").write_text("1")
    jobs = [{"module": "theirs", "stamp": ["0" * 64] * 20}]
    study = Study("x", "X", "m", "f", {"models": str(tmp_path), "engines": jobs, "words": "w" * 1000})
    cache = AnswerCache(tmp_path / "kept")
    module, function, plain, folders = cache.list_study_dependencies(study)
    assert (module, function, plain) == ("m", "f", {"engines": jobs, "words": "w" * 1000})
    assert list(folders) == ["models"]  # type: ignore[call-overload]
    (tmp_path / "one.csv").write_text("2")
    assert AnswerCache(tmp_path / "kept").list_study_dependencies(study)[3] != folders


def test_what_failed_is_not_kept(task: Task, good: Attempt, tmp_path: Path) -> None:
    cache = AnswerCache(tmp_path / "kept")
    for status in ("error", "timeout"):
        cache.add_answer(task, PINOCCHIO, replace(good, record=Record("pinocchio", status=status)))  # type: ignore[arg-type]
    assert not (tmp_path / "kept").exists()


Change = Callable[[pytest.MonkeyPatch, Task], Task]


def _file(patch: pytest.MonkeyPatch, task: Task) -> Task:
    (task.folder / "extra.csv").write_text("1")
    return task


def _mechanism(patch: pytest.MonkeyPatch, task: Task) -> Task:
    return replace(task, mechanism=replace(task.mechanism, gravity=np.array([0.0, -9.8, 0.0])))


def _case(patch: pytest.MonkeyPatch, task: Task) -> Task:
    return replace(task, case=replace(task.case, step=2.0 * task.case.step))


def _environment(patch: pytest.MonkeyPatch, task: Task) -> Task:
    patch.setenv("NUMBA_CPU_NAME", "haswell")
    return task


def _packages(patch: pytest.MonkeyPatch, task: Task) -> Task:
    patch.setattr(answer_cache, "compute_installed_digest", lambda: "numpy 9.9")
    return task


def _machine(name: str) -> Change:
    def change(patch: pytest.MonkeyPatch, task: Task) -> Task:
        there = answer_cache.describe_machine()
        patch.setattr(answer_cache, "describe_machine", lambda: {**there, name: "another"})
        return task

    return change


def _sources(patch: pytest.MonkeyPatch, task: Task) -> Task:
    patch.setattr(answer_cache, "compute_source_digest", lambda: "another line")
    return task


def _versions(patch: pytest.MonkeyPatch, task: Task) -> Task:
    patch.setattr(run_cache, "compute_surroundings_digest", lambda: "another version")
    return task


@pytest.mark.parametrize(
    "change",
    [
        _file,
        _mechanism,
        _case,
        _environment,
        _packages,
        _machine("processor"),
        _machine("Python"),
        _machine("system"),
        _sources,
        _versions,
    ],
)
def test_each_thing_that_matters_changes_the_key(
    change: Change, task: Task, good: Attempt, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    AnswerCache(tmp_path / "kept").add_answer(task, PINOCCHIO, good)
    other = change(monkeypatch, task)
    assert AnswerCache(tmp_path / "kept").find_attempt(other, PINOCCHIO) is None


def test_engine_and_options_change_the_key_and_limits_do_not(task: Task, good: Attempt, tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    AnswerCache(folder).add_answer(task, PINOCCHIO, good)
    assert AnswerCache(folder).find_attempt(task, ENGINES["mujoco"]) is None
    assert AnswerCache(folder, {"step": 1e-3}).find_attempt(task, PINOCCHIO) is None
    assert AnswerCache(folder).find_attempt(replace(task, case=replace(task.case, limits=())), PINOCCHIO) is not None


def test_the_sources_of_another_package_change_the_key(
    task: Task, good: Attempt, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "outside").mkdir()
    source = tmp_path / "outside" / "__init__.py"
    source.write_text("one = 1")
    engine = Engine("outside", "outside:adapter", "", "")
    AnswerCache(tmp_path / "kept").add_answer(task, engine, good)
    assert AnswerCache(tmp_path / "kept").find_attempt(task, engine) is not None
    (tmp_path / "outside" / "law.py").write_text("two = 2")
    answer_cache.compute_package_digest.cache_clear()
    assert AnswerCache(tmp_path / "kept").find_attempt(task, engine) is None


def test_programs_and_modules_of_the_user_are_always_asked(task: Task, good: Attempt, tmp_path: Path) -> None:
    program = Engine("mine", answer_cache.COMMAND, "", "", settings={"command": ["octave", "run.m"]})
    module = Engine("mine", "mine:adapter", "", "", path=str(tmp_path))
    cache = AnswerCache(tmp_path / "kept")
    for engine in (program, module):
        assert not is_traceable(engine)
        cache.add_answer(task, engine, good)
        assert cache.find_attempt(task, engine) is None
    assert all(is_traceable(engine) for engine in ENGINES.values())


# --- what may happen to the folder --------------------------------------------------------------------------------------


def entry(folder: Path) -> Path:
    (file,) = folder.glob(f"*/*{ENDING}")
    return file


def _cut(data: bytes) -> bytes:
    return data[: len(data) // 2]


def _flipped(data: bytes) -> bytes:
    half = len(data) // 2
    return data[:half] + bytes([data[half] ^ 1]) + data[half + 1 :]


@pytest.mark.parametrize("harm", [_cut, _flipped, lambda data: b"", lambda data: b"rubbish" * 99])
def test_a_damaged_entry_is_removed_and_told(
    harm: Callable[[bytes], bytes], task: Task, good: Attempt, tmp_path: Path
) -> None:
    cache = AnswerCache(tmp_path)
    cache.add_answer(task, PINOCCHIO, good)
    file = entry(tmp_path)
    file.write_bytes(harm(file.read_bytes()))
    assert cache.find_attempt(task, PINOCCHIO) is None
    assert "a kept answer was damaged and is computed again" in cache.trouble[0]
    assert not file.exists()


def test_where_nothing_can_be_written_that_is_told_once(
    task: Task, good: Attempt, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(answer_cache.owned, "replace", full)
    cache = AnswerCache(tmp_path)
    cache.add_answer(task, PINOCCHIO, good)
    cache.add_answer(task, ENGINES["mujoco"], good)
    cache.close({})
    assert cache.trouble == ["answers are not kept: [Errno 28] No space left on device"]


def test_what_was_not_used_for_longest_goes_first(tmp_path: Path) -> None:
    for age, name in enumerate(("new", "old", "oldest")):
        file = tmp_path / "ab" / f"{name}{ENDING}"
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(bytes(1000))
        os.utime(file, (1e9 - age, 1e9 - age))
    (tmp_path / "mine.txt").write_bytes(bytes(5000))
    remove_oldest_entries(tmp_path, 2000)
    assert sorted(f.stem for f in (tmp_path / "ab").iterdir()) == ["new", "old"]
    assert (tmp_path / "mine.txt").exists()


def test_two_runs_at_once_share_a_folder(task: Task, good: Attempt, tmp_path: Path) -> None:
    troubles: list[str] = []

    def use() -> None:
        cache = AnswerCache(tmp_path)
        for _ in range(10):
            cache.add_answer(task, PINOCCHIO, good)
            attempt = cache.find_attempt(task, PINOCCHIO)
            assert attempt is None or attempt.record.series.keys() == good.record.series.keys()
            remove_oldest_entries(tmp_path, 0)
        cache.close({"a": 1.0})
        troubles.extend(cache.trouble)

    threads = [threading.Thread(target=use) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert troubles == []
    assert AnswerCache(tmp_path).read_times() == {"a": 1.0}


def test_the_folder_is_the_users_cache_unless_it_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert find_user_folder() is None  # in tests: see conftest
    monkeypatch.setenv("CROSSCHECK_KEPT", str(tmp_path))
    assert find_user_folder() == tmp_path
    monkeypatch.delenv("CROSSCHECK_KEPT")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert find_user_folder() == tmp_path / "crosscheck" / "answers"


# --- whole runs -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def plan(models: Path, monkeypatch: pytest.MonkeyPatch) -> Plan:
    monkeypatch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
    return discover(models)


def night(plan: Plan, out: Path, **options: object) -> tuple[Results, list[Event]]:
    engines = {"pinocchio": PINOCCHIO, "mujoco": ENGINES["mujoco"], "measured": ENGINES["measured"]}
    studies = (Study("rogue", "A study", "rogue_engines", "study", {"models": str(plan.tasks[0].folder.parent)}),)
    events: list[Event] = []
    work = Work(plan, engines, studies, Options(60.0, kept=out.parent / "kept", **options))  # type: ignore[arg-type]
    return run(work, out, events.append), events


@pytest.mark.slow
def test_an_unchanged_run_starts_no_process_and_says_so(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, _ = night(plan, tmp_path / "out")
    assert {row.kept for row in (*first.runs, *first.studies)} == {""}

    def forbidden(*_: object, **__: object) -> None:
        raise AssertionError("a process was started")

    with monkeypatch.context() as patch:
        patch.setattr(isolation.subprocess, "Popen", forbidden)
        again, events = night(plan, tmp_path / "out")
    assert all(row.kept for row in (*again.runs, *again.studies))
    assert any("unchanged since" in event.message for event in events)
    assert again.engines == first.engines
    assert again.comparisons == first.comparisons
    render(again, tmp_path / "out")
    assert "4 of 4 results are of earlier runs, unchanged since" in (tmp_path / "out" / "index.html").read_text()
    (page,) = (tmp_path / "out" / "cases").glob("*.html")
    assert "nothing has changed since" in page.read_text()
    assert "4 of 4 results are of earlier runs" in (tmp_path / "out" / "summary.md").read_text()

    fresh, _ = night(plan, tmp_path / "out", fresh=True)
    assert {row.kept for row in (*fresh.runs, *fresh.studies)} == {""}


@pytest.mark.slow
def test_a_damaged_entry_is_computed_again_and_the_report_says_so(plan: Plan, tmp_path: Path) -> None:
    night(plan, tmp_path / "out")
    for file in (tmp_path / "kept").glob(f"*/*{ENDING}"):
        file.write_bytes(_cut(file.read_bytes()))
    again, _ = night(plan, tmp_path / "out")
    assert {row.kept for row in again.runs} == {""}
    assert "was damaged and is computed again" in again.settings["kept results"]


@pytest.mark.slow
def test_the_command_line_takes_what_is_kept_but_not_in_ci(plan: Plan, tmp_path: Path) -> None:
    models = plan.tasks[0].folder.parent

    def kept(*words: str, **environment: str) -> list[bool]:
        command = [sys.executable, "-m", "crosscheck", "run", "--models", str(models), "--out", str(tmp_path / "out")]
        variables = {name: value for name, value in os.environ.items() if name != "CI"}
        variables |= {"CROSSCHECK_KEPT": str(tmp_path / "kept"), **environment}
        done = subprocess.run(
            [*command, "--engines", "pinocchio,mujoco", *words], env=variables, capture_output=True, text=True
        )
        runs = json.loads((tmp_path / "out" / "results.json").read_text())["runs"]
        assert ("--fresh computes all" in done.stderr) == any(run["kept"] for run in runs)
        return [bool(run["kept"]) for run in runs]

    assert kept() == [False, False]
    assert kept() == [True, True]
    assert kept("--fresh") == [False, False]
    assert kept(CI="true") == [False, False]


def test_a_file_that_goes_while_it_is_replaced_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another run may trim the folder between any two looks at the file."""
    file, look = tmp_path / "one.answer", Path.stat
    file.write_text("old")

    def look_and_remove(path: Path, **options: bool) -> os.stat_result:
        seen = look(path, **options)
        if path == file:
            os.unlink(path)
        return seen

    monkeypatch.setattr(Path, "stat", look_and_remove)
    output_folder.replace(file, "new")
    monkeypatch.undo()
    assert file.read_text() == "new"
