"""solve_many: many payloads, stiffnesses, motions or mechanisms with one call, spread over threads.

Every scenario has arrays of its own and the compiled march holds no lock, so scenarios run side by side and each gives, bit
for bit, what `solve` gives alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count, repeat
from threading import Lock
from typing import Any

from flexinv.errors import InputError
from flexinv.kinematics import Progress
from flexinv.mechanism import Mechanism
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
    lock = Lock()

    def run(scenario: tuple[Mechanism, Motion, Mapping[str, Any]]) -> Solution | Exception:
        mechanism, motion, own = scenario
        try:
            return solve(mechanism, motion, **{"step": step, **options, **own})
        except Exception as error:  # whatever stops one scenario is kept as its result
            return error
        finally:
            if progress is not None:
                with lock:
                    progress(1)

    most, numbers, here = min(threads or processors(), len(scenarios) or 1), count(), processor_now()
    with ThreadPoolExecutor(most, initializer=lambda: go_to(next(numbers), here) if most > 1 else None) as pool:
        results = list(pool.map(run, scenarios))
    return Batch(
        solutions=tuple(result if isinstance(result, Solution) else None for result in results),
        errors={k: result for k, result in enumerate(results) if isinstance(result, Exception)},
    )


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
    length = next(iter(lengths.values()), 1)
    columns = (
        repeat(mechanisms, length) if isinstance(mechanisms, Mechanism) else mechanisms,
        repeat(motions, length) if isinstance(motions, Motion) else motions,
        repeat({}, length) if each is None else each,
    )
    return list(zip(*columns, strict=True))
