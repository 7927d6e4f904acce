"""A measured arm: the share of unseen drive torques and gauge readings that a rigid and a flexible model explain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosscheck.measured import arm
from crosscheck.measured.arm import Sensed
from crosscheck.measured.fit import Fit, bar_of_parameters, deviation_of_explained, explained, identify, rms
from crosscheck.measured.recording import Recording, read_recording
from crosscheck.measures.mechanisms import read_mechanism
from flexinv.model.mechanism import Mechanism

Array = NDArray[np.float64]
FLEXIBLE, RIGID, RECORD = "quanser_2dsfl", "quanser_2dsfl_rigid", "record.csv"
# The references repeat after 10 s; every 5 s one of the drives has moved and the arm stands still again.
PART, PARTS = 5.0, 4  # [s], [-]
# Residuals of samples this far apart [s] may still agree: half a period of the lowest natural frequency, 1.9 Hz.
AGREE = 0.25
# Elements of order 2 at the samples' own step identify: their first two natural frequencies are those of order 4 to 0.1 %.
MESH = (1, 2)
# What is reported uses the mechanism's own mesh and a quarter of the step.
FINE = 1e-3  # [s]
THIN = 5  # of so many samples the figures draw one


@dataclass(frozen=True)
class Split:
    """Split of the record into seen and unseen parts.

    sign : of the seen half replayed as a prediction [-]
    floors : (4,) what the flexible model has to explain of the unseen half [-], torques while their joint slides: what was
        measured when this was written, less three of its deviations.  A model that falls below has lost something.
    """

    name: str
    seen: tuple[int, ...]
    unseen: tuple[int, ...]
    sign: float
    floors: tuple[float, ...]


SPLITS = (
    Split("opposite direction", (0, 2), (1, 3), -1.0, (0.978, 0.789, 0.941, 0.898)),
    Split("the same moves again", (0, 1), (2, 3), 1.0, (0.982, 0.939, 0.975, 0.951)),
)
TEXT = """Two flexible links in series (Quanser 2-DOF serial flexible link), measured: motor angles, motor currents and strain
gauges at the roots of the links, 20 s at 250 Hz (models/quanser_2dsfl/record.csv). The measured motion, low-passed at
{bandwidth:g} Hz without delay and inside each part of the record, drives the mechanism; what its sensors
should have read is compared with what they read. Torque is current x torque constant x gear x efficiency of the data sheet.

What the sheet leaves open is identified by least squares on one half: friction (viscous, dry), rotor inertia and the
current's offset of each drive, gain and zero of each gauge, where the second beam begins, and for the flexible model stiffness
and damping of gear and clamp. The table is about the other half, which the identification has not seen. Of the moves the
record has four, each twice: in "opposite direction" each is predicted from those the other way, in "the same moves again"
from themselves ten seconds before, which is little more than repeatability. "Replay" is a prediction without any model: the
seen half itself, mirrored in the first split.

A joint that stands holds whatever its drive gives, up to its dry friction: no model of motion can tell the torque then.
"Sliding" counts the samples with more than {still:g} rad/s, "all" every sample, "raw" every sample of the unfiltered current.
The gauges are compared as recorded, behind the rig's own 2 Hz low-pass, which delays them by some 0.14 s; the rigid model's
reading is what a beam would show under the rigid arm's moment. Deviations are by a jackknife over half seconds."""

COLUMNS = (
    ("split", "unseen half", ""),
    ("model", "model", ""),
    ("signal", "signal", ""),
    ("unit", "unit", ""),
    ("explained", "variance explained, sliding", ""),
    ("deviation", "± (1 deviation)", ""),
    ("all", "all", ""),
    ("raw", "raw", ""),
    ("fitted", "on the seen half, sliding", ""),
    ("replay", "replay, sliding", ""),
    ("rms", "RMS residual, sliding", "unit"),
    ("parameters", "bar: parameters", "unit"),
    ("bandwidth", "bar: bandwidth", "unit"),
    ("numerical", "bar: mesh and step", "unit"),
)


@dataclass(frozen=True)
class Outcome:
    """A model identified on one half and what it says about the other; predicted, bars : (samples, 4) [N m], [rad]."""

    fit: Fit
    fitted: Array
    predicted: Array
    parameters: Array
    bandwidth: Array
    numerical: Array


def study(models: str) -> dict[str, Any]:
    """Return the table of the report; variance explained [-], residuals [N m], [rad]."""
    folder = Path(models) / FLEXIBLE
    if not (folder / RECORD).is_file() or not (Path(models) / RIGID).is_dir():
        return {"status": "skipped", "message": f"there is no {FLEXIBLE} with its record and {RIGID} among the models"}
    record = read_recording(folder / RECORD, arm.COLUMNS)
    mechanisms = {"rigid": read_mechanism(Path(models) / RIGID), "flexible": read_mechanism(folder)}
    flexibility = arm.flexibilities(mechanisms["flexible"])
    rows: list[dict[str, Any]] = []
    outcomes: dict[str, dict[str, Outcome]] = {}
    for split in SPLITS:
        found = {name: outcome(m, record, split, flexibility) for name, m in mechanisms.items()}
        seen, unseen = (parts(record, which, mechanisms["rigid"]) for which in (split.seen, split.unseen))
        rows += judged(split, [row for name in found for row in table(split, name, found[name], seen, unseen)])
        outcomes[split.name] = found
    first = SPLITS[0]
    shown = parts(record, first.unseen[:1], mechanisms["rigid"])[0]
    return {
        "text": TEXT.format(bandwidth=arm.BANDWIDTH, still=arm.STILL),
        "columns": COLUMNS,
        "rows": rows,
        "figures": list(figures(shown, outcomes[first.name])),
        "tables": [parameters(outcomes)],
    }


