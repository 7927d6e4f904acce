"""A steady motion: joints turn at constant rates, all else stands still in the axes that turn along; and its linearisation.

About such a motion the residual r of the march depends on small changes of the unknowns d, their rates u and u'.  With y seen in
the turning axes (angular velocity W, world; w = R^T W in the node's own frame),

    du = y' + A y         A = (skew W, skew w) for the position and the rotation of a node
    du' = y'' + B y' + D y        B = (2 skew W, skew w),  D = (skew W skew W, 0)

so that r = 0 becomes  M y'' + C y' + K y = 0  with constant matrices

    M = dr/du'      C = dr/du + M B   (gyroscopic terms and damping)      K = dr/dd + dr/du A + M D   (with pre-stress and W^2)

Where nothing turns these are the matrices of `natural_modes`.  The deformed shape is found by Newton with this very K.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexinv.dynamics.generalized_alpha import DYNAMIC, STATICS
from flexinv.dynamics.initial_state import instant
from flexinv.dynamics.linearization import Matrices, matrices
from flexinv.dynamics.solver import Solver
from flexinv.dynamics.stepper import INCREMENT, MOST_ITERATIONS
from flexinv.errors import ConvergenceError, InputError
from flexinv.kinematics.mesh import Mesh, attachment_node
from flexinv.kinematics.tree import Joints
from flexinv.linearized.natural_modes import (
    REDUNDANT,
    allowed_motions,
    closing_forces,
    constraints,
    load_springs,
    rest,
    scaled_gradient,
    tied_matrices,
    update_start,
)
from flexinv.model.joint_kinds import KINDS, SECTION
from flexinv.model.mechanism import WORLD, Closure, Joint, Mechanism, Spring
from flexinv.typing import Array

# Rates are raised from zero in steps that are halved at most this often.
MOST_HALVINGS = 8
# Gravity or a load across the axis by more than this part of itself is no rounding of an axis.
ACROSS = 1e-9


@dataclass(frozen=True)
class Turning:
    """Steady rotation of every node: rate W (nodes, 3) [rad/s] world, about centre (nodes, 3) [m]."""

    rate: Array
    centre: Array


@dataclass(frozen=True)
class Steady:
    """The linearisation M y'' + C y' + K y = effort about a steady motion, in the unknowns of the march.

    solver : at the motion; mass, damping, stiffness : (unknowns, unknowns), in metres and radians; residual : (unknowns,) that
        outside efforts hold in free joints [N], [N m]
    """

    solver: Solver
    mass: Array
    damping: Array
    stiffness: Array
    residual: Array


def steady_motion(mesh: Mesh, q: Array, rates: Mapping[str, float], free: set[str]) -> Steady:
    """Return the linearisation about a mechanism that turns steadily, joints at q (nq,) [rad], [m], some at ``rates`` [rad/s].

    free : joints that move about the steady motion; what holds them there is taken as a constant effort

    Raises InputError where the motion cannot be steady, ConvergenceError where no deformed shape is found.
    """
    spun = _spinning(mesh.mechanism, rates)
    nodes = [_beyond(mesh, mesh.joint_node[joint.name]) for joint in spun]
    for joint, beyond in zip(spun, nodes, strict=True):
        _check_steady(mesh, joint, beyond, [j for j in spun if j is not joint])
    solver = Solver.of(mesh, free)
    joints = rest(solver, q)
    if any(rates.values()):
        held = solver if mesh.mechanism.closures else Solver.of(mesh, set())
        if held is not solver:
            rest(held, q)
        if len(held.topology.scale):
            _settle(held, q, rates)
        sections = solver.topology.independent
        solver.state.x[sections], solver.state.r[sections] = held.state.x[sections], held.state.r[sections]
        joints = _set_rates(solver, q, rates, 1.0)
    solver.evaluate(STATICS, joints)
    turning = _turning(solver, rates, 1.0)
    _move_along(solver, turning)
    found = _matrices(tied_matrices(solver, joints), solver, turning)
    solver.evaluate(STATICS._replace(mode=DYNAMIC), joints)
    # what outside efforts hold: forces in closures are none
    return Steady(solver, *found, solver.work.residual[0].copy())


def _spinning(mechanism: Mechanism, rates: Mapping[str, float]) -> list[Joint]:
    for name, rate in rates.items():
        turning = [j.name for j in mechanism.joints if j.nv == 1 and KINDS[j.kind].repeats]
        if name not in turning:
            known = ", ".join(turning)
            raise InputError(f"rate of joint {name!r}: '{mechanism.name}' turns by {known or 'no revolute joint'}")
        if not np.isfinite(rate):
            raise InputError(f"rate of joint {name!r} is {rate}, expected a finite number [rad/s]")
    return [j for j in mechanism.joints if rates.get(j.name, 0.0) != 0.0]


def _beyond(mesh: Mesh, node: int) -> NDArray[np.bool_]:
    """(nodes,) bool: which nodes a joint's node carries, itself among them."""
    out: NDArray[np.bool_] = np.arange(mesh.size) == node
    for n in range(node + 1, mesh.size):
        out[n] = mesh.parent[n] >= 0 and out[mesh.parent[n]]
    return out


