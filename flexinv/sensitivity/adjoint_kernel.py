"""Adjoint of the march: derivatives of one number by everything that enters it, in one march backwards (compiled).

`tangent_kernel` gives dy, du, du' of a step from those of the step before, line by line, and each line is linear.  Read backwards
they carry costates, the derivatives of the number by pose, rate, acceleration and the integrator's own acceleration A:

    S^T mu + G^T nu = Y + H^-T (cv V + ca W + P / (h^2 beta)),   G mu = 0       by forces -mu, by what closures are open -nu
    Y += -K^T mu - G^T nu,   V += -C^T mu,   W += -M^T mu
    P* = P + h gamma V + (1 - alpha_m)/(1 - alpha_f) W
    P_n = h (1 - gamma) V + alpha_m/(1 - alpha_f) W - (1/2 - beta)/beta P*
    V_n = V - P*/(h beta),   W_n = -alpha_f/(1 - alpha_f) W,   Y_n = exp(d) Y

Y, V, W, P : costates of pose, rate, acceleration and A.  Costates of joints with a motion are the derivatives by that motion.
Accelerations of index 1, which are shown where closures act, are a system of the same form with N in place of S.
"""

from __future__ import annotations

from typing import NamedTuple

from flexinv.dynamics.constraint_rows import PULL, REDUNDANT_PIVOT, has_acting_closure
from flexinv.kernels.dense import factorise_blocks, solve_blocks, solve_dense
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.so3 import exp, inverse_tangent
from flexinv.kernels.vec3 import add, apply, cross, dot, mat, put_mat, vec
from flexinv.kinematics.tree import take_joints
from flexinv.sensitivity.border_tangents import begin_border, fill_rate_slopes
from flexinv.sensitivity.projected_masses import assemble_masses
from flexinv.sensitivity.tangent_kernel import (
    compute_march_matrices,
    fill_march_state,
    fill_step_matrix,
    update_stiffness,
)
from flexinv.sensitivity.tangent_records import GIVEN, MARCHED, OUT_OF_PLANE
from flexinv.typing import Array


@send_by_address
class Seeds(NamedTuple):
    """Derivatives of a number by results of a march, over its samples [any unit].

    effort : (samples, joints) of those with a motion; tip : (samples, tips, 3); pose : (samples, unknowns)
    """

    effort: Array
    tip: Array
    pose: Array


@send_by_address
class Costates(NamedTuple):
    """Derivatives (unknowns,) of a number by pose, rate, acceleration and the integrator's own acceleration [any unit].

    shown : by accelerations of index 1; factors : (unknowns,) and pulls, opening : (rows,) scratch; ones : (unknowns, 1)
    """

    pose: Array
    rate: Array
    acceleration: Array
    pseudo: Array
    shown: Array
    factors: Array
    pulls: Array
    opening: Array
    ones: Array


@send_by_address
class InputSlopes(NamedTuple):
    """Derivatives of a number by what enters a march [any unit].

    given : (3, samples, joints) by prescribed unknowns, their rates and accelerations
    pushed : (2, samples, unknowns) by forces at the march's accelerations and at those that are shown
    opened : (2, samples, rows) by what closures are open, and by the second rate of that
    """

    given: Array
    pushed: Array
    opened: Array


@jit
def integrate_adjoint(system, massive, task, scheme, seeds, costates, scratch, out):
    """March the costates [any unit] of the last sample back to the first, and fill the derivatives by what enters.

    Return -1, or the sample in which an element turned too much.
    """
    projects = has_acting_closure(system.border.ties)
    roles = task.freedoms.role
    for k in range(task.states.x.shape[0] - 1, -1, -1):
        if compute_march_matrices(system, massive, task.states, k, scratch, 4) >= 0:
            return k
        _add_pose_seeds(system, task.tips, seeds, k, costates)
        if projects:
            if _resolve_shown_accelerations(system, massive, task, k, seeds, costates, scratch, out) >= 0:
                return k
        else:
            _take_effort_seeds(task.freedoms, seeds.effort[k], costates.factors)
            _add_force_costates(roles, (GIVEN, 0), costates, costates.acceleration, scratch)
            _write_factors(roles, GIVEN, costates.factors, out.pushed[0, k])
        if k > 0:
            _resolve_step(system, task, k, scheme, costates, scratch)
            _add_force_costates(roles, (MARCHED, 0), costates, costates.acceleration, scratch)
            _add_closing_costates(scratch.border, costates.opening, costates.pose)
            _write_factors(roles, MARCHED, costates.factors, out.pushed[0, k])
            for r in range(len(costates.opening)):
                out.opened[0, k, r] = costates.opening[r]
        _take_out_inputs(task.freedoms, k, costates, out)
        if k > 0:
            _move_costates(task.turns, scheme, k, costates)
    return -1


