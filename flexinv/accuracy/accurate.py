"""Accurate solutions: a task as exact as was asked, with error bars; what ``accuracy=`` of the public verbs calls."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.accuracy.refinement import Answer, Problem, Refinement, refine, unreached
from flexinv.analysis.evaluation import FirstStep, second_step, solution_after, solution_of
from flexinv.analysis.extrapolation import extrapolated
from flexinv.analysis.solution import Solution
from flexinv.errors import InputError
from flexinv.inverse.trajectory_pass import Found
from flexinv.typing import Array
from flexinv.validation import number, refuse

# Below this part of the range rounding of accelerations is met; above a tenth nothing is asked.
FINEST, COARSEST = 1e-9, 0.1
# Samples to a coarsest step of a motion that is exact at any step.
EXACT_SAMPLES = 8
# What a solution says where nothing was extrapolated.
PLAIN = (
    "steps do not converge as powers of the step do: the answer is that of the shortest steps, with a bar of its own"
)


def check_accuracy(accuracy: float | None, step: float | None) -> float:
    """Return the accuracy asked [-]; raises InputError where there is none, a step [s] beside it, or no number."""
    if accuracy is None:
        raise InputError("neither step nor accuracy is given: write accuracy=1e-4, or a time step such as step=1e-3")
    if step is not None:
        raise InputError(
            f"step = {step} s and accuracy = {accuracy} are both given, and the accuracy decides the step: write one of them"
        )
    expected = f"a part of the range between {FINEST:g} and {COARSEST:g}"
    asked = number("accuracy", accuracy, f"{expected}, for example 1e-4")
    if not FINEST <= asked <= COARSEST:
        refuse("accuracy", accuracy, expected, "accuracy=1e-4")
    return asked


def accurate(problem: Problem) -> Solution:
    """Return the solution [N m, N, m, rad, s] of a problem with ``torque_error`` and ``tip_error`` within the accuracy asked.

    Raises ConvergenceError where no step and mesh lead there.
    """
    refinement = Refinement(problem)
    if not problem.marched:
        return _exact(refinement)
    answer = refine(refinement)
    level = answer.finest
    steps = [one.thinned(answer.kept) for one in answer.levels]
    mesh, grid = level.made.mesh, problem.grid
    first = extrapolated(mesh.mechanism, steps, answer.weight)
    found = second_step(mesh, first)
    solution = solution_of(mesh, first, found, level.made.settings)
    if not any(closure.active for closure in mesh.mechanism.closures):
        jumps = {int(np.abs(first.time - t).argmin()) for t in level.made.jumps}
        work = energy_defect(first, found, grid.seams(answer.kept), jumps)
        solution = replace(solution, balance=replace(solution.balance, work=work))
    return _told(refinement, answer, solution)


def _exact(refinement: Refinement) -> Solution:
    level = refinement.level(0, EXACT_SAMPLES)
    if level is None:
        raise unreached(refinement, None)
    solution = solution_after(level.made.mesh, level.first, level.made.settings)
    bars = _rounding(solution)
    tips = {name: np.full(len(solution.time), np.finfo(float).eps * solution.mesh.length) for name in solution.tip}
    return replace(
        solution, torque_error=bars, tip_error=tips,
        settings=solution.settings | {"accuracy": refinement.problem.accuracy, "extrapolated": False, "order": 0.0},
    )  # fmt: skip


def _rounding(solution: Solution) -> Array:
    """Rounding of torques (samples, actuated) [N m], [N]: both sides of every joint are summed from other numbers."""
    apart = np.abs(solution.torque_all - solution.reaction)[:, solution.mechanism.actuated]
    floor = np.finfo(float).eps * len(solution.mesh.parent) * np.abs(solution.torque).max(axis=0, initial=0.0)
    return np.asarray(apart + floor)


def _told(refinement: Refinement, answer: Answer, solution: Solution) -> Solution:
    """The solution with its bars, and what was done to get it."""
    asked, count, rounding = refinement.problem.accuracy, solution.torque.shape[1], _rounding(solution)
    torque = answer.bars[:, :count] * answer.ranges.torque + rounding
    if (rounding > asked * answer.ranges.torque).any():
        raise unreached(refinement, answer)
    links = zip(solution.tip, answer.ranges.tip, strict=True)
    tips = {name: answer.bars[:, count + k] * size for k, (name, size) in enumerate(links)}
    plain = len(answer.levels) == 1
    notes = solution.notes + ((PLAIN,) if plain else ())
    said: dict[str, float | int | str | bool] = {
        "accuracy": asked,
        "extrapolated": not plain,
        "order": round(answer.order, 2),
    }
    return replace(solution, torque_error=torque, tip_error=tips, notes=notes, settings=solution.settings | said)


def energy_defect(first: FirstStep, found: Found, seams: Sequence[int], jumps: Collection[int]) -> Array:
    """Return (samples,) [J]: work of efforts and applied forces less what is dissipated, less the change of energy.

    Between the samples, which are far apart, the power is a spline of degree 5 in every stretch between ``seams`` [-]; where it
    jumps, the value before the jump is the spline's own.
    """
    motion, power = first.trajectory.motion, (found.tau * first.joints[1]).sum(axis=1) - first.trajectory.energy[:, 2]
    if first.applied is not None:
        spin = np.einsum("snij,snj->sni", motion.rotation, motion.omega)
        power = power + (first.applied.force * motion.v + first.applied.moment * spin).sum(axis=(1, 2))
    energy = found.kinetic + found.potential + first.trajectory.energy[:, 0]
    worked = np.zeros(len(energy))
    for start, end in pairwise([0, *seams, len(energy) - 1]):
        own = slice(start, end if end in jumps else end + 1)
        time = first.time[own]
        spline = scipy.interpolate.make_interp_spline(time, power[own], k=min(5, len(time) - 1)).antiderivative()
        worked[start + 1 : end + 1] = (
            worked[start] + spline(first.time[start + 1 : end + 1]) - spline(first.time[start])
        )
    return np.asarray(worked - (energy - energy[0]))
