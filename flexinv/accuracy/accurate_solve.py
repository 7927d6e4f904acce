"""accurate_solve: inverse dynamics as exact as was asked, `flexinv.solve` with ``accuracy=``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from numpy.typing import ArrayLike

from flexinv.accuracy.accurate import accurate, check_accuracy
from flexinv.accuracy.refinement import Problem
from flexinv.accuracy.step_grid import step_grid
from flexinv.analysis.settings import Settings
from flexinv.analysis.solution import Solution
from flexinv.analysis.task import Progress, Task, last_time, looked_up, prescribe
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array

Starts = tuple[Mapping[str, ArrayLike] | None, Mapping[str, ArrayLike] | None, Progress | None]


def accurate_solve(
    mechanism: Mechanism, motion: Motion, accuracy: float | None, step: float | None, end: float | None, settings: Settings, starts: Starts
) -> Solution:
    """Return the torques [N m], [N] of a motion within ``accuracy`` [-] of their ranges; arguments as of `solve`, no step [s].

    starts : ``start``, ``start_rate`` and ``progress`` of `solve`
    """
    asked, (start, start_rate, progress) = check_accuracy(accuracy, step), starts

    def state(meshed: Mechanism, steps: Array, own: Settings) -> Task:
        return looked_up(replace(prescribe(meshed, motion, steps, own, start, start_rate), progress=progress))

    sudden = switching_times(mechanism)
    jumps = (*motion.jumps, *sudden)
    breaks = (*getattr(motion, "breaks", ()), *(float(t) for force in mechanism.forces for t in force.time))
    grid = step_grid(breaks, jumps, 0.0, last_time(motion, end))
    moves = {joint.name for joint in mechanism.joints if joint.nv}
    given = moves <= set(motion.joints(mechanism))
    marched = not mechanism.is_rigid or not (given or mechanism.closures)
    return accurate(Problem(mechanism, grid, state, settings, asked), marched)


def switching_times(mechanism: Mechanism) -> tuple[float, ...]:
    """Return the times [s] at which closures begin or cease to act."""
    return tuple(float(t) for closure in mechanism.closures for interval in closure.active for t in interval)
