"""Closed loops: motion that keeps the closures, and their forces among the nodal ones; of rigid links, and with beams."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexinv.analysis.evaluation import FirstStep, build_rigid_trajectory
from flexinv.analysis.solution import LoopForces
from flexinv.analysis.task import Task
from flexinv.constraints.allocation import LEFT_OVER, PrescribedLoops, check_carried, split_efforts
from flexinv.constraints.allocation_kernel import AllocatedEfforts
from flexinv.constraints.closures import (
    Phase,
    Stretch,
    build_constraint_rows,
    compute_constraint_jacobian,
    list_phases,
    list_velocity_scales,
    move_second_frames,
)
from flexinv.constraints.continuation import solve_closed_motion, solve_closed_start
from flexinv.constraints.drive_dead_points import check_drives
from flexinv.constraints.loop_starts import build_joint_mask
from flexinv.constraints.reactions import (
    Impact,
    check_meeting,
    compute_closure_wrenches,
    compute_impulses,
    compute_phased_wrenches,
    make_impact,
)
from flexinv.dynamics.constraint_rows import Ties, update_ties
from flexinv.dynamics.generalized_alpha import ACCELERATIONS
from flexinv.dynamics.initial_state import begin_from_state
from flexinv.dynamics.solver import Solver, build_coordinate_map, write_instant
from flexinv.dynamics.system import Trajectory
from flexinv.errors import InputError
from flexinv.inverse.inverse_dynamics import (
    compute_applied_forces,
    compute_internal_efforts,
    compute_local_wrenches,
    compute_nodal_forces,
    compute_projected_efforts,
)
from flexinv.inverse.spring_lengths import InterpolatedMotion, check_spring_lengths
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import JointHistory, NodalMotion, compute_rigid_motion
from flexinv.kinematics.tree import Joints
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Mask, Triple


def solve_rigid_loops(task: Task) -> FirstStep:
    """Return the first step of a rigid mechanism with closures [m, rad, s], their forces [N], [N m] among the applied ones.

    Loops are closed at every sample, passive joints begin at their initial guess.  Closures that act for a while divide the time
    into phases, solved one after the other by the same equations.  Raises InputError for closures that meet with unequal
    velocities and for drives that cannot hold the mechanism, ConvergenceError at singular configurations and lost branches.
    """
    mesh = task.mesh
    time = task.time
    m = task.mesh.mechanism
    unknown = build_joint_mask(m, task.passive)
    joints, stretches, impacts, given = _solve_phased_motion(mesh, task.after, time, unknown, task.knots)
    q, qd, qdd = joints
    g, motion = given or (None, compute_rigid_motion(mesh, q, qd, qdd))
    for one in stretches:
        rows = one.rows.take_active(one.phase.active)
        part = slice(one.phase.first, min(one.phase.last + 1, len(time)))
        check_drives(mesh, rows, (task.after, task.knots), unknown, time[part], (q[part], qd[part], qdd[part]), g)
    check_spring_lengths(mesh, motion, time, _make_motion_between(task))
    acting = compute_applied_forces(mesh, motion, time)
    forces = compute_nodal_forces(mesh, motion, acting)
    wrenches = compute_local_wrenches(mesh, motion, forces)
    tree = compute_projected_efforts(mesh, motion, forces, wrenches) + compute_internal_efforts(m, q, qd, qdd)
    shares = _join_shares(
        [_compute_phase_shares(mesh, one, motion.take_samples(one.span), tree[one.span], g) for one in stretches]
    )
    largest = _find_largest_magnitude(tree)
    if (
        _find_largest_magnitude(shares.left) > LEFT_OVER * largest
    ):  # it may be rounding of forces that are large beside the efforts
        pulls = forces.force, *(wrench[:, :3] for wrench in wrenches.values())
        largest = max(largest, *(mesh.length * _find_largest_magnitude(pull) for pull in pulls))
    check_carried(m, shares.left, largest, lambda sample: f"t = {time[sample]:g} s")
    pushed, reaction = compute_phased_wrenches(mesh, motion, stretches, shares.multipliers)
    applied = pushed + acting
    return FirstStep(
        build_rigid_trajectory(mesh, motion, applied), time, joints, applied, _collect_energy_jumps(time, impacts),
        loops=LoopForces(reaction, shares.preload, shares.condition, shares.left, tuple(impacts)),
        geared=shares.multipliers @ stretches[0].rows.gear,
    )  # fmt: skip


def _make_motion_between(task: Task) -> InterpolatedMotion:
    """The motion of a rigid mechanism with closures between its samples, which are followed again with all instants."""
    mesh = task.mesh
    unknown = build_joint_mask(task.mesh.mechanism, task.passive)

    def evaluate_nodes(times: Array) -> NodalMotion:
        at = np.union1d(task.time, times)
        found = _solve_phased_motion(mesh, task.after, at, unknown, task.knots)[0]
        rows = np.searchsorted(at, times)
        return compute_rigid_motion(mesh, *(part[rows] for part in found))

    given = ~unknown
    scales = list_velocity_scales(mesh)[given]

    def evaluate_speed(times: Array) -> Array:
        return np.asarray((np.abs(task.after(times)[1][:, given]) / scales).sum(axis=1))

    switches = tuple(instant for closure in mesh.mechanism.closures for span in closure.active for instant in span)
    return InterpolatedMotion(evaluate_nodes, (*task.knots, *switches), evaluate_speed)


def _find_largest_magnitude(values: Array) -> float:
    """The largest absolute value, without an array of them."""
    return float(max(values.max(initial=0.0), -values.min(initial=0.0)))


def _join_shares(parts: list[AllocatedEfforts]) -> AllocatedEfforts:
    """The shares of all phases, one after the other; preloads that a phase does not have are zero there."""
    if len(parts) == 1:
        return parts[0]
    width = max(part.preload.shape[2] for part in parts)
    missing = [((0, 0), (0, 0), (0, width - part.preload.shape[2])) for part in parts]
    parts = [p._replace(preload=np.pad(p.preload, pad)) for p, pad in zip(parts, missing, strict=True)]
    return AllocatedEfforts(*(np.concatenate(one) for one in zip(*parts, strict=True)))


def _solve_phased_motion(
    mesh: Mesh, history: JointHistory, time: Array, unknown: Mask, knots: tuple[float, ...]
) -> tuple[Triple, list[Stretch], list[Impact], tuple[Array, NodalMotion] | None]:
    """Motion phase by phase, each from where the one before has come to; at a switching instant the right-hand limit.

    Last the constraint Jacobian and the nodes' motion at all samples, where all closures act and the motion that is given has
    been held against them.
    """
    m = mesh.mechanism
    pieces = list_phases(m, time)
    original = build_constraint_rows(mesh)
    if len(pieces) == 1 and pieces[0].active.all():
        joints, known = _solve_lasting_motion(mesh, history, time, unknown, knots)
        return joints, [Stretch(pieces[0], original)], [], known
    whole = history(time)
    begins = np.zeros(len(m.closures), dtype=bool)
    stretches = list[Stretch]()
    impacts = list[Impact]()
    before: tuple[Array, Array] | None = None
    for piece in pieces:
        span = slice(piece.first, min(piece.last + 1, len(time)))  # with the instant at which the next phase begins
        stretch = Stretch(piece, original)
        at = float(time[piece.first])
        if before is not None:
            state = compute_rigid_motion(mesh, before[0][None], before[1][None], np.zeros((1, m.nv)))
            stretch, begins = _begin_stretch(mesh, stretches[-1], piece, state, at)
        begun = None if before is None else before[0]
        rows = stretch.rows.take_active(piece.active)
        closed_motion = solve_closed_motion(mesh, history, time[span], unknown, rows, begun, knots)
        if before is not None and _is_plastic(mesh, begins):
            rates = before[1], closed_motion[1][0]
            impacts.append(_compute_impact(mesh, stretch, begins, closed_motion[0][:1], rates, at))
        stretches.append(stretch)
        before = closed_motion[0][-1], closed_motion[1][-1]
        for part, values in zip(whole, closed_motion, strict=True):
            part[span] = values
    return whole, stretches, impacts, None


def _solve_lasting_motion(
    mesh: Mesh, history: JointHistory, time: Array, unknown: Mask, knots: tuple[float, ...]
) -> tuple[Triple, tuple[Array, NodalMotion] | None]:
    """Motion where all closures act throughout; the Jacobian and the nodes' motion where nothing is left to be solved for."""
    if unknown.any() or not len(build_constraint_rows(mesh).closure):
        return solve_closed_motion(mesh, history, time, unknown, knots=knots), None
    given = history(time)
    motion = NodalMotion.make_uninitialized(len(time), mesh.size)
    return given, (PrescribedLoops(mesh).compute_jacobian(*given, motion), motion)


