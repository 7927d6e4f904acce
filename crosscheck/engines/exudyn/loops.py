"""Closed loops, springs and forces in Exudyn, in time: redundant coordinates, drives where the motion gives joints.

Links may be rigid (``exudyn-dae``), or beams too (``exudyn-ancf``, ``exudyn-ge``), or meshes too (``exudyn-ge``).

The joints that the motion leaves out are connectors with free axes; Exudyn's integrator moves them.  Its multipliers are
the efforts of drives on the joints that the motion gives; where actuators stand on other joints, or on more of them,
the same virtual work is shared out to them with least norm (`exudyn.chain`).  What rotors, damping, dry friction and
springs in joints take joins in there, on passive joints too.

A start with speed or acceleration would cost some 20 steps of transient: the engine finds its initial accelerations without
what the motion prescribes, and takes none from outside (1.13.6: SetODE2Coordinates_tt has no effect on either integrator,
measured).  Loops of rigid links are led into their start from rest (`exudyn.lead_in`).

Beams move the passive joints as they please: there drives stand on the joints that the motion gives, and damping and
springs of the others are connectors of their own.

Three runs, with 2 h, h and h / 2, beams with n / 2, n and 2 n elements: (4 fine - coarse) / 3 of the last two is the result,
and its difference from that of the first two is its error bar.
"""

from __future__ import annotations

import contextlib
import time as clock
from collections.abc import Container
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.engines.base import Options, sample_times
from crosscheck.engines.exudyn import lead_in as exudyn_lead
from crosscheck.engines.exudyn.integration import NewtonStalled, Plan, compute_step_size, compute_step_times
from crosscheck.engines.exudyn.lead_in import ExtendedMotion, build_history, list_joints_in_motion, move_force_times
from crosscheck.engines.exudyn.models import chain as exudyn_chain
from crosscheck.engines.exudyn.models import connectors as exudyn_closing
from crosscheck.engines.exudyn.models import planar as exudyn_planar
from crosscheck.engines.exudyn.models import planar_connectors as exudyn_flat
from crosscheck.engines.exudyn.models import spatial as exudyn_spatial
from crosscheck.engines.exudyn.models.frames import Array, compute_effort_axes, compute_scalar_coordinate, take_joint_q
from crosscheck.engines.exudyn.models.layout import Layout, build_layout
from crosscheck.engines.exudyn.models.parts import Outcome
from crosscheck.engines.exudyn.run_in_time import ANCF, DAE, EXACT, NAMES, TimedRun, TimedSettings, collect_link_series
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.engines.shared.prescribed import compute_spring_effort, missing_motion, passive_effort, rotor_effort
from crosscheck.measures.budget import Family, add_error_bars, compute_richardson_limit
from crosscheck.measures.record import Series, make_reaction_series, make_wrench_series, torque_series
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

STEPS = 2000  # of the coarse run: the extrapolated torque of the four-bar is within 1e-8 of the range
LEAD_POINTS = 21  # at which the loops are followed from t = 0 back to where a lead-in begins
ELEMENTS = 8  # per beam; the run beyond has twice as many
NEWTON = (1e-10, 1e-9, 1e-8)  # of increments, relative and absolute: the next one where a run stalls
# A pair of unit vectors whose product is smaller is perpendicular up to the digits of a file.
PERPENDICULAR = 1e-9


@dataclass(frozen=True)
class Model:
    """System to integrate: layout at the closed start, plane (None in space), equations that each closure keeps.

    free : joints that closures move, where they start [rad], [m] (those of one coordinate)
    """

    history: ExtendedMotion
    engine: str
    layout: Layout
    plane: Array | None
    free: dict[str, float]
    held: dict[str, list[int]]

    @property
    def mechanism(self) -> Mechanism:
        """Return the mechanism."""
        return self.history.mechanism

    @property
    def case(self) -> Case:
        """Return the case."""
        return self.history.case

    @property
    def left_out(self) -> list[str]:
        """Closures whose equations are not all needed (in the plane they are)."""
        full = {c.name: sum(exudyn_closing.HELD[c.kind]) for c in self.mechanism.closures}
        return [] if self.plane is not None else [n for n, rows in self.held.items() if sum(rows) < full[n]]