@jit_inner
def _add_pose_seeds(system, tips, seeds, k, costates):
    """Add to the costates of poses what poses and tips are worth: x = x_n + R_n place."""
    topology = system.topology
    variation = system.variation
    for i in range(len(costates.pose)):
        costates.pose[i] += seeds.pose[k, i]
    for i in range(len(tips.node)):
        weight = vec(seeds.tip[k, i])
        if weight[0] == 0.0 and weight[1] == 0.0 and weight[2] == 0.0:
            continue
        n = tips.node[i]
        turned = mat(system.frames.r[n])
        for c in range(topology.width[n]):
            moved = add(vec(variation.x[n, c]), apply(turned, cross(vec(variation.t[n, c]), vec(tips.place[i]))))
            costates.pose[topology.first[n] + c] += dot(moved, weight)


@jit_inner
def _take_effort_seeds(freedoms, seed, factors):
    """Put what efforts are worth into the rows of the joints with a motion."""
    for j in range(len(freedoms.prescribed)):
        factors[freedoms.prescribed[j]] = seed[j]


@jit_inner
def _add_force_costates(roles, wanted, costates, accelerations, scratch):
    """Add K^T f, C^T f and M^T f of the rows of a role to costates; accelerations : costates of the march's or the shown ones.

    wanted : the role, and 1 where K is that at accelerations of index 1
    """
    role, which = wanted
    factors = costates.factors
    for e in range(len(scratch.stiffness)):
        i = scratch.at[0, e]
        j = scratch.at[1, e]
        if roles[i] == role and roles[j] != OUT_OF_PLANE:
            costates.pose[j] += scratch.stiffness[e] * factors[i]
    for e in range(scratch.massive.shape[1]):
        i = scratch.massive_at[0, e]
        j = scratch.massive_at[1, e]
        if roles[i] == role and roles[j] != OUT_OF_PLANE:
            costates.rate[j] += scratch.massive[1, e] * factors[i]
            accelerations[j] += scratch.massive[2, e] * factors[i]
            if which == 1:
                costates.pose[j] += scratch.massive[3, e] * factors[i]
    bent = scratch.border.bent
    dragged = scratch.border.dragged
    for i in range(bent.shape[0]):
        for j in range(bent.shape[1] if roles[i] == role else 0):
            costates.pose[j] += bent[i, j] * factors[i]
            costates.rate[j] += dragged[i, j] * factors[i]


@jit_inner
def _add_closing_costates(border, opening, moves):
    """Add G^T times the derivatives by what closures are open to the costates of moves."""
    for r in range(len(opening)):
        for i in range(border.gradient.shape[1]):
            moves[i] += border.gradient[r, i] * opening[r]


@jit_inner
def _write_factors(roles, role, factors, out):
    """Write the derivatives by forces in the rows of a role."""
    for i in range(len(factors)):
        if roles[i] == role:
            out[i] = factors[i]


