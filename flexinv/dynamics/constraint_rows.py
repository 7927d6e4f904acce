"""Closures in the march: constraint equations between two nodes and their gradients, rows of the border (compiled).

Same equations as `closures`, one row each: position u . d = 0 or direction u . w = 0, with the gradient g of a row (force on
node b and a in the world, moment in the node's own frame).  A closure that does not act has rows of zeros.
Springs between points (`spring_rows`) follow as further rows.

With K of the tree, every row k of the border adds an unknown lambda_k (a multiplier, or the force of a spring), a column C_k
(what the unknown does to the residual) and an equation:

    K y - C dlambda = -r          A_k . y + e_k dlambda_k = -phi_k

solved by y = y_0 + K^-1 C dlambda on the tree, and the border  (A K^-1 C + e) dlambda = -phi - A y_0  with complete pivoting:
rows that add nothing (redundant constraints of planar loops, closures that do not act) are found there and keep their unknowns.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.constraints.closures import Rows
from flexinv.constraints.equations import fixed, gap
from flexinv.kernels.dense import solve_symmetric
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import by_address
from flexinv.kernels.vec3 import ZERO, cross, dot, mat, put, scale, sub, tapply, vec, vec_at
from flexinv.typing import Array

POSITION, DIRECTION, PULL, COUPLING = 0, 1, 2, 3
# What `tie_rows` sets: phi, its rate, or its second rate.
VALUES, RATES, SECOND_RATES = 0, 1, 2
# A constraint that moves with no unknown by more than this, in mechanism lengths, is one that no unknown can break (planar
# loops of spatial joints): rounding leaves 1e-16.
MOVES_NOTHING = 1e-13
UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@by_address
class Ties(NamedTuple):
    """Rows of the border: first the constraints of all closures (see `closures.Rows`), then three for each spring.

    kind : (rows,) POSITION, DIRECTION, PULL or COUPLING; acting : (rows,) whether the closure acts
    a, b : (rows,) nodes; place_a, place_b [m], u, w : (rows, 3) in the nodes' frames
    multiplier : (rows,) [N], [N m]; value : (rows,) phi, or phi'' when accelerations are solved for
    give : (rows,) what the row's own multiplier adds to its equation: 1 where it is a spring's force, else 0
    gradient : (rows, 12) by the motion of a (world, own frame) and of b
    gear : (rows, unknowns) factors of couplings; given : (rows, 3) what joints with a motion add to their equation, and its rates
    sides, across : (rows, unknowns) -C and -A of `border`; border : (rows, rows + 1); order, step, kept : (rows,) scratch
    """

    kind: NDArray[np.int64]
    acting: NDArray[np.bool_]
    a: NDArray[np.int64]
    b: NDArray[np.int64]
    place_a: Array
    place_b: Array
    u: Array
    w: Array
    multiplier: Array
    value: Array
    give: Array
    gradient: Array
    gear: Array
    given: Array
    sides: Array
    across: Array
    border: Array
    order: NDArray[np.int64]
    step: Array
    kept: Array


def ties(rows: Rows, pulls: int, by_unknown: Array) -> Ties:
    """Return the border's rows: the constraints ``rows`` of closures [m], [-], then those of as many ``pulls`` (springs).

    by_unknown : (nv, unknowns) 1 where an unknown of the march is a joint coordinate
    """
    unknowns = by_unknown.shape[1]
    more = 3 * pulls
    n = len(rows) + more

    def padded(values: NDArray[Any], fill: float) -> NDArray[Any]:
        return np.concatenate([values, np.full((more, *values.shape[1:]), fill, dtype=values.dtype)])

    return Ties(
        kind=padded(np.where(rows.gear.any(axis=1), COUPLING, np.where(rows.direction, DIRECTION, POSITION)), PULL),
        acting=np.ones(n, dtype=bool),
        a=padded(rows.a, -1),
        b=padded(rows.b, -1),
        place_a=padded(rows.place_a, 0.0),
        place_b=padded(rows.place_b, 0.0),
        u=padded(rows.u, 0.0),
        w=padded(rows.w, 0.0),
        multiplier=np.zeros(n),
        value=np.zeros(n),
        give=padded(np.zeros(len(rows)), 1.0),
        gradient=np.zeros((n, 12)),
        gear=padded(rows.gear @ by_unknown, 0.0),
        given=np.zeros((n, 3)),
        sides=np.zeros((n, unknowns)),
        across=np.zeros((n, unknowns)),
        border=np.zeros((n, n + 1)),
        order=np.zeros(n, dtype=np.int64),
        step=np.zeros(n),
        kept=np.zeros(n),
    )


def set_ties(constraints: Ties, rows: Rows, acting: NDArray[np.bool_]) -> None:
    """Let the closures of ``acting`` (closures,) act, with the frames [m], [-] that ``rows`` have now; others carry nothing."""
    n = len(rows)
    constraints.acting[:n] = acting[rows.closure]
    constraints.place_b[:n], constraints.w[:n] = rows.place_b, rows.w
    constraints.multiplier[:n][~constraints.acting[:n]] = 0.0


@jit_inner
def _second(row, node_a, node_b, constraints, frames):
    """The second vector of a row, w or d, and its two rates."""
    if constraints.kind[row] == DIRECTION:
        return fixed(frames, node_b, vec(constraints.w[row]))
    return gap(frames, node_a, node_b, vec(constraints.place_a[row]), vec(constraints.place_b[row]))


@jit_inner
def _geared(k, constraints, state, wanted):
    """Equation of a coupling, sum gear q - offset, or a rate of it, of joints with and without a motion."""
    value = constraints.given[k, wanted]
    for i in range(constraints.gear.shape[1]):
        if constraints.gear[k, i] != 0.0:
            if wanted == SECOND_RATES:
                value += constraints.gear[k, i] * state.du[i]
            elif wanted == RATES:
                value += constraints.gear[k, i] * state.u[i]
            else:
                value += constraints.gear[k, i] * (state.place[i] + state.d[i])
    return value


@jit_inner
def tie_rows(constraints, state, frames, wanted):
    """Set value and gradient of every constraint, and return nothing [m], [-]: phi, phi', or phi'' = u''.w + 2 u'.w' + u.w''."""
    for k in range(len(constraints.a)):
        if constraints.kind[k] == PULL:
            continue
        if constraints.kind[k] == COUPLING:
            constraints.value[k] = _geared(k, constraints, state, wanted)
            continue
        if not constraints.acting[k]:
            constraints.value[k] = 0.0
            for i in range(12):
                constraints.gradient[k, i] = 0.0
            continue
        a, b = constraints.a[k], constraints.b[k]
        u = fixed(frames, a, vec(constraints.u[k]))
        w = _second(k, a, b, constraints, frames)
        if wanted == SECOND_RATES:
            constraints.value[k] = dot(u[2], w[0]) + 2 * dot(u[1], w[1]) + dot(u[0], w[2])
        elif wanted == RATES:
            constraints.value[k] = dot(u[1], w[0]) + dot(u[0], w[1])
        else:
            constraints.value[k] = dot(u[0], w[0])
        _set_gradient(k, a, b, constraints, frames, u[0], w[0])