def describe_refusal(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why Exudyn cannot do this mechanism with closures, springs or forces in time, or None."""
    if reason := _describe_wrong_engine(mechanism, engine):
        return reason
    if not mechanism.closures and (reason := missing_motion(mechanism, case)):
        return reason
    if reason := _describe_switched_closures(mechanism):
        return reason
    if strange := [c.name for c in mechanism.closures if c.kind not in exudyn_closing.HELD]:
        return f"closures without a connector of Exudyn between redundant coordinates: {', '.join(strange)}"
    if mechanism.is_rigid and (reason := assembly.describe_refusal(mechanism)):
        return reason
    if (
        reason := exudyn_spatial.describe_refusal(mechanism)
        or _describe_leaning_axes(mechanism, case)
        or exudyn_lead.describe_refusal(mechanism, case)
    ):
        return reason
    return _describe_flexible_refusal(mechanism, case, engine) if mechanism.flexible else None


def _describe_wrong_engine(mechanism: Mechanism, engine: str) -> str | None:
    bending = ", ".join(link.name for link in mechanism.flexible)
    meshes = ", ".join(link.name for link in mechanism.meshed)
    if engine == DAE:
        return f"{engine} has rigid bodies only; flexible here: {bending}" if bending else None
    if engine == ANCF and meshes:
        return f"links that are meshes are told to {EXACT} alone; here: {meshes}"
    return None if bending else f"no link bends: see {DAE}"


def _describe_switched_closures(mechanism: Mechanism) -> str | None:
    names = [c.name for c in mechanism.closures if c.active]
    return f"closures act all the time here; switched: {', '.join(names)}" if names else None


def _describe_leaning_axes(mechanism: Mechanism, case: Case) -> str | None:
    for joint in mechanism.joints:
        lean = joint.kind == "universal" and abs(joint.axis @ joint.second_axis) > PERPENDICULAR
        if lean and joint.name in assembly.find_unprescribed_joints(mechanism, case):
            return f"joint {joint.name}: a connector holds the axes of a universal joint perpendicular; these lean"
    return None


def _describe_flexible_refusal(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why links that bend with closures, springs or forces cannot be done, or None."""
    free = assembly.find_unprescribed_joints(mechanism, case)
    wrong = [j.name for j in mechanism.joints if j.nv and j.actuated is (j.name in free)]
    if mechanism.closures and wrong:
        return f"with links that bend the drives stand on the very joints that the motion gives; here not so: {', '.join(wrong)}"
    if reason := exudyn_flat.describe_unmodelled_effort(mechanism, frozenset(free)):
        return reason
    left_out = exudyn_spatial.describe_damping_loss(mechanism) if engine == EXACT else None
    missing = left_out or _describe_hindered_joint(mechanism, free)
    return missing if missing and _is_spatial(mechanism, case) else None


def _describe_hindered_joint(mechanism: Mechanism, free: Container[str]) -> str | None:
    for joint in mechanism.joints:
        if joint.name in free and (joint.damping or joint.stiffness):
            return (
                f"joint {joint.name}: damping and springs of joints without a drive have a connector in the plane only"
            )
    return None


def _is_spatial(mechanism: Mechanism, case: Case) -> bool:
    try:
        return build_model(mechanism, case).plane is None
    except assembly.AssemblyError:  # the run itself says that the loops do not close
        return False


def compute_free_coordinates(mechanism: Mechanism, case: Case, q: Array) -> dict[str, float]:
    """Return the start of joints that the motion leaves out [rad], [m], 0 of those with several coordinates; q : (nq,)."""
    left_out = assembly.find_unprescribed_joints(mechanism, case)
    return {
        j.name: float(compute_scalar_coordinate(j, take_joint_q(mechanism, j, q[None]))[0]) if j.nv == 1 else 0.0
        for j in mechanism.joints
        if j.name in left_out
    }


def build_model(mechanism: Mechanism, case: Case, engine: str = DAE, history: ExtendedMotion | None = None) -> Model:
    """Return the system to integrate.  Raises AssemblyError where the loops do not close at the start."""
    history = history or ExtendedMotion(mechanism, case)
    q, qd, _ = _find_start_state(mechanism, case, history)
    layout = build_layout(mechanism, q, qd)
    free = compute_free_coordinates(mechanism, case, q)
    plane = exudyn_planar.find_plane(mechanism, layout, frozenset(free))
    if mechanism.flexible:  # a link that bends leaves no equation of its loop to follow from the others
        held = {c.name: list(exudyn_closing.HELD[c.kind]) for c in mechanism.closures}
        return Model(history, engine, layout, None if isinstance(plane, str) else plane, free, held)
    held = exudyn_closing.find_independent_axes(mechanism, case) if mechanism.closures else {}
    # in the plane, where some of the equations of its connectors are redundant too, the spatial model leaves them out
    flat = not isinstance(plane, str) and sum(map(sum, held.values())) == exudyn_flat.count_equations(mechanism)
    return Model(history, engine, layout, plane if flat and not isinstance(plane, str) else None, free, held)


def _find_start_state(mechanism: Mechanism, case: Case, history: ExtendedMotion) -> tuple[Array, Array, Array]:
    """Return q (nq,), qd, qdd (nv,) [rad or m, s] where the run starts: closed at 0 and followed back to there."""
    back = np.linspace(0.0, -history.lead, LEAD_POINTS) if history.lead else np.zeros(1)
    q, qd, qdd = exudyn_chain.evaluate_closed_motion(mechanism, case, back, history)
    return q[-1], qd[-1], qdd[-1]


def compute_coarsest_step(case: Case, options: Options) -> float:
    """Return the step of the first run [s]."""
    wanted = float(options.get("step", case.end / STEPS)) / 2 ** int(options.get("refinement", 0))
    return compute_step_size(case.sample, wanted * (2 if options.get("error", True) else 1))


def plan_runs(model: Model, options: Options) -> list[Plan]:
    """Return the runs from coarse to fine, steps in [s]; without "error" those two that the result needs."""
    case = model.case
    lead = model.history.lead
    jumps = [t for t in case.motion.jumps if t < case.end and (t > 0.0 or not lead)]
    moving = not lead and bool(list_joints_in_motion(model.mechanism, case))
    plan = Plan(
        end=(len(sample_times(case)) - 1) * case.sample,
        step=compute_coarsest_step(case, options),
        sample=case.sample,
        index2=model.plane is not None and not jumps and not moving,
        spectral_radius=0.5,
        tolerance=NEWTON[0],
        extrapolate=moving,
        static_start=bool(model.mechanism.flexible) and case.initial == "static",
        lead=lead,
    )
    return [replace(plan, step=plan.step / 2**k) for k in range(3 if options.get("error", True) else 2)]


def list_mesh_sizes(runs: int, options: Options) -> list[int]:
    """Return the elements per beam [-] of the runs, from coarse to fine."""
    usual = int(options.get("elements", ELEMENTS)) * 2 ** int(options.get("refinement", 0))
    return [max(1, usual * 2**k // 2 ** (runs - 2)) for k in range(runs)]


def integrate_loops(mechanism: Mechanism, case: Case, engine: str, options: Options) -> TimedRun:
    """Return torque [N m] or [N], tip [m] and, where unique, wrench [N], [N m], each with its bar.

    Of beams also deflection [m] and axial force [N].
    """
    start = clock.perf_counter()
    model = build_model(mechanism, case, engine, build_history(mechanism, case, compute_coarsest_step(case, options)))
    plans = plan_runs(model, options)
    elements = list_mesh_sizes(len(plans), options)
    done = [_integrate_with_retries(model, n, plan) for n, plan in zip(elements, plans, strict=True)]
    series_of = collect_flexible_series if mechanism.flexible else _collect_rigid_series
    runs = [series_of(model, outcome) for outcome, _ in done]
    made, budget = add_error_bars(
        compute_richardson_limit(runs), [Family("mesh and step" if mechanism.beams else "step", runs, "limit")]
    )
    settings = _describe_settings(model, [plan for _, plan in done])
    if mechanism.beams:
        settings |= {"element": NAMES[engine, model.plane is not None], "elements_per_beam": elements}
    return TimedRun(made, settings, clock.perf_counter() - start, budget)


def _integrate_with_retries(model: Model, elements: int, plan: Plan) -> tuple[Outcome, Plan]:
    for tolerance in NEWTON[:-1]:
        one = replace(plan, tolerance=tolerance)
        with contextlib.suppress(NewtonStalled):
            return integrate_model(model, elements, one), one
    last = replace(plan, tolerance=NEWTON[-1])
    return integrate_model(model, elements, last), last


def integrate_model(model: Model, elements: int, plan: Plan) -> Outcome:
    """Return the outcome of a model with so many elements per beam [-] along its motion [m, rad, s, N]."""
    m = move_force_times(model.mechanism, plan.lead)
    layout = model.layout
    ancf = model.engine == ANCF
    q, qd, _ = model.history(compute_step_times(plan))
    if model.plane is None:
        drawing = exudyn_spatial.build(m, layout, ancf, elements, frozenset(model.free), model.held)
        return exudyn_spatial.run(drawing, plan, q)
    return exudyn_planar.run(exudyn_planar.build(m, layout, model.plane, ancf, elements, model.free), plan, q, qd)


def collect_flexible_series(model: Model, outcome: Outcome) -> dict[str, Series]:
    """Return the series of one run of a mechanism with links that bend [N m], [N], [m]."""
    m = model.mechanism
    torque = compute_drive_efforts(model, outcome, sample_times(model.case))
    flexible_series = torque_series(m, torque) | collect_link_series(m, model.layout, outcome)
    for name, wrench in outcome.wrench.items():
        flexible_series |= make_wrench_series(name, wrench)
    for name, wrench in outcome.closure.items():
        # what the model has no equation for is no reaction: a pin of the plane and its moments
        flexible_series |= {n: one for n, one in make_reaction_series(name, wrench).items() if one.values.any()}
    return flexible_series


def compute_drive_efforts(model: Model, outcome: Outcome, time: Array) -> Array:
    """Return the efforts (samples, nv) [N m], [N] of the drives at ``time`` (samples,) [s], links that bend among the others."""
    m = model.mechanism
    q, qd, qdd = model.case.motion.evaluate(m, time)
    passive = rotor_effort(m, qdd) + passive_effort(m, qd) + compute_spring_effort(m, q)
    given = np.array([j.name not in model.free for j in m.joints for _ in range(j.nv)], dtype=bool)
    return _compute_connector_efforts(model, outcome, q) + np.where(given, passive, 0.0)


def _compute_connector_efforts(model: Model, outcome: Outcome, q: Array) -> Array:
    """Return the efforts of the drives' connectors, (samples, nv) [N m] or [N]; q : (samples, nq)."""
    m = model.mechanism
    torque = np.zeros((len(q), m.nv))
    for name, wrench in outcome.wrench.items():
        if name not in model.free:
            axes = np.concatenate(compute_effort_axes(m.joint_of[name], take_joint_q(m, m.joint_of[name], q)), axis=2)
            torque[:, m.v_slices[name]] = np.einsum("svc,sc->sv", axes, wrench)  # (sample, coordinate)
    return torque


def _collect_rigid_series(model: Model, outcome: Outcome) -> dict[str, Series]:
    m = model.mechanism
    q, qd, qdd = exudyn_chain.evaluate_closed_motion(m, model.case, sample_times(model.case))
    torque = (
        _compute_connector_efforts(model, outcome, q)
        + rotor_effort(m, qdd)
        + passive_effort(m, qd)
        + compute_spring_effort(m, q)
    )
    made: dict[str, Series] = {}
    for name, wrench in outcome.wrench.items():
        made |= make_wrench_series(name, wrench)
    for name, wrench in outcome.closure.items():
        made |= make_reaction_series(name, wrench)
    if m.closures:
        torque = exudyn_chain.split_sampled_efforts(m, model.case, q, torque)
    if model.left_out or (m.closures and not _has_collocated_drives(model)):
        made = {}  # not the reactions that belong to these efforts
    return torque_series(m, torque) | made | collect_link_series(m, model.layout, outcome)


def _has_collocated_drives(model: Model) -> bool:
    """Return True if drives stand on the very joints that the motion gives, and take nothing on the others."""
    m = model.mechanism
    given = all(j.actuated is (j.name not in model.free) for j in m.joints if j.nv)
    quiet = all(
        not any((j.rotor_inertia, j.damping, j.friction, j.stiffness)) for j in m.joints if j.name in model.free
    )
    return given and quiet


def _describe_settings(model: Model, plans: list[Plan]) -> TimedSettings:
    flat = model.plane is not None
    return {
        "model": "planar bodies" if flat else "bodies with Euler parameters",
        "closures": "RevoluteJoint2D; slides and welds GenericJoint" if flat else "GenericJoint",
        "redundant equations left out of": model.left_out,
        "step_s": [plan.step for plan in plans],
        "integrator": plans[0].integrator,
        "newton_tolerance": [plan.tolerance for plan in plans],
        "start": _describe_start(plans[0]),
        "extrapolation": "(4 fine - coarse) / 3: the error is of order h^2",
    }


def _describe_start(plan: Plan) -> str:
    if plan.lead:
        return f"in motion, led into from rest over {plan.lead:.3g} s before"
    return "in motion: the first some 20 steps are a transient" if plan.extrapolate else "at rest"
