"""Forward and backward pass over the tree, node by node: motion from parent to child, loads from child to parent.

With p, R_j the relative pose (p in the parent's frame A, w_j in the child's frame B), c = R_j^T w_A:

    x_B = x_A + R_A p            R_B = R_A R_j
    v_B = v_A + R_A y            y = w_A x p + p'
    w_B = c + w_j
    a_B = a_A + R_A z            z = al_A x p + w_A x (w_A x p) + 2 w_A x p' + p''
    al_B = R_j^T al_A + al_j + c x w_j

Forces are dual: a force f (world) and a moment mu (own frame) at B act on A as f and p x R_A^T f + R_j mu.
Both maps come with their first variation, which the implicit time integration linearises.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np

from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import (
    add,
    add_pair,
    add_scaled,
    apply,
    cross,
    dot_pair,
    mat,
    mul,
    pair,
    put,
    put_mat,
    sum3,
    tapply,
    vec,
)
from flexinv.typing import Array


@send_by_address
class Frames(NamedTuple):
    """Motion of all nodes at one instant: x, v, a [m, s] world; r = R_W,node; w, al [rad, s] own frame."""

    x: Array
    r: Array
    v: Array
    w: Array
    a: Array
    al: Array


@send_by_address
class Joints(NamedTuple):
    """Motion of all nodes relative to their parents: p, dp, ddp [m, s] and r in the parent's frame; w, al [rad, s] own frame."""

    p: Array
    dp: Array
    ddp: Array
    r: Array
    w: Array
    al: Array


@send_by_address
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


NodeRecord = TypeVar("NodeRecord", Frames, Joints, Variation)


def make_room(record: type[NodeRecord], *shape: int) -> NodeRecord:
    """Return a record of motions with zeros [any unit], vectors (shape, 3) and matrices ``r`` (shape, 3, 3)."""
    return record(*(np.zeros((*shape, 3, 3) if name == "r" else (*shape, 3)) for name in record._fields))


@jit_inner
def compute_child_motion(n, m, frames, joints):
    """Set the motion of node n from that of its parent m (-1: the fixed world) [m, rad, s]."""
    p = vec(joints.p[n])
    dp = vec(joints.dp[n])
    ddp = vec(joints.ddp[n])
    rj = mat(joints.r[n])
    wj = vec(joints.w[n])
    alj = vec(joints.al[n])
    if m < 0:
        write_frame(n, frames, p, rj, dp, wj, ddp, alj)
        return
    r = mat(frames.r[m])
    w = vec(frames.w[m])
    al = vec(frames.al[m])
    wp = cross(w, p)
    z = sum3(cross(al, p), cross(w, add_scaled(wp, 2.0, dp)), ddp)
    c = tapply(rj, w)
    x = add(vec(frames.x[m]), apply(r, p))
    v = vec(frames.v[m])
    a = add(vec(frames.a[m]), apply(r, z))
    v = add(v, apply(r, add(wp, dp)))
    alpha = sum3(tapply(rj, al), alj, cross(c, wj))
    write_frame(n, frames, x, mul(r, rj), v, add(c, wj), a, alpha)


@jit_inner
def write_frame(n, frames, position, rotation, velocity, omega, acceleration, alpha):
    """Write the motion of node n [m, rad, s], fields as of `Frames`."""
    put(frames.x[n], position)
    put_mat(frames.r[n], rotation)
    put(frames.v[n], velocity)
    put(frames.w[n], omega)
    put(frames.a[n], acceleration)
    put(frames.al[n], alpha)


