"""Closed loops with beams: the march keeps the closures, inverse dynamics takes their forces among the nodal ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexinv.analysis.evaluation import FirstStep
from flexinv.analysis.rigid_loops import coordinates, energy_jumps
from flexinv.analysis.solution import LoopForces
from flexinv.analysis.switching import Switching
from flexinv.analysis.task import Task
from flexinv.constraints.closures import constraint_rows
from flexinv.constraints.continuation import closed_start
from flexinv.constraints.phases import phases
from flexinv.constraints.reactions import phased_closing
from flexinv.errors import InputError
from flexinv.inverse.inverse_dynamics import NodalForces
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.owned_cache import kept_with_owner
from flexinv.typing import Array, Triple


def closed_task(task: Task) -> Task:
    """Return the task of a mechanism with beams and closures that begins with its loops closed, undeformed [rad or m, s].

    From there the march carries closures, passive joints and beams together.
    Drives may be more than the freedoms that rigid links would have: beams yield, and so decide how drives share the work.
    Raises InputError unless the motion is that of the drives, ConvergenceError where the loops do not close.
    """
    mesh, start = task.mesh, float(task.steps[0])
    unknown = coordinates(mesh, task.passive)
    _check_drives(mesh, unknown)
    guess = [part[0].tobytes() for part in task.after(task.steps[:1])]
    masks = unknown, coordinates(mesh, set(task.stated_rates)), phases(mesh.mechanism, task.steps)[0].active
    closed = _start(mesh, start, *(mask.tobytes() for mask in masks), *guess)

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
    mesh: Mesh, time: float, unknown: bytes, stated: bytes, active: bytes, q: bytes, qd: bytes, qdd: bytes
) -> tuple[Array, Array, Array]:
    """The closed state of one sample: other steps, tolerances and motions often begin at the same."""
    free, kept, acts = (np.frombuffer(mask, dtype=bool) for mask in (unknown, stated, active))
    rows = constraint_rows(mesh).of(acts)
    guess = np.frombuffer(q)[None], np.frombuffer(qd)[None], np.frombuffer(qdd)[None]
    found = closed_start(mesh, lambda _: guess, time, free, rows, kept)
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
    brought = _closing_work(motion, pushed, (efforts * first.joints[1]).sum(axis=1), time)
    brought += _damped_after(trajectory.energy[:, 2], [stretch.phase.first for stretch in stretches[1:]], time)
    if (jumps := energy_jumps(time, switching.impacts)) is not None:
        brought += jumps
    none, unknown_condition = np.zeros((len(time), m.nv, 0)), np.full(len(time), np.nan)
    unseen = np.empty((0, m.nv))  # what is left at joints without a drive, until the second step
    loops = LoopForces(reaction, none, unknown_condition, unseen, tuple(switching.impacts))
    return replace(first, applied=pushed + first.applied, brought=brought, loops=loops, geared=efforts)


def _closing_work(motion: NodalMotion, pushed: NodalForces, power: Array, time: Array) -> Array:
    """Return the energy that closures absorb from one sample to the next, (samples,) [J]: zero for short steps."""
    nodes = np.flatnonzero((pushed.force != 0.0).any(axis=(0, 2)) | (pushed.moment != 0.0).any(axis=(0, 2)))
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
