"""Kelvin-Voigt damping of the beam element: stresses that follow strain rates, and their exact linearisation.

    n = C_N (Gamma) + D_N dGamma/dt,    m = C_M (kappa) + D_M dkappa/dt          in the section frame

Strain rates come from the same interpolation as the strains (`beam`), with velocities relative to the moving first node:

    du_i = v_i - v_0 - W_0 x u_i,    dpsi_i = H_i^-1 (w_i - (R_0^T R_i)^T w_0),    r = H dpsi
    dGamma/dt = S^T du' - r x y,     dkappa/dt = H dpsi' + (d(H psi')/dpsi) dpsi         y = S^T u',  W_0 = R_0 w_0

With e the strains, z = (u, psi) and B = de/dz nodal forces are B^T (C e + D B dz), so that a rigid motion dissipates nothing and
the dissipated power is exactly de . D de.  The linearisation has two parts, one by poses (at fixed velocities) and one by
velocities, B^T D B, which velocities bring in as the scheme says.  Source: as `beam`, with the material law of Kelvin and Voigt:
J. Linn, H. Lang, A. Tuganov, *Geometrically exact Cosserat rods with Kelvin-Voigt type viscous damping*, Mech. Sci. 4, 2013.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.elements.beam import interpolate, inverse_tangent_slope, part, point_hessian, put_part, tangent_slope
from flexinv.elements.beam import tangent_curvature as curvature
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.so3 import coefficients, exp_with, tangent_with
from flexinv.kernels.vec3 import (
    add,
    add_scaled,
    add_to,
    apply,
    block,
    cross,
    diagonal,
    dot,
    madd,
    mat,
    mscale,
    msub,
    mul,
    put,
    put_block,
    rows,
    scale,
    skew,
    sub,
    tapply,
    times,
    tmul,
    transpose,
    vec,
    vec_at,
)
from flexinv.typing import Array

NONE = (0.0, 0.0, 0.0)
UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Rates(NamedTuple):
    """Work space of damping beside `beam.Scratch` for one element, count = order + 1 nodes; empty where no beam is damped.

    v, w : (count, 3) velocity (world) [m/s] and angular velocity (own frame) [rad/s]; du, dpsi : (count, 3) relative rates
    turned : (count, 3, 3) how dpsi_i varies with the node's own turn [1/s]; spin : (3, 3) skew(W_0) [rad/s]
    parts : (8, 36) derivatives at a Gauss point as `beam.Scratch.parts`, by poses and by velocities
    stiff, drag : (count, count, 36) the same at the nodes; by_velocity : (6 count, 6 count) forces by nodal velocities
    """

    v: Array
    w: Array
    du: Array
    dpsi: Array
    turned: Array
    spin: Array
    parts: Array
    stiff: Array
    drag: Array
    by_velocity: Array

    @classmethod
    def of(cls, count: int) -> Rates:
        """Return arrays for elements of at most ``count`` nodes [-]."""
        vectors, pairs = (count, 3), (count, count, 36)
        shapes = (
            vectors,
            vectors,
            vectors,
            vectors,
            (count, 3, 3),
            (3, 3),
            (8, 36),
            pairs,
            pairs,
            (6 * count, 6 * count),
        )
        return cls(*(np.zeros(shape) for shape in shapes))


@jit
def relative_rates(count, scratch, rates):
    """Fill du [m/s], dpsi [rad/s] and how they vary with the nodes' poses; `beam.relative` came before."""
    first, v0, w0 = mat(scratch.r[0]), vec(rates.v[0]), vec(rates.w[0])
    world = apply(first, w0)
    put_block(rates.spin, 0, 0, skew(world))
    for i in range(count):
        inverse = mat(scratch.inverse[i])
        carried = tapply(mat(scratch.r[i]), world)  # w_0 in the frame of node i
        g = sub(vec(rates.w[i]), carried)
        put(rates.du[i], 0, sub(sub(vec(rates.v[i]), v0), cross(world, vec(scratch.u[i]))))
        put(rates.dpsi[i], 0, apply(inverse, g))
        by_psi = mul(inverse_tangent_slope(vec(scratch.psi[i]), g, 1.0), inverse)
        put_block(rates.turned[i], 0, 0, msub(by_psi, mul(inverse, skew(carried))))


