"""accurate_simulate: forward dynamics as exact as was asked, `flexinv.simulate` with ``accuracy=``."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexinv.accuracy.accurate import accurate
from flexinv.accuracy.accurate_solve import force_times, switching_times
from flexinv.accuracy.refinement import Problem, Run, marched
from flexinv.accuracy.step_grid import step_grid
from flexinv.analysis.settings import Settings
from flexinv.analysis.solution import Solution
from flexinv.analysis.task import Task
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array


def accurate_simulate(
    mechanism: Mechanism,
    time: Array,
    accuracy: float,
    settings: Settings,
    state: Callable[[Mechanism, Array, Settings], Task],
) -> Solution:
    """Return the motion [m, rad, s] that torques give, tips and coordinates within ``accuracy`` [-] of their ranges.

    time : of the torque's rows [s], between which it is linear; state : mechanism, instants [s], settings -> Task
    """

    def run(meshed: Mechanism, steps: Array, seams: tuple[int, ...], own: Settings) -> Run:
        return marched(state(meshed, steps, own), seams)

    jumps = (*time[1:][np.diff(time) == 0.0], *switching_times(mechanism))
    grid = step_grid((*time, *force_times(mechanism)), jumps, float(time[0]), float(time[-1]))
    return accurate(Problem(mechanism, grid, run, settings, accuracy))
