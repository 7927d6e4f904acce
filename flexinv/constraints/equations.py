"""Closure equations of one configuration in compiled code: the rows of `closures`, their rates, their Jacobian.

Seen from the first frame A, in which u is fixed, with e = R_A^T d the place of the second and R = R_A^T R_B its axes there:

    phi = u . e  or  u . R w        phi' = u . e'  or  u . (om x R w)        phi'' = u . e''  or  u . (al x R w + om x (om x R w))

where ' is a rate seen from A and om, al are B's angular velocity and acceleration there.  What a joint between the two does to
them is its axis, and its slide or what its turn does to the point of B.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from flexinv.kernels.fronts import Fronts, build_fronts
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import (
    EYE,
    ZERO,
    add,
    add_to,
    apply,
    cross,
    dot,
    mat,
    mul,
    put,
    put_pair,
    scale,
    sub,
    tapply,
    tmul,
    vec,
)
from flexinv.kinematics.tree import take_sample
from flexinv.model.owned_cache import make_read_only
from flexinv.typing import Array, Indices, Mask


@send_by_address
class Rows(NamedTuple):
    """Constraints of all closures, one row each.

    closure : (rows,) index into mechanism.closures; last : (rows,) the row behind those of the same closure
    direction : (rows,) True for u . w, False for u . d
    a, b : (rows,) nodes, -1 the world; place_a, place_b : (rows, 3) [m] frame origins in the nodes' frames
    u, w : (rows, 3) [-] vectors in the nodes' frames
    gear : (rows, nv) factors of a coupling, whose equation is sum gear q = offset; zero for all others
    pattern : (rows, nv) entries that G may have
    scale : (rows,) what the equations are measured against [m], [-]: the mechanism's length for positions, 1 for directions, for
        couplings the largest of their terms, for a slide as long as the mechanism or an angle of 1
    place : (nv,) index into q of the scalar coordinates, -1 for others
    """

    closure: Indices
    direction: Mask
    a: Indices
    b: Indices
    place_a: Array
    place_b: Array
    u: Array
    w: Array
    gear: Array
    offset: Array
    pattern: Mask
    scale: Array
    last: Indices
    place: Indices

    def take_active(self, active: Mask) -> Rows:
        """Return the rows of the closures that are ``active`` (closures,)."""
        if active.all():
            return self
        parts: dict[str, Any] = {name: getattr(self, name)[active[self.closure]] for name in self._fields[:-1]}
        parts["last"] = np.searchsorted(parts["closure"], parts["closure"], side="right")
        return make_read_only(self._replace(**parts))  # as those of all closures are: one type for the kernels

    def build_fronts(self, columns: Mask | None = None, last: Mask | None = None) -> Fronts:
        """Return the fronts of some ``columns`` (nv,) of G [-], all by default, those of ``last`` (nv,) after all others."""
        kept = np.ones(len(self.place), dtype=bool) if columns is None else columns
        return build_fronts(self.pattern[:, kept], None if last is None else last[kept])


@jit_inner
def compute_fixed_vector(frames, n, vector):
    """Return a vector [m], [-] fixed in node n (-1: the world) and its two rates, world axes: r, w x r, al x r + w x (w x r)."""
    if n < 0:
        return vector, ZERO, ZERO
    r = mat(frames.r[n])
    w = vec(frames.w[n])
    al = vec(frames.al[n])
    spin = cross(w, vector)
    return apply(r, vector), apply(r, spin), apply(r, add(cross(al, vector), cross(w, spin)))


@jit_inner
def compute_point_motion(frames, n, place):
    """Return a point fixed in node n [m], its velocity and its acceleration."""
    x, v, a = compute_fixed_vector(frames, n, place)
    if n < 0:
        return x, v, a
    return add(vec(frames.x[n]), x), add(vec(frames.v[n]), v), add(vec(frames.a[n]), a)


@jit_inner
def compute_gap(frames, a, b, place_a, place_b):
    """Return the vector from a point of node a to a point of node b [m] and its two rates, world axes."""
    xa = compute_point_motion(frames, a, place_a)
    xb = compute_point_motion(frames, b, place_b)
    return sub(xb[0], xa[0]), sub(xb[1], xa[1]), sub(xb[2], xa[2])


@jit_inner
def _read_axes(frames, n):
    """Axes of node n in the world."""
    return mat(frames.r[n]) if n >= 0 else EYE


@jit_inner
def _compute_relative_place(k, rows, frames):
    """Place of frame B seen from frame A, R_A^T d, and its two rates there."""
    a = rows.a[k]
    d, d1, d2 = compute_gap(frames, a, rows.b[k], vec(rows.place_a[k]), vec(rows.place_b[k]))
    if a < 0:
        return d, d1, d2
    r = mat(frames.r[a])
    w = vec(frames.w[a])
    al = vec(frames.al[a])
    e = tapply(r, d)
    e1 = tapply(r, d1)
    e2 = tapply(r, d2)
    e1 = sub(e1, cross(w, e))
    return e, e1, sub(sub(e2, cross(al, e)), cross(w, add(cross(w, e), scale(2.0, e1))))


@jit_inner
def _turn_seen(k, rows, frames):
    """Axes of frame B seen from frame A, its angular velocity there, and the rate of that."""
    a = rows.a[k]
    b = rows.b[k]
    r = _read_axes(frames, a)
    s = _read_axes(frames, b)
    w, al = (vec(frames.w[b]), vec(frames.al[b])) if b >= 0 else (ZERO, ZERO)
    w = tapply(r, apply(s, w))
    al = tapply(r, apply(s, al))
    if a >= 0:
        rate = vec(frames.w[a])
        w = sub(w, rate)
        al = sub(sub(al, vec(frames.al[a])), cross(rate, w))
    return tmul(r, s), w, al


@jit_inner
def _fill_residuals(k, rows, place, turned, phi):
    """Set phi, phi' and phi'' of the rows of one closure."""
    r, w, al = turned
    for i in range(k, rows.last[k]):
        u = vec(rows.u[i])
        if rows.direction[i]:
            seen = apply(r, vec(rows.w[i]))
            rate = cross(w, seen)
            put(phi[i], (dot(u, seen), dot(u, rate), dot(u, add(cross(al, seen), cross(w, rate)))))
        else:
            put(phi[i], (dot(u, place[0]), dot(u, place[1]), dot(u, place[2])))


