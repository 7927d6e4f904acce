"""One instant of the march: place all nodes, sum the wrenches on every block, and linearise both.

Residual of a block = inertia + elastic forces - loads on its independent node and along its passive freedoms; zero in motion.
The unknowns' increments are dx (world), theta (own frame) of independent nodes and dq of passive joints; velocities and
accelerations vary with them as the integrator says, dv = cv dx, da = ca dx (`integrate`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.beam import Scratch, element_gradient, element_tangent, nodal_forces, relative
from flexinv.compiled import jit_inner
from flexinv.damped_beam import Rates, damped_gradient, damped_tangent, relative_rates
from flexinv.mechanism import Array
from flexinv.rotations import exp, inverse_tangent
from flexinv.system import FRICTION_RATE
from flexinv.tree import bring_back, bring_back_variation, carry, carry_variation
from flexinv.vectors import (
    add,
    add_scaled,
    add_to,
    apply,
    cross,
    dot,
    mat,
    mscale,
    mul,
    put,
    put_block,
    scale,
    sub,
    tapply,
    transpose,
    vec,
    vec_at,
)


class State(NamedTuple):
    """Unknowns of a step.

    x, r : (nodes, 3), (nodes, 3, 3) pose at the start of the step: of independent nodes in the world, of passive joints
        in the parent's frame; d, u, du : (unknowns,) increment since then, velocity, acceleration [m, rad, s]
    pseudo : (unknowns,) the integrator's auxiliary acceleration at the start of the step
    u0, du0 : (unknowns,) velocity and acceleration at the start of the step; kept : (unknowns,) set aside
    place : (unknowns,) coordinate of a passive scalar joint at the start of the step, against which its spring pulls [rad], [m]
    """

    x: Array
    r: Array
    d: Array
    u: Array
    du: Array
    pseudo: Array
    u0: Array
    du0: Array
    kept: Array
    place: Array


class Work(NamedTuple):
    """Wrenches, residual and linearisation, allocated once.

    wrench : (nodes, 6); dwrench : (nodes, columns, 6); residual : (sides, unknowns), the first is it, the others belong to
        the closures (`ties`); diagonal : (blocks, columns, columns)
    tangent : (elements, 6 count, 6 count), with damping six columns more (`damped_beam`); internal : (elements, points, 6)
    energy : (3,) elastic energy [J], power of the internal forces and what of it is dissipated [W]
    element, rates : scratch of one element; own_x, own_t : (columns, 3), scratch of one passive joint
    system : (rows, rows + columns + sides), scratch of one elimination; settled : (2, nodes, 6), scratch of `settle`
    solved : (elements, rows, columns + sides) eliminated unknowns by those of the element's first block
    """

    wrench: Array
    dwrench: Array
    residual: Array
    diagonal: Array
    tangent: Array
    internal: Array
    energy: Array
    element: Scratch
    rates: Rates
    own_x: Array
    own_t: Array
    system: Array
    solved: Array
    settled: Array


# An element that turns more than this between its first and any other node is too coarse (log is singular at pi).
LARGEST_TURN = 2.5  # [rad]
NONE = (0.0, 0.0, 0.0)
UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@jit_inner
def place(t, s, j, f, d, cv, ca, want_tangent):
    """Set motion f and variation d of all nodes from the unknowns s and the prescribed relative motion j [m, rad, s]."""
    for n in range(len(t.parent)):
        columns = t.size[t.block[n]] if want_tangent else 0
        _clear(n, columns, d)
        if t.independent[n]:
            _place_section(n, t.offset[t.block[n]], columns, s, f, d, cv, ca)
        else:
            if t.freedoms[n] > 0:
                _place_passive(n, t, s, j, d, cv, ca, columns)
            carry(n, t.parent[n], f, j)
            carry_variation(n, t.parent[n], columns, f, j, d)


@jit_inner
def _clear(n, columns, d):
    for k in range(columns):
        for i in range(3):
            d.x[n, k, i] = d.t[n, k, i] = d.v[n, k, i] = d.w[n, k, i] = d.a[n, k, i] = d.al[n, k, i] = 0.0


@jit_inner
def _place_section(n, o, columns, s, f, d, cv, ca):
    psi = vec_at(s.d, o + 3)
    put(f.x[n], 0, add(vec(s.x[n]), vec_at(s.d, o)))
    put_block(f.r[n], 0, 0, mul(mat(s.r[n]), exp(psi)))
    put(f.v[n], 0, vec_at(s.u, o))
    put(f.w[n], 0, vec_at(s.u, o + 3))
    put(f.a[n], 0, vec_at(s.du, o))
    put(f.al[n], 0, vec_at(s.du, o + 3))
    if columns == 0:
        return
    for k in range(3):
        d.x[n, k, k], d.v[n, k, k], d.a[n, k, k] = 1.0, cv, ca
        d.t[n, 3 + k, k] = 1.0
    turned = transpose(inverse_tangent(psi))  # dpsi = H^-1 theta
    put_block(d.w[n], 3, 0, mscale(cv, turned))
    put_block(d.al[n], 3, 0, mscale(ca, turned))


@jit_inner
def passive_psi(n, t, s, first):
    """Return the rotation vector [rad] that a passive joint has turned since the start of the step."""
    psi = NONE
    for k in range(t.freedoms[n]):
        psi = add_scaled(psi, s.d[first + k], vec(t.turn[n, k]))
    return psi


@jit_inner
def _place_passive(n, t, s, j, d, cv, ca, columns):
    """Relative motion of a passive joint, and with ``columns`` its variation."""
    first = t.offset[t.block[n]] + t.column[n]
    psi = passive_psi(n, t, s, first)
    inverse = inverse_tangent(psi)
    p, dp, ddp, w, al = vec(s.x[n]), NONE, NONE, NONE, NONE
    for k in range(t.freedoms[n]):
        slide, turn = vec(t.slide[n, k]), vec(t.turn[n, k])
        p = add_scaled(p, s.d[first + k], slide)
        dp, w = add_scaled(dp, s.u[first + k], slide), add_scaled(w, s.u[first + k], turn)
        ddp, al = add_scaled(ddp, s.du[first + k], slide), add_scaled(al, s.du[first + k], turn)
        if columns > 0:
            at = t.column[n] + k
            rate = apply(inverse, turn) if t.triple[n] >= 0 else turn
            _put_variation(n, at, d, slide, turn, scale(cv, slide), scale(cv, rate), scale(ca, slide), scale(ca, rate))
    put(j.p[n], 0, p)
    put_block(j.r[n], 0, 0, mul(mat(s.r[n]), exp(psi)))
    put(j.dp[n], 0, dp)
    put(j.ddp[n], 0, ddp)
    put(j.w[n], 0, w)
    put(j.al[n], 0, al)


@jit_inner
def _put_variation(n, k, d, x, t, v, w, a, al):
    put(d.x[n, k], 0, x)
    put(d.t[n, k], 0, t)
    put(d.v[n, k], 0, v)
    put(d.w[n, k], 0, w)
    put(d.a[n, k], 0, a)
    put(d.al[n, k], 0, al)


@jit_inner
def node_wrenches(t, f, d, level, work, want_tangent):
    """Set every node's own wrench P = m (a - g), Q = J al + w x J w, and its variation; ``level`` of g acts [N], [N m]."""
    gravity = scale(level, vec(t.gravity))
    for n in range(len(t.parent)):
        m, inertia, w = t.mass[n], mat(t.inertia[n]), vec(f.w[n])
        spin = apply(inertia, w)
        put(work.wrench[n], 0, scale(m, sub(vec(f.a[n]), gravity)))
        put(work.wrench[n], 3, add(apply(inertia, vec(f.al[n])), cross(w, spin)))
        for k in range(t.size[t.block[n]] if want_tangent else 0):
            dw = vec(d.w[n, k])
            gyro = add(cross(dw, spin), cross(w, apply(inertia, dw)))
            put(work.dwrench[n, k], 0, scale(m, vec(d.a[n, k])))
            put(work.dwrench[n, k], 3, add(apply(inertia, vec(d.al[n, k])), gyro))


