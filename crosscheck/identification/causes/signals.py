"""Signals that show their own fault: clipped at an extreme, or written in steps that are larger than what remains."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from crosscheck.identification.causes.cause import NamedCause
from crosscheck.identification.estimation.fit import Fit
from crosscheck.identification.filters import low_pass
from crosscheck.identification.logs.doubts import find_clipped_extremes
from crosscheck.identification.logs.log import Log
from crosscheck.identification.readings import Machine, compute_readings, make_run
from crosscheck.identification.settings import ANGLES
from flexinv.typing import Array

REACH = 1.0  # periods of the bandwidth over which the low-pass carries a clipped sample
LEVELS = 5000  # a signal of more of them is no coarse one
EXACT = 1e-3  # part of a step by which values may miss its multiples
HALF = 0.5  # of what remains: an angle's steps that make more of the readings are named


def list_clipped_columns(machine: Machine, log: Log) -> Iterator[NamedCause]:
    """Yield columns that stand at an extreme as a clipped signal does [unit of the channel]."""
    for channel in machine.channels:
        values = log.columns.get(channel.column, np.zeros(0))
        for side, share in find_clipped_extremes(values):
            words = f"{share:.0%} of the samples stand there, and next to none close to it"
            yield NamedCause(
                f"clipped {channel.sense}", channel.place, channel.unit, side * channel.factor, 0.0, np.inf, words
            )


def find_clipped_samples(machine: Machine, log: Log) -> NDArray[np.bool_]:
    """Return the samples that a clipped stretch spoils behind the low-pass (samples, channels) [-]."""
    out = np.zeros((len(log.time), len(machine.channels)), dtype=bool)
    reach = max(1, round(REACH / (machine.settings.bandwidth_Hz * log.spacing)))
    for c, channel in enumerate(machine.channels):
        values = log.columns.get(channel.column, np.zeros(0))
        for side, _ in find_clipped_extremes(values):
            near = np.convolve((values == side).astype(float), np.ones(2 * reach + 1), mode="same")
            out[:, c] |= near > 0.5
    return out


def find_quantisation_step(values: Array) -> float:
    """Return the step of which all values (samples,) are multiples [any unit]; 0 where there is none, or many levels."""
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < 3 or len(levels) > LEVELS:
        return 0.0
    step = float(np.diff(levels).min())
    multiples = (levels - levels[0]) / step
    return step if np.abs(multiples - np.round(multiples)).max() < EXACT * len(levels) else 0.0


def list_quantised_columns(machine: Machine, fit: Fit, log: Log) -> Iterator[NamedCause]:
    """Yield columns whose steps are larger than what remains [unit of the channel], [rad], [m]."""
    for channel, spread in zip(machine.channels, fit.spread, strict=True):
        values = log.columns.get(channel.column, np.zeros(0))
        step = find_quantisation_step(values) * abs(channel.factor)
        if step > spread:
            words = f"{len(np.unique(values))} levels; {spread:.3g} {channel.unit} remain"
            yield NamedCause(
                f"quantisation of the {channel.sense}", channel.place, channel.unit, step, 0.0, np.inf, words
            )
    as_it_is: Array | None = None
    for name, table in machine.settings.joints.items():
        column = log.read_column(table.angle.column)
        factor = abs(ANGLES[table.angle.unit] / table.angle.over)
        if step := find_quantisation_step(column):
            if as_it_is is None:
                as_it_is = _compute_readings(machine, fit, log)
            part = _compute_step_share(machine, fit, log, table.angle.column, step, as_it_is)
            if part > HALF:
                words = f"{len(np.unique(column))} levels make {part:.3g} of what remains, through the accelerations"
                slides = machine.mechanism.joint_of[name].kind == "prismatic"
                unit = "m" if slides else "rad"
                yield NamedCause("quantisation of the angle", name, unit, step * factor, 0.0, np.inf, words)


def _compute_readings(machine: Machine, fit: Fit, log: Log) -> Array:
    return compute_readings(
        machine, make_run(machine, log, efforts=False, once=True), machine.space.compute_values(fit.z)
    )


def _compute_step_share(machine: Machine, fit: Fit, log: Log, column: str, step: float, one: Array) -> float:
    """Largest part of what remains [-] that values anywhere inside their steps make; one : the readings as they are."""
    random = np.random.default_rng(0)
    values = log.columns[column]
    moved = replace(log, columns={**log.columns, column: values + step * random.uniform(-0.5, 0.5, len(values))})
    other = _compute_readings(machine, fit, moved)
    change = np.column_stack([low_pass(c, log.spacing, machine.settings.bandwidth_Hz) for c in (other - one).T])
    return float((np.sqrt(np.mean(change**2, axis=0)) / fit.spread).max())
