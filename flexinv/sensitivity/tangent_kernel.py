"""Tangents of the march: derivatives of poses, rates and accelerations by parameters, step by step (compiled).

Where a step ends its residual is zero, r(y, u, u', p) = 0, for any value of a parameter p.  Its derivative is

    K dy + C du + M du' = -dr/dp                                           (`dynamics.linearization`)

With the generalised-alpha scheme du and du' follow from dy, the derivative of the increment of the pose over the step:

    dA  = (dd - h du_n - h^2 (1/2 - beta) dA_n) / (h^2 beta)
    du  = du_n + h (1 - gamma) dA_n + h gamma dA
    du' = ((1 - alpha_m) dA + alpha_m dA_n - alpha_f du'_n) / (1 - alpha_f)

and rotations R_n exp(d) move by  exp(-d) dy_n + H(d) dd  in their own frame.  So every step is one linear system

    (K + (cv C + ca M) H^-1) y = -(K dy* + C du* + M du'* + dr/dp)          * : with dd = 0

for all parameters at once.  Rows of joints with a motion give the derivatives of their efforts.
"""

from __future__ import annotations

from typing import NamedTuple

from flexinv.dynamics.linearization import LARGE_FACTOR, fill_sparse_entries, make_weighted_scheme
from flexinv.dynamics.loads import update_loads
from flexinv.dynamics.stepper import evaluate
from flexinv.kernels.dense import solve_dense
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.so3 import exp, inverse_tangent
from flexinv.kernels.vec3 import add, apply, cross, mat, put, put_block, tapply, vec
from flexinv.kinematics.tree import Joints
from flexinv.typing import Array, Indices


@send_by_address
class MarchStates(NamedTuple):
    """States along a march, with all joints as unknowns.

    x, r : (samples, nodes, 3), (samples, nodes, 3, 3) as `dynamics.system.State`; u, du, place : (samples, unknowns) [m, rad, s]
    joints : relative motion of all nodes; table : (samples, loads, 6) given wrenches [N], [N m]
    """

    x: Array
    r: Array
    u: Array
    du: Array
    place: Array
    joints: Joints
    table: Array


@send_by_address
class StepTurns(NamedTuple):
    """Rotations among the unknowns over each step.

    at : (unknowns,) row of a rotation's first entry in the unknowns, -1 of no rotation; number : (unknowns,) of the rotation
    first : (rotations,) first unknown of each; vector : (samples, rotations, 3) d [rad]
    inverse : (rotations, 3, 3) H(d)^-1 of the present step
    """

    at: Indices
    number: Indices
    first: Indices
    vector: Array
    inverse: Array


@send_by_address
class ParameterInputs(NamedTuple):
    """Effects of parameters from outside.

    given : (3, samples, joints, parameters) derivatives of prescribed unknowns, their rates and accelerations
    pushed : (samples, unknowns, columns) dr/dp of the parameters ``column`` (columns,), and shifted : (samples, tips, 3, columns)
        by how much they move tips, at given unknowns [any unit]
    """

    given: Array
    pushed: Array
    shifted: Array
    column: Indices


@send_by_address
class TipNodes(NamedTuple):
    """Tips of links: node (tips,), and place (tips, 3) in its frame [m]."""

    node: Indices
    place: Array


@send_by_address
class MarchedFreedoms(NamedTuple):
    """Prescribed unknowns (joints,), those that are marched (marched,), and the place of each among the latter, -1 without."""

    prescribed: Indices
    marched: Indices
    order: Indices


@send_by_address
class TangentTask(NamedTuple):
    """A march to be differentiated: its states, turns of its steps, effects of parameters, unknowns and tips."""

    states: MarchStates
    turns: StepTurns
    inputs: ParameterInputs
    freedoms: MarchedFreedoms
    tips: TipNodes


@send_by_address
class StepTangents(NamedTuple):
    """Derivatives (unknowns, parameters) of pose, rate, acceleration and the integrator's own acceleration [any unit]."""

    pose: Array
    rate: Array
    acceleration: Array
    pseudo: Array


@send_by_address
class TangentScratch(NamedTuple):
    """Entries of the linearisation, and the linear system of a step [any unit].

    at : (2, entries) places of the entries of K, stiffness : (entries,) of K
    massive_at : (2, massive entries) places of those of C and M, massive : (3, massive entries), the first row a reference
    system : (marched, marched + parameters); forces : (unknowns, parameters) of the residual
    """

    at: Indices
    stiffness: Array
    massive_at: Indices
    massive: Array
    system: Array
    forces: Array


@send_by_address
class TangentHistories(NamedTuple):
    """Derivatives over the samples [any unit].

    effort : (samples, joints, parameters) of those with a motion; tip : (samples, tips, 3, parameters)
    pose : (samples, unknowns, parameters)
    """

    effort: Array
    tip: Array
    pose: Array


@send_by_address
class ForceRecord(NamedTuple):
    """Forces and places at every sample: residual (samples, unknowns) [N], [N m], and tips (samples, tips, 3) [m]."""

    residual: Array
    tip: Array


