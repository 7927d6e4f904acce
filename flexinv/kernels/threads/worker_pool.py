"""Threads that help with one call: they take blocks that the calling thread has not taken yet.

After its work a helper watches its mail for a while, so that the next call of a loop has it within a microsecond; then it
sleeps, and waking it takes some ten times as long.  On the processor of the caller, which it leaves, it would watch while the
caller stands still.  Offers of work go through memory that both watch: a helper begins some hundred nanoseconds later.
A *mail* is a row of cells (`atomics`).  Its state goes round:

    EMPTY -> CLAIMED   a caller is writing an offer
          -> OFFERED   ... which a helper may take, or the caller withdraw
          -> TAKEN     a helper works on it
          -> DONE      ... and has left its answer, which the caller collects
          -> EMPTY
"""

from __future__ import annotations

import atexit
import os
import time
from collections.abc import Callable
from queue import SimpleQueue
from threading import Lock, Thread

import numpy as np

from flexinv.kernels.jit import jit_lanes
from flexinv.kernels.threads.affinity import move_from_processor, processor_now, read_thread_limit
from flexinv.kernels.threads.atomics import pause, read_address, read_cell, swap, write_cell
from flexinv.typing import Unsigned

EMPTY, CLAIMED, OFFERED, TAKEN, DONE = range(5)
# Cells of a mail, in lines of the cache of eight: the state, what only the caller writes, whether the helper sleeps, the offer.
STATE = 0
OWNER = 8
SLEEPS = 16
ANSWER = 24
WORDS = 32
CELLS = 64
LOOKS = 10_000  # after which a caller that waits for a helper lets the system run others: some hundred microseconds
WATCH = 3e-4  # [s] that a helper watches before it sleeps: several times what passes between two calls in a loop
# by which a helper learns how long a look takes: the shortest, as the system interrupts
_LOOKS = 2_000
_TRIES = 5
MOST = 255
Attend = Callable[[Unsigned, int], None]


@jit_lanes
def take_mailbox(mail, owner):
    """Claim a mail; return True [-] if it was free: its new owner then writes the words of an offer and makes it."""
    if read_cell(mail, STATE) != EMPTY or not swap(mail, STATE, EMPTY, CLAIMED):
        return False
    mail[OWNER] = owner
    return True


@jit_lanes
def write_array(mail, number, array):
    """Write where an array begins and how long it is [-], as word ``number`` of an offer."""
    mail[WORDS + 2 * number] = read_address(array)
    mail[WORDS + 2 * number + 1] = array.size


@jit_lanes
def read_array_word(mail, number):
    """Read word ``number`` of an offer: the address of an array and its shape (length,) [-]."""
    return mail[WORDS + 2 * number], (mail[WORDS + 2 * number + 1],)


@jit_lanes
def wait_for_offer(mail, patience):
    """Wait for an offer, for at most so many looks [-]; return True if it was taken."""
    for _ in range(patience):
        if read_cell(mail, STATE) == OFFERED and swap(mail, STATE, OFFERED, TAKEN):
            return True
        pause()
    return False


@jit_lanes
def collect_answers(mails, owner, total):
    """Add the answers to the owner's offers to total[0] and withdraw what nobody took [-]; return whether all are settled.

    False where a helper still works after `LOOKS`: ask again.
    """
    for i in range(mails.shape[0]):
        mail = mails[i]
        if read_cell(mail, OWNER) != owner:
            continue
        if not swap(mail, STATE, OFFERED, CLAIMED):
            left = LOOKS
            while read_cell(mail, STATE) != DONE:
                pause()
                left -= 1
                if left == 0:
                    return False
            total[0] += mail[ANSWER]
        mail[OWNER] = 0
        write_cell(mail, STATE, EMPTY)
    return True


class _Helper:
    """A thread, its mail and the bell that wakes it."""

    def __init__(self, attend: Attend, mail: Unsigned) -> None:
        self.attend = attend
        self.mail = mail
        self.bell = SimpleQueue[bool]()
        self.caller = processor_now()
        self.thread = Thread(target=self._run_helper, name="flexinv", daemon=True)
        self.thread.start()

    def _run_helper(self) -> None:
        move_from_processor(self.caller)
        tried = list[float]()
        nobody = np.zeros(CELLS, dtype=np.uint64)
        for _ in range(_TRIES):  # not by `timeit`: it switches the garbage collector of the whole process
            start = time.perf_counter()
            self.attend(nobody, _LOOKS)
            tried.append(time.perf_counter() - start)
        looks = int(_LOOKS * WATCH / min(tried))
        self.attend(self.mail, looks)
        while self.bell.get():
            move_from_processor(self.caller)
            self.attend(self.mail, looks)

    def send_wakeup(self) -> None:
        if self.mail[SLEEPS]:
            self.mail[SLEEPS] = 0
            self.caller = processor_now()
            self.bell.put(True)


class Helpers:
    """The threads, started when first needed; a forked child begins without them, and at the end they are dismissed.

    attend : what they do: take work from a mail until no offer comes for so many looks
    """

    def __init__(self, attend: Attend) -> None:
        self._attend = attend
        self.begin_without_helpers()
        atexit.register(self.end_helpers)
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self.begin_without_helpers)

    def begin_without_helpers(self) -> None:
        """Begin without helpers [-]."""
        self._starting = Lock()
        self._members = list[_Helper]()
        self._mails = np.zeros((MOST, CELLS), dtype=np.uint64)
        self._called = -np.inf

    def end_helpers(self) -> None:
        """Let all helpers end [-]."""
        members = self._members
        self.begin_without_helpers()
        for one in members:
            one.bell.put(False)
            one.thread.join()

    def prepare_mailboxes(self, count: int, wake: bool) -> Unsigned:
        """Return the mails (helpers, cells) [-] of at most so many helpers, which watch them soon.

        Where not ``wake``, those that sleep are woken only if the last call was a moment ago, as in a loop.
        """
        count = min(count, read_thread_limit() - 1)
        now = time.perf_counter()
        wake = wake or now - self._called < WATCH
        self._called = now
        if wake:
            if len(self._members) < count:
                self._begin_helpers(count)
            for one in self._members[:count]:
                one.send_wakeup()
        return self._mails[: min(count, len(self._members))]

    def _begin_helpers(self, count: int) -> None:
        with self._starting:
            try:
                while len(self._members) < min(count, MOST):
                    self._members.append(_Helper(self._attend, self._mails[len(self._members)]))
            except RuntimeError:  # no more threads, or the program is ending: those that are there have to do
                return
