"""Parameters as a table in physical units, with intervals: mass properties as mass, centre of mass and inertia about it.

Intervals are quantiles of draws from the posterior; a parameter counts as identifiable where the log has narrowed what was known
before to `fit.TOLD` of its width.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from crosscheck.identification.fit import TOLD, Fit
from crosscheck.identification.parameters import MASS, ParameterSpace
from crosscheck.identification.pseudo_inertia import NAMES, QUANTITIES, UNITS, convert_to_com, move_mass_properties
from flexinv.typing import Array

DRAWS = 1000  # quantiles of 5 and 95 % of so many draws scatter by 2 % of the interval
INSIDE = (0.05, 0.95)


@dataclass(frozen=True)
class Row:
    """A parameter: value found and 90 % interval, and value and interval before the log [unit]."""

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


def describe_unidentified(table: list[Row]) -> list[str]:
    """Return in words which parameters the logs cannot tell [-]: places of which the same is said together."""
    places: dict[tuple[str, ...], list[str]] = {}
    for place in dict.fromkeys(row.place for row in table if not row.identifiable):
        names = tuple(row.parameter for row in table if row.place == place and not row.identifiable)
        places.setdefault(names, []).append(place)
    return [
        f"{', '.join(where)}: {', '.join(names)} cannot be told {'one by one ' if len(names) > 1 else ''}from these logs: "
        "the intervals are nearly what was known before"
        for names, where in places.items()
    ]


def list_parameter_rows(space: ParameterSpace, fit: Fit) -> list[Row]:
    """Return all parameters [unit of each] with 90 % intervals."""
    random = np.random.default_rng(0)  # the same log gives the same file
    count = len(fit.z)
    values, vectors = np.linalg.eigh(fit.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    normal = random.normal(size=(DRAWS, count))
    after = fit.z + normal @ root.T
    before = random.normal(size=(DRAWS, count))
    return [*_list_scalar_rows(space, fit, after, before), *_list_mass_rows(space, fit, after, before)]


def _list_scalar_rows(space: ParameterSpace, fit: Fit, after: Array, before: Array) -> Iterator[Row]:
    """Yield the parameters that are no mass properties; after, before : (draws, parameters) [-]."""
    for k, one in enumerate(space.parameters):
        if one.kind == MASS:
            continue
        value = np.array([one.compute_value(float(x)) for x in after[:, k]])
        known = np.array([one.compute_value(float(x)) for x in before[:, k]])
        told = bool(np.sqrt(fit.covariance[k, k]) < TOLD)
        what = (one.kind, one.place, one.unit)
        yield _make_row(what, one.compute_value(float(fit.z[k])), value, one.known, known, told)


def _list_mass_rows(space: ParameterSpace, fit: Fit, after: Array, before: Array) -> Iterator[Row]:
    """Yield mass, centre of mass and inertia about it of each link; after, before : (draws, parameters) [-]."""
    keys = [p.key for p in space.parameters]
    for name, factor in space.factors.items():
        at = [keys.index((MASS, f"{name}.{n}")) for n in NAMES]
        errors = np.array([space.parameters[k].error for k in at])
        value = convert_to_com(move_mass_properties(factor, errors * after[:, at]))
        known = convert_to_com(move_mass_properties(factor, errors * before[:, at]))
        here = convert_to_com(move_mass_properties(factor, errors * fit.z[at]))
        there = convert_to_com(move_mass_properties(factor, np.zeros(len(NAMES))))
        for k, (quantity, unit) in enumerate(zip(QUANTITIES, UNITS, strict=True)):
            told = bool(np.std(value[:, k]) < TOLD * np.std(known[:, k]))
            what = (quantity, name, unit)
            yield _make_row(what, float(here[k]), value[:, k], float(there[k]), known[:, k], told)


def _make_row(what: tuple[str, str, str], value: float, drawn: Array, before: float, known: Array, told: bool) -> Row:
    low, high = np.quantile(drawn, INSIDE)
    first, last = np.quantile(known, INSIDE)
    return Row(*what, value, float(low), float(high), before, float(first), float(last), told)
