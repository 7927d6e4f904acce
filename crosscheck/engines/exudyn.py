"""Exudyn: rigid mechanisms by its kinematic tree or in time, flexible ones by two beam formulations in time.

    exudyn        rigid trees, every joint kind: KinematicTree66, tau = M qdd + f (exact, no time integration)
    exudyn-dae    the same mechanisms in redundant coordinates, every joint a prescribed constraint, in time
    exudyn-ancf   absolute nodal coordinates: ANCFCable2D in the plane, ANCFBeam in space
    exudyn-ge     geometrically exact: BeamGeometricallyExact2D (3 nodes) in the plane, BeamGeometricallyExact in space

Options: ``elements`` (per beam), ``step`` [s], ``refinement`` (each doubles the elements and halves the step).
The modules exudyn_rigid, exudyn_planar and exudyn_spatial give the conventions; what the bodies need is completed here
to the effort of the actuator: + rotor inertia qdd + damping qd + friction sign(qd).
"""

from __future__ import annotations

import contextlib
import time as clock
from dataclasses import dataclass, replace
from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines import exudyn_planar, exudyn_rigid, exudyn_spatial
from crosscheck.engines.base import Options, sample_times
from crosscheck.engines.exudyn_frames import Array, axis_pose, compose, effort_axes, joint_q
from crosscheck.engines.exudyn_layout import Layout, lay_out
from crosscheck.engines.exudyn_parts import Outcome
from crosscheck.engines.exudyn_solve import NewtonStalled, Plan, grid, quiet, step_size
from crosscheck.record import Record, Series, fingerprint, series, torque_series, vector_series, wrench_series
from flexinv.case import Case
from flexinv.mechanism import Beam, Mechanism

TREE, DAE, ANCF, EXACT = "exudyn", "exudyn-dae", "exudyn-ancf", "exudyn-ge"
# Steps per case and elements per beam, in the plane and in space (there also twice as many, for the extrapolation).
# Measured on the paper's arms, see tests/test_engine_exudyn_beams.py.
STEPS = {True: 8000, False: 3000}
ELEMENTS = {(ANCF, True): 16, (EXACT, True): 16, (ANCF, False): 8, (EXACT, False): 16}
# Of Newton, relative and absolute.  What is looser shows in reactions (ANCFBeam at 1e-7: up to 7e-3 of the range), what
# is tighter lets stiff beams stall at their rounding (planar ones at 1e-7, ANCFBeam at 1e-9); a run that stalls is
# repeated with ten times the tolerance, and the record says which one held.
NEWTON = {
    (DAE, True): 1e-8,
    (DAE, False): 1e-8,
    (ANCF, True): 1e-6,
    (ANCF, False): 1e-8,
    (EXACT, True): 1e-6,
    (EXACT, False): 1e-6,
}
TRIES = 3


def version() -> str:
    """Return the version of Exudyn."""
    return str(exu.__version__)


