"""Prepared processes outlive a run, and what has changed between two runs is seen."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from crosscheck.engines import ENGINES, Engine
from crosscheck.run.forking import MOST_IDLE, ForkServers, KeptServers
from crosscheck.run.isolation import ChildProcesses, run_engine
from crosscheck.verdicts.plan import Task, discover

LIMIT = 60.0  # [s]: no test waits for it
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere no process is prepared")
ADAPTER = """
import os

def version(): return "{version}"
def abilities(): return "Says who prepared it."
def unsupported(mechanism, case, engine): return None
def run(mechanism, case, engine, options): raise RuntimeError("version {version}, prepared by " + str(os.getppid()))
"""


@pytest.fixture
def kept() -> Iterator[KeptServers]:
    """A store of its own."""
    result = KeptServers()
    yield result
    result.close()


@pytest.fixture(scope="module")
def task(root: Path) -> Task:
    return discover(root / "models", ["double_pendulum"]).tasks[0]


def run_case(task: Task, engine: Engine, servers: ForkServers) -> str:
    """Run a case in an engine and return the words of its end."""
    job = {"mechanism": str(task.folder.resolve()), "case": task.case.name, "options": {}}
    servers.begin_common()
    return run_engine(engine, job, task.time, LIMIT, ChildProcesses(servers=servers)).record.message


def find_common(servers: ForkServers) -> int:
    """Return the number of the common process."""
    servers.begin_common()
    assert servers.common is not None
    return servers.common.process.pid


def test_the_next_run_finds_engines_imported(kept: KeptServers, task: Task) -> None:
    pids = []
    for _ in range(2):
        with kept.open_servers() as servers:
            assert run_case(task, ENGINES["pinocchio"], servers) == ""
            pids.append([find_common(servers), *(one.process.pid for one in servers.known.values())])
    assert pids[0] == pids[1]
    kept.close()
    assert not any(psutil.pid_exists(pid) for pid in pids[0])


def test_two_at_once_have_a_set_each(kept: KeptServers) -> None:
    with kept.open_servers() as one, kept.open_servers() as other:
        assert find_common(one) != find_common(other)


def test_code_of_others_is_read_anew_in_every_run(
    kept: KeptServers, task: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")  # two versions of one second have one time
    engine = Engine("guest", "guest_adapter", "numpy", "")
    file = tmp_path / "guest_adapter.py"
    for version in ("first", "second"):
        file.write_text(ADAPTER.format(version=version), encoding="utf-8")
        with kept.open_servers() as servers:
            words = [run_case(task, engine, servers) for _ in range(2)]
        assert f"version {version}" in words[0]
        assert words[0] == words[1]  # within a run it is prepared once


def test_an_environment_has_its_own_set_and_the_oldest_of_many_ends(
    kept: KeptServers, monkeypatch: pytest.MonkeyPatch
) -> None:
    pids = {}
    for place in [str(number) for number in range(MOST_IDLE + 1)]:
        monkeypatch.setenv("ROS_PACKAGE_PATH", place)
        with kept.open_servers() as servers:
            pids[place] = find_common(servers)
    assert len(set(pids.values())) == MOST_IDLE + 1
    assert [psutil.pid_exists(pid) for pid in pids.values()] == [False] + [True] * MOST_IDLE


def test_what_was_interrupted_or_has_died_is_not_kept(kept: KeptServers) -> None:
    with kept.open_servers() as servers:
        first = find_common(servers)
        servers.end_processes()
    with kept.open_servers() as servers:
        second = find_common(servers)
    os.kill(second, 9)
    psutil.wait_procs([psutil.Process(second)], timeout=LIMIT)
    with kept.open_servers() as servers:
        assert len({first, second, find_common(servers)}) == 3


def test_a_set_that_ended_with_the_thread_that_began_it_is_not_used(kept: KeptServers, task: Task) -> None:
    pids = []

    def run() -> None:
        with kept.open_servers() as servers:
            assert run_case(task, ENGINES["pinocchio"], servers) == ""
            pids.append(find_common(servers))

    for _ in range(2):
        thread = threading.Thread(target=run)
        thread.start()
        thread.join()
        psutil.wait_procs([one for one in psutil.process_iter() if one.pid == pids[-1]], timeout=LIMIT)
    assert pids[0] != pids[1]
