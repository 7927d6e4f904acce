"""Initial states of a time integration: undeformed, in static equilibrium or moving, with consistent accelerations."""

from __future__ import annotations

import numpy as np

from flexinv.dynamics.generalized_alpha import ACCELERATIONS, PASSES, ROUNDING, STATICS, Scheme, filtering, is_sudden
from flexinv.dynamics.solver import Solver
from flexinv.dynamics.stepper import CONVERGED
from flexinv.dynamics.system import State
from flexinv.kinematics.joint_motion import relative_motion
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.rigid_motion import rigid_motion
from flexinv.kinematics.tree import Frames, Joints, carry_samples
from flexinv.model.joint_kinds import CONTINUOUS
from flexinv.typing import Array


def instant(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> Joints:
    """Return the relative motion of all nodes at one instant, q (nq,), qd, qdd (nv,) [m, rad, s]."""
    return Joints(*(part[0] for part in relative_motion(mesh, q[None], qd[None], qdd[None])))


def start_undeformed(solver: Solver, q: Array, qd: Array, qdd: Array) -> Joints:
    """Set the unknowns to the rigid motion of the stress-free mechanism at one instant [m, rad, s]; return that of its joints."""
    mesh, t = solver.mesh, solver.topology
    for n in np.flatnonzero((t.freedoms == 1) & (mesh.q_index >= 0)):
        i = mesh.q_index[n]
        angle = np.arctan2(q[i + 1], q[i]) if mesh.kind[n] == CONTINUOUS else q[i]
        solver.state.place[t.offset[t.block[n]] + t.column[n]] = angle
    joints = instant(mesh, q, qd, qdd)
    _start(solver, rigid_motion(mesh, q[None], qd[None], qdd[None]), joints, qd, qdd)
    return joints


def _start(solver: Solver, motion: NodalMotion, joints: Joints, qd: Array, qdd: Array) -> None:
    t, s = solver.topology, solver.state
    for n in range(solver.mesh.size):
        o = t.offset[t.block[n]]
        if t.independent[n]:
            s.x[n], s.r[n] = motion.x[0, n], motion.rotation[0, n]
            s.u[o : o + 6] = np.concatenate([motion.v[0, n], motion.omega[0, n]])
            s.du[o : o + 6] = np.concatenate([motion.a[0, n], motion.alpha[0, n]])
        elif t.freedoms[n]:
            s.x[n], s.r[n] = joints.p[n], joints.r[n]
            own = slice(o + t.column[n], o + t.column[n] + t.freedoms[n])
            v = int(solver.mesh.v_index[n])
            s.u[own], s.du[own] = _passive_rates(
                solver, n, joints, qd[v : v + t.freedoms[n]], qdd[v : v + t.freedoms[n]]
            )
    accept(s)


def _passive_rates(solver: Solver, n: int, joints: Joints, qd: Array, qdd: Array) -> tuple[Array, Array]:
    """Rates of a passive joint in the march's own coordinates: a free joint's p' is taken in the joint frame."""
    t = solver.topology
    if t.triple[n] != 3:
        return qd, qdd
    placed = solver.mesh.rotation[n]
    return np.concatenate([placed.T @ joints.dp[n], qd[3:]]), np.concatenate([placed.T @ joints.ddp[n], qdd[3:]])


def accept(state: State) -> None:
    """Let a step start from the present velocities [m/s] and accelerations [m/s^2]."""
    state.u0[:], state.du0[:], state.pseudo[:] = state.u, state.du, state.du
    state.d[:] = 0.0


def consistent_accelerations(solver: Solver, joints: Joints, when: str) -> None:
    """Find the accelerations [m/s^2], [rad/s^2] that the present state of motion has; `begin_step` starts the integrator."""
    status, count, size = solver.newton(ACCELERATIONS, joints)
    if status != CONVERGED:
        raise solver.complain(status, count, size, when)


def begin_step(solver: Solver, joints: Joints, scheme: Scheme, when: str) -> bool:
    """Let the next step start from the accelerations that were found last, as far as a step of the ``scheme`` resolves them.

    What it does not resolve keeps the accelerations of before [m/s^2], [rad/s^2], which are those at the start of the step or of
    the rigid motion: a stiff mode that something sudden excites follows it quasi-statically.
    Return whether that leaves too much out (`generalized_alpha.SUDDEN`): then the first steps are made in parts.
    """
    s, multiplier = solver.state, solver.border.ties.multiplier
    found, forces = s.du.copy(), multiplier.copy()

    sudden, scale = False, solver.topology.scale
    if (scheme.h**2 * np.abs(found - s.du0) / scale).max(initial=0.0) > ROUNDING:
        s.du[:] = s.du0
        for _ in range(PASSES):
            status, count, size = solver.newton(filtering(scheme), joints)
            if status != CONVERGED:
                raise solver.complain(status, count, size, when)
        sudden = is_sudden(scheme, scale, found, s.du)
    if not sudden:
        s.du[:], multiplier[:] = found, forces
    accept(s)
    return sudden


def end_early(state: State) -> None:
    """Go on with another scheme: it starts from the present accelerations [m/s^2], [rad/s^2]."""
    state.pseudo[:] = state.du0


# A load step is halved at most this often before the equilibrium is called unreachable.
MOST_HALVINGS = 12


def equilibrium(solver: Solver, q: Array, when: str) -> Joints:
    """Find the rest position under gravity, springs and the solver's loads, raised from zero in steps as large as converge [N].

    The unknowns must hold a starting position, and are at rest afterwards; returns the relative motion of the prescribed joints.
    Raises ConvergenceError, naming the part of the load that was reached.
    """
    nv = solver.mesh.mechanism.nv
    joints = instant(solver.mesh, q, np.zeros(nv), np.zeros(nv))
    level, state = solver.loads.level, solver.state
    state.u[:], state.du[:] = 0.0, 0.0
    reached, part = 0.0, 1.0
    while reached < 1.0:
        level[0] = min(1.0, reached + part)
        status, count, size = solver.newton(STATICS, joints)
        if status == CONVERGED:
            reached, part = float(level[0]), 2 * part
            continue
        state.d[:] = 0.0
        part *= 0.5
        if part < 0.5**MOST_HALVINGS:
            raise solver.complain(status, count, size, f"{when}, {reached:.1%} of the load")
    return joints


def settle_held(solver: Solver, q: Array, time: float, when: str) -> bool:
    """Put a mechanism that torques move into its equilibrium at a time [s] with all driven joints held at q (nq,) [rad], [m].

    Were they free, joints with nothing to hold them (a vertical axis) would have no one equilibrium, and a first torque seldom
    is just what holds the others.  False where nothing is left that could settle.
    """
    mesh, t = solver.mesh, solver.topology
    still = np.zeros(mesh.mechanism.nv)
    held = Solver.of(mesh, {j.name for j in mesh.mechanism.joints if j.nv and not j.actuated})
    if not len(held.topology.scale):
        return False
    acting, own = held.border.ties, solver.border.ties
    acting.acting[:], acting.place_b[:], acting.w[:] = own.acting, own.place_b, own.w
    start_undeformed(held, q, still, still)
    held.load_at(time, q, still, still)
    equilibrium(held, q, when)
    nodes = held.topology.independent | (held.topology.freedoms > 0)
    solver.state.x[nodes], solver.state.r[nodes] = held.state.x[nodes], held.state.r[nodes]
    for n in np.flatnonzero(held.topology.freedoms):
        of, to = (int(part.offset[part.block[n]] + part.column[n]) for part in (held.topology, t))
        solver.state.place[to : to + t.freedoms[n]] = held.state.place[of : of + t.freedoms[n]]
    solver.frames.x[:], solver.frames.r[:] = held.frames.x, held.frames.r
    own.multiplier[:] = acting.multiplier
    return True


def move_as_rigid(solver: Solver, joints: Joints, qd: Array, qdd: Array) -> None:
    """Give the deformed mechanism the velocities [m/s] it has when it moves on without changing its deformation."""
    mesh, frames, t = solver.mesh, solver.frames, solver.topology
    shape = Joints(*(part.copy() for part in joints))
    for n in range(mesh.size):
        m = mesh.parent[n]
        if t.independent[n]:
            shape.p[n] = frames.r[m].T @ (frames.x[n] - frames.x[m])
            shape.r[n] = frames.r[m].T @ frames.r[n]
        elif t.freedoms[n]:
            shape.p[n], shape.r[n] = solver.state.x[n], solver.state.r[n]
    moving = NodalMotion.empty(1, mesh.size)
    _carry_all(mesh, moving, shape)
    _start(solver, moving, shape, qd, qdd)


def _carry_all(mesh: Mesh, motion: NodalMotion, joints: Joints) -> None:
    world = Frames(*motion.parts)
    carry_samples(mesh.parent, world, Joints(*(part[None] for part in joints)))
