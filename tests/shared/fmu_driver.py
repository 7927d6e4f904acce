"""An FMU that FMPy drives, of FMI 2.0 or 3.0, for the tests of what `flexinv.export_fmu` writes."""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pendulum_fmu
import pytest

from flexinv.typing import Array

needs_fmpy = pytest.mark.skipif(bool(pendulum_fmu.why_not()), reason=pendulum_fmu.why_not() or "nothing is missing")


class DrivenFmu:
    """One instance: variables by name; what its log has said."""

    def __init__(self, file: Path, folder: str) -> None:
        fmpy, fmi2, fmi3 = (importlib.import_module(name) for name in ("fmpy", "fmpy.fmi2", "fmpy.fmi3"))
        self.description = fmpy.read_model_description(str(file))
        self.is_new = self.description.fmiVersion == "3.0"
        self.places = {one.name: one.valueReference for one in self.description.modelVariables}
        self.said = list[str]()
        part = self.description.coSimulation
        make: Any = fmi3.FMU3Slave if self.is_new else fmi2.FMU2Slave
        self.fmu = make(
            guid=self.description.guid,
            unzipDirectory=folder,
            modelIdentifier=part.modelIdentifier,
            instanceName="driven",
        )
        if self.is_new:
            self.fmu.instantiate(logMessage=lambda *said: self.said.append(said[-1].decode()))
            self.set_numbers, self.get_numbers = self.fmu.setFloat64, self.fmu.getFloat64
            self.keep, self.restore = self.fmu.getFMUState, self.fmu.setFMUState
            self.free = self.fmu.freeFMUState
            self.pack, self.unpack = self.fmu.serializeFMUState, self.fmu.deserializeFMUState
        else:
            callbacks = fmi2.fmi2CallbackFunctions()
            callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(lambda *said: self.said.append(said[-1].decode()))
            callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(lambda *_: 0)
            callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(lambda *_: None)
            self.fmu.instantiate(callbacks=callbacks)
            self.set_numbers, self.get_numbers = self.fmu.setReal, self.fmu.getReal
            self.keep, self.restore = self.fmu.getFMUstate, self.fmu.setFMUstate
            self.free = self.fmu.freeFMUstate
            self.pack, self.unpack = self.fmu.serializeFMUstate, self.fmu.deSerializeFMUstate

    def set(self, values: Mapping[str, float]) -> None:
        self.set_numbers([self.places[name] for name in values], [float(one) for one in values.values()])

    def get(self, *names: str) -> list[float]:
        return list(self.get_numbers([self.places[name] for name in names]))

    def begin(self, values: Mapping[str, float], start: float = 0.0) -> None:
        """Initialise, with parameters and first inputs."""
        if self.is_new:
            self.fmu.enterInitializationMode(startTime=start)
        else:
            self.fmu.setupExperiment(startTime=start)
            self.fmu.enterInitializationMode()
        self.set(values)
        self.fmu.exitInitializationMode()

    def step(self, time: float, step: float) -> None:
        self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=step)

    def replay(self, inputs: list[str], rows: Array, outputs: list[str], step: float, first: int = 0) -> Array:
        """Outputs after steps whose inputs are rows (steps, inputs), from the time ``first`` steps on."""
        out = []
        for k, row in enumerate(rows, first):
            self.set(dict(zip(inputs, row, strict=True)))
            self.step(k * step, step)
            out.append(self.get(*outputs))
        return np.array(out)


@contextmanager
def driven(file: Path) -> Iterator[DrivenFmu]:
    """An instance, and its files, until the end of the block."""
    folder = importlib.import_module("fmpy").extract(str(file))
    try:
        one = DrivenFmu(file, folder)
        yield one
        one.fmu.freeInstance()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
