"""Evidence for a term that a model lacks: how much better blocks of time are told that were left out.

    gain = 1/2 sum_c N_c / n_c log(P_c without / P_c with),   P_c : sum of squares of the residuals left out of channel c

Each part of the logs is left out in turn, and parameters and term are told by the others: parameters z with their priors, sizes b
of the term without any,

    (z - z^, b) = argmin  sum_c w_c^2 |r_c - J_c (z - z^) - X_c b|^2 + |R z|^2,   w_c = 1 / (s_c n_c^0.5)

N_c / n_c samples are news: neighbours that agree under the larger model count as one.  The gain is a difference of logarithms of
likelihoods.  A criterion of information would need the number of parameters, which priors hold in part, and samples that are
independent; parts of the logs that nobody has fitted to need neither.  Where a term is not there, twice its gain is about
chi^2 - 2 of its numbers: for one number chance passes `EVIDENCE` once in five thousand.

Source: A. Vehtari, J. Ojanen, "A survey of Bayesian predictive methods for model assessment, selection and comparison",
Statistics Surveys 6 (2012), for the gain and its standard error over the parts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.identification.estimation.days import DayFits, compute_day_deviations
from crosscheck.identification.estimation.fit import Fit, Problem, compute_jacobian
from crosscheck.identification.estimation.noise import count_agreeing_samples
from crosscheck.identification.filters import apply_low_pass_all
from crosscheck.identification.machine import Machine
from crosscheck.identification.readings import Run, apply_bandwidth, compute_readings
from flexinv.typing import Array

EVIDENCE = 6.0  # gain that chance does not give: half of what a cause of a log needs, which is twice a logarithm
SURE = 3.0  # standard errors that a size has to be from 0: where parts are told badly the gain is none of the term
FOLDS = 10  # parts of the logs, at most: more tell the same
TINY = 1e-300  # no part is told better
HELD = 1e-9  # precision of the sizes of a term in units of its effect: next to nothing holds them
Signals = Callable[[Run], Array]


@dataclass(frozen=True)
class Terms:
    """Residuals that identified, weighed, and what parameters make of them.

    z : (size,) of machine and days [-]; root : square root of the precision before the logs (size, size)
    slopes, residuals, parts : per channel (counted, size) and (counted,) [-], number of the part of the logs
    weights : 1 / (s n^0.5) (channels,) [1 / unit of the channel]; held : residuals left out (counted,) per channel [-]
    """

    task: Problem
    z: Array
    root: Array
    slopes: tuple[Array, ...]
    residuals: tuple[Array, ...]
    parts: tuple[Array, ...]
    weights: Array
    held: tuple[Array, ...] = ()

    @property
    def machine(self) -> Machine:
        """The machine whose logs they are."""
        return self.task.machine


@dataclass(frozen=True)
class TermEvidence:
    """Evidence for a term: gain, its error as parts of the logs differ in it [-], sizes and errors [unit of each]."""

    gain: float
    error: float
    sizes: Array
    errors: Array

    @property
    def is_told(self) -> bool:
        """True where neither chance nor a single part of the logs makes the gain, and a size is no error."""
        return self.gain > max(EVIDENCE, self.error) and bool((np.abs(self.sizes) > SURE * self.errors).any())


def build_terms(task: Problem, days: DayFits) -> Terms:
    """Return the residuals of the logs that identified [-], with what the parameters of machine and days can make up for."""
    machine = task.machine
    found = days.own[0] if len(days.own) == 1 else days.machine
    moved = list(task.moved)
    of_days = [fit.z - found.z for fit in days.own] if moved else []
    z = np.concatenate([found.z, *(one[moved] for one in of_days)])
    deviations = compute_day_deviations(machine, found.z, days.widths)
    root = np.concatenate([np.ones(len(found.z)), *(1.0 / deviations[moved] for _ in of_days)])
    weights = 1.0 / (found.spread * np.sqrt(found.agree))
    left = [_compute_residual(task, run, days.own[day]) for run, day in zip(task.runs, task.days, strict=True)]
    residuals = [w * r for w, r in zip(weights, task.collect_counted_samples(left), strict=True)]
    slopes = [w * j for w, j in zip(weights, compute_jacobian(task, z), strict=True)]
    parts = task.collect_counted_samples([_list_parts(task, run) for run in task.runs])
    terms = Terms(task, z, np.diag(root), tuple(slopes), tuple(residuals), tuple(parts), weights)
    return _fill_held_residuals(terms)


def _compute_residual(task: Problem, run: Run, fit: Fit) -> Array:
    """The residual of a run (samples, channels) [units of the channels] under the parameters of its day."""
    assert run.measured is not None
    return run.measured - compute_readings(task.machine, run, task.machine.space.compute_values(fit.z, run.load))


def _list_parts(task: Problem, run: Run) -> Array:
    """(samples, channels) number of the part of the logs that a sample belongs to: blocks of time, at most `FOLDS` of a log."""
    length = max(task.machine.settings.block_s, (run.time[-1] - run.time[0]) / FOLDS)
    number = np.floor((run.time - run.time[0]) / length) + 2.0 * FOLDS * task.runs.index(run)
    return np.repeat(number[:, None], len(task.machine.channels), axis=1)


def compute_columns(terms: Terms, signals: Signals) -> list[Array]:
    """Return the columns (counted, numbers) [-] per channel of signals of a run (samples, channels, numbers) [units of channels].

    Signals are those of sensors before any low-pass of ours.
    """
    raw = [signals(run) for run in terms.task.runs]
    out: list[list[Array]] = [[] for _ in terms.weights]
    for k in range(raw[0].shape[2]):
        passed = [
            apply_bandwidth(terms.machine, run, one[:, :, k]) for run, one in zip(terms.task.runs, raw, strict=True)
        ]
        for c, values in enumerate(terms.task.collect_counted_samples(passed)):
            out[c].append(terms.weights[c] * values)
    return [np.column_stack(columns) for columns in out]


def compute_channel_columns(terms: Terms, c: int, signals: Signals) -> Array:
    """Return the columns (counted, numbers) [-] of signals of one channel (samples, numbers) [unit of the channel]."""
    bandwidth = terms.machine.settings.bandwidth_Hz
    parts = []
    for run, chosen, every in zip(terms.task.runs, terms.task.chosen, terms.task.every, strict=True):
        passed = apply_low_pass_all(signals(run), float(run.time[1] - run.time[0]), bandwidth)
        parts.append(passed[::every][chosen[::every, c]])
    return np.asarray(terms.weights[c] * np.concatenate(parts))


def fill_other_channels(terms: Terms, c: int, columns: Array) -> list[Array]:
    """Return columns (counted, numbers) [-] of one channel beside zeros of all others."""
    return [columns if k == c else np.zeros((len(r), columns.shape[1])) for k, r in enumerate(terms.residuals)]


def add_columns(terms: Terms, columns: Sequence[Array]) -> Terms:
    """Return the same with a term that is believed: its sizes are parameters that nothing holds [-]."""
    count = columns[0].shape[1]
    scale = _compute_scale(columns)
    slopes = tuple(np.hstack([j, x / scale]) for j, x in zip(terms.slopes, columns, strict=True))
    root = np.zeros((len(terms.z) + count,) * 2)
    root[: len(terms.z), : len(terms.z)] = terms.root
    root[len(terms.z) :, len(terms.z) :] = np.sqrt(HELD) * np.eye(count)
    wider = replace(terms, z=np.concatenate([terms.z, np.zeros(count)]), root=root, slopes=slopes)
    return _update_weights(_fill_held_residuals(wider))


def _update_weights(terms: Terms) -> Terms:
    """The same with channels that weigh by what is left of them: a term that was missing was no noise."""
    factors = [1.0 / np.sqrt(np.mean(h**2) * count_agreeing_samples(h)) for h in terms.held]
    slopes = tuple(f * j for f, j in zip(factors, terms.slopes, strict=True))
    residuals = tuple(f * r for f, r in zip(factors, terms.residuals, strict=True))
    changed = replace(terms, slopes=slopes, residuals=residuals, weights=np.array(factors) * terms.weights)
    return _fill_held_residuals(changed)


def drop_parameter(terms: Terms, k: int, absent: float) -> Terms:
    """Return the same without parameter k, which stays at ``absent`` [-]."""
    kept = [n for n in range(len(terms.z)) if n != k]
    change = float(terms.z[k]) - absent
    residuals = tuple(r + change * j[:, k] for r, j in zip(terms.residuals, terms.slopes, strict=True))
    slopes = tuple(j[:, kept] for j in terms.slopes)
    smaller = replace(terms, z=terms.z[kept], root=terms.root[np.ix_(kept, kept)], slopes=slopes, residuals=residuals)
    return _update_weights(_fill_held_residuals(smaller))


def judge_term(terms: Terms, columns: Sequence[Array]) -> TermEvidence:
    """Return the evidence for a term of the columns (counted, numbers) [-] of each channel."""
    wider = add_columns(terms, columns)
    gain = 0.0
    by_part: dict[float, float] = {}
    for c, (without, held) in enumerate(zip(terms.held, wider.held, strict=True)):
        beside = held * (terms.weights[c] / wider.weights[c])
        news = 1.0 / count_agreeing_samples(beside)
        before = float(without @ without)
        after = float(beside @ beside)
        gain += 0.5 * len(beside) * news * np.log(before / after)
        for part in np.unique(terms.parts[c]):
            rows = terms.parts[c] == part
            better = float(np.sum(without[rows] ** 2 - beside[rows] ** 2))
            by_part[part] = by_part.get(part, 0.0) + news * better / after
    less = np.array(list(by_part.values()))
    error = abs(gain) * float(np.sqrt(len(less)) * np.std(less) / max(abs(less.sum()), TINY))
    change, covariance = solve_terms(wider)
    count = columns[0].shape[1]
    scale = _compute_scale(columns)
    errors = np.sqrt(np.diag(covariance)[-count:]) / scale
    return TermEvidence(float(gain), error, change[-count:] / scale, errors)


def _compute_scale(columns: Sequence[Array]) -> Array:
    """Size of the effect of each number (numbers,) [-]: the root of the sum of squares over all channels."""
    return np.asarray(np.sqrt(sum(np.sum(x**2, axis=0) for x in columns)) + TINY)


def _build_normal_equations(terms: Terms) -> tuple[Array, Array]:
    """Hessian (size, size) and pull (size,) of the cost at z [-]."""
    prior = terms.root.T @ terms.root
    hessian = prior + sum((j.T @ j for j in terms.slopes), np.zeros_like(prior))
    pull = sum((j.T @ r for j, r in zip(terms.slopes, terms.residuals, strict=True)), -prior @ terms.z)
    return hessian, pull


def solve_terms(terms: Terms) -> tuple[Array, Array]:
    """Return the change of z (size,) [-] that all logs ask for, and its covariance (size, size)."""
    hessian, pull = _build_normal_equations(terms)
    covariance = np.asarray(np.linalg.inv(hessian), dtype=np.float64)
    return covariance @ pull, covariance


def _fill_held_residuals(terms: Terms) -> Terms:
    """The same with the residuals of each part under what the others tell."""
    hessian, pull = _build_normal_equations(terms)
    held = [np.zeros_like(r) for r in terms.residuals]
    for part in np.unique(np.concatenate(terms.parts)):
        rows = [numbers == part for numbers in terms.parts]
        inside = [j[k] for j, k in zip(terms.slopes, rows, strict=True)]
        less = sum((j.T @ j for j in inside), np.zeros_like(hessian))
        taken = sum((j.T @ r[k] for j, r, k in zip(inside, terms.residuals, rows, strict=True)), np.zeros_like(pull))
        change = np.linalg.solve(hessian - less, pull - taken)
        for h, r, j, k in zip(held, terms.residuals, inside, rows, strict=True):
            h[k] = r[k] - j @ change
    return replace(terms, held=tuple(held))
