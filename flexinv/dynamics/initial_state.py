"""Initial states of a time integration: undeformed, in static equilibrium or moving, with consistent accelerations."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexinv.dynamics import generalized_alpha as integrator
from flexinv.dynamics.generalized_alpha import (
    ACCELERATIONS,
    RESOLVED,
    STATICS,
    Scheme,
    build_generalized_alpha,
    is_sudden,
)
from flexinv.dynamics.solver import Solver, build_coordinate_map
from flexinv.dynamics.stepper import CONVERGED, NOT_CONVERGED
from flexinv.dynamics.system import State
from flexinv.errors import ConvergenceError
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import (
    NodalMotion,
    compute_relative_motion,
    compute_rigid_motion,
    list_sliding_coordinates,
)
from flexinv.kinematics.tree import Joints
from flexinv.model.joint_kinds import CONTINUOUS
from flexinv.typing import Array

Failure = tuple[int, int, float]  # what `Solver.solve_newton` returns

CERTAIN = 30.0  # times what the last digit of places does: accelerations beyond that are no rounding


def compute_joint_motion(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> Joints:
    """Return the relative motion of all nodes at one instant, q (nq,), qd, qdd (nv,) [m, rad, s]."""
    return Joints(*(part[0] for part in compute_relative_motion(mesh, q[None], qd[None], qdd[None])))


def begin_undeformed(solver: Solver, q: Array, qd: Array, qdd: Array) -> Joints:
    """Set the unknowns to the rigid motion of the stress-free mechanism at one instant [m, rad, s]; return that of its joints."""
    mesh = solver.mesh
    t = solver.topology
    for n in np.flatnonzero((t.freedoms == 1) & (mesh.q_index >= 0)):
        i = mesh.q_index[n]
        angle = np.arctan2(q[i + 1], q[i]) if mesh.kind[n] == CONTINUOUS else q[i]
        solver.state.place[t.first[n] + t.column[n]] = angle
    joints = compute_joint_motion(mesh, q, qd, qdd)
    fill_initial_unknowns(solver, compute_rigid_motion(mesh, q[None], qd[None], qdd[None]), joints, qd, qdd)
    return joints


def fill_initial_unknowns(solver: Solver, motion: NodalMotion, joints: Joints, qd: Array, qdd: Array) -> None:
    """Set the unknowns and their rates [m, rad, s] to a motion of all nodes at one sample, and of the joints by qd, qdd (nv,)."""
    t = solver.topology
    s = solver.state
    moved = build_coordinate_map(solver.mesh, solver.topology)
    free = np.flatnonzero(t.independent)
    held = t.freedoms > 0
    at = t.first[free, None] + np.arange(6)
    s.x[free] = motion.x[0, free]
    s.r[free] = motion.rotation[0, free]
    s.x[held] = joints.p[held]
    s.r[held] = joints.r[held]
    s.u[:] = qd @ moved
    s.du[:] = qdd @ moved
    s.u[at] = np.concatenate([motion.v[0, free], motion.omega[0, free]], axis=1)
    s.du[at] = np.concatenate([motion.a[0, free], motion.alpha[0, free]], axis=1)
    for n in np.flatnonzero(t.triple == 3):  # of a free joint the march takes p' in the joint frame
        rows = t.first[n] + t.column[n] + np.arange(3)
        s.u[rows] = joints.dp[n] @ solver.mesh.rotation[n]
        s.du[rows] = joints.ddp[n] @ solver.mesh.rotation[n]
    begin_from_state(s)


def begin_from_state(state: State) -> None:
    """Let a step start from the present velocities [m/s] and accelerations [m/s^2]."""
    state.u0[:], state.du0[:], state.pseudo[:] = state.u, state.du, state.du
    drop_increments(state)


def drop_increments(state: State) -> None:
    """Let nothing be known of a step: no increments [m], [rad] and no trend of them."""
    for part in (state.d, state.trend, state.bend, state.order):
        part[:] = 0


def begin_step(solver: Solver, joints: Joints, scheme: Scheme, when: str) -> bool:
    """Let the next step start from the accelerations that were found last, as far as a step of the ``scheme`` resolves them.

    What it does not resolve keeps the accelerations of before [m/s^2], [rad/s^2], which are those at the start of the step or of
    the rigid motion: a stiff mode that something sudden excites follows it quasi-statically.
    Return whether that leaves too much out (`generalized_alpha.SUDDEN`): then the first steps are made in parts.
    """
    s = solver.state
    multiplier = solver.border.ties.multiplier
    found = s.du.copy()
    forces = multiplier.copy()
    sudden = False
    scale = solver.topology.scale
    if (scheme.h**2 * np.abs(found - s.du0) / scale).max(initial=0.0) > integrator.START_ROUNDING:
        s.du[:] = s.du0
        for _ in range(integrator.PASSES):
            solver.solve_instant(scheme._replace(mode=RESOLVED), joints, when)
        sudden = is_sudden(scheme, scale, found, s.du)
        left = np.abs((found - s.du) / scale).max()
        sudden = sudden and not left <= CERTAIN * _compute_rounding_effect(solver, joints, found)
    if not sudden:
        s.du[:] = found
        multiplier[:] = forces
    begin_from_state(s)
    return sudden


def _compute_rounding_effect(solver: Solver, joints: Joints, values: Array) -> float:
    """Return by how much accelerations, over the length or in radians [1/s^2], change where nodes move by their last digit.

    So far the accelerations ``values`` are known where the mechanism stands.  The unknowns are left as they were.
    """
    s = solver.state
    multiplier = solver.border.ties.multiplier
    before = [part.copy() for part in (s.x, s.du, multiplier)]
    last = np.finfo(float).eps * solver.mesh.length
    s.x[::2], s.x[1::2], s.du[:] = s.x[::2] + last, s.x[1::2] - last, values
    status, _, _ = solver.solve_newton(ACCELERATIONS, joints)
    change = float(np.abs((s.du - values) / solver.topology.scale).max(initial=0.0)) if status == CONVERGED else 0.0
    for part, kept in zip((s.x, s.du, multiplier), before, strict=True):
        part[:] = kept
    return change


def end_early(state: Any) -> None:
    """Go on with another scheme: in space or in a plane it starts from the present accelerations [m/s^2], [rad/s^2]."""
    state.pseudo[:] = state.du0
    state.trend[:] = 0.0
    state.bend[:] = 0.0
    state.order[:] = 0


# A load step is halved at most this often before the equilibrium is called unreachable.
MOST_HALVINGS = 12
# The first step [-], in times in which the mechanism falls its own length.  One that fails, climbs or goes too far is made again
# with a quarter of it, at most MOST_SHORTER times from the first; one that goes less than half as far as it may is followed by
# one of four times its length.
FIRST_STEP = 0.25
STEP_FACTOR = 4.0
MOST_SHORTER = 16
# How far a step may go, over the mechanism's length or in radians: farther, and it could miss a rest position that lies between.
LONGEST_MOVE = 0.5
# Where a step goes less than NEAR_REST, Newton's method is asked for the rest position itself; below STILL nothing moves.
NEAR_REST = 1e-3
STILL = 1e-10
# Newton's last increment closes loops a little better, up or down, whatever the step: no climb.  That of a slider-crank of 1 mm
# is 3.6e-9, as the search for a rest position before it stops where increments of less than 1e-8 no longer shrink.
CLOSING = 1e-8
# Leaving an unstable position by a part of 1e-10 takes some fifty steps.
MOST_STEPS = 500


def find_equilibrium(solver: Solver, q: Array, when: str) -> Joints:
    """Find the rest position under gravity, springs and the solver's loads [N], [N m] that belongs to the starting position.

    Where every joint is held the loads are raised from zero in steps as large as converge.  With passive joints there are several
    rest positions: every caller gets the one to which the mechanism sinks from its start (`_find_rest_position`).

    The unknowns must hold a starting position, and are at rest afterwards; returns the relative motion of the prescribed joints.
    Raises ConvergenceError, naming what was reached.
    """
    nv = solver.mesh.mechanism.nv
    joints = compute_joint_motion(solver.mesh, q, np.zeros(nv), np.zeros(nv))
    solver.state.u[:] = 0.0
    solver.state.du[:] = 0.0
    if solver.topology.freedoms.any():
        _find_rest_position(solver, joints, when)
        return joints
    level = solver.loads.level
    reached = 0.0
    part = 1.0
    while reached < 1.0:
        level[0] = min(1.0, reached + part)
        status, count, size = solver.solve_newton(STATICS, joints)
        if status == CONVERGED:
            reached = float(level[0])
            part = 2 * part
            continue
        solver.state.d[:] = 0.0
        part = 0.5 * part
        if part < 0.5**MOST_HALVINGS:
            raise solver.make_step_error(status, count, size, f"{when}, {reached:.1%} of the load")
    return joints


def _find_rest_position(solver: Solver, joints: Joints, when: str) -> None:
    """Bring a mechanism at rest under its whole load [N], [N m] to the rest position below it; the unknowns change.

    A step of h from rest, with a scheme that keeps no rates, ends where  f(x + d) = 2 M d / h^2:  a step down the slope of the
    energy that is short where h is short, and leads to a rest position where h is long.  A step that would climb, f(x) d < 0, is
    made shorter.  So a mechanism comes to rest below where it starts, and passes by what it would fall from (proximal point
    method; Rockafellar, *Monotone operators and the proximal point algorithm*, SIAM J. Control Optim. 14, 1976). Where nothing
    holds a joint and nothing moves it (a vertical axis), it stays where it is. Raises ConvergenceError where no step succeeds, or
    where the mechanism moves on and on: nothing holds it, or a force that turns along drives it.
    """
    solver.loads.level[0] = 1.0
    gravity = float(np.linalg.norm(solver.topology.gravity))
    longest = FIRST_STEP * (np.sqrt(2 * solver.mesh.length / gravity) if gravity > 0.0 else 1.0)
    step = longest
    shortest = longest / STEP_FACTOR**MOST_SHORTER
    begin = solver.state.place.copy()
    last = np.zeros(len(begin))
    for _ in range(MOST_STEPS):
        before = solver.state.place.copy()
        moved, failed = _move_one_step(solver, joints, build_generalized_alpha(step, 0.0), LONGEST_MOVE)
        if moved is None:
            step /= STEP_FACTOR
            if step < shortest:
                raise solver.make_step_error(*failed, f"{when}, on the way down to a rest position")
            continue
        last = solver.state.place - before
        # Close by Newton's method may find the rest position; where a motion is free of forces, standing still will do.
        if moved < NEAR_REST and _move_one_step(solver, joints, STATICS, STEP_FACTOR * NEAR_REST)[0] is not None:
            return
        if step >= longest and moved < STILL:
            return
        step *= STEP_FACTOR if moved < LONGEST_MOVE / 2 else 1.0
    raise _make_motion_error(solver, solver.state.place - begin, last, when)


def _make_motion_error(solver: Solver, way: Array, last: Array, when: str) -> ConvergenceError:
    """Return the error of a mechanism that moves on and on, with the joint that moves most.

    way, last : (unknowns,) what the unknowns have moved by in all, and in the last step that was kept [rad], [m]
    """
    mechanism = solver.mesh.mechanism
    of_joints = build_coordinate_map(solver.mesh, solver.topology)
    most = int(np.abs(of_joints @ (last / solver.topology.scale)).argmax())
    name = next(name for name, columns in mechanism.v_slices.items() if columns.start <= most < columns.stop)
    unit = "m" if list_sliding_coordinates(mechanism)[most] else "rad"
    moved = f"has moved by {abs(of_joints[most] @ way):.3g} {unit} in {MOST_STEPS} steps"
    moves = f"moves on, by {abs(of_joints[most] @ last):.2g} {unit} in the last one"
    return ConvergenceError(
        f"mechanism '{mechanism.name}', {when}, on the way down to a rest position: joint '{name}' {moved} and {moves}: "
        "nothing holds it, or a force that turns along drives it; give it a stiffness, hold it, or write other loads"
    )


def _move_one_step(solver: Solver, joints: Joints, scheme: Scheme, farthest: float) -> tuple[float | None, Failure]:
    """Make one step from rest; return how far it went [-], None (and why) where it failed, went too far or climbed."""
    s = solver.state
    multiplier = solver.border.ties.multiplier
    s.u[:] = 0.0
    s.du[:] = 0.0
    begin_from_state(s)
    before = [part.copy() for part in (s.x, s.r, s.place, multiplier)]
    solver.evaluate(STATICS, joints)
    load = -solver.work.residual[0]
    failed = solver.solve_newton(scheme, joints)
    gone = s.place - before[2]
    moved = float(np.abs(gone / solver.topology.scale).max(initial=0.0))
    s.u[:] = 0.0
    s.du[:] = 0.0
    begin_from_state(s)
    if failed[0] == CONVERGED and moved <= farthest and (moved < CLOSING or float(load @ gone) >= 0.0):
        return moved, failed
    for part, kept in zip((s.x, s.r, s.place, multiplier), before, strict=True):
        part[:] = kept
    return None, (NOT_CONVERGED, failed[1], moved) if failed[0] == CONVERGED else failed