@jit
def damped_gradient(k, count, elements, scratch, rates, internal, want_tangent):
    """Compute `beam.element_gradient` with damping; return elastic energy [J] and dissipated power [W] of element k."""
    energy, lost = 0.0, 0.0
    for i in range(count):
        for c in range(6):
            scratch.gradient[i, c] = 0.0
        for j in range(count if want_tangent else 0):
            for c in range(36):
                rates.stiff[i, j, c] = rates.drag[i, j, c] = 0.0
    for g in range(count - 1):
        stored, gone = _add_point(count, elements.shape[k, g], elements.slope[k, g], elements.weight[k, g],
                                  elements.stiffness[k, g], elements.damping[k, g],
                                  vec(elements.gamma0[k, g]), vec(elements.kappa0[k, g]),
                                  scratch, rates, internal[g], want_tangent)  # fmt: skip
        energy += stored
        lost += gone
    return energy, lost


@jit_inner
def _interpolate_rates(count, shape, slope, rates):
    """du', dpsi, dpsi' at one Gauss point."""
    du, psi, dpsi = NONE, NONE, NONE
    for i in range(1, count):
        du = add_scaled(du, slope[i], vec(rates.du[i]))
        psi = add_scaled(psi, shape[i], vec(rates.dpsi[i]))
        dpsi = add_scaled(dpsi, slope[i], vec(rates.dpsi[i]))
    return du, psi, dpsi


@jit_inner
def _add_point(count, shape, slope, w, stiffness, damping, gamma0, kappa0, scratch, rates, internal, want_tangent):
    """Add one Gauss point to gradient and derivatives; return its energy and dissipated power."""
    du, psi, dpsi = interpolate(count, shape, slope, scratch)
    du_rate, psi_rate, dpsi_rate = _interpolate_rates(count, shape, slope, rates)
    q = coefficients(dot(psi, psi))
    s, h = mul(mat(scratch.r[0]), exp_with(psi, q)), tangent_with(psi, q)
    stretch, bend = tapply(s, du), tangent_slope(psi, dpsi, q, 1.0)
    gamma, kappa = sub(stretch, gamma0), sub(apply(h, dpsi), kappa0)
    slid, turn = tapply(s, du_rate), apply(h, psi_rate)
    gamma_rate = add(slid, cross(stretch, turn))
    kappa_rate = add(apply(h, dpsi_rate), apply(bend, psi_rate))
    c_n, c_m, d_n, d_m = vec_at(stiffness, 0), vec_at(stiffness, 3), vec_at(damping, 0), vec_at(damping, 3)
    n, m = add(times(c_n, gamma), times(d_n, gamma_rate)), add(times(c_m, kappa), times(d_m, kappa_rate))
    put(internal, 0, n)
    put(internal, 3, m)
    couple = cross(n, stretch)
    by_du, by_dpsi = scale(w, apply(s, n)), scale(w, tapply(h, m))
    by_psi = scale(w, add(tapply(h, couple), tapply(bend, m)))
    for i in range(1, count):
        add_to(scratch.gradient[i], 0, scale(slope[i], by_du))
        add_to(scratch.gradient[i], 3, add(scale(shape[i], by_psi), scale(slope[i], by_dpsi)))
    if want_tangent:
        point_hessian(psi, dpsi, q, s, h, stretch, bend, n, m, couple, c_n, c_m, w, rates.parts[:4])
        point_hessian(psi, dpsi, q, s, h, stretch, bend, NONE, NONE, NONE, d_n, d_m, w, rates.parts[4:])
        _rates_by_pose(psi, dpsi, q, s, h, stretch, bend, slid, turn, psi_rate, dpsi_rate, d_n, d_m, w, rates.parts)
        _spread(count, shape, slope, rates.parts[:4], rates.stiff)
        _spread(count, shape, slope, rates.parts[4:], rates.drag)
    stored = 0.5 * w * (dot(times(c_n, gamma), gamma) + dot(times(c_m, kappa), kappa))
    return stored, w * (dot(times(d_n, gamma_rate), gamma_rate) + dot(times(d_m, kappa_rate), kappa_rate))