@jit_inner
def _set_gradient(row, node_a, node_b, constraints, frames, vector, second):
    """phi' = g_a . (v_a, w_a) + g_b . (v_b, w_b), angular velocities in the nodes' own frames."""
    ra = mat(frames.r[node_a]) if node_a >= 0 else UNIT
    rb = mat(frames.r[node_b]) if node_b >= 0 else UNIT
    on_a = cross(vec(constraints.u[row]), tapply(ra, second))
    if constraints.kind[row] == DIRECTION:
        put(constraints.gradient[row], 0, ZERO)
        put(constraints.gradient[row], 3, on_a)
        put(constraints.gradient[row], 6, ZERO)
        put(constraints.gradient[row], 9, cross(vec(constraints.w[row]), tapply(rb, vector)))
        return
    put(constraints.gradient[row], 0, scale(-1.0, vector))
    put(constraints.gradient[row], 3, sub(on_a, cross(vec(constraints.place_a[row]), tapply(ra, vector))))
    put(constraints.gradient[row], 6, vector)
    put(constraints.gradient[row], 9, cross(vec(constraints.place_b[row]), tapply(rb, vector)))


@jit_inner
def add_ties(constraints, multiplier, wrench):
    """Take the forces of multipliers (rows,), or of their changes, off the wrenches of their nodes, r - C lambda [N], [N m]."""
    for k in range(len(constraints.a)):
        for i in range(6):
            if constraints.a[k] >= 0:
                wrench[constraints.a[k], i] -= multiplier[k] * constraints.gradient[k, i]
            if constraints.b[k] >= 0:
                wrench[constraints.b[k], i] -= multiplier[k] * constraints.gradient[k, 6 + i]


