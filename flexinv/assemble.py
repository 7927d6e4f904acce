"""One instant of the march: place all nodes, sum the wrenches on every block, and linearise both.

Residual of a block = inertia + elastic forces - loads on its independent node and along its passive freedoms; zero in motion.
The unknowns' increments are dx (world), theta (own frame) of independent nodes and dq of passive joints; velocities and
accelerations vary with them as the integrator says, dv = cv dx, da = ca dx (`integrate`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from flexinv.beam import element_gradient, element_tangent, nodal_forces_from_gradient, relative
from flexinv.mechanism import Array
from flexinv.rotations import exp3, inverse_tangent3
from flexinv.system import FRICTION_RATE
from flexinv.tree import bring_back, bring_back_variation, carry, carry_variation
from flexinv.vectors import apply3, cross3, dot3, mul3, tapply3


class State(NamedTuple):
    """Unknowns of a step.

    x, r : (nodes, 3), (nodes, 3, 3) pose at the start of the step: of independent nodes in the world, of passive joints
        in the parent's frame; d, u, du : (unknowns,) increment since then, velocity, acceleration [m, rad, s]
    pseudo : (unknowns,) the integrator's auxiliary acceleration at the start of the step
    u0, du0 : (unknowns,) velocity and acceleration at the start of the step
    """

    x: Array
    r: Array
    d: Array
    u: Array
    du: Array
    pseudo: Array
    u0: Array
    du0: Array


class Loads(NamedTuple):
    """Loads on nodes, (nodes, 6) force [N] then moment [N m]: dead ones in the world frame, followers in the node's."""

    dead: Array
    follower: Array


class Work(NamedTuple):
    """Wrenches, residual and linearisation, allocated once.

    wrench : (nodes, 6); dwrench : (nodes, columns, 6); residual : (unknowns,); diagonal : (blocks, columns, columns)
    tangent : (elements, 6 count, 6 count); internal : (elements, points, 6); energy : (2,) elastic energy [J] and power [W]
    hessian, u, psi, gradient, forces, own, first, x, r : scratch of one element
    solved : (elements, rows, columns + 1) eliminated unknowns by those of the element's first block
    """

    wrench: Array
    dwrench: Array
    residual: Array
    diagonal: Array
    tangent: Array
    internal: Array
    energy: Array
    hessian: Array
    u: Array
    psi: Array
    gradient: Array
    forces: Array
    own: Array
    first: Array
    x: Array
    r: Array
    solved: Array


# An element that turns more than this between its first and any other node is too coarse (log is singular at pi).
LARGEST_TURN = 2.5  # [rad]


@njit(cache=True)
def place(t, s, j, f, d, cv, ca):
    """Set motion f and variation d of all nodes from the unknowns s and the prescribed relative motion j [m, rad, s]."""
    for n in range(len(t.parent)):
        columns = t.size[t.block[n]]
        d.x[n, :columns], d.t[n, :columns], d.v[n, :columns] = 0.0, 0.0, 0.0
        d.w[n, :columns], d.a[n, :columns], d.al[n, :columns] = 0.0, 0.0, 0.0
        if t.independent[n]:
            _place_section(n, t.offset[t.block[n]], s, f, d, cv, ca)
        else:
            if t.freedoms[n] > 0:
                _place_passive(n, t, s, j, d, cv, ca)
            carry(n, t.parent[n], f, j)
            carry_variation(n, t.parent[n], columns, f, j, d)


@njit(cache=True)
def _place_section(n, o, s, f, d, cv, ca):
    psi = s.d[o + 3 : o + 6]
    f.x[n] = s.x[n] + s.d[o : o + 3]
    f.r[n] = mul3(s.r[n], exp3(psi))
    f.v[n], f.w[n] = s.u[o : o + 3], s.u[o + 3 : o + 6]
    f.a[n], f.al[n] = s.du[o : o + 3], s.du[o + 3 : o + 6]
    inverse = inverse_tangent3(psi)  # dpsi = H^-1 theta
    for k in range(3):
        d.x[n, k, k], d.v[n, k, k], d.a[n, k, k] = 1.0, cv, ca
        d.t[n, 3 + k, k] = 1.0
        for i in range(3):
            d.w[n, 3 + k, i] = cv * inverse[i, k]
            d.al[n, 3 + k, i] = ca * inverse[i, k]


