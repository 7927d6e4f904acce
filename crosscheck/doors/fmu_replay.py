"""A forward FMU: torques drive it, and where its joints go the tips of the mechanism's links go.

Inputs NAME.tau of every drive, outputs NAME.q of every joint, which begin where they are set (initial = "exact"), at rest.

    model exchange   dx/dt = f(x, tau) of the FMU, by Runge and Kutta's method of order 4; the torque is linear between samples
    co-simulation    the FMU integrates by itself; it gets the torque of a step's middle throughout the step: error of order h^2

One for co-simulation that takes one step alone marches: it gets the torque at the end of each step, and begins where
it was made to begin.  Where an FMU tells the tips of links itself, outputs LINK.tip.x and so on, they are taken.
"""

from __future__ import annotations

import ctypes
import importlib
import shutil
from collections.abc import Iterator, Mapping
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.doors.fmu_description import (
    count_steps,
    find_variables,
    is_new,
    read_description,
    resolve_interface,
)
from crosscheck.engines.shared.replay import Array, DriveTorques
from crosscheck.kit.resolved import UNITS
from crosscheck.kit.tree import AXES
from crosscheck.lifting.rigid import apply_placement, turned
from crosscheck.measures.record import list_effort_units
from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import WORLD, Joint, Mechanism, Placement

SAME_START = 1e-9  # [rad], [m]: starts that were written with twelve digits
TURN = 2.0 * np.pi  # [rad]: what a helical joint's pitch counts


class ForwardFmuAdapter:
    """The adapter of one forward FMU: it is asked for no torques, but replays those of others."""

    repeatable = False

    def __init__(self, path: Path, mechanism: str, settings: Mapping[str, Any]) -> None:
        """Keep the file, the name of the mechanism's folder, and the settings: cases, version, abilities."""
        self._path = path
        self._mechanism = mechanism
        self._settings = settings

    def version(self) -> str:
        """Return the version that crosscheck.toml states, else that of the FMU's model description."""
        description = read_description(self._path)
        return str(self._settings.get("version", "") or description.version or description.generationTool or "")

    def abilities(self) -> str:
        """Return one sentence: what it can do."""
        return str(self._settings.get("abilities", "") or f"the FMU {self._path.name}, forward dynamics: replay alone")

    def unsupported(self, mechanism: Mechanism, case: Case, engine: str) -> str | None:
        """Return the reason why it gives no torques."""
        return "a forward FMU: torques drive it, in the table of feed-forwards (--studies feedforward)"

    def run(self, mechanism: Mechanism, case: Case, engine: str, options: Mapping[str, Any]) -> Any:
        """Raise InputError: it gives no torques."""
        raise InputError(self.unsupported(mechanism, case, engine))

    def replay(self, mechanism: Mechanism, drive: DriveTorques) -> dict[str, Array]:
        """Return the paths of the links' tips, by link (samples, 3) [m], at the times of the torque.

        Raises InputError where the FMU is not what the door asks for, or is another mechanism's.
        """
        self._check_asked(mechanism)
        told = _list_told_tips(self._path, mechanism)
        if not told and (not mechanism.is_rigid or mechanism.closures):
            raise InputError(
                "tips are those of open trees of rigid links here, unless the FMU has outputs LINK.tip.x, .y, .z"
            )
        places, tips = _integrate_torques(self._path, mechanism, drive, told)
        if told:
            return {link.name: tips[:, 3 * k : 3 * k + 3] for k, link in enumerate(mechanism.links)}
        found = [compute_tips(mechanism, q) for q in places]
        return {link.name: np.array([at[link.name] for at in found]) for link in mechanism.links}

    def _check_asked(self, mechanism: Mechanism) -> None:
        """Refuse mechanisms that it is not asked for, and coordinates that have no names."""
        patterns = [str(p).partition("/")[0] for p in self._settings.get("cases", ["*"])]
        name = self._mechanism or mechanism.name
        if not any(fnmatchcase(name, pattern) for pattern in patterns):
            raise InputError(f"crosscheck.toml asks it for {', '.join(self._settings['cases'])} only")
        if others := [j.name for j in mechanism.joints if j.nq > 1]:
            raise InputError(f"joints with more than one coordinate have no names in an FMU: {', '.join(others)}")


