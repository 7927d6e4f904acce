"""The motion of a case, from tables of joints or a CSV file, and the start of joints that it leaves out (in a loop a guess)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flexinv.files.case_csv import read_samples
from flexinv.files.case_schema import MOVES, STARTS, MotionTable, MoveTable, Way
from flexinv.files.toml_tables import Location, Table, validate
from flexinv.model.joint_kinds import KINDS, POSE
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array
from flexinv.validation import nearest

Timing = tuple[str, float, float, float]  # law, duration, hold, delay [s]
Groups = dict[Timing, tuple[dict[str, Array], dict[str, Array]]]  # joints that move alike -> where from and where to


def read_motion(table: MotionTable, mechanism: Mechanism, where: Location) -> Motion:
    """Make the motion [rad, m, s] that the table describes; InputError where mechanism and table do not fit."""
    if (table.law == "sampled") != (table.csv is not None):
        without = "csv", 'law = "sampled" without csv', 'csv = "..."'
        key, given, write = without if table.csv is None else ("law", "csv", 'law = "sampled"')
        raise where.wrong(key, given, 'law = "sampled" and csv together', write)
    if table.csv is not None:
        return _sampled(table, table.csv, mechanism, where)
    groups: Groups = {}
    for name, data in table.joints.items():
        here = where.inner(f"joints.{name}")
        model, parts, write = MOVES[KINDS[_joint(name, mechanism, where).kind].units]
        move = validate(model, data, here)
        ends = zip(*(_ends(move, part, write, here) for part in parts), strict=True)
        first, last = groups.setdefault(_timing(move, table, where), ({}, {}))
        first[name], last[name] = map(np.concatenate, ends)
    _add_others(groups, table, mechanism, where)
    motions = [
        Motion.point_to_point(first, last, duration, hold, law, delay)
        for (law, duration, hold, delay), (first, last) in groups.items()
    ]
    return Motion.merge(*motions)


def _sampled(table: MotionTable, csv: str, mechanism: Mechanism, where: Location) -> Motion:
    for name in ("duration_s", "hold_s", "delay_s", "joints", "others"):
        if getattr(table, name):
            expected = "the times and joints of the CSV file alone"
            raise where.wrong(name, f"{name} beside csv", expected, "samples that rest, if so meant")
    folder = where.file.resolve().parent
    samples = (folder / csv).resolve()
    if Path(csv).is_absolute() or not samples.is_relative_to(folder):
        raise where.wrong("csv", f'csv = "{csv}"', "a file in the folder of the cases", f'csv = "{Path(csv).name}"')
    time, columns, gap = read_samples(samples, mechanism, table.largest_gap_s)
    motion = Motion.from_samples(time, columns, rest=table.rest, max_gap=gap)
    _check_complete(set(columns), mechanism, where)
    return motion


def _joint(name: str, mechanism: Mechanism, where: Location) -> Joint:
    movable = [joint.name for joint in mechanism.joints if joint.nv]
    if name in movable:
        return mechanism.joint_of[name]
    near = nearest(name, movable)
    given = f"a motion for joint {name}" + (", which is fixed" if name in mechanism.joint_of else "")
    expected = f"a joint of {mechanism.name} that moves: {', '.join(movable[:20])}"
    write = f"{near} instead of {name}" if near and near != name else "one of these"
    raise where.inner("joints").wrong(name, given, expected, write)


def _timing(move: MoveTable, table: MotionTable, where: Location) -> Timing:
    duration = move.duration_s or table.duration_s
    if duration is None:
        expected = MotionTable.model_fields["duration_s"].description or ""
        raise where.wrong("duration_s", "nothing", expected, "duration_s = 1.0")
    hold = table.hold_s if move.hold_s is None else move.hold_s
    delay = table.delay_s if move.delay_s is None else move.delay_s
    return move.law or table.law, duration, hold, delay


def _ends(move: MoveTable, part: Mapping[str, Way], write: str, where: Location) -> tuple[Array, Array]:
    """Start and end of a part of a joint's coordinates, which says where from and where to, or where it rests."""
    stated = [(when, u) for when in ("from", "to", "at") for u in part if getattr(move, f"{when}_{u}") is not None]
    if [when for when, _ in stated] not in (["from", "to"], ["at"]):
        given = ", ".join(f"{when}_{u}" for when, u in stated) or "nothing"
        expected = "where from and where to, or where it rests: from_, to_ or at_ with " + " or ".join(part)
        raise where.wrong("", given, f"{expected}, each once", write)
    values = [part[u].read(getattr(move, f"{when}_{u}")) for when, u in stated]
    return values[0], values[-1]


