"""identified.toml: what was identified, laid over the mechanism file, with intervals in comments; it loads like any mechanism.

The gain of a current is a torque constant: the stated one over the gain, of the motor where the joint has a drive.  Parameters of
sensors, laws of friction that a mechanism file does not have, and places in a URDF stand in comments at its end.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck import output_folder as owned
from crosscheck.identification.identify import Identification
from crosscheck.identification.machine import Channel, Machine, resolve_value
from crosscheck.identification.parameters import COUPLING
from crosscheck.identification.responses.response import compute_link_inertias, turn_gravity
from crosscheck.identification.table import Row
from crosscheck.report.words import format_by_width, format_interval, format_short
from flexinv.files.joints import DRIVES
from flexinv.files.load_mechanism import read_layers
from flexinv.model.mechanism import SPRING, Joint, Mechanism

LINKS = ("mass", "com x", "com y", "com z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
# kind -> key of a joint that turns, of one that slides, key of its drive
JOINTS = {
    "rotor inertia": ("rotor_inertia_kgm2", "rotor_inertia_kg", "motor_inertia_kgm2"),
    "viscous friction": ("damping_Nms_per_rad", "damping_Ns_per_m", "viscous_Nms_per_rad"),
    "coulomb friction": ("friction_Nm", "friction_N", "coulomb_Nm"),
    "joint stiffness": ("stiffness_Nm_per_rad", "stiffness_N_per_m", ""),
    "joint damping": ("damping_Nms_per_rad", "damping_Ns_per_m", "viscous_Nms_per_rad"),
    "joint friction": ("friction_Nm", "friction_N", "coulomb_Nm"),
}
# Of the gear ratio, from the joint to the motor.
POWER = {"rotor inertia": 2, "viscous friction": 2, "joint damping": 2, "coulomb friction": 1, "joint friction": 1}
SCALED = {"stiffness_N_per_m", "force_N"}
OF_SECTION = {"EA_N", "GA_N", "GJ_Nm2", "EI_Nm2", "E_Pa", "G_Pa", "stiffness_matrix"}
Tables = dict[str, dict[str, tuple[Any, str]]]


@dataclass(frozen=True)
class Layer:
    """A mechanism, and the tables of links, joints and sections of the file that it was read from.

    prefix : of the tables laid over it, "overlay." of a URDF
    """

    mechanism: Mechanism
    prefix: str
    links: Mapping[str, Any]
    joints: Mapping[str, Any]
    sections: Mapping[str, Any]

    @classmethod
    def build(cls, mechanism: Mechanism, data: Mapping[str, Any]) -> Layer:
        """Build the layer of a mechanism file's ``data`` [any unit]."""
        layer = data.get("overlay", {}) if "urdf" in data else data
        tables = (layer.get("links", {}), layer.get("joints", {}), data.get("sections", {}))
        return cls(mechanism, "overlay." if "urdf" in data else "", *tables)

    def format_table_name(self, kind: str, name: str, *inner: str) -> str:
        """Return the name of a table of a link or a joint [-]: ``links.arm``, ``overlay.joints.elbow.drive``."""
        return ".".join((f"{self.prefix}{kind}", _format_key(name), *inner))


def write_identified(identification: Identification, base: Path, file: Path) -> None:
    """Write the overlay of a mechanism file [kg], [m], [kg m^2], [N m s/rad], [N m]; base : that file; file : where to write."""
    mechanism = identification.machine.mechanism
    data = read_layers(base)[0]
    layer = Layer.build(mechanism, data)
    rows = {(row.parameter, row.place): row for row in identification.parameters}
    currents = {channel.place: channel for channel in identification.machine.channels if channel.unit == "A"}
    tables: Tables = {}
    done = {
        *_fill_link_tables(identification, layer, rows, tables),
        *_fill_joint_tables(layer, rows, tables),
        *_fill_constants(currents, layer, rows, tables),
        *_fill_beam_tables(layer, rows, tables, "damping" in data),
        *_fill_payload_tables(layer, rows, tables),
        *_fill_load_tables(mechanism, rows, data, tables),
        *_fill_coupled_motors(identification, layer, rows, tables),
    }
    rest = [_describe_rest(row, currents) for key, row in rows.items() if key not in done]
    logs = [run.name for run, _ in identification.shown]
    over = os.path.relpath(base.resolve(), file.resolve().parent)
    owned.write(file, "\n".join(_format_file_lines(mechanism, logs, Path(over).as_posix(), tables, rest)) + "\n")


