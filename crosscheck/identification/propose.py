"""A first identify.toml, proposed from a mechanism and the header of a log: columns by name and unit, priors by the mechanism."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from crosscheck.identification.logs.log import Log
from crosscheck.identification.settings import ANGLES, EFFORTS
from flexinv.errors import InputError
from flexinv.files.values import FORMAT
from flexinv.model.mechanism import Joint, Mechanism

# How a header writes units -> unit of identify.toml; a rate is no angle.
UNITS = {
    "deg": "deg", "rad": "rad", "mm": "mm", "m": "m", "nm": "N m", "n m": "N m", "n": "N", "a": "A", "mnm": "mN m",
    "amp": "A", "amps": "A", "degrees": "deg", "radians": "rad",
}  # fmt: skip
RATES = re.compile(r"per_s|/s|_s\b|rate|vel|speed|acc|qd|dq", re.IGNORECASE)
TOLD = re.compile(r"ref|des|cmd|command|target|setpoint|error", re.IGNORECASE)
SECOND = re.compile(r"link|secondary|output|joint_side", re.IGNORECASE)
ANGLE = re.compile(r"angle|pos|^q\d*|theta|phi", re.IGNORECASE)
EFFORT = re.compile(r"torque|effort|current|tau|force|^i\d+|^t\d+", re.IGNORECASE)
TIME = re.compile(r"^(t|time|timestamp|stamp|clock)\b|^time|_time$", re.IGNORECASE)
SMALL = 0.05  # of the effort's spread: a first value of friction where the mechanism has none
QUICK = 0.02  # of the largest rate: slower joints stand


def time_of(names: Sequence[str]) -> str:
    """Return the column that looks like times [s]; "time_s" where none does, which the reader of logs then misses in words."""
    like = [name for name in names if name == "time_s"] or [name for name in names if TIME.search(name)]
    return like[0] if like else "time_s"


def proposed(mechanism: Mechanism, log: Log, time: str = "time_s") -> str:
    """Return the text of a first identify.toml [unit of each key]; time : name of the column of times.

    Raises InputError where no column is an angle of a joint.
    """
    joints = [j for j in mechanism.joints if j.nv == 1 and j.actuated] or [j for j in mechanism.joints if j.nv == 1]
    found = {j.name: _columns(j, k, joints, log) for k, j in enumerate(joints)}
    found = {name: own for name, own in found.items() if "angle" in own}
    if not found:
        raise InputError(
            f"{log.name}: no column looks like the angle of a joint ({', '.join(j.name for j in joints)}); it has "
            f"{', '.join(list(log.columns)[:40])}; write {joints[0].name if joints else 'q1'}_rad or _deg into the header"
        )
    return "\n".join([*_head(log, found, time), *_joints(mechanism, found), *_free(mechanism, log, found)]) + "\n"


Found = Mapping[str, Mapping[str, tuple[str, str]]]


def _columns(joint: Joint, number: int, joints: Sequence[Joint], log: Log) -> dict[str, tuple[str, str]]:
    slides = joint.kind == "prismatic"
    kinds: dict[str, list[tuple[str, str]]] = {"angle": [], "link_angle": [], "effort": []}
    for name in log.columns:
        unit = _unit(name)
        if TOLD.search(name):
            continue
        if not RATES.search(name) and (unit in ANGLES or (not unit and ANGLE.search(name))):
            fits = not unit or (unit in ("m", "mm")) == slides
            if fits:
                kinds["link_angle" if SECOND.search(name) else "angle"].append(
                    (name, unit or ("m" if slides else "rad"))
                )
        elif unit in EFFORTS or (not unit and EFFORT.search(name)):
            kinds["effort"].append((name, unit or ("N" if slides else "N m")))
    out = {}
    for kind, all_ in kinds.items():
        named = [c for c in all_ if joint.name.lower() in c[0].lower()]
        numbered = [c for c in all_ if re.findall(r"\d+", c[0])[:1] == [str(number + 1)]]
        ordered = [all_[number]] if len(all_) == len(joints) and not any(_owned(c[0], joints) for c in all_) else []
        if chosen := named or numbered or ordered:
            out[kind] = chosen[0]
    return out


def _owned(column: str, joints: Sequence[Joint]) -> bool:
    return any(j.name.lower() in column.lower() for j in joints)


def _unit(name: str) -> str:
    bracket = re.search(r"\[(.*?)\]|\((.*?)\)", name)
    last = next(filter(None, bracket.groups()), "") if bracket else name.rsplit("_", 1)[-1] if "_" in name else ""
    return UNITS.get(last.strip().lower().replace("*", " "), "")


def _head(log: Log, found: Found, time: str) -> Iterator[str]:
    rate = max(_rates(log, found).values())
    yield f"format = {FORMAT}"
    yield f"source = {json.dumps(f'proposed for {log.name} by crosscheck identify --propose: read every line')}"
    if time != "time_s":
        yield f"time = {json.dumps(time)}      # [s]"
    yield f"bandwidth_Hz = {min(10.0, 0.1 / log.spacing):.3g}      # above it nothing is compared"
    yield f"still_rad_per_s = {QUICK * rate:.2g}   # slower than this a joint stands"
    yield f"block_s = {max(0.5, (log.time[-1] - log.time[0]) / 8.0):.3g}"


def _rates(log: Log, found: Found) -> dict[str, float]:
    """Largest rates [rad/s], [m/s], but for the quickest hundredth of the samples."""
    out = {}
    for name, own in found.items():
        column, unit = own["angle"]
        rate = np.abs(np.gradient(log.columns[column], log.spacing)) * ANGLES[unit]
        out[name] = float(np.nanquantile(rate, 0.99))
    return out


def _joints(mechanism: Mechanism, found: Found) -> Iterator[str]:
    for name, own in found.items():
        drive = mechanism.joint_of[name].drive
        yield f"\n[joints.{_key(name)}]"
        for kind, (column, unit) in own.items():
            words = f'column = {json.dumps(column)}, unit = "{unit}"'
            if kind == "effort" and "motor" in column.lower() and drive is not None and drive.ratio != 1.0:
                words += ', side = "motor"'
            if kind == "effort" and unit == "A" and (drive is None or not drive.torque_constant):
                words += ", constant_Nm_per_A = 1.0"
            unknown = "   # write the torque constant" if "constant_Nm_per_A = 1.0" in words else ""
            yield f"{kind} = {{ {words} }}{unknown}"


def _free(mechanism: Mechanism, log: Log, found: Found) -> Iterator[str]:
    if any(link.beam is None and sum(b.inertia.mass for b in link.bodies) > 0 for link in mechanism.links):
        yield from _table("mass properties", ["*"], "relative = 0.2", "of drawings; what was weighed is known better")
    rates = _rates(log, found)
    for name, own in found.items():
        if "effort" not in own:
            continue
        joint, column = mechanism.joint_of[name], own["effort"]
        spread = float(np.nanstd(log.columns[column[0]])) * EFFORTS[column[1]]
        ratio = joint.drive.ratio if joint.drive is not None and "motor" in column[0].lower() else 1.0
        known = {"viscous friction": joint.damping, "coulomb friction": joint.friction}
        first = {"viscous friction": spread * ratio / max(rates[name], 1e-9), "coulomb friction": spread * ratio}
        for kind, value in known.items():
            start = f"value = {SMALL * first[kind]:.3g}\n" if value <= 0.0 else ""
            yield from _table(kind, [name], f"{start}relative = {0.5 if value > 0.0 else 1.5}")
        if joint.rotor_inertia > 0.0:
            yield from _table("rotor inertia", [name], "relative = 0.1")
        yield from _table("effort offset", [name], f"error = {max(0.1 * spread, 1e-9):.3g}")
    if mechanism.beams:
        yield from _table("beam stiffness", ["*"], "relative = 0.2")
    if mechanism.springs:
        yield from _table("spring force", ["*"], "relative = 0.1")


def _table(kind: str, places: list[str], lines: str, why: str = "") -> Iterator[str]:
    yield "\n[[free]]" + (f"   # {why}" if why else "")
    yield f'parameter = "{kind}"'
    yield f"place = {json.dumps(places)}"
    yield lines


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name)
