"""Closed loops for engines of open trees: the closures' equations in terms of what an engine says of frames.

An engine gives poses, Jacobians, velocities and bias accelerations of the frames that a closure ties; everything here
follows from them, in the engine's own coordinates.  Each equation is a product of two vectors, u fixed in the first
frame and d = x_2 - x_1, or w fixed in the second:

    phi = u . d     phi' = u . (v_2 - v_1) + (w_1 x u) . d
    phi = u . w     phi' = (w_2 - w_1) . (w x u)

A coupling of joint coordinates joins in as the first of these (`build_coupling_frames`).

Positions by Newton, continued from sample to sample with halved steps where it has to go far; rates by two linear
solves.  Multipliers act on the second frame as forces u at its origin and moments w x u, on the first as the opposite.

    S tau + G^T lambda = tau_tree          of least (weighted) norm where drives or constraints are redundant
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.shared.cross import cross
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Closure, Mechanism
from flexinv.model.owned_cache import make_owner_cache

Array = NDArray[np.float64]
State = tuple[Array, Array, Array]
NOTHING = (
    1e-13  # [m/rad], [-]: where all of a Jacobian is below that, it is rounding, as of a second bearing of a shaft
)
REDUNDANT = 1e-9  # part of the largest singular value: redundant constraints leave rounding, 1e-15, singular ones more
CLOSED = 1e-11  # [m], [-]: what rounding leaves of an equation, coordinates of some metres and ten roundings taken
STALLED = 1e-13  # [rad], [m]: a Newton step that is rounding
MOST_ITERATIONS = 25
SURPRISE = 0.03  # [rad], [m]: how far the solution may lie from its prediction of second order on the same branch
MOST_HALVINGS = 12
NOT_HELD = 1e-8  # part of the largest effort of the tree that nothing carries: above rounding, drives are missing


class AssemblyError(RuntimeError):
    """The loops cannot be closed, followed or held; the message says where."""


@dataclass(frozen=True)
class FrameMotion:
    """A frame in the world.

    x (3,) [m], r (3, 3) : pose; linear, angular (3, nv) : Jacobians; v, w (3,) [m/s], [rad/s]
    a, alpha (3,) [m/s^2], [rad/s^2] : accelerations where those of all coordinates are zero
    """

    x: Array
    r: Array
    linear: Array
    angular: Array
    v: Array
    w: Array
    a: Array
    alpha: Array


@dataclass(frozen=True)
class ClosureRows:
    """Equations of all closures: phi [m], [-]; g (rows, nv); bias (rows,): phi'' at zero acceleration of coordinates.

    closure : (rows,) index; force, moment : (rows, 3) in the world, on the second frame per unit of the multiplier
    """

    phi: Array
    g: Array
    bias: Array
    closure: NDArray[np.intp]
    force: Array
    moment: Array


class Tree(Protocol):
    """Interface of an engine's open tree, in its own coordinates."""

    def compute_frame_pairs(self, q: Array, v: Array) -> list[tuple[FrameMotion, FrameMotion]]:
        """Return first and second frame of every closure."""

    def integrate_step(self, q: Array, step: Array) -> Array:
        """Return q after a step (nv,) [rad], [m] of velocity coordinates."""

    def evaluate_motion(self, time: Array) -> tuple[Array, Array, Array]:
        """Return q, v, a at times [s]; joints that the motion leaves out stand at their guess."""


# --------------------------------------------------------------------------------------------------- the equations


@make_owner_cache()
def build_equation_vectors(closure: Closure) -> tuple[list[Array], list[tuple[Array, Array]]]:
    """Return the vectors u of positions and the pairs u, w of directions [-], in the two frames of a closure."""
    x, y, z = np.eye(3)
    n = closure.axis
    p = cross(n, np.eye(3)[int(np.argmin(np.abs(n)))])
    p = p / np.linalg.norm(p)
    s = cross(n, p)
    match closure.kind:
        case "fixed":
            return [x, y, z], [(x, y), (y, z), (z, x)]
        case "revolute":
            return [x, y, z], [(p, n), (s, n)]
        case "spherical":
            return [x, y, z], []
        case "universal":
            return [x, y, z], [(n, closure.second_axis)]
        case "prismatic":
            return [p, s], [(x, y), (y, z), (z, x)]
        case "cylindrical":
            return [p, s], [(p, n), (s, n)]
        case "point-on-line":
            return [p, s], []
        case "coupling":
            return [x], []
    raise AssemblyError(f"closure {closure.name!r}: no equations here for kind {closure.kind!r}")


