"""Programs as engines: whatever one does becomes a row in words, nothing is lost, and nothing of it is left running."""

from __future__ import annotations

import math
import os
import pickle
import shutil
import subprocess
import sys
import threading
import time as clock
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rogue_program

from crosscheck.doors.command import make_environment
from crosscheck.doors.registry import COMMAND, RECORD
from crosscheck.engines import ENGINES, Engine
from crosscheck.kit.write import write
from crosscheck.run.cluster import read_task_files, run_on_worker
from crosscheck.run.forking import ForkServers
from crosscheck.run.isolation import Attempt, ChildProcesses, run_engine
from crosscheck.run.jobs import CaseRun
from crosscheck.run.runner import _run_job
from crosscheck.run.work import Options
from crosscheck.verdicts.plan import Task, discover

SHARED = Path(rogue_program.__file__).parent
LIMIT = 60.0  # [s]: no test waits for it
Go = Callable[..., Attempt]


@pytest.fixture(scope="module")
def task(root: Path) -> Task:
    return discover(root / "models", ["double_pendulum"]).tasks[0]


def engine(name: str, *words: str, **more: Any) -> Engine:
    """A program, as crosscheck.toml would state it."""
    settings = {"command": [sys.executable, *words], "folder": str(SHARED), "refine": False, "cases": ["*"], **more}
    return Engine(name, COMMAND, "", "", settings=settings)


@pytest.fixture(scope="module")
def children() -> Iterator[ChildProcesses]:
    """Processes that are forked, as a run's are."""
    servers = ForkServers()
    yield ChildProcesses(servers=servers)
    servers.close()


@pytest.fixture
def go(task: Task, tmp_path: Path, children: ChildProcesses) -> Go:
    def call(kind: str, limit: float = LIMIT, **more: Any) -> Attempt:
        words = ("rogue_program.py", kind, str(task.folder), task.case.name, str(tmp_path), "{kit}", "{out}")
        job = {"mechanism": str(task.folder), "case": task.case.name, "options": {"error": False}}
        return run_engine(engine(kind, *words, **more), job, task.time, limit, children)

    return call


def test_a_good_program_gives_its_record(go: Go, task: Task) -> None:
    attempt = go("fine")
    record = attempt.record
    assert (record.status, record.version, record.engine) == ("ok", "0.rogue", "fine")
    assert set(record.series) == {f"torque/{name}" for name in task.mechanism.velocity_names}
    assert record.model_hash
    assert "rogue_program.py fine" in record.settings["command"]
    assert record.wall_time > 0.0


@pytest.mark.parametrize(
    ("kind", "status", "message"),
    [
        ("killed", "error", "the program was killed by signal 9 (SIGKILL)"),
        ("leaving", "error", "the program left with exit code 3: licence expired"),
        pytest.param("refusing", "skipped", "has no legs", marks=pytest.mark.slow),
        pytest.param(
            "crashing", "error", "killed by signal 6 (SIGABRT): the solver's last words", marks=pytest.mark.slow
        ),
        pytest.param("raising", "error", "ArithmeticError: singular <matrix> & worse", marks=pytest.mark.slow),
        pytest.param("nan", "error", "1 of {n} values are no finite numbers, the first at t =", marks=pytest.mark.slow),
        pytest.param("truncated", "error", "has 5 times, not the {n} of the case", marks=pytest.mark.slow),
        pytest.param("drifting", "error", "where the case has", marks=pytest.mark.slow),
        pytest.param("empty", "error", "holds no series.csv: nothing was answered", marks=pytest.mark.slow),
        pytest.param("odd-settings", "error", "step: Input should be a finite number", marks=pytest.mark.slow),
        pytest.param("flooding", "error", "exit code 1: OSError: [Errno 27] File too large", marks=pytest.mark.slow),
    ],
)
def test_misbehaviour_becomes_words(go: Go, task: Task, kind: str, status: str, message: str) -> None:
    record = go(kind).record
    assert record.status == status
    assert message.format(n=task.time.size) in record.message
    assert not record.series


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["garbage", "loud"])
def test_what_a_program_prints_is_kept_and_harmless(go: Go, kind: str) -> None:
    attempt = go(kind)
    assert attempt.record.status == "ok"
    assert 0 < len(attempt.printed) <= 4000
    assert "\0" not in attempt.printed


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["damped", "heavy", "noisy", "steady"])
def test_a_program_with_a_mistake_answers_all_the_same(go: Go, kind: str) -> None:
    record = go(kind).record
    assert record.status == "ok"
    assert bool(record.certificate.get("mass")) == (kind == "heavy")


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    ["hanging", pytest.param("stubborn", marks=pytest.mark.slow), pytest.param("breeding", marks=pytest.mark.slow)],
)
def test_a_hang_ends_at_the_time_limit_with_all_it_started(go: Go, tmp_path: Path, kind: str) -> None:
    begun = clock.monotonic()
    assert go("fine").record.status == "ok"
    limit = math.ceil(
        max(2.0, 4.0 * (clock.monotonic() - begun))
    )  # [s]: on a busy machine, too, it begins before it hangs
    done: list[Attempt] = []
    worker = threading.Thread(target=lambda: done.append(go(kind, limit=float(limit))))
    worker.start()
    end = clock.monotonic() + LIMIT
    while not (result := [int(f.name) for f in tmp_path.iterdir() if f.name.isdigit()]) and clock.monotonic() < end:
        clock.sleep(0.05)
    leader = os.getpgid(result[0])
    family = [p for p in map(int, filter(str.isdigit, os.listdir("/proc"))) if _group(p) == leader]
    assert len(family) >= (3 if kind == "breeding" else 2)  # the child process, the program, what it started
    worker.join()
    assert done[0].record.status == "timeout"
    clock.sleep(0.5)
    assert not [p for p in family if _alive(p)]


