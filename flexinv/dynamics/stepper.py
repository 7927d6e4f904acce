"""The march by generalized-alpha: Newton on all unknowns of one instant, and the loop over time steps (compiled)."""

from __future__ import annotations

import numpy as np

from flexinv.dynamics import constraint_rows, generalized_alpha
from flexinv.dynamics.assembly import (
    add_amplitude_forces,
    add_elements,
    assemble_residual,
    compute_node_wrenches,
    run_forward_pass,
)
from flexinv.dynamics.constraint_rows import (
    PULL,
    RATES,
    VALUES,
    add_gears,
    add_ties,
    evaluate_ties,
    fill_right_sides,
    solve_border,
)
from flexinv.dynamics.generalized_alpha import (
    ACCELERATION,
    DYNAMIC,
    RESOLVED,
    STATIC,
    apply_increment,
    copy,
    end_step,
    prepare_step,
)
from flexinv.dynamics.index1 import add_missing_masses, solve_masses, update_accelerations
from flexinv.dynamics.loads import add_loads, evaluate_spring_rows, fill_spring_sides, turn_arms, update_loads
from flexinv.dynamics.tree_solver import solve_tree
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.vec3 import apply, dot, mat, put, put_mat, scale, sub, tapply, vec, vec_at
from flexinv.kinematics.tree import take_joints

# Newton stops when an increment, relative to the mechanism's length or in radians, is below this; one evaluation follows, and as
# convergence is quadratic about its square is left: rounding.  (A scheme that may leave more lets it stop earlier.)
INCREMENT = 1e-8
# Where closures act the linearisation leaves out how their forces turn: an increment shrinks to a part of 1e-3 to 1e-5, not to
# its square.  So Newton goes on to this, or until one below INCREMENT shrinks by no more than STALLED, which is rounding.  (With
# INCREMENT alone derivatives of torques of a loop in space with a steel strip were off by 1e-5 of the largest.)
CLOSED_INCREMENT = 1e-11
STALLED = 0.5
MOST_ITERATIONS = 25
# A predicted step that takes more iterations than this is begun anew, without the past: it may lead to another solution, and
# Newton, whose increments square, needs two or three where the prediction is good (a slider-crank that took eight went on to a
# rod rolled up by 1.9 rad: tests/flexinv/analysis/test_sudden.py).
PREDICTED_ITERATIONS = 6
# Where the last increment was below this, K^-1 C of the border (`constraint_rows.solve_border`) stays what it was: it has changed
# by such a part, and the multipliers' own increments, squared by then, with it.
BORDER_STAYS = 1e-4

# SUDDEN_START is no failure: the march stands at its first instant, and what comes begins in parts (`generalized_alpha.EARLY`).
CONVERGED = 0
NOT_CONVERGED = 1
TURNED_TOO_MUCH = 2
NOT_FINITE = 3
SLIPPED = 4
SUDDEN_START = 5

# A section that turns by less than this in a step has not slipped, whatever carries it: how that turns is not asked.
NO_SLIP = 1.0  # [rad]

# At rest nothing but the closures or springs of the border may hold a passive joint, and the tree alone cannot be solved.
# Its diagonal gets this part of the largest stiffness: Newton's step falls short by as much, rounding by 1e-16 / HELD_STIFFNESS.
HELD_STIFFNESS = 4e-11


@jit_inner
def evaluate(system, scheme, joints, want_tangent):
    """Evaluate residual [N], [N m] (and linearisation) at the present unknowns; return -1 or the element that turned too much."""
    topology = system.topology
    frames = system.frames
    variation = system.variation
    work = system.work
    ties = system.border.ties
    pulls = system.border.pulls
    loads = system.loads
    level = loads.level[0]
    rated = scheme.mode == ACCELERATION or scheme.mode == RESOLVED
    factors = scheme.cv, scheme.ca
    run_forward_pass(topology, system.state, joints, frames, variation, work, factors, want_tangent)
    compute_node_wrenches(topology, frames, variation, level, work, want_tangent)
    add_loads(topology, frames, variation, loads, work, want_tangent)
    evaluate_ties(ties, system.state, frames, constraint_rows.SECOND_RATES if rated else VALUES)
    evaluate_spring_rows(pulls, ties, frames, level)
    add_ties(ties, ties.multiplier, work.wrench)
    bad = add_elements(topology, system.elements, frames, variation, work, scheme.mode != STATIC, want_tangent)
    if bad < 0:
        add_amplitude_forces(topology, system.state, work, scheme.mode != STATIC, scheme.cv, want_tangent)
        if want_tangent:
            turn_arms(topology, pulls, ties, frames, variation, work.dwrench)
        assemble_residual(system, joints, scheme.cv, scheme.ca, want_tangent)
        add_gears(ties, work.residual)
        if want_tangent:
            fill_right_sides(topology, ties, variation, work.residual)
            fill_spring_sides(topology, pulls, ties, frames, variation)
    return bad


