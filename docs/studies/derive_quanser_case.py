"""Derive the case of the measured arm from its record: python docs/studies/derive_quanser_case.py.

Identifies the flexible model on the first 10 s of models/quanser_2dsfl/record.csv, prints what stands in the mechanism
files (some 30 s of one core), and writes motion.csv and measured.csv of the next 5 s, which the identification has not seen.
"""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from crosscheck.measured import arm
from crosscheck.measured.filters import low_pass, undo_lag
from crosscheck.measured.fit import Fit, identify
from crosscheck.measured.recording import read_recording
from crosscheck.studies.measured_arm import AGREE, FLEXIBLE, MESH, RECORD, RIGID, SPLITS, Array, parts, together
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism

MODELS = Path(__file__).parents[2] / "models"
EVERY = 2  # of the record's samples one: 8 ms
SPLIT = SPLITS[1]  # the same moves again


def main() -> None:
    """Write the CSV files [rad], [N m], [m] and say what was identified."""
    flexible = load_mechanism(MODELS / FLEXIBLE)
    record = read_recording(MODELS / FLEXIBLE / RECORD, arm.COLUMNS)
    seen = parts(record, SPLIT.seen, flexible)
    predict = arm.predictor(flexible.with_mesh(*MESH), seen, arm.flexibilities(flexible))
    open_ = (*arm.mechanical(True), *arm.of_sensors())
    lags = round(AGREE / record.spacing)
    fit = identify(predict, together(seen, "measured"), together(seen, "used"), open_, lags)
    click.echo("\n".join(f"{name} = {value:.4g} +- {fit.uncertainty[name]:.2g}" for name, value in fit.value.items()))
    shown = parts(record, SPLIT.unseen[:1], flexible)[0]
    torque, deflection = torques(shown, fit), deflections(shown, fit, flexible)
    for folder, measured in ((FLEXIBLE, torque | deflection), (RIGID, torque)):
        motion = {f"{name}_rad": column for name, column in zip(arm.DRIVES, shown.q.T, strict=True)}
        write(MODELS / folder / "motion.csv", {"time_s": shown.part.time, **motion})
        write(MODELS / folder / "measured.csv", {"time [s]": shown.part.time, **measured})


def torques(shown: arm.Sensed, fit: Fit) -> dict[str, Array]:
    """Return what the drives give to the mechanism, less offset and dry friction, with bars [N m].

    A joint that stands may hold as much as its dry friction: the bar there.
    """
    columns = {}
    for k, name in enumerate(arm.DRIVES):
        coulomb, offset = fit.value[f"coulomb {k + 1}"], fit.value[f"offset {k + 1}"]
        slides = np.tanh(shown.qd[:, k] / arm.STILL)
        columns[f"torque/{name} [N m]"] = shown.measured[:, k] - offset - coulomb * slides
        unsure = np.hypot(fit.uncertainty[f"coulomb {k + 1}"], fit.uncertainty[f"offset {k + 1}"])
        columns[f"torque/{name} error [N m]"] = unsure + coulomb * (1.0 - np.abs(slides))
    return columns


def deflections(shown: arm.Sensed, fit: Fit, flexible: Mechanism) -> dict[str, Array]:
    """Return the deflection at the tips [m] from the gauges, without the rig's filter, with bars."""
    columns, h = {}, shown.part.spacing
    for k, link in enumerate(flexible.beams):
        seen = undo_lag(low_pass(shown.measured[:, 2 + k], h, arm.BANDWIDTH), h, arm.GAUGE_HZ, arm.GAUGE_DAMPING)
        gain, zero, slope = (fit.value[f"{n} {k + 1}"] for n in ("gain", "zero", "slope"))
        length = 0.0 if link.beam is None else link.beam.length
        tip = length / gain * (seen - zero - slope * shown.q[:, 0])
        unsure = length / gain * fit.uncertainty[f"zero {k + 1}"]
        columns[f"deflection/{link.name}/y [m]"] = tip
        columns[f"deflection/{link.name}/y error [m]"] = unsure + np.abs(tip) * fit.uncertainty[f"gain {k + 1}"] / gain
    return columns


def write(file: Path, columns: dict[str, Array]) -> None:
    """Write every second sample [any unit] with seven digits."""
    table = np.column_stack(list(columns.values()))[::EVERY]
    np.savetxt(file, table, fmt="%.7g", delimiter=",", header=",".join(columns), comments="")


if __name__ == "__main__":
    main()
