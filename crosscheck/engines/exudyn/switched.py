"""Closures that act for a while beside beams, in Exudyn: one phase after the other, each from the state where the last has ended.

All phases have the same bodies and beams with the same reference, so that the coordinates of one are those of the next; they
differ in their connectors.  A closure that captures gets its second frame where the first one stands in the engine's solution.

At an instant where closures begin to act the velocities jump (a plastic impact), by the engine's own mass matrix M, its Jacobian
G of all connectors of the phase that begins, and what its equations leave at velocity level, r = G v - w(t):

    M dv + G^T L = 0        G dv = -r

The integrator is that of index 3 with a spectral radius of 0.5 throughout: what a switch sets ringing beyond the steps dies out
within some 20 of them.  The engine finds the accelerations after a switch without those of the motion (`exudyn_lead`), so drives
have to be at rest there.  Reactions of closures are not given: where frames were captured is the engine's own.
"""

from __future__ import annotations

import contextlib
import time as clock
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines.base import Options, sample_times
from crosscheck.engines.exudyn import lead_in as exudyn_lead
from crosscheck.engines.exudyn import loops as exudyn_loops
from crosscheck.engines.exudyn.integration import Begin, NewtonStalled, Plan, build_solver_settings, compute_step_size
from crosscheck.engines.exudyn.lead_in import ExtendedMotion, move_force_times
from crosscheck.engines.exudyn.models import chain as exudyn_chain
from crosscheck.engines.exudyn.models import planar as exudyn_planar
from crosscheck.engines.exudyn.models import spatial as exudyn_spatial
from crosscheck.engines.exudyn.models.connectors import HELD
from crosscheck.engines.exudyn.models.frames import Array, compose
from crosscheck.engines.exudyn.models.layout import Layout, build_layout, find_attachment_frame
from crosscheck.engines.exudyn.models.parts import Outcome, Poses
from crosscheck.engines.exudyn.run_in_time import ANCF, NAMES, TimedRun, TimedSettings
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.engines.shared import phases
from crosscheck.measures.budget import Family, add_error_bars, compute_richardson_limit
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Attachment, Closure, Mechanism, Placement

STEPS = 4000  # of the coarse run over the whole case
# Singular values of the impact's equations below this part of the largest are those of massless links and redundant equations.
SINGULAR = 1e-12


@dataclass(frozen=True)
class State:
    """Coordinates and velocities of a system between two phases, in the engine's order and units."""

    place: Array
    rate: Array


@dataclass(frozen=True)
class PhaseSegment:
    """A phase: samples of the case, where it begins [s], and which closures act in it."""

    samples: slice
    start: float
    acting: frozenset[str]