def _describe_row(row: Row) -> str:
    told = "" if row.identifiable else ", not told by the logs"
    return f"90 %: {format_interval(row.low, row.high)} {row.unit}; before {format_short(row.before)}{told}"


def _format_row_value(row: Row) -> str:
    return format_by_width(row.value, row.high - row.low)


def _fill_link_tables(
    identification: Identification, layer: Layer, rows: Mapping[Any, Row], tables: Tables
) -> Iterator[tuple[str, str]]:
    """Mass, centre and inertia about it of each link whose mass properties were free; its payloads are part of them."""
    space = identification.machine.space
    ten = compute_link_inertias(space, layer.mechanism, space.compute_values(identification.fit.z))
    for k, link in enumerate(layer.mechanism.links):
        if link.name not in space.factors:
            continue
        com = ten[k][1:4] / ten[k][0]
        found = {q: rows[q, link.name] for q in LINKS}
        inertia = {n: found[f"I{n}"].value for n in ("xx", "yy", "zz", "xy", "xz", "yz")}
        inside = "; ".join(f"{n} {_describe_row(found[f'I{n}'])}" for n in ("xx", "yy", "zz"))
        places = "; ".join(_describe_row(found[f"com {a}"]) for a in "xyz")
        tables[layer.format_table_name("links", link.name)] = {
            "mass_kg": (float(ten[k][0]), _describe_row(found["mass"])),
            "com_m": (com.tolist(), places),
            "inertia_kgm2": (inertia, inside),
            "payload": ([], "part of the numbers above"),
        }
        yield from ((quantity, link.name) for quantity in LINKS)


def _fill_joint_tables(layer: Layer, rows: Mapping[Any, Row], tables: Tables) -> Iterator[tuple[str, str]]:
    for (kind, place), row in rows.items():
        stated = layer.joints.get(place, {})
        if kind == "place x" and place in layer.joints and not layer.prefix:
            xyz = [row.value, *stated.get("placement", {}).get("xyz_m", [0.0, 0.0, 0.0])[1:]]
            tables.setdefault(layer.format_table_name("joints", place, "placement"), {})["xyz_m"] = (
                xyz,
                _describe_row(row),
            )
        elif kind in JOINTS and (found := _find_joint_key(layer, kind, place)) is not None:
            name, key, ratio = found
            words = _describe_row(row) if ratio == 1.0 else f"at the joint {_format_row_value(row)} {row.unit}, "
            words += "" if ratio == 1.0 else _describe_row(row)
            before, others = tables.setdefault(name, {}).get(key, (0.0, ""))  # damping may be one of two laws
            tables[name][key] = (before + row.value / ratio, f"{others}; {words}" if others else words)
            if key == "coulomb_Nm" and stated["drive"].get("static_Nm", 0.0) > 0.0:
                static = max(tables[name][key][0], float(stated["drive"]["static_Nm"]))
                tables[name]["static_Nm"] = (static, "not below coulomb_Nm")
        else:
            continue
        yield kind, place


def _find_joint_key(layer: Layer, kind: str, place: str) -> tuple[str, str, float] | None:
    """Table and key that say a parameter of a joint, and what its value is divided by there; None where none does."""
    joint = layer.mechanism.joint_of[place]
    turning, sliding, drive_key = JOINTS[kind]
    key = sliding if joint.kind == "prismatic" else turning
    owner = place.removesuffix(SPRING)
    if owner != place and "drive" in layer.joints.get(owner, {}):  # the spring between a motor and its link
        return layer.format_table_name("joints", owner, "drive"), key, 1.0
    if "drive" in layer.joints.get(place, {}) and joint.drive is not None:
        ratio = float(joint.drive.ratio) ** POWER.get(kind, 0)
        return (layer.format_table_name("joints", place, "drive"), drive_key, ratio) if drive_key else None
    if joint.kind not in DRIVES or key not in DRIVES[joint.kind].model_fields:
        return None
    return layer.format_table_name("joints", place), key, 1.0


