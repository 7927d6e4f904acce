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
from flexinv.joint import JointHistory
from flexinv.kinematics import Progress, flexible_motion
from flexinv.loops import Shares, closed_motion, share_out
from flexinv.mechanism import WORLD, Array, Attachment
from flexinv.mesh import Mesh
from flexinv.nodal import NodalMotion
from flexinv.passive import fill_passive
from flexinv.phases import Phase, phases
from flexinv.rigid import rigid_motion
from flexinv.solution import LoopForces, Solution

# What neither drives nor closures carry, over the largest force in the mechanism: beyond this (rounding of 1e-16, enlarged
# by the condition of the closures) it is an effort that no drive can give.
LEFT_OVER = 1e-9
# Rates before and after a switch that differ by less than this part of the largest rate (of 1 rad/s or 1 m/s where all is
# slower: from rest to rest there is nothing else to compare with) are equal: Newton leaves 1e-13, splines of samples 1e-9.
MEETING = 1e-6


def closed_solution(
    mesh: Mesh, history: JointHistory, time: Array, passive: set[str], settings: dict[str, float | int | str | bool]
) -> Solution:
    """Return the torques [N m], [N] of a rigid mechanism with closures over ``time`` (samples,) [s].

    history : time -> q, qd, qdd of all joints, those in ``passive`` at their initial guess
    Closures that act for a while divide the time into phases, solved one after the other by the same equations.
    Raises InputError for closures that meet with unequal velocities and for drives that cannot hold the mechanism,
    ConvergenceError at singular configurations and lost branches.
    """
    m = mesh.mechanism
    pieces = phases(m, time)
    rows = constraint_rows(mesh)
    q, qd, qdd = _phased_motion(mesh, history, time, _coordinates(mesh, passive), rows, pieces)
    motion = rigid_motion(mesh, q, qd, qdd)
    acting = applied_forces(mesh, motion, time)
    wrenches = joint_wrenches(mesh, motion, nodal_forces(mesh, motion, acting))
    tree = project(mesh, motion, wrenches) + drive_efforts(m, qd, qdd) + joint_springs(m, q)
    shares = _phased_shares(constraint_jacobian(mesh, motion, rows), tree, m.actuated, rows, pieces)
    left = np.abs(shares.left).max(initial=0.0)
    largest = max(np.abs(wrenches.force).max(initial=0.0) * mesh.length, np.abs(tree).max(initial=0.0))
    if left > LEFT_OVER * largest:
        sample, column = np.unravel_index(int(np.argmax(np.abs(shares.left))), shares.left.shape)
        raise InputError(
            f"mechanism '{m.name}', t = {time[sample]:g} s: the actuated joints cannot give this motion ({left:.3g} N m or N is "
            f"left at '{m.velocity_names[column]}'): "
            "write actuated = true for as many independent joints as the mechanism has freedoms"
        )
    closing = row_forces(motion, rows, shares.multipliers) + acting
    trajectory = rigid_trajectory(mesh, q, qd, qdd, closing)
    solution = evaluate(mesh, trajectory, time, q, qd, qdd, set(), settings, closing)
    reaction = closure_reactions(mesh, motion, rows, shares.multipliers)
    return replace(solution, loops=LoopForces(reaction, shares.preload, shares.condition, shares.left))


def _phased_motion(
    mesh: Mesh, history: JointHistory, time: Array, unknown: NDArray[np.bool_], rows: Rows, pieces: list[Phase]
) -> tuple[Array, Array, Array]:
    """Motion phase by phase, each from where the one before has come to; at a switching instant the right-hand limit."""
    if len(pieces) == 1 and pieces[0].active.all():
        return closed_motion(mesh, history, time, unknown)
    whole = history(time)
    before: tuple[Array, Array] | None = None
    for piece in pieces:
        span = slice(piece.first, min(piece.last + 1, len(time)))  # with the instant at which the next phase begins
        start = None if before is None else before[0]
        found = closed_motion(mesh, history, time[span], unknown, rows.of(piece.active), start)
        if before is not None:
            _check_meeting(mesh, before[1], found[1][0], float(time[piece.first]), piece)
        before = found[0][-1], found[1][-1]
        for part, values in zip(whole, found, strict=True):
            part[span] = values
    return whole


def _check_meeting(mesh: Mesh, before: Array, after: Array, time: float, piece: Phase) -> None:
    """Raise InputError where closures that begin to act would change velocities in no time."""
    m = mesh.mechanism
    change = np.abs(before - after)
    size = max(np.abs(before).max(initial=0.0), np.abs(after).max(initial=0.0), 1.0)
    if change.max(initial=0.0) > MEETING * size:
        worst = int(np.argmax(change))
        names = ", ".join(c.name for c, acts in zip(m.closures, piece.active, strict=True) if acts) or "none"
        raise InputError(
            f"mechanism '{m.name}', t = {time:g} s: the closures that act from here on ({names}) change the rate of "
            f"'{m.velocity_names[worst]}' from {before[worst]:.4g} to {after[worst]:.4g} at once, which takes an impulse; let "
            "the frames meet with equal velocities"
        )


def _phased_shares(g: Array, tree: Array, driven: NDArray[np.bool_], rows: Rows, pieces: list[Phase]) -> Shares:
    """Shares of the drives phase by phase; multipliers of closures that do not act are zero."""
    parts = []
    for piece in pieces:
        span, pick = slice(piece.first, piece.last), piece.active[rows.closure]
        part = share_out(g[span][:, pick], tree[span], driven)
        multipliers = np.zeros((piece.last - piece.first, len(rows)))
        multipliers[:, pick] = part.multipliers
        parts.append(replace(part, multipliers=multipliers))
    width = max(part.preload.shape[2] for part in parts)
    preload = [np.pad(part.preload, ((0, 0), (0, 0), (0, width - part.preload.shape[2]))) for part in parts]
    return Shares(
        tau=np.concatenate([part.tau for part in parts]),
        multipliers=np.concatenate([part.multipliers for part in parts]),
        left=np.concatenate([part.left for part in parts]),
        preload=np.concatenate(preload),
        condition=np.concatenate([part.condition for part in parts]),
    )


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
    reaction = closure_reactions(mesh, motion, rows, trajectory.multipliers)
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
            f"mechanism '{m.name}', closure '{timed[0]}': active intervals are not solved together with beams yet; "
            "leave 'active' out, or make the links rigid"
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


def closure_reactions(mesh: Mesh, motion: NodalMotion, rows: Rows, multipliers: Array) -> dict[str, Array]:
    """Return the wrench [N], [N m] of each closure on its second link, at its frame there and in its axes, (samples, 6).

    multipliers : (samples, rows) [N], [N m]
    """
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