@jit_inner
def run_newton(system, scheme, joints, y, most):
    """Solve one instant in at ``most`` iterations; return status, iterations or the bad element, last increment [-]."""
    topology = system.topology
    closes = constraint_rows.has_acting_closure(system.border.ties)
    size = 0.0
    last = False
    for iteration in range(most + 1):
        bad = evaluate(system, scheme, joints, not last)
        if bad >= 0:
            return TURNED_TOO_MUCH, bad, size
        if last or y.shape[1] == 0:
            slipped = find_overturned_element(topology, system.elements, scheme, system.state, system.frames)
            return (SLIPPED, slipped, size) if slipped >= 0 else (CONVERGED, iteration, size)
        stays = iteration > 0 and scheme.mode == DYNAMIC and size < BORDER_STAYS
        _solve_linearization(system, scheme, stays, y)
        before = size
        size = generalized_alpha.find_largest_increment(y[0], topology.scale)
        if not np.isfinite(size):
            return NOT_FINITE, iteration, size
        apply_increment(topology, scheme, system.state, y[0])
        last = (
            scheme.mode == ACCELERATION or scheme.mode == RESOLVED or _is_last_increment(size, before, closes, scheme)
        )
    return NOT_CONVERGED, most, size


@jit_inner
def _is_last_increment(size, before, closes, scheme):
    """Return True if what an increment leaves is small enough; before : the one before it, 0 of the first."""
    if not closes:
        return size < INCREMENT or generalized_alpha.SQUARED * size * size < scheme.tolerance
    stalls = before > 0.0 and size < INCREMENT and size > STALLED * before
    return size < CLOSED_INCREMENT or stalls or (before > 0.0 and size * size < scheme.tolerance * before)


@jit_inner
def _add_passive_stiffness(topology, diagonal):
    """Give passive freedoms a stiffness of their own in the linearisation, HELD_STIFFNESS of the largest; the residual has none.

    Stiffnesses are compared in lengths of the mechanism: N m/rad and N/m of small ones are far apart.
    """
    largest = 0.0
    for b in range(len(topology.size)):
        for k in range(topology.size[b]):
            largest = max(largest, abs(diagonal[b, k, k]) * topology.scale[topology.offset[b] + k] ** 2)
    for n in range(len(topology.parent)):
        b = topology.block[n]
        for i in range(topology.freedoms[n]):
            k = topology.column[n] + i
            diagonal[b, k, k] += HELD_STIFFNESS * largest / topology.scale[topology.offset[b] + k] ** 2


@jit_inner
def _solve_linearization(system, scheme, stays, y):
    """Set the increment of all unknowns, y[0]; ``stays``: the border's factors are kept."""
    topology = system.topology
    ties = system.border.ties
    work = system.work
    if scheme.mode == ACCELERATION:
        solve_masses(system, y)
    else:
        if scheme.mode == RESOLVED:
            add_missing_masses(topology, work.diagonal)
        elif scheme.mode == STATIC and len(ties.a) > 0:
            _add_passive_stiffness(topology, work.diagonal)
        solve_tree(topology, system.elements, system.variation, work, ties.layout, stays, y)
    # At rest loose joints make it nearly singular, and equilibria need not be stable: pivots are sought among all rows.
    blocks = ties.layout.whole if scheme.mode == STATIC else ties.layout.blocks
    if not stays:
        constraint_rows.compute_border_factors(ties, blocks, y)
    solve_border(ties, blocks, scheme.ca if scheme.mode == RESOLVED else 1.0, y)


@jit
def integrate_instants(system, scheme, instants, y, out):
    """Solve the instants of one chunk, in DYNAMIC mode step after step; fill the histories.  Without room for increments, y
    (0, unknowns), the first instant is evaluated with its linearisation where the system stands, and nothing moves.

    With closures a step finds positions that meet them, and then the accelerations and multipliers that belong to that state
    (`index1.project_accelerations`), which are what is recorded.

    system : `system.System`; instants : `system.Instants`; out : `system.Trajectory`; y : (sides, unknowns) scratch
    Return status, sample reached, element or iterations, last relative increment [-].
    """
    state = system.state
    ties = system.border.ties
    rel = instants.joints
    moves = scheme.mode == DYNAMIC
    count = 0
    size = 0.0
    for sample in range(rel.p.shape[0]):
        j = take_joints(rel, sample)
        _begin_instant(system, instants, sample)
        if y.shape[0] == 0:
            bad = evaluate(system, scheme, j, True)
            return TURNED_TOO_MUCH if bad >= 0 else CONVERGED, sample, bad, size
        predicted = moves and state.order[0] > 0
        status = NOT_CONVERGED
        copy(ties.multiplier, ties.saved_multiplier)
        while True:
            if moves:
                prepare_step(scheme, state)
            status, count, size = run_newton(
                system, scheme, j, y, PREDICTED_ITERATIONS if predicted else MOST_ITERATIONS
            )
            if status == CONVERGED or not predicted:
                break
            copy(
                ties.saved_multiplier, ties.multiplier
            )  # where something has just let go, the past says little about what comes
            predicted = False
            state.order[0] = 0
        if status != CONVERGED:
            copy(ties.saved_multiplier, ties.multiplier)  # which may be none: what comes next begins where this one has
            return status, sample, count, size
        _write_instant(system, j, y, sample, moves, out)
        out.iterations[sample] = count
        end_step(system.topology, scheme, state)
    return CONVERGED, rel.p.shape[0], count, size


