"""Cases: what a mechanism does, from tables of joints or CSV files, what is compared, and limits with their reasons.

Sampled motions are CSV: a column ``time_s``, then one column per coordinate, named ``<coordinate>_<unit>``: ``elbow_rad`` or
``elbow_deg`` of a joint that turns, continuous ones too, ``slide_m`` or ``slide_mm`` of a prismatic one; other coordinates are
named as in ``mechanism.coordinate_names``: ``ball.qx``, ``base.x_m``, ``cross.1_deg``.
"""

from __future__ import annotations

import csv
import datetime
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from flexinv.files import case_schema as schema
from flexinv.files.csv_dialect import find_nearest_csv
from flexinv.files.toml_tables import Location, check_table, check_table_names, make_input_error, read_bytes
from flexinv.files.values import UNITS
from flexinv.model import rules
from flexinv.model.frozen import Frozen
from flexinv.model.joint_kinds import KINDS, POSE
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array
from flexinv.validation import check_kind, find_nearest_word

# Times are decimals in a binary machine: quotients of them are whole numbers only to about 1e-13.
WHOLE_QUOTIENT = 1e-9
MOST_PARTS = 1e15  # steps in a case [-]: beyond, a number of them cannot be told from the next
LARGEST_FILE = 64 << 20  # [byte]: a million samples of a robot
LOST_SAMPLES = 3.0  # an interval this many times the median one is samples lost, not a change of pace
ANGLE_UNITS = ("rad", "deg", "mrad")
LENGTH_UNITS = ("m", "mm", "cm")
Column = tuple[str, int, float]  # joint, which of its numbers, factor to SI
# Joints that move alike: duration and hold [s], law, delay [s] -> where from and where to.
Groups = dict[tuple[float, float, str, float], tuple[dict[str, Array], dict[str, Array]]]


@dataclass(frozen=True, eq=False)
class Limit(Frozen):
    """Largest allowed difference of engines from the reference in one quantity.

    quantity : "torque", "wrench", "reaction", "tip", "deflection", "axial", "internal" or "frequency"
    engines : patterns of names (fnmatch); of several limits that match, the first one holds
    maximum : largest difference as a fraction of the reference's range [-]; reason : why that is right
    versions : of the engine, such as ">=1.13, <1.14", for which it holds; "" for all
    expires : the day after which the limit must be looked at again
    """

    quantity: str
    engines: tuple[str, ...]
    maximum: float
    reason: str
    reference: str = "flexinv"
    source: str = ""
    expires: datetime.date | None = None
    versions: str = ""

    RULES: ClassVar[rules.Rules] = {
        "quantity": rules.check_text,
        "engines": rules.make_list_rule(rules.check_text),
        "maximum": rules.make_real_rule("-", 0.0),
        "reason": rules.check_text,
        "reference": rules.check_text,
        "source": rules.check_text,
        "expires": rules.make_optional_rule(rules.make_kind_rule(datetime.date)),
        "versions": rules.check_text,
    }