def _fill_constants(
    currents: Mapping[str, Channel], layer: Layer, rows: Mapping[Any, Row], tables: Tables
) -> Iterator[tuple[str, str]]:
    """Torque constants of the motors whose currents, by joint, had a free gain [N m/A]."""
    for place, channel in currents.items():
        drive = layer.mechanism.joint_of[place].drive
        if drive is None or "drive" not in layer.joints.get(place, {}):
            continue
        row = rows["effort gain", place]
        constant = _convert_to_constant(row, channel.ratio / drive.ratio)
        words = f"{_describe_row(constant)}; the effort gain was {_format_row_value(row)}"
        words += ": identify.toml needs neither it nor constant_Nm_per_A any more"
        table = tables.setdefault(layer.format_table_name("joints", place, "drive"), {})
        table["torque_constant_Nm_per_A"] = (constant.value, words)
        yield "effort gain", place


def _convert_to_constant(row: Row, stated: float) -> Row:
    """The torque constant that a gain of a current is, by the stated one [N m/A]."""
    turned = replace(row, unit="N m/A", low=stated / row.high, high=stated / row.low)
    return replace(turned, value=stated / row.value, before=stated / row.before)


def _describe_rest(row: Row, currents: Mapping[str, Channel]) -> str:
    """A parameter that no mechanism file has; of the gain of a current (by its joint) the line that says its constant."""
    words = f"{row.parameter} of {row.place}: {_format_row_value(row)} {row.unit}, {_describe_row(row)}"
    if row.parameter != "effort gain" or row.place not in currents:
        return words
    constant = _convert_to_constant(row, currents[row.place].constant)
    line = f"constant_Nm_per_A = {_format_value(constant.value)}"
    told = f"as a torque constant {_format_row_value(constant)} N m/A, {_describe_row(constant)}"
    return f"{words}; {told}: write {line} into effort of [joints.{_format_key(row.place)}] of identify.toml, without this gain"


def _fill_beam_tables(layer: Layer, rows: Mapping[Any, Row], tables: Tables, damped: bool) -> Iterator[tuple[str, str]]:
    """Lengths, and sections of its own for each beam whose stiffness or damping was free.

    damped : by a table of the whole file, beside which no section may state its damping
    """
    inner = ("beam",) if layer.prefix else ()
    for (kind, place), row in rows.items():
        stated = layer.links.get(place, {})
        table = stated.get("beam", {}) if layer.prefix else stated
        names = _list_section_names(table)
        link = layer.format_table_name("links", place, *inner)
        if kind == "beam length" and "length_m" in table:
            tables.setdefault(link, {})["length_m"] = (row.value, _describe_row(row))
        elif names and all(_is_section_parameter(kind, layer.sections[name], damped) for name in names):
            tables.setdefault(link, {})["section"] = (_replace_section_names(table["section"], place), "as identified")
            for name in dict.fromkeys(names):
                section = tables.setdefault(f"sections.{_format_key(f'{name} of {place}')}", {})
                for key, value in layer.sections[name].items():
                    section.setdefault(key, (value, ""))
                _apply_to_section(section, kind, row)
        else:
            continue
        yield kind, place


def _list_section_names(table: Mapping[str, Any]) -> list[str]:
    """The sections of a beam: one, or one for each of its stations."""
    said = table.get("section", [])
    return [said] if isinstance(said, str) else [station["section"] for station in said]


def _replace_section_names(said: Any, place: str) -> Any:
    """The section of a beam, or its stations, with the names of sections that are its own."""
    if isinstance(said, str):
        return f"{said} of {place}"
    return [station | {"section": f"{station['section']} of {place}"} for station in said]


