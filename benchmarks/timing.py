"""Time calls in turns, so that whatever else the machine does meets all of them alike.

A repetition begins with a run that is not timed, or with as many as take some milliseconds where calls have threads: every
call finds its data, its machine code and its threads as in a loop of its own, and not as the call before it left the caches,
and threads of others that watch for their next call have gone to sleep (those of OpenMP after 9 ms); a call of more than
50 ms needs none.

A repetition in which the processors did not give all they have is dropped (`cores`), and one in which the process was
interrupted (an involuntary context switch).  Looks at the processors before and after a long call miss what happens within it:
there the processor's time tells, against the least that the same call has taken.  Where too few are left, as with long calls
on a busy machine, calls of one thread are measured by the processor's time instead, which does not count
interruptions.  Threads interrupt each other, too: their calls count as they are where others hardly used the machine, and
where others did, they say nothing.
"""

from __future__ import annotations

import gc
import os
import time as clock
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.cores import Cores, find_undisturbed_repetitions
from flexinv.typing import Array

REPETITION = 1e-3  # [s]: well below the some 4 ms after which a busy system changes processes
LONG = (
    0.05  # [s]: what takes longer is not run before it is timed, as what it finds in the caches is no part of its time
)
AGAIN = 1.0  # [s]: what takes as long at first is not run once more to see what it takes usually
SETTLED = 0.012  # [s] of runs before one is timed, where calls have threads
FEWEST = 5  # repetitions, and clean ones, that quartiles are taken of
MOST = 400  # repetitions; more do not move a median
PATIENCE = 8  # times as long as asked is measured at most, until there are enough repetitions on whole cores
ENOUGH = 9  # of them
BUSY = "not measured: others held the processors"
HALVES = "not measured: the processors shared a core, with each other or with others of the host"
LOOKS = 40  # at the processors before and after a long call, which episodes of some milliseconds spoil as well: four of them
STEADY = 1.06  # times its least of processor time that a long call takes at most on whole cores: it repeats within a twentieth
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
    """Seconds that one run of a call took, by repetition: on the clock and of the processor.

    clean : not interrupted; whole : the processors gave all they have
    others : processors that other programs used meanwhile [-], infinite where the system does not tell
    """

    wall: Array
    processor: Array
    clean: NDArray[np.bool_]
    whole: NDArray[np.bool_]
    threads: int = 1
    others: float = np.inf

    def find_usable_times(self) -> Array:
        """Return the times that count [s]."""
        own = self._take_repetitions(self.whole) if _has_enough_repetitions(self.whole) else self
        if _has_enough_repetitions(own.clean):
            return own.wall[own.clean]
        return own.processor if own.threads == 1 else own.wall

    def _take_repetitions(self, which: NDArray[np.bool_]) -> Times:
        return replace(
            self,
            wall=self.wall[which],
            processor=self.processor[which],
            clean=self.clean[which],
            whole=self.whole[which],
        )

    def compute_quartiles(self) -> Spread:
        """Return the quartiles [s]."""
        return _compute_quartiles(self.find_usable_times())


def describe_disturbance(*times: Times) -> str:
    """Return the reason why these times say nothing about calls with threads, for a table; empty where they do."""
    if any(t.threads > 1 and not _has_enough_repetitions(t.whole) for t in times):
        return HALVES
    parts = [t._take_repetitions(t.whole) for t in times if t.threads > 1]
    return BUSY if any(not _has_enough_repetitions(t.clean) and t.others > OTHERS for t in parts) else ""


def compute_time_ratio(slow: Times, fast: Times) -> Spread:
    """Return the time of the first over that of the second [-]: quartiles over repetitions that stood side by side.

    Where the processors gave all they have to either, but hardly ever to both in turn, as on a busy host where one works alone
    and the other beside others, quartiles are compared instead.
    """
    both = slow.whole & fast.whole
    if (
        _has_enough_repetitions(slow.whole)
        and _has_enough_repetitions(fast.whole)
        and (slow.threads != fast.threads or not _has_enough_repetitions(both))
    ):
        a = slow.compute_quartiles()
        b = fast.compute_quartiles()
        return Spread(a.low / b.high, a.median / b.median, a.high / b.low)
    if _has_enough_repetitions(both):
        slow = slow._take_repetitions(both)
        fast = fast._take_repetitions(both)
    both = slow.clean & fast.clean
    if _has_enough_repetitions(both):
        return _compute_quartiles(slow.wall[both] / fast.wall[both])
    if slow.threads == fast.threads == 1:
        return _compute_quartiles(slow.processor / fast.processor)
    return _compute_quartiles(slow.wall / fast.wall)


def _has_enough_repetitions(which: NDArray[np.bool_]) -> bool:
    """Return True if these are repetitions enough for quartiles, or all."""
    return bool(which.sum() >= min(FEWEST, len(which)))


