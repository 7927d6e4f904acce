"""The march in a plane: time steps of generalized-alpha with a linearisation that is kept while it serves (compiled).

The same scheme, equations and accuracy as `march`; in the plane positions and angles are a vector space, x_(n+1) = x_n + d.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.assemble import LARGEST_TURN
from flexinv.compiled import jit, jit_inner
from flexinv.integrate import follow, largest_increment, pseudo_acceleration
from flexinv.march import CONVERGED, MOST_ITERATIONS, NOT_CONVERGED, NOT_FINITE, TURNED_TOO_MUCH
from flexinv.mechanism import Array
from flexinv.planar_beam import N1, N2, M, add_forces, energy, interpolate, point, point_gradients, point_hessians
from flexinv.planar_solve import factorise, put_stiffness, solve
from flexinv.planar_tree import (
    gather,
    gather_variations,
    node_wrench_variations,
    node_wrenches,
    place,
    vary,
    vary_independent,
)

# When the iterations of a step end.  A fresh linearisation leaves the square of an increment, times 1e3 or so where axial
# stiffness meets bending: after FRESH that is 1e-17.  A kept one leaves SLOW times it or less: after KEPT that is 1e-16.
FRESH = 1e-10
KEPT = 5e-15
# A linearisation that shrinks increments by less than SLOW is made anew: that costs about as much as three iterations.  It
# serves the next step too if it has shrunk them to QUICK in this one.
SLOW = 0.02
QUICK = 1e-4


class PlanarWork(NamedTuple):
    """Scratch of the march: points of `planar_beam`, u (count, 3), felt (elements, count, 3), residual and y (unknowns,)."""

    points: Array
    u: Array
    felt: Array
    residual: Array
    y: Array


class Embedding(NamedTuple):
    """How the plane lies in space.

    axes : (3, 3) columns: the plane's x, y and its normal, in the world; height : of the plane along the normal [m]
    across, along, normal : (nodes, 3, 3) R_W,node = cos(theta) across + sin(theta) along + normal
    axle : (nodes, 3) the normal in the nodes' frames; side : (elements, 3) J e_1 in the section frames
    """

    axes: Array
    height: float
    across: Array
    along: Array
    normal: Array
    axle: Array
    side: Array


class Histories(NamedTuple):
    """Where the samples are written (`kinematics.Trajectory`): x, r, v, w, a, al, wrench, internal, energy, iterations."""

    x: Array
    r: Array
    v: Array
    w: Array
    a: Array
    al: Array
    wrench: Array
    internal: Array
    energy: Array
    iterations: NDArray[np.int64]


@jit_inner
def evaluate(t, e, s, given, f, q, w):
    """Evaluate the residual [N], [N m] at the present unknowns; return the largest turn [rad] in an element, and which."""
    place(t, s, given, f)
    node_wrenches(t, f)
    largest, worst = interpolate(e, f.pose, w.u, w.points)
    point_gradients(e, w.points)
    add_forces(e, f.pose, w.points, f.wrench, w.felt)
    gather(t, s, f, w.residual)
    return largest, worst


@jit_inner
def linearise(t, e, c, s, f, q, w):
    """Make and eliminate the linearisation at the state that `evaluate` has seen last [N/m], [N], [N m]."""
    vary(t, f, c.cv, c.ca)
    node_wrench_variations(t, f)
    point_hessians(e, w.points)
    put_stiffness(t, e, w.points, f, q)
    gather_variations(t, s, f, q.diagonal, c.cv, c.ca)
    factorise(t, e, f, q)


@jit_inner
def newton(t, e, c, s, given, f, q, w, slowest):
    """Solve one step; return status, iterations (or the bad element), last relative increment [-], and the slowest shrinking.

    slowest : that of the step before [-], which decides whether its linearisation is kept
    """
    size, before, fresh, last = 0.0, 0.0, slowest > QUICK, False
    slowest = 0.0
    for iteration in range(MOST_ITERATIONS + 1):
        turned, worst = evaluate(t, e, s, given, f, q, w)
        if not turned <= LARGEST_TURN:
            return TURNED_TOO_MUCH, worst, size, slowest
        if last or len(w.y) == 0:
            return CONVERGED, iteration, size, slowest
        if fresh:
            linearise(t, e, c, s, f, q, w)
        solve(t, e, q, w.residual, w.y)
        before, size = size, largest_increment(w.y, t.scale)
        if not np.isfinite(size):
            return NOT_FINITE, iteration, size, slowest
        for k in range(len(w.y)):
            s.d[k] += w.y[k]
            s.u[k] += c.cv * w.y[k]
            s.du[k] += c.ca * w.y[k]
        last = size < (FRESH if fresh else KEPT)
        shrunk = size / before if iteration > 0 and not last else 0.0
        slowest, fresh = max(slowest, shrunk), shrunk > SLOW
    return NOT_CONVERGED, MOST_ITERATIONS, size, slowest


@jit_inner
def start(c, s):
    """Start a step where the auxiliary accelerations go on changing as they did in the last [m, rad, s]."""
    for k in range(len(s.d)):
        s.d[k] = c.h * s.u0[k] + c.h * c.h * (0.5 * s.pseudo[k] + c.beta * s.trend[k])
    follow(c, s)


@jit_inner
def advance(t, c, s):
    """Finish a step: its end becomes the start of the next [m, rad, s]."""
    for n in range(len(t.parent)):
        o = t.offset[t.block[n]]
        if t.independent[n]:
            for i in range(3):
                s.start[n, i] += s.d[o + i]
        elif t.column[n] >= 0:
            s.start[n, 0] += s.d[o + t.column[n]]
    for k in range(len(s.d)):
        pseudo = pseudo_acceleration(c, s, k)
        s.trend[k] = pseudo - s.pseudo[k]
        s.pseudo[k], s.u0[k], s.du0[k] = pseudo, s.u[k], s.du[k]
        s.d[k] = 0.0


@jit
def planar_march(t, e, space, c, s, f, q, w, given, row, out):
    """March over the steps of one chunk and write the samples that are asked for.

    given : (steps, joints, 3) q, q', q'' of the prescribed joints [m, rad, s]; row : (steps,) of the histories, -1 for none
    Return status, step reached, element or iterations, last relative increment [-].
    """
    count, size, slowest = 0, 0.0, np.inf
    vary_independent(t, f, c.cv, c.ca)
    for step in range(given.shape[0]):
        start(c, s)
        status, count, size, slowest = newton(t, e, c, s, given[step], f, q, w, slowest)
        if status != CONVERGED:
            return status, step, count, size
        if row[step] >= 0:
            record(row[step], t, e, space, f, w, out)
            out.iterations[row[step]] = count
        advance(t, c, s)
    return CONVERGED, given.shape[0], count, size


@jit_inner
def record(sample, t, e, space, f, w, out):
    """Write one instant into the histories, in space [m, rad, s, N, J]."""
    for n in range(len(t.parent)):
        _embed(space.axes, f.pose[n], space.height, out.x[sample, n])
        _embed(space.axes, f.rate[n], 0.0, out.v[sample, n])
        _embed(space.axes, f.acceleration[n], 0.0, out.a[sample, n])
        _embed(space.axes, f.wrench[n], 0.0, out.wrench[sample, n])
        c, s = np.cos(f.pose[n, 2]), np.sin(f.pose[n, 2])
        for i in range(3):
            out.w[sample, n, i] = f.rate[n, 2] * space.axle[n, i]
            out.al[sample, n, i] = f.acceleration[n, 2] * space.axle[n, i]
            out.wrench[sample, n, 3 + i] = f.wrench[n, 2] * space.axle[n, i]
            for j in range(3):
                turned = c * space.across[n, i, j] + s * space.along[n, i, j]
                out.r[sample, n, i, j] = turned + space.normal[n, i, j]
    power = 0.0
    for k in range(len(e.order)):
        for i in range(e.order[k] + 1):
            rate, felt = f.rate[e.nodes[k, i]], w.felt[k, i]
            power += felt[0] * rate[0] + felt[1] * rate[1] + felt[2] * rate[2]
        _resultants(k, e, space, w.points, out.internal[sample, k])
    out.energy[sample, 0], out.energy[sample, 1] = energy(e, w.points), power


@jit_inner
def _embed(axes, v, height, out):
    """A vector of the plane, and a height above it, in the world."""
    for i in range(3):
        out[i] = axes[i, 0] * v[0] + axes[i, 1] * v[1] + axes[i, 2] * height


@jit_inner
def _resultants(k, e, space, p, internal):
    """Stress resultants of one element in its section frame: n_1 e_1 + n_2 side, m normal."""
    side, axle = space.side[k], space.axle[e.nodes[k, 0]]
    for g in range(e.order[k]):
        at = point(k, g, e.shape.shape[1])
        n1, n2, m = p[at + N1], p[at + N2], p[at + M]
        for i in range(3):
            internal[g, i], internal[g, 3 + i] = n2 * side[i], m * axle[i]
        internal[g, 0] = n1
