"""solve: a task becomes a flexible trajectory, nodal forces and joint torques; the whole scheme in one call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from flexinv.analysis.accurate import check_accuracy, solve_problem, solve_within_accuracy
from flexinv.analysis.evaluation import FirstStep, assemble_solution, run_second_step
from flexinv.analysis.extrapolation import compute_extrapolated_step, take_every_sample, weights
from flexinv.analysis.nearby import find_largest_nearby
from flexinv.analysis.solution import Solution
from flexinv.analysis.task import (
    Progress,
    Settings,
    Start,
    Task,
    build_time_grid,
    check_settings,
    check_start,
    check_task,
    make_prescribed_task,
)
from flexinv.analysis.trajectory import run_first_step
from flexinv.dynamics.generalized_alpha import EXACT
from flexinv.errors import InputError
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import check_samples
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array
from flexinv.validation import check_flag

# Differences near each sample: of torque [N m], [N], and of every link's tip [m].
Bars = tuple[Array, dict[str, Array]]
Again = Callable[[Mechanism, Array, tuple[int, ...], Settings], tuple[Mesh, FirstStep]]

# Times the difference of steps h and h/2 [-]: the error of h, where that falls with the square of the step.  Extrapolation
# from both is better as a rule, but its gain is not known: vibration that no step resolves can undo it.
STEP_ERROR = 4 / 3


def solve(
    mechanism: Mechanism, motion: Motion, step: float | None = None, error: bool = False, end: float | None = None,
    spectral_radius: float = 0.8, initial: str = "consistent", incremental: bool = False,
    start: Start = None, start_rate: Start = None, progress: Progress | None = None,
    every: int = 1, tolerance: float = EXACT, accuracy: float | None = None,
) -> Solution:  # fmt: skip
    """Return the torques that make a mechanism, rigid, flexible or mixed, follow a motion of its joints.

    Two steps, one program:  task -> flexible trajectory (M, C, K act) -> P = M (a - g) -> tau = L T P.

    step : time step and spacing of the samples [s]; end : last time [s], the motion's duration by default
    accuracy : in place of a step the largest error of every torque, tip and free coordinate, part of its range [-]: steps, mesh
        and extrapolation are chosen for it (`analysis.accurate`), and error bars say so
    error : also march with half the step and on a refined mesh: ``torque_error``, ``tip_error``; the answer is extrapolated from
        both steps (not where joints stick, closures switch or the mode is incremental)
    spectral_radius : numerical damping of the march, 0 strong, 1 none [-]
    initial : "consistent" (starts undeformed) or "static" (starts in equilibrium under gravity, to which passive joints sink)
    incremental : the paper's incremental mode, accelerations from differences of nodal positions (`nodal_motion.differenced`)
    start, start_rate : initial coordinates and rates of passive joints (unactuated, not in the motion) [rad], [m], [1/s]
    progress : called with the number of steps done since its last call
    every : of so many steps one is kept in the solution [-], from the start on: a long march at a small step fits in memory
        (turns of passive joints are counted, and work is summed, over the samples that are kept)
    tolerance : what Newton may leave of positions, over the mechanism's length [-]; by default less than rounding.  1e-9 saves a
        third of the time of a beam in a plane; accelerations are then known to some tolerance x length / step^2 at worst
    Raises InputError for input that cannot be, ConvergenceError (time, increment, advice) if Newton fails.
    """
    every = check_task(mechanism, motion, initial, every, progress)
    error = check_flag("error", error)
    incremental = check_flag("incremental", incremental)
    if accuracy is not None or step is None:
        if incremental or every > 1:
            why = "it chooses the steps, their samples and the mode by itself; leave out incremental, every"
            raise InputError(f"accuracy: {why}")
        options: dict[str, Any] = {"end": end, "start": start, "start_rate": start_rate, "progress": progress}
        settings = check_settings(1.0, spectral_radius, tolerance, initial)
        return solve_within_accuracy(
            solve_problem(mechanism, motion, check_accuracy(accuracy, step), settings, options)
        )
    steps = build_time_grid(motion, step, end, every)
    if every > 1:
        _check_every(mechanism, every, incremental)
    if incremental:
        check_samples(len(steps[::every]), step)
    settings = replace(check_settings(step, spectral_radius, tolerance, initial), incremental=incremental, every=every)
    task = make_prescribed_task(mechanism, motion, steps, settings, start, start_rate, progress)
    (first,) = run_first_step(task)  # the flexible trajectory: M, C and K act
    if incremental:
        first = first.apply_differences(settings.step)
    second = run_second_step(task.mesh, first)  # P = M (a - g), tau = L T P
    solution = assemble_solution(task.mesh, first, settings, second)
    if mechanism.closures and (start or start_rate):
        check_start(task, motion, start, start_rate, solution.q[0], solution.qd[0])
    if not error:
        return solution

    return _add_bars(solution, first, task, _make_refined_run(motion, start, start_rate, progress))


def _make_refined_run(motion: Motion, start: Start, start_rate: Start, progress: Progress | None) -> Again:
    """The first step of the same task with other meshes, instants and settings."""

    def solve_refined(
        meshed: Mechanism, instants: Array, _: tuple[int, ...], settings: Settings
    ) -> tuple[Mesh, FirstStep]:
        other = make_prescribed_task(meshed, motion, instants, settings, start, start_rate, progress)
        (found,) = run_first_step(other)
        return other.mesh, found.apply_differences(settings.step) if settings.incremental else found

    return solve_refined


def _check_every(mechanism: Mechanism, every: int, incremental: bool) -> None:
    """Raise InputError where samples cannot be left out."""
    if incremental:
        raise InputError(f"every = {every}: the incremental mode takes differences from step to step; write every=1")
    if mechanism.closures and not mechanism.is_rigid:
        why = f"mechanism '{mechanism.name}' has closures and beams, of which every step is kept"
        raise InputError(f"every = {every}: {why}; write every=1")


def _add_bars(solution: Solution, first: FirstStep, task: Task, refined: Again) -> Solution:
    """The solution with its error bars, extrapolated where that can be."""
    incremental = task.settings.incremental
    # Of the half steps every second is compared, where not all are differenced.
    stride = 2 if incremental or solution.mechanism.closures else 1
    even = not incremental and _has_even_errors(task)
    solution = add_error_bars(solution, first, task.steps, task.settings, refined, stride, even)
    return replace(solution, settings=solution.settings | {"extrapolated": True}) if even else solution


def _has_even_errors(task: Task) -> bool:
    """Return True if a march's errors have even powers of the step: but where something sticks or closes.

    What is rigid and moved whole is exact at any step.
    """
    mechanism = task.mesh.mechanism
    marched = bool(mechanism.flexible) or (bool(task.passive) and not mechanism.closures)
    sticks = any(joint.friction for joint in mechanism.joints if joint.name in task.passive)
    return marched and not (sticks or any(closure.active for closure in mechanism.closures))


def add_error_bars(
    solution: Solution, first: FirstStep, steps: Array, settings: Settings, again: Again, stride: int, even: bool
) -> Solution:
    """Return a solution with error bars [N m], [N], [m] from half the step and from refined meshes, extrapolated if ``even``.

    first, steps, settings : of the solution; again : as `refinement.Problem.run`
    stride : samples of half the step that there are for each of its own [-]; even : whether the steps' errors have even powers
    """
    mechanism = solution.mechanism
    half = settings.step / 2
    finest = replace(settings, step=half, every=2 * settings.every // stride)
    mesh, halved = again(mechanism, steps[0] + half * np.arange(2 * len(steps) - 1), (), finest)
    better = solution
    bars = [_compute_scaled_difference(solution, assemble_solution(mesh, halved, finest), stride, STEP_ERROR)]
    if even:
        both = compute_extrapolated_step(mechanism, [first, take_every_sample(halved, stride)], weights((1, 2)))
        better = assemble_solution(solution.mesh, both, settings)
    if mechanism.flexible:
        # doubled where elements are linear (second order), two orders higher else
        linear = max((link.beam.order for link in mechanism.beams if link.beam is not None), default=0) == 1
        finer, factor = (mechanism.refined(elements=2), 4 / 3) if linear else (mechanism.refined(order=2), 1.0)
        mesh, first = again(finer, steps, (), settings)
        bars.append(_compute_scaled_difference(solution, assemble_solution(mesh, first, settings), 1, factor))
    torque = np.asarray(sum(bar[0] for bar in bars))
    tip = {name: np.asarray(sum(bar[1][name] for bar in bars)) for name in solution.tip}
    return replace(better, torque_error=torque, tip_error=tip)


def _compute_scaled_difference(solution: Solution, finer: Solution, stride: int, factor: float) -> Bars:
    """``factor`` times the largest differences near each sample: of torque [N m], [N], and of every link's tip [m]."""
    torque = np.abs(solution.torque - finer.torque[::stride][: len(solution.time)])
    tip = {k: np.linalg.norm(v - finer.tip[k][::stride][: len(v)], axis=1) for k, v in solution.tip.items()}
    return factor * find_largest_nearby(torque), {k: factor * find_largest_nearby(v) for k, v in tip.items()}
