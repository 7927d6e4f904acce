"""Index-1 projection: accelerations and multipliers consistent with closed positions and their velocities (compiled).

At the end of a step the positions satisfy the closures, and the integrator's accelerations a and multipliers are in balance;
but a depends on the positions of several steps.  Index 1 requires accelerations a_new that keep the closures closed:

    M (a_new - a) = G^T dlambda - r        G a_new = -G' u

Masses are lumped in the nodes, so M has one small matrix for each block of unknowns; r is Newton's remaining residual.  Elastic
forces stay as they are: positions and velocities do not change.

M may be singular: a section without rotary inertia that carries a hinge turns one way, what hangs on the hinge the other, and
nothing resists.  Such a motion has no acceleration of its own (`add_mass_to_block`).
"""

from __future__ import annotations

from flexinv.dynamics.assembly import compute_node_wrenches, run_forward_pass
from flexinv.dynamics.constraint_rows import (
    PULL,
    SECOND_RATES,
    add_ties,
    compute_border_factors,
    evaluate_ties,
    fill_right_sides,
    solve_border,
)
from flexinv.dynamics.point_rows import add_point_masses
from flexinv.dynamics.tree_solver import solve_block
from flexinv.elements.shapes import is_point_mass
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.vec3 import apply, dot, mat, vec
from flexinv.kinematics.tree import add_wrench_to_parent

# A freedom whose inertia is this far below the largest has none: rounding of sums over the nodes of a block.
MASSLESS = 1e-16
# Of an inertia, this part is left by rounding of some tens of lever arms where all of it moves with other freedoms.
NO_INERTIA = 1e-13


@jit_inner
def update_accelerations(system, joints, y):
    """Change accelerations state.du [m/s^2], [rad/s^2], multipliers, frames and wrenches [N], [N m] into those of index 1.

    work.residual[0] : what Newton has left
    """
    topology = system.topology
    ties = system.border.ties
    state = system.state
    frames = system.frames
    work = system.work
    variation = system.variation
    level = system.loads.level[0]
    full = work.projection[0]
    change = work.projection[1]
    run_forward_pass(topology, state, joints, frames, variation, work, (0.0, 1.0), True)
    _write_scaled(1.0, work.wrench, full)
    compute_node_wrenches(topology, frames, variation, level, work, False)
    _write_scaled(-1.0, work.wrench, change)
    evaluate_ties(ties, state, frames, SECOND_RATES)
    fill_right_sides(topology, ties, variation, work.residual)
    for k in range(len(ties.a)):  # springs keep their forces
        if ties.kind[k] == PULL:
            ties.value[k] = 0.0
    solve_masses(system, y)
    compute_border_factors(ties, ties.layout.blocks, y)
    solve_border(ties, ties.layout.blocks, 1.0, y)
    for i in range(y.shape[1]):
        state.du[i] += y[0, i]
    run_forward_pass(topology, state, joints, frames, variation, work, (0.0, 1.0), False)
    compute_node_wrenches(topology, frames, variation, level, work, False)
    _add_wrenches(work.wrench, change)
    add_ties(ties, ties.step, change)  # those of springs are zero
    for n in range(len(topology.parent) - 1, -1, -1):
        if topology.parent[n] >= 0 and not topology.independent[n]:
            add_wrench_to_parent(n, topology.parent[n], frames, joints, change)
    _write_scaled(1.0, full, work.wrench)
    _add_wrenches(change, work.wrench)


@jit_inner
def _write_scaled(factor, wrench, to):
    for n in range(len(wrench)):
        for i in range(6):
            to[n, i] = factor * wrench[n, i]


@jit_inner
def _add_wrenches(wrench, to):
    for n in range(len(wrench)):
        for i in range(6):
            to[n, i] += wrench[n, i]