@dataclass(frozen=True, eq=False)
class Case(Frozen):
    """One motion of a mechanism and what is compared.

    step : of the time integration [s]; end : of the case [s]; sample : spacing of results [s], a multiple of step
    spectral_radius : of the time integration [-]; initial : "consistent" or "static"
    mesh : (elements, order) of every beam in flexinv [-], None for the mechanism's own
    start : joint that the motion leaves out -> its coordinates at the start [rad], [m]; in a loop a guess of them
    measured : CSV file of what a machine that did this was seen to do, None where there is none
    accuracy : with which `flexinv solve` answers [-], None where it makes steps of ``step``
    """

    name: str
    title: str
    motion: Motion
    step: float
    end: float
    sample: float
    quantities: tuple[str, ...]
    limits: tuple[Limit, ...]
    spectral_radius: float = 0.8
    initial: str = "consistent"
    mesh: tuple[int, int] | None = None
    start: Mapping[str, Array] = field(default_factory=dict)
    source: str = ""
    notes: tuple[str, ...] = ()
    measured: Path | None = None
    accuracy: float | None = None

    RULES: ClassVar[rules.Rules] = {
        "name": rules.check_text, "title": rules.check_text, "step": rules.make_real_rule("s", 0.0, above=True),
        "end": rules.make_real_rule("s", 0.0, above=True), "sample": rules.make_real_rule("s", 0.0, above=True),
        "quantities": rules.make_list_rule(rules.check_text), "limits": rules.make_list_rule(rules.make_kind_rule(Limit)),
        "spectral_radius": rules.make_real_rule("-", 0.0, most=1.0), "initial": rules.make_option_rule(("consistent", "static")),
        "mesh": rules.make_optional_rule(rules.make_pair_rule(rules.count(1), rules.count(1))), "source": rules.check_text,
        "notes": rules.make_list_rule(rules.check_text), "measured": rules.make_optional_rule(rules.make_kind_rule(Path)),
        "accuracy": rules.make_optional_rule(rules.make_real_rule("-", 0.0, above=True)),
    }  # fmt: skip

    def meshed(self, mechanism: Mechanism) -> Mechanism:
        """Return the mechanism with the mesh [-] of this case, its own where the case says nothing."""
        return mechanism if self.mesh is None else mechanism.with_mesh(*self.mesh)


def load_cases(path: str | Path, mechanism: Mechanism) -> dict[str, Case]:
    """Load the cases of a mechanism by name; times in [s], angles and lengths in the unit of their keys.

    path : ``models/<name>`` or the TOML file.  The format is described in models/README.md.
    Raises InputError, which names file, table, key, what was given, what is expected and what to write.
    """
    check_kind("mechanism", mechanism, Mechanism)
    file, table = schema.read_cases(path)
    check_table_names(file, cases=table.cases)
    where = Location(file, "cases")
    if not table.cases:
        expected = schema.CasesTable.model_fields["cases"].description or ""
        raise where.make_error("", "no case", expected, "[cases.cycloid]")
    return {
        name: _build_case(data, name, table, mechanism, where.make_inner_location(name))
        for name, data in table.cases.items()
    }


def _build_case(data: Any, name: str, whole: schema.CasesTable, mechanism: Mechanism, where: Location) -> Case:
    table = check_table(schema.CaseTable, data, where)
    motion = read_motion(table.motion, mechanism, where.make_inner_location("motion"))
    start = read_start(table.start, mechanism, motion, where.make_inner_location("start"))
    end = table.end_s or motion.duration
    sample = table.sample_s or table.step_s
    mesh = (table.mesh.elements, table.mesh.order) if table.mesh is not None else None
    _check_times(table, motion, end, sample, where)
    _check_quantities(table, mechanism, where)
    measured = None if table.measured is None else _find_measured(table.measured, where)
    limits = *table.limits, *(limit for limit in whole.limits if limit.quantity in table.quantities)
    stated = tuple(Limit(**{**dict(limit), "engines": tuple(limit.engines)}) for limit in limits)
    return Case(
        name, table.title, motion, table.step_s, end, sample, tuple(table.quantities), stated,
        table.spectral_radius, table.initial, mesh, start, table.source or whole.source, tuple(table.notes),
        measured, table.accuracy,
    )  # fmt: skip


def _check_times(table: schema.CaseTable, motion: Motion, end: float, sample: float, where: Location) -> None:
    step = table.step_s
    if step > min(motion.duration, end):
        expected = f"a step shorter than the motion of {motion.duration:g} s and the case of {end:g} s [s]"
        raise where.make_error(
            "step_s", f"step_s = {step:g}", expected, f"step_s = {min(motion.duration, end) / 1000:.4g}"
        )
    for key, value, part, word in (("sample_s", sample, step, "step_s"), ("end_s", end, sample, "sample_s")):
        if value / part > MOST_PARTS:
            expected = f"at most {MOST_PARTS:g} times {word} = {part:g} [s]"
            raise where.make_error(key, f"{key} = {value:g}", expected, f"{key} = {1000 * part:.4g}")
        if not _is_multiple(value, part):
            nearby = max(round(value / part), 1) * part
            expected = f"a whole number of {word} = {part:g} [s]"
            raise where.make_error(key, f"{key} = {value:g}", expected, f"{key} = {nearby:.10g}")
    for jump in motion.jumps:
        if jump < end and not _is_multiple(jump, step):
            expected = f"a step that meets the jump of the acceleration at {jump:g} s"
            write = f"step_s = {jump / max(round(jump / step), 1):.10g}"
            raise where.make_error("step_s", f"step_s = {step:g}", expected, write)


