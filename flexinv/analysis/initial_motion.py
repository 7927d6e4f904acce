"""Initial motion of a march: undeformed or in static equilibrium, moving, with the accelerations that belong to it.

A rest position in which it begins is judged: a ModelWarning says where it is unstable.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from flexinv.dynamics.dofs import list_amplitudes
from flexinv.dynamics.generalized_alpha import ACCELERATIONS
from flexinv.dynamics.initial_state import begin_undeformed, fill_initial_unknowns, find_equilibrium
from flexinv.dynamics.solver import Solver
from flexinv.errors import ModelWarning
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.tree import Joints, compute_tree_motion
from flexinv.linearized.rest_position import count_unstable_motions
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array

# Unknowns up to which the stiffness at the start is judged: its dense matrices then take some hundred megabytes.
MOST_JUDGED = 3000


def begin_motion(solver: Solver, motion: Sequence[Array], time: float, initial: str, when: str) -> Joints:
    """Start at a motion q (nq,), qd, qdd (nv,) [m, rad, s], with the accelerations that belong to it; return that of the joints.

    initial : "consistent" (undeformed) or "static" (in equilibrium at a time [s]).  Raises ConvergenceError.
    """
    q, qd, qdd = motion
    joints = begin_undeformed(solver, q, qd, qdd)
    solver.update_loads(time, q, qd, qdd)
    if initial == "static":
        steady = solver.efforts is None or _begin_with_fixed_drives(solver, q, time, when)
        if solver.efforts is None:
            _begin_at_equilibrium(solver, q, when)
        if steady:
            _move_as_rigid(solver, joints, qd, qdd)
    solver.solve_instant(ACCELERATIONS, joints, when)
    return joints


def _begin_with_fixed_drives(solver: Solver, q: Array, time: float, when: str) -> bool:
    """Put a mechanism that torques move into its equilibrium at a time [s] with all driven joints held at q (nq,) [rad], [m].

    Were they free, joints with nothing to hold them (a vertical axis) would have no one equilibrium, and a first torque seldom
    is just what holds the others.  False where nothing is left that could settle.
    """
    mesh = solver.mesh
    t = solver.topology
    still = np.zeros(mesh.mechanism.nv)
    held = Solver.build_for(mesh, mesh.mechanism.undriven_names)
    if not len(held.topology.scale):
        return False
    acting = held.border.ties
    ties = solver.border.ties
    acting.acting[:] = ties.acting
    acting.place_b[:] = ties.place_b
    acting.w[:] = ties.w
    begin_undeformed(held, q, still, still)
    held.update_loads(time, q, still, still)
    _begin_at_equilibrium(held, q, when)
    nodes = held.topology.independent | (held.topology.freedoms > 0)
    solver.state.x[nodes] = held.state.x[nodes]
    solver.state.r[nodes] = held.state.r[nodes]
    for n in np.flatnonzero(held.topology.freedoms):
        of, to = (int(part.first[n] + part.column[n]) for part in (held.topology, t))
        solver.state.place[to : to + t.freedoms[n]] = held.state.place[of : of + t.freedoms[n]]
    solver.state.place[list_amplitudes(t)] = held.state.place[list_amplitudes(held.topology)]
    solver.frames.x[:] = held.frames.x
    solver.frames.r[:] = held.frames.r
    ties.multiplier[:] = acting.multiplier
    return True


def _begin_at_equilibrium(solver: Solver, q: Array, when: str) -> None:
    """Begin in the `find_equilibrium` of the starting position q (nq,) [rad], [m], with a ModelWarning where that is unstable."""
    joints = find_equilibrium(solver, q, when)
    s = solver.state
    loads = solver.loads
    ties = solver.border.ties
    parts = (s.x, s.r, s.place, loads.wrench, loads.effort, ties.multiplier, ties.acting, solver.topology.freedoms)
    # all that the stiffness of a rest position follows from, beside the mesh
    here = b"".join(part.tobytes() for part in (*parts, *solver.frames))
    stable = _list_stable_positions(solver.mesh)
    if len(solver.topology.scale) > MOST_JUDGED or here in stable:
        return
    forces = ties.multiplier.copy()
    unstable, _ = count_unstable_motions(solver, joints)
    ties.multiplier[:] = forces  # a start that is judged has the digits of one whose position was judged before
    if not unstable:
        stable.clear()
        stable.add(here)
        return
    mesh = solver.mesh
    free = solver.topology.freedoms
    names = ", ".join(j.name for j in mesh.mechanism.joints if free[mesh.joint_node[j.name]])
    count = f"{unstable} independent motion{'s' * (unstable > 1)} of it, alone or swinging, would grow"
    beside = f"write a start beside it for {names}, from which the mechanism sinks to another"
    begins = f"the rest position in which it begins is unstable ({count}), and is not the only one"
    advice = f"{beside if names else 'write a smaller load'}, or initial = 'consistent'"
    warnings.warn(f"mechanism '{mesh.mechanism.name}', {when}: {begins}; {advice}", ModelWarning, stacklevel=2)


@make_owner_cache()
def _list_stable_positions(mesh: Mesh) -> set[bytes]:
    """The rest position of a mesh, in bytes, that was found stable last: marches begin in it again and again."""
    return set()


def _move_as_rigid(solver: Solver, joints: Joints, qd: Array, qdd: Array) -> None:
    """Give the deformed mechanism the velocities [m/s] it has when it moves on without changing its deformation."""
    mesh = solver.mesh
    frames = solver.frames
    t = solver.topology
    shape = Joints(*(part.copy() for part in joints))
    free = np.flatnonzero(t.independent | (t.shapes.part >= 0))
    held = t.freedoms > 0
    parent = mesh.parent[free]
    back = frames.r[mesh.parent[free]].transpose(0, 2, 1)
    shape.p[free] = (back @ (frames.x[free] - frames.x[parent])[:, :, None])[:, :, 0]
    shape.r[free] = back @ frames.r[free]
    shape.p[held] = solver.state.x[held]
    shape.r[held] = solver.state.r[held]
    moving = NodalMotion.make_uninitialized(1, mesh.size)
    compute_tree_motion(mesh.parent, moving.frames, Joints(*(part[None] for part in shape)))
    fill_initial_unknowns(solver, moving, shape, qd, qdd)