@jit_inner
def add_parent_variation(n, m, columns, frames, joints, variation):
    """Add to the variation of node n what follows from that of its parent m [m, rad, s].

    On entry it holds the joint's own part, in frames of `Joints`: x = dp, t = theta_j, v = dp', w = dw_j, a = dp'', al = dal_j.
    """
    if m < 0:
        return
    p = vec(joints.p[n])
    dp = vec(joints.dp[n])
    wj = vec(joints.w[n])
    rj = mat(joints.r[n])
    r = mat(frames.r[m])
    w = vec(frames.w[m])
    al = vec(frames.al[m])
    wp = cross(w, p)
    y = add(wp, dp)
    y2 = add_scaled(wp, 2.0, dp)
    z = sum3(cross(al, p), cross(w, y2), vec(joints.ddp[n]))
    c = tapply(rj, w)
    e = tapply(rj, al)
    for k in range(columns):
        t = vec(variation.t[m, k])
        dw = vec(variation.w[m, k])
        dal = vec(variation.al[m, k])
        own_x = vec(variation.x[n, k])
        own_t = vec(variation.t[n, k])
        own_v = vec(variation.v[n, k])
        own_w = vec(variation.w[n, k])
        own_a = vec(variation.a[n, k])
        own_al = vec(variation.al[n, k])
        dc = add(tapply(rj, dw), cross(c, own_t))
        dwp = add(cross(dw, p), cross(w, own_x))
        dy = add(dwp, own_v)
        dy2 = add_scaled(dwp, 2.0, own_v)
        dz = add(sum3(cross(dal, p), cross(al, own_x), cross(dw, y2)), add(cross(w, dy2), own_a))
        de = add(tapply(rj, dal), cross(e, own_t))
        put(variation.x[n, k], add(vec(variation.x[m, k]), apply(r, add(cross(t, p), own_x))))
        put(variation.t[n, k], add(tapply(rj, t), own_t))
        put(variation.v[n, k], add(vec(variation.v[m, k]), apply(r, add(cross(t, y), dy))))
        put(variation.w[n, k], add(dc, own_w))
        put(variation.a[n, k], add(vec(variation.a[m, k]), apply(r, add(cross(t, z), dz))))
        put(variation.al[n, k], add(sum3(de, own_al, cross(dc, wj)), cross(c, own_w)))


@jit_inner
def add_wrench_to_parent(n, m, frames, joints, wrench):
    """Add the wrench of node n, [N] world and [N m] own frame, to that of its parent m."""
    force, moment = pair(wrench[n])
    arm = cross(vec(joints.p[n]), tapply(mat(frames.r[m]), force))
    add_pair(wrench[m], force, add(arm, apply(mat(joints.r[n]), moment)))


@jit_inner
def compute_wrench_effort(joints, n, i, wrench):
    """Return the effort of a wrench in the frame of node n along freedom i of its joint [N m], [N].

    joints : `configuration.Nodes` or what else has ``slide`` and ``turn``, the axes of freedoms, (nodes, 6, 3)
    """
    return dot_pair((vec(joints.slide[n, i]), vec(joints.turn[n, i])), wrench)


@jit_inner
def take_sample(frames, sample):
    """Return one sample of a motion with a leading axis of samples [m, rad, s]."""
    x = frames.x[sample]
    r = frames.r[sample]
    v = frames.v[sample]
    w = frames.w[sample]
    return Frames(x, r, v, w, frames.a[sample], frames.al[sample])


@jit_inner
def take_joints(joints, sample):
    """Return one sample of relative motions with a leading axis of samples [m, rad, s]."""
    p = joints.p[sample]
    dp = joints.dp[sample]
    ddp = joints.ddp[sample]
    return Joints(p, dp, ddp, joints.r[sample], joints.w[sample], joints.al[sample])


@jit_inner
def write_joint(n, joints, p, dp, ddp, turn, w, al):
    """Write the relative motion of node n [m, rad, s], fields as of `Joints`."""
    put(joints.p[n], p)
    put(joints.dp[n], dp)
    put(joints.ddp[n], ddp)
    put_mat(joints.r[n], turn)
    put(joints.w[n], w)
    put(joints.al[n], al)


@jit
def compute_tree_motion(parent, frames, joints):
    """Walk the tree for every sample: fill ``frames`` from ``joints``, both with a leading axis of samples [m, rad, s]."""
    for s in range(frames.x.shape[0]):
        f = take_sample(frames, s)
        j = take_joints(joints, s)
        for n in range(len(parent)):
            compute_child_motion(n, parent[n], f, j)
