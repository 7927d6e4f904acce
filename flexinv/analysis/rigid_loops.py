"""Closed loops of rigid links: motion that keeps the closures, then inverse dynamics with their forces among the nodal ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexinv.analysis.evaluation import FirstStep, rigid_trajectory
from flexinv.analysis.solution import LoopForces
from flexinv.analysis.task import Task
from flexinv.constraints.allocation import GivenLoops, check_carried, share_out
from flexinv.constraints.allocation_kernel import Shares
from flexinv.constraints.closures import captured, constraint_jacobian, constraint_rows
from flexinv.constraints.continuation import closed_motion
from flexinv.constraints.loop_starts import stated_of
from flexinv.constraints.phases import Stretch, phases
from flexinv.constraints.reactions import Impact, check_meeting, impact_of, jump_efforts, phased_closing
from flexinv.inverse.applied_forces import applied_forces, joint_springs
from flexinv.inverse.inverse_dynamics import drive_efforts, joint_wrenches, nodal_forces, project
from flexinv.kinematics.joint_motion import JointHistory
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.rigid_motion import rigid_motion
from flexinv.typing import Array


def rigid_loops(task: Task) -> FirstStep:
    """Return the first step of a rigid mechanism with closures [m, rad, s], their forces [N], [N m] among the applied ones.

    Passive joints begin at their initial guess.
    Closures that act for a while divide the time into phases, solved one after the other by the same equations.
    Raises InputError for closures that meet with unequal velocities and for drives that cannot hold the mechanism,
    ConvergenceError at singular configurations and lost branches.
    """
    mesh, time, m = task.mesh, task.time, task.mesh.mechanism
    joints, stretches, impacts, given = _phased_motion(mesh, task.after, time, stated_of(mesh.mechanism, task.passive))
    q, qd, qdd = joints
    g, motion = given or (None, rigid_motion(mesh, q, qd, qdd))
    acting = applied_forces(mesh, motion, time)
    wrenches = joint_wrenches(mesh, motion, nodal_forces(mesh, motion, acting))
    tree = project(mesh, motion, wrenches) + drive_efforts(m, qd, qdd) + joint_springs(m, q)
    shares = _phased_shares(mesh, motion, tree, stretches, g)
    largest = max(np.abs(wrenches.force).max(initial=0.0) * mesh.length, np.abs(tree).max(initial=0.0))
    check_carried(m, shares.left, largest, lambda sample: f"t = {time[sample]:g} s")
    pushed, reaction = phased_closing(mesh, motion, stretches, shares.multipliers)
    applied = pushed + acting
    return FirstStep(
        rigid_trajectory(mesh, motion, applied), time, joints, applied, energy_jumps(time, impacts),
        loops=LoopForces(reaction, shares.preload, shares.condition, shares.left, tuple(impacts)),
        geared=shares.multipliers @ stretches[0].rows.gear,
    )  # fmt: skip


def _phased_motion(
    mesh: Mesh, history: JointHistory, time: Array, unknown: NDArray[np.bool_]
) -> tuple[tuple[Array, Array, Array], list[Stretch], list[Impact], tuple[Array, NodalMotion] | None]:
    """Motion phase by phase, each from where the one before has come to; at a switching instant the right-hand limit.

    Last the constraint Jacobian and the nodes' motion at all samples, where all closures act and the motion that is given has
    been held against them.
    """
    m = mesh.mechanism
    pieces, original = phases(m, time), constraint_rows(mesh)
    if len(pieces) == 1 and pieces[0].active.all():
        only = [Stretch(pieces[0], original)]
        if unknown.any() or not len(original):
            return closed_motion(mesh, history, time, unknown), only, [], None
        given, motion = history(time), NodalMotion.unwritten(len(time), mesh.size)
        return given, only, [], (GivenLoops(mesh).jacobian(*given, motion), motion)
    whole, rows = history(time), original
    stretches: list[Stretch] = []
    impacts: list[Impact] = []
    before: tuple[Array, Array] | None = None
    for piece in pieces:
        span = slice(piece.first, min(piece.last + 1, len(time)))  # with the instant at which the next phase begins
        begins = piece.active & ~stretches[-1].phase.active if stretches else np.zeros(len(m.closures), dtype=bool)
        at = float(time[piece.first])
        if before is not None:
            state = rigid_motion(mesh, before[0][None], before[1][None], np.zeros((1, m.nv)))
            rows = captured(m, original, rows, state, begins & np.array([c.capture for c in m.closures]))
            check_meeting(mesh, rows, state, begins, at)
        stretch = Stretch(piece, rows)
        found = closed_motion(
            mesh, history, time[span], unknown, rows.of(piece.active), None if before is None else before[0]
        )
        if before is not None and any(m.closures[int(k)].impact == "plastic" for k in np.flatnonzero(begins)):
            impacts.append(_impact(mesh, stretch, begins, found[0][0], before[1], found[1][0], at))
        stretches.append(stretch)
        before = found[0][-1], found[1][-1]
        for part, values in zip(whole, found, strict=True):
            part[span] = values
    return whole, stretches, impacts, None


def _impact(
    mesh: Mesh, stretch: Stretch, begins: NDArray[np.bool_], q: Array, before: Array, after: Array, time: float
) -> Impact:
    """Impulses of drives and closures that change the rates (nv,) at a configuration (nq,) at once."""
    m, rest = mesh.mechanism, np.zeros((1, mesh.mechanism.nv))
    one, two = ((rigid_motion(mesh, q[None], rate[None], rest), rate) for rate in (before, after))
    acting = stretch.acting
    g, tree = constraint_jacobian(mesh, two[0], acting), jump_efforts(mesh, (one, two))[None]
    shares = share_out(g, tree, m.actuated, m.weights[m.actuated], acting)
    multipliers = np.zeros(len(stretch.rows))
    multipliers[stretch.pick] = shares.multipliers[0]
    return impact_of(mesh, stretch.rows, begins, (one, two), shares.tau[0], multipliers, time)


def energy_jumps(time: Array, impacts: list[Impact]) -> Array | None:
    """Return the energy [J] that impacts bring, (samples,) at their instants: drives' work less what is lost; None without."""
    if not impacts:
        return None
    out = np.zeros(len(time))
    for impact in impacts:
        sample = int(np.argmin(np.abs(time - impact.time)))
        out[sample] += impact.work - impact.energy
    return out


def _phased_shares(
    mesh: Mesh, motion: NodalMotion, tree: Array, stretches: list[Stretch], jacobian: Array | None
) -> Shares:
    """Shares of the drives phase by phase; multipliers of closures that do not act are zero."""
    m, parts = mesh.mechanism, []
    for stretch in stretches:
        span, pick, acting = stretch.span, stretch.pick, stretch.acting
        g = constraint_jacobian(mesh, motion.samples(span), acting) if jacobian is None else jacobian
        part = share_out(g, tree[span], m.actuated, m.weights[m.actuated], acting)
        if len(stretches) == 1 and pick.all():
            return part
        multipliers = np.zeros((len(part.tau), len(stretch.rows)))
        multipliers[:, pick] = part.multipliers
        parts.append(part._replace(multipliers=multipliers))
    width = max(part.preload.shape[2] for part in parts)
    parts = [
        part._replace(preload=np.pad(part.preload, ((0, 0), (0, 0), (0, width - part.preload.shape[2]))))
        for part in parts
    ]
    return Shares(*(np.concatenate(one) for one in zip(*parts, strict=True)))
