"""Run of one case in time: choice of model and steps, extrapolation and series."""

from __future__ import annotations

import contextlib
import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypedDict

import numpy as np

from crosscheck.engines.base import Options, sample_times
from crosscheck.engines.exudyn.integration import (
    SAME_TIME,
    ExudynFailure,
    NewtonStalled,
    Plan,
    compute_step_size,
    compute_step_times,
)
from crosscheck.engines.exudyn.models import planar as exudyn_planar
from crosscheck.engines.exudyn.models import spatial as exudyn_spatial
from crosscheck.engines.exudyn.models.frames import Array, compute_effort_axes, compute_section_pose, take_joint_q
from crosscheck.engines.exudyn.models.layout import Layout, build_layout
from crosscheck.engines.exudyn.models.parts import Outcome
from crosscheck.engines.shared.prescribed import passive_effort, rotor_effort
from crosscheck.measures.budget import Family, add_error_bars, compute_richardson_limit
from crosscheck.measures.record import BudgetLine, Series, make_wrench_series, series, torque_series, vector_series
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Beam, Mechanism
from flexinv.model.motion import Motion

TREE = "exudyn"
DAE = "exudyn-dae"
ANCF = "exudyn-ancf"
EXACT = "exudyn-ge"
NAMES = {
    (ANCF, True): "ANCFCable2D (no shear, no rotary inertia)",
    (ANCF, False): "ANCFBeam (one rotary inertia, rho I_x / 2)",
    (EXACT, True): "BeamGeometricallyExact2D, 3 nodes",
    (EXACT, False): "BeamGeometricallyExact, 2 nodes, lumped mass",
}
# Steps per case and elements per beam, in the plane and in space (there also twice as many, for the extrapolation).
# Measured on the paper's arms, see tests/crosscheck/engines/exudyn/test_beams.py.
STEPS = {True: 8000, False: 4000}
ELEMENTS = 16
ELEMENTS_ANCF_BEAM = 12  # its Jacobian is numerical and slow
# Of Newton's increments, relative to the first one and absolute.  Looser ones leave spikes in reactions of index 3 (1e-6:
# 3e-2 of the range, single samples; from 1e-8 on nothing changes).  A run that stalls is repeated with ten times the
# tolerance, and the record says which one held.
NEWTON = 1e-9
RADIUS = 0.5  # settles within some 20 steps, see ``choose``
TRIES = 3


# What the engine was told, for the reader of the report, of runs from coarse to fine (a tree is an algorithm alone); two keys
# are no names of Python.
TimedSettings = TypedDict(
    "TimedSettings",
    {
        "algorithm": str,
        "model": str,
        "closures": str,
        "drives of the phases": list[list[str]],
        "phases": list[list[str]],
        "redundant equations left out of": list[str],
        "step_s": list[float],
        "integrator": str,
        "newton_tolerance": list[float],
        "start": str,
        "element": str,
        "elements_per_beam": list[int],
        "extrapolation": str,
        "reactions_at_0": str,
    },
    total=False,
)


@dataclass(frozen=True)
class TimedRun:
    """Series, what the engine was told, how long it took [s], and where its error bars come from."""

    series: dict[str, Series]
    settings: TimedSettings
    wall: float
    budget: Mapping[str, BudgetLine] = field(default_factory=dict)


def build_start_layout(mechanism: Mechanism, case: Case) -> Layout:
    """Return the layout at the start of a case."""
    q, qd, _ = case.motion.evaluate(mechanism, np.zeros(1))
    return build_layout(mechanism, q[0], qd[0])


@dataclass(frozen=True)
class ModelChoice:
    """Model to run: its engine, the plane (or None in space), elements per beam and integration of every run.

    The runs go from coarse to fine; reported is the last one, or in space (beams of low order) the limit of the last two.
    """

    engine: str
    plane: Array | None
    elements: tuple[int, ...]
    plans: tuple[Plan, ...]
    limit: bool = False


