"""Kelvin-Voigt damping of the beam element: rates of strain at a Gauss point, and how they vary with the deformation.

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

from flexinv.elements.beam import Vector, inverse_tangent_slope, part, put_part, tangent_slope
from flexinv.elements.beam import tangent_curvature as curvature
from flexinv.kernels.jit import jit_inner, jit_shared
from flexinv.kernels.vec3 import (
    add,
    add_scaled,
    apply,
    cross,
    madd,
    mat,
    mscale,
    msub,
    mul,
    put,
    put_block,
    rows,
    skew,
    sub,
    tapply,
    tmul,
    transpose,
    vec,
)
from flexinv.typing import Array

NONE = (0.0, 0.0, 0.0)
UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Rates(NamedTuple):
    """Work space of damping beside `beam.Scratch` for one element, count = order + 1 nodes; empty where no beam is damped.

    v, w : (count, 3) velocity (world) [m/s] and angular velocity (own frame) [rad/s]; du, dpsi : (count, 3) relative rates
    turned : (count, 3, 3) how dpsi_i varies with the node's own turn [1/s]; spin : (3, 3) skew(W_0) [rad/s]
    parts : (4, 36) derivatives at a Gauss point by velocities, as `beam.Scratch.parts` by poses
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
    def of(cls, count: int) -> Rates:
        """Return arrays for elements of at most ``count`` nodes [-]."""
        vectors = 4 * [(count, 3)]
        shapes = (*vectors, (count, 3, 3), (3, 3), (4, 36), (count, count, 36), (6 * count, 6 * count))
        return cls(*(np.zeros(shape) for shape in shapes))


class Rate(NamedTuple):
    """Rates at a Gauss point: S^T du', H dpsi, dpsi, dpsi', and of strain, dGamma/dt and dkappa/dt [1/s], [rad/s]."""

    slid: Vector
    turn: Vector
    psi: Vector
    dpsi: Vector
    gamma: Vector
    kappa: Vector


@jit_shared
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
def rate_of(count, shape, slope, point, rates):
    """Return the `Rate` [1/s], [rad/s] of the relative motion at one Gauss point."""
    du, psi, dpsi = _interpolate_rates(count, shape, slope, rates)
    slid, turn = tapply(point.s, du), apply(point.h, psi)
    gamma = add(slid, cross(point.stretch, turn))
    return Rate(slid, turn, psi, dpsi, gamma, add(apply(point.h, dpsi), apply(point.bend, psi)))


@jit_inner
def rates_by_pose(point, rate, damping, w, parts):
    """Add w B^T D d(de/dt)/dz, how strain rates vary with the deformation, to the parts by poses [N], [N m].

    damping : D_N [N s], D_M [N m^2 s]
    """
    psi, dpsi, q, s, h, stretch, bend = point
    slid, turn, psi_rate, dpsi_rate, _, _ = rate
    d_n, d_m = damping
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
