"""Closed loops with beams: the march keeps the closures, inverse dynamics takes their forces among the nodal ones."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexinv.analysis.evaluation import evaluate
from flexinv.analysis.rigid_loops import coordinates, energy_jumps, geared
from flexinv.analysis.solution import LoopForces, Solution
from flexinv.analysis.switching import Switching
from flexinv.analysis.trajectory import Progress, flexible_motion
from flexinv.constraints.closures import constraint_rows
from flexinv.constraints.continuation import closed_start
from flexinv.constraints.phases import phases
from flexinv.constraints.reactions import phased_closing
from flexinv.dynamics.generalized_alpha import Scheme
from flexinv.dynamics.solver import Trajectory
from flexinv.errors import InputError
from flexinv.inverse.applied_forces import applied_forces
from flexinv.inverse.inverse_dynamics import NodalForces
from flexinv.kinematics.joint_motion import JointHistory
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.unactuated import fill_passive
from flexinv.typing import Array


def flexible_closed_solution(
    mesh: Mesh,
    before: JointHistory,
    after: JointHistory,
    time: Array,
    scheme: Scheme,
    passive: set[str],
    settings: dict[str, float | int | str | bool],
    jumps: tuple[float, ...] = (),
    progress: Progress | None = None,
    stated_rates: Collection[str] = (),
) -> Solution:
    """Return the torques [N m], [N] of a mechanism with beams and closures over ``time`` (samples,) [s].

    The loops are closed undeformed at the start; from there the march carries closures, passive joints and beams together.
    Drives may be more than the freedoms that rigid links would have: beams yield, and so decide how drives share the work.
    Multipliers come with accelerations at every step, and act in the inverse dynamics as nodal forces.
    before, after : as in `trajectory.flexible_motion`; stated_rates : passive joints whose rates at the start are kept
    Raises InputError unless the motion is that of the drives, else as `closed_solution` and the march do.
    """
    m = mesh.mechanism
    unknown = coordinates(mesh, passive)
    _check_drives(mesh, unknown)
    switching = Switching(phases(m, time))
    guess = [part[0].tobytes() for part in after(time[:1])]
    masks = unknown, coordinates(mesh, set(stated_rates)), switching.phases[0].active
    q0, qd0, qdd0 = _start(mesh, float(time[0]), *(mask.tobytes() for mask in masks), *guess)

    def started(at: Array) -> tuple[Array, Array, Array]:
        q, qd, qdd = after(at)
        if len(at) == 1 and at[0] == time[0]:
            return q0, qd0, qdd0
        return q, qd, qdd

    initial = str(settings["initial"])
    trajectory = flexible_motion(mesh, before, started, time, scheme, passive, jumps, initial, progress, switching)
    q, qd, qdd = (part.copy() for part in after(time))
    q[0] = q0[0]
    return evaluated(mesh, trajectory, time, (q, qd, qdd), passive, settings, switching)


@lru_cache(maxsize=64)
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


def evaluated(
    mesh: Mesh,
    trajectory: Trajectory,
    time: Array,
    joint_motion: tuple[Array, Array, Array],
    passive: set[str],
    settings: dict[str, float | int | str | bool],
    switching: Switching,
) -> Solution:
    """Return the Solution of a trajectory over ``time`` (samples,) [s] with the closures' multipliers [N], [N m].

    joint_motion : q, qd, qdd, into which the coordinates of the passive joints are written
    """
    m = mesh.mechanism
    q, qd, qdd = joint_motion
    fill_passive(mesh, trajectory.motion, passive, q, qd, qdd)
    motion, stretches = trajectory.motion, switching.stretches
    pushed, reaction = phased_closing(mesh, motion, stretches, trajectory.multipliers)
    closing = pushed + applied_forces(mesh, motion, time)
    efforts = trajectory.multipliers @ stretches[0].rows.gear
    brought = _closing_work(motion, pushed, (efforts * qd).sum(axis=1), time)
    brought += _damped_after(trajectory.energy[:, 2], [stretch.phase.first for stretch in stretches[1:]], time)
    if (jumps := energy_jumps(time, switching.impacts)) is not None:
        brought += jumps
    none, unknown_condition = np.zeros((len(time), m.nv, 0)), np.full(len(time), np.nan)
    solution = evaluate(mesh, trajectory, time, q, qd, qdd, passive, settings, closing, brought)
    if stretches[0].rows.gear.any():
        solution = geared(solution, efforts)
    left = solution.torque_all * ~m.actuated
    loops = LoopForces(reaction, none, unknown_condition, left, tuple(switching.impacts))
    return replace(solution, loops=loops)


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
