"""Tangents of the march: derivatives of poses, rates and accelerations by parameters, step by step (compiled).

Where a step ends its residual is zero, r(y, u, u', p) = 0, for any value of a parameter p.  Its derivative is

    K dy + C du + M du' = -dr/dp                                           (`dynamics.linearization`)

With the generalised-alpha scheme du and du' follow from dy, the derivative of the increment of the pose over the step:

    dA  = (dd - h du_n - h^2 (1/2 - beta) dA_n) / (h^2 beta)
    du  = du_n + h (1 - gamma) dA_n + h gamma dA
    du' = ((1 - alpha_m) dA + alpha_m dA_n - alpha_f du'_n) / (1 - alpha_f)

and rotations R_n exp(d) move by  exp(-d) dy_n + H(d) dd  in their own frame.  So every step is one linear system

    (K + (cv C + ca M) H^-1) y = -(K dy* + C du* + M du'* + dr/dp)          * : with dd = 0

for all parameters at once.  Rows of joints with a motion give the derivatives of their efforts.  Closures and springs between
points take part as `border_tangents` says; what closures act on is shown with accelerations of index 1, and so differentiated.
"""

from __future__ import annotations

from flexinv.dynamics.constraint_rows import PULL, evaluate_ties, has_acting_closure
from flexinv.dynamics.linearization import LARGE_FACTOR, fill_sparse_entries, make_weighted_scheme, move_system_to
from flexinv.dynamics.stepper import evaluate, write_sample
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.so3 import exp, inverse_tangent
from flexinv.kernels.vec3 import add, apply, cross, mat, put, put_mat, tapply, vec
from flexinv.kinematics.tree import take_joints
from flexinv.sensitivity.border_tangents import (
    add_border_forces,
    apply_spring_forces,
    begin_border,
    fill_closing,
    fill_drags,
    fill_rate_slopes,
    solve_closed,
    take_off_multipliers,
)
from flexinv.sensitivity.projected_masses import assemble_masses
from flexinv.sensitivity.tangent_records import GIVEN, MARCHED, OUT_OF_PLANE


@jit
def integrate_tangents(system, massive, task, scheme, tangents, scratch, out, record):
    """Fill the histories of derivatives [any unit] from the tangents of the first sample on, which are changed.

    massive : the system, without its elements where these are not damped: C and M are those of nodes and joints alone
    With room in the record nothing is marched: forces are recorded.
    Return -1, or the sample in which an element turned too much.
    """
    inputs = task.inputs
    freedoms = task.freedoms
    projects = has_acting_closure(system.border.ties)
    for k in range(task.states.x.shape[0]):
        if len(record.residual) > 0:
            if _write_record(system, massive, task, k, scratch, record) >= 0:
                return k
            continue
        if compute_march_matrices(system, massive, task.states, k, scratch, 4) >= 0:
            return k
        if k > 0:
            _move_tangents(task.turns, scheme, k, tangents)
        _take_inputs(inputs, freedoms, k, tangents)
        if k > 0:
            _compute_forces(task, k, (0, MARCHED), tangents, tangents.acceleration, scratch)
            fill_closing(inputs.opened[0, k], inputs.column, scratch.border, tangents.pose)
            _solve_step(system, task.turns, freedoms, scheme, tangents, scratch)
            _update_tangents(task.turns, freedoms, scheme, tangents, scratch)
        if not projects:
            _compute_forces(task, k, (0, GIVEN), tangents, tangents.acceleration, scratch)
        elif _update_shown_accelerations(system, massive, task, k, tangents, scratch) >= 0:
            return k
        _write_sample(freedoms, k, tangents, scratch, out)
        if len(out.rate) > 0:
            _write_rates(projects, k, tangents, scratch, out)
        _write_tips(system, task.tips, inputs, k, tangents, out)
    return -1


