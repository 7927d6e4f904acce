"""modelDescription.xml and the page of an FMU: what an importer and a reader are told, escaped."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import flexinv
from flexinv.export.fmu.variables import OUTPUT_ROLE, PARAMETER_ROLE, Interface, Variable, list_units
from flexinv.export.names import format_line

FMI_VERSIONS = {"3.0": "the present one", "2.0": "that of older tools"}
FMU_LICENCE = "BSD 3-Clause, see documentation/licenses/license.txt"
# Powers of the units of the SI that a unit is made of.
UNIT_POWERS = {
    "1": {}, "s": {"s": 1}, "rad": {"rad": 1}, "rad/s": {"rad": 1, "s": -1}, "rad/s2": {"rad": 1, "s": -2}, "m": {"m": 1},
    "m/s": {"m": 1, "s": -1}, "m/s2": {"m": 1, "s": -2}, "N.m": {"kg": 1, "m": 2, "s": -2}, "N": {"kg": 1, "m": 1, "s": -2},
    "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1}, "N.s/m": {"kg": 1, "s": -1}, "kg": {"kg": 1}, "kg.m2": {"kg": 1, "m": 2},
}  # fmt: skip
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*")


@dataclass(frozen=True)
class FmuHead:
    """Head of an FMU: FMI version, title and identifier of the model, token, what it says, step [s] or None: the first one."""

    fmi: str
    title: str
    identifier: str
    token: str
    says: str
    step: float | None


def render_description(head: FmuHead, made: Interface) -> str:
    """Return modelDescription.xml [-]."""
    is_new = head.fmi == "3.0"
    lines = [*_render_head(head, made, is_new), "  <UnitDefinitions>", *_render_units(made), "  </UnitDefinitions>"]
    lines += [_render_experiment(head), "  <ModelVariables>"]
    lines += [_render_variable(k, one, is_new) for k, one in enumerate(made.variables)]
    if (
        is_new
    ):  # in FMI 2.0 it may be left out, and readers of FMI Library ask for its start, which the standard forbids
        lines.append(_render_time(len(made.variables)))
    lines += ["  </ModelVariables>", *_render_structure(made, is_new)]
    return "\n".join([*lines, "</fmiModelDescription>", ""])


def _render_head(head: FmuHead, made: Interface, is_new: bool) -> Iterator[str]:
    """The root with its attributes, and the interface."""
    structured = all(_NAME.fullmatch(one.name) for one in made.variables)
    token = "instantiationToken" if is_new else "guid"
    values = {
        "fmiVersion": head.fmi, "modelName": head.title, token: head.token, "description": head.says,
        "author": "flexinv", "version": flexinv.__version__, "license": FMU_LICENCE,
        "generationTool": f"flexinv {flexinv.__version__}",
        "variableNamingConvention": "structured" if structured else "flat",
    }  # fmt: skip
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield f"<fmiModelDescription {_list_attributes(values)}>"
    state = (
        ("canGetAndSetFMUState", "canSerializeFMUState") if is_new else ("canGetAndSetFMUstate", "canSerializeFMUstate")
    )
    abilities = {
        "modelIdentifier": head.identifier, "canHandleVariableCommunicationStepSize": "false",
        **dict.fromkeys(state, "true"),
    }  # fmt: skip
    if is_new:
        abilities |= {"fixedInternalStepSize": repr(head.step)} if head.step is not None else {}
    else:
        abilities["canNotUseMemoryManagementFunctions"] = "true"
    yield f"  <CoSimulation {_list_attributes(abilities)}/>"


def _render_units(made: Interface) -> Iterator[str]:
    """Each unit by those of the SI."""
    for unit in list_units(made):
        powers = _list_attributes({base: str(power) for base, power in UNIT_POWERS[unit].items()})
        yield f"    <Unit name={quoteattr(unit)}><BaseUnit {powers}/></Unit>"


def _render_experiment(head: FmuHead) -> str:
    step = "" if head.step is None else f' stepSize="{head.step!r}"'
    return f'  <DefaultExperiment startTime="0"{step}/>'


def _render_variable(reference: int, one: Variable, is_new: bool) -> str:
    values = {
        "name": one.name, "valueReference": str(reference), "causality": one.role,
        "variability": "tunable" if one.role == PARAMETER_ROLE else "continuous", "description": one.says,
    }  # fmt: skip
    number = {"unit": one.unit} | ({} if one.start is None else {"start": repr(one.start)})
    if is_new:
        return f"    <Float64 {_list_attributes(values | number)}/>"
    return f"    <ScalarVariable {_list_attributes(values)}><Real {_list_attributes(number)}/></ScalarVariable>"


def _render_time(reference: int) -> str:
    values = {
        "name": "time", "valueReference": str(reference), "causality": "independent", "variability": "continuous",
        "description": "end of the last communication step",
    }  # fmt: skip
    return f'    <Float64 {_list_attributes(values)} unit="s"/>'


def _render_structure(made: Interface, is_new: bool) -> Iterator[str]:
    """Outputs, each of which depends on everything."""
    asked = made.find(OUTPUT_ROLE)
    yield "  <ModelStructure>"
    if is_new:
        for word in ("Output", "InitialUnknown"):
            yield from (f'    <{word} valueReference="{k}"/>' for k in asked)
    else:
        for word in ("Outputs", "InitialUnknowns"):
            rows = "".join(f'<Unknown index="{k + 1}"/>' for k in asked)
            yield f"    <{word}>{rows}</{word}>"
    yield "  </ModelStructure>"


def render_fmu_page(head: FmuHead, made: Interface) -> str:
    """Return documentation/index.html [-]."""
    rows = "\n".join(
        f"<tr><td>{html.escape(one.name)}</td><td>{one.role}</td><td>{one.unit}</td>"
        f"<td>{'' if one.start is None else repr(one.start)}</td><td>{html.escape(one.says)}</td></tr>"
        for one in made.variables
    )
    step = "communication step " + ("that is made first" if head.step is None else f"{head.step!r} s") + " and no other"
    return (
        f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(head.title)}</title></head><body>\n'
        f"<h1>{html.escape(head.title)}</h1>\n<p>{html.escape(head.says)}</p>\n"
        f"<p>FMI {head.fmi}, co-simulation, {step}. Made by flexinv {flexinv.__version__}; licence: {FMU_LICENCE}.</p>\n"
        "<table><tr><th>variable</th><th>role</th><th>unit</th><th>start</th><th>meaning</th></tr>\n"
        f"{rows}\n</table></body></html>\n"
    )


def _list_attributes(values: dict[str, str]) -> str:
    return " ".join(f"{name}={quoteattr(format_line(value))}" for name, value in values.items())
