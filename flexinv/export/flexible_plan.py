"""The library of a mechanism with beams: the step of `analysis.controller.Controller`, its three kernels one after the other.

    place the joints          `fill_given` in the plane, `fill_relative` in space
    march one time step       `integrate_planar_motion` or `integrate_instants`
    tau = L T P, guarded      `evaluate_guarded_torques`

The block is the work space of a controller that has been started in Python, as it stands then; so every library begins at the
position, at rest, that it was made for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexinv.analysis.controller import Controller, FlexibleState
from flexinv.dynamics.stepper import SLIPPED, SUDDEN_START, TURNED_TOO_MUCH, integrate_instants
from flexinv.errors import InputError
from flexinv.export.library_plan import BLOCK_HEADER, GoldenSeries, LibraryPlan, refuse_parts
from flexinv.export.machine_code import Entry, KernelCall, add_entry
from flexinv.export.memory_image import MemoryImage, list_arrays
from flexinv.export.names import format_numbers
from flexinv.export.rest_plan import RestStart, plan_rest_start
from flexinv.inverse.balance import REASON, compute_carried_energy, compute_energy_rounding, evaluate_guarded_torques
from flexinv.kinematics.configuration import fill_given, fill_relative, integrate_array
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.planar.stepper import integrate_planar_motion
from flexinv.typing import Array

REPLAYED_STEPS = 20  # steps of the self-test
GOLDEN_SWING = 0.02  # way of every driven joint in it [rad], [m]
# Of the self-test, in parts of the largest effort: a rounding of the position of 0.4 m is 7e-12 of the peak acceleration at steps
# of 5e-4 s, and marches on.  On this processor no digit differs.
MARCH_TOLERANCE = 1e-9


def plan_flexible_library(
    mechanism: Mechanism, prefix: str, step: float, start: Array, initial: str, spectral_radius: float
) -> LibraryPlan:
    """Return the library [N m], [N] of a mechanism with beams, whose names begin with ``prefix``.

    step : between two calls [s]; start : (nq,) position in which it begins at rest [rad], [m]; initial : "static" or "consistent"
    Raises InputError where none can be made, ConvergenceError where the position has no equilibrium.
    """
    controller = _begin_controller(mechanism, step, start, initial, spectral_radius)
    state = controller.flexible
    assert state is not None
    motion = [np.zeros(size) for size in (mechanism.nq, mechanism.nv, mechanism.nv)]
    rest = plan_rest_start(state, motion, prefix)
    steps = _list_step_calls(state, motion, prefix)
    calls = [*steps, *(rest.calls if rest else ())]
    image = MemoryImage(BLOCK_HEADER, [one for call in calls for one in list_arrays(call.arguments)])
    entries = [add_entry(image, call) for call in calls]
    at_q, at_qd, at_qdd = map(image.find_place, motion)
    places = {
        "at_q": at_q, "at_qd": at_qd, "at_qdd": at_qdd, "at_tau": image.find_place(state.tau),
        "at_account": image.find_place(state.instant.account), "at_marched": entries[1].result,
        "at_judged": entries[2].result, "too_much": TURNED_TOO_MUCH, "slipped": SLIPPED, "sudden": SUDDEN_START,
    }  # fmt: skip
    values = {name: str(value) for name, value in places.items()} | _format_guard(state)
    values["start_numbers"] = format_numbers(start)
    more: tuple[str, ...] = ()
    if rest is not None:
        values |= _format_rest(image, rest, entries[len(steps) :])
        more = ("settle", rest.template, "rest")
    golden = _make_step_series(controller, state, start)
    return LibraryPlan("flexible", mechanism, entries, image, values, golden, more, start, step)


def _begin_controller(mechanism: Mechanism, step: float, start: Array, initial: str, radius: float) -> Controller:
    """A controller at rest at the start; raises InputError for what acts on the mechanism and has no kernel of one step."""
    winding = [j for j in mechanism.joints if KINDS[j.kind].circle and j.stiffness and j.actuated]
    parts: dict[str, Sequence[Any]] = {
        "beams and closures": mechanism.closures, "beams and springs between points": mechanism.springs,
        "beams and forces": mechanism.forces, "beams and springs in joints that turn without end": winding,
    }  # fmt: skip
    refuse_parts(mechanism, parts, "flexinv.Controller or flexinv.solve")
    controller = Controller.of(mechanism, step=step, spectral_radius=radius)
    still = np.zeros(mechanism.nv)
    controller.start(start, still, still, initial)
    if controller.flexible is not None and controller.flexible.early_steps:
        raise InputError(
            f"export_c: mechanism {mechanism.name!r} begins suddenly at this position (initial = {initial!r}): its first steps "
            "would be made in parts, for which the C library has no kernel; write initial='static', or a shorter step"
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
    place: Any = (fill_relative, state.joints) if state.flat is None else (fill_given, state.given[0])
    march: Any = integrate_instants if state.flat is None else integrate_planar_motion
    torques = (*state.parts, tuple(motion), state.instant, state.tau)
    return [
        KernelCall(f"{prefix}_kernel_place", place[0], (state.nodes, *motion, place[1])),
        KernelCall(f"{prefix}_kernel_march", march, (state.system, state.scheme, *state.arguments)),
        KernelCall(f"{prefix}_kernel_torques", evaluate_guarded_torques, torques),
    ]


def _format_rest(image: MemoryImage, rest: RestStart, entries: Sequence[Entry]) -> dict[str, str]:
    """Places of the start at rest, and of what is zero there."""
    results = zip(("at_begun", "at_settled", "at_rested"), entries, strict=True)
    places = {name: image.find_place(one) for name, one in rest.places.items()} | {
        name: one.result for name, one in results
    }
    still = ", ".join(f"{{{image.find_place(one)}, {one.size}}}" for one in rest.still)
    return {name: str(place) for name, place in places.items()} | {"rest_rates": still, **rest.texts}


def _make_step_series(controller: Controller, state: FlexibleState, start: Array) -> GoldenSeries:
    """A smooth move of all driven joints from rest, s = 10 x^3 - 15 x^4 + 6 x^5 of GOLDEN_SWING, and its efforts."""
    x = np.arange(1, REPLAYED_STEPS + 1) / REPLAYED_STEPS
    end = REPLAYED_STEPS * state.scheme.h
    way = GOLDEN_SWING * state.mechanism.actuated
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
