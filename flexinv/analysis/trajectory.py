"""Kinematics, the paper's first step: a task gives the flexible trajectory, by the finite-element march with stiffness."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flexinv.analysis.switching import Switching
from flexinv.constraints.closures import constraint_rows
from flexinv.dynamics.dofs import Indices
from flexinv.dynamics.generalized_alpha import EARLY, SUBSTEPS, Scheme, early_rows, early_times, start_up
from flexinv.dynamics.initial_state import (
    begin_step,
    consistent_accelerations,
    end_early,
    equilibrium,
    instant,
    move_as_rigid,
    settle_held,
    start_undeformed,
)
from flexinv.dynamics.loads import load_table
from flexinv.dynamics.solver import Efforts, Solver, Trajectory, complaint, record_instant
from flexinv.dynamics.stepper import CONVERGED, SUDDEN_START
from flexinv.dynamics.system import Instants
from flexinv.errors import ConvergenceError
from flexinv.kinematics.joint_motion import JointHistory, relative_motion
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.tree import Joints
from flexinv.planar.detection import NotPlanar, find_plane
from flexinv.planar.solver import PlanarMarch
from flexinv.typing import Array

# Instants of nodes handed to the compiled loop at once: short enough for a live progress bar, some hundredths of a second, long
# enough to cost nothing, and few enough that what the joints do takes some megabytes.
AT_ONCE = 1 << 14
# Samples handed over at once in a plane, whose steps are short.
PLANAR_CHUNK = 4096

# Times closer than this part of a step are the same instant.
SAME_TIME = 1e-6

Progress = Callable[[int], None]
Turned = Callable[[int], float]


def flexible_motion(
    mesh: Mesh, before: JointHistory, after: JointHistory, time: Array, *given: Any, **options: Any
) -> Trajectory:
    """Return the flexible trajectory over a uniform grid ``time`` (samples,) [s] of prescribed joint motion, in one part.

    before, after, given, options : of `flexible_parts`
    """
    (trajectory,) = flexible_parts(mesh, before, after, time, *given, **options)
    return trajectory


def flexible_parts(
    mesh: Mesh,
    before: JointHistory,
    after: JointHistory,
    time: Array,
    scheme: Scheme,
    passive: set[str] | None = None,
    jumps: tuple[float, ...] = (),
    initial: str = "consistent",
    progress: Progress | None = None,
    switching: Switching | None = None,
    every: int = 1,
    efforts: Efforts | None = None,
    part: int | None = None,
) -> Iterator[Trajectory]:
    """Yield the flexible trajectory over a uniform grid ``time`` (samples,) [s] of prescribed joint motion, part by part.

    before, after : time -> q (samples, nq), qd, qdd (samples, nv) [rad or m, s], the left-hand and the right-hand limit
        where accelerations jump; passive joints start from the first sample
    initial : "consistent" (undeformed, accelerations solved for) or "static" (equilibrium under gravity first)
    jumps : times [s] at which accelerations jump; there the accelerations are solved anew (right-hand limit)
    switching : the phases, where closures act for a while; it gathers what happens between them
    every : of so many steps one is kept, from the first on [-]: what memory a long march takes (1 with ``switching``)
    efforts : of the drives of passive joints, which their torque moves (`dynamics.solver.Efforts`) [N m], [N]; none by default
    part : kept samples [-] by which parts advance: each begins with the last one of that before; one part of all by default

    Raises ConvergenceError with the time, the size of the increment and what to try.
    """
    flat = None if efforts is not None else in_plane(mesh, passive or set())
    alone = flat is not None and initial == "consistent" and (switching is None or switching.never)
    solver = None if alone else Solver.of(mesh, passive or set(), efforts)
    kept = len(time[::every])
    ends = set() if part is None else {every * row for row in range(part, kept - 1, part)}
    out = Trajectory.unwritten(min(kept, kept if part is None else part + 1), mesh, len(constraint_rows(mesh)))
    march = _March(mesh, solver, flat, scheme, time, out, every)
    if switching is not None:
        switching.begin(mesh, None if solver is None else solver.border.ties)
    if not alone:
        march.begin(after, initial)
    switches = {} if switching is None else switching.samples
    stops = _jump_samples(time, jumps)
    start, chunk = 0 if alone else 1, max(1, AT_ONCE // mesh.size) if flat is None else PLANAR_CHUNK
    for stop in sorted({*stops, *switches, *ends, len(time) - 1}):
        while start <= stop:
            first, start = start, march.onwards(before, after, start, min(start + chunk, stop + 1))
            if progress is not None:
                progress(start - max(first, 1))
        if switching is not None and stop in switches:
            march.switch(after, switching, stop)
        elif stop in stops:
            march.restart(after, stop)
        if stop in ends:
            yield march.out
            march = march.onward(stop // every, kept)
    if alone and flat is not None:
        flat.leave(passive or set())
    yield march.out


def in_plane(mesh: Mesh, passive: set[str]) -> PlanarMarch | None:
    """Return the planar march of a mesh that lies in a plane [m], with the named joints free, else None."""
    return None if isinstance(find_plane(mesh), NotPlanar) else PlanarMarch.ready(mesh, passive)


def _jump_samples(time: Array, jumps: tuple[float, ...]) -> list[int]:
    """Samples after the first at which the acceleration jumps."""
    step = time[1] - time[0] if len(time) > 1 else 1.0
    found = {round((jump - time[0]) / step) for jump in jumps}
    return sorted(k for k in found if 0 < k < len(time) and _is_jump(time[k], jumps, step))


def _is_jump(t: float, jumps: tuple[float, ...], step: float) -> bool:
    return any(abs(t - jump) < SAME_TIME * step for jump in jumps)


@dataclass
class _March:
    """A march over ``time`` [s] that fills ``out``: in the plane if there is one (``flat``), else in space.

    The spatial solver is there where something is found in space: all, a rest position at the start, what a switch does.
    origin : kept samples before those of ``out`` [-]; early : steps that are still to be made in parts after a sudden start [-]
    """

    mesh: Mesh
    solver: Solver | None
    flat: PlanarMarch | None
    scheme: Scheme
    time: Array
    out: Trajectory
    every: int
    origin: int = 0
    early: int = 0

    def onward(self, origin: int, kept: int) -> _March:
        """The same march with the next part of so many ``kept`` samples in all: it begins with the last one of this."""
        rows = len(self.out.iterations)
        out = Trajectory.unwritten(min(rows, kept - origin), self.mesh, self.out.multipliers.shape[1])
        out.put(np.zeros(1, dtype=np.int64), self.out.rows(rows - 1, rows), np.ones(1, dtype=bool))
        return replace(self, out=out, origin=origin)

    def row(self, sample: int) -> int:
        """Return the row in which a sample is stored, -1 if it is not stored [-]."""
        return -1 if sample % self.every else sample // self.every - self.origin

    def begin(self, history: JointHistory, initial: str) -> None:
        """Start undeformed or in equilibrium, with the accelerations that belong to it, and record that."""
        solver, flat, time = self.solver, self.flat, self.time[:1]
        assert solver is not None
        when = f"at the start, t = {time[0]:g} s"
        q, qd, qdd = (part[0] for part in history(time))
        joints = start_undeformed(solver, q, qd, qdd)
        solver.load_at(float(time[0]), q, qd, qdd)
        if initial == "static":
            settled = solver.efforts is None or settle_held(solver, q, float(time[0]), when)
            if solver.efforts is None:
                equilibrium(solver, q, when)
            if settled:
                move_as_rigid(solver, joints, qd, qdd)
        consistent_accelerations(solver, joints, when)
        record_instant(solver, 0, self.out)
        self.set_early(begin_step(solver, joints, self.scheme, when))
        if flat is not None:
            flat.take(solver.state, solver.border.ties)

    def set_early(self, sudden: bool) -> None:
        """Make the first steps in parts after a start that is ``sudden`` [-]."""
        self.early = EARLY if sudden else 0

    def onwards(self, before: JointHistory, after: JointHistory, first: int, last: int) -> int:
        """March from the sample ``first`` to before ``last``, or less far [-]; return the first sample that is not done.

        With 0 as the ``first`` the march in a plane begins there, undeformed, with what the joints do ``after`` it.
        """
        if self.early == 0:
            return self.steps(before, after, first, last)
        last = min(last, first + self.early)
        time, row = early_times(self.time[first - 1 : last]), early_rows(self.rows(first, last))
        result = self._march(start_up(self.scheme), before, None, time, row)
        self.check(result, time, begins=False, parts=SUBSTEPS)
        self.early -= last - first
        if self.early == 0 and self.flat is not None:
            self.flat.end_early()
        elif self.early == 0 and self.solver is not None:
            end_early(self.solver.state)
        return last

    def steps(self, before: JointHistory, after: JointHistory, first: int, last: int) -> int:
        """Do what `onwards` does [-], not in parts."""
        time = self.time[first:last]
        result = self._march(self.scheme, before, after if first == 0 else None, time, self.rows(first, last))
        self.check(result, time, begins=first == 0)
        self.set_early(result[0] == SUDDEN_START)
        return first + result[1]

    def check(self, result: tuple[int, int, int, float], time: Array, begins: bool, parts: int = 1) -> None:
        """Raise the error [-] of `failure` if there is one."""
        one = self.solver if self.flat is None else self.flat
        turned = None if one is None else one.turned
        if error := failure(self.mesh, result, time, self.scheme.h, begins, turned, parts):
            raise error

    def rows(self, first: int, last: int) -> Indices:
        """Return the rows that keep the samples from ``first`` to before ``last``, -1 for samples that are not kept [-]."""
        samples = np.arange(first, last)
        return np.where(samples % self.every == 0, samples // self.every - self.origin, -1)

    def _march(
        self, scheme: Scheme, before: JointHistory, after: JointHistory | None, time: Array, row: Indices
    ) -> tuple[int, int, int, float]:
        """March to the instants ``time``, in a plane from the first of them where ``after`` is given; write the kept rows."""
        if self.flat is not None:
            start = None if after is None else after(time[:1])
            steps = before(time if start is None else time[1:])
            return self.flat.march(scheme, start, steps, row, self.out.histories())
        assert self.solver is not None
        q, qd, qdd = before(time)
        solver, dense = self.solver, bool((np.diff(row) == 1).all() and row[0] >= 0)
        whole = self.out.rows(int(row[0]), int(row[-1]) + 1) if dense else self.out.of_length(len(row))
        rel = Joints(*(np.ascontiguousarray(part) for part in relative_motion(self.mesh, q, qd, qdd)))
        instants = Instants(rel, load_table(self.mesh, time), solver.drives(time), solver.given(q, qd, qdd))
        result = solver.march(scheme, instants, whole)
        if not dense:
            self.out.put(row[row >= 0], whole, row >= 0)
        return result

    def restart(self, history: JointHistory, sample: int) -> None:
        """Solve the accelerations anew where those of the task jump, and record their right-hand limit."""
        time, row = self.time[sample : sample + 1], self.row(sample)
        motion, when = history(time), f"at t = {time[0]:g} s"
        if self.flat is not None:
            result = self.flat.restart(self.scheme, *motion, np.array([row]), self.out.histories())
            self.check(result, time, begins=True)
            self.set_early(result[0] == SUDDEN_START)
            return
        assert self.solver is not None
        q, qd, qdd = (part[0] for part in motion)
        s = self.solver.state
        s.u[:], s.du[:] = s.u0, s.du0
        self.solver.load_at(float(time[0]), q, qd, qdd)
        joints = instant(self.mesh, q, qd, qdd)
        consistent_accelerations(self.solver, joints, when)
        if row >= 0:
            record_instant(self.solver, row, self.out)
        self.set_early(begin_step(self.solver, joints, self.scheme, when))

    def switch(self, history: JointHistory, switching: Switching, sample: int) -> None:
        """Go over to the phase that begins at a sample."""
        solver, flat, time = self.solver, self.flat, float(self.time[sample])
        assert solver is not None
        if flat is not None:
            flat.give(solver.state, solver.border.ties)
        q, qd, qdd = (part[0] for part in history(self.time[sample : sample + 1]))
        solver.load_at(time, q, qd, qdd)
        joints = instant(self.mesh, q, qd, qdd)
        switching.switch(solver, switching.samples[sample], joints, qd, time, self.out)
        self.set_early(begin_step(solver, joints, self.scheme, f"at t = {time:g} s"))
        if flat is not None:
            flat.take(solver.state, solver.border.ties)


def failure(
    mesh: Mesh,
    result: tuple[int, int, int, float],
    time: Array,
    step: float,
    begins: bool = True,
    turned: Turned | None = None,
    parts: int = 1,
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
