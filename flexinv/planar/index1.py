"""Index-1 projection in a plane: accelerations and multipliers consistent with positions and velocities (compiled).

The planar form of `dynamics.index1`: M (a_new - a) = G^T dlambda - r, G a_new = -G' u, with masses lumped in the nodes, so that
M has one small matrix for each block of unknowns; Newton's remaining residual r is removed as well.
"""

from __future__ import annotations

from typing import NamedTuple

from flexinv.dynamics.constraint_rows import add_ties, compute_border_factors, solve_border
from flexinv.dynamics.index1 import add_mass_to_block
from flexinv.kernels.dense import invert_scaled
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import ZERO, add_scaled, add_to, put, vec, vec_at
from flexinv.planar.constraint_rows import evaluate_ties, fill_right_sides
from flexinv.planar.tree import fill_pose_variations
from flexinv.typing import Array, Indices, Mask


@send_by_address
class BlockMasses(NamedTuple):
    """Blocks of unknowns whose mass matrices are inverted.

    single : nodes alone in their block; over : (single, 3) 1/m, 1/m, 1/J, zero where that is infinite
    block : (blocks,) the other blocks of unknowns; member : (blocks, most) nodes of each, -1 behind the last
    mass, rest, weight, left, change (nodes, 3) : scratch
    """

    single: Indices
    over: Array
    block: Indices
    member: Indices
    mass: Array
    rest: Array
    weight: Array
    left: Mask
    change: Array


@jit_inner
def update_accelerations(system):
    """Change multipliers, and the nodes' accelerations and wrenches, into those that belong to the positions and velocities.

    What the accelerations of the unknowns change by stays in work.y[0] [m/s^2], [rad/s^2].
    work.residual[0] : what Newton has left [N], [N m]
    """
    tree = system.tree
    ties = system.ties
    masses = system.masses
    frames = system.frames
    plan = ties.layout
    residual = system.work.residual
    y = system.work.y
    fill_pose_variations(tree, frames)
    evaluate_ties(ties, frames, True)
    fill_right_sides(tree, ties, frames, residual)
    for n in range(len(masses.single)):
        _solve_single_acceleration(tree, plan, masses.single[n], masses.over[n], residual, y)
    for b in range(len(masses.block)):
        _solve_block_acceleration(b, tree, plan, masses, frames, residual, y)
    compute_border_factors(ties, plan.blocks, y)
    solve_border(ties, plan.blocks, 1.0, y)
    # accelerations and wrenches are linear in those of unknowns and in multipliers
    _update_node_accelerations(tree, frames, y[0], masses.change)
    add_ties(ties, ties.step, masses.change)
    _add_wrenches(tree, frames, masses.change)


@jit_inner
def _solve_single_acceleration(tree, plan, node, over, residual, y):
    """Set y = -M^-1 residual of a node alone in its block; over : 1/m, 1/m, 1/J."""
    block = tree.block[node]
    first = tree.offset[block]
    part = tree.part[block]
    for side in plan.side[plan.first_side[part] : plan.first_side[part + 1]]:
        for i in range(3):
            y[side, first + i] = -residual[side, first + i] * over[i]


@jit_inner
def _update_node_accelerations(tree, frames, by, changes):
    """Change the accelerations of all nodes by those of the unknowns; set what that changes their own wrenches by."""
    for n in range(len(tree.parent)):
        first = tree.first[n]
        change = ZERO
        m = tree.mass[n]
        if tree.independent[n]:
            change = vec_at(by, first)
        else:
            for i in range(tree.width[n]):
                change = add_scaled(change, by[first + i], vec(frames.by_pose[n, i]))
        add_to(frames.acceleration[n], change)
        put(changes[n], (m * change[0], m * change[1], tree.inertia[n] * change[2]))


@jit_inner
def _add_wrenches(tree, frames, changes):
    """Add to the wrenches of all nodes what changes in them and in what they carry."""
    for n in range(len(tree.parent) - 1, -1, -1):
        f1, f2, mu = vec(changes[n])
        add_to(frames.wrench[n], (f1, f2, mu))
        if tree.parent[n] >= 0 and not tree.independent[n]:
            turned = frames.arm[n, 0] * f2 - frames.arm[n, 1] * f1
            add_to(changes[tree.parent[n]], (f1, f2, mu + turned))


@jit_inner
def _solve_block_acceleration(b, tree, plan, masses, frames, residual, y):
    """Set y = -M^-1 residual of one block: its mass matrix from its nodes and the rotors of its passive joints."""
    block = masses.block[b]
    largest = 0.0
    columns = tree.size[block]
    first = tree.offset[block]
    m = masses.mass
    m[:columns, :columns] = 0.0
    for n in masses.member[b]:
        if n < 0:
            break
        for i in range(columns):
            one = frames.by_pose[n, i]
            for j in range(columns):
                two = frames.by_pose[n, j]
                m[i, j] += tree.mass[n] * (one[0] * two[0] + one[1] * two[1]) + tree.inertia[n] * one[2] * two[2]
        if tree.column[n] >= 0 and not tree.independent[n]:
            m[tree.column[n], tree.column[n]] += tree.drives[0, n]
    for i in range(columns):  # inertias are compared in lengths of the mechanism
        largest = max(largest, m[i, i] * tree.scale[first + i] ** 2)
    add_mass_to_block(m, columns, tree.scale[first : first + columns], largest, masses.rest)
    invert_scaled(m, columns, 0.0, masses.weight, masses.left)
    part = tree.part[block]
    for i in range(columns):
        for side in plan.side[plan.first_side[part] : plan.first_side[part + 1]]:
            total = 0.0
            for j in range(columns):
                total += m[i, j] * residual[side, first + j]
            y[side, first + i] = -total