def build_coupling_frames(
    closure: Closure, place: Callable[[str], tuple[int, int]], q: Array, v: Array
) -> tuple[FrameMotion, FrameMotion]:
    """Return a coupling, sum factor q = offset [rad], [m], as two points on a line: the second is where the sum is.

    place : joint -> where its number stands in q (nq,) and in v (nv,).  Both points are the world's: a force between
    them acts on nothing.
    """
    still = np.zeros(3)
    none = np.zeros((3, len(v)))
    sum_of = np.array([-closure.offset, 0.0, 0.0])
    rate = none.copy()
    for name, factor in closure.factors:
        at, column = place(name)
        sum_of[0] += factor * q[at]
        rate[0, column] += factor
    fixed = FrameMotion(still, np.eye(3), none, none, still, still, still, still)
    return fixed, FrameMotion(sum_of, np.eye(3), rate, none, rate @ v, still, still, still)


def assemble_rows(closures: tuple[Closure, ...], pairs: list[tuple[FrameMotion, FrameMotion]]) -> ClosureRows:
    """Return all equations [m], [-] at one state."""
    rows: list[tuple[Any, ...]] = []
    for index, (closure, (first, second)) in enumerate(zip(closures, pairs, strict=True)):
        positions, directions = build_equation_vectors(closure)
        rows += [(*compute_position_row(first, second, first.r @ u), index) for u in positions]
        rows += [(*compute_direction_row(first, second, first.r @ u, second.r @ w), index) for u, w in directions]
    phi, g, bias, force, moment, owner = (np.array(column) for column in zip(*rows, strict=True))
    return ClosureRows(phi, g, bias, owner, force, moment)


def compute_position_row(first: FrameMotion, second: FrameMotion, u: Array) -> tuple[Any, ...]:
    """Return phi [m], its Jacobian (nv,), its bias, force and moment of u . (x_2 - x_1) = 0; u : (3,) [-], world."""
    d = second.x - first.x
    v = second.v - first.v
    a = second.a - first.a
    turned = cross(first.w, u)
    g = u @ (second.linear - first.linear) + cross(u, d) @ first.angular
    bias = u @ a + 2 * turned @ v + (cross(first.alpha, u) + cross(first.w, turned)) @ d
    return u @ d, g, bias, u, np.zeros(3)


def compute_direction_row(first: FrameMotion, second: FrameMotion, u: Array, w: Array) -> tuple[Any, ...]:
    """Return phi [-], its Jacobian (nv,), its bias, force and moment of u . w = 0; u, w : (3,) [-], world."""
    u1 = cross(first.w, u)
    w1 = cross(second.w, w)
    u2 = cross(first.alpha, u) + cross(first.w, u1)
    w2 = cross(second.alpha, w) + cross(second.w, w1)
    normal = cross(w, u)
    return u @ w, normal @ (second.angular - first.angular), u2 @ w + 2 * u1 @ w1 + u @ w2, np.zeros(3), normal


# ------------------------------------------------------------------------------------------------------- the motion


@dataclass(frozen=True)
class ClosureTask:
    """A mechanism whose motion leaves joints to the closures.

    unknown : (nv,) and unknown_q : (nq,) which of the tree's coordinates follow from the closures
    """

    mechanism: Mechanism
    tree: Tree
    unknown: NDArray[np.bool_]
    unknown_q: NDArray[np.bool_]


