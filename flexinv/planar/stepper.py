"""The march in a plane: time steps of generalized-alpha, one linearisation for all iterations of a step (compiled).

The same scheme, equations and accuracy as `dynamics.stepper`; positions and angles are a vector space here, x_(n+1) = x_n + d.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.dynamics import generalized_alpha, stepper
from flexinv.dynamics.assembly import LARGEST_TURN
from flexinv.dynamics.constraint_rows import Ties, add_ties, has_acting_closure, solve_border
from flexinv.dynamics.generalized_alpha import ACCELERATION, ACCELERATIONS, DYNAMIC, PASSES, SQUARED, copy, prepare_step
from flexinv.dynamics.stepper import CONVERGED, MOST_ITERATIONS, NOT_CONVERGED, NOT_FINITE, SLIPPED, TURNED_TOO_MUCH
from flexinv.dynamics.system import State
from flexinv.elements import planar_beam
from flexinv.elements.planar_beam import (
    N1,
    N2,
    M,
    PlanarElements,
    add_forces,
    compute_energy,
    compute_point_offset,
    fill_point_strains,
    remove_stress,
)
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.simd import cos_sin_unfused
from flexinv.kernels.vec3 import dot, put, vec
from flexinv.planar import tree as passes
from flexinv.planar.constraint_rows import compute_tie_factors, evaluate_ties
from flexinv.planar.index1 import BlockMasses, update_accelerations
from flexinv.planar.tree import (
    PlanarFrames,
    PlanarTree,
    assemble_residual,
    begin_from_state,
    begin_undeformed,
    compute_node_wrenches,
    fill_variations,
    run_forward_pass,
)
from flexinv.planar.tree_solver import PlanarFactors, add_element_stiffness, compute_planar_factors, solve_tree
from flexinv.typing import Array, Indices

# Newton stops when the estimated remaining error is below the tolerance: increment times the observed rate of contraction (at
# least SURE_STEP), or its square after a new linearisation (`generalized_alpha.SQUARED`).  Increments below INCREMENT_ROUNDING
# carry no information.
SURE_STEP = 1e-6
INCREMENT_ROUNDING = 5e-15
# With damping no linearisation is exact (`planar_beam`), and rates add rounding of their own: an increment below
# this that shrinks no more is rounding.
STALLED = 1e-12
# A linearisation serves all iterations of a step, unless it shrinks an increment by less than SLOW: a new one costs as much as
# two iterations or three.  (That of the step before, even turned with the mechanism, costs two iterations more: dearer.)
SLOW = 0.03
# A step that takes more iterations than this is begun anew, cautiously: there may be another solution where it gets to.
MANY = 12


@send_by_address
class PlanarWork(NamedTuple):
    """Scratch of the march: points of `planar_beam`, u (count, 3), felt (elements, count, 3).

    rates : the same of their rates, empty where no beam is damped
    residual, y : (1 + rows, unknowns), the first is of the tree, the others belong to the closures (`dynamics.constraint_rows`)
    """

    points: Array
    rates: Array
    u: Array
    node_forces: Array
    residual: Array
    y: Array


@send_by_address
class Embedding(NamedTuple):
    """Embedding of the plane in space.

    axes : (3, 3) columns: the plane's x, y and its normal, in the world; height : of the plane along the normal [m]
    across, along, normal : (nodes, 3, 3) R_W,node = cos(theta) across + sin(theta) along + normal
    axle : (nodes, 3) the normal in the nodes' frames; side : (elements, 3) J e_1 in the section frames
    row : (rows,) of the constraints that act in the plane among those in space
    """

    axes: Array
    height: float
    across: Array
    along: Array
    normal: Array
    axle: Array
    side: Array
    row: Indices


@send_by_address
class PlanarSystem(NamedTuple):
    """A mechanism in a plane under time integration, as `dynamics.system.System` in space."""

    tree: PlanarTree
    elements: PlanarElements
    ties: Ties
    masses: BlockMasses
    space: Embedding
    state: State
    frames: PlanarFrames
    factors: PlanarFactors
    work: PlanarWork


@jit_inner
def evaluate(system, given, moved):
    """Evaluate the residual [N], [N m] at the present unknowns; return the largest turn [rad] in an element, and which.

    moved : whether poses or rates have changed since the last evaluation, and with them what the elements feel
    """
    elements = system.elements
    frames = system.frames
    work = system.work
    largest = 0.0
    worst = 0
    run_forward_pass(system.tree, system.state, given, frames)
    evaluate_ties(system.ties, frames, False)
    if moved:
        largest, worst = fill_point_strains(elements, frames.pose, work.u, work.points)
        if len(elements.damping) > 0:
            planar_beam.fill_point_rates(elements, frames.rate, work.rates)
        planar_beam.fill_point_gradients(elements, work.points, work.rates)
    compute_node_wrenches(system.tree, frames)
    add_ties(system.ties, system.ties.multiplier, frames.wrench)
    add_forces(elements, frames.pose, work.points, frames.wrench, work.node_forces)
    assemble_residual(system.tree, system.state, frames, work.residual[0])
    return largest, worst


@jit_inner
def build_linearization(system, scheme):
    """Make and eliminate the linearisation at the state that `evaluate` has seen last [N/m], [N], [N m]."""
    tree = system.tree
    elements = system.elements
    frames = system.frames
    work = system.work
    fill_variations(tree, frames, scheme.cv, scheme.ca)
    passes.fill_wrench_variations(tree, frames)
    planar_beam.fill_point_hessians(elements, scheme.cv, work.points)
    add_element_stiffness(tree, elements, work.points, frames, system.factors)
    passes.assemble_diagonal(tree, system.state, frames, system.factors.diagonal, scheme.cv, scheme.ca)
    compute_planar_factors(tree, elements, frames, system.factors)
    compute_tie_factors(system)


@jit_inner
def run_newton(system, scheme, given, slow, most):
    """Solve one step; return status, iterations (or the bad element), last relative increment [-].

    Where only accelerations are asked for, the state stands still.
    slow : shrinking of an increment [-] from which on the linearisation is made anew, 0 for every time; most : iterations
    """
    tree = system.tree
    elements = system.elements
    ties = system.ties
    state = system.state
    work = system.work
    size = 0.0
    fresh = True
    last = scheme.mode == ACCELERATION
    for iteration in range(most + 1):
        turned, worst = evaluate(system, given, scheme.mode != ACCELERATION)
        if not turned <= LARGEST_TURN:
            return TURNED_TOO_MUCH, worst, size
        if last or work.y.shape[1] == 0:
            slipped = find_overturned_element(tree, elements, scheme, state, system.frames)
            return (SLIPPED, slipped, size) if slipped >= 0 else (CONVERGED, iteration, size)
        if fresh:
            build_linearization(system, scheme)
        solve_tree(tree, elements, system.factors, work.residual[0], work.y[0])
        solve_border(ties, ties.layout.blocks, 1.0, work.y)
        before = size
        size = generalized_alpha.find_largest_increment(work.y[0], tree.scale)
        if not np.isfinite(size):
            return NOT_FINITE, iteration, size
        for i in range(len(state.d)):
            state.d[i] += work.y[0, i]
            state.u[i] += scheme.cv * work.y[0, i]
            state.du[i] += scheme.ca * work.y[0, i]
        shrunk = size / before if iteration > 0 else 1.0
        last = _is_last_increment(size, shrunk, fresh, len(elements.damping) > 0, iteration, scheme.tolerance)
        fresh = shrunk > slow if iteration > 0 else slow == 0.0
    return NOT_CONVERGED, most, size


@jit_inner
def begin_step(system, scheme, given):
    """Let the next step start from what has been projected, as far as a step resolves that: `initial_state.begin_step`.

    Return whether that leaves something out [-].
    """
    tree = system.tree
    ties = system.ties
    state = system.state
    work = system.work
    for i in range(len(state.du)):
        state.du[i] += work.y[0, i]
    copy(state.du, state.pseudo)
    jump = 0.0
    for i in range(len(state.du)):
        jump = max(jump, scheme.h * scheme.h * abs(state.pseudo[i] - state.du0[i]) / tree.scale[i])
    if jump > generalized_alpha.START_ROUNDING:
        copy(ties.multiplier, ties.saved_multiplier)
        copy(state.du0, state.du)
        passes.fill_independent_variations(tree, system.frames, scheme.cv, scheme.ca)
        for _ in range(PASSES):
            evaluate(system, given, True)
            build_linearization(system, scheme)
            solve_tree(tree, system.elements, system.factors, work.residual[0], work.y[0])
            evaluate_ties(ties, system.frames, True)
            solve_border(ties, ties.layout.blocks, scheme.ca, work.y)
            for i in range(len(state.du)):
                state.du[i] += scheme.ca * work.y[0, i]
        if generalized_alpha.is_sudden(scheme, tree.scale, state.pseudo, state.du):
            begin_from_state(state)
            return True
        copy(ties.saved_multiplier, ties.multiplier)
    copy(state.pseudo, state.du)
    begin_from_state(state)
    return False


@jit_inner
def find_overturned_element(tree, elements, scheme, state, frames):
    """Return the element of which a section turns by more than pi [rad] beside what carries it, else -1."""
    for k in range(len(elements.order) if scheme.mode == DYNAMIC else 0):
        root = elements.nodes[k, 0]
        for i in range(1, elements.order[k] + 1):
            turn = state.d[tree.first[elements.nodes[k, i]] + 2]
            if not abs(turn) <= stepper.NO_SLIP:
                end_turn = state.d[tree.first[root] + 2]
                if not abs(turn - (end_turn if tree.independent[root] else scheme.h * frames.rate[root, 2])) <= np.pi:
                    return k
    return -1


@jit_inner
def _is_last_increment(size, shrunk, fresh, damped, iteration, tolerance):
    """Return True if what an increment leaves is small enough, or where damping is so strong that no other would be smaller."""
    leaves = SQUARED * size * size if fresh and not damped else size * max(shrunk, SURE_STEP)
    last = size < INCREMENT_ROUNDING or leaves < tolerance
    return last or (damped and iteration > 0 and shrunk > 0.5 and size < STALLED)


@jit
def integrate_planar_motion(system, step, start_at, still, given, row, out):
    """March over the instants of one chunk and write the samples that are asked for.

    step : the scheme; an instant is the end of a step.  still : the first instant is no step: only its accelerations are
    found, at the state at hand, and the march goes on from them, or ends there where such a start is sudden.  Where closures
    act, what is written are the accelerations and multipliers of `planar.index1.project_accelerations`.

    start_at : (nodes, 3) q, q', q'' of all joints [m, rad, s] where the march begins, undeformed; (0, 3) where it goes on
    given : (instants, joints, 3) q, q', q'' of the prescribed joints [m, rad, s]; row : (instants,) of the histories, -1 for none
    Return status, instant reached, element or iterations, last relative increment [-].
    """
    ties = system.ties
    state = system.state
    count = 0
    size = 0.0
    acts = has_acting_closure(ties)
    if start_at.shape[0] > 0:
        _begin_march(system, start_at)
    for n in range(given.shape[0]):
        moves = n > 0 or not still
        scheme = step if moves else ACCELERATIONS
        _begin_instant(system, scheme, n == 0 or (n == 1 and still), moves)
        status, count, size = run_newton(system, scheme, given[n], SLOW, MANY)
        if status != CONVERGED and moves:  # where something has just let go, the past says little about what comes
            state.order[0] = 0
            prepare_step(step, state)
            copy(ties.saved_multiplier, ties.multiplier)
            status, count, size = run_newton(system, step, given[n], 0.0, MOST_ITERATIONS)
        if status != CONVERGED:
            copy(ties.saved_multiplier, ties.multiplier)  # which may be none: what comes next begins where this one has
            return status, n, count, size
        if not moves:
            _write_instant(system, row[n], count, True, out)
            if begin_step(system, step, given[n]):
                return stepper.SUDDEN_START, n + 1, count, size
            continue
        _write_step(system, row[n], count, acts, out)
        generalized_alpha.update_unknowns(step, state, system.tree.scale)
    return CONVERGED, given.shape[0], count, size


@jit_inner
def _begin_march(system, start_at):
    """Begin undeformed, joints as ``start_at`` says; the elements feel nothing, not even rounding."""
    begin_undeformed(system.tree, system.state, start_at, system.frames)
    begin_from_state(system.state)
    remove_stress(system.elements, system.work.points)
    system.work.rates[:] = 0.0


@jit_inner
def _begin_instant(system, scheme, is_new, moves):
    """Prepare for Newton at an instant, with a scheme that ``is_new`` or has served before."""
    if is_new:
        passes.fill_independent_variations(system.tree, system.frames, scheme.cv, scheme.ca)
    if moves:
        prepare_step(scheme, system.state)
    copy(system.ties.multiplier, system.ties.saved_multiplier)


@jit_inner
def _write_instant(system, row, count, projects, out):
    """Write an instant into its row of the histories, where it has one, with accelerations of index 1 if it ``projects``."""
    if projects:
        copy(system.ties.multiplier, system.ties.saved_multiplier)
        update_accelerations(system)
    if row >= 0:
        write_sample(row, system, out)
        out.iterations[row] = count


@jit_inner
def _write_step(system, row, count, acts, out):
    """Write an instant at which a step ends; the march goes on with its own multipliers."""
    projects = acts and row >= 0
    _write_instant(system, row, count, projects, out)
    if projects:
        copy(system.ties.saved_multiplier, system.ties.multiplier)


@jit_inner
def write_sample(sample, system, out):
    """Write one instant into the histories, in space [m, rad, s, N, J]."""
    ties = system.ties
    space = system.space
    frames = system.frames
    work = system.work
    for n in range(len(system.tree.parent)):
        _convert_to_space(space.axes, frames.pose[n], space.height, out.x[sample, n])
        _convert_to_space(space.axes, frames.rate[n], 0.0, out.v[sample, n])
        _convert_to_space(space.axes, frames.acceleration[n], 0.0, out.a[sample, n])
        _convert_to_space(space.axes, frames.wrench[n], 0.0, out.wrench[sample, n])
        _write_rotation(sample, n, space, frames, out)
    for r in range(len(ties.a)):
        out.multipliers[sample, space.row[r]] = ties.multiplier[r]
    power = _write_resultants(system, out.internal[sample])
    stored = compute_energy(system.elements, work.points)
    lost = planar_beam.compute_dissipated_power(system.elements, work.rates)
    put(out.energy[sample], (stored, power, lost))


@jit_inner
def _write_rotation(sample, n, space, frames, out):
    """Rotation, angular velocity and acceleration, and moment of node n."""
    c, s = cos_sin_unfused(frames.pose[n, 2])
    for i in range(3):
        out.w[sample, n, i] = frames.rate[n, 2] * space.axle[n, i]
        out.al[sample, n, i] = frames.acceleration[n, 2] * space.axle[n, i]
        out.wrench[sample, n, 3 + i] = frames.wrench[n, 2] * space.axle[n, i]
        for j in range(3):
            turned = c * space.across[n, i, j] + s * space.along[n, i, j]
            out.r[sample, n, i, j] = turned + space.normal[n, i, j]


@jit_inner
def _write_resultants(system, internal):
    """Stress resultants in the section frame, n_1 e_1 + n_2 side, m normal; return the power of the elements' forces."""
    elements = system.elements
    work = system.work
    power = 0.0
    for n in range(len(elements.order)):
        for i in range(elements.order[n] + 1):
            power += dot(vec(work.node_forces[n, i]), vec(system.frames.rate[elements.nodes[n, i]]))
        side = system.space.side[n]
        axle = system.space.axle[elements.nodes[n, 0]]
        for g in range(elements.order[n]):
            at = compute_point_offset(n, g, elements.shape.shape[1])
            resultant = internal[n, g]
            for i in range(3):
                resultant[i] = work.points[at + N2] * side[i]
                resultant[3 + i] = work.points[at + M] * axle[i]
            resultant[0] = work.points[at + N1]
    return power


@jit_inner
def _convert_to_space(axes, vector, height, out):
    """A vector of the plane, and a height above it, in the world."""
    for i in range(3):
        out[i] = axes[i, 0] * vector[0] + axes[i, 1] * vector[1] + axes[i, 2] * height
