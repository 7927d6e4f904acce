"""The march in a plane: time steps of generalized-alpha, one linearisation for all iterations of a step (compiled).

The same scheme, equations and accuracy as `march`; in the plane positions and angles are a vector space, x_(n+1) = x_n + d.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.assemble import LARGEST_TURN
from flexinv.compiled import jit, jit_inner
from flexinv.damped_plane import add_viscous, add_viscous_hessians, interpolate_rates
from flexinv.integrate import ACCELERATION, ACCELERATIONS, SQUARED, follow, largest_increment, pseudo_acceleration
from flexinv.march import CONVERGED, MOST_ITERATIONS, NOT_CONVERGED, NOT_FINITE, TURNED_TOO_MUCH
from flexinv.mechanism import Array
from flexinv.planar_beam import (
    add_forces,
    interpolate,
    point_gradients,
    point_hessians,
    relax,
)
from flexinv.planar_record import record
from flexinv.planar_settle import settle
from flexinv.planar_solve import factorise, put_stiffness, solve
from flexinv.planar_ties import (
    add_step,
    add_ties,
    any_acts,
    factorise_ties,
    keep,
    return_to,
    solve_ties,
    tie_rows,
)
from flexinv.planar_tree import (
    accept,
    gather,
    gather_variations,
    node_wrench_variations,
    node_wrenches,
    place,
    stand,
    vary,
    vary_independent,
)

# Newton stops when what an iteration leaves is below that of the scheme: its increment times what it shrank the one before to
# (and no less than SURE of it), or with a new linearisation the square (`integrate.SQUARED`).  Increments below ROUNDING say
# nothing more.
SURE = 1e-6
ROUNDING = 5e-15
# With damping no linearisation is exact (`damped_plane`), and rates add rounding of their own: an increment below this that
# shrinks no more is rounding.
STALLED = 1e-12
# A linearisation serves all iterations of a step, unless it shrinks an increment by less than SLOW: a new one costs as much as
# two iterations or three.  (That of the step before, even turned with the mechanism, costs two iterations more: dearer.)
SLOW = 0.03
# A step that takes more iterations than this is begun anew, cautiously: there may be another solution where it gets to.
MANY = 12


class PlanarWork(NamedTuple):
    """Scratch of the march: points of `planar_beam`, u (count, 3), felt (elements, count, 3), residual and y (unknowns,).

    rates : of `damped_plane`, empty where no beam is damped
    """

    points: Array
    rates: Array
    u: Array
    felt: Array
    residual: Array
    y: Array


@jit_inner
def evaluate(t, e, k, s, given, f, w, moved):
    """Evaluate the residual [N], [N m] at the present unknowns; return the largest turn [rad] in an element, and which.

    moved : whether poses or rates have changed since the last evaluation, and with them what the elements feel
    """
    place(t, s, given, f)
    tie_rows(k, f, False)
    largest, worst = 0.0, 0
    if moved:
        largest, worst = interpolate(e, f.pose, w.u, w.points)
        point_gradients(e, w.points)
        if len(e.damping) > 0:
            interpolate_rates(e, f.rate, w.rates)
            add_viscous(e, w.points, w.rates)
    add_up(t, e, k, s, f, w)
    return largest, worst


@jit_inner
def add_up(t, e, k, s, f, w):
    """Sum the wrenches of inertia, closures and elements to the residual [N], [N m]."""
    node_wrenches(t, f)
    add_ties(k, f.wrench)
    add_forces(e, f.pose, w.points, f.wrench, w.felt)
    gather(t, s, f, w.residual)


@jit_inner
def linearise(t, e, k, c, s, f, q, w):
    """Make and eliminate the linearisation at the state that `evaluate` has seen last [N/m], [N], [N m]."""
    vary(t, f, c.cv, c.ca)
    node_wrench_variations(t, f)
    point_hessians(e, w.points)
    if len(e.damping) > 0:
        add_viscous_hessians(e, c.cv, w.points, w.rates)
    put_stiffness(t, e, w.points, f, q)
    gather_variations(t, s, f, q.diagonal, c.cv, c.ca)
    factorise(t, e, f, q)
    factorise_ties(t, e, k, f, q)


@jit_inner
def newton(t, e, k, c, s, given, f, q, w, slow, most):
    """Solve one step; return status, iterations (or the bad element), last relative increment [-].

    Where only accelerations are asked for, the state stands still.
    slow : shrinking of an increment [-] from which on the linearisation is made anew, 0 for every time; most : iterations
    """
    size, fresh, last, damped = 0.0, True, c.mode == ACCELERATION, len(e.damping) > 0
    for iteration in range(most + 1):
        turned, worst = evaluate(t, e, k, s, given, f, w, c.mode != ACCELERATION)
        if not turned <= LARGEST_TURN:
            return TURNED_TOO_MUCH, worst, size
        if last or len(w.y) == 0:
            return CONVERGED, iteration, size
        if fresh:
            linearise(t, e, k, c, s, f, q, w)
        solve(t, e, q, w.residual, w.y, False)
        solve_ties(t, k, w.y)
        before, size = size, largest_increment(w.y, t.scale)
        if not np.isfinite(size):
            return NOT_FINITE, iteration, size
        add_step(k)
        for i in range(len(w.y)):
            s.d[i] += w.y[i]
            s.u[i] += c.cv * w.y[i]
            s.du[i] += c.ca * w.y[i]
        shrunk = size / before if iteration > 0 else 1.0
        leaves = SQUARED * size * size if fresh and not damped else size * max(shrunk, SURE)
        last = size < ROUNDING or leaves < c.left
        last = last or (damped and iteration > 0 and shrunk > 0.5 and size < STALLED)
        fresh = shrunk > slow if iteration > 0 else slow == 0.0
    return NOT_CONVERGED, most, size


@jit_inner
def start(c, s, order):
    """Start a step where the auxiliary accelerations go on as a parabola (2), a line (1) or as they are (0) [m, rad, s]."""
    for k in range(len(s.d)):
        change = (s.trend[k] if order > 0 else 0.0) + (s.bend[k] if order > 1 else 0.0)
        s.d[k] = c.h * s.u0[k] + c.h * c.h * (0.5 * s.pseudo[k] + c.beta * change)
    follow(c, s)


@jit_inner
def advance(t, c, s):
    """Finish a step: its end becomes the start of the next [m, rad, s]; return the order that would have served best."""
    for n in range(len(t.parent)):
        o = t.offset[t.block[n]]
        if t.independent[n]:
            for i in range(3):
                s.start[n, i] += s.d[o + i]
        elif t.column[n] >= 0:
            s.start[n, 0] += s.d[o + t.column[n]]
    still, line, parabola = 0.0, 0.0, 0.0
    for k in range(len(s.d)):
        pseudo = pseudo_acceleration(c, s, k)
        trend = pseudo - s.pseudo[k]
        bend = trend - s.trend[k]
        still, line = still + abs(trend) / t.scale[k], line + abs(bend) / t.scale[k]
        parabola += abs(bend - s.bend[k]) / t.scale[k]
        s.trend[k], s.bend[k] = trend, bend
        s.pseudo[k], s.u0[k], s.du0[k] = pseudo, s.u[k], s.du[k]
        s.d[k] = 0.0
    return 0 if still < line else 1 if line < parabola else 2


@jit
def planar_march(t, e, k, space, c, s, f, q, w, joint, still, given, row, out):
    """March over the instants of one chunk and write the samples that are asked for.

    An instant is the end of a step; at the first, where it is to stand ``still``, accelerations are found for the state at hand,
    and the march goes on from them.  Where closures act, what is written are the accelerations and multipliers of
    `planar_settle.settle`.

    joint : (nodes, 3) q, q', q'' of all joints [m, rad, s] where the march begins, undeformed; (0, 3) where it goes on
    given : (instants, joints, 3) q, q', q'' of the prescribed joints [m, rad, s]; row : (instants,) of the histories, -1 for none
    Return status, instant reached, element or iterations, last relative increment [-].
    """
    count, size, order, acts = 0, 0.0, 0, any_acts(k)
    if joint.shape[0] > 0:
        begin(t, e, s, joint, f, w)
    for n in range(given.shape[0]):
        moves = n > 0 or not still
        scheme = c if moves else ACCELERATIONS
        if n == 0 or (n == 1 and still):
            vary_independent(t, f, scheme.cv, scheme.ca)
        if moves:
            start(c, s, order)
        keep(k)
        status, count, size = newton(t, e, k, scheme, s, given[n], f, q, w, SLOW, MANY)
        if status != CONVERGED and moves:  # where something has just let go, the past says little about what comes
            start(c, s, 0)
            return_to(k)
            status, count, size = newton(t, e, k, c, s, given[n], f, q, w, 0.0, MOST_ITERATIONS)
        if status != CONVERGED:
            return status, n, count, size
        settles = not moves or (acts and row[n] >= 0)
        if settles:
            keep(k)
            settle(t, k, f, w.residual)
        if row[n] >= 0:
            record(row[n], t, e, k, space, f, w, out)
            out.iterations[row[n]] = count
        if not moves:  # the march goes on from what has been settled
            for i in range(len(s.du)):
                s.du[i] += k.line[i]
            accept(s)
            continue
        if settles:
            return_to(k)
        order = advance(t, c, s)
    return CONVERGED, given.shape[0], count, size


@jit_inner
def begin(t, e, s, joint, f, w):
    """Begin undeformed: joint (nodes, 3) q, q', q'' of all joints [m, rad, s]; the elements feel nothing, not even rounding."""
    stand(t, s, joint, f)
    accept(s)
    relax(e, w.points)
    for i in range(len(w.rates)):
        w.rates[i] = 0.0
