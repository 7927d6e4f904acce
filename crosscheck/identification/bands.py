"""Bands of predicted readings, and how often they hold: parameter and residual uncertainty apart, measured on blocks left out.

sd^2 = J cov J^T (parameters) + s^2 (residuals) + (between_runs friction)^2 + coulomb^2 (a joint that stands)
band = value +- q sd,   q such that `HOLD` of the residuals of blocks left out lie inside, and at most `WIDEST` of their RMS

The most is that of a usual sd (`USUAL`): where a joint nearly stands its band is wider, and no reason for narrow ones elsewhere.
Each residual left out is held against its own sd, with the larger cov of the parameters that have not seen its block.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from crosscheck.identification.filters import low_pass
from crosscheck.identification.fit import STEP, Fit, Problem
from crosscheck.identification.readings import Machine, Run, friction, readings

Array = NDArray[np.float64]
NOMINAL = 0.9
HOLD = 0.94  # of residuals left out, more than promised: another run differs by more than a block does
WIDEST = 2.0  # half width of 95 % of a normal distribution: more would be a band that says nothing
USUAL = 0.6  # of the samples have at most the sd that is meant by it: where a joint nearly stands it is wider
NORMAL = 1.6448536269514722  # half width of 90 % of a normal distribution, in standard deviations


@dataclass(frozen=True)
class Prediction:
    """Readings of a log that need no effort of it.

    time : (samples,) [s]; value, low, high : (samples, channels) [units of the channels]
    parameters, residual : (samples, channels) standard deviations by their cause; sliding : (samples, channels)
    """

    name: str
    time: Array
    value: Array
    low: Array
    high: Array
    parameters: Array
    residual: Array
    sliding: NDArray[np.bool_]


def predict(machine: Machine, found: Fit, factor: Array, run: Run) -> Prediction:
    """Return readings with 90 % bands [units of the channels] of a run; factor : (channels,) of `factors` [-]."""
    value = readings(machine, run, machine.space.values(found.z))
    own = _of_parameters(machine, found, run, value)
    rest = np.sqrt(found.spread**2 + _of_runs(machine, found, run) ** 2)
    half = factor * np.sqrt(own**2 + rest**2)
    return Prediction(run.name, run.time, value, value - half, value + half, own, rest, run.sliding)


def factors(task: Problem, found: Fit) -> Array:
    """Return q (channels,) [-] with which `HOLD` of the residuals of blocks left out lie inside their bands."""
    extra = task.pick([_of_runs(task.machine, found, run) for run in task.runs])
    out = []
    for c, more in enumerate(extra):
        sd = np.sqrt(found.unsure[c] ** 2 + found.spread[c] ** 2 + more**2)
        out.append(
            min(np.quantile(np.abs(found.held[c]) / sd, HOLD), WIDEST * found.block[c] / float(np.quantile(sd, USUAL)))
        )
    return np.array(out)


def _of_parameters(machine: Machine, found: Fit, run: Run, value: Array) -> Array:
    slopes = []
    for k in range(len(found.z)):  # one prediction each; those of sensors and friction solve nothing anew
        ahead = found.z.copy()
        ahead[k] += STEP
        slopes.append((readings(machine, run, machine.space.values(ahead)) - value) / STEP)
    j = np.stack(slopes, axis=-1)
    variance = np.einsum("tcp,pq,tcq->tc", j, found.covariance, j, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _of_runs(machine: Machine, found: Fit, run: Run) -> Array:
    """Scatter of friction between runs, and what a joint holds while it stands, (samples, channels)."""
    values, spacing = machine.space.values(found.z), float(run.time[1] - run.time[0])
    columns = []
    for channel in machine.channels:
        if channel.sense != "effort":
            columns.append(np.zeros(len(run.time)))
            continue
        v = run.motion.qd[:, run.motion.names.index(channel.place)]
        took = np.abs(friction(machine, channel.place, v, values)) / channel.ratio
        still = machine.settings.still_rad_per_s
        dry = float(np.abs(friction(machine, channel.place, np.array([still]), values))[0]) / channel.ratio
        stands = low_pass((np.abs(v) <= still).astype(float), spacing, machine.settings.bandwidth_Hz)
        columns.append(machine.settings.between_runs * took + np.clip(stands, 0.0, 1.0) * dry / NORMAL)
    return np.column_stack(columns)


@dataclass(frozen=True)
class Judged:
    """One channel of a judged log: parts explained while sliding, of that without a constant, and over all samples.

    coverage : part of samples inside the band; width : of the band over the RMS error; all [-]; rms : RMS error [unit]
    """

    log: str
    channel: str
    unit: str
    samples: int
    explained: float
    spread_explained: float
    explained_all: float
    coverage: float
    width: float
    rms: float


def explained(measured: Array, told: Array) -> float:
    """Return ``1 - sum(e^2) / sum((y - mean y)^2)`` [-]; the mean of e counts.  measured, told : (samples,) [any unit]"""
    return float(1.0 - np.sum((measured - told) ** 2) / np.sum((measured - measured.mean()) ** 2))


def judge(machine: Machine, run: Run, told: Prediction, chosen: NDArray[np.bool_] | None = None) -> list[Judged]:
    """Judge a prediction by the measurement [-]; chosen : (samples, channels), by default `Run.counted`.

    A prediction is nan where there is none, outside of all blocks: "all samples" are those that it has.
    """
    assert run.measured is not None
    counted, out = run.counted if chosen is None else chosen, []
    for c, channel in enumerate(machine.channels):
        u, y, known = counted[:, c], run.measured[:, c], np.isfinite(told.value[:, c])
        if u.sum() < 10:
            continue
        e = y[u] - told.value[u, c]
        rms = float(np.sqrt(np.mean(e**2)))
        inside = (y[u] >= told.low[u, c]) & (y[u] <= told.high[u, c])
        width = float(np.mean(told.high[u, c] - told.low[u, c])) / rms
        shares = (
            explained(y[u], told.value[u, c]),
            1.0 - float(np.var(e) / np.var(y[u])),
            explained(y[known], told.value[known, c]),
            float(inside.mean()),
        )
        out.append(Judged(run.name, channel.name, channel.unit, int(u.sum()), *shares, width, rms))
    return out


def judged(machine: Machine, some: list[tuple[Run, Prediction]]) -> list[Judged]:
    """Judge predictions of several runs, and all of them together where there are more [-]."""
    out = [row for run, told in some for row in judge(machine, run, told)]
    if len(some) < 2:
        return out
    runs, tolds = zip(*some, strict=True)
    together = {
        n: np.vstack([getattr(t, n) for t in tolds]) for n in ("value", "low", "high", "parameters", "residual")
    }
    sliding = np.vstack([t.sliding for t in tolds])
    time = np.concatenate([run.time for run in runs])
    whole = Prediction("together", time, **together, sliding=sliding)
    measured = np.vstack([run.measured for run in runs])
    counted = np.vstack([run.counted for run in runs])
    return out + judge(machine, replace(runs[0], name="together", time=time, measured=measured, counted=counted), whole)