@jit_inner
def _resolve_step(system, task, k, scheme, costates, scratch):
    """Set the derivatives of the number by the forces and by what closures are open in a step."""
    freedoms = task.freedoms
    turns = task.turns
    border = scratch.border
    whole = scratch.system
    size = len(freedoms.marched)
    for t in range(len(turns.first)):
        put_mat(turns.inverse[t], inverse_tangent(vec(turns.vector[k, t])))
    for c in range(border.gradient.shape[0]):
        costates.pulls[c] = 0.0
        for i in range(border.gradient.shape[1]):
            border.across[c, i] = border.gradient[c, i]
    for r in range(size):
        whole[r, :size] = 0.0
    fill_step_matrix(turns, freedoms, scheme, scratch)
    for r in range(size):
        whole[r, size] = costates.pose[freedoms.marched[r]]
    _add_increment_costates(freedoms, turns, scheme, costates, whole)
    _solve_adjoint(system.border.ties, freedoms, border, costates, whole)


@jit_inner
def _add_increment_costates(freedoms, turns, scheme, costates, whole):
    """Add to the right side what increments dd = H^-1 z are worth by rates and accelerations."""
    size = len(freedoms.marched)
    over = 1.0 / (scheme.h * scheme.h * scheme.beta)
    for r in range(size):
        i = freedoms.marched[r]
        worth = scheme.cv * costates.rate[i] + scheme.ca * costates.acceleration[i] + over * costates.pseudo[i]
        o = turns.at[i]
        if o < 0:
            whole[r, size] += worth
            continue
        inverse = turns.inverse[turns.number[i]]
        for b in range(3):
            if freedoms.order[o + b] >= 0:
                whole[freedoms.order[o + b], size] += inverse[i - o, b] * worth


@jit_inner
def _solve_adjoint(ties, freedoms, border, costates, whole):
    """Solve A^T mu + G^T nu = right side, B mu = -pulls; the factors are -mu of marched rows, the opening -nu.

    whole : A (marched, marched), the right side, and room for G^T; B (rows, unknowns) is ``border.across``
    """
    size = len(freedoms.marched)
    rows = border.gradient.shape[0]
    factors = costates.factors
    for r in range(rows):
        costates.opening[r] = 0.0
    if size == 0:
        return
    _turn_over(size, whole)
    for r in range(size):
        for c in range(rows):
            whole[r, size + 1 + c] = border.gradient[c, freedoms.marched[r]]
    solve_dense(whole, size, size + 1 + rows)
    for r in range(size):
        factors[freedoms.marched[r]] = -whole[r, size]
    if rows == 0:
        return
    for r in range(rows):
        for c in range(rows):
            ties.border[r, c] = _compute_product(freedoms, border.across[r], whole, size + 1 + c)
    factorise_blocks(ties.border, ties.layout.whole, REDUNDANT_PIVOT, ties.pivots)
    for r in range(rows):
        left = costates.pulls[r] + _compute_product(freedoms, border.across[r], whole, size)
        ties.value[r] = left if ties.kind[r] != PULL else 0.0
    solve_blocks(ties.border, ties.layout.whole, ties.pivots, ties.value, ties.step)
    for r in range(rows):
        costates.opening[r] = -ties.step[r]
        for i in range(size):
            factors[freedoms.marched[i]] += ties.step[r] * whole[i, size + 1 + r]


@jit_inner
def _turn_over(size, whole):
    """Transpose the first rows and columns in place."""
    for r in range(size):
        for c in range(r):
            upper = whole[c, r]
            whole[c, r] = whole[r, c]
            whole[r, c] = upper


@jit_inner
def _compute_product(freedoms, row, whole, column):
    """The product of a row over the marched unknowns and a solved column."""
    total = 0.0
    for i in range(len(freedoms.marched)):
        total += row[freedoms.marched[i]] * whole[i, column]
    return total


