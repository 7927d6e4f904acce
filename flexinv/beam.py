"""The spectral, geometrically exact beam element: strains, energy, nodal forces and their exact tangent.

Strain at the Gauss points, seen from the frame R_0 of the element's first node (objective):

    u_i = R_0^T (x_i - x_0),  psi_i = log(R_0^T R_i),  S = exp(psi),  H = H(psi)      interpolated: u', psi, psi'
    Gamma = S^T u' - Gamma_0          (axial, shear, shear)
    kappa = H psi' - kappa_0          (twist, bending, bending)
    E = 1/2 sum_g w (Gamma . C_N Gamma + kappa . C_M kappa)

Nodal forces are the gradient of E, so power closes in space as in the plane; the tangent is the exact derivative.
Increments: dx_i in the world frame, theta_i in the node's own frame (R_i <- R_i exp(theta_i)); forces are dual to them.
Source: Simo, Vu-Quoc, *A three-dimensional finite-strain rod model*, 1986, with the interpolation of Crisfield, Jelenic, 1999.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from flexinv.rotations import coefficients, exp3, inverse_coefficient, inverse_tangent3, log3, tangent3
from flexinv.vectors import apply3, cross3, dot3, mul3, skew3, tapply3, tmul3


@njit(cache=True)
def tangent_slope(psi, b, sign):
    """Return d/dpsi of H(psi) b (sign +1) or of H(psi)^T b (sign -1), (3, 3) [unit of b].

    H b = (1 - s B) b - A psi x b + B psi (psi . b), s = psi . psi; the transpose turns the sign of A.
    """
    s = dot3(psi, psi)
    a_, a1, _, b_, b1, _ = coefficients(s)
    a_, a1 = sign * a_, sign * a1
    along = dot3(psi, b)
    twist = cross3(psi, b)
    out = a_ * skew3(b)
    for i in range(3):
        for j in range(3):
            out[i, j] += (-2 * (b_ + s * b1) * b[i] - 2 * a1 * twist[i] + 2 * b1 * along * psi[i]) * psi[j]
            out[i, j] += b_ * psi[i] * b[j]
        out[i, i] += b_ * along
    return out


@njit(cache=True)
def tangent_curvature(psi, a, b):
    """Return the second derivative of h = a . H(psi) b with respect to psi, (3, 3) symmetric [unit of a b].

    h = (a.b)(1 - s B) - A psi.(b x a) + B (a.psi)(b.psi), s = psi . psi
    """
    s = dot3(psi, psi)
    a_, a1, a2, b_, b1, b2 = coefficients(s)
    ab, ap, bp = dot3(a, b), dot3(a, psi), dot3(b, psi)
    c = cross3(b, a)
    p = dot3(psi, c)
    round_part = -2 * ab * (b_ + s * b1) - 2 * a1 * p + 2 * b1 * ap * bp
    dyad_part = -4 * ab * (2 * b1 + s * b2) - 4 * a2 * p + 4 * b2 * ap * bp
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            mixed_i = -2 * a1 * c[i] + 2 * b1 * (a[i] * bp + b[i] * ap)
            mixed_j = -2 * a1 * c[j] + 2 * b1 * (a[j] * bp + b[j] * ap)
            out[i, j] = dyad_part * psi[i] * psi[j] + psi[i] * mixed_j + mixed_i * psi[j]
            out[i, j] += b_ * (a[i] * b[j] + b[i] * a[j])
        out[i, i] += round_part
    return out


@njit(cache=True)
def inverse_tangent_slope(psi, g, sign):
    """Return d/dpsi of H(psi)^-1 g (sign +1) or of H(psi)^-T g (sign -1), (3, 3) [unit of g].

    H^-1 = I + skew(psi)/2 + c(s) skew(psi)^2; the transpose turns the sign of the middle term.
    """
    c, c1 = inverse_coefficient(dot3(psi, psi))
    pg = cross3(psi, g)
    ppg = cross3(psi, pg)
    out = -0.5 * sign * skew3(g) - c * skew3(pg) - c * mul3(skew3(psi), skew3(g))
    for i in range(3):
        for j in range(3):
            out[i, j] += 2 * c1 * ppg[i] * psi[j]
    return out


@njit(cache=True)
def relative(x, r, count, u, psi):
    """Fill u_i = R_0^T (x_i - x_0) [m] and psi_i = log(R_0^T R_i) [rad]; return the largest |psi_i| [rad]."""
    largest = 0.0
    for i in range(count):
        u[i] = tapply3(r[0], x[i] - x[0])
        psi[i] = log3(tmul3(r[0], r[i]))
        largest = max(largest, np.sqrt(dot3(psi[i], psi[i])))
    return largest


@njit(cache=True)
def _strain(shape, slope, u, psi, count):
    """Interpolated u', psi, psi' at one Gauss point (node 0 contributes nothing: u_0 = psi_0 = 0)."""
    du, at, dpsi = np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(1, count):
        for k in range(3):
            du[k] += slope[i] * u[i, k]
            at[k] += shape[i] * psi[i, k]
            dpsi[k] += slope[i] * psi[i, k]
    return du, at, dpsi


@njit(cache=True)
def element_gradient(count, shape, slope, weight, stiffness, gamma0, kappa0, u, psi, g, hessian, internal, want_hessian):
    """Fill dE/d(u_i, psi_i) into g (count, 6) [N], [N m] and, if wanted, the second derivative; return E [J].

    hessian : (6 count, 6 count); internal : (points, 6) stress resultants in the section frame [N], [N m]
    """
    energy = 0.0
    g[:count] = 0.0
    if want_hessian:
        hessian[: 6 * count, : 6 * count] = 0.0
    for point in range(count - 1):
        du, at, dpsi = _strain(shape[point], slope[point], u, psi, count)
        s, h = exp3(at), tangent3(at)
        stretch = tapply3(s, du)
        bend_slope = tangent_slope(at, dpsi, 1.0)
        w, c = weight[point], stiffness[point]
        gamma, kappa = stretch - gamma0[point], apply3(h, dpsi) - kappa0[point]
        n, m = c[:3] * gamma, c[3:] * kappa
        internal[point, :3], internal[point, 3:] = n, m
        energy += 0.5 * w * (dot3(n, gamma) + dot3(m, kappa))
        couple = cross3(n, stretch)
        by_du = w * apply3(s, n)  # dE/du'
        by_psi = w * (tapply3(h, couple) + tapply3(bend_slope, m))  # dE/dpsi
        by_dpsi = w * tapply3(h, m)  # dE/dpsi'
        for i in range(1, count):
            for k in range(3):
                g[i, k] += slope[point, i] * by_du[k]
                g[i, 3 + k] += shape[point, i] * by_psi[k] + slope[point, i] * by_dpsi[k]
        if want_hessian:
            blocks = _point_hessian(at, dpsi, s, h, stretch, bend_slope, n, m, couple, c, w)
            _spread(count, shape[point], slope[point], blocks, hessian)
    return energy


@njit(cache=True)
def _point_hessian(at, dpsi, s, h, stretch, bend_slope, n, m, couple, c, w):
    """Second derivatives at one Gauss point: blocks [u'u', u'psi, psi psi, psi'psi, psi'psi'], each (3, 3)."""
    spin = mul3(skew3(stretch), h)  # dGamma = S^T du' + spin dpsi
    skew_n = skew3(n)
    c_spin, c_st, c_h, c_bend = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            c_spin[i, j] = c[i] * spin[i, j]
            c_st[i, j] = c[i] * s[j, i]
            c_h[i, j] = c[3 + i] * h[i, j]
            c_bend[i, j] = c[3 + i] * bend_slope[i, j]
    out = np.empty((5, 3, 3))
    out[0] = w * mul3(s, c_st)
    out[1] = w * mul3(s, c_spin - mul3(skew_n, h))
    stretching = tmul3(spin, c_spin) + tmul3(h, mul3(skew_n, spin)) + tangent_slope(at, couple, -1.0)
    bending = tmul3(bend_slope, c_bend) + tangent_curvature(at, m, dpsi)
    out[2] = w * (stretching + bending)
    out[3] = w * (tmul3(h, c_bend) + tangent_slope(at, m, -1.0))
    out[4] = w * tmul3(h, c_h)
    return out


@njit(cache=True)
def _spread(count, shape, slope, blocks, hessian):
    """Add one Gauss point's second derivatives to the nodal Hessian through the interpolation."""
    uu, up, pp, dp, dd = blocks[0], blocks[1], blocks[2], blocks[3], blocks[4]
    for i in range(1, count):
        for j in range(1, count):
            ss, sn = slope[i] * slope[j], slope[i] * shape[j]
            ns, nn = shape[i] * slope[j], shape[i] * shape[j]
            for k in range(3):
                for q in range(3):
                    hessian[6 * i + k, 6 * j + q] += ss * uu[k, q]
                    hessian[6 * i + k, 6 * j + 3 + q] += sn * up[k, q]
                    hessian[6 * i + 3 + k, 6 * j + q] += ns * up[q, k]
                    hessian[6 * i + 3 + k, 6 * j + 3 + q] += nn * pp[k, q] + sn * dp[k, q] + ns * dp[q, k] + ss * dd[k, q]


