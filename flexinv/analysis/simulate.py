"""simulate: torques become a motion, by the same model and the same march with every joint free."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import compress

import numpy as np
from numpy.typing import ArrayLike

from flexinv.analysis.accurate import check_accuracy, make_problem, solve_within_accuracy
from flexinv.analysis.evaluation import assemble_solution
from flexinv.analysis.solution import Solution
from flexinv.analysis.task import MOST_SAMPLES, Progress, Settings, Task, check_settings, make_rest_history
from flexinv.analysis.trajectory import SAME_TIME, run_first_step
from flexinv.constraints.closures import build_constraint_rows, find_acting_closures
from flexinv.constraints.loop_starts import (
    ANOTHER_BRANCH,
    SAGGED,
    StatedStart,
    build_joint_mask,
    check_static,
    find_consistent_start,
)
from flexinv.dynamics.generalized_alpha import EXACT
from flexinv.dynamics.solver import Efforts
from flexinv.errors import InputError
from flexinv.kinematics.mesh import build
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.model.joint_kinds import KINDS, POSE
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import resolve_start_coordinates
from flexinv.typing import Array
from flexinv.validation import check_callable, check_kind, check_number, convert_to_floats, shown


def simulate(
    mechanism: Mechanism, time: ArrayLike, torque: ArrayLike | None = None, step: float | None = None,
    spectral_radius: float = 0.8, initial: str = "consistent",
    start: Mapping[str, ArrayLike] | None = None, start_rate: Mapping[str, ArrayLike] | None = None,
    progress: Progress | None = None, accuracy: float | None = None,
) -> Solution:  # fmt: skip
    """Return the motion that torques of the drives give a mechanism, rigid, flexible or mixed, open or closed.

    M a + f_elastic + f_velocity - m g = S tau(t), from ``time[0]`` to ``time[-1]``: `solve` with nothing prescribed, so that
    ``simulate`` with the torque of `solve` gives its motion back, up to the time error of both (second order).

    time : (n,) [s], increasing; torque : (n, actuated) [N m], [N], columns as in ``Solution.torque_names``, linear between; a
        time given twice is a jump: the first row ends what is before it, the second begins what follows; None without drives
    step : time step and spacing of the samples [s], or accuracy : as in `solve` [-]
    spectral_radius, initial : as in `solve` ("static": in equilibrium with the driven joints held where they start)
    start, start_rate : initial coordinates and rates of joints [rad], [m], [1/s], zero unless given; in loops what is given is
        kept, up to a hundredth (rad, of the length, of the largest rate), and the other joints are moved onto the closures
    progress : called with the number of samples done since its last call
    Raises InputError for input that cannot be, a drive of a free joint or a start that closures contradict among it,
    ConvergenceError (time, increment, advice) if Newton fails.
    """
    check_kind("mechanism", mechanism, Mechanism)
    if not isinstance(initial, str) or initial not in ("consistent", "static"):
        expected = "'consistent' (starts undeformed) or 'static' (in equilibrium)"
        raise InputError(f"simulate: initial = {shown(initial)}, expected {expected}")
    check_callable("progress", progress, "a function of the number of samples done since its last call")
    table = _check_torque_table(mechanism, time, torque)
    at_rest = bool(mechanism.closures) and initial == "static" and not mechanism.is_rigid
    tasks = _FreeTasks(table, start, start_rate, at_rest, progress)
    if accuracy is None and step is not None:
        solution = _run_by_steps(mechanism, tasks, step, spectral_radius, initial)
    else:
        asked = check_accuracy(accuracy, step)
        settings = check_settings(1.0, spectral_radius, EXACT, initial)
        span = (float(table[0][0]), float(table[0][-1]))
        jumps = _find_jumps(table[0])
        solution = solve_within_accuracy(
            make_problem(mechanism, tasks.make_task, settings, asked, table[0], jumps, span)
        )
    if at_rest and tasks.began is not None:  # an equilibrium may leave what was stated of the start
        check_static(solution.mesh, *tasks.began, solution.q[0], solution.qd[0], float(solution.time[0]))
    return solution


@dataclass
class _FreeTasks:
    """Tasks of one table of torques, every joint free, on any mesh and with any steps.

    table : times [s] and torques; start, start_rate : as they are stated; at_rest : whether closed loops begin in equilibrium
    began : of the last task what was stated, and q (nq,), qd (nv,) with which its loops close
    """

    table: tuple[Array, Array]
    start: Mapping[str, ArrayLike] | None
    start_rate: Mapping[str, ArrayLike] | None
    at_rest: bool
    progress: Progress | None
    began: tuple[StatedStart, Array, Array] | None = None

    def make_task(self, meshed: Mechanism, steps: Array, settings: Settings) -> Task:
        """Return the task of a mechanism at the instants ``steps`` [s]."""
        mesh = build(apply_stated_ratio(meshed))
        moves = meshed.moving_names
        stated = resolve_start_coordinates(meshed, moves, self.start, self.start_rate)
        start_values = _collect_start_values(meshed, *stated, self.at_rest)
        first = float(steps[0])
        state = start_values.q, start_values.qd, start_values.qdd
        if meshed.closures:
            rows = build_constraint_rows(mesh).take_active(find_acting_closures(meshed, first))
            state = find_consistent_start(mesh, start_values, rows, first)
        self.began = (start_values, state[0], state[1])
        history = make_rest_history(*state)
        jumps = tuple(_find_jumps(self.table[0]))
        efforts = _make_effort_function(meshed, self.table, settings.step)
        return Task(mesh, steps, history, history, moves, settings, jumps, efforts=efforts, progress=self.progress)


def _run_by_steps(
    mechanism: Mechanism, tasks: _FreeTasks, step: float, spectral_radius: float, initial: str
) -> Solution:
    """The motion with a step that is given."""
    step = check_number("step", step, "a positive number of seconds, for example step=1e-3")
    time = tasks.table[0]
    span = time[-1] - time[0]
    settings = check_settings(step, spectral_radius, EXACT, initial)
    count = round(span / step)
    if count < 1:
        raise InputError(f"step = {step:g} s is longer than the torque's {span:g} s: write a smaller step")
    if count > MOST_SAMPLES:
        raise InputError(f"step = {step:g} s gives {count} samples, more than {MOST_SAMPLES}: write a larger step")
    task = tasks.make_task(mechanism, time[0] + settings.step * np.arange(count + 1), settings)
    (first,) = run_first_step(task)
    return assemble_solution(task.mesh, first, settings)


def _collect_start_values(
    mechanism: Mechanism, places: dict[str, Array], rates: dict[str, Array], at_rest: bool
) -> StatedStart:
    """The known values of the start; ``at_rest``: passive joints may be stated where beams are bent, loops are closed unbent."""
    m = mechanism
    q = mechanism.neutral
    qd = np.zeros(mechanism.nv)
    for name, value in places.items():
        q[m.q_slices[name]] = value
    for name, value in rates.items():
        qd[m.v_slices[name]] = value
    bars = {"place": ANOTHER_BRANCH, "rate": SAGGED} if at_rest else {}
    passive = build_joint_mask(m, {j.name for j in m.joints if not j.actuated})
    return StatedStart(q, qd, np.zeros(m.nv), build_joint_mask(m, places), build_joint_mask(m, rates), passive, **bars)


def _check_torque_table(mechanism: Mechanism, time: ArrayLike, torque: ArrayLike | None) -> tuple[Array, Array]:
    at = convert_to_floats("simulate: time", time)
    values = np.zeros((len(np.atleast_1d(at)), 0)) if torque is None else convert_to_floats("simulate: torque", torque)
    names = list(compress(mechanism.velocity_names, mechanism.actuated))
    if not _is_torque_time(at):
        twice = "between the first and the last a time may be given twice, where the torque jumps"
        raise InputError(f"simulate: time has shape {at.shape}, expected two or more times that increase [s]; {twice}")
    if values.shape != (len(at), len(names)) or not np.isfinite(values).all():
        each = f"a row for each time and a column for each drive of '{mechanism.name}': {', '.join(names) or 'none'}"
        expected = f"finite numbers ({len(at)}, {len(names)}), {each}"
        raise InputError(f"simulate: torque has shape {values.shape}, expected {expected}")
    for joint in mechanism.joints:
        if KINDS[joint.kind].layout == POSE and joint.actuated:
            why = "whose force would turn with what it moves; write actuated=False and a force with follower=True on its link"
            raise InputError(f"simulate: free joint '{joint.name}' of '{mechanism.name}' has a drive, {why}")
    return at, values


def _is_torque_time(time: Array) -> bool:
    """Return True for times that increase, where those between the first and the last may be given twice."""
    if time.ndim != 1 or len(time) < 2 or not np.isfinite(time).all() or not (np.diff(time) >= 0.0).all():
        return False
    return bool(time[0] != time[1] and time[-2] != time[-1] and (time[2:] > time[:-2]).all())


def _find_jumps(time: Array) -> Array:
    return np.asarray(time[1:][np.diff(time) == 0.0])  # that are given twice


def _make_effort_function(mechanism: Mechanism, table: tuple[Array, Array], step: float) -> Efforts:
    time, torque = table
    jumps = np.append(_find_jumps(table[0]), np.inf)

    def evaluate_efforts(at: Array, before: bool) -> Array:
        after = np.minimum(np.searchsorted(jumps, at - SAME_TIME * step), len(jumps) - 1)
        met = np.where(np.abs(jumps[after] - at) < SAME_TIME * step, jumps[after], at)
        out = np.zeros((len(at), mechanism.nv))
        # of two rows at one time np.interp takes the second, seen backwards the first
        line = (-met[::-1], -time[::-1], torque[::-1]) if before else (met, time, torque)
        found = [np.interp(line[0], line[1], column) for column in line[2].T]
        out[:, mechanism.actuated] = np.reshape(found, (-1, len(at))).T[:: -1 if before else 1]
        return out

    return evaluate_efforts
