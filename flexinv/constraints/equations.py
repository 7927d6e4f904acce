"""Closure equations of one configuration in compiled code: the rows of `closures`, their rates, their Jacobian."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import by_address
from flexinv.kernels.vec3 import add, add_to, apply, cross, dot, mat, mul, put, scale, sub, tapply, vec, vec_at
from flexinv.kinematics.tree import frames_at
from flexinv.typing import Array


@by_address
class RowArrays(NamedTuple):
    """Constraints, one a row: see `closures.Rows` [m], [-]."""

    direction: NDArray[np.bool_]
    a: NDArray[np.int64]
    b: NDArray[np.int64]
    place_a: Array
    place_b: Array
    u: Array
    w: Array
    gear: Array
    offset: Array
    place: NDArray[np.int64]


@jit_inner
def fixed(frames, n, vector):
    """Return a vector [m], [-] fixed in node n (-1: the world) and its two rates, world axes: r, w x r, al x r + w x (w x r)."""
    none = (0.0, 0.0, 0.0)
    if n < 0:
        return vector, none, none
    r, w, al = mat(frames.r[n]), vec(frames.w[n]), vec(frames.al[n])
    spin = cross(w, vector)
    return apply(r, vector), apply(r, spin), apply(r, add(cross(al, vector), cross(w, spin)))


@jit_inner
def point(frames, n, place):
    """Return a point fixed in node n [m], its velocity and its acceleration."""
    x, v, a = fixed(frames, n, place)
    if n < 0:
        return x, v, a
    return add(vec(frames.x[n]), x), add(vec(frames.v[n]), v), add(vec(frames.a[n]), a)


@jit_inner
def gap(frames, a, b, place_a, place_b):
    """Return the vector from a point of node a to a point of node b [m] and its two rates, world axes."""
    xa, xb = point(frames, a, place_a), point(frames, b, place_b)
    return sub(xb[0], xa[0]), sub(xb[1], xa[1]), sub(xb[2], xa[2])


@jit_inner
def _vectors(k, rows, frames):
    """u and w, or u and d = x_B - x_A, of row k, each with its two rates."""
    u = fixed(frames, rows.a[k], vec(rows.u[k]))
    if rows.direction[k]:
        return u, fixed(frames, rows.b[k], vec(rows.w[k]))
    return u, gap(frames, rows.a[k], rows.b[k], vec(rows.place_a[k]), vec(rows.place_b[k]))


@jit_inner
def residual(k, rows, frames):
    """Return phi = u . w [m], [-], phi' and phi'' = u''.w + 2 u'.w' + u.w'' of row k."""
    (u, u1, u2), (w, w1, w2) = _vectors(k, rows, frames)
    return dot(u, w), dot(u1, w) + dot(u, w1), dot(u2, w) + 2 * dot(u1, w1) + dot(u, w2)


@jit_inner
def geared(k, rows, q, qd, qdd):
    """Return the terms of a coupling of joint coordinates in row k: sum gear q - offset [rad], [m], and its two rates."""
    phi, rate, second = -rows.offset[k], 0.0, 0.0
    for i in range(rows.place.shape[0]):
        if rows.gear[k, i] != 0.0:
            phi += rows.gear[k, i] * q[rows.place[i]]
            rate += rows.gear[k, i] * qd[i]
            second += rows.gear[k, i] * qdd[i]
    return phi, rate, second


@jit_inner
def _add_path(nodes, frames, node, force, moment, out):
    """Add the joint efforts of a wrench on a node, moment about it (world), along the path to the root."""
    n = node
    while n >= 0:
        k = nodes.v_index[n]
        if k >= 0:
            r = mat(frames.r[n])
            push = tapply(r, force)
            turn = tapply(r, add(moment, cross(sub(vec(frames.x[node]), vec(frames.x[n])), force)))
            for i in range(nodes.freedoms[n]):
                out[k + i] += dot(vec(nodes.slide[n, i]), push) + dot(vec(nodes.turn[n, i]), turn)
        n = nodes.parent[n]


