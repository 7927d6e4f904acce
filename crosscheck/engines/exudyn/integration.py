"""Time integration in Exudyn: settings that do not bend silently, and a check that the run came to its end.

Traps that this module closes (exudyn 1.13.6): the adaptive step subdivides in silence (off); a run that stops early
returns normally with shorter sensor data (the last time is checked); ``SolverError`` carries no reason (read from the
solver); ``./solution`` is written by default (off); a static solution evaluates user functions at a load factor
instead of the time (they are taken off for it); the console is used from C++ (off, and put back); the multipliers at
t = 0 come from C q'' = 0 without the acceleration that the motion prescribes (static ones or ``Plan.extrapolate``);
Newton stops on its residual, which in index 3 leaves up to 1e-2 of the range in reactions and stalls at its rounding
where stricter (here it stops on its increment: no spikes, no stalls); but that increment does not see the multipliers,
so that with a Jacobian kept from another position a mechanism at rest converges at once, to wrong reactions (here the
Jacobian is renewed once per step).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.solver import SolverSuccess
from numpy.typing import NDArray

from crosscheck.engines.exudyn.script import add_solve_record

Array = NDArray[np.float64]
Key = tuple[Any, ...]
Sensors = dict[Key, Any]
Begin = Callable[[Any], None]


# Exudyn adds up its times: 1e5 steps of rounding (1e5 x 1e-16) stay far below this fraction of a step.
SAME_TIME = 1e-6


class ExudynFailure(RuntimeError):
    """Exudyn did not give what it was asked for; the message says at which time and why, as far as it tells."""


class NewtonStalled(ExudynFailure):
    """Newton did not reach its tolerance; a looser one may do."""


@dataclass(frozen=True)
class Plan:
    """Settings of a time integration.

    end, step, sample : [s], sample a multiple of step; index2 : TrapezoidalIndex2, else generalized-alpha (index 3)
    with this spectral radius; tolerance : of Newton's increment, relative and absolute
    extrapolate : replace the reactions at t = 0 by 2 R(h) - R(2 h), an error of order h^2
    static_start : rest in static equilibrium first, the motion held at its start; its reactions are those at t = 0
    lead : time before 0 at which the run begins [s], a multiple of step; what is seen before 0 is dropped
    keeps : the Jacobian lasts while Newton converges, not for one step (see the head of this module)
    """

    end: float
    step: float
    sample: float
    index2: bool
    spectral_radius: float
    tolerance: float
    extrapolate: bool = False
    static_start: bool = False
    lead: float = 0.0
    keeps: bool = False

    @property
    def steps(self) -> int:
        """Return the number of steps [-], the lead-in's included."""
        return round((self.lead + self.end) / self.step)

    @property
    def integrator(self) -> str:
        """Return the name of the integrator for the record's settings."""
        return "TrapezoidalIndex2" if self.index2 else f"generalized-alpha, index 3, rho = {self.spectral_radius:g}"


@dataclass(frozen=True)
class Table:
    """Values of the prescribed motion at every time at which Exudyn may ask.

    step : [s]; values : (steps + 1, columns), or (steps + 1,) for numbers
    """

    step: float
    values: Array

    @cached_property
    def rows(self) -> list[Any]:
        """Rows as plain numbers, which the engine reads the fastest [any unit]."""
        rows: list[Any] = self.values.tolist()
        return rows

    def __call__(self, time: float) -> Any:
        """Return the row at a multiple of the step.  Raises ExudynFailure at any other time [s]."""
        k = round(time / self.step)
        if abs(time - k * self.step) > SAME_TIME * self.step or not 0 <= k < len(self.rows):
            raise ExudynFailure(f"Exudyn asks for the motion at t = {time!r} s, no multiple of {self.step:g} s")
        return self.rows[k]


@dataclass(frozen=True)
class Driver:
    """A connector whose offset follows the motion: its object number and its user functions (None: none)."""

    number: Any
    offset: Any
    rate: Any = None


def compute_step_times(plan: Plan) -> Array:
    """Return the times of all steps, (steps + 1,) [s]; Exudyn counts from 0 (it takes no negative time): lead is added."""
    before = round(plan.lead / plan.step)
    return np.arange(-before, plan.steps + 1 - before, dtype=np.float64) * plan.step


def compute_step_size(sample: float, target: float) -> float:
    """Return the largest step [s] up to ``target`` that divides the sample spacing [s]."""
    # A wanted step that divides the spacing up to rounding is taken as it is.
    return float(sample / np.ceil(sample / target * (1 - 1e-9)))


@contextmanager
def quiet() -> Iterator[None]:
    """Keep Exudyn from writing to the console, and put its global switch back."""
    before = exu.config.printToConsole
    exu.config.printToConsole = False
    try:
        yield
    finally:
        exu.config.printToConsole = before


