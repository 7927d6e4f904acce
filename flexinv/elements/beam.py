"""The spectral, geometrically exact beam element: strains, energy, nodal forces and their exact tangent.

Strain at the Gauss points, from positions and rotations relative to the element's first node (objective):

    u_i = x_i - x_0,  psi_i = log(R_0^T R_i),  S = R_0 exp(psi),  H = H(psi)      interpolated: u', psi, psi'
    Gamma = S^T u' - Gamma_0          (axial, shear, shear)
    kappa = H psi' - kappa_0          (twist, bending, bending)
    E = 1/2 sum_g w (Gamma . C_N Gamma + kappa . C_M kappa)

Nodal forces are the gradient of E, so power closes in space as in the plane; the tangent is the exact derivative.
Increments: dx_i in the world frame, theta_i in the node's own frame (R_i <- R_i exp(theta_i)); forces are dual to them.
What the first node feels, and how it acts on the others, follows from objectivity: a rigid motion strains nothing.
Source: Simo, Vu-Quoc, *A three-dimensional finite-strain rod model*, 1986, with the interpolation of Crisfield, Jelenic, 1999.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.kernels.jit import jit_inner
from flexinv.kernels.so3 import (
    coefficients,
    exp_with,
    inverse_coefficient,
    inverse_tangent,
    log,
    quadratic,
    tangent_with,
)
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
    outer,
    put,
    put_block,
    rows,
    scale,
    skew,
    sub,
    sum3,
    tapply,
    times,
    tmul,
    transpose,
    vec,
    vec_at,
)
from flexinv.typing import Array


class Scratch(NamedTuple):
    """One element under evaluation, count = order + 1 nodes; allocated once.

    x, r : (count, 3) [m], (count, 3, 3), poses of the nodes; u, psi : (count, 3) [m], [rad], relative to the first node
    inverse : (count, 3, 3), H(psi_i)^-1; gradient, forces : (count, 6) [N], [N m]
    parts : (4, 36), second derivatives at a Gauss point as (6, 6) blocks over (u, psi), by what the interpolation puts to
        them: slope slope, slope shape, shape slope, shape shape; hessian : (count, count, 36), the same at the nodes
    """

    x: Array
    r: Array
    u: Array
    psi: Array
    inverse: Array
    gradient: Array
    forces: Array
    parts: Array
    hessian: Array

    @classmethod
    def of(cls, count: int) -> Scratch:
        """Return arrays for elements of at most ``count`` nodes [-]."""
        vectors, matrices = (count, 3), (count, 3, 3)
        shapes = (vectors, matrices, vectors, vectors, matrices, (count, 6), (count, 6), (4, 36), (count, count, 36))
        return cls(*(np.zeros(shape) for shape in shapes))


@jit_inner
def tangent_slope(psi, b, q, sign):
    """Return d/dpsi of H(psi) b (sign +1) or of H(psi)^T b (sign -1) [unit of b]; q from `coefficients`.

    H b = (1 - s B) b - A psi x b + B psi (psi . b), s = psi . psi; the transpose turns the sign of A.
    """
    a0, a1, _, b0, b1, _ = q
    s, along = dot(psi, psi), dot(psi, b)
    by_s = sum3(scale(-2 * (b0 + s * b1), b), scale(-2 * sign * a1, cross(psi, b)), scale(2 * b1 * along, psi))
    return madd(madd(quadratic(b, b0 * along, sign * a0, 0.0), outer(by_s, psi)), outer(scale(b0, psi), b))


@jit_inner
def tangent_curvature(psi, a, b, q):
    """Return the second derivative of h = a . H(psi) b with respect to psi, symmetric [unit of a b].

    h = (a.b)(1 - s B) - A psi.(b x a) + B (a.psi)(b.psi), s = psi . psi; q from `coefficients`
    """
    _, a1, a2, b0, b1, b2 = q
    s, ab, ap, bp = dot(psi, psi), dot(a, b), dot(a, psi), dot(b, psi)
    c = cross(b, a)
    p = dot(psi, c)
    round_part = -2 * ab * (b0 + s * b1) - 2 * a1 * p + 2 * b1 * ap * bp
    dyad_part = -4 * ab * (2 * b1 + s * b2) - 4 * a2 * p + 4 * b2 * ap * bp
    mixed = sum3(scale(-2 * a1, c), scale(2 * b1 * bp, a), scale(2 * b1 * ap, b))
    half = madd(outer(add_scaled(mixed, 0.5 * dyad_part, psi), psi), outer(scale(b0, a), b))
    return madd(madd(half, transpose(half)), diagonal(round_part))


@jit_inner
def inverse_tangent_slope(psi, g, sign):
    """Return d/dpsi of H(psi)^-1 g (sign +1) or of H(psi)^-T g (sign -1) [unit of g].

    H^-1 g = (1 - s c) g + psi x g / 2 + c psi (psi . g), s = psi . psi; the transpose turns the sign of the middle term.
    """
    s, along = dot(psi, psi), dot(psi, g)
    c, c1 = inverse_coefficient(s)
    by_s = add(scale(-2 * (c + s * c1), g), scale(2 * c1 * along, psi))
    return madd(madd(quadratic(g, c * along, -0.5 * sign, 0.0), outer(by_s, psi)), outer(scale(c, psi), g))


@jit_inner
def relative(count, scratch):
    """Fill u_i = x_i - x_0 [m] and psi_i = log(R_0^T R_i) [rad] of scratch z; return the largest |psi_i| [rad]."""
    largest = 0.0
    first, x0 = mat(scratch.r[0]), vec(scratch.x[0])
    for i in range(count):
        psi = log(tmul(first, mat(scratch.r[i])))
        put(scratch.u[i], 0, sub(vec(scratch.x[i]), x0))
        put(scratch.psi[i], 0, psi)
        put_block(scratch.inverse[i], 0, 0, inverse_tangent(psi))
        largest = max(largest, np.sqrt(dot(psi, psi)))
    return largest


@jit_inner
def interpolate(count, shape, slope, scratch):
    """Return u' [-], psi [rad], psi' [rad/m] at one Gauss point (node 0 contributes nothing: u_0 = psi_0 = 0)."""
    du, psi, dpsi = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(1, count):
        du = add_scaled(du, slope[i], vec(scratch.u[i]))
        psi = add_scaled(psi, shape[i], vec(scratch.psi[i]))
        dpsi = add_scaled(dpsi, slope[i], vec(scratch.psi[i]))
    return du, psi, dpsi


@jit_inner
def element_gradient(k, count, elements, scratch, internal, want_hessian):
    """Fill dE/d(u_i, psi_i) of element k, scratch.gradient [N], [N m] and, if wanted, scratch.hessian; return E [J].

    elements : `dofs.ElementArrays`; internal : (points, 6) stress resultants in the section frame [N], [N m]
    """
    energy = 0.0
    _clear(count, scratch, want_hessian)
    for g in range(count - 1):
        energy += _add_point(count, elements.shape[k, g], elements.slope[k, g], elements.weight[k, g],
                             elements.stiffness[k, g], vec(elements.gamma0[k, g]), vec(elements.kappa0[k, g]),
                             scratch, internal[g], want_hessian)  # fmt: skip
    return energy


@jit_inner
def _clear(count, scratch, want_hessian):
    for i in range(count):
        for k in range(6):
            scratch.gradient[i, k] = 0.0
        if want_hessian:
            for j in range(i, count):
                for k in range(36):
                    scratch.hessian[i, j, k] = 0.0


@jit_inner
def _add_point(count, shape, slope, w, stiffness, gamma0, kappa0, scratch, internal, want_hessian):
    """Add one Gauss point to gradient and Hessian; return its energy."""
    du, psi, dpsi = interpolate(count, shape, slope, scratch)
    q = coefficients(dot(psi, psi))
    s, h = mul(mat(scratch.r[0]), exp_with(psi, q)), tangent_with(psi, q)
    stretch = tapply(s, du)
    bend = tangent_slope(psi, dpsi, q, 1.0)  # d(H psi')/dpsi
    gamma, kappa = sub(stretch, gamma0), sub(apply(h, dpsi), kappa0)
    c_n, c_m = vec_at(stiffness, 0), vec_at(stiffness, 3)
    n, m = times(c_n, gamma), times(c_m, kappa)
    put(internal, 0, n)
    put(internal, 3, m)
    couple = cross(n, stretch)
    by_du = scale(w, apply(s, n))  # dE/du'
    by_psi = scale(w, add(tapply(h, couple), tapply(bend, m)))  # dE/dpsi
    by_dpsi = scale(w, tapply(h, m))  # dE/dpsi'
    for i in range(1, count):
        add_to(scratch.gradient[i], 0, scale(slope[i], by_du))
        add_to(scratch.gradient[i], 3, add(scale(shape[i], by_psi), scale(slope[i], by_dpsi)))
    if want_hessian:
        point_hessian(psi, dpsi, q, s, h, stretch, bend, n, m, couple, c_n, c_m, w, scratch.parts)
        _spread(count, shape, slope, scratch.parts, scratch.hessian)
    return 0.5 * w * (dot(n, gamma) + dot(m, kappa))


@jit_inner
def point_hessian(psi, dpsi, q, s, h, stretch, bend, n, m, couple, c_n, c_m, w, parts):
    """Fill the parts of `Scratch` with second derivatives at one Gauss point, w d2E by (u', psi, psi') [N], [N m]."""
    spin = mul(skew(stretch), h)  # dGamma = S^T du' + spin dpsi
    c_spin, c_bend = rows(c_n, spin), rows(c_m, bend)
    turned = mul(skew(n), spin)
    by_u_u = mul(s, rows(c_n, transpose(s)))
    by_u_psi = mul(s, msub(c_spin, mul(skew(n), h)))
    stretching = madd(madd(tmul(spin, c_spin), tmul(h, turned)), tangent_slope(psi, couple, q, -1.0))
    bending = madd(tmul(bend, c_bend), tangent_curvature(psi, m, dpsi, q))
    by_slope_psi = madd(tmul(h, c_bend), tangent_slope(psi, m, q, -1.0))
    put_part(parts[0], 0, 0, mscale(w, by_u_u))
    put_part(parts[0], 3, 3, mscale(w, tmul(h, rows(c_m, h))))
    put_part(parts[1], 0, 3, mscale(w, by_u_psi))
    put_part(parts[1], 3, 3, mscale(w, by_slope_psi))
    put_part(parts[2], 3, 0, mscale(w, transpose(by_u_psi)))
    put_part(parts[2], 3, 3, mscale(w, transpose(by_slope_psi)))
    put_part(parts[3], 3, 3, mscale(w, madd(stretching, bending)))


@jit_inner
def put_part(numbers, row, column, m):
    """Write a matrix into a (6, 6) block that is stored as 36 numbers [any unit]."""
    put(numbers, 6 * row + column, m[0])
    put(numbers, 6 * row + 6 + column, m[1])
    put(numbers, 6 * row + 12 + column, m[2])


@jit_inner
def part(numbers, row, column):
    """Return a matrix of a (6, 6) block that is stored as 36 numbers [any unit]."""
    first = 6 * row + column
    return vec_at(numbers, first), vec_at(numbers, first + 6), vec_at(numbers, first + 12)


@jit_inner
def _spread(count, shape, slope, parts, hessian):
    """Add one Gauss point's second derivatives to the nodal Hessian (i <= j) through the interpolation."""
    for i in range(1, count):
        for j in range(i, count):
            ss, sn = slope[i] * slope[j], slope[i] * shape[j]
            ns, nn = shape[i] * slope[j], shape[i] * shape[j]
            for k in range(36):
                hessian[i, j, k] += ss * parts[0, k] + sn * parts[1, k] + ns * parts[2, k] + nn * parts[3, k]


