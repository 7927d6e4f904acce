"""Headers of logs: which column is the angle and the effort of which joint, by names, numbers and units, and what is doubtful.

A column belongs to the joint whose name stands in it; else to the one that its number means, counted from 1 or from 0; else,
where there are as many columns as joints, to the one in its place.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.identification.settings import ANGLES, EFFORTS
from flexinv.files.header_words import (
    EFFORT_UNITS,
    find_column_joint,
    find_header_unit,
    map_joint_names,
    match_by_number,
    remove_words,
)
from flexinv.model.mechanism import Joint
from flexinv.typing import Array

# How headers write units -> unit of identify.toml; a rate is no angle.
UNITS = {
    "deg": "deg", "degs": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "rads": "rad", "radians": "rad",
    "mm": "mm", "m": "m",
} | EFFORT_UNITS  # fmt: skip
RATES = re.compile(
    r"per_s|/s(?![a-z])|_s\b|rate|vel|speed|acc|qd|dq|geschw|drehzahl|beschl|vitesse|速度", re.IGNORECASE
)
# What was asked for, what a controller makes of it, and what is told of the tool or of the room: no sensor of a joint.
TOLD = re.compile(
    r"ref|des|cmd|command|target|setpoint|error|goal|(?:q|tau|pos|torque|theta)_d(?![a-z])|_ext|tcp|pose|cart|temp(?!s)|volt|limit|setpos"
    r"|soll|consigne|温度|指令|目標|目标",
    re.IGNORECASE,
)
CURRENT = re.compile(r"curr|strom|courant|電流|电流|(?:^|[^a-z])i_?\d", re.IGNORECASE)
SECOND = re.compile(r"link|secondary|output|joint_side", re.IGNORECASE)
ANGLE = re.compile(
    r"angle|pos|(?:^|[^a-z])q(?![a-z])|theta|phi|enc|winkel|角|位置|(?<!torque_)(?<!curr_)axis_act|(?:^|[^a-z])(?:ang|ist)(?![a-z])",
    re.IGNORECASE,
)
EFFORT = re.compile(
    r"torque|trq|effort|current|tau|force|moment|strom|couple|courant|トルク|力矩|扭矩|電流|电流"
    r"|(?:^|[^a-z])(?:eff|curr|i_?\d+|t\d+)(?![a-z])",
    re.IGNORECASE,
)
TURNS = 4.0 * np.pi  # [rad]: an angle without a unit that reaches farther is taken as degrees


@dataclass(frozen=True)
class Column:
    """A column of a log as a sensor of a joint; unit : as identify.toml writes it; why : doubts in words, "" without any."""

    name: str
    unit: str
    why: str = ""


Found = Mapping[str, Mapping[str, Column]]


def match_joint_columns(joints: Sequence[Joint], columns: Mapping[str, Array]) -> dict[str, dict[str, Column]]:
    """Return by joint its columns "angle", "link_angle", "effort" [unit of each]; joints without any are left out."""
    names = map_joint_names(joints)
    owners = {name: find_column_joint(name, names) for name in columns}
    kinds: dict[str, list[Column]] = {"angle": [], "link_angle": [], "effort": []}
    for name, values in columns.items():
        if column_sense := _find_column_sense(name, remove_words(name, names.get(owners[name], ())), values):
            kinds[column_sense[0]].append(column_sense[1])
    out: dict[str, dict[str, Column]] = {}
    for kind, every in kinds.items():
        for joint, candidates in _split_columns(joints, every, owners).items():
            slides = next(j for j in joints if j.name == joint).kind == "prismatic"
            fitting = [_resolve_unit(c, kind, slides) for c in candidates if _has_fitting_unit(c, kind, slides)]
            if fitting:
                out.setdefault(joint, {})[kind] = _choose_column(fitting, kind)
    return out


# --------------------------------------------------------------------------------------------------- what a column is


def _find_column_sense(name: str, rest: str, values: Array) -> tuple[str, Column] | None:
    """The sense of a column, and the column with its unit; rest : its name without that of its joint."""
    unit = find_header_unit(rest, UNITS)
    if TOLD.search(rest):
        return None
    if not RATES.search(rest) and (unit in ANGLES or (not unit and ANGLE.search(rest))):
        kind = "link_angle" if SECOND.search(rest) else "angle"
        return kind, Column(name, unit) if unit else _resolve_angle_unit(name, values)
    if unit in EFFORTS or (not unit and EFFORT.search(rest) and not RATES.search(rest)):
        return "effort", Column(name, unit)
    return None


def _resolve_angle_unit(name: str, values: Array) -> Column:
    """A coordinate whose unit no header names."""
    far = float(np.nanmax(np.abs(values), initial=0.0))
    return Column(name, "", f"it reaches {far:.3g}" if far > TURNS else "")


def _resolve_unit(column: Column, kind: str, slides: bool) -> Column:
    """The column with a unit: where its header names none, that of the joint, with a doubt."""
    if column.unit:
        return column
    if kind == "effort" and CURRENT.search(column.name):
        return replace(column, unit="A", why="the header names no unit, and its name a current: is it A?")
    units = ("N", "N m") if kind == "effort" else ("m", "deg" if column.why else "rad")
    unit = units[0] if slides else units[1]
    reaches = f" and {column.why}" if column.why else ""
    return Column(column.name, unit, f"the header names no unit{reaches}: is it {unit}?")


def make_angle_column(name: str, values: Array, joint: Joint) -> Column:
    """Return a column as the coordinate of a joint [unit of the column]: in the unit in which it keeps to the joint's limits."""
    column = _resolve_unit(_resolve_angle_unit(name, values), "angle", joint.kind == "prismatic")
    reach = max(abs(joint.limits.lower), abs(joint.limits.upper))
    far = float(np.abs(values).max(initial=0.0))
    if column.unit == "rad" and reach < far <= reach / ANGLES["deg"]:
        return Column(name, "deg", f"it reaches {far:.3g}, and {joint.name} {reach:.3g} rad: it is taken as deg")
    return column