@jit_inner
def fill_closure_residuals(rows, frames, phi):
    """Set phi = u . w [m], [-], phi' and phi'' (rows, 3) of all rows, those of couplings to zero (`compute_coupling_terms`)."""
    k = 0
    while k < rows.a.shape[0]:
        _fill_residuals(k, rows, _compute_relative_place(k, rows, frames), _turn_seen(k, rows, frames), phi)
        k = rows.last[k]


@jit_inner
def compute_coupling_terms(k, rows, q, qd, qdd):
    """Return the terms of a coupling of joint coordinates in row k: sum gear q - offset [rad], [m], and its two rates."""
    if rows.a[k] >= 0 or rows.b[k] >= 0:
        return 0.0, 0.0, 0.0
    phi = -rows.offset[k]
    rate = 0.0
    second = 0.0
    for i in range(rows.place.shape[0]):
        if rows.gear[k, i] != 0.0:
            phi += rows.gear[k, i] * q[rows.place[i]]
            rate += rows.gear[k, i] * qd[i]
            second += rows.gear[k, i] * qdd[i]
    return phi, rate, second


@jit_inner
def _fill_joint_columns(nodes, rows, frames, n, sign, seen, g):
    """Set what the joint of node n does to the rows of a closure; ``seen``: first row, axes of A, place of B, rows' vectors."""
    k, axes, place, along = seen
    r = mat(frames.r[n])
    arm = sub(place, vec(frames.x[n]))
    for j in range(nodes.freedoms[n] if nodes.v_index[n] >= 0 else 0):
        turn = apply(r, vec(nodes.turn[n, j]))
        moved = scale(sign, tapply(axes, add(apply(r, vec(nodes.slide[n, j])), cross(turn, arm))))
        turn = scale(sign, tapply(axes, turn))
        for i in range(k, rows.last[k]):
            g[i, nodes.v_index[n] + j] = dot(turn if rows.direction[i] else moved, vec(along[i]))


