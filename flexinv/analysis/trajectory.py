"""Kinematics, the paper's first step: a task gives the flexible trajectory, by the finite-element march with stiffness."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from flexinv.analysis.evaluation import FirstStep, build_rigid_first_step
from flexinv.analysis.initial_motion import begin_motion
from flexinv.analysis.loops import PhaseHistory, add_reaction_forces, make_closed_task, solve_rigid_loops
from flexinv.analysis.task import Task, prepare_motion_samples
from flexinv.constraints.closures import Phase, build_constraint_rows, list_phases
from flexinv.constraints.singular_marches import check_march
from flexinv.dynamics.generalized_alpha import (
    ACCELERATIONS,
    EARLY,
    SUBSTEPS,
    build_start_scheme,
    list_early_rows,
    list_early_times,
)
from flexinv.dynamics.initial_state import begin_step, compute_joint_motion, end_early
from flexinv.dynamics.loads import build_load_table
from flexinv.dynamics.solver import Solver, make_solve_error, write_instant
from flexinv.dynamics.stepper import CONVERGED, SUDDEN_START, integrate_instants
from flexinv.dynamics.system import Instants, Trajectory
from flexinv.errors import ConvergenceError
from flexinv.inverse.inverse_dynamics import compute_applied_forces
from flexinv.inverse.spring_lengths import InterpolatedMotion, check_spring_lengths
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import compute_relative_motion, compute_rigid_motion, fill_passive
from flexinv.planar.detection import NotPlanar, find_plane
from flexinv.planar.solver import PlanarMarch
from flexinv.planar.stepper import integrate_planar_motion
from flexinv.typing import Array, Indices, Triple

# Instants of nodes handed to the compiled loop at once: short enough for a live progress bar, some hundredths of a second, long
# enough to cost nothing, and few enough that what the joints do takes some megabytes; in a plane, whose steps are short, samples.
SPATIAL_CHUNK = 1 << 14
PLANAR_CHUNK = 4096
# Times closer than this part of a step are the same instant.
SAME_TIME = 1e-6

Turned = Callable[[int], float] | None
Marched = tuple[Mesh, Collection[str]]  # and the names of the joints that were free
Status = tuple[int, int, int, float]


def run_first_step(task: Task) -> Iterator[FirstStep]:
    """Yield the first step [m, rad, s, N] of a task, part by part: here the rigid, the closed and the flexible way part.

    Raises InputError for closures that contradict the task, ConvergenceError with the time, the increment and what to try.
    """
    m = task.mesh.mechanism
    marched = bool(task.passive) or task.efforts is not None
    task = prepare_motion_samples(task) if task.efforts is None and task.part is None else task
    if m.is_rigid and m.closures and task.efforts is None:
        return iter((solve_rigid_loops(task),))
    if m.is_rigid and not m.closures and not marched:
        return solve_rigid_motions(task)
    return integrate_flexible_motion(make_closed_task(task) if m.closures and task.efforts is None else task)


def solve_rigid_motions(task: Task) -> Iterator[FirstStep]:
    """Yield the motion of a rigid mechanism whose joints are all moved [m, rad, s, N], part by part."""
    part = task.part or len(task.time)
    for first in range(0, max(len(task.time) - 1, 1), part):
        time = task.time if task.part is None else task.time[first : first + part + 1]
        q, qd, qdd = task.after(time)
        interpolated_motion = InterpolatedMotion(
            lambda times: compute_rigid_motion(task.mesh, *task.after(times)), task.knots
        )
        yield replace(
            build_rigid_first_step(task.mesh, time, (q.copy(), qd.copy(), qdd.copy()), interpolated_motion),
            ends=task.part is None,
        )


def integrate_flexible_motion(task: Task) -> Iterator[FirstStep]:
    """Yield the flexible trajectory of a task [m, rad, s, N], part by part, by time integration: M, C and K act.

    Each part begins with the last sample of that before.  The compiled loop over time steps is called for many of them at once,
    up to instants at which accelerations jump, closures begin or cease to act, or a part ends.
    Raises ConvergenceError with the time, the size of the increment and what to try.
    """
    march = _March(task)
    every = task.settings.every
    last = len(task.steps) - 1
    stops = _find_jumps(task)
    ends = set() if task.part is None else {every * row for row in range(task.part, len(task.time) - 1, task.part)}
    switches = {phase.first: phase for phase in march.phases[1:]}
    start = march.begin()
    chunk = PLANAR_CHUNK if march.flat is not None else max(1, SPATIAL_CHUNK // task.mesh.size)
    for stop in sorted({*stops, *switches, *ends, last}):
        while start <= stop:
            kernel, arguments, arrive = march.prepare_leg(start, min(start + chunk, stop + 1))
            first = start
            start = arrive(kernel(*arguments))
            if task.progress is not None:
                task.progress(start - max(first, 1))
        if stop in switches or stop in stops:
            march.update_accelerations(stop, switches.get(stop))
        if stop in ends:
            yield march.collect_first_step(ends=False)
            march.begin_next_part(stop // every)
    if march.solver is None and march.flat is not None:  # its arrays are for the next that is in the plane alone
        march.flat.make_reusable(task.passive)
    yield march.collect_first_step(ends=task.part is None)


def _find_jumps(task: Task) -> set[int]:
    """Samples at which steps change, or where all are equal those at which accelerations jump."""
    if task.seams:
        return {*task.seams}
    steps = task.steps
    step = steps[1] - steps[0] if len(steps) > 1 else 1.0
    found = {round((jump - steps[0]) / step) for jump in task.jumps}
    return {k for k in found if 0 < k < len(steps) and np.abs(steps[k] - np.array(task.jumps)).min() < SAME_TIME * step}


def build_planar_march(mesh: Mesh, passive: Collection[str]) -> PlanarMarch | None:
    """Return the planar march of a mesh that lies in a plane [m], with the named joints free, else None."""
    return None if isinstance(find_plane(mesh), NotPlanar) else PlanarMarch.take_reusable(mesh, passive)


class _March:
    """A march that fills ``out``: in the plane if there is one (``flat``), else in space.

    The spatial solver is there where something is found in space: all, a rest position at the start, what a switch does.
    origin : kept samples before those of ``out`` [-]; early : steps that are still to be made in parts after a sudden start [-]
    last : coordinates (nq,) with which the part before has ended, from which turns of passive joints are counted
    """

    def __init__(self, task: Task) -> None:
        """Prepare the march of a task, in the plane where the mechanism lies in one and begins undeformed."""
        self.task = task
        self.scheme = task.settings.scheme
        self.origin = 0
        self.early = 0
        mesh = task.mesh
        self.phases = list_phases(task.mesh.mechanism, task.steps)
        self.last: Array | None = None
        self.flat = None if task.efforts is not None else build_planar_march(mesh, task.passive)
        never_switches = len(self.phases) == 1 and self.phases[0].active.all()
        alone = self.flat is not None and task.settings.initial == "consistent" and never_switches
        self.solver = None if alone else Solver.build_for(mesh, task.passive, task.efforts)
        rows = len(task.time) if task.part is None else min(len(task.time), task.part + 1)
        self.out = Trajectory.make_uninitialized(rows, mesh, len(build_constraint_rows(mesh).closure))
        self.switching = PhaseHistory(mesh, self.phases[0], None if self.solver is None else self.solver.border.ties)

    def begin_next_part(self, origin: int) -> None:
        """Begin the next part with the last sample of this one, the kept sample ``origin`` [-]."""
        rows = len(self.out.iterations)
        left = len(self.task.time) - origin
        out = Trajectory.make_uninitialized(min(rows, left), self.task.mesh, self.out.multipliers.shape[1])
        out.write_samples(np.zeros(1, dtype=np.int64), self.out.take_samples(rows - 1, rows), np.ones(1, dtype=bool))
        self.out = out
        self.origin = origin

    def collect_first_step(self, ends: bool) -> FirstStep:
        """Return the part that was marched last [m, rad, s, N], with the coordinates of passive joints and what acts on nodes."""
        task = self.task
        mesh = self.task.mesh
        trajectory = self.out
        time = task.time if task.part is None else task.time[self.origin : self.origin + len(trajectory.iterations)]
        q, qd, qdd = (part.copy() for part in task.after(time))
        for joint in mesh.mechanism.joints:
            if self.last is not None and joint.name in task.passive:
                columns = mesh.mechanism.q_slices[joint.name]
                q[:, columns] = self.last[columns]
        check_spring_lengths(mesh, trajectory.motion, time)
        if mesh.mechanism.closures:
            self._check_closures(len(time))
        fill_passive(mesh, trajectory.motion, task.passive, q, qd, qdd)
        self.last = q[-1]
        applied = compute_applied_forces(mesh, trajectory.motion, time)
        first = FirstStep(trajectory, time, (q, qd, qdd), applied, smooth=task.passive, ends=ends)
        return add_reaction_forces(mesh, first, self.switching) if mesh.mechanism.closures else first

    def _check_closures(self, samples: int, failed_at: float | None = None) -> None:
        """Raise ConvergenceError where closures pass a singular position in the first so many samples: `check_march`.

        With closures a march is not made in parts, and keeps every step.
        """
        task = self.task
        motion = self.out.motion.take_samples(slice(samples))
        check_march(task.mesh, motion, task.time[:samples], self.switching.stretches, task.passive, failed_at)

    def begin(self) -> int:
        """Start undeformed or in equilibrium, with the accelerations that belong to it, and record that; return samples done."""
        solver = self.solver
        flat = self.flat
        time = self.task.steps[:1]
        self.update_step(0)
        if solver is None:  # in the plane alone that is left to the first call of the compiled loop
            return 0
        motion = [part[0] for part in self.task.after(time)]
        when = f"at the start, t = {time[0]:g} s"
        joints = begin_motion(solver, motion, float(time[0]), self.task.settings.initial, when)
        write_instant(solver, 0, self.out)
        self.early = EARLY * begin_step(solver, joints, self.scheme, when)
        if flat is not None:
            flat.copy_from_space(solver.state, solver.border.ties)
        return 1

    def prepare_leg(
        self, first: int, last: int
    ) -> tuple[Callable[..., Status], tuple[Any, ...], Callable[[Status], int]]:
        """Return the call that marches from the sample ``first`` to before ``last``, or less far [-]: kernel and arguments.

        With 0 as the ``first`` the march in a plane begins there, undeformed, with what the joints do after it.
        Last what takes the result of the call and returns the first sample that is not done, or raises the error of
        `make_march_error`.
        """
        scheme = self.scheme
        parts = 1
        begins = first == 0
        time = self.task.steps[first:last]
        row = self.list_history_rows(first, last)
        if self.early > 0:
            last = min(last, first + self.early)
            scheme = build_start_scheme(scheme)
            parts = SUBSTEPS
            time = list_early_times(self.task.steps[first - 1 : last])
            row = list_early_rows(self.list_history_rows(first, last))
        given = self.task.before(time[1:] if begins else time)
        whole: Trajectory | None = None  # a trajectory of all instants, of which those that are kept are taken
        kernel: Callable[..., Status] = integrate_instants if self.flat is None else integrate_planar_motion
        if self.flat is not None:
            start = self.task.after(time[:1]) if begins else None
            arguments = self.flat.prepare_arguments(scheme, start, given, row, self.out)
        else:
            if not _is_run(row):
                whole = Trajectory.make_zero(len(row), self.task.mesh, self.out.multipliers.shape[1])
            out = whole or self.out.take_samples(int(row[0]), int(row[-1]) + 1)
            solver = self._resolve_spatial_solver()
            arguments = solver.prepare_arguments(scheme, self._make_instants(time, given), out)

        def end_leg(result: Status) -> int:
            if whole is not None:
                self.out.write_samples(row[row >= 0], whole, row >= 0)
            self.check(result, time, first + result[1] // parts, begins, parts)
            if parts == 1:
                self.early = EARLY * (result[0] == SUDDEN_START)
                return first + result[1]
            self.early -= last - first
            if self.early == 0:
                end_early((self.flat or self._resolve_spatial_solver()).system.state)
            return last

        return kernel, arguments, end_leg

    def check(self, result: Status, time: Array, reached: int, begins: bool, parts: int = 1) -> None:
        """Raise the error of `make_march_error` at the sample ``reached`` [-] if there is one, or what closures say of it."""
        turned = (self._resolve_spatial_solver() if self.flat is None else self.flat).compute_section_turn
        if error := make_march_error(
            (self.task.mesh, self.task.passive), result, time, self.scheme.h, begins, turned, parts
        ):
            if reached > 0 and self.task.mesh.mechanism.closures:
                self._check_closures(reached, failed_at=float(time[result[1]]))
            raise error

    def list_history_rows(self, first: int, last: int) -> Indices:
        """Return the rows that keep the samples from ``first`` to before ``last``, -1 for samples that are not kept [-]."""
        samples = np.arange(first, last)
        every = self.task.settings.every
        return np.where(samples % every == 0, samples // every - self.origin, -1)

    def _resolve_spatial_solver(self) -> Solver:
        assert self.solver is not None
        return self.solver

    def _make_instants(self, time: Array, given: Triple) -> Instants:
        """The data of instants in space: motion of the joints, loads, efforts of drives, and terms of couplings."""
        mesh = self.task.mesh
        solver = self._resolve_spatial_solver()
        joints = compute_relative_motion(mesh, *given)
        loads = build_load_table(mesh, time)
        return Instants(joints, loads, solver.evaluate_drives(time), solver.compute_coupling_terms(*given))

    def update_step(self, sample: int) -> None:
        """Take the step [s] that the task makes after a sample; nothing to do where all steps are equal."""
        steps = self.task.steps
        if self.task.seams and sample + 1 < len(steps):
            ends = [*(seam for seam in self.task.seams if seam > sample), len(steps) - 1]
            step = float(steps[ends[0]] - steps[sample]) / (ends[0] - sample)
            self.scheme = replace(self.task.settings, step=step).scheme

    def update_accelerations(self, sample: int, phase: Phase | None) -> None:
        """Solve the accelerations anew where those of the task jump, or go over to a phase; record the right-hand limit."""
        self.update_step(sample)
        flat = self.flat
        row = self.list_history_rows(sample, sample + 1)
        time = self.task.steps[sample : sample + 1]
        motion = self.task.after(time)
        now = float(time[0])
        when = f"at t = {time[0]:g} s"
        if flat is not None and phase is None:
            result = flat.update_accelerations(self.scheme, *motion, row, self.out)
            self.check(result, time, sample, begins=True)
            self.early = EARLY * (result[0] == SUDDEN_START)
            return
        solver = self._resolve_spatial_solver()
        q, qd, qdd = (part[0] for part in motion)
        s = solver.state
        joints = compute_joint_motion(self.task.mesh, q, qd, qdd)
        if flat is not None:
            flat.copy_to_space(s, solver.border.ties)
        solver.update_loads(now, q, qd, qdd)
        if phase is not None:
            self.switching.begin_phase(solver, phase, joints, qd, now, self.out)
        else:
            s.u[:], s.du[:] = s.u0, s.du0
            solver.solve_instant(ACCELERATIONS, joints, when)
            if row[0] >= 0:
                write_instant(solver, int(row[0]), self.out)
        self.early = EARLY * begin_step(solver, joints, self.scheme, when)
        if flat is not None:
            flat.copy_from_space(s, solver.border.ties)


def _is_run(rows: Indices) -> bool:
    """Return True for rows one after the other, all of which are kept."""
    return bool((np.diff(rows) == 1).all() and rows[0] >= 0)


def make_march_error(
    marched: Marched,
    result: Status,
    time: Array,
    step: float,
    begins: bool = True,
    turned: Turned = None,
    parts: int = 1,
) -> ConvergenceError | None:
    """Return the error that a march over ``time`` (instants,) [s] has ended with, None if it has come to the end.

    marched : the mesh and its free joints
    result : status, instant, iterations or element, last relative increment [-]; begins : whether it begins at the first
    turned : element -> by how much it had turned [rad], as `solver.Solver.compute_section_turn`;
    parts : of a step, where they are the instants
    """
    status, instant, count, size = result
    if status in (CONVERGED, SUDDEN_START):
        return None
    when = f"at the start, t = {time[0]:g} s"
    if not begins or instant > 0:
        divided = f", after a sudden start in {parts} parts" if parts > 1 else ""
        when = f"at t = {time[instant]:g} s (step {step:g} s{divided})"
    bent = turned(count) if turned is not None else 0.0
    return make_solve_error(*marched, (status, count, size), when, step, bent)
