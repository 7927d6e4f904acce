"""Index-1 projection in a plane: accelerations and multipliers consistent with positions and velocities (compiled).

The planar form of `dynamics.index1`: M (a' - a) = G^T dlambda - r, G a' = -G' u, with masses lumped in the nodes, so that M
has one small matrix for each block of unknowns; Newton's remaining residual r is removed as well.
"""

from __future__ import annotations

from flexinv.dynamics.index1 import MASSLESS
from flexinv.kernels.dense import invert_scaled
from flexinv.kernels.jit import jit_inner
from flexinv.planar.constraint_rows import add_step, add_ties, factorise_border, solve_ties, tie_rows, tie_sides
from flexinv.planar.tree import vary_poses


@jit_inner
def project_accelerations(tree, constraints, frames, residual):
    """Change multipliers, and the nodes' accelerations and wrenches, into those that belong to the positions and velocities.

    What the accelerations of the unknowns change by stays in constraints.line [m/s^2], [rad/s^2].
    residual : (unknowns,) what Newton has left [N], [N m]
    """
    vary_poses(tree, frames)
    tie_rows(constraints, frames, True)
    tie_sides(tree, constraints, frames)
    plan = constraints.layout
    for n in range(len(constraints.single)):
        block, over = tree.block[constraints.single[n]], constraints.over[n]
        first, part = tree.offset[block], tree.part[block]
        for i in range(3):
            constraints.line[first + i] = -residual[first + i] * over[i]
        for side in plan.side[plan.first_side[part] + 1 : plan.first_side[part + 1]]:
            for i in range(3):
                constraints.moved[side - 1, first + i] = constraints.sides[side - 1, first + i] * over[i]
    for b in range(len(constraints.block)):
        _accelerate_block(b, tree, constraints, frames, residual)
    factorise_border(tree, constraints)
    solve_ties(tree, constraints, constraints.line)
    add_step(constraints)
    _change(tree, constraints, frames)


@jit_inner
def _change(tree, constraints, frames):
    """Add to the nodes' accelerations and wrenches what changes of accelerations and multipliers do, both of them linear."""
    for n in range(len(tree.parent)):
        x, y, turned, first = 0.0, 0.0, 0.0, tree.offset[tree.block[n]]
        if tree.independent[n]:
            x, y, turned = constraints.line[first], constraints.line[first + 1], constraints.line[first + 2]
        else:
            for i in range(tree.size[tree.block[n]]):
                step, by = constraints.line[first + i], frames.by_pose[n, i]
                x, y, turned = x + by[0] * step, y + by[1] * step, turned + by[2] * step
        frames.acceleration[n, 0] += x
        frames.acceleration[n, 1] += y
        frames.acceleration[n, 2] += turned
        change, m = constraints.change[n], tree.mass[n]
        change[0], change[1], change[2] = m * x, m * y, tree.inertia[n] * turned
    add_ties(constraints, constraints.step, constraints.change)
    for n in range(len(tree.parent) - 1, -1, -1):
        m, own = tree.parent[n], constraints.change[n]
        for i in range(3):
            frames.wrench[n, i] += own[i]
            if m >= 0 and not tree.independent[n]:
                constraints.change[m, i] += own[i]
        if m >= 0 and not tree.independent[n]:
            constraints.change[m, 2] += frames.arm[n, 0] * own[1] - frames.arm[n, 1] * own[0]


@jit_inner
def _accelerate_block(b, tree, constraints, frames, residual):
    """M^-1 G^T and -M^-1 r of one block: its mass matrix from its nodes and the rotors of its passive joints."""
    block, largest = constraints.block[b], 0.0
    columns, first, m = tree.size[block], tree.offset[block], constraints.mass
    for i in range(columns):
        for j in range(columns):
            m[i, j] = 0.0
    for n in constraints.member[b]:
        if n < 0:
            break
        for i in range(columns):
            x = frames.by_pose[n, i]
            for j in range(columns):
                y = frames.by_pose[n, j]
                m[i, j] += tree.mass[n] * (x[0] * y[0] + x[1] * y[1]) + tree.inertia[n] * x[2] * y[2]
        if tree.column[n] >= 0 and not tree.independent[n]:
            m[tree.column[n], tree.column[n]] += tree.rotor[n]
    for i in range(columns):  # inertias are compared in lengths of the mechanism
        largest = max(largest, m[i, i] * tree.scale[first + i] ** 2)
    for i in range(columns):
        unit = tree.scale[first + i] ** 2
        if m[i, i] * unit <= MASSLESS * largest:  # what has no inertia keeps its acceleration
            m[i, i] = largest / unit
    invert_scaled(m, columns, 0.0, constraints.weight, constraints.left)
    plan, part = constraints.layout, tree.part[block]
    for i in range(columns):
        constraints.line[first + i] = -_dot_from(m[i], residual, first, columns)
        for side in plan.side[plan.first_side[part] + 1 : plan.first_side[part + 1]]:
            constraints.moved[side - 1, first + i] = _dot_from(m[i], constraints.sides[side - 1], first, columns)


@jit_inner
def _dot_from(a, b, first, size):
    """Sum of a_i b_(first + i)."""
    total = 0.0
    for i in range(size):
        total += a[i] * b[first + i]
    return total
