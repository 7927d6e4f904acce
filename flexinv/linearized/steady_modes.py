"""A steady motion, joints turning at constant rates, its linearisation, and the complex modes of M y'' + C y' + K y = 0 about it.

All else stands still in the axes that turn along.

About such a motion the residual r of the march depends on small changes of the unknowns d, their rates u and u'.  With y seen in
the turning axes (angular velocity W, world; w = R^T W in the node's own frame),

    du = y' + A y         A = (skew W, skew w) for the position and the rotation of a node
    du' = y'' + B y' + D y        B = (2 skew W, skew w),  D = (skew W skew W, 0)

so that r = 0 becomes  M y'' + C y' + K y = 0  with constant matrices

    M = dr/du'      C = dr/du + M B   (gyroscopic terms and damping)      K = dr/dd + dr/du A + M D   (with pre-stress and W^2)

Where nothing turns these are the matrices of `natural_modes`.  The deformed shape is found by Newton with this very K.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import ArrayLike

from flexinv.constraints.allocation import REDUNDANT
from flexinv.display.card import Card, Shown
from flexinv.dynamics.generalized_alpha import DYNAMIC, STATICS
from flexinv.dynamics.initial_state import compute_joint_motion
from flexinv.dynamics.linearization import Matrices, compute_matrices
from flexinv.dynamics.solver import Solver
from flexinv.dynamics.stepper import INCREMENT, MOST_ITERATIONS
from flexinv.errors import ConvergenceError, InputError
from flexinv.kinematics.mesh import Mesh, find_attachment_node, find_outboard_nodes
from flexinv.kinematics.tree import Joints
from flexinv.linearized.closed_motions import (
    compute_scaled_gradient,
    count_constraints,
    find_allowed_motions,
    solve_closing_forces,
)
from flexinv.linearized.complex_roots import find_roots
from flexinv.linearized.eigenvalues import ONE_AND_ALL
from flexinv.linearized.modal_damping import resolve_damping_ratio
from flexinv.linearized.modes import FEW, SAFETY, Shapes, convert_rates, resolve_setup
from flexinv.linearized.rest_position import (
    compute_nodal_shapes,
    compute_tied_matrices,
    copy_shape,
    find_rest_position,
    update_spring_forces,
    update_start,
)
from flexinv.linearized.slowest_roots import find_slowest_roots
from flexinv.model.joint_kinds import KINDS, SECTION
from flexinv.model.mechanism import WORLD, Closure, Joint, Mechanism, Spring
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Complex, Sparse

# Displacements below this part of the mechanism's length times rotations are rounding of nothing.
TWISTS = 1e-8
# Rates of a coupling whose sum is below this part of the largest agree: decimals of a ratio of teeth.
CONTRADICTS = 1e-9
MOST_HALVINGS = 8  # of steps in which rates are raised from zero
# Gravity or a load across the axis by more than this part of itself is no rounding of an axis.
ACROSS = 1e-9


@dataclass(frozen=True)
class SteadyRotation:
    """Steady rotation of every node: rate W (nodes, 3) [rad/s] world, about centre (nodes, 3) [m]."""

    rate: Array
    centre: Array


@dataclass(frozen=True)
class SteadyLinearisation:
    """The linearisation M y'' + C y' + K y = effort about a steady motion, in the unknowns of the march.

    solver : at the motion; matrices : M, C, K, in metres and radians
    residual : (unknowns,) that outside efforts hold in free joints [N], [N m]
    """

    solver: Solver
    matrices: Matrices
    residual: Array


def build_steady_motion(mesh: Mesh, q: Array, rates: Mapping[str, float], free: set[str]) -> SteadyLinearisation:
    """Return the linearisation about a mechanism that turns steadily, joints at q (nq,) [rad], [m], some at ``rates`` [rad/s].

    free : joints that move about the steady motion; what holds them there is taken as a constant effort
    Raises InputError where the motion cannot be steady, ConvergenceError where no deformed shape is found.
    """
    m = mesh.mechanism
    turning = [j.name for j in m.joints if j.nv == 1 and KINDS[j.kind].repeats]
    for name, rate in rates.items():
        if name not in turning:
            known = ", ".join(turning)
            raise InputError(f"rate of joint {name!r}: '{m.name}' turns by {known or 'no revolute joint'}")
        if not np.isfinite(rate):
            raise InputError(f"rate of joint {name!r} is {rate}, expected a finite number [rad/s]")
    rates = add_coupled_rates(mesh, rates)
    spun = [j for j in m.joints if rates.get(j.name, 0.0) != 0.0]
    for joint in spun:
        if joint.stiffness:
            raise InputError(
                f"joint '{joint.name}' of '{m.name}' cannot turn steadily: its spring ({joint.stiffness:g} N m/rad) winds up; "
                "write its rate as 0, or its stiffness"
            )
        _check_steady(mesh, joint, [other for other in spun if other is not joint])
    solver = Solver.build_for(mesh, free)
    joints, held = find_rest_position(solver, q)
    if any(rates.values()):
        if len(held.topology.scale):
            _find_deformed_shape(held, q, rates)
        copy_shape(held, solver)
        joints = _apply_rates(solver, q, rates, 1.0)
    solver.evaluate(STATICS, joints)
    along = _build_turning(solver, rates, 1.0)
    _move_along(solver, along)
    matrices = _compute_matrices(compute_tied_matrices(solver, joints), solver, along)
    solver.evaluate(STATICS._replace(mode=DYNAMIC), joints)
    # what outside efforts hold: forces in closures are none
    return SteadyLinearisation(solver, matrices, solver.work.residual[0].copy())


def add_coupled_rates(mesh: Mesh, rates: Mapping[str, float]) -> dict[str, float]:
    """Return rates [rad/s] of joints with those that follow from couplings, sum factor rate = 0; joints beside them have none.

    Raises InputError where rates contradict a coupling, where they leave one open, and where a joint would slide along.
    """
    m = mesh.mechanism
    couplings = [closure for closure in m.closures if closure.kind == "coupling"]
    grown = _find_moved_joints(couplings, {name for name, rate in rates.items() if rate != 0.0})
    tied = [closure for closure in couplings if grown & {name for name, _ in closure.factors}]
    if not tied:
        return dict(rates)
    open_ones = sorted(grown - set(rates), key=list(m.joint_of).index)
    out = dict(rates) | _solve_coupled_rates(m, tied, rates, open_ones)
    for closure in tied:
        _check_coupling(m, closure, out)
    for name in grown:
        if out.get(name, 0.0) != 0.0 and not KINDS[m.joint_of[name].kind].repeats:
            raise InputError(
                f"joint '{name}' of '{m.name}' cannot move steadily: it slides along with '{tied[0].name}'"
            )
    return out


def _find_moved_joints(couplings: list[Closure], moving: set[str]) -> set[str]:
    """The joints in couplings that move with those that do."""
    names = [{name for name, _ in closure.factors} for closure in couplings]
    grown = moving & set[str]().union(*names)
    while more := set[str]().union(*(coupled for coupled in names if grown & coupled)) - grown:
        grown |= more
    return grown


def _solve_coupled_rates(
    mechanism: Mechanism, tied: list[Closure], rates: Mapping[str, float], open_ones: list[str]
) -> dict[str, float]:
    """The rates of joints that couplings leave no choice."""
    if not open_ones:
        return {}
    factors = np.array([[dict(c.factors).get(name, 0.0) for name in open_ones] for c in tied]).reshape(len(tied), -1)
    given = np.array([sum(factor * rates.get(name, 0.0) for name, factor in c.factors) for c in tied])
    found = np.linalg.lstsq(factors, -given, rcond=None)[0]
    if np.linalg.matrix_rank(factors) < len(open_ones):
        names = ", ".join(open_ones)
        raise InputError(
            f"rates of '{mechanism.name}': couplings leave the rates of {names} open; write one of them, 0 if it rests"
        )
    return {name: float(rate) for name, rate in zip(open_ones, found, strict=True)}


def _check_coupling(mechanism: Mechanism, closure: Closure, rates: Mapping[str, float]) -> None:
    """Raise InputError where rates contradict a coupling."""
    terms = [factor * rates.get(name, 0.0) for name, factor in closure.factors]
    if abs(sum(terms)) > CONTRADICTS * max(map(abs, terms)):
        said = " + ".join(f"{factor:g} x {rates.get(name, 0.0):g} ('{name}')" for name, factor in closure.factors)
        raise InputError(
            f"rates of '{mechanism.name}' contradict coupling '{closure.name}': {said} = {sum(terms):g} rad/s, expected 0; "
            "write the rate of one joint, the others follow"
        )


def _check_steady(mesh: Mesh, joint: Joint, others: list[Joint]) -> None:
    """Refuse what would change in the axes that turn along."""
    m = mesh.mechanism
    at = mesh.joint_node[joint.name]
    why = ""
    carried = find_outboard_nodes(mesh, at)
    above = int(mesh.parent[at])
    while above >= 0:
        if mesh.kind[above] == SECTION:
            why = f"its axis is carried by a beam ('{m.links[int(mesh.link[above])].name}')"
        above = int(mesh.parent[above])
    for other in others:
        if carried[mesh.joint_node[other.name]]:
            why = f"joint '{other.name}', which it carries, turns too"
    tied: list[Closure | Spring] = [*m.closures, *m.springs]
    for what in tied:
        ends = [find_attachment_node(mesh, end) for end in (what.first, what.second) if end.link != WORLD]
        turns = [bool(carried[n]) for n in ends] + [False] * (2 - len(ends))
        if turns[0] != turns[1]:
            why = f"'{what.name}' ties what turns to what does not"
    if why:
        raise InputError(f"joint '{joint.name}' of '{m.name}' cannot turn steadily: {why}")


def _check_across(mesh: Mesh, joint: Joint, axis: Array) -> None:
    """Refuse gravity and dead loads that are not along the axis of rotation."""
    m = mesh.mechanism
    carried = find_outboard_nodes(mesh, mesh.joint_node[joint.name])
    loads: list[tuple[str, Array]] = [(f.name, part) for f in m.forces for part in f.wrench.reshape(-1, 3)
             if not f.follower and f.at.link != WORLD and carried[find_attachment_node(mesh, f.at)]]  # fmt: skip
    for what, vector in [("gravity", m.gravity), *loads]:
        across = np.linalg.norm(np.cross(axis, vector))
        if across > ACROSS * max(float(np.linalg.norm(vector)), np.finfo(float).tiny):
            raise InputError(
                f"joint '{joint.name}' of '{m.name}' cannot turn steadily: {what} {np.round(vector, 6).tolist()} is not along "
                f"its axis {np.round(axis, 6).tolist()}; write it along the axis, or zero"
            )


def _apply_rates(solver: Solver, q: Array, rates: Mapping[str, float], part: float) -> Joints:
    """Give joints a part of their rates; return their relative motion."""
    mesh = solver.mesh
    t = solver.topology
    qd = np.zeros(mesh.mechanism.nv)
    for name, rate in rates.items():
        qd[mesh.mechanism.v_slices[name]] = part * rate
    for n in np.flatnonzero(t.freedoms == 1):
        solver.state.u[t.first[n] + t.column[n]] = qd[mesh.v_index[n]]
    return compute_joint_motion(mesh, q, qd, np.zeros(mesh.mechanism.nv))


def _build_turning(solver: Solver, rates: Mapping[str, float], part: float) -> SteadyRotation:
    mesh = solver.mesh
    out = SteadyRotation(np.zeros((mesh.size, 3)), np.zeros((mesh.size, 3)))
    for name, rate in rates.items():
        if rate:
            node = mesh.joint_node[name]
            carried = find_outboard_nodes(mesh, node)
            axis = solver.frames.r[node] @ mesh.axis[node]
            _check_across(mesh, mesh.mechanism.joint_of[name], axis)
            out.rate[carried] = part * rate * axis
            out.centre[carried] = solver.frames.x[node]
    return out


def _move_along(solver: Solver, turning: SteadyRotation) -> None:
    """Give the sections the velocities and accelerations of the steady motion: W x r, W x (W x r)."""
    t = solver.topology
    s = solver.state
    for n in np.flatnonzero(t.independent):
        o = t.first[n]
        w = turning.rate[n]
        v = np.cross(w, s.x[n] - turning.centre[n])
        s.u[o : o + 6] = np.concatenate([v, s.r[n].T @ w])
        s.du[o : o + 6] = np.concatenate([np.cross(w, v), np.zeros(3)])


def _find_deformed_shape(solver: Solver, q: Array, rates: Mapping[str, float]) -> None:
    """Find the deformed shape, rates raised from zero in steps as large as converge."""
    x, r, place = (part.copy() for part in (solver.state.x, solver.state.r, solver.state.place))
    solver.evaluate(STATICS, _apply_rates(solver, q, rates, 0.0))
    reached = 0.0
    step = 1.0
    while reached < 1.0:
        part = min(1.0, reached + step)
        try:
            _find_steady_state(solver, _apply_rates(solver, q, rates, part), _build_turning(solver, rates, part))
        except ConvergenceError:
            solver.state.x[:] = x
            solver.state.r[:] = r
            solver.state.place[:] = place
            step *= 0.5
            if step < 0.5**MOST_HALVINGS:
                raise
            continue
        x, r, place = (part.copy() for part in (solver.state.x, solver.state.r, solver.state.place))
        reached = part


def _find_steady_state(solver: Solver, joints: Joints, turning: SteadyRotation) -> None:
    n = count_constraints(solver)
    ties = solver.border.ties
    size = 0.0
    for _ in range(MOST_ITERATIONS):
        _move_along(solver, turning)
        update_spring_forces(solver, joints)
        stiffness = _compute_matrices(compute_matrices(solver, joints), solver, turning).stiffness
        residual = solver.work.residual[0].copy()
        y = _solve_increment(solver, stiffness, residual)
        ties.multiplier[:n] += solve_closing_forces(solver, residual + stiffness @ y)
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


def _solve_increment(solver: Solver, stiffness: Sparse, residual: Array) -> Array:
    """y (unknowns,) of  K y - G^T dlambda = -r,  G y = -phi: what closes the loops, and then the motions that they allow.

    All in unknowns over their scales: metres of a small mechanism stand beside radians.
    """
    scale = solver.topology.scale
    free = find_allowed_motions(solver)
    g, rows = compute_scaled_gradient(solver)
    phi = solver.border.ties.value[: len(rows)]
    y = scale * np.linalg.lstsq(g, -phi / rows, rcond=REDUNDANT)[0] if len(rows) else np.zeros(len(scale))
    inner = scipy.sparse.csc_array(free.T @ stiffness @ free)
    try:
        return np.asarray(y - free @ scipy.sparse.linalg.splu(inner).solve(free.T @ (residual + stiffness @ y)))
    except RuntimeError:  # exactly singular
        return np.full(len(scale), np.nan)


def _compute_matrices(found: Matrices, solver: Solver, turning: SteadyRotation) -> Matrices:
    """M, C and K in the axes that turn along, from those of the march's unknowns, with A, B and D of the head of this file."""
    t = solver.topology
    if not turning.rate.any():
        return found
    by_acceleration, by_rate, by_place = found
    a, b, d = (scipy.sparse.lil_array((len(t.scale), len(t.scale))) for _ in range(3))
    for n in np.flatnonzero(t.independent & turning.rate.any(axis=1)):
        o = t.first[n]
        rate = turning.rate[n]
        place = slice(o, o + 3)
        turn = slice(o + 3, o + 6)
        world, local = (np.cross(np.eye(3), w) for w in (rate, solver.state.r[n].T @ rate))  # skew matrices
        a[place, place] = world
        a[turn, turn] = local
        b[place, place] = 2 * world
        b[turn, turn] = local
        d[place, place] = world @ world
    a, b, d = (scipy.sparse.csc_array(part) for part in (a, b, d))
    damping = by_rate + by_acceleration @ b
    stiffness = by_place + by_rate @ a + by_acceleration @ d
    return Matrices(by_acceleration, damping, stiffness)


