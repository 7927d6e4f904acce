"""Bands of predicted readings, and how often they hold: parameter and residual uncertainty apart, measured on blocks left out.

sd^2 = J cov J^T (parameters) + s(v)^2 (residuals) + coulomb^2 (a joint that stands)
s(v)^2 = a + b / (1 + (v / v_0)^2),   v the rate of the channel's joint; of all other sensors a alone
day^2 = (w_v viscous v)^2 + (w_c dry)^2 + (w_o coulomb)^2 + (w_g y)^2,   w of `days.DayFits`, of a day that did not identify
y : the reading, where its gain is free; of a day that identified day = 0
band = value +- (q^2 sd^2 + 1.645^2 day^2)^0.5,   q such that `HOLD` of the residuals of blocks left out lie inside, and at most
`WIDEST` of their RMS

Friction that turns round leaves more than the model knows.  A log whose joints are slower or faster than those that identified
has another mix of that, so s(v) is told by the residuals of blocks left out: the a and b of the largest likelihood of normal
residuals, beside J cov J^T of the others' parameters, with the best of some v_0.  Where one s for all rates is as likely, b = 0.

The most is that of a usual sd (`USUAL`): where a joint nearly stands its band is wider, and no reason for narrow ones elsewhere.
Each residual left out is held against its own sd, with the larger cov of the parameters that have not seen its block.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import NDArray

from crosscheck.identification.drives.efforts import compute_channel_rate, compute_friction_reading
from crosscheck.identification.estimation.days import DRY, GAIN, OFFSET, VISCOUS
from crosscheck.identification.estimation.fit import STEP, Fit, Problem
from crosscheck.identification.filters import low_pass
from crosscheck.identification.machine import Channel, Machine, has_friction
from crosscheck.identification.parameters import Values
from crosscheck.identification.readings import Run, apply_bandwidth_to_all, compute_raw_signals, compute_readings
from flexinv.typing import Array

NOMINAL = 0.9
HOLD = 0.94  # of residuals left out, more than promised: another run differs by more than a block does
WIDEST = 2.0  # half width of 95 % of a normal distribution: more would be a band that says nothing
USUAL = 0.6  # of the samples have at most the sd that is meant by it: where a joint nearly stands it is wider
NORMAL = 1.6448536269514722  # half width of 90 % of a normal distribution, in standard deviations
TURNS = 6  # rates v_0 that are tried: so many steps of 2 from that below which a joint stands
# of the mean square: where a and b stop
LEAST = 1e-4
MOST = 1e2
MORE = 2  # numbers that s(v) has beside a constant: each is worth 2 of the cost (Akaike), neighbours that agree count as one


@dataclass(frozen=True)
class Prediction:
    """Readings of a log that need no effort of it.

    time : (samples,) [s]; value, low, high : (samples, channels) [units of the channels]
    parameters, residual, day : (samples, channels) standard deviations by their cause; sliding : (samples, channels)
    """

    name: str
    time: Array
    value: Array
    low: Array
    high: Array
    parameters: Array
    residual: Array
    day: Array
    sliding: NDArray[np.bool_]


@dataclass(frozen=True)
class Scatter:
    """Standard deviation of what remains of a channel, by the rate of its joint.

    steady, near : a, b [square of the channel's unit]; turn : v_0 [rad/s], [m/s]
    """

    steady: float
    near: float = 0.0
    turn: float = 1.0

    def evaluate_scatter(self, rate: Array) -> Array:
        """Return s [unit of the channel] at rates (samples,) [rad/s], [m/s]."""
        return np.asarray(np.sqrt(_compute_rate_shapes(rate, self.turn) @ [self.steady, self.near]))


def _compute_rate_shapes(rate: Array, turn: float) -> Array:
    return np.column_stack([np.ones_like(rate), 1.0 / (1.0 + (rate / turn) ** 2)])


def fit_scatter(rate: Array, held: Array, unsure: Array, agree: float, slowest: float) -> Scatter | None:
    """Return the scatter of the largest likelihood of residuals held (samples,) [unit of the channel], None if one s does.

    rate : (samples,) [rad/s], [m/s]; unsure : their standard deviations by the parameters; agree : samples that count as one [-]
    slowest : the first v_0 [rad/s], [m/s]
    """
    top = float(np.mean(held**2))
    if top == 0.0:
        return None
    turns = slowest * 2.0 ** np.arange(TURNS)
    laws = [
        (*_find_likeliest_scatter(_compute_rate_shapes(rate, turn) * top, held, unsure), float(turn)) for turn in turns
    ]
    cost, (steady, near), turn = min(laws, key=lambda law: law[0])
    alone = _find_likeliest_scatter(np.full((len(held), 1), top), held, unsure)[0]
    if (alone - cost) / agree < 2.0 * MORE:
        return None
    return Scatter(float(top * steady), float(top * near), turn)


def _find_likeliest_scatter(shapes: Array, held: Array, unsure: Array) -> tuple[float, Array]:
    """Twice the least negative logarithm of the likelihood [-], and the parts of the shapes (samples, parts)."""

    def compute_cost(x: Array) -> tuple[float, Array]:
        parts = shapes * np.exp(x)
        variance = unsure**2 + parts.sum(axis=1)
        return float(np.sum(np.log(variance) + held**2 / variance)), (1.0 / variance - held**2 / variance**2) @ parts

    count = shapes.shape[1]
    found = scipy.optimize.minimize(
        compute_cost, np.zeros(count), jac=True, bounds=[(np.log(LEAST), np.log(MOST))] * count
    )
    return float(found.fun), np.exp(found.x)


@dataclass(frozen=True)
class Margins:
    """Margins of predictions: q (channels,) [-], and the scatter of each channel."""

    factor: Array
    scatters: tuple[Scatter, ...]


def predict(machine: Machine, fit: Fit, margin: Margins, run: Run) -> Prediction:
    """Return readings with 90 % bands [units of the channels] of a run; margin : of `compute_margins`."""
    value = compute_readings(machine, run, machine.space.compute_values(fit.z, run.load))
    parameter_scatter = _compute_parameter_scatter(machine, fit, run)
    left = np.column_stack(
        [s.evaluate_scatter(v) for s, v in zip(margin.scatters, _compute_channel_rates(machine, run).T, strict=True)]
    )
    rest = np.sqrt(left**2 + _compute_standing_scatter(machine, fit, run) ** 2)
    day = _compute_day_scatter(machine, fit, run, value)
    half = np.sqrt(margin.factor**2 * (parameter_scatter**2 + rest**2) + NORMAL**2 * day**2)
    return Prediction(run.name, run.time, value, value - half, value + half, parameter_scatter, rest, day, run.sliding)


def compute_margins(task: Problem, fit: Fit) -> Margins:
    """Return the scatter of each channel, and q [-] with which `HOLD` of the residuals of blocks left out lie inside."""
    machine = task.machine
    rates = task.collect_counted_samples([_compute_channel_rates(machine, run) for run in task.runs])
    extra = task.collect_counted_samples([_compute_standing_scatter(machine, fit, run) for run in task.runs])
    out = []
    factor = []
    for c, (channel, rate, more) in enumerate(zip(machine.channels, rates, extra, strict=True)):
        held = fit.held[c]
        unsure = fit.unsure[c]
        slowest = machine.settings.still_rad_per_s
        known = has_friction(machine, channel) and slowest > 0.0
        law = fit_scatter(rate, held, unsure, float(fit.agree[c]), slowest) if known else None
        out.append(law or Scatter(float(fit.spread[c] ** 2)))
        sd = np.sqrt(unsure**2 + out[-1].evaluate_scatter(rate) ** 2 + more**2)
        widest = WIDEST * fit.block[c] / float(np.quantile(sd, USUAL))
        factor.append(min(float(np.quantile(np.abs(held) / sd, HOLD)), widest))
    return Margins(np.array(factor), tuple(out))


def _compute_channel_rates(machine: Machine, run: Run) -> Array:
    """Rates without sign (samples, channels) [rad/s], [m/s] of the joints of efforts, of one that stands the least; else 0."""
    rate = np.zeros((len(run.time), len(machine.channels)))
    for c, channel in enumerate(machine.channels):
        if has_friction(machine, channel):
            joint_rate = np.abs(compute_channel_rate(machine, run.motion, channel))
            rate[:, c] = np.maximum(
                joint_rate, machine.settings.still_rad_per_s
            )  # slower ones were not counted: nothing is told of them
    return rate


def _compute_parameter_scatter(machine: Machine, fit: Fit, run: Run) -> Array:
    slopes = []
    level = compute_raw_signals(machine, run.motion, run.response, machine.space.compute_values(fit.z, run.load))
    for k in range(len(fit.z)):  # one prediction each; those of sensors and friction solve nothing anew
        ahead = fit.z.copy()
        ahead[k] += STEP
        raw = compute_raw_signals(machine, run.motion, run.response, machine.space.compute_values(ahead, run.load))
        slopes.append((raw - level) / STEP)
    j = np.stack(apply_bandwidth_to_all(machine, run, slopes), axis=-1)
    variance = np.einsum("tcp,pq,tcq->tc", j, fit.covariance, j, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _compute_standing_scatter(machine: Machine, fit: Fit, run: Run) -> Array:
    """Scatter of what a joint holds while it stands, (samples, channels)."""
    values = machine.space.compute_values(fit.z, run.load)
    still = machine.settings.still_rad_per_s
    spacing = float(run.time[1] - run.time[0])
    out = np.zeros((len(run.time), len(machine.channels)))
    for c, channel in enumerate(machine.channels):
        if has_friction(machine, channel):
            stands = (np.abs(compute_channel_rate(machine, run.motion, channel)) <= still).astype(float)
            part = np.clip(low_pass(stands, spacing, machine.settings.bandwidth_Hz), 0.0, 1.0)
            out[:, c] = part * _compute_dry_reading(machine, channel, values) / NORMAL
    return out


def _compute_day_scatter(machine: Machine, fit: Fit, run: Run, reading: Array) -> Array:
    """Standard deviation of what friction, offsets and gains of another day change of readings, (samples, channels)."""
    values = machine.space.compute_values(fit.z, run.load)
    out = np.zeros((len(run.time), len(machine.channels)))
    for c, channel in enumerate(machine.channels):
        if has_friction(machine, channel) and fit.scatter:
            rate = compute_channel_rate(machine, run.motion, channel, values)
            load = run.response(values)[0][:, run.motion.names.index(channel.place)]
            whole = compute_friction_reading(machine, channel, rate, values, load)
            other = values | {(VISCOUS, channel.place): 0.0}
            viscous = whole - compute_friction_reading(machine, channel, rate, other, load)
            offset = fit.scatter[OFFSET] * _compute_dry_reading(machine, channel, values)
            square = (fit.scatter[VISCOUS] * viscous) ** 2 + (fit.scatter[DRY] * (whole - viscous)) ** 2
            out[:, c] = np.sqrt(square + offset**2)
        if (GAIN, channel.place) in values and channel.sense == "effort":
            out[:, c] = np.hypot(out[:, c], fit.scatter.get(GAIN, 0.0) * reading[:, c])
    return out


def _compute_dry_reading(machine: Machine, channel: Channel, values: Values) -> float:
    """The friction of a joint that just slides, as its sensor reads it [unit of the channel]."""
    still = np.array([machine.settings.still_rad_per_s])
    return float(np.abs(compute_friction_reading(machine, channel, still, values))[0])


@dataclass(frozen=True)
class ChannelJudgement:
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


def compute_explained_share(measured: Array, told: Array) -> float:
    """Return ``1 - sum(e^2) / sum((y - mean y)^2)`` [-]; the mean of e counts.  measured, told : (samples,) [any unit]"""
    return float(1.0 - np.sum((measured - told) ** 2) / np.sum((measured - measured.mean()) ** 2))


def judge(
    machine: Machine, run: Run, prediction: Prediction, chosen: NDArray[np.bool_] | None = None
) -> list[ChannelJudgement]:
    """Judge a prediction by the measurement [-]; chosen : (samples, channels), by default `Run.counted`.

    A prediction is nan where there is none, outside of all blocks: "all samples" are those that it has.
    """
    assert run.measured is not None
    counted = run.counted if chosen is None else chosen
    out = []
    for c, channel in enumerate(machine.channels):
        u = counted[:, c]
        y = run.measured[:, c]
        known = np.isfinite(prediction.value[:, c])
        if u.sum() < 10:
            continue
        e = y[u] - prediction.value[u, c]
        rms = float(np.sqrt(np.mean(e**2)))
        inside = (y[u] >= prediction.low[u, c]) & (y[u] <= prediction.high[u, c])
        width = float(np.mean(prediction.high[u, c] - prediction.low[u, c])) / rms
        shares = (
            compute_explained_share(y[u], prediction.value[u, c]),
            1.0 - float(np.var(e) / np.var(y[u])),
            compute_explained_share(y[known], prediction.value[known, c]),
            float(inside.mean()),
        )
        out.append(ChannelJudgement(run.name, channel.name, channel.unit, int(u.sum()), *shares, width, rms))
    return out


def judge_predictions(machine: Machine, some: list[tuple[Run, Prediction]]) -> list[ChannelJudgement]:
    """Judge predictions of several runs, and all of them together where there are more [-]."""
    out = [row for run, told in some for row in judge(machine, run, told)]
    if len(some) < 2:
        return out
    runs, tolds = zip(*some, strict=True)
    together = {
        n: np.vstack([getattr(t, n) for t in tolds]) for n in ("value", "low", "high", "parameters", "residual", "day")
    }
    sliding = np.vstack([t.sliding for t in tolds])
    time = np.concatenate([run.time for run in runs])
    whole = Prediction("together", time, **together, sliding=sliding)
    measured = np.vstack([run.measured for run in runs])
    counted = np.vstack([run.counted for run in runs])
    return out + judge(machine, replace(runs[0], name="together", time=time, measured=measured, counted=counted), whole)
