"""Motions of a log, from rest to rest, and how well each is explained; the same over time, part by part.

A machine rests where every measured joint has stood for a while.  A log without rests is one motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from crosscheck.identification.bands import Prediction
from crosscheck.identification.machine import Machine
from crosscheck.identification.readings import Run
from flexinv.typing import Array

REST = 0.1  # [s] for which all joints stand between two motions
SHORTEST = 0.1  # [s] of a motion: a twitch is none
PARTS = 20  # of a log, over time
FEW = 10  # samples that count of a part, at least


@dataclass(frozen=True)
class PartJudgement:
    """A channel in a part of a log: from and to [s], samples, RMS error and spread of the reading [unit].

    inside : part of the samples in their 90 % bands [-]
    """

    log: str
    part: int
    start: float
    end: float
    channel: str
    unit: str
    samples: int
    rms: float
    spread: float
    inside: float

    @property
    def left(self) -> float:
        """RMS error over the spread of the reading in the whole log [-]."""
        return self.rms / self.spread


def list_motions(machine: Machine, run: Run) -> list[tuple[float, float]]:
    """Return the motions of a log, from and to [s]."""
    moving = (np.abs(run.motion.qd) > machine.settings.still_rad_per_s).any(axis=1)
    time = run.time
    edges = np.flatnonzero(np.diff(np.concatenate([[False], moving, [False]]).astype(int)))
    stretches = [(float(time[first]), float(time[last - 1])) for first, last in edges.reshape(-1, 2)]
    joined: list[tuple[float, float]] = []
    for start, end in stretches:
        if joined and start - joined[-1][1] < REST:
            joined[-1] = (joined[-1][0], end)
        else:
            joined.append((start, end))
    return [(start, end) for start, end in joined if end - start > SHORTEST]


def judge_motions(machine: Machine, some: Sequence[tuple[Run, Prediction]]) -> list[PartJudgement]:
    """Judge predictions of runs by the measurement, motion by motion [unit of each channel]."""
    return [row for run, told in some for row in _judge_parts(machine, run, told, list_motions(machine, run))]


def judge_over_time(machine: Machine, some: Sequence[tuple[Run, Prediction]]) -> list[PartJudgement]:
    """Judge predictions of runs by the measurement, in `PARTS` equal parts of each [unit of each channel]."""
    out = []
    for run, told in some:
        edges = np.linspace(run.time[0], run.time[-1], PARTS + 1)
        out += list(_judge_parts(machine, run, told, list(pairwise(edges.tolist()))))
    return out


def _judge_parts(
    machine: Machine, run: Run, told: Prediction, parts: Sequence[tuple[float, float]]
) -> Iterator[PartJudgement]:
    if run.measured is None:
        return
    error = run.measured - told.value
    inside = (run.measured >= told.low) & (run.measured <= told.high)
    for k, (start, end) in enumerate(parts, 1):
        within = (run.time >= start) & (run.time <= end)
        for c, channel in enumerate(machine.channels):
            rows = within & run.counted[:, c]
            if rows.sum() < FEW:
                continue
            spread = float(np.std(run.measured[run.counted[:, c], c]))
            rms = _compute_rms(error[rows, c])
            held = float(inside[rows, c].mean())
            ends = (float(start), float(end), channel.name, channel.unit, int(rows.sum()))
            yield PartJudgement(run.name, k, *ends, rms, spread, held)


def _compute_rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
