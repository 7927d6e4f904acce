"""Closed loops with beams: the march keeps the closures, inverse dynamics takes their forces among the nodal ones."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexinv.applied import applied_forces
from flexinv.closed import coordinates, energy_jumps, geared
from flexinv.closures import constraint_rows
from flexinv.errors import InputError
from flexinv.evaluate import evaluate
from flexinv.integrate import Scheme
from flexinv.joint import JointHistory
from flexinv.kinematics import Progress, flexible_motion
from flexinv.loops import closed_start
from flexinv.mechanism import Array
from flexinv.mesh import Mesh
from flexinv.passive import fill_passive
from flexinv.phases import phases
from flexinv.reactions import phased_closing
from flexinv.solution import LoopForces, Solution
from flexinv.solver import Trajectory
from flexinv.switching import Switching


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
) -> Solution:
    """Return the torques [N m], [N] of a mechanism with beams and closures over ``time`` (samples,) [s].

    The loops are closed undeformed at the start; from there the march carries closures, passive joints and beams together.
    Drives may be more than the freedoms that rigid links would have: beams yield, and so decide how drives share the work.
    Multipliers come with accelerations at every step, and act in the inverse dynamics as nodal forces.
    before, after : as in `kinematics.flexible_motion`
    Raises InputError unless the motion is that of the drives, else as `closed_solution` and the march do.
    """
    m = mesh.mechanism
    unknown = coordinates(mesh, passive)
    _check_drives(mesh, unknown)
    switching = Switching(phases(m, time))
    guess = [part[0].tobytes() for part in after(time[:1])]
    q0, qd0, qdd0 = _start(mesh, float(time[0]), unknown.tobytes(), switching.phases[0].active.tobytes(), *guess)

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
    mesh: Mesh, time: float, unknown: bytes, active: bytes, q: bytes, qd: bytes, qdd: bytes
) -> tuple[Array, Array, Array]:
    """The closed state of one sample: other steps, tolerances and motions often begin at the same."""
    free, rows = np.frombuffer(unknown, dtype=bool), constraint_rows(mesh).of(np.frombuffer(active, dtype=bool))
    guess = np.frombuffer(q)[None], np.frombuffer(qd)[None], np.frombuffer(qdd)[None]
    found = closed_start(mesh, lambda _: guess, time, free, rows)
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
    """Return what follows from a trajectory over ``time`` (samples,) [s] with the closures' multipliers [N], [N m].

    joint_motion : q, qd, qdd, into which the coordinates of the passive joints are written
    """
    m = mesh.mechanism
    q, qd, qdd = joint_motion
    fill_passive(mesh, trajectory.motion, passive, q, qd, qdd)
    motion, stretches = trajectory.motion, switching.stretches
    pushed, reaction = phased_closing(mesh, motion, stretches, trajectory.multipliers)
    closing = pushed + applied_forces(mesh, motion, time)
    brought = energy_jumps(time, switching.impacts)
    none, unknown_condition = np.zeros((len(time), m.nv, 0)), np.full(len(time), np.nan)
    solution = evaluate(mesh, trajectory, time, q, qd, qdd, passive, settings, closing, brought)
    if stretches[0].rows.gear.any():
        solution = geared(solution, trajectory.multipliers @ stretches[0].rows.gear)
    left = solution.torque_all * ~m.actuated
    loops = LoopForces(reaction, none, unknown_condition, left, tuple(switching.impacts))
    return replace(solution, loops=loops)


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
