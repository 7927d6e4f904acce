"""Faults of sensors and loggers: what a `Record` says instead of what was."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from campaigns.log_faults.machines import SPACING, Record
from campaigns.log_faults.plants import Random, add_logger_fault
from flexinv.typing import Array


def _replace_column(values: Array, place: int, change: Callable[[Array], Array]) -> Array:
    """Change the column of a joint; those of all joints where the place is -1."""
    return np.column_stack([change(c) if place in (k, -1) else c for k, c in enumerate(values.T)])


def _replace_effort(record: Record, place: int, change: Callable[[Array], Array]) -> Record:
    return replace(record, effort=_replace_column(record.effort, place, change))


def _replace_angle(record: Record, place: int, change: Callable[[Array], Array]) -> Record:
    return replace(record, angle=_replace_column(record.angle, place, change))


@add_logger_fault
def apply_effort_offset(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Add a constant [N m] to an effort."""
    return _replace_effort(record, place, lambda v: v + size)


@add_logger_fault
def apply_effort_gain(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Multiply an effort [-]: a wrong torque constant, sign or unit."""
    return _replace_effort(record, place, lambda v: v * size)


@add_logger_fault
def apply_effort_drift(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let the zero of an effort drift by this [N m] from the first sample to the last."""
    return _replace_effort(record, place, lambda v: v + size * np.linspace(0.0, 1.0, len(v)))


@add_logger_fault
def apply_gain_drift(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let the gain of an effort grow by this part [-] from the first sample to the last: magnets that warm up."""
    return _replace_effort(record, place, lambda v: v * (1.0 + size * np.linspace(0.0, 1.0, len(v))))


@add_logger_fault
def apply_effort_step(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let the zero of an effort jump by this [N m] at ``other`` [s]."""
    return _replace_effort(record, place, lambda v: v + size * (record.time >= other))


@add_logger_fault
def apply_effort_spikes(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let ``other`` single samples of an effort be off by this [N m], either way."""

    def add(v: Array) -> Array:
        at = random.choice(np.arange(300, len(v) - 300), int(other), replace=False)
        v = v.copy()
        v[at] += size * random.choice([-1.0, 1.0], len(at))
        return v

    return _replace_effort(record, place, add)


@add_logger_fault
def apply_effort_dropout(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an effort read zero for this time [s] from ``other`` [s]."""
    inside = (record.time >= other) & (record.time < other + size)
    return _replace_effort(record, place, lambda v: np.where(inside, 0.0, v))


@add_logger_fault
def apply_effort_frozen(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an effort keep its last value for this time [s] from ``other`` [s]."""
    inside = (record.time >= other) & (record.time < other + size)
    return _replace_effort(record, place, lambda v: np.where(inside, v[np.argmax(inside)], v))


@add_logger_fault
def apply_effort_clipped(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an effort stop at this part [-] of its largest size."""
    return _replace_effort(record, place, lambda v: np.clip(v, -size * np.abs(v).max(), size * np.abs(v).max()))


@add_logger_fault
def apply_effort_noise(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Add white noise [N m] to an effort."""
    return _replace_effort(record, place, lambda v: v + size * random.normal(size=len(v)))


@add_logger_fault
def apply_effort_held(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an effort be fresh only every so many samples [-]."""
    return _replace_effort(record, place, lambda v: v[np.arange(len(v)) // int(size) * int(size)])


@add_logger_fault
def apply_effort_coarse(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Round an effort to multiples of this [N m]."""
    return _replace_effort(record, place, lambda v: size * np.round(v / size))


@add_logger_fault
def apply_effort_unsigned(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log the size [N m] of an effort without its sign."""
    return _replace_effort(record, place, np.abs)


def _apply_delay(v: Array, late: float) -> Array:
    at = np.arange(len(v)) * SPACING
    return np.asarray(np.interp(at - late, at, v))


def _apply_lag(v: Array, constant: float) -> Array:
    keep = np.exp(-SPACING / constant)
    out = np.empty_like(v)
    out[0] = v[0]
    for i in range(1, len(v)):
        out[i] = keep * out[i - 1] + (1.0 - keep) * v[i]
    return out


@add_logger_fault
def apply_effort_delay(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log an effort late by this [s]."""
    return _replace_effort(record, place, lambda v: _apply_delay(v, size))


@add_logger_fault
def apply_effort_lag(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log an effort behind a first-order lag [s]."""
    return _replace_effort(record, place, lambda v: _apply_lag(v, size))


@add_logger_fault
def apply_angle_delay(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log an angle late by this [s]."""
    return _replace_angle(record, place, lambda v: _apply_delay(v, size))


@add_logger_fault
def apply_angle_lag(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log an angle behind a first-order lag [s]."""
    return _replace_angle(record, place, lambda v: _apply_lag(v, size))


@add_logger_fault
def apply_angle_offset(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Add a constant [rad] to an angle: homed at the wrong place."""
    return _replace_angle(record, place, lambda v: v + size)


@add_logger_fault
def apply_angle_gain(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Multiply an angle [-]: wrong counts per turn, sign or unit."""
    return _replace_angle(record, place, lambda v: v * size)


@add_logger_fault
def apply_angle_drift(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an angle creep by this [rad] from the first sample to the last: a coupling that slips."""
    return _replace_angle(record, place, lambda v: v + size * np.linspace(0.0, 1.0, len(v)))


@add_logger_fault
def apply_angle_jump(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an angle jump by this [rad] at ``other`` [s]: lost counts."""
    return _replace_angle(record, place, lambda v: v + size * (record.time >= other))


@add_logger_fault
def apply_angle_wrapped(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Wrap an angle into a turn that begins at this [rad]."""
    return _replace_angle(record, place, lambda v: (v - size) % (2 * np.pi) + size)


@add_logger_fault
def apply_angle_spikes(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let ``other`` single samples of an angle be off by this [rad]: lost bits."""

    def add(v: Array) -> Array:
        at = random.choice(np.arange(300, len(v) - 300), int(other), replace=False)
        v = v.copy()
        v[at] += size
        return v

    return _replace_angle(record, place, add)


@add_logger_fault
def apply_angle_frozen(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an angle keep its last value for this time [s] from ``other`` [s]."""
    inside = (record.time >= other) & (record.time < other + size)
    return _replace_angle(record, place, lambda v: np.where(inside, v[np.argmax(inside)], v))


@add_logger_fault
def apply_angle_coarse(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Round an angle to multiples of this [rad]: lost lower bits."""
    return _replace_angle(record, place, lambda v: size * np.round(v / size))


@add_logger_fault
def apply_angle_eccentric(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an encoder's disc run out: the angle is off by this [rad], ``other`` periods a turn."""
    return _replace_angle(record, place, lambda v: v + size * np.sin(other * v + 0.3))


@add_logger_fault
def apply_swapped_efforts(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Swap the columns of the efforts [N m] of two joints."""
    return replace(record, effort=record.effort[:, ::-1])


@add_logger_fault
def apply_swapped_angles(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Swap the columns of the angles [rad] of two joints."""
    return replace(record, angle=record.angle[:, ::-1])


@add_logger_fault
def apply_swapped_joints(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Swap angles [rad] and efforts [N m] of two joints."""
    return replace(record, angle=record.angle[:, ::-1], effort=record.effort[:, ::-1])


@add_logger_fault
def apply_copied_effort(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Write the effort [N m] of the other joint into the column of this one."""
    return replace(record, effort=np.column_stack([record.effort[:, 1 - place]] * 2))


@add_logger_fault
def apply_crosstalk(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let this part [-] of the other joint's effort leak into this one's."""
    return _replace_effort(record, place, lambda v: v + size * record.effort[:, 1 - place])


@add_logger_fault
def apply_absolute_angle(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log the elbow's angle [rad] against the world instead of the upper arm."""
    return _replace_angle(record, 1, lambda v: v + record.angle[:, 0])


@add_logger_fault
def apply_clock(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Multiply the time stamps [s] by this [-]."""
    return replace(record, time=record.time * size)


@add_logger_fault
def apply_jitter(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let samples be taken early or late by this [s] (standard deviation), and stamped evenly."""
    at = record.time + size * random.normal(size=len(record.time))

    def take(values: Array) -> Array:
        return _replace_column(values, -1, lambda v: np.interp(at, record.time, v))

    return replace(record, angle=take(record.angle), effort=take(record.effort))


@add_logger_fault
def apply_lost_rows(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Lose this time [s] of rows at ``other`` [s]; the time stamps are numbered through, as if nothing was lost."""
    keep = (record.time < other) | (record.time >= other + size)
    count = int(keep.sum())
    return Record(record.time[:count], record.angle[keep], record.effort[keep])


@add_logger_fault
def apply_gap(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Lose this time [s] of rows at ``other`` [s]; the time stamps tell of it."""
    keep = (record.time < other) | (record.time >= other + size)
    return Record(record.time[keep], record.angle[keep], record.effort[keep])


@add_logger_fault
def apply_empty_cells(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Leave this many cells [-] of an effort empty."""

    def drop_cells(v: Array) -> Array:
        v = v.copy()
        v[random.choice(len(v), int(size), replace=False)] = np.nan
        return v

    return _replace_effort(record, place, drop_cells)


@add_logger_fault
def apply_iron_saturation(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let a motor need this part [-] more current at the largest effort, and less of it below, by the square."""
    return _replace_effort(record, place, lambda v: v * (1.0 + size * (v / np.abs(v).max()) ** 2))


@add_logger_fault
def apply_dead_band(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an effort below this [N m] read zero, and all others so much less."""
    return _replace_effort(record, place, lambda v: np.sign(v) * np.maximum(np.abs(v) - size, 0.0))


@add_logger_fault
def apply_one_sided_gain(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Multiply positive efforts alone [-]: one half of an amplifier."""
    return _replace_effort(record, place, lambda v: np.where(v > 0.0, size * v, v))


@add_logger_fault
def apply_overflow(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an effort wrap round beyond this part [-] of its largest size, as an integer does."""

    def take_remainder(v: Array) -> Array:
        top = size * np.abs(v).max()
        return np.asarray((v + top) % (2.0 * top) - top)

    return _replace_effort(record, place, take_remainder)


@add_logger_fault
def apply_mean_removed(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Take its mean [N m] off an effort."""
    return _replace_effort(record, place, lambda v: v - v.mean())


@add_logger_fault
def apply_high_pass(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log an effort behind a high-pass with this time constant [s]: an input coupled for alternating current."""
    return _replace_effort(record, place, lambda v: v - _apply_lag(v, size))


@add_logger_fault
def apply_smoothed_effort(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Average an effort over this time [s], centred."""
    count = 2 * round(size / SPACING / 2) + 1

    def take_average(v: Array) -> Array:
        return np.convolve(np.pad(v, count // 2, "edge"), np.ones(count) / count, "valid")

    return _replace_effort(record, place, take_average)


@add_logger_fault
def apply_hum(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Add a sine [N m] of ``other`` [Hz] to an effort: mains, aliased."""
    return _replace_effort(record, place, lambda v: v + size * np.sin(2 * np.pi * other * record.time))


@add_logger_fault
def apply_late_after(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let efforts come late by this [s] from ``other`` [s] on: a buffer that has filled."""
    return _replace_effort(record, place, lambda v: np.where(record.time < other, v, _apply_delay(v, size)))


@add_logger_fault
def apply_uneven_clock(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Stamp evenly what was sampled ever faster: by this part [-] at the last sample."""
    at = record.time - size * record.time**2 / 2.0 / record.time[-1]

    def take(values: Array) -> Array:
        return _replace_column(values, -1, lambda v: np.interp(at, record.time, v))

    return replace(record, angle=take(record.angle), effort=take(record.effort))


@add_logger_fault
def apply_coupled_angle(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let the elbow's encoder turn by this part [-] of the shoulder's angle: a belt over the shoulder's axis."""
    return _replace_angle(record, 1, lambda v: v + size * record.angle[:, 0])


@add_logger_fault
def apply_zeroed_angle(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Count an angle [rad] from where the log begins."""
    return _replace_angle(record, place, lambda v: v - v[0])


@add_logger_fault
def apply_commanded_angle(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log where the joint should be, which it reaches this much later [s]."""
    return _replace_angle(record, place, lambda v: _apply_delay(v, -size))


@add_logger_fault
def apply_flipped_bits(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let this many single samples [-] of an effort have the other sign."""

    def turn_signs(v: Array) -> Array:
        at = random.choice(np.arange(300, len(v) - 300), int(size), replace=False)
        v = v.copy()
        v[at] *= -1.0
        return v

    return _replace_effort(record, place, turn_signs)


@add_logger_fault
def apply_warm_up(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let the zero of an effort be off by this [N m] at first, and settle with a time constant of ``other`` [s]."""
    return _replace_effort(record, place, lambda v: v + size * np.exp(-record.time / other))


@add_logger_fault
def apply_bent_sensor(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Add this part [-] of an effort's square over its largest size: a sensor that is not linear."""
    return _replace_effort(record, place, lambda v: v + size * v**2 / np.abs(v).max())
