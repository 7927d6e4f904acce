"""Processes of engines: their environment, their bounds, and the end of their whole group."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
from collections.abc import Container
from pathlib import Path

ONE_THREAD = ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "NUMBA", "VECLIB_MAXIMUM")
MARK = "CROSSCHECK_JOB"  # variable by which all that a fresh process has started can be found
DEPTH = 20  # rounds of killing: a process that starts others faster than that is left to the death of its group
LARGEST_FILE = 1 << 28  # [bytes]; one MuJoCo log was seen to grow without end, a record has a few megabytes
# linux/prctl.h
PR_SET_PDEATHSIG = 1
PR_SET_CHILD_SUBREAPER = 36


def make_environment() -> dict[str, str]:
    """Return the environment of a child: one thread per library, and this very crosscheck on the path."""
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
    threads = {f"{library}_NUM_THREADS": "1" for library in ONE_THREAD}
    return os.environ | threads | {"PYTHONPATH": path, "MPLBACKEND": "Agg", "PYTHONUNBUFFERED": "1"}


def make_subreaper() -> None:
    """Ask Linux to make this process the parent of every orphan among its descendants; elsewhere do nothing.

    What a job starts in a session of its own (``setsid``) leaves the job's process group, but not its descendants.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def list_descendants(ancestor: int) -> list[int]:
    """Return the processes below another one, each after its parent; [] where the system does not list them."""
    children: dict[int, list[int]] = {}
    with contextlib.suppress(OSError):
        for entry in os.listdir("/proc"):
            if entry.isdigit() and (parent := _find_parent(int(entry))) is not None:
                children.setdefault(parent, []).append(int(entry))
    descendants: list[int] = []
    ahead = [ancestor]
    while ahead:
        below = children.get(ahead.pop(), [])
        descendants += below
        ahead += below
    return descendants


def _find_parent(process: int) -> int | None:
    """Return the parent of a process, None where it has ended."""
    try:
        state, parent = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[:2]
    except (OSError, ValueError):
        return None
    return None if state in "ZX" else int(parent)


def end_process_tree(leader: int) -> None:
    """Kill a process group and all descendants of its leader, also those that left the group.

    The leader is stopped first, so that it starts nothing more; what its descendants start meanwhile is looked for again.
    """
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.kill(leader, signal.SIGSTOP)
    for _ in range(DEPTH):
        if not (descendants := list_descendants(leader)):
            break
        for process in descendants:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(process, signal.SIGKILL)
    end_process_group(leader)


def list_children() -> list[int]:
    """Return the processes that this one is the parent of; [] where the system does not list them."""
    this = os.getpid()
    return [process for process in list_descendants(this) if _find_parent(process) == this]


def end_stray_processes(known: Container[int]) -> None:
    """Kill all children of this process that are not known: orphans of jobs that have ended."""
    for process in list_children():
        if process in known:
            continue
        end_process_tree(process)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(process, 0)


def end_marked_processes(mark: str) -> None:
    """Kill all processes that were started with a mark in their environment (`MARK`), whoever their parent is now."""
    wanted = f"{MARK}={mark}".encode()
    with contextlib.suppress(OSError):
        for entry in os.listdir("/proc"):
            with contextlib.suppress(OSError):
                if entry.isdigit() and wanted in Path("/proc", entry, "environ").read_bytes().split(b"\0"):
                    os.kill(int(entry), signal.SIGKILL)


def end_process_group(leader: int) -> None:
    """Kill a process group; one that is gone already is no error."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(leader, signal.SIGKILL)


def read_waiting_time(process: int) -> float:
    """Return the time that a process wanted a processor and got none [s], of its longest waiting thread; 0 where unknown."""
    longest = 0
    with contextlib.suppress(OSError, ValueError, IndexError):
        for thread in Path(f"/proc/{process}/task").iterdir():
            longest = max(longest, int((thread / "schedstat").read_text(encoding="ascii").split()[1]))
    return 1e-9 * longest


def end_with_parent() -> None:
    """Ask Linux to kill this process when its parent dies, however it dies; elsewhere do nothing."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def apply_file_size_limit() -> None:
    """Bound the size of every file that the engine writes, so that it cannot fill the disk."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST_FILE, LARGEST_FILE))


def apply_memory_limit(most: int) -> None:
    """Bound the memory that this process may ask for [bytes]: beyond it an allocation fails."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (most, most))