@jit_inner
def add_gears(constraints, residual):
    """Take the efforts of the couplings' multipliers off the residual of the unknowns [N m], [N]."""
    for k in range(len(constraints.a)):
        if constraints.kind[k] == COUPLING:
            for i in range(residual.shape[1]):
                residual[0, i] -= constraints.multiplier[k] * constraints.gear[k, i]


@jit_inner
def tie_sides(topology, constraints, variation, length, residual):
    """Put -C, by unknowns, into the right sides 1.. of the solve [N], [N m] per unit multiplier; A = C^T for constraints."""
    for k in range(len(constraints.a)):
        for i in range(residual.shape[1]):
            constraints.sides[k, i] = -constraints.gear[k, i]
        _add_side(topology, constraints.a[k], variation, constraints.gradient[k], 0, constraints.sides[k])
        _add_side(topology, constraints.b[k], variation, constraints.gradient[k], 6, constraints.sides[k])
        largest = 0.0
        for i in range(residual.shape[1]):
            largest = max(largest, abs(constraints.sides[k, i]))
        if largest < MOVES_NOTHING * length:
            for i in range(residual.shape[1]):
                constraints.sides[k, i] = 0.0
        for i in range(residual.shape[1]):
            residual[1 + k, i] = constraints.sides[k, i]
            if constraints.kind[k] != PULL:
                constraints.across[k, i] = constraints.sides[k, i]


@jit_inner
def _add_side(topology, n, variation, gradient, first, side):
    if n < 0:
        return
    block = topology.block[n]
    for k in range(topology.size[block]):
        along = dot(vec_at(gradient, first), vec(variation.x[n, k])) + dot(
            vec_at(gradient, first + 3), vec(variation.t[n, k])
        )
        side[topology.offset[block] + k] -= along


# A pivot of the border, scaled to a unit diagonal, below this belongs to a redundant row: rounding leaves 1e-14.
REDUNDANT_PIVOT = 1e-10


@jit_inner
def solve_border(constraints, unit, y):
    """Find the increments of the border's unknowns and add what they do to y[0] [m], [rad].

    y : (1 + rows, unknowns), y_0 and then K^-1 C; ``unit`` scales the equations of constraints
    """
    rows = len(constraints.a)
    for i in range(rows):
        for j in range(rows):
            constraints.border[i, j] = -product(constraints.across[i], y[1 + j])
        constraints.border[i, i] -= constraints.give[i]
        constraints.border[i, rows] = product(constraints.across[i], y[0]) - constraints.value[i] / (
            unit if constraints.give[i] == 0.0 else 1.0
        )
    work = constraints.order, constraints.value
    solve_symmetric(constraints.border, rows, REDUNDANT_PIVOT, constraints.step, work)
    for k in range(rows):
        constraints.multiplier[k] += constraints.step[k]
        for i in range(y.shape[1]):
            y[0, i] += constraints.step[k] * y[1 + k, i]


@jit_inner
def product(a, b):
    """Return a . b of two rows [any unit]."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total