def run_calls_in_turns(calls: Mapping[str, Call], seconds: float) -> dict[str, Times]:
    """Return the times of calls that are run one after the other, over and over, for so many seconds [s] or a little more.

    Short calls are repeated within a repetition; the times are those of one run.
    """
    often = {name: _count(call) for name, call in calls.items()}
    taken: dict[str, list[_Repetition]] = {name: [] for name in calls}
    settled = SETTLED if any(call.threads > 1 for call in calls.values()) else 0.0
    start = clock.perf_counter()
    before = _read_system_time()
    own = clock.process_time()
    with _open_undisturbed_section(), Cores() as cores:
        for done in range(MOST):
            passed = clock.perf_counter() - start
            if done >= FEWEST and (
                passed > PATIENCE * seconds or (passed > seconds and _has_enough_common_turns(taken, calls))
            ):
                break
            for name, call in calls.items():
                taken[name].append(_run_repetition(call, *often[name], settled, cores))
    worked = _read_system_time() - before - (clock.process_time() - own)
    others = worked / (clock.perf_counter() - start) if np.isfinite(before) else np.inf
    return {name: _assemble_times(rows, calls[name].threads, others) for name, rows in taken.items()}


class _Repetition(NamedTuple):
    """One repetition: seconds of a run on the clock and of the processor, whether clean, the loops [s] before and after."""

    wall: float
    processor: float
    clean: bool
    loops: tuple[float, float]
    long: bool


def _assemble_times(rows: list[_Repetition], threads: int, others: float) -> Times:
    wall, own, clean = (np.array(column) for column in list(zip(*rows, strict=True))[:3])
    return Times(wall, own, clean, _find_undisturbed_repetitions(rows), threads, others)


def _find_undisturbed_repetitions(rows: list[_Repetition]) -> NDArray[np.bool_]:
    """Return a mask of the repetitions with whole processors: before and after, and within long ones."""
    own = np.array([row.processor for row in rows])
    steady = own <= STEADY * own.min() if rows[0].long else np.ones(len(rows), dtype=bool)
    return np.asarray(find_undisturbed_repetitions(np.array([row.loops for row in rows])) & steady)


def _has_enough_common_turns(taken: Mapping[str, list[_Repetition]], calls: Mapping[str, Call]) -> bool:
    """Return True if enough turns had whole cores, in all calls with as many threads, as those are compared."""
    for threads in {call.threads for call in calls.values()}:
        own = [_find_undisturbed_repetitions(rows) for name, rows in taken.items() if calls[name].threads == threads]
        if np.all(own, axis=0).sum() < ENOUGH:
            return False
    return True


def _run_repetition(call: Call, times: int, long: bool, settled: float, cores: Cores) -> _Repetition:
    looks = LOOKS if long else 1
    loop = cores.compute_loop_time(call.threads, looks)
    begun = clock.perf_counter()
    while not long:
        call.run()
        if clock.perf_counter() - begun > settled:
            break
    before = _count_interruptions()
    own = clock.process_time()
    start = clock.perf_counter()
    for _ in range(times):
        call.run()
    wall = clock.perf_counter() - start
    own = clock.process_time() - own
    clean = _count_interruptions() == before
    return _Repetition(wall / times, own / times, clean, (loop, cores.compute_loop_time(call.threads, looks)), long)


def _count(call: Call) -> tuple[int, bool]:
    """Return the number of runs in a repetition, and True if one is long; the first run counts only if it must."""
    taken = _run_timed_call(call)
    if taken < AGAIN:
        taken = _run_timed_call(call)
    if taken > LONG:
        return 1, True
    return max(1, int(REPETITION / max(taken, 1e-7))), False


def _run_timed_call(call: Call) -> float:
    start = clock.perf_counter()
    call.run()
    return clock.perf_counter() - start


def _compute_quartiles(values: Array) -> Spread:
    low, median, high = np.percentile(values, (25, 50, 75))
    return Spread(float(low), float(median), float(high))


def _count_interruptions() -> int:
    """Involuntary context switches so far; where the system does not tell, every repetition counts as clean."""
    try:
        import resource
    except ImportError:
        return 0
    return resource.getrusage(resource.RUSAGE_SELF).ru_nivcsw


def _read_system_time() -> float:
    """Seconds that all processors together have worked since the system began; infinite where it does not tell."""
    try:
        with open("/proc/stat", encoding="ascii") as stat:
            user, nice, system, _, _, *interrupts = (int(word) for word in stat.readline().split()[1:9])
    except OSError:
        return np.inf
    return (user + nice + system + sum(interrupts)) / os.sysconf("SC_CLK_TCK")


@contextmanager
def _open_undisturbed_section() -> Iterator[None]:
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
