"""solve_in_parts: a march of any length in the memory of a part of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from flexinv.analysis.evaluation import solution_after
from flexinv.analysis.settings import checked
from flexinv.analysis.solution import Solution
from flexinv.analysis.task import Progress, Task, check_task, prescribe, time_grid
from flexinv.analysis.trajectory import first_step
from flexinv.dynamics.generalized_alpha import EXACT
from flexinv.errors import InputError
from flexinv.kinematics.nodal_motion import scalar_coordinate
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.validation import whole


def solve_in_parts(
    mechanism: Mechanism,
    motion: Motion,
    step: float,
    part: int = 10_000,
    end: float | None = None,
    spectral_radius: float = 0.8,
    initial: str = "consistent",
    start: Mapping[str, ArrayLike] | None = None,
    start_rate: Mapping[str, ArrayLike] | None = None,
    progress: Progress | None = None,
    every: int = 1,
    tolerance: float = EXACT,
) -> Iterator[Solution]:
    """Return the Solution of `solve` in consecutive parts, an iterator: a long one can go to disk while it is computed.

    part : kept samples [-] by which the parts advance; each begins with the sample [s] with which that before ended, and sums
        its work from there.  All else are arguments of `solve`, and the series are its own, up to rounding
    What is given is looked at by the call; a step is marched when its part is asked for, and its errors come with that part.

    Raises InputError as `solve` does, and for closures, which are solved as a whole; ConvergenceError.
    """
    every = check_task(mechanism, motion, initial, every, progress)
    part = whole("part", part, 1, "the number of samples of a part, 1 or more")
    if mechanism.closures:
        raise InputError(
            f"solve_in_parts: mechanism '{mechanism.name}' has closures, whose motion is found as a whole; write flexinv.solve"
        )
    steps = time_grid(motion, step, end, every)
    settings = replace(checked(step, spectral_radius, tolerance, initial), every=every)
    task = prescribe(mechanism, motion, steps, settings, start, start_rate)
    return _parts(replace(task, progress=progress, part=part))


def _parts(task: Task) -> Iterator[Solution]:
    wound: dict[str, float] = {}
    for first in first_step(task):
        yield _wind_on(solution_after(task.mesh, first, task.settings), wound)


def _wind_on(solution: Solution, wound: dict[str, float]) -> Solution:
    """Let springs of joints that turn without end go on from the angles [rad] to which they were wound, and keep these."""
    mechanism = solution.mechanism
    more = np.zeros(mechanism.nv)
    for joint in mechanism.joints:
        if KINDS[joint.kind].circle and joint.stiffness:
            angle = scalar_coordinate(joint, solution.q[:, mechanism.q_slices[joint.name]])
            turns = 2 * np.pi * np.round((wound.get(joint.name, angle[0]) - angle[0]) / (2 * np.pi))
            wound[joint.name] = angle[-1] + turns
            more[mechanism.v_slices[joint.name].start] = joint.stiffness * turns
    return replace(solution, torque_all=solution.torque_all + more, reaction=solution.reaction + more)
