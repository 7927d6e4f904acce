"""Days: friction, offsets and gains differ from one day to the next, by widths that the logs of several days tell.

    z_d = z + delta_d,   delta_dk ~ N(0, (w_c s_k)^2),   w_c = A_c t_c,   t_c half-normal with scale 1

z : parameters of the machine; z_d : those of day d, which differ in viscous friction, coulomb friction, the offset of efforts
and, where it is free, their gain
w_c : width of each of these classes, of friction and gains relative, of offsets in parts of the joint's dry friction; s_k makes
it one of z
A_c : what is expected, `IdentifyTable.between_runs`.  E t^2 = 1: of one day alone nothing is told of w, and its square is A^2

With the logs' information H and pull g about all delta, z made up for, and p_k = 1 / (w_c s_k)^2, the widths are as likely as

    log p(logs | w) = 1/2 (sum log p_k - log |H + diag p| + g^T (H + diag p)^-1 g)

and w_c^2 is its mean under this and the prior.  Two days differ by 2 w^2 in variance: so does a new day from a single one.

Sources: A. Gelman, "Prior distributions for variance parameters in hierarchical models", Bayesian Analysis 1 (2006): where groups
are few, a prior that is finite at 0 and falls.  It is half-normal and not half-Cauchy because bands need the mean of w^2.
A. Bittencourt, S. Gunnarsson, "Static friction in a robot joint", J. Dynamic Systems, Measurement and Control 134 (2012), for
friction that follows temperature and load.  Gear oil (ISO 3448, VG 150) loses nine tenths of its viscosity from 40 to 100 degrees
Celsius, which is 4 % per kelvin, and rooms and warm drives differ by some 3 K: 12 % of viscous friction, beside A = 0.15.
Magnets lose 0.1 % (NdFeB) to 0.2 % (ferrite) of their flux per kelvin (IEC 60404-8-1), and motors differ by some 10 to 20 K from
a cold day to a warm one: 2 % of a torque constant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal, get_args

import numpy as np

from crosscheck.identification.estimation.fit import Fit, Problem, build_problem, fit
from crosscheck.identification.estimation.march_steps import choose_steps
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Machine, resolve_value
from crosscheck.identification.readings import Run
from flexinv.errors import InputError
from flexinv.typing import Array

DayWidths = Mapping[str, float]
DayRule = Literal["files", "logs", "one"]
VISCOUS = "viscous friction"
DRY = "coulomb friction"
OFFSET = "effort offset"
GAIN = "effort gain"
# Kinds that differ -> what is expected in parts of between_runs.  Viscous friction follows the temperature, too.  An offset is
# what friction has more one way than the other, and the zero of a current sensor: 1 % of a range of five times the dry friction.
# A torque constant follows the temperature of its magnets, by 2 %.
SHARES = {VISCOUS: 4.0 / 3.0, DRY: 1.0, OFFSET: 1.0 / 3.0, GAIN: 2.0 / 15.0}
MOST_NAMED = 3  # logs of a day
TRIED = np.array([0.1, 0.3, 0.5, 0.75, 1.0, 1.35, 1.8, 2.4, 3.2, 4.2])  # widths, in those expected


@dataclass(frozen=True)
class DayFits:
    """Fits of all days.

    rule : what is a day; names : of each; logs : of each in words; own : parameters of each [-]
    machine : those that a new day differs from by its ``scatter``: of the mean of several days, of the only one
    widths : of each class from day to day [-]; before : as they were expected
    """

    rule: DayRule
    names: tuple[str, ...]
    logs: tuple[str, ...]
    own: tuple[Fit, ...]
    machine: Fit
    widths: DayWidths
    before: DayWidths

    def choose_fit(self, day: str) -> Fit:
        """Return the parameters [-] as they are known on a day: its own if it identified, else those of the machine."""
        return self.own[self.names.index(day)] if day in self.names else self.machine


def describe_days(days: DayFits) -> str:
    """Return in words what is assumed, or was found, to differ from day to day [-]."""
    if not days.machine.scatter:
        return "Friction and offsets are taken to be the same every day."
    held = (
        "Bands of logs of another day hold that, and so do the intervals of the machine, which is the mean of its days."
    )
    if len(days.own) == 1:
        return (
            "The logs that identify are of one day, and tell nothing of others. From day to day "
            f"{_describe_widths(days.before)} are expected (between_runs in identify.toml, as one standard deviation). {held}"
        )
    own = "friction, offsets and gains" if GAIN in days.widths else "friction and offsets"
    return (
        f"The logs that identify are of {len(days.own)} days, each with {own} of its own. From day to day "
        f"{_describe_widths(days.widths)} were found, as one standard deviation (expected were "
        f"{', '.join(f'{100.0 * width:.2g} %' for width in days.before.values())}). {held}"
    )


def _describe_widths(widths: DayWidths) -> str:
    sizes = {kind: f"{100.0 * width:.2g} %" for kind, width in widths.items()}
    gains = f"{sizes[GAIN]} of the gains of efforts, " if GAIN in sizes else ""
    return (
        f"{gains}{sizes[VISCOUS]} of the viscous friction, {sizes[DRY]} of the dry friction and an offset of {sizes[OFFSET]} "
        "of the dry friction"
    )


def _describe_logs(names: list[str]) -> str:
    return ", ".join(names) if len(names) <= MOST_NAMED else f"{names[0]} and {len(names) - 1} more"


def find_day(log: Log, rule: DayRule) -> str:
    """Return the day of a log [-]: by "files" that of its file, by "logs" its own, by "one" that of all."""
    return {"files": log.day or log.name, "logs": f"{log.day}/{log.name}", "one": "all logs"}[rule]


def check_day_rule(rule: str) -> None:
    """Raise InputError where a rule of days is none [-]."""
    if rule not in get_args(DayRule):
        raise InputError(
            f"identify, days: {rule!r}, expected one of {', '.join(get_args(DayRule))}: each file is a day, each log is one, or "
            "all are of one day; write days='files'"
        )


def compute_expected_widths(machine: Machine) -> dict[str, float]:
    """Return the widths of all classes [-] that are expected where nothing tells them; gains are one where some are free."""
    free = {one.kind for one in machine.space.parameters}
    classes = [kind for kind in SHARES if kind != GAIN or kind in free]
    return {kind: machine.settings.between_runs * SHARES[kind] for kind in classes}


def compute_day_deviations(machine: Machine, z: Array, widths: DayWidths) -> Array:
    """Return the standard deviations (parameters,) of z [-] from day to day at z; 0 of what stays."""
    values = machine.space.compute_values(z)
    out = np.zeros(len(z))
    for k, one in enumerate(machine.space.parameters):
        if one.kind in widths:
            size = resolve_value(machine, values, DRY, one.place) if one.kind == OFFSET else 1.0
            out[k] = widths[one.kind] * size / one.error
    return out


def fit_days(machine: Machine, runs: Sequence[Run], days: Sequence[str], rule: DayRule) -> tuple[Problem, DayFits]:
    """Return the problem of all runs, and the parameters of each day and of the machine [-], with the steps that they need.

    days : name of the day of each run
    """
    task, found = _fit_days_once(machine, runs, days, rule)
    while (finer := choose_steps(task, found.machine, machine.settings.every)) is not None:
        task, found = _fit_days_once(finer.machine, finer.runs, days, rule, found.machine.z)
    return task, found


def _fit_days_once(
    machine: Machine, runs: Sequence[Run], days: Sequence[str], rule: DayRule, start: Array | None = None
) -> tuple[Problem, DayFits]:
    """The same with the steps that the machine has; start : z (parameters,) of the machine from which the search begins."""
    names = tuple(dict.fromkeys(days))
    logs = tuple(
        _describe_logs([run.name for run, day in zip(runs, days, strict=True) if day == name]) for name in names
    )
    before = compute_expected_widths(machine)
    unit = compute_day_deviations(machine, np.zeros(len(machine.space.parameters)), before)
    moved = tuple(np.flatnonzero(unit).tolist()) if len(names) > 1 else ()
    task = build_problem(machine, tuple(runs), None, tuple(names.index(day) for day in days), moved)
    if not moved:
        found = fit(task, start)
        apart = {kind: np.sqrt(2.0) * width for kind, width in before.items()}
        other = replace(found, scatter=apart if machine.settings.between_runs else {})
        return task, DayFits(rule, names, logs, (found,) * len(names), other, before, before)
    both = None if start is None else np.concatenate([start, np.zeros(task.size - len(start))])
    first = fit(task, both, _build_day_prior(task, unit))
    widths = find_day_widths(task, first, unit, before)
    now = compute_day_deviations(machine, _take_machine(task, first.z), widths)
    last = fit(task, first.z, _build_day_prior(task, now))
    each_day = tuple(_map_fit(last, task.build_day_map(day)) for day in range(len(names)))
    mean = replace(_map_fit(last, np.eye(len(unit), task.size)), scatter=widths)
    return task, DayFits(rule, names, logs, each_day, mean, widths, before)


def _take_machine(task: Problem, z: Array) -> Array:
    return z[: len(task.machine.space.parameters)]


def _build_day_prior(task: Problem, deviations: Array) -> tuple[Array, Array]:
    """Mean and square root of the precision (size, size) of z and of what each day adds."""
    count = len(set(task.days))
    weights = 1.0 / np.tile(deviations[list(task.moved)], count)
    return np.zeros(task.size), np.diag(np.concatenate([np.ones(task.size - len(weights)), weights]))


def _map_fit(found: Fit, places: Array) -> Fit:
    """The fit of the parameters ``places z`` (parameters,); products with gains are told in z as a whole only."""
    return replace(found, z=places @ found.z, covariance=places @ found.covariance @ places.T, information={})


def find_day_widths(task: Problem, found: Fit, unit: Array, before: DayWidths) -> dict[str, float]:
    """Return the widths of all classes [-]: the root of the mean of their squares.

    found : fit of all days that held them by deviations ``unit`` (parameters,) of z; before : widths that are expected
    """
    now = compute_day_deviations(task.machine, _take_machine(task, found.z), before)
    kinds = [task.machine.space.parameters[k].kind for k in task.moved] * len(set(task.days))
    scales = np.tile(now[list(task.moved)], len(set(task.days)))
    held = _build_day_prior(task, unit)[1]
    whole = np.linalg.inv(found.covariance).astype(np.float64)
    information, pull = _remove_machine(whole, whole @ found.z, len(unit))
    information -= np.diag(np.diag(held)[len(unit) :] ** 2)
    classes = list(dict.fromkeys(kinds))
    grid = list(product(TRIED, repeat=len(classes)))
    number = np.array([classes.index(kind) for kind in kinds])
    logs = [_compute_evidence(information, pull, np.array(t)[number] * scales) for t in grid]
    tried = np.array(grid)
    steps = np.gradient(TRIED)[np.searchsorted(TRIED, tried)]
    score = np.array(logs) + np.sum(np.log(steps) - tried**2 / 2.0, axis=1)
    chance = np.exp(score - score.max())
    square = (chance @ tried**2) / chance.sum()
    told = {kind: before[kind] * float(np.sqrt(t)) for kind, t in zip(classes, square, strict=True)}
    return {**before, **told}


def _remove_machine(information: Array, pull: Array, count: int) -> tuple[Array, Array]:
    """Information and pull about what days add, with the first ``count`` coordinates made up for."""
    across = np.linalg.solve(information[:count, :count], information[:count, count:]).T
    rest = information[count:, count:] - across @ information[:count, count:]
    return rest, pull[count:] - across @ pull[:count]


def _compute_evidence(information: Array, pull: Array, deviations: Array) -> float:
    """Logarithm of the likelihood of deviations from day to day (added,) [-], but for a constant."""
    root = np.linalg.cholesky(information + np.diag(deviations**-2.0))
    half = np.linalg.solve(root, pull)
    return float(-np.sum(np.log(deviations)) - np.sum(np.log(np.diag(root))) + 0.5 * half @ half)