def _check_steady(mesh: Mesh, joint: Joint, beyond: NDArray[np.bool_], others: list[Joint]) -> None:
    """Refuse what would change in the axes that turn along."""
    m, at, why = mesh.mechanism, mesh.joint_node[joint.name], ""
    above = int(mesh.parent[at])
    while above >= 0:
        if mesh.kind[above] == SECTION:
            why = f"its axis is carried by a beam ('{m.links[int(mesh.link[above])].name}')"
        above = int(mesh.parent[above])
    for other in others:
        if beyond[mesh.joint_node[other.name]]:
            why = f"joint '{other.name}', which it carries, turns too"
    tied: list[Closure | Spring] = [*m.closures, *m.springs]
    for what in tied:
        ends = [attachment_node(mesh, end) for end in (what.first, what.second) if end.link != WORLD]
        turns = [bool(beyond[n]) for n in ends] + [False] * (2 - len(ends))
        if turns[0] != turns[1]:
            why = f"'{what.name}' ties what turns to what does not"
    if why:
        raise InputError(f"joint '{joint.name}' of '{m.name}' cannot turn steadily: {why}")


def _check_across(mesh: Mesh, joint: Joint, axis: Array) -> None:
    """Refuse gravity and dead loads that are not along the axis of rotation."""
    m, beyond = mesh.mechanism, _beyond(mesh, mesh.joint_node[joint.name])
    loads: list[tuple[str, Array]] = [(f.name, part) for f in m.forces for part in f.wrench.reshape(-1, 3)
             if not f.follower and f.at.link != WORLD and beyond[attachment_node(mesh, f.at)]]  # fmt: skip
    for what, vector in [("gravity", m.gravity), *loads]:
        across = np.linalg.norm(np.cross(axis, vector))
        if across > ACROSS * max(float(np.linalg.norm(vector)), np.finfo(float).tiny):
            raise InputError(
                f"joint '{joint.name}' of '{m.name}' cannot turn steadily: {what} {np.round(vector, 6).tolist()} is not along "
                f"its axis {np.round(axis, 6).tolist()}; write it along the axis, or zero"
            )


def _set_rates(solver: Solver, q: Array, rates: Mapping[str, float], part: float) -> Joints:
    """Give joints a part of their rates; return their relative motion."""
    mesh, t = solver.mesh, solver.topology
    qd = np.zeros(mesh.mechanism.nv)
    for name, rate in rates.items():
        qd[mesh.mechanism.v_slices[name]] = part * rate
    for n in np.flatnonzero(t.freedoms == 1):
        solver.state.u[t.offset[t.block[n]] + t.column[n]] = qd[mesh.v_index[n]]
    return instant(mesh, q, qd, np.zeros(mesh.mechanism.nv))


def _turning(solver: Solver, rates: Mapping[str, float], part: float) -> Turning:
    mesh = solver.mesh
    out = Turning(np.zeros((mesh.size, 3)), np.zeros((mesh.size, 3)))
    for name, rate in rates.items():
        if rate:
            node = mesh.joint_node[name]
            axis = solver.frames.r[node] @ mesh.axis[node]
            _check_across(mesh, mesh.mechanism.joint_of[name], axis)
            beyond = _beyond(mesh, node)
            out.rate[beyond], out.centre[beyond] = part * rate * axis, solver.frames.x[node]
    return out


