"""Exudyn's marches of beams as they are run when time matters: the adapters' models with nothing but what the march needs.

No files, no sensors; modified Newton, which keeps its Jacobian while it converges, or full Newton; dense or sparse matrices;
tolerances of 1e-6, which the defaults of 1e-8 and 1e-10 would turn into failures or hundreds of iterations.  The motion
is put in once per step where the engine has a parameter for it (in the plane), else by a user function (in space).
The fast build, without range checks, is what ``sys.exudynFast = True`` before the first import of exudyn gives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import SensorNode

from crosscheck.engines.exudyn.integration import ExudynFailure, Plan, build_solver_settings, quiet
from crosscheck.engines.exudyn.loops import Model, build_model, compute_drive_efforts, integrate_model
from crosscheck.engines.exudyn.models import planar as exudyn_planar
from crosscheck.engines.exudyn.models import spatial as exudyn_spatial
from crosscheck.engines.exudyn.models.frames import compute_scalar_coordinate, take_joint_q
from crosscheck.engines.exudyn.models.layout import Layout, build_layout
from crosscheck.engines.exudyn.run_in_time import ANCF, EXACT
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array

# of generalized-alpha, and of Newton where torques are asked for
RADIUS = 0.8
INCREMENT = 1e-9
TOLERANCES = (1e-6, 1e-5)  # the looser one where the stricter stalls on its own rounding (fine meshes)


@dataclass(frozen=True)
class Setting:
    """Settings of Newton's method: modified or full, dense or sparse matrices, tolerance [-]."""

    modified: bool
    dense: bool
    tolerance: float = TOLERANCES[0]

    def __str__(self) -> str:
        kinds = ("modified" if self.modified else "full", "dense" if self.dense else "sparse")
        return f"{' Newton, '.join(kinds)}, {self.tolerance:.0e}"


@dataclass(frozen=True)
class March:
    """A model of a mechanism whose joints all move as told, ready to be marched.

    formulation : "ancf" or "ge"; elements : of every beam; step, end : [s]; spectral_radius : of generalized-alpha [-]
    """

    mechanism: Mechanism
    motion: Motion
    formulation: str
    elements: int
    step: float
    end: float
    spectral_radius: float = 0.8

    def list_settings(self) -> list[Setting]:
        """Return the settings worth trying, the stricter tolerance first; dense matrices where there are few unknowns."""
        kinds = [(True, False), (False, False), *([(True, True)] if self.elements <= 16 else [])]
        return [Setting(modified, dense, tolerance) for tolerance in TOLERANCES for modified, dense in kinds]

    def make_runner(self, setting: Setting) -> Callable[[], None]:
        """Return a function that marches from the start to the end.  Raises ExudynFailure where Newton fails."""
        return self.make_simulation_runner(_build_simulation_settings(self, setting), str(setting))

    def make_simulation_runner(self, simulation: Any, setting: str) -> Callable[[], None]:
        """Return a function that marches by Exudyn's own settings, which errors call ``setting``."""
        mbs, _ = self._build_system(sensors=False)
        return self._make_solver_call(mbs, simulation, setting)

    def sample_tips(self, setting: Setting, every: float) -> dict[str, Array]:
        """Return the positions of the beams' ends, (samples, 3) [m], every so many seconds [s]."""
        mbs, sensors = self._build_system(sensors=True)
        self._make_solver_call(mbs, _build_simulation_settings(self, setting), str(setting))()
        rows = slice(None, None, round(every / self.step))
        return {name: place(np.array(mbs.GetSensorStoredData(s))[rows, 1:4]) for name, (s, place) in sensors.items()}

    def _make_solver_call(self, mbs: Any, simulation: Any, setting: str) -> Callable[[], None]:
        def run() -> None:
            with quiet():
                try:
                    done = mbs.SolveDynamic(simulation, solverType=exu.DynamicSolverType.GeneralizedAlpha)
                except Exception as error:
                    raise ExudynFailure(f"{self.elements} elements, {setting}: {error}") from error
            if done is False:
                raise ExudynFailure(f"{self.elements} elements, {setting}: no success")

        return run

    def _build_system(self, sensors: bool) -> tuple[Any, dict[str, Any]]:
        steps = round(self.end / self.step)
        q, qd, _ = self.motion.evaluate(self.mechanism, self.step * np.arange(steps + 2))
        layout = build_layout(self.mechanism, q[0], qd[0])
        plane = exudyn_planar.find_plane(self.mechanism, layout)
        with quiet():
            if isinstance(plane, str):
                return _build_spatial_march(self, layout, q, sensors)
            return _build_planar_march(self, layout, plane, q, sensors)


def make_quiet_call(call: Callable[[], object]) -> Callable[[], object]:
    """Return a call that prints nothing [-]."""

    def run() -> object:
        with quiet():
            return call()

    return run


