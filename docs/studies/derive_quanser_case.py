"""Derive the case of the measured arm from its record: python docs/studies/derive_quanser_case.py.

Identifies the flexible model on the first 10 s of models/quanser_2dsfl/record.csv by its identify.toml (a minute of one core),
prints what was found, and writes motion.csv and measured.csv of the next 5 s, which the identification has not seen.
"""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

import crosscheck
from crosscheck.identification.filters import low_pass, undo_lag
from crosscheck.identification.identify import Identification
from crosscheck.identification.table import Row

Array = NDArray[np.float64]
MODELS = Path(__file__).parents[2] / "models"
FLEXIBLE, RIGID = "quanser_2dsfl", "quanser_2dsfl_rigid"
LOG = f"{MODELS / FLEXIBLE / 'record.csv'}@"
EVERY = 2  # of the record's samples one: 8 ms
NORMAL = 1.6448536269514722  # half width of 90 % of a normal distribution, in standard deviations
Table = dict[tuple[str, str], Row]


def main() -> None:
    """Write the CSV files [rad], [N m], [m] and say what was identified."""
    found = crosscheck.identify(MODELS / FLEXIBLE, [f"{LOG}0:5", f"{LOG}5:10"], [f"{LOG}10:15"])
    for row in found.parameters:
        click.echo(f"{row.parameter} of {row.place} = {row.value:.4g} +- {deviation(row):.2g} {row.unit}")
    table = {(row.parameter, row.place): row for row in found.parameters}
    torque, deflection = torques(found, table), deflections(found, table)
    motion = found.held[0][0].motion
    for folder, measured in ((FLEXIBLE, torque | deflection), (RIGID, torque)):
        columns = {f"{name}_rad": column for name, column in zip(motion.names, motion.q.T, strict=True)}
        write(MODELS / folder / "motion.csv", {"time_s": motion.time, **columns})
        write(MODELS / folder / "measured.csv", {"time [s]": motion.time, **measured})


def deviation(row: Row) -> float:
    """Return the standard deviation [unit of the parameter] of a 90 % interval."""
    return (row.high - row.low) / 2.0 / NORMAL


def torques(found: Identification, table: Table) -> dict[str, Array]:
    """Return what the drives give to the mechanism, less offset and dry friction, with bars [N m].

    A joint that stands may hold as much as its dry friction: the bar there.
    """
    run, columns = found.held[0][0], {}
    assert run.measured is not None
    for k, name in enumerate(run.motion.names):
        coulomb, offset = table["coulomb friction", name], table["effort offset", name]
        slides = np.tanh(run.motion.qd[:, k] / found.machine.settings.still_rad_per_s)
        columns[f"torque/{name} [N m]"] = run.measured[:, k] - offset.value - coulomb.value * slides
        unsure = np.hypot(deviation(coulomb), deviation(offset))
        columns[f"torque/{name} error [N m]"] = unsure + coulomb.value * (1.0 - np.abs(slides))
    return columns


def deflections(found: Identification, table: Table) -> dict[str, Array]:
    """Return the deflection at the tips [m] from the gauges, without the rig's filter, with bars."""
    run, columns = found.held[0][0], {}
    assert run.measured is not None
    spacing = float(run.time[1] - run.time[0])
    for k, (name, gauge) in enumerate(found.machine.settings.gauges.items()):
        smooth = low_pass(run.measured[:, len(run.motion.names) + k], spacing, found.machine.settings.bandwidth_Hz)
        seen = undo_lag(smooth, spacing, gauge.lag_Hz or 0.0, gauge.lag_damping)
        gain, zero, slope = (table[f"gauge {n}", name] for n in ("gain", "zero", "slope"))
        beam = found.machine.mechanism.link_of[gauge.beam].beam
        length = 0.0 if beam is None else beam.length
        tip = length / gain.value * (seen - zero.value - slope.value * run.motion.q[:, 0])
        unsure = length / gain.value * deviation(zero) + np.abs(tip) * deviation(gain) / gain.value
        columns[f"deflection/{gauge.beam}/y [m]"] = tip
        columns[f"deflection/{gauge.beam}/y error [m]"] = unsure
    return columns


def write(file: Path, columns: dict[str, Array]) -> None:
    """Write every second sample [any unit] with seven digits."""
    table = np.column_stack(list(columns.values()))[::EVERY]
    np.savetxt(file, table, fmt="%.7g", delimiter=",", header=",".join(columns), comments="")


if __name__ == "__main__":
    main()