# ----------------------------------------------------------------------------------------------- modes


@dataclass(frozen=True, eq=False, repr=False)
class SteadyModes(Shown, Shapes):
    """Small motions Re(shape exp(root t)) about a steady motion, seen in the axes that turn along, slowest first.

    root : (modes,) [1/s], of a pair the one with positive imaginary part; rounding : (modes,) what rounding leaves of it [1/s]
    displacement, rotation : complex, as the axes stand at q; the largest displacement (or, without one, rotation) is 1
    rates : of the joints that turn [rad/s], those that follow from couplings among them
    """

    rates: dict[str, float]
    root: Complex
    rounding: Array

    def _make_card(self) -> Card:
        from flexinv.linearized.modes_card import make_steady_modes_card

        return make_steady_modes_card(self)

    @property
    def frequency(self) -> Array:
        """(modes,) damped natural frequencies [Hz], zero of a motion that does not swing."""
        return self.root.imag / (2 * np.pi)

    @property
    def root_error(self) -> Array:
        """(modes,) error bars of the roots [1/s], of mesh and rounding.

        Twice the distance to the root of the same number of a finer mesh, two elements of the next order for one, as
        `natural_modes.Modes.frequency_error`: it is solved when this is asked for first.
        """
        if self.mesh.mechanism.is_rigid:
            return self.rounding
        finer = compute_refined_steady_modes(self)
        return self.rounding + SAFETY * np.abs(self.root - finer.root)

    @property
    def frequency_error(self) -> Array:
        """(modes,) error bars of the frequencies [Hz], of mesh and rounding (`root_error`)."""
        return self.root_error / (2 * np.pi)

    @property
    def damping_ratio(self) -> Array:
        """(modes,) part of critical damping [-]; negative where the motion is unstable, nan of a motion without stiffness."""
        size = np.abs(self.root)
        return np.asarray(np.divide(0.0 - self.root.real, size, out=np.full(len(size), np.nan), where=size > 0))