@njit(cache=True)
def nodal_forces_from_gradient(count, r0, u, psi, g, forces):
    """Fill nodal forces [N] (world) and moments [N m] (node frame), (count, 6), from dE/d(u_i, psi_i).

    du_i = R_0^T (dx_i - dx_0) - theta_0 x u_i,     dpsi_i = H_i^-1 theta_i - H_i^-T theta_0
    """
    forces[0] = 0.0
    for i in range(1, count):
        force = apply3(r0, g[i, :3])
        inverse = inverse_tangent3(psi[i])
        moment = tapply3(inverse, g[i, 3:])
        reaction = cross3(u[i], g[i, :3]) + apply3(inverse, g[i, 3:])
        for k in range(3):
            forces[i, k], forces[i, 3 + k] = force[k], moment[k]
            forces[0, k] -= force[k]
            forces[0, 3 + k] -= reaction[k]


@njit(cache=True)
def _node_maps(count, r0, u, psi, own, first):
    """Fill d(u_i, psi_i) / d(dx_i, theta_i) and / d(dx_0, theta_0), (count, 6, 6) each."""
    own[:count] = 0.0
    first[:count] = 0.0
    for i in range(1, count):
        inverse, skew_u = inverse_tangent3(psi[i]), skew3(u[i])
        for k in range(3):
            for q in range(3):
                own[i, k, q], own[i, 3 + k, 3 + q] = r0[q, k], inverse[k, q]
                first[i, k, q], first[i, k, 3 + q] = -r0[q, k], skew_u[k, q]
                first[i, 3 + k, 3 + q] = -inverse[q, k]