@jit
def integrate_tangents(system, massive, task, scheme, tangents, scratch, out, record):
    """Fill the histories of derivatives [any unit] from the tangents of the first sample on, which are changed.

    massive : the system, without its elements where these are not damped: C and M are those of nodes and joints alone
    Without room for entries in the scratch nothing is marched: the record of forces alone is filled.
    Return -1, or the sample in which an element turned too much.
    """
    marches = len(scratch.stiffness) > 0
    inputs = task.inputs
    freedoms = task.freedoms
    for k in range(task.states.x.shape[0]):
        if _compute_matrices(system, massive, task.states, k, scratch, marches) >= 0:
            return k
        if not marches:
            _write_forces(system, task.tips, k, record)
            continue
        if k > 0:
            _move_tangents(task.turns, scheme, k, tangents)
        _take_inputs(inputs, freedoms, k, tangents)
        _compute_forces(inputs, k, tangents, scratch)
        if k > 0:
            _solve_step(task.turns, freedoms, scheme, tangents, scratch)
            _update_tangents(task.turns, freedoms, scheme, tangents, scratch)
            _compute_forces(inputs, k, tangents, scratch)
        _write_sample(freedoms, k, tangents, scratch, out)
        _write_tips(system, task.tips, inputs, k, tangents, out)
    return -1


@jit_inner
def _compute_matrices(system, massive, states, k, scratch, marches):
    """Set the residual at sample k and, if the tangents are marched, the entries of K, C and M.

    Return -1 or the element that turned too much.
    """
    rel = states.joints
    joints = Joints(rel.p[k], rel.dp[k], rel.ddp[k], rel.r[k], rel.w[k], rel.al[k])
    _fill_state(system, states, k)
    for stage in range(4 if marches else 1):
        which = max(stage - 1, 0)
        present = system if stage == 0 else massive
        bad = evaluate(present, make_weighted_scheme(which), joints, True)
        if bad >= 0:
            return bad
        if marches and stage == 0:
            fill_sparse_entries(present, scratch.at, scratch.stiffness)
        elif stage > 0:
            fill_sparse_entries(present, scratch.massive_at, scratch.massive[which])
    for which in range(1, 3 if marches else 1):
        for e in range(scratch.massive.shape[1]):
            scratch.massive[which, e] = (scratch.massive[which, e] - scratch.massive[0, e]) / LARGE_FACTOR
    return -1


@jit_inner
def _write_forces(system, tips, k, record):
    """Write residual and tips of a sample."""
    for i in range(record.residual.shape[1]):
        record.residual[k, i] = system.work.residual[0, i]
    for i in range(len(tips.node)):
        n = tips.node[i]
        put(record.tip[k, i], 0, add(vec(system.frames.x[n]), apply(mat(system.frames.r[n]), vec(tips.place[i]))))


@jit_inner
def _fill_state(system, states, k):
    """Put the system where it was at sample k [m, rad, s], with the loads of then [N], [N m]."""
    state = system.state
    for n in range(states.x.shape[1]):
        put(state.x[n], 0, vec(states.x[k, n]))
        put_block(state.r[n], 0, 0, mat(states.r[k, n]))
    for i in range(states.u.shape[1]):
        state.u[i] = states.u[k, i]
        state.du[i] = states.du[k, i]
        state.place[i] = states.place[k, i]
        state.d[i] = 0.0
    update_loads(system.loads, states.table[k], states.u[0, :0])


@jit_inner
def _move_tangents(turns, scheme, k, tangents):
    """Carry the tangents over a step with dd = 0."""
    h = scheme.h
    beta = scheme.beta
    gamma = scheme.gamma
    am = scheme.alpha_m
    af = scheme.alpha_f
    pose = tangents.pose
    rate = tangents.rate
    acceleration = tangents.acceleration
    pseudo = tangents.pseudo
    for i in range(pose.shape[0]):
        for p in range(pose.shape[1]):
            before = pseudo[i, p]
            later = -(rate[i, p] + h * (0.5 - beta) * before) / (h * beta)
            rate[i, p] += h * ((1 - gamma) * before + gamma * later)
            acceleration[i, p] = ((1 - am) * later + am * before - af * acceleration[i, p]) / (1 - af)
            pseudo[i, p] = later
    for t in range(len(turns.first)):
        o = turns.first[t]
        turned = exp(vec(turns.vector[k, t]))
        put_block(turns.inverse[t], 0, 0, inverse_tangent(vec(turns.vector[k, t])))
        for p in range(pose.shape[1]):
            back = tapply(turned, (pose[o, p], pose[o + 1, p], pose[o + 2, p]))
            pose[o, p], pose[o + 1, p], pose[o + 2, p] = back


@jit_inner
def _take_inputs(inputs, freedoms, k, tangents):
    """Give prescribed unknowns the derivatives that they have."""
    for j in range(len(freedoms.prescribed)):
        i = freedoms.prescribed[j]
        for p in range(tangents.pose.shape[1]):
            tangents.pose[i, p] = inputs.given[0, k, j, p]
            tangents.rate[i, p] = inputs.given[1, k, j, p]
            tangents.acceleration[i, p] = inputs.given[2, k, j, p]


