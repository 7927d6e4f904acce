"""Start of a march as a function of mechanism and motion, and its first steps where something sudden makes them in parts."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from flexinv.analysis.evaluation import FirstStep, add_joint_efforts, run_second_step
from flexinv.analysis.initial_motion import begin_motion
from flexinv.analysis.loops import PhaseHistory, add_reaction_forces
from flexinv.analysis.task import Settings, Task
from flexinv.constraints.closures import (
    build_constraint_rows,
    compute_coupling_residuals,
    evaluate_closures,
    list_phases,
)
from flexinv.constraints.continuation import close_rates, solve_closing_step
from flexinv.constraints.loop_starts import build_joint_mask
from flexinv.dynamics.generalized_alpha import build_start_scheme
from flexinv.dynamics.initial_state import begin_step
from flexinv.dynamics.loads import build_load_table
from flexinv.dynamics.solver import Solver, build_coordinate_map, write_instant
from flexinv.dynamics.stepper import CONVERGED, integrate_instants
from flexinv.dynamics.system import Instants, Trajectory
from flexinv.inverse.inverse_dynamics import compute_applied_forces
from flexinv.kernels.so3 import log_so3
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import (
    NodalMotion,
    compute_relative_motion,
    compute_rigid_motion,
    fill_passive,
    integrate_configuration,
)
from flexinv.kinematics.tree import Joints
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.model.mechanism import Mechanism
from flexinv.sensitivity.march_states import FreeSystem
from flexinv.typing import Array, Indices, Triple

POLISHING = 2  # Newton's steps: from 1e-12 to rounding


@dataclass(frozen=True)
class MarchStart:
    """State in which a march begins, its solver still there.

    x, r : (sections, 3), (sections, 3, 3); place : (nv,) of passive joints [rad], [m]
    u, du, pseudo : (marched,) rates, accelerations and the integrator's own ones [m, rad, s]
    effort : (nv,) of all joints then, from nodal accelerations [N m], [N]; sudden : whether the first steps are made in parts
    """

    solver: Solver
    x: Array
    r: Array
    place: Array
    u: Array
    du: Array
    pseudo: Array
    effort: Array
    sudden: bool


def begin_march(
    mechanism: Mechanism, passive: Collection[str], joints: Triple, time: float, settings: Settings
) -> MarchStart:
    """Return the state in which a march begins at a time [s], with joints at q (nq,), qd, qdd (nv,) [rad or m, s].

    Raises ConvergenceError where there is none.
    """
    mesh = build(apply_stated_ratio(mechanism))
    solver = Solver.build_for(mesh, set(passive))
    when = f"at the start, t = {time:g} s"
    relative = begin_motion(solver, joints, time, settings.initial, when)
    du = solver.state.du.copy()
    effort = _compute_efforts(solver, joints, time)
    sudden = begin_step(solver, relative, settings.scheme, when)
    s = solver.state
    sections = np.flatnonzero(solver.topology.independent)
    place = build_coordinate_map(mesh, solver.topology) @ s.place
    return MarchStart(
        solver, s.x[sections].copy(), s.r[sections].copy(), place, s.u.copy(), du, s.pseudo.copy(), effort, bool(sudden)
    )


def _compute_efforts(solver: Solver, joints: Triple, time: float) -> Array:
    """Efforts (nv,) of all joints where the solver stands [N m], [N], by the second step of the scheme."""
    mesh = solver.mesh
    instant = np.array([time])
    trajectory = Trajectory.make_zero(1, mesh, _count_rows(solver))
    write_instant(solver, 0, trajectory)
    q, qd, qdd = (part[None].copy() for part in joints)
    fill_passive(mesh, trajectory.motion, solver.passive, q, qd, qdd)
    applied = compute_applied_forces(mesh, trajectory.motion, instant)
    first = FirstStep(trajectory, instant, (q, qd, qdd), applied, smooth=solver.passive)
    if mesh.mechanism.closures:
        phase = list_phases(mesh.mechanism, instant)[0]
        first = add_reaction_forces(mesh, first, PhaseHistory(mesh, phase, None))
    found = run_second_step(mesh, first)
    efforts, _ = add_joint_efforts(mesh.mechanism, first, found.tau, found.reaction)
    return np.asarray(efforts[0])


def _count_rows(solver: Solver) -> int:
    """Rows of the closures."""
    return int(solver.instant.multipliers.shape[1])


def compute_start_offsets(start: MarchStart, base: MarchStart, system: FreeSystem) -> Array:
    """Return by how much a start is off another one, (4, unknowns) [m, rad, s].

    Rows: pose, rate, acceleration, and the integrator's own one.
    """
    out = np.zeros((4, system.size))
    to = _list_unknowns(system, start.solver)
    for row, (one, other) in enumerate(((start.u, base.u), (start.du, base.du), (start.pseudo, base.pseudo)), start=1):
        out[row, to] = one - other
    out[0, system.unknown] = start.place - base.place
    out[0, system.first[:, None] + np.arange(3)] = start.x - base.x
    turned = log_so3(np.einsum("nji,njk->nik", base.r, start.r)) if len(base.r) else np.zeros((0, 3))
    out[0, system.first[:, None] + np.arange(3, 6)] = turned
    return out


def collect_accelerations(start: MarchStart, system: FreeSystem) -> Array:
    """Return the integrator's own accelerations (unknowns,) at a start [m/s^2], [rad/s^2], zero for joints with a motion."""
    out = np.zeros(system.size)
    out[_list_unknowns(system, start.solver)] = start.pseudo
    return out