@jit_inner
def _rates_by_pose(psi, dpsi, q, s, h, stretch, bend, slid, turn, psi_rate, dpsi_rate, d_n, d_m, w, parts):
    """Add w B^T D d(de/dt)/dz, how strain rates vary with the deformation, to the parts by poses."""
    spin, whirl = mul(skew(stretch), h), skew(turn)
    by_u = mscale(-1.0, mul(whirl, transpose(s)))
    slides = mul(msub(skew(slid), mul(whirl, skew(stretch))), h)
    by_psi = rows(d_n, madd(slides, mul(skew(stretch), tangent_slope(psi, psi_rate, q, 1.0))))
    by_u = rows(d_n, by_u)
    grown = transpose((
        apply(tangent_slope(psi, UNIT[0], q, 1.0), psi_rate),
        apply(tangent_slope(psi, UNIT[1], q, 1.0), psi_rate),
        apply(tangent_slope(psi, UNIT[2], q, 1.0), psi_rate),
    ))  # fmt: skip
    twice = (
        apply(curvature(psi, UNIT[0], dpsi, q), psi_rate),
        apply(curvature(psi, UNIT[1], dpsi, q), psi_rate),
        apply(curvature(psi, UNIT[2], dpsi, q), psi_rate),
    )
    by_slope, by_bend = rows(d_m, grown), rows(d_m, madd(tangent_slope(psi, dpsi_rate, q, 1.0), twice))
    _add_part(parts[0], 0, 0, mscale(w, mul(s, by_u)))
    _add_part(parts[0], 3, 3, mscale(w, tmul(h, by_slope)))
    _add_part(parts[1], 0, 3, mscale(w, mul(s, by_psi)))
    _add_part(parts[1], 3, 3, mscale(w, tmul(h, by_bend)))
    _add_part(parts[2], 3, 0, mscale(w, tmul(spin, by_u)))
    _add_part(parts[2], 3, 3, mscale(w, tmul(bend, by_slope)))
    _add_part(parts[3], 3, 3, mscale(w, madd(tmul(spin, by_psi), tmul(bend, by_bend))))


@jit_inner
def _add_part(numbers, row, column, m):
    put_part(numbers, row, column, madd(part(numbers, row, column), m))


@jit_inner
def _spread(count, shape, slope, parts, out):
    """Add one Gauss point's derivatives to those of all pairs of nodes: they are not symmetric."""
    for i in range(1, count):
        for j in range(1, count):
            ss, sn = slope[i] * slope[j], slope[i] * shape[j]
            ns, nn = shape[i] * slope[j], shape[i] * shape[j]
            for k in range(36):
                out[i, j, k] += ss * parts[0, k] + sn * parts[1, k] + ns * parts[2, k] + nn * parts[3, k]


@jit
def damped_tangent(count, scratch, rates, nodes, variation, tangent):
    """Fill how nodal forces vary with the motion of the element's nodes [N/m], [N], [N m].

    Columns of nodes beyond the first are by their own unknowns, whose velocities follow as ``variation``
    (`kinematics.tree.Variation`) says; those of the first are by its pose, and the last six by its velocity.
    """
    for i in range(1, count):
        for j in range(1, count):
            _pair(i, j, scratch, rates, tangent)
    for j in range(1, count):
        _first_row(j, count, scratch, rates, tangent)
    for i in range(count):
        _by_objectivity(i, count, scratch, rates, tangent)
    last = tangent.shape[1] - 6
    for row in range(6 * count):
        by = rates.by_velocity[row]
        for k in range(6):
            tangent[row, last + k] = by[k]
        for j in range(1, count):
            n, at = nodes[j], 6 * j
            for k in range(6):
                tangent[row, at + k] += dot(vec_at(by, at), vec(variation.v[n, k])) + dot(
                    vec_at(by, at + 3), vec(variation.w[n, k])
                )


@jit_inner
def _pair(i, j, scratch, rates, tangent):
    """Forces on node i by pose and velocity of node j, both beyond the first: A_i^T (P A_j + V E_j) and A_i^T V A_j."""
    own, other, row, column = mat(scratch.inverse[i]), mat(scratch.inverse[j]), 6 * i, 6 * j
    stiff, drag, spin, turned = rates.stiff[i, j], rates.drag[i, j], mat(rates.spin), mat(rates.turned[j])
    x_x = msub(part(stiff, 0, 0), mul(part(drag, 0, 0), spin))
    t_x = tmul(own, msub(part(stiff, 3, 0), mul(part(drag, 3, 0), spin)))
    x_t = madd(mul(part(stiff, 0, 3), other), mul(part(drag, 0, 3), turned))
    t_t = tmul(own, madd(mul(part(stiff, 3, 3), other), mul(part(drag, 3, 3), turned)))
    if i == j:
        geometric = inverse_tangent_slope(vec(scratch.psi[i]), vec_at(scratch.gradient[i], 3), -1.0)
        t_t = madd(t_t, mul(geometric, own))
    _put_pair(tangent, row, column, x_x, x_t, t_x, t_t)
    x_t, t_x = mul(part(drag, 0, 3), other), tmul(own, part(drag, 3, 0))
    t_t = tmul(own, mul(part(drag, 3, 3), other))
    _put_pair(rates.by_velocity, row, column, part(drag, 0, 0), x_t, t_x, t_t)


