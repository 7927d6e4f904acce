"""Forward and backward pass over the tree in a plane: `kinematics.tree` and `assembly` with two positions and one angle.

With p the place of child B in its parent's frame, S = S(theta_A), J (a, b) = (-b, a), r = S p:

    x_B = x_A + r                                    theta_B = theta_A + q
    v_B = v_A + w_A J r + S p'                       w_B = w_A + q'
    a_B = a_A + al_A J r - w_A^2 r + 2 w_A J S p' + S p''

A joint turns by +-q (revolute) or slides, p = p_0 + q d (prismatic).  A wrench (f, mu) at B acts on A as (f, mu + r x f).
"""

from __future__ import annotations

from typing import NamedTuple

from flexinv.elements.joint_law import (
    compute_effort_slope,
    compute_joint_effort,
    compute_smooth_direction,
    take_joint_law,
)
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.simd import cos_sin_unfused
from flexinv.kernels.vec3 import ZERO, add, add_to, put, put_at, vec, vec_at
from flexinv.typing import Array, Indices, Mask


@send_by_address
class PlanarTree(NamedTuple):
    """Nodes, blocks and joints of a mechanism in a plane (as `dofs.Topology`).

    parent, block : (nodes,); independent : (nodes,) bool; size, offset, part : (blocks,); width, first : (nodes,)
    span : (parts + 1,)
    scale : (unknowns,) [m] or 1; first_element : (parts + 1,) of each part in ``element``, from its root to its leaves
    prescribed_column : (nodes,) column of the prescribed joint coordinate, -1 without;
    column : (nodes,) of the passive one in its block
    turn : (nodes,) +-1 of revolute joints, 0 else; slide : (nodes, 2) direction of prismatic ones in the parent's frame
    offset_p : (nodes, 2) p_0 [m]; shifted : (nodes,) whether p may differ from zero
    mass, inertia : (nodes,) [kg], [kg m^2] about the normal; gravity : (2,) [m/s^2]
    drives : (5, nodes) as of `dofs.Topology`; springs there are none
    """

    parent: Indices
    block: Indices
    independent: Mask
    size: Indices
    offset: Indices
    width: Indices
    first: Indices
    part: Indices
    span: Indices
    first_element: Indices
    element: Indices
    scale: Array
    prescribed_column: Indices
    column: Indices
    turn: Array
    slide: Array
    offset_p: Array
    shifted: Mask
    mass: Array
    inertia: Array
    gravity: Array
    drives: Array


@send_by_address
class PlanarFrames(NamedTuple):
    """Poses, velocities, accelerations (nodes, 3) of all nodes, x, y, theta [m, rad, s], and their variations.

    joint : (nodes, 3) q, q', q''; arm : (nodes, 4) r and S d of dependent nodes [m], [-]
    by_pose, by_rate, by_acceleration : (nodes, columns, 3) by the block's unknowns
    wrench : (nodes, 3) [N], [N m]; dwrench : (nodes, columns, 3)
    """

    pose: Array
    rate: Array
    acceleration: Array
    joint: Array
    arm: Array
    by_pose: Array
    by_rate: Array
    by_acceleration: Array
    wrench: Array
    dwrench: Array


@jit_inner
def run_forward_pass(tree, state, given, frames):
    """Set the motion of all nodes from the unknowns and the prescribed coordinates (joints, 3) q, q', q'' [m, rad, s]."""
    for n in range(len(tree.parent)):
        o = tree.first[n]
        column = tree.column[n]
        if tree.independent[n]:
            put(frames.pose[n], add(vec_at(state.place, o), vec_at(state.d, o)))
            put(frames.rate[n], vec_at(state.u, o))
            put(frames.acceleration[n], vec_at(state.du, o))
            continue
        if tree.prescribed_column[n] >= 0:
            put(frames.joint[n], vec(given[tree.prescribed_column[n]]))
        elif column >= 0:
            k = o + column
            put(frames.joint[n], (state.place[k] + state.d[k], state.u[k], state.du[k]))
        _compute_child_motion(n, tree, frames)


@jit_inner
def read_node_motion(frames, n):
    """Return pose, rates and accelerations of a node [m, rad, s], zeros of the world (-1)."""
    if n < 0:
        return ZERO, ZERO, ZERO
    return vec(frames.pose[n]), vec(frames.rate[n]), vec(frames.acceleration[n])


