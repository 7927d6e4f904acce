"""One case in time: which model, which steps, what the extrapolation and the series are made of."""

from __future__ import annotations

import contextlib
import time as clock
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crosscheck.engines import exudyn_planar, exudyn_spatial
from crosscheck.engines.base import Options, sample_times
from crosscheck.engines.exudyn_frames import Array, axis_pose, effort_axes, joint_q
from crosscheck.engines.exudyn_layout import Layout, lay_out
from crosscheck.engines.exudyn_parts import Outcome
from crosscheck.engines.exudyn_solve import NewtonStalled, Plan, grid, step_size
from crosscheck.engines.prescribed import passive_effort, rotor_effort
from crosscheck.record import Series, series, torque_series, vector_series, wrench_series
from flexinv.files.case import Case
from flexinv.mechanism import Beam, Mechanism

TREE, DAE, ANCF, EXACT = "exudyn", "exudyn-dae", "exudyn-ancf", "exudyn-ge"
# Steps per case and elements per beam, in the plane and in space (there also twice as many, for the extrapolation).
# Measured on the paper's arms, see tests/test_engine_exudyn_beams.py.
STEPS = {True: 8000, False: 4000}
ELEMENTS = 16
ELEMENTS_ANCF_BEAM = 12  # its Jacobian is numerical and slow
# Of Newton's increments, relative to the first one and absolute.  Looser ones leave spikes in reactions of index 3 (1e-6:
# 3e-2 of the range, single samples; from 1e-8 on nothing changes).  A run that stalls is repeated with ten times the
# tolerance, and the record says which one held.
NEWTON = 1e-9
TRIES = 3


@dataclass(frozen=True)
class Made:
    """Series, what the engine was told, and how long it took [s]."""

    series: dict[str, Series]
    settings: dict[str, Any]
    wall: float


def layout_of(mechanism: Mechanism, case: Case) -> Layout:
    """Return the layout at the start of a case."""
    q, qd, _ = case.motion.evaluate(mechanism, np.zeros(1))
    return lay_out(mechanism, q[0], qd[0])


@dataclass(frozen=True)
class Choice:
    """Which model is run: its engine, the plane (or None in space), elements per beam and integration of every run."""

    engine: str
    plane: Array | None
    elements: tuple[int, ...]
    plans: tuple[Plan, ...]