def _is_multiple(value: float, part: float) -> bool:
    ratio = value / part
    return abs(ratio - round(ratio)) <= WHOLE_QUOTIENT * max(ratio, 1.0)


def _check_quantities(table: schema.CaseTable, mechanism: Mechanism, where: Location) -> None:
    """Check that the mechanism has the quantities of a case, and that its limits are of these."""
    for quantity in table.quantities:
        if quantity in schema.OF_BEAMS and mechanism.is_rigid:
            given = f'"{quantity}" of a mechanism without beams'
            expected = f"torque, wrench or tip: {mechanism.name} is rigid"
            raise where.make_error("quantities", given, expected, f"quantities without {quantity}")
    for k, limit in enumerate(table.limits):
        if limit.quantity not in table.quantities:
            expected = f"one of the case's quantities: {', '.join(table.quantities)}"
            write = f'"{limit.quantity}" in quantities, or no limit for it'
            raise where.make_inner_location(f"limits[{k}]").make_error(
                "quantity", f'quantity = "{limit.quantity}"', expected, write
            )


def _find_measured(name: str, where: Location) -> Path:
    """The file of what was measured, in the folder of the cases, like that of a sampled motion."""
    measured = where.file.parent / name
    if Path(name).name != name or not measured.is_file():
        near = find_nearest_word(name, sorted(p.name for p in where.file.parent.glob("*.csv")))
        write = f'measured = "{near}"' if near else "the name of a file that exists"
        expected = "the name of a CSV file in the same folder"
        raise where.make_error("measured", f'measured = "{name}"', expected, write)
    return measured


def read_motion(table: schema.MotionTable, mechanism: Mechanism, where: Location) -> Motion:
    """Make the motion [rad, m, s] that the table describes; InputError where mechanism and table do not fit."""
    if (table.law == "sampled") != (table.csv is not None):
        without = "csv", 'law = "sampled" without csv', 'csv = "..."'
        key, given, write = without if table.csv is None else ("law", "csv", 'law = "sampled"')
        raise where.make_error(key, given, 'law = "sampled" and csv together', write)
    if table.csv is not None:
        return _read_sampled_motion(table, table.csv, mechanism, where)
    groups: Groups = {}
    for name, data in table.joints.items():
        _add_move(groups, name, data, table, mechanism, where)
    if table.others is None:  # a missing joint that has an actuator is an error; else it is held at zero
        _check_complete(set(table.joints), mechanism, where)
    elif not groups:
        write = "joints.elbow = { from_deg = 0, to_deg = 90 }"
        raise where.make_error("joints", "nothing", "at least one joint that moves", write)
    else:
        _add_held_joints(*next(iter(groups.values())), table, mechanism)
    moves = ((*ends, time, hold, law, delay) for (time, hold, law, delay), ends in groups.items())
    return Motion.merge(*(Motion.point_to_point(*move) for move in moves))


def _find_joint(name: str, mechanism: Mechanism, where: Location) -> Joint:
    movable = mechanism.moving_names
    if name in movable:
        return mechanism.joint_of[name]
    near = find_nearest_word(name, movable)
    given = f"a motion for joint {name}" + (", which is fixed" if name in mechanism.joint_of else "")
    expected = f"a joint of {mechanism.name} that moves: {', '.join(movable[:20])}"
    write = f"{near} instead of {name}" if near and near != name else "one of these"
    raise where.make_inner_location("joints").make_error(name, given, expected, write)