def _is_section_parameter(kind: str, section: Mapping[str, Any], damped: bool) -> bool:
    """Return true for parameters that a section can say: GJ apart from EI only where it states GJ as a number."""
    if kind == "beam damping":
        return not damped
    return kind == "beam stiffness" or (kind == "torsion stiffness" and "GJ_Nm2" in section)


def _apply_to_section(section: dict[str, tuple[Any, str]], kind: str, row: Row) -> None:
    """Give a section the stiffness [N], [N m^2], [Pa] or the damping [s] that was found."""
    if kind == "beam damping":
        section.pop("damping_matrix", None)  # in whose place the time is
        section["retardation_s"] = (row.value, _describe_row(row))
        return
    scaled = {"GJ_Nm2"} if kind == "torsion stiffness" else OF_SECTION | {"damping_matrix"}
    for key in scaled & section.keys():
        before = f"{section[key][1]}; " if section[key][1] else ""
        words = f"{before}times {_format_row_value(row)}; {_describe_row(row)}"
        section[key] = (_scale_value(section[key][0], row.value), words)


def _fill_payload_tables(layer: Layer, rows: Mapping[Any, Row], tables: Tables) -> Iterator[tuple[str, str]]:
    """All payloads of each beam that carries one whose mass was free [kg]; inertia follows the mass [kg m^2]."""
    for (kind, place), row in rows.items():
        beam, _, name = place.partition("/")
        stated = layer.links.get(beam, {}).get("payload", [])
        if kind != "payload mass" or name not in [body["name"] for body in stated]:
            continue
        table = tables.setdefault(layer.format_table_name("links", beam), {})
        bodies, before = table.get("payload", (stated, ""))
        changed = [_scale_body(body, row.value) if body["name"] == name else body for body in bodies]
        words = f"mass of {name} {_describe_row(row)}"
        table["payload"] = (changed, f"{before}; {words}" if before else words)
        yield kind, place


def _scale_body(body: Mapping[str, Any], mass: float) -> dict[str, Any]:
    """The table of a body with another mass [kg]; a stated inertia follows it [kg m^2], and that of a shape does by itself."""
    out = {**body, "mass_kg": mass}
    factor = mass / body["mass_kg"]
    if "inertia_kgm2" in body:
        out["inertia_kgm2"] = _scale_value(body["inertia_kgm2"], factor)
    if "axial_inertia_kgm2" in body.get("rod", {}):
        out["rod"] = {**body["rod"], "axial_inertia_kgm2": body["rod"]["axial_inertia_kgm2"] * factor}
    return out


def _fill_load_tables(
    mechanism: Mechanism, rows: Mapping[Any, Row], data: Mapping[str, Any], tables: Tables
) -> Iterator[tuple[str, str]]:
    for (kind, place), row in rows.items():
        if kind == "spring force":
            for key in SCALED & data["springs"][place].keys():
                value = _scale_value(data["springs"][place][key], row.value)
                words = f"times {_format_row_value(row)}; {_describe_row(row)}"
                tables.setdefault(f"springs.{_format_key(place)}", {})[key] = (value, words)
            yield kind, place
    tilt = {axis: rows.get((f"gravity tilt {axis}", "world")) for axis in "xy"}
    if any(row is not None for row in tilt.values()):
        turn = [0.0 if row is None else row.value for row in tilt.values()]
        words = "; ".join(f"tilt {a} {_describe_row(row)}" for a, row in tilt.items() if row is not None)
        gravity = turn_gravity(np.asarray(mechanism.gravity), turn[0], turn[1]).tolist()
        tables.setdefault("", {})["gravity_m_per_s2"] = (gravity, words)
        yield from ((f"gravity tilt {a}", "world") for a, row in tilt.items() if row is not None)


