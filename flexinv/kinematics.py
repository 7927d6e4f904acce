"""Kinematics, the paper's first step: a task gives the flexible trajectory, by the finite-element march with stiffness."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flexinv.integrate import Scheme
from flexinv.joint import JointHistory, relative_motion
from flexinv.loads import load_table
from flexinv.march import CONVERGED
from flexinv.mechanism import Array
from flexinv.mesh import Mesh
from flexinv.planar import PlanarMarch
from flexinv.planar_march import Histories
from flexinv.plane import NotPlanar, find_plane
from flexinv.solver import Efforts, Solver, Trajectory, record_instant
from flexinv.starting import (
    consistent_accelerations,
    equilibrium,
    instant,
    move_as_rigid,
    settle_held,
    start_undeformed,
)
from flexinv.switching import Switching
from flexinv.tree import Joints

# Samples handed to the compiled loop at once: short enough for a live progress bar, long enough to cost nothing.
CHUNK = 256
# The same of a march in a plane, whose steps are short.
PLANAR_CHUNK = 4096

# Times closer than this part of a step are the same instant.
SAME_TIME = 1e-6

Progress = Callable[[int], None]


def flexible_motion(
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
) -> Trajectory:
    """Return the flexible trajectory over a uniform grid ``time`` (samples,) [s] of prescribed joint motion.

    before, after : time -> q (samples, nq), qd, qdd (samples, nv) [rad or m, s], the left-hand and the right-hand limit
        where accelerations jump; passive joints start from the first sample
    initial : "consistent" (undeformed, accelerations solved for) or "static" (equilibrium under gravity first)
    jumps : times [s] at which accelerations jump; there the accelerations are solved anew (right-hand limit)
    switching : the phases, where closures act for a while; it gathers what happens between them
    every : of so many steps one is kept, from the first on [-]: what memory a long march takes (1 with ``switching``)
    efforts : of the drives of passive joints, which their torque moves (`solver.Efforts`) [N m], [N]; none by default

    Raises ConvergenceError with the time, the size of the increment and what to try.
    """
    solver = Solver.of(mesh, passive or set())
    plane = find_plane(mesh)
    flat = None if isinstance(plane, NotPlanar) or efforts is not None else PlanarMarch.of(mesh, passive or set())
    solver.efforts = efforts
    out = Trajectory.empty(len(time[::every]), mesh, solver.instant.multipliers.shape[1])
    switches = {} if switching is None else switching.samples
    if switching is not None:
        switching.begin(solver)
    _begin(solver, after, time, initial, out)
    stops = _jump_samples(time, jumps)
    start, chunk = 1, CHUNK if flat is None else PLANAR_CHUNK
    for stop in sorted({*stops, *switches, len(time) - 1}):
        if flat is not None:
            flat.take(solver.state, solver.border.ties)
        for first in range(start, stop + 1, chunk):
            last = min(first + chunk, stop + 1)
            _march(solver, flat, before, time[first:last], scheme, out, np.arange(first, last), every)
            if progress is not None:
                progress(last - first)
        switched = switching is not None and stop in switches
        if flat is not None and (switched or stop in stops):
            flat.give(solver.state, solver.border.ties)
        if switching is not None and switched:
            q, qd, qdd = (part[0] for part in after(time[stop : stop + 1]))
            solver.load_at(float(time[stop]), q, qd, qdd)
            switching.switch(solver, switches[stop], instant(mesh, q, qd, qdd), qd, float(time[stop]), out)
        elif stop in stops:
            _restart(solver, after, time, stop, out, every)
        start = stop + 1
    return out


def _begin(solver: Solver, history: JointHistory, time: Array, initial: str, out: Trajectory) -> None:
    q, qd, qdd = (part[0] for part in history(time[:1]))
    start_undeformed(solver, q, qd, qdd)
    solver.load_at(float(time[0]), q, qd, qdd)
    joints = instant(solver.mesh, q, qd, qdd)
    when = f"at the start, t = {time[0]:g} s"
    if initial == "static":
        settled = solver.efforts is None or settle_held(solver, q, float(time[0]), when)
        if solver.efforts is None:
            equilibrium(solver, q, when)
        if settled:
            move_as_rigid(solver, joints, qd, qdd)
    consistent_accelerations(solver, joints, when)
    record_instant(solver, 0, out)


def _jump_samples(time: Array, jumps: tuple[float, ...]) -> list[int]:
    """Samples after the first at which the acceleration jumps."""
    step = time[1] - time[0] if len(time) > 1 else 1.0
    found = {round((jump - time[0]) / step) for jump in jumps}
    return sorted(k for k in found if 0 < k < len(time) and _is_jump(time[k], jumps, step))


def _is_jump(t: float, jumps: tuple[float, ...], step: float) -> bool:
    return any(abs(t - jump) < SAME_TIME * step for jump in jumps)


def _march(
    solver: Solver, flat: PlanarMarch | None, history: JointHistory, time: Array, scheme: Scheme, out: Trajectory,
    steps: NDArray[np.int64], every: int,
) -> None:  # fmt: skip
    """March over ``steps``, which end at ``time``, in the plane if there is one, else in space; keep every so many."""
    q, qd, qdd = history(time)
    row = np.where(steps % every == 0, steps // every, -1)
    if flat is not None:
        m = out.motion
        written = Histories(
            m.x, m.rotation, m.v, m.omega, m.a, m.alpha, out.wrench, out.internal, out.energy, out.multipliers, out.iterations
        )  # fmt: skip
        status, sample, count, size = flat.march(scheme, q, qd, qdd, row, written)
    else:
        rel = Joints(*(np.ascontiguousarray(part) for part in relative_motion(solver.mesh, q, qd, qdd)))
        table, drives = load_table(solver.mesh, time), solver.drives(time)
        whole = out.rows(steps[0], steps[-1] + 1) if every == 1 else out.of_length(len(steps))
        status, sample, count, size = solver.march(scheme, rel, table, drives, solver.given(q, qd, qdd), whole)
        if every > 1:
            out.put(row[row >= 0], whole, row >= 0)
    if status != CONVERGED:
        raise solver.complain(status, count, size, f"at t = {time[sample]:g} s (step {scheme.h:g} s)")


def _restart(solver: Solver, history: JointHistory, time: Array, sample: int, out: Trajectory, every: int) -> None:
    """Solve the accelerations anew where those of the task jump, and record their right-hand limit."""
    s = solver.state
    s.u[:], s.du[:] = s.u0, s.du0
    q, qd, qdd = (part[0] for part in history(time[sample : sample + 1]))
    solver.load_at(float(time[sample]), q, qd, qdd)
    consistent_accelerations(solver, instant(solver.mesh, q, qd, qdd), f"at t = {time[sample]:g} s")
    if sample % every == 0:
        record_instant(solver, sample // every, out)
