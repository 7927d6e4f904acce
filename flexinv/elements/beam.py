"""The spectral, geometrically exact beam element: strains and energy at a Gauss point, and their derivatives.

Strain at the Gauss points, from positions and rotations relative to the element's first node (objective):

    u_i = x_i - x_0,  psi_i = log(R_0^T R_i),  S = R_0 exp(psi),  H = H(psi)      interpolated: u', psi, psi'
    Gamma = S^T u' - Gamma_0          (axial, shear, shear)
    kappa = H psi' - kappa_0          (twist, bending, bending)
    E = 1/2 sum_g w (Gamma . C_N Gamma + kappa . C_M kappa)

Forces and tangent, with and without damping, follow in `beam_element`.
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
    tmul,
    transpose,
    vec,
    vec_at,
)
from flexinv.typing import Array

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]


class Scratch(NamedTuple):
    """One element under evaluation, count = order + 1 nodes; allocated once.

    x, r : (count, 3) [m], (count, 3, 3), poses of the nodes; u, psi : (count, 3) [m], [rad], relative to the first node
    inverse : (count, 3, 3), H(psi_i)^-1; gradient, forces : (count, 6) [N], [N m]
    parts : (4, 36), second derivatives at a Gauss point as (6, 6) blocks over (u, psi), by what the interpolation puts to
        them: slope slope, slope shape, shape slope, shape shape; hessian : (count, count, 36), the same at the nodes
        (with damping, how forces vary with the poses at given velocities)
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


class Point(NamedTuple):
    """Strains at a Gauss point: psi [rad], psi' [rad/m] and the coefficients q at psi; S, H, S^T u' [-], d(H psi')/dpsi [1/m]."""

    psi: Vector
    dpsi: Vector
    q: tuple[float, ...]
    s: Matrix
    h: Matrix
    stretch: Vector
    bend: Matrix


@jit_inner
def point_of(count, shape, slope, scratch):
    """Return the `Point` [rad], [1/m] of the relative poses at one Gauss point."""
    du, psi, dpsi = interpolate(count, shape, slope, scratch)
    q = coefficients(dot(psi, psi))
    s = mul(mat(scratch.r[0]), exp_with(psi, q))
    return Point(psi, dpsi, q, s, tangent_with(psi, q), tapply(s, du), tangent_slope(psi, dpsi, q, 1.0))


@jit_inner
def point_hessian(point, stress, stiffness, w, parts):
    """Fill the parts of `Scratch` with second derivatives at one Gauss point, w d2E by (u', psi, psi') [N], [N m].

    stress : n [N], m [N m] and n x S^T u'; stiffness : C_N [N], C_M [N m^2]
    """
    psi, dpsi, q, s, h, stretch, bend = point
    (n, m, couple), (c_n, c_m) = stress, stiffness
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
def spread(count, shape, slope, parts, out, whole):
    """Add one Gauss point's derivatives to those of the pairs of nodes i, j (j >= i unless ``whole``) [N/m], [N], [N m]."""
    for i in range(1, count):
        for j in range(1 if whole else i, count):
            ss, sn = slope[i] * slope[j], slope[i] * shape[j]
            ns, nn = shape[i] * slope[j], shape[i] * shape[j]
            for k in range(36):
                out[i, j, k] += ss * parts[0, k] + sn * parts[1, k] + ns * parts[2, k] + nn * parts[3, k]