@jit_inner
def nodal_forces(count, scratch):
    """Fill scratch.forces, (count, 6) [N] (world) and [N m] (node frame), from dE/d(u_i, psi_i).

    F_i = dE/du_i, M_i = H_i^-T dE/dpsi_i; the sums of forces and moments vanish, and R_0^T R_i H_i^-T = H_i^-1:
    F_0 = - sum F_i,   M_0 = - sum (R_0^T (u_i x F_i) + H_i^-1 dE/dpsi_i)
    """
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    r0 = mat(scratch.r[0])
    for i in range(1, count):
        inverse = mat(scratch.inverse[i])
        f, by_psi = vec(scratch.gradient[i]), vec_at(scratch.gradient[i], 3)
        put(scratch.forces[i], 0, f)
        put(scratch.forces[i], 3, tapply(inverse, by_psi))
        force = sub(force, f)
        moment = sub(moment, add(tapply(r0, cross(vec(scratch.u[i]), f)), apply(inverse, by_psi)))
    put(scratch.forces[0], 0, force)
    put(scratch.forces[0], 3, moment)


@jit_inner
def element_tangent(count, scratch, tangent):
    """Fill the exact derivative of the nodal forces by (dx, theta) of all nodes, (6 count, 6 count) [N/m], [N], [N m].

    Between nodes beyond the first K = B^T (d2E) B + (dB^T) g with B = diag(1, H_i^-1); the first node by objectivity.
    K is symmetric but for the (theta_i, theta_i) blocks: translations and rotations of different nodes commute.
    """
    for i in range(1, count):
        own = mat(scratch.inverse[i])
        for j in range(i, count):
            other = mat(scratch.inverse[j])
            x_x, x_t = part(scratch.hessian[i, j], 0, 0), mul(part(scratch.hessian[i, j], 0, 3), other)
            t_x = tmul(own, part(scratch.hessian[i, j], 3, 0))
            t_t = tmul(own, mul(part(scratch.hessian[i, j], 3, 3), other))
            if i == j:
                geometric = inverse_tangent_slope(vec(scratch.psi[i]), vec_at(scratch.gradient[i], 3), -1.0)
                t_t = madd(t_t, mul(geometric, own))
            put_block(tangent, 6 * i, 6 * j, x_x)
            put_block(tangent, 6 * i, 6 * j + 3, x_t)
            put_block(tangent, 6 * i + 3, 6 * j, t_x)
            put_block(tangent, 6 * i + 3, 6 * j + 3, t_t)
            for a in range(6 if j > i else 0):
                for b in range(6):
                    tangent[6 * j + b, 6 * i + a] = tangent[6 * i + a, 6 * j + b]
    for i in range(count - 1, -1, -1):  # node 0 last: its row is the transpose of its column
        _by_objectivity(i, count, scratch, tangent)


