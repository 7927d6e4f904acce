"""The library of a mechanism with beams: the step of `analysis.controller.Controller`, its three kernels one after the other.

    place the joints          `fill_given` in the plane, `fill_relative` in space
    march one time step       `integrate_planar_motion` or `integrate_instants`
    tau = L T P, guarded      `evaluate_guarded_torques`, with springs, forces or loops `evaluate_loaded_torques`

The block is the work space of a controller that has been started in Python, as it stands then; so every library begins at the
position, at rest, that it was made for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexinv.analysis.controller import Controller, FlexibleState
from flexinv.dynamics.loaded_torques import evaluate_loaded_torques
from flexinv.dynamics.stepper import SLIPPED, SUDDEN_START, TURNED_TOO_MUCH, integrate_instants
from flexinv.errors import ConvergenceError, InputError
from flexinv.export.flexible.beam_damping import format_damping
from flexinv.export.flexible.parameters import format_parameters
from flexinv.export.flexible.rest_plan import RestStart, plan_rest_start
from flexinv.export.flexible.step_advice import find_slowest_vibration, format_advised_step, warn_of_long_step
from flexinv.export.given_forces import format_forces, list_moved_forces
from flexinv.export.library_plan import BLOCK_HEADER, GoldenSeries, LibraryPlan
from flexinv.export.machine_code import Entry, KernelCall, add_entry
from flexinv.export.memory_image import MemoryImage, list_arrays
from flexinv.export.names import format_numbers
from flexinv.export.payload_nodes import add_payload_bodies
from flexinv.export.readings import format_beams, format_poses, format_wrenches, make_strain_call
from flexinv.inverse.balance import REASON, compute_carried_energy, compute_energy_rounding, evaluate_guarded_torques
from flexinv.kinematics.configuration import fill_given, fill_relative, integrate_array
from flexinv.model.mechanism import Mechanism
from flexinv.planar.stepper import integrate_planar_motion
from flexinv.typing import Array


@dataclass(frozen=True)
class MarchSettings:
    """Settings of the march of a library.

    step : between two calls [s]; start : (nq,) position in which it begins at rest [rad], [m]; initial : "static" or "consistent"
    spectral_radius : as in `Controller` [-]; payloads : links that carry something that changes
    """

    step: float
    start: Array
    initial: str = "static"
    spectral_radius: float = 0.8
    payloads: tuple[str, ...] = ()


REPLAYED_STEPS = 20  # steps of the self-test
GOLDEN_SWINGS = (
    0.02,
    2e-4,
    0.0,
)  # ways of every driven joint in it, of which the first is taken that can be made [rad], [m]
# Of the self-test, in parts of the largest effort: a rounding of the position of 0.4 m is 7e-12 of the peak acceleration at steps
# of 5e-4 s, and marches on.  On this processor no digit differs.
MARCH_TOLERANCE = 1e-9


def plan_flexible_library(mechanism: Mechanism, prefix: str, settings: MarchSettings) -> LibraryPlan:
    """Return the library [N m], [N] of a mechanism with beams, whose names begin with ``prefix``.

    Raises InputError where none can be made, ConvergenceError where the position has no equilibrium.
    """
    mechanism = add_payload_bodies(mechanism, settings.payloads)
    controller = _begin_controller(mechanism, settings)
    state = controller.flexible
    assert state is not None
    motion = [np.zeros(size) for size in (mechanism.nq, mechanism.nv, mechanism.nv)]
    rest = plan_rest_start(state, motion, prefix)
    steps = _list_step_calls(state, motion, prefix)
    strained = make_strain_call(state.solver.mesh, state.frames, state.solver.work.element, f"{prefix}_kernel_strains")
    calls = [*steps, *rest.calls, strained]
    image = MemoryImage(BLOCK_HEADER, [one for call in calls for one in list_arrays(call.arguments)])
    entries = [add_entry(image, call) for call in calls]
    values = _format_places(image, entries, state, motion) | _format_guard(state)
    begins = state.previous[0]  # with its loops closed
    warn_of_long_step(mechanism, begins, settings.step)
    values |= _format_readings(image, state, prefix)
    values["start_numbers"] = format_numbers(begins)
    values |= format_parameters(image, state, settings.payloads, prefix)
    values["at_strains"] = str(image.find_place(strained.arguments[-1]))
    parts = ["links", "flexible", "poses", "turned", "wrenches"]
    parts += ["beams", "strains", "parameters"] if mechanism.beams else ["parameters"]
    parts += ["bodies", "payloads"] if settings.payloads else []
    changes = _format_changes(image, state, prefix)
    parts += changes
    values |= {name: text for texts in changes.values() for name, text in texts.items()}
    values |= _format_rest(image, rest, entries[len(steps) : -1])
    parts += ["settle", rest.template, "rest"]
    golden = _make_step_series(controller, state, begins)
    return LibraryPlan("flexible", mechanism, entries, image, values, golden, tuple(parts), begins, settings.step)


def _format_changes(image: MemoryImage, state: FlexibleState, prefix: str) -> dict[str, dict[str, str]]:
    """Template -> its texts, of what changes while it marches beside parameters: damping of beams, and given forces."""
    out = dict[str, dict[str, str]]()
    mesh = state.solver.mesh
    elements = state.solver.elements if state.flat is None else state.flat.system.elements
    if (damping := format_damping(image, mesh, elements)) is not None:
        out["damping"] = damping
    if state.loads is not None and list_moved_forces(mesh):
        tables = [state.loads.applied.forces.wrench, state.arguments[0].table]
        out["forces"] = format_forces(image, mesh, tables, prefix)
    return out


def _format_places(
    image: MemoryImage, entries: Sequence[Entry], state: FlexibleState, motion: Sequence[Array]
) -> dict[str, str]:
    """Places of what a step is given and of what it leaves, and the numbers of what a march returns."""
    at_q, at_qd, at_qdd = map(image.find_place, motion)
    places = {
        "at_q": at_q, "at_qd": at_qd, "at_qdd": at_qdd, "at_tau": image.find_place(state.tau),
        "at_account": image.find_place(state.instant.account), "at_marched": entries[1].result,
        "at_judged": entries[2].result, "too_much": TURNED_TOO_MUCH, "slipped": SLIPPED, "sudden": SUDDEN_START,
    }  # fmt: skip
    return {name: str(value) for name, value in places.items()}


def _format_readings(image: MemoryImage, state: FlexibleState, prefix: str) -> dict[str, str]:
    """Places and tables of what is read after a step."""
    mesh = state.solver.mesh
    poses = format_poses(image, mesh, state.frames, "Of the last step, or of the start.")
    beams = format_beams(image, mesh, state.solver.instant.internal, prefix)
    return poses | format_wrenches(image, mesh, state.instant.line, prefix) | beams


def _begin_controller(mechanism: Mechanism, settings: MarchSettings) -> Controller:
    """A controller at rest at the start; raises InputError where it begins suddenly."""
    controller = Controller.of(mechanism, step=settings.step, spectral_radius=settings.spectral_radius)
    still = np.zeros(mechanism.nv)
    controller.start(settings.start, still, still, settings.initial)
    if controller.flexible is not None and controller.flexible.early_steps:
        raise InputError(
            f"export: mechanism {mechanism.name!r} begins suddenly at this position (initial = {settings.initial!r}): its "
            "first steps would be made in parts, for which the C library has no kernel; write initial='static', or a shorter step"
        )
    return controller


def _format_guard(state: FlexibleState) -> dict[str, str]:
    """Numbers of `balance.find_excessive_energies`; the energy that rates carry is the square of a sum over them."""
    mesh = state.solver.mesh
    carried = [float(compute_carried_energy(mesh, rate[None], state.passive)[0]) for rate in np.eye(state.nv)]
    rounding = compute_energy_rounding(mesh)
    return {"roots": format_numbers(np.sqrt(carried)), "reason": REASON.hex(), "rounding": rounding.hex()}


def _list_step_calls(state: FlexibleState, motion: list[Array], prefix: str) -> list[KernelCall]:
    """The kernels of one step, in the order in which `Controller.step` calls them."""
    place: Any = (fill_relative, state.joints) if state.flat is None else (fill_given, state.prescribed, state.given[0])
    march: Any = integrate_instants if state.flat is None else integrate_planar_motion
    evaluate = evaluate_guarded_torques if state.loads is None else evaluate_loaded_torques
    torques = (*state.parts, tuple(motion), *state.loading, state.tau)
    return [
        KernelCall(f"{prefix}_kernel_place", place[0], (state.nodes, *motion, *place[1:])),
        KernelCall(f"{prefix}_kernel_march", march, (state.system, state.scheme, *state.arguments)),
        KernelCall(f"{prefix}_kernel_torques", evaluate, torques),
    ]


def _format_rest(image: MemoryImage, rest: RestStart, entries: Sequence[Entry]) -> dict[str, str]:
    """Places of the start at rest, and of what is zero there."""
    results = zip(("at_begun", "at_settled", "at_rested")[-len(entries) :], entries, strict=True)
    places = {name: image.find_place(one) for name, one in rest.places.items()} | {
        name: one.result for name, one in results
    }
    still = ", ".join(f"{{{image.find_place(one)}, {one.size}}}" for one in rest.still)
    return {name: str(place) for name, place in places.items()} | {"rest_rates": still, **rest.texts}


def _make_step_series(controller: Controller, state: FlexibleState, start: Array) -> GoldenSeries:
    """Efforts of a move from rest, as far as the march takes it: drives of one loop may hinder each other."""
    kept = state.copy_state()
    for way in GOLDEN_SWINGS:
        try:
            return _run_golden_march(controller, state, start, way)
        except ConvergenceError:
            state.replace_state(kept)
            controller.begun = True
    step = state.scheme.h
    advised = format_advised_step(find_slowest_vibration(state.mechanism, start), step)
    raise InputError(
        f"export: mechanism {state.mechanism.name!r} does not even stand still at this position for {REPLAYED_STEPS} steps of "
        f"{step:g} s; write {advised}, or another start"
    )


def _run_golden_march(controller: Controller, state: FlexibleState, start: Array, swing: float) -> GoldenSeries:
    """A smooth move of all driven joints from rest, s = 10 x^3 - 15 x^4 + 6 x^5 of a swing [rad], [m], and its efforts."""
    x = np.arange(1, REPLAYED_STEPS + 1) / REPLAYED_STEPS
    end = REPLAYED_STEPS * state.scheme.h
    way = swing * state.mechanism.actuated
    place = x**3 * (10 - 15 * x + 6 * x**2)
    rate = 30 * x**2 * (1 - x) ** 2 / end
    acceleration = 60 * x * (1 - x) * (1 - 2 * x) / end**2
    q = np.tile(start, (REPLAYED_STEPS, 1))
    for coordinates, part in zip(q, place, strict=True):
        integrate_array(state.nodes, coordinates, part * way)
    qd = np.outer(rate, way)
    qdd = np.outer(acceleration, way)
    tau = [controller.step(*now).copy() for now in zip(q, qd, qdd, strict=True)]
    return GoldenSeries(q, qd, qdd, np.array(tau), MARCH_TOLERANCE)
