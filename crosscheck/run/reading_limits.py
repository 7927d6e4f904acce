"""Reading of strangers' files in a process of its own: what takes too long or too much memory, or crashes, becomes words.

A reader is a compiled parser of somebody else's: it may wait, swell or die.  `ReadingLimits.run_function` lets it do so where
it harms nobody.  The process is forked from this one where that may be, which costs nothing; else, as in a notebook,
from a prepared one that lives as long as this (`crosscheck.run.forking`), or it is a fresh one.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import pickle
import re
import select
import subprocess
import sys
import threading
import time as clock
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from crosscheck.engines.job_files import ReadJobFile
from crosscheck.run.forking import KEPT_SERVERS
from crosscheck.run.isolation import (
    ChildProcesses,
    ProcessEnd,
    describe_timeout,
    judge_exit_code,
    make_mark,
    open_scratch_folder,
    read_tail,
    run_child,
)
from crosscheck.run.processes import (
    MARK,
    apply_file_size_limit,
    end_marked_processes,
    end_process_group,
    end_process_tree,
    end_with_parent,
    make_subreaper,
    read_waiting_time,
)
from crosscheck.run.reading_job import GIVEN, read
from flexinv.errors import InputError
from flexinv.files.toml_tables import LONGEST_PATH, make_input_error

SECONDS = 120.0  # [s] for one file: the largest humanoid of example-robot-data takes 20 s
GIGABYTES = 4.0  # of memory for one file: that humanoid takes 0.5
OUT_OF_MEMORY = re.compile(r"MemoryError|bad_alloc|out of memory|allocate memory|Unable to allocate", re.IGNORECASE)
MILLI = 1e-3  # [s]
T = TypeVar("T")


class UnreadFile(InputError):
    """A file that no reader came to the end of, and why."""


@dataclass
class ReadingLimits:
    """Limits of reading: time [s] and memory [GB] for one call, each of which runs in a process of its own."""

    seconds: float = SECONDS
    gigabytes: float = GIGABYTES

    def run_function(self, function: Callable[..., T], file: str, *arguments: Any) -> T:
        """Return the answer of a function of a module of ours to a file [-].

        Raises InputError as it does, and Unread where it takes too long or too much memory, dies, or fails.
        """
        with open_scratch_folder() as folder:
            out = folder / "answer.pickle"
            job: ReadJobFile = {
                "kind": "read",
                "module": function.__module__,
                "function": function.__name__,
                "place": str(Path.cwd()),
                "memory": str(int(self.gigabytes * 1e9)),
                "out": str(out),
            }
            out.with_suffix(GIVEN).write_bytes(pickle.dumps((file, *arguments)))
            if can_fork():
                ending = _run_forked(job, folder, self.seconds)
            else:
                with KEPT_SERVERS.open_servers() as servers:
                    ending = run_child(job, folder, self.seconds, ChildProcesses(servers=servers))
            if ending.status != "ok":
                raise self._make_unread_error(file, ending)
            kind, found = pickle.loads(out.read_bytes())  # written by our own code, into this folder alone
        if kind == "refused":
            raise InputError(found)
        if kind == "failed":
            raise self._make_unread_error(
                file, ProcessEnd("error", found, f"{ending.printed}\n{found}", ending.elapsed)
            )
        result: T = found
        return result

    def _make_unread_error(self, file: str, ending: ProcessEnd) -> UnreadFile:
        """Return the words for a reader that came to no end."""
        limits = f"one that is read within {self.seconds:g} s and {self.gigabytes:g} GB of memory"
        if ending.status == "timeout":
            given = f"reading it was {ending.message}"
            write = "a smaller file; or --timeout with more seconds, if it is meant to be that large"
        elif OUT_OF_MEMORY.search(ending.printed):
            given = f"reading it asked for more than {self.gigabytes:g} GB of memory"
            write = "a smaller file; or --memory with more gigabytes, if it is meant to be that large"
        else:
            given = f"its reader fails: {ending.message}"
            write = (
                "the file without what is unusual in it; --readers all of crosscheck compare says which readers take it"
            )
        return UnreadFile(str(make_input_error(str(file)[:LONGEST_PATH], given[:600], limits, write)))


def can_fork() -> bool:
    """Return True where this process may be copied: no other thread of Python's runs, whose locks would stay shut in the copy.

    The threads of OpenBLAS end before a fork and begin again on demand.
    """
    return sys.platform == "linux" and threading.active_count() == 1 and hasattr(os, "pidfd_open")


def _run_forked(job: ReadJobFile, folder: Path, limit: float) -> ProcessEnd:
    """Do a job in a copy of this process, for at most ``limit`` [s]."""
    log_file = folder / "printed.txt"
    log_file.touch()
    start = clock.monotonic()
    late = ""
    process = _ForkedJob(job, log_file, make_mark(folder))
    try:
        process.wait(limit)
    except subprocess.TimeoutExpired:
        late = describe_timeout(limit, read_waiting_time(process.pid))
    finally:
        process.end()
    elapsed = clock.monotonic() - start
    printed = read_tail(log_file)
    if late:
        return ProcessEnd("timeout", late, printed, elapsed)
    return ProcessEnd(*judge_exit_code(process.returncode or 0, printed), printed, elapsed)


class _ForkedJob:
    """A copy of this process that does one job, and prints into a file."""

    def __init__(self, job: ReadJobFile, log: Path, mark: str) -> None:
        """Fork it."""
        sys.stdout.flush()
        sys.stderr.flush()
        parent = os.getpid()
        self.mark = mark
        self.returncode: int | None = None
        self.pid = os.fork()
        if self.pid == 0:
            _run_in_copy(job, log, mark, parent)

    def wait(self, limit: float) -> None:
        """Wait for its end for at most ``limit`` [s].  Raises TimeoutExpired."""
        number = os.pidfd_open(self.pid)
        try:
            poll = select.poll()
            poll.register(number, select.POLLIN)
            if not poll.poll(limit / MILLI):
                raise subprocess.TimeoutExpired("a copy", limit)
        finally:
            os.close(number)
        self._collect_exit_code()

    def end(self) -> None:
        """Kill what is left of it, and of everything that it started."""
        if self.returncode is None:
            end_process_tree(self.pid)
            self._collect_exit_code()
        end_process_group(self.pid)
        end_marked_processes(self.mark)

    def _collect_exit_code(self) -> None:
        self.returncode = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])


def _run_in_copy(job: ReadJobFile, log: Path, mark: str, parent: int) -> NoReturn:
    """Be the copy: a session of its own without the terminal, nothing to read, and one file for all that is printed."""
    code = 1
    try:
        os.setsid()
        end_with_parent()
        if os.getppid() != parent:
            os._exit(1)  # it has died meanwhile
        make_subreaper()
        apply_file_size_limit()
        os.environ[MARK] = mark
        with contextlib.ExitStack() as files:
            nothing = files.enter_context(open(os.devnull, "rb"))
            printed = files.enter_context(log.open("ab"))
            os.dup2(nothing.fileno(), 0)
            os.dup2(printed.fileno(), 1)
            os.dup2(printed.fileno(), 2)
        sys.stdin = os.fdopen(0, "r", encoding="utf-8", closefd=False)
        sys.stdout = sys.stderr = os.fdopen(2, "w", encoding="utf-8", errors="replace", closefd=False)
        faulthandler.enable(sys.stderr)
        read(job)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        os._exit(code)