@jit_inner
def fill_closure_rows(nodes, rows, frames, phi, g):
    """Set phi (rows, 3) as `fill_closure_residuals`, and entries of G (rows, nv) [m/rad], [-], phi' = G qd.

    Each row of G is the joint efforts of a unit multiplier.  Joints between the two frames of a closure have entries, and those
    of couplings; others are left alone, and are zero.
    """
    k = 0
    while k < rows.a.shape[0]:
        a = rows.a[k]
        b = rows.b[k]
        if a < 0 and b < 0:
            for i in range(rows.place.shape[0]):
                if rows.gear[k, i] != 0.0:
                    g[k, i] = rows.gear[k, i]
        turned = _turn_seen(k, rows, frames)
        for i in range(k, rows.last[k]):  # what an angular velocity, or a velocity, of B has a part in
            u = vec(rows.u[i])
            put(phi[i], cross(apply(turned[0], vec(rows.w[i])), u) if rows.direction[i] else u)
        place, _, _ = compute_point_motion(frames, b, vec(rows.place_b[k]))
        seen = k, _read_axes(frames, a), place, phi
        while a != b:  # parents come before their children: both ways end where they meet
            if a > b:
                _fill_joint_columns(nodes, rows, frames, a, -1.0, seen, g)
                a = nodes.parent[a]
            else:
                _fill_joint_columns(nodes, rows, frames, b, 1.0, seen, g)
                b = nodes.parent[b]
        _fill_residuals(k, rows, _compute_relative_place(k, rows, frames), turned, phi)
        k = rows.last[k]


@jit
def fill_closure_samples(nodes, rows, frames, phi, g):
    """Set phi [m], [-] (samples, rows, 3) and G (samples, rows, nv), zero on entry, as `fill_closure_rows`."""
    for s in range(g.shape[0]):
        fill_closure_rows(nodes, rows, take_sample(frames, s), phi[s], g[s])


@send_by_address
class Ends(NamedTuple):
    """Frames in which closures report their wrenches (closures,): the second, or the first where the second is in the world.

    node : that carries it; second : whether it is the second; place (closures, 3) [m], turn (closures, 3, 3) : in the node
    """

    node: Indices
    second: Mask
    place: Array
    turn: Array


@jit
def add_multiplier_forces(rows, ends, frames, multipliers, force, moment, wrench):
    """Add what multipliers (samples, rows) [N], [N m] do to nodes, and set what each closure does to the second of its links.

    force, moment : (samples, nodes, 3) on the nodes, about them (world)
    wrench : (closures, samples, 6), zero on entry, force and moment at the closures' ends, in the axes there
    """
    for s in range(multipliers.shape[0]):
        f = take_sample(frames, s)
        k = 0
        while k < rows.a.shape[0]:
            push, on_a, on_b = _compute_wrenches(k, rows, f, multipliers[s])
            if rows.b[k] >= 0:
                add_to(force[s, rows.b[k]], push)
                add_to(moment[s, rows.b[k]], on_b)
            if rows.a[k] >= 0:
                add_to(force[s, rows.a[k]], scale(-1.0, push))
                add_to(moment[s, rows.a[k]], on_a)
            put_pair(wrench[rows.closure[k], s], push, on_b if ends.second[rows.closure[k]] else sub(ZERO, on_a))
            k = rows.last[k]
        for n in range(wrench.shape[0]):
            if ends.node[n] >= 0:
                # from the node (world, moment about it) to the frame at a place in it, and into its axes
                turned = mat(f.r[ends.node[n]])
                shown = wrench[n, s]
                push = vec(shown)
                turn = vec(shown[3:])
                axes = mul(turned, mat(ends.turn[n]))
                put_pair(
                    shown, tapply(axes, push), tapply(axes, sub(turn, cross(apply(turned, vec(ends.place[n])), push)))
                )


@jit_inner
def _compute_wrenches(k, rows, frames, multipliers):
    """Force on the second node, and moments on the first and on the second, of one closure's rows (world, about the nodes)."""
    a = rows.a[k]
    b = rows.b[k]
    axes = _read_axes(frames, a)
    turned = tmul(axes, _read_axes(frames, b))
    push = ZERO
    turn = ZERO
    for i in range(k, rows.last[k]):
        u = vec(rows.u[i])
        if rows.direction[i]:
            turn = add(turn, scale(multipliers[i], cross(apply(turned, vec(rows.w[i])), u)))
        else:
            push = add(push, scale(multipliers[i], u))
    push = apply(axes, push)
    turn = apply(axes, turn)
    at_b, _, _ = compute_point_motion(frames, b, vec(rows.place_b[k]))
    arm_a = sub(at_b, vec(frames.x[a])) if a >= 0 else at_b
    arm_b = sub(at_b, vec(frames.x[b])) if b >= 0 else at_b
    return push, sub(cross(push, arm_a), turn), add(turn, cross(arm_b, push))
