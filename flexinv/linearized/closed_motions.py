"""The motions that closures allow, y = N z with G N = 0, and what forces in closures add to the stiffness."""

from __future__ import annotations

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.constraints.allocation import REDUNDANT
from flexinv.constraints.closures import build_constraint_rows
from flexinv.dynamics.generalized_alpha import STATICS
from flexinv.dynamics.solver import Solver
from flexinv.kinematics.tree import Joints
from flexinv.typing import Array, Sparse


def count_constraints(solver: Solver) -> int:
    """Return the number [-] of the border's rows that are constraints; springs follow."""
    return int(solver.instant.multipliers.shape[1])


# Central differences of the closures' gradients, fourth order: their derivatives are of the size of one over the mechanism's
# length, rounding 1e-16 / STEP and truncation STEP^4 / 30 leave 1e-12 of it.
STEP = 1e-3


def compute_tie_stiffness(solver: Solver, joints: Joints) -> Sparse:
    """Return -d(G^T lambda) / dy [N/m], [N m]: what forces in closures add to the stiffness where something loads them."""
    n = count_constraints(solver)
    size = len(solver.topology.scale)
    force = solver.border.ties.multiplier[:n].copy()
    k = scipy.sparse.lil_array((size, size))
    if not np.any(force):
        return scipy.sparse.csc_array(k)

    def compute_tie_force(unknown: int, step: float) -> Array:
        solver.state.d[unknown] = step * solver.topology.scale[unknown]
        solver.evaluate(STATICS, joints)
        solver.state.d[unknown] = 0.0
        return solver.border.ties.sides[:n].T @ force

    plan = solver.border.ties.layout  # the gradient of a row moves with the unknowns of its own nodes only
    for unknown in np.unique(plan.unknown[: plan.first_unknown[n]]).tolist():
        near = compute_tie_force(unknown, STEP) - compute_tie_force(unknown, -STEP)
        far = compute_tie_force(unknown, 2 * STEP) - compute_tie_force(unknown, -2 * STEP)
        k[:, [unknown]] = ((8 * near - far) / (12 * STEP * solver.topology.scale[unknown]))[:, None]
    return scipy.sparse.csc_array(k)


def find_allowed_motions(solver: Solver) -> Sparse:
    """Return N (unknowns, freedoms) [m], [rad]: the motions that closures allow.

    In scaled unknowns: as many of them as closures have independent rows follow the others, those with the largest pivots.
    """
    scale = solver.topology.scale
    every = scipy.sparse.diags_array(scale)
    g, _ = compute_scaled_gradient(solver)
    touched = np.flatnonzero(g.any(axis=0))
    if not len(touched):
        return scipy.sparse.csc_array(every)
    r, pivot = scipy.linalg.qr(g[:, touched], mode="r", pivoting=True)
    size = np.abs(np.diag(r))
    rank = int((size > REDUNDANT * size[0]).sum())
    follow = -scipy.linalg.solve_triangular(r[:rank, :rank], r[:rank, rank:])
    moves = np.ones(len(scale), dtype=bool)
    moves[touched[pivot[:rank]]] = False
    number = np.cumsum(moves) - 1
    by = scipy.sparse.lil_array((len(scale), int(moves.sum())))
    by[np.flatnonzero(moves), number[moves]] = 1.0
    if rank < len(pivot):
        by[np.ix_(touched[pivot[:rank]], number[touched[pivot[rank:]]])] = follow
    return scipy.sparse.csc_array(every @ scipy.sparse.csc_array(by))


def compute_scaled_gradient(solver: Solver) -> tuple[Array, Array]:
    """Return G (rows, unknowns) [-] of the acting closures, lengths over the mechanism's, and the rows' scales [m], [-]."""
    scales = build_constraint_rows(solver.mesh).scale
    return -solver.border.ties.sides[: count_constraints(solver)] * solver.topology.scale / scales[:, None], scales


def solve_closing_forces(solver: Solver, residual: Array) -> Array:
    """Return the multipliers (rows,) [N], [N m] of least norm that hold a residual (unknowns,), G^T lambda = r."""
    g, scales = compute_scaled_gradient(solver)
    return np.linalg.lstsq(g.T, solver.topology.scale * residual, rcond=REDUNDANT)[0] / scales
