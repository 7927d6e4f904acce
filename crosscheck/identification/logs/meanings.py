"""Meanings of columns: by their names where those say it, else by what their numbers do beside each other; each with its reason.

Names come first (`header`).  Where no name is an angle, angles are the columns whose rate stands beside them, then the smoothest;
where none is an effort, efforts are what the motion explains (`relations`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.identification.logs.header import (
    RATES,
    TOLD,
    Column,
    Found,
    has_other_unit,
    make_angle_column,
    make_effort_column,
    match_joint_columns,
)
from crosscheck.identification.logs.log import Log
from crosscheck.identification.logs.relations import (
    MotionTerms,
    compute_roughness,
    find_copies,
    find_rates,
    is_constant,
    is_drift,
    is_time,
)
from crosscheck.identification.settings import ANGLES, TIMES
from flexinv.files.header_words import find_time_column, find_time_unit
from flexinv.model.mechanism import Joint
from flexinv.typing import Array

EXPLAINED = 0.5  # of an effort by the motion: of what is no effort less is
CLEAR = 3.0  # times as much as the next one: else both are named
RATE_UNIT = re.compile(r"(deg|°|rad|mm|m)\s*(?:/|_per_)\s*s(?![a-z])", re.IGNORECASE)
SMOOTH = "it is smoother than the others, as angles are"
PLACED = "by its place among the columns"


@dataclass(frozen=True)
class Meaning:
    """A column and what it was taken for, in words, with the reason."""

    column: str
    words: str


@dataclass(frozen=True)
class Columns:
    """The columns of a log that move, and their relations.

    live : without constants and copies; rates : by rate its angle and the factor of their units [-]; copies : of which column
    """

    live: Mapping[str, Array]
    rates: Mapping[str, tuple[str, float]]
    copies: Mapping[str, str]
    spacing: float


def choose_time_column(columns: Mapping[str, Array]) -> tuple[str, str]:
    """Return the column of times [any unit] and a doubt in words: by its name, else one that only rises, in even steps.

    Of several it is the one by which most columns are rates of others, of those alike the first.
    """
    name = find_time_column(list(columns))
    if name in columns:
        return name, ""
    rising = [one for one, values in columns.items() if is_time(values)]
    if not rising:
        return name, ""
    chosen = max(rising, key=lambda one: _count_rates(columns, rising, one)) if rising[1:] else rising[0]
    rivals = [one for one in rising if one != chosen]
    others = f", or is it {', '.join(rivals[:3])}?" if rivals else ""
    return chosen, f"no name says which column is the time: this one rises in even steps{others}"


def _count_rates(columns: Mapping[str, Array], rising: Sequence[str], time: str) -> int:
    """Count the columns that are rates of others where one is the time."""
    step = float(np.median(np.diff(columns[time])))
    spacing = step * TIMES[find_time_unit(time, step)[0]]
    return len(find_rates({k: v for k, v in columns.items() if k not in rising and not is_constant(v)}, spacing))


def find_meanings(joints: Sequence[Joint], log: Log) -> tuple[dict[str, dict[str, Column]], list[Meaning]]:
    """Return by joint its columns "angle", "link_angle", "effort" [unit of each], and what each column was taken for."""
    moving = {name: values for name, values in log.columns.items() if not is_constant(values)}
    copies = find_copies(moving)
    live = {name: values for name, values in moving.items() if name not in copies}
    columns = Columns(live, find_rates(live, log.spacing), copies, log.spacing)
    found = {joint: dict(kinds) for joint, kinds in match_joint_columns(joints, log.columns).items()}
    if not any("angle" in kinds for kinds in found.values()):
        for joint, column in _find_angles(joints, columns).items():
            found.setdefault(joint, {})["angle"] = column
    for kinds in found.values():
        if "angle" in kinds:
            kinds["angle"] = _resolve_by_rate(kinds["angle"], columns)
    if not any("effort" in kinds for kinds in found.values()):
        for joint, column in _find_efforts(joints, columns, found).items():
            found[joint]["effort"] = column
    return found, [Meaning(name, _describe_column(name, found, columns)) for name in log.columns]


# ----------------------------------------------------------------------------------------------------- what nobody named


def _list_unnamed(columns: Columns, used: Iterable[str]) -> list[str]:
    """Columns that no name excludes, that are the rate of none, and that do not only rise or drift."""
    taken = {*used, *columns.rates}
    free = [name for name in columns.live if name not in taken and not _has_other_name(name)]
    return [name for name in free if not is_time(columns.live[name]) and not is_drift(columns.live[name])]


def _has_other_name(name: str) -> bool:
    return bool(TOLD.search(name) or RATES.search(name) or has_other_unit(name))


def _find_angles(joints: Sequence[Joint], columns: Columns) -> dict[str, Column]:
    """By joint an angle: those that have a rate, then the smoothest, as many as there are joints."""
    free = _list_unnamed(columns, ())
    with_rate = {angle for angle, _ in columns.rates.values() if angle in free}
    ranked = sorted(free, key=lambda name: (name not in with_rate, compute_roughness(columns.live[name])))
    if len(ranked) < len(joints):
        return {}
    chosen = sorted(ranked[: len(joints)], key=list(columns.live).index)
    cost = [[_count_misfit(j, k, columns.live[name], n) for k, j in enumerate(joints)] for n, name in enumerate(chosen)]
    rows, places = scipy.optimize.linear_sum_assignment(np.array(cost))
    out = {}
    left = [name for name in ranked if name not in chosen]
    for row, place in zip(rows, places, strict=True):
        name = chosen[row]
        told = [f"{_find_rate_name(name, columns)} is its rate"] if name in with_rate else [SMOOTH]
        rivals = [] if name in with_rate else list(_list_rivals(name, left, columns))
        made = make_angle_column(name, columns.live[name], joints[place])
        why = "; ".join(filter(None, [f"no name says it: {told[0]}", PLACED, made.why, *rivals]))
        out[joints[place].name] = replace(made, why=why)
    return out


def _count_misfit(joint: Joint, place: int, values: Array, row: int) -> float:
    """Places by which a column is out of the order of the joints, and a hundred where it leaves the joint's limits."""
    scale = min(ANGLES.values()) if joint.kind == "prismatic" else ANGLES["deg"]
    low = float(values.min()) * scale
    high = float(values.max()) * scale
    leaves = low < joint.limits.lower or high > joint.limits.upper
    return abs(place - row) + 100.0 * leaves


