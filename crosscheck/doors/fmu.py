"""An FMU as an engine: inverse or forward dynamics behind the Functional Mock-up Interface 2.0 or 3.0, called by FMPy.

Which of the two its variables say; a forward one replays torques (`crosscheck.doors.fmu_replay`).  An inverse one has
inputs NAME.q, NAME.qd, NAME.qdd and outputs NAME.tau of every velocity NAME, each with its unit; no states, no events, and every
output depends on its inputs directly.  A model exchange FMU is a function of its inputs: set, get.  One for co-simulation alone
may answer later: then its inputs are held until its outputs stand, and the number of steps that takes is reported.

One for co-simulation alone that takes no step but the one that its default experiment states marches: it begins at rest with the
motion at the start, and gets at each step the motion at its end.  It may ask for the motion of joints that follow from closures.
"""

from __future__ import annotations

import importlib
import shutil
import time as clock
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.doors.config import accepts_case
from crosscheck.doors.fmu_description import (
    PLACE,
    check_feedthrough,
    check_stateless,
    count_steps,
    find_variables,
    is_forward,
    is_new,
    read_description,
    resolve_interface,
)
from crosscheck.doors.fmu_replay import ForwardFmuAdapter
from crosscheck.engines.base import Options, sample_times
from crosscheck.kit.resolved import UNITS, list_idle_velocities, list_quantity_series
from crosscheck.measures.record import Record, list_effort_units, torque_series
from flexinv.analysis.solve import solve
from flexinv.errors import InputError
from flexinv.export.acting_sets import find_acting_set
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

PHASE = "phase"  # input of an FMU whose closures come and go, as `flexinv.export_fmu` names it
MOST_STEPS = 4  # that a co-simulation FMU may take to answer: a chain of as many unit delays
STANDS = 1e-12  # of the largest output: an answer that changes less from one step to the next has come


def open_adapter(name: str, mechanism: str, settings: Mapping[str, Any]) -> FmuAdapter | ForwardFmuAdapter:
    """Return the adapter of an FMU; mechanism : its folder; settings : fmu (path), cases, version, abilities.

    In the path ``{mechanism}`` is the name of the mechanism's folder: FMUs of many mechanisms are one engine.
    """
    folder = Path(mechanism).name
    path = Path(settings["fmu"].replace(PLACE, folder))
    if path.is_file() and is_forward(read_description(path)):
        return ForwardFmuAdapter(path, folder, settings)
    return FmuAdapter(path, folder, settings)


