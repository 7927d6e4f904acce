"""Threads that help with one call: they take blocks that the calling thread has not taken yet.

After its work a helper watches its mail for a while, so that the next call of a loop has it within a microsecond; then it
sleeps, and waking it takes some ten times as long.  Nobody waits for a helper that has not begun.
It leaves the processor of the caller, where it would watch while the caller stands still.
"""

from __future__ import annotations

import atexit
import os
import time
from queue import SimpleQueue
from threading import Lock, Thread

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.affinity import leave, processor_now
from flexinv.kernels.mailbox import CELLS, SLEEPS
from flexinv.rigid.blocks import attend

# How long a helper watches before it sleeps [s]: several times what passes between two calls in a loop.
WATCH = 3e-4
_LOOKS, _TRIES = (
    2_000,
    5,
)  # by which a helper learns at first how long a look takes: the shortest, as the system interrupts
MOST = 255


def _looking() -> float:
    """Seconds that `_LOOKS` looks take."""
    start = time.perf_counter()
    attend(np.zeros(CELLS, dtype=np.uint64), _LOOKS)
    return time.perf_counter() - start


class _Helper:
    """A thread, its mail and the bell that wakes it."""

    def __init__(self, mail: NDArray[np.uint64]) -> None:
        self.mail, self.bell, self.caller = mail, SimpleQueue[bool](), processor_now()
        self.thread = Thread(target=self._serve, name="flexinv", daemon=True)
        self.thread.start()

    def _serve(self) -> None:
        leave(self.caller)
        looks = int(_LOOKS * WATCH / min(_looking() for _ in range(_TRIES)))
        attend(self.mail, looks)
        while self.bell.get():
            leave(self.caller)
            attend(self.mail, looks)

    def wake(self) -> None:
        if self.mail[SLEEPS]:
            self.mail[SLEEPS], self.caller = 0, processor_now()
            self.bell.put(True)

    def dismiss(self) -> None:
        self.bell.put(False)
        self.thread.join()


class Helpers:
    """The threads, started when first needed; a forked child begins without them, and at the end they are dismissed."""

    def __init__(self) -> None:
        self.forget()
        atexit.register(self.dismiss)
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self.forget)

    def forget(self) -> None:
        """Begin without helpers [-]."""
        self._starting, self._members = Lock(), list[_Helper]()
        self._mails, self._called = np.zeros((MOST, CELLS), dtype=np.uint64), -np.inf

    def dismiss(self) -> None:
        """Let all helpers end [-]."""
        members = self._members
        self.forget()
        for one in members:
            one.dismiss()

    def mails(self, count: int, wake: bool) -> NDArray[np.uint64]:
        """Return the mails (helpers, cells) [-] of at most so many helpers, which watch them soon.

        Where not ``wake``, those that sleep are woken only if the last call was a moment ago, as in a loop.
        """
        now = time.perf_counter()
        wake, self._called = wake or now - self._called < WATCH, now
        if wake:
            if len(self._members) < count:
                self._start(count)
            for one in self._members[:count]:
                one.wake()
        return self._mails[: min(count, len(self._members))]

    def _start(self, count: int) -> None:
        with self._starting:
            try:
                while len(self._members) < min(count, MOST):
                    self._members.append(_Helper(self._mails[len(self._members)]))
            except RuntimeError:  # no more threads, or the program is ending: those that are there have to do
                return


HELPERS = Helpers()
