"""A prepared process: ``python -m crosscheck.run.fork_server SOCKET``.

The first of a run imports what every job needs and forks a prepared process per engine; that one imports the engine's adapter
once and forks a process for every job, which then does what a fresh one does (`crosscheck.run.child`) without importing
anything again.  Neither computes anything itself, so that every job finds it as the imports left it.  Only a process of one
thread may be forked: another thread's locks would stay shut in the copy, and a graphics card's context is not copied.  So
before every fork the threads and open devices are looked at, and a job is refused in words where there are others; the parent
(`crosscheck.run.forking`) then starts a fresh process for it.

A request is one packet, the names of the file of the job or of the door and of the folder, with descriptors: a socket for the
answers, the file for what is printed, and for a door the socket of its own requests.  Answers are lines: ``forked PID``, then
``ended CODE``; or ``refused WHY``.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import random
import select
import signal
import socket
import sys
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np

from crosscheck.engines import resolve_adapter
from crosscheck.engines.base import can_fork_jobs, prepare_adapter
from crosscheck.engines.job_files import PreparedDoor
from crosscheck.run import child
from crosscheck.run.processes import (
    end_process_group,
    end_stray_processes,
    end_with_parent,
    list_children,
    make_subreaper,
)
from flexinv.files.toml_tables import build_validators

LARGEST_REQUEST = 1 << 16  # [bytes]
KERNELS = "flexinv.kernels.compiler.choice"  # whoever has imported it will call kernels
DEVICES = ("/dev/nvidia", "/dev/dri", "/dev/kfd")  # a graphics card's runtime that has started keeps one of these open


def main(number: str) -> None:
    """Serve requests of the socket with this number until the parent closes it, what every job needs being imported."""
    end_with_parent()
    build_validators()
    run_server(int(number), "")


def run_server(number: int, refusal: str) -> NoReturn:
    """Serve requests of a socket; refusal : why none is granted, "" where they are."""
    gc.collect()
    gc.freeze()
    Server(socket.socket(fileno=number), refusal).run_until_closed()
    os._exit(0)


def prepare(door: PreparedDoor) -> str:
    """Import what jobs of a door need and return "", or why none may be forked from here.

    door : module, perhaps path (`crosscheck.engines.open_adapter`); settings, where it is a door's module, which is imported
    alone
    """
    try:
        if (path := door.get("path", "")) and path not in sys.path:
            sys.path.insert(0, path)
        if "settings" in door or door.get("plain"):
            importlib.import_module(door["module"])
        else:
            adapter = resolve_adapter(door["module"])
            if not can_fork_jobs(adapter):
                return "its adapter says that it must not be forked"
            prepare_adapter(adapter)
        if (kernels := sys.modules.get(KERNELS)) is not None:
            kernels.NUMBA.begin_runtime()
    except Exception as error:
        traceback.print_exc()
        return f"it could not be prepared: {type(error).__name__}: {error}"
    return ""


def describe_fork_trouble() -> str:
    """Return the reason why this process must not be forked now, "" where nothing speaks against it."""
    threads = len(os.listdir("/proc/self/task"))
    if threads > 1:
        return f"{threads - 1} other thread{'s run' if threads > 2 else ' runs'} after its imports"
    return next((f"it has {name} open" for name in _open_files() if name.startswith(DEVICES)), "")


def _open_files() -> Iterator[str]:
    for number in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):
            yield os.readlink(f"/proc/self/fd/{number}")


@dataclass
class Server:
    """A process that forks jobs.

    requests : socket of packets; refusal : why no job may be forked, ""
    answers : the socket of every job under way by its process; helpers : what the imports have started
    """

    requests: socket.socket
    refusal: str
    answers: dict[int, socket.socket] = field(default_factory=dict)
    helpers: frozenset[int] = field(default_factory=lambda: frozenset(list_children()))

    def run_until_closed(self) -> None:
        """Fork a job per request and tell how each ended, until the parent closes its side."""
        make_subreaper()
        ear, mouth = socket.socketpair()
        ear.setblocking(False)
        mouth.setblocking(False)
        signal.signal(signal.SIGCHLD, lambda number, frame: None)
        signal.set_wakeup_fd(mouth.fileno(), warn_on_full_buffer=False)
        while True:
            ready, _, _ = select.select([self.requests, ear], [], [])
            if ear in ready:
                ear.recv(4096)
                self._collect_ended_jobs()
            if self.requests in ready and not self._can_take_request([ear, mouth]):
                return

    def _can_take_request(self, sockets: list[socket.socket]) -> bool:
        """Take one request; return False where the parent has closed its side."""
        packet, descriptors, _, _ = socket.recv_fds(self.requests, LARGEST_REQUEST, 3)
        if not packet:
            return False
        answer = socket.socket(fileno=descriptors.pop(0))
        if why := self.refusal or describe_fork_trouble():
            _send_words(answer, f"refused {why}")
            answer.close()
        else:
            self._fork(answer, descriptors, json.loads(packet), sockets)
        for descriptor in descriptors:
            os.close(descriptor)
        return True

    def _fork(
        self, answer: socket.socket, descriptors: list[int], job: Mapping[str, str], sockets: list[socket.socket]
    ) -> None:
        leader = os.getpid()
        pid = os.fork()
        if pid == 0:
            for other in (self.requests, answer, *sockets, *self.answers.values()):
                other.close()
            begin(leader, job, *descriptors)
        with contextlib.suppress(OSError):  # whoever is first; the parent kills the group, so it has to be one by now
            os.setpgid(pid, pid)
        self.answers[pid] = answer
        _send_words(answer, f"forked {pid}")

    def _collect_ended_jobs(self) -> None:
        """Tell how jobs ended, and end what each of them has started (before its number may be given to another)."""
        for pid in list(self.answers):
            if os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
                continue
            end_process_group(pid)  # what it left in other groups has become a child of this process
            _, status = os.waitpid(pid, 0)
            answer = self.answers.pop(pid)
            end_stray_processes({*self.answers, *self.helpers})
            _send_words(answer, f"ended {os.waitstatus_to_exitcode(status)}")
            answer.close()


def _send_words(answer: socket.socket, words: str) -> None:
    with contextlib.suppress(OSError):  # nobody listens any more
        answer.sendall(f"{words}\n".encode())


def begin(leader: int, job: Mapping[str, str], log: int, requests: int = -1) -> NoReturn:
    """Be the process of a job or of a door from here on: a group of its own, its own folder, its own printed text.

    requests : the socket of a door
    """
    code = 1
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        os.setpgid(0, 0)  # the session is that of the prepared process, which has no terminal
        end_with_parent()
        if os.getppid() != leader:
            os._exit(1)  # it has died meanwhile
        os.dup2(log, 1)
        os.dup2(log, 2)
        os.close(log)
        os.chdir(job["folder"])
        sys.path[0] = job["folder"]
        random.seed()
        np.random.seed()  # noqa: NPY002 - for engines that use this generator: each process has its own numbers
        if "door" in job:
            run_server(requests, prepare(json.loads(Path(job["door"]).read_text(encoding="utf-8"))))
        child.main(job["job"])
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else int(left.code is not None)
        if not isinstance(left.code, int | None):
            os.write(2, f"{left.code}\n".encode())
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


if __name__ == "__main__":
    main(*sys.argv[1:])
