"""The accelerations and multipliers that belong to closed positions and their velocities, at the end of a step (compiled).

Positions meet the closures, and the integrator's accelerations a and multipliers balance there; but a belongs to the positions
of some steps.  Index 1 asks for those that keep the closures closed from this state on:

    M (a' - a) = G^T dlambda - r        G a' = -G' u

Masses are lumped in the nodes, so M has one small matrix for each block of unknowns; r is what Newton has left.  Elastic forces
stay as they are: positions and velocities do not change.
"""

from __future__ import annotations

from flexinv.assemble import gather, node_wrenches, place
from flexinv.border import solve_border
from flexinv.compiled import jit_inner
from flexinv.eliminate import solve_dense
from flexinv.ties import ACCELERATIONS as RATED
from flexinv.ties import PULL, tie_rows, tie_sides
from flexinv.tree import bring_back

# In units of 1/ca (`integrate.ACCELERATIONS`: 1e30) inertia stands above all that depends on positions: what is this far below
# the largest inertia has none.
MASSLESS = 1e-16


@jit_inner
def settle(t, ties, c, s, j, f, d, loads, work, y):
    """Change accelerations s.du [m/s^2], [rad/s^2], multipliers, frames and wrenches [N], [N m] into those of index 1.

    c : `integrate.ACCELERATIONS`; work.residual[0] : what Newton has left
    """
    full, change, level = work.settled[0], work.settled[1], loads.level[0]
    for i in range(y.shape[1]):
        y[0, i] = work.residual[0, i]
    place(t, s, j, f, d, 0.0, c.ca, True)
    _copy(work.wrench, full)
    node_wrenches(t, f, d, level, work, True)
    _negative(work.wrench, change)
    tie_rows(ties, s, f, RATED)
    gather(t, s, f, j, d, loads, work, 0.0, c.ca, True)
    for i in range(y.shape[1]):
        work.residual[0, i] = y[0, i]
    tie_sides(t, ties, d, t.length, work.residual)
    _leave_springs(ties, work.residual)
    weigh_massless(t, work.diagonal)
    _solve_blocks(t, work, y)
    solve_border(ties, c.ca, y)
    for i in range(y.shape[1]):
        s.du[i] += c.ca * y[0, i]
    place(t, s, j, f, d, 0.0, c.ca, False)
    node_wrenches(t, f, d, level, work, False)
    _add(work.wrench, change)
    _add_steps(ties, change)
    for n in range(len(t.parent) - 1, -1, -1):
        if t.parent[n] >= 0 and not t.independent[n]:
            bring_back(n, t.parent[n], f, j, change)
    _copy(full, work.wrench)
    _add(change, work.wrench)


@jit_inner
def weigh_massless(t, diagonal):
    """Make freedoms without inertia (no term in ca) so heavy that their acceleration stays as it is [kg], [kg m^2]."""
    largest = 0.0
    for b in range(len(t.size)):
        for k in range(t.size[b]):
            for i in range(t.size[b]):
                largest = max(largest, abs(diagonal[b, k, i]))
    for b in range(len(t.size)):
        for k in range(t.size[b]):
            if abs(diagonal[b, k, k]) < MASSLESS * largest:
                diagonal[b, k, k] = largest


@jit_inner
def _leave_springs(ties, residual):
    """Rows of springs keep their forces."""
    for k in range(len(ties.a)):
        if ties.kind[k] == PULL:
            ties.value[k] = 0.0
            for i in range(residual.shape[1]):
                residual[1 + k, i], ties.across[k, i] = 0.0, 0.0


@jit_inner
def _solve_blocks(t, work, y):
    """y = -M^-1 residual for all right sides, block by block."""
    sides, system = y.shape[0], work.system
    for b in range(len(t.size)):
        size, first = t.size[b], t.offset[b]
        for r in range(size):
            for c in range(size):
                system[r, c] = work.diagonal[b, r, c]
            for side in range(sides):
                system[r, size + side] = -work.residual[side, first + r]
        solve_dense(system, size, size + sides)
        for r in range(size):
            for side in range(sides):
                y[side, first + r] = system[r, size + side]


@jit_inner
def _add_steps(ties, wrench):
    """Take the forces of the multipliers' changes off the wrenches of their nodes."""
    for k in range(len(ties.a)):
        if ties.kind[k] == PULL:
            continue
        for i in range(6):
            if ties.a[k] >= 0:
                wrench[ties.a[k], i] -= ties.step[k] * ties.gradient[k, i]
            if ties.b[k] >= 0:
                wrench[ties.b[k], i] -= ties.step[k] * ties.gradient[k, 6 + i]


@jit_inner
def _copy(a, b):
    for n in range(a.shape[0]):
        for i in range(6):
            b[n, i] = a[n, i]


@jit_inner
def _negative(a, b):
    for n in range(a.shape[0]):
        for i in range(6):
            b[n, i] = -a[n, i]


@jit_inner
def _add(a, b):
    for n in range(a.shape[0]):
        for i in range(6):
            b[n, i] += a[n, i]