def make_effort_column(name: str, joint: Joint) -> Column:
    """Return a column as the effort of a joint [unit of the column]."""
    return _resolve_unit(Column(name, find_header_unit(name, EFFORT_UNITS)), "effort", joint.kind == "prismatic")


def has_other_unit(name: str) -> bool:
    """Return True for a header whose brackets hold the unit of neither an angle nor an effort: [bar], (degC)."""
    inside = re.search(r"[\[(]\s*[^\d\W][^\])]*[\])]|[\[(]\s*[°℃%]", name)
    return inside is not None and not find_header_unit(name, UNITS)


def _has_fitting_unit(column: Column, kind: str, slides: bool) -> bool:
    return kind == "effort" or not column.unit or (column.unit in ("m", "mm")) == slides


def _choose_column(columns: list[Column], kind: str) -> Column:
    """The first; of efforts one whose header names a torque or a force before a current."""
    ordered = sorted(columns, key=lambda c: kind == "effort" and (c.unit == "A", bool(c.why)))
    chosen = ordered[0]
    others = [c.name for c in ordered[1:]]
    words = [chosen.why] if chosen.why else []
    if others:
        words.append(f"or is it {', '.join(others[:3])}?")
    return replace(chosen, why="; ".join(words))


# ---------------------------------------------------------------------------------------------- whose column it is


def _split_columns(
    joints: Sequence[Joint], columns: Sequence[Column], owners: Mapping[str, str]
) -> dict[str, list[Column]]:
    """By joint its columns of one kind."""
    out: dict[str, list[Column]] = {}
    left = [c for c in columns if not owners[c.name]]
    for column in columns:
        if owners[column.name]:
            out.setdefault(owners[column.name], []).append(column)
    called = {column.name: column for column in left}
    if numbered := match_by_number(joints, list(called)):
        for joint, numbers in numbered.items():
            out.setdefault(joint, [called[name] for name in numbers])
    elif not out and len(left) == len(joints):
        words = "by its place among the columns"
        out |= {
            j.name: [replace(c, why=c.why or words) if len(joints) > 1 else c]
            for j, c in zip(joints, left, strict=True)
        }
    return out