def _move_along(solver: Solver, turning: Turning) -> None:
    """Give the sections the velocities and accelerations of the steady motion: W x r, W x (W x r)."""
    t, s = solver.topology, solver.state
    for n in np.flatnonzero(t.independent):
        o, w = t.offset[t.block[n]], turning.rate[n]
        v = np.cross(w, s.x[n] - turning.centre[n])
        s.u[o : o + 6] = np.concatenate([v, s.r[n].T @ w])
        s.du[o : o + 6] = np.concatenate([np.cross(w, v), np.zeros(3)])


def _settle(solver: Solver, q: Array, rates: Mapping[str, float]) -> None:
    """Find the deformed shape, rates raised from zero in steps as large as converge."""
    x, r, place = (part.copy() for part in (solver.state.x, solver.state.r, solver.state.place))
    solver.evaluate(STATICS, _set_rates(solver, q, rates, 0.0))
    reached, step = 0.0, 1.0
    while reached < 1.0:
        part = min(1.0, reached + step)
        try:
            _newton(solver, _set_rates(solver, q, rates, part), _turning(solver, rates, part))
        except ConvergenceError:
            solver.state.x[:], solver.state.r[:], solver.state.place[:] = x, r, place
            step *= 0.5
            if step < 0.5**MOST_HALVINGS:
                raise
            continue
        x, r, place = (part.copy() for part in (solver.state.x, solver.state.r, solver.state.place))
        reached = part


def _newton(solver: Solver, joints: Joints, turning: Turning) -> None:
    n, ties, size = constraints(solver), solver.border.ties, 0.0
    for _ in range(MOST_ITERATIONS):
        _move_along(solver, turning)
        load_springs(solver, joints)
        stiffness = _matrices(matrices(solver, joints), solver, turning).stiffness
        residual = solver.work.residual[0].copy()
        y = _increment(solver, stiffness, residual)
        ties.multiplier[:n] += closing_forces(solver, residual + stiffness @ y)
        if not np.isfinite(y).all():
            break
        update_start(solver.topology, STATICS, solver.state, y)
        size = float(np.abs(y / solver.topology.scale).max(initial=0.0))
        if size < INCREMENT:
            return
    raise ConvergenceError(
        f"mechanism '{solver.mesh.mechanism.name}': no steady shape at {np.abs(turning.rate).max():.6g} rad/s: Newton's "
        f"increment is still {size:.1e} after {MOST_ITERATIONS} iterations; it may be unstable there, or need more elements"
    )


def _increment(solver: Solver, stiffness: Array, residual: Array) -> Array:
    """y (unknowns,) of  K y - G^T dlambda = -r,  G y = -phi: what closes the loops, and then the motions that they allow.

    All in unknowns over their scales: metres of a small mechanism stand beside radians.
    """
    scale, free = solver.topology.scale, allowed_motions(solver)
    g, rows = scaled_gradient(solver)
    phi = solver.border.ties.value[: len(rows)]
    y = scale * np.linalg.lstsq(g, -phi / rows, rcond=REDUNDANT)[0] if len(rows) else np.zeros(len(scale))
    inner = free.T @ stiffness @ free
    try:
        return np.asarray(y - free @ np.linalg.solve(inner, free.T @ (residual + stiffness @ y)))
    except np.linalg.LinAlgError:
        return np.full(len(scale), np.nan)


def _matrices(found: Matrices, solver: Solver, turning: Turning) -> Matrices:
    """M, C and K in the axes that turn along, from those of the march's unknowns."""
    a, b, d = _carried(solver, turning)
    by_acceleration, by_rate, by_place = found
    damping, stiffness = by_rate + by_acceleration @ b, by_place + by_rate @ a + by_acceleration @ d
    return Matrices(by_acceleration, damping, stiffness)


def _carried(solver: Solver, turning: Turning) -> tuple[Array, Array, Array]:
    """A, B and D of the head of this file, (unknowns, unknowns)."""
    t, r = solver.topology, solver.state.r
    a, b, d = (np.zeros((len(t.scale), len(t.scale))) for _ in range(3))
    for n in np.flatnonzero(t.independent):
        o = t.offset[t.block[n]]
        place, turn = slice(o, o + 3), slice(o + 3, o + 6)
        world, own = _skew(turning.rate[n]), _skew(r[n].T @ turning.rate[n])
        a[place, place], a[turn, turn] = world, own
        b[place, place], b[turn, turn] = 2 * world, own
        d[place, place] = world @ world
    return a, b, d


def _skew(w: Array) -> Array:
    return np.cross(np.eye(3), w)
