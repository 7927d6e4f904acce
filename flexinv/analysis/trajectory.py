"""Kinematics, the paper's first step: a task gives the flexible trajectory, by the finite-element march with stiffness."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from flexinv.analysis.evaluation import FirstStep, rigid_motion_of
from flexinv.analysis.loops import Switching, closed_task, rigid_loops, with_closures
from flexinv.analysis.task import Task, looked_up
from flexinv.constraints.closures import constraint_rows
from flexinv.constraints.phases import phases
from flexinv.dynamics.dofs import Indices
from flexinv.dynamics.generalized_alpha import ACCELERATIONS, EARLY, SUBSTEPS, Scheme, early_rows, early_times, start_up
from flexinv.dynamics.initial_state import begin_step, end_early, instant, stand
from flexinv.dynamics.loads import load_table
from flexinv.dynamics.solver import Solver, complaint, record_instant
from flexinv.dynamics.stepper import CONVERGED, SUDDEN_START, march
from flexinv.dynamics.system import Instants, Trajectory
from flexinv.errors import ConvergenceError
from flexinv.inverse.inverse_dynamics import applied_forces
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import fill_passive, relative_motion
from flexinv.kinematics.tree import Joints
from flexinv.planar.detection import NotPlanar, find_plane
from flexinv.planar.solver import PlanarMarch
from flexinv.planar.stepper import planar_march
from flexinv.typing import Array

# Instants of nodes handed to the compiled loop at once: short enough for a live progress bar, some hundredths of a second, long
# enough to cost nothing, and few enough that what the joints do takes some megabytes.
AT_ONCE = 1 << 14
# Samples handed over at once in a plane, whose steps are short.
PLANAR_CHUNK = 4096

# Times closer than this part of a step are the same instant.
SAME_TIME = 1e-6

Turned = Callable[[int], float] | None
Status = tuple[int, int, int, float]


def first_step(task: Task) -> Iterator[FirstStep]:
    """Yield the first step [m, rad, s, N] of a task, part by part: here the rigid, the closed and the flexible way part.

    Raises InputError for closures that contradict the task, ConvergenceError with the time, the increment and what to try.
    """
    m, marched = task.mesh.mechanism, bool(task.passive) or task.efforts is not None
    task = looked_up(task) if task.efforts is None and task.part is None else task
    if m.is_rigid and m.closures and task.efforts is None:
        return iter((rigid_loops(task),))
    if m.is_rigid and not m.closures and not marched:
        return rigid_motions(task)
    return flexible_motion(closed_task(task) if m.closures and task.efforts is None else task)


def rigid_motions(task: Task) -> Iterator[FirstStep]:
    """Yield the motion of a rigid mechanism whose joints are all moved [m, rad, s, N], part by part."""
    part = task.part or len(task.time)
    for first in range(0, max(len(task.time) - 1, 1), part):
        own = task.time if task.part is None else task.time[first : first + part + 1]
        q, qd, qdd = task.after(own)
        yield replace(rigid_motion_of(task.mesh, own, (q.copy(), qd.copy(), qdd.copy())), ends=task.part is None)


def flexible_motion(task: Task) -> Iterator[FirstStep]:
    """Yield the flexible trajectory of a task [m, rad, s, N], part by part, by time integration: M, C and K act.

    Each part begins with the last sample of that before.  The compiled loop over time steps is called for many of them at once,
    up to instants at which accelerations jump, closures begin or cease to act, or a part ends.

    Raises ConvergenceError with the time, the size of the increment and what to try.
    """
    march, stops = _March.of(task), task.seams or _jump_samples(task.steps, task.jumps)
    kept, last, every = len(task.time), len(task.steps) - 1, task.settings.every
    ends = set() if task.part is None else {every * row for row in range(task.part, kept - 1, task.part)}
    switches = march.switching.samples
    start, chunk = march.begin(), PLANAR_CHUNK if march.flat is not None else max(1, AT_ONCE // task.mesh.size)
    for stop in sorted({*stops, *switches, *ends, last}):
        while start <= stop:
            leg = march.leg(start, min(start + chunk, stop + 1))
            result = leg.kernel(*leg.arguments)
            first, start = start, march.arrive(leg, result)
            if task.progress is not None:
                task.progress(start - max(first, 1))
        if stop in switches:
            march.switch(stop)
        elif stop in stops:
            march.restart(stop)
        if stop in ends:
            yield march.moved(ends=False)
            march.go_on(stop // every)
    if march.solver is None and march.flat is not None:  # its arrays are for the next that is in the plane alone
        march.flat.leave(task.passive)
    yield march.moved(ends=task.part is None)


def in_plane(mesh: Mesh, passive: set[str]) -> PlanarMarch | None:
    """Return the planar march of a mesh that lies in a plane [m], with the named joints free, else None."""
    return None if isinstance(find_plane(mesh), NotPlanar) else PlanarMarch.ready(mesh, passive)


def _jump_samples(time: Array, jumps: tuple[float, ...]) -> list[int]:
    """Samples after the first at which the acceleration jumps."""
    step = time[1] - time[0] if len(time) > 1 else 1.0
    found = {round((jump - time[0]) / step) for jump in jumps}
    met = (k for k in found if 0 < k < len(time) and np.abs(time[k] - np.array(jumps)).min() < SAME_TIME * step)
    return sorted(met)


class _Leg(NamedTuple):
    """One call of a compiled march: kernel and arguments, instants ``time`` [s], first sample that is not done when it ends.

    begins : whether it begins at the first instant; parts : of a step, where they are the instants; row, whole : rows of the
    histories that are kept, and a trajectory of all instants of which they are taken, None where they are written themselves
    """

    kernel: Callable[..., Status]
    arguments: tuple[Any, ...]
    time: Array
    last: int
    begins: bool = False
    parts: int = 1
    row: Indices | None = None
    whole: Trajectory | None = None


@dataclass
class _March:
    """A march that fills ``out``: in the plane if there is one (``flat``), else in space.

    The spatial solver is there where something is found in space: all, a rest position at the start, what a switch does.
    origin : kept samples before those of ``out`` [-]; early : steps that are still to be made in parts after a sudden start [-]
    last : coordinates (nq,) with which the part before has ended, from which turns of passive joints are counted
    """

    task: Task
    scheme: Scheme
    solver: Solver | None
    flat: PlanarMarch | None
    switching: Switching
    out: Trajectory
    origin: int = 0
    early: int = 0
    last: Array | None = None

    @classmethod
    def of(cls, task: Task) -> _March:
        """Return the march of a task, in the plane where the mechanism lies in one and begins undeformed."""
        mesh, m, settings = task.mesh, task.mesh.mechanism, task.settings
        switching = Switching(phases(m, task.steps))
        flat = None if task.efforts is not None else in_plane(mesh, task.passive)
        alone = flat is not None and settings.initial == "consistent" and switching.never
        solver = None if alone else Solver.of(mesh, task.passive, task.efforts)
        rows = len(task.time) if task.part is None else min(len(task.time), task.part + 1)
        out = Trajectory.unwritten(rows, mesh, len(constraint_rows(mesh)))
        switching.begin(mesh, None if solver is None else solver.border.ties)
        return cls(task, settings.scheme, solver, flat, switching, out)

    def go_on(self, origin: int) -> None:
        """Begin the next part with the last sample of this one, the kept sample ``origin`` [-]."""
        rows = len(self.out.iterations)
        left = len(self.task.time) - origin
        out = Trajectory.unwritten(min(rows, left), self.task.mesh, self.out.multipliers.shape[1])
        out.put(np.zeros(1, dtype=np.int64), self.out.rows(rows - 1, rows), np.ones(1, dtype=bool))
        self.out, self.origin = out, origin

    def moved(self, ends: bool) -> FirstStep:
        """Return the part that was marched last [m, rad, s, N], with the coordinates of passive joints and what acts on nodes."""
        task, mesh, trajectory = self.task, self.task.mesh, self.out
        time = task.time if task.part is None else task.time[self.origin : self.origin + len(trajectory.iterations)]
        q, qd, qdd = (part.copy() for part in task.after(time))
        for joint in mesh.mechanism.joints:
            if self.last is not None and joint.name in task.passive:
                own = mesh.mechanism.q_slices[joint.name]
                q[:, own] = self.last[own]
        fill_passive(mesh, trajectory.motion, task.passive, q, qd, qdd)
        self.last, applied = q[-1], applied_forces(mesh, trajectory.motion, time)
        first = FirstStep(trajectory, time, (q, qd, qdd), applied, smooth=task.passive, ends=ends)
        return with_closures(mesh, first, self.switching) if mesh.mechanism.closures else first

    def begin(self) -> int:
        """Start undeformed or in equilibrium, with the accelerations that belong to it, and record that; return samples done.

        In the plane alone that is left to the first call of the compiled loop.
        """
        solver, flat, time = self.solver, self.flat, self.task.steps[:1]
        self.pace(0)
        if solver is None:
            return 0
        when = f"at the start, t = {time[0]:g} s"
        motion, initial = [part[0] for part in self.task.after(time)], self.task.settings.initial
        joints = stand(solver, motion, float(time[0]), initial, when)
        record_instant(solver, 0, self.out)
        self.early = EARLY * begin_step(solver, joints, self.scheme, when)
        if flat is not None:
            flat.take(solver.state, solver.border.ties)
        return 1

    def leg(self, first: int, last: int) -> _Leg:
        """Return the call that marches from the sample ``first`` to before ``last``, or less far [-].

        With 0 as the ``first`` the march in a plane begins there, undeformed, with what the joints do after it.
        """
        if self.early == 0:
            return self._leg(self.scheme, self.task.steps[first:last], self.rows(first, last), last, first == 0)
        last = min(last, first + self.early)
        time, row = early_times(self.task.steps[first - 1 : last]), early_rows(self.rows(first, last))
        return self._leg(start_up(self.scheme), time, row, last)._replace(parts=SUBSTEPS)

    def arrive(self, leg: _Leg, result: Status) -> int:
        """Take what a call returns; return the first sample that is not done [-].  Raises the error of `failure`."""
        result = int(result[0]), int(result[1]), int(result[2]), float(result[3])
        if leg.whole is not None and leg.row is not None:
            self.out.put(leg.row[leg.row >= 0], leg.whole, leg.row >= 0)
        self.check(result, leg.time, leg.begins, leg.parts)
        if leg.parts == 1:
            self.early = EARLY * (result[0] == SUDDEN_START)
            return leg.last - len(leg.time) + result[1]
        self.early -= len(leg.time) // leg.parts
        if self.early == 0 and (march := self.flat or self.solver) is not None:
            end_early(march.state)
        return leg.last

    def check(self, result: Status, time: Array, begins: bool, parts: int = 1) -> None:
        """Raise the error [-] of `failure` if there is one."""
        one = self.solver if self.flat is None else self.flat
        turned = None if one is None else one.turned
        if error := failure(self.task.mesh, result, time, self.scheme.h, begins, turned, parts):
            raise error

    def rows(self, first: int, last: int) -> Indices:
        """Return the rows that keep the samples from ``first`` to before ``last``, -1 for samples that are not kept [-]."""
        samples, every = np.arange(first, last), self.task.settings.every
        return np.where(samples % every == 0, samples // every - self.origin, -1)

    def _leg(self, scheme: Scheme, time: Array, row: Indices, last: int, begins: bool = False) -> _Leg:
        """The call that marches to the instants ``time``, in a plane from the first of them where it ``begins`` there."""
        if self.flat is not None:
            start = self.task.after(time[:1]) if begins else None
            steps = self.task.before(time[1:] if begins else time)
            arguments = self.flat.arguments(scheme, start, steps, row, self.out)
            return _Leg(planar_march, arguments, time, last, begins)
        assert self.solver is not None
        q, qd, qdd = self.task.before(time)
        solver, dense = self.solver, bool((np.diff(row) == 1).all() and row[0] >= 0)
        carried = self.out.multipliers.shape[1]
        whole = (
            self.out.rows(int(row[0]), int(row[-1]) + 1)
            if dense
            else Trajectory.empty(len(row), self.task.mesh, carried)
        )
        rel = Joints(*(np.ascontiguousarray(part) for part in relative_motion(self.task.mesh, q, qd, qdd)))
        table, drives = load_table(self.task.mesh, time), solver.drives(time)
        arguments = solver.arguments(scheme, Instants(rel, table, drives, solver.given(q, qd, qdd)), whole)
        return _Leg(march, arguments, time, last, row=row, whole=None if dense else whole)

    def pace(self, sample: int) -> None:
        """Take the step [s] that the task makes after a sample; nothing to do where all steps are equal."""
        steps = self.task.steps
        if self.task.seams and sample + 1 < len(steps):
            ends = [*(seam for seam in self.task.seams if seam > sample), len(steps) - 1]
            step = float(steps[ends[0]] - steps[sample]) / (ends[0] - sample)
            self.scheme = replace(self.task.settings, step=step).scheme

    def restart(self, sample: int) -> None:
        """Solve the accelerations anew where those of the task jump, and record their right-hand limit."""
        self.pace(sample)
        time, row = self.task.steps[sample : sample + 1], self.rows(sample, sample + 1)
        motion, when = self.task.after(time), f"at t = {time[0]:g} s"
        if self.flat is not None:
            result = self.flat.restart(self.scheme, *motion, row, self.out)
            self.check(result, time, begins=True)
            self.early = EARLY * (result[0] == SUDDEN_START)
            return
        assert self.solver is not None
        q, qd, qdd = (part[0] for part in motion)
        s = self.solver.state
        s.u[:], s.du[:] = s.u0, s.du0
        self.solver.load_at(float(time[0]), q, qd, qdd)
        joints = instant(self.task.mesh, q, qd, qdd)
        self.solver.solve_instant(ACCELERATIONS, joints, when)
        if row[0] >= 0:
            record_instant(self.solver, int(row[0]), self.out)
        self.early = EARLY * begin_step(self.solver, joints, self.scheme, when)

    def switch(self, sample: int) -> None:
        """Go over to the phase that begins at a sample."""
        solver, flat, time = self.solver, self.flat, float(self.task.steps[sample])
        self.pace(sample)
        assert solver is not None
        if flat is not None:
            flat.give(solver.state, solver.border.ties)
        q, qd, qdd = (part[0] for part in self.task.after(self.task.steps[sample : sample + 1]))
        solver.load_at(time, q, qd, qdd)
        joints = instant(self.task.mesh, q, qd, qdd)
        self.switching.switch(solver, self.switching.samples[sample], joints, qd, time, self.out)
        self.early = EARLY * begin_step(solver, joints, self.scheme, f"at t = {time:g} s")
        if flat is not None:
            flat.take(solver.state, solver.border.ties)


def failure(
    mesh: Mesh, result: Status, time: Array, step: float, begins: bool = True, turned: Turned = None, parts: int = 1
) -> ConvergenceError | None:
    """Return the error that a march over ``time`` (instants,) [s] has ended with, None if it has come to the end.

    result : status, instant, iterations or element, last relative increment [-]; begins : whether it begins at the first
    turned : element -> by how much it had turned [rad], as `solver.Solver.turned`; parts : of a step, where they are the instants
    """
    status, instant, count, size = result
    if status in (CONVERGED, SUDDEN_START):
        return None
    when = f"at the start, t = {time[0]:g} s"
    if not begins or instant > 0:
        divided = f", after a sudden start in {parts} parts" if parts > 1 else ""
        when = f"at t = {time[instant]:g} s (step {step:g} s{divided})"
    return complaint(mesh, status, count, size, when, step, turned(count) if turned is not None else 0.0)
