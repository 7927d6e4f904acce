"""Columns of a motion as planners write it: which is the position, rate or acceleration of which coordinate, in which unit.

A header names a joint, in any order and among other words: ``elbow``, ``elbow_deg``, ``rate elbow [rad/s]``, ``qdd_elbow``,
``/joint_states/elbow/velocity``; or it numbers the joints, ``q1 [deg]``, ``qd1``.  The unit stands in brackets or at the end; SI
without one.  A word or a unit of rates makes a rate: the two must not contradict each other.  What a drive feels or draws
(``elbow_A``, ``elbow [N m]``), and what has other words (``elbow_temperature``), is no coordinate, and is left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from flexinv.errors import InputError
from flexinv.files.header_words import (
    EFFORT_UNITS,
    find_column_joint,
    find_header_unit,
    find_time_column,
    map_joint_names,
    match_by_number,
    remove_words,
)
from flexinv.files.toml_tables import make_input_error
from flexinv.files.values import UNITS
from flexinv.model.joint_kinds import KINDS
from flexinv.model.joints import Joint
from flexinv.model.mechanism import Mechanism
from flexinv.validation import find_nearest_word

POSITION_COLUMNS = "position"
RATE_COLUMNS = "rate"
ACCELERATION_COLUMNS = "acceleration"
SENSES = (POSITION_COLUMNS, RATE_COLUMNS, ACCELERATION_COLUMNS)
SENSE_WORDS = {
    POSITION_COLUMNS: "position positions pos angle angles q theta phi coordinate displacement",
    RATE_COLUMNS: "rate rates velocity velocities vel speed speeds qd dq qdot v omega",
    ACCELERATION_COLUMNS: "acceleration accelerations accel acc qdd ddq qddot a alpha",
}
_SENSE_OF = {word: sense for sense, words in SENSE_WORDS.items() for word in words.split()}
SILENT_WORDS = frozenset(["joint", "joints", "axis", "j", "state", "states", "actual", "planned", "trajectory"])
# What a file of efforts or of results has beside a motion; flexinv's own tables among them.
LEFT_OUT = re.compile(
    r"torque|effort|force|current|(?:^|[^a-z])tau(?![a-z])|^tip |^deflection |^error of ", re.IGNORECASE
)
# Units of what a drive feels or draws; without them "_A" and "_V" would be words of accelerations and rates.
DRIVE_UNITS = EFFORT_UNITS | {"ma": "mA", "v": "V", "mv": "mV", "w": "W"}
BASES = {
    "rad": ("rad", "rads", "radian", "radians"), "deg": ("deg", "degs", "degree", "degrees", "°"), "mrad": ("mrad",),
    "m": ("m", "metre", "metres", "meter", "meters"), "mm": ("mm",), "cm": ("cm",),
}  # fmt: skip
_BASE_OF = {word: base for base, words in BASES.items() for word in words}
_ORDERS = {
    POSITION_COLUMNS: ("",),
    RATE_COLUMNS: ("/s", "s^-1", "s-1"),
    ACCELERATION_COLUMNS: ("/s^2", "/s2", "/s**2", "/s/s", "/(s^2)", "s^-2", "s-2"),
}
# Every unit as a header may write it, blanks and marks removed -> its sense, "rad" or "m", and its size in SI.
MOTION_UNITS = {
    word + mark: (sense, "m" if base in ("m", "mm", "cm") else "rad", UNITS[base][base])
    for word, base in _BASE_OF.items()
    for sense, marks in _ORDERS.items()
    for mark in marks
} | dict.fromkeys(("rpm", "1/min"), (RATE_COLUMNS, "rad", UNITS["rpm"]["rpm"]))
MOST_NAMED = 12  # columns or joints that a message lists


@dataclass(frozen=True)
class MotionColumn:
    """One column: its place in the file, its header, whose coordinate it is, and its unit's size in SI.

    stated : the header names the unit
    """

    place: int
    name: str
    sense: str
    joint: str
    coordinate: str
    factor: float = 1.0
    stated: bool = True


@dataclass(frozen=True)
class MotionColumns:
    """Columns of a motion by what they are, each in the order of the mechanism's coordinates; those of joints held are not there.

    time : the place of its column and its header, None where there is none
    """

    time: tuple[int, str] | None
    positions: tuple[MotionColumn, ...]
    rates: tuple[MotionColumn, ...]
    accelerations: tuple[MotionColumn, ...]
    left_out: tuple[str, ...]


def list_place_suffixes(joint: Joint) -> tuple[str, ...]:
    """Return the suffixes of a joint's positions in a file [-]: of a continuous joint one angle, not cosine and sine."""
    kind = KINDS[joint.kind]
    return ("",) if kind.circle else kind.q