def _compute_impact(
    mesh: Mesh, stretch: Stretch, begins: Mask, q: Array, rates: tuple[Array, Array], time: float
) -> Impact:
    """The impact of closures that begin at q (1, nq), whose impulses change the rates at once; rates : before and after."""
    rest = np.zeros((1, mesh.mechanism.nv))
    one, two = ((compute_rigid_motion(mesh, q, rate[None], rest), rate) for rate in rates)
    shares = _compute_phase_shares(mesh, stretch, two[0], compute_impulses(mesh, (one, two))[None])
    return make_impact(mesh, stretch.rows, begins, (one, two), shares.tau[0], shares.multipliers[0], time)


def _begin_stretch(mesh: Mesh, last: Stretch, phase: Phase, motion: NodalMotion, time: float) -> tuple[Stretch, Mask]:
    """The stretch of a phase and which closures begin to act: frames that are captured as they lie, the others have met."""
    m = mesh.mechanism
    begins = phase.active & ~last.phase.active
    captures = begins & np.array([c.capture for c in m.closures])
    rows = move_second_frames(m, build_constraint_rows(mesh), last.rows, motion, captures)
    check_meeting(mesh, rows, motion, begins, time)
    return Stretch(phase, rows), begins


def _is_plastic(mesh: Mesh, begins: Mask) -> bool:
    return any(c.impact == "plastic" for c, now in zip(mesh.mechanism.closures, begins, strict=True) if now)