def solve_closed_motion(task: ClosureTask, time: Array) -> tuple[Array, Array, Array]:
    """Return q (samples, nq), v, a (samples, nv) [rad], [m], [s] of the tree on its closures.

    Raises AssemblyError where the loops do not close, where the branch is lost, and where they stay movable.
    """
    motion = task.tree.evaluate_motion(time)
    q = _solve_newton(task, motion[0][0])
    if q is None:
        raise AssemblyError(
            f"the loops do not close at t = {time[0]:g} s: another guess of the joints left out is needed"
        )
    states = [(a, b, c) for a, b, c in zip(*motion, strict=True)]
    rates = _solve_rates(task, q, float(time[0]), states[0])
    out = [(q, *rates)]
    for (before, after), state in zip(pairwise(time), states[1:], strict=True):
        q, rates = _integrate_step(task, q, rates, (float(before), float(after)), state)
        out.append((q, *rates))
    columns = zip(*out, strict=True)
    return tuple(np.array(column) for column in columns)  # type: ignore[return-value]


def compute_extent(mechanism: Mechanism) -> float:
    """Return the sum of all offsets in a mechanism [m], a metre where there are none: what positions are compared with."""
    offsets = [joint.placement.position for joint in mechanism.joints]
    offsets += [body.inertia.com for link in mechanism.links for body in link.bodies]
    beams = sum(link.beam.length for link in mechanism.links if link.beam is not None)
    return float(np.abs(offsets).sum() + beams) or 1.0


def _compute_scales(task: ClosureTask, rows: ClosureRows) -> Array:
    """Return the divisor of each equation, (rows,): a length [m] for positions, 1 for directions.

    Where closures are redundant and the given motion meets them to its digits only, this weighs what is left open.
    """
    return np.where(rows.force.any(axis=1), compute_extent(task.mechanism), 1.0)


def _solve_newton(task: ClosureTask, guess: Array) -> Array | None:
    """Return the closed configuration near a guess, or None."""
    q = guess
    rest = np.zeros(len(task.unknown))
    for _ in range(MOST_ITERATIONS):
        rows = assemble_rows(task.mechanism.closures, task.tree.compute_frame_pairs(q, rest))
        step = rest.copy()
        scale = _compute_scales(task, rows)
        step[task.unknown] = -np.linalg.lstsq(
            rows.g[:, task.unknown] / scale[:, None], rows.phi / scale, rcond=REDUNDANT
        )[0]
        # The last step is taken, too: soft constraints multiply what it mends by their stiffness, some 1e8.
        q = task.tree.integrate_step(q, step)
        if np.abs(step).max() < STALLED:
            break
    return q if np.abs(rows.phi).max() < CLOSED else None


def _solve_rates(task: ClosureTask, q: Array, time: float, given: State) -> tuple[Array, Array]:
    """Return v and a (nv,) [1/s], [1/s^2]: G v = 0 and G a + bias = 0 with the given coordinates as they are at a time [s]."""
    _, v, a = given
    free = task.unknown
    v = np.where(free, 0.0, v)
    a = np.where(free, 0.0, a)
    rows = assemble_rows(task.mechanism.closures, task.tree.compute_frame_pairs(q, v))
    scale = _compute_scales(task, rows)
    g = rows.g / scale[:, None]
    solved, _, rank, _ = np.linalg.lstsq(g[:, free], -g @ v, rcond=REDUNDANT)
    if rank < free.sum():
        raise AssemblyError(
            f"the closures leave {free.sum() - rank} of {free.sum()} coordinates open at t = {time:g} s: a singular position, "
            "or the motion gives too few coordinates"
        )
    v[free] = solved
    rows = assemble_rows(task.mechanism.closures, task.tree.compute_frame_pairs(q, v))
    a[free] = np.linalg.lstsq(g[:, free], -(rows.bias / scale + g @ a), rcond=REDUNDANT)[0]
    return v, a


def _evaluate_motion(task: ClosureTask, time: float) -> State:
    q, v, a = task.tree.evaluate_motion(np.array([time]))
    return q[0], v[0], a[0]


