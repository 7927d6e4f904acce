"""Cases: what a mechanism does, what is compared, and how far engines may differ, each limit with its reason."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flexinv import validation as arguments
from flexinv.files.case_motion import read_motion, read_start
from flexinv.files.case_schema import OF_BEAMS, CasesTable, CaseTable, LimitTable, read_cases
from flexinv.files.toml_tables import Location, check_names, validate
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array
from flexinv.validation import nearest

# Times are decimals in a binary machine: quotients of them are whole numbers only to about 1e-13.
WHOLE = 1e-9
MOST_PARTS = 1e15  # steps in a case [-]: beyond, a number of them cannot be told from the next


@dataclass(frozen=True)
class Limit:
    """Largest allowed difference of engines from the reference in one quantity.

    quantity : "torque", "wrench", "reaction", "tip", "deflection", "axial", "internal" or "frequency"
    engines : patterns of names (fnmatch); of several limits that match, the first one holds
    maximum : largest difference as a fraction of the reference's range [-]; reason : why that is right
    versions : of the engine, such as ">=1.13, <1.14", for which it holds; "" for all
    expires : the day after which the limit must be looked at again
    """

    quantity: str
    engines: tuple[str, ...]
    maximum: float
    reason: str
    reference: str = "flexinv"
    source: str = ""
    expires: datetime.date | None = None
    versions: str = ""


@dataclass(frozen=True)
class Case:
    """One motion of a mechanism and what is compared.

    step : of the time integration [s]; end : of the case [s]; sample : spacing of results [s], a multiple of step
    spectral_radius : of the time integration [-]; initial : "consistent" or "static"
    mesh : (elements, order) of every beam in flexinv [-], None for the mechanism's own
    start : joint that the motion leaves out -> its coordinates at the start [rad], [m]; in a loop a guess of them
    measured : CSV file of what a machine that did this was seen to do, None where there is none
    accuracy : with which `flexinv solve` answers [-], None where it makes steps of ``step``
    """

    name: str
    title: str
    motion: Motion
    step: float
    end: float
    sample: float
    quantities: tuple[str, ...]
    limits: tuple[Limit, ...]
    spectral_radius: float = 0.8
    initial: str = "consistent"
    mesh: tuple[int, int] | None = None
    start: Mapping[str, Array] = field(default_factory=dict)
    source: str = ""
    notes: tuple[str, ...] = ()
    measured: Path | None = None
    accuracy: float | None = None

    def meshed(self, mechanism: Mechanism) -> Mechanism:
        """Return the mechanism with the mesh [-] of this case, its own where the case says nothing."""
        return mechanism if self.mesh is None else mechanism.with_mesh(*self.mesh)


def load_cases(path: str | Path, mechanism: Mechanism) -> dict[str, Case]:
    """Load the cases of a mechanism by name; times in [s], angles and lengths in the unit of their keys.

    path : ``models/<name>`` or the TOML file.  The format is described in models/README.md.
    Raises InputError, which names file, table, key, what was given, what is expected and what to write.
    """
    arguments.of_kind("mechanism", mechanism, Mechanism)
    file, table = read_cases(path)
    check_names(file, cases=table.cases)
    if not table.cases:
        expected = CasesTable.model_fields["cases"].description or ""
        raise Location(file, "cases").wrong("", "no case", expected, "[cases.cycloid]")
    shared = [_limit(limit) for limit in table.limits]
    return {
        name: _case(data, name, table.source, shared, mechanism, Location(file, f"cases.{name}"))
        for name, data in table.cases.items()
    }


def _limit(table: LimitTable) -> Limit:
    return Limit(
        table.quantity, tuple(table.engines), table.maximum, table.reason, table.reference, table.source, table.expires,
        table.versions,
    )  # fmt: skip


def _case(data: Any, name: str, source: str, shared: list[Limit], mechanism: Mechanism, where: Location) -> Case:
    table = validate(CaseTable, data, where)
    motion = read_motion(table.motion, mechanism, where.inner("motion"))
    start = read_start(table.start, mechanism, motion, where.inner("start"))
    end = table.end_s or motion.duration
    sample = table.sample_s or table.step_s
    mesh = (table.mesh.elements, table.mesh.order) if table.mesh is not None else None
    _check_times(table, motion, end, sample, where)
    _check_quantities(table, mechanism, where)
    limits = (*map(_limit, table.limits), *(limit for limit in shared if limit.quantity in table.quantities))
    return Case(
        name, table.title, motion, table.step_s, end, sample, tuple(table.quantities), limits,
        table.spectral_radius, table.initial, mesh, start, table.source or source, tuple(table.notes),
        _measured(table, where), table.accuracy,
    )  # fmt: skip


def _measured(table: CaseTable, where: Location) -> Path | None:
    """The file of what was measured, which has to be in the folder of the cases, like that of a sampled motion."""
    if table.measured is None:
        return None
    found = where.file.parent / table.measured
    if Path(table.measured).name != table.measured or not found.is_file():
        near = nearest(table.measured, sorted(p.name for p in where.file.parent.glob("*.csv")))
        write = f'measured = "{near}"' if near else "the name of a file that exists"
        given, expected = f'measured = "{table.measured}"', "the name of a CSV file in the same folder"
        raise where.wrong("measured", given, expected, write)
    return found


def _check_times(table: CaseTable, motion: Motion, end: float, sample: float, where: Location) -> None:
    step = table.step_s
    if step > min(motion.duration, end):
        expected = f"a step shorter than the motion of {motion.duration:g} s and the case of {end:g} s [s]"
        raise where.wrong("step_s", f"step_s = {step:g}", expected, f"step_s = {min(motion.duration, end) / 1000:.4g}")
    for key, value, part, word in (("sample_s", sample, step, "step_s"), ("end_s", end, sample, "sample_s")):
        if value / part > MOST_PARTS:
            expected = f"at most {MOST_PARTS:g} times {word} = {part:g} [s]"
            raise where.wrong(key, f"{key} = {value:g}", expected, f"{key} = {1000 * part:.4g}")
        if not _is_multiple(value, part):
            nearby = max(round(value / part), 1) * part
            expected = f"a whole number of {word} = {part:g} [s]"
            raise where.wrong(key, f"{key} = {value:g}", expected, f"{key} = {nearby:.10g}")
    for jump in motion.jumps:
        if jump < end and not _is_multiple(jump, step):
            expected = f"a step that meets the jump of the acceleration at {jump:g} s"
            write = f"step_s = {jump / max(round(jump / step), 1):.10g}"
            raise where.wrong("step_s", f"step_s = {step:g}", expected, write)


def _is_multiple(value: float, part: float) -> bool:
    ratio = value / part
    return abs(ratio - round(ratio)) <= WHOLE * max(ratio, 1.0)


def _check_quantities(table: CaseTable, mechanism: Mechanism, where: Location) -> None:
    for quantity in table.quantities:
        if quantity in OF_BEAMS and mechanism.is_rigid:
            given = f'"{quantity}" of a mechanism without beams'
            expected = f"torque, wrench or tip: {mechanism.name} is rigid"
            raise where.wrong("quantities", given, expected, f"quantities without {quantity}")
    for k, limit in enumerate(table.limits):
        if limit.quantity not in table.quantities:
            expected = f"one of the case's quantities: {', '.join(table.quantities)}"
            write = f'"{limit.quantity}" in quantities, or no limit for it'
            raise where.inner(f"limits[{k}]").wrong("quantity", f'quantity = "{limit.quantity}"', expected, write)