@jit_inner
def _compute_child_motion(n, tree, frames):
    """Motion of a dependent node from its parent's, the equations at the head of the file."""
    m = tree.parent[n]
    turn = tree.turn[n]
    e1 = tree.slide[n, 0]
    e2 = tree.slide[n, 1]
    q = frames.joint[n, 0]
    dq = frames.joint[n, 1]
    ddq = frames.joint[n, 2]
    r1 = tree.offset_p[n, 0] + q * e1
    r2 = tree.offset_p[n, 1] + q * e2
    x, v, a = read_node_motion(frames, m)
    if m >= 0 and tree.shifted[n]:
        c, s = cos_sin_unfused(x[2])
        r1, r2, e1, e2 = c * r1 - s * r2, s * r1 + c * r2, c * e1 - s * e2, s * e1 + c * e2
    frames.arm[n, 0] = r1
    frames.arm[n, 1] = r2
    frames.arm[n, 2] = e1
    frames.arm[n, 3] = e2
    w = v[2]
    al = a[2]
    put(frames.pose[n], (x[0] + r1, x[1] + r2, x[2] + turn * q))
    put(frames.rate[n], (v[0] - w * r2 + dq * e1, v[1] + w * r1 + dq * e2, w + turn * dq))
    a1 = a[0] - al * r2 - w * w * r1 - 2 * w * dq * e2 + ddq * e1
    a2 = a[1] + al * r1 - w * w * r2 + 2 * w * dq * e1 + ddq * e2
    put(frames.acceleration[n], (a1, a2, al + turn * ddq))


@jit_inner
def begin_undeformed(tree, state, joint, frames):
    """Set the unknowns to the rigid motion of the stress-free mechanism whose joints (nodes, 3) are at q, q', q'' [m, rad, s]."""
    for n in range(len(tree.parent)):
        o = tree.first[n]
        column = tree.column[n]
        put(frames.joint[n], vec(joint[n]))
        _compute_child_motion(n, tree, frames)
        if tree.independent[n]:
            put_at(state.place, o, vec(frames.pose[n]))
            put_at(state.u, o, vec(frames.rate[n]))
            put_at(state.du, o, vec(frames.acceleration[n]))
        elif column >= 0:
            state.place[o + column] = joint[n, 0]
            state.u[o + column] = joint[n, 1]
            state.du[o + column] = joint[n, 2]


@jit_inner
def begin_from_state(state):
    """Let the next step start from the present velocities [m/s] and accelerations [m/s^2], without a past."""
    for k in range(len(state.d)):
        state.u0[k], state.du0[k], state.pseudo[k] = state.u[k], state.du[k], state.du[k]
        state.d[k] = 0.0
        state.trend[k] = 0.0
        state.bend[k] = 0.0
    state.order[0] = 0


@jit_inner
def fill_independent_variations(tree, frames, cv, ca):
    """Set how independent nodes move with their own unknowns [m, rad, s], once and for all: dv = cv dx, da = ca dx."""
    for n in range(len(tree.parent)):
        if tree.independent[n]:
            for k in range(tree.width[n]):
                for i in range(3):
                    unit = 1.0 if k == i else 0.0
                    frames.by_pose[n, k, i] = unit
                    frames.by_rate[n, k, i] = cv * unit
                    frames.by_acceleration[n, k, i] = ca * unit


@jit_inner
def fill_variations(tree, frames, cv, ca):
    """Set how dependent nodes move with the unknowns of their blocks [m, rad, s]."""
    for n in range(len(tree.parent)):
        m = tree.parent[n]
        columns = tree.width[n]
        for k in range(0 if tree.independent[n] else columns):
            for by in (frames.by_pose, frames.by_rate, frames.by_acceleration):
                put(by[n, k], vec(by[m, k]) if m >= 0 else ZERO)
            _add_variation(n, k, tree, frames, cv, ca)


@jit_inner
def fill_pose_variations(tree, frames):
    """Set how poses of dependent nodes move with unknowns of their blocks [m], [rad]: the first part of `fill_variations`."""
    for n in range(len(tree.parent)):
        m = tree.parent[n]
        for k in range(0 if tree.independent[n] else tree.width[n]):
            x, y, turned = vec(frames.by_pose[m, k]) if m >= 0 else ZERO
            unit = 1.0 if k == tree.column[n] else 0.0
            arm = frames.arm[n]
            x = x + unit * arm[2] - turned * arm[1]
            y = y + unit * arm[3] + turned * arm[0]
            put(frames.by_pose[n, k], (x, y, turned + unit * tree.turn[n]))


