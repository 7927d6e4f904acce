"""Derivatives of inverse dynamics by spatial vectors, sample by sample (compiled).

Motions (w, v) and forces (n, f) are in world axes about a point of reference c that stands still; S_j are the joint axes,

    psi' = v_p x S     psi'' = a_p x S + v_p x psi'     S' = v x S         (p: the parent; a_world = (0, -g))
    B m = 1/2 (v x* I m - I (v x m) + m x* I v)         f = I a + v x* I v        summed from the leaves, as I is

With sums over everything beyond the outer one of two joints, i on the path from the root to j:

    dtau_i/dq_j  = S_i . (2 B psi'_j + I psi''_j + S_j x* f)      (without the last term for two axes of one joint)
    dtau_j/dq_i  = S_j . (2 B psi'_i + I psi''_i)
    dtau_i/dqd_j = S_i . (2 B S_j + I (psi'_j + S'_j)),  and with i and j exchanged alike;   dtau_i/dqdd_j = S_i . I S_j
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
    transpose,
    vec,
    vec_at,
)
from flexinv.typing import Array

UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


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
    velocity, acceleration : (bodies, 6), of the world first; force : (bodies, 6) f, summed
    mass : (bodies,); first : (bodies, 3); inertia : (bodies, 3, 3); coupling : (bodies, 6, 6) B, summed
    """

    axis: Array
    rate: Array
    second: Array
    slope: Array
    velocity: Array
    acceleration: Array
    force: Array
    mass: Array
    first: Array
    inertia: Array
    coupling: Array


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
def _momentum(b, spatial, m):
    """I m: angular momentum about c, and momentum."""
    h = vec(spatial.first[b])
    return add(apply(mat(spatial.inertia[b]), m[0]), cross(h, m[1])), sub(scale(spatial.mass[b], m[1]), cross(h, m[0]))


@jit_inner
def _set_inertia(body, spatial, mass, moment, inertia, rotation, arm):
    """Inertia of a body about c, world axes, from that about its node at ``arm`` from c."""
    own = apply(rotation, moment)
    turned = mul(mul(rotation, inertia), transpose(rotation))
    both = add(own, scale(mass, arm))  # h about c
    # I_c = I + (2 arm.h + m arm^2) 1 - arm h^T - h arm^T - m arm arm^T
    round_part = dot(arm, own) + dot(arm, both)
    dyads = madd(outer(arm, own), outer(both, arm))
    full = madd(madd(turned, mscale(round_part, UNIT)), mscale(-1.0, dyads))
    spatial.mass[body] = mass
    put(spatial.first[body], 0, both)
    for i in range(3):
        put(spatial.inertia[body, i], 0, full[i])


@jit_inner
def _set_motion(body, spatial, omega, alpha, velocity, acceleration, arm, gravity):
    """Velocity and acceleration (ω, v_c)' of a body at c, where it is free of gravity."""
    _put_pair(spatial.velocity[body], (omega, sub(velocity, cross(omega, arm))))
    _put_pair(
        spatial.acceleration[body],
        (alpha, sub(sub(sub(acceleration, cross(alpha, arm)), cross(omega, velocity)), gravity)),
    )


@jit_inner
def _set_coupling(b, spatial):
    """B and f of a body alone."""
    v = _pair(spatial.velocity[b])
    iv = _momentum(b, spatial, v)
    for k in range(6):
        m = (UNIT[k], ZERO) if k < 3 else (ZERO, UNIT[k - 3])
        column = _plus(force_cross(v, _momentum(b, spatial, m)), force_cross(m, iv))
        carried = _momentum(b, spatial, motion_cross(v, m))
        for i in range(3):
            spatial.coupling[b, i, k] = 0.5 * (column[0][i] - carried[0][i])
            spatial.coupling[b, 3 + i, k] = 0.5 * (column[1][i] - carried[1][i])
    _put_pair(spatial.force[b], _plus(_momentum(b, spatial, _pair(spatial.acceleration[b])), force_cross(v, iv)))


@jit_inner
def _set_axes(b, carried, r, arm, spatial):
    """S, psi', psi'' and psi' + S' of a body's joint."""
    above, first, count = carried.parent[b], carried.first[b], carried.freedoms[b]
    slide, turn = carried.slide[b], carried.turn[b]
    up, up_rate, own = _pair(spatial.velocity[above]), _pair(spatial.acceleration[above]), _pair(spatial.velocity[b])
    for i in range(count):
        t = apply(r, vec(turn[i]))
        s = t, add(apply(r, vec(slide[i])), cross(arm, t))
        rate = motion_cross(up, s)
        _put_pair(spatial.axis[first + i], s)
        _put_pair(spatial.rate[first + i], rate)
        _put_pair(spatial.second[first + i], _plus(motion_cross(up_rate, s), motion_cross(up, rate)))
        _put_pair(spatial.slope[first + i], _plus(rate, motion_cross(own, s)))


