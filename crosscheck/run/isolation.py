"""Run a job in a process of its own, with a time limit; whatever happens there becomes words here.

A crash, a hang, a NaN, a truncated series, a missing package: each becomes a record with a status and a message.
"""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import tempfile
import threading
import time as clock
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines import Engine, describe_missing_package
from crosscheck.engines.job_files import CaseJobFile, CaseRequest
from crosscheck.measures.record import Record, RecordError, Status, check, read_record
from crosscheck.output_folder import remove_tree
from crosscheck.run.forking import ForkedProcess, ForkRefused, ForkServerLost, ForkServers
from crosscheck.run.processes import (
    MARK,
    end_marked_processes,
    end_process_group,
    end_process_tree,
    make_environment,
    read_waiting_time,
)

BUSY = 0.5  # of the time limit: whoever had to wait longer for a processor may not be slow
TAIL = 4000  # [characters] of what the engine printed that a report keeps


@dataclass(frozen=True)
class Attempt:
    """A record and how it came about: printed (the tail of stdout and stderr), elapsed [s].

    kept : when it was made, where it was not made in this run (`crosscheck.run.answer_cache`)
    """

    record: Record
    printed: str = ""
    elapsed: float = 0.0
    kept: str = ""


@dataclass(frozen=True)
class ProcessEnd:
    """End of a child process: status and message, "ok" when it left by its own will with exit code 0.

    kept : when that was, where it was not in this run
    """

    status: Status
    message: str
    printed: str
    elapsed: float
    kept: str = ""


Process = subprocess.Popen[bytes] | ForkedProcess


