"""Where the march starts: undeformed, at rest under gravity and loads, and with the accelerations that belong to it."""

from __future__ import annotations

import numpy as np

from flexinv.assemble import State
from flexinv.integrate import ACCELERATIONS, STATICS
from flexinv.joint import Relative, relative_motion
from flexinv.march import CONVERGED
from flexinv.mechanism import Array
from flexinv.mesh import CONTINUOUS, Mesh
from flexinv.nodal import NodalMotion
from flexinv.rigid import carried
from flexinv.solver import Solver
from flexinv.tree import Joints, carry_samples


def instant(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> Joints:
    """Return the relative motion of all nodes at one instant, q (nq,), qd, qdd (nv,) [m, rad, s]."""
    return _only(relative_motion(mesh, q[None], qd[None], qdd[None]))


def _only(relative: Relative) -> Joints:
    return Joints(*(np.ascontiguousarray(part[0]) for part in relative))


def start_undeformed(solver: Solver, q: Array, qd: Array, qdd: Array) -> Joints:
    """Set the unknowns to the rigid motion of the stress-free mechanism at one instant [m, rad, s]; return that of its joints."""
    mesh, t = solver.mesh, solver.topology
    for n in np.flatnonzero((t.freedoms == 1) & (mesh.q_index >= 0)):
        i = mesh.q_index[n]
        angle = np.arctan2(q[i + 1], q[i]) if mesh.kind[n] == CONTINUOUS else q[i]
        solver.state.place[t.offset[t.block[n]] + t.column[n]] = angle
    relative = relative_motion(mesh, q[None], qd[None], qdd[None])
    joints = _only(relative)
    _start(solver, carried(mesh, relative), joints, qd, qdd)
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


def accept(s: State) -> None:
    """Let a step start from the present velocities [m/s] and accelerations [m/s^2]."""
    s.u0[:], s.du0[:], s.pseudo[:] = s.u, s.du, s.du
    s.d[:] = 0.0


def consistent_accelerations(solver: Solver, joints: Joints, when: str) -> None:
    """Find the accelerations [m/s^2], [rad/s^2] that the present state of motion has, and start the integrator with them."""
    status, count, size = solver.newton(ACCELERATIONS, joints)
    if status != CONVERGED:
        raise solver.complain(status, count, size, when)
    accept(solver.state)


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
    world = (motion.x, motion.rotation, motion.v, motion.omega, motion.a, motion.alpha)
    carry_samples(mesh.parent, *world, *(part[None] for part in joints))