def _list_told_tips(path: Path, mechanism: Mechanism) -> dict[str, str]:
    """Units by name of the outputs by which an FMU tells the tips of all links, none where it does not."""
    told = {f"{link.name}.tip.{axis}": "m" for link in mechanism.links for axis in AXES}
    return told if told.keys() <= {one.name for one in read_description(path).modelVariables} else {}


def _integrate_torques(
    path: Path, mechanism: Mechanism, drive: DriveTorques, told: Mapping[str, str]
) -> tuple[Array, Array]:
    """Return the coordinates (samples, nq) [rad], [m] to which the torques move an FMU, and other outputs; told : their units."""
    description = read_description(path)
    moving = [joint for joint in mechanism.joints if joint.nv]
    efforts = dict(zip(mechanism.velocity_names, list_effort_units(mechanism), strict=True))
    driven = {f"{j.name}.tau": efforts[j.name] for j in moving if j.actuated}
    inputs = find_variables(description, driven, "input")
    outputs = find_variables(description, {f"{j.name}.q": UNITS[j.kind][0][0] for j in moving}, "output")
    every = count_steps(description, path, drive.spacing)
    for output in outputs:
        if output.initial != "exact" and not every:
            raise InputError(f'the FMU\'s {output.name!r} cannot be set where it starts; write initial="exact" there')
    beside = find_variables(description, told, "output")
    folder = importlib.import_module("fmpy").extract(str(path))
    try:
        with ForwardInstance(description, folder) as fmu:
            refs = [one.valueReference for one in inputs], [one.valueReference for one in (*outputs, *beside)]
            if every:
                rows = np.array(list(fmu.run_march(refs, drive, every)))[::every]
            else:
                fmu.begin(refs[1][: len(outputs)], drive.q)
                rows = np.array(list(fmu.integrate_steps(refs, drive.torque, drive.spacing)))
            return rows[:, : len(outputs)], rows[:, len(outputs) :]
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class ForwardInstance:
    """One instance of a forward FMU; for model exchange where it can, else for co-simulation."""

    def __init__(self, description: Any, folder: str) -> None:
        """Instantiate.  Raises InputError for an FMU for model exchange with events."""
        self._states = description.numberOfContinuousStates
        self._exchange = description.modelExchange is not None
        if self._exchange and description.numberOfEventIndicators:
            raise InputError("the FMU has events; write it for co-simulation, where it integrates over them by itself")
        part = description.modelExchange or description.coSimulation
        make = resolve_interface(description, self._exchange)
        self._fmu = make(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=part.modelIdentifier,
            instanceName="crosscheck",
        )
        self._is_new = is_new(description)
        self._set_numbers = self._fmu.setFloat64 if self._is_new else self._fmu.setReal
        self._read_numbers = self._fmu.getFloat64 if self._is_new else self._fmu.getReal
        self._fmu.instantiate()

    def __enter__(self) -> ForwardInstance:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End and free it."""
        self._fmu.terminate()
        self._fmu.freeInstance()

    def begin(self, places: list[int], q: Array) -> None:
        """Let it begin at coordinates [rad], [m] of these variables."""
        if not self._is_new:
            self._fmu.setupExperiment(startTime=0.0)
        self._set_numbers(places, q.tolist())
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()
        if self._exchange:
            while self._fmu.newDiscreteStates()[0]:
                pass
            self._fmu.enterContinuousTimeMode()

    def run_march(self, refs: tuple[list[int], list[int]], drive: DriveTorques, every: int) -> Iterator[list[float]]:
        """Yield outputs [rad], [m] at the end of every step, ``every`` to a sample; refs : of inputs, outputs.

        Raises InputError where the FMU begins elsewhere than the torques: its start is of its making.
        """
        to, of = refs
        h = drive.spacing / every
        last = every * (len(drive.torque) - 1)
        samples = np.arange(len(drive.torque)) * every
        torque = np.stack([np.interp(np.arange(last + 1), samples, column) for column in drive.torque.T], axis=1)
        if not self._is_new:
            self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()
        self._set_numbers(to, torque[0].tolist())
        self._fmu.exitInitializationMode()
        start = self._read_numbers(of)
        begins = np.array(start[: len(drive.q)])
        if np.abs(begins - drive.q).max() > SAME_START:
            raise InputError(
                f"the FMU begins at {begins.tolist()}, and the torques at {drive.q.tolist()}; export it with --start "
                f"{','.join(f'{one:.12g}' for one in drive.q)}"
            )
        yield start
        for k, row in enumerate(torque[1:]):
            self._set_numbers(to, row.tolist())
            self._fmu.doStep(currentCommunicationPoint=k * h, communicationStepSize=h)
            yield self._read_numbers(of)

    def integrate_steps(self, refs: tuple[list[int], list[int]], torque: Array, h: float) -> Iterator[list[float]]:
        """Yield outputs [rad], [m] at every sample; refs : of inputs, outputs; torque (samples, drives); h : between two [s]."""
        to, of = refs
        yield self._read_numbers(of)
        for k, (now, then) in enumerate(pairwise(torque)):
            if self._exchange:
                self._integrate_runge_kutta(to, now, then, k * h, h)
            else:
                self._set_numbers(to, (0.5 * (now + then)).tolist())
                self._fmu.doStep(currentCommunicationPoint=k * h, communicationStepSize=h)
            yield self._read_numbers(of)

    def _integrate_runge_kutta(self, to: list[int], now: Array, then: Array, t: float, h: float) -> None:
        n = self._states
        middle = 0.5 * (now + then)
        store = (ctypes.c_double * n)()
        self._fmu.getContinuousStates(store, n)
        x = np.array(store)

        def evaluate_rate(time: float, at: Array, effort: Array) -> Array:
            self._fmu.setTime(time)
            self._fmu.setContinuousStates((ctypes.c_double * n)(*at), n)
            self._set_numbers(to, effort.tolist())
            self._fmu.getDerivatives(store, n)
            return np.array(store)

        a = evaluate_rate(t, x, now)
        b = evaluate_rate(t + h / 2, x + h / 2 * a, middle)
        c = evaluate_rate(t + h / 2, x + h / 2 * b, middle)
        d = evaluate_rate(t + h, x + h * c, then)
        self._fmu.setContinuousStates((ctypes.c_double * n)(*(x + h / 6 * (a + 2 * b + 2 * c + d))), n)
        self._fmu.completedIntegratorStep()


def compute_tips(mechanism: Mechanism, q: Array) -> dict[str, Array]:
    """Return the tips of all links (3,) [m] in the world, at coordinates (nq,) [rad], [m] of an open tree of rigid links."""
    frames = {WORLD: Placement()}
    for joint in mechanism.joints:
        place = apply_placement(frames[joint.parent], joint.placement)
        frames[joint.child] = (
            apply_placement(place, compute_joint_motion(joint, q[mechanism.q_slices[joint.name]]))
            if joint.nv
            else place
        )
    return {x.name: frames[x.name].position + frames[x.name].rotation @ x.tip for x in mechanism.links}


def compute_joint_motion(joint: Joint, q: Array) -> Placement:
    """Return the frame of a child in its joint's frame; q : (1,) [rad], [m]."""
    if joint.kind == "prismatic":
        return Placement(joint.axis * q[0], np.eye(3))
    way = joint.axis * (joint.pitch / TURN * q[0]) if joint.kind == "helical" else np.zeros(3)
    return Placement(way, turned(joint.axis, float(q[0])))
