"""The spectral, geometrically exact beam element at a Gauss point: strains, their rates, energy, and the derivatives.

Strain at the Gauss points, from positions and rotations relative to the element's first node (objective):

    u_i = x_i - x_0,  psi_i = log(R_0^T R_i),  S = R_0 exp(psi),  H = H(psi)      interpolated: u', psi, psi'
    Gamma = S^T u' - Gamma_0          (axial, shear, shear)
    kappa = H psi' - kappa_0          (twist, bending, bending)
    E = 1/2 sum_g w (Gamma . C_N Gamma + kappa . C_M kappa)

Kelvin-Voigt damping adds stresses that follow strain rates:
    n = C_N (Gamma) + D_N dGamma/dt,    m = C_M (kappa) + D_M dkappa/dt          in the section frame

`beam_law` states the resultants.  Where strains are coupled, C has more than C_N and C_M: functions of their own add that.

Strain rates come from the same interpolation as the strains, with velocities relative to the moving first node:
    du_i = v_i - v_0 - W_0 x u_i,    dpsi_i = H_i^-1 (w_i - (R_0^T R_i)^T w_0),    r = H dpsi
    dGamma/dt = S^T du' - r x y,     dkappa/dt = H dpsi' + (d(H psi')/dpsi) dpsi         y = S^T u',  W_0 = R_0 w_0

With e the strains, z = (u, psi) and B = de/dz nodal forces are B^T (C e + D B dz): a rigid motion dissipates nothing, and the
lost power is exactly de . D de.  The linearisation is by poses (velocities fixed) and by velocities, B^T D B, as the scheme says.
Source: Simo, Vu-Quoc, *A three-dimensional finite-strain rod model*, 1986, with the interpolation of Crisfield, Jelenic, 1999;
of damping Linn, Lang, Tuganov, *Geometrically exact Cosserat rods with Kelvin-Voigt type viscous damping*, Mech. Sci. 4, 2013.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.kernels import so3, vec3
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.so3 import coefficients, exp_with, inverse_tangent, log, quadratic, tangent_with
from flexinv.kernels.vec3 import (
    EYE,
    apply,
    dot,
    madd,
    mat,
    mscale,
    mul,
    outer,
    put,
    put_at,
    rows,
    scale,
    skew,
    tmul,
    transpose,
    vec,
)
from flexinv.typing import Array

Vector3 = tuple[float, float, float]
Matrix = tuple[Vector3, Vector3, Vector3]


@send_by_address
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
    def build_for(cls, count: int) -> Scratch:
        """Return arrays for elements of at most ``count`` nodes [-]."""
        vectors = (count, 3)
        matrices = (count, 3, 3)
        shapes = (vectors, matrices, vectors, vectors, matrices, (count, 6), (count, 6), (4, 36), (count, count, 36))
        return cls(*(np.zeros(shape) for shape in shapes))


@jit_inner
def compute_tangent_slope(psi, b, q, sign):
    """Return d/dpsi of H(psi) b (sign +1) or of H(psi)^T b (sign -1) [unit of b]; q from `coefficients`.

    H b = (1 - s B) b - A psi x b + B psi (psi . b), s = psi . psi; the transpose turns the sign of A.
    """
    a0, a1, _, b0, b1, _ = q
    s = dot(psi, psi)
    along = dot(psi, b)
    turned = scale(-2 * sign * a1, vec3.cross(psi, b))
    by_s = vec3.sum3(scale(-2 * (b0 + s * b1), b), turned, scale(2 * b1 * along, psi))
    return madd(madd(quadratic(b, b0 * along, sign * a0, 0.0), outer(by_s, psi)), outer(scale(b0, psi), b))


@jit_inner
def compute_tangent_curvature(psi, a, b, q):
    """Return the second derivative of h = a . H(psi) b with respect to psi, symmetric [unit of a b].

    h = (a.b)(1 - s B) - A psi.(b x a) + B (a.psi)(b.psi), s = psi . psi; q from `coefficients`
    """
    _, a1, a2, b0, b1, b2 = q
    s = dot(psi, psi)
    ab = dot(a, b)
    ap = dot(a, psi)
    bp = dot(b, psi)
    c = vec3.cross(b, a)
    p = dot(psi, vec3.cross(b, a))
    round_part = -2 * ab * (b0 + s * b1) - 2 * a1 * p + 2 * b1 * ap * bp
    dyad_part = -4 * ab * (2 * b1 + s * b2) - 4 * a2 * p + 4 * b2 * ap * bp
    mixed = vec3.sum3(scale(-2 * a1, c), scale(2 * b1 * bp, a), scale(2 * b1 * ap, b))
    half = madd(outer(vec3.add_scaled(mixed, 0.5 * dyad_part, psi), psi), outer(scale(b0, a), b))
    return madd(madd(half, transpose(half)), vec3.diagonal(round_part))


@jit_inner
def compute_inverse_slope(psi, g, sign):
    """Return d/dpsi of H(psi)^-1 g (sign +1) or of H(psi)^-T g (sign -1) [unit of g].

    H^-1 g = (1 - s c) g + psi x g / 2 + c psi (psi . g), s = psi . psi; the transpose turns the sign of the middle term.
    """
    s = dot(psi, psi)
    along = dot(psi, g)
    c, c1 = so3.inverse_coefficient(s)
    by_s = vec3.add(scale(-2 * (c + s * c1), g), scale(2 * c1 * along, psi))
    return madd(madd(quadratic(g, c * along, -0.5 * sign, 0.0), outer(by_s, psi)), outer(scale(c, psi), g))


@jit_inner
def fill_relative_poses(count, scratch):
    """Fill u_i = x_i - x_0 [m] and psi_i = log(R_0^T R_i) [rad] of scratch z; return the largest |psi_i| [rad]."""
    largest = 0.0
    first = mat(scratch.r[0])
    x0 = vec(scratch.x[0])
    for i in range(count):
        psi = log(tmul(first, mat(scratch.r[i])))
        put(scratch.u[i], vec3.sub(vec(scratch.x[i]), x0))
        put(scratch.psi[i], psi)
        vec3.put_mat(scratch.inverse[i], inverse_tangent(psi))
        largest = max(largest, np.sqrt(dot(psi, psi)))
    return largest


@jit_inner
def evaluate_pose_at_point(count, shape, slope, moved, turned):
    """Return u' [-], psi [rad], psi' [rad/m] at one Gauss point, or their rates; node 0 contributes nothing: u_0 = psi_0 = 0."""
    du = vec3.ZERO
    psi = vec3.ZERO
    dpsi = vec3.ZERO
    for i in range(1, count):
        du = vec3.add_scaled(du, slope[i], vec(moved[i]))
        turn = vec(turned[i])
        psi = vec3.add_scaled(psi, shape[i], turn)
        dpsi = vec3.add_scaled(dpsi, slope[i], turn)
    return du, psi, dpsi


class Point(NamedTuple):
    """Strains at a Gauss point: psi [rad], psi' [rad/m] and the coefficients q at psi; S, H, S^T u' [-], d(H psi')/dpsi [1/m]."""

    psi: Vector3
    dpsi: Vector3
    q: tuple[float, ...]
    s: Matrix
    h: Matrix
    stretch: Vector3
    bend: Matrix


@jit_inner
def make_point(count, shape, slope, scratch):
    """Return the `Point` [rad], [1/m] of the relative poses at one Gauss point."""
    du, psi, dpsi = evaluate_pose_at_point(count, shape, slope, scratch.u, scratch.psi)
    q = coefficients(dot(psi, psi))
    s = mul(mat(scratch.r[0]), exp_with(psi, q))
    return Point(psi, dpsi, q, s, tangent_with(psi, q), vec3.tapply(s, du), compute_tangent_slope(psi, dpsi, q, 1.0))


@jit_inner
def fill_point_hessian(point, stress, stiffness, w, parts):
    """Fill the parts of `Scratch` with second derivatives at one Gauss point, w d2E by (u', psi, psi') [N], [N m].

    stress : n [N], m [N m] and n x S^T u'; stiffness : C_N [N], C_M [N m^2]
    """
    psi, dpsi, q, s, h, stretch, bend = point
    n, m, couple = stress
    c_n, c_m = stiffness
    spin = mul(skew(stretch), h)  # dGamma = S^T du' + spin dpsi
    c_spin = rows(c_n, spin)
    c_bend = rows(c_m, bend)
    turned = mul(skew(n), spin)
    by_u_u = mul(s, rows(c_n, transpose(s)))
    by_u_psi = mul(s, vec3.msub(c_spin, mul(skew(n), h)))
    stretching = madd(madd(tmul(spin, c_spin), tmul(h, turned)), compute_tangent_slope(psi, couple, q, -1.0))
    bending = madd(tmul(bend, c_bend), compute_tangent_curvature(psi, m, dpsi, q))
    by_slope_psi = madd(tmul(h, c_bend), compute_tangent_slope(psi, m, q, -1.0))
    write_part(parts[0], 0, 0, mscale(w, by_u_u))
    write_part(parts[0], 3, 3, mscale(w, tmul(h, rows(c_m, h))))
    write_part(parts[1], 0, 3, mscale(w, by_u_psi))
    write_part(parts[1], 3, 3, mscale(w, by_slope_psi))
    write_part(parts[2], 3, 0, mscale(w, transpose(by_u_psi)))
    write_part(parts[2], 3, 3, mscale(w, transpose(by_slope_psi)))
    write_part(parts[3], 3, 3, mscale(w, madd(stretching, bending)))


@jit_inner
def write_part(numbers, row, column, m):
    """Write a matrix into a (6, 6) block that is stored as 36 numbers [any unit]."""
    put_at(numbers, 6 * row + column, m[0])
    put_at(numbers, 6 * row + 6 + column, m[1])
    put_at(numbers, 6 * row + 12 + column, m[2])


@jit_inner
def read_part(numbers, row, column):
    """Return a matrix of a (6, 6) block that is stored as 36 numbers [any unit]."""
    first = 6 * row + column
    return vec3.vec_at(numbers, first), vec3.vec_at(numbers, first + 6), vec3.vec_at(numbers, first + 12)


@jit_inner
def add_to_node_pairs(count, shape, slope, parts, out, whole):
    """Add one Gauss point's derivatives to those of the pairs of nodes i, j (j >= i unless ``whole``) [N/m], [N], [N m]."""
    for i in range(1, count):
        for j in range(1 if whole else i, count):
            ss = slope[i] * slope[j]
            sn = slope[i] * shape[j]
            ns = shape[i] * slope[j]
            nn = shape[i] * shape[j]
            for k in range(36):
                out[i, j, k] += ss * parts[0, k] + sn * parts[1, k] + ns * parts[2, k] + nn * parts[3, k]


@send_by_address
class Rates(NamedTuple):
    """Work space of damping beside `Scratch` for one element, count = order + 1 nodes; empty where no beam is damped.

    v, w : (count, 3) velocity (world) [m/s] and angular velocity (own frame) [rad/s]; du, dpsi : (count, 3) relative rates
    turned : (count, 3, 3) how dpsi_i varies with the node's own turn [1/s]; spin : (3, 3) skew(W_0) [rad/s]
    parts : (4, 36) derivatives at a Gauss point by velocities, as `Scratch.parts` by poses
    drag : (count, count, 36) the same at the nodes; by_velocity : (6 count, 6 count) forces by nodal velocities
    """

    v: Array
    w: Array
    du: Array
    dpsi: Array
    turned: Array
    spin: Array
    parts: Array
    drag: Array
    by_velocity: Array

    @classmethod
    def build_for(cls, count: int) -> Rates:
        """Return arrays for elements of at most ``count`` nodes [-]."""
        shapes = (*4 * [(count, 3)], (count, 3, 3), (3, 3), (4, 36), (count, count, 36), (6 * count, 6 * count))
        return cls(*(np.zeros(shape) for shape in shapes))


class Rate(NamedTuple):
    """Rates at a Gauss point: S^T du', H dpsi, dpsi, dpsi', and of strain, dGamma/dt and dkappa/dt [1/s], [rad/s]."""

    slid: Vector3
    turn: Vector3
    psi: Vector3
    dpsi: Vector3
    gamma: Vector3
    kappa: Vector3


@jit_inner
def fill_relative_rates(count, scratch, rates):
    """Fill du [m/s], dpsi [rad/s] and how they vary with the nodes' poses; `fill_relative_poses` came before."""
    first = mat(scratch.r[0])
    v0 = vec(rates.v[0])
    w0 = vec(rates.w[0])
    world = apply(first, w0)
    vec3.put_mat(rates.spin, skew(world))
    for i in range(count):
        inverse = mat(scratch.inverse[i])
        carried = vec3.tapply(mat(scratch.r[i]), world)  # w_0 in the frame of node i
        g = vec3.sub(vec(rates.w[i]), carried)
        put(rates.du[i], vec3.sub(vec3.sub(vec(rates.v[i]), v0), vec3.cross(world, vec(scratch.u[i]))))
        put(rates.dpsi[i], apply(inverse, g))
        by_psi = mul(compute_inverse_slope(vec(scratch.psi[i]), g, 1.0), inverse)
        vec3.put_mat(rates.turned[i], vec3.msub(by_psi, mul(inverse, skew(carried))))


@jit_inner
def make_rate(count, shape, slope, point, rates):
    """Return the `Rate` [1/s], [rad/s] of the relative motion at one Gauss point."""
    du, psi, dpsi = evaluate_pose_at_point(count, shape, slope, rates.du, rates.dpsi)
    slid = vec3.tapply(point.s, du)
    turn = apply(point.h, psi)
    gamma = vec3.add(slid, vec3.cross(point.stretch, turn))
    return Rate(slid, turn, psi, dpsi, gamma, vec3.add(apply(point.h, dpsi), apply(point.bend, psi)))


class StrainSlopes(NamedTuple):
    """Derivatives of strains [-], [1/m], or of their rates: Gamma by u' and psi, kappa by psi' and psi."""

    gamma_by_u: Matrix
    gamma_by_psi: Matrix
    kappa_by_slope: Matrix
    kappa_by_psi: Matrix


@jit_inner
def compute_strain_slopes(point):
    """Return the `StrainSlopes` of the strains [-], [1/m]: dGamma = S^T du' + spin dpsi,  dkappa = H dpsi' + bend dpsi."""
    return StrainSlopes(transpose(point.s), mul(skew(point.stretch), point.h), point.h, point.bend)


@jit_inner
def compute_rate_slopes(point, rate):
    """Return the `StrainSlopes` of the rates of strain at given velocities [1/s], [rad/s]."""
    psi, dpsi, q, s, h, stretch, _ = point
    slid, turn, psi_rate, dpsi_rate, _, _ = rate
    whirl = skew(turn)
    by_u = mscale(-1.0, mul(whirl, transpose(s)))
    slides = mul(vec3.msub(skew(slid), mul(whirl, skew(stretch))), h)
    by_psi = madd(slides, mul(skew(stretch), compute_tangent_slope(psi, psi_rate, q, 1.0)))
    twice = compute_curvature_rate(psi, dpsi, psi_rate, q)
    by_bend = madd(compute_tangent_slope(psi, dpsi_rate, q, 1.0), twice)
    return StrainSlopes(by_u, by_psi, _compute_tangent_rate(psi, psi_rate, q), by_bend)


@jit_inner
def add_rate_derivatives(point, slopes, damping, w, parts):
    """Add w B^T D d(de/dt)/dz, how strain rates vary with the deformation, to the parts by poses; damping D [N s], [N m^2 s]."""
    _, _, _, s, h, stretch, bend = point
    d_n, d_m = damping
    spin = mul(skew(stretch), h)
    by_u = rows(d_n, slopes.gamma_by_u)
    by_psi = rows(d_n, slopes.gamma_by_psi)
    by_slope = rows(d_m, slopes.kappa_by_slope)
    by_bend = rows(d_m, slopes.kappa_by_psi)
    _add_part(parts[0], 0, 0, mscale(w, mul(s, by_u)))
    _add_part(parts[0], 3, 3, mscale(w, tmul(h, by_slope)))
    _add_part(parts[1], 0, 3, mscale(w, mul(s, by_psi)))
    _add_part(parts[1], 3, 3, mscale(w, tmul(h, by_bend)))
    _add_part(parts[2], 3, 0, mscale(w, tmul(spin, by_u)))
    _add_part(parts[2], 3, 3, mscale(w, tmul(bend, by_slope)))
    _add_part(parts[3], 3, 3, mscale(w, madd(tmul(spin, by_psi), tmul(bend, by_bend))))


@jit_inner
def fill_coupled_part_with_zeros(parts):
    """Fill the part that only couplings have, slopes of places by slopes of turns, with zeros [N], so that they can be added."""
    none = vec3.diagonal(0.0)
    write_part(parts[0], 0, 3, none)
    write_part(parts[0], 3, 0, none)


@jit_inner
def add_coupled_derivatives(point, slopes, coupling, w, parts):
    """Add w B^T C de/dz of the couplings C (6, 6) [N], [N m], [N m^2]; ``slopes`` of e: the strains, or their rates with D for C.

    The blocks of C are n_n, n_m and m_m; its lower left one is n_m^T.
    """
    n_n = vec3.block(coupling, 0, 0)
    n_m = vec3.block(coupling, 0, 3)
    m_m = vec3.block(coupling, 3, 3)
    s = point.s
    h = point.h
    bend = point.bend
    spin = mul(skew(point.stretch), h)
    n_by_u = mul(n_n, slopes.gamma_by_u)
    n_by_slope = mul(n_m, slopes.kappa_by_slope)
    n_by_psi = madd(mul(n_n, slopes.gamma_by_psi), mul(n_m, slopes.kappa_by_psi))
    m_by_u = tmul(n_m, slopes.gamma_by_u)
    m_by_slope = mul(m_m, slopes.kappa_by_slope)
    m_by_psi = madd(tmul(n_m, slopes.gamma_by_psi), mul(m_m, slopes.kappa_by_psi))
    _add_part(parts[0], 0, 0, mscale(w, mul(s, n_by_u)))
    _add_part(parts[0], 0, 3, mscale(w, mul(s, n_by_slope)))
    _add_part(parts[0], 3, 0, mscale(w, tmul(h, m_by_u)))
    _add_part(parts[0], 3, 3, mscale(w, tmul(h, m_by_slope)))
    _add_part(parts[1], 0, 3, mscale(w, mul(s, n_by_psi)))
    _add_part(parts[1], 3, 3, mscale(w, tmul(h, m_by_psi)))
    _add_part(parts[2], 3, 0, mscale(w, madd(tmul(spin, n_by_u), tmul(bend, m_by_u))))
    _add_part(parts[2], 3, 3, mscale(w, madd(tmul(spin, n_by_slope), tmul(bend, m_by_slope))))
    _add_part(parts[3], 3, 3, mscale(w, madd(tmul(spin, n_by_psi), tmul(bend, m_by_psi))))


@jit_inner
def _compute_tangent_rate(psi, rate, q):
    """dH/dt, column by column d(H e)/dpsi psi'."""
    x, y, z = EYE
    a = apply(compute_tangent_slope(psi, x, q, 1.0), rate)
    b = apply(compute_tangent_slope(psi, y, q, 1.0), rate)
    c = apply(compute_tangent_slope(psi, z, q, 1.0), rate)
    return transpose((a, b, c))


@jit_inner
def compute_curvature_rate(psi, dpsi, rate, q):
    """Return the rate of d(H dpsi)/dpsi [unit of dpsi rate], from the second derivatives of H dpsi."""
    x, y, z = EYE
    a = apply(compute_tangent_curvature(psi, x, dpsi, q), rate)
    b = apply(compute_tangent_curvature(psi, y, dpsi, q), rate)
    c = apply(compute_tangent_curvature(psi, z, dpsi, q), rate)
    return a, b, c


@jit_inner
def _add_part(numbers, row, column, m):
    write_part(numbers, row, column, madd(read_part(numbers, row, column), m))