def build_solver_settings(plan: Plan) -> Any:
    """Return Exudyn's simulation settings."""
    s = exu.SimulationSettings()
    t = s.timeIntegration
    t.startTime = 0.0
    t.endTime = plan.steps * plan.step
    t.numberOfSteps = plan.steps
    t.adaptiveStep = False
    t.generalizedAlpha.spectralRadius = plan.spectral_radius
    t.generalizedAlpha.computeInitialAccelerations = True
    t.newton.useModifiedNewton = True
    t.newton.modifiedNewtonJacUpdatePerStep = not plan.keeps
    s.staticSolver.newton.useModifiedNewton = False
    for solver in (t.newton, s.staticSolver.newton):
        solver.residualMode = 1
        solver.relativeTolerance = solver.absoluteTolerance = plan.tolerance
    s.staticSolver.numberOfLoadSteps = 10
    s.staticSolver.adaptiveStep = False
    s.solution.file.write = False
    s.solution.sensors.writePeriod = plan.step
    s.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    return s


def integrate(
    mbs: Any,
    plan: Plan,
    drivers: list[Driver],
    motions: Sensors,
    reactions: Sensors,
    loads: Mapping[Any, Any] = MappingProxyType({}),
    begin: Begin | None = None,
) -> dict[Key, Array]:
    """Integrate an assembled system and return what the sensors saw, (samples, components) each.

    motions, reactions : sensors of states and of multipliers; loads : user functions of loads, by number
    begin : puts the system where it begins, once its drivers know the motion
    Raises ExudynFailure where Newton does not converge, the run stops early or a value is not finite.
    """
    add_solve_record(mbs, plan, drivers, motions, reactions, loads)
    resting = _solve_static_start(mbs, plan, drivers, reactions, loads) if plan.static_start else {}
    for number, load in loads.items():
        mbs.SetLoadParameter(number, "loadVectorUserFunction", load)
    for driver in drivers:
        mbs.SetObjectParameter(driver.number, "offsetUserFunction", driver.offset)
        if driver.rate is not None:
            mbs.SetObjectParameter(driver.number, "offsetUserFunction_t", driver.rate)
    if begin is not None:
        begin(mbs)
    kind = exu.DynamicSolverType.TrapezoidalIndex2 if plan.index2 else exu.DynamicSolverType.GeneralizedAlpha
    with _convert_solver_errors(mbs, "dynamicSolver"):
        mbs.SolveDynamic(build_solver_settings(plan), solverType=kind)
    seen = {key: _read(mbs, sensor, plan) for key, sensor in (motions | reactions).items()}
    for key in reactions:
        if plan.extrapolate:
            seen[key][0] = 2 * seen[key][1] - seen[key][2]
        elif resting:
            seen[key][0] = resting[key]
    before = round(plan.lead / plan.step)
    stride = round(plan.sample / plan.step)
    return {key: data[before::stride] for key, data in seen.items()}


def _solve_static_start(
    mbs: Any, plan: Plan, drivers: list[Driver], reactions: Sensors, loads: Mapping[Any, Any]
) -> dict[Key, Array]:
    """Move the start to static equilibrium, with the loads of t = 0, and return the reactions there.

    The multipliers of the static solver have the opposite sign of those of the dynamic ones (1.13.6, measured).
    """
    for driver in drivers:
        mbs.SetObjectParameter(driver.number, "offsetUserFunction", 0)
    for number in loads:
        mbs.SetLoadParameter(number, "loadVectorUserFunction", 0)
    with _convert_solver_errors(mbs, "staticSolver"):
        mbs.SolveStatic(build_solver_settings(plan), updateInitialValues=True)
    return {key: -np.array(mbs.GetSensorValues(sensor), dtype=np.float64) for key, sensor in reactions.items()}


@contextmanager
def _convert_solver_errors(mbs: Any, solver: str) -> Iterator[None]:
    """Turn Exudyn's exceptions into one that gives the reason which only the solver object knows."""
    try:
        yield
    except exu.SolverError as error:
        where = mbs.sys.get(solver)
        known = "" if where is None else str(SolverSuccess(where)[1]).strip()
        raise NewtonStalled(f"Exudyn's {solver} failed: {known or error}") from error
    except Exception as error:
        raise ExudynFailure(f"Exudyn's {solver} failed: {type(error).__name__}: {error}") from error


def _read(mbs: Any, sensor: Any, plan: Plan) -> Array:
    data = np.array(mbs.GetSensorStoredData(sensor), dtype=np.float64)
    wanted = compute_step_times(plan) + plan.lead
    if len(data) != len(wanted) or np.abs(data[:, 0] - wanted).max() > SAME_TIME * plan.step:
        last = data[-1, 0] if len(data) else 0.0
        of = f"{len(data)} of {len(wanted)} steps, the last at t = {last:.6g} of {plan.end:.6g} s"
        raise ExudynFailure(f"Exudyn gives {of}")
    if not np.isfinite(data).all():
        bad = data[~np.isfinite(data).all(axis=1), 0][0]
        raise ExudynFailure(f"Exudyn gives values that are not finite, the first at t = {bad:.6g} s")
    return data[:, 1:]
