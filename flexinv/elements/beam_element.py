"""The beam element as the march takes it: nodal forces and their tangents, with and without damping from one source.

Nodal forces are the gradient of E, so power closes in space as in the plane; the tangent is the exact derivative.
Increments: dx_i in the world frame, theta_i in the node's own frame (R_i <- R_i exp(theta_i)); forces are dual to them.
What the first node feels, and how it acts on the others, follows from objectivity: a rigid motion strains nothing.
Without damping the tangent is symmetric, and half of it is enough.  Sources: as `beam`.
"""

from __future__ import annotations

from typing import NamedTuple

from flexinv.elements.beam import (
    add_coupled_derivatives,
    add_rate_derivatives,
    add_to_node_pairs,
    compute_inverse_slope,
    compute_rate_slopes,
    compute_strain_slopes,
    fill_coupled_part_with_zeros,
    fill_point_hessian,
    make_point,
    make_rate,
    read_part,
)
from flexinv.elements.beam_law import compute_coupled_resultants, compute_direct_resultants
from flexinv.kernels import vec3
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import (
    add,
    block,
    dot,
    madd,
    mat,
    msub,
    mul,
    put_block,
    put_pair,
    scale,
    skew,
    sub,
    vec,
    vec_at,
)
from flexinv.model.owned_cache import make_read_only
from flexinv.typing import Array, Indices


@send_by_address
class Elements(NamedTuple):
    """Beam elements, padded to the highest order in use.

    order : (elements,); nodes : (elements, order+1) node numbers, -1 where padded
    stiffness : (elements, points, 6) EA, GA_y, GA_z [N], GJ, EI_y, EI_z [N m^2] at the Gauss points
    damping : (elements, points, 6) [N s], [N m^2 s] of the rates of strain; (0, points, 6) where no beam has any
    coupling, damping_coupling : (elements, points, 6, 6) what is beside the diagonals of both, their own diagonals zero
        (`beam_law`) [N], [N m], [N m^2]; (0, points, 6, 6) where strains of no beam are coupled
    gamma0, kappa0 : (elements, points, 3) strains of the stress-free shape [-], [1/m]
    weight : (elements, points) Gauss weight times ds/dxi [m]
    shape, slope : (elements, points, order+1) interpolation and its derivative by arc length [-], [1/m]
    station : (elements, points) fraction of the link's length [-]; link : (elements,) index into mechanism.links
    """

    order: Indices
    nodes: Indices
    stiffness: Array
    damping: Array
    coupling: Array
    damping_coupling: Array
    gamma0: Array
    kappa0: Array
    weight: Array
    shape: Array
    slope: Array
    station: Array
    link: Indices


def scale_stiffness(elements: Elements, factor: float) -> Elements:
    """Return the elements ``factor`` times as stiff [-], their damping as it is."""
    stiffness = make_read_only(factor * elements.stiffness)
    return elements._replace(stiffness=stiffness, coupling=make_read_only(factor * elements.coupling))


@jit_inner
def _add_point(k, g, count, elements, scratch, rates, internal, want_tangent):
    """Add a Gauss point to the gradient, and its derivatives; return what it stores [J] and loses [W]."""
    shape = elements.shape[k, g]
    slope = elements.slope[k, g]
    w = elements.weight[k, g]
    point = make_point(count, shape, slope, scratch)
    gamma = sub(point.stretch, vec(elements.gamma0[k, g]))
    kappa = sub(vec3.apply(point.h, point.dpsi), vec(elements.kappa0[k, g]))
    n, m = _compute_resultants(elements.stiffness, elements.coupling, k, g, gamma, kappa)
    lost = 0.0
    stored = 0.5 * w * (dot(n, gamma) + dot(m, kappa))
    if rates is not None:
        rate = make_rate(count, shape, slope, point, rates)
        n_lost, m_lost = _compute_resultants(elements.damping, elements.damping_coupling, k, g, rate.gamma, rate.kappa)
        n = add(n, n_lost)
        m = add(m, m_lost)
        lost = w * (dot(n_lost, rate.gamma) + dot(m_lost, rate.kappa))
    put_pair(internal, n, m)
    couple = vec3.cross(n, point.stretch)
    _add_point_gradient(count, shape, slope, w, point, (n, m, couple), scratch.gradient)
    if want_tangent:
        _fill_parts(elements.stiffness, elements.coupling, k, g, point, (n, m, couple), w, scratch.parts)
        if rates is not None:
            _fill_damped_parts(elements, k, g, point, rate, w, scratch.parts, rates.parts)
            add_to_node_pairs(count, shape, slope, rates.parts, rates.drag, True)
        add_to_node_pairs(count, shape, slope, scratch.parts, scratch.hessian, rates is not None)
    return stored, lost


