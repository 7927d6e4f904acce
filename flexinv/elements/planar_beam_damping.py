"""Kelvin-Voigt damping of the beam element in a plane: `beam_damping` where all rotations share one axis.

With v' the slope of the velocities and phi' the rate of the section's angle, J (a, b) = (-b, a), y = S^T u':

    dGamma/dt = S^T v' - phi' J y,     dkappa/dt = slope of the nodes' rates         n = C Gamma + D dGamma/dt,  m likewise

The residual is exact.  The linearisation is symmetric, as the planar solver needs it: it keeps the damping term B^T D B (by
velocities, a factor of about 2/h by poses) and drops the derivative of strain rates by poses at given velocities, B^T D (...),
which is smaller by phi' h / 2 and acts on strains only: as many iterations as without damping.  (The symmetric part of the
dropped term would act on bending without strain, which is soft: 2 to 5 times the iterations.)  Blocks of eight points as in
`planar_beam`.
"""

from __future__ import annotations

import numpy as np

from flexinv.elements.planar_beam import (
    BEND_BEND,
    BLOCK,
    BY_BEND,
    BY_PSI,
    BY_U1,
    BY_U2,
    CONSTANTS,
    COS,
    LANES,
    N1,
    N2,
    PSI_PSI,
    SIN,
    U1_PSI,
    U1_U1,
    U1_U2,
    U2_PSI,
    U2_U2,
    WEIGHT,
    Y1,
    Y2,
    M,
)
from flexinv.kernels.jit import jit_inner

_LANES = np.uint64(LANES)
# Rows of a block of rates: S^T v' (interpolated as v'), phi', and the rates of strain.
R1, R2, SPIN, RATE1, RATE2, BENT = (np.uint64(LANES * k) for k in range(6))
RATES = np.uint64(6 * LANES)
# Rows of a block of damping coefficients.
D_AXIAL, D_SHEAR, D_BENDING = (np.uint64(LANES * k) for k in range(3))
COEFFICIENTS = np.uint64(3 * LANES)


@jit_inner
def interpolate_rates(elements, rate, r):
    """Fill v' [1/s], phi' [rad/s] and the rate of curvature of all points from the nodes' velocities, (nodes, 3)."""
    points = elements.shape.shape[1]
    for k in range(len(elements.order)):
        first = rate[elements.nodes[k, 0]]
        for g in range(elements.order[k]):
            v1, v2, spin, bent = 0.0, 0.0, first[2], 0.0
            for i in range(1, elements.order[k] + 1):
                own, slope = rate[elements.nodes[k, i]], elements.slope[k, g, i]
                v1 += slope * (own[0] - first[0])
                v2 += slope * (own[1] - first[1])
                spin += elements.shape[k, g, i] * (own[2] - first[2])
                bent += slope * (own[2] - first[2])
            n = np.uint64(k * points + g)
            at = n // _LANES * RATES + n % _LANES
            r[at + R1], r[at + R2], r[at + SPIN], r[at + BENT] = v1, v2, spin, bent


@jit_inner
def add_viscous(elements, p, r):
    """Add the viscous stresses to n, m of all points and to the first derivatives [N], [N m]; `point_gradients` came before."""
    for block in range(np.uint64(len(elements.constants)) // CONSTANTS):
        at, by, own, d = block * BLOCK, block * RATES, block * CONSTANTS, block * COEFFICIENTS
        for lane in range(_LANES):
            c, s, y1, y2 = p[at + COS + lane], p[at + SIN + lane], p[at + Y1 + lane], p[at + Y2 + lane]
            v1, v2, spin = r[by + R1 + lane], r[by + R2 + lane], r[by + SPIN + lane]
            r1, r2 = c * v1 + s * v2, c * v2 - s * v1
            rate1, rate2 = r1 + spin * y2, r2 - spin * y1
            n1 = elements.damping[d + D_AXIAL + lane] * rate1
            n2 = elements.damping[d + D_SHEAR + lane] * rate2
            m = elements.damping[d + D_BENDING + lane] * r[by + BENT + lane]
            w = elements.constants[own + WEIGHT + lane]
            r[by + R1 + lane], r[by + R2 + lane] = r1, r2
            r[by + RATE1 + lane], r[by + RATE2 + lane] = rate1, rate2
            p[at + N1 + lane] += n1
            p[at + N2 + lane] += n2
            p[at + M + lane] += m
            p[at + BY_U1 + lane] += w * (c * n1 - s * n2)
            p[at + BY_U2 + lane] += w * (s * n1 + c * n2)
            p[at + BY_PSI + lane] += w * (n1 * y2 - n2 * y1)
            p[at + BY_BEND + lane] += w * m


@jit_inner
def add_viscous_hessians(elements, cv, p, r):
    """Add what velocities, cv of a change of pose [1/s], and rates of strain do to the second derivatives [N], [N m]."""
    for block in range(np.uint64(len(elements.constants)) // CONSTANTS):
        at, _by, own, d = block * BLOCK, block * RATES, block * CONSTANTS, block * COEFFICIENTS
        for lane in range(_LANES):
            c, s, y1, y2 = p[at + COS + lane], p[at + SIN + lane], p[at + Y1 + lane], p[at + Y2 + lane]
            w = elements.constants[own + WEIGHT + lane]
            d1, d2 = w * elements.damping[d + D_AXIAL + lane], w * elements.damping[d + D_SHEAR + lane]
            p[at + U1_U1 + lane] += cv * (c * c * d1 + s * s * d2)
            p[at + U2_U2 + lane] += cv * (s * s * d1 + c * c * d2)
            p[at + U1_U2 + lane] += cv * c * s * (d1 - d2)
            p[at + U1_PSI + lane] += cv * (c * d1 * y2 + s * d2 * y1)
            p[at + U2_PSI + lane] += cv * (s * d1 * y2 - c * d2 * y1)
            p[at + PSI_PSI + lane] += cv * (d1 * y2 * y2 + d2 * y1 * y1)
            p[at + BEND_BEND + lane] += cv * w * elements.damping[d + D_BENDING + lane]


@jit_inner
def dissipated(elements, r):
    """Return the power that all elements dissipate [W]."""
    total = 0.0
    for block in range(np.uint64(len(elements.damping)) // COEFFICIENTS):
        by, own, d = block * RATES, block * CONSTANTS, block * COEFFICIENTS
        for lane in range(_LANES):
            rate1, rate2, bent = r[by + RATE1 + lane], r[by + RATE2 + lane], r[by + BENT + lane]
            strained = (
                elements.damping[d + D_AXIAL + lane] * rate1 * rate1
                + elements.damping[d + D_SHEAR + lane] * rate2 * rate2
            )
            total += elements.constants[own + WEIGHT + lane] * (
                strained + elements.damping[d + D_BENDING + lane] * bent * bent
            )
    return total