@jit_inner
def _times_coupling(b, spatial, m, transposed):
    """2 B m, or 2 B^T m."""
    out_n, out_f = ZERO, ZERO
    for k in range(6):
        factor = 2.0 * (m[0][k] if k < 3 else m[1][k - 3])
        if transposed:
            column = _pair(spatial.coupling[b, k])
        else:
            c = spatial.coupling[b]
            column = (c[0, k], c[1, k], c[2, k]), (c[3, k], c[4, k], c[5, k])
        out_n, out_f = add(out_n, scale(factor, column[0])), add(out_f, scale(factor, column[1]))
    return out_n, out_f


@jit_inner
def _add_to_parent(b, above, spatial):
    spatial.mass[above] += spatial.mass[b]
    for i in range(3):
        spatial.first[above, i] += spatial.first[b, i]
        for k in range(3):
            spatial.inertia[above, i, k] += spatial.inertia[b, i, k]
    for i in range(6):
        spatial.force[above, i] += spatial.force[b, i]
        for k in range(6):
            spatial.coupling[above, i, k] += spatial.coupling[b, i, k]


@jit_inner
def _fill_columns(b, j, carried, spatial, by_q, by_qd, by_qdd):
    """All pairs of axis j of body b with the axes of b and of the bodies that carry it."""
    s, rate = _pair(spatial.axis[j]), _pair(spatial.rate[j])
    inertial = _momentum(b, spatial, s)
    by_place = _plus(_times_coupling(b, spatial, rate, False), _momentum(b, spatial, _pair(spatial.second[j])))
    turned = _plus(by_place, force_cross(s, _pair(spatial.force[b])))
    by_rate = _plus(_times_coupling(b, spatial, s, False), _momentum(b, spatial, _pair(spatial.slope[j])))
    back = _times_coupling(b, spatial, s, True)
    carrier = b
    while carrier > 0:
        for i in range(carried.first[carrier], carried.first[carrier] + carried.freedoms[carrier]):
            axis = _pair(spatial.axis[i])
            by_q[i, j] = _along(axis, by_place if carrier == b else turned)
            by_qd[i, j] = _along(axis, by_rate)
            by_qdd[i, j] = _along(axis, inertial)
            if carrier != b:
                by_q[j, i] = _along(_pair(spatial.rate[i]), back) + _along(_pair(spatial.second[i]), inertial)
                by_qd[j, i] = _along(axis, back) + _along(_pair(spatial.slope[i]), inertial)
                by_qdd[j, i] = by_qdd[i, j]
        carrier = carried.parent[carrier]


@jit
def derivative_samples(carried, gravity, motion, spatial, by_q, by_qd, by_qdd):
    """Fill by_q, by_qd, by_qdd (samples, nv, nv), zero on entry, with d tau_i / d (q, qd, qdd)_j [N m], [N] per unit.

    carried : CarriedBodies; gravity : (3,) [m/s^2]; motion : `kinematics.tree.Frames` with a leading sample axis
    """
    g = vec(gravity)
    for i in range(3):
        spatial.velocity[0, i] = spatial.velocity[0, 3 + i] = spatial.acceleration[0, i] = 0.0
        spatial.acceleration[0, 3 + i] = -gravity[i]
    for s in range(motion.x.shape[0]):
        c = vec(motion.x[s, carried.node[1]])
        for b in range(1, len(carried.node)):
            n = carried.node[b]
            r, arm = mat(motion.r[s, n]), sub(vec(motion.x[s, n]), c)
            w, al = apply(r, vec(motion.w[s, n])), apply(r, vec(motion.al[s, n]))
            _set_inertia(b, spatial, carried.mass[b], vec(carried.h[b]), mat(carried.inertia[b]), r, arm)
            _set_motion(b, spatial, w, al, vec(motion.v[s, n]), vec(motion.a[s, n]), arm, g)
            _set_coupling(b, spatial)
            _set_axes(b, carried, r, arm, spatial)
        for back in range(1, len(carried.node)):
            b = len(carried.node) - back
            for j in range(carried.first[b], carried.first[b] + carried.freedoms[b]):
                _fill_columns(b, j, carried, spatial, by_q[s], by_qd[s], by_qdd[s])
            if carried.parent[b] > 0:
                _add_to_parent(b, carried.parent[b], spatial)
