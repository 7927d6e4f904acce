"""Whatever an engine does in its process, the parent goes on and says what happened.  Real processes, no mocks."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time as clock
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import rogue_engines as rogue

from crosscheck.engines import Engine
from crosscheck.run.forking import ForkServers
from crosscheck.run.isolation import Attempt, ChildProcesses, ask, describe_timeout, open_scratch_folder, run_engine
from crosscheck.run.processes import read_waiting_time
from crosscheck.verdicts.plan import Task, discover

LIMIT = 60.0  # [s]: no test waits for it; a child needs a second or two to import on a busy machine


@pytest.fixture(scope="module")
def task(root: Path) -> Task:
    return discover(root / "models", ["double_pendulum"]).tasks[0]


@pytest.fixture
def attempt(task: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Attempt]:
    monkeypatch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))

    def go(kind: str, limit: float = LIMIT, children: ChildProcesses | None = None) -> Attempt:
        job = {"mechanism": str(task.folder), "case": task.case.name, "options": {"pids": str(tmp_path)}}
        return run_engine(rogue.engine(kind), job, task.time, limit, children or ChildProcesses())

    return go


def gone(pid: int) -> bool:
    """Whether a process has ended (a zombie that nobody has waited for has ended, too)."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return True
    return state == "Z"


def wait_for(condition: Callable[[], Any], seconds: float = LIMIT) -> Any:
    end = clock.monotonic() + seconds
    while clock.monotonic() < end:
        if result := condition():
            return result
        clock.sleep(0.05)
    raise AssertionError("it did not happen in time")


def pids(folder: Path) -> list[int]:
    return [int(f.name) for f in folder.iterdir() if f.name.isdigit()]


def test_a_good_engine_gives_its_record(attempt: Callable[..., Attempt], task: Task) -> None:
    record = attempt("fine").record
    assert (record.status, record.version, record.engine) == ("ok", "0.rogue", "fine")
    assert set(record.series) == {f"torque/{name}" for name in task.mechanism.velocity_names}
    assert record.model_hash


@pytest.mark.parametrize(
    ("kind", "status", "message"),
    [
        ("refusing", "skipped", "has no legs"),
        ("killed", "error", "killed by signal 9 (SIGKILL)"),
        pytest.param("crashing", "error", "killed by signal 6 (SIGABRT)", marks=pytest.mark.slow),
        pytest.param("leaving", "error", "left with exit code 3: licence expired", marks=pytest.mark.slow),
        ("raising", "error", "ArithmeticError: singular <matrix> & worse"),
        ("nan", "error", "1 of {n} values are not finite, the first at t ="),
        pytest.param("truncated", "error", "gives 5 of {n} samples and stops at t =", marks=pytest.mark.slow),
        pytest.param("drifting", "error", "other sample times", marks=pytest.mark.slow),
        pytest.param("empty", "error", "says ok and gives no series", marks=pytest.mark.slow),
        pytest.param("odd-settings", "error", "not JSON compliant", marks=pytest.mark.slow),
    ],
)
def test_misbehaviour_becomes_words(
    attempt: Callable[..., Attempt], task: Task, kind: str, status: str, message: str
) -> None:
    record = attempt(kind).record
    assert record.status == status
    assert message.format(n=task.time.size) in record.message
    assert not record.series


@pytest.mark.slow
def test_what_an_engine_prints_is_kept_and_harmless(attempt: Callable[..., Attempt]) -> None:
    assert "the solver's last words" in attempt("crashing").printed
    assert "test_isolation" not in attempt("raising").printed
    loud = attempt("garbage")
    assert loud.record.status == "ok"
    assert 0 < len(loud.printed) <= 4000
    assert "\0" not in loud.printed


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    ["hanging", pytest.param("stubborn", marks=pytest.mark.slow), pytest.param("breeding", marks=pytest.mark.slow)],
)
def test_a_hang_ends_at_the_time_limit_with_all_it_started(
    attempt: Callable[..., Attempt], tmp_path: Path, kind: str
) -> None:
    begun = clock.monotonic()
    assert attempt("fine").record.status == "ok"
    limit = math.ceil(
        max(2.0, 4.0 * (clock.monotonic() - begun))
    )  # [s]: on a busy machine, too, it begins before it hangs
    done: list[Attempt] = []
    worker = threading.Thread(target=lambda: done.append(attempt(kind, limit=float(limit))))
    worker.start()
    (pid,) = wait_for(lambda: pids(tmp_path))
    family = [p for p in map(int, filter(str.isdigit, os.listdir("/proc"))) if group(p) == pid]
    assert len(family) >= (2 if kind == "breeding" else 1)
    worker.join()
    assert done[0].record.status == "timeout"
    assert done[0].record.message.startswith(f"stopped after the time limit of {limit} s")
    wait_for(lambda: all(map(gone, family)), 5.0)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not list processes as files")