def _read_ends(
    move: schema.MoveTable, part: Mapping[str, schema.CoordinateForm], write: str, where: Location
) -> tuple[Array, Array]:
    """Start and end of a part of a joint's coordinates, which says where from and where to, or where it rests."""
    stated = [(when, u) for when in ("from", "to", "at") for u in part if getattr(move, f"{when}_{u}") is not None]
    if [when for when, _ in stated] not in (["from", "to"], ["at"]):
        given = ", ".join(f"{when}_{u}" for when, u in stated) or "nothing"
        expected = "where from and where to, or where it rests: from_, to_ or at_ with " + " or ".join(part)
        raise where.make_error("", given, f"{expected}, each once", write)
    values = [part[u].read(getattr(move, f"{when}_{u}")) for when, u in stated]
    return values[0], values[-1]


def _check_complete(given: set[str], mechanism: Mechanism, where: Location) -> None:
    missing = [j for j in mechanism.moving_joints if j.actuated and j.name not in given]
    if missing and not mechanism.closures:  # in a loop the closures move the joints that the motion leaves out
        expected = f"a motion for every joint with an actuator; missing: {', '.join(j.name for j in missing[:10])}"
        write = f'{missing[0].name} = {schema.MOVES[KINDS[missing[0].kind].units][2]}, or others = "at_zero"'
        raise where.make_inner_location("joints").make_error(missing[0].name, "nothing", expected, write)


def read_start(tables: Mapping[str, Any], mechanism: Mechanism, motion: Motion, where: Location) -> dict[str, Array]:
    """Read the start of joints that the motion leaves out: joint -> its coordinates [rad], [m], quaternion [-]."""
    given = motion.joints(mechanism)
    passive = [joint.name for joint in mechanism.moving_joints if joint.name not in given]
    for name in tables:
        if name not in passive:
            near = find_nearest_word(name, passive)
            moved = f"a start for joint {name}" + (", which the motion moves" if name in given else "")
            expected = f"a joint that the motion leaves out: {', '.join(passive[:20]) or 'there is none'}"
            other = near and name not in given
            write = f"{near} instead of {name}" if other else f"the motion alone; no start.{name}"
            raise where.make_error(name, moved, expected, write)
    return read_places(tables, mechanism, passive, where)


def read_places(
    tables: Mapping[str, Any], mechanism: Mechanism, joints: Sequence[str], where: Location
) -> dict[str, Array]:
    """Read where joints are, each of ``joints`` or none: joint -> its coordinates [rad], [m], quaternion [-]."""
    out = {}
    for name, data in tables.items():
        if name not in joints:
            near = find_nearest_word(name, joints)
            expected = f"a joint of {mechanism.name} that moves: {', '.join(joints[:20]) or 'there is none'}"
            write = f"{near} instead of {name}" if near else f"no start.{name}"
            raise where.make_error(name, f"a start for joint {name}", expected, write)
        model, parts, write = schema.STARTS[KINDS[mechanism.joint_of[name].kind].units]
        table = check_table(model, data, where.make_inner_location(name))
        values = []
        for part in parts:
            stated = [key for key in part if getattr(table, key) is not None]
            if len(stated) != 1:
                given = " and ".join(stated) or "nothing"
                expected = f"where it starts: one of {', '.join(part)}"
                raise where.make_inner_location(name).make_error("", given, expected, write)
            values.append(part[stated[0]].read(getattr(table, stated[0])))
        out[name] = np.concatenate(values)
    return out


