"""Accelerations and multipliers that belong to closed positions and their velocities, in a plane (compiled): `settle` there.

A step ends with closed positions; index 1 asks for M (a' - a) = G^T dlambda - r, G a' = -G' u.  Masses are lumped in the
nodes, so M has one small matrix for each block of unknowns; what Newton has left, r, goes too.
"""

from __future__ import annotations

from flexinv.compiled import jit_inner, jit_shared
from flexinv.planar_ties import add_step, invert_scaled, solve_ties, stiffen, tie_rows, tie_sides
from flexinv.planar_tree import vary_poses
from flexinv.settle import MASSLESS


@jit_shared
def settle(t, k, f, residual):
    """Change multipliers, and the nodes' accelerations and wrenches, into those that belong to the positions and velocities.

    What the accelerations of the unknowns change by stays in k.line [m/s^2], [rad/s^2].
    residual : (unknowns,) what Newton has left [N], [N m]
    """
    vary_poses(t, f)
    tie_rows(k, f, True)
    tie_sides(t, k, f)
    for n in range(len(k.single)):
        first, over = t.offset[t.block[k.single[n]]], k.over[n]
        for i in range(3):
            k.line[first + i] = -residual[first + i] * over[i]
            for r in range(len(k.a)):
                k.moved[r, first + i] = k.sides[r, first + i] * over[i]
    for b in range(len(k.block)):
        _accelerate_block(b, t, k, f, residual)
    stiffen(t, k)
    solve_ties(t, k, k.line)
    add_step(k)
    _change(t, k, f)


@jit_inner
def _change(t, k, f):
    """Add to the nodes' accelerations and wrenches what changes of accelerations and multipliers do, both of them linear."""
    for n in range(len(t.parent)):
        x, y, turned, first = 0.0, 0.0, 0.0, t.offset[t.block[n]]
        if t.independent[n]:
            x, y, turned = k.line[first], k.line[first + 1], k.line[first + 2]
        else:
            for i in range(t.size[t.block[n]]):
                step, by = k.line[first + i], f.by_pose[n, i]
                x, y, turned = x + by[0] * step, y + by[1] * step, turned + by[2] * step
        f.acceleration[n, 0] += x
        f.acceleration[n, 1] += y
        f.acceleration[n, 2] += turned
        k.change[n, 0], k.change[n, 1], k.change[n, 2] = t.mass[n] * x, t.mass[n] * y, t.inertia[n] * turned
    for r in range(len(k.a)):
        for i in range(3):
            if k.a[r] >= 0:
                k.change[k.a[r], i] -= k.step[r] * k.gradient[r, i]
            if k.b[r] >= 0:
                k.change[k.b[r], i] -= k.step[r] * k.gradient[r, 3 + i]
    for n in range(len(t.parent) - 1, -1, -1):
        m, own = t.parent[n], k.change[n]
        for i in range(3):
            f.wrench[n, i] += own[i]
            if m >= 0 and not t.independent[n]:
                k.change[m, i] += own[i]
        if m >= 0 and not t.independent[n]:
            k.change[m, 2] += f.arm[n, 0] * own[1] - f.arm[n, 1] * own[0]


@jit_inner
def _accelerate_block(b, t, k, f, residual):
    """M^-1 G^T and -M^-1 r of one block: its mass matrix from its nodes and the rotors of its passive joints."""
    block, largest = k.block[b], 0.0
    columns, first, m = t.size[block], t.offset[block], k.mass
    for i in range(columns):
        for j in range(columns):
            m[i, j] = 0.0
    for n in k.member[b]:
        if n < 0:
            break
        for i in range(columns):
            x = f.by_pose[n, i]
            for j in range(columns):
                y = f.by_pose[n, j]
                m[i, j] += t.mass[n] * (x[0] * y[0] + x[1] * y[1]) + t.inertia[n] * x[2] * y[2]
        if t.column[n] >= 0 and not t.independent[n]:
            m[t.column[n], t.column[n]] += t.rotor[n]
    for i in range(columns):
        largest = max(largest, m[i, i])
    for i in range(columns):
        if m[i, i] <= MASSLESS * largest:  # what has no inertia keeps its acceleration
            m[i, i] = largest
    invert_scaled(m, columns, 0.0, k.step, k.left)
    for i in range(columns):
        k.line[first + i] = -_dot_from(m[i], residual, first, columns)
        for r in range(len(k.a)):
            k.moved[r, first + i] = _dot_from(m[i], k.sides[r], first, columns)


@jit_inner
def _dot_from(a, b, first, size):
    """Sum of a_i b_(first + i)."""
    total = 0.0
    for i in range(size):
        total += a[i] * b[first + i]
    return total
