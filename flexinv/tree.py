"""Walking the tree, one node at a time: how a child's frame moves with its parent's, and how loads come back.

With p, R_j the relative pose (p in the parent's frame A, w_j in the child's frame B), c = R_j^T w_A:

    x_B = x_A + R_A p            R_B = R_A R_j
    v_B = v_A + R_A y            y = w_A x p + p'
    w_B = c + w_j
    a_B = a_A + R_A z            z = al_A x p + w_A x (w_A x p) + 2 w_A x p' + p''
    al_B = R_j^T al_A + al_j + c x w_j

Forces are dual: a force f (world) and a moment mu (own frame) at B act on A as f and p x R_A^T f + R_j mu.
Both maps come with their first variation, which is what the implicit march linearises.
"""

from __future__ import annotations

from typing import NamedTuple

from numba import njit

from flexinv.mechanism import Array
from flexinv.vectors import apply3, cross3, mul3, tapply3


class Frames(NamedTuple):
    """Motion of all nodes at one instant: x, v, a [m, s] world; r = R_W,node; w, al [rad, s] own frame."""

    x: Array
    r: Array
    v: Array
    w: Array
    a: Array
    al: Array


class Joints(NamedTuple):
    """Relative motion of all nodes at one instant: p, dp, ddp [m, s]; r; w, al [rad, s] (see `joint.Relative`)."""

    p: Array
    dp: Array
    ddp: Array
    r: Array
    w: Array
    al: Array


class Variation(NamedTuple):
    """First variation of all nodes by the unknowns of their block, (nodes, columns, 3) each, columns first.

    x [m] world, t rotation increment [rad] own frame, and those of v, w, a, al
    """

    x: Array
    t: Array
    v: Array
    w: Array
    a: Array
    al: Array


@njit(cache=True)
def carry(n, m, f, j):
    """Set the motion of node n from that of its parent m (-1: the fixed world) [m, rad, s]."""
    p, dp = j.p[n], j.dp[n]
    if m < 0:
        f.x[n], f.r[n], f.v[n], f.w[n], f.a[n], f.al[n] = p, j.r[n], dp, j.w[n], j.ddp[n], j.al[n]
        return
    r, w, al = f.r[m], f.w[m], f.al[m]
    wp = cross3(w, p)
    c = tapply3(j.r[n], w)
    f.x[n] = f.x[m] + apply3(r, p)
    f.r[n] = mul3(r, j.r[n])
    f.v[n] = f.v[m] + apply3(r, wp + dp)
    f.w[n] = c + j.w[n]
    f.a[n] = f.a[m] + apply3(r, cross3(al, p) + cross3(w, wp) + 2 * cross3(w, dp) + j.ddp[n])
    f.al[n] = tapply3(j.r[n], al) + j.al[n] + cross3(c, j.w[n])


@njit(cache=True)
def carry_variation(n, m, columns, f, j, d):
    """Add to d of node n what follows from the variation of its parent m; d[n] holds the joint's own part on entry.

    Own part on entry, all in the frames of `Joints`: d.x = dp, d.t = theta_j, d.v = dp', d.w = dw_j, d.a = dp'', d.al = dal_j.
    """
    if m < 0:
        return
    p, dp, r, rj, w, al = j.p[n], j.dp[n], f.r[m], j.r[n], f.w[m], f.al[m]
    wp = cross3(w, p)
    y = wp + dp
    z = cross3(al, p) + cross3(w, wp) + 2 * cross3(w, dp) + j.ddp[n]
    c, e, wj = tapply3(rj, w), tapply3(rj, al), j.w[n]
    for k in range(columns):
        t, dw, dal = d.t[m, k], d.w[m, k], d.al[m, k]
        own_x, own_t, own_v, own_a = d.x[n, k].copy(), d.t[n, k].copy(), d.v[n, k].copy(), d.a[n, k].copy()
        dc = tapply3(rj, dw) + cross3(c, own_t)
        dy = cross3(dw, p) + cross3(w, own_x) + own_v
        dz = cross3(dal, p) + cross3(al, own_x) + cross3(dw, wp) + cross3(w, cross3(dw, p) + cross3(w, own_x))
        dz += 2 * (cross3(dw, dp) + cross3(w, own_v)) + own_a
        d.al[n, k] += tapply3(rj, dal) + cross3(e, own_t) + cross3(dc, wj) + cross3(c, d.w[n, k])
        d.w[n, k] += dc
        d.x[n, k] = d.x[m, k] + apply3(r, cross3(t, p) + own_x)
        d.t[n, k] = tapply3(rj, t) + own_t
        d.v[n, k] = d.v[m, k] + apply3(r, cross3(t, y) + dy)
        d.a[n, k] = d.a[m, k] + apply3(r, cross3(t, z) + dz)


@njit(cache=True)
def bring_back(n, m, f, j, wrench):
    """Add the wrench of node n, [N] world and [N m] own frame, to that of its parent m."""
    local = tapply3(f.r[m], wrench[n, :3])
    moment = cross3(j.p[n], local) + apply3(j.r[n], wrench[n, 3:])
    for k in range(3):
        wrench[m, k] += wrench[n, k]
        wrench[m, 3 + k] += moment[k]


@njit(cache=True)
def bring_back_variation(n, m, columns, f, j, d, own_x, own_t, wrench, dwrench):
    """Add the variation of node n's wrench to its parent's; own_x, own_t (columns, 3): variation of p and theta_j."""
    p, rj, r = j.p[n], j.r[n], f.r[m]
    local, mu = tapply3(r, wrench[n, :3]), wrench[n, 3:]
    for k in range(columns):
        df, dmu = dwrench[n, k, :3], dwrench[n, k, 3:]
        dlocal = tapply3(r, df) - cross3(d.t[m, k], local)
        moment = cross3(own_x[k], local) + cross3(p, dlocal) + apply3(rj, cross3(own_t[k], mu) + dmu)
        for i in range(3):
            dwrench[m, k, i] += df[i]
            dwrench[m, k, 3 + i] += moment[i]


@njit(cache=True)
def carry_samples(parent, x, r, v, w, a, al, p, dp, ddp, rj, wj, alj):
    """Walk the tree for every sample: fill world motion (samples, nodes, ...) from relative motion [m, rad, s]."""
    for s in range(x.shape[0]):
        f = Frames(x[s], r[s], v[s], w[s], a[s], al[s])
        j = Joints(p[s], dp[s], ddp[s], rj[s], wj[s], alj[s])
        for n in range(len(parent)):
            carry(n, parent[n], f, j)