@njit(cache=True)
def passive_psi(n, t, s, first):
    """Return the rotation vector (3,) [rad] that a passive joint has turned since the start of the step."""
    psi = np.zeros(3)
    for k in range(t.freedoms[n]):
        psi += s.d[first + k] * t.turn[n, k]
    return psi


@njit(cache=True)
def _place_passive(n, t, s, j, d, cv, ca):
    first = t.offset[t.block[n]] + t.column[n]
    psi = passive_psi(n, t, s, first)
    j.p[n], j.r[n] = s.x[n], mul3(s.r[n], exp3(psi))
    j.dp[n], j.ddp[n], j.w[n], j.al[n] = 0.0, 0.0, 0.0, 0.0
    inverse = inverse_tangent3(psi)
    for k in range(t.freedoms[n]):
        column, slide, turn = t.column[n] + k, t.slide[n, k], t.turn[n, k]
        j.p[n] += s.d[first + k] * slide
        j.dp[n] += s.u[first + k] * slide
        j.ddp[n] += s.du[first + k] * slide
        j.w[n] += s.u[first + k] * turn
        j.al[n] += s.du[first + k] * turn
        rate = apply3(inverse, turn) if t.triple[n] >= 0 else turn
        d.x[n, column], d.v[n, column], d.a[n, column] = slide, cv * slide, ca * slide
        d.t[n, column], d.w[n, column], d.al[n, column] = turn, cv * rate, ca * rate


@njit(cache=True)
def node_wrenches(t, f, d, loads, work):
    """Set every node's own wrench P = m (a - g), Q = J al + w x J w, less loads, and its variation [N], [N m]."""
    for n in range(len(t.parent)):
        columns = t.size[t.block[n]]
        m, inertia, w, r = t.mass[n], t.inertia[n], f.w[n], f.r[n]
        spin = apply3(inertia, w)
        moment = apply3(inertia, f.al[n]) + cross3(w, spin)
        push, turn = apply3(r, loads.follower[n, :3]), tapply3(r, loads.dead[n, 3:])
        work.wrench[n, :3] = m * (f.a[n] - t.gravity) - loads.dead[n, :3] - push
        work.wrench[n, 3:] = moment - turn - loads.follower[n, 3:]
        for k in range(columns):
            dw, theta = d.w[n, k], d.t[n, k]
            work.dwrench[n, k, :3] = m * d.a[n, k] - apply3(r, cross3(theta, loads.follower[n, :3]))
            gyro = cross3(dw, spin) + cross3(w, apply3(inertia, dw))
            work.dwrench[n, k, 3:] = apply3(inertia, d.al[n, k]) + gyro + cross3(theta, turn)


@njit(cache=True)
def add_elements(t, e, f, d, work, want_tangent):
    """Add elastic forces of all elements to the wrenches; return -1, or the element that turns too much [rad]."""
    work.energy[:] = 0.0
    for k in range(len(e.order)):
        count = e.order[k] + 1
        nodes = e.nodes[k]
        for i in range(count):
            work.x[i], work.r[i] = f.x[nodes[i]], f.r[nodes[i]]
        if not relative(work.x, work.r, count, work.u, work.psi) <= LARGEST_TURN:
            return k
        work.energy[0] += element_gradient(
            count, e.shape[k], e.slope[k], e.weight[k], e.stiffness[k], e.gamma0[k], e.kappa0[k],
            work.u, work.psi, work.gradient, work.hessian, work.internal[k], want_tangent,
        )  # fmt: skip
        nodal_forces_from_gradient(count, work.r[0], work.u, work.psi, work.gradient, work.forces)
        for i in range(count):
            n = nodes[i]
            work.wrench[n] += work.forces[i]
            work.energy[1] += dot3(work.forces[i, :3], f.v[n]) + dot3(work.forces[i, 3:], f.w[n])
        if want_tangent:
            tangent = work.tangent[k]
            element_tangent(count, work.r[0], work.u, work.psi, work.gradient, work.hessian, work.own, work.first, tangent)
            _add_diagonal(t, d, nodes, count, tangent, work.dwrench)
    return -1