def _integrate_step(
    task: ClosureTask, q: Array, rates: tuple[Array, Array], times: tuple[float, float], end: State
) -> tuple[Array, tuple[Array, Array]]:
    """Follow the loops from one time to the next, at which the given coordinates are ``end``."""
    before, after = times
    done = 0.0
    part = 1.0
    while done < 1.0:
        target = min(1.0, done + part)
        step = (target - done) * (after - before)
        guess = task.tree.integrate_step(q, step * rates[0] + step**2 / 2 * rates[1])
        time = before + target * (after - before)
        given = end if target == 1.0 else _evaluate_motion(task, time)
        guess = np.where(task.unknown_q, guess, given[0])
        newton = _solve_newton(task, guess)
        if newton is not None and np.abs(newton - guess).max() < SURPRISE:
            q = newton
            done = target
            rates = _solve_rates(task, newton, time, given)
        elif (part := part / 2) < 0.5**MOST_HALVINGS:
            raise AssemblyError(f"the loops cannot be followed beyond t = {before + done * (after - before):g} s")
    return q, rates


# ------------------------------------------------------------------------------------------------------- the forces


def split_efforts(g: Array, tree: Array, driven: NDArray[np.bool_], weight: Array) -> Array:
    """Return the drives' efforts (nv,) [N m] or [N]: N^T S tau = N^T tau_tree with G N = 0, of least sum weight tau^2.

    g : (rows, nv); tree : (nv,) effort of the open tree; driven, weight : (nv,)
    Raises AssemblyError where the drives cannot hold the mechanism.
    """
    motions = compute_null_space(g)
    asked = motions.T @ tree
    effort = np.zeros(len(tree))
    root = np.sqrt(weight[driven])
    effort[driven] = np.linalg.lstsq(motions[driven].T / root, asked, rcond=REDUNDANT)[0] / root
    missing = np.abs(motions.T @ effort - asked).max(initial=0.0)
    if missing > NOT_HELD * np.abs(tree).max(initial=1.0):
        raise AssemblyError(f"the actuated joints cannot hold the mechanism: {missing:.3g} N m or N is missing")
    return effort


def compute_null_space(g: Array) -> Array:
    """Return an orthonormal basis (nv, freedoms) [-] of the motions that constraints (rows, nv) allow."""
    _, values, right = np.linalg.svd(g)
    return np.asarray(right[_count(values) :].T)


def compute_rank(g: Array) -> int:
    """Return the number of independent equations of a Jacobian (rows, nv) [m/rad], [-]: 0 where all of it is rounding."""
    return _count(np.linalg.svd(g, compute_uv=False))


def _count(values: NDArray[np.floating[Any]]) -> int:
    """Singular values that are neither rounding nor redundant."""
    return int((values > max(REDUNDANT * values.max(initial=0.0), NOTHING)).sum())


def solve_multipliers(g: Array, tree: Array, effort: Array) -> Array:
    """Return lambda (rows,) [N], [N m] with G^T lambda = tau_tree - tau, of least norm."""
    told = g if np.abs(g).max(initial=0.0) > NOTHING else np.zeros_like(g)
    return np.asarray(np.linalg.lstsq(told.T, tree - effort, rcond=REDUNDANT)[0])


# ---------------------------------------------------------------------------------------------------- start, reasons


def find_unprescribed_joints(mechanism: Mechanism, case: Case) -> set[str]:
    """Return the moving joints that the motion does not give."""
    given = set(case.motion.joints(mechanism))
    return {j.name for j in mechanism.joints if j.nv and j.name not in given}


def apply_guess(mechanism: Mechanism, case: Case, q: Array) -> Array:
    """Return q (samples, nq) [rad], [m] with the joints that the motion leaves out at the case's guess."""
    out = q.copy()
    for name in find_unprescribed_joints(mechanism, case) & set(case.start):
        joint = mechanism.joint_of[name]
        value = np.atleast_1d(np.asarray(case.start[name], dtype=np.float64))
        if joint.kind == "continuous" and value.size == 1:
            value = np.array([np.cos(value[0]), np.sin(value[0])])
        out[:, mechanism.q_slices[name]] = value
    return out


def describe_refusal(mechanism: Mechanism) -> str | None:
    """Return the reason why these loops cannot be closed here, or None."""
    if catches := [c.name for c in mechanism.closures if c.capture]:
        return f"closures tie frames that have met here; capturing: {', '.join(catches)}"
    if not mechanism.is_rigid:
        return f"closed loops of rigid links only; flexible: {', '.join(link.name for link in mechanism.flexible)}"
    return None
