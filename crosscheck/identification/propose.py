"""A first identify.toml, proposed from a mechanism and the header of a log: columns by name and unit, priors by the mechanism."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from crosscheck.identification.filters import low_pass
from crosscheck.identification.logs.header import Column, Found
from crosscheck.identification.logs.log import Log
from crosscheck.identification.logs.meanings import Meaning, find_meanings
from crosscheck.identification.settings import ANGLES, EFFORTS
from flexinv.errors import InputError
from flexinv.files.values import FORMAT
from flexinv.model.mechanism import Drive, Joint, Mechanism

SMALL = 0.05  # of the effort's spread: a first value of what the mechanism says nothing of: friction, rotor inertia
QUICK = 0.02  # of the largest rate: slower joints stand
# relative errors of friction and rotor inertia: with and without a value of the mechanism
KNOWN = 0.5
UNKNOWN = 1.5
DRAWN = 0.2  # relative error of masses that are drawn, not weighed
LOAD = 0.1  # of the mass that moves: a tool or payload that nobody wrote down
OFFSET = 0.1  # of the effort's spread: an offset of its sensor
WIDEST = 2.5  # relative error of a mass, and of a torque constant that nobody wrote: a factor of twelve
LAW = 'friction = "evidence"   # terms beside Coulomb and viscous friction are free where logs left out are told better by them'
LIMITS = """
# What logs that are held out have to reach: without limits nothing is judged.  Remove the marks when you know what you need.
# [[limits]]
# channel = ["torque/*"]
# explained = 0.95
# coverage = [0.8, 0.97]"""


def format_identify_toml(
    mechanism: Mechanism,
    log: Log,
    time: str = "time_s",
    unit: tuple[str, str] = ("s", ""),
    behind: bool = False,
) -> str:
    """Return the text of a first identify.toml [unit of each key]; time, unit : column of times, its unit and a doubt about it.

    behind : efforts are torques behind the gears, which are no currents [-]

    Raises InputError where no column is an angle of a joint.
    """
    joints = [j for j in mechanism.joints if j.nv == 1 and j.actuated] or [j for j in mechanism.joints if j.nv == 1]
    columns, meanings = find_meanings(joints, log)
    found = {j.name: kinds for j in joints if "angle" in (kinds := columns.get(j.name, {}))}
    if not found:
        raise InputError(
            f"{log.name}: no column looks like the angle of a joint ({', '.join(j.name for j in joints)}); it has "
            f"{', '.join(list(log.columns)[:40])}; write {joints[0].name if joints else 'q1'}_rad or _deg into the header"
        )
    lost = [j.name for j in joints if j.name not in found]
    linked = _find_link_sensors(found) if behind else set()
    head = [*_format_head(log, found, time, unit), *([] if linked == set(found) else [LAW])]
    return (
        "\n".join(
            [
                *head,
                *_format_meanings(meanings),
                *_format_joint_tables(mechanism, found, lost, linked),
                *_format_free_tables(mechanism, log, found, linked),
                LIMITS,
            ]
        )
        + "\n"
    )


def _find_link_sensors(columns: Found) -> set[str]:
    """The joints of which an effort is no current: a torque behind the gear."""
    return {name for name, kinds in columns.items() if "effort" in kinds and kinds["effort"].unit != "A"}


def _format_head(log: Log, columns: Found, time: str, unit: tuple[str, str]) -> Iterator[str]:
    rate = max(rate for rate, _ in _find_peak_rates(log, columns).values())
    yield f"format = {FORMAT}"
    yield f"source = {json.dumps(f'proposed for {log.name} by crosscheck identify --propose: read every line')}"
    if time != "time_s":
        yield f"time = {json.dumps(time)}"
    if unit[0] != "s" or unit[1]:
        yield f'time_unit = "{unit[0]}"{_format_comment([unit[1]])}'
    yield f"bandwidth_Hz = {_choose_bandwidth(log):.3g}      # above it nothing is compared"
    yield f"still_rad_per_s = {QUICK * rate:.2g}   # slower than this a joint stands"
    yield f"block_s = {max(0.5, (log.time[-1] - log.time[0]) / 8.0):.3g}"