@jit_inner
def _compute_forces(inputs, k, tangents, scratch):
    """Set the forces K dy + C du + M du' + dr/dp [N], [N m] per unit of each parameter."""
    forces = scratch.forces
    for i in range(forces.shape[0]):
        for p in range(forces.shape[1]):
            forces[i, p] = 0.0
        for q in range(len(inputs.column)):
            forces[i, inputs.column[q]] += inputs.pushed[k, i, q]
    for e in range(len(scratch.stiffness)):
        if scratch.stiffness[e] != 0.0:
            _add_product(forces[scratch.at[0, e]], scratch.stiffness[e], tangents.pose[scratch.at[1, e]])
    for e in range(scratch.massive.shape[1]):
        i = scratch.massive_at[0, e]
        j = scratch.massive_at[1, e]
        if scratch.massive[1, e] != 0.0:
            _add_product(forces[i], scratch.massive[1, e], tangents.rate[j])
        if scratch.massive[2, e] != 0.0:
            _add_product(forces[i], scratch.massive[2, e], tangents.acceleration[j])


@jit_inner
def _add_product(row, factor, other):
    """Add a multiple of another row to a row [any unit]."""
    for p in range(len(row)):
        row[p] += factor * other[p]


@jit_inner
def _solve_step(turns, freedoms, scheme, tangents, scratch):
    """Solve the linear system of a step; its solutions stay in the last columns of the scratch."""
    system = scratch.system
    size = len(freedoms.marched)
    wide = size + tangents.pose.shape[1]
    for r in range(size):
        for c in range(size):
            system[r, c] = 0.0
        for c in range(size, wide):
            system[r, c] = -scratch.forces[freedoms.marched[r], c - size]
    for e in range(len(scratch.stiffness)):
        r = freedoms.order[scratch.at[0, e]]
        c = freedoms.order[scratch.at[1, e]]
        if r >= 0 and c >= 0:
            system[r, c] += scratch.stiffness[e]
    for e in range(scratch.massive.shape[1]):
        r = freedoms.order[scratch.massive_at[0, e]]
        j = scratch.massive_at[1, e]
        moved = scheme.cv * scratch.massive[1, e] + scheme.ca * scratch.massive[2, e]
        if r < 0 or freedoms.order[j] < 0 or moved == 0.0:
            continue
        o = turns.at[j]
        if o < 0:
            system[r, freedoms.order[j]] += moved
        else:
            inverse = turns.inverse[turns.number[j]]
            for b in range(3):
                system[r, freedoms.order[o + b]] += moved * inverse[j - o, b]
    solve_dense(system, size, wide)


@jit_inner
def _update_tangents(turns, freedoms, scheme, tangents, scratch):
    """Add what the solution of a step moves to the tangents of pose, rate and acceleration."""
    size = len(freedoms.marched)
    over = 1.0 / (scheme.h * scheme.h * scheme.beta)
    parameters = tangents.pose.shape[1]
    for r in range(size):
        i = freedoms.marched[r]
        o = turns.at[i]
        for p in range(parameters):
            y = scratch.system[r, size + p]
            d = y
            if o >= 0:
                inverse = turns.inverse[turns.number[i]]
                d = 0.0
                for b in range(3):
                    d += inverse[i - o, b] * scratch.system[freedoms.order[o + b], size + p]
            tangents.pose[i, p] += y
            tangents.rate[i, p] += scheme.cv * d
            tangents.acceleration[i, p] += scheme.ca * d
            tangents.pseudo[i, p] += over * d


@jit_inner
def _write_sample(freedoms, k, tangents, scratch, out):
    """Write the derivatives of a sample into the histories, as far as these have room."""
    for p in range(tangents.pose.shape[1]):
        for j in range(len(freedoms.prescribed)):
            out.effort[k, j, p] = scratch.forces[freedoms.prescribed[j], p]
        for i in range(tangents.pose.shape[0]):
            out.pose[k, i, p] = tangents.pose[i, p]


@jit_inner
def _write_tips(system, tips, inputs, k, tangents, out):
    """Write the derivatives of the tips of a sample: dx = dx_n + R_n (theta x place), and what parameters shift beside."""
    topology = system.topology
    variation = system.variation
    for i in range(len(tips.node)):
        n = tips.node[i]
        o = topology.offset[topology.block[n]]
        turned = mat(system.frames.r[n])
        place = vec(tips.place[i])
        for a in range(3):
            for p in range(tangents.pose.shape[1]):
                out.tip[k, i, a, p] = 0.0
            for q in range(len(inputs.column)):
                out.tip[k, i, a, inputs.column[q]] += inputs.shifted[k, i, a, q]
        for c in range(topology.size[topology.block[n]]):
            moved = add(vec(variation.x[n, c]), apply(turned, cross(vec(variation.t[n, c]), place)))
            for a in range(3):
                if moved[a] != 0.0:
                    _add_product(out.tip[k, i, a], moved[a], tangents.pose[o + c])
