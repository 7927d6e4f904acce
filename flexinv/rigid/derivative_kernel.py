"""Derivatives of inverse dynamics by spatial vectors, sample by sample (compiled).

Motions (w, v) and forces (n, f) are in world axes about a point of reference c that stands still; S_j are the joint axes,

    psi' = v_p x S     psi'' = a_p x S + v_p x psi'     S' = v x S         (p: the parent; a_world = (0, -g))
    B m = 1/2 (v x* I m - I (v x m) + m x* I v)         f = I a + v x* I v        summed from the leaves, as I is

With sums over everything beyond the outer one of two joints, i on the path from the root to j:

    dtau_i/dq_j  = S_i . (2 B psi'_j + I psi''_j + S_j x* f)      (without the last term for two axes of one joint)
    dtau_j/dq_i  = S_j . (2 B psi'_i + I psi''_i)
    dtau_i/dqd_j = S_i . (2 B S_j + I (psi'_j + S'_j)),  and with i and j exchanged alike;   dtau_i/dqdd_j = S_i . I S_j

Of a body of mass m, first moment h, inertia J about c, which moves at v = (w, u), with its momentum (n, p) = I v,

    2 B (w', u') = (A w', -2 p x w')        A w' = w x J w' - J (w x w') - u x (h x w') - h x (u x w') - n x w'

as all that u' adds cancels.
Source: Singh, Russell, Wensing, *Efficient analytical derivatives of rigid-body dynamics using spatial vector algebra*,
IEEE RA-L 7(2), 2022.
"""

from __future__ import annotations

from typing import NamedTuple

from flexinv.kernels import vec3
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import (
    EYE,
    add,
    apply,
    cross,
    dot,
    dot_pair,
    mat,
    mat_at,
    pair_at,
    put_at,
    scale,
    sub,
    tapply,
    vec,
    vec_at,
)
from flexinv.typing import Array, Indices


@send_by_address
class CarriedBodies(NamedTuple):
    """Bodies as this kernel reads them; body 0 is the world.

    parent, node, first, freedoms : (bodies,) carrier, node, first velocity coordinate and freedoms
    slide, turn : (bodies, 6, 3) axes in the node's frame [-]
    mass, h, inertia : (bodies, ...) about the node, in its frame [kg], [kg m], [kg m^2]
    """

    parent: Indices
    node: Indices
    first: Indices
    freedoms: Indices
    slide: Array
    turn: Array
    mass: Array
    h: Array
    inertia: Array


# Where numbers of an axis stand, S, psi', psi'' and psi' + S' (motions and forces are angular part first), and those of a body:
# the sums m, h, p, f, J and A of itself and of all that it carries; its velocity and acceleration.
AXIS = 0
AXIS_RATE = 6
AXIS_SECOND = 12
AXIS_SLOPE = 18
AXIS_CELLS = 24
MASS = 0
FIRST_MOMENT = 1
MOMENTUM = 4
BODY_WRENCH = 7
INERTIA = 13
GYRATION = 22
SUMS = 31
VELOCITY = 31
VELOCITY_RATE = 37
BODY_CELLS = 43


@jit_inner
def motion_cross(m, k):
    """Return the rate of motion k carried along by motion m, m x k [any unit]."""
    return cross(m[0], k[0]), add(cross(m[0], k[1]), cross(m[1], k[0]))


@jit_inner
def force_cross(m, f):
    """Return the rate of force f carried along by motion m, m x* f [any unit]."""
    return add(cross(m[0], f[0]), cross(m[1], f[1])), cross(m[0], f[1])


@jit_inner
def _write_spatial_vector(a, first, m):
    put_at(a, first, m[0])
    put_at(a, first + 3, m[1])


@jit_inner
def _add_spatial_vectors(m, k):
    return add(m[0], k[0]), add(m[1], k[1])


@jit_inner
def _apply_inertia(body, m):
    """I m: angular momentum about c, and momentum."""
    h = vec_at(body, FIRST_MOMENT)
    return add(apply(mat_at(body, INERTIA), m[0]), cross(h, m[1])), sub(scale(body[MASS], m[1]), cross(h, m[0]))


@jit_inner
def _apply_coupling(body, m):
    """2 B m."""
    return apply(mat_at(body, GYRATION), m[0]), scale(-2.0, cross(vec_at(body, MOMENTUM), m[0]))


@jit_inner
def _fill_body(body, mass, moment, inertia, rotation, arm):
    """The sums of a body alone: about c, in world axes, from its inertia about its node at ``arm`` from c, and its motion."""
    turned_moment = apply(rotation, moment)
    h = add(turned_moment, scale(mass, arm))
    # J = I + (2 arm.h + m arm^2) 1 - arm h^T - h arm^T - m arm arm^T, h about the node
    round_part = vec3.mscale(dot(arm, turned_moment) + dot(arm, h), EYE)
    turned = vec3.madd(vec3.mul(vec3.mul(rotation, inertia), vec3.transpose(rotation)), round_part)
    about = vec3.madd(turned, vec3.mscale(-1.0, vec3.madd(vec3.outer(arm, turned_moment), vec3.outer(h, arm))))
    body[MASS] = mass
    put_at(body, FIRST_MOMENT, h)
    for i in range(3):
        put_at(body, INERTIA + 3 * i, about[i])
    v = pair_at(body, VELOCITY)
    w, u = v
    n, p = _apply_inertia(body, v)
    put_at(body, MOMENTUM, p)
    _write_spatial_vector(
        body,
        BODY_WRENCH,
        _add_spatial_vectors(_apply_inertia(body, pair_at(body, VELOCITY_RATE)), force_cross(v, (n, p))),
    )
    for k in range(3):
        e = EYE[k]
        column = sub(cross(w, about[k]), apply(about, cross(w, e)))
        column = sub(column, vec3.sum3(cross(u, cross(h, e)), cross(h, cross(u, e)), cross(n, e)))
        for i in range(3):
            body[GYRATION + 3 * i + k] = column[i]