def _collect_energy_jumps(time: Array, impacts: list[Impact]) -> Array:
    """Energy [J] that impacts bring, (samples,) at their instants: drives' work less what is lost."""
    out = np.zeros(len(time))
    for impact in impacts:
        out[int(np.argmin(np.abs(time - impact.time)))] += impact.work - impact.energy
    return out


def _compute_phase_shares(
    mesh: Mesh, stretch: Stretch, motion: NodalMotion, tree: Array, jacobian: Array | None = None
) -> AllocatedEfforts:
    """Shares of the drives in one phase, from its constraint Jacobian; multipliers of closures that do not act are zero."""
    m = mesh.mechanism
    active = stretch.phase.active
    rows = stretch.rows.take_active(active)
    pick = active[stretch.rows.closure]
    g = compute_constraint_jacobian(mesh, motion, rows) if jacobian is None else jacobian
    phase_shares = split_efforts(g, tree, m.actuated, m.weights[m.actuated], rows)
    if pick.all():
        return phase_shares
    multipliers = np.zeros((len(tree), len(pick)))
    multipliers[:, pick] = phase_shares.multipliers
    return phase_shares._replace(multipliers=multipliers)


def make_closed_task(task: Task) -> Task:
    """Return the task of a mechanism with beams and closures that begins with its loops closed, undeformed [rad or m, s].

    From there the march carries closures, passive joints and beams together.  Drives may be more than the freedoms that rigid
    links would have: beams yield, and so decide how drives share the work.
    Raises InputError unless the motion is that of the drives, ConvergenceError where the loops do not close.
    """
    mesh = task.mesh
    m = task.mesh.mechanism
    start = float(task.steps[0])
    unknown = build_joint_mask(m, task.passive)
    given = "the motion gives a joint without a drive", "give the motion of the drives, or write actuated = true"
    left = "the motion leaves out a drive", "write actuated = false: drives cannot share the work here yet"
    for wrong, (what, write) in ((~unknown & ~m.actuated, given), (unknown & m.actuated, left)):
        if wrong.any():
            name = m.velocity_names[int(np.argmax(wrong))]
            raise InputError(f"mechanism '{m.name}' has beams and closures, and {what} ('{name}'): {write}")
    masks = unknown, build_joint_mask(m, task.stated_rates), list_phases(m, task.steps)[0].active
    closed = _solve_closed_start(mesh, start, *masks, *(part[0] for part in task.after(task.steps[:1])))

    def evaluate_from_start(at: Array) -> Triple:
        if len(at) == 1 and at[0] == start:
            return closed
        q, qd, qdd = task.after(at)
        if at[0] == start:
            q = np.concatenate([closed[0], q[1:]])
        return q, qd, qdd

    return replace(task, after=evaluate_from_start)


@make_owner_cache()
def _solve_closed_start(
    mesh: Mesh, time: float, unknown: Mask, stated: Mask, active: Mask, q: Array, qd: Array, qdd: Array
) -> Triple:
    """The closed state of one sample: other steps, tolerances and motions often begin at the same."""
    closed_start = solve_closed_start(
        mesh, (q, qd, qdd), time, unknown, build_constraint_rows(mesh).take_active(active), stated
    )
    for part in closed_start:
        part.flags.writeable = False
    return closed_start[0][None], closed_start[1][None], closed_start[2][None]