def _list_rivals(name: str, left: Sequence[str], columns: Columns) -> Iterator[str]:
    """The smoothest column that is left, where it is nearly as smooth as one that no rate shows to be an angle."""
    if left and compute_roughness(columns.live[left[0]]) < CLEAR * compute_roughness(columns.live[name]):
        yield f"or is it {left[0]}?"


def _find_rate_name(angle: str, columns: Columns) -> str:
    return next(rate for rate, (one, _) in columns.rates.items() if one == angle)


def _find_efforts(joints: Sequence[Joint], columns: Columns, found: Found) -> dict[str, Column]:
    """By joint the column that the motion explains, most of it by the joint's own rate and acceleration."""
    moved = [joint for joint in joints if "angle" in found.get(joint.name, {})]
    if not moved:
        return {}
    sensors = [found[joint.name]["angle"] for joint in moved]
    angles = np.array([columns.live.get(one.name, np.zeros(0)) * ANGLES[one.unit] for one in sensors]).T
    terms = MotionTerms.build(angles, columns.spacing)
    told: dict[str, list[tuple[float, str]]] = {}
    for name in _list_unnamed(columns, [one.name for kinds in found.values() for one in kinds.values()]):
        share = terms.compute_share(columns.live[name])
        if share > EXPLAINED:
            told.setdefault(moved[terms.find_owner(columns.live[name])].name, []).append((share, name))
    return {joint: _make_told_effort(joint, moved, some, columns) for joint, some in told.items()}


def _make_told_effort(joint: str, moved: Sequence[Joint], some: list[tuple[float, str]], columns: Columns) -> Column:
    """The effort that the motion explains best; a second one is named beside it."""
    ranked = sorted(some, reverse=True)
    name = ranked[0][1]
    column = make_effort_column(name, next(one for one in moved if one.name == joint))
    words = [f"no name says it: the motion explains {ranked[0][0]:.0%} of it, most by the rate of {joint}"]
    words += [f"or is it {other}, of which {share:.0%}?" for share, other in ranked[1:3]]
    unit = f"no header names its unit: {column.unit}, or A of a current?" if column.why else ""
    return replace(column, why="; ".join(filter(None, [*words, unit])))


def _resolve_by_rate(column: Column, columns: Columns) -> Column:
    """An angle whose header names no unit has that of its rate, where the header of that one names it."""
    if "names no unit" not in column.why:
        return column
    for rate, (angle, factor) in columns.rates.items():
        if angle == column.name and (unit := RATE_UNIT.search(rate)) is not None:
            resolved = "deg" if unit[1].lower() in ("deg", "°") else unit[1].lower()
            if factor != 1.0:
                resolved = {"deg": "rad", "rad": "deg", "mm": "m", "m": "mm"}[resolved]
            return Column(column.name, resolved, f"in {resolved}, for {rate} is its rate")
    return column


# ------------------------------------------------------------------------------------------------------------ in words


def _describe_column(name: str, found: Found, columns: Columns) -> str:
    for joint, kinds in found.items():
        for kind, column in kinds.items():
            if column.name == name:
                sure = f"doubtful: {column.why}" if column.why else "by its name"
                return f"{kind.replace('_', ' ')} of {joint} [{column.unit}], {sure}"
    if name in columns.copies:
        return f"not used: the same as {columns.copies[name]}; a set point, or a second sensor?"
    if name in columns.rates:
        return _describe_rate(name, found, columns)
    if name not in columns.live:
        return "not used: it stands still, or has gaps"
    if TOLD.search(name):
        return "not used: by its name what is commanded, or told of the tool or of the room"
    if is_drift(columns.live[name]):
        return "not used: it only drifts, as a temperature does"
    return "not used: neither its name nor the motion tells what it is"


def _describe_rate(name: str, found: Found, columns: Columns) -> str:
    """A rate by its numbers, with the line that uses it."""
    angle, factor = columns.rates[name]
    if angle in columns.rates:
        return f"not used: an acceleration, for it is the rate of {angle}"
    for joint, kinds in found.items():
        if "angle" in kinds and kinds["angle"].name == angle:
            unit = kinds["angle"].unit
            if factor != 1.0:
                unit = {"deg": "rad", "rad": "deg", "mm": "m", "m": "mm"}[unit]
            line = f'rate = {{ column = {name!r}, unit = "{unit}/s" }}'
            return f"rate of {joint} [{unit}/s], by its numbers; not used: where a sensor measures it, write {line}"
    return f"not used: the rate of {angle}"
