"""Signals that show their own fault: clipped, held, with jumps or spikes, or written in steps larger than what remains."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from crosscheck.identification.causes.cause import NamedCause
from crosscheck.identification.estimation.fit import Fit
from crosscheck.identification.filters import low_pass
from crosscheck.identification.logs.doubts import find_clipped_extremes
from crosscheck.identification.logs.jumps import WHOLE, find_jumps
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Channel, Machine
from crosscheck.identification.readings import compute_raw_signals, compute_readings, make_run
from crosscheck.identification.settings import ANGLES
from flexinv.typing import Array

REACH = 1.0  # periods of the bandwidth over which the low-pass carries a clipped sample
HELD = 8  # equal samples on end that no measured signal has
QUIET = 0.95  # of the steps of a signal are none of its spikes
AT_ONCE = 2  # samples: what is elsewhere for no longer is a spike, which may be as large as the range
BESIDE = 12  # samples after a step, whose median says whether it lasts
EXACT = 0.05  # part of a step by which values may miss its multiples: what few decimals leave of it
FIRST = 8  # levels by which a step is told first
LEAP = 3.0  # times the largest step beside it is a leap: an angle that was held for `HELD` samples makes more
AMONG_SMALLEST = 0.1  # of a signal's values are smaller than those at the ends of a dead band: of dropouts any are
TINY = 1e-300
HALF = 0.5  # of what remains: an angle's steps that make more of the readings are named


def list_broken_columns(machine: Machine, fit: Fit, log: Log) -> Iterator[NamedCause]:
    """Yield spikes and dropouts of angles and efforts, and jumps of angles [unit of the channel], [rad], [m].

    Efforts leap where dry friction turns round: their spikes are looked for in what the readings leave of them, jumps are not.
    """
    for name, table in machine.settings.joints.items():
        slides = machine.mechanism.joint_of[name].kind == "prismatic"
        factor = ANGLES[table.angle.unit] / table.angle.over
        if table.angle.column in log.columns:
            values = log.columns[table.angle.column] * factor
            yield from _list_breaks("angle", name, "m" if slides else "rad", log.time, values, values)
    run = make_run(machine, log, efforts=False, once=True)
    told = compute_raw_signals(machine, run.motion, run.response, machine.space.compute_values(fit.z))
    yield from _list_copied_efforts(machine, log, told)
    for channel, expected in zip(machine.channels, told.T, strict=True):
        if channel.column in log.columns:
            yield from _list_whole_faults(channel, log.columns[channel.column] * channel.factor, expected)
            values = log.columns[channel.column] * channel.factor
            yield from _list_breaks(channel.sense, channel.place, channel.unit, log.time, values, values - expected)


def _list_copied_efforts(machine: Machine, log: Log, told: Array) -> Iterator[NamedCause]:
    """Yield efforts whose column is that of another one, number by number; told : (samples, channels) [units of the channels]."""
    efforts = [
        (c, one) for c, one in enumerate(machine.channels) if one.sense == "effort" and one.column in log.columns
    ]
    for (a, one), (b, other) in combinations(efforts, 2):
        if one.column != other.column and np.array_equal(log.columns[one.column], log.columns[other.column]):
            values = [log.columns[c.column] * c.factor for c in (one, other)]
            missed = [np.std(v - told[:, k]) / np.std(told[:, k]) for v, k in zip(values, (a, b), strict=True)]
            copy, first = (one, other) if missed[0] > missed[1] else (other, one)
            words = (
                f"all samples are those of {first.column}, and miss what is expected by {max(missed):.2g} of its spread"
            )
            yield NamedCause(f"copied column of the {copy.sense}", copy.place, "-", 1.0, 0.0, np.inf, words)


def _list_whole_faults(channel: Channel, values: Array, expected: Array) -> Iterator[NamedCause]:
    """Yield an effort without its sign, and one that begins anew beyond its range; values, expected : (samples,) [unit]."""
    if channel.sense != "effort":
        return
    sizes = np.abs(expected)
    left = [float(np.std(values - one)) for one in (expected, sizes)]
    low, high = np.quantile(expected, [AMONG_SMALLEST, 1.0 - AMONG_SMALLEST])
    if low < 0.0 < high and values.min() >= 0.0 and left[1] < HALF * left[0]:
        words = (
            f"it is never negative; {left[0]:.3g} {channel.unit} remain, and {left[1]:.3g} where the sign is left out"
        )
        yield NamedCause(f"{channel.sense} without its sign", channel.place, "-", 1.0, 0.0, np.inf, words)
    period = float(np.ptp(values))
    turns = np.round((expected - values) / max(period, TINY)) if period > 0.0 else np.zeros(1)
    wrapped = np.abs(np.diff(values)) > WHOLE * period
    stays = np.convolve(turns != 0.0, np.ones(AT_ONCE + 1), mode="valid").max(initial=0.0) > AT_ONCE
    if wrapped.any() and stays and np.std(values + period * turns - expected) < HALF * left[0]:
        words = f"it begins anew at the other end of its range {int(wrapped.sum())} times"
        yield NamedCause(f"wrapped {channel.sense}", channel.place, channel.unit, period, 0.0, np.inf, words)


def _list_breaks(sense: str, place: str, unit: str, time: Array, values: Array, rest: Array) -> Iterator[NamedCause]:
    """Yield the faults of a signal at times [s]; values, rest : (samples,) [unit] as it is, and less what is expected."""
    held = _find_held_samples(values, stands=sense == "angle")
    if held.any():
        words = f"{held.mean():.1%} of the samples repeat the one before, {HELD} times and more on end"
        yield NamedCause(f"dropouts of the {sense}", place, "-", float(held.mean()), 0.0, np.inf, words)
    steps = np.diff(rest)
    jumps = [k for k in find_jumps(rest, QUIET) if not held[k : k + 2].any()]
    lasting = [k for k in jumps if abs(np.median(rest[k + 1 : k + 1 + BESIDE]) - rest[k]) > 0.5 * abs(steps[k])]
    returning = [k for k in jumps if k not in lasting and k - 1 not in jumps]
    if returning:
        words = (
            f"{len(returning)} samples stand out from those beside them, the first at {time[returning[0] + 1]:.4g} s"
        )
        size = float(np.abs(steps[returning]).max())
        yield NamedCause(f"spikes of the {sense}", place, unit, size, 0.0, np.inf, words)
    lasting = [k for k in lasting if k - 1 not in jumps]
    if lasting and sense == "angle":
        words = f"it leaps {len(lasting)} times and goes on from there, the first time at {time[lasting[0] + 1]:.4g} s"
        yield NamedCause(f"jump of the {sense}", place, unit, float(steps[lasting[0]]), 0.0, np.inf, words)


def _find_held_samples(values: Array, stands: bool) -> NDArray[np.bool_]:
    """Samples (samples,) that belong to `HELD` equal ones on end, in a signal of which most differ from all others.

    stands : the machine may stand, as an angle does; then only stretches are held that begin or end with a leap.
    """
    equal = np.concatenate([[False], np.diff(values) == 0.0])
    if len(np.unique(values)) < HALF * len(values):  # of a coarse signal neighbours are equal
        return np.zeros(len(values), dtype=bool)
    inside = (values > values.min()) & (values < values.max())
    zero = (values == 0.0) & (not _has_dead_band(values))
    equal &= np.where(values == 0.0, zero, inside)  # what stands at another extreme is clipped
    steps = np.abs(np.diff(values))
    typical = float(np.median(steps))
    ends = np.flatnonzero(np.diff(np.concatenate([[False], equal, [False]]).astype(int)))
    out = np.zeros(len(values), dtype=bool)
    for first, last in ends.reshape(-1, 2):
        if last - first < HELD:
            continue
        # A signal that comes late stands on its first value, and one that is out early on its last.
        at_end = first <= 1 or last >= len(values)
        if (stands or at_end) and not _is_beside_leap(steps, max(first - 1, 0), last - 1, typical):
            continue
        out[max(first - 1, 0) : last] = True
    return out


def _has_dead_band(values: Array) -> bool:
    """Tell whether a signal (samples,) is zero where it is small: what stands beside zeros is of the smallest that there is."""
    size = np.abs(values)
    beside = (size > 0.0) & (np.convolve(size == 0.0, np.ones(3), mode="same") > 0.0)
    return bool(beside.any() and np.median(size[beside]) < np.quantile(size[size > 0.0], AMONG_SMALLEST))


def _is_beside_leap(steps: Array, first: int, last: int, typical: float) -> bool:
    """Tell whether a signal leaps as the equal samples first to last begin or end.

    steps : (samples - 1,) absolute ones; typical : their median. A leap is `LEAP` times the largest step beside it, and
    times the typical one: a joint that stands still creeps by less.
    """
    before = steps[max(first - 1 - BESIDE, 0) : max(first - 1, 0)]
    after = steps[last + 1 : last + 1 + BESIDE]
    usual = max(before.max(initial=typical), after.max(initial=typical))
    edges = np.concatenate([steps[max(first - 1, 0) : first], steps[last : last + 1]])
    return bool(edges.max(initial=0.0) > LEAP * usual)


def list_clipped_columns(machine: Machine, log: Log) -> Iterator[NamedCause]:
    """Yield columns that stand at an extreme as a clipped signal does [unit of the channel]."""
    for channel in machine.channels:
        values = log.columns.get(channel.column, np.zeros(0))
        for side, share in find_clipped_extremes(values):
            if side == 0.0:  # no drive has this limit: samples are missing
                continue
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
    """Return the step of which all values (samples,) are multiples [any unit]; 0 where there is none."""
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < 3:
        return 0.0
    way = levels - levels[0]
    step = float(np.diff(levels).min())
    count = FIRST
    while (
        True
    ):  # what the smallest step is wrong by counts as often as there are levels: the first ones mend it for more
        multiples = np.round(way[:count] / step)
        step = float(multiples @ way[:count]) / float(multiples @ multiples)
        if count >= len(levels):
            break
        count *= 2
    multiples = way / step
    return step if np.abs(multiples - np.round(multiples)).max() < EXACT else 0.0


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
