"""Closures in the march: constraint equations between two nodes and their gradients, rows of the border (compiled).

Same equations as `closures`, one row each: position u . d = 0 or direction u . w = 0, with the gradient g of a row (force on
node b and a in the world, moment in the node's own frame).  A closure that does not act has rows of zeros.
Springs between points (`loads`) follow as further rows.

With K of the tree, every row k of the border adds an unknown lambda_k (a multiplier, or the force of a spring), a column C_k
(what the unknown does to the residual) and an equation:

    K y - C dlambda = -r          A_k . y + e_k dlambda_k = -phi_k          e_k = 1 for forces of springs, else 0

solved by y = y_0 + K^-1 C dlambda on the tree, and the border  (A K^-1 C + e) dlambda = -phi - A y_0  with pivoting:
rows that add nothing (redundant constraints of planar loops, closures that do not act) are found there and keep their unknowns.
A row has to do with the parts of the mechanism (`dynamics.dofs`) that its nodes belong to, and with no other: `Layout` has which.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from flexinv.constraints.closures import Rows, build_constraint_rows
from flexinv.constraints.equations import compute_fixed_vector, compute_gap
from flexinv.dynamics.dofs import Topology
from flexinv.kernels.dense import Blocks, Pivots, build_blocks, factorise_blocks, solve_blocks
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import EYE, ZERO, cross, dot, mat, put_at, put_pair, scale, sub, tapply, vec, vec_at
from flexinv.kinematics.mesh import Mesh, find_attachment_node
from flexinv.typing import Array, Indices, Mask

POSITION = 0
DIRECTION = 1
PULL = 2
COUPLING = 3
# What `evaluate_ties` sets: phi, its rate, or its second rate.
VALUES = 0
RATES = 1
SECOND_RATES = 2
# A constraint that moves with no unknown by more than this, in mechanism lengths, is one that no unknown can break (planar
# loops of spatial joints): rounding leaves 1e-16.
MOVES_NOTHING = 1e-13


@send_by_address
class Layout(NamedTuple):
    """Parts of the mechanism that the rows of the border have to do with.

    first_part : (rows + 1,) of each row in ``begin`` and ``end``, the unknowns of a part from its first to behind its last
    first_unknown : (rows + 1,) of each row in ``unknown``: those that A_k has entries for, of its nodes' blocks or joints
    first_side : (parts + 1,) of each part in ``side``: right sides of its solve, 0 the residual, then 1 + row
    blocks : closures and springs, coupled where they share a part; whole : all of them as one
    """

    first_part: Indices
    begin: Indices
    end: Indices
    first_unknown: Indices
    unknown: Indices
    first_side: Indices
    side: Indices
    blocks: Blocks
    whole: Blocks


@send_by_address
class Ties(NamedTuple):
    """Rows of the border: first the constraints of all closures (see `equations.Rows`), then three for each spring.

    kind : (rows,) POSITION, DIRECTION, PULL or COUPLING; acting : (rows,) whether the closure acts
    a, b : (rows,) nodes; place_a, place_b [m], u, w : (rows, 3) in the nodes' frames; in a plane (rows, 2), in its axes where the
        nodes stand at zero
    multiplier : (rows,) [N], [N m]; value : (rows,) phi, or phi'' when accelerations are solved for
    gradient : (rows, 12) by the motion of a (world, own frame) and of b; in a plane (rows, 6)
    gear : (rows, unknowns) factors of couplings; coupling_terms : (rows, 3) what joints with a motion
        add to their equation, and its rates
    sides, across : (rows, unknowns) -C and -A; border : (rows, rows) A K^-1 C + e, pivots : its factors
    step, saved_multiplier : (rows,)
    layout : parts of the mechanism that rows have to do with
    """

    kind: Indices
    acting: Mask
    a: Indices
    b: Indices
    place_a: Array
    place_b: Array
    u: Array
    w: Array
    multiplier: Array
    value: Array
    gradient: Array
    gear: Array
    coupling_terms: Array
    sides: Array
    across: Array
    border: Array
    pivots: Pivots
    step: Array
    saved_multiplier: Array
    layout: Layout


def build_layout(tree: Any, nodes: Sequence[Indices], gear: Array, group: Indices) -> Layout:
    """Return the layout of a border [-] whose rows have to do with the blocks of their ``nodes`` a and b, -1 the world.

    tree : `dofs.Topology`, in a plane `planar.tree.PlanarTree`
    gear : (rows, unknowns) factors of couplings, which have to do with their unknowns
    group : (rows,) the closure or spring of each row, which does not fall
    """
    count = len(gear)
    parts = len(tree.span) - 1
    entries = gear != 0.0
    order = np.argsort(tree.part, kind="stable")  # in which blocks follow each other (`dofs.laid_out`)
    of_block = np.repeat(order, tree.size[order])  # of each unknown
    for node in nodes:
        held = np.flatnonzero(node >= 0)
        entries[held] |= of_block == tree.block[node[held], None]
    of_parts = [entries[:, first:last].any(axis=1) for first, last in pairwise(tree.span)]
    touched = np.array(of_parts, dtype=bool).reshape(parts, count).T
    lengths = np.unique(group, return_counts=True)[1]
    ends = np.cumsum([0, *lengths])
    coupled = np.array([touched[first:last].any(axis=0) for first, last in pairwise(ends)], dtype=bool)
    sides = [np.concatenate([[0], 1 + np.flatnonzero(column)]) for column in touched.T]
    (first_part, part), (first_unknown, unknown) = (
        (_compute_offsets(one.sum(axis=1)), np.nonzero(one)[1].astype(np.int64)) for one in (touched, entries)
    )
    return Layout(
        first_part, tree.span[part], tree.span[part + 1], first_unknown, unknown,
        first_side=_compute_offsets([len(side) for side in sides]), side=np.concatenate(sides).astype(np.int64),
        blocks=build_blocks(lengths.tolist(), coupled.reshape(-1, parts).T),
        whole=build_blocks([count], np.ones((1, 1), dtype=bool)),
    )  # fmt: skip


def _compute_offsets(counts: Any) -> Indices:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def build_border_rows(mesh: Mesh, topology: Topology, by_unknown: Array) -> Ties:
    """Return the border's rows of a mesh: the constraints of its closures [m], [-], then three for each spring [N].

    by_unknown : (nv, unknowns) 1 where an unknown of the march is a joint coordinate
    """
    rows = build_constraint_rows(mesh)
    springs = mesh.mechanism.springs
    kind = np.where(rows.gear.any(axis=1), COUPLING, np.where(rows.direction, DIRECTION, POSITION))
    ends = [spring.first for spring in springs], [spring.second for spring in springs]
    nodes = [np.array([find_attachment_node(mesh, end) for end in one], dtype=np.int64).repeat(3) for one in ends]
    places = [np.array([end.placement.position for end in one]).reshape(-1, 3).repeat(3, axis=0) for one in ends]
    group = rows.closure.max(initial=-1) + 1 + np.arange(len(springs)).repeat(3)
    of_closures = kind, rows.a, rows.b, rows.place_a, rows.place_b, rows.u, rows.w, rows.gear @ by_unknown, rows.closure
    of_springs = PULL, *nodes, *places, 0.0, 0.0, 0.0, group
    kind, a, b, *vectors, gear, group = (
        np.concatenate([one, np.broadcast_to(other, (3 * len(springs), *one.shape[1:]))])
        for one, other in zip(of_closures, of_springs, strict=True)
    )
    return build_ties(kind, (a, b), vectors, gear, build_layout(topology, (a, b), gear, group))


def build_ties(kind: Indices, nodes: Sequence[Indices], vectors: Sequence[Array], gear: Array, layout: Layout) -> Ties:
    """Return rows of the border that all act, without force [m], [-], [N]; vectors : place_a, place_b, u, w."""
    a, b = nodes
    place_a, place_b, u, w = vectors
    n, size = vectors[0].shape
    return Ties(
        kind=kind, acting=np.ones(n, dtype=bool), a=a, b=b, place_a=place_a, place_b=place_b, u=u, w=w, multiplier=np.zeros(n),
        value=np.zeros(n), gradient=np.zeros((n, 12 if size == 3 else 6)), gear=gear, coupling_terms=np.zeros((n, 3)),
        sides=np.zeros(gear.shape), across=np.zeros(gear.shape), border=np.zeros((n, n)), pivots=Pivots.build_for(n),
        step=np.zeros(n), saved_multiplier=np.zeros(n), layout=layout,
    )  # fmt: skip


def update_ties(constraints: Ties, rows: Rows, acting: Mask) -> None:
    """Let the closures of ``acting`` (closures,) act, with the frames [m], [-] that ``rows`` have now; others carry nothing."""
    n = len(rows.closure)
    constraints.acting[:n] = acting[rows.closure]
    constraints.place_b[:n] = rows.place_b
    constraints.w[:n] = rows.w
    constraints.multiplier[:n][~constraints.acting[:n]] = 0.0


@jit_inner
def evaluate_ties(constraints, state, frames, wanted):
    """Set value and gradient of every constraint, and return nothing [m], [-]: phi, phi', or phi'' = u''.w + 2 u'.w' + u.w''."""
    for k in range(len(constraints.a)):
        if constraints.kind[k] == PULL:
            continue
        if constraints.kind[k] == COUPLING:  # sum gear q - offset, or a rate of it, of joints with and without a motion
            value = constraints.coupling_terms[k, wanted]
            rate = state.du if wanted == SECOND_RATES else state.u
            for i in range(constraints.gear.shape[1]):
                if constraints.gear[k, i] != 0.0:
                    value += constraints.gear[k, i] * (state.place[i] + state.d[i] if wanted == VALUES else rate[i])
            constraints.value[k] = value
            continue
        if not constraints.acting[k]:
            constraints.value[k] = 0.0
            constraints.gradient[k] = 0.0
            continue
        u, w = compute_row_vectors(k, constraints, frames)
        if wanted == SECOND_RATES:
            constraints.value[k] = join_rates(u, w)
        elif wanted == RATES:
            constraints.value[k] = dot(u[1], w[0]) + dot(u[0], w[1])
        else:
            constraints.value[k] = dot(u[0], w[0])
        fill_gradient(k, constraints, frames, u[0], w[0])


