"""Walking the tree in a plane: `tree` and `assemble` with positions of two numbers and angles of one.

With p the place of child B in its parent's frame, S = S(theta_A), J (a, b) = (-b, a), r = S p:

    x_B = x_A + r                                    theta_B = theta_A + q
    v_B = v_A + w_A J r + S p'                       w_B = w_A + q'
    a_B = a_A + al_A J r - w_A^2 r + 2 w_A J S p' + S p''

A joint turns by +-q (revolute) or slides, p = p_0 + q d (prismatic).  A wrench (f, mu) at B acts on A as (f, mu + r x f).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.compiled import jit_inner
from flexinv.lanes import cos_sin
from flexinv.mechanism import Array
from flexinv.system import FRICTION_RATE


class PlanarTree(NamedTuple):
    """Nodes, blocks and joints of a mechanism in a plane (as `system.Topology`).

    parent, block : (nodes,); independent : (nodes,) bool; size, offset : (blocks,); scale : (unknowns,) [m] or 1
    given : (nodes,) column of the prescribed joint coordinate, -1 without; column : (nodes,) of the passive one in its block
    turn : (nodes,) +-1 of revolute joints, 0 else; slide : (nodes, 2) direction of prismatic ones in the parent's frame
    offset_p : (nodes, 2) p_0 [m]; shifted : (nodes,) whether p may differ from zero
    mass, inertia : (nodes,) [kg], [kg m^2] about the normal; gravity : (2,) [m/s^2]
    rotor, damping, friction : (nodes,) of the passive joint
    """

    parent: NDArray[np.int64]
    block: NDArray[np.int64]
    independent: NDArray[np.bool_]
    size: NDArray[np.int64]
    offset: NDArray[np.int64]
    scale: Array
    given: NDArray[np.int64]
    column: NDArray[np.int64]
    turn: Array
    slide: Array
    offset_p: Array
    shifted: NDArray[np.bool_]
    mass: Array
    inertia: Array
    gravity: Array
    rotor: Array
    damping: Array
    friction: Array


class PlanarState(NamedTuple):
    """Unknowns of a step as in `assemble.State`; start : (nodes, 3) pose of independent nodes, coordinate of passive joints.

    trend : (unknowns,) change of the auxiliary acceleration in the last step [m/s^2], [rad/s^2]
    """

    start: Array
    d: Array
    u: Array
    du: Array
    pseudo: Array
    trend: Array
    bend: Array
    u0: Array
    du0: Array


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
def place(t, s, given, f):
    """Set the motion of all nodes from the unknowns and the prescribed coordinates (joints, 3) q, q', q'' [m, rad, s]."""
    for n in range(len(t.parent)):
        o, own = t.offset[t.block[n]], t.column[n]
        if t.independent[n]:
            for i in range(3):
                f.pose[n, i] = s.start[n, i] + s.d[o + i]
                f.rate[n, i], f.acceleration[n, i] = s.u[o + i], s.du[o + i]
            continue
        if t.given[n] >= 0:
            for i in range(3):
                f.joint[n, i] = given[t.given[n], i]
        elif own >= 0:
            f.joint[n, 0], f.joint[n, 1], f.joint[n, 2] = s.start[n, 0] + s.d[o + own], s.u[o + own], s.du[o + own]
        _carry(n, t, f)


@jit_inner
def _put(a, x, y, turned):
    a[0], a[1], a[2] = x, y, turned


@jit_inner
def _carry(n, t, f):
    """Motion of a dependent node from its parent's, the equations at the head of the file."""
    m, turn, d1, d2 = t.parent[n], t.turn[n], t.slide[n, 0], t.slide[n, 1]
    q, dq, ddq = f.joint[n, 0], f.joint[n, 1], f.joint[n, 2]
    p1, p2 = t.offset_p[n, 0] + q * d1, t.offset_p[n, 1] + q * d2
    if m < 0:
        f.arm[n, 0], f.arm[n, 1], f.arm[n, 2], f.arm[n, 3] = p1, p2, d1, d2
        _put(f.pose[n], p1, p2, turn * q)
        _put(f.rate[n], dq * d1, dq * d2, turn * dq)
        _put(f.acceleration[n], ddq * d1, ddq * d2, turn * ddq)
        return
    r1, r2, e1, e2 = 0.0, 0.0, 0.0, 0.0
    if t.shifted[n]:
        c, s = cos_sin(f.pose[m, 2])
        r1, r2, e1, e2 = c * p1 - s * p2, s * p1 + c * p2, c * d1 - s * d2, s * d1 + c * d2
    f.arm[n, 0], f.arm[n, 1], f.arm[n, 2], f.arm[n, 3] = r1, r2, e1, e2
    x, v, a, w, al = f.pose[m], f.rate[m], f.acceleration[m], f.rate[m, 2], f.acceleration[m, 2]
    _put(f.pose[n], x[0] + r1, x[1] + r2, x[2] + turn * q)
    _put(f.rate[n], v[0] - w * r2 + dq * e1, v[1] + w * r1 + dq * e2, w + turn * dq)
    a1 = a[0] - al * r2 - w * w * r1 - 2 * w * dq * e2 + ddq * e1
    a2 = a[1] + al * r1 - w * w * r2 + 2 * w * dq * e1 + ddq * e2
    _put(f.acceleration[n], a1, a2, al + turn * ddq)


