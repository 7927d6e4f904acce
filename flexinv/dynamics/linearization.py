"""Mass, damping and stiffness matrices of the linearised equation of motion, at any pose, velocity u and acceleration u'.

    r(y, u, u') = inertia + elastic forces - loads,       K = dr/dy,   C = dr/du,   M = dr/du'

with y increments of the pose, a rotation's in the node's own frame.  The linearisation of a time step is affine in the factors
cv = du/dy and ca = du'/dy of its scheme, T(cv, ca) = K + cv C + ca M, so that three evaluations give all of them.
Nodes couple along the tree only: of a large mechanism nearly all entries are zero, and `compute_matrices` keeps the others alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.dynamics.assembly import compute_root_derivative
from flexinv.dynamics.constraint_rows import PULL
from flexinv.dynamics.generalized_alpha import DYNAMIC, Scheme
from flexinv.dynamics.loads import update_loads
from flexinv.dynamics.solver import Solver
from flexinv.dynamics.stepper import TURNED_TOO_MUCH, evaluate
from flexinv.kernels.jit import jit, jit_formula, jit_inner
from flexinv.kernels.vec3 import add_scaled, mat, put, put_mat, vec, vec_at
from flexinv.kinematics.tree import Joints
from flexinv.typing import Sparse

# C = (T(LARGE_FACTOR, 0) - K) / LARGE_FACTOR, M = (T(0, LARGE_FACTOR) - K) / LARGE_FACTOR: so large that rounding of K is
# below that of the smallest entry (a factor of 1 drowns C of small, fast mechanisms in it), and a power of two, which rounds
# nothing itself.
LARGE_FACTOR = 2.0**100


class Matrices(NamedTuple):
    """M [kg], C [N s/m] and K [N/m], sparse (unknowns, unknowns) in metres and radians."""

    mass: Sparse
    damping: Sparse
    stiffness: Sparse


def compute_matrices(solver: Solver, joints: Joints) -> Matrices:
    """Return M [kg], C [N s/m] and K [N/m] where the solver stands; forces of springs between points follow the motion.

    Raises ConvergenceError where an element turns too much to be linearised.
    """
    count = count_entries(solver)
    size = len(solver.topology.scale)
    at = np.zeros((2, count), dtype=np.int64)
    values = np.zeros((3, count))
    springs = list[Sparse]()
    for which in range(3):
        if (bad := solver.evaluate(make_weighted_scheme(which), joints)) >= 0:
            raise solver.make_step_error(TURNED_TOO_MUCH, bad, 0.0, "where it is linearised")
        fill_sparse_entries(solver.system, at, values[which])
        springs.append(_compute_spring_matrix(solver))
    values[1:] = (values[1:] - values[0]) / LARGE_FACTOR
    springs[1:] = [(one - springs[0]) / LARGE_FACTOR for one in springs[1:]]
    parts = [scipy.sparse.csc_array((value, (at[0], at[1])), shape=(size, size)) for value in values]
    stiffness, damping, mass = (part + spring for part, spring in zip(parts, springs, strict=True))
    return Matrices(mass, damping, stiffness)


def count_entries(solver: Solver) -> int:
    """Count the entries that blocks and elements have in one matrix [-]."""
    t = solver.topology
    e = solver.elements
    count = int((t.size**2).sum())
    for k, order in enumerate(e.order):
        sizes = t.width[e.nodes[k, : order + 1]].copy()
        sizes[1:] = 6
        count += int(sizes.sum() ** 2 - (sizes**2).sum())
    return count


def _compute_spring_matrix(solver: Solver) -> Sparse:
    """Give the part of springs between points in the linearisation, -C A of their rows in the border."""
    ties = solver.border.ties
    pulls = ties.kind == PULL
    size = ties.sides.shape[1]
    if not pulls.any():
        return scipy.sparse.csc_array((size, size))
    sides, across = (scipy.sparse.csc_array(part[pulls]) for part in (ties.sides, ties.across))
    return -(sides.T @ across)


@jit_formula
def make_weighted_scheme(which: int) -> Scheme:
    """Return the scheme [-] of which the linearisation is K (0), K + LARGE_FACTOR C (1) or K + LARGE_FACTOR M (2)."""
    return Scheme(
        DYNAMIC, 0.0, LARGE_FACTOR if which == 1 else 0.0, LARGE_FACTOR if which == 2 else 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    )


@jit_inner
def move_system_to(system, states, k):
    """Put the system where it is at sample k of ``states`` [m, rad, s], `State` by samples, with the loads of then [N], [N m]."""
    state = system.state
    for n in range(states.x.shape[1]):
        put(state.x[n], vec(states.x[k, n]))
        put_mat(state.r[n], mat(states.r[k, n]))
    for i in range(len(state.d)):
        state.d[i] = 0.0
        state.u[i] = states.u[k, i]
        state.du[i] = states.du[k, i]
        state.place[i] = states.place[k, i]
    update_loads(system.loads, states.table[k], state.d[:0])


@jit_inner
def fill_dense_matrices(system, joints, out):
    """Fill K, C and M (3, unknowns, unknowns) [N/m], [N s/m], [kg]; return -1 or the element that turned too much."""
    for which in range(3):
        bad = evaluate(system, make_weighted_scheme(which), joints, True)
        if bad >= 0:
            return bad
        fill(system, which, out)
    return -1


@jit
def fill_sparse_entries(system, at, values):
    """Fill the places (2, entries) and values (entries,) [any unit] of the linearisation without springs between points."""
    work = system.work  # by itself: it is written to (`assembly._passive_rows`)
    topology = system.topology
    elements = system.elements
    n = 0
    for b in range(len(topology.size)):
        o = topology.offset[b]
        size = topology.size[b]
        n = _list(work.diagonal[b], (o, size), (o, size), at, values, n)
    for k in range(len(elements.order)):
        nodes = elements.nodes[k]
        count = elements.order[k] + 1
        for i in range(count):
            for q in range(count):
                if i == q:
                    continue
                rows = topology.width[nodes[i]] if i == 0 else 6
                columns = topology.width[nodes[q]] if q == 0 else 6
                work.system[:rows, :columns] = 0.0
                _add_coupling(topology, system.variation, nodes, i, q, work.tangent[k], (0, 0), work.system)
                of = topology.first[nodes[i]]
                by = topology.first[nodes[q]]
                n = _list(work.system, (of, rows), (by, columns), at, values, n)


@jit_inner
def _list(block, rows, columns, at, values, n):
    """List a block of the linearisation from entry n on; rows, columns : first and number; return the next entry."""
    for r in range(rows[1]):
        for c in range(columns[1]):
            at[0, n] = rows[0] + r
            at[1, n] = columns[0] + c
            values[n] = block[r, c]
            n += 1
    return n


@jit
def fill(system, which, out):
    """Fill K (0), C (1) or M (2) of (3, unknowns, unknowns) [N/m], [N s/m], [kg] from the linearisation by "
    "`make_weighted_scheme`.

    Forces of springs between points are in it by -C A of their rows in the border.
    """
    topology = system.topology
    elements = system.elements
    variation = system.variation
    work = system.work
    ties = system.border.ties
    whole = out[which]
    whole[:] = 0.0
    for b in range(len(topology.size)):
        o = topology.offset[b]
        for r in range(topology.size[b]):
            for c in range(topology.size[b]):
                whole[o + r, o + c] = work.diagonal[b, r, c]
    for k in range(len(elements.order)):
        count = elements.order[k] + 1
        for i in range(count):
            for q in range(count):
                if i != q:
                    nodes = elements.nodes[k]
                    rows = topology.first[nodes[i]]
                    columns = topology.first[nodes[q]]
                    _add_coupling(topology, variation, nodes, i, q, work.tangent[k], (rows, columns), whole)
    for r in range(whole.shape[0]):
        for c in range(whole.shape[1]):
            for k in range(len(ties.a)):
                if ties.kind[k] == PULL:
                    whole[r, c] -= ties.sides[k, r] * ties.across[k, c]
            if which > 0:
                whole[r, c] = (whole[r, c] - out[0, r, c]) / LARGE_FACTOR


@jit_inner
def _add_coupling(topology, variation, nodes, first, second, tangent, at, out):
    """Add B_i^T K_iq B_q from row and column ``at`` on; the first node moves with all of its block, others with their six."""
    root = nodes[0]
    rows, columns = at
    for r in range(topology.width[root] if first == 0 else 6):
        by_x = vec_at(tangent[6 * first + r % 6], 6 * second)
        by_t = vec_at(tangent[6 * first + r % 6], 6 * second + 3)
        if first == 0:
            by_x = (0.0, 0.0, 0.0)
            by_t = (0.0, 0.0, 0.0)
            for a in range(3):
                by_x = add_scaled(by_x, variation.x[root, r, a], vec_at(tangent[a], 6 * second))
                by_t = add_scaled(by_t, variation.x[root, r, a], vec_at(tangent[a], 6 * second + 3))
                by_x = add_scaled(by_x, variation.t[root, r, a], vec_at(tangent[3 + a], 6 * second))
                by_t = add_scaled(by_t, variation.t[root, r, a], vec_at(tangent[3 + a], 6 * second + 3))
        if second > 0:
            for a in range(3):
                out[rows + r, columns + a] += by_x[a]
                out[rows + r, columns + 3 + a] += by_t[a]
        else:
            for c in range(topology.width[root]):
                out[rows + r, columns + c] += compute_root_derivative(tangent, 6 * first + r, root, c, variation)