class FmuAdapter:
    """The adapter of one FMU: it has the physics of its own mechanism, whatever it is asked for."""

    repeatable = False

    def __init__(self, path: Path, mechanism: str, settings: Mapping[str, Any]) -> None:
        """Keep the file, the name of the mechanism's folder, and the settings."""
        self._path = path
        self._mechanism = mechanism
        self._settings = settings

    def version(self) -> str:
        """Return the version that crosscheck.toml states, else that of the FMU's model description."""
        if (said := str(self._settings.get("version", ""))) or not self._path.is_file():
            return said
        description = read_description(self._path)
        return str(description.version or description.generationTool or "")

    def abilities(self) -> str:
        """Return one sentence: what it can do."""
        said = str(self._settings.get("abilities", ""))
        return said or f"the FMU {Path(self._settings['fmu']).name}, inverse dynamics"

    def unsupported(self, mechanism: Mechanism, case: Case, engine: str) -> str | None:
        """Return the reason why it is not asked, or None where it is."""
        patterns = list(self._settings.get("cases", ["*"]))
        if not accepts_case(patterns, self._mechanism or mechanism.name, case.name):
            return f"crosscheck.toml asks it for {', '.join(patterns)} only"
        if not self._path.is_file():
            return f"there is no FMU {self._path.name}"
        others = [j.name for j in mechanism.joints if j.nv and (j.nv > 1 or j.kind == "continuous")]
        return f"joints with more than one coordinate have no names in an FMU: {', '.join(others)}" if others else None

    def run(self, mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
        """Return its torques [N m], [N] on the sample times.  Raises InputError where it is not what the door asks for."""
        description = read_description(self._path)
        check_stateless(description, self._path)
        time = sample_times(case)
        every = count_steps(description, self._path, float(time[1] - time[0]))
        names, wanted, table = prepare_inputs(mechanism, case, sample_steps(time, every), description)
        inputs = find_variables(description, names, "input")
        outputs = find_variables(description, wanted, "output")
        check_feedthrough(description, inputs, outputs)
        folder = importlib.import_module("fmpy").extract(str(self._path))
        try:
            start = clock.perf_counter()
            with Instance(description, folder, find_start_values(description, mechanism, case)) as instance:
                if every:
                    instance.send_inputs(inputs, table[0])
                instance.begin()
                evaluate = instance.run_march if every else instance.evaluate_outputs
                got, steps = evaluate(inputs, outputs, sample_steps(time, every), table)
            wall = clock.perf_counter() - start
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        got = got[:: every or 1]
        torque = np.zeros((time.size, mechanism.nv))
        torque[:, [mechanism.velocity_names.index(name.removesuffix(".tau")) for name in wanted]] = got
        said = {"file": self._path.name, "interface": instance.kind, "steps until it answers": steps}
        return Record(engine, settings=said, time=time, series=torque_series(mechanism, torque), wall_time=wall)


def sample_steps(time: Array, every: int) -> Array:
    """Return the ends of all steps [s], ``every`` to a sample; 0: the samples themselves."""
    if every in (0, 1):
        return time
    return np.asarray(time[0] + (time[1] - time[0]) / every * np.arange(every * (len(time) - 1) + 1))


def prepare_inputs(
    mechanism: Mechanism, case: Case, time: Array, description: Any
) -> tuple[dict[str, str], dict[str, str], Array]:
    """Return units by name of inputs and of outputs, and the inputs (samples, inputs) [rad], [m], [s] over time [s].

    Joints that the motion leaves out are inputs where the FMU asks for them: they go as flexinv closes the loops.  An input
    ``phase`` is told which closures act, in the order of time [-].
    """
    given = set(case.motion.joints(mechanism))
    asked = {v.name for v in description.modelVariables if v.causality == "input"}
    joints = [j for j in mechanism.joints if j.nv and (j.name in given or f"{j.name}.q" in asked)]
    motion = case.motion.evaluate(mechanism, time)
    if any(joint.name not in given for joint in joints):
        motion = _close_loops(mechanism, case, time)
    parts = dict(zip(("q", "qd", "qdd"), motion, strict=True))
    names = {}
    columns = []
    for joint in joints:
        rate = UNITS[joint.kind][1][0]
        for part, unit in (("q", UNITS[joint.kind][0][0]), ("qd", rate), ("qdd", f"{rate}^2")):
            names[f"{joint.name}.{part}"] = unit
            slices = mechanism.q_slices if part == "q" else mechanism.v_slices
            columns.append(parts[part][:, slices[joint.name]])
    if PHASE in asked:
        names[PHASE] = "-"
        columns.append(_list_phases(mechanism, time))
    efforts = dict(zip(mechanism.velocity_names, list_effort_units(mechanism), strict=True))
    wanted = [n.removeprefix("torque/") for n in list_quantity_series(mechanism, case, "torque")]
    assert not set(wanted) & set(list_idle_velocities(mechanism, case))
    return names, {f"{name}.tau": efforts[name] for name in wanted}, np.hstack(columns)


def _list_phases(mechanism: Mechanism, time: Array) -> Array:
    """The numbers (samples, 1) of the closures that act at each time [s]."""
    return np.array([[find_acting_set(mechanism, t)] for t in time.tolist()], dtype=float)


def _close_loops(mechanism: Mechanism, case: Case, time: Array) -> tuple[Array, Array, Array]:
    """The motion of all joints of closed loops (samples, each) [rad], [m], [s] on the samples."""
    every = round((time[1] - time[0]) / case.step)
    found = solve(mechanism, case.motion, case.step, end=case.end, start=case.start)
    return found.q[::every], found.qd[::every], found.qdd[::every]


def find_start_values(description: Any, mechanism: Mechanism, case: Case) -> dict[int, float]:
    """Return by value reference where joints start that follow from closures, parameters ``JOINT.start`` [rad], [m].

    A loop closes in more than one way; the case says in which it begins.  Raises InputError for another unit.
    """
    units = {f"{joint.name}.start": UNITS[joint.kind][0][0] for joint in mechanism.joints if joint.nv == 1}
    stated = {v.name for v in description.modelVariables if v.causality == "parameter"}
    wanted = {name: unit for name, unit in units.items() if name in stated}
    variables = find_variables(description, wanted, "parameter")
    begins = {name: np.ravel(case.start.get(name.removesuffix(".start"), 0.0)) for name in wanted}
    return {one.valueReference: float(begins[one.name][0]) for one in variables}


class Instance:
    """One instance of an FMU, set up for its inputs; kind : "model exchange" or "co-simulation"."""

    def __init__(self, description: Any, folder: str, starts: Mapping[int, float]) -> None:
        """Instantiate: the interface for model exchange where there is one.

        starts : by value reference, numbers that are set while it initialises [units of the variables]
        """
        self._starts = starts
        self._is_new = is_new(description)
        exchange = description.modelExchange
        part = exchange or description.coSimulation
        self.kind = "model exchange" if exchange is not None else "co-simulation"
        make = resolve_interface(description, exchange is not None)
        self._fmu = make(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=part.modelIdentifier,
            instanceName="crosscheck",
        )
        self.set_numbers = self._fmu.setFloat64 if self._is_new else self._fmu.setReal
        self.read_numbers = self._fmu.getFloat64 if self._is_new else self._fmu.getReal

    def __enter__(self) -> Instance:
        """Instantiate it, and let it initialise."""
        self._fmu.instantiate()
        if not self._is_new:
            self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()
        if self._starts:
            self.set_numbers(list(self._starts), list(self._starts.values()))
        return self

    def send_inputs(self, inputs: list[Any], row: Array) -> None:
        """Set inputs (inputs,) [units of the variables]."""
        self.set_numbers([variable.valueReference for variable in inputs], row.tolist())

    def begin(self) -> None:
        """End its initialisation."""
        self._fmu.exitInitializationMode()

    def __exit__(self, *_: object) -> None:
        """End and free it."""
        self._fmu.terminate()
        self._fmu.freeInstance()

    def run_march(self, inputs: list[Any], outputs: list[Any], time: Array, table: Array) -> tuple[Array, int]:
        """Return the outputs (samples, outputs) [N m], [N] of steps whose inputs are those at their ends, and 1 step each [-]."""
        of = [variable.valueReference for variable in outputs]
        rows = [self.read_numbers(of)]
        for now, (start, end) in zip(table[1:], pairwise(time), strict=True):
            self.send_inputs(inputs, now)
            self._fmu.doStep(currentCommunicationPoint=start, communicationStepSize=end - start)
            rows.append(self.read_numbers(of))
        return np.array(rows).reshape(len(time), len(of)), 1

    def evaluate_outputs(self, inputs: list[Any], outputs: list[Any], time: Array, table: Array) -> tuple[Array, int]:
        """Return the outputs (samples, outputs) [N m], [N] at inputs (samples, inputs), and the steps until they stood [-]."""
        to, of = ([variable.valueReference for variable in part] for part in (inputs, outputs))
        rows = []
        most = 0
        now = 0.0
        spacing = float(time[1] - time[0])
        for row in table:
            self.set_numbers(to, row.tolist())
            values = np.array(self.read_numbers(of))
            if self.kind == "co-simulation":
                values, steps = self._evaluate_settled_outputs(of, values, now, spacing)
                most = max(most, steps[0])
                now = now + steps[1] * spacing
            rows.append(values)
        return np.array(rows).reshape(len(table), len(of)), most

    def _evaluate_settled_outputs(
        self, of: list[int], values: Array, now: float, spacing: float
    ) -> tuple[Array, tuple[int, int]]:
        """Return the outputs that stand while the inputs are held, in how many steps they came, and all that were made."""
        steps = 0
        for made in range(1, MOST_STEPS + 1):
            self._fmu.doStep(currentCommunicationPoint=now + (made - 1) * spacing, communicationStepSize=spacing)
            after = np.array(self.read_numbers(of))
            if np.abs(after - values).max(initial=0.0) <= STANDS * np.abs(after).max(initial=0.0):
                return after, (steps, made)
            values = after
            steps = made
        raise InputError(f"the FMU's outputs do not stand after {MOST_STEPS} steps with the same inputs: it has states")