@njit(cache=True)
def _add_diagonal(t, d, nodes, count, tangent, dwrench):
    """Add what each node of an element feels of its own motion (and the root of its block's other unknowns)."""
    root = nodes[0]
    for k in range(t.size[t.block[root]]):
        for i in range(6):
            for q in range(3):
                dwrench[root, k, i] += tangent[i, q] * d.x[root, k, q] + tangent[i, 3 + q] * d.t[root, k, q]
    for node in range(1, count):
        for k in range(6):
            for i in range(6):
                dwrench[nodes[node], k, i] += tangent[6 * node + i, 6 * node + k]


@njit(cache=True)
def gather(t, s, f, j, d, work, cv, ca):
    """Bring wrenches of dependent nodes back to their blocks: residual (unknowns,) [N], [N m] and diagonal blocks."""
    widest = work.dwrench.shape[1]
    own_x, own_t = np.zeros((widest, 3)), np.zeros((widest, 3))
    for n in range(len(t.parent) - 1, -1, -1):
        b, m = t.block[n], t.parent[n]
        columns = t.size[b]
        if t.independent[n]:
            work.residual[t.offset[b] : t.offset[b] + 6] = work.wrench[n]
            for k in range(columns):
                work.diagonal[b, :6, k] = work.dwrench[n, k]
            continue
        own_x[:columns], own_t[:columns] = 0.0, 0.0
        for k in range(t.freedoms[n]):
            own_x[t.column[n] + k], own_t[t.column[n] + k] = t.slide[n, k], t.turn[n, k]
        if t.freedoms[n] > 0:
            _passive_rows(n, m, b, columns, t, s, f, d, work, cv, ca)
        if m >= 0:
            bring_back(n, m, f, j, work.wrench)
            bring_back_variation(n, m, columns, f, j, d, own_x, own_t, work.wrench, work.dwrench)


@njit(cache=True)
def _passive_rows(n, m, b, columns, t, s, f, d, work, cv, ca):
    """Residual along passive freedoms: wrench on the axes + rotor, damping and friction of the joint itself."""
    first = t.offset[b] + t.column[n]
    force = work.wrench[n, :3] if m < 0 else tapply3(f.r[m], work.wrench[n, :3])
    inverse = inverse_tangent3(passive_psi(n, t, s, first))
    for i in range(t.freedoms[n]):
        row, slide, turn = t.column[n] + i, t.slide[n, i], t.turn[n, i]
        rate, soft = s.u[first + i], np.tanh(s.u[first + i] / FRICTION_RATE)
        own = t.rotor[n] * s.du[first + i] + t.damping[n] * rate + t.friction[n] * soft
        work.residual[first + i] = dot3(slide, force) + dot3(turn, work.wrench[n, 3:]) + own
        for k in range(columns):
            dforce = work.dwrench[n, k, :3]
            if m >= 0:
                dforce = tapply3(f.r[m], dforce) - cross3(d.t[m, k], force)
            work.diagonal[b, row, k] = dot3(slide, dforce) + dot3(turn, work.dwrench[n, k, 3:])
        slope = cv * (t.damping[n] + t.friction[n] * (1 - soft * soft) / FRICTION_RATE) + ca * t.rotor[n]
        if t.triple[n] >= 0 and i >= t.triple[n]:
            for k in range(3):
                work.diagonal[b, row, t.column[n] + t.triple[n] + k] += slope * inverse[i - t.triple[n], k]
        else:
            work.diagonal[b, row, row] += slope