@jit_inner
def solve_masses(system, y):
    """Solve M y = -residual for all right sides, block by block; forces of springs do not depend on accelerations [m/s^2].

    y : (sides, unknowns); overwrites work.diagonal
    """
    ties = system.border.ties
    for k in range(len(ties.a)):
        if ties.kind[k] == PULL:
            ties.across[k, : y.shape[1]] = 0.0
    topology = system.topology
    diagonal = system.work.diagonal
    for b in range(len(topology.size)):
        diagonal[b, : topology.size[b], : topology.size[b]] = 0.0
    _add_node_masses(system)
    for part in range(len(topology.shapes.root)):
        add_point_masses(part, system)
    largest = find_largest_inertia(topology, diagonal)
    plan = ties.layout
    for b in range(len(topology.size)):
        first = topology.offset[b]
        scale = topology.scale[first : first + topology.size[b]]
        add_mass_to_block(diagonal[b], topology.size[b], scale, largest, system.work.system)
    for b in range(len(topology.size)):
        part = topology.part[b]
        solve_block(topology, system.work, b, plan.side[plan.first_side[part] : plan.first_side[part + 1]], y)


@jit_inner
def _add_node_masses(system):
    """Add M = sum_n B_n^T diag(m_n, J_n) B_n over the nodes of every block, and rotors [kg], [kg m], [kg m^2]."""
    topology = system.topology
    variation = system.variation
    diagonal = system.work.diagonal
    for n in range(len(topology.parent)):
        if is_point_mass(n, topology.shapes):
            continue
        m = topology.mass[n]
        inertia = mat(topology.inertia[n])
        block = diagonal[topology.block[n]]
        columns = topology.width[n]
        for k in range(columns):
            moved = vec(variation.x[n, k])
            turned = apply(inertia, vec(variation.t[n, k]))
            for i in range(columns):
                block[i, k] += m * dot(vec(variation.x[n, i]), moved) + dot(vec(variation.t[n, i]), turned)
        for i in range(topology.freedoms[n]):
            block[topology.column[n] + i, topology.column[n] + i] += topology.drives[0, n]


@jit_inner
def find_largest_inertia(topology, diagonal):
    """Return the largest inertia of all blocks, as it is felt over one length of the mechanism or one radian [kg m^2]."""
    largest = 0.0
    for b in range(len(topology.size)):
        o = topology.offset[b]
        for k in range(topology.size[b]):
            for i in range(topology.size[b]):
                largest = max(largest, abs(diagonal[b, k, i]) * topology.scale[o + k] * topology.scale[o + i])
    return largest


@jit_inner
def add_mass_to_block(m, size, scale, largest, left):
    """Make motions of one block that have no inertia so heavy that their accelerations stay as they are [kg], [kg m^2].

    Gauss elimination of the symmetric m (size, size), the last freedom first: where all behind a freedom follow freely and its
    pivot is rounding, nothing resists.  So a section without rotary inertia is held, and a hinge on it moves what it carries.

    scale : (size,) length of the mechanism or 1 [m], [-]; largest : inertia of the mechanism [kg m^2]; left : scratch
    """
    for i in range(size):
        for j in range(size):
            left[i, j] = m[i, j]
    for k in range(size - 1, -1, -1):
        heavy = largest / scale[k] ** 2
        if not left[k, k] > max(NO_INERTIA * m[k, k], MASSLESS * heavy):
            m[k, k] += heavy
            continue
        for i in range(k):
            factor = left[i, k] / left[k, k]
            for j in range(k):
                left[i, j] -= factor * left[k, j]


@jit_inner
def add_missing_masses(topology, diagonal):
    """Make freedoms without inertia (no term in ca) so heavy that their acceleration stays as it is [kg], [kg m^2].

    Inertias are compared in lengths of the mechanism.
    """
    largest = find_largest_inertia(topology, diagonal)
    for b in range(len(topology.size)):
        for k in range(topology.size[b]):
            unit = topology.scale[topology.offset[b] + k] ** 2
            if abs(diagonal[b, k, k]) * unit < MASSLESS * largest:
                diagonal[b, k, k] = largest / unit