@jit_inner
def _resolve_shown_accelerations(system, massive, task, k, seeds, costates, scratch, out):
    """Carry costates of efforts and of accelerations of index 1 on to those of the march; return -1 or a bad element."""
    freedoms = task.freedoms
    roles = freedoms.role
    border = scratch.border
    bad = update_stiffness(massive, task.shown, k, scratch)
    if bad >= 0:
        return bad
    fill_rate_slopes(system, take_joints(task.shown.joints, k), border)
    _take_effort_seeds(freedoms, seeds.effort[k], costates.factors)
    _add_force_costates(roles, (GIVEN, 1), costates, costates.shown, scratch)
    _write_factors(roles, GIVEN, costates.factors, out.pushed[1, k])
    _solve_shown(system, task, seeds.effort[k], costates, scratch)
    _add_force_costates(roles, (MARCHED, 1), costates, costates.shown, scratch)
    _add_closing_costates(border, costates.opening, costates.shown)
    _write_factors(roles, MARCHED, costates.factors, out.pushed[1, k])
    for r in range(len(costates.opening)):
        out.opened[1, k, r] = costates.opening[r]
        for i in range(len(costates.pose)):
            costates.pose[i] += border.by_pose[r, i] * costates.opening[r]
            costates.rate[i] += border.by_rate[r, i] * costates.opening[r]
    for i in range(len(costates.shown)):
        if roles[i] == GIVEN:
            costates.acceleration[i] += costates.shown[i]
        costates.shown[i] = 0.0
    fill_march_state(system, task.states, k)
    begin_border(system, border)
    return -1


@jit_inner
def _solve_shown(system, task, seed, costates, scratch):
    """Set the derivatives of the number by the forces and by the second rates of closures at accelerations of index 1.

    Motions without inertia keep what they have in the march (`projected_masses`), in a plane in place of their balance.
    """
    freedoms = task.freedoms
    border = scratch.border
    whole = scratch.system
    size = len(freedoms.marched)
    rows = border.gradient.shape[0]
    for r in range(size):
        whole[r, : size + 1] = 0.0
        for c in range(rows):
            whole[r, size + 1 + c] = border.gradient[c, freedoms.marched[r]]
    assemble_masses(system.topology, task, scratch, costates.ones)
    held = border.left[size]
    for r in range(size):
        held[r] = whole[r, size]
        whole[r, size] = costates.shown[freedoms.marched[r]]
        for c in range(rows):
            border.across[c, freedoms.marched[r]] = whole[r, size + 1 + c]
    for c in range(rows):
        costates.pulls[c] = 0.0
        for j in range(len(freedoms.prescribed)):
            costates.pulls[c] -= border.gradient[c, freedoms.prescribed[j]] * seed[j]
    _solve_adjoint(system.border.ties, freedoms, border, costates, whole)
    for r in range(size):
        i = freedoms.marched[r]
        costates.acceleration[i] -= held[r] * costates.factors[i]
        if held[r] != 0.0 and task.flat:
            costates.factors[i] = 0.0


@jit_inner
def _take_out_inputs(freedoms, k, costates, out):
    """Give out the costates of joints with a motion, whose derivatives are given."""
    for j in range(len(freedoms.prescribed)):
        i = freedoms.prescribed[j]
        out.given[0, k, j] = costates.pose[i]
        out.given[1, k, j] = costates.rate[i]
        out.given[2, k, j] = costates.acceleration[i]
        costates.pose[i] = 0.0
        costates.rate[i] = 0.0
        costates.acceleration[i] = 0.0
        costates.pseudo[i] = 0.0


@jit_inner
def _move_costates(turns, scheme, k, costates):
    """Carry the costates back over a step with dd = 0."""
    h = scheme.h
    beta = scheme.beta
    gamma = scheme.gamma
    am = scheme.alpha_m
    af = scheme.alpha_f
    for i in range(len(costates.pose)):
        rate = costates.rate[i]
        acceleration = costates.acceleration[i]
        later = costates.pseudo[i] + h * gamma * rate + (1 - am) / (1 - af) * acceleration
        costates.pseudo[i] = h * (1 - gamma) * rate + am / (1 - af) * acceleration - (0.5 - beta) / beta * later
        costates.rate[i] = rate - later / (h * beta)
        costates.acceleration[i] = -af / (1 - af) * acceleration
    for t in range(len(turns.first)):
        o = turns.first[t]
        turned = exp(vec(turns.vector[k, t]))
        back = apply(turned, (costates.pose[o], costates.pose[o + 1], costates.pose[o + 2]))
        costates.pose[o], costates.pose[o + 1], costates.pose[o + 2] = back
