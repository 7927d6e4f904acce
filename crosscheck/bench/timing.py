"""Time calls in turns, so that whatever else the machine does meets all of them alike.

A repetition begins with a run that is not timed: every call finds its data, its machine code and its threads as in a loop of
its own, and not as the call before it left the caches; a call of more than 50 ms needs none.

A repetition in which the process was interrupted (an involuntary context switch) is dropped.  Where too few are left, as
with long calls on a busy machine, calls of one thread are measured by the processor's time instead, which does not count
interruptions.  Threads interrupt each other, too: their calls count as they are where others hardly used the machine, and
where others did, they say nothing.
"""

from __future__ import annotations

import gc
import os
import time as clock
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
REPETITION = 1e-3  # [s]: well below the some 4 ms after which a busy system changes processes
LONG = (
    0.05  # [s]: what takes longer is not run before it is timed, as what it finds in the caches is no part of its time
)
FEWEST = 5  # repetitions, and clean ones, that quartiles are taken of
MOST = 400  # repetitions; more do not move a median
OTHERS = 0.05  # processors that others may use while several threads are timed: a fortieth of two


@dataclass(frozen=True)
class Call:
    """Something to be timed; threads: how many of them it works with [-]."""

    run: Callable[[], object]
    threads: int = 1


@dataclass(frozen=True)
class Spread:
    """Quartiles [unit]."""

    low: float
    median: float
    high: float


@dataclass(frozen=True)
class Times:
    """Seconds that one run of a call took, by repetition: on the clock and of the processor; clean: not interrupted.

    others : processors that other programs used meanwhile [-], infinite where the system does not tell
    """

    wall: Array
    processor: Array
    clean: NDArray[np.bool_]
    threads: int = 1
    others: float = np.inf

    def usable(self) -> Array:
        """Return the times that count [s]."""
        if self.clean.sum() >= min(FEWEST, len(self.wall)):
            return self.wall[self.clean]
        return self.processor if self.threads == 1 else self.wall

    def spread(self) -> Spread:
        """Return the quartiles [s]."""
        return _quartiles(self.usable())


def busy(*times: Times) -> bool:
    """Return whether others took the processors too often to say how long several threads take together."""
    return any(t.threads > 1 and t.clean.sum() < min(FEWEST, len(t.wall)) and t.others > OTHERS for t in times)


def ratio(slow: Times, fast: Times) -> Spread:
    """Return how many times as long the first takes [-]: quartiles over repetitions that stood side by side."""
    both = slow.clean & fast.clean
    if both.sum() >= min(FEWEST, len(both)):
        return _quartiles(slow.wall[both] / fast.wall[both])
    if slow.threads == fast.threads == 1:
        return _quartiles(slow.processor / fast.processor)
    return _quartiles(slow.wall / fast.wall)


def in_turns(calls: Mapping[str, Call], seconds: float) -> dict[str, Times]:
    """Return the times of calls that are run one after the other, over and over, for so many seconds [s] or a little more.

    Short calls are repeated within a repetition; the times are those of one run.
    """
    often = {name: _count(call) for name, call in calls.items()}
    taken: dict[str, list[tuple[float, float, bool]]] = {name: [] for name in calls}
    start, before, own = clock.perf_counter(), _machine(), clock.process_time()
    end = start + seconds
    with _undisturbed():
        for done in range(MOST):
            if done >= FEWEST and clock.perf_counter() > end:
                break
            for name, call in calls.items():
                taken[name].append(_once(call, *often[name]))
    worked = _machine() - before - (clock.process_time() - own)
    others = worked / (clock.perf_counter() - start) if np.isfinite(before) else np.inf
    columns = {name: list(zip(*rows, strict=True)) for name, rows in taken.items()}
    return {
        name: Times(np.array(wall), np.array(own), np.array(clean, dtype=bool), calls[name].threads, others)
        for name, (wall, own, clean) in columns.items()
    }


def _once(call: Call, times: int, long: bool) -> tuple[float, float, bool]:
    if not long:
        call.run()
    before, own, start = _interruptions(), clock.process_time(), clock.perf_counter()
    for _ in range(times):
        call.run()
    wall = clock.perf_counter() - start
    return wall / times, (clock.process_time() - own) / times, _interruptions() == before


def _count(call: Call) -> tuple[int, bool]:
    """How many runs make a repetition, and whether one is long; the first, which compiles or fills caches, counts if it is."""
    start = clock.perf_counter()
    call.run()
    if clock.perf_counter() - start > LONG:
        return 1, True
    start = clock.perf_counter()
    call.run()
    return max(1, int(REPETITION / max(clock.perf_counter() - start, 1e-7))), False


def _quartiles(values: Array) -> Spread:
    low, median, high = np.percentile(values, (25, 50, 75))
    return Spread(float(low), float(median), float(high))


def _interruptions() -> int:
    """Involuntary context switches so far; where the system does not tell, every repetition counts as clean."""
    try:
        import resource
    except ImportError:
        return 0
    return resource.getrusage(resource.RUSAGE_SELF).ru_nivcsw


def _machine() -> float:
    """Seconds that all processors together have worked since the system began; infinite where it does not tell."""
    try:
        with open("/proc/stat", encoding="ascii") as stat:
            user, nice, system, _, _, *interrupts = (int(word) for word in stat.readline().split()[1:9])
    except OSError:
        return np.inf
    return (user + nice + system + sum(interrupts)) / os.sysconf("SC_CLK_TCK")


@contextmanager
def _undisturbed() -> Iterator[None]:
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