def _read_sampled_motion(table: schema.MotionTable, name: str, mechanism: Mechanism, where: Location) -> Motion:
    """The motion of the CSV file of that name, which has all joints and times."""
    for key in ("duration_s", "hold_s", "delay_s", "joints", "others"):
        if getattr(table, key):
            expected = "the times and joints of the CSV file alone"
            raise where.make_error(key, f"{key} beside csv", expected, "samples that rest, if so meant")
    folder = where.file.resolve().parent
    named = Path(name)
    samples = (folder / named).resolve()
    if named.is_absolute() or not samples.is_relative_to(folder):
        write = f'csv = "{named.name}"'
        raise where.make_error("csv", f'csv = "{name}"', "a file in the folder of the cases", write)
    time, columns, gap = read_samples(samples, mechanism, table.largest_gap_s)
    motion = Motion.from_samples(time, columns, rest=table.rest, max_gap=gap)
    _check_complete(set(columns), mechanism, where)
    return motion


def _add_held_joints(
    first: dict[str, Array], last: dict[str, Array], table: schema.MotionTable, mechanism: Mechanism
) -> None:
    """Hold the driven and free joints that the motion does not name at zero."""
    for joint in mechanism.joints:
        if joint.nv and joint.name not in table.joints and (joint.actuated or KINDS[joint.kind].layout == POSE):
            first[joint.name] = last[joint.name] = mechanism.neutral[mechanism.q_slices[joint.name]]


def _add_move(
    groups: Groups, name: str, data: Any, table: schema.MotionTable, mechanism: Mechanism, where: Location
) -> None:
    """Add the move of a joint to those that are alike; what it does not say of times and law the motion says."""
    here = where.make_inner_location(f"joints.{name}")
    model, parts, write = schema.MOVES[KINDS[_find_joint(name, mechanism, where).kind].units]
    move = check_table(model, data, here)
    duration = move.duration_s or table.duration_s
    if duration is None:
        expected = schema.MotionTable.model_fields["duration_s"].description or ""
        raise where.make_error("duration_s", "nothing", expected, "duration_s = 1.0")
    hold = table.hold_s if move.hold_s is None else move.hold_s
    delay = table.delay_s if move.delay_s is None else move.delay_s
    first, last = groups.setdefault((duration, hold, move.law or table.law, delay), ({}, {}))
    ends = zip(*(_read_ends(move, part, write, here) for part in parts), strict=True)
    first[name], last[name] = map(np.concatenate, ends)


def read_samples(path: Path, mechanism: Mechanism, largest_gap: float | None) -> tuple[Array, dict[str, Array], float]:
    """Read time (samples,) [s], joint -> (samples, numbers) [rad, m, -], and the longest interval allowed [s].

    InputError names the line: a column that is no coordinate, a missing or odd number, times that do not increase,
    a gap longer than ``largest_gap`` [s] (three times the median interval when None).
    """
    rows = list(_read_rows(path))
    header = [name.strip() for name in rows[0][1]] if rows else []
    columns = _read_columns(header, mechanism, path)
    table = np.array([_read_row(header, row, f"{path}: line {line}") for line, row in rows[1:]])
    if len(table) < 2:
        raise make_input_error(str(path), f"{len(table)} rows of numbers", "two or more samples", "one row per time")
    time = table[:, 0]
    gap = LOST_SAMPLES * float(np.median(np.diff(time))) if largest_gap is None else largest_gap
    _check_sample_times(time, gap, [f"{path}: line {line}, column time_s" for line, _ in rows[1:]])
    joints = {}
    for joint in mechanism.joints:
        joint_columns = sorted((k, column) for column, (name, k, _) in enumerate(columns) if name == joint.name)
        if joint_columns:
            joints[joint.name] = np.stack(
                [table[:, 1 + c] * columns[c][2] for _, c in joint_columns], axis=1
            )  # (sample, number)
    return time, joints, gap