def parts(record: Recording, which: tuple[int, ...], mechanism: Mechanism, factor: float = 1.0) -> tuple[Sensed, ...]:
    """Return parts of the record, each cut first and smoothed then, at the bandwidth times a factor [-]."""
    cuts = (record.cut(PART * k, PART) for k in which)
    return tuple(arm.sense(cut, mechanism, arm.BANDWIDTH * factor) for cut in cuts)


def together(sensed: tuple[Sensed, ...], name: str) -> Any:
    """Return an array of all parts, (samples, channels) [N m], [rad] or [-]."""
    return np.vstack([getattr(one, name) for one in sensed])


def outcome(mechanism: Mechanism, record: Recording, split: Split, flexibility: Array) -> Outcome:
    """Identify on the seen half and predict the unseen one, with bars [N m], [rad]."""
    coarse = mechanism.with_mesh(*MESH)
    seen, unseen = parts(record, split.seen, mechanism), parts(record, split.unseen, mechanism)
    open_ = (*arm.mechanical(not mechanism.is_rigid), *arm.of_sensors())
    lags = round(AGREE / record.spacing)
    predict = arm.predictor(coarse, seen, flexibility)
    fit = identify(predict, together(seen, "measured"), together(seen, "used"), open_, lags)

    def at(which: Mechanism, sensed: tuple[Sensed, ...], step: float = 0.0) -> Array:
        return arm.predictor(which, sensed, flexibility, step)(fit.value)

    rough = at(coarse, unseen)
    wide, narrow = (parts(record, split.unseen, mechanism, f) for f in (1.5, 1 / 1.5))
    return Outcome(
        fit,
        predict(fit.value),
        at(mechanism, unseen, FINE),
        bar_of_parameters(arm.predictor(coarse, unseen, flexibility), fit),
        np.abs(at(coarse, wide) - at(coarse, narrow)) / 2.0,
        np.abs(rough - at(mechanism, unseen, FINE)),
    )


# ------------------------------------------------------------------------------------------------------ the tables


def table(
    split: Split, model: str, found: Outcome, seen: tuple[Sensed, ...], unseen: tuple[Sensed, ...]
) -> Iterator[dict[str, Any]]:
    """Yield one row per signal: variance explained [-], residuals and bars [N m], [rad]."""
    measured, raw, used = (together(unseen, n) for n in ("measured", "raw", "used"))
    before, counted = together(seen, "measured"), together(seen, "used")
    residual = rms(measured - found.predicted, used)
    block = 2 * round(AGREE / unseen[0].part.spacing)
    for k, (signal, unit) in enumerate(arm.CHANNELS):
        y, p, u = measured[:, k], found.predicted[:, k], used[:, k]
        yield {
            "split": split.name,
            "model": model,
            "signal": signal,
            "unit": unit,
            "explained": explained(y, p, u),
            "deviation": deviation_of_explained(y, p, u, block),
            "all": explained(y, p),
            "raw": explained(raw[:, k], p),
            "fitted": explained(before[:, k], found.fitted[:, k], counted[:, k]),
            "replay": explained(y, split.sign * before[:, k], u),
            "rms": float(residual[k]),
            **{n: float(rms(getattr(found, n), used)[k]) for n in ("parameters", "bandwidth", "numerical")},
        }


def judged(split: Split, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows with verdicts: the flexible model [-] above its floor, and not below the rigid one."""
    rigid = {row["signal"]: row for row in rows if row["model"] == "rigid"}
    floors = {signal: floor for (signal, _), floor in zip(arm.CHANNELS, split.floors, strict=True)}
    for row in rows:
        row["verdict"] = "within"
        if row["model"] != "flexible":
            continue
        other, floor = rigid[row["signal"]], floors[row["signal"]]
        if not row["explained"] >= floor:
            row |= {"verdict": "deviation", "message": f"explains {row['explained']:.4f}, expected {floor} or more"}
        elif row["explained"] < other["explained"] - row["deviation"] - other["deviation"]:
            row |= {"verdict": "deviation", "message": f"the rigid model explains {other['explained']:.4f}"}
    return rows


def parameters(outcomes: dict[str, dict[str, Outcome]]) -> dict[str, Any]:
    """Return the table of identified values with their standard uncertainties, in the unit of each."""
    known = {p.name: p for p in (*arm.mechanical(True), *arm.of_sensors())}
    keys = list(product((split.name for split in SPLITS), ("rigid", "flexible")))
    columns = [("name", "identified", ""), ("unit", "unit", "")]
    columns += [(f"{split}/{model}", f"{model}; judged on: {split}", "") for split, model in keys]
    rows = []
    for name, one in known.items():
        row: dict[str, Any] = {"name": name, "unit": one.unit}
        for split, model in keys:
            fit = outcomes[split][model].fit
            row[f"{split}/{model}"] = (
                f"{fit.value[name]:.4g} ± {fit.uncertainty[name]:.2g}" if name in fit.value else "–"
            )
        rows.append(row)
    return {"title": "What was identified, with standard uncertainties", "columns": columns, "rows": rows}


def figures(shown: Sensed, found: dict[str, Outcome]) -> Iterator[dict[str, Any]]:
    """Yield measured and predicted signals [N m], [rad] of one unseen part over time [s]."""
    size = shown.part.size
    time = (shown.part.start + shown.part.time)[::THIN].round(3).tolist()
    for k, (signal, unit) in enumerate(arm.CHANNELS):
        lines = {"measured": shown.measured[:, k]} | {n: o.predicted[:size, k] for n, o in found.items()}
        curves = {n: {"x": time, "y": np.round(v[::THIN], 6).tolist()} for n, v in lines.items()}
        yield {"title": signal, "x": "time [s]", "y": f"{signal} [{unit}]", "curves": curves}