@make_owner_cache()
def compute_refined_steady_modes(modes: SteadyModes) -> SteadyModes:
    """Return the same modes of a finer mesh [1/s]: two elements of the next order in place of each."""
    finer = modes.mesh.mechanism.refined(2, 1)
    return steady_modes(finer, modes.q, modes.rates, modes.free, len(modes.root))


def steady_modes(
    mechanism: Mechanism,
    q: ArrayLike | None = None,
    rates: Mapping[str, float] | None = None,
    free: Collection[str] | None = None,
    count: int | None = None,
) -> SteadyModes:
    """Return natural frequencies [Hz], damping and complex shapes about a motion in which joints turn at constant ``rates``.

    M y'' + C y' + K y = 0 in the axes that turn along: gyroscopic terms and all damping in C, stress and centrifugal terms in K.

    q : (nq,) [rad], [m], zero by default; rates : of revolute joints [rad/s], none by default; those of joints that couplings
        tie to them follow
    free : joints that move about the motion, as in `natural_modes`; count : number of modes, all by default
    What has no inertia and moves 1e7 times faster than all that has follows at once, and has no root.  All others are counted
    by the argument principle: a ModelWarning says where that none is lost is not proved.
    Raises InputError where the motion cannot be steady (gravity across the axis, an axis on a beam) and as `natural_modes`,
    ConvergenceError where no deformed shape is found, or a root is lost.
    """
    mesh, at, names = resolve_setup(resolve_damping_ratio(mechanism), q, free, count)
    rates = convert_rates(rates)
    motion = build_steady_motion(mesh, at, rates, set(names))
    turning = add_coupled_rates(mesh, rates)
    n = find_allowed_motions(motion.solver)
    m, c, k = (scipy.sparse.csc_array(n.T @ part @ n) for part in motion.matrices)
    size = k.shape[0]
    few = count is not None and size > ONE_AND_ALL and FEW * count <= size
    found = find_slowest_roots(m, c, k, count) if few and count is not None else find_roots(m, c, k)
    root = found.root
    shapes = found.shapes
    last = len(root) if count is None else count
    moves: Complex = compute_nodal_shapes(motion.solver, n @ shapes[:, :last])
    moved, turned = (np.abs(part).max(axis=(1, 2), initial=0.0) for part in (moves[..., :3], moves[..., 3:]))
    largest = np.where(moved > TWISTS * mesh.length * turned, moved, turned)  # displacements may be rounding
    moves /= largest[:, None, None]
    place = motion.solver.frames.x.copy()
    turn = motion.solver.frames.r.copy()
    return SteadyModes(
        mesh, at, names, moves[..., :3], moves[..., 3:], place, turn, turning, root[:last], found.bar[:last]
    )
