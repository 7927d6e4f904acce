"""Jobs that are forked from a prepared process give what fresh processes give, to the bit, and are as well contained."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import socket
import subprocess
import threading
import time as clock
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rogue_engines as rogue

from crosscheck.engines import ENGINES, Engine
from crosscheck.engines.base import can_fork_jobs, prepare_adapter
from crosscheck.run import fork_server, forking
from crosscheck.run.forking import ForkedProcess, ForkRefused, ForkServerLost, ForkServers
from crosscheck.run.isolation import Attempt, ChildProcesses, run_engine
from crosscheck.verdicts.plan import Task, discover

LIMIT = 60.0  # [s]: no test waits for it
linux = pytest.mark.skipif(
    not Path("/proc/self/task").is_dir(), reason="only Linux says how many threads a process has"
)
pytestmark = linux


@pytest.fixture(scope="module")
def task(root: Path) -> Task:
    return discover(root / "models", ["double_pendulum"]).tasks[0]


@pytest.fixture
def children(monkeypatch: pytest.MonkeyPatch) -> Iterator[ChildProcesses]:
    """The processes of a test of its own."""
    monkeypatch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
    servers = ForkServers()
    yield ChildProcesses(servers=servers)
    servers.close()


@pytest.fixture(scope="module")
def shared() -> Iterator[ChildProcesses]:
    """Prepared processes that tests share, for they leave them as they are."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
        servers = ForkServers()
        yield ChildProcesses(servers=servers)
        servers.close()


def attempt(
    task: Task, engine: Engine, children: ChildProcesses, limit: float = LIMIT, pids: Path | None = None, **more: Any
) -> Attempt:
    job = {"mechanism": str(task.folder.resolve()), "case": task.case.name, "options": {"pids": str(pids)}, **more}
    return run_engine(engine, job, task.time, limit, children)


def servers_of(children: ChildProcesses) -> ForkServers:
    assert children.servers is not None
    return children.servers


# Coarse runs, whose bits depend on the process as those of fine ones do.
COARSE: dict[str, dict[str, Any]] = {"exudyn-ancf": {"elements": 4, "step": 2.5e-4}}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "mechanism"),
    [
        ("flexinv", "flex_one_link"),
        ("pinocchio", "four_bar"),
        ("mujoco", "four_bar"),
        ("exudyn", "rigid_3r"),
        ("exudyn-ancf", "flex_one_link"),
    ],
)
def test_forked_and_fresh_processes_give_the_same_to_the_bit(
    name: str, mechanism: str, root: Path, shared: ChildProcesses
) -> None:
    task, options = discover(root / "models", [mechanism]).tasks[0], COARSE.get(name, {})
    forked = [attempt(task, ENGINES[name], shared, options=options).record for _ in range(2)]
    assert servers_of(shared).refusals == {}
    fresh = attempt(task, ENGINES[name], ChildProcesses(), options=options).record
    assert fresh.status == "ok"
    for other in forked:
        assert set(other.series) == set(fresh.series)
        for key, one in fresh.series.items():
            assert np.array_equal(other.series[key].values, one.values)
            assert (other.series[key].error is None) == (one.error is None)
            assert one.error is None or np.array_equal(other.series[key].error, one.error)
        assert (other.certificate, other.budget, other.model_hash) == (
            fresh.certificate,
            fresh.budget,
            fresh.model_hash,
        )


def test_a_process_is_prepared_once_and_every_job_has_its_own(
    task: Task, shared: ChildProcesses, tmp_path: Path
) -> None:
    assert attempt(task, rogue.engine("fine"), shared).record.status == "ok"
    server = servers_of(shared).known["rogue_engines"]
    first = server.process.pid
    assert attempt(task, rogue.engine("killed"), shared).record.message == "killed by signal 9 (SIGKILL)"
    assert attempt(task, rogue.engine("crashing"), shared).record.message == "killed by signal 6 (SIGABRT)"
    left = attempt(task, rogue.engine("leaving"), shared)
    assert left.record.message == "left with exit code 3: licence expired"
    assert "licence expired" in left.printed
    limit = patience(task, shared)
    late = attempt(task, rogue.engine("breeding"), shared, limit, tmp_path)
    assert late.record.message.startswith(f"stopped after the time limit of {limit:g} s")
    (pid,) = [int(f.name) for f in tmp_path.iterdir()]
    wait_for(lambda: not living(pid), 5.0)
    assert attempt(task, rogue.engine("fine"), shared).record.status == "ok"
    assert server.process.pid == first
    assert living(first)


def patience(task: Task, children: ChildProcesses) -> float:
    """Return a time limit [s] within which an engine begins, on a busy machine, too."""
    begun = clock.monotonic()
    assert attempt(task, rogue.engine("fine"), children).record.status == "ok"
    return float(math.ceil(max(2.0, 4.0 * (clock.monotonic() - begun))))


def living(leader: int) -> list[str]:
    """Return the processes of a group that have not ended (a zombie has, though nobody has waited for it)."""
    result = []
    for file in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            state, _, its_group = file.read_text().rsplit(")", 1)[1].split()[:3]
            result += [file.parent.name] if int(its_group) == leader and state != "Z" else []
    return result


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "why"),
    [
        ("rogue_threads", "1 other thread runs after its imports"),
        ("rogue_unforkable", "its adapter says that it must not be forked"),
    ],
)
def test_an_engine_that_must_not_be_forked_starts_afresh(
    module: str, why: str, task: Task, children: ChildProcesses
) -> None:
    for _ in range(2):
        record = attempt(task, Engine("fine", module, "numpy", "never"), children).record
        assert (record.status, record.version) == ("ok", "0.rogue")
    assert servers_of(children).refusals == {module: why}


