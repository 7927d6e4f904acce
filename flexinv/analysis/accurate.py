"""Accurate solutions: a task as exact as was asked, with error bars; what ``accuracy=`` of the public verbs calls."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.analysis.evaluation import FirstStep, assemble_solution, run_second_step
from flexinv.analysis.extrapolation import compute_extrapolated_step, take_every_sample
from flexinv.analysis.refinement import (
    COARSEST,
    FINEST,
    Problem,
    Refinement,
    StepGrid,
    find_cheapest_answer,
    make_accuracy_error,
)
from flexinv.analysis.solution import Solution
from flexinv.analysis.task import Settings, Task, Words, make_prescribed_task, resolve_last_time
from flexinv.analysis.trajectory import run_first_step
from flexinv.errors import InputError
from flexinv.inverse.nodal_sums import SecondStepArrays
from flexinv.kinematics.mesh import Mesh
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array
from flexinv.validation import check_number, refuse

TaskOf = Callable[[Mechanism, Array, Settings], Task]
# Coarsest steps: so many in the run, and so many in the longest stretch of it that is smooth, unless that is too many in the run.
FEWEST_IN_RUN = 40
FEWEST_IN_STRETCH = 16
MOST_IN_RUN = 160
# After a jump of the acceleration what is stiff and damped settles: so many times the step is halved towards the jump.
# (From 14 on the accelerations of such short steps are rounding; with 7 a damped arm takes four times as long to 1e-5:
# docs/studies/accuracy.py.)
GRADES = 11
# Instants closer than this part of the run are one.
SAME = 1e-9
EXACT_SAMPLES = 8  # to a coarsest step, of a motion that is exact at any step
# What a solution says where nothing was extrapolated.
NOT_EXTRAPOLATED = (
    "steps do not converge as powers of the step do: the answer is that of the shortest steps, with a bar of its own"
)


def check_accuracy(accuracy: float | None, step: float | None) -> float:
    """Return the accuracy asked [-]; raises InputError where there is none, a step [s] beside it, or no number."""
    if accuracy is None:
        raise InputError("neither step nor accuracy is given: write accuracy=1e-4, or a time step such as step=1e-3")
    if step is not None:
        both = f"step = {step} s and accuracy = {accuracy}"
        raise InputError(f"{both} are both given, and the accuracy decides the step: write one of them")
    expected = f"a part of the range between {FINEST:g} and {COARSEST:g}"
    asked = check_number("accuracy", accuracy, f"{expected}, for example 1e-4")
    if not FINEST <= asked <= COARSEST:
        refuse("accuracy", accuracy, expected, "accuracy=1e-4")
    return asked


def solve_problem(
    mechanism: Mechanism, motion: Motion, accuracy: float, settings: Settings, options: Mapping[str, Any]
) -> Problem:
    """Return the inverse dynamics of a motion as a problem of any step [s] and mesh.

    accuracy : asked, part of ranges [-]; options : ``end``, ``start``, ``start_rate`` and ``progress`` of `solve`, where given
    """
    start, start_rate, progress = (options.get(name) for name in ("start", "start_rate", "progress"))

    def make_task(meshed: Mechanism, steps: Array, settings: Settings) -> Task:
        return make_prescribed_task(meshed, motion, steps, settings, start, start_rate, progress)

    given = set(mechanism.moving_names) <= set(motion.joints(mechanism))
    breaks = getattr(motion, "breaks", ())
    span = (0.0, resolve_last_time(motion, options.get("end")))
    problem = make_problem(mechanism, make_task, settings, accuracy, breaks, motion.jumps, span)
    return replace(problem, marched=not mechanism.is_rigid or not (given or mechanism.closures))


def make_problem(
    mechanism: Mechanism, task_of: TaskOf, settings: Settings, accuracy: float,
    breaks: Iterable[float], jumps: Iterable[float], span: tuple[float, float],
) -> Problem:  # fmt: skip
    """Return a task as a problem of any step [s] and mesh that is integrated in time; accuracy : asked, part of ranges [-].

    breaks, jumps : times [s] at which what is given is not smooth, and at which accelerations jump; span : first and last time
    """

    def run(meshed: Mechanism, steps: Array, seams: tuple[int, ...], settings: Settings) -> tuple[Mesh, FirstStep]:
        (first,) = run_first_step(task := replace(task_of(meshed, steps, settings), seams=seams))
        return task.mesh, first

    forces = [float(t) for force in mechanism.forces for t in force.time]  # linear between
    switches = (float(t) for closure in mechanism.closures for interval in closure.active for t in interval)
    sudden = (*jumps, *switches)
    return Problem(mechanism, build_step_grid((*breaks, *forces), sudden, *span), run, settings, accuracy, sudden)


def build_step_grid(breaks: Iterable[float], jumps: Iterable[float], first: float, last: float) -> StepGrid:
    """Return the coarsest grid from ``first`` to ``last`` [s] that meets the ``breaks`` [s] between them.

    jumps : breaks [s] at which accelerations jump: after them steps are short and double; at all others stretches of equal
        steps are joined
    """
    span = last - first
    ends = _drop_close_times([first, *sorted(t for t in (*breaks, *jumps) if first < t < last), last], SAME * span)
    longest = min(span / FEWEST_IN_RUN, max(np.diff(ends).max() / FEWEST_IN_STRETCH, span / MOST_IN_RUN))
    sudden = [t for t in ends[:-1] if any(abs(t - jump) <= SAME * span for jump in jumps)]
    graded = [t + 2 * longest / 2**k for t in sudden for k in range(GRADES)]
    ends = _drop_close_times([first, *sorted({*ends[1:-1], *(t for t in graded if t < last)}), last], SAME * span)
    counts = np.ceil(np.diff(ends) / longest * (1 - SAME)).astype(int).tolist()
    kept = [0]
    joined = counts[:1]
    steps = np.diff(ends) / counts
    for k in range(1, len(counts)):
        alike = abs(steps[k] - steps[k - 1]) <= SAME * longest
        if alike and not any(abs(ends[k] - t) <= SAME * span for t in jumps):
            joined[-1] += counts[k]
        else:
            kept.append(k)
            joined.append(counts[k])
    return StepGrid(ends[[*kept, -1]], tuple(joined))


def _drop_close_times(times: list[float], least: float) -> Array:
    """Times [s] without those that are the same as one before, the last one kept."""
    kept = [times[0]]
    for t in times[1:-1]:
        if t - kept[-1] > least and times[-1] - t > least:
            kept.append(t)
    return np.array([*kept, times[-1]])


def solve_within_accuracy(problem: Problem) -> Solution:
    """Return the solution [N m, N, m, rad, s] with bars within the accuracy asked; raises ConvergenceError out of reach."""
    refinement = Refinement(problem)
    if not problem.marched:
        return _solve_exactly(refinement)
    answer = find_cheapest_answer(refinement)
    level = answer.levels[-1]
    steps = [take_every_sample(one.first, one.samples_per_step // answer.samples_per_step) for one in answer.levels]
    first = compute_extrapolated_step(level.mesh.mechanism, steps, answer.weight)
    found = run_second_step(level.mesh, first)
    solution = assemble_solution(level.mesh, first, level.settings, found)
    if not any(closure.active for closure in problem.mechanism.closures):
        jumps = {int(np.abs(first.time - t).argmin()) for t in problem.jumps}
        work = compute_energy_defect(first, found, problem.grid.list_seams(answer.samples_per_step), jumps)
        solution = replace(solution, balance=replace(solution.balance, work=work))
    asked = problem.accuracy
    count = solution.torque.shape[1]
    rounding = _compute_rounding(solution)
    if (rounding > asked * answer.ranges.torque).any():
        raise make_accuracy_error(refinement, answer)
    torque = answer.bars[:, :count] * answer.ranges.torque + rounding
    links = zip(solution.tip, answer.ranges.tip, strict=True)
    tips = {name: answer.bars[:, count + k] * size for k, (name, size) in enumerate(links)}
    if is_plain := len(answer.levels) == 1:
        solution = replace(solution, notes=(*solution.notes, NOT_EXTRAPOLATED))
    words: Words = {"accuracy": asked, "extrapolated": not is_plain, "order": round(answer.order, 2)}
    return replace(solution, torque_error=torque, tip_error=tips, settings=solution.settings | words)


def _solve_exactly(refinement: Refinement) -> Solution:
    """The solution of a problem that is exact at any step, with bars of rounding."""
    if (exact := refinement.run_level(0, EXACT_SAMPLES)) is None:
        raise make_accuracy_error(refinement, None)
    solution = assemble_solution(exact.mesh, exact.first, exact.settings)
    last = np.finfo(float).eps * solution.mesh.length
    tips = {name: np.full(len(solution.time), last) for name in solution.tip}
    words: Words = {"accuracy": refinement.problem.accuracy, "extrapolated": False, "order": 0.0}
    settings = solution.settings | words
    return replace(solution, torque_error=_compute_rounding(solution), tip_error=tips, settings=settings)


def _compute_rounding(solution: Solution) -> Array:
    """Rounding of torques (samples, actuated) [N m], [N]: both sides of every joint are summed from other numbers."""
    apart = np.abs(solution.torque_all - solution.reaction)[:, solution.mechanism.actuated]
    floor = np.finfo(float).eps * len(solution.mesh.parent) * np.abs(solution.torque).max(axis=0, initial=0.0)
    return np.asarray(apart + floor)


def compute_energy_defect(
    first: FirstStep, found: SecondStepArrays, seams: Sequence[int], jumps: Collection[int]
) -> Array:
    """Return (samples,) [J]: work of efforts and applied forces less what is dissipated, less the change of energy.

    Between the samples, which are far apart, the power is a spline of degree 5 in every stretch between ``seams`` [-]; where it
    jumps, the value before the jump is the spline's own.
    """
    motion = first.trajectory.motion
    power = (found.tau * first.joints[1]).sum(axis=1) - first.trajectory.energy[:, 2]
    if first.applied is not None:
        spin = np.einsum("snij,snj->sni", motion.rotation, motion.omega)
        power = power + (first.applied.force * motion.v + first.applied.moment * spin).sum(axis=(1, 2))
    energy = found.kinetic + found.potential + first.trajectory.energy[:, 0]
    worked = np.zeros(len(energy))
    for start, end in pairwise([0, *seams, len(energy) - 1]):
        piece = slice(start, end if end in jumps else end + 1)
        ends = slice(start + 1, end + 1)
        time = first.time[piece]
        spline = scipy.interpolate.make_interp_spline(time, power[piece], k=min(5, len(time) - 1)).antiderivative()
        worked[ends] = worked[start] + spline(first.time[ends]) - spline(first.time[start])
    return np.asarray(worked - (energy - energy[0]))
