"""The march itself: Newton on all unknowns of one instant, and the loop over time steps (compiled)."""

from __future__ import annotations

import numpy as np
from numba import njit

from flexinv.assemble import add_elements, gather, node_wrenches, place
from flexinv.eliminate import solve_tree
from flexinv.integrate import ACCELERATION, advance, correct, predict
from flexinv.tree import Joints

# Newton stops when an increment, relative to the mechanism's length or in radians, is below this; one evaluation
# follows, and as convergence is quadratic the error that is left is about its square: rounding.
INCREMENT = 1e-8
MOST_ITERATIONS = 25

# In an ACCELERATION solve inertia stands 1e30 (`integrate.ACCELERATIONS`) above stiffness: what is this far below the
# largest inertia has none.
MASSLESS = 1e-16

CONVERGED, NOT_CONVERGED, TURNED_TOO_MUCH, NOT_FINITE = 0, 1, 2, 3


@njit(cache=True)
def evaluate(t, e, c, s, j, f, d, loads, work, want_tangent):
    """Evaluate residual (and linearisation) at the present unknowns; return -1 or the element that turned too much."""
    place(t, s, j, f, d, c.cv, c.ca)
    node_wrenches(t, f, d, loads, work)
    bad = add_elements(t, e, f, d, work, want_tangent)
    if bad < 0:
        gather(t, s, f, j, d, work, c.cv, c.ca)
    return bad


@njit(cache=True)
def newton(t, e, c, s, j, f, d, loads, work, y):
    """Solve one instant; return status, iterations (or the bad element), last relative increment [-]."""
    size, last = 0.0, False
    for iteration in range(MOST_ITERATIONS + 1):
        bad = evaluate(t, e, c, s, j, f, d, loads, work, not last)
        if bad >= 0:
            return TURNED_TOO_MUCH, bad, size
        if last or len(y) == 0:
            return CONVERGED, iteration, size
        if c.mode == ACCELERATION:
            _weigh_massless(work.diagonal)
        solve_tree(t, e, d, work, y)
        size = np.max(np.abs(y) / t.scale)
        if not np.isfinite(size):
            return NOT_FINITE, iteration, size
        correct(t, c, s, y)
        last = size < INCREMENT or c.mode == ACCELERATION
    return NOT_CONVERGED, MOST_ITERATIONS, size


@njit(cache=True)
def _weigh_massless(diagonal):
    """Make freedoms without inertia (no term in ca) so heavy that their acceleration stays that of the rigid motion."""
    largest = np.max(np.abs(diagonal))
    for b in range(diagonal.shape[0]):
        for k in range(diagonal.shape[1]):
            if np.abs(diagonal[b, k, k]) < MASSLESS * largest:
                diagonal[b, k, k] = largest


@njit(cache=True)
def march(t, e, c, s, f, d, loads, work, y, rel, out, wrench, internal, energy, iterations, first):
    """Advance over the samples of one chunk, from sample ``first`` on; fill the histories.

    rel : Joints with a leading sample axis; out : x, r, v, w, a, al (samples, nodes, ...); wrench : (samples, nodes, 6)
    internal : (samples, elements, points, 6); energy : (samples, 2); iterations : (samples,)
    Return status, sample reached, element or iterations, last relative increment.
    """
    for sample in range(first, rel.p.shape[0]):
        j = Joints(rel.p[sample], rel.dp[sample], rel.ddp[sample], rel.r[sample], rel.w[sample], rel.al[sample])
        predict(c, s)
        status, count, size = newton(t, e, c, s, j, f, d, loads, work, y)
        if status != CONVERGED:
            return status, sample, count, size
        record(sample, f, work, out, wrench, internal, energy)
        iterations[sample] = count
        advance(t, c, s)
    return CONVERGED, rel.p.shape[0], 0, 0.0


@njit(cache=True)
def record(sample, f, work, out, wrench, internal, energy):
    """Copy one instant into the histories [m, rad, s, N, J]."""
    out.x[sample], out.r[sample], out.v[sample] = f.x, f.r, f.v
    out.w[sample], out.a[sample], out.al[sample] = f.w, f.a, f.al
    wrench[sample], internal[sample], energy[sample] = work.wrench, work.internal, work.energy
