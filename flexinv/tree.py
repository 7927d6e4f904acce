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

from flexinv.compiled import jit, jit_inner
from flexinv.mechanism import Array
from flexinv.vectors import (
    add,
    add_scaled,
    add_to,
    apply,
    cross,
    mat,
    mul,
    put,
    put_block,
    sub,
    sum3,
    tapply,
    vec,
    vec_at,
)


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


@jit_inner
def carry(n, m, f, j):
    """Set the motion of node n from that of its parent m (-1: the fixed world) [m, rad, s]."""
    p, dp, ddp, rj, wj, alj = vec(j.p[n]), vec(j.dp[n]), vec(j.ddp[n]), mat(j.r[n]), vec(j.w[n]), vec(j.al[n])
    if m < 0:
        _put_frame(n, f, p, rj, dp, wj, ddp, alj)
        return
    r, w, al = mat(f.r[m]), vec(f.w[m]), vec(f.al[m])
    wp = cross(w, p)
    z = sum3(cross(al, p), cross(w, add_scaled(wp, 2.0, dp)), ddp)
    c = tapply(rj, w)
    _put_frame(
        n,
        f,
        add(vec(f.x[m]), apply(r, p)),
        mul(r, rj),
        add(vec(f.v[m]), apply(r, add(wp, dp))),
        add(c, wj),
        add(vec(f.a[m]), apply(r, z)),
        sum3(tapply(rj, al), alj, cross(c, wj)),
    )


@jit_inner
def _put_frame(n, f, x, r, v, w, a, al):
    put(f.x[n], 0, x)
    put_block(f.r[n], 0, 0, r)
    put(f.v[n], 0, v)
    put(f.w[n], 0, w)
    put(f.a[n], 0, a)
    put(f.al[n], 0, al)


@jit_inner
def carry_variation(n, m, columns, f, j, d):
    """Add to d of node n what follows from the variation of its parent m; d[n] holds the joint's own part on entry [m, rad, s].

    Own part on entry, all in the frames of `Joints`: d.x = dp, d.t = theta_j, d.v = dp', d.w = dw_j, d.a = dp'', d.al = dal_j.
    """
    if m < 0:
        return
    p, dp, wj, rj = vec(j.p[n]), vec(j.dp[n]), vec(j.w[n]), mat(j.r[n])
    r, w, al = mat(f.r[m]), vec(f.w[m]), vec(f.al[m])
    wp = cross(w, p)
    y, y2 = add(wp, dp), add_scaled(wp, 2.0, dp)
    z = sum3(cross(al, p), cross(w, y2), vec(j.ddp[n]))
    c, e = tapply(rj, w), tapply(rj, al)
    for k in range(columns):
        t, dw, dal = vec(d.t[m, k]), vec(d.w[m, k]), vec(d.al[m, k])
        own_x, own_t, own_v = vec(d.x[n, k]), vec(d.t[n, k]), vec(d.v[n, k])
        own_w, own_a, own_al = vec(d.w[n, k]), vec(d.a[n, k]), vec(d.al[n, k])
        dc = add(tapply(rj, dw), cross(c, own_t))
        dwp = add(cross(dw, p), cross(w, own_x))
        dy, dy2 = add(dwp, own_v), add_scaled(dwp, 2.0, own_v)
        dz = add(sum3(cross(dal, p), cross(al, own_x), cross(dw, y2)), add(cross(w, dy2), own_a))
        de = add(tapply(rj, dal), cross(e, own_t))
        put(d.x[n, k], 0, add(vec(d.x[m, k]), apply(r, add(cross(t, p), own_x))))
        put(d.t[n, k], 0, add(tapply(rj, t), own_t))
        put(d.v[n, k], 0, add(vec(d.v[m, k]), apply(r, add(cross(t, y), dy))))
        put(d.w[n, k], 0, add(dc, own_w))
        put(d.a[n, k], 0, add(vec(d.a[m, k]), apply(r, add(cross(t, z), dz))))
        put(d.al[n, k], 0, add(sum3(de, own_al, cross(dc, wj)), cross(c, own_w)))


@jit_inner
def bring_back(n, m, f, j, wrench):
    """Add the wrench of node n, [N] world and [N m] own frame, to that of its parent m."""
    force = vec(wrench[n])
    arm = cross(vec(j.p[n]), tapply(mat(f.r[m]), force))
    add_to(wrench[m], 0, force)
    add_to(wrench[m], 3, add(arm, apply(mat(j.r[n]), vec_at(wrench[n], 3))))


@jit_inner
def bring_back_variation(n, m, columns, f, j, d, own_x, own_t, wrench, dwrench):
    """Add the variation of node n's wrench [N], [N m] to its parent's; own_x, own_t (columns, 3): that of p, theta_j."""
    p, rj, r = vec(j.p[n]), mat(j.r[n]), mat(f.r[m])
    local, mu = tapply(r, vec(wrench[n])), vec_at(wrench[n], 3)
    for k in range(columns):
        df, dmu = vec(dwrench[n, k]), vec_at(dwrench[n, k], 3)
        dlocal = sub(tapply(r, df), cross(vec(d.t[m, k]), local))
        arm = add(cross(vec(own_x[k]), local), cross(p, dlocal))
        add_to(dwrench[m, k], 0, df)
        add_to(dwrench[m, k], 3, add(arm, apply(rj, add(cross(vec(own_t[k]), mu), dmu))))


@jit
def carry_samples(parent, x, r, v, w, a, al, p, dp, ddp, rj, wj, alj):
    """Walk the tree for every sample: fill world motion (samples, nodes, ...) from relative motion [m, rad, s]."""
    for s in range(x.shape[0]):
        f = Frames(x[s], r[s], v[s], w[s], a[s], al[s])
        j = Joints(p[s], dp[s], ddp[s], rj[s], wj[s], alj[s])
        for n in range(len(parent)):
            carry(n, parent[n], f, j)