@pytest.mark.parametrize(("kind", "status"), [("fleeing", "timeout"), ("leaving-behind", "error")])
@pytest.mark.parametrize("forked", [False, True])
def test_a_child_in_a_session_of_its_own_ends_with_its_job(
    attempt: Callable[..., Attempt], tmp_path: Path, kind: str, status: str, forked: bool
) -> None:
    """No signal to the group reaches it: it is found as a descendant, or by its mark where its parent has crashed."""
    servers = ForkServers() if forked else None
    children = ChildProcesses(servers=servers)
    begun = clock.monotonic()
    assert attempt("fine", children=children).record.status == "ok"
    limit = max(2.0, 4.0 * (clock.monotonic() - begun))  # [s]: on a busy machine, too, it begins before it hangs
    try:
        assert attempt(kind, limit=limit, children=children).record.status == status
        assert pids(tmp_path)
        wait_for(lambda: all(map(gone, pids(tmp_path))), 5.0)
    finally:
        if servers is not None:
            servers.close()


# Programs that share one processor: it is a busy machine for all of them.
SHARED = "import os, time\nos.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n"
SPIN = SHARED + "while True:\n    pass\n"
SLEEP = SHARED + "print('asleep', flush=True)\ntime.sleep(600)\n"


@pytest.mark.skipif(
    not Path("/proc/self/schedstat").exists(), reason="this system does not say who waits for a processor"
)
def test_who_waits_for_a_processor_is_told_from_who_sleeps() -> None:
    programs = [["nice", "-n", "19", sys.executable, "-c", SPIN], *([[sys.executable, "-c", SPIN]] * 2)]
    with subprocess.Popen([sys.executable, "-c", SLEEP], stdout=subprocess.PIPE) as asleep:
        assert asleep.stdout is not None
        assert asleep.stdout.readline() == b"asleep\n"
        before = read_waiting_time(asleep.pid)
        spinning = [subprocess.Popen(words) for words in programs]
        try:
            wait_for(lambda: read_waiting_time(spinning[0].pid) > 2.0)
            assert read_waiting_time(asleep.pid) - before < 0.5
        finally:
            for one in (asleep, *spinning):
                one.kill()
                one.wait()
    assert read_waiting_time(spinning[0].pid) == 0.0  # it is gone


def test_a_late_process_that_had_no_processor_is_not_said_to_hang() -> None:
    assert describe_timeout(900.0, 3.0) == "stopped after the time limit of 900 s"
    assert describe_timeout(900.0, 850.0).endswith(
        "of which it waited 850 s for a processor: too much runs on this machine"
    )


def group(pid: int) -> int:
    try:
        return os.getpgid(pid)
    except ProcessLookupError:
        return -1


def test_a_missing_package_says_how_to_install_it(task: Task) -> None:
    engine = Engine("absent", "rogue_engines", "no_such_package", "python -m pip install no-such-package")
    record = run_engine(engine, {}, task.time, LIMIT, ChildProcesses()).record
    assert record.status == "error"
    assert "not installed" in record.message
    assert "python -m pip install no-such-package" in record.message


def test_stop_ends_all_children_and_starts_no_more(attempt: Callable[..., Attempt], tmp_path: Path) -> None:
    children, done = ChildProcesses(), []
    worker = threading.Thread(target=lambda: done.append(attempt("hanging", children=children)))
    worker.start()
    (pid,) = wait_for(lambda: pids(tmp_path))
    children.end_processes()
    worker.join(10.0)
    assert not worker.is_alive()
    assert done[0].record.message == "interrupted"
    assert gone(pid)
    assert attempt("fine", children=children).record.message == "interrupted before it started"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells a child that its parent died")
def test_a_parent_that_is_killed_leaves_no_orphans(attempt: object, task: Task, tmp_path: Path) -> None:
    script = textwrap.dedent("""
        import sys
        import numpy as np
        import rogue_engines as rogue
        from crosscheck.run.isolation import ChildProcesses, run_engine
        job = {"mechanism": sys.argv[1], "case": sys.argv[2], "options": {"pids": sys.argv[3]}}
        run_engine(rogue.engine("hanging"), job, np.zeros(1), 600.0, ChildProcesses())
    """)
    path = os.pathsep.join([os.environ["PYTHONPATH"], str(task.folder.parents[1])])
    parent = subprocess.Popen(
        [sys.executable, "-c", script, str(task.folder), task.case.name, str(tmp_path)],
        env=os.environ | {"PYTHONPATH": path},
    )
    (pid,) = wait_for(lambda: pids(tmp_path))
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    wait_for(lambda: gone(pid), 10.0)


@pytest.mark.slow
def test_questions_are_answered_or_explained(attempt: object) -> None:
    answer, ending = ask({"kind": "describe", "module": "rogue_engines", "engine": "rogue"}, LIMIT, ChildProcesses())
    assert answer == {"version": "0.rogue", "abilities": "Does one thing wrong."}
    answer, ending = ask({"kind": "describe", "module": "no_such_module", "engine": "rogue"}, LIMIT, ChildProcesses())
    assert answer is None
    assert "No module named 'no_such_module'" in ending.message


def test_a_folder_that_is_deeper_than_python_goes_is_removed() -> None:
    """An engine made it in its own folder, where nobody else looks."""
    here = Path.cwd()
    with open_scratch_folder() as folder:
        os.chdir(folder)
        for _ in range(1500):
            os.mkdir("deep" * 20)
            os.chdir("deep" * 20)
        Path("file").touch()
        os.chdir(here)
    assert not folder.exists()