@jit_inner
def _compute_resultants(direct, coupling, k, g, gamma, kappa):
    """The stress resultants of strains, or those of damping of their rates, by the law at a point [N], [N m]."""
    n = compute_direct_resultants(vec(direct[k, g]), gamma)
    m = compute_direct_resultants(vec_at(direct[k, g], 3), kappa)
    if len(coupling) > 0:
        strain = gamma[0], gamma[1], gamma[2], kappa[0], kappa[1], kappa[2]
        by = compute_coupled_resultants(coupling[k, g], strain)
        n = add(n, (by[0], by[1], by[2]))
        m = add(m, (by[3], by[4], by[5]))
    return n, m


@jit_inner
def _fill_parts(direct, coupling, k, g, point, stress, w, parts):
    """Fill second derivatives at a point by the law there, of stiffness or of damping [N], [N m]."""
    fill_point_hessian(point, stress, (vec(direct[k, g]), vec_at(direct[k, g], 3)), w, parts)
    if len(coupling) > 0:
        fill_coupled_part_with_zeros(parts)
        add_coupled_derivatives(point, compute_strain_slopes(point), coupling[k, g], w, parts)


@jit_inner
def _fill_damped_parts(elements, k, g, point, rate, w, parts, by_velocity):
    """Fill what damping at a point makes of velocities, and add what it makes of poses at given velocities [N], [N m]."""
    none = (vec3.ZERO, vec3.ZERO, vec3.ZERO)
    _fill_parts(elements.damping, elements.damping_coupling, k, g, point, none, w, by_velocity)
    slopes = compute_rate_slopes(point, rate)
    damping = vec(elements.damping[k, g]), vec_at(elements.damping[k, g], 3)
    add_rate_derivatives(point, slopes, damping, w, parts)
    if len(elements.damping_coupling) > 0:
        add_coupled_derivatives(point, slopes, elements.damping_coupling[k, g], w, parts)


@jit_inner
def _add_point_gradient(count, shape, slope, w, point, resultants, gradient):
    """Add a Gauss point to dE/d(u_i, psi_i), from n, m and n x y."""
    n, m, couple = resultants
    by_du = scale(w, vec3.apply(point.s, n))
    by_dpsi = scale(w, vec3.tapply(point.h, m))
    by_psi = scale(w, add(vec3.tapply(point.h, couple), vec3.tapply(point.bend, m)))
    for i in range(1, count):
        vec3.add_pair(gradient[i], scale(slope[i], by_du), add(scale(shape[i], by_psi), scale(slope[i], by_dpsi)))


@jit_inner
def fill_element_gradient(k, count, elements, scratch, rates, internal, want_tangent):
    """Fill dE/d(u_i, psi_i) of element k, scratch.gradient [N], [N m] and, if wanted, its derivatives.

    elements : `Elements`; internal : (points, 6) stress resultants in the section frame [N], [N m]
    rates : `beam.Rates` of a damped element, here and below; None of an undamped one, for which their branches are not compiled
    Return the elastic energy [J] and the power that is dissipated [W].
    """
    energy = 0.0
    lost = 0.0
    _fill_zeros(count, scratch.gradient, scratch.hessian, want_tangent)
    if rates is not None:
        _fill_zeros(count, scratch.gradient, rates.drag, want_tangent)
    for g in range(count - 1):
        stored, gone = _add_point(k, g, count, elements, scratch, rates, internal[g], want_tangent)
        energy = energy + stored
        lost = lost + gone
    return energy, lost


@jit_inner
def _fill_zeros(count, gradient, pairs, want_tangent):
    for i in range(count):
        gradient[i, :6] = 0.0
        for j in range(count if want_tangent else 0):
            for k in range(36):
                pairs[i, j, k] = 0.0