def abilities() -> str:
    """Return one sentence: what Exudyn can do here."""
    return (
        "Rigid inverse dynamics of every joint kind (KinematicTree66, or in time); flexible and mixed trees in time "
        "with prescribed joints, by ANCF (cable in the plane, beam in space) or geometrically exact beams."
    )


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return why Exudyn cannot do this case, or None."""
    given = case.motion.joints(mechanism)
    free = [j.name for j in mechanism.joints if j.nv and j.name not in given]
    if free:
        return f"this adapter prescribes every joint; left to the dynamics here: {', '.join(free)}"
    names = ", ".join(link.name for link in mechanism.beams)
    if engine in (TREE, DAE):
        if names:
            return f"{engine} has rigid bodies only; flexible here: {names}"
        return None if engine == TREE else _unsupported(mechanism, case)
    return _unsupported(mechanism, case) if names else f"no link is a beam: see {TREE} and {DAE}"


def _unsupported(mechanism: Mechanism, case: Case) -> str | None:
    """Return why there is no model in time, or None; the tree of rigid bodies has no such limits."""
    layout = _layout(mechanism, case)
    if not isinstance(exudyn_planar.plane_of(mechanism, layout), str):
        return None
    return exudyn_spatial.unsupported(mechanism)


def run(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
    """Return torque [N m] or [N], wrench [N], [N m], tip, deflection [m] and axial [N] on the sample times."""
    with quiet():
        made = _tree(mechanism, case) if engine == TREE else _in_time(mechanism, case, engine, options)
    return Record(
        engine=engine,
        version=version(),
        settings=made.settings,
        time=sample_times(case),
        series=made.series,
        wall_time=made.wall,
        model_hash=fingerprint(mechanism),
    )


@dataclass(frozen=True)
class Made:
    """Series, what the engine was told, and how long it took [s]."""

    series: dict[str, Series]
    settings: dict[str, Any]
    wall: float


def _layout(mechanism: Mechanism, case: Case) -> Layout:
    q, qd, _ = case.motion.evaluate(mechanism, np.zeros(1))
    return lay_out(mechanism, q[0], qd[0])


def passive_effort(mechanism: Mechanism, qd: Array, qdd: Array) -> Array:
    """Return rotor inertia qdd + damping qd + friction sign(qd), what the actuator gives beside the bodies' effort.

    qd, qdd : (samples, nv); returns : (samples, nv) [N m] or [N]
    """
    rows = [(j.rotor_inertia, j.damping, j.friction) for j in mechanism.joints for _ in range(j.nv)]
    rotor, damping, friction = np.array(rows).reshape(-1, 3).T
    return np.asarray(rotor * qdd + damping * qd + friction * np.sign(qd))


# ----------------------------------------------------------------------------------------------------------- rigid


def _tree(mechanism: Mechanism, case: Case) -> Made:
    q, qd, qdd = case.motion.evaluate(mechanism, sample_times(case))
    start = clock.perf_counter()
    result = exudyn_rigid.inverse_dynamics(mechanism, q, qd, qdd, wrench="wrench" in case.quantities)
    wall = clock.perf_counter() - start
    made = torque_series(mechanism, result.torque + passive_effort(mechanism, qd, qdd))
    for name, tip in result.tip.items():
        made |= vector_series(f"tip/{name}", "m", tip)
    for name, wrench in result.wrench.items():
        made |= wrench_series(name, wrench)
    return Made(made, {"algorithm": "KinematicTree66, M qdd + f"}, wall)


# --------------------------------------------------------------------------------------------------------- in time


@dataclass(frozen=True)
class Choice:
    """Which model is run: its element, the plane (or None in space), elements per beam of every run, integration."""

    engine: str
    plane: Array | None
    elements: tuple[int, ...]
    plan: Plan


def choose(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Choice:
    """Return how a case is run; every refinement doubles the elements and halves the step.

    In the plane index 2 for smooth motions: it has no transient where the jerk jumps, but rings for ever after jumps of
    the acceleration.  Those, and everything in space, take index 3 with a spectral radius of 0.5, which settles
    within some 20 steps (at 0.9 within some hundred).
    """
    plane = exudyn_planar.plane_of(mechanism, _layout(mechanism, case))
    flat = not isinstance(plane, str)
    finer = 2 ** int(options.get("refinement", 0))
    elements = int(options.get("elements", ELEMENTS.get((engine, flat), 1))) * finer
    wanted = float(options.get("step", case.end / STEPS[flat])) / finer
    step = step_size(case.step if case.motion.jumps else case.sample, wanted)
    moving = any(rate.any() for rate in case.motion.evaluate(mechanism, np.zeros(1))[1:])
    resting = case.initial == "static"
    plan = Plan(
        end=(len(sample_times(case)) - 1) * case.sample,
        step=step,
        sample=case.sample,
        index2=flat and not case.motion.jumps,
        spectral_radius=0.5,
        tolerance=NEWTON[engine, flat],
        extrapolate=moving or (engine == ANCF and not flat and not resting),
        static_start=resting,
    )
    twice = not flat and engine != DAE
    return Choice(engine, None if isinstance(plane, str) else plane, (elements, 2 * elements)[: 1 + twice], plan)


def _in_time(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Made:
    choice = choose(mechanism, case, engine, options)
    layout = _layout(mechanism, case)
    q, qd, _ = case.motion.evaluate(mechanism, grid(choice.plan))
    start = clock.perf_counter()
    done = [_march(mechanism, layout, choice, q, qd, n) for n in choice.elements]
    wall = clock.perf_counter() - start
    series_of = [_series(mechanism, case, layout, outcome) for outcome, _ in done]
    return Made(_extrapolated(series_of), _settings(choice, [tolerance for _, tolerance in done]), wall)


def _march(mechanism: Mechanism, layout: Layout, choice: Choice, q: Array, qd: Array, n: int) -> tuple[Outcome, float]:
    """Integrate one model of n elements per beam; return its outcome and the Newton tolerance that held."""
    tolerances = [choice.plan.tolerance * 10.0**k for k in range(TRIES)]
    for tolerance in tolerances[:-1]:
        with contextlib.suppress(NewtonStalled):
            return _integrate(mechanism, layout, choice, q, qd, n, tolerance), tolerance
    return _integrate(mechanism, layout, choice, q, qd, n, tolerances[-1]), tolerances[-1]


def _integrate(
    mechanism: Mechanism, layout: Layout, choice: Choice, q: Array, qd: Array, n: int, tolerance: float
) -> Outcome:
    plan, ancf = replace(choice.plan, tolerance=tolerance), choice.engine == ANCF
    if choice.plane is None:
        return exudyn_spatial.run(exudyn_spatial.build(mechanism, layout, ancf, n), plan, q)
    return exudyn_planar.run(exudyn_planar.build(mechanism, layout, choice.plane, ancf, n), plan, q, qd)


def _extrapolated(runs: list[dict[str, Series]]) -> dict[str, Series]:
    """Return the limit of an error that falls with the square of the element length, (4 fine - coarse) / 3."""
    fine = runs[-1]
    if len(runs) == 1:
        return fine
    return {n: replace(s, values=(4 * s.values - runs[0][n].values) / 3) for n, s in fine.items()}


def _settings(choice: Choice, tolerances: list[float]) -> dict[str, Any]:
    """Return what the engine was told, for the reader of the report."""
    names = {
        (ANCF, True): "ANCFCable2D (no shear, no rotary inertia)",
        (ANCF, False): "ANCFBeam (one rotary inertia, rho I_x / 2)",
        (EXACT, True): "BeamGeometricallyExact2D, 3 nodes",
        (EXACT, False): "BeamGeometricallyExact, 2 nodes, lumped mass",
    }
    plan, flat = choice.plan, choice.plane is not None
    told: dict[str, Any] = {
        "model": "planar bodies" if flat else "bodies with Euler parameters",
        "step_s": plan.step,
        "integrator": plan.integrator,
        "newton_tolerance": tolerances,
        "start": "static equilibrium" if plan.static_start else "undeformed",
    }
    if choice.engine in (ANCF, EXACT):
        told |= {"element": names[choice.engine, flat], "elements_per_beam": list(choice.elements)}
    if len(choice.elements) > 1:
        told["extrapolation"] = "(4 fine - coarse) / 3: the error is of order l^2"
    if plan.extrapolate:
        told["reactions_at_0"] = "2 R(h) - R(2 h)"
    return told


def _series(mechanism: Mechanism, case: Case, layout: Layout, outcome: Outcome) -> dict[str, Series]:
    """Return the series of one run."""
    q, qd, qdd = case.motion.evaluate(mechanism, sample_times(case))
    torque = passive_effort(mechanism, qd, qdd)
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
        end = outcome.end[link.name]
        made |= vector_series(f"tip/{link.name}", "m", end)
        ahead = np.einsum("sij,si->sj", axes, end - origin)  # (sample, xyz of the hub)
        made |= vector_series(f"deflection/{link.name}", "m", ahead - undeformed_end(link.beam))
        made |= series(f"axial/{link.name}", "N", _axial(mechanism, link.name, outcome))
    return torque_series(mechanism, torque) | made


def undeformed_end(beam: Beam) -> Array:
    """Return where the end of the undeformed beam lies in its link's frame, (3,) [m]."""
    return compose(beam.placement, axis_pose(beam, beam.length)).position


def _axial(mechanism: Mechanism, name: str, outcome: Outcome) -> Array:
    """Return the x component of the force on the beam's root, of its joint or, fixed, of its clamp (samples,) [N]."""
    carrier = next(j.name for j in mechanism.joints if j.child == name)
    return outcome.wrench[carrier][:, 0] if carrier in outcome.wrench else outcome.root[name][:, 0]