def _format_meanings(meanings: Iterable[Meaning]) -> Iterator[str]:
    """Lines that say of each column its meaning; names as TOML writes them, so that none begins a line of its own."""
    yield "\n# What each column was taken for:"
    for one in meanings:
        yield f"#   {json.dumps(one.column, ensure_ascii=False)}: {' '.join(one.words.split())}"


def _choose_bandwidth(log: Log) -> float:
    return min(10.0, 0.1 / log.spacing)


def _find_peak_rates(log: Log, columns: Found) -> dict[str, tuple[float, float]]:
    """Largest rates [rad/s], [m/s] and accelerations [1/s of these], but for the quickest hundredth of the samples."""
    out = {}
    for name, kinds in columns.items():
        angle = (
            low_pass(log.read_column(kinds["angle"].name), log.spacing, _choose_bandwidth(log))
            * ANGLES[kinds["angle"].unit]
        )
        rate = np.gradient(angle, log.spacing)
        both = [float(np.quantile(np.abs(x), 0.99)) for x in (rate, np.gradient(rate, log.spacing))]
        out[name] = (max(both[0], 1e-9), max(both[1], 1e-9))
    return out


def _format_joint_tables(mechanism: Mechanism, columns: Found, lost: list[str], linked: set[str]) -> Iterator[str]:
    for name, kinds in columns.items():
        yield f"\n[joints.{_format_key(name)}]"
        for kind, column in kinds.items():
            yield _format_column(kind, column, mechanism.joint_of[name].drive, name in linked)
    if lost:
        yield f"\n# no column was found for the angle of: {', '.join(lost)}"


def _format_column(kind: str, column: Column, drive: Drive | None, behind: bool) -> str:
    words = f'column = {json.dumps(column.name)}, unit = "{column.unit}"'
    doubts = [column.why] if column.why else []
    if kind == "effort" and behind:
        words += ', side = "link"'
    elif kind == "effort" and _is_at_motor(column) and drive is not None and drive.ratio != 1.0:
        words += ', side = "motor"'
    if kind == "effort" and _needs_constant(column, drive):
        words += ", constant_Nm_per_A = 1.0"
        doubts.append('write the torque constant, and remove its "effort gain" below')
    return f"{kind} = {{ {words} }}{_format_comment(doubts)}"


def _format_comment(doubts: Iterable[str]) -> str:
    """Doubts behind a line, on that line whatever the names in them hold; "" for none."""
    words = " ".join("; ".join(filter(None, doubts)).split())
    return f"   # {words}" if words else ""


def _is_at_motor(column: Column) -> bool:
    return "motor" in column.name.lower()


def _needs_constant(column: Column, drive: Drive | None) -> bool:
    """Return true for a current whose torque per ampere nobody states."""
    return column.unit == "A" and (drive is None or not drive.torque_constant)


def _format_free_tables(mechanism: Mechanism, log: Log, columns: Found, linked: set[str]) -> Iterator[str]:
    yield from _format_mass_tables(mechanism)
    quickest = _find_peak_rates(log, columns)
    for name, kinds in columns.items():
        if "effort" in kinds:
            if name not in linked:
                yield from _format_drive_tables(mechanism.joint_of[name], kinds["effort"], log, quickest[name])
            yield from _format_sensor_tables(mechanism.joint_of[name], kinds["effort"], log)
    if mechanism.beams:
        yield from _format_free_table("beam stiffness", ["*"], "relative = 0.2")
    if mechanism.springs:
        yield from _format_free_table("spring force", ["*"], "relative = 0.1")