@jit_inner
def stand(t, s, joint, f):
    """Set the unknowns to the rigid motion of the stress-free mechanism whose joints (nodes, 3) are at q, q', q'' [m, rad, s]."""
    for n in range(len(t.parent)):
        o, own = t.offset[t.block[n]], t.column[n]
        for i in range(3):
            f.joint[n, i] = joint[n, i]
        _carry(n, t, f)
        if t.independent[n]:
            for i in range(3):
                s.start[n, i], s.u[o + i], s.du[o + i] = f.pose[n, i], f.rate[n, i], f.acceleration[n, i]
        elif own >= 0:
            s.start[n, 0], s.u[o + own], s.du[o + own] = joint[n, 0], joint[n, 1], joint[n, 2]


@jit_inner
def accept(s):
    """Let the next step start from the present velocities [m/s] and accelerations [m/s^2], without a past."""
    for k in range(len(s.d)):
        s.u0[k], s.du0[k], s.pseudo[k] = s.u[k], s.du[k], s.du[k]
        s.d[k], s.trend[k], s.bend[k] = 0.0, 0.0, 0.0


@jit_inner
def vary_independent(t, f, cv, ca):
    """Set how independent nodes move with their own unknowns [m, rad, s], once and for all: dv = cv dx, da = ca dx."""
    for n in range(len(t.parent)):
        if t.independent[n]:
            for k in range(t.size[t.block[n]]):
                for i in range(3):
                    own = 1.0 if k == i else 0.0
                    f.by_pose[n, k, i], f.by_rate[n, k, i], f.by_acceleration[n, k, i] = own, cv * own, ca * own


@jit_inner
def vary(t, f, cv, ca):
    """Set how dependent nodes move with the unknowns of their blocks [m, rad, s]."""
    for n in range(len(t.parent)):
        m, columns = t.parent[n], t.size[t.block[n]]
        for k in range(0 if t.independent[n] else columns):
            for i in range(3):
                f.by_pose[n, k, i] = f.by_pose[m, k, i] if m >= 0 else 0.0
                f.by_rate[n, k, i] = f.by_rate[m, k, i] if m >= 0 else 0.0
                f.by_acceleration[n, k, i] = f.by_acceleration[m, k, i] if m >= 0 else 0.0
            _carry_variation(n, k, t, f, cv, ca)


@jit_inner
def vary_poses(t, f):
    """Set how the poses of dependent nodes move with the unknowns of their blocks [m], [rad]: the first part of `vary`."""
    for n in range(len(t.parent)):
        m = t.parent[n]
        for k in range(0 if t.independent[n] else t.size[t.block[n]]):
            x, y, turned = _get(f.by_pose[m, k]) if m >= 0 else (0.0, 0.0, 0.0)
            own = 1.0 if k == t.column[n] else 0.0
            x, y = x + own * f.arm[n, 2] - turned * f.arm[n, 1], y + own * f.arm[n, 3] + turned * f.arm[n, 0]
            _put(f.by_pose[n, k], x, y, turned + own * t.turn[n])


@jit_inner
def _carry_variation(n, k, t, f, cv, ca):
    """Add to the variation of node n, on entry its parent's, the differential of `_carry` by unknown k."""
    m, own = t.parent[n], 1.0 if k == t.column[n] else 0.0
    w, al = (f.rate[m, 2], f.acceleration[m, 2]) if m >= 0 else (0.0, 0.0)
    turned, dw, dal = f.by_pose[n, k, 2], f.by_rate[n, k, 2], f.by_acceleration[n, k, 2]
    r1, r2, e1, e2 = f.arm[n, 0], f.arm[n, 1], f.arm[n, 2], f.arm[n, 3]
    dq, ddq = f.joint[n, 1], f.joint[n, 2]
    dr1, dr2 = own * e1 - turned * r2, own * e2 + turned * r1
    s1, s2 = cv * own * e1 - turned * dq * e2, cv * own * e2 + turned * dq * e1  # d(S p')
    z1, z2 = ca * own * e1 - turned * ddq * e2, ca * own * e2 + turned * ddq * e1  # d(S p'')
    x, v, a, turn = f.by_pose[n, k], f.by_rate[n, k], f.by_acceleration[n, k], own * t.turn[n]
    _put(x, x[0] + dr1, x[1] + dr2, turned + turn)
    _put(v, v[0] - dw * r2 - w * dr2 + s1, v[1] + dw * r1 + w * dr1 + s2, dw + cv * turn)
    spin, dspin = w * w, 2 * w * dw
    a1 = a[0] - dal * r2 - al * dr2 - dspin * r1 - spin * dr1 - 2 * (dw * dq * e2 + w * s2) + z1
    a2 = a[1] + dal * r1 + al * dr1 - dspin * r2 - spin * dr2 + 2 * (dw * dq * e1 + w * s1) + z2
    _put(a, a1, a2, dal + ca * turn)