@jit_inner
def _by_objectivity(i, count, scratch, tangent):
    """Set how forces on node i vary with the motion of node 0, from how they vary with that of all others.

    Moved along with the element they do not change, K_(i,x0) = - sum_j K_(i,xj); turned with it about x_0 by phi they turn:
    K_(i,t0) R_0^T phi = (phi x F_i, 0) - sum_j (K_(i,xj) (phi x u_j) + K_(i,tj) R_j^T phi)
    """
    none = diagonal(0.0)
    x_x, t_x, x_t, t_t = none, none, mscale(-1.0, skew(vec(scratch.forces[i]))), none
    row = 6 * i
    for j in range(1, count):
        arm, turn, column = skew(vec(scratch.u[j])), transpose(mat(scratch.r[j])), 6 * j
        by_x, by_t = block(tangent, row, column), block(tangent, row, column + 3)
        x_x, x_t = msub(x_x, by_x), madd(x_t, msub(mul(by_x, arm), mul(by_t, turn)))
        by_x, by_t = block(tangent, row + 3, column), block(tangent, row + 3, column + 3)
        t_x, t_t = msub(t_x, by_x), madd(t_t, msub(mul(by_x, arm), mul(by_t, turn)))
    r0 = mat(scratch.r[0])
    put_block(tangent, row, 0, x_x)
    put_block(tangent, row, 3, mul(x_t, r0))
    put_block(tangent, row + 3, 0, t_x)
    put_block(tangent, row + 3, 3, mul(t_t, r0))
    for a in range(row, row + 6 if i > 0 else 0):
        for b in range(6):
            tangent[b, a] = tangent[a, b]
