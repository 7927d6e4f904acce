"""One process compiles a kernel, others wait for it: a lock beside the machine code of each kernel.

The system takes the lock from a process that ends, however it ends: no lock is ever stale.  Where files cannot be locked, or one
process holds a lock for longer than any compilation takes, others compile without it: twice the work, the same numbers.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: each process compiles for itself
    fcntl = None  # type: ignore[assignment]

PATIENCE = 300.0  # [s]
PAUSE = 0.02  # [s] between two looks
NOTE = "compiling kernels, up to a minute; the machine code is kept for the next time"
SLOW_COMPILING = 2.0  # [s] of compiling after which it is said
LONGEST_KERNEL = 60.0  # [s] between kernels of two calls; one kernel takes less
_BEGUN: list[float] = []  # when kernels of a call began to be compiled [s]
_SAID: list[str] = []
_LISTENERS: list[Callable[[], None]] = []


@contextmanager
def add_compile_listener(say: Callable[[], None]) -> Iterator[None]:
    """Call ``say`` when the first kernel of this block is compiled [-]; never where all are read from the disk."""
    _LISTENERS.append(say)
    try:
        yield
    finally:
        _LISTENERS.clear()


def warn_if_slow(now: float) -> None:
    """Say once in a process that kernels are compiled, where that has taken longer than `SLOW_COMPILING` [s]; now : [s].

    A program that waits for its first answer shall know why.  The words go through `logging`, so that they can be switched off.
    """
    if _BEGUN and now - _BEGUN[-1] > LONGEST_KERNEL:
        _BEGUN.clear()
    _BEGUN.append(now)
    if now - _BEGUN[0] > SLOW_COMPILING and not _SAID:
        _SAID.append(NOTE)
        logging.getLogger("flexinv").warning(NOTE)


class CompileLock:
    """The right to compile one kernel, by a lock on a file that is never removed."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._held: int | None = None

    def take(self, patience: float = PATIENCE) -> bool:
        """Wait for the lock, at most so long [s]; return whether there was somebody to wait for."""
        while _LISTENERS:
            _SAID.append(NOTE)
            _LISTENERS.pop()()
        warn_if_slow(time.monotonic())
        if fcntl is None or self._held is not None:
            return False
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError:
            return False
        until = time.monotonic() + patience
        waited = False
        while not _is_locked(file):
            waited = True
            if time.monotonic() > until:
                os.close(file)
                return waited
            time.sleep(PAUSE)
        self._held = file
        return waited

    def drop_lock(self) -> None:
        """Let the next process go on [-]; nothing where the lock is not held."""
        if self._held is not None:
            os.close(self._held)
            self._held = None


def _is_locked(file: int) -> bool:
    """Return True if the file is ours now, or cannot be locked at all."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True
