"""The march itself: Newton on all unknowns of one instant, and the loop over time steps (compiled)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.assemble import add_elements, gather, node_wrenches, place
from flexinv.border import solve_border
from flexinv.compiled import jit, jit_inline, jit_inner
from flexinv.eliminate import solve_tree
from flexinv.integrate import ACCELERATION, DYNAMIC, SQUARED, STATIC, advance, correct, largest_increment, predict
from flexinv.loads import add_loads, set_loads
from flexinv.pulls import Pulls, pull_rows, pull_sides, turn_arms
from flexinv.settle import settle, weigh_massless
from flexinv.ties import ACCELERATIONS as RATED
from flexinv.ties import PULL, RATES, VALUES, Ties, add_gears, add_ties, tie_rows, tie_sides
from flexinv.tree import Joints
from flexinv.vectors import mat, put, put_block, vec

# Newton stops when an increment, relative to the mechanism's length or in radians, is below this; one evaluation
# follows, and as convergence is quadratic the error that is left is about its square: rounding.  (A scheme that may leave more
# lets it stop earlier.)
INCREMENT = 1e-8
MOST_ITERATIONS = 25

CONVERGED, NOT_CONVERGED, TURNED_TOO_MUCH, NOT_FINITE = 0, 1, 2, 3


# At rest nothing but the closures or springs of the border may hold a passive joint, and the tree alone cannot be solved.
# Its diagonal gets this part of the largest stiffness: Newton's step falls short by as much, rounding by 1e-16 / HELD.
HELD = 1e-10


class Border(NamedTuple):
    """What stands beside the tree: closures and springs between points [m], [N]."""

    ties: Ties
    pulls: Pulls


@jit_inline
def evaluate(t, e, b, c, s, j, f, d, loads, work, want_tangent):
    """Evaluate residual [N], [N m] (and linearisation) at the present unknowns; return -1 or the element that turned too much."""
    level = loads.level[0]
    place(t, s, j, f, d, c.cv, c.ca, want_tangent)
    node_wrenches(t, f, d, level, work, want_tangent)
    add_loads(t, f, d, loads, work, want_tangent)
    tie_rows(b.ties, s, f, RATED if c.mode == ACCELERATION else VALUES)
    pull_rows(b.pulls, b.ties, f, level)
    add_ties(b.ties, work.wrench)
    bad = add_elements(t, e, f, d, work, c.mode != STATIC, want_tangent)
    if bad < 0:
        if want_tangent:
            turn_arms(t, b.pulls, b.ties, f, d, work.dwrench)
        gather(t, s, f, j, d, loads, work, c.cv, c.ca, want_tangent)
        add_gears(b.ties, work.residual)
        if want_tangent:
            tie_sides(t, b.ties, d, t.length, work.residual)
            pull_sides(t, b.pulls, b.ties, f, d)
    return bad


@jit_inline
def newton(t, e, b, c, s, j, f, d, loads, work, y):
    """Solve one instant; return status, iterations (or the bad element), last relative increment [-]."""
    size, last = 0.0, False
    for iteration in range(MOST_ITERATIONS + 1):
        bad = evaluate(t, e, b, c, s, j, f, d, loads, work, not last)
        if bad >= 0:
            return TURNED_TOO_MUCH, bad, size
        if last or y.shape[1] == 0:
            return CONVERGED, iteration, size
        if c.mode == ACCELERATION:
            weigh_massless(t, work.diagonal)
        elif c.mode == STATIC and len(b.ties.a) > 0:
            _hold_loose(t, work.diagonal)
        solve_tree(t, e, d, work, y)
        solve_border(b.ties, c.ca if c.mode == ACCELERATION else 1.0, y)
        size = largest_increment(y[0], t.scale)
        if not np.isfinite(size):
            return NOT_FINITE, iteration, size
        correct(t, c, s, y[0])
        last = size < INCREMENT or SQUARED * size * size < c.left or c.mode == ACCELERATION
    return NOT_CONVERGED, MOST_ITERATIONS, size


@jit_inner
def _hold_loose(t, diagonal):
    """Give passive freedoms a stiffness of their own in the linearisation, HELD of the largest; the residual has none."""
    largest = 0.0
    for b in range(len(t.size)):
        for k in range(t.size[b]):
            largest = max(largest, abs(diagonal[b, k, k]))
    for n in range(len(t.parent)):
        for i in range(t.freedoms[n]):
            diagonal[t.block[n], t.column[n] + i, t.column[n] + i] += HELD * largest


@jit
def march(
    t, e, b, c, rates, s, f, d, loads, work, y, rel, table, efforts, given, out, wrench, internal, energy, multipliers, iterations
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
        set_given(b.ties, given[sample])
        if c.mode == DYNAMIC:
            predict(c, s)
        status, count, size = newton(t, e, b, c, s, j, f, d, loads, work, y)
        if status != CONVERGED:
            return status, sample, count, size
        settles = c.mode == DYNAMIC and any_acts(b.ties)
        if settles:
            keep(s, b.ties)
            settle(t, b.ties, rates, s, j, f, d, loads, work, y)
        record(sample, f, work, out, wrench, internal, energy)
        for k in range(multipliers.shape[1]):
            multipliers[sample, k] = b.ties.multiplier[k]
        iterations[sample] = count
        if settles:
            restore(s, b.ties)
        advance(t, c, s)
    return CONVERGED, rel.p.shape[0], count, size


@jit
def collide(t, e, b, rates, s, j, f, d, loads, work, y):
    """Let the acting closures stop the velocities that they do not allow, perfectly plastic: s.u changes [m/s], [rad/s].

    M du - G^T Lambda = 0,  G (u + du) = 0: impulses Lambda [N s], [N m s] are left in ties.step.
    """
    evaluate(t, e, b, rates, s, j, f, d, loads, work, True)
    tie_rows(b.ties, s, f, RATES)
    weigh_massless(t, work.diagonal)
    for i in range(y.shape[1]):
        work.residual[0, i] = 0.0
    for k in range(len(b.ties.a)):
        b.ties.kept[k] = b.ties.multiplier[k]
        b.ties.value[k] *= 1.0 - b.ties.give[k]
    solve_tree(t, e, d, work, y)
    solve_border(b.ties, rates.ca, y)
    for i in range(y.shape[1]):
        s.u[i] += rates.ca * y[0, i]
    for k in range(len(b.ties.a)):
        b.ties.multiplier[k] = b.ties.kept[k]


@jit_inner
def any_acts(ties):
    """Whether a closure acts [-]: springs need no second phase."""
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
def keep(s, ties):
    """Set aside the integrator's own accelerations [m/s^2], [rad/s^2] and multipliers [N], [N m]."""
    for k in range(len(s.du)):
        s.kept[k] = s.du[k]
    for k in range(len(ties.a)):
        ties.kept[k] = ties.multiplier[k]


@jit_inner
def restore(s, ties):
    """Take back what `keep` set aside [m/s^2], [rad/s^2], [N], [N m]."""
    for k in range(len(s.du)):
        s.du[k] = s.kept[k]
    for k in range(len(ties.a)):
        ties.multiplier[k] = ties.kept[k]


@jit_inner
def record(sample, f, work, out, wrench, internal, energy):
    """Copy one instant into the histories [m, rad, s, N, J]."""
    for n in range(f.x.shape[0]):
        put(out.x[sample, n], 0, vec(f.x[n]))
        put_block(out.r[sample, n], 0, 0, mat(f.r[n]))
        put(out.v[sample, n], 0, vec(f.v[n]))
        put(out.w[sample, n], 0, vec(f.w[n]))
        put(out.a[sample, n], 0, vec(f.a[n]))
        put(out.al[sample, n], 0, vec(f.al[n]))
        for i in range(6):
            wrench[sample, n, i] = work.wrench[n, i]
    for k in range(work.internal.shape[0]):
        for point in range(work.internal.shape[1]):
            for i in range(6):
                internal[sample, k, point, i] = work.internal[k, point, i]
    put(energy[sample], 0, vec(work.energy))