def list_coordinates(joint: Joint, sense: str) -> tuple[str, ...]:
    """Return the names of the columns of a joint [-] that a motion needs of one sense."""
    suffixes = list_place_suffixes(joint) if sense == POSITION_COLUMNS else KINDS[joint.kind].v
    return tuple(joint.name + suffix for suffix in suffixes)


def parse_motion_unit(text: str) -> tuple[str, str, float] | None:
    """Return the sense, "rad" or "m", and the size [rad], [m], [1/s] of a unit; None for what is none."""
    plain = text.lower().replace("²", "^2").replace("_per_", "/").replace(" ", "").replace("·", "").strip("_")
    return MOTION_UNITS.get(plain)


def match_motion_columns(header: Sequence[str], mechanism: Mechanism, held: Iterable[str], where: str) -> MotionColumns:
    """Return the columns of a header by what they are [rad], [m], [1/s].

    held : joints that need no column.  Raises InputError, one for all: columns that are nothing of the mechanism, coordinates
    without a column, columns that say the same.
    """
    moving = mechanism.moving_joints
    names = map_joint_names(moving)
    time = _find_time(header)
    read = _parse_headers(header, time, names)
    named = [(one, _match_joint_column(one, mechanism.joint_of[one.joint])) for one in read if one.joint]
    numbered = [(one, _match_nameless_column(one)) for one in read if not one.joint]
    given, lost = _match_numbered_columns(moving, [column for _, column in numbered if column is not None])
    found = [*(column for _, column in named if column is not None), *given]
    none = [one for one, column in sorted((*named, *numbered), key=_find_place) if column is None]
    left_out = [one.name for one in none if _is_no_coordinate(one, names)]
    unknown = [name for name in (*(one.name for one in none), *lost) if name not in left_out]
    _check_columns(found, unknown, left_out, mechanism, tuple(held), where)
    positions, rates, accelerations = (_list_ordered(found, mechanism, sense) for sense in SENSES)
    when = None if time is None else (time, header[time])
    return MotionColumns(when, positions, rates, accelerations, tuple(left_out))


def _find_time(header: Sequence[str]) -> int | None:
    """The place of the column of times, None where none looks like one."""
    name = find_time_column(header)
    return list(header).index(name) if name in header else None


@dataclass(frozen=True)
class _Header:
    """Words of a header: the joint that it names or "", what its words and its unit mean, and what else is there.

    drive : its unit is that of what a drive feels or draws
    """

    place: int
    name: str
    joint: str
    senses: frozenset[str]
    unit: tuple[str, str, float] | None
    others: tuple[str, ...]
    drive: bool


def _find_place(pair: tuple[_Header, MotionColumn | None]) -> int:
    return pair[0].place


def _parse_headers(header: Sequence[str], time: int | None, names: Mapping[str, tuple[str, ...]]) -> list[_Header]:
    """All headers but that of times, and those that are empty."""
    return [_parse_header(place, name, names) for place, name in enumerate(header) if place != time and name]


def _parse_header(place: int, name: str, names: Mapping[str, tuple[str, ...]]) -> _Header:
    joint = find_column_joint(name, names)
    nameless = remove_words(name, names.get(joint, ()))
    rest, unit = _split_motion_unit(nameless)
    tokens = re.findall(r"[^\W\d_]+|\d+", rest.lower())
    senses = {_SENSE_OF[token] for token in tokens if token in _SENSE_OF}
    if unit is not None:
        senses.add(unit[0])
    others = tuple(token for token in tokens if token not in _SENSE_OF and token not in SILENT_WORDS)
    drive = unit is None and find_header_unit(nameless, DRIVE_UNITS) != ""
    return _Header(place, name, joint, frozenset(senses), unit, others, drive)