@jit_inner
def compute_march_matrices(system, massive, states, k, scratch, stages):
    """Set the residual at sample k and the entries of K (one stage), of C and M, too (four), or none of them (zero) [any unit].

    Return -1 or the element that turned too much.
    """
    joints = take_joints(states.joints, k)
    fill_march_state(system, states, k)
    for stage in range(max(stages, 1)):
        which = max(stage - 1, 0)
        present = system if stage == 0 else massive
        bad = evaluate(present, make_weighted_scheme(which), joints, True)
        if bad >= 0:
            return bad
        if stages > 0 and stage == 0:
            fill_sparse_entries(present, scratch.at, scratch.stiffness)
            begin_border(present, scratch.border)
        elif stage > 0:
            fill_sparse_entries(present, scratch.massive_at, scratch.massive[which])
        if stage == 2:
            fill_drags(present, scratch.border)
    for which in range(1, 3 if stages > 1 else 1):
        for e in range(scratch.massive.shape[1]):
            scratch.massive[which, e] = (scratch.massive[which, e] - scratch.massive[0, e]) / LARGE_FACTOR
    return -1


@jit_inner
def _write_record(system, massive, task, k, scratch, record):
    """Write residual and tips of a sample, closures and springs, and slopes where there is room for them.

    Springs pull as they must where the system stands.  Return -1 or the element that turned too much.
    """
    joints = take_joints(task.states.joints, k)
    ties = system.border.ties
    bad = compute_march_matrices(system, massive, task.states, k, scratch, 0)
    if bad < 0 and apply_spring_forces(ties):
        bad = evaluate(system, make_weighted_scheme(0), joints, True)
    if bad >= 0:
        return bad
    _write_forces(system, task.tips, k, record)
    if len(record.trajectory.x) > 0:
        write_sample(k, system.frames, system.work, record.trajectory)
    if record.slopes.shape[1] > 0:
        fill_rate_slopes(system, joints, scratch.border)
        for i in range(record.slopes.shape[2]):
            for j in range(record.slopes.shape[3]):
                record.slopes[0, k, i, j] = scratch.border.by_pose[i, j]
                record.slopes[1, k, i, j] = scratch.border.by_rate[i, j]
    return -1


@jit_inner
def _write_forces(system, tips, k, record):
    """Write residual, tips and closures of a sample."""
    ties = system.border.ties
    for i in range(record.residual.shape[1]):
        record.residual[k, i] = system.work.residual[0, i]
    for i in range(len(tips.node)):
        n = tips.node[i]
        put(record.tip[k, i], add(vec(system.frames.x[n]), apply(mat(system.frames.r[n]), vec(tips.place[i]))))
    for r in range(record.pulls.shape[1]):
        record.pulls[k, r] = ties.multiplier[r]
        for i in range(record.gradient.shape[2]):
            record.gradient[k, r, i] = -ties.across[r, i] if ties.kind[r] != PULL else 0.0
    for which in range(3):
        evaluate_ties(ties, system.state, system.frames, which)
        for r in range(record.closing.shape[2]):
            record.closing[which, k, r] = ties.value[r] if ties.kind[r] != PULL else 0.0


@jit_inner
def _update_shown_accelerations(system, massive, task, k, tangents, scratch):
    """Set the derivatives of the accelerations of index 1, and the forces there; return -1 or an element that turned too much.

        N du' = G^T dlambda - (K dy + C du + dr/dp) + H du'_march        G du' = -(d phi''/dy dy + d phi''/du du + d phi''/dp)

    N = M + H, H where a motion has no inertia (`dynamics.index1`); K at these accelerations and multipliers.
    """
    inputs = task.inputs
    freedoms = task.freedoms
    shown = tangents.shown
    border = scratch.border
    size = len(freedoms.marched)
    bad = update_stiffness(massive, task.shown, k, scratch)
    if bad >= 0:
        return bad
    fill_rate_slopes(system, take_joints(task.shown.joints, k), border)
    for i in range(shown.shape[0]):
        for p in range(shown.shape[1]):
            shown[i, p] = 0.0 if freedoms.order[i] >= 0 else tangents.acceleration[i, p]
    _compute_forces(task, k, (1, MARCHED), tangents, shown, scratch)
    fill_closing(inputs.opened[1, k], inputs.column, border, shown)
    for r in range(border.by_pose.shape[0]):
        for i in range(border.by_pose.shape[1]):
            if border.by_pose[r, i] != 0.0:
                _add_product(border.closing[r], border.by_pose[r, i], tangents.pose[i])
            if border.by_rate[r, i] != 0.0:
                _add_product(border.closing[r], border.by_rate[r, i], tangents.rate[i])
    _fill_right_sides(freedoms, scratch)
    assemble_masses(system.topology, task, scratch, tangents.acceleration)
    solve_closed(system.border.ties, freedoms, border, scratch.system)
    for r in range(size):
        for p in range(shown.shape[1]):
            shown[freedoms.marched[r], p] = scratch.system[r, size + p]
    _compute_forces(task, k, (1, GIVEN), tangents, shown, scratch)
    take_off_multipliers(border, scratch.forces)
    return -1