@njit(cache=True)
def _add_product(a, b, c, out, row, column):
    """out[row:row+6, column:column+6] += a^T b c for (6, 6) matrices."""
    bc = np.zeros((6, 6))
    for i in range(6):
        for k in range(6):
            for j in range(6):
                bc[i, j] += b[i, k] * c[k, j]
    for k in range(6):
        for i in range(6):
            for j in range(6):
                out[row + i, column + j] += a[k, i] * bc[k, j]


@njit(cache=True)
def element_tangent(count, r0, u, psi, g, hessian, own, first, tangent):
    """Fill the exact derivative of the nodal forces by (dx, theta) of all nodes, (6 count, 6 count) [N/m], [N m].

    K = B^T (d2E) B + (dB^T) g, with B from `_node_maps` (own for node i, first for node 0).
    """
    tangent[: 6 * count, : 6 * count] = 0.0
    _node_maps(count, r0, u, psi, own, first)
    for i in range(1, count):
        to_first = np.zeros((6, 6))
        for j in range(1, count):
            block = hessian[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
            _add_product(own[i], block, own[j], tangent, 6 * i, 6 * j)
            for a in range(6):
                for b in range(6):
                    for k in range(6):
                        to_first[a, b] += block[a, k] * first[j, k, b]
        for a in range(6):
            for b in range(6):
                total_own = total_first = 0.0
                for k in range(6):
                    total_own += own[i, k, a] * to_first[k, b]
                    total_first += first[i, k, a] * to_first[k, b]
                tangent[6 * i + a, b] += total_own
                tangent[b, 6 * i + a] += total_own
                tangent[a, b] += total_first
        _add_geometric(i, r0, u[i], psi[i], g[i], own[i], first[i], tangent)


@njit(cache=True)
def _add_geometric(i, r0, u, psi, g, own, first, tangent):
    """Add (dB^T) g of node i: how lever arms and frames turn under the forces that act."""
    skew_f = skew3(g[:3])
    turned = mul3(r0, skew_f)  # d(R_0 g_u) = -R_0 skew(g_u) theta_0
    by_own = inverse_tangent_slope(psi, g[3:], -1.0)  # d(H^-T g_psi) by psi_i
    by_first = inverse_tangent_slope(psi, g[3:], 1.0)
    for k in range(3):
        for q in range(3):
            tangent[6 * i + k, 3 + q] -= turned[k, q]
            tangent[k, 3 + q] += turned[k, q]
            for a in range(3):  # d(-u x g_u) = skew(g_u) du,  d(-H^-1 g_psi),  d(H^-T g_psi)
                tangent[3 + k, 6 * i + q] += skew_f[k, a] * own[a, q]
                tangent[3 + k, q] += skew_f[k, a] * first[a, q]
                tangent[3 + k, 3 + q] += skew_f[k, a] * first[a, 3 + q] - by_first[k, a] * first[3 + a, 3 + q]
                tangent[3 + k, 6 * i + 3 + q] -= by_first[k, a] * own[3 + a, 3 + q]
                tangent[6 * i + 3 + k, 6 * i + 3 + q] += by_own[k, a] * own[3 + a, 3 + q]
                tangent[6 * i + 3 + k, 3 + q] += by_own[k, a] * first[3 + a, 3 + q]
