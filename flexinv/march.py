"""The march itself: Newton on all unknowns of one instant, and the loop over time steps (compiled)."""

from __future__ import annotations

import numpy as np

from flexinv.assemble import add_elements, gather, node_wrenches, place
from flexinv.compiled import jit, jit_inline, jit_inner
from flexinv.eliminate import solve_tree
from flexinv.integrate import ACCELERATION, DYNAMIC, advance, correct, predict
from flexinv.ties import add_ties, solve_border, tie_rows, tie_sides
from flexinv.tree import Joints
from flexinv.vectors import mat, put, put_block, vec

# Newton stops when an increment, relative to the mechanism's length or in radians, is below this; one evaluation
# follows, and as convergence is quadratic the error that is left is about its square: rounding.
INCREMENT = 1e-8
MOST_ITERATIONS = 25

# In an ACCELERATION solve inertia stands 1e30 (`integrate.ACCELERATIONS`) above stiffness: what is this far below the
# largest inertia has none.
MASSLESS = 1e-16

CONVERGED, NOT_CONVERGED, TURNED_TOO_MUCH, NOT_FINITE = 0, 1, 2, 3


@jit_inline
def evaluate(t, e, ties, c, s, j, f, d, loads, work, want_tangent):
    """Evaluate residual [N], [N m] (and linearisation) at the present unknowns; return -1 or the element that turned too much."""
    place(t, s, j, f, d, c.cv, c.ca, want_tangent)
    node_wrenches(t, f, d, loads, work, want_tangent)
    tie_rows(ties, f, c.mode == ACCELERATION)
    add_ties(ties, work.wrench)
    bad = add_elements(t, e, f, d, work, want_tangent)
    if bad < 0:
        gather(t, s, f, j, d, work, c.cv, c.ca, want_tangent)
        if want_tangent:
            tie_sides(t, ties, d, work.residual)
    return bad


@jit_inline
def newton(t, e, ties, c, s, j, f, d, loads, work, y):
    """Solve one instant; return status, iterations (or the bad element), last relative increment [-]."""
    size, last = 0.0, False
    for iteration in range(MOST_ITERATIONS + 1):
        bad = evaluate(t, e, ties, c, s, j, f, d, loads, work, not last)
        if bad >= 0:
            return TURNED_TOO_MUCH, bad, size
        if last or y.shape[1] == 0:
            return CONVERGED, iteration, size
        if c.mode == ACCELERATION:
            _weigh_massless(t, work.diagonal)
        solve_tree(t, e, d, work, y)
        solve_border(ties, c.ca if c.mode == ACCELERATION else 1.0, y)
        size = _largest(y[0], t.scale)
        if not np.isfinite(size):
            return NOT_FINITE, iteration, size
        correct(t, c, s, y[0])
        last = size < INCREMENT or c.mode == ACCELERATION
    return NOT_CONVERGED, MOST_ITERATIONS, size


@jit_inner
def _largest(y, scale):
    """Largest increment relative to its scale; not a number if one of them is not."""
    largest = 0.0
    for k in range(len(y)):
        size = abs(y[k]) / scale[k]
        if not size <= largest:
            largest = size
        if not np.isfinite(size):
            return size
    return largest


@jit_inner
def _weigh_massless(t, diagonal):
    """Make freedoms without inertia (no term in ca) so heavy that their acceleration stays that of the rigid motion."""
    largest = 0.0
    for b in range(len(t.size)):
        for k in range(t.size[b]):
            for i in range(t.size[b]):
                largest = max(largest, abs(diagonal[b, k, i]))
    for b in range(len(t.size)):
        for k in range(t.size[b]):
            if abs(diagonal[b, k, k]) < MASSLESS * largest:
                diagonal[b, k, k] = largest


@jit
def march(t, e, ties, c, rates, s, f, d, loads, work, y, rel, out, wrench, internal, energy, multipliers, iterations):
    """Solve the instants of one chunk, in DYNAMIC mode step after step; fill the histories.

    With closures every step has two phases: positions that meet them (scheme c), and then the accelerations and multipliers
    that belong to that state (scheme ``rates``, index 1), which are what is recorded; the integrator goes on with its own.

    rel : Joints with a leading sample axis; out : x, r, v, w, a, al (samples, nodes, ...); wrench : (samples, nodes, 6)
    internal : (samples, elements, points, 6); energy : (samples, 2); multipliers : (samples, rows); iterations : (samples,)
    Return status, sample reached, element or iterations, last relative increment [-].
    """
    count, size = 0, 0.0
    for sample in range(rel.p.shape[0]):
        j = Joints(rel.p[sample], rel.dp[sample], rel.ddp[sample], rel.r[sample], rel.w[sample], rel.al[sample])
        if c.mode == DYNAMIC:
            predict(c, s)
        for phase in range(2 if c.mode == DYNAMIC and len(ties.a) > 0 else 1):
            if phase == 1:
                keep(s, ties)
            status, done, size = newton(t, e, ties, c if phase == 0 else rates, s, j, f, d, loads, work, y)
            if status != CONVERGED:
                return status, sample, done, size
            count = done if phase == 0 else count
        record(sample, f, work, out, wrench, internal, energy)
        for k in range(len(ties.a)):
            multipliers[sample, k] = ties.multiplier[k]
        iterations[sample] = count
        if phase == 1:
            restore(s, ties)
        advance(t, c, s)
    return CONVERGED, rel.p.shape[0], count, size


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
    energy[sample, 0], energy[sample, 1] = work.energy[0], work.energy[1]
