"""Index-1 projection: accelerations and multipliers consistent with closed positions and their velocities (compiled).

At the end of a step the positions satisfy the closures, and the integrator's accelerations a and multipliers are in balance;
but a depends on the positions of several steps.  Index 1 requires accelerations a' that keep the closures closed from this state:

    M (a' - a) = G^T dlambda - r        G a' = -G' u

Masses are lumped in the nodes, so M has one small matrix for each block of unknowns; r is Newton's remaining residual.  Elastic
forces stay as they are: positions and velocities do not change.
"""

from __future__ import annotations

from flexinv.dynamics.assembly import gather, node_wrenches, place
from flexinv.dynamics.bordered_solver import solve_border
from flexinv.dynamics.constraint_rows import ACCELERATIONS as RATED
from flexinv.dynamics.constraint_rows import PULL, tie_rows, tie_sides
from flexinv.dynamics.tree_solver import solve_dense
from flexinv.kernels.jit import jit_inner
from flexinv.kinematics.tree import bring_back

# In units of 1/ca (`generalized_alpha.ACCELERATIONS`: 1e30) inertia stands above all that depends on positions: what is this
# far below the largest inertia has none.
MASSLESS = 1e-16


@jit_inner
def settle(topology, ties, scheme, state, joints, frames, variation, loads, work, y):
    """Change accelerations state.du [m/s^2], [rad/s^2], multipliers, frames and wrenches [N], [N m] into those of index 1.

    scheme : `generalized_alpha.ACCELERATIONS`; work.residual[0] : what Newton has left
    """
    full, change, level = work.settled[0], work.settled[1], loads.level[0]
    for i in range(y.shape[1]):
        y[0, i] = work.residual[0, i]
    place(topology, state, joints, frames, variation, 0.0, scheme.ca, True)
    _copy(work.wrench, full)
    node_wrenches(topology, frames, variation, level, work, True)
    _negative(work.wrench, change)
    tie_rows(ties, state, frames, RATED)
    gather(topology, state, frames, joints, variation, loads, work, 0.0, scheme.ca, True)
    for i in range(y.shape[1]):
        work.residual[0, i] = y[0, i]
    tie_sides(topology, ties, variation, topology.length, work.residual)
    _leave_springs(ties, work.residual)
    weigh_massless(topology, work.diagonal)
    _solve_blocks(topology, work, y)
    solve_border(ties, scheme.ca, y)
    for i in range(y.shape[1]):
        state.du[i] += scheme.ca * y[0, i]
    place(topology, state, joints, frames, variation, 0.0, scheme.ca, False)
    node_wrenches(topology, frames, variation, level, work, False)
    _add(work.wrench, change)
    _add_steps(ties, change)
    for n in range(len(topology.parent) - 1, -1, -1):
        if topology.parent[n] >= 0 and not topology.independent[n]:
            bring_back(n, topology.parent[n], frames, joints, change)
    _copy(full, work.wrench)
    _add(change, work.wrench)


@jit_inner
def weigh_massless(topology, diagonal):
    """Make freedoms without inertia (no term in ca) so heavy that their acceleration stays as it is [kg], [kg m^2].

    Inertias are compared in lengths of the mechanism.
    """
    largest = 0.0
    for b in range(len(topology.size)):
        for k in range(topology.size[b]):
            for i in range(topology.size[b]):
                largest = max(
                    largest,
                    abs(diagonal[b, k, i])
                    * topology.scale[topology.offset[b] + k]
                    * topology.scale[topology.offset[b] + i],
                )
    for b in range(len(topology.size)):
        for k in range(topology.size[b]):
            unit = topology.scale[topology.offset[b] + k] ** 2
            if abs(diagonal[b, k, k]) * unit < MASSLESS * largest:
                diagonal[b, k, k] = largest / unit


@jit_inner
def _leave_springs(ties, residual):
    """Rows of springs keep their forces."""
    for k in range(len(ties.a)):
        if ties.kind[k] == PULL:
            ties.value[k] = 0.0
            for i in range(residual.shape[1]):
                residual[1 + k, i], ties.across[k, i] = 0.0, 0.0


@jit_inner
def _solve_blocks(topology, work, y):
    """y = -M^-1 residual for all right sides, block by block."""
    sides, system = y.shape[0], work.system
    for b in range(len(topology.size)):
        size, first = topology.size[b], topology.offset[b]
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
