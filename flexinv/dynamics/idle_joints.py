"""Idle joints: motions of passive joints that nothing resists, for the error of a march that cannot determine them.

    M v = 0,  C v = 0,  K v = 0,  G v = 0,        v along passive joints

Two coincident parallel hinges with a massless link between turn against each other like that.
"""

from __future__ import annotations

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.dynamics.constraint_rows import PULL
from flexinv.dynamics.initial_state import begin_undeformed
from flexinv.dynamics.linearization import compute_matrices
from flexinv.dynamics.solver import Solver
from flexinv.errors import ConvergenceError
from flexinv.kinematics.mesh import Mesh
from flexinv.typing import Array, Indices

# Of the largest entry of a matrix, what rounding of some tens of lever arms leaves of a motion that nothing resists.
RESISTED = 1e-14
# Joints whose part of such a motion is below this have none.
MOVED = 1e-6


def find_idle(mesh: Mesh, passive: frozenset[str]) -> list[list[str]]:
    """Return the joints of each motion of the ``passive`` ones that nothing resists where the mechanism is undeformed.

    Joints that move together in such a motion stand in one list.  Empty where everything is resisted, where an element turns too
    much to be linearised, or where masses or stiffnesses are beyond all numbers.
    """
    solver = Solver.build_for(mesh, set(passive))
    topology = solver.topology
    neutral = mesh.mechanism.neutral
    still = np.zeros(mesh.mechanism.nv)
    joints = begin_undeformed(solver, neutral, still, still)
    try:
        matrices = compute_matrices(solver, joints)
    except ConvergenceError:
        return []
    columns, owner = _list_passive_columns(solver)
    ties = solver.border.ties
    rows = [part[:, columns].toarray() for part in matrices]
    rows = [_scale_to_largest(topology.scale[:, None] * part * topology.scale[columns]) for part in rows]
    rows.append(_scale_to_largest(ties.sides[ties.kind != PULL][:, columns] * topology.scale[columns]))
    resisted = np.concatenate(rows)
    if not np.isfinite(resisted).all():
        return []
    free = scipy.linalg.null_space(resisted, rcond=RESISTED)
    moves = np.abs(free) > MOVED * np.abs(free).max(initial=0.0)
    pairs = scipy.sparse.csr_array(moves.astype(float) @ moves.T)
    together = scipy.sparse.csgraph.connected_components(pairs, directed=False)[1]
    names: dict[int, list[str]] = {}
    for place in np.flatnonzero(moves.any(axis=1)):
        members = names.setdefault(int(together[place]), [])
        if owner[place] not in members:
            members.append(owner[place])
    return list(names.values())


def describe_idle_joints(mesh: Mesh, passive: frozenset[str]) -> str:
    """Return the sentence of an error on passive joints that nothing resists, with advice; empty without such joints."""
    said = []
    for names in find_idle(mesh, passive):
        kinds = {mesh.mechanism.joint_of[name].kind for name in names}
        unit = "N_per_m" if kinds == {"prismatic"} else "Nm_per_rad"
        one = len(names) == 1
        listed = f"joint {names[0]!r}" if one else f"joints {', '.join(map(repr, names[:-1]))} and {names[-1]!r}"
        moves = f"{listed} moves" if one else f"{listed} move against each other"
        masses = "mass to what it moves" if one else "mass to a link between them"
        of = "it" if one else "one of them"
        said.append(
            f"{moves}, and nothing resists that: no inertia, no spring, no damper; give {masses}, "
            f"write stiffness_{unit} or rotor_inertia for {of}, or kind = 'fixed'"
        )
    return "; ".join(said)


def _list_passive_columns(solver: Solver) -> tuple[Indices, list[str]]:
    """Return the unknowns that are coordinates of passive joints, (columns,), and the joint of each."""
    topology = solver.topology
    mesh = solver.mesh
    columns = list[int]()
    owner = list[str]()
    for joint in mesh.mechanism.joints:
        node = mesh.joint_node[joint.name]
        first = int(topology.first[node] + topology.column[node])
        columns += range(first, first + int(topology.freedoms[node]))
        owner += [joint.name] * int(topology.freedoms[node])
    return np.array(columns, dtype=np.int64), owner


def _scale_to_largest(part: Array) -> Array:
    """Return a matrix over its largest entry [-], or as it is where all are zero."""
    largest = float(np.abs(part).max(initial=0.0))
    return part / largest if largest > 0.0 else part
