"""Closures and springs between points in the tangents of a march: rows of the border beside K, C and M (compiled).

With G the gradients of the closures phi = 0 by the unknowns, and lambda their multipliers, the linear system of a step gets

    (K - d(G^T lambda)/dy) y - G^T dlambda = ...        G y = -(G dy* + dphi/dp)                * : with dd = 0

Rows that repeat others are found by pivoting, as in the march (`dynamics.constraint_rows`).  A row's force turns with the nodes
that it ties: with e = R_A^T d,  on A  (-R_A u, u x e - p_A x u),  on B  (R_A u, p_B x R_B^T R_A u).  Springs are forces of their
lengths and rates: -C A of their rows.  Of accelerations of index 1 phi'' = u''.w + 2 u'.w' + u.w'' is differentiated as well.
"""

from __future__ import annotations

from typing import NamedTuple

from flexinv.constraints.equations import compute_gap
from flexinv.dynamics.assembly import run_forward_pass
from flexinv.dynamics.constraint_rows import (
    COUPLING,
    DIRECTION,
    PULL,
    REDUNDANT_PIVOT,
    compute_row_vectors,
    join_rates,
)
from flexinv.dynamics.linearization import LARGE_FACTOR
from flexinv.kernels.dense import factorise_blocks, solve_blocks, solve_dense
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import EYE, ZERO, add, apply, cross, dot, mat, scale, tapply, vec
from flexinv.typing import Array


@send_by_address
class BorderScratch(NamedTuple):
    """Shares of closures and springs in a linearisation [any unit].

    gradient : (rows, unknowns) G, zero for springs; bent, dragged : (unknowns, unknowns) of K and C, without rows empty
    by_pose, by_rate : (rows, unknowns) derivatives of phi''; across : (rows, unknowns) scratch of springs
    closing : (rows, parameters) what the closures are open by; multiplier : (rows, parameters) derivatives of lambda
    left : (marched, marched) scratch
    """

    gradient: Array
    bent: Array
    dragged: Array
    by_pose: Array
    by_rate: Array
    across: Array
    closing: Array
    multiplier: Array
    left: Array


@jit_inner
def begin_border(system, border):
    """Set G [m], [-], and what the forces of closures and springs add to K where the system stands [N/m]."""
    ties = system.border.ties
    border.bent[:] = 0.0
    for r in range(len(ties.a)):
        pulls = ties.kind[r] == PULL
        for i in range(border.gradient.shape[1]):
            border.gradient[r, i] = 0.0 if pulls else -ties.across[r, i]
            border.across[r, i] = ties.across[r, i]
        if pulls:
            _add_pulls(ties.sides[r], ties.across[r], border.bent)
        elif ties.kind[r] != COUPLING:
            _turn_forces(system, r, border.bent)


@jit_inner
def fill_drags(system, border):
    """Set what springs with dampers add to C [N s/m] after an evaluation with rates weighted by LARGE_FACTOR."""
    ties = system.border.ties
    border.dragged[:] = 0.0
    for r in range(len(ties.a)):
        if ties.kind[r] == PULL:
            slope = border.across[r]
            for j in range(len(slope)):
                slope[j] = (ties.across[r, j] - slope[j]) / LARGE_FACTOR
            _add_pulls(ties.sides[r], slope, border.dragged)


@jit_inner
def _add_pulls(side, across, out):
    """Add -C A of a spring's row, its ``side`` -C and ``across`` -A."""
    for i in range(len(side)):
        if side[i] != 0.0:
            for j in range(len(across)):
                out[i, j] -= side[i] * across[j]


@jit_inner
def apply_spring_forces(ties):
    """Let springs pull with the forces that their lengths ask for [N], after an evaluation; return whether there are any."""
    pulls = False
    for r in range(len(ties.a)):
        if ties.kind[r] == PULL:
            ties.multiplier[r] += ties.value[r]
            pulls = True
    return pulls