def _fill_coupled_motors(
    identification: Identification, layer: Layer, rows: Mapping[Any, Row], tables: Tables
) -> Iterator[tuple[str, str]]:
    """A motor that follows several joints: a frame of its own with rotor and friction, and a coupling that turns it."""
    values = identification.machine.space.compute_values(identification.fit.z)
    for name, columns in identification.machine.settings.joints.items():
        if not columns.follows or layer.prefix or "drive" in layer.joints.get(name, {}):
            continue
        joint = layer.mechanism.joint_of[name]
        motor = f"{name}_motor"
        kind = "prismatic" if joint.kind == "prismatic" else "revolute"
        law = _take_drive_numbers(
            identification.machine, joint, tables.get(layer.format_table_name("joints", name), {})
        )
        words = f"turns with {name} and what it follows; its rotor and friction were those of {name}"
        tables[layer.format_table_name("links", motor)] = {"kind": ("rigid", ""), "massless": (True, words)}
        place = {"kind": (kind, ""), "parent": ("world", ""), "child": (motor, ""), "axis": (joint.axis.tolist(), "")}
        tables[layer.format_table_name("joints", motor)] = place | law
        passive = tables.setdefault(layer.format_table_name("joints", name), {})
        passive |= dict.fromkeys(law, (0.0, f"of {motor}")) | {"actuated": (False, f"{motor} moves it")}
        parts = {o: resolve_value(identification.machine, values, COUPLING, f"{name}/{o}") for o in columns.follows}
        factors = {motor: 1.0, name: -1.0} | {other: -part for other, part in parts.items()}
        told = "; ".join(
            _describe_row(rows[COUPLING, f"{name}/{o}"]) for o in parts if (COUPLING, f"{name}/{o}") in rows
        )
        tables[f"closures.{_format_key(f'{name}_coupling')}"] = {"kind": ("coupling", ""), "factors": (factors, told)}
        yield from ((COUPLING, f"{name}/{other}") for other in parts)


def _take_drive_numbers(machine: Machine, joint: Joint, table: Mapping[str, Any]) -> dict[str, tuple[Any, str]]:
    """Rotor inertia, viscous and dry friction of a joint as keys of its motor, found or known."""
    out = {}
    for kind in ("rotor inertia", "viscous friction", "coulomb friction"):
        key = JOINTS[kind][joint.kind == "prismatic"]
        out[key] = table.get(key, (resolve_value(machine, {}, kind, joint.name), "known before"))
    return out


def _scale_value(value: Any, factor: float) -> Any:
    if isinstance(value, Mapping):
        return {key: _scale_value(one, factor) for key, one in value.items()}
    return [_scale_value(one, factor) for one in value] if isinstance(value, list) else float(value) * factor


def _format_file_lines(
    mechanism: Mechanism, logs: list[str], over: str, tables: Tables, rest: list[str]
) -> Iterator[str]:
    yield f"over = {json.dumps(over)}"
    yield f"name = {json.dumps(mechanism.name)}"
    source = f"identified from {', '.join(logs)} by crosscheck identify; before: {mechanism.source}"
    yield f"source = {json.dumps(source, ensure_ascii=False)}"
    yield from _format_table_lines(tables.pop("", {}))
    for name, table in sorted(tables.items()):
        yield ""
        yield f"[{name}]"
        yield from _format_table_lines(table)
    if rest:
        yield ""
        yield "# Identified, and no part of a mechanism file: parameters of sensors, and laws that it does not have."
        yield from (f"#   {words}" for words in rest)


def _format_table_lines(table: Mapping[str, tuple[Any, str]]) -> Iterator[str]:
    for key, (value, words) in table.items():
        yield f"{key} = {_format_value(value)}" + (f"   # {words}" if words else "")


def _format_key(name: str) -> str:
    return name if name.replace("_", "").replace("-", "").isalnum() and name.isascii() else json.dumps(name)


def _format_value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_format_key(k)} = {_format_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_format_value(one) for one in value) + "]"
    if isinstance(value, bool | str):
        return json.dumps(value, ensure_ascii=False)
    return repr(float(value))  # with all its digits: what is loaded gives the torques of the run