def add_reaction_forces(mesh: Mesh, first: FirstStep, switching: PhaseHistory) -> FirstStep:
    """Return a first step with its closures' forces [N], [N m] among those applied, from multipliers that each step has found."""
    m = mesh.mechanism
    time = first.time
    trajectory = first.trajectory
    motion = trajectory.motion
    stretches = switching.stretches
    pushed, reaction = compute_phased_wrenches(mesh, motion, stretches, trajectory.multipliers)
    efforts = trajectory.multipliers @ stretches[0].rows.gear
    # the energy that closures absorb from one sample to the next: zero for short steps
    both = np.union1d(stretches[0].rows.a, stretches[0].rows.b)
    nodes = both[both >= 0]
    spin = np.einsum("snij,snj->sni", motion.rotation[:, nodes], motion.omega[:, nodes])
    power = (efforts * first.joints[1]).sum(axis=1)
    power += np.einsum("snc,snc->s", pushed.force[:, nodes], motion.v[:, nodes])
    power += np.einsum("snc,snc->s", pushed.moment[:, nodes], spin)
    brought = -0.5 * np.diff(time, prepend=time[0]) * (power + np.concatenate([power[:1], power[:-1]]))
    brought += _compute_damping_excess(
        trajectory.energy[:, 2], [stretch.phase.first for stretch in stretches[1:]], time
    )
    brought += _collect_energy_jumps(time, switching.impacts)
    # no preload, an unknown condition, and until the second step nothing left at joints without a drive
    unseen = np.zeros((len(time), m.nv, 0)), np.full(len(time), np.nan), np.empty((0, m.nv))
    loops = LoopForces(reaction, *unseen, tuple(switching.impacts))
    return replace(first, applied=pushed + first.applied, brought=brought, loops=loops, geared=efforts)


def _compute_damping_excess(dissipated: Array, switches: list[int], time: Array) -> Array:
    """Return the excess of the trapezoidal sum of damping in the steps before and after ``switches``, (samples,) [J].

    Strain rates of velocities that jump end long before the next sample: the power dissipated (samples,) [W] in these two steps
    is that of their other ends.
    """
    out = np.zeros(len(time))
    for first in switches:
        out[first] += 0.5 * (time[first] - time[first - 1]) * (dissipated[first] - dissipated[first - 1])
        if first + 1 < len(time):
            out[first + 1] += 0.5 * (time[first + 1] - time[first]) * (dissipated[first] - dissipated[first + 1])
    return out


class PhaseHistory:
    """Stretches and impacts [N s] of the phases of a march that have begun."""

    def __init__(self, mesh: Mesh, phase: Phase, ties: Ties | None) -> None:
        """Let the closures of the first phase act, with the frames [m] that the mechanism states."""
        rows = build_constraint_rows(mesh)
        self.impacts = list[Impact]()
        self.stretches = [Stretch(phase, rows)]
        if ties is not None:
            update_ties(ties, rows, phase.active)

    def begin_phase(
        self, solver: Solver, phase: Phase, joints: Joints, qd: Array, time: float, out: Trajectory
    ) -> None:
        """Go over to another phase at one sample of ``out``, which holds its left-hand limit and gets the right-hand one.

        joints, qd : right-hand limit of the prescribed motion there [m, rad, s]; time [s]
        Raises InputError for frames that have not met or move against each other (`reactions.check_meeting`).
        """
        mesh = solver.mesh
        s = solver.state
        sample = phase.first
        one = NodalMotion(*(part.copy() for part in out.take_samples(sample, sample + 1).motion.parts))
        stretch, begins = _begin_stretch(mesh, self.stretches[-1], phase, one, time)
        # the rest, below `reactions.APART`: the next step shall not jerk it away
        rows = move_second_frames(mesh.mechanism, build_constraint_rows(mesh), stretch.rows, one, begins)
        self.stretches.append(Stretch(phase, rows))
        update_ties(solver.border.ties, rows, phase.active)
        s.u[:], s.du[:] = s.u0, s.du0
        before = _collect_rates(solver, qd)
        impulses = solver.apply_impact(joints)
        begin_from_state(s)
        solver.solve_instant(ACCELERATIONS, joints, f"at t = {time:g} s")
        write_instant(solver, sample, out)
        if _is_plastic(mesh, begins):
            two = out.take_samples(sample, sample + 1).motion
            after = _collect_rates(solver, qd)
            sides = ((one, before), (two, after))
            pushed = compute_closure_wrenches(mesh, two, rows, impulses[None])[0]
            self.impacts.append(
                make_impact(mesh, rows, begins, sides, compute_impulses(mesh, sides, pushed), impulses, time)
            )


def _collect_rates(solver: Solver, qd: Array) -> Array:
    """Rates (nv,) of all joints now: the prescribed ones, and those of the passive joints among the unknowns."""
    coordinate_map = build_coordinate_map(solver.mesh, solver.topology)
    return np.where(coordinate_map.any(axis=1), coordinate_map @ solver.state.u, qd)
