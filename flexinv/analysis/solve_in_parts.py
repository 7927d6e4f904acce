"""solve_in_parts: a march of any length in the memory of a part of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from flexinv.analysis.evaluation import assemble_solution
from flexinv.analysis.solution import Solution
from flexinv.analysis.task import (
    Progress,
    Start,
    Task,
    build_time_grid,
    check_settings,
    check_task,
    make_prescribed_task,
)
from flexinv.analysis.trajectory import run_first_step
from flexinv.dynamics.generalized_alpha import EXACT
from flexinv.errors import InputError
from flexinv.inverse.inverse_dynamics import compute_winding_efforts
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.validation import check_whole_number


def solve_in_parts(
    mechanism: Mechanism, motion: Motion, step: float, part: int = 10_000, end: float | None = None,
    spectral_radius: float = 0.8, initial: str = "consistent", start: Start = None, start_rate: Start = None,
    progress: Progress | None = None, every: int = 1, tolerance: float = EXACT,
) -> Iterator[Solution]:  # fmt: skip
    """Return the Solution of `solve` in consecutive parts, an iterator: a long one can go to disk while it is computed.

    part : kept samples [-] by which the parts advance; each begins with the sample [s] with which that before ended, and sums
        its work from there.  All else are arguments of `solve`, and the series are its own, up to rounding
    What is given is looked at by the call; a step is marched when its part is asked for, and its errors come with that part.
    Raises InputError as `solve` does, and for closures, which are solved as a whole; ConvergenceError.
    """
    every = check_task(mechanism, motion, initial, every, progress)
    part = check_whole_number("part", part, 1, "the number of samples of a part, 1 or more")
    if mechanism.closures:
        why = "has closures, whose motion is found as a whole; write flexinv.solve"
        raise InputError(f"solve_in_parts: mechanism '{mechanism.name}' {why}")
    steps = build_time_grid(motion, step, end, every)
    settings = replace(check_settings(step, spectral_radius, tolerance, initial), every=every)
    task = make_prescribed_task(mechanism, motion, steps, settings, start, start_rate, progress)
    return _solve_parts(replace(task, part=part))


def _solve_parts(task: Task) -> Iterator[Solution]:
    """Solutions of the parts, in which springs of joints that turn without end go on from where they were wound."""
    wound: dict[str, float] = {}
    for first in run_first_step(task):
        one = assemble_solution(task.mesh, first, task.settings)
        more = compute_winding_efforts(one.mechanism, one.q, wound)
        yield replace(one, torque_all=one.torque_all + more, reaction=one.reaction + more)
