"""solve_many: many payloads, stiffnesses, motions or mechanisms with one call, spread over threads.

Scenarios of one structure are integrated many in one compiled call (`batch_groups`); each of the others is a `solve` of its own,
whose compiled time integration holds no lock.  So they run side by side, and each result is, bit for bit, that of `solve` alone.
"""

from __future__ import annotations

from _thread import start_new_thread
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import signature
from itertools import repeat
from queue import SimpleQueue
from threading import Lock
from typing import Any

from flexinv.analysis.batch_groups import alike, prepare_all, solve_alike
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve
from flexinv.analysis.task import Progress
from flexinv.errors import InputError
from flexinv.kernels.memory import shared_pieces
from flexinv.kernels.threads.affinity import go_to, limit, processor_now, processors
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.rigid.prepare import THREADS
from flexinv.validation import function, nearest, whole

OPTIONS = tuple(signature(solve).parameters)[2:]  # what a scenario may say beside its mechanism and its motion


@dataclass(frozen=True)
class Batch:
    """Results of the scenarios of one `solve_many`, in their order.

    solutions : a Solution for each scenario, None where it failed
    errors : number of the scenario -> what stopped it
    """

    solutions: tuple[Solution | None, ...]
    errors: dict[int, Exception]

    def all(self) -> list[Solution]:
        """Return all solutions; raises the first error if there is one."""
        for error in self.errors.values():
            raise error
        return [solution for solution in self.solutions if solution is not None]


def solve_many(
    mechanisms: Mechanism | Sequence[Mechanism],
    motions: Motion | Sequence[Motion],
    step: float,
    each: Sequence[Mapping[str, Any]] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Batch:
    """Return the solutions of many scenarios: `solve` of every mechanism with every motion that stands beside it.

    mechanisms, motions : one, or a list with one for each scenario; ``step`` and ``options`` are those of `solve`  [s]
    each : for every scenario the options in which it differs, for example {"start": {"swing": 0.1}} or {"step": 1e-4}
    threads : how many work at a time [-], by default one for every processor that the process may use
    progress : called with 1 after every scenario, from any thread but one at a time

    A scenario that fails does not stop the others: its error is kept.  Raises InputError for lists of unequal length.
    """
    scenarios = _scenarios(mechanisms, motions, each)
    _check_options(options, "")
    function("progress", progress, "a function that is called with 1 after every scenario")
    count = processors() if threads is None else min(whole("threads", threads, 1, THREADS), limit())
    lock, results = Lock(), list[Solution | Exception | None](repeat(None, len(scenarios)))
    prepared = prepare_all(scenarios, {"step": step, **options})
    runs = [run for run in alike(prepared) if len(run) > 1]
    together = {k for run in runs for k in run}
    ahead = deque(k for k in range(len(scenarios)) if k not in together)

    def work() -> None:
        with shared_pieces():
            while ahead:
                try:
                    k = ahead.popleft()
                except IndexError:  # another thread has taken it
                    return
                mechanism, motion, own = scenarios[k]
                try:
                    results[k] = solve(mechanism, motion, **{"step": step, **options, **own})
                except Exception as error:  # whatever stops one scenario is kept as its result
                    results[k] = error
                if progress is not None:
                    with lock:
                        progress(1)

    for run in runs:
        found = solve_alike([prepared[k] for k in run], count, side_by_side, progress)
        for k, result in zip(run, found, strict=True):
            results[k] = result
    if len(together) < len(scenarios):
        side_by_side(work, ahead.clear, min(count, len(scenarios) - len(together)))
    return Batch(
        solutions=tuple(result if isinstance(result, Solution) else None for result in results),
        errors={k: result for k, result in enumerate(results) if isinstance(result, Exception)},
    )


def side_by_side(work: Callable[[], None], stop: Callable[[], None], threads: int) -> None:
    """Let so many threads [-] do the same work, this one among them; what stops one stops all, and is raised.

    Threads are started at the lowest level: `Thread.start` waits until the new one has the interpreter, for as long as a short
    scenario takes a quarter of.
    """
    ended, here = SimpleQueue[BaseException | None](), processor_now()

    def kept(number: int) -> None:
        try:
            if number:
                go_to(number, here)
            work()
        except BaseException as error:
            stop()
            ended.put(error)
        else:
            ended.put(None)

    begun = 1
    try:
        for number in range(1, threads):
            start_new_thread(kept, (number,))
            begun += 1
    except RuntimeError:  # no more threads: those that are there have to do
        pass
    kept(0)
    try:
        errors = [ended.get() for _ in range(begun)]
    except KeyboardInterrupt:
        stop()
        raise
    for error in errors:
        if error is not None:
            raise error


def _scenarios(
    mechanisms: Mechanism | Sequence[Mechanism],
    motions: Motion | Sequence[Motion],
    each: Sequence[Mapping[str, Any]] | None,
) -> list[tuple[Mechanism, Motion, Mapping[str, Any]]]:
    _check_lists(mechanisms, motions, each)
    given = {"motions": motions, "mechanisms": mechanisms, "each": each}
    lengths = {name: len(value) for name, value in given.items() if isinstance(value, Sequence)}
    if len(set(lengths.values())) > 1:
        found = ", ".join(f"{name} has {count}" for name, count in lengths.items())
        raise InputError(f"solve_many: {found}: expected lists of equal length, one entry for each scenario")
    count = next(iter(lengths.values()), 1)
    columns = (
        repeat(mechanisms, count) if isinstance(mechanisms, Mechanism) else mechanisms,
        repeat(motions, count) if isinstance(motions, Motion) else motions,
        repeat({}, count) if each is None else each,
    )
    return list(zip(*columns, strict=True))


def _check_options(options: Mapping[str, Any], where: str) -> None:
    for name in options:
        if name not in OPTIONS:
            like = nearest(str(name), OPTIONS)
            raise InputError(
                f"solve_many: {where}{name!r} is no option of solve: expected some of {', '.join(OPTIONS)}"
                + (f"; write {like!r}" if like else "")
            )


def _check_lists(mechanisms: object, motions: object, each: object) -> None:
    for name, value, kind in (("mechanisms", mechanisms, Mechanism), ("motions", motions, Motion)):
        if isinstance(value, str) or not isinstance(value, (kind, Sequence)):
            raise InputError(
                f"solve_many: {name} is a {type(value).__name__}: expected one {kind.__name__} or a list; write list({name})"
            )
    if each is not None and not (isinstance(each, Sequence) and all(isinstance(own, Mapping) for own in each)):
        raise InputError(
            f"solve_many: each is a {type(each).__name__}: expected a list with a table of options for every scenario, such as "
            '[{"step": 1e-3}, {}]; options of all scenarios are arguments of solve_many'
        )
    for k, own in enumerate(each or ()):
        _check_options(own, f"each[{k}]: ")
