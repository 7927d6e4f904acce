"""accurate_solve: inverse dynamics as exact as was asked, `flexinv.solve` with ``accuracy=``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from flexinv.accuracy.accurate import accurate
from flexinv.accuracy.refinement import Problem, Run, marched
from flexinv.accuracy.step_grid import step_grid
from flexinv.analysis.settings import Settings
from flexinv.analysis.solution import Solution
from flexinv.analysis.task import last_time, looked_up, prescribe
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array

Options = Mapping[str, Any]


def accurate_solve(
    mechanism: Mechanism, motion: Motion, accuracy: float, settings: Settings, options: Options
) -> Solution:
    """Return the torques [N m], [N] of a motion within ``accuracy`` [-] of their ranges; arguments as of `solve_problem`."""
    return accurate(solve_problem(mechanism, motion, accuracy, settings, options))


def solve_problem(
    mechanism: Mechanism, motion: Motion, accuracy: float, settings: Settings, options: Options
) -> Problem:
    """Return the inverse dynamics of a motion as a problem of any step [s] and mesh.

    accuracy : asked, part of ranges [-]; options : ``end``, ``start``, ``start_rate`` and ``progress`` of `solve`, where given
    """
    start, start_rate, progress = (options.get(name) for name in ("start", "start_rate", "progress"))

    def run(meshed: Mechanism, steps: Array, seams: tuple[int, ...], own: Settings) -> Run:
        task = replace(prescribe(meshed, motion, steps, own, start, start_rate), progress=progress)
        return marched(looked_up(task), seams)

    jumps = (*motion.jumps, *switching_times(mechanism))
    breaks = (*getattr(motion, "breaks", ()), *force_times(mechanism))
    grid = step_grid(breaks, jumps, 0.0, last_time(motion, options.get("end")))
    moves = {joint.name for joint in mechanism.joints if joint.nv}
    given = moves <= set(motion.joints(mechanism))
    integrated = not mechanism.is_rigid or not (given or mechanism.closures)
    return Problem(mechanism, grid, run, settings, accuracy, integrated)


def force_times(mechanism: Mechanism) -> tuple[float, ...]:
    """Return the times [s] between which given forces are linear."""
    return tuple(float(t) for force in mechanism.forces for t in force.time)


def switching_times(mechanism: Mechanism) -> tuple[float, ...]:
    """Return the times [s] at which closures begin or cease to act."""
    return tuple(float(t) for closure in mechanism.closures for interval in closure.active for t in interval)