@jit_inner
def add_elements(t, e, f, d, work, moving, want_tangent):
    """Add internal forces of all elements to the wrenches; return -1, or the element that turns too much [rad].

    moving : False where velocities do not count, at rest
    """
    z, energy, power, lost = work.element, 0.0, 0.0, 0.0
    damped = moving and len(e.damping) > 0
    for k in range(len(e.order)):
        count = e.order[k] + 1
        nodes = e.nodes[k]
        for i in range(count):
            put(z.x[i], 0, vec(f.x[nodes[i]]))
            put_block(z.r[i], 0, 0, mat(f.r[nodes[i]]))
        if not relative(count, z) <= LARGEST_TURN:
            return k
        if damped:
            _set_rates(count, nodes, f, work.rates)
            relative_rates(count, z, work.rates)
            stored, gone = damped_gradient(k, count, e, z, work.rates, work.internal[k], want_tangent)
            energy, lost = energy + stored, lost + gone
        else:
            energy += element_gradient(k, count, e, z, work.internal[k], want_tangent)
        nodal_forces(count, z)
        for i in range(count):
            n, force, moment = nodes[i], vec(z.forces[i]), vec_at(z.forces[i], 3)
            add_to(work.wrench[n], 0, force)
            add_to(work.wrench[n], 3, moment)
            power += dot(force, vec(f.v[n])) + dot(moment, vec(f.w[n]))
        if want_tangent:
            if damped:
                damped_tangent(count, z, work.rates, nodes, d, work.tangent[k])
            else:
                element_tangent(count, z, work.tangent[k])
                work.tangent[k, :, 6 * e.nodes.shape[1] :] = 0.0
            _add_diagonal(t, d, nodes, count, work.tangent[k], work.dwrench)
    work.energy[0], work.energy[1], work.energy[2] = energy, power, lost
    return -1