@jit_inner
def compute_row_vectors(k, constraints, frames):
    """Return the vectors of row k whose product is phi, u, and d or w, each with its two rates, world axes [-], [m]."""
    a = constraints.a[k]
    b = constraints.b[k]
    u = compute_fixed_vector(frames, a, vec(constraints.u[k]))
    if constraints.kind[k] == DIRECTION:
        return u, compute_fixed_vector(frames, b, vec(constraints.w[k]))
    return u, compute_gap(frames, a, b, vec(constraints.place_a[k]), vec(constraints.place_b[k]))


@jit_inner
def join_rates(one, other):
    """Return the second rate of the product of two vectors, each with its two rates: u''.w + 2 u'.w' + u.w'' [any unit]."""
    return dot(one[2], other[0]) + 2.0 * dot(one[1], other[1]) + dot(one[0], other[2])


@jit_inner
def fill_gradient(row, constraints, frames, vector, second):
    """Set the gradient g of a row [-], [m], of phi' = g_a . (v_a, w_a) + g_b . (v_b, w_b), w in the nodes' own frames.

    vector : u, which turns with a, or a fixed one where the row's u is zero; second : d or w; all in the world
    """
    ra = mat(frames.r[constraints.a[row]]) if constraints.a[row] >= 0 else EYE
    rb = mat(frames.r[constraints.b[row]]) if constraints.b[row] >= 0 else EYE
    on_a = cross(vec(constraints.u[row]), tapply(ra, second))
    if constraints.kind[row] == DIRECTION:
        put_pair(constraints.gradient[row], ZERO, on_a)
        put_at(constraints.gradient[row], 6, ZERO)
        put_at(constraints.gradient[row], 9, cross(vec(constraints.w[row]), tapply(rb, vector)))
        return
    put_pair(
        constraints.gradient[row],
        scale(-1.0, vector),
        sub(on_a, cross(vec(constraints.place_a[row]), tapply(ra, vector))),
    )
    put_at(constraints.gradient[row], 6, vector)
    put_at(constraints.gradient[row], 9, cross(vec(constraints.place_b[row]), tapply(rb, vector)))


