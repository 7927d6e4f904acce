"""Model descriptions of FMUs, read by FMPy: direction, and variables by name, causality and unit, each refused in words.

An inverse FMU has inputs NAME.q, NAME.qd, NAME.qdd and outputs NAME.tau; a forward one inputs NAME.tau and outputs NAME.q.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flexinv.errors import InputError

INSTALL = 'python -m pip install "flexinv[fmu]" (or fmpy)'
PLACE = "{mechanism}"  # in the path of an FMU: the name of the mechanism's folder, so that many are one engine
CLOCK_ROUNDING = 1e-6  # of a step: by so much two clocks may differ
# Ways to write a unit of ours in an FMU.
SAME_UNIT = {
    "rad": ("rad",),
    "m": ("m",),
    "rad/s": ("rad/s",),
    "m/s": ("m/s",),
    "rad/s^2": ("rad/s2", "rad/s^2"),
    "m/s^2": ("m/s2", "m/s^2"),
    "N m": ("N.m", "N m", "Nm", "N*m"),
    "N": ("N",),
    "-": ("1",),
}


def read_description(path: Path) -> Any:
    """Return the model description of an FMU.  Raises InputError where it is none of FMI 2.0 or 3.0."""
    try:
        description = importlib.import_module("fmpy").read_model_description(str(path), validate=False)
    except Exception as error:
        raise InputError(f"{path.name} is no FMU: {error}") from error
    if not str(description.fmiVersion).startswith(("2.", "3.")):
        raise InputError(f"{path.name} is of FMI {description.fmiVersion}; expected 2.0 or 3.0")
    return description


def is_new(description: Any) -> bool:
    """Return True for FMI 3, False for FMI 2."""
    return str(description.fmiVersion).startswith("3.")


def resolve_interface(description: Any, exchange: bool) -> Any:
    """Return FMPy's class for FMUs of a version: for model ``exchange``, or for co-simulation."""
    version = 3 if is_new(description) else 2
    module = importlib.import_module(f"fmpy.fmi{version}")
    return getattr(module, f"FMU{version}{'Model' if exchange else 'Slave'}")


def find_march_step(description: Any) -> float | None:
    """Return the one communication step [s] of an FMU that marches from step to step, None for others.

    It is for co-simulation alone, takes no other step, and states which in its default experiment.
    """
    part = description.coSimulation
    experiment = description.defaultExperiment
    if description.modelExchange is not None or part is None or part.canHandleVariableCommunicationStepSize:
        return None
    stated = None if experiment is None else experiment.stepSize
    return None if stated is None else float(stated)


def is_forward(description: Any) -> bool:
    """Return True if torques are inputs: an FMU that moves by itself."""
    return any(v.causality == "input" and v.name.endswith(".tau") for v in description.modelVariables)


def check_stateless(description: Any, path: Path) -> None:
    """Raise InputError where an FMU has states or events: it is no function of its inputs."""
    states = description.numberOfContinuousStates
    if states or description.numberOfEventIndicators:
        raise InputError(f"{path.name} has {states} states; expected a function of its inputs: inverse dynamics")


def find_variables(description: Any, wanted: Mapping[str, str], causality: str) -> list[Any]:
    """Return the variables of these names, in their order; wanted : unit by name; causality : input, output.

    Raises InputError for one that is missing or in another unit.
    """
    known = {variable.name: variable for variable in description.modelVariables}
    variables = []
    for name, unit in wanted.items():
        variable = known.get(name)
        if variable is None or variable.causality != causality:
            have = ", ".join(n for n, v in known.items() if v.causality == causality) or "none"
            raise InputError(f"the FMU has no {causality} {name!r}; it has {have}")
        said = variable.unit or (variable.declaredType.unit if variable.declaredType is not None else None)
        if said not in SAME_UNIT[unit]:
            raise InputError(f"the FMU's {name!r} is in {said or 'no unit'}, expected {SAME_UNIT[unit][0]}")
        variables.append(variable)
    return variables


def check_feedthrough(description: Any, inputs: list[Any], outputs: list[Any]) -> None:
    """Raise InputError where an output does not depend on the acceleration of its own joint: it is no inverse dynamics."""
    names = {variable.name for variable in inputs}
    stated = {unknown.variable.name: unknown.dependencies for unknown in description.outputs}
    for output in outputs:
        acceleration = output.name.removesuffix(".tau") + ".qdd"
        depends = stated.get(output.name)
        if (
            depends is not None
            and acceleration in names
            and acceleration not in {variable.name for variable in depends}
        ):
            raise InputError(
                f"the FMU's {output.name!r} does not depend on {acceleration!r} directly; state it in ModelStructure"
            )


def count_steps(description: Any, path: Path, spacing: float) -> int:
    """Return the steps of an FMU that marches between two samples a ``spacing`` apart [s], 0 for one that does not march.

    Raises InputError where samples are no whole number of steps apart.
    """
    step = find_march_step(description)
    if step is None:
        return 0
    count = round(spacing / step)
    if count < 1 or abs(count * step - spacing) > CLOCK_ROUNDING * step:
        raise InputError(
            f"{path.name} marches by {step:g} s, and samples of the case are {spacing:g} s apart; export it with --step "
            f"{spacing:g}"
        )
    return count