@dataclass(frozen=True)
class TorqueMarch:
    """A march of a mechanism for its torques; fields as of `March`, the case's motion and start, samples: that are seen.

    Joints that the motion leaves out move as closures have it.
    Newton stops on its increments, as in the adapter: where it stops on its residual, torques are off by up to 1e-2 of the range.
    keeps : the Jacobian lasts while Newton converges, or for one step
    """

    mechanism: Mechanism
    case: Case
    formulation: str
    elements: int
    steps: int
    end: float
    samples: int
    keeps: bool = True

    @property
    def plan(self) -> Plan:
        """Return the settings of the time integration [s], [-]."""
        return Plan(
            self.end, self.end / self.steps, self.end / self.samples, False, RADIUS, INCREMENT, keeps=self.keeps
        )

    def compute_torques(self) -> Array:
        """Return the efforts (samples + 1, nv) [N m], [N].  Raises ExudynFailure where Newton fails."""
        model = self._build_model()
        with quiet():
            outcome = integrate_model(model, self.elements, self.plan)
        return compute_drive_efforts(
            model, outcome, np.asarray(self.plan.sample * np.arange(self.samples + 1), dtype=np.float64)
        )

    def _build_model(self) -> Model:
        return build_model(self.mechanism, self.case, {"ancf": ANCF, "ge": EXACT}[self.formulation])

    def make_runner(self) -> Callable[[], object]:
        """Return a function that marches from the start to the end.  Raises ExudynFailure where Newton fails.

        Of open chains it is SolveDynamic alone, without sensors; of loops all but finding the start.
        """
        if self.mechanism.closures:
            model = self._build_model()
            plan = self.plan
            return make_quiet_call(lambda: integrate_model(model, self.elements, plan))
        motion = self.case.motion
        march = March(self.mechanism, motion, self.formulation, self.elements, self.end / self.steps, self.end)
        return march.make_simulation_runner(build_solver_settings(self.plan), f"{self.steps} steps")

    def __str__(self) -> str:
        return f"{self.elements} elements, {self.steps} steps, Jacobian {'kept' if self.keeps else 'once a step'}"


def _build_simulation_settings(march: March, setting: Setting) -> Any:
    s = exu.SimulationSettings()
    t = s.timeIntegration
    t.endTime = march.end
    t.numberOfSteps = round(march.end / march.step)
    t.adaptiveStep = False
    t.generalizedAlpha.spectralRadius = march.spectral_radius
    t.newton.useModifiedNewton = setting.modified
    t.newton.relativeTolerance = t.newton.absoluteTolerance = setting.tolerance
    t.verboseMode = 0
    s.solution.file.write = False
    s.solution.sensors.writePeriod = march.step
    kinds = exu.LinearSolverType
    s.linearSolver.solverType = kinds.EXUdense if setting.dense else kinds.EigenSparse
    return s


def _build_planar_march(
    march: March, layout: Layout, plane: Array, q: Array, sensors: bool
) -> tuple[Any, dict[str, Any]]:
    """The adapter's model in the plane; once per step the offsets of all motors are set."""
    d = exudyn_planar.build(march.mechanism, layout, plane, march.formulation == "ancf", march.elements)
    mbs = d.model.mbs
    motors = []
    for joint in _list_moving_joints(march.mechanism):
        axis = layout.compute_start_pose(layout.joint[joint.name]).rotation @ joint.axis
        angle = float(plane[:, 2] @ axis) * compute_scalar_coordinate(joint, take_joint_q(march.mechanism, joint, q))
        motors.append((d.model.joint[joint.name][1], (angle - angle[0]).tolist()))
    per_step = 1.0 / march.step

    def update_offsets(mbs: Any, t: float) -> bool:
        k = round(t * per_step)
        for number, offsets in motors:
            mbs.SetObjectParameter(number, "offset", offsets[k])
        return True

    mbs.SetPreStepUserFunction(update_offsets)
    return mbs, _add_tip_sensors(
        d, sensors, lambda name, flat: exudyn_planar.convert_to_world(d, layout.root[name], flat)
    )


def _build_spatial_march(march: March, layout: Layout, q: Array, sensors: bool) -> tuple[Any, dict[str, Any]]:
    """The adapter's model in space; every joint has its user function, which looks a list up."""
    d = exudyn_spatial.build(march.mechanism, layout, march.formulation == "ancf", march.elements)
    mbs = d.model.mbs
    per_step = 1.0 / march.step
    for joint in _list_moving_joints(march.mechanism):
        joint_q = take_joint_q(march.mechanism, joint, q)
        for number, rows in zip(
            d.model.joint[joint.name], exudyn_spatial._compute_offsets(d, joint, joint_q), strict=True
        ):
            mbs.SetObjectParameter(number, "offsetUserFunction", _make_row_lookup(rows.tolist(), per_step))
    return mbs, _add_tip_sensors(d, sensors, lambda name, place: place)


def _make_row_lookup(rows: list[list[float]], per_step: float) -> Any:
    return lambda mbs, t, item, parameters: rows[round(t * per_step)]


def _list_moving_joints(mechanism: Mechanism) -> list[Joint]:
    return [joint for joint in mechanism.joints if joint.nv]


def _add_tip_sensors(drawing: Any, sensors: bool, place: Callable[[str, Array], Array]) -> dict[str, Any]:
    """Sensors of the ends of all beams, and what turns their data into places in the world."""
    if not sensors:
        return {}
    kind = exu.OutputVariableType.Position
    add = drawing.model.mbs.AddSensor
    made = {
        name: add(SensorNode(nodeNumber=nodes[-1], outputVariableType=kind, storeInternal=True))
        for name, nodes in drawing.model.beam.items()
    }
    drawing.model.mbs.Assemble()
    return {name: (number, lambda data, name=name: place(name, data)) for name, number in made.items()}
