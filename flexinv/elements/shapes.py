"""Shapes of meshed links as the march takes them: nodes that amplitudes move against the frame of their link, and modal laws.

With the amplitudes y of a part, slide U, turn T and their derivatives B, D of a node, and psi = (T + T(y)) y / 2:

    p = p_0 + (U + U(y)) y / 2        U(y) = U + B y        p' = U(y) y'        p'' = U(y) y'' + y' B y'
    R = exp(psi)        T(y) = T + D y        w = H(psi) T(y) y'        (and likewise al)

These are frames of interfaces; point masses of a part slide alone (`elements.points`).  B and D are of the softest shapes, which
come first: what is quadratic in the amplitudes gives loads along a part their stiffness against bending.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexinv.elements.beam import compute_curvature_rate, compute_tangent_slope
from flexinv.elements.points import SIDE_BY_SIDE, PartPoints
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.so3 import coefficients, exp_with, tangent_with
from flexinv.kernels.vec3 import EYE, ZERO, add, add_scaled, apply, dot, put, put_at, put_mat, sum3, vec, vec_at
from flexinv.typing import Array, Indices, Mask


@send_by_address
class PartShapes(NamedTuple):
    """Parts of a mechanism, padded to the largest number of amplitudes.

    part : (nodes,) the part whose amplitudes move a node against its parent, -1 without
    row : (nodes,) of the tables below, -1 of nodes without and of point masses, which have their own, ``points``
    place : (rows, 3) [m] of the undeformed node; slide : (rows, amplitudes, 3) [-]; turn : (rows, amplitudes, 3) [rad/m]
    bend : (rows, soft, soft, 3) second derivatives of the place [1/m]; whirl : those of the rotation vector [rad/m^2]
    turns : (rows,) whether a node turns at all
    root : (parts,) nodes of the link frames; link : (parts,) index into mechanism.links
    size, soft : (parts,) amplitudes, and those of them with second derivatives
    stiffness, damping : (parts, amplitudes) modal [N/m], [N s/m]
    """

    part: Indices
    row: Indices
    place: Array
    slide: Array
    turn: Array
    bend: Array
    whirl: Array
    turns: Mask
    root: Indices
    size: Indices
    soft: Indices
    link: Indices
    stiffness: Array
    damping: Array
    points: PartPoints


class Turn(NamedTuple):
    """Turn of a frame by amplitudes: psi [rad], its rates [1/s], [1/s^2], and the coefficients of H(psi)."""

    psi: tuple[float, float, float]
    rate: tuple[float, float, float]
    change: tuple[float, float, float]
    q: tuple[float, ...]


@jit_inner
def is_point_mass(n, shapes):
    """Return True for a node that is a point mass of a part [-]."""
    return shapes.part[n] >= 0 and shapes.row[n] < 0


@jit_inner
def fill_shaped_motion(n, shapes, first, state, moved, joints):
    """Set the motion of node n against its parent from the amplitudes at ``first`` of the unknowns; return its `Turn`.

    moved : (rows, amplitudes, 6) is filled with U(y) and T(y) of the node [-], [rad/m]
    """
    row = shapes.row[n]
    turns = shapes.turns[row]
    p = vec(shapes.place[row])
    dp = ZERO
    ddp = ZERO
    psi = ZERO
    rate = ZERO
    change = ZERO
    for k in range(shapes.size[shapes.part[n]]):
        y = state.place[first + k] + state.d[first + k]
        u = state.u[first + k]
        du = state.du[first + k]
        slide, slide_rate, turn, turn_rate = _compute_bent_shape(n, k, shapes, first, state)
        p = add_scaled(p, 0.5 * y, add(vec(shapes.slide[row, k]), slide))
        dp = add_scaled(dp, u, slide)
        ddp = add_scaled(add_scaled(ddp, du, slide), u, slide_rate)
        put(moved[row, k], slide)
        if turns:
            psi = add_scaled(psi, 0.5 * y, add(vec(shapes.turn[row, k]), turn))
            rate = add_scaled(rate, u, turn)
            change = add_scaled(add_scaled(change, du, turn), u, turn_rate)
            put_at(moved[row, k], 3, turn)
    put(joints.p[n], p)
    put(joints.dp[n], dp)
    put(joints.ddp[n], ddp)
    motion = Turn(psi, rate, change, coefficients(dot(psi, psi)))
    _write_turn(n, turns, motion, joints)
    return motion


@jit_inner
def _write_turn(n, turns, motion, joints):
    """Write rotation, angular velocity and acceleration of a frame; a point mass does not turn."""
    psi, rate, change, q = motion
    if turns:
        tangent = tangent_with(psi, q)
        put_mat(joints.r[n], exp_with(psi, q))
        put(joints.w[n], apply(tangent, rate))
        put(joints.al[n], add(apply(tangent, change), apply(compute_tangent_slope(psi, rate, q, 1.0), rate)))
    else:
        put_mat(joints.r[n], EYE)
        put(joints.w[n], ZERO)
        put(joints.al[n], ZERO)


@jit_inner
def _compute_bent_shape(n, k, shapes, first, state):
    """U(y) and T(y) of node n for amplitude k, and their rates B y', D y'."""
    row = shapes.row[n]
    slide = vec(shapes.slide[row, k])
    turn = vec(shapes.turn[row, k])
    slide_rate = ZERO
    turn_rate = ZERO
    soft = shapes.soft[shapes.part[n]]
    for j in range(soft if k < soft else 0):
        y = state.place[first + j] + state.d[first + j]
        bend = vec(shapes.bend[row, k, j])
        slide = add_scaled(slide, y, bend)
        slide_rate = add_scaled(slide_rate, state.u[first + j], bend)
        if shapes.turns[row]:
            whirl = vec(shapes.whirl[row, k, j])
            turn = add_scaled(turn, y, whirl)
            turn_rate = add_scaled(turn_rate, state.u[first + j], whirl)
    return slide, slide_rate, turn, turn_rate


@jit_inner
def _compute_shape_rates(n, k, shapes, first, state):
    """B y', B y'', D y' and D y'' of node n for amplitude k."""
    row = shapes.row[n]
    slide_rate = ZERO
    slide_change = ZERO
    turn_rate = ZERO
    turn_change = ZERO
    soft = shapes.soft[shapes.part[n]]
    for j in range(soft if k < soft else 0):
        bend = vec(shapes.bend[row, k, j])
        slide_rate = add_scaled(slide_rate, state.u[first + j], bend)
        slide_change = add_scaled(slide_change, state.du[first + j], bend)
        if shapes.turns[row]:
            whirl = vec(shapes.whirl[row, k, j])
            turn_rate = add_scaled(turn_rate, state.u[first + j], whirl)
            turn_change = add_scaled(turn_change, state.du[first + j], whirl)
    return slide_rate, slide_change, turn_rate, turn_change


@jit_inner
def fill_shaped_variation(n, shapes, columns, state, moved, motion, variation, factors):
    """Set the variation of node n against its parent by the amplitudes; ``columns`` : their first column and unknown [-].

    moved : of `fill_shaped_motion`; motion : its `Turn`; factors : cv, ca of the scheme
    """
    row = shapes.row[n]
    column, first = columns
    cv, ca = factors
    psi, rate, change, q = motion
    tangent = tangent_with(psi, q)
    by_rate = compute_tangent_slope(psi, rate, q, 1.0)
    by_change = compute_tangent_slope(psi, change, q, 1.0)
    twice = compute_curvature_rate(psi, rate, rate, q)
    for k in range(shapes.size[shapes.part[n]]):
        slide_rate, slide_change, turn_rate, turn_change = _compute_shape_rates(n, k, shapes, first, state)
        slide = vec(moved[row, k])
        put(variation.x[n, column + k], slide)
        put(variation.v[n, column + k], add_scaled(slide_rate, cv, slide))
        put(variation.a[n, column + k], add_scaled(add_scaled(slide_change, 2.0 * cv, slide_rate), ca, slide))
        if shapes.turns[row]:
            turn = vec_at(moved[row, k], 3)
            of_rate = add_scaled(turn_rate, cv, turn)
            of_change = add_scaled(add_scaled(turn_change, 2.0 * cv, turn_rate), ca, turn)
            across = add(apply(compute_tangent_slope(psi, of_rate, q, 1.0), rate), apply(by_rate, of_rate))
            put(variation.t[n, column + k], apply(tangent, turn))
            put(variation.w[n, column + k], add(apply(by_rate, turn), apply(tangent, of_rate)))
            still = sum3(apply(tangent, of_change), apply(by_change, turn), apply(twice, turn))
            put(variation.al[n, column + k], add(still, across))


@jit_inner
def turn_shapes(n, shapes, motion, moved):
    """Make the turns T(y) of a node in ``moved`` those of its frame, H(psi) T(y) [rad/m]."""
    row = shapes.row[n]
    tangent = tangent_with(motion.psi, motion.q)
    for k in range(shapes.size[shapes.part[n]]):
        put_at(moved[row, k], 3, apply(tangent, vec_at(moved[row, k], 3)))


def build_shapes(part: Indices, nodes: list[ShapedNode], masses: list[ShapedNode], parts: list[PartLaw]) -> PartShapes:
    """Return the record of parts [N/m], [N s/m] and of the nodes that their amplitudes move [m], [-], [rad/m].

    part : (nodes of the mechanism,) as in `PartShapes`; nodes, masses, parts : in the order of their numbers
    """
    of_parts = [(law.root, len(law.stiffness), law.soft, law.link) for law in parts]
    root, size, soft, link = np.array(of_parts, dtype=np.int64).reshape(-1, 4).T.copy()
    most = int(size.max(initial=0))
    softest = int(soft.max(initial=0))
    row = np.full(len(part), -1)
    row[[node.number for node in nodes]] = np.arange(len(nodes))
    place = _fill_up(nodes, "place", (3,))
    slide, turn = (_fill_up(nodes, name, (3, most)).transpose(0, 2, 1).copy() for name in ("slide", "turn"))
    curved = (_fill_up(nodes, name, (3, softest, softest)) for name in ("bend", "whirl"))
    bend, whirl = (table.transpose(0, 2, 3, 1).copy() for table in curved)
    turns = np.array([bool(table.any()) for table in turn], dtype=np.bool_)
    stiffness, damping = (_fill_up(parts, name, (most,)) for name in ("stiffness", "damping"))
    points = _build_points(part, masses, parts, (most, softest))
    return PartShapes(
        part, row, place, slide, turn, bend, whirl, turns, root, size, soft, link, stiffness, damping, points
    )


def _build_points(part: Indices, masses: list[ShapedNode], parts: list[PartLaw], sizes: tuple[int, int]) -> PartPoints:
    """Tables of the point masses, part after part; ``sizes`` : amplitudes, and those with second derivatives."""
    most, softest = sizes
    node = np.array([one.number for one in masses], dtype=np.int64)
    first = np.searchsorted(part[node], np.arange(len(parts) + 1)).astype(np.int64)
    stride = -(-np.diff(first) // SIDE_BY_SIDE) * SIDE_BY_SIDE
    row = 3 * (np.cumsum(stride) - stride)
    place = np.zeros((3 * int(stride.sum()), 1))
    slide = np.zeros((len(place), most))
    bend = np.zeros((len(place), softest * softest))
    product = np.zeros((len(parts), most, 3, 3, most))
    for number, law in enumerate(parts):
        of_part = masses[first[number] : first[number + 1]]
        at = row[number] + stride[number] * np.arange(3) + np.arange(len(of_part))[:, None]  # (point, xyz)
        slides = _fill_up(of_part, "slide", (3, most))
        place[at, 0] = _fill_up(of_part, "place", (3,))
        slide[at] = slides
        bend[at] = _fill_up(of_part, "bend", (3, softest, softest)).reshape(*at.shape, -1)
        product[number] = law.point_mass * np.einsum("pia,pjb->aijb", slides, slides, optimize=True)
    bends = bend.T.copy().reshape(softest, softest, len(place))
    mass = np.array([law.point_mass for law in parts])
    return PartPoints(first, node, row, stride, place[:, 0].copy(), slide.T.copy(), bends, mass, product)


def _fill_up(records: Sequence[ShapedNode | PartLaw], name: str, shape: tuple[int, ...]) -> Array:
    """Tables of a name one after the other, each filled up with zeros to a shape."""
    out = np.zeros((len(records), *shape))
    for whole, record in zip(out, records, strict=True):
        table = getattr(record, name)
        whole[tuple(map(slice, table.shape))] = table
    return out


class ShapedNode(NamedTuple):
    """A node that a part moves: number, place (3,) [m], slide (3, amplitudes) [-], turn [rad/m], and second derivatives.

    bend, whirl : (3, soft, soft) of the place [1/m], of the rotation vector [rad/m^2]
    """

    number: int
    place: Array
    slide: Array
    turn: Array
    bend: Array
    whirl: Array


class PartLaw(NamedTuple):
    """A part: node of its link frame, link, amplitudes with second derivatives [-], mass of each of its points [kg].

    stiffness, damping : (amplitudes,) modal [N/m], [N s/m]
    """

    root: int
    link: int
    soft: int
    point_mass: float
    stiffness: Array
    damping: Array
