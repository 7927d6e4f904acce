"""Fit: maximum a posteriori of the free parameters, with residuals that are correlated in time, and what is left of the priors.

    z^ = argmin  sum_c sum_t (r_ct / s_c)^2 / n_c + |z|^2,   cov z = kappa (J^T J + 1)^-1

z : coordinates that are standard normal before the log; of several days (`Problem`) those of the machine, then what each day has
beside them, with a prior of its own in the place of 1 (`days.fit_days`)
r_ct : residual of channel c; s_c, n_c : standard deviation and samples that agree of its noise, `compute_noise`.  So n_c
neighbours count as one.  kappa >= 1 is how much more the estimates scatter when one block of time after the other is left out
than the formula says (median of what is told).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import NDArray

from crosscheck.identification.estimation.noise import Noise, compute_noise
from crosscheck.identification.machine import Machine
from crosscheck.identification.parameters import KINDS, Key
from crosscheck.identification.readings import Run, apply_bandwidth, apply_bandwidth_to_all, compute_raw_signals
from flexinv.errors import ConvergenceError, InputError
from flexinv.typing import Array

STEP = 1e-4  # of the difference quotients, in standard errors of the priors
FILTERED_TOGETHER = 2_000_000  # numbers of signals behind one call of the low-pass: 16 MB
ROUNDS = 8  # at most: the weights are known when the residuals are
SCAN = (-1.0, -0.5, 0.5, 1.0)  # of the prior's width: where stiffnesses, dampings and lengths are tried first
STEADY = 0.03  # relative change of all weights at which the rounds end: intervals change by less
CLOSE = 1e-4  # relative change of cost, and of z, at which the optimiser stops: far below the width of any interval
EVALUATIONS = 40
FAILED = 1e3  # times the residuals of the start are those where no march succeeds: no step leads there
WIDER = 10.0  # times the priors' widths: where the search looks whether they hold it at a place that leaves much
SMALLEST = 1e-2  # of its value that one step leaves of what is positive
# What is left there of a residual, if it is worth a fit of its own.  Wider priors take a half away from noise that lasts, too.
LESS = 0.3
PER_PERIOD = 4.0  # samples kept per period of the bandwidth: the low-pass leaves no news between them
# Below this part of its prior's width an interval is what the log tells: the log's own error is a third of the prior's width or
# less, and nine tenths of the information are the log's.  A prior that is wrong by two of its widths pulls an estimate by 2 r of
# the interval's standard deviations: a 90 % interval of ratio r then holds the truth with probability
# Phi((1.645 - 2 r) / (1 - r^2)^0.5): 86 % at 0.316, 77 % at 0.5, 63 % at 0.7.
TOLD = 0.1**0.5
HALF = 0.7  # below it the log tells as much as the prior: such estimates show how much blocks differ


@dataclass(frozen=True)
class Fit:
    """Parameters found.

    z : (parameters,) [-]; covariance : (parameters, parameters) of z [-]; spread, agree : (channels,) RMS residual [units of the
    channels], samples that agree [-]; block : RMS of residuals of blocks that were left out (channels,); kappa : [-]
    held : per channel those residuals (counted,); unsure : their standard deviations by the parameters without the block
    information : (parameters, parameters) of z [-] of the channels that a free gain multiplies, by that gain, and of all others
    scatter : how much friction and offsets of the day that is asked for differ from these, `days.DayFits` [-]; {}: not at all
    """

    z: Array
    covariance: Array
    spread: Array
    agree: Array
    kappa: float
    block: Array
    held: tuple[Array, ...]
    unsure: tuple[Array, ...]
    information: Mapping[Key | None, Array] = field(default_factory=dict)
    scatter: Mapping[str, float] = field(default_factory=dict)

    @property
    def identifiable(self) -> NDArray[np.bool_]:
        """(parameters,) which of them the log narrows [-]."""
        return np.sqrt(np.diag(self.covariance)) < TOLD


@dataclass(frozen=True)
class Problem:
    """Runs and the samples of them that count: chosen (samples, channels) per run; thinned by ``every`` [-].

    days : number of the day of each run; moved : numbers of the parameters that have a value of their own on each day
    z : (parameters,), or where something moves (parameters + days moved,): behind them what each day adds to those moved, in turn
    """

    machine: Machine
    runs: tuple[Run, ...]
    chosen: tuple[NDArray[np.bool_], ...]
    every: tuple[int, ...]
    days: tuple[int, ...] = ()
    moved: tuple[int, ...] = ()

    @property
    def size(self) -> int:
        """Length of z [-]."""
        return len(self.machine.space.parameters) + len(self.moved) * len(set(self.days))

    def list_day_places(self, day: int) -> slice:
        """Return the places in z of what a day adds to the parameters that move [-]."""
        first = len(self.machine.space.parameters) + day * len(self.moved)
        return slice(first, first + len(self.moved))

    def build_day_map(self, day: int) -> Array:
        """Return T (parameters, size) [-]: T z are the coordinates of the parameters on a day."""
        count = len(self.machine.space.parameters)
        out = np.eye(count, self.size)
        out[list(self.moved), np.arange(self.size)[self.list_day_places(day)]] = 1.0
        return out

    def predict(self, z: Array) -> list[Array]:
        """Return the readings (samples, channels) [units of the channels] of each run at z (size,) [-]."""
        return [
            apply_bandwidth(self.machine, *one) for one in zip(self.runs, self.compute_raw_readings(z), strict=True)
        ]

    def compute_raw_readings(self, z: Array) -> list[Array]:
        """Return the same before any low-pass of ours."""
        space = self.machine.space
        of_day = {day: self.build_day_map(day) @ z for day in set(self.days)} if self.moved else {}
        days = self.days or (0,) * len(self.runs)
        every = [space.compute_values(of_day.get(day, z), run.load) for run, day in zip(self.runs, days, strict=True)]
        return [
            compute_raw_signals(self.machine, run.motion, run.response, values)
            for run, values in zip(self.runs, every, strict=True)
        ]

    def collect_counted_samples(self, arrays: list[Array]) -> list[Array]:
        """Return of each channel the samples that count, of all runs one after the other, (counted,) [any unit]."""
        out = []
        for c in range(len(self.machine.channels)):
            parts = [a[::e, c][k[::e, c]] for a, k, e in zip(arrays, self.chosen, self.every, strict=True)]
            out.append(np.concatenate(parts))
        return out


def build_problem(
    machine: Machine,
    runs: tuple[Run, ...],
    chosen: tuple[NDArray[np.bool_], ...] | None = None,
    days: tuple[int, ...] = (),
    moved: tuple[int, ...] = (),
) -> Problem:
    """Return runs [s] with the samples that count, by default those of the window in which the joints slide.

    days, moved : as `Problem` has them
    """
    counted = tuple(run.counted for run in runs) if chosen is None else chosen
    every = tuple(
        max(1, int(1.0 / (PER_PERIOD * machine.settings.bandwidth_Hz * (run.time[1] - run.time[0])))) for run in runs
    )
    problem = Problem(machine, runs, counted, every, days, moved)
    for channel, values in zip(
        machine.channels, problem.collect_counted_samples([np.zeros(c.shape) for c in counted]), strict=True
    ):
        if len(values) < 10:
            raise InputError(
                f"{', '.join(r.name for r in runs)}: {channel.name} has {len(values)} samples that count, expected 10 or more: "
                f"{channel.place} hardly moves, or window_s leaves it out; write a wider window, or no effort of this joint"
            )
    return problem


def fit(task: Problem, start: Array | None = None, prior: tuple[Array, Array] | None = None) -> Fit:
    """Return the parameters under which the readings come closest to what was measured, weighed against the priors [-].

    start : z (size,); prior : mean and square root of the precision (size, size) in the place of 0 and 1

    Noise is what is left at the fit.  Far from the truth much is left, which then counts for little against the priors, and the
    search would stay; what is positive has hardly a slope where it is far too small.  So the search goes on in values, then with
    priors that are wider, and where that leaves less, it begins again from there.
    """
    count = task.size
    mean, root = (np.zeros(count), np.eye(count)) if prior is None else prior
    measured = task.collect_counted_samples([_read_measured(run) for run in task.runs])
    if start is not None:
        return _compute_posterior(task, _find_mode(task, measured, start.copy(), mean, root), root)
    near = _find_mode(task, measured, _find_start_by_scan(task, measured, np.zeros(count)), mean, root)
    moved = _move_in_values(task, measured, near, root)
    try:
        far = _find_minimum(_KeptSlopes(task), measured, 1.0 / near.noise.spread, moved, mean, root / WIDER)
    except ConvergenceError:  # no machine moves like that: what is known before does not hold it there
        return _compute_posterior(task, near, root)
    left = np.array([np.sqrt(np.mean(r**2)) for r in _compute_residuals(task, measured, far)])
    if (left < LESS * near.noise.spread).any():
        other = _find_mode(task, measured, far, mean, root)
        near = min(near, other, key=lambda mode: mode.compute_cost(other.noise.agree, mean, root))
    return _compute_posterior(task, near, root)


@dataclass(frozen=True)
class _Mode:
    """Parameters z of least cost (parameters,) [-], slopes (counted, parameters) per channel, and the noise that is left."""

    z: Array
    slopes: list[Array]
    noise: Noise

    def compute_cost(self, agree: Array, mean: Array, root: Array) -> float:
        """Return twice the negative logarithm of the posterior [-]; agree : samples that count as one (channels,)."""
        counted = np.array([len(j) for j in self.slopes])
        return float(np.sum(counted / agree * np.log(self.noise.spread**2)) + np.sum((root @ (self.z - mean)) ** 2))


def _find_mode(task: Problem, measured: list[Array], z: Array, mean: Array, root: Array) -> _Mode:
    """The parameters of least cost near z (parameters,) [-], found with the noise that they leave in turn."""
    noise = compute_noise(_compute_residuals(task, measured, z), [np.zeros((len(m), len(z))) for m in measured], root)
    kept = _KeptSlopes(task)
    for _ in range(ROUNDS):
        z = _find_minimum(kept, measured, noise.weight, z, mean, root)
        slopes = kept.compute_at(z)
        last = noise.weight
        noise = compute_noise(_compute_residuals(task, measured, z), slopes, root)
        if np.abs(noise.weight / last - 1.0).max() < STEADY:
            break
    return _Mode(z, slopes, noise)


def _find_start_by_scan(task: Problem, measured: list[Array], z: Array) -> Array:
    """A start beyond valleys: natural frequencies that pass one of the motion's make the cost of stiffnesses rough.

    A candidate whose march fails is none.  Raises InputError where all of them fail.
    """
    failed: list[str] = []

    def compute_cost(x: Array) -> float:
        try:
            told = task.collect_counted_samples(task.predict(x))
        except ConvergenceError as error:
            failed.append(str(error).partition("; write")[0])  # its advice is for another command
            return np.inf
        cost = float(sum(np.log(np.mean((m - p) ** 2)) for m, p in zip(measured, told, strict=True)))
        return np.inf if np.isnan(cost) else cost

    least = compute_cost(z)
    for k, parameter in enumerate(task.machine.space.parameters):
        if not KINDS[parameter.kind].solved:
            continue
        center = z.copy()
        for step in SCAN:
            tried = center.copy()
            tried[k] += step
            cost = compute_cost(tried)
            if cost < least:
                z = tried
                least = cost
    if least == np.inf:
        first = failed[0] if failed else "its readings are no numbers"
        raise InputError(
            f"{', '.join(run.name for run in task.runs)}: the machine cannot be marched along the log, neither with what was "
            f"known before nor with other stiffnesses, dampings or lengths ({first}); write "
            f"every = {2 * (task.machine.settings.every or 1)} or more (steps per sample), a smaller motion_Hz, initial = "
            '"static", or better values of [[free]] into identify.toml'
        )
    return z


def _compute_residuals(task: Problem, measured: list[Array], z: Array) -> list[Array]:
    return [m - p for m, p in zip(measured, task.collect_counted_samples(task.predict(z)), strict=True)]


def _read_measured(run: Run) -> Array:
    if run.measured is None:
        raise InputError(f"{run.name}: it was read without its efforts, and nothing can be fitted to it")
    return run.measured


def compute_jacobian(task: Problem, z: Array) -> list[Array]:
    """Return the derivatives by z of what `Problem.collect_counted_samples` gives, (counted, size) [units of channels].

    What a day adds to a parameter changes that day's runs, by as much as the parameter does: it needs no reading of its own.
    """
    level = task.compute_raw_readings(z)
    count = len(task.machine.space.parameters)
    together = max(1, FILTERED_TOGETHER // max(sum(one.size for one in level), 1))
    columns: list[list[Array]] = []
    for first in range(0, count, together):
        slopes = [_compute_slopes(task, z, k, level) for k in range(first, min(first + together, count))]
        of_runs = zip(task.runs, zip(*slopes, strict=True), strict=True)
        passed = [apply_bandwidth_to_all(task.machine, run, signals) for run, signals in of_runs]
        columns.extend(task.collect_counted_samples(list(of_parameter)) for of_parameter in zip(*passed, strict=True))
    whole = [np.column_stack([c[channel] for c in columns]) for channel in range(len(task.machine.channels))]
    if not task.moved:
        return whole
    number = task.collect_counted_samples(_list_day_numbers(task))
    days = range(len(set(task.days)))
    return [
        np.hstack([j, *(j[:, list(task.moved)] * (day_number == day)[:, None] for day in days)])
        for j, day_number in zip(whole, number, strict=True)
    ]


def _compute_slopes(task: Problem, z: Array, k: int, level: list[Array]) -> list[Array]:
    """Derivatives of the raw readings of each run by coordinate k, (samples, channels) [units of channels]."""
    ahead = z.copy()
    ahead[k] += STEP
    return [(a - b) / STEP for a, b in zip(task.compute_raw_readings(ahead), level, strict=True)]


def _list_day_numbers(task: Problem) -> list[Array]:
    """(samples, channels) per run, the number of its day."""
    return [np.full(c.shape, float(day)) for c, day in zip(task.chosen, task.days, strict=True)]


class _KeptSlopes:
    """The slopes of a task where they were asked for last: a search begins with those at which the one before has ended."""

    def __init__(self, task: Problem) -> None:
        self.task = task
        self._last: tuple[Array, list[Array]] | None = None

    def compute_at(self, z: Array) -> list[Array]:
        """The `compute_jacobian` at z (size,) [-], (counted, size) [units of channels]."""
        if self._last is None or not np.array_equal(self._last[0], z):
            self._last = z.copy(), compute_jacobian(self.task, z)
        return self._last[1]


def _find_minimum(kept: _KeptSlopes, measured: list[Array], weight: Array, z: Array, mean: Array, root: Array) -> Array:
    """The parameters of least cost; a step to where the machine cannot be marched along the log is too long.

    Raises ConvergenceError where it cannot be at the start either.
    """
    first: list[Array] = []

    def compute_residual(x: Array) -> Array:
        try:
            residuals = _compute_residuals(kept.task, measured, x)
        except ConvergenceError:
            if not first:
                raise
            return FAILED * first[0]
        parts = [-w * r for w, r in zip(weight, residuals, strict=True)]
        out = np.concatenate([*parts, root @ (x - mean)])
        first[:] = first or [out]
        return out

    def compute_scaled_jacobian(x: Array) -> Array:
        return np.vstack([*(w * j for w, j in zip(weight, kept.compute_at(x), strict=True)), root])

    found = scipy.optimize.least_squares(
        compute_residual, z, compute_scaled_jacobian, method="lm", ftol=CLOSE, xtol=CLOSE, max_nfev=EVALUATIONS
    )
    return np.asarray(found.x)


def _move_in_values(task: Problem, measured: list[Array], mode: _Mode, root: Array) -> Array:
    """The z (size,) [-] of a step of least squares in the values of what is positive, which stay so, and in z of the rest.

    Readings are linear in friction, rotors and gains: far from the truth the step in values is right where one in logarithms is
    not.  Widths of the priors, `WIDER` times, hold what the logs do not tell.
    """
    parameters = task.machine.space.parameters
    scale = np.ones(task.size)  # d value / d z, of what is stepped in values
    least = np.full(task.size, -np.inf)
    width = WIDER / np.diag(root)
    for k, one in enumerate(parameters):
        if one.positive and not KINDS[one.kind].solved:
            value = one.compute_value(float(mode.z[k]))
            scale[k] = one.error * value
            least[k] = (SMALLEST - 1.0) * value
            width[k] = WIDER * max(value, one.compute_value(1.0))
    weight = 1.0 / mode.noise.spread
    rows = [w * j / scale for w, j in zip(weight, mode.slopes, strict=True)]
    left = [w * r for w, r in zip(weight, _compute_residuals(task, measured, mode.z), strict=True)]
    matrix = np.vstack([*rows, np.diag(1.0 / width)])
    right = np.concatenate([*left, np.zeros(task.size)])
    q, r = np.linalg.qr(matrix * width)
    step = width * scipy.optimize.lsq_linear(r, q.T @ right, (least / width, np.inf)).x
    moved = mode.z + step / scale
    for k, one in enumerate(parameters):
        if np.isfinite(least[k]):
            moved[k] = np.log((one.compute_value(float(mode.z[k])) + step[k]) / one.known) / one.error
    return np.asarray(moved)


def _compute_posterior(task: Problem, mode: _Mode, root: Array) -> Fit:
    z = mode.z
    slopes = mode.slopes
    noise = mode.noise
    residual = _compute_residuals(task, task.collect_counted_samples([_read_measured(r) for r in task.runs]), z)
    scaled = [w * j for w, j in zip(noise.weight, slopes, strict=True)]
    errors = [w * r for w, r in zip(noise.weight, residual, strict=True)]
    hessian = sum((j.T @ j for j in scaled), root.T @ root)
    label = task.collect_counted_samples([_list_block_numbers(task, run) for run in task.runs])
    base = np.linalg.inv(hessian)
    left_out, held, unsure = _solve_without_blocks(scaled, errors, label, hessian)
    scatter = (len(left_out) - 1) * np.var(left_out, axis=0)
    ratio = scatter / np.diag(base)
    told_of = np.sqrt(np.diag(base)) < HALF * np.sqrt(np.diag(np.linalg.inv(root.T @ root)))
    kappa = float(max(1.0, np.median(ratio[told_of]))) if told_of.any() and len(left_out) > 2 else 1.0
    weighted = [h / w for h, w in zip(held, noise.weight, strict=True)]
    sides = [np.sqrt(kappa * u) / w for u, w in zip(unsure, noise.weight, strict=True)]
    block = np.array([np.sqrt(np.mean(h**2)) for h in weighted])
    information = _collect_by_gain(task, [j.T @ j / kappa for j in scaled])
    covariance = _scale_covariance(base, kappa, root)
    return Fit(z, covariance, noise.spread, noise.agree, kappa, block, tuple(weighted), tuple(sides), information)


def _collect_by_gain(task: Problem, parts: list[Array]) -> dict[Key | None, Array]:
    """The information of channels (parameters, parameters), summed over those that a free gain multiplies, and all others."""
    free = {one.key for one in task.machine.space.parameters}
    out: dict[Key | None, Array] = {}
    for channel, part in zip(task.machine.channels, parts, strict=True):
        gain = (f"{channel.sense} gain", channel.place)
        key = gain if gain in free else None
        out[key] = out.get(key, np.zeros_like(part)) + part
    return out


def _scale_covariance(base: Array, kappa: float, root: Array) -> Array:
    """The covariance times kappa, in no direction wider than before the log: kappa and 1 where both are diagonal."""
    values, vectors = np.linalg.eigh(root @ base @ root.T)
    inner = vectors * np.minimum(1.0, kappa * values) @ vectors.T
    back = np.linalg.inv(root)
    return np.asarray(back @ inner @ back.T)


def _list_block_numbers(task: Problem, run: Run) -> Array:
    """(samples, channels) number of the block of time that a sample belongs to."""
    number = np.floor((run.time - run.time[0]) / task.machine.settings.block_s) + 1e6 * task.runs.index(run)
    return np.repeat(number[:, None], len(task.machine.channels), axis=1)


def _solve_without_blocks(
    scaled: list[Array], errors: list[Array], label: list[Array], hessian: Array
) -> tuple[Array, list[Array], list[Array]]:
    """z without each block, less z (blocks, parameters); residuals of each block under the others' parameters, with variances.

    One Gauss-Newton step: (H - J_b^T J_b) dz = -J_b^T r_b;  variance J_b (H - J_b^T J_b)^-1 J_b^T.
    """
    moved = []
    held = [np.zeros_like(e) for e in errors]
    unsure = [np.zeros_like(e) for e in errors]
    for block in np.unique(np.concatenate(label)):
        rows = [k == block for k in label]
        inside = [j[r] for j, r in zip(scaled, rows, strict=True)]
        pull = sum((j.T @ e[r] for j, e, r in zip(inside, errors, rows, strict=True)), np.zeros(len(hessian)))
        without = np.linalg.inv(hessian - sum((j.T @ j for j in inside), np.zeros_like(hessian)))
        step = -without @ pull
        moved.append(step)
        for h, u, e, j, r in zip(held, unsure, errors, inside, rows, strict=True):
            h[r] = e[r] - j @ step
            u[r] = np.einsum("tp,pq,tq->t", j, without, j)
    return np.array(moved), held, unsure
