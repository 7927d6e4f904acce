"""Whatever a reader does in its process becomes words within the limits, and nothing of it is left."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time as clock
from pathlib import Path

import psutil
import pytest
from click.testing import CliRunner

from crosscheck.cli import main
from crosscheck.run.reading_limits import ReadingLimits, UnreadFile, can_fork
from flexinv.errors import InputError

LIMIT = 5.0  # [s]
SLOW = 20.0  # [s] of a fresh process, which imports everything first
ENOUGH = {LIMIT: 1.0, SLOW: 5.0}  # [s] for a reader that sleeps: whatever is stopped after it gets the same words
SLEEPER = [sys.executable, "-c", "import time; time.sleep(600)"]


def answer(file: str, number: int) -> tuple[str, int]:
    return f"{file} in {Path.cwd()}", number + 1


def name_server(file: str) -> int:
    return os.getppid()


def refuse(file: str) -> None:
    raise InputError(f"{file}: no machine")


def fail(file: str) -> None:
    raise KeyError("a key")


def crash(file: str) -> None:
    ctypes.string_at(0)


def abort(file: str) -> None:
    os.write(2, b"Assertion failed in line 3\n")
    os.abort()


def leave(file: str) -> None:
    os._exit(7)


def sleep(file: str) -> None:
    clock.sleep(600)


def ignore_all(file: str) -> None:
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    clock.sleep(600)


def swell(file: str) -> None:
    bytearray(50 << 30)


def recurse(file: str) -> None:
    recurse(file)


def start_others(file: str) -> int:
    subprocess.Popen(SLEEPER, start_new_session=True)
    return subprocess.Popen(SLEEPER).pid


def start_others_and_sleep(file: str) -> None:
    start_others(file)
    clock.sleep(600)


def wait_for_input(file: str) -> str:
    return sys.stdin.read() + os.read(0, 100).decode()


STOPPED = "reading it was stopped after the time limit of"
ENDS = {
    fail: "its reader fails: KeyError: 'a key'",
    crash: r"its reader fails: killed by signal 11 \(SIGSEGV\)",
    abort: r"its reader fails: killed by signal 6 \(SIGABRT\)",
    leave: "its reader fails: left with exit code 7",
    sleep: STOPPED,
    ignore_all: STOPPED,
    swell: "reading it asked for more than 4 GB of memory",
    recurse: "its reader fails: RecursionError",
    start_others_and_sleep: STOPPED,
}


def sleepers() -> list[psutil.Process]:
    """Sleepers that have not been killed; a process that was ends a moment later."""
    result = [one for one in psutil.process_iter(["cmdline"]) if one.info["cmdline"] == SLEEPER]
    return psutil.wait_procs(result, timeout=10)[1]


@pytest.fixture(params=["a copy", "a fresh process"])
def guard(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> ReadingLimits:
    """A guard whose calls are copies of this process, or fresh ones."""
    if request.param == "a copy" and not can_fork():
        pytest.skip("other threads run in this process")
    monkeypatch.setattr("crosscheck.run.reading_limits.can_fork", lambda: request.param == "a copy")
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))
    return ReadingLimits(LIMIT if request.param == "a copy" else SLOW)


def test_an_answer_comes_back_and_a_refusal_stays_one(
    guard: ReadingLimits, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert guard.run_function(answer, "arm.urdf", 2) == (f"arm.urdf in {tmp_path}", 3)
    with pytest.raises(InputError, match=r"arm\.urdf: no machine") as caught:
        guard.run_function(refuse, "arm.urdf")
    assert not isinstance(caught.value, UnreadFile)
    assert guard.run_function(wait_for_input, "arm.urdf") == ""


def test_where_threads_run_readers_are_prepared_once_for_an_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crosscheck.run.reading_limits.can_fork", lambda: False)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))
    guard = ReadingLimits(SLOW)
    server = guard.run_function(name_server, "arm.urdf")
    assert server != os.getpid()
    assert guard.run_function(name_server, "arm.urdf") == server
    monkeypatch.setenv("ROS_PACKAGE_PATH", "/elsewhere")  # by which readers find files
    after = guard.run_function(name_server, "arm.urdf")
    assert after != server
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    assert guard.run_function(name_server, "arm.urdf") == server
    for place in ("/elsewhere/again", "/elsewhere"):
        monkeypatch.setenv("ROS_PACKAGE_PATH", place)
        after = guard.run_function(name_server, "arm.urdf")
    assert not psutil.pid_exists(server)  # two environments are kept
    os.kill(psutil.Process(after).ppid(), signal.SIGKILL)  # the common one, and with it all that were forked from it
    assert guard.run_function(name_server, "arm.urdf") not in (server, after)


@pytest.mark.parametrize("end", ENDS)
def test_whatever_a_reader_does_becomes_words(end: object, guard: ReadingLimits) -> None:
    words = ENDS[end]
    if words == STOPPED:
        guard = ReadingLimits(ENOUGH[guard.seconds])
        words += f" {guard.seconds:g} s"
    with pytest.raises(UnreadFile, match=rf"^arm.urdf\n  given:    {words}.*\n  expected: .*\n  write:    .*"):
        guard.run_function(end, "arm.urdf")
    assert sleepers() == []


def test_what_a_reader_started_ends_with_it(guard: ReadingLimits) -> None:
    guard.run_function(start_others, "arm.urdf")
    assert sleepers() == []


def test_beside_other_threads_no_copy_is_made() -> None:
    """A lock that another thread holds would stay shut in a copy."""
    stop = threading.Event()
    other = threading.Thread(target=stop.wait)
    other.start()
    assert not can_fork()
    stop.set()
    other.join()


@pytest.mark.parametrize(
    ("word", "value"), [("--timeout", "0"), ("--timeout", "nan"), ("--memory", "0.1"), ("--memory", "x")]
)
@pytest.mark.parametrize("command", ["lint", "compare"])
def test_limits_that_are_none_are_refused(command: str, word: str, value: str) -> None:
    run = CliRunner().invoke(main, [command, "a.urdf", word, value])
    assert run.exit_code == 2
    assert word in run.output