def choose(mechanism: Mechanism, case: Case, engine: str, options: Options) -> ModelChoice:
    """Return the model and the refinements of a case; every refinement doubles the elements and halves the step [s].

    In the plane index 2 for smooth motions from rest: it has no transient where the jerk jumps, but rings for ever
    after jumps of the acceleration (and after a start in motion, whose accelerations the engine does not know).
    Those, and everything in space, take index 3 with a spectral radius of 0.5, which settles
    within some 20 steps (at 0.9 within some hundred).  Three runs, each with twice the elements and half the step of
    the one before, give the error bars; option "error" False leaves out those that the result itself does not need.
    """
    plane = exudyn_planar.find_plane(mechanism, build_start_layout(mechanism, case))
    flat = not isinstance(plane, str)
    ahead = 0 if flat or engine == DAE else 1  # beams in space are of low order: one run beyond, for the extrapolation
    behind = 2 - ahead if options.get("error", True) else 0
    finer = 2 ** int(options.get("refinement", 0))
    usual = ELEMENTS_ANCF_BEAM if engine == ANCF and not flat else ELEMENTS
    elements = int(options.get("elements", usual)) * finer
    wanted = float(options.get("step", case.end / STEPS[flat])) / finer
    step = compute_coarsest_step(case, wanted, 2**behind)
    plan = _make_plan(mechanism, case, engine, options.get("spectral_radius"), flat, step)
    runs = range(behind + ahead + 1)
    plans = tuple(replace(plan, step=plan.step / 2**k) for k in runs)
    meshes = tuple(max(1, elements * 2**k // 2**behind) for k in runs)
    return ModelChoice(engine, None if isinstance(plane, str) else plane, meshes, plans, limit=bool(ahead))


def _make_plan(mechanism: Mechanism, case: Case, engine: str, radius: Any, flat: bool, step: float) -> Plan:
    """Return the integration of the coarsest run; radius : where it is asked for, the integrator that has one is taken."""
    moving = any(rate.any() for rate in case.motion.evaluate(mechanism, np.zeros(1))[1:])
    resting = case.initial == "static"
    falling = engine == ANCF and not flat and not resting and bool(mechanism.gravity.any())
    return Plan(
        end=(len(sample_times(case)) - 1) * case.sample,
        step=step,
        sample=case.sample,
        index2=flat and not case.motion.jumps and not moving and radius is None,
        spectral_radius=RADIUS if radius is None else float(radius),
        tolerance=NEWTON,
        extrapolate=moving or falling,
        static_start=resting,
    )


def compute_coarsest_step(case: Case, target: float, times: int) -> float:
    """Return the step [s] of the coarsest run, ``times`` as long as that wanted, or less: it meets samples and jumps.

    With jumps the finest step is at most the case's own, which is made to meet them.
    """
    if not case.motion.jumps:
        return compute_step_size(case.sample, target * times)
    # After a jump the transient of some 20 steps has to be over within a sample: the finest run is no coarser than asked.
    fewest = round(case.sample / compute_step_size(case.sample, compute_step_size(case.step, target) * times))
    for step in (case.sample / count for count in range(fewest, 2 * fewest)):
        parts = [jump / step for jump in case.motion.jumps if jump < case.end]
        if all(abs(part - round(part)) <= SAME_TIME * max(1.0, part) for part in parts):
            return step
    return compute_step_size(case.step, target * times)


def integrate_tree(mechanism: Mechanism, case: Case, engine: str, options: Options) -> TimedRun:
    """Return torque [N m] or [N], wrench [N], [N m], tip, deflection [m] and axial [N] by time integration."""
    choice = choose(mechanism, case, engine, options)
    layout = build_start_layout(mechanism, case)
    start = clock.perf_counter()
    done = []
    for k, (n, plan) in enumerate(zip(choice.elements, choice.plans, strict=True)):
        # The coarse runs are there for the error bars: where they fail, the bars come from those that are left.
        spare = k < len(choice.plans) - (2 if choice.limit else 1)
        with contextlib.suppress(*(ExudynFailure,) if spare else ()):
            done.append(_integrate_with_retries(mechanism, case, layout, choice, n, plan))
    wall = clock.perf_counter() - start
    made = [_collect_series(mechanism, case, layout, outcome) for outcome, _ in done]
    values = compute_richardson_limit(made) if choice.limit else made[-1]
    family = Family("step" if engine == DAE else "mesh and step", made, "limit" if choice.limit else -1)
    bars, budget = add_error_bars(values, [family])
    return TimedRun(bars, _describe_settings(choice, [plan for _, plan in done]), wall, budget)


def _integrate_with_retries(
    mechanism: Mechanism, case: Case, layout: Layout, choice: ModelChoice, n: int, plan: Plan
) -> tuple[Outcome, Plan]:
    """Integrate one model of n elements per beam; return its outcome and the plan whose Newton tolerance held."""
    plans = [replace(plan, tolerance=plan.tolerance * 10.0**k) for k in range(TRIES)]
    for one in plans[:-1]:
        with contextlib.suppress(NewtonStalled):
            return integrate_model(mechanism, case.motion, layout, choice, n, one), one
    return integrate_model(mechanism, case.motion, layout, choice, n, plans[-1]), plans[-1]


def integrate_model(
    mechanism: Mechanism, motion: Motion, layout: Layout, choice: ModelChoice, elements: int, plan: Plan
) -> Outcome:
    """Return the outcome of a model with so many elements per beam [-] along a motion [m, rad, s, N]."""
    q, qd, _ = motion.evaluate(mechanism, compute_step_times(plan))
    ancf = choice.engine == ANCF
    if choice.plane is None:
        return exudyn_spatial.run(exudyn_spatial.build(mechanism, layout, ancf, elements), plan, q)
    return exudyn_planar.run(exudyn_planar.build(mechanism, layout, choice.plane, ancf, elements), plan, q, qd)


def _describe_settings(choice: ModelChoice, plans: list[Plan]) -> TimedSettings:
    """Return the engine's settings, for the reader of the report."""
    plan = plans[0]
    flat = choice.plane is not None
    settings: TimedSettings = {
        "model": "planar bodies" if flat else "bodies with Euler parameters",
        "step_s": [one.step for one in plans],
        "integrator": plan.integrator,
        "newton_tolerance": [one.tolerance for one in plans],
        "start": "static equilibrium" if plan.static_start else "undeformed",
    }
    if choice.engine in (ANCF, EXACT):
        settings["element"] = NAMES[choice.engine, flat]
        settings["elements_per_beam"] = list(choice.elements)
    if choice.limit:
        settings["extrapolation"] = "(4 fine - coarse) / 3: the error is of order l^2 and h^2"
    if plan.extrapolate:
        settings["reactions_at_0"] = "2 R(h) - R(2 h)"
    return settings


def _collect_series(mechanism: Mechanism, case: Case, layout: Layout, outcome: Outcome) -> dict[str, Series]:
    """Return the series of one run."""
    made: dict[str, Series] = {}
    for name, wrench in outcome.wrench.items():
        made |= make_wrench_series(name, wrench)
    torque = compute_drive_efforts(mechanism, case.motion, sample_times(case), outcome)
    return torque_series(mechanism, torque) | made | collect_link_series(mechanism, layout, outcome)


def compute_drive_efforts(mechanism: Mechanism, motion: Motion, time: Array, outcome: Outcome) -> Array:
    """Return the efforts (samples, nv) [N m], [N] of the drives that give a run's wrenches at ``time`` (samples,) [s]."""
    q, qd, qdd = motion.evaluate(mechanism, time)
    torque = rotor_effort(mechanism, qdd) + passive_effort(mechanism, qd)
    for name, wrench in outcome.wrench.items():
        joint = mechanism.joint_of[name]
        force, moment = compute_effort_axes(joint, take_joint_q(mechanism, joint, q))
        both = np.einsum("svc,sc->sv", np.concatenate([force, moment], axis=2), wrench)  # (sample, coordinate)
        torque[:, mechanism.v_slices[name]] += both
    return np.asarray(torque)


def collect_link_series(mechanism: Mechanism, layout: Layout, outcome: Outcome) -> dict[str, Series]:
    """Return tips of all links, and of beams deflections [m] and axial forces [N]."""
    link_series: dict[str, Series] = {}
    for link in mechanism.links:
        position, rotation = outcome.pose[layout.link[link.name].group]
        frame = layout.link[link.name].placement
        origin = position + rotation @ frame.position
        axes = rotation @ frame.rotation
        if link.part is not None:
            end, _ = outcome.pose[layout.interface[link.name, link.part.tip].group]
            link_series |= vector_series(f"tip/{link.name}", "m", end)
            continue
        if link.beam is None:
            link_series |= vector_series(f"tip/{link.name}", "m", origin + axes @ link.tip)
            continue
        end = outcome.end[link.name]
        link_series |= vector_series(f"tip/{link.name}", "m", end)
        link_series |= vector_series(f"deflection/{link.name}", "m", _compute_deflection(link.beam, origin, axes, end))
        link_series |= series(f"axial/{link.name}", "N", _take_axial_force(mechanism, link.name, outcome))
    return link_series


def _compute_deflection(beam: Beam, origin: Array, axes: Array, end: Array) -> Array:
    """Return the end of a beam in the frame of its root minus where it lies undeformed, (samples, 3) [m].

    origin, axes : of the link's frame in the world (samples, 3) [m], (samples, 3, 3); end : (samples, 3) [m]
    """
    root = origin + axes @ beam.placement.position
    ahead = np.einsum("sij,si->sj", axes @ beam.placement.rotation, end - root)  # (sample, xyz of the root)
    return np.asarray(ahead - compute_section_pose(beam, beam.length).position)


def _take_axial_force(mechanism: Mechanism, name: str, outcome: Outcome) -> Array:
    """Return the x component of the force on the beam's root, of its joint or, fixed, of its clamp (samples,) [N]."""
    carrier = next(j.name for j in mechanism.joints if j.child == name)
    return outcome.wrench[carrier][:, 0] if carrier in outcome.wrench else outcome.root[name][:, 0]