@jit_inner
def fill_element_forces(count, scratch):
    """Fill scratch.forces, (count, 6) [N] (world) and [N m] (node frame), from dE/d(u_i, psi_i).

    F_i = dE/du_i, M_i = H_i^-T dE/dpsi_i; the sums of forces and moments vanish, and R_0^T R_i H_i^-T = H_i^-1:
    F_0 = - sum F_i,   M_0 = - sum (R_0^T (u_i x F_i) + H_i^-1 dE/dpsi_i)
    """
    force = vec3.ZERO
    moment = vec3.ZERO
    r0 = mat(scratch.r[0])
    for i in range(1, count):
        inverse = mat(scratch.inverse[i])
        f = vec(scratch.gradient[i])
        by_psi = vec_at(scratch.gradient[i], 3)
        put_pair(scratch.forces[i], f, vec3.tapply(inverse, by_psi))
        force = sub(force, f)
        moment = sub(moment, add(vec3.tapply(r0, vec3.cross(vec(scratch.u[i]), f)), vec3.apply(inverse, by_psi)))
    put_pair(scratch.forces[0], force, moment)


@jit_inner
def _fill_pair(i, j, scratch, rates, tangent):
    """Set how the forces on node i vary with the motion of node j, both beyond the first.

    By poses K = B^T (d2E) B + (dB^T) g with B = diag(1, H_i^-1), symmetric but for (theta_i, theta_i): translations and rotations
    of different nodes commute; with damping  A_i^T (P A_j + V E_j),  and by velocities  A_i^T V A_j.
    """
    inverse = mat(scratch.inverse[i])
    other = mat(scratch.inverse[j])
    stiff = scratch.hessian[i, j]
    row = 6 * i
    column = 6 * j
    x_x = read_part(stiff, 0, 0)
    x_t = mul(read_part(stiff, 0, 3), other)
    t_x = read_part(stiff, 3, 0)
    t_t = mul(read_part(stiff, 3, 3), other)
    if rates is not None:
        drag = rates.drag[i, j]
        spin = mat(rates.spin)
        turned = mat(rates.turned[j])
        x_x = msub(x_x, mul(read_part(drag, 0, 0), spin))
        x_t = madd(x_t, mul(read_part(drag, 0, 3), turned))
        t_x = msub(t_x, mul(read_part(drag, 3, 0), spin))
        t_t = madd(t_t, mul(read_part(drag, 3, 3), turned))
    t_x = vec3.tmul(inverse, t_x)
    t_t = vec3.tmul(inverse, t_t)
    if i == j:
        geometric = compute_inverse_slope(vec(scratch.psi[i]), vec_at(scratch.gradient[i], 3), -1.0)
        t_t = madd(t_t, mul(geometric, inverse))
    _write_pair(tangent, row, column, ((x_x, x_t), (t_x, t_t)))
    if rates is not None:
        t_x = vec3.tmul(inverse, read_part(drag, 3, 0))
        t_t = vec3.tmul(inverse, mul(read_part(drag, 3, 3), other))
        _write_pair(
            rates.by_velocity, row, column, ((read_part(drag, 0, 0), mul(read_part(drag, 0, 3), other)), (t_x, t_t))
        )
    elif j > i:
        _write_transpose(tangent, row, column)


@jit_inner
def _write_pair(a, row, column, blocks):
    """Write a (6, 6) block from its four (3, 3) blocks."""
    put_block(a, row, column, blocks[0][0])
    put_block(a, row, column + 3, blocks[0][1])
    put_block(a, row + 3, column, blocks[1][0])
    put_block(a, row + 3, column + 3, blocks[1][1])


@jit_inner
def _write_transpose(a, row, column):
    """Write the transpose of a (6, 6) block where symmetry has it."""
    for i in range(6):
        for j in range(6):
            a[column + j, row + i] = a[row + i, column + j]


@jit_inner
def fill_element_tangent(count, scratch, tangent):
    """Fill the exact derivative of the nodal forces by (dx, theta) of all nodes, (6 count, 6 count) [N/m], [N], [N m]."""
    for i in range(1, count):
        for j in range(i, count):
            _fill_pair(i, j, scratch, None, tangent)
    for i in range(count - 1, -1, -1):  # node 0 last: its row is the transpose of its column
        _fill_root_column(i, count, scratch, None, tangent)
        if i > 0:
            _write_transpose(tangent, 6 * i, 0)