def _is_no_coordinate(header: _Header, names: Mapping[str, tuple[str, ...]]) -> bool:
    """Return True for what a drive feels, and for other words, unless one may be a joint's that is misspelt."""
    if header.drive or LEFT_OUT.search(header.name):
        return True
    suffixes = {suffix.strip(".") for kind in KINDS.values() for suffix in (*kind.q, *kind.v)}
    foreign = [token for token in header.others if not token.isdigit() and token not in suffixes]
    known = [word for words in names.values() for word in words]
    return bool(foreign) and not any(find_nearest_word(word, known) for word in (header.name, *foreign))


def _match_nameless_column(header: _Header) -> MotionColumn | None:
    """The column of a joint that is yet to be found by a number; None where other words stand there, or none of a motion."""
    plain = len(header.others) < 2 and all(token.isdigit() for token in header.others)
    if header.drive or not plain or len(header.senses) != 1:
        return None
    return MotionColumn(header.place, header.name, next(iter(header.senses)), "", "", *_read_factor(header.unit))


def _match_joint_column(header: _Header, joint: Joint) -> MotionColumn | None:
    """The column as a coordinate of its joint; None where its words or its unit are those of none."""
    places = list_place_suffixes(joint)
    suffixes = {suffix.strip("."): suffix for suffix in (*places, *KINDS[joint.kind].v) if suffix}
    ends = [suffixes[token] for token in header.others if token in suffixes]
    if header.drive or len(ends) != len(header.others) or len(ends) > 1 or len(header.senses) > 1:
        return None
    suffix = ends[0] if ends else ""
    sense = next(iter(header.senses), POSITION_COLUMNS if suffix in places else RATE_COLUMNS)
    coordinate = joint.name + suffix
    if coordinate not in list_coordinates(joint, sense) or not _has_joint_unit(joint, suffix, sense, header.unit):
        return None
    return MotionColumn(header.place, header.name, sense, joint.name, coordinate, *_read_factor(header.unit))


def _read_factor(unit: tuple[str, str, float] | None) -> tuple[float, bool]:
    return (1.0, False) if unit is None else (unit[2], True)


def _has_joint_unit(joint: Joint, suffix: str, sense: str, unit: tuple[str, str, float] | None) -> bool:
    """Return True unless the unit is of a length where the coordinate is an angle, or the other way round."""
    kind = KINDS[joint.kind]
    if unit is None:
        return True
    if sense == POSITION_COLUMNS and suffix.startswith(".q"):
        return False
    suffixes = list_place_suffixes(joint) if sense == POSITION_COLUMNS else kind.v
    return kind.units[min(suffixes.index(suffix), len(kind.units) - 1)] == unit[1]


def _split_motion_unit(text: str) -> tuple[str, tuple[str, str, float] | None]:
    """The rest of a header, and its unit: in brackets, or after the first mark behind which there is nothing else."""
    for bracket in re.finditer(r"\[(.*?)\]|\((.*?)\)", text):
        if unit := parse_motion_unit(bracket.group(1) or bracket.group(2) or ""):
            return text.replace(bracket.group(0), " "), unit
    for mark in re.finditer(r"[_\s.]", text):
        if unit := parse_motion_unit(text[mark.end() :]):
            return text[: mark.start()], unit
    return text, None


def _match_numbered_columns(
    joints: Sequence[Joint], columns: Sequence[MotionColumn]
) -> tuple[list[MotionColumn], list[str]]:
    """Columns that number the joints, as those of these joints; and those whose number means none."""
    scalar = {joint.name: joint for joint in joints if joint.nv == 1}
    given: list[MotionColumn] = []
    for sense in SENSES:
        numbered = {column.name: column for column in columns if column.sense == sense}
        alone = len(scalar) == 1 and len(numbered) == 1
        matched = (
            {next(iter(scalar)): list(numbered)} if alone else match_by_number(list(scalar.values()), list(numbered))
        )
        pairs = [(joint, numbered[name]) for joint, names in matched.items() for name in names]
        given += [replace(column, joint=joint, coordinate=joint) for joint, column in pairs]
    fitting = [c for c in given if _has_joint_unit(scalar[c.joint], "", c.sense, _split_motion_unit(c.name)[1])]
    names = {column.name for column in fitting}
    return fitting, [column.name for column in columns if column.name not in names]


