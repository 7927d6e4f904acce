"""find_gradient: derivatives of one number by many parameters, in one march backwards.

`differentiate` marches tangents, of which there are as many as parameters.  Here costates of one number are marched
(`adjoint_kernel`), which cost the same for one parameter and for a thousand.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexinv.analysis.solution import Solution
from flexinv.analysis.task import Start
from flexinv.errors import ConvergenceError, InputError
from flexinv.linearized.residual_vibration import compute_amplitudes
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.sensitivity.adjoint_kernel import Costates, InputSlopes, Seeds, integrate_adjoint
from flexinv.sensitivity.differentiate import Leg, MarchDifferentiation, prepare_differentiation
from flexinv.sensitivity.gradient import Gradient
from flexinv.sensitivity.march_states import build_massive_solver, compute_end_slopes, make_tangent_scratch
from flexinv.sensitivity.parameters import Parameter
from flexinv.sensitivity.sensitivities import Sensitivities, check_unchanged_ends
from flexinv.sensitivity.tangent_records import StepTangents, TangentTask
from flexinv.typing import Array
from flexinv.validation import check_finite_array, check_mapping, check_number, find_nearest_word

# What a number may be a sum of, and what each is multiplied by.
RESULTS = ("torque", "q", "tip", "residual")
Weights = Mapping[str, Array | float | Mapping[str, Array]]


def find_gradient(
    mechanism: Mechanism, motion: Motion, of: Weights | Callable[[Solution], Weights],
    by: str | Parameter | Iterable[str | Parameter], step: float, end: float | None = None,
    spectral_radius: float = 0.8, initial: str = "consistent", start: Start = None, start_rate: Start = None,
) -> Gradient:  # fmt: skip
    """Return the derivatives of one number by parameters of motion and mechanism [any unit], in one march backwards.

    of : weights of results, of which the number is the sum: "torque" (samples, actuated), "q" (samples, nv), "tip" a table of
        (samples, 3) by link, "residual" a factor of the energy that goes on swinging; or a function of the Solution that returns
        them, as  lambda s: {"torque": s.torque / len(s.time)}  for half the mean square of the torques
    by, step, end, spectral_radius, initial, start, start_rate : as `differentiate` takes them
    A parameter of the mechanism costs six evaluations of the forces along the way, rows of a motion next to nothing.
    Raises InputError and ConvergenceError as `differentiate`, and InputError for weights that are none.
    """
    settings = {
        "step": step, "end": end, "spectral_radius": spectral_radius, "initial": initial, "start": start,
        "start_rate": start_rate,
    }  # fmt: skip
    run = prepare_differentiation(mechanism, motion, by, settings)
    weights = _check_weights(of(run.solution) if callable(of) else of, run)
    values = np.array([parameter.value for parameter in run.parameters], dtype=float)
    names = tuple(parameter.name for parameter in run.parameters)
    if mechanism.is_rigid and mechanism.closures:  # solved sample by sample: there is no march to go back
        gradient = _add_up_sensitivities(run.run_march(), weights)
    else:
        gradient = _Adjoint(run, weights).compute_gradient()
    return Gradient(run.solution, names, values, gradient)


@dataclass(frozen=True)
class _Weighted:
    """Weights of results: torque (samples, actuated), q (samples, nv), tip of some links (samples, 3), of the energy left."""

    torque: Array
    q: Array
    tip: Mapping[str, Array]
    residual: float


def _check_weights(weights: object, run: MarchDifferentiation) -> _Weighted:
    """The weights, zero where there are none.  Raises InputError."""
    table = check_mapping("of", weights, "a table of weights (samples, drives) and the like", "{'residual': 1.0}")
    if not table:
        raise InputError(f"of: expected at least one of {', '.join(RESULTS)}, for example {{'residual': 1.0}}")
    for name in table:
        if name not in RESULTS:
            like = find_nearest_word(str(name), RESULTS)
            raise InputError(
                f"of: {name!r}: expected one of {', '.join(RESULTS)}" + (f"; write {like!r}" if like else "")
            )
    solution = run.solution
    samples = len(solution.time)
    links = [joint.child for joint in run.mechanism.joints]
    expected = "a table of weights (samples, 3) by link"
    tips = check_mapping("of: tip", table.get("tip", {}), expected, f"{{'tip': {{{links[-1]!r}: weights}}}}")
    for name in tips:
        if name not in links:
            raise InputError(f"of: tip of {name!r}: expected one of {', '.join(links)}")
    residual = check_number("of: residual", table.get("residual", 0.0), "a finite number")
    if residual:
        check_unchanged_ends([parameter.name for parameter in run.parameters], run.find_ends_alike(), solution)
    return _Weighted(
        torque=_take_array(table, "torque", solution.torque.shape),
        q=_take_array(table, "q", solution.qd.shape),
        tip={name: check_finite_array(f"of: tip of {name}", tips[name], (samples, 3), "any unit") for name in tips},
        residual=residual,
    )


def _take_array(table: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> Array:
    """The weights of a result, zero where it has none."""
    return check_finite_array(f"of: {name}", table[name], shape, "any unit") if name in table else np.zeros(shape)


def _add_up_sensitivities(found: Sensitivities, weights: _Weighted) -> Array:
    """The sum of derivatives that tangents gave."""
    out = np.einsum("sa,sap->p", weights.torque, found.torque) + np.einsum("sv,svp->p", weights.q, found.q)
    for name, weight in weights.tip.items():
        out += np.einsum("si,sip->p", weight, found.tip[name])
    if weights.residual:
        out += weights.residual * found.differentiate_residual_vibration().energy
    return np.asarray(out)


class _Adjoint:
    """One number of a march, differentiated backwards."""

    def __init__(self, run: MarchDifferentiation, weights: _Weighted) -> None:
        """Record what is differentiated."""
        self.run = run
        self.weights = weights
        self.system = run.system

    def compute_gradient(self) -> Array:
        """Return the derivatives (parameters,) of the number [any unit].  Raises ConvergenceError, InputError."""
        run = self.run
        base = run.begin((run.mechanism, run.motion))
        legs = run.list_legs(base)
        tangents, first = run.make_start_tangents(base)
        effort = self._collect_effort_weights()
        out = np.tensordot(effort, run.compute_friction(run.solution.qd[:, run.given], run.given), axes=2)
        if not run.starts_in_balance:
            out += effort[0] @ first
            effort[0] = 0.0
        costates = self._make_costates()
        self._add_residual_costates(legs[-1][1], costates)
        for leg, task in reversed(legs):
            seeds = self._make_seeds(leg, effort)
            slopes = self._integrate(leg, task, seeds, costates)
            out += run.given_slopes.add_up_weighted(leg.time, slopes.given) + _add_up_inputs(
                len(out), task, seeds, slopes
            )
            if leg.first:  # the march goes on from the accelerations there
                costates.acceleration[:] += costates.pseudo
                costates.pseudo[:] = 0.0
        for costate, tangent in zip(costates[:4], tangents[:4], strict=True):
            out += costate @ tangent
        return out

    def _collect_effort_weights(self) -> Array:
        """Weights (samples, joints) of the efforts of joints with a motion."""
        run = self.run
        whole = np.zeros_like(run.solution.qd)
        whole[:, run.mechanism.actuated] = self.weights.torque
        return np.ascontiguousarray(whole[:, run.given])

    def _make_seeds(self, leg: Leg, effort: Array) -> Seeds:
        """Weights over the samples of a leg; the last sample of the first steps belongs to the rest."""
        run = self.run
        count = len(leg.time)
        whole = len(range(0, count, leg.every)) - (leg.every > 1)
        rows = slice(0, whole * leg.every, leg.every)
        samples = slice(leg.first, leg.first + whole)
        joints = run.mechanism.joints
        seeds = Seeds(
            np.zeros((count, effort.shape[1])), np.zeros((count, len(joints), 3)), np.zeros((count, self.system.size))
        )
        seeds.effort[rows] = effort[samples]
        seeds.pose[rows, self.system.unknown] = self.weights.q[samples]
        for place, joint in enumerate(joints):
            if joint.child in self.weights.tip:
                seeds.tip[rows, place] = self.weights.tip[joint.child][samples]
        return seeds

    def _make_costates(self) -> Costates:
        size = self.system.size
        rows = self.system.rows
        return Costates(
            pose=np.zeros(size),
            rate=np.zeros(size),
            acceleration=np.zeros(size),
            pseudo=np.zeros(size),
            shown=np.zeros(size),
            factors=np.zeros(size),
            pulls=np.zeros(rows),
            opening=np.zeros(rows),
            ones=np.ones((size, 1)),
        )

    def _add_residual_costates(self, task: TangentTask, costates: Costates) -> None:
        """Add to the costates of the last sample what the energy left is worth."""
        if not self.weights.residual:
            return
        run = self.run
        solution = run.solution
        size = self.system.size
        units = np.zeros((5, size, 3 * size))
        for part in range(3):
            units[part, :, part * size : (part + 1) * size] = np.eye(size)
        units[4] = units[2]
        joints = solution.q[-1], solution.qd[-1], solution.qdd[-1]
        slopes = compute_end_slopes(self.system, task.states, StepTangents(*units), joints)
        vibration = solution.find_residual_vibration()
        cosine, sine = compute_amplitudes(vibration.modes, slopes)
        squared = vibration.modes.squared.real
        energy = cosine @ (squared * vibration.cosine) + sine @ (squared * vibration.sine)
        pose, rate, acceleration = self.weights.residual * energy.reshape(3, size)
        costates.pose[:] += pose
        costates.rate[:] += rate
        shown = costates.shown if self.system.constraints else costates.acceleration
        shown[:] += acceleration

    def _integrate(self, leg: Leg, task: TangentTask, seeds: Seeds, costates: Costates) -> InputSlopes:
        """March the costates back over a leg.  Raises ConvergenceError."""
        system = self.system
        count = len(leg.time)
        slopes = InputSlopes(
            np.zeros((3, count, len(task.freedoms.prescribed))),
            np.zeros((2, count, system.size)),
            np.zeros((2, count, system.rows)),
        )
        scratch = make_tangent_scratch(system, len(task.freedoms.marched), 1)
        solver = system.solver
        massive = build_massive_solver(solver)
        bad = integrate_adjoint(solver.system, massive.system, task, leg.scheme, seeds, costates, scratch, slopes)
        if bad >= 0:
            raise ConvergenceError(
                f"mechanism '{self.run.mechanism.name}', at sample {bad}: an element turns too much to be linearised; use "
                "more elements"
            )
        return slopes


def _add_up_inputs(parameters: int, task: TangentTask, seeds: Seeds, slopes: InputSlopes) -> Array:
    """Derivatives (parameters,) of a number by what parameters do to forces, closures and tips in a leg."""
    inputs = task.inputs
    out = np.zeros(parameters)
    out[inputs.column] += np.tensordot(slopes.pushed, inputs.pushed, axes=3)
    out[inputs.column] += np.tensordot(slopes.opened, inputs.opened, axes=3)
    out[inputs.column] += np.tensordot(seeds.tip, inputs.shifted, axes=3)
    return out