@jit_inner
def _add_variation(n, k, tree, frames, cv, ca):
    """Add to the variation of node n, on entry its parent's, the differential of `_compute_child_motion` by unknown k."""
    m = tree.parent[n]
    unit = 1.0 if k == tree.column[n] else 0.0
    w, al = (frames.rate[m, 2], frames.acceleration[m, 2]) if m >= 0 else (0.0, 0.0)
    turned = frames.by_pose[n, k, 2]
    dw = frames.by_rate[n, k, 2]
    dal = frames.by_acceleration[n, k, 2]
    arm = frames.arm[n]
    r1 = arm[0]
    r2 = arm[1]
    e1 = arm[2]
    e2 = arm[3]
    dq = frames.joint[n, 1]
    ddq = frames.joint[n, 2]
    dr1 = unit * e1 - turned * r2
    dr2 = unit * e2 + turned * r1
    # d(S p')
    s1 = cv * unit * e1 - turned * dq * e2
    s2 = cv * unit * e2 + turned * dq * e1
    # d(S p'')
    z1 = ca * unit * e1 - turned * ddq * e2
    z2 = ca * unit * e2 + turned * ddq * e1
    x = frames.by_pose[n, k]
    v = frames.by_rate[n, k]
    a = frames.by_acceleration[n, k]
    turn = unit * tree.turn[n]
    put(x, (x[0] + dr1, x[1] + dr2, turned + turn))
    put(v, (v[0] - dw * r2 - w * dr2 + s1, v[1] + dw * r1 + w * dr1 + s2, dw + cv * turn))
    spin = w * w
    dspin = 2 * w * dw
    a1 = a[0] - dal * r2 - al * dr2 - dspin * r1 - spin * dr1 - 2 * (dw * dq * e2 + w * s2) + z1
    a2 = a[1] + dal * r1 + al * dr1 - dspin * r2 - spin * dr2 + 2 * (dw * dq * e1 + w * s1) + z2
    put(a, (a1, a2, dal + ca * turn))


@jit_inner
def compute_node_wrenches(tree, frames):
    """Set every node's own wrench P = m (a - g) [N], Q = J al [N m]."""
    for n in range(len(tree.parent)):
        m = tree.mass[n]
        a = frames.acceleration[n]
        put(frames.wrench[n], (m * (a[0] - tree.gravity[0]), m * (a[1] - tree.gravity[1]), tree.inertia[n] * a[2]))


@jit_inner
def fill_wrench_variations(tree, frames):
    """Set how every node's own wrench varies with the unknowns of its block [N], [N m]."""
    for n in range(len(tree.parent)):
        m = tree.mass[n]
        j = tree.inertia[n]
        for k in range(tree.width[n]):
            a = frames.by_acceleration[n, k]
            put(frames.dwrench[n, k], (m * a[0], m * a[1], j * a[2]))


@jit_inner
def assemble_residual(tree, state, frames, residual):
    """Bring wrenches of dependent nodes back to their blocks: residual (unknowns,) [N], [N m]."""
    for n in range(len(tree.parent) - 1, -1, -1):
        m = tree.parent[n]
        o = tree.first[n]
        column = tree.column[n]
        f1, f2, mu = vec(frames.wrench[n])
        if tree.independent[n]:
            put_at(residual, o, (f1, f2, mu))
            continue
        if column >= 0:
            u = state.u[o + column]
            du = state.du[o + column]
            drive = compute_joint_effort(take_joint_law(tree.drives, n), 0.0, u, du, compute_smooth_direction(u))
            residual[o + column] = frames.arm[n, 2] * f1 + frames.arm[n, 3] * f2 + tree.turn[n] * mu + drive
        if m >= 0:
            add_to(frames.wrench[m], (f1, f2, mu + frames.arm[n, 0] * f2 - frames.arm[n, 1] * f1))


@jit_inner
def assemble_diagonal(tree, state, frames, diagonal, cv, ca):
    """Bring variations of wrenches back: diagonal blocks of the linearisation [N/m], [N], [N m].

    diagonal : (blocks, columns, columns); `assemble_residual` came before
    """
    for n in range(len(tree.parent) - 1, -1, -1):
        m = tree.parent[n]
        b = tree.block[n]
        column = tree.column[n]
        columns = tree.width[n]
        f1, f2, _ = vec(frames.wrench[n])
        r1 = frames.arm[n, 0]
        r2 = frames.arm[n, 1]
        e1 = frames.arm[n, 2]
        e2 = frames.arm[n, 3]
        for k in range(columns):
            df1, df2, dmu = vec(frames.dwrench[n, k])
            if tree.independent[n]:
                diagonal[b, 0, k] = df1
                diagonal[b, 1, k] = df2
                diagonal[b, 2, k] = dmu
                continue
            turned = frames.by_pose[m, k, 2] if m >= 0 else 0.0
            along = 1.0 if k == column else 0.0
            if column >= 0:
                slope = e1 * df1 + e2 * df2 + turned * (e1 * f2 - e2 * f1) + tree.turn[n] * dmu
                direction = compute_smooth_direction(state.u[tree.offset[b] + column])
                diagonal[b, column, k] = slope + along * compute_effort_slope(
                    take_joint_law(tree.drives, n), direction, cv, ca
                )
            if m >= 0:
                dr1 = along * e1 - turned * r2
                dr2 = along * e2 + turned * r1
                add_to(frames.dwrench[m, k], (df1, df2, dmu + r1 * df2 - r2 * df1 + dr1 * f2 - dr2 * f1))