def _list_ordered(found: Iterable[MotionColumn], mechanism: Mechanism, sense: str) -> tuple[MotionColumn, ...]:
    by_coordinate = {column.coordinate: column for column in found if column.sense == sense}
    order = [name for joint in mechanism.moving_joints for name in list_coordinates(joint, sense)]
    return tuple(by_coordinate[name] for name in order if name in by_coordinate)


def _check_columns(
    found: Sequence[MotionColumn],
    unknown: Sequence[str],
    left_out: Sequence[str],
    mechanism: Mechanism,
    held: Sequence[str],
    where: str,
) -> None:
    """Raise one InputError for all that does not fit."""
    faults = []
    seen: dict[tuple[str, str], str] = {}
    for column in found:
        key = (column.sense, column.coordinate)
        if key in seen:
            faults.append(f"{seen[key]!r} and {column.name!r} are both the {column.sense} of {column.coordinate}")
        if column.joint in held:
            faults.append(f"{column.name!r} moves joint {column.joint}, which is held")
        seen[key] = column.name
    if unknown:
        faults.append(
            f"no coordinate of {mechanism.name}: {_list_some(map(repr, unknown))}{_describe_nearest(unknown, mechanism)}"
        )
    senses = {column.sense for column in found} | {POSITION_COLUMNS}
    if ACCELERATION_COLUMNS in senses:
        senses.add(RATE_COLUMNS)
    for sense in SENSES:
        missing = _list_missing(seen, mechanism, held, sense) if sense in senses else []
        if missing:
            faults.append(f"no {sense} of {_list_some(missing)}")
    if faults:
        if left_out:
            faults.append(f"left out: {_list_some(map(repr, left_out))}")
        expected = (
            f"columns of {mechanism.name}: positions, or positions and rates, or accelerations, too; others left out"
        )
        still = "a joint that stands still may be held instead: --hold NAME=0, in Python hold={'NAME': 0.0}"
        write = f"{make_header(mechanism, held)}; {still}"
        raise make_input_error(where, "; ".join(faults), expected, write)


def _list_missing(
    seen: Mapping[tuple[str, str], str], mechanism: Mechanism, held: Sequence[str], sense: str
) -> list[str]:
    """Coordinates without a column; of a joint that closures or springs may move, and that a motion leaves out, none."""
    missing = []
    for joint in mechanism.joints:
        coordinates = list_coordinates(joint, sense) if joint.nv and joint.name not in held else ()
        absent = [name for name in coordinates if (sense, name) not in seen]
        whole = len(absent) == len(coordinates)
        left_out = whole and (POSITION_COLUMNS, coordinates[0] if coordinates else "") not in seen
        if not (left_out and (mechanism.closures or not joint.actuated)):
            missing += absent
    return missing


def _list_some(names: Iterable[str]) -> str:
    every = list(names)
    more = f" and {len(every) - MOST_NAMED} more" if len(every) > MOST_NAMED else ""
    return ", ".join(every[:MOST_NAMED]) + more


def _describe_nearest(unknown: Sequence[str], mechanism: Mechanism) -> str:
    """The joint that the first unknown column may mean."""
    words = map_joint_names(mechanism.moving_joints)
    owners = {word: joint for joint, known in words.items() for word in known}
    near = find_nearest_word(_split_motion_unit(unknown[0])[0].strip(), owners)
    return f" (is it {owners[near]}?)" if near else ""


def make_header(mechanism: Mechanism, held: Iterable[str] = ()) -> str:
    """Return the header of a motion of positions alone [rad], [m], as an example."""
    free = [joint for joint in mechanism.moving_joints if joint.name not in held]
    names = []
    for joint in free:
        units = KINDS[joint.kind].units
        for k, name in enumerate(list_coordinates(joint, POSITION_COLUMNS)):
            plain = ".q" in name[len(joint.name) :]
            names.append(name if plain else f"{name}_{units[min(k, len(units) - 1)]}")
    shown = names if len(names) <= MOST_NAMED else [*names[: MOST_NAMED - 1], "..."]
    return ",".join(["time_s", *shown])


def check_held_joints(hold: Mapping[str, object], mechanism: Mechanism) -> None:
    """Raise InputError for a joint that is held and that the mechanism does not move [-]."""
    moving = mechanism.moving_names
    for name in hold:
        if name not in moving:
            near = find_nearest_word(str(name), moving) or _list_some(moving)
            raise InputError(f"hold: joint {name!r} is none that moves in {mechanism.name}; write {near}")