def _read_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Lines that are not empty, with their numbers."""
    near = find_nearest_csv(path)
    data = read_bytes(path, LARGEST_FILE, "a CSV file", near or "the name of a file that exists", "fewer samples")
    try:
        reader = csv.reader(io.StringIO(data.decode("utf-8-sig"), newline=""), strict=True)
        for row in reader:
            if any(cell.strip() for cell in row):
                yield reader.line_num, row
    except (UnicodeDecodeError, csv.Error) as error:
        raise make_input_error(
            str(path), f"no CSV: {error}", "UTF-8 text, commas between numbers", "the file again"
        ) from None


def _read_row(header: list[str], row: list[str], where: str) -> list[float]:
    """The numbers of a line."""
    if len(row) != len(header):
        expected = f"{len(header)}, as in the first line"
        raise make_input_error(where, f"{len(row)} cells", expected, "a number in each column")
    numbers = []
    for name, cell in zip(header, row, strict=True):
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            place = f"{where}, column {name}"
            raise make_input_error(place, repr(cell[:40]), "a finite number", "the number, or leave the line out")
        numbers.append(value)
    return numbers


def _check_sample_times(time: Array, gap: float, places: list[str]) -> None:
    """Check that times begin at zero and increase by at most ``gap``; places : of each in its file, in words."""
    steps = np.diff(time)
    k = int(np.argmax(steps <= 0))
    if steps[k] <= 0:
        given = f"{time[k + 1]:g} after {time[k]:g}"
        write = "the rows sorted by time, each time once"
        raise make_input_error(places[k + 1], given, "times that increase [s]", write)
    if time[0] != 0.0:
        raise make_input_error(places[0], f"{time[0]:g}", "a first time of 0 [s]", f"all times less {time[0]:g}")
    k = int(np.argmax(steps))
    if steps[k] > gap:
        given = f"a gap of {steps[k]:g} s, from {time[k]:g} to {time[k + 1]:g}"
        write = f"the samples between, or largest_gap_s = {steps[k] * 1.001:.4g} if the spline may cross it"
        raise make_input_error(places[k + 1], given, f"at most {gap:g} s between samples", write)


def _read_columns(header: list[str], mechanism: Mechanism, path: Path) -> list[Column]:
    known = _list_known_columns(mechanism)
    where = f"{path}: line 1"
    if not header or header[0] != "time_s":
        given = f"first column {header[0]!r}" if header else "an empty file"
        first_units = {(joint, k): name for name, (joint, k, _) in reversed(known.items())}
        raise make_input_error(
            where, given, "time_s, the time [s]", ",".join(["time_s", *reversed(first_units.values())])
        )
    for k, name in enumerate(header[1:], 2):
        if name not in known:
            near = find_nearest_word(name, known)
            expected = "a coordinate with its unit: " + ", ".join(list(known)[:12])
            raise make_input_error(f"{where}, column {k}", name, expected, near or "one of these")
    columns = [known[name] for name in header[1:]]
    _check_coordinates(header, columns, known, where)
    return columns


def _list_known_columns(mechanism: Mechanism) -> dict[str, Column]:
    """All names that a column may have."""
    known: dict[str, Column] = {}
    for joint in mechanism.joints:
        kind = KINDS[joint.kind]
        units = LENGTH_UNITS if any(kind.translations) else ANGLE_UNITS
        for k, suffix in enumerate(("",) if kind.circle else kind.q):
            if suffix.startswith(".q"):
                known[joint.name + suffix] = (joint.name, k, 1.0)
            else:
                known |= {f"{joint.name}{suffix}_{unit}": (joint.name, k, UNITS[unit][unit]) for unit in units}
    return known


def _check_coordinates(header: list[str], columns: list[Column], known: Mapping[str, Column], where: str) -> None:
    """Check that each coordinate stands there once, and all of a joint or none."""
    places = [(joint, k) for joint, k, _ in columns]
    for k, found in enumerate(places):
        if found in places[:k]:
            given = f"{header[k + 1]}: joint {found[0]} twice"
            raise make_input_error(f"{where}, column {k + 2}", given, "each coordinate once", "one of the two")
    moved = {joint for joint, _ in places}
    for name, (owner, k, _) in known.items():
        if (owner, k) not in places and owner in moved:
            given = f"some coordinates of joint {owner}"
            raise make_input_error(where, given, "all its coordinates", f"a column {name}")
