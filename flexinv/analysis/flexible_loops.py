"""Closed loops with beams: the march keeps the closures, inverse dynamics takes their forces among the nodal ones."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from flexinv.analysis.evaluation import FirstStep
from flexinv.analysis.rigid_loops import energy_jumps
from flexinv.analysis.solution import LoopForces
from flexinv.analysis.task import Task
from flexinv.constraints.closures import Rows, captured, constraint_rows
from flexinv.constraints.continuation import closed_start
from flexinv.constraints.loop_starts import stated_of
from flexinv.constraints.phases import Phase, Stretch, phases
from flexinv.constraints.reactions import Impact, check_meeting, closing, impact_of, jump_efforts, phased_closing
from flexinv.dynamics.constraint_rows import Ties, set_ties
from flexinv.dynamics.initial_state import accept, consistent_accelerations
from flexinv.dynamics.solver import Solver, Trajectory, record_instant
from flexinv.errors import InputError
from flexinv.inverse.inverse_dynamics import NodalForces
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.tree import Joints
from flexinv.model.owned_cache import kept_with_owner
from flexinv.typing import Array, Mask, Triple


def closed_task(task: Task) -> Task:
    """Return the task of a mechanism with beams and closures that begins with its loops closed, undeformed [rad or m, s].

    From there the march carries closures, passive joints and beams together.
    Drives may be more than the freedoms that rigid links would have: beams yield, and so decide how drives share the work.
    Raises InputError unless the motion is that of the drives, ConvergenceError where the loops do not close.
    """
    mesh, start = task.mesh, float(task.steps[0])
    unknown = stated_of(mesh.mechanism, task.passive)
    _check_drives(mesh, unknown)
    q, qd, qdd = (part[0] for part in task.after(task.steps[:1]))
    masks = unknown, stated_of(mesh.mechanism, set(task.stated_rates)), phases(mesh.mechanism, task.steps)[0].active
    closed = _start(mesh, start, *masks, q, qd, qdd)

    def started(at: Array) -> Triple:
        if len(at) == 1 and at[0] == start:
            return closed
        q, qd, qdd = task.after(at)
        if at[0] == start:
            q = q.copy()
            q[0] = closed[0][0]
        return q, qd, qdd

    return replace(task, after=started)


@kept_with_owner()
def _start(
    mesh: Mesh, time: float, unknown: Mask, stated: Mask, active: Mask, q: Array, qd: Array, qdd: Array
) -> Triple:
    """The closed state of one sample: other steps, tolerances and motions often begin at the same."""
    found = closed_start(mesh, (q, qd, qdd), time, unknown, constraint_rows(mesh).of(active), stated)
    for part in found:
        part.flags.writeable = False
    return found[0][None], found[1][None], found[2][None]


def with_closures(mesh: Mesh, first: FirstStep, switching: Switching) -> FirstStep:
    """Return a first step with the forces of its closures, from their multipliers [N], [N m], among the applied ones.

    Multipliers come with accelerations at every step, and act in the inverse dynamics as nodal forces.
    """
    m, time, trajectory = mesh.mechanism, first.time, first.trajectory
    motion, stretches = trajectory.motion, switching.stretches
    pushed, reaction = phased_closing(mesh, motion, stretches, trajectory.multipliers)
    efforts = trajectory.multipliers @ stretches[0].rows.gear
    brought = _closing_work(motion, pushed, stretches[0].rows, (efforts * first.joints[1]).sum(axis=1), time)
    brought += _damped_after(trajectory.energy[:, 2], [stretch.phase.first for stretch in stretches[1:]], time)
    if (jumps := energy_jumps(time, switching.impacts)) is not None:
        brought += jumps
    none, unknown_condition = np.zeros((len(time), m.nv, 0)), np.full(len(time), np.nan)
    unseen = np.empty((0, m.nv))  # what is left at joints without a drive, until the second step
    loops = LoopForces(reaction, none, unknown_condition, unseen, tuple(switching.impacts))
    return replace(first, applied=pushed + first.applied, brought=brought, loops=loops, geared=efforts)


def _closing_work(motion: NodalMotion, pushed: NodalForces, rows: Rows, power: Array, time: Array) -> Array:
    """Return the energy that closures absorb from one sample to the next, (samples,) [J]: zero for short steps."""
    both = np.union1d(rows.a, rows.b)
    nodes = both[both >= 0]
    spin = np.einsum("snij,snj->sni", motion.rotation[:, nodes], motion.omega[:, nodes])
    power = power + np.einsum("snc,snc->s", pushed.force[:, nodes], motion.v[:, nodes])
    power += np.einsum("snc,snc->s", pushed.moment[:, nodes], spin)
    return np.asarray(-0.5 * np.diff(time, prepend=time[0]) * (power + np.concatenate([power[:1], power[:-1]])))


def _damped_after(dissipated: Array, switches: list[int], time: Array) -> Array:
    """Return the excess of the trapezoidal sum of damping in the steps before and after ``switches``, (samples,) [J].

    Velocities that jump at one section make strain rates that damping ends long before the next sample: the power that is
    dissipated (samples,) [W] in these two steps is that of their other ends.
    """
    out = np.zeros(len(time))
    for first in switches:
        out[first] += 0.5 * (time[first] - time[first - 1]) * (dissipated[first] - dissipated[first - 1])
        if first + 1 < len(time):
            out[first + 1] += 0.5 * (time[first + 1] - time[first]) * (dissipated[first] - dissipated[first + 1])
    return out


def _check_drives(mesh: Mesh, unknown: NDArray[np.bool_]) -> None:
    """With beams the joints that the motion gives are the drives: the march shares nothing out among others."""
    m = mesh.mechanism
    for wrong, what, write in (
        (
            ~unknown & ~m.actuated,
            "the motion gives a joint without a drive",
            "give the motion of the drives, or write actuated = true",
        ),
        (
            unknown & m.actuated,
            "the motion leaves out a drive",
            "write actuated = false: drives cannot share the work here yet",
        ),
    ):
        if wrong.any():
            name = m.velocity_names[int(np.argmax(wrong))]
            raise InputError(f"mechanism '{m.name}' has beams and closures, and {what} ('{name}'): {write}")


@dataclass
class Switching:
    """Phases of the march still to come, and the stretches and impacts [N s] of those that have begun."""

    phases: list[Phase]
    stretches: list[Stretch] = field(default_factory=list)
    impacts: list[Impact] = field(default_factory=list)

    @property
    def never(self) -> bool:
        """Return True if all closures act all the time [-]."""
        return len(self.phases) == 1 and bool(self.phases[0].active.all())

    def begin(self, mesh: Mesh, ties: Ties | None) -> None:
        """Let the closures of the first phase act, with the frames [m] that the mechanism states."""
        rows = constraint_rows(mesh)
        self.stretches.append(Stretch(self.phases[0], rows))
        if ties is not None:
            set_ties(ties, rows, self.phases[0].active)

    @property
    def samples(self) -> dict[int, Phase]:
        """Phases after the first by the sample at which they begin."""
        return {phase.first: phase for phase in self.phases[1:]}

    def switch(self, solver: Solver, phase: Phase, joints: Joints, qd: Array, time: float, out: Trajectory) -> None:
        """Go over to another phase at one sample of ``out``, which holds its left-hand limit and gets the right-hand one.

        joints, qd : right-hand limit of the prescribed motion there [m, rad, s]; time [s]
        Raises InputError for frames that have not met or move against each other (`reactions.check_meeting`).
        """
        mesh, s, sample = solver.mesh, solver.state, phase.first
        m = mesh.mechanism
        last, original = self.stretches[-1], constraint_rows(mesh)
        begins = phase.active & ~last.phase.active
        one = NodalMotion(*(part.copy() for part in out.rows(sample, sample + 1).histories()[:6]))
        catches = begins & np.array([c.capture for c in m.closures])
        rows = captured(m, original, last.rows, one, catches)
        check_meeting(mesh, rows, one, begins, time)
        rows = captured(
            m, original, rows, one, begins
        )  # the rest, below `reactions.OPEN`: the next step shall not jerk it away
        self.stretches.append(Stretch(phase, rows))
        set_ties(solver.border.ties, rows, phase.active)
        s.u[:], s.du[:] = s.u0, s.du0
        before = _rates(solver, qd)
        impulses = solver.collide(joints)
        accept(s)
        consistent_accelerations(solver, joints, f"at t = {time:g} s")
        record_instant(solver, sample, out)
        if any(m.closures[int(k)].impact == "plastic" for k in np.flatnonzero(begins)):
            two = out.rows(sample, sample + 1).motion
            sides = (one, before), (two, _rates(solver, qd))
            pushed, _ = closing(mesh, two, rows, impulses[None])
            self.impacts.append(impact_of(mesh, rows, begins, sides, jump_efforts(mesh, sides, pushed), impulses, time))


def _rates(solver: Solver, qd: Array) -> Array:
    """Rates (nv,) of all joints now: the prescribed ones, and those of the passive joints among the unknowns."""
    out, t, mesh = qd.copy(), solver.topology, solver.mesh
    for n in np.flatnonzero(t.freedoms):
        first, v = t.offset[t.block[n]] + t.column[n], mesh.v_index[n]
        out[v : v + t.freedoms[n]] = solver.state.u[first : first + t.freedoms[n]]
    return out
