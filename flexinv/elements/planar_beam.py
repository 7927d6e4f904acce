"""The beam element in a plane: the formulas of `beam` where all rotations share one axis, so that three freedoms are left.

A rotation is an angle: R_0^T R_i = exp(psi_i) has psi_i = theta_i - theta_0, H = 1, and what `beam` states becomes
    u_i = x_i - x_0,  phi = phi_0 + psi,  S = (c, -s; s, c)(phi)               interpolated: u', psi, psi'
    Gamma = S^T u' - Gamma_0    (axial, shear)            kappa = psi' - kappa_0    (bending)
    E = 1/2 sum_g w (Gamma . C Gamma + B kappa^2)
    dE/du' = w S n,   dE/dpsi = w (n_1 y_2 - n_2 y_1),   dE/dpsi' = w m      with n = C Gamma, m = B kappa, y = S^T u'

Where axial strain, shear and bending are coupled (`beam_law`), functions of their own add what that makes, block by block.

Kelvin-Voigt damping (`beam`), with v' the slope of velocities, phi' the rate of the section's angle, J (a, b) = (-b, a):
    dGamma/dt = S^T v' - phi' J y,     dkappa/dt = slope of the nodes' rates         n = C Gamma + D dGamma/dt,  m likewise

The residual is exact.  The linearisation is symmetric, as the planar solver needs it: it keeps the damping term B^T D B (by
velocities, a factor cv of about 2/h by poses), so that C + cv D takes the place of C, and drops the derivative of strain rates by
poses at given velocities, B^T D (...), which is smaller by phi' h / 2 and acts on strains only: as many iterations as without
damping.  (Its symmetric part would act on bending without strain, which is soft: 2 to 5 times the iterations.)

Points of all elements lie in blocks of eight, one quantity beside the other: what is done at a point is vector code.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.elements.beam_law import compute_direct_resultants, compute_planar_coupling, compute_planar_work
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.simd import cos_sin_unfused
from flexinv.typing import Array, Indices

POINTS_AT_ONCE = 8  # points of a block
_LANES = np.uint64(POINTS_AT_ONCE)
# Rows of a block.  First what is interpolated, then what follows: S, y, n, m; w times the first derivatives; w times the second.
(U1, U2, PHI, BEND, COS_PHI, SIN_PHI, Y1, Y2, N1, N2, M, BY_U1, BY_U2, BY_PSI, BY_BEND, U1_U1, U1_U2, U2_U2, U1_PSI, U2_PSI,
 PSI_PSI, BEND_BEND) = (np.uint64(POINTS_AT_ONCE * k) for k in range(22))  # fmt: skip
POINT_BLOCK = np.uint64(22 * POINTS_AT_ONCE)
# Behind all blocks, where a section is coupled: w times the second derivatives by bending and another, a block of each.
BEND_U1, BEND_U2, BEND_PSI = (np.uint64(POINTS_AT_ONCE * k) for k in range(3))
BEND_BLOCK = np.uint64(3 * POINTS_AT_ONCE)
# Rows of a block of couplings: axial with shear [N], axial and shear with bending [N m], and of damping; empty without any.
(AXIAL_SHEAR, AXIAL_BENDING, SHEAR_BENDING, D_AXIAL_SHEAR, D_AXIAL_BENDING, D_SHEAR_BENDING) = (
    np.uint64(POINTS_AT_ONCE * k) for k in range(6)
)
COUPLINGS = np.uint64(6 * POINTS_AT_ONCE)
# Rows of a block of constants.
AXIAL, SHEAR, BENDING, WEIGHT, STRAIN1, STRAIN2, CURVATURE = (np.uint64(POINTS_AT_ONCE * k) for k in range(7))
CONSTANTS = np.uint64(7 * POINTS_AT_ONCE)
# Rows of a block of rates (v', phi', the rates of strain), and of damping coefficients; both empty where no beam is damped.
R1, R2, PHI_RATE, RATE1, RATE2, KAPPA_RATE = (np.uint64(POINTS_AT_ONCE * k) for k in range(6))
RATE_BLOCK = np.uint64(6 * POINTS_AT_ONCE)
D_AXIAL, D_SHEAR, D_BENDING = (np.uint64(POINTS_AT_ONCE * k) for k in range(3))
COEFFICIENTS = np.uint64(3 * POINTS_AT_ONCE)
FULL_TURN = 2.0 * np.pi  # an element that turns more between its first and any other node is refused, as in `assembly`


@send_by_address
class PlanarElements(NamedTuple):
    """Elements in a plane.

    order : (elements,); nodes : (elements, count); shape, slope : (elements, points, count) [-], [1/m]
    bend : (elements, count) angle of each section against the first in the stress-free shape [rad]
    heading : (elements,) angle of the first section's axis in the plane when its node stands at zero [rad]
    lanes : of a block, LANES; as a number that the compiler does not know, so that it takes them all at once
    constants : (blocks * CONSTANTS,) EA, GA [N], EI [N m^2], weights [m], Gamma_0 [-], kappa_0 [1/m] of all points
    damping : (blocks * COEFFICIENTS,) of all points, empty where no beam has any [N s], [N m^2 s]
    coupling : (blocks * COUPLINGS,) of all points, empty where no section is coupled [N], [N m], [N s], [N m s]
    """

    order: Indices
    nodes: Indices
    shape: Array
    slope: Array
    bend: Array
    heading: Array
    lanes: np.uint64
    constants: Array
    damping: Array
    coupling: Array


@jit_inner
def compute_point_offset(k, g, points):
    """Return the offset of point g of element k in the first row of its block [-]."""
    n = np.uint64(k * points + g)
    return n // _LANES * POINT_BLOCK + n % _LANES


@jit_inner
def fill_point_strains(elements, pose, u, p):
    """Fill u', phi, psi' of all points from the nodes' poses (nodes, 3); return the largest |psi_i| [rad] and its element.

    u : (count, 3) scratch, u_i [m] and psi_i [rad] of one element
    """
    largest = 0.0
    worst = 0
    points = elements.shape.shape[1]
    for k in range(len(elements.order)):
        count = elements.order[k] + 1
        first = pose[elements.nodes[k, 0]]
        for i in range(1, count):
            node = pose[elements.nodes[k, i]]
            turned = node[2] - first[2] + elements.bend[k, i]
            u[i, 0] = node[0] - first[0]
            u[i, 1] = node[1] - first[1]
            u[i, 2] = turned - FULL_TURN * np.floor(turned / FULL_TURN + 0.5)
            if not abs(u[i, 2]) <= largest:
                largest = abs(u[i, 2])
                worst = k
        phi0 = elements.heading[k] + first[2]
        for g in range(count - 1):
            u1 = 0.0
            u2 = 0.0
            psi = 0.0
            bend = 0.0
            for i in range(1, count):
                slope = elements.slope[k, g, i]
                u1 = u1 + slope * u[i, 0]
                u2 = u2 + slope * u[i, 1]
                psi = psi + elements.shape[k, g, i] * u[i, 2]
                bend = bend + slope * u[i, 2]
            at = compute_point_offset(k, g, points)
            p[at + U1] = u1
            p[at + U2] = u2
            p[at + PHI] = phi0 + psi
            p[at + BEND] = bend
    return largest, worst


@jit_inner
def remove_stress(elements, p):
    """Leave all points without stress [N], [N m], exactly."""
    for block in range(np.uint64(len(elements.constants)) // CONSTANTS):
        at = block * POINT_BLOCK
        start = block * CONSTANTS
        for i in range(POINT_BLOCK):
            p[at + i] = 0.0
        for lane in range(_LANES):
            p[at + Y1 + lane] = elements.constants[start + STRAIN1 + lane]
            p[at + Y2 + lane] = elements.constants[start + STRAIN2 + lane]
            p[at + BEND + lane] = elements.constants[start + CURVATURE + lane]


@jit_inner
def fill_point_rates(elements, rate, r):
    """Fill v' [1/s], phi' [rad/s] and the rate of curvature of all points from the nodes' velocities, (nodes, 3)."""
    points = elements.shape.shape[1]
    for k in range(len(elements.order)):
        first = rate[elements.nodes[k, 0]]
        for g in range(elements.order[k]):
            v1 = 0.0
            v2 = 0.0
            spin = first[2]
            bent = 0.0
            for i in range(1, elements.order[k] + 1):
                velocity = rate[elements.nodes[k, i]]
                slope = elements.slope[k, g, i]
                v1 = v1 + slope * (velocity[0] - first[0])
                v2 = v2 + slope * (velocity[1] - first[1])
                turn = velocity[2] - first[2]
                spin = spin + elements.shape[k, g, i] * turn
                bent = bent + slope * turn
            n = np.uint64(k * points + g)
            at = n // _LANES * RATE_BLOCK + n % _LANES
            r[at + R1] = v1
            r[at + R2] = v2
            r[at + PHI_RATE] = spin
            r[at + KAPPA_RATE] = bent


