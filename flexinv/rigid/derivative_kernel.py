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

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import by_address
from flexinv.kernels.vec3 import (
    ZERO,
    add,
    apply,
    cross,
    dot,
    madd,
    mat,
    mscale,
    mul,
    outer,
    put,
    scale,
    sub,
    sum3,
    tapply,
    transpose,
    vec,
    vec_at,
)  # fmt: skip
from flexinv.typing import Array


@by_address
class CarriedBodies(NamedTuple):
    """Bodies as this kernel reads them; body 0 is the world.

    parent, node, first, freedoms : (bodies,) carrier, node, first velocity coordinate and freedoms
    slide, turn : (bodies, 6, 3) axes in the node's frame [-]
    mass, h, inertia : (bodies, ...) about the node, in its frame [kg], [kg m], [kg m^2]
    """

    parent: NDArray[np.int64]
    node: NDArray[np.int64]
    first: NDArray[np.int64]
    freedoms: NDArray[np.int64]
    slide: Array
    turn: Array
    mass: Array
    h: Array
    inertia: Array


@by_address
class Spatial(NamedTuple):
    """Scratch of one sample; motions and forces are angular part first.

    axis, rate, second, slope : (nv, 6) S, psi', psi'', psi' + S'
    velocity, acceleration : (bodies, 6), of the world first
    sums : (bodies, SUMS) m, h, p, f, J and A, of the body and of all that it carries
    """

    axis: Array
    rate: Array
    second: Array
    slope: Array
    velocity: Array
    acceleration: Array
    sums: Array


# Where these sums stand.
MASS, FIRST, MOMENTUM, FORCE, INERTIA, COUPLING, SUMS = 0, 1, 4, 7, 13, 22, 31
UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@jit_inner
def motion_cross(m, k):
    """Return the rate of motion k carried along by motion m, m x k [any unit]."""
    return cross(m[0], k[0]), add(cross(m[0], k[1]), cross(m[1], k[0]))


@jit_inner
def force_cross(m, f):
    """Return the rate of force f carried along by motion m, m x* f [any unit]."""
    return add(cross(m[0], f[0]), cross(m[1], f[1])), cross(m[0], f[1])


@jit_inner
def _pair(a):
    return vec(a), vec_at(a, 3)


@jit_inner
def _put_pair(a, m):
    put(a, 0, m[0])
    put(a, 3, m[1])


@jit_inner
def _plus(m, k):
    return add(m[0], k[0]), add(m[1], k[1])


@jit_inner
def _along(m, f):
    return dot(m[0], f[0]) + dot(m[1], f[1])


@jit_inner
def _matrix(sums, first):
    return vec_at(sums, first), vec_at(sums, first + 3), vec_at(sums, first + 6)


@jit_inner
def _times_inertia(sums, m):
    """I m: angular momentum about c, and momentum."""
    h = vec_at(sums, FIRST)
    return add(apply(_matrix(sums, INERTIA), m[0]), cross(h, m[1])), sub(scale(sums[MASS], m[1]), cross(h, m[0]))


@jit_inner
def _times_coupling(sums, m):
    """2 B m."""
    return apply(_matrix(sums, COUPLING), m[0]), scale(-2.0, cross(vec_at(sums, MOMENTUM), m[0]))


@jit_inner
def _set_inertia(sums, mass, moment, inertia, rotation, arm):
    """Inertia of a body about c, world axes, from that about its node at ``arm`` from c."""
    own = apply(rotation, moment)
    turned = mul(mul(rotation, inertia), transpose(rotation))
    both = add(own, scale(mass, arm))  # h about c
    # J = I + (2 arm.h + m arm^2) 1 - arm h^T - h arm^T - m arm arm^T
    round_part = mscale(dot(arm, own) + dot(arm, both), UNIT)
    full = madd(madd(turned, round_part), mscale(-1.0, madd(outer(arm, own), outer(both, arm))))
    sums[MASS] = mass
    put(sums, FIRST, both)
    for i in range(3):
        put(sums, INERTIA + 3 * i, full[i])


@jit_inner
def _set_motion(sums, v, a):
    """p, f and A of a body alone."""
    h, inertia, (w, u), momentum = vec_at(sums, FIRST), _matrix(sums, INERTIA), v, _times_inertia(sums, v)
    force = _plus(_times_inertia(sums, a), force_cross(v, momentum))
    put(sums, MOMENTUM, momentum[1])
    put(sums, FORCE, force[0])
    put(sums, FORCE + 3, force[1])
    for k in range(3):
        e = UNIT[k]
        turned = sub(cross(w, inertia[k]), apply(inertia, cross(w, e)))
        column = sub(turned, sum3(cross(u, cross(h, e)), cross(h, cross(u, e)), cross(momentum[0], e)))
        for i in range(3):
            sums[COUPLING + 3 * i + k] = column[i]