@jit_inner
def _put_pair(a, row, column, x_x, x_t, t_x, t_t):
    put_block(a, row, column, x_x)
    put_block(a, row, column + 3, x_t)
    put_block(a, row + 3, column, t_x)
    put_block(a, row + 3, column + 3, t_t)


@jit_inner
def _first_row(j, count, scratch, rates, tangent):
    """Forces on the first node by pose and velocity of node j: F_0 = - sum F_i,  M_0 = - R_0^T sum (u_i x F_i + R_i M_i)."""
    force, moment = vec(scratch.forces[j]), vec_at(scratch.forces[j], 3)
    carried = mul(mat(scratch.r[j]), skew(moment))  # R_j (theta x M) = - R_j skew(M) theta
    _sum_row(j, count, scratch, mscale(-1.0, skew(force)), mscale(-1.0, carried), tangent)
    _sum_row(j, count, scratch, diagonal(0.0), diagonal(0.0), rates.by_velocity)


@jit_inner
def _sum_row(j, count, scratch, by_x, by_t, a):
    """Balance of one column of (6, 6) blocks; by_x, by_t : how arm and frame of node j itself change the moment."""
    none, r0 = diagonal(0.0), mat(scratch.r[0])
    x_x, x_t, t_x, t_t = none, none, by_x, by_t
    for i in range(1, count):
        arm, turn, row, column = skew(vec(scratch.u[i])), mat(scratch.r[i]), 6 * i, 6 * j
        f_x, f_t = block(a, row, column), block(a, row, column + 3)
        x_x, x_t = msub(x_x, f_x), msub(x_t, f_t)
        t_x = madd(t_x, madd(mul(arm, f_x), mul(turn, block(a, row + 3, column))))
        t_t = madd(t_t, madd(mul(arm, f_t), mul(turn, block(a, row + 3, column + 3))))
    back = mscale(-1.0, transpose(r0))
    _put_pair(a, 0, 6 * j, x_x, x_t, mul(back, t_x), mul(back, t_t))


@jit_inner
def _by_objectivity(i, count, scratch, rates, tangent):
    """Set how forces on node i vary with pose and velocity of the first node, from how they vary with all others.

    A rigid velocity added changes nothing; a rigid turn phi of poses and velocities about x_0 turns the forces:
    K_(i,t0) R_0^T phi = (phi x F_i, 0) - sum_j (K_(i,xj) (phi x u_j) + K_(i,tj) R_j^T phi + V_(i,vj) (phi x (v_j - v_0)))
    """
    none, r0, v0 = diagonal(0.0), mat(scratch.r[0]), vec(rates.v[0])
    row, a, b = 6 * i, tangent, rates.by_velocity
    for half in range(0, 6, 3):
        by_x, by_v, by_w = none, none, none
        by_t = mscale(-1.0, skew(vec(scratch.forces[i]))) if half == 0 else none
        for j in range(1, count):
            arm, turn, column = skew(vec(scratch.u[j])), transpose(mat(scratch.r[j])), 6 * j
            slid = skew(sub(vec(rates.v[j]), v0))
            k_x, k_t = block(a, row + half, column), block(a, row + half, column + 3)
            v_x, v_t = block(b, row + half, column), block(b, row + half, column + 3)
            by_x, by_v = msub(by_x, k_x), msub(by_v, v_x)
            by_t = madd(by_t, madd(msub(mul(k_x, arm), mul(k_t, turn)), mul(v_x, slid)))
            by_w = madd(by_w, msub(mul(v_x, arm), mul(v_t, turn)))
        put_block(a, row + half, 0, by_x)
        put_block(a, row + half, 3, mul(by_t, r0))
        put_block(b, row + half, 0, by_v)
        put_block(b, row + half, 3, mul(by_w, r0))