def choose(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Choice:
    """Return how a case is run; every refinement doubles the elements and halves the step [s].

    In the plane index 2 for smooth motions from rest: it has no transient where the jerk jumps, but rings for ever
    after jumps of the acceleration (and after a start in motion, whose accelerations the engine does not know).
    Those, and everything in space, take index 3 with a spectral radius of 0.5, which settles
    within some 20 steps (at 0.9 within some hundred).  Beams in space are of low order: they run twice, the second
    time with twice the elements and half the step, for the extrapolation.
    """
    plane = exudyn_planar.plane_of(mechanism, layout_of(mechanism, case))
    flat = not isinstance(plane, str)
    finer = 2 ** int(options.get("refinement", 0))
    usual = ELEMENTS_ANCF_BEAM if engine == ANCF and not flat else ELEMENTS
    elements = int(options.get("elements", usual)) * finer
    wanted = float(options.get("step", case.end / STEPS[flat])) / finer
    moving = any(rate.any() for rate in case.motion.evaluate(mechanism, np.zeros(1))[1:])
    resting = case.initial == "static"
    plan = Plan(
        end=(len(sample_times(case)) - 1) * case.sample,
        step=step_size(case.step if case.motion.jumps else case.sample, wanted),
        sample=case.sample,
        index2=flat and not case.motion.jumps and not moving,
        spectral_radius=0.5,
        tolerance=NEWTON,
        extrapolate=moving or (engine == ANCF and not flat and not resting and bool(mechanism.gravity.any())),
        static_start=resting,
    )
    runs = 1 if flat or engine == DAE else 2
    plans = tuple(replace(plan, step=plan.step / 2**k) for k in range(runs))
    return Choice(engine, None if isinstance(plane, str) else plane, tuple(elements * 2**k for k in range(runs)), plans)


def in_time(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Made:
    """Return torque [N m] or [N], wrench [N], [N m], tip, deflection [m] and axial [N] by time integration."""
    choice = choose(mechanism, case, engine, options)
    layout = layout_of(mechanism, case)
    start = clock.perf_counter()
    done = [
        _march(mechanism, case, layout, choice, n, plan) for n, plan in zip(choice.elements, choice.plans, strict=True)
    ]
    wall = clock.perf_counter() - start
    made = [_series(mechanism, case, layout, outcome) for outcome, _ in done]
    return Made(_extrapolated(made), _settings(choice, [plan for _, plan in done]), wall)


def _march(
    mechanism: Mechanism, case: Case, layout: Layout, choice: Choice, n: int, plan: Plan
) -> tuple[Outcome, Plan]:
    """Integrate one model of n elements per beam; return its outcome and the plan whose Newton tolerance held."""
    plans = [replace(plan, tolerance=plan.tolerance * 10.0**k) for k in range(TRIES)]
    for one in plans[:-1]:
        with contextlib.suppress(NewtonStalled):
            return _integrate(mechanism, case, layout, choice, n, one), one
    return _integrate(mechanism, case, layout, choice, n, plans[-1]), plans[-1]


def _integrate(mechanism: Mechanism, case: Case, layout: Layout, choice: Choice, n: int, plan: Plan) -> Outcome:
    q, qd, _ = case.motion.evaluate(mechanism, grid(plan))
    ancf = choice.engine == ANCF
    if choice.plane is None:
        return exudyn_spatial.run(exudyn_spatial.build(mechanism, layout, ancf, n), plan, q)
    return exudyn_planar.run(exudyn_planar.build(mechanism, layout, choice.plane, ancf, n), plan, q, qd)


def _extrapolated(runs: list[dict[str, Series]]) -> dict[str, Series]:
    """Return the limit of an error a l^2 + b h^2, (4 fine - coarse) / 3, the fine run having half of both."""
    fine = runs[-1]
    if len(runs) == 1:
        return fine
    return {n: replace(s, values=(4 * s.values - runs[0][n].values) / 3) for n, s in fine.items()}


def _settings(choice: Choice, plans: list[Plan]) -> dict[str, Any]:
    """Return what the engine was told, for the reader of the report."""
    names = {
        (ANCF, True): "ANCFCable2D (no shear, no rotary inertia)",
        (ANCF, False): "ANCFBeam (one rotary inertia, rho I_x / 2)",
        (EXACT, True): "BeamGeometricallyExact2D, 3 nodes",
        (EXACT, False): "BeamGeometricallyExact, 2 nodes, lumped mass",
    }
    plan, flat = plans[0], choice.plane is not None
    told: dict[str, Any] = {
        "model": "planar bodies" if flat else "bodies with Euler parameters",
        "step_s": [one.step for one in plans],
        "integrator": plan.integrator,
        "newton_tolerance": [one.tolerance for one in plans],
        "start": "static equilibrium" if plan.static_start else "undeformed",
    }
    if choice.engine in (ANCF, EXACT):
        told |= {"element": names[choice.engine, flat], "elements_per_beam": list(choice.elements)}
    if len(choice.elements) > 1:
        told["extrapolation"] = "(4 fine - coarse) / 3: the error is of order l^2 and h^2"
    if plan.extrapolate:
        told["reactions_at_0"] = "2 R(h) - R(2 h)"
    return told


def _series(mechanism: Mechanism, case: Case, layout: Layout, outcome: Outcome) -> dict[str, Series]:
    """Return the series of one run."""
    q, qd, qdd = case.motion.evaluate(mechanism, sample_times(case))
    torque = rotor_effort(mechanism, qdd) + passive_effort(mechanism, qd)
    made: dict[str, Series] = {}
    for name, wrench in outcome.wrench.items():
        joint = mechanism.joint_of[name]
        force, moment = effort_axes(joint, joint_q(mechanism, joint, q))
        both = np.einsum("svc,sc->sv", np.concatenate([force, moment], axis=2), wrench)  # (sample, coordinate)
        torque[:, mechanism.v_slices[name]] += both
        made |= wrench_series(name, wrench)
    for link in mechanism.links:
        position, rotation = outcome.pose[layout.link[link.name].group]
        frame = layout.link[link.name].placement
        origin = position + rotation @ frame.position
        axes = rotation @ frame.rotation
        if link.beam is None:
            made |= vector_series(f"tip/{link.name}", "m", origin + axes @ link.tip)
            continue
        made |= vector_series(f"tip/{link.name}", "m", outcome.end[link.name])
        made |= vector_series(
            f"deflection/{link.name}", "m", _deflection(link.beam, origin, axes, outcome.end[link.name])
        )
        made |= series(f"axial/{link.name}", "N", _axial(mechanism, link.name, outcome))
    return torque_series(mechanism, torque) | made


def _deflection(beam: Beam, origin: Array, axes: Array, end: Array) -> Array:
    """Return the end of a beam in the frame of its root minus where it lies undeformed, (samples, 3) [m].

    origin, axes : of the link's frame in the world (samples, 3) [m], (samples, 3, 3); end : (samples, 3) [m]
    """
    root = origin + axes @ beam.placement.position
    ahead = np.einsum("sij,si->sj", axes @ beam.placement.rotation, end - root)  # (sample, xyz of the root)
    return np.asarray(ahead - axis_pose(beam, beam.length).position)


def _axial(mechanism: Mechanism, name: str, outcome: Outcome) -> Array:
    """Return the x component of the force on the beam's root, of its joint or, fixed, of its clamp (samples,) [N]."""
    carrier = next(j.name for j in mechanism.joints if j.child == name)
    return outcome.wrench[carrier][:, 0] if carrier in outcome.wrench else outcome.root[name][:, 0]