@jit_inner
def _set_axes(b, carried, r, arm, spatial):
    """S, psi', psi'' and psi' + S' of a body's joint."""
    above, first, count = carried.parent[b], carried.first[b], carried.freedoms[b]
    up, up_rate, own = _pair(spatial.velocity[above]), _pair(spatial.acceleration[above]), _pair(spatial.velocity[b])
    for i in range(count):
        t = apply(r, vec(carried.turn[b, i]))
        s = t, add(apply(r, vec(carried.slide[b, i])), cross(arm, t))
        rate = motion_cross(up, s)
        _put_pair(spatial.axis[first + i], s)
        _put_pair(spatial.rate[first + i], rate)
        _put_pair(spatial.second[first + i], _plus(motion_cross(up_rate, s), motion_cross(up, rate)))
        _put_pair(spatial.slope[first + i], _plus(rate, motion_cross(own, s)))


@jit_inner
def _fill_columns(b, j, carried, spatial, by_q, by_qd, by_qdd):
    """All pairs of axis j of body b with the axes of b and of the bodies that carry it."""
    s, rate, sums = _pair(spatial.axis[j]), _pair(spatial.rate[j]), spatial.sums[b]
    inertial = _times_inertia(sums, s)
    by_place = _plus(_times_coupling(sums, rate), _times_inertia(sums, _pair(spatial.second[j])))
    turned = _plus(by_place, force_cross(s, (vec_at(sums, FORCE), vec_at(sums, FORCE + 3))))
    by_rate = _plus(_times_coupling(sums, s), _times_inertia(sums, _pair(spatial.slope[j])))
    # 2 B^T s, which has no linear part
    back = add(tapply(_matrix(sums, COUPLING), s[0]), scale(2.0, cross(vec_at(sums, MOMENTUM), s[1])))
    carrier = b
    while carrier > 0:
        for i in range(carried.first[carrier], carried.first[carrier] + carried.freedoms[carrier]):
            axis = _pair(spatial.axis[i])
            by_q[i, j] = _along(axis, by_place if carrier == b else turned)
            by_qd[i, j] = _along(axis, by_rate)
            by_qdd[i, j] = _along(axis, inertial)
            if carrier != b:
                by_q[j, i] = dot(vec(spatial.rate[i]), back) + _along(_pair(spatial.second[i]), inertial)
                by_qd[j, i] = dot(axis[0], back) + _along(_pair(spatial.slope[i]), inertial)
                by_qdd[j, i] = by_qdd[i, j]
        carrier = carried.parent[carrier]


@jit
def derivative_samples(carried, gravity, motion, spatial, by_q, by_qd, by_qdd):
    """Fill by_q, by_qd, by_qdd (samples, nv, nv), zero on entry, with d tau_i / d (q, qd, qdd)_j [N m], [N] per unit.

    carried : CarriedBodies; gravity : (3,) [m/s^2]; motion : `kinematics.tree.Frames` with a leading sample axis
    """
    g = vec(gravity)
    _put_pair(spatial.velocity[0], (ZERO, ZERO))
    _put_pair(spatial.acceleration[0], (ZERO, scale(-1.0, g)))
    for s in range(motion.x.shape[0]):
        c = vec(motion.x[s, carried.node[1]])
        for b in range(1, len(carried.node)):
            n = carried.node[b]
            r, arm = mat(motion.r[s, n]), sub(vec(motion.x[s, n]), c)
            w, al, v = apply(r, vec(motion.w[s, n])), apply(r, vec(motion.al[s, n])), vec(motion.v[s, n])
            a = sub(sub(sub(vec(motion.a[s, n]), cross(al, arm)), cross(w, v)), g)  # of c, free of gravity
            velocity, acceleration = (w, sub(v, cross(w, arm))), (al, a)
            _put_pair(spatial.velocity[b], velocity)
            _put_pair(spatial.acceleration[b], acceleration)
            _set_inertia(spatial.sums[b], carried.mass[b], vec(carried.h[b]), mat(carried.inertia[b]), r, arm)
            _set_motion(spatial.sums[b], velocity, acceleration)
            _set_axes(b, carried, r, arm, spatial)
        for back in range(1, len(carried.node)):
            b = len(carried.node) - back
            above = carried.parent[b]
            for j in range(carried.first[b], carried.first[b] + carried.freedoms[b]):
                _fill_columns(b, j, carried, spatial, by_q[s], by_qd[s], by_qdd[s])
            for i in range(SUMS if above > 0 else 0):
                spatial.sums[above, i] += spatial.sums[b, i]