def _group(pid: int) -> int:
    try:
        return os.getpgid(pid)
    except ProcessLookupError:
        return -1


def _alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def test_a_program_that_is_not_there_is_named(task: Task, children: ChildProcesses) -> None:
    missing = Engine(
        "mine", COMMAND, "", "", settings={"command": ["./no_such_program", "{out}"], "folder": str(SHARED)}
    )
    job = {"mechanism": str(task.folder), "case": task.case.name, "options": {}}
    record = run_engine(missing, job, task.time, LIMIT, children).record
    assert record.status == "error"
    assert "no_such_program cannot be run: No such file or directory" in record.message


@pytest.mark.slow
def test_three_runs_give_error_bars(root: Path, tmp_path: Path, children: ChildProcesses) -> None:
    """The chain of rods takes the steps that it is asked for, and keeps its rods: the bar is that of its steps.

    A move of 0.1 s without a rest has as many steps as an order needs.
    """
    folder = tmp_path / "flex_one_link"
    shutil.copytree(root / "models" / "flex_one_link", folder)
    cases = (folder / "cases.toml").read_text()
    (folder / "cases.toml").write_text(cases.replace("duration_s = 0.2\nhold_s = 0.3", "duration_s = 0.1", 1))
    task = discover(tmp_path, ["flex_one_link/cycloid"]).tasks[0]
    assert task.time[-1] == 0.1
    programs = SHARED / "kit_programs"
    words = ("beam.py", "{kit}", "{out}")
    job = {"mechanism": str(task.folder), "case": task.case.name, "options": {}}
    one = engine("chain", *words, folder=str(programs), refine=True)
    record = run_engine(one, job, task.time, LIMIT, children).record
    assert record.status == "ok", record.message
    line = record.budget["torque/hub"]
    # Its steps are halved twice, its rods stay: the difference of the runs is that of Runge and Kutta's steps alone.
    assert 0.0 < line["bar"] < 1e-3 * line["peak"]
    assert line["order"]["step and mesh"] > 2.0


def test_a_program_is_asked_for_what_it_does(task: Task, children: ChildProcesses) -> None:
    job = {"mechanism": str(task.folder), "case": task.case.name, "options": {}}
    record = run_engine(engine("mine", "-c", "1", cases=["ur5/*"]), job, task.time, LIMIT, children).record
    assert (record.status, record.message) == ("skipped", "crosscheck.toml asks it for ur5/* only")


@pytest.mark.slow
def test_numpy_answers_loops_and_agrees(root: Path, children: ChildProcesses) -> None:
    task = discover(root / "models", ["four_bar/turn"]).tasks[0]
    job = {"mechanism": str(task.folder), "case": task.case.name, "options": {}}
    ours = run_engine(ENGINES["flexinv"], job, task.time, LIMIT, children).record
    one = engine("numpy", "rigid.py", "{kit}", "{out}", folder=str(SHARED / "kit_programs"))
    theirs = run_engine(one, job, task.time, LIMIT, children).record
    assert theirs.status == "ok", theirs.message
    for name in ("torque/A", "torque/B", "tip/rocker/x"):
        np.testing.assert_allclose(theirs.series[name].values, ours.series[name].values, rtol=0, atol=1e-12)
    assert theirs.series["torque/A"].error is not None  # of rounding: it ran twice


def test_nothing_of_ours_is_in_reach_in_a_blind_round(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, root: Path
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(root))
    monkeypatch.setenv("PROJECT", str(root / "models"))
    environment = make_environment(tmp_path)
    assert not [name for name, value in environment.items() if str(root) in value and name != "PATH"]
    assert environment["PYTHONPATH"] == str(tmp_path / "hidden")
    assert str(root) not in make_environment().get("PYTHONPATH", "")


@pytest.mark.slow
def test_a_worker_of_a_cluster_asks_programs_and_records(root: Path, tmp_path: Path) -> None:
    """What Dask sends is pickled: the engine with its door, and the files of the mechanism with its records."""
    models = tmp_path / "models"
    shutil.copytree(root / "models" / "double_pendulum", models / "double_pendulum")
    answered = models / "double_pendulum" / "records" / "adams" / "swing"
    kit = tmp_path / "kit"
    task = discover(models, ["double_pendulum/swing"]).tasks[0]
    write(task.mechanism, task.case, kit)
    answered.parent.mkdir(parents=True)
    words = [sys.executable, str(SHARED / "kit_programs" / "rigid.py"), str(kit), str(answered)]
    subprocess.run(words, check=True, timeout=60)
    one = engine("numpy", "rigid.py", "{kit}", "{out}", folder=str(SHARED / "kit_programs"))
    records = Engine("adams", RECORD, "", "", settings={})
    for which in (one, records):
        job = pickle.loads(pickle.dumps(CaseRun(task, which)))
        files = read_task_files(job)
        shutil.move(models, tmp_path / "hidden")  # a worker has another file system
        attempt = run_on_worker(_run_job, job, files, Options(timeout=60.0))
        shutil.move(tmp_path / "hidden", models)
        assert attempt.record.status == "ok", attempt.record.message
        assert attempt.record.engine == which.name