def _add_others(groups: Groups, table: MotionTable, mechanism: Mechanism, where: Location) -> None:
    """Hold what is not listed at zero if the table says so; a missing joint that has an actuator is an error."""
    if table.others is None:
        return _check_complete(set(table.joints), mechanism, where)
    if not groups:
        write = "joints.elbow = { from_deg = 0, to_deg = 90 }"
        raise where.wrong("joints", "nothing", "at least one joint that moves", write)
    first, last = next(iter(groups.values()))
    for joint in mechanism.joints:
        if joint.nv and joint.name not in table.joints and (joint.actuated or KINDS[joint.kind].layout == POSE):
            first[joint.name] = last[joint.name] = mechanism.neutral[mechanism.q_slices[joint.name]]
    return None


def _check_complete(given: set[str], mechanism: Mechanism, where: Location) -> None:
    missing = [j for j in mechanism.joints if j.nv and j.actuated and j.name not in given]
    if missing and not mechanism.closures:  # in a loop the closures move the joints that the motion leaves out
        expected = f"a motion for every joint with an actuator; missing: {', '.join(j.name for j in missing[:10])}"
        write = f'{missing[0].name} = {MOVES[KINDS[missing[0].kind].units][2]}, or others = "at_zero"'
        raise where.inner("joints").wrong(missing[0].name, "nothing", expected, write)


def read_start(tables: Mapping[str, Any], mechanism: Mechanism, motion: Motion, where: Location) -> dict[str, Array]:
    """Read the start of joints that the motion leaves out: joint -> its coordinates [rad], [m], quaternion [-]."""
    given = motion.joints(mechanism)
    passive = [joint.name for joint in mechanism.joints if joint.nv and joint.name not in given]
    for name in tables:
        if name not in passive:
            near = nearest(name, passive)
            moved = f"a start for joint {name}" + (", which the motion moves" if name in given else "")
            expected = f"a joint that the motion leaves out: {', '.join(passive[:20]) or 'there is none'}"
            alone = f"the motion alone; no start.{name}"
            raise where.wrong(
                name, moved, expected, f"{near} instead of {name}" if near and name not in given else alone
            )
    return read_places(tables, mechanism, passive, where)


def read_places(
    tables: Mapping[str, Any], mechanism: Mechanism, joints: list[str], where: Location
) -> dict[str, Array]:
    """Read where joints are, each of ``joints`` or none: joint -> its coordinates [rad], [m], quaternion [-]."""
    out = {}
    for name, data in tables.items():
        if name not in joints:
            near = nearest(name, joints)
            expected = f"a joint of {mechanism.name} that moves: {', '.join(joints[:20]) or 'there is none'}"
            write = f"{near} instead of {name}" if near else f"no start.{name}"
            raise where.wrong(name, f"a start for joint {name}", expected, write)
        model, parts, write = STARTS[KINDS[mechanism.joint_of[name].kind].units]
        table = validate(model, data, where.inner(name))
        out[name] = np.concatenate([_start(table, part, write, where.inner(name)) for part in parts])
    return out


def _start(table: Table, part: Mapping[str, Way], write: str, where: Location) -> Array:
    stated = [key for key in part if getattr(table, key) is not None]
    if len(stated) != 1:
        raise where.wrong("", " and ".join(stated) or "nothing", f"where it starts: one of {', '.join(part)}", write)
    return part[stated[0]].read(getattr(table, stated[0]))
