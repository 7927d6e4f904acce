"""Statics: the rest position of a mechanism under gravity and loads, and the torques that hold it."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexinv.analysis.evaluation import FirstStep, assemble_solution
from flexinv.analysis.loops import PhaseHistory, add_reaction_forces
from flexinv.analysis.solution import Solution
from flexinv.analysis.task import Settings, Task, make_rest_history
from flexinv.analysis.trajectory import run_first_step
from flexinv.constraints.closures import build_constraint_rows, list_phases
from flexinv.constraints.continuation import solve_closed_start
from flexinv.constraints.loop_starts import build_joint_mask, find_closed_at
from flexinv.constraints.open_loops import GIVE_Q, replace_advice
from flexinv.dynamics.generalized_alpha import STATICS
from flexinv.dynamics.initial_state import begin_undeformed, find_equilibrium
from flexinv.dynamics.solver import Solver, write_instant
from flexinv.dynamics.system import Trajectory
from flexinv.errors import InputError, ModelWarning
from flexinv.inverse.inverse_dynamics import compute_applied_forces
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.nodal_motion import fill_passive
from flexinv.kinematics.tree import Joints
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.linearized.rest_position import SLOWEST, count_unstable_motions
from flexinv.model import rules
from flexinv.model.frozen import Frozen
from flexinv.model.mechanism import Attachment, Force, Mechanism, Placement
from flexinv.typing import Array
from flexinv.validation import check_kind, check_kinds, convert_to_floats, shown

SETTINGS = Settings(statics=True)


@dataclass(frozen=True, eq=False)
class Load(Frozen):
    """A force and a moment on one link.

    link : name; station : on a beam the fraction 0..1 of the length [-], 1 the tip
    point : on a rigid link the point of application in the link frame, (3,) [m]
    force : (3,) [N]; moment : (3,) [N m]; world axes, or with ``follower`` axes that turn with the section (link)
    """

    link: str
    force: ArrayLike = (0.0, 0.0, 0.0)
    moment: ArrayLike = (0.0, 0.0, 0.0)
    station: float = 1.0
    point: ArrayLike = (0.0, 0.0, 0.0)
    follower: bool = False

    RULES: ClassVar[rules.Rules] = {
        "link": rules.check_text,
        "force": rules.make_array_rule((3,), "N"),
        "moment": rules.make_array_rule((3,), "N m"),
        "station": rules.make_real_rule("-, of the length", 0.0, most=1.0),
        "point": rules.make_array_rule((3,), "m"),
        "follower": rules.check_truth,
    }

    def _describe_record(self) -> str:
        return f"load on {shown(self.link)}: "


def statics(mechanism: Mechanism, loads: Sequence[Load] = (), q: ArrayLike | None = None) -> Solution:
    """Return the equilibrium under gravity and loads with all joints held at ``q``: a Solution of one sample.

    In a loop the drives are held and the passive joints give way; ``q`` is their guess.
    Zero of the residual  f_elastic - m g - loads = 0  on all free nodes; gravity, the mechanism's springs and forces (those of
    t = 0) and the loads are raised in steps as large as Newton converges.  ``torque`` holds the joints; ``tip``, ``deflection``,
    ``wrench``, ``internal`` are those of the rest position; ``stable`` is False where its tangent stiffness is not positive
    definite, as of a straight column beyond its buckling load, or where forces that turn along make it flutter, as of Beck's
    column, or where dampers let them (a ModelWarning says so, too).  Of more than 300 freedoms under such forces the 30 slowest
    motions alone are looked at: ``notes`` says so.

    q : (nq,) [rad], [m], all joints at zero by default
    Raises InputError for a load that cannot act, ConvergenceError with the part of the load that was reached.
    """
    check_kind("mechanism", mechanism, Mechanism)
    at = mechanism.neutral if q is None else convert_to_floats("statics: q", q)
    if at.shape != (mechanism.nq,) or not np.isfinite(at).all():
        expected = f"expected ({mechanism.nq},) finite numbers: {mechanism.coordinate_names}"
        raise InputError(f"statics: q has shape {at.shape}, {expected}")
    forces = [_make_force(mechanism, load, k) for k, load in enumerate(check_kinds("loads", loads, Load))]
    damped = apply_stated_ratio(mechanism)
    mesh = build(replace(damped, forces=(*mechanism.forces, *forces)))
    passive = mechanism.undriven_names if mechanism.closures else ()
    if mechanism.closures and q is not None:
        with replace_advice(GIVE_Q):
            at = find_closed_at(mesh, at)
    if mechanism.is_rigid:
        rest = np.zeros(mechanism.nv)
        held = make_rest_history(at, rest, rest)
        with replace_advice(GIVE_Q):
            (first,) = run_first_step(Task(mesh, np.zeros(1), held, held, passive, SETTINGS))
        return assemble_solution(mesh, first, SETTINGS)
    solver, joints, first = _solve_equilibrium(mesh, passive, at)
    solution = assemble_solution(mesh, first, SETTINGS)
    unstable, all_of_them = count_unstable_motions(solver, joints)  # a word on whether a structure stays there
    slowest = (
        f"statics of '{mechanism.name}': loads turn along or are moments; of its many motions the {SLOWEST} slowest were looked "
        "at: that faster ones are stable is not proved",
    )
    notes = solution.notes if all_of_them else (*solution.notes, *slowest)
    if not unstable:
        return replace(solution, stable=True, notes=notes)
    note = _describe_instability(mechanism, unstable)
    warnings.warn(note, ModelWarning, stacklevel=2)
    return replace(solution, stable=False, notes=(*notes, note))


def _solve_equilibrium(mesh: Mesh, passive: Collection[str], at: Array) -> tuple[Solver, Joints, FirstStep]:
    """The solver and the joints at rest, and the first step of one sample there; at : (nq,) of the joints, a guess in a loop."""
    now = np.zeros(1)
    rest = np.zeros((1, mesh.mechanism.nv))
    solver = Solver.build_for(mesh, passive)
    (phase,) = list_phases(mesh.mechanism, now)
    switching = PhaseHistory(mesh, phase, solver.border.ties)
    if mesh.mechanism.closures:
        rows = build_constraint_rows(mesh).take_active(phase.active)
        unknown = build_joint_mask(mesh.mechanism, passive)
        with replace_advice(GIVE_Q):
            at = solve_closed_start(mesh, (at, rest[0], rest[0]), 0.0, unknown, rows)[0]
    solver.update_loads(0.0, at, rest[0], rest[0])
    begin_undeformed(solver, at, rest[0], rest[0])
    joints = find_equilibrium(solver, at, "statics")
    out = Trajectory.make_zero(1, mesh, solver.instant.multipliers.shape[1])
    iterations = solver.solve_instant(STATICS, joints, "statics")
    write_instant(solver, 0, out)
    out.iterations[0] = iterations
    joint_motion = at[None].copy(), rest, rest.copy()
    fill_passive(mesh, out.motion, passive, *joint_motion)
    first = FirstStep(out, now, joint_motion, compute_applied_forces(mesh, out.motion, now), smooth=passive)
    if mesh.mechanism.closures:
        first = add_reaction_forces(mesh, first, switching)
    return solver, joints, first


def _describe_instability(mechanism: Mechanism, unstable: int) -> str:
    count = f"{unstable} unstable eigenvalue{'s' * (unstable > 1)} (negative: divergence; complex: flutter)"
    return (
        f"statics of '{mechanism.name}': this equilibrium is unstable, its tangent stiffness has {count}: a structure "
        "leaves it, as a column does under more than its buckling load; write a smaller load, or let flexinv.solve show where it "
        "goes, with a load across and damped beams"
    )


def _make_force(mechanism: Mechanism, load: Load, number: int) -> Force:
    """The force of a load; raises InputError for one on a link that there is not."""
    if load.link not in mechanism.link_of:
        known = f"'{mechanism.name}'; its links are {', '.join(mechanism.link_of)}"
        raise InputError(f"load: no link {shown(load.link)} in {known}")
    station = None if mechanism.link_of[load.link].beam is None else load.station
    at = Attachment(load.link, Placement(np.asarray(load.point)), station)
    wrench = np.concatenate([load.force, load.moment])[None]
    return Force(f"load {number} of statics", at, wrench, follower=load.follower)