def _list_unknowns(system: FreeSystem, solver: Solver) -> Indices:
    """Of each marched unknown of a solver its place among those of the free system."""
    t = solver.topology
    to = np.zeros(len(t.scale), dtype=np.int64)
    sections = np.flatnonzero(t.independent)
    to[t.first[sections][:, None] + np.arange(6)] = system.first[:, None] + np.arange(6)
    coordinates = build_coordinate_map(solver.mesh, t)
    v, at = np.nonzero(coordinates)
    to[at] = system.unknown[v]
    return to


def integrate_parts(start: MarchStart, joints: Triple, time: Array, settings: Settings) -> tuple[NodalMotion, Triple]:
    """Return the motion of nodes and joints at the start and at all parts of the first steps [m, rad, s].

    joints : q (1 + parts, nq), qd, qdd (1 + parts, nv) of those with a motion; time : (1 + parts,) [s]
    Raises ConvergenceError where Newton fails.
    """
    solver = start.solver
    mesh = solver.mesh
    relative = compute_relative_motion(mesh, *joints)
    loads = build_load_table(mesh, time)
    coupled = solver.compute_coupling_terms(*joints)
    out = Trajectory.make_zero(len(time), mesh, _count_rows(solver))
    write_instant(solver, 0, out)
    rest = out.take_samples(1, len(time))
    instants = Instants(
        Joints(*(part[1:] for part in relative)), loads[1:], solver.evaluate_drives(time[1:]), coupled[1:]
    )
    scheme = build_start_scheme(settings.scheme)
    status, sample, count, size = integrate_instants(*solver.prepare_arguments(scheme, instants, rest))
    if status != CONVERGED:
        raise solver.make_step_error(status, count, size, f"at t = {time[1 + sample]:g} s", scheme.h)
    q, qd, qdd = (part.copy() for part in joints)
    fill_passive(mesh, out.motion, solver.passive, q, qd, qdd)
    return out.motion, (q, qd, qdd)


def close_start(task: Task, joints: Triple) -> Triple:
    """Return the joints (1, ...) at a start [rad or m, s] with the loops closed to rounding, where 1e-12 or so is left.

    What is left there, over a small change of a parameter, is no small error of a derivative where beams are stiff.
    """
    mesh = task.mesh
    mechanism = mesh.mechanism
    q, qd, qdd = (part[0].copy() for part in joints)
    rows = build_constraint_rows(mesh).take_active(list_phases(mechanism, task.steps)[0].active)
    unknown = build_joint_mask(mechanism, task.passive)
    for _ in range(POLISHING):
        state = (q[None], qd[None], qdd[None])
        phi, (g,) = evaluate_closures(mesh, compute_rigid_motion(mesh, *state), rows)
        opening = phi[0, :, 0] + compute_coupling_residuals(rows, *state)[0][0]
        q = integrate_configuration(mechanism, q, solve_closing_step(mesh, rows, g, opening, unknown))
    close_rates(mesh, rows, q, qd, qdd, [unknown])
    return q[None], qd[None], qdd[None]
