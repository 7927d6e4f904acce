"""Instructions of single steps, counted by callgrind: the same on every run, and no times."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from campaigns.hardness.libraries import MACHINES, Library, open_library, run_command
from flexinv.dynamics.stepper import MOST_ITERATIONS, PREDICTED_ITERATIONS
from flexinv.export.c_files import STATUSES
from flexinv.planar.stepper import MANY

STEPS = 10_000
WILD = 1500  # steps to random places
TARGET = "x86-64-v3"
OK, NO_SOLUTION = map(list(STATUSES).index, ("OK", "NO_SOLUTION"))


@dataclass(frozen=True)
class MeasuredCall:
    """A call: what it was, its status, its iterations of Newton's method and its instructions [-]."""

    what: str
    status: int
    iterations: int
    instructions: int


def list_instruction_rows(scale: float) -> Iterator[str]:
    """Yield lines about the instructions of single calls [-]: median, 99.9 %, worst, refused ones, and the bound at the cap."""
    for machine in MACHINES:
        with open_library(machine, (TARGET,)) as library:
            yield f"{machine.title}: {describe_calls(library, count_instructions(library, int(scale * STEPS)))}"


def count_instructions(library: Library, steps: int) -> list[MeasuredCall]:
    """Return the calls of the program `counted.c` [-], each with its instructions."""
    program = library.compile("counted.c", TARGET)
    out = library.folder / "callgrind.out"
    words = ["valgrind", "-q", "--tool=callgrind", f"--callgrind-out-file={out}", "--combine-dumps=yes"]
    words += ["--toggle-collect=measured_call", "--dump-after=measured_call"]
    said = run_command([*words, program, library.motion, steps, WILD]).splitlines()
    counts = _read_totals(out)
    calls = [line.split() for line in said]
    return [
        MeasuredCall(what, int(status), int(iterations), count)
        for (what, status, iterations), count in zip(calls, counts, strict=True)
    ]


def _read_totals(out: Path) -> list[int]:
    """The sums of all parts that were dumped, without the last, which is what comes after the last call."""
    with out.open(encoding="utf-8") as lines:
        found = [int(one[1]) for line in lines if (one := re.match(r"totals: (\d+)", line))]
    return found[:-1]


def describe_calls(library: Library, calls: list[MeasuredCall]) -> str:
    """Return in words what calls take [-]."""
    steps = np.array([one.instructions for one in calls if one.what == "step"])
    failed = sum(one.status != 0 for one in calls if one.what == "step")
    refused = next(one for one in calls if one.what == "refused")
    words = (
        f"{len(steps)} calls ({failed} refused): median {np.median(steps):.0f}, 99.9 % {np.percentile(steps, 99.9):.0f}, worst "
        f"{steps.max()}; jump by 2 rad: {list(STATUSES)[refused.status]}, {refused.instructions}"
    )
    if library.machine.step is None:
        return words
    wild = [one for one in calls if one.what == "wild"]
    worst = max(wild, key=lambda one: one.instructions)
    return (
        f"{words}; {len(wild)} wild steps: worst {worst.instructions} ({list(STATUSES)[worst.status]}, {worst.iterations} "
        f"iterations); bound {compute_bound(library, calls):.0f}"
    )


def compute_bound(library: Library, calls: list[MeasuredCall]) -> float:
    """Return instructions of a call that takes all evaluations that it may, each as dear as the dearest that was seen [-].

    A call with more iterations than its first try may have has begun anew: one evaluation more than those, and one before.
    """
    in_plane = "IN_PLANE 1" in (library.folder / "src" / f"{library.name}.c").read_text(encoding="utf-8")
    first, second = (MANY, MOST_ITERATIONS) if in_plane else (PREDICTED_ITERATIONS, MOST_ITERATIONS)
    again = [one for one in calls if one.iterations > first and one.status in (OK, NO_SOLUTION)]
    dearest = max((one.instructions / (one.iterations + 2) for one in again), default=np.nan)
    return (first + second + 2) * dearest