@jit_inner
def _set_rates(count, nodes, f, rates):
    for i in range(count):
        put(rates.v[i], 0, vec(f.v[nodes[i]]))
        put(rates.w[i], 0, vec(f.w[nodes[i]]))


@jit_inner
def _add_diagonal(t, d, nodes, count, tangent, dwrench):
    """Add what each node of an element feels of its own motion (and the root of its block's other unknowns)."""
    root = nodes[0]
    for k in range(t.size[t.block[root]]):
        for i in range(6):
            dwrench[root, k, i] += by_root(tangent, i, root, k, d)
    for node in range(1, count):
        for k in range(6):
            for i in range(6):
                dwrench[nodes[node], k, i] += tangent[6 * node + i, 6 * node + k]


@jit_inner
def by_root(tangent, row, root, k, d):
    """Return how a force of an element varies with unknown k of its root's block, by pose and velocity [N/m], [N], [N m]."""
    by, last = tangent[row], tangent.shape[1] - 6
    felt = dot(vec(by), vec(d.x[root, k])) + dot(vec_at(by, 3), vec(d.t[root, k]))
    if tangent.shape[1] > tangent.shape[0]:
        felt += dot(vec_at(by, last), vec(d.v[root, k])) + dot(vec_at(by, last + 3), vec(d.w[root, k]))
    return felt


@jit_inner
def gather(t, s, f, j, d, loads, work, cv, ca, want_tangent):
    """Bring wrenches of dependent nodes back to their blocks: residual (unknowns,) [N], [N m] and diagonal blocks."""
    for n in range(len(t.parent) - 1, -1, -1):
        b, m = t.block[n], t.parent[n]
        columns = t.size[b] if want_tangent else 0
        if t.independent[n]:
            for i in range(6):
                work.residual[0, t.offset[b] + i] = work.wrench[n, i]
                for k in range(columns):
                    work.diagonal[b, i, k] = work.dwrench[n, k, i]
            continue
        _own_variation(n, t, columns, work)
        if t.freedoms[n] > 0:
            _passive_rows(n, m, b, columns, t, s, f, d, loads, work, cv, ca)
        if m >= 0:
            bring_back(n, m, f, j, work.wrench)
            bring_back_variation(n, m, columns, f, j, d, work.own_x, work.own_t, work.wrench, work.dwrench)


@jit_inner
def _own_variation(n, t, columns, work):
    """Variation of a node's pose in its parent by the joint's own freedoms, others zero."""
    for k in range(columns):
        i = k - t.column[n]
        own = 0 <= i < t.freedoms[n]
        put(work.own_x[k], 0, vec(t.slide[n, i]) if own else NONE)
        put(work.own_t[k], 0, vec(t.turn[n, i]) if own else NONE)


@jit_inner
def _passive_rows(n, m, b, columns, t, s, f, d, loads, work, cv, ca):
    """Residual along passive freedoms: wrench on the axes + rotor, damping, friction and spring of the joint, less its drive."""
    first, diagonal = t.offset[b] + t.column[n], work.diagonal[b]
    frame = mat(f.r[m]) if m >= 0 else UNIT
    force, moment = tapply(frame, vec(work.wrench[n])), vec_at(work.wrench[n], 3)
    inverse, level = inverse_tangent(passive_psi(n, t, s, first)), loads.level[0]
    for i in range(t.freedoms[n]):
        row, slide, turn = t.column[n] + i, vec(t.slide[n, i]), vec(t.turn[n, i])
        rate, soft = s.u[first + i], np.tanh(s.u[first + i] / FRICTION_RATE)
        own = t.rotor[n] * s.du[first + i] + t.damping[n] * rate + t.friction[n] * soft
        own -= level * loads.effort[first + i]
        own += level * t.spring[n] * (s.place[first + i] + s.d[first + i] - t.rest[n])
        work.residual[0, first + i] = dot(slide, force) + dot(turn, moment) + own
        if columns == 0:
            continue
        for k in range(columns):
            dforce = tapply(frame, vec(work.dwrench[n, k]))
            if m >= 0:
                dforce = sub(dforce, cross(vec(d.t[m, k]), force))
            diagonal[row, k] = dot(slide, dforce) + dot(turn, vec_at(work.dwrench[n, k], 3))
        slope = cv * (t.damping[n] + t.friction[n] * (1 - soft * soft) / FRICTION_RATE) + ca * t.rotor[n]
        slope += level * t.spring[n]
        if t.triple[n] >= 0 and i >= t.triple[n]:  # the turn is unit vector number i - triple
            add_to(diagonal[row], t.column[n] + t.triple[n], scale(slope, tapply(inverse, turn)))
        else:
            diagonal[row, row] += slope