@jit_inner
def jacobian(nodes, rows, frames, g):
    """Set G (rows, nv) [m/rad], [-], phi' = G qd: each row is the joint efforts of a unit multiplier."""
    for k in range(rows.a.shape[0]):
        for i in range(rows.place.shape[0]):
            g[k, i] = rows.gear[k, i]
        (u, _, _), (w, _, _) = _vectors(k, rows, frames)
        if rows.direction[k]:
            none = (0.0, 0.0, 0.0)
            _add_path(nodes, frames, rows.b[k], none, cross(w, u), g[k])
            _add_path(nodes, frames, rows.a[k], none, cross(u, w), g[k])
        else:
            arm_a, _, _ = fixed(frames, rows.a[k], vec(rows.place_a[k]))
            arm_b, _, _ = fixed(frames, rows.b[k], vec(rows.place_b[k]))
            _add_path(nodes, frames, rows.b[k], u, cross(arm_b, u), g[k])
            _add_path(nodes, frames, rows.a[k], scale(-1.0, u), cross(u, add(arm_a, w)), g[k])


@jit
def jacobians(nodes, rows, frames, g):
    """Set G of every sample (samples, rows, nv) [m/rad], [-] from the motion of the nodes."""
    for s in range(g.shape[0]):
        jacobian(nodes, rows, frames_at(frames, s), g[s])


@jit
def residual_samples(rows, frames, phi):
    """Set phi [m], [-], phi' and phi'', (samples, rows, 3), of every sample from the motion of the nodes."""
    for s in range(phi.shape[0]):
        f = frames_at(frames, s)
        for k in range(rows.a.shape[0]):
            put(phi[s, k], 0, residual(k, rows, f))


@by_address
class Ends(NamedTuple):
    """Frames in which closures report their wrenches (closures,): the second, or the first where the second is in the world.

    node : that carries it; second : whether it is the second; place (closures, 3) [m], turn (closures, 3, 3) : in the node
    """

    node: NDArray[np.int64]
    second: NDArray[np.bool_]
    place: Array
    turn: Array


@jit
def closing_samples(rows, closure, ends, frames, multipliers, force, moment, wrench):
    """Add what multipliers (samples, rows) [N], [N m] do to nodes, and set what each closure does to the second of its links.

    closure : (rows,) of each row; force, moment : (samples, nodes, 3) on the nodes, about them (world)
    wrench : (closures, samples, 6) force and moment at the closures' ends, in the axes there
    """
    for s in range(multipliers.shape[0]):
        f = frames_at(frames, s)
        for n in range(wrench.shape[0]):
            put(wrench[n, s], 0, (0.0, 0.0, 0.0))
            put(wrench[n, s], 3, (0.0, 0.0, 0.0))
        for k in range(rows.a.shape[0]):
            if multipliers[s, k] == 0.0:
                continue
            push, on_a, on_b = _wrenches(k, rows, f, multipliers[s, k])
            if rows.b[k] >= 0:
                add_to(force[s, rows.b[k]], 0, push)
                add_to(moment[s, rows.b[k]], 0, on_b)
            if rows.a[k] >= 0:
                add_to(force[s, rows.a[k]], 0, scale(-1.0, push))
                add_to(moment[s, rows.a[k]], 0, on_a)
            add_to(wrench[closure[k], s], 0, push)
            add_to(wrench[closure[k], s], 3, on_b if ends.second[closure[k]] else scale(-1.0, on_a))
        for n in range(wrench.shape[0]):
            if ends.node[n] >= 0:
                _show(wrench[n, s], mat(f.r[ends.node[n]]), vec(ends.place[n]), mat(ends.turn[n]))


@jit_inner
def _show(wrench, turned, place, turn):
    """Bring a wrench on a node (world, moment about it) to a frame at a place in it, and into its axes."""
    force, moment, axes = vec_at(wrench, 0), vec_at(wrench, 3), mul(turned, turn)
    put(wrench, 0, tapply(axes, force))
    put(wrench, 3, tapply(axes, sub(moment, cross(apply(turned, place), force))))


@jit_inner
def _wrenches(k, rows, frames, size):
    """Force on the second node, and moments on the first and on the second, of a multiplier (world, about the nodes)."""
    (u, _, _), (w, _, _) = _vectors(k, rows, frames)
    on_a = scale(size, cross(u, w))
    if rows.direction[k]:
        return (0.0, 0.0, 0.0), on_a, scale(-1.0, on_a)
    push = scale(size, u)
    arm_a, _, _ = fixed(frames, rows.a[k], vec(rows.place_a[k]))
    arm_b, _, _ = fixed(frames, rows.b[k], vec(rows.place_b[k]))
    return push, sub(on_a, cross(arm_a, push)), cross(arm_b, push)
