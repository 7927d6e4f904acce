"""One process compiles, others wait; a process that dies leaves no lock behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from flexinv.kernels.compiler import compile_lock
from flexinv.kernels.compiler.compile_lock import CompileLock

HOLDER = """
import sys, time
from pathlib import Path
from flexinv.kernels.compiler.compile_lock import CompileLock
CompileLock(Path(sys.argv[1])).take()
print("held", flush=True)
time.sleep(60)
"""
USER = """
import json
from pathlib import Path
import doubled
print(json.dumps([doubled.twice(3.0), sum(doubled.twice.stats.cache_misses.values())]))
"""
MODULE = """
from flexinv.kernels.jit import jit, jit_inner

@jit_inner
def once(x):
    return x

@jit
def twice(x):
    return once(x) + once(x)
"""


def test_a_process_that_is_killed_leaves_no_lock(tmp_path: Path) -> None:
    path = tmp_path / "kernel.lock"
    holder = subprocess.Popen([sys.executable, "-c", HOLDER, str(path)], stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    lock = CompileLock(path)
    assert lock.take(patience=0.1)  # there is somebody to wait for
    assert lock._held is None  # and the patience ends
    os.kill(holder.pid, signal.SIGKILL)
    holder.wait()
    holder.stdout.close()
    lock.take(patience=10.0)
    assert lock._held is not None
    lock.drop_lock()
    assert not lock.take()  # free
    lock.drop_lock()


def test_where_no_file_can_be_made_nobody_waits(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    started = time.monotonic()
    assert not CompileLock(tmp_path / "file" / "kernel.lock").take()
    assert time.monotonic() - started < 1.0


def test_a_file_system_without_locks_stops_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(compile_lock.fcntl, "flock", refuse)
    lock = CompileLock(tmp_path / "kernel.lock")
    assert not lock.take()
    lock.drop_lock()


def test_of_processes_that_start_at_once_one_compiles(tmp_path: Path) -> None:
    (tmp_path / "doubled.py").write_text(MODULE)
    search = os.pathsep.join([str(tmp_path), str(Path(__file__).resolve().parents[4])])
    asked = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": search}
    users = [
        subprocess.Popen([sys.executable, "-c", USER], env=asked, stdout=subprocess.PIPE, text=True) for _ in range(3)
    ]
    result = [json.loads(user.communicate()[0]) for user in users]
    assert [value for value, _ in result] == [6.0] * 3
    assert sum(misses for _, misses in result) == 1


def test_a_kernel_that_cannot_be_compiled_keeps_no_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "doubled.py").write_text(MODULE.replace("return once(x) + once(x)", "return once(x).nothing"))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "doubled", raising=False)
    import doubled  # type: ignore[import-not-found]

    with pytest.raises(Exception, match="nothing"):
        doubled.twice(3.0)
    assert doubled.twice.lock._held is None
    monkeypatch.delitem(sys.modules, "doubled")


def test_the_first_kernel_that_is_compiled_is_told_once_and_none_after_the_block(tmp_path: Path) -> None:
    said: list[str] = []
    with compile_lock.add_compile_listener(lambda: said.append("compiling")):
        assert said == []
        for name in ("one", "two"):
            CompileLock(tmp_path / name).take()
    with compile_lock.add_compile_listener(lambda: said.append("never")):
        pass
    CompileLock(tmp_path / "three").take()
    assert said == ["compiling"]


def test_a_first_call_that_compiles_for_seconds_says_so_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for name in ("_BEGUN", "_SAID"):
        monkeypatch.setattr(compile_lock, name, [])
    for now in (10.0, 11.9, 12.1, 15.0):  # [s]
        compile_lock.warn_if_slow(now)
    assert caplog.messages == [compile_lock.NOTE]


def test_compiling_that_is_soon_done_is_not_told(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for name in ("_BEGUN", "_SAID"):
        monkeypatch.setattr(compile_lock, name, [])
    for now in (10.0, 11.9, 100.0):  # [s]: the last is one of a later call
        compile_lock.warn_if_slow(now)
    assert caplog.messages == []
