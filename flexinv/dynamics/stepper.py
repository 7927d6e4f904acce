"""The march itself: Newton on all unknowns of one instant, and the loop over time steps (compiled)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.dynamics.assembly import add_elements, gather, node_wrenches, place
from flexinv.dynamics.bordered_solver import solve_border
from flexinv.dynamics.constraint_rows import ACCELERATIONS as RATED
from flexinv.dynamics.constraint_rows import PULL, RATES, VALUES, Ties, add_gears, add_ties, tie_rows, tie_sides
from flexinv.dynamics.generalized_alpha import (
    ACCELERATION,
    DYNAMIC,
    SQUARED,
    STATIC,
    advance,
    correct,
    largest_increment,
    predict,
)
from flexinv.dynamics.index1 import settle, weigh_massless
from flexinv.dynamics.loads import add_loads, set_loads
from flexinv.dynamics.spring_rows import Pulls, pull_rows, pull_sides, turn_arms
from flexinv.dynamics.tree_solver import solve_tree
from flexinv.kernels.jit import jit, jit_inline, jit_inner
from flexinv.kernels.vec3 import apply, dot, mat, put, put_block, scale, sub, tapply, vec, vec_at
from flexinv.kinematics.tree import Joints

# Newton stops when an increment, relative to the mechanism's length or in radians, is below this; one evaluation
# follows, and as convergence is quadratic the error that is left is about its square: rounding.  (A scheme that may leave more
# lets it stop earlier.)
INCREMENT = 1e-8
MOST_ITERATIONS = 25

# SUDDEN_START is no failure: the march stands at its first instant, and what comes begins in parts (`generalized_alpha.EARLY`).
CONVERGED, NOT_CONVERGED, TURNED_TOO_MUCH, NOT_FINITE, SLIPPED, SUDDEN_START = 0, 1, 2, 3, 4, 5


# A section that turns by less than this in a step has not slipped, whatever carries it: how that turns is not asked.
NO_SLIP = 1.0  # [rad]

# At rest nothing but the closures or springs of the border may hold a passive joint, and the tree alone cannot be solved.
# Its diagonal gets this part of the largest stiffness: Newton's step falls short by as much, rounding by 1e-16 / HELD.
HELD = 4e-11


class Border(NamedTuple):
    """Bordered system beside the tree: closures and springs between points [m], [N]."""

    ties: Ties
    pulls: Pulls


@jit_inline
def evaluate(topology, elements, border, scheme, state, joints, frames, variation, loads, work, want_tangent):
    """Evaluate residual [N], [N m] (and linearisation) at the present unknowns; return -1 or the element that turned too much."""
    level = loads.level[0]
    place(topology, state, joints, frames, variation, scheme.cv, scheme.ca, want_tangent)
    node_wrenches(topology, frames, variation, level, work, want_tangent)
    add_loads(topology, frames, variation, loads, work, want_tangent)
    tie_rows(border.ties, state, frames, RATED if scheme.mode == ACCELERATION else VALUES)
    pull_rows(border.pulls, border.ties, frames, level)
    add_ties(border.ties, work.wrench)
    bad = add_elements(topology, elements, frames, variation, work, scheme.mode != STATIC, want_tangent)
    if bad < 0:
        if want_tangent:
            turn_arms(topology, border.pulls, border.ties, frames, variation, work.dwrench)
        gather(topology, state, frames, joints, variation, loads, work, scheme.cv, scheme.ca, want_tangent)
        add_gears(border.ties, work.residual)
        if want_tangent:
            tie_sides(topology, border.ties, variation, topology.length, work.residual)
            pull_sides(topology, border.pulls, border.ties, frames, variation)
    return bad


@jit_inline
def newton(topology, elements, border, scheme, state, joints, frames, variation, loads, work, y):
    """Solve one instant; return status, iterations (or the bad element), last relative increment [-]."""
    size, last = 0.0, False
    for iteration in range(MOST_ITERATIONS + 1):
        bad = evaluate(topology, elements, border, scheme, state, joints, frames, variation, loads, work, not last)
        if bad >= 0:
            return TURNED_TOO_MUCH, bad, size
        if last or y.shape[1] == 0:
            return CONVERGED, iteration, size
        if scheme.mode == ACCELERATION:
            weigh_massless(topology, work.diagonal)
        elif scheme.mode == STATIC and len(border.ties.a) > 0:
            _hold_loose(topology, work.diagonal)
        solve_tree(topology, elements, variation, work, y)
        solve_border(border.ties, scheme.ca if scheme.mode == ACCELERATION else 1.0, y)
        size = largest_increment(y[0], topology.scale)
        if not np.isfinite(size):
            return NOT_FINITE, iteration, size
        correct(topology, scheme, state, y[0])
        last = size < INCREMENT or SQUARED * size * size < scheme.left or scheme.mode == ACCELERATION
    return NOT_CONVERGED, MOST_ITERATIONS, size


@jit_inner
def _hold_loose(topology, diagonal):
    """Give passive freedoms a stiffness of their own in the linearisation, HELD of the largest; the residual has none.

    Stiffnesses are compared in lengths of the mechanism: N m/rad and N/m of small ones are far apart.
    """
    largest = 0.0
    for b in range(len(topology.size)):
        for k in range(topology.size[b]):
            largest = max(largest, abs(diagonal[b, k, k]) * topology.scale[topology.offset[b] + k] ** 2)
    for n in range(len(topology.parent)):
        b = topology.block[n]
        for i in range(topology.freedoms[n]):
            k = topology.column[n] + i
            diagonal[b, k, k] += HELD * largest / topology.scale[topology.offset[b] + k] ** 2


@jit
def march(
    topology, elements, border, scheme, rates, state, frames, variation, loads, work, y,
    rel, table, efforts, given, out, wrench, internal, energy, multipliers, iterations,
):  # fmt: skip
    """Solve the instants of one chunk, in DYNAMIC mode step after step; fill the histories.

    With closures a step finds positions that meet them, and then the accelerations and multipliers that belong to that state
    (`settle`, scheme ``rates``), which are what is recorded; the integrator goes on with its own.

    rel : Joints with a leading sample axis; table : (samples, loads, 6) wrenches of loads; efforts : (samples, unknowns or 0)
    out : x, r, v, w, a, al (samples, nodes, ...); wrench : (samples, nodes, 6)
    internal : (samples, elements, points, 6); energy : (samples, 3); multipliers : (samples, rows); iterations : (samples,)
    Return status, sample reached, element or iterations, last relative increment [-].
    """
    count, size = 0, 0.0
    for sample in range(rel.p.shape[0]):
        j = Joints(rel.p[sample], rel.dp[sample], rel.ddp[sample], rel.r[sample], rel.w[sample], rel.al[sample])
        set_loads(loads, table[sample], efforts[sample])
        set_given(border.ties, given[sample])
        if scheme.mode == DYNAMIC:
            predict(scheme, state)
        status, count, size = newton(topology, elements, border, scheme, state, j, frames, variation, loads, work, y)
        if status != CONVERGED:
            return status, sample, count, size
        slipped = slips(topology, elements, scheme, state, frames) if scheme.mode == DYNAMIC else -1
        if slipped >= 0:
            return SLIPPED, sample, slipped, size
        settles = scheme.mode == DYNAMIC and any_acts(border.ties)
        if settles:
            keep(state, border.ties)
            settle(topology, border.ties, rates, state, j, frames, variation, loads, work, y)
        record(sample, frames, work, out, wrench, internal, energy)
        for k in range(multipliers.shape[1]):
            multipliers[sample, k] = border.ties.multiplier[k]
        iterations[sample] = count
        if settles:
            restore(state, border.ties)
        advance(topology, scheme, state)
    return CONVERGED, rel.p.shape[0], count, size


@jit_inner
def slips(topology, elements, scheme, state, frames):
    """Return the element of which a section turns by more than pi [rad] in a step beside what carries it, else -1.

    An element sees turns between its sections only up to 2 pi: Newton may have converged some turns away.
    """
    for k in range(len(elements.order)):
        root = elements.nodes[k, 0]
        for i in range(1, elements.order[k] + 1):
            n = elements.nodes[k, i]
            turn = vec_at(state.d, topology.offset[topology.block[n]] + 3)
            if dot(turn, turn) > NO_SLIP * NO_SLIP:
                carried = (
                    vec_at(state.d, topology.offset[topology.block[root]] + 3)
                    if topology.independent[root]
                    else scale(scheme.h, vec(frames.w[root]))
                )
                apart = sub(turn, tapply(mat(frames.r[n]), apply(mat(frames.r[root]), carried)))
                if not dot(apart, apart) <= np.pi * np.pi:
                    return k
    return -1


@jit
def collide(topology, elements, border, rates, state, joints, frames, variation, loads, work, y):
    """Let the acting closures stop the velocities that they do not allow, perfectly plastic: state.u changes [m/s], [rad/s].

    M du - G^T Lambda = 0,  G (u + du) = 0: impulses Lambda [N s], [N m s] are left in ties.step.
    """
    evaluate(topology, elements, border, rates, state, joints, frames, variation, loads, work, True)
    tie_rows(border.ties, state, frames, RATES)
    weigh_massless(topology, work.diagonal)
    for i in range(y.shape[1]):
        work.residual[0, i] = 0.0
    for k in range(len(border.ties.a)):
        border.ties.kept[k] = border.ties.multiplier[k]
        border.ties.value[k] *= 1.0 - border.ties.give[k]
    solve_tree(topology, elements, variation, work, y)
    solve_border(border.ties, rates.ca, y)
    for i in range(y.shape[1]):
        state.u[i] += rates.ca * y[0, i]
    for k in range(len(border.ties.a)):
        border.ties.multiplier[k] = border.ties.kept[k]


@jit_inner
def any_acts(ties):
    """Return True if a closure acts [-]: springs need no second phase."""
    acts = False
    for k in range(len(ties.a)):
        acts = acts or (ties.kind[k] != PULL and ties.acting[k])
    return acts


@jit_inner
def set_given(ties, given):
    """Set what joints with a motion add to the equations of couplings (rows or 0, 3) [rad], [m] and rates."""
    for k in range(given.shape[0]):
        for i in range(3):
            ties.given[k, i] = given[k, i]


@jit_inner
def keep(state, ties):
    """Set aside the integrator's own accelerations [m/s^2], [rad/s^2] and multipliers [N], [N m]."""
    for k in range(len(state.du)):
        state.kept[k] = state.du[k]
    for k in range(len(ties.a)):
        ties.kept[k] = ties.multiplier[k]


@jit_inner
def restore(state, ties):
    """Take back what `keep` set aside [m/s^2], [rad/s^2], [N], [N m]."""
    for k in range(len(state.du)):
        state.du[k] = state.kept[k]
    for k in range(len(ties.a)):
        ties.multiplier[k] = ties.kept[k]


@jit_inner
def record(sample, frames, work, out, wrench, internal, energy):
    """Copy one instant into the histories [m, rad, s, N, J]."""
    for n in range(frames.x.shape[0]):
        put(out.x[sample, n], 0, vec(frames.x[n]))
        put_block(out.r[sample, n], 0, 0, mat(frames.r[n]))
        put(out.v[sample, n], 0, vec(frames.v[n]))
        put(out.w[sample, n], 0, vec(frames.w[n]))
        put(out.a[sample, n], 0, vec(frames.a[n]))
        put(out.al[sample, n], 0, vec(frames.al[n]))
        for i in range(6):
            wrench[sample, n, i] = work.wrench[n, i]
    for k in range(work.internal.shape[0]):
        for point in range(work.internal.shape[1]):
            for i in range(6):
                internal[sample, k, point, i] = work.internal[k, point, i]
    put(energy[sample], 0, vec(work.energy))