def _format_drive_tables(joint: Joint, column: Column, log: Log, quickest: tuple[float, float]) -> Iterator[str]:
    """Friction and rotor inertia of a joint; of an unknown torque constant they are known less.

    quickest : largest rate and acceleration of the joint [rad/s], [rad/s^2]
    """
    rate, acceleration = quickest
    scaled = not _needs_constant(column, joint.drive)
    spread = float(np.std(log.read_column(column.name))) * EFFORTS[column.unit]
    small = SMALL * spread * (joint.drive.ratio if joint.drive is not None and _is_at_motor(column) else 1.0)
    known = {
        "viscous friction": (joint.damping, small / rate),
        "coulomb friction": (joint.friction, small),
        "rotor inertia": (joint.rotor_inertia, small / acceleration),
    }
    for kind, (value, first) in known.items():
        width = KNOWN if kind != "rotor inertia" else 0.1
        start = f"value = {max(first, 1e-9):.3g}   # the mechanism has none: a small part of the effort\n"
        lines = f"relative = {width}" if value > 0.0 else f"{start}relative = {UNKNOWN if scaled else WIDEST}"
        yield from _format_free_table(kind, [joint.name], lines)


def _format_sensor_tables(joint: Joint, column: Column, log: Log) -> Iterator[str]:
    """Offset of an effort, and its gain where nobody states the torque constant."""
    scaled = not _needs_constant(column, joint.drive)
    spread = float(np.std(log.read_column(column.name))) * EFFORTS[column.unit]
    offset = OFFSET * spread if scaled else spread
    yield from _format_free_table("effort offset", [joint.name], f"error = {max(offset, 1e-9):.3g}")
    if not scaled:
        why = "1 over the torque constant, which nobody wrote: remove it when constant_Nm_per_A is written"
        yield from _format_free_table("effort gain", [joint.name], f"relative = {WIDEST}", why)


def _format_mass_tables(mechanism: Mechanism) -> Iterator[str]:
    """Mass properties of the links that move; wider at the ends, which may carry what the mechanism does not know."""
    carried = {j.child: j for j in mechanism.joints}
    masses = {
        link.name: mass
        for link in mechanism.links
        if link.beam is None
        and (mass := sum(b.inertia.mass for b in link.bodies)) > 0
        and _is_moving_link(link.name, carried)
    }
    if not masses:
        return
    all_of_them = len(masses) == sum(link.beam is None for link in mechanism.links)
    places = ["*"] if all_of_them else list(masses)
    yield from _format_free_table(
        "mass properties", places, f"relative = {DRAWN}", "of drawings; what was weighed is known better"
    )
    for name in _list_end_links(mechanism, masses, carried):
        wide = min(WIDEST, float(np.log1p(LOAD * sum(masses.values()) / masses[name])))
        if wide > DRAWN:
            why = (
                "at an end: room for a tool or payload that the mechanism does not know; remove it where there is none"
            )
            yield from _format_free_table("mass properties", [name], f"relative = {wide:.2g}", why)


def _is_moving_link(link: str, carried: Mapping[str, Joint]) -> bool:
    while link in carried:
        if carried[link].nv:
            return True
        link = carried[link].parent
    return False


def _list_end_links(mechanism: Mechanism, masses: Mapping[str, float], carried: Mapping[str, Joint]) -> Iterator[str]:
    """Of each body that carries none that moves on it, and that no closure holds, the last link with a mass."""
    body = {}
    for link in carried:
        root = link
        while root in carried and not carried[root].nv:
            root = carried[root].parent
        body[link] = root
    busy = {body.get(j.parent, j.parent) for j in mechanism.joints if j.nv}
    busy |= {body.get(e.link, e.link) for c in mechanism.closures for e in (c.first, c.second)}
    last = {body[link]: link for link in masses if link in body and body[link] not in busy}
    yield from last.values()


def _format_free_table(kind: str, places: list[str], lines: str, why: str = "") -> Iterator[str]:
    yield "\n[[free]]" + (f"   # {why}" if why else "")
    yield f'parameter = "{kind}"'
    yield f"place = {json.dumps(places)}"
    yield lines


def _format_key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name)
