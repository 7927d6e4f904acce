"""Rest position about which a mechanism is linearised: its equilibrium, its M, C and K there, and whether it would stay.

Joints that are not free are held.  A motion y of the unknowns about it moves node n by B_n y (`kinematics.tree`).
At a rest position K is symmetric but for forces that turn along and moments; where an outside effort holds a free joint in place,
it is taken as constant.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.dynamics.dofs import list_amplitudes
from flexinv.dynamics.generalized_alpha import STATICS, apply_increment, end_step
from flexinv.dynamics.initial_state import begin_undeformed, find_equilibrium
from flexinv.dynamics.linearization import Matrices, compute_matrices
from flexinv.dynamics.solver import Solver
from flexinv.kernels.jit import jit
from flexinv.kinematics.mesh import Mesh, list_tips
from flexinv.kinematics.tree import Joints
from flexinv.linearized.closed_motions import (
    compute_tie_stiffness,
    count_constraints,
    find_allowed_motions,
    solve_closing_forces,
)
from flexinv.linearized.complex_roots import find_circulatory_modes, find_roots
from flexinv.linearized.eigenvalues import ONE_AND_ALL, count_negative_eigenvalues, is_symmetric
from flexinv.linearized.slowest_modes import find_slowest_circulatory
from flexinv.linearized.slowest_roots import find_slowest_roots
from flexinv.model.owned_cache import make_read_only
from flexinv.typing import Array, RealOrComplex

# How many slowest motions are looked at where a mesh has too many for all.
SLOWEST = 30


@jit
def update_start(topology, scheme, state, y):
    """Move the unknowns s by Newton's increments y (unknowns,) [m], [rad], and start from there."""
    apply_increment(topology, scheme, state, y)
    end_step(topology, scheme, state)


def find_rest_position(solver: Solver, q: Array) -> tuple[Joints, Solver]:
    """Bring the solver to the rest position [m], [rad]: of a tree with all joints held, of a loop with its free joints free.

    Return the relative motion of its joints, and the solver of the tree so held (of a loop itself).
    """
    mesh = solver.mesh
    nothing = np.zeros(solver.mesh.mechanism.nv)
    held = solver if mesh.mechanism.closures else Solver.build_for(mesh, set())
    joints = begin_undeformed(solver, q, nothing, nothing)
    solver.update_loads(0.0, q, nothing, nothing)
    if mesh.mechanism.is_rigid:
        update_spring_forces(solver, joints)
        if count := count_constraints(solver):  # the forces G^T lambda = r of least norm that hold it where it stands
            solver.evaluate(STATICS, joints)
            solver.border.ties.multiplier[:count] = solve_closing_forces(solver, solver.work.residual[0])
        return joints, held
    if held is not solver:
        begin_undeformed(held, q, nothing, nothing)
        held.update_loads(0.0, q, nothing, nothing)
    equilibrium = find_equilibrium(held, q, "rest position for modes")
    held.solve_instant(STATICS, equilibrium, "rest position for modes")
    copy_shape(held, solver)
    return joints, held


def copy_shape(held: Solver, solver: Solver) -> None:
    """Give a solver the sections [m], [-] and amplitudes [m] of one whose joints are held."""
    sections = solver.topology.independent
    solver.state.x[sections] = held.state.x[sections]
    solver.state.r[sections] = held.state.r[sections]
    solver.state.place[list_amplitudes(solver.topology)] = held.state.place[list_amplitudes(held.topology)]


def update_spring_forces(solver: Solver, joints: Joints) -> None:
    """Give the springs between points the forces that they have where the mechanism stands [N]."""
    n = count_constraints(solver)
    solver.evaluate(STATICS, joints)
    solver.border.ties.multiplier[n:] += solver.border.ties.value[n:]


def compute_rest_matrices(solver: Solver, joints: Joints) -> Matrices:
    """Return M, C and K [kg, N, m, s] at rest; dry friction, whose effort has no derivative there, is left out."""
    drives = solver.topology.drives.copy()
    drives[2] = 0.0
    return compute_tied_matrices(
        replace(solver, topology=solver.topology._replace(drives=make_read_only(drives))), joints
    )