@jit_inner
def _turn_forces(system, r, bent):
    """Add how the force of a closure's row turns with the nodes that it ties [N/m], [N m]."""
    ties = system.border.ties
    topology = system.topology
    variation = system.variation
    for m, first in ((ties.a[r], True), (ties.b[r], False)):
        for c in range(topology.width[m] if m >= 0 else 0):
            wrenches = _compute_wrench_slopes(
                ties, r, system.frames, first, vec(variation.x[m, c]), vec(variation.t[m, c])
            )
            column = topology.first[m] + c
            for n, force, moment in (
                (ties.a[r], wrenches[0], wrenches[1]),
                (ties.b[r], wrenches[2], wrenches[3]),
            ):
                for i in range(topology.width[n] if n >= 0 else 0):
                    felt = dot(force, vec(variation.x[n, i])) + dot(moment, vec(variation.t[n, i]))
                    bent[topology.first[n] + i, column] -= ties.multiplier[r] * felt


@jit_inner
def _compute_wrench_slopes(ties, r, frames, first, moved, turned):
    """Slopes of a row's force and moment on A, and of those on B, where A (``first``) or B moves, per unit multiplier."""
    ra = mat(frames.r[ties.a[r]]) if ties.a[r] >= 0 else EYE
    rb = mat(frames.r[ties.b[r]]) if ties.b[r] >= 0 else EYE
    u = vec(ties.u[r])
    w = vec(ties.w[r])
    p = vec(ties.place_b[r])
    if ties.kind[r] == DIRECTION:
        if first:
            on_a = cross(u, scale(-1.0, cross(turned, tapply(ra, apply(rb, w)))))
            on_b = cross(w, tapply(rb, apply(ra, cross(turned, u))))
        else:
            on_a = cross(u, tapply(ra, apply(rb, cross(turned, w))))
            on_b = cross(w, scale(-1.0, cross(turned, tapply(rb, apply(ra, u)))))
        return ZERO, on_a, ZERO, on_b
    if first:
        d = compute_gap(frames, ties.a[r], ties.b[r], vec(ties.place_a[r]), p)[0]
        seen = add(tapply(ra, d), vec(ties.place_a[r]))  # place of B's point in A's frame
        change = scale(-1.0, add(tapply(ra, moved), cross(turned, seen)))
        force = apply(ra, cross(turned, u))
        return scale(-1.0, force), cross(u, change), force, cross(p, tapply(rb, force))
    change = tapply(ra, add(moved, apply(rb, cross(turned, p))))
    on_b = cross(p, scale(-1.0, cross(turned, tapply(rb, apply(ra, u)))))
    return ZERO, cross(u, change), ZERO, on_b


@jit_inner
def add_border_forces(border, roles, role, moves, forces):
    """Add to the forces [N], [N m], in rows of a role, what closures and springs do by poses and rates (unknowns, parameters)."""
    pose, rate = moves
    for i in range(border.bent.shape[0]):
        for j in range(border.bent.shape[1] if roles[i] == role else 0):
            for p in range(forces.shape[1] if border.bent[i, j] != 0.0 else 0):
                forces[i, p] += border.bent[i, j] * pose[j, p]
            for p in range(forces.shape[1] if border.dragged[i, j] != 0.0 else 0):
                forces[i, p] += border.dragged[i, j] * rate[j, p]


@jit_inner
def take_off_multipliers(border, forces):
    """Take the forces G^T dlambda off the forces (unknowns, parameters) [N], [N m]."""
    for r in range(border.gradient.shape[0]):
        for i in range(border.gradient.shape[1]):
            for p in range(forces.shape[1] if border.gradient[r, i] != 0.0 else 0):
                forces[i, p] -= border.gradient[r, i] * border.multiplier[r, p]


@jit_inner
def fill_closing(opened, column, border, moves):
    """Set what closures are open by [m], [-]: G moves + opened; moves (unknowns, parameters), opened (rows, columns)."""
    for r in range(border.closing.shape[0]):
        border.closing[r] = 0.0
        for q in range(len(column)):
            border.closing[r, column[q]] += opened[r, q]
        for i in range(border.gradient.shape[1]):
            for p in range(moves.shape[1] if border.gradient[r, i] != 0.0 else 0):
                border.closing[r, p] += border.gradient[r, i] * moves[i, p]


