"""Prepared processes as the parent sees them: one per engine's adapter, forked from a common one when its first job comes.

A run borrows a set of them and gives it back, so that all runs of this Python process import what engines need once.  Only the
adapters of this package stay prepared: the code of others may be edited between two runs.

Where a job may not be forked, and where a prepared process has died, a fresh process is started instead: `ForkRefused` says why.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from crosscheck.output_folder import uninterrupted
from crosscheck.run.processes import end_process_group, end_process_tree, make_environment

PREPARE = 120.0  # [s] to import an engine: a cold disk takes some ten seconds
CURRENT_TEST = "PYTEST_CURRENT_TEST"  # pytest gives it another value for every test
MOST_IDLE = 2  # sets that nobody uses, of which each keeps a process per engine
OURS = "crosscheck."  # how names of this package's modules begin
PLAIN = ("study", "read")  # kinds of jobs whose module is no adapter


class ForkRefused(RuntimeError):
    """A job that is not forked, and why."""


class ForkServerLost(RuntimeError):
    """A prepared process that died before its job did."""


class ForkedProcess:
    """A process that was forked for a job, to be waited for as for one of `subprocess`."""

    def __init__(self, pid: int, answers: socket.socket) -> None:
        """Keep the process and the socket on which its end is told."""
        self.pid = pid
        self.returncode: int | None = None
        self._answers = answers

    def wait(self, timeout: float | None = None) -> int:
        """Return the exit code (negative: the signal) once it has ended; timeout : [s].

        Raises TimeoutExpired, and Lost where the process that it was forked from has died, and it with that one.
        """
        words = _read_line(self._answers, timeout)
        if words is None:
            raise subprocess.TimeoutExpired("a forked job", timeout or 0.0)
        if not words.startswith("ended "):
            raise ForkServerLost("the prepared process of this engine has died")
        self.returncode = int(words.removeprefix("ended "))
        return self.returncode

    def end(self) -> None:
        """Kill what is left of the process and of everything it started (what ended by itself, its server has ended)."""
        if self.returncode is None:
            end_process_tree(self.pid)
            with contextlib.suppress(ForkServerLost):
                self.wait()
        self._answers.close()


def _read_line(answers: socket.socket, limit: float | None) -> str | None:
    """Return the next line, "" where nobody writes any more, or ours is closed by an interrupt; None after ``limit`` [s]."""
    read = bytearray()
    try:
        answers.settimeout(limit)
        while not read.endswith(b"\n"):
            if not (more := answers.recv(1)):
                return ""
            read += more
    except TimeoutError:
        return None
    except OSError:
        return ""
    return read.decode().rstrip("\n")


@dataclass
class PreparedProcess:
    """A prepared process: the process, the socket for requests, its folder, and why it takes no more ("" where it does)."""

    process: subprocess.Popen[bytes] | ForkedProcess
    requests: socket.socket
    folder: tempfile.TemporaryDirectory[str]
    refusal: str = ""

    def fork(self, what: Mapping[str, Path], *descriptors: int) -> ForkedProcess:
        """Return the process of a job or of a door that runs in a folder and prints into a log.  Raises Refused.

        what : folder, and the file of the job or of the door; descriptors : of the log, and of the socket of a door
        """
        if self.refusal:
            raise ForkRefused(self.refusal)
        ours, theirs = socket.socketpair()
        words = json.dumps({name: str(path) for name, path in what.items()}).encode()
        try:
            with theirs:
                socket.send_fds(self.requests, [words], [theirs.fileno(), *descriptors])
            answer = _read_line(ours, PREPARE)
        except OSError:
            answer = ""
        if answer and answer.startswith("forked "):
            return ForkedProcess(int(answer.removeprefix("forked ")), ours)
        ours.close()
        self.refusal = self.refusal or self._describe_refusal(answer)
        self.end()
        raise ForkRefused(self.refusal)

    def _describe_refusal(self, answer: str | None) -> str:
        if answer is None:
            return f"it was not prepared after {PREPARE:g} s"
        return answer.removeprefix("refused ") or "its prepared process has died"

    def has_ended(self) -> bool:
        """Return True where a process that was not forked has ended."""
        return not isinstance(self.process, ForkedProcess) and self.process.poll() is not None

    def end(self) -> None:
        """End the process, and with it everything that was forked from it."""
        if isinstance(self.process, ForkedProcess):
            self.process.end()
        else:
            end_process_group(self.process.pid)
            self.process.wait()
        self.requests.close()
        self.folder.cleanup()


@dataclass
class ForkServers:
    """The prepared processes of a run: a common one, and one by each adapter that is imported.

    foreign : names of the adapters that are not of this package
    """

    common: PreparedProcess | None = None
    known: dict[str, PreparedProcess] = field(default_factory=dict)
    foreign: set[str] = field(default_factory=set)
    lock: threading.Lock = field(default_factory=threading.Lock)
    stopped: bool = False

    def fork(self, job: Mapping[str, object], job_file: Path, folder: Path, log: int) -> ForkedProcess:
        """Return the process of a job.  Raises Refused."""
        if sys.platform != "linux":
            raise ForkRefused("only Linux says how many threads a process has")
        return self._prepare_adapter(job).fork({"job": job_file, "folder": folder}, log)

    @property
    def refusals(self) -> dict[str, str]:
        """The reasons why jobs of an adapter were not forked, by its name."""
        return {name: one.refusal for name, one in self.known.items() if one.refusal}

    def _prepare_adapter(self, job: Mapping[str, object]) -> PreparedProcess:
        name = " ".join(filter(None, [str(job["module"]), str(job.get("path", ""))]))
        with self.lock:
            if self.stopped:
                raise ForkRefused("interrupted")
            common = self._find_common()
            if job["kind"] not in PLAIN and (job.get("path") or not name.startswith(OURS)):
                self.foreign.add(name)
            if name not in self.known:
                self.known[name] = _begin_prepared(common, job)
            return self.known[name]

    def begin_common(self) -> None:
        """Start the common process; by the thread that is to outlive all jobs, for it ends with the thread that began it.

        Nothing interrupts this: a process of which nobody knows would be left.
        """
        if sys.platform == "linux":
            with uninterrupted(), self.lock:
                self._find_common()

    def _find_common(self) -> PreparedProcess:
        """Return the common process, which begins now where it has not."""
        self.common = self.common or _begin_common()
        return self.common

    def end_foreign_adapters(self) -> None:
        """End the prepared processes of adapters that are not of this package, and forget those that refused or have died."""
        with self.lock:
            for name, one in list(self.known.items()):
                if name in self.foreign and not one.refusal:
                    one.end()
                if name in self.foreign or one.refusal:
                    del self.known[name]

    def end_processes(self) -> None:
        """End all of them, and start no more."""
        self.stopped = True
        if self.common is not None:
            end_process_tree(self.common.process.pid)  # whoever holds the lock waits for it
        with self.lock:
            for one in self.known.values():
                end_process_group(one.process.pid)

    def close(self) -> None:
        """End all of them and wait until they are gone, the common one last: it counts the time that the others took."""
        self.stopped = True
        with self.lock:
            for one in (*self.known.values(), self.common):
                if one is not None and not one.refusal:
                    one.end()


@dataclass
class KeptServers:
    """Sets of prepared processes that nobody uses, each with the environment in which it began, the oldest first."""

    idle: list[tuple[Mapping[str, str], ForkServers]] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)

    @contextmanager
    def open_servers(self) -> Iterator[ForkServers]:
        """Yield a set of prepared processes for one user, which began in today's environment; keep it afterwards.

        Engines find packages and plugins by the environment.
        """
        environment = {name: value for name, value in make_environment().items() if name != CURRENT_TEST}
        servers = self._take(environment) or ForkServers()
        try:
            yield servers
        finally:
            self._add_idle(environment, servers)

    def _take(self, environment: Mapping[str, str]) -> ForkServers | None:
        """Return a kept set of an environment, None where there is none.

        A common process ends with the thread that began it: sets without one are of no use any more.
        """
        with self.lock:
            for place in reversed(range(len(self.idle))):
                began_in, servers = self.idle[place]
                if servers.common is None or servers.common.has_ended():
                    del self.idle[place]
                    servers.close()
                elif began_in == environment:
                    del self.idle[place]
                    return servers
        return None

    def _add_idle(self, environment: Mapping[str, str], servers: ForkServers) -> None:
        if servers.stopped or servers.common is None or servers.common.refusal:
            servers.close()
            return
        servers.end_foreign_adapters()
        with self.lock:
            self.idle.append((environment, servers))
            surplus = [old for _, old in self.idle[:-MOST_IDLE]]
            del self.idle[:-MOST_IDLE]
        for old in surplus:
            old.close()

    def close(self) -> None:
        """End the processes that nobody uses."""
        with self.lock:
            for _, servers in self.idle:
                servers.close()
            self.idle.clear()


def _begin_common() -> PreparedProcess:
    folder = _make_folder()  # first: on a full disk there is nothing to be closed yet
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs, (Path(folder.name) / "printed.txt").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-X", "faulthandler", "-m", "crosscheck.run.fork_server", str(theirs.fileno())],
            cwd=folder.name,
            env=make_environment(),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            pass_fds=[theirs.fileno()],
        )
    return PreparedProcess(process, ours, folder)


def _begin_prepared(common: PreparedProcess, job: Mapping[str, object]) -> PreparedProcess:
    """Fork the prepared process of a job's adapter.  Raises Refused."""
    door = {name: job[name] for name in ("module", "path", "settings") if name in job}
    folder = _make_folder()
    told = Path(folder.name) / "door.json"
    told.write_text(json.dumps({**door, "plain": job["kind"] in PLAIN}), encoding="utf-8")
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs, (told.parent / "printed.txt").open("wb") as log:
        try:
            process = common.fork({"door": told, "folder": told.parent}, log.fileno(), theirs.fileno())
        except ForkRefused:
            ours.close()
            folder.cleanup()
            raise
    return PreparedProcess(process, ours, folder)


def _make_folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="crosscheck-prepared-", ignore_cleanup_errors=True)


KEPT_SERVERS = KeptServers()
atexit.register(KEPT_SERVERS.close)