def compute_tied_matrices(solver: Solver, joints: Joints) -> Matrices:
    """Return M, C and K [kg, N, m, s] of a mechanism with the forces in closures that it has where it stands.

    These act on K by differences (`compute_tie_stiffness`); the march's linearisation leaves out part of that.
    """
    ties = solver.border.ties
    n = count_constraints(solver)
    update_spring_forces(solver, joints)
    force = ties.multiplier.copy()
    tied = compute_tie_stiffness(solver, joints)
    ties.multiplier[:n] = 0.0
    mass, damping, stiffness = compute_matrices(solver, joints)
    ties.multiplier[:] = force
    return Matrices(mass, damping, scipy.sparse.csc_array(stiffness + tied))


def count_unstable_motions(solver: Solver, joints: Joints) -> tuple[int, bool]:
    """Return in how many independent motions a mechanism would leave the rest position that the solver has found [-].

    And whether all motions were looked at: of many freedoms under forces that turn along the slowest alone are.  Dampers decide
    nothing where K is symmetric: what it holds they only slow down (Kelvin, Tait, Chetaev).  Where it is not, they may make a
    column flutter below its undamped load (Ziegler), and roots with damping are looked at.
    """
    if not len(solver.topology.scale):
        return 0, True
    allowed = find_allowed_motions(solver)
    mass, damping, stiffness = compute_rest_matrices(solver, joints)
    k = scipy.sparse.csc_array(allowed.T @ stiffness @ allowed)
    if is_symmetric(k):
        return count_negative_eigenvalues(k), True
    m, c = (scipy.sparse.csc_array(allowed.T @ part @ allowed) for part in (mass, damping))
    few = k.shape[0] <= ONE_AND_ALL
    if abs(c).max() > 0.0:
        root = (find_roots(m, c, k) if few else find_slowest_roots(m, c, k, SLOWEST)).root
        return int(((root.real > 0.0) * (1 + (root.imag > 0.0))).sum()), few
    squared = find_circulatory_modes(k, m)[0] if few else find_slowest_circulatory(k, m, SLOWEST)[0]
    return int(((squared.imag != 0.0) | (squared.real < 0.0)).sum()), few


def compute_nodal_shapes(solver: Solver, shapes: RealOrComplex) -> RealOrComplex:
    """Return displacement [m] (world) and rotation [rad] (own frame) of every node, (modes, nodes, 6)."""
    out = np.zeros((shapes.shape[1], solver.mesh.size, 6), dtype=shapes.dtype)
    t = solver.topology
    variation = solver.variation
    for node, block in enumerate(t.block):
        size = t.size[block]
        first = t.offset[block]
        by_unknowns = np.hstack([variation.x[node, :size], variation.t[node, :size]])  # B^T (columns, 6)
        out[:, node] = shapes[first : first + size].T @ by_unknowns
    for part in range(len(t.shapes.root)):
        _fill_point_shapes(solver, part, shapes, out)
    return out


def _fill_point_shapes(solver: Solver, part: int, shapes: RealOrComplex, out: RealOrComplex) -> None:
    """Set the displacements of a part's points, R (t x r + U y) beside that of the link frame, and its rotation t."""
    t = solver.topology
    motion = solver.work.points
    root = int(t.shapes.root[part])
    points = t.shapes.points
    node = points.node[points.first[part] : points.first[part + 1]]
    at = points.row[part] + points.stride[part] * np.arange(3) + np.arange(len(node))[:, None]  # (point, xyz)
    first = t.first[root] + t.amplitude[part]
    size = t.shapes.size[part]
    turned = np.cross(out[:, root, None, 3:], motion.place[at])
    moved = turned + np.einsum("kpi,km->mpi", motion.slide[:size, at], shapes[first : first + size])
    out[:, node, :3] = out[:, root, None, :3] + moved @ solver.frames.r[root].T
    out[:, node, 3:] = out[:, root, None, 3:]


def compute_tip_displacements(mesh: Mesh, moves: Array, orientation: Array) -> dict[str, Array]:
    """Return displacements of links' tips (motions, 3) [m] world from `compute_nodal_shapes`; orientation : (nodes, 3, 3) [-]."""
    return {
        name: moves[:, node, :3] + np.cross(moves[:, node, 3:], tip) @ orientation[node].T
        for name, node, tip in list_tips(mesh)
    }