@jit_inner
def update_stiffness(massive, shown, k, scratch):
    """Set what K differs by at accelerations of index 1 [N/m], which elements do not feel; return -1 or a bad element."""
    joints = take_joints(shown.joints, k)
    fill_march_state(massive, shown, k)
    bad = evaluate(massive, make_weighted_scheme(0), joints, True)
    if bad >= 0:
        return bad
    changed = scratch.massive[3]
    fill_sparse_entries(massive, scratch.massive_at, changed)
    for e in range(len(changed)):
        changed[e] -= scratch.massive[0, e]
    begin_border(massive, scratch.border)
    return -1


@jit_inner
def fill_march_state(system, states, k):
    """Put the system where it was at sample k [m, rad, s], with the loads of then [N], [N m]."""
    move_system_to(system, states, k)
    ties = system.border.ties
    for r in range(states.multiplier.shape[1]):
        ties.multiplier[r] = states.multiplier[k, r]
    for r in range(states.coupling.shape[1]):
        put(ties.coupling_terms[r], vec(states.coupling[k, r]))


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
        put_mat(turns.inverse[t], inverse_tangent(vec(turns.vector[k, t])))
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
def _compute_forces(task, k, wanted, tangents, accelerations, scratch):
    """Set the forces K dy + C du + M du' + dr/dp [N], [N m] per unit of each parameter, in some rows.

    wanted : 0 at the march's accelerations, 1 at those that are shown; and the role of the rows
    """
    which, role = wanted
    inputs = task.inputs
    roles = task.freedoms.role
    forces = scratch.forces
    for i in range(forces.shape[0]):
        if roles[i] == role:
            forces[i] = 0.0
            for q in range(len(inputs.column)):
                forces[i, inputs.column[q]] += inputs.pushed[which, k, i, q]
    for e in range(len(scratch.stiffness)):
        i = scratch.at[0, e]
        j = scratch.at[1, e]
        if roles[i] == role and roles[j] != OUT_OF_PLANE and scratch.stiffness[e] != 0.0:
            _add_product(forces[i], scratch.stiffness[e], tangents.pose[j])
    _add_massive_forces(roles, wanted, tangents, accelerations, scratch)
    add_border_forces(scratch.border, roles, role, (tangents.pose, tangents.rate), forces)


@jit_inner
def _add_massive_forces(roles, wanted, tangents, accelerations, scratch):
    """Add the shares of C and M, and of K what accelerations of index 1 change [N], [N m]."""
    which, role = wanted
    forces = scratch.forces
    for e in range(scratch.massive.shape[1]):
        i = scratch.massive_at[0, e]
        j = scratch.massive_at[1, e]
        if roles[i] != role or roles[j] == OUT_OF_PLANE:
            continue
        if scratch.massive[1, e] != 0.0:
            _add_product(forces[i], scratch.massive[1, e], tangents.rate[j])
        if scratch.massive[2, e] != 0.0:
            _add_product(forces[i], scratch.massive[2, e], accelerations[j])
        if which == 1 and scratch.massive[3, e] != 0.0:
            _add_product(forces[i], scratch.massive[3, e], tangents.pose[j])


@jit_inner
def _add_product(row, factor, other):
    """Add a multiple of another row to a row [any unit]."""
    for p in range(len(row)):
        row[p] += factor * other[p]