def apply_all_closures(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with all its closures at once, for good: what is asked of it does not depend on when they act."""
    return replace(
        mechanism, closures=tuple(replace(c, active=(), capture=False, impact="error") for c in mechanism.closures)
    )


def describe_refusal(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason that excludes a mechanism with beams whose closures act for a while, in words, or None."""
    if reason := exudyn_loops.describe_refusal(apply_all_closures(mechanism), case, engine):
        return reason
    instants = np.array([piece.start for piece in list_phases(mechanism, case)[1:]])
    if not len(instants):
        return None
    span = case.motion.evaluate(mechanism, np.linspace(0.0, case.end, 101))
    free = assembly.find_unprescribed_joints(mechanism, case)
    for joint in mechanism.joints:
        columns = mechanism.v_slices[joint.name]
        for here, whole in zip(case.motion.evaluate(mechanism, instants)[1:], span[1:], strict=True):
            most = np.abs(whole[:, columns]).max(initial=0.0)
            if joint.name not in free and np.abs(here[:, columns]).max(initial=0.0) > exudyn_lead.REFUSED * most:
                return (
                    f"joint {joint.name} moves where closures switch: Exudyn finds the accelerations there without those of the "
                    "motion and takes none from outside"
                )
    return None


def list_phases(mechanism: Mechanism, case: Case) -> list[PhaseSegment]:
    """Return the phases of a case."""
    time = sample_times(case)
    cuts = phases.list_phase_bounds(mechanism, time)
    out = []
    for first, last in pairwise(cuts):
        acting = frozenset(c.name for c in phases.apply_active_closures(mechanism, float(time[first])).closures)
        out.append(PhaseSegment(slice(first, last), float(time[first]), acting))
    return out


def build_model(mechanism: Mechanism, case: Case, engine: str) -> exudyn_loops.Model:
    """Return the integrated model, without any phase's closures.  Raises AssemblyError where the first ones do not close."""
    now = phases.apply_active_closures(mechanism, 0.0)
    at = np.zeros(1)
    q, qd, _ = (part[0] for part in exudyn_chain.evaluate_closed_motion(now, case, at))
    if not now.closures:
        q = assembly.apply_guess(mechanism, case, q[None])[0]
    layout = build_layout(mechanism, q, qd)
    free = exudyn_loops.compute_free_coordinates(mechanism, case, q)
    plane = exudyn_planar.find_plane(apply_all_closures(mechanism), layout, frozenset(free))
    history = ExtendedMotion(replace(mechanism, closures=()), case)
    return exudyn_loops.Model(history, engine, layout, None if isinstance(plane, str) else plane, free, {})


def integrate_switched_beams(mechanism: Mechanism, case: Case, engine: str, options: Options) -> TimedRun:
    """Return torque [N m] or [N], tip [m], wrench, deflection [m] and axial force [N], each with its bar."""
    start = clock.perf_counter()
    model = build_model(mechanism, case, engine)
    plans = plan_runs(case, options)
    elements = exudyn_loops.list_mesh_sizes(len(plans), options)
    done = [_integrate_with_retries(mechanism, model, n, plan) for n, plan in zip(elements, plans, strict=True)]
    runs = [exudyn_loops.collect_flexible_series(model, outcome) for outcome, _ in done]
    made, budget = add_error_bars(compute_richardson_limit(runs), [Family("mesh and step", runs, "limit")])
    told: TimedSettings = {
        "model": "planar bodies" if model.plane is not None else "bodies with Euler parameters",
        "closures": "connectors of each phase; velocities jump by the engine's mass matrix and Jacobian",
        "element": NAMES[engine, model.plane is not None],
        "elements_per_beam": elements,
        "phases": [sorted(piece.acting) for piece in list_phases(mechanism, case)],
        "step_s": [plan.step for _, plan in done],
        "integrator": plans[0].integrator,
        "newton_tolerance": [plan.tolerance for _, plan in done],
        "extrapolation": "(4 fine - coarse) / 3: the error is of order h^2",
    }
    return TimedRun(made, told, clock.perf_counter() - start, budget)


def plan_runs(case: Case, options: Options) -> list[Plan]:
    """Return the runs from coarse to fine, steps in [s], ends those of the whole case."""
    behind = 1 if options.get("error", True) else 0
    wanted = float(options.get("step", case.end / STEPS)) / 2 ** int(options.get("refinement", 0))
    plan = Plan(
        end=(len(sample_times(case)) - 1) * case.sample,
        step=compute_step_size(case.sample, wanted * 2**behind),
        sample=case.sample,
        index2=False,
        spectral_radius=0.5,
        tolerance=exudyn_loops.NEWTON[0],
    )
    return [replace(plan, step=plan.step / 2**k) for k in range(behind + 2)]


def _integrate_with_retries(
    mechanism: Mechanism, model: exudyn_loops.Model, elements: int, plan: Plan
) -> tuple[Outcome, Plan]:
    """Integrate all phases; the plan comes back with the tolerance that held."""
    for tolerance in exudyn_loops.NEWTON[:-1]:
        one = replace(plan, tolerance=tolerance)
        with contextlib.suppress(NewtonStalled):
            return _integrate(mechanism, model, elements, one), one
    last = replace(plan, tolerance=exudyn_loops.NEWTON[-1])
    return _integrate(mechanism, model, elements, last), last


def _integrate(mechanism: Mechanism, model: exudyn_loops.Model, elements: int, plan: Plan) -> Outcome:
    parts: list[Outcome] = []
    state: State | None = None
    before: dict[str, Closure] = {}
    pose: dict[int, Poses] = {}
    all_pieces = list_phases(mechanism, model.case)
    for piece in all_pieces:
        stated = [c for c in mechanism.closures if c.name in piece.acting]
        acting = {c.name: before.get(c.name) or _apply_capture(model.layout, c, pose) for c in stated}
        settings = replace(
            plan,
            end=(piece.samples.stop - piece.samples.start - (piece is all_pieces[-1])) * plan.sample,
            static_start=state is None and model.case.initial == "static",
        )
        outcome, state = _integrate_phase(
            mechanism, model, (elements, settings, piece.start), tuple(acting.values()), state
        )
        pose = {index: (x[-1:], r[-1:]) for index, (x, r) in outcome.pose.items()}
        parts.append(outcome if piece is all_pieces[-1] else _drop_last_sample(outcome))
        before = acting
    return _join_outcomes(parts)


def _integrate_phase(
    mechanism: Mechanism,
    model: exudyn_loops.Model,
    how: tuple[int, Plan, float],
    acting: tuple[Closure, ...],
    state: State | None,
) -> tuple[Outcome, State]:
    """Integrate one phase from a state (None: from the layout) and return the state where it ends."""
    elements, plan, start = how
    m = move_force_times(replace(mechanism, closures=tuple(replace(c, active=()) for c in acting)), -start)
    before = round(start / plan.step)  # a whole number: phases begin at samples
    q, qd, _ = model.case.motion.evaluate(mechanism, plan.step * np.arange(before + plan.steps + 1))
    begin = None if state is None else _make_state_setter(state, plan)
    drawing: Any
    if model.plane is None:
        held = {c.name: list(HELD[c.kind]) for c in m.closures}
        drawing = exudyn_spatial.build(m, model.layout, model.engine == ANCF, elements, frozenset(model.free), held)
        outcome = exudyn_spatial.run(drawing, plan, q, begin)
    else:
        drawing = exudyn_planar.build(m, model.layout, model.plane, model.engine == ANCF, elements, model.free)
        outcome = exudyn_planar.run(drawing, plan, q, qd, begin)
    data = drawing.model.mbs.systemData
    return replace(outcome, closure={}), State(
        np.array(data.GetODE2Coordinates()), np.array(data.GetODE2Coordinates_t())
    )


def _make_state_setter(state: State, plan: Plan) -> Begin:
    """Return a function that puts a system into a state, its velocities those that the connectors allow."""

    def begin(mbs: Any) -> None:
        mbs.Assemble()  # drivers were put in since; later it would take the state back
        mbs.systemData.SetODE2Coordinates(state.place, configuration=exu.ConfigurationType.Initial)
        mbs.systemData.SetODE2Coordinates_t(state.rate, configuration=exu.ConfigurationType.Initial)
        jump = compute_velocity_jump(mbs, plan)
        mbs.systemData.SetODE2Coordinates_t(state.rate + jump, configuration=exu.ConfigurationType.Initial)

    return begin


def compute_velocity_jump(mbs: Any, plan: Plan) -> Array:
    """Return the jump of the initial velocities by which the connectors stop what they tie, in the engine's coordinates."""
    solver: Any = exu.MainSolverImplicitSecondOrder()
    solver_settings = build_solver_settings(plan)
    solver_settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False
    solver.InitializeSolver(mbs, solver_settings)
    solver.ComputeMassMatrix(mbs, 1.0)
    mass = np.array(solver.GetSystemMassMatrix())
    n = len(mass)
    size = n + solver.GetAEsize()
    solver.SetSystemJacobian(np.zeros((size, size)))
    solver.ComputeJacobianAE(mbs, scalarFactor_ODE2=1.0, scalarFactor_ODE2_t=0.0, velocityLevel=False)
    g = np.array(solver.GetSystemJacobian())[n:, :n]
    solver.ComputeAlgebraicEquations(mbs, velocityLevel=True)
    left = np.array(solver.GetSystemResidual())[n:]
    solver.FinalizeSolver(mbs, solver_settings)
    whole = np.block([[mass, g.T], [g, np.zeros((len(g), len(g)))]])
    # rows and columns of one size: slopes, angles, positions and multipliers have units of their own
    scale = 1.0 / np.sqrt(np.maximum(np.abs(whole).max(axis=1), np.finfo(float).tiny))
    found = np.linalg.lstsq(scale[:, None] * whole * scale, scale * np.append(np.zeros(n), -left), rcond=SINGULAR)[0]
    return np.asarray((scale * found)[:n])


def _apply_capture(layout: Layout, closure: Closure, pose: dict[int, Poses]) -> Closure:
    """Return a closure that begins to act, one that captures with its second frame where the first one stands."""
    if not closure.capture or not pose:
        return closure
    first = _compute_frame_pose(layout, closure.first, pose)
    carrier = _compute_frame_pose(layout, replace(closure.second, placement=Placement()), pose)
    turned = carrier.rotation.T
    rotation = closure.second.placement.rotation if closure.kind == "universal" else turned @ first.rotation
    placement = Placement(turned @ (first.position - carrier.position), rotation)
    return replace(closure, second=replace(closure.second, placement=placement))


def _compute_frame_pose(layout: Layout, at: Attachment, pose: dict[int, Poses]) -> Placement:
    """Return the placement of a frame in the world."""
    attachment_frame = find_attachment_frame(layout, at)
    x, r = pose[attachment_frame.group]
    return compose(Placement(x[0], r[0]), attachment_frame.placement)


def _drop_last_sample(outcome: Outcome) -> Outcome:
    """Return an outcome without the instant at which the next phase begins."""
    return Outcome(
        pose={k: (x[:-1], r[:-1]) for k, (x, r) in outcome.pose.items()},
        **{part: {k: v[:-1] for k, v in getattr(outcome, part).items()} for part in ("end", "wrench", "root")},
    )


def _join_outcomes(parts: list[Outcome]) -> Outcome:
    """Return the outcomes of all phases as one."""
    first = parts[0]
    return Outcome(
        pose={k: tuple(np.concatenate([p.pose[k][i] for p in parts]) for i in range(2)) for k in first.pose},  # type: ignore[misc]
        **{part: phases.join_series(getattr(p, part) for p in parts) for part in ("end", "wrench", "root")},
    )