@dataclass
class ChildProcesses:
    """The processes under way, so that all of them can be ended at once (Ctrl-C).

    marks : of fresh processes, by which all that they have started is found
    servers : prepared processes from which jobs are forked; None: every job starts afresh
    """

    running: set[int] = field(default_factory=set)
    stopped: bool = False
    lock: threading.Lock = field(default_factory=threading.Lock)
    marks: dict[int, str] = field(default_factory=dict)
    servers: ForkServers | None = None

    def begin_common(self) -> None:
        """Start the process that prepared ones are forked from, in this thread, where there are such."""
        if self.servers is not None:
            self.servers.begin_common()

    def begin(self, job: Mapping[str, object], job_file: Path, folder: Path, log: int) -> Process:
        """Return the process of a job, forked from a prepared one where that may be, else a fresh one.

        Raises InterruptedError where nothing is started any more.
        """
        if self.servers is not None and job.get("module") and not job.get("afresh"):
            with contextlib.suppress(ForkRefused):
                process = self.servers.fork(job, job_file, folder, log)
                with self.lock:
                    self.running.add(process.pid)
                    if self.stopped:
                        end_process_tree(process.pid)
                return process
        return self.begin_process(build_command(job_file), folder, log)

    def begin_process(self, command: list[str], folder: Path, log: int) -> subprocess.Popen[bytes]:
        """Start ``build_command`` in ``folder`` as the head of a process group of its own."""
        with self.lock:
            if self.stopped:
                raise InterruptedError("interrupted before it started")
            process = subprocess.Popen(
                command,
                cwd=folder,
                env=make_environment() | {MARK: make_mark(folder)},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            self.running.add(process.pid)
            self.marks[process.pid] = make_mark(folder)
        return process

    def end(self, process: Process) -> None:
        """Kill what is left of the process and of everything it started."""
        with self.lock:
            self.running.discard(process.pid)
        if isinstance(process, ForkedProcess):
            process.end()
            return
        if process.returncode is None:
            end_process_tree(process.pid)
        end_process_group(process.pid)
        process.wait()
        end_marked_processes(self.marks.pop(process.pid, ""))

    def end_processes(self) -> None:
        """Kill every child and start no more."""
        with self.lock:
            self.stopped = True
            for leader in self.running:
                end_process_tree(leader)
        if self.servers is not None:
            self.servers.end_processes()


def make_mark(folder: Path) -> str:
    """Return the mark of a job: the name of its folder, which no other job has."""
    return str(folder)


def run_engine(
    engine: Engine, task: CaseRequest, time: NDArray[np.float64], limit: float, children: ChildProcesses
) -> Attempt:
    """Run ``engine`` on ``task`` and return its record, or one that says why there is none.

    task : mechanism (folder), case (name), options; time : (samples,) [s]; limit : [s]
    """
    failed = Record(engine=engine.name, status="error")
    if (reason := describe_missing_package(engine)) is not None:
        return Attempt(replace(failed, message=f"not installed: {reason}"))
    with open_scratch_folder() as folder:
        out = str(folder / "record")
        job: CaseJobFile = {"kind": "run", **engine.door, "engine": engine.name, **task, "out": out}
        ending = run_child(job, folder, limit, children)
        record = replace(failed, status=ending.status, message=ending.message)
        if ending.status == "ok":
            record = _read(folder / "record", failed, time)
    return Attempt(record, ending.printed, ending.elapsed)


def _read(stem: Path, failed: Record, time: NDArray[np.float64]) -> Record:
    try:
        record = read_record(stem)
    except RecordError as error:
        return replace(failed, message=str(error))
    try:
        check(record, time)
    except RecordError as error:
        return replace(record, status="error", message=str(error), time=np.zeros(0), series={})
    return record


def ask(job: Mapping[str, object], limit: float, children: ChildProcesses) -> tuple[Any, ProcessEnd]:
    """Return the JSON answer of a "describe" or "study" job (None where there is none) and how it ended.

    limit : [s]
    """
    with open_scratch_folder() as folder:
        out = folder / "answer.json"
        ending = run_child({**job, "out": str(out)}, folder, limit, children)
        if ending.status != "ok":
            return None, ending
        try:
            return json.loads(out.read_text(encoding="utf-8")), ending
        except (OSError, ValueError) as error:
            return None, replace(ending, status="error", message=f"no answer: {error}")


def run_child(job: Mapping[str, object], folder: Path, limit: float, children: ChildProcesses) -> ProcessEnd:
    """Run ``python -m crosscheck.run.child`` on ``job`` inside ``folder`` for at most ``limit`` [s].

    Where a prepared process dies under its job, the job is done again in a fresh one.
    """
    try:
        return _run_job(job, folder, limit, children)
    except ForkServerLost as error:
        if children.stopped:
            return ProcessEnd("error", "interrupted", "", 0.0)
        (folder / "work").rename(folder / "lost")
        ending = _run_job({**job, "afresh": True}, folder, limit, children)
        return replace(ending, printed=f"{error}: done again in a fresh one\n{ending.printed}")


def _run_job(job: Mapping[str, object], folder: Path, limit: float, children: ChildProcesses) -> ProcessEnd:
    job_file = folder / "job.json"
    log_file = folder / "printed.txt"
    job_file.write_text(json.dumps(job), encoding="utf-8")
    work = folder / "work"
    work.mkdir()
    with log_file.open("wb") as log:
        try:
            process = children.begin(job, job_file, work, log.fileno())
        except InterruptedError as error:
            return ProcessEnd("error", str(error), "", 0.0)
        start = clock.monotonic()
        late = ""
        try:
            process.wait(limit)
        except subprocess.TimeoutExpired:
            late = describe_timeout(limit, read_waiting_time(process.pid))
        finally:
            children.end(process)
    elapsed = clock.monotonic() - start
    printed = read_tail(log_file)
    if late:
        return ProcessEnd("timeout", late, printed, elapsed)
    if children.stopped:
        return ProcessEnd("error", "interrupted", printed, elapsed)
    return ProcessEnd(*judge_exit_code(process.returncode or 0, printed), printed, elapsed)


def describe_timeout(limit: float, without: float) -> str:
    """Return the message for a process stopped after ``limit`` [s], of which it waited ``without`` [s] for a processor."""
    words = f"stopped after the time limit of {limit:g} s"
    if without <= BUSY * limit:
        return words
    return f"{words}, of which it waited {without:.0f} s for a processor: too much runs on this machine"


def build_command(job_file: Path) -> list[str]:
    """Return the command line of a child."""
    return [sys.executable, "-X", "faulthandler", "-m", "crosscheck.run.child", str(job_file)]


def judge_exit_code(code: int, printed: str) -> tuple[Status, str]:
    """Return status and message of an exit code; what was printed last is part of the message."""
    if code == 0:
        return "ok", ""
    if code > 0:
        last = printed.strip().rsplit("\n", 1)[-1]
        return "error", f"left with exit code {code}" + (f": {last}" if last else "")
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = "unknown"
    return "error", f"killed by signal {-code} ({name})"


def read_tail(file: Path) -> str:
    """Return the end of a text file, whatever bytes are in it."""
    with file.open("rb") as stream:
        stream.seek(max(0, file.stat().st_size - TAIL))
        return stream.read().decode("utf-8", errors="replace").replace("\0", "\N{REPLACEMENT CHARACTER}")


@contextmanager
def open_scratch_folder() -> Iterator[Path]:
    """Give a temporary folder that is gone afterwards, even where a dying engine still writes into it."""
    folder = Path(tempfile.mkdtemp(prefix="crosscheck-"))
    try:
        yield folder
    finally:
        remove_tree(folder)