@jit_inner
def fill_damped_tangent(count, scratch, rates, nodes, variation, tangent):
    """Fill how nodal forces vary with the motion of the element's nodes [N/m], [N], [N m].

    Columns of nodes beyond the first are by their own unknowns, whose velocities follow as ``variation``
    (`kinematics.tree.Variation`) says; those of the first are by its pose, and the last six by its velocity.
    """
    for i in range(1, count):
        for j in range(1, count):
            _fill_pair(i, j, scratch, rates, tangent)
    for j in range(1, count):
        _fill_first_row(j, count, scratch, rates, tangent)
    for i in range(count):
        _fill_root_column(i, count, scratch, rates, tangent)
    last = tangent.shape[1] - 6
    for row in range(6 * count):
        by = rates.by_velocity[row]
        for k in range(6):
            tangent[row, last + k] = by[k]
        for j in range(1, count):
            n = nodes[j]
            at = 6 * j
            turned = vec_at(by, 6 * j + 3)
            for k in range(3):  # a section's places move its velocity alone, its turns its angular velocity
                tangent[row, at + k] += by[at + k] * variation.v[n, k, k]
                tangent[row, at + 3 + k] += dot(turned, vec(variation.w[n, 3 + k]))


@jit_inner
def _fill_first_row(j, count, scratch, rates, tangent):
    """Forces on the first node by pose and velocity of node j: F_0 = - sum F_i,  M_0 = - R_0^T sum (u_i x F_i + R_i M_i)."""
    force = vec(scratch.forces[j])
    moment = vec_at(scratch.forces[j], 3)
    carried = mul(mat(scratch.r[j]), skew(moment))  # R_j (theta x M) = - R_j skew(M) theta
    _fill_row_sum(j, count, scratch, vec3.mscale(-1.0, skew(force)), vec3.mscale(-1.0, carried), tangent)
    _fill_row_sum(j, count, scratch, vec3.diagonal(0.0), vec3.diagonal(0.0), rates.by_velocity)


@jit_inner
def _fill_row_sum(j, count, scratch, by_x, by_t, a):
    """Balance of one column of (6, 6) blocks; by_x, by_t : how arm and frame of node j itself change the moment."""
    none = vec3.diagonal(0.0)
    r0 = mat(scratch.r[0])
    x_x = none
    x_t = none
    t_x = by_x
    t_t = by_t
    for i in range(1, count):
        arm = skew(vec(scratch.u[i]))
        turn = mat(scratch.r[i])
        row = 6 * i
        column = 6 * j
        f_x = block(a, row, column)
        f_t = block(a, row, column + 3)
        x_x = msub(x_x, f_x)
        x_t = msub(x_t, f_t)
        t_x = madd(t_x, madd(mul(arm, f_x), mul(turn, block(a, row + 3, column))))
        t_t = madd(t_t, madd(mul(arm, f_t), mul(turn, block(a, row + 3, column + 3))))
    back = vec3.mscale(-1.0, vec3.transpose(r0))
    _write_pair(a, 0, 6 * j, ((x_x, x_t), (mul(back, t_x), mul(back, t_t))))


@jit_inner
def _fill_root_column(i, count, scratch, rates, tangent):
    """Set how forces on node i vary with the motion of the first node, from that with all others.

    Moved along with the element they do not change, K_(i,x0) = - sum_j K_(i,xj), nor by rigid velocities; turned about
    x_0 by phi, poses and velocities, they turn:
    K_(i,t0) R_0^T phi = (phi x F_i, 0) - sum_j (K_(i,xj) (phi x u_j) + K_(i,tj) R_j^T phi + V_(i,vj) (phi x (v_j - v_0)))
    """
    none = vec3.diagonal(0.0)
    r0 = mat(scratch.r[0])
    row = 6 * i
    for half in range(0, 6, 3):
        by_x = none
        by_v = none
        by_w = none
        by_t = vec3.mscale(-1.0, skew(vec(scratch.forces[i]))) if half == 0 else none
        for j in range(1, count):
            arm = skew(vec(scratch.u[j]))
            turn = vec3.transpose(mat(scratch.r[j]))
            column = 6 * j
            k_x = block(tangent, row + half, column)
            k_t = block(tangent, row + half, column + 3)
            by_x = msub(by_x, k_x)
            turned = msub(mul(k_x, arm), mul(k_t, turn))
            if rates is not None:
                v_x = block(rates.by_velocity, row + half, column)
                v_t = block(rates.by_velocity, row + half, column + 3)
                turned = madd(turned, mul(v_x, skew(sub(vec(rates.v[j]), vec(rates.v[0])))))
                by_v = msub(by_v, v_x)
                by_w = madd(by_w, msub(mul(v_x, arm), mul(v_t, turn)))
            by_t = madd(by_t, turned)
        put_block(tangent, row + half, 0, by_x)
        put_block(tangent, row + half, 3, mul(by_t, r0))
        if rates is not None:
            put_block(rates.by_velocity, row + half, 0, by_v)
            put_block(rates.by_velocity, row + half, 3, mul(by_w, r0))