@jit_inner
def fill_point_gradients(elements, p, r):
    """Fill S, y, n, m and the first derivatives of the energy at all points [N], [N m]; r : their rates, interpolated."""
    for block in range(np.uint64(len(elements.constants)) // CONSTANTS):
        if len(elements.damping) > 0:
            _fill_block_gradients(elements.lanes, block, elements, p, r)
        else:
            _fill_block_gradients(elements.lanes, block, elements, p, None)
        if len(elements.coupling) > 0:
            _add_coupled_gradients(block, elements, p, r)


@jit_inner
def _fill_block_gradients(lanes, block, elements, p, r):
    """First derivatives at the points of a block; r : None where no beam is damped, and nothing of damping is compiled."""
    at = block * POINT_BLOCK
    start = block * CONSTANTS
    k = elements.constants
    by = block * RATE_BLOCK
    d = block * COEFFICIENTS
    for lane in range(lanes):
        c, s = cos_sin_unfused(p[at + PHI + lane])
        u1 = p[at + U1 + lane]
        u2 = p[at + U2 + lane]
        y1 = c * u1 + s * u2
        y2 = c * u2 - s * u1
        direct = k[start + AXIAL + lane], k[start + SHEAR + lane], k[start + BENDING + lane]
        bent = p[at + BEND + lane] - k[start + CURVATURE + lane]
        strain = y1 - k[start + STRAIN1 + lane], y2 - k[start + STRAIN2 + lane], bent
        n1, n2, m = compute_direct_resultants(direct, strain)
        if r is not None:
            v1 = r[by + R1 + lane]
            v2 = r[by + R2 + lane]
            spin = r[by + PHI_RATE + lane]
            rate1 = c * v1 + s * v2 + spin * y2
            rate2 = c * v2 - s * v1 - spin * y1
            r[by + RATE1 + lane] = rate1
            r[by + RATE2 + lane] = rate2
            n1 += elements.damping[d + D_AXIAL + lane] * rate1
            n2 += elements.damping[d + D_SHEAR + lane] * rate2
            m += elements.damping[d + D_BENDING + lane] * r[by + KAPPA_RATE + lane]
        w = k[start + WEIGHT + lane]
        p[at + COS_PHI + lane] = c
        p[at + SIN_PHI + lane] = s
        p[at + Y1 + lane] = y1
        p[at + Y2 + lane] = y2
        p[at + N1 + lane] = n1
        p[at + N2 + lane] = n2
        p[at + M + lane] = m
        p[at + BY_U1 + lane] = w * (c * n1 - s * n2)
        p[at + BY_U2 + lane] = w * (s * n1 + c * n2)
        p[at + BY_PSI + lane] = w * (n1 * y2 - n2 * y1)
        p[at + BY_BEND + lane] = w * m


@jit_inner
def _find_planar_strain(elements, block, lane, p):
    """Axial strain, shear and curvature of a point whose gradients are there."""
    at = block * POINT_BLOCK
    start = block * CONSTANTS
    k = elements.constants
    axial = p[at + Y1 + lane] - k[start + STRAIN1 + lane]
    shear = p[at + Y2 + lane] - k[start + STRAIN2 + lane]
    return axial, shear, p[at + BEND + lane] - k[start + CURVATURE + lane]


@jit_inner
def _find_planar_rate(block, lane, r):
    """Rates of axial strain, shear and curvature of a point."""
    by = block * RATE_BLOCK
    return r[by + RATE1 + lane], r[by + RATE2 + lane], r[by + KAPPA_RATE + lane]


@jit_inner
def _find_planar_coupling(elements, block, lane):
    """The three couplings of a point, and those of its damping."""
    e = block * COUPLINGS
    c = elements.coupling
    stiff = c[e + AXIAL_SHEAR + lane], c[e + AXIAL_BENDING + lane], c[e + SHEAR_BENDING + lane]
    return stiff, (c[e + D_AXIAL_SHEAR + lane], c[e + D_AXIAL_BENDING + lane], c[e + D_SHEAR_BENDING + lane])


@jit_inner
def _add_coupled_gradients(block, elements, p, r):
    """Add what couplings make of strains and their rates to resultants and first derivatives at the points of a block."""
    at = block * POINT_BLOCK
    damped = len(elements.damping) > 0
    for lane in range(_LANES):
        stiff, drag = _find_planar_coupling(elements, block, lane)
        n1, n2, m = compute_planar_coupling(stiff, _find_planar_strain(elements, block, lane, p))
        if damped:
            d1, d2, d3 = compute_planar_coupling(drag, _find_planar_rate(block, lane, r))
            n1 += d1
            n2 += d2
            m += d3
        c = p[at + COS_PHI + lane]
        s = p[at + SIN_PHI + lane]
        w = elements.constants[block * CONSTANTS + WEIGHT + lane]
        p[at + N1 + lane] += n1
        p[at + N2 + lane] += n2
        p[at + M + lane] += m
        p[at + BY_U1 + lane] += w * (c * n1 - s * n2)
        p[at + BY_U2 + lane] += w * (s * n1 + c * n2)
        p[at + BY_PSI + lane] += w * (n1 * p[at + Y2 + lane] - n2 * p[at + Y1 + lane])
        p[at + BY_BEND + lane] += w * m


@jit_inner
def fill_point_hessians(elements, cv, p):
    """Fill the second derivatives of the energy at all points [N], [N m]; velocities are cv of a change of pose [1/s].

    d2E/du'du' = S C S^T,  d2E/du'dpsi = S (J n - C J y),  d2E/dpsi2 = J y . C J y - n . y       with C + cv D for C
    """
    for block in range(np.uint64(len(elements.constants)) // CONSTANTS):
        if len(elements.damping) > 0:
            _fill_block_hessians(elements.lanes, block, elements, cv, p)
        else:
            _fill_block_hessians(elements.lanes, block, elements, None, p)
        if len(elements.coupling) > 0:
            _add_coupled_hessians(block, elements, cv, p)


@jit_inner
def _fill_block_hessians(lanes, block, elements, cv, p):
    """Second derivatives at the points of a block; cv : None where no beam is damped."""
    at = block * POINT_BLOCK
    start = block * CONSTANTS
    d = block * COEFFICIENTS
    k = elements.constants
    for lane in range(lanes):
        c = p[at + COS_PHI + lane]
        s = p[at + SIN_PHI + lane]
        y1 = p[at + Y1 + lane]
        y2 = p[at + Y2 + lane]
        n1 = p[at + N1 + lane]
        n2 = p[at + N2 + lane]
        w = k[start + WEIGHT + lane]
        ea = k[start + AXIAL + lane]
        ga = k[start + SHEAR + lane]
        bending = k[start + BENDING + lane]
        if cv is not None:
            ea += cv * elements.damping[d + D_AXIAL + lane]
            ga += cv * elements.damping[d + D_SHEAR + lane]
            bending += cv * elements.damping[d + D_BENDING + lane]
        b1 = ea * y2 - n2
        b2 = n1 - ga * y1
        p[at + U1_U1 + lane] = w * (ea * c * c + ga * s * s)
        p[at + U2_U2 + lane] = w * (ea * s * s + ga * c * c)
        p[at + U1_U2 + lane] = w * (ea - ga) * c * s
        p[at + BEND_BEND + lane] = w * bending
        p[at + U1_PSI + lane] = w * (c * b1 - s * b2)
        p[at + U2_PSI + lane] = w * (s * b1 + c * b2)
        p[at + PSI_PSI + lane] = w * (ea * y2 * y2 + ga * y1 * y1 - n1 * y1 - n2 * y2)


@jit_inner
def _add_coupled_hessians(block, elements, cv, p):
    """Add what couplings c (with cv times those of damping) make: c_ij (a_i a_j^T + a_j a_i^T), a the derivatives of strains.

    dGamma_1 = (c, s) . du' + y_2 dpsi,   dGamma_2 = (-s, c) . du' - y_1 dpsi,   dkappa = dpsi'
    """
    at = block * POINT_BLOCK
    start = block * CONSTANTS
    behind = np.uint64(len(elements.constants)) // CONSTANTS * POINT_BLOCK + block * BEND_BLOCK
    damped = len(elements.damping) > 0
    for lane in range(_LANES):
        stiff, drag = _find_planar_coupling(elements, block, lane)
        by = cv if damped else 0.0
        shear = stiff[0] + by * drag[0]
        bent = stiff[1] + by * drag[1]
        slid = stiff[2] + by * drag[2]
        c = p[at + COS_PHI + lane]
        s = p[at + SIN_PHI + lane]
        y1 = p[at + Y1 + lane]
        y2 = p[at + Y2 + lane]
        w = elements.constants[start + WEIGHT + lane]
        p[at + U1_U1 + lane] -= 2.0 * w * shear * c * s
        p[at + U2_U2 + lane] += 2.0 * w * shear * c * s
        p[at + U1_U2 + lane] += w * shear * (c * c - s * s)
        p[at + U1_PSI + lane] -= w * shear * (c * y1 + s * y2)
        p[at + U2_PSI + lane] += w * shear * (c * y2 - s * y1)
        p[at + PSI_PSI + lane] -= 2.0 * w * shear * y1 * y2
        p[behind + BEND_U1 + lane] = w * (bent * c - slid * s)
        p[behind + BEND_U2 + lane] = w * (bent * s + slid * c)
        p[behind + BEND_PSI + lane] = w * (bent * y2 - slid * y1)


@jit_inner
def add_forces(elements, pose, p, wrench, felt):
    """Add the nodal forces, the gradient of the energy, to wrench (nodes, 3) [N], [N m]; felt (elements, count, 3): by element.

    Those on the first node follow from balance: F_0 = - sum F_i,  M_0 = - sum (M_i + (x_i - x_0) x F_i)
    """
    points = elements.shape.shape[1]
    for k in range(len(elements.order)):
        count = elements.order[k] + 1
        first = elements.nodes[k, 0]
        fx = 0.0
        fy = 0.0
        moment = 0.0
        for i in range(1, count):
            n = elements.nodes[k, i]
            f1 = 0.0
            f2 = 0.0
            m = 0.0
            for g in range(count - 1):
                at = compute_point_offset(k, g, points)
                slope = elements.slope[k, g, i]
                f1 = f1 + slope * p[at + BY_U1]
                f2 = f2 + slope * p[at + BY_U2]
                m += elements.shape[k, g, i] * p[at + BY_PSI] + slope * p[at + BY_BEND]
            felt[k, i, 0] = f1
            felt[k, i, 1] = f2
            felt[k, i, 2] = m
            wrench[n, 0] += f1
            wrench[n, 1] += f2
            wrench[n, 2] += m
            fx = fx - f1
            fy = fy - f2
            moment -= m + (pose[n, 0] - pose[first, 0]) * f2 - (pose[n, 1] - pose[first, 1]) * f1
        felt[k, 0, 0] = fx
        felt[k, 0, 1] = fy
        felt[k, 0, 2] = moment
        wrench[first, 0] += fx
        wrench[first, 1] += fy
        wrench[first, 2] += moment


@jit_inner
def compute_pair_stiffness(k, i, j, elements, p):
    """Return the exact stiffness of element k between nodes i and j: force on i by pose of j, (3, 3) [N/m], [N], [N m].

    K_ij = sum_g (A N_i' N_j', b N_i' N_j; b^T N_i N_j', d N_i N_j + w EI N_i' N_j')  with A, b, d of `fill_point_hessians`,
    and where bending is coupled  (0, h N_i' N_j'; h^T N_i' N_j', e (N_i N_j' + N_i' N_j))  with h, e behind the blocks.
    """
    a11 = 0.0
    a12 = 0.0
    a22 = 0.0
    b1 = 0.0
    b2 = 0.0
    c1 = 0.0
    c2 = 0.0
    d = 0.0
    for g in range(elements.order[k]):
        at = compute_point_offset(k, g, elements.shape.shape[1])
        slope_i = elements.slope[k, g, i]
        slope_j = elements.slope[k, g, j]
        shape_i = elements.shape[k, g, i]
        shape_j = elements.shape[k, g, j]
        slopes = slope_i * slope_j
        a11 = a11 + p[at + U1_U1] * slopes
        a12 = a12 + p[at + U1_U2] * slopes
        a22 = a22 + p[at + U2_U2] * slopes
        b1 = b1 + p[at + U1_PSI] * slope_i * shape_j
        b2 = b2 + p[at + U2_PSI] * slope_i * shape_j
        c1 = c1 + p[at + U1_PSI] * shape_i * slope_j
        c2 = c2 + p[at + U2_PSI] * shape_i * slope_j
        d += p[at + PSI_PSI] * shape_i * shape_j + p[at + BEND_BEND] * slopes
    if len(elements.coupling) > 0:
        h1, h2, e = _compute_coupled_pair(k, i, j, elements, p)
        b1 += h1
        b2 += h2
        c1 += h1
        c2 += h2
        d += e
    return (a11, a12, b1), (a12, a22, b2), (c1, c2, d)


@jit_inner
def _compute_coupled_pair(k, i, j, elements, p):
    """The part of couplings of bending in the stiffness between two nodes: h and e of `compute_pair_stiffness`."""
    h1 = 0.0
    h2 = 0.0
    e = 0.0
    blocks = np.uint64(len(elements.constants)) // CONSTANTS
    for g in range(elements.order[k]):
        n = np.uint64(k * elements.shape.shape[1] + g)
        at = blocks * POINT_BLOCK + n // _LANES * BEND_BLOCK + n % _LANES
        slope_i = elements.slope[k, g, i]
        slope_j = elements.slope[k, g, j]
        h1 += p[at + BEND_U1] * slope_i * slope_j
        h2 += p[at + BEND_U2] * slope_i * slope_j
        e += p[at + BEND_PSI] * (elements.shape[k, g, i] * slope_j + slope_i * elements.shape[k, g, j])
    return h1, h2, e


@jit_inner
def compute_energy(elements, p):
    """Return the elastic energy of all elements [J]."""
    total = 0.0
    c = elements.constants
    for block in range(np.uint64(len(c)) // CONSTANTS):
        start = block * CONSTANTS
        for lane in range(_LANES):
            axial, shear, curvature = _find_planar_strain(elements, block, lane, p)
            stretched = c[start + AXIAL + lane] * axial * axial + c[start + SHEAR + lane] * shear * shear
            bent = c[start + BENDING + lane] * curvature * curvature
            total += 0.5 * c[start + WEIGHT + lane] * (stretched + bent)
            if len(elements.coupling) > 0:
                stiff = _find_planar_coupling(elements, block, lane)[0]
                total += 0.5 * c[start + WEIGHT + lane] * compute_planar_work(stiff, (axial, shear, curvature))
    return total


@jit_inner
def compute_dissipated_power(elements, r):
    """Return the power that all elements dissipate [W]."""
    total = 0.0
    damping = elements.damping
    for block in range(np.uint64(len(damping)) // COEFFICIENTS):
        start = block * CONSTANTS
        d = block * COEFFICIENTS
        for lane in range(_LANES):
            rate1, rate2, bent = _find_planar_rate(block, lane, r)
            lost = damping[d + D_AXIAL + lane] * rate1 * rate1 + damping[d + D_SHEAR + lane] * rate2 * rate2
            lost += damping[d + D_BENDING + lane] * bent * bent
            if len(elements.coupling) > 0:
                drag = _find_planar_coupling(elements, block, lane)[1]
                lost += compute_planar_work(drag, _find_planar_rate(block, lane, r))
            total += elements.constants[start + WEIGHT + lane] * lost
    return total
