"""Parameters as a table in physical units, with intervals: mass properties as mass, centre of mass and inertia about it.

Intervals hold 90 % of draws from the posterior, and the value.  A parameter is told by the logs where they narrow what was known
before to `fit.TOLD` of its width, and would narrow it to half were all others known; else it is held by its prior.  Widths are
compared as normal scores of the prior, which heavy tails leave as they are.  Where data and prior contradict each other:

    conflict = a . z^ / (1 - a^T C a)^0.5,   a : direction of the parameter in z, of length 1

which is standard normal where the truth is drawn from the prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.identification.estimation.days import DayFits, compute_day_deviations
from crosscheck.identification.estimation.fit import TOLD, Fit
from crosscheck.identification.estimation.posterior import (
    LEAST,
    LogInformation,
    compute_log_information,
    compute_physical_values,
    sample_posterior,
)
from crosscheck.identification.machine import Machine
from crosscheck.identification.parameters import MASS, ParameterSpace
from crosscheck.report.words import format_by_width, format_interval, format_short
from flexinv.typing import Array

INSIDE = 0.9
MACHINE = "mean of days"  # what stands for a day where the machine is meant
NORMAL = 1.6448536269514722  # half width of it, in standard deviations of a normal distribution
FARTHEST = (
    20.0  # widths of its prior that a value of logs alone is away at most: of what they hardly tell it is no number
)
SCORED = 2.5  # standard deviations of the prior within which its quantiles are known
SLOPE = 1.0  # of the last of them go on beyond
SCORES = 101  # quantiles that are taken
WIDE = 1.0  # relative error of a gain that says that nobody knows it
# Of a truth drawn from the prior 1.6 % stand farther off; of one that is four widths off, and told, 93 % do.
CONFLICT = 2.4


@dataclass(frozen=True)
class DayRow:
    """A parameter that differs from day to day: value and 90 % interval [unit] on one day, or of the machine (day = "").

    That of the machine is the mean of its days: from one of them it is as far as days scatter.
    """

    parameter: str
    place: str
    unit: str
    day: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Row:
    """A parameter: value found and 90 % interval, and value and interval before the log [unit].

    Of logs of one day it is that day's, of several days the machine's.

    identifiable : told by the logs, else held by its prior; conflict : standard errors between data and prior [-]
    alone : what the data say without the prior [unit], to first order
    """

    parameter: str
    place: str
    unit: str
    value: float
    low: float
    high: float
    before: float
    before_low: float
    before_high: float
    identifiable: bool
    conflict: float
    alone: float


def describe_unidentified(table: list[Row]) -> list[str]:
    """Return in words which parameters the logs cannot tell [-]: places of which the same is said together."""
    places: dict[tuple[str, ...], list[str]] = {}
    for place in dict.fromkeys(row.place for row in table if not row.identifiable):
        names = tuple(row.parameter for row in table if row.place == place and not row.identifiable)
        places.setdefault(names, []).append(place)
    return [
        f"{', '.join(where)}: {', '.join(names)} cannot be told {'one by one ' if len(names) > 1 else ''}from these logs: "
        "held by the prior, the intervals are mostly what was known before"
        for names, where in places.items()
    ]


def describe_conflicts(table: list[Row]) -> list[str]:
    """Return in words where the logs contradict what was known before [-], the worst first."""
    rows = [row for row in table if abs(row.conflict) > CONFLICT]
    return [
        f"{row.parameter} of {row.place}: the logs contradict what was known before by {abs(row.conflict):.1f} standard errors: "
        f"they alone say about {format_by_width(row.alone, row.high - row.low)} {row.unit}, known was {format_short(row.before)} "
        f"({format_interval(row.before_low, row.before_high)}), and {format_by_width(row.value, row.high - row.low)} was found; "
        "correct the value or widen its error in [[free]], or look for what the model lacks"
        for row in sorted(rows, key=lambda row: -abs(row.conflict))
    ]


def describe_free_scales(space: ParameterSpace) -> list[str]:
    """Return in words which efforts have a scale that no log tells [-]: a wide gain, which masses that are known must hold."""
    return [
        f"{one.place}: nobody wrote the torque constant, and efforts alone do not tell their scale: what is known of the masses "
        "holds it, within the intervals; write constant_Nm_per_A where it is known"
        for one in space.parameters
        if one.kind == "effort gain" and one.error >= WIDE
    ]


def list_parameter_rows(space: ParameterSpace, fit: Fit) -> list[Row]:
    """Return all parameters [unit of each] with 90 % intervals."""
    random = np.random.default_rng(0)  # the same log gives the same file
    after = sample_posterior(space, fit, random)
    drawn = compute_physical_values(space, after)
    known = compute_physical_values(space, random.normal(size=after.shape))
    value = compute_physical_values(space, fit.z)
    before = compute_physical_values(space, np.zeros_like(fit.z))
    information = compute_log_information(space, fit)
    widths = [
        float(np.std(after[:, k])) if one.kind != MASS else _compute_score_width(drawn[:, k], known[:, k])
        for k, one in enumerate(space.parameters)
    ]
    told = (np.array(widths) < TOLD) & information.own
    conflict = information.compute_conflict()
    alone = _compute_values_without_prior(space, fit, information, before)
    # Mass properties stand behind all others.
    order = sorted(range(len(value)), key=lambda k: space.parameters[k].kind == MASS)
    return [
        Row(
            *information.keys[k],
            information.units[k],
            float(value[k]),
            *_find_interval(drawn[:, k], float(value[k])),
            float(before[k]),
            *_find_interval(known[:, k], float(before[k])),
            bool(told[k]),
            float(conflict[k]),
            float(alone[k]),
        )
        for k in order
    ]


def list_day_rows(machine: Machine, days: DayFits, table: list[Row]) -> list[DayRow]:
    """Return the parameters that differ from day to day [unit of each], of each day and of the machine, with 90 % intervals.

    table : all parameters, of the day if there is one, of the machine if there are several; the others are normal in z
    """
    space = machine.space
    moved = np.flatnonzero(compute_day_deviations(machine, days.machine.z, days.machine.scatter)).tolist()
    by_key = {(row.parameter, row.place): row for row in table}
    found = [by_key[space.parameters[k].key] for k in moved]
    drawn = [DayRow(r.parameter, r.place, r.unit, "", r.value, r.low, r.high) for r in found]
    still = np.zeros(len(space.parameters))
    if len(days.own) > 1:
        day_rows = [
            _make_day_row(space, k, one, still, n) for n, one in zip(days.logs, days.own, strict=True) for k in moved
        ]
        return day_rows + drawn
    deviations = compute_day_deviations(machine, days.machine.z, days.widths)
    whole = [_make_day_row(space, k, days.own[0], deviations, "") for k in moved]
    return [replace(row, day=days.logs[0]) for row in drawn] + whole


def _make_day_row(space: ParameterSpace, k: int, fit: Fit, deviations: Array, day: str) -> DayRow:
    """Row of parameter k on a day; with deviations (parameters,) of z [-] between days that of the machine it is one of."""
    one = space.parameters[k]
    half = NORMAL * float(np.sqrt(fit.covariance[k, k] + deviations[k] ** 2))
    at = float(fit.z[k])
    value, low, high = (one.compute_value(z) for z in (at, at - half, at + half))
    return DayRow(one.kind, one.place, one.unit, day, value, low, high)


def _compute_values_without_prior(space: ParameterSpace, fit: Fit, information: LogInformation, before: Array) -> Array:
    """Values of the logs alone (parameters,) [unit]: the prior draws the fit to itself by r^2, which is taken back."""
    taken = np.maximum(1.0 - information.ratio**2, LEAST)
    out = before + information.width * information.pull / taken
    for k, one in enumerate(space.parameters):
        if one.kind != MASS:
            out[k] = one.compute_value(float(np.clip(fit.z[k] / taken[k], -FARTHEST, FARTHEST)))
    return out


def _find_interval(drawn: Array, value: float) -> tuple[float, float]:
    """Return the ends of an interval with 90 % of the draws (draws,) [unit] and the value: equal tails, moved if they miss it."""
    below = float(np.mean(drawn <= value))
    first = np.clip((1.0 - INSIDE) / 2.0, below - INSIDE, below)
    low, high = np.quantile(drawn, (first, min(first + INSIDE, 1.0)))
    return min(float(low), float(value)), max(float(high), float(value))


def _compute_score_width(drawn: Array, known: Array) -> float:
    """Return the standard deviation of draws (draws,) as normal scores of draws from the prior (draws,) [-].

    Beyond `SCORED` of the prior, where few of its draws are, scores go on as they did over the last `SLOPE` of them: a value that
    lies far out would be told by its place alone.
    """
    scores = np.linspace(-SCORED, SCORED, SCORES)
    at = np.quantile(known, scipy.special.ndtr(scores))
    out = np.interp(drawn, at, scores)
    inner = [np.interp(side * (SCORED - SLOPE), scores, at) for side in (-1.0, 1.0)]
    for end, inside, side in ((at[0], inner[0], -1.0), (at[-1], inner[1], 1.0)):
        beyond = side * (drawn - end) > 0.0
        if end != inside:
            out[beyond] = side * SCORED + SLOPE * side * (drawn[beyond] - end) / abs(end - inside)
    return float(np.std(out))