@jit_inner
def solve_closed(ties, freedoms, border, system):
    """Solve the linear system (marched, marched + parameters + rows) in place so that its solutions close all [-].

    The last columns are G^T; multipliers go to the border.
    """
    size = len(freedoms.marched)
    rows = border.gradient.shape[0]
    last = size + border.closing.shape[1]
    border.multiplier[:] = 0.0
    if size == 0:
        return
    solve_dense(system, size, system.shape[1])
    for r in range(rows):
        for s in range(rows):
            ties.border[r, s] = _compute_row_product(freedoms, border.gradient[r], system, last + s)
    if rows == 0:
        return
    factorise_blocks(ties.border, ties.layout.whole, REDUNDANT_PIVOT, ties.pivots)
    for p in range(border.closing.shape[1]):
        for r in range(rows):
            open_by = border.closing[r, p] if ties.kind[r] != PULL else 0.0
            ties.value[r] = -open_by - _compute_row_product(freedoms, border.gradient[r], system, size + p)
        solve_blocks(ties.border, ties.layout.whole, ties.pivots, ties.value, ties.step)
        for r in range(rows):
            border.multiplier[r, p] = ties.step[r]
            for i in range(size):
                system[i, size + p] += ties.step[r] * system[i, last + r]


@jit_inner
def _compute_row_product(freedoms, gradient, system, column):
    """G y of a row, y a column of the solved system."""
    total = 0.0
    for i in range(len(freedoms.marched)):
        total += gradient[freedoms.marched[i]] * system[i, column]
    return total


@jit_inner
def fill_rate_slopes(system, joints, border):
    """Set the derivatives of phi'' by poses and rates [m/s^2], [1/s^2] per unit where the system stands."""
    ties = system.border.ties
    for which in range(2):
        into = border.by_rate if which == 1 else border.by_pose
        weight = LARGE_FACTOR if which == 1 else 0.0
        run_forward_pass(
            system.topology, system.state, joints, system.frames, system.variation, system.work, (weight, 0.0), True
        )
        for r in range(len(ties.a)):
            into[r] = 0.0
            if ties.kind[r] == PULL or ties.kind[r] == COUPLING:
                continue
            _fill_rate_slope(system, r, into[r])
    for r in range(len(ties.a)):
        for i in range(border.by_rate.shape[1]):
            border.by_rate[r, i] = (border.by_rate[r, i] - border.by_pose[r, i]) / LARGE_FACTOR


@jit_inner
def _fill_rate_slope(system, r, into):
    """Derivative of phi'' of a row by all unknowns, as the variations of the nodes have them."""
    ties = system.border.ties
    topology = system.topology
    frames = system.frames
    variation = system.variation
    a = ties.a[r]
    b = ties.b[r]
    directed = ties.kind[r] == DIRECTION
    u, w = compute_row_vectors(r, ties, frames)
    for c in range(topology.width[a] if a >= 0 else 0):
        at = topology.first[a] + c
        into[at] += join_rates(_compute_vector_slopes(frames, variation, a, c, vec(ties.u[r])), w)
        if not directed:
            into[at] -= join_rates(_compute_point_slopes(frames, variation, a, c, vec(ties.place_a[r])), u)
    for c in range(topology.width[b] if b >= 0 else 0):
        at = topology.first[b] + c
        if directed:
            into[at] += join_rates(_compute_vector_slopes(frames, variation, b, c, vec(ties.w[r])), u)
        else:
            into[at] += join_rates(_compute_point_slopes(frames, variation, b, c, vec(ties.place_b[r])), u)


@jit_inner
def _compute_vector_slopes(frames, variation, n, c, vector):
    """Slopes of a vector fixed in a node, and of its two rates, by unknown c of its block, in the world."""
    r = mat(frames.r[n])
    w = vec(frames.w[n])
    turned = vec(variation.t[n, c])
    spun = vec(variation.w[n, c])
    rate = cross(w, vector)
    change = add(cross(vec(frames.al[n]), vector), cross(w, rate))
    swept = cross(spun, vector)
    second = add(cross(vec(variation.al[n, c]), vector), add(cross(spun, rate), cross(w, swept)))
    return (
        apply(r, cross(turned, vector)),
        apply(r, add(cross(turned, rate), swept)),
        apply(r, add(cross(turned, change), second)),
    )


@jit_inner
def _compute_point_slopes(frames, variation, n, c, place):
    """Slopes of a point fixed in a node, and of its two rates, by unknown c of its block, in the world."""
    x, v, a = _compute_vector_slopes(frames, variation, n, c, place)
    return (
        add(vec(variation.x[n, c]), x),
        add(vec(variation.v[n, c]), v),
        add(vec(variation.a[n, c]), a),
    )