def test_an_engine_that_cannot_be_imported_says_so_itself(task: Task, children: ChildProcesses) -> None:
    record = attempt(task, Engine("gone", "no_such_module", "numpy", "never"), children).record
    assert record.message == "ModuleNotFoundError: No module named 'no_such_module'"


@pytest.mark.slow
def test_a_job_whose_prepared_process_dies_is_done_again(task: Task, children: ChildProcesses, tmp_path: Path) -> None:
    done: list[Attempt] = []
    engine, limit = rogue.engine("hanging"), patience(task, ChildProcesses())
    worker = threading.Thread(target=lambda: done.append(attempt(task, engine, children, limit, tmp_path)))
    worker.start()
    wait_for(lambda: len(list(tmp_path.iterdir())) == 1)
    (server,) = servers_of(children).known.values()
    os.kill(server.process.pid, signal.SIGKILL)
    worker.join()
    assert len(list(tmp_path.iterdir())) == 2  # it hung once more, in a fresh process
    assert done[0].record.status == "timeout"
    assert "the prepared process of this engine has died: done again in a fresh one" in done[0].printed


def test_stopping_ends_forked_jobs_and_prepared_processes(task: Task, children: ChildProcesses, tmp_path: Path) -> None:
    done: list[Attempt] = []
    worker = threading.Thread(
        target=lambda: done.append(attempt(task, rogue.engine("hanging"), children, LIMIT, tmp_path))
    )
    worker.start()
    wait_for(lambda: list(tmp_path.iterdir()))
    children.end_processes()
    worker.join(10.0)
    assert done[0].record.message == "interrupted"
    (server,) = servers_of(children).known.values()
    wait_for(lambda: not living(server.process.pid), 10.0)
    assert attempt(task, rogue.engine("fine"), children).record.message == "interrupted before it started"


def test_engines_share_one_common_process(task: Task, shared: ChildProcesses) -> None:
    """One process is started; those of the engines are its children, and each imports no engine but its own."""
    for name in ("pinocchio", "mujoco"):
        assert attempt(task, ENGINES[name], shared).record.status == "ok"
    servers = servers_of(shared)
    assert servers.common is not None
    for name, other in (("pinocchio", "mujoco"), ("mujoco", "pinocchio")):
        pid = servers.known[ENGINES[name].module].process.pid
        assert int(Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[1]) == servers.common.process.pid
        mapped = Path(f"/proc/{pid}/maps").read_text()
        assert f"lib{name}" in mapped
        assert f"lib{other}" not in mapped


def test_without_the_common_process_every_job_starts_afresh(task: Task, children: ChildProcesses) -> None:
    servers = servers_of(children)
    servers.common = forking._begin_common()
    os.kill(servers.common.process.pid, signal.SIGKILL)
    for _ in range(2):
        assert attempt(task, rogue.engine("fine"), children).record.status == "ok"
    assert servers.known == {}
    assert servers.common.refusal == "its prepared process has died"


def wait_for(condition: Callable[[], Any], seconds: float = LIMIT) -> None:
    end = clock.monotonic() + seconds
    while not condition():
        assert clock.monotonic() < end, "it did not happen in time"
        clock.sleep(0.02)


def test_what_is_to_be_repeated_starts_afresh(task: Task, children: ChildProcesses) -> None:
    assert attempt(task, rogue.engine("fine"), children, afresh=True).record.status == "ok"
    assert servers_of(children).known == {}


def test_forked_jobs_draw_numbers_of_their_own(task: Task, shared: ChildProcesses) -> None:
    values = [attempt(task, rogue.engine("drawing"), shared).record.series for _ in range(2)]
    assert not np.array_equal(*(next(iter(series.values())).values for series in values))


def test_trouble_is_seen_before_a_fork(monkeypatch: pytest.MonkeyPatch) -> None:
    stop = threading.Event()
    worker = threading.Thread(target=stop.wait)
    worker.start()
    try:
        assert "other thread" in fork_server.describe_fork_trouble()
    finally:
        stop.set()
        worker.join()
    monkeypatch.setattr(fork_server.os, "listdir", lambda folder: ["1"])
    monkeypatch.setattr(fork_server.os, "readlink", lambda file: "/dev/nvidia0")
    assert fork_server.describe_fork_trouble() == "it has /dev/nvidia0 open"
    monkeypatch.setattr(fork_server.os, "readlink", lambda file: "/dev/null")
    assert fork_server.describe_fork_trouble() == ""


def test_every_adapter_of_ours_may_be_forked() -> None:
    for engine in ENGINES.values():
        result = __import__(engine.module, fromlist=["run"])
        assert can_fork_jobs(result)
        prepare_adapter(result)


def test_another_system_forks_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(forking.sys, "platform", "darwin")
    with pytest.raises(ForkRefused, match="only Linux"):
        ForkServers().fork({"kind": "run", "module": "rogue_engines"}, tmp_path, tmp_path, 1)


def test_a_job_that_is_late_or_lost_says_so() -> None:
    ours, theirs = forking.socket.socketpair()
    job = ForkedProcess(os.getpid(), ours)
    with pytest.raises(subprocess.TimeoutExpired):
        job.wait(0.01)
    theirs.close()
    with pytest.raises(ForkServerLost):
        job.wait(1.0)
    ours.close()


def test_a_job_that_an_interrupt_has_ended_is_lost_and_no_failure_of_the_harness() -> None:
    """Another thread ends the job and closes its socket before this one begins to wait for it."""
    ours, theirs = socket.socketpair()
    job = ForkedProcess(os.getpid(), ours)
    ours.close()
    with pytest.raises(ForkServerLost):
        job.wait(1.0)
    theirs.close()
