"""solve_many: many payloads, stiffnesses, motions or mechanisms with one call, spread over threads.

Every scenario has arrays of its own and the compiled march holds no lock, so scenarios run side by side and each gives, bit
for bit, what `solve` gives alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat
from threading import Lock, Thread
from typing import Any

from flexinv.errors import InputError
from flexinv.kinematics import Progress
from flexinv.mechanism import Mechanism
from flexinv.memory import shared_pieces
from flexinv.motion import Motion
from flexinv.processors import go_to, processor_now, processors
from flexinv.scheme import solve
from flexinv.solution import Solution


@dataclass(frozen=True)
class Batch:
    """What became of the scenarios of one `solve_many`, in their order.

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
    if threads is not None and threads < 1:
        raise InputError(f"threads = {threads}: expected 1 or more, or None for one per processor")
    lock, results = Lock(), list[Solution | Exception | None](repeat(None, len(scenarios)))
    ahead = iter(
        range(len(scenarios))
    )  # taking the next is one operation of the interpreter: no two threads get the same

    def work() -> None:
        with shared_pieces():
            for k in ahead:
                mechanism, motion, own = scenarios[k]
                try:
                    results[k] = solve(mechanism, motion, **{"step": step, **options, **own})
                except Exception as error:  # whatever stops one scenario is kept as its result
                    results[k] = error
                if progress is not None:
                    with lock:
                        progress(1)

    side_by_side(work, min(threads or processors(), len(scenarios)))
    return Batch(
        solutions=tuple(result if isinstance(result, Solution) else None for result in results),
        errors={k: result for k, result in enumerate(results) if isinstance(result, Exception)},
    )


def side_by_side(work: Callable[[], None], threads: int) -> None:
    """Let so many threads [-] do the same work, this one among them; raises what stopped one of them."""
    stopped, here = list[BaseException](), processor_now()

    def kept(number: int) -> None:
        try:
            if number:
                go_to(number, here)
            work()
        except BaseException as error:
            stopped.append(error)

    others = [Thread(target=kept, args=(number,), name="flexinv") for number in range(1, threads)]
    for one in others:
        one.start()
    kept(0)
    for one in others:
        one.join()
    if stopped:
        raise stopped[0]


def _scenarios(
    mechanisms: Mechanism | Sequence[Mechanism],
    motions: Motion | Sequence[Motion],
    each: Sequence[Mapping[str, Any]] | None,
) -> list[tuple[Mechanism, Motion, Mapping[str, Any]]]:
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
