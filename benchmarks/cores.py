"""Availability of whole cores: two processors may be halves of one core, or a stranger may use the other half.

Processors of a virtual machine are threads of its host, which moves them as it likes: for seconds on end two of them share a
core, or one shares it with somebody else's.  Work that keeps the arithmetic units busy then takes up to twice as long, work
that waits for its own results hardly longer, and no count of interruptions tells.  So a loop of multiplications is timed
before and after whatever is measured: on one thread, or beside as many others as that uses.  Where it takes clearly longer
than it ever took alone, the processors did not give all they have.
"""

from __future__ import annotations

import time as clock
from queue import SimpleQueue
from threading import Thread
from types import TracebackType

import numpy as np
from numba import njit
from numpy.typing import NDArray

from flexinv.kernels.threads.affinity import move_from_processor, processor_now
from flexinv.kernels.threads.atomics import pause, read_cell, write_cell
from flexinv.typing import Array

# Times as long as alone at which a core counts as shared: halves of a core take 1.4 to 1.9 times as long, whole cores up to 1.1
# side by side, as all of them together run at a lower frequency.
SHARED = 1.2
# in the fastest cache, by lines [bytes], and a tenth of a millisecond
_NUMBERS = 128
_LINE = 64
_ROUNDS = 20_000
# what a companion and its caller tell each other, in lines of the cache of their own
_HERE = 0
_ENOUGH = 8
_CELLS = 16
_PATIENCE = 100_000_000  # looks for a companion: a second and more
_TRIES = 20


@njit(nogil=True)
def _run_multiplications(x: Array, rounds: int) -> None:
    for _ in range(rounds):
        for j in range(x.size):
            x[j] = x[j] * 0.999999 + 1e-9


@njit(nogil=True)
def _run_beside_caller(cells: NDArray[np.uint64], x: Array) -> None:
    write_cell(cells, _HERE, 1)
    while read_cell(cells, _ENOUGH) == 0:
        _run_multiplications(x, 10)


@njit(nogil=True)
def _has_begun(cells: NDArray[np.uint64]) -> bool:
    for _ in range(_PATIENCE):
        if read_cell(cells, _HERE) == 1:
            return True
        pause()
    return False


def _make_aligned_array() -> Array:
    """Numbers that begin with a line of the cache: else every other access meets two of them, and the time is another."""
    spare = np.ones(_NUMBERS + _LINE // 8)
    first = -spare.ctypes.data % _LINE // 8
    return spare[first : first + _NUMBERS]


class _Companion:
    """A thread that multiplies while its caller does."""

    def __init__(self) -> None:
        self.bell = SimpleQueue[int | None]()
        self.cells = np.zeros(_CELLS, dtype=np.uint64)
        self.thread = Thread(target=self._run_until_closed, name="companion", daemon=True)
        self.thread.start()

    def _run_until_closed(self) -> None:
        x = _make_aligned_array()
        while (caller := self.bell.get()) is not None:
            move_from_processor(caller)
            _run_beside_caller(self.cells, x)
            self.cells[:] = 0

    def begin(self) -> bool:
        self.bell.put(processor_now())
        return bool(_has_begun(self.cells))

    def end(self) -> None:
        self.cells[_ENOUGH] = 1
        while self.cells[_ENOUGH]:
            clock.sleep(0)

    def end_thread(self) -> None:
        self.bell.put(None)
        self.thread.join()


class Cores:
    """The processors while something is measured; a context that ends its threads."""

    least = np.inf  # seconds that the loop took at least in this process, alone

    def __enter__(self) -> Cores:
        self._x = _make_aligned_array()
        self._companions = list[_Companion]()
        for _ in range(_TRIES):
            self.run_loop(1)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for one in self._companions:
            one.end_thread()

    def compute_loop_time(self, threads: int, often: int) -> float:
        """Return the largest [s] of the first and the last of so many loops, as in `loop`, and of nine in ten of them."""
        taken = [self.run_loop(threads) for _ in range(often)]
        return max(taken[0], taken[-1], sorted(taken)[(9 * often - 1) // 10])

    def run_loop(self, threads: int) -> float:
        """Return the seconds that the loop takes on this thread while others do the same; infinite where one does not begin."""
        while len(self._companions) < threads - 1:
            self._companions.append(_Companion())
        beside = self._companions[: threads - 1]
        ready = [one.begin() for one in beside]
        start = clock.perf_counter()
        _run_multiplications(self._x, _ROUNDS)
        taken = clock.perf_counter() - start
        for one in beside:
            one.end()
        if threads == 1:
            Cores.least = min(Cores.least, taken)
        return taken if all(ready) else np.inf


def find_undisturbed_repetitions(loops: Array) -> NDArray[np.bool_]:
    """Return a mask of the repetitions in which the processors gave all they have; loops : (repetitions, any) [s]."""
    undisturbed_repetitions: NDArray[np.bool_] = loops.max(axis=1) <= SHARED * Cores.least
    return undisturbed_repetitions