@jit_inner
def add_ties(constraints, multiplier, wrench):
    """Take the forces of multipliers (rows,), or of their changes, off the wrenches of their nodes, r - C lambda [N], [N m].

    wrench : (nodes, 6), in a plane (nodes, 3)
    """
    size = wrench.shape[1]
    for k in range(len(constraints.a)):
        for i in range(size):
            if constraints.a[k] >= 0:
                wrench[constraints.a[k], i] -= multiplier[k] * constraints.gradient[k, i]
            if constraints.b[k] >= 0:
                wrench[constraints.b[k], i] -= multiplier[k] * constraints.gradient[k, size + i]


@jit_inner
def add_gears(constraints, residual):
    """Take the efforts of the couplings' multipliers off the residual of the unknowns [N m], [N]."""
    for k in range(len(constraints.a)):
        if constraints.kind[k] == COUPLING:
            for i in range(residual.shape[1]):
                residual[0, i] -= constraints.multiplier[k] * constraints.gear[k, i]


@jit_inner
def fill_right_sides(topology, constraints, variation, residual):
    """Put -C, by unknowns, into the right sides 1.. of the solve [N], [N m] per unit multiplier; A = C^T for constraints."""
    plan = constraints.layout
    for k in range(len(constraints.a)):
        for n in range(plan.first_part[k], plan.first_part[k + 1]):
            for i in range(plan.begin[n], plan.end[n]):
                constraints.sides[k, i] = -constraints.gear[k, i]
        for n, first in ((constraints.a[k], 0), (constraints.b[k], 6)):
            force = vec_at(constraints.gradient[k], first)
            moment = vec_at(constraints.gradient[k], first + 3)
            for c in range(topology.width[n] if n >= 0 else 0):
                felt = dot(force, vec(variation.x[n, c])) + dot(moment, vec(variation.t[n, c]))
                constraints.sides[k, topology.first[n] + c] -= felt
        largest = 0.0
        for n in range(plan.first_part[k], plan.first_part[k + 1]):
            for i in range(plan.begin[n], plan.end[n]):
                largest = max(largest, abs(constraints.sides[k, i]))
        moves = not largest < MOVES_NOTHING * topology.length
        for n in range(plan.first_part[k], plan.first_part[k + 1]):
            for i in range(plan.begin[n], plan.end[n]):
                if not moves:
                    constraints.sides[k, i] = 0.0
                residual[1 + k, i] = constraints.sides[k, i]
                if constraints.kind[k] != PULL:
                    constraints.across[k, i] = constraints.sides[k, i]