@jit_inner
def _begin_instant(system, instants, sample):
    """Set the loads, the efforts of drives and the terms of couplings of an instant."""
    update_loads(system.loads, instants.table[sample], instants.efforts[sample])
    for k in range(instants.coupling_terms.shape[1]):
        put(system.border.ties.coupling_terms[k], vec(instants.coupling_terms[sample, k]))


@jit_inner
def _write_instant(system, joints, y, sample, moves, out):
    """Write an instant into the histories, of a step with closures as projected; the integrator goes on with its own."""
    state = system.state
    ties = system.border.ties
    projects = moves and constraint_rows.has_acting_closure(ties)
    if projects:
        copy(ties.multiplier, ties.saved_multiplier)
        copy(state.du, state.saved_acceleration)
        update_accelerations(system, joints, y)
    write_sample(sample, system.frames, system.work, out)
    for k in range(out.multipliers.shape[1]):
        out.multipliers[sample, k] = ties.multiplier[k]
    if projects:
        copy(ties.saved_multiplier, ties.multiplier)
        copy(state.saved_acceleration, state.du)


@jit_inner
def find_overturned_element(topology, elements, scheme, state, frames):
    """Return the element of which a section turns by more than pi [rad] in a step beside what carries it, else -1.

    An element sees turns between its sections only up to 2 pi: Newton may have converged some turns away.
    """
    for k in range(len(elements.order) if scheme.mode == DYNAMIC else 0):
        root = elements.nodes[k, 0]
        for i in range(1, elements.order[k] + 1):
            n = elements.nodes[k, i]
            turn = vec_at(state.d, topology.first[n] + 3)
            if dot(turn, turn) > NO_SLIP * NO_SLIP:
                carried = scale(scheme.h, vec(frames.w[root]))
                if topology.independent[root]:
                    carried = vec_at(state.d, topology.first[root] + 3)
                apart = sub(turn, tapply(mat(frames.r[n]), apply(mat(frames.r[root]), carried)))
                if not dot(apart, apart) <= np.pi * np.pi:
                    return k
    return -1


@jit
def apply_impact(system, joints, y):
    """Let the acting closures stop the velocities that they do not allow, perfectly plastic: state.u changes [m/s], [rad/s].

    M du - G^T Lambda = 0,  G (u + du) = 0: impulses Lambda [N s], [N m s] are left in ties.step.
    """
    ties = system.border.ties
    state = system.state
    evaluate(system, generalized_alpha.ACCELERATIONS, joints, True)
    evaluate_ties(ties, state, system.frames, RATES)
    system.work.residual[0, : y.shape[1]] = 0.0
    copy(ties.multiplier, ties.saved_multiplier)
    for k in range(len(ties.a)):
        if ties.kind[k] == PULL:
            ties.value[k] = 0.0
    solve_masses(system, y)
    constraint_rows.compute_border_factors(ties, ties.layout.blocks, y)
    solve_border(ties, ties.layout.blocks, 1.0, y)
    for i in range(y.shape[1]):
        state.u[i] += y[0, i]
    copy(ties.saved_multiplier, ties.multiplier)


@jit_inner
def write_sample(sample, frames, work, out):
    """Copy one instant into the histories [m, rad, s, N, J]."""
    for n in range(frames.x.shape[0]):
        put_mat(out.r[sample, n], mat(frames.r[n]))
        for history, now in (
            (out.x, frames.x), (out.v, frames.v), (out.w, frames.w), (out.a, frames.a), (out.al, frames.al),
        ):  # fmt: skip
            put(history[sample, n], vec(now[n]))
        for i in range(6):
            out.wrench[sample, n, i] = work.wrench[n, i]
    for k in range(work.internal.shape[0]):
        for point in range(work.internal.shape[1]):
            for i in range(6):
                out.internal[sample, k, point, i] = work.internal[k, point, i]
    put(out.energy[sample], vec(work.energy))