@jit_inner
def _fill_right_sides(freedoms, scratch):
    """Clear the linear system, and put the forces and the gradients of the closures on its right [N], [N m]."""
    system = scratch.system
    gradient = scratch.border.gradient
    size = len(freedoms.marched)
    ties = size + scratch.forces.shape[1]
    for r in range(size):
        system[r, :size] = 0.0
        for c in range(size, ties):
            system[r, c] = -scratch.forces[freedoms.marched[r], c - size]
        for c in range(ties, system.shape[1]):
            system[r, c] = gradient[c - ties, freedoms.marched[r]]


@jit_inner
def _solve_step(system, turns, freedoms, scheme, tangents, scratch):
    """Solve the linear system of a step; its solutions stay in columns of the scratch behind the system itself."""
    whole = scratch.system
    _fill_right_sides(freedoms, scratch)
    fill_step_matrix(turns, freedoms, scheme, scratch)
    solve_closed(system.border.ties, freedoms, scratch.border, whole)


@jit_inner
def fill_step_matrix(turns, freedoms, scheme, scratch):
    """Add K + (cv C + ca M) H^-1 of the marched unknowns to the linear system [any unit]."""
    whole = scratch.system
    for e in range(len(scratch.stiffness)):
        r = freedoms.order[scratch.at[0, e]]
        c = freedoms.order[scratch.at[1, e]]
        if r >= 0 and c >= 0:
            whole[r, c] += scratch.stiffness[e]
    for e in range(scratch.massive.shape[1]):
        r = freedoms.order[scratch.massive_at[0, e]]
        moved = scheme.cv * scratch.massive[1, e] + scheme.ca * scratch.massive[2, e]
        _add_moved(whole, r, scratch.massive_at[1, e], moved, turns, freedoms)
    bent = scratch.border.bent
    dragged = scratch.border.dragged
    for i in range(bent.shape[0]):
        for j in range(bent.shape[1]):
            r = freedoms.order[i]
            if r >= 0 and freedoms.order[j] >= 0:
                whole[r, freedoms.order[j]] += bent[i, j]
                _add_moved(whole, r, j, scheme.cv * dragged[i, j], turns, freedoms)


@jit_inner
def _add_moved(whole, r, j, moved, turns, freedoms):
    """Add to row r what unknown j does by its rates: of a rotation by the increment, H^-1 times that of the pose."""
    if r < 0 or freedoms.order[j] < 0 or moved == 0.0:
        return
    o = turns.at[j]
    if o < 0:
        whole[r, freedoms.order[j]] += moved
        return
    inverse = turns.inverse[turns.number[j]]
    for b in range(3):
        if freedoms.order[o + b] >= 0:  # what is out of a plane is not marched, and no turn in it has a part there
            whole[r, freedoms.order[o + b]] += moved * inverse[j - o, b]


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
                    if freedoms.order[o + b] >= 0:
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
def _write_rates(projects, k, tangents, scratch, out):
    """Write the derivatives of rates and accelerations of a sample, and of multipliers; those of index 1 where ``projects``."""
    accelerations = tangents.shown if projects else tangents.acceleration
    for p in range(tangents.pose.shape[1]):
        for i in range(tangents.pose.shape[0]):
            out.rate[k, i, p] = tangents.rate[i, p]
            out.acceleration[k, i, p] = accelerations[i, p]
        for r in range(scratch.border.multiplier.shape[0]):
            out.multiplier[k, r, p] = scratch.border.multiplier[r, p]


@jit_inner
def _write_tips(system, tips, inputs, k, tangents, out):
    """Write the derivatives of the tips of a sample: dx = dx_n + R_n (theta x place), and what parameters shift beside."""
    topology = system.topology
    variation = system.variation
    for i in range(len(tips.node)):
        n = tips.node[i]
        o = topology.first[n]
        turned = mat(system.frames.r[n])
        place = vec(tips.place[i])
        for a in range(3):
            out.tip[k, i, a] = 0.0
            for q in range(len(inputs.column)):
                out.tip[k, i, a, inputs.column[q]] += inputs.shifted[k, i, a, q]
        for c in range(topology.width[n]):
            moved = add(vec(variation.x[n, c]), apply(turned, cross(vec(variation.t[n, c]), place)))
            for a in range(3):
                if moved[a] != 0.0:
                    _add_product(out.tip[k, i, a], moved[a], tangents.pose[o + c])