@jit_inner
def node_wrenches(t, f):
    """Set every node's own wrench P = m (a - g) [N], Q = J al [N m]."""
    for n in range(len(t.parent)):
        m, a = t.mass[n], f.acceleration[n]
        _put(f.wrench[n], m * (a[0] - t.gravity[0]), m * (a[1] - t.gravity[1]), t.inertia[n] * a[2])


@jit_inner
def node_wrench_variations(t, f):
    """Set how every node's own wrench varies with the unknowns of its block [N], [N m]."""
    for n in range(len(t.parent)):
        m, j = t.mass[n], t.inertia[n]
        for k in range(t.size[t.block[n]]):
            a = f.by_acceleration[n, k]
            _put(f.dwrench[n, k], m * a[0], m * a[1], j * a[2])


@jit_inner
def gather(t, s, f, residual):
    """Bring wrenches of dependent nodes back to their blocks: residual (unknowns,) [N], [N m]."""
    for n in range(len(t.parent) - 1, -1, -1):
        m, o, own = t.parent[n], t.offset[t.block[n]], t.column[n]
        f1, f2, mu = _get(f.wrench[n])
        if t.independent[n]:
            residual[o], residual[o + 1], residual[o + 2] = f1, f2, mu
            continue
        if own >= 0:
            u, du = s.u[o + own], s.du[o + own]
            drive = t.rotor[n] * du + t.damping[n] * u + t.friction[n] * np.tanh(u / FRICTION_RATE)
            residual[o + own] = f.arm[n, 2] * f1 + f.arm[n, 3] * f2 + t.turn[n] * mu + drive
        if m >= 0:
            f.wrench[m, 0] += f1
            f.wrench[m, 1] += f2
            f.wrench[m, 2] += mu + f.arm[n, 0] * f2 - f.arm[n, 1] * f1


@jit_inner
def _get(a):
    return a[0], a[1], a[2]


@jit_inner
def gather_variations(t, s, f, diagonal, cv, ca):
    """Bring variations of wrenches back: diagonal blocks of the linearisation [N/m], [N], [N m].

    diagonal : (blocks, columns, columns); `gather` came before
    """
    for n in range(len(t.parent) - 1, -1, -1):
        m, b, own, columns = t.parent[n], t.block[n], t.column[n], t.size[t.block[n]]
        f1, f2, _ = _get(f.wrench[n])
        r1, r2, e1, e2 = f.arm[n, 0], f.arm[n, 1], f.arm[n, 2], f.arm[n, 3]
        for k in range(columns):
            df1, df2, dmu = _get(f.dwrench[n, k])
            if t.independent[n]:
                diagonal[b, 0, k], diagonal[b, 1, k], diagonal[b, 2, k] = df1, df2, dmu
                continue
            turned = f.by_pose[m, k, 2] if m >= 0 else 0.0
            along = 1.0 if k == own else 0.0
            if own >= 0:
                slope = e1 * df1 + e2 * df2 + turned * (e1 * f2 - e2 * f1) + t.turn[n] * dmu
                diagonal[b, own, k] = slope + along * _drive_slope(n, own, t, s, cv, ca)
            if m >= 0:
                dr1, dr2 = along * e1 - turned * r2, along * e2 + turned * r1
                f.dwrench[m, k, 0] += df1
                f.dwrench[m, k, 1] += df2
                f.dwrench[m, k, 2] += dmu + r1 * df2 - r2 * df1 + dr1 * f2 - dr2 * f1


@jit_inner
def _drive_slope(n, own, t, s, cv, ca):
    """Derivative of a passive joint's own rotor, damping and friction efforts by its coordinate."""
    soft = np.tanh(s.u[t.offset[t.block[n]] + own] / FRICTION_RATE)
    return ca * t.rotor[n] + cv * (t.damping[n] + t.friction[n] * (1.0 - soft * soft) / FRICTION_RATE)