@jit_inner
def _fill_columns(b, j, carried, axes, body, by_q, by_qd, by_qdd):
    """All pairs of axis j of body b with the axes of b and of the bodies that carry it."""
    s = pair_at(axes[j], AXIS)
    rate = pair_at(axes[j], AXIS_RATE)
    inertial = _apply_inertia(body, s)
    by_place = _add_spatial_vectors(_apply_coupling(body, rate), _apply_inertia(body, pair_at(axes[j], AXIS_SECOND)))
    turned = _add_spatial_vectors(by_place, force_cross(s, pair_at(body, BODY_WRENCH)))
    by_rate = _add_spatial_vectors(_apply_coupling(body, s), _apply_inertia(body, pair_at(axes[j], AXIS_SLOPE)))
    # 2 B^T s, which has no linear part
    back = add(tapply(mat_at(body, GYRATION), s[0]), scale(2.0, cross(vec_at(body, MOMENTUM), s[1])))
    carrier = b
    while carrier > 0:
        for i in range(carried.first[carrier], carried.first[carrier] + carried.freedoms[carrier]):
            axis = pair_at(axes[i], AXIS)
            by_q[i, j] = dot_pair(axis, by_place if carrier == b else turned)
            by_qd[i, j] = dot_pair(axis, by_rate)
            by_qdd[i, j] = dot_pair(axis, inertial)
            if carrier != b:
                by_q[j, i] = dot(vec_at(axes[i], AXIS_RATE), back) + dot_pair(pair_at(axes[i], AXIS_SECOND), inertial)
                by_qd[j, i] = dot(axis[0], back) + dot_pair(pair_at(axes[i], AXIS_SLOPE), inertial)
                by_qdd[j, i] = by_qdd[i, j]
        carrier = carried.parent[carrier]


@jit
def fill_torque_derivatives(carried, gravity, motion, axes, bodies, by_q, by_qd, by_qdd):
    """Fill by_q, by_qd, by_qdd (samples, nv, nv), zero on entry, with d tau_i / d (q, qd, qdd)_j [N m], [N] per unit.

    carried : CarriedBodies; gravity : (3,) [m/s^2]; motion : `kinematics.tree.Frames` with a leading sample axis
    axes : (nv, AXIS_CELLS), bodies : (bodies, BODY_CELLS) zero for the world, scratch of one sample
    """
    g = vec(gravity)
    put_at(bodies[0], VELOCITY_RATE + 3, scale(-1.0, g))
    for s in range(motion.x.shape[0]):
        c = vec(motion.x[s, carried.node[1]])
        for b in range(1, len(carried.node)):
            n = carried.node[b]
            r = mat(motion.r[s, n])
            arm = sub(vec(motion.x[s, n]), c)
            _fill_body_motion(bodies[b], s, n, motion, arm, g)
            _fill_body(bodies[b], carried.mass[b], vec(carried.h[b]), mat(carried.inertia[b]), r, arm)
            _fill_axes(b, carried, r, arm, bodies, axes)
        for back in range(1, len(carried.node)):
            b = len(carried.node) - back
            for j in range(carried.first[b], carried.first[b] + carried.freedoms[b]):
                _fill_columns(b, j, carried, axes, bodies[b], by_q[s], by_qd[s], by_qdd[s])
            for i in range(SUMS if carried.parent[b] > 0 else 0):
                bodies[carried.parent[b], i] += bodies[b, i]


@jit_inner
def _fill_body_motion(body, s, n, motion, arm, g):
    """Spatial velocity of a body about c, and its rate, free of gravity, from node n in sample s, at ``arm`` from c."""
    r = mat(motion.r[s, n])
    w = apply(r, vec(motion.w[s, n]))
    al = apply(r, vec(motion.al[s, n]))
    v = vec(motion.v[s, n])
    a = sub(sub(sub(vec(motion.a[s, n]), cross(al, arm)), cross(w, v)), g)
    _write_spatial_vector(body, VELOCITY, (w, sub(v, cross(w, arm))))
    _write_spatial_vector(body, VELOCITY_RATE, (al, a))


@jit_inner
def _fill_axes(b, carried, r, arm, bodies, axes):
    """The axes of the joint of body b, how they move with the body that carries it, and how the velocity does with its rate."""
    above = bodies[carried.parent[b]]
    up = pair_at(above, VELOCITY)
    up_rate = pair_at(above, VELOCITY_RATE)
    velocity = pair_at(bodies[b], VELOCITY)
    for i in range(carried.freedoms[b]):
        t = apply(r, vec(carried.turn[b, i]))
        entry = axes[carried.first[b] + i]
        axis = t, add(apply(r, vec(carried.slide[b, i])), cross(arm, t))
        rate = motion_cross(up, axis)
        second = _add_spatial_vectors(motion_cross(up_rate, axis), motion_cross(up, rate))
        _write_spatial_vector(entry, AXIS, axis)
        _write_spatial_vector(entry, AXIS_RATE, rate)
        _write_spatial_vector(entry, AXIS_SECOND, second)
        _write_spatial_vector(entry, AXIS_SLOPE, _add_spatial_vectors(rate, motion_cross(velocity, axis)))