@jit_inner
def has_acting_closure(constraints):
    """Return True if a closure acts [-]; what springs do needs no second phase of a step."""
    acts = False
    for k in range(len(constraints.a)):
        acts = acts or (constraints.kind[k] != PULL and constraints.acting[k])
    return acts


# A pivot of the border, scaled to a unit diagonal, below this belongs to a redundant row: rounding leaves 1e-14.
REDUNDANT_PIVOT = 1e-10


@jit_inner
def compute_border_factors(constraints, blocks, y):
    """Factor A K^-1 C + e [m/N], [rad/N m], with y (1 + rows, unknowns), y_0 and then K^-1 C; blocks : of the layout."""
    for e in range(blocks.entry.shape[0]):
        i = blocks.entry[e, 0]
        j = blocks.entry[e, 1]
        pull = 1.0 if i == j and constraints.kind[i] == PULL else 0.0
        constraints.border[i, j] = -_compute_row_product(constraints, i, y[1 + j]) - pull
    factorise_blocks(constraints.border, blocks, REDUNDANT_PIVOT, constraints.pivots)


@jit_inner
def solve_border(constraints, blocks, unit, y):
    """Find the increments of the border's unknowns and add what they do to y[0] [m], [rad].

    y : (1 + rows, unknowns), y_0 and then K^-1 C, of the factors at hand; ``unit`` scales the equations of constraints
    """
    plan = constraints.layout
    for k in range(len(constraints.a)):
        given = constraints.value[k] / (1.0 if constraints.kind[k] == PULL else unit)
        constraints.value[k] = _compute_row_product(constraints, k, y[0]) - given
    solve_blocks(constraints.border, blocks, constraints.pivots, constraints.value, constraints.step)
    for k in range(len(constraints.a)):
        constraints.multiplier[k] += constraints.step[k]
        for n in range(plan.first_part[k], plan.first_part[k + 1]):
            for i in range(plan.begin[n], plan.end[n]):
                y[0, i] += constraints.step[k] * y[1 + k, i]


@jit_inner
def _compute_row_product(constraints, k, y):
    """-A y of row k."""
    total = 0.0
    across = constraints.across[k]
    plan = constraints.layout
    for n in range(plan.first_unknown[k], plan.first_unknown[k + 1]):
        total += across[plan.unknown[n]] * y[plan.unknown[n]]
    return total
