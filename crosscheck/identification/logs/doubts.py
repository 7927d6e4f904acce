"""Doubts about logs that can be read: overlaps, copies, slow, uneven and other rates, jumps, saturated columns; each in words."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from crosscheck.identification.bands import ChannelJudgement
from crosscheck.identification.logs.jumps import OUT, find_jumps
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Machine
from flexinv.files.header_words import SLOW_SAMPLES
from flexinv.typing import Array

# Samples at an extreme value, of all: a smooth signal touches its extremes once or twice.
SATURATED = 0.02
BESIDE = 5.0  # times as many samples stand there as at the next value: the highest level of a coarse signal is no limit
SAME = 1e-9  # relative, of columns that are copies
SAID = 3  # jumps of one column: more tell no more
RATE = 0.01  # relative, of sampling rates that agree
TURN = 2.0 * np.pi  # [rad]: a joint that goes farther, under a model that fails, is likely one in degrees


def describe_log_doubts(machine: Machine, logs: list[Log], held: list[Log]) -> list[str]:
    """Return doubts about the logs in words [-], for readers of the results."""
    words = [w for log in (*logs, *held) for w in (*log.notes, *_list_jumps(machine, log))]
    words += [w for log in (*logs, *held) for w in _describe_saturation(machine, log)]
    words += [
        _describe_shared_samples(machine, a, b, "both identify: samples count twice") for a, b in combinations(logs, 2)
    ]
    words += [
        _describe_shared_samples(machine, a, b, "the hold-out was seen: what it says is no test")
        for a in logs
        for b in held
    ]
    words += [
        f"{log.name}: its samples are {log.spacing:g} s apart, which is slow for a machine that moves: if its times are "
        'milliseconds, write time_unit = "ms" in identify.toml'
        for log in (*logs, *held)
        if log.spacing > SLOW_SAMPLES
    ]
    rate = logs[0].spacing
    words += [
        f"{log.name} is sampled at {1 / log.spacing:.4g} Hz, {logs[0].name} at {1 / rate:.4g} Hz: "
        "each is low-passed at its own rate"
        for log in (*logs[1:], *held)
        if abs(log.spacing / rate - 1.0) > RATE
    ]
    return [w for w in words if w]


def describe_log_failures(machine: Machine, logs: list[Log], rows: list[ChannelJudgement]) -> list[str]:
    """Return words about logs that a model explains worse than a constant does [-], with the angles that may be in degrees."""
    out = []
    for log in logs:
        failed = list(dict.fromkeys(row.channel for row in rows if row.log == log.name and row.explained < 0.0))
        if not failed:
            continue
        far = [
            f"{log.name}: column {t.angle.column!r} goes over {np.ptp(log.read_column(t.angle.column)):.3g} rad: "
            'write unit = "deg" '
            f"in [joints.{name}] angle if it is in degrees"
            for name, t in machine.settings.joints.items()
            if t.angle.unit == "rad" and machine.mechanism.joint_of[name].kind == "revolute"
            if np.ptp(log.read_column(t.angle.column)) / t.angle.over > TURN
        ]
        rest = [] if far else ["; --causes looks for wrong signs, units, gears and swapped columns"]
        columns = {c.name: f"{c.name} (column {c.column!r})" for c in machine.channels}
        said = ", ".join(columns.get(name, name) for name in failed)
        out += [f"{log.name}: the model explains {said} worse than a constant does{''.join(rest)}", *far]
    return out


def find_clipped_extremes(values: Array) -> list[tuple[float, float]]:
    """Return the extremes at which a column (samples,) [any unit] stands as a clipped signal does, and the share of samples."""
    values = values[np.isfinite(values)]
    if len(values) < 20 or np.ptp(values) == 0.0:
        return []
    levels, counts = np.unique(values, return_counts=True)
    out = []
    for end, beside in ((-1, -2), (0, 1)):
        share = float(counts[end]) / len(values)
        if share > SATURATED and counts[end] > BESIDE * counts[beside]:
            out.append((float(levels[end]), share))
    return out


def _list_jumps(machine: Machine, log: Log) -> Iterator[str]:
    """Yield words about angles that leap; those that begin anew are refused where the motion is read."""
    for name, table in machine.settings.joints.items():
        for angle in filter(None, (table.angle, table.link_angle)):
            values = log.columns.get(angle.column, np.zeros(0))
            for k in find_jumps(values)[:SAID] if np.isfinite(values).all() else ():
                size = f"{values[k + 1] - values[k]:.4g} {angle.unit}"
                yield (
                    f"{log.name}: column {angle.column!r} of joint {name} leaps by {size} at {log.time[k + 1]:g} s, more than "
                    f"{OUT:g} times as far as it moves beside: an encoder that slipped, or samples that are missing; mend the "
                    f"column, or take the log in parts (LOG@{log.time[0]:g}:{log.time[k + 1]:g})"
                )


def _describe_saturation(machine: Machine, log: Log) -> list[str]:
    return [
        f"{log.name}: {share:.0%} of column {channel.column!r} stand at {side:g}, as a signal does that is clipped: "
        "the drive gave more than it shows"
        for channel in machine.channels
        for side, share in find_clipped_extremes(log.columns.get(channel.column, np.zeros(0)))
    ]


def _describe_shared_samples(machine: Machine, one: Log, other: Log, consequence: str) -> str:
    """Return words where two logs share samples: the same columns over common times, or from beginning to end."""
    names = [t.angle.column for t in machine.settings.joints.values()]
    names += [c.column for c in machine.channels if c.column in one.columns and c.column in other.columns]
    common, a, b = np.intersect1d(np.round(one.time, 6), np.round(other.time, 6), return_indices=True)
    if len(common) < 20:
        return ""
    same = all(
        np.allclose(
            one.read_column(n)[a],
            other.read_column(n)[b],
            rtol=0,
            atol=SAME * max(float(np.ptp(one.read_column(n))), 1e-300),
        )
        for n in names
    )
    if not same:
        return ""
    return f"{one.name} and {other.name} hold the same samples over {common[-1] - common[0]:.4g} s; {consequence}"
