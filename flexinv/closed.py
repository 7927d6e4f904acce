"""Closed loops: motion that keeps the closures, then the same inverse dynamics with closure forces among the nodal ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexinv.applied import applied_forces, check_no_springs, joint_springs
from flexinv.closures import Rows, constraint_jacobian, constraint_rows, row_forces
from flexinv.errors import InputError
from flexinv.evaluate import evaluate, rigid_trajectory
from flexinv.integrate import Scheme
from flexinv.inverse import NodalForces, drive_efforts, joint_wrenches, nodal_forces, project
from flexinv.kinematics import Progress, flexible_motion
from flexinv.loops import JointHistory, closed_motion, share_out
from flexinv.mechanism import WORLD, Array, Attachment
from flexinv.mesh import Mesh
from flexinv.nodal import NodalMotion
from flexinv.passive import fill_passive
from flexinv.rigid import rigid_motion
from flexinv.solution import LoopForces, Solution

# What neither drives nor closures carry, over the largest force in the mechanism: beyond this (rounding of 1e-16, enlarged
# by the condition of the closures) it is an effort that no drive can give.
LEFT_OVER = 1e-9


def closed_solution(
    mesh: Mesh, history: JointHistory, time: Array, passive: set[str], settings: dict[str, float | int | str | bool]
) -> Solution:
    """Return the torques [N m], [N] of a rigid mechanism with closures over ``time`` (samples,) [s].

    history : time -> q, qd, qdd of all joints, those in ``passive`` at their initial guess
    Raises InputError for what is not there yet (closures that act for a while) and for drives that cannot hold the
    mechanism, ConvergenceError at singular configurations and lost branches.
    """
    m = mesh.mechanism
    _check(mesh)
    q, qd, qdd = closed_motion(mesh, history, time, _coordinates(mesh, passive))
    rows = constraint_rows(mesh)
    motion = rigid_motion(mesh, q, qd, qdd)
    acting = applied_forces(mesh, motion, time)
    wrenches = joint_wrenches(mesh, motion, nodal_forces(mesh, motion, acting))
    tree = project(mesh, motion, wrenches) + drive_efforts(m, qd, qdd) + joint_springs(m, q)
    shares = share_out(constraint_jacobian(mesh, motion, rows), tree, m.actuated)
    left = np.abs(shares.left).max(initial=0.0)
    largest = max(np.abs(wrenches.force).max(initial=0.0) * mesh.length, np.abs(tree).max(initial=0.0))
    if left > LEFT_OVER * largest:
        coordinate = m.velocity_names[int(np.argmax(np.abs(shares.left).max(axis=0)))]
        raise InputError(
            f"mechanism '{m.name}': the actuated joints cannot give this motion ({left:.3g} N m or N is left at '{coordinate}'): "
            "write actuated = true for as many independent joints as the mechanism has freedoms"
        )
    closing = row_forces(motion, rows, shares.multipliers) + acting
    trajectory = rigid_trajectory(mesh, q, qd, qdd, closing)
    solution = evaluate(mesh, trajectory, time, q, qd, qdd, set(), settings, closing)
    reaction = _reactions(mesh, motion, rows, shares.multipliers)
    return replace(solution, loops=LoopForces(reaction, shares.preload, shares.condition, shares.left))


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
    Multipliers come with accelerations at every step, and act in the inverse dynamics as nodal forces.
    before, after : as in `kinematics.flexible_motion`
    Raises InputError unless the motion is that of the drives, else as `closed_solution` and the march do.
    """
    _check(mesh)
    m = mesh.mechanism
    check_no_springs(m)
    unknown = _coordinates(mesh, passive)
    _check_drives(mesh, unknown)
    q0, qd0, qdd0 = closed_motion(mesh, after, time[:1], unknown)

    def started(at: Array) -> tuple[Array, Array, Array]:
        q, qd, qdd = after(at)
        if len(at) == 1 and at[0] == time[0]:
            return q0, qd0, qdd0
        return q, qd, qdd

    initial = str(settings["initial"])
    trajectory = flexible_motion(mesh, before, started, time, scheme, passive, jumps, initial, progress)
    q, qd, qdd = after(time)
    q[0] = q0[0]
    fill_passive(mesh, trajectory.motion, passive, q, qd, qdd)
    rows, motion = constraint_rows(mesh), trajectory.motion
    closing = row_forces(motion, rows, trajectory.multipliers)
    solution = evaluate(mesh, trajectory, time, q, qd, qdd, passive, settings, closing)
    reaction = _reactions(mesh, motion, rows, trajectory.multipliers)
    none, unknown_condition = np.zeros((len(time), m.nv, 0)), np.full(len(time), np.nan)
    return replace(solution, loops=LoopForces(reaction, none, unknown_condition, solution.torque_all * ~m.actuated))


def _coordinates(mesh: Mesh, names: set[str]) -> NDArray[np.bool_]:
    """Which velocity coordinates, (nv,), belong to the named joints."""
    return np.array([j.name in names for j in mesh.mechanism.joints for _ in range(j.nv)], dtype=bool)


def _check(mesh: Mesh) -> None:
    m = mesh.mechanism
    timed = [c.name for c in m.closures if c.active]
    if timed:
        raise InputError(
            f"mechanism '{m.name}', closure '{timed[0]}': active intervals are not solved yet; leave 'active' out"
        )


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


def _reactions(mesh: Mesh, motion: NodalMotion, rows: Rows, multipliers: Array) -> dict[str, Array]:
    """Wrench of each closure on its second link, at the closure's frame there and in its axes, (samples, 6)."""
    out = {}
    for index, closure in enumerate(mesh.mechanism.closures):
        own = np.where(rows.closure == index, multipliers, 0.0)
        end, node = (closure.second, 1) if closure.second.link != WORLD else (closure.first, -1)
        out[closure.name] = node * _at_frame(motion, row_forces(motion, rows, own), rows, index, end)
    return out


def _at_frame(motion: NodalMotion, forces: NodalForces, rows: Rows, index: int, end: Attachment) -> Array:
    first = int(np.flatnonzero(rows.closure == index)[0])
    node = int(rows.b[first] if rows.b[first] >= 0 else rows.a[first])
    turn = motion.rotation[:, node] @ end.placement.rotation
    arm = motion.rotation[:, node] @ end.placement.position
    force, moment = forces.force[:, node], forces.moment[:, node]
    at_frame = moment - np.cross(arm, force)
    return np.hstack([np.einsum("sji,sj->si", turn, force), np.einsum("sji,sj->si", turn, at_frame)])
