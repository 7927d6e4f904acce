"""identified.toml: what was identified, laid over the mechanism file, with intervals in comments; it loads like any mechanism.

Parameters of sensors, and laws of friction that a mechanism file does not have, stand in comments at its end.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck import output_folder as owned
from crosscheck.identification.identify import Identification
from crosscheck.identification.response import compute_link_inertias, turn_gravity
from crosscheck.identification.table import Row
from crosscheck.report.words import format_short
from flexinv.files.load_mechanism import read_layers
from flexinv.model.mechanism import Mechanism

LINKS = ("mass", "com x", "com y", "com z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
# kind -> key of a joint that turns, of one that slides, key of its drive
JOINTS = {
    "rotor inertia": ("rotor_inertia_kgm2", "rotor_inertia_kg", "motor_inertia_kgm2"),
    "viscous friction": ("damping_Nms_per_rad", "damping_Ns_per_m", "viscous_Nms_per_rad"),
    "coulomb friction": ("friction_Nm", "friction_N", "coulomb_Nm"),
    "joint stiffness": ("stiffness_Nm_per_rad", "stiffness_N_per_m", ""),
    "joint damping": ("damping_Nms_per_rad", "damping_Ns_per_m", ""),
}
POWER = {
    "rotor inertia": 2,
    "viscous friction": 2,
    "coulomb friction": 1,
}  # of the gear ratio: from the joint to the motor
SCALED = {"stiffness_N_per_m", "force_N"}
OF_SECTION = {"EA_N", "GA_N", "GJ_Nm2", "EI_Nm2", "E_Pa", "G_Pa", "stiffness_matrix"}
Tables = dict[str, dict[str, tuple[Any, str]]]


def write_identified(identification: Identification, base: Path, file: Path) -> None:
    """Write the overlay of a mechanism file [kg], [m], [kg m^2], [N m s/rad], [N m]; base : that file; file : where to write."""
    mechanism = identification.machine.mechanism
    space = identification.machine.space
    data = read_layers(base)[0]
    rows = {(row.parameter, row.place): row for row in identification.parameters}
    tables: Tables = {}
    done: set[tuple[str, str]] = set()
    _fill_link_tables(identification, rows, data, tables)
    done |= {key for key in rows if key[0] in LINKS and key[1] in space.factors and "urdf" not in data}
    done |= set(_fill_joint_tables(mechanism, rows, data, tables))
    done |= set(_fill_beam_tables(rows, data, tables))
    done |= set(_fill_load_tables(mechanism, rows, data, tables))
    rest = [row for key, row in rows.items() if key not in done]
    logs = [run.name for run, _ in identification.shown]
    over = os.path.relpath(base.resolve(), file.resolve().parent)
    owned.write(file, "\n".join(_format_file_lines(mechanism, logs, Path(over).as_posix(), tables, rest)) + "\n")


def _describe_row(row: Row) -> str:
    told = "" if row.identifiable else ", not told by the logs"
    return (
        f"90 %: {format_short(row.low)} to {format_short(row.high)} {row.unit}; before {format_short(row.before)}{told}"
    )


def _fill_link_tables(
    identification: Identification, rows: Mapping[Any, Row], data: Mapping[str, Any], tables: Tables
) -> None:
    if "urdf" in data:
        return
    mechanism = identification.machine.mechanism
    space = identification.machine.space
    ten = compute_link_inertias(space, mechanism, space.compute_values(identification.fit.z))
    for k, link in enumerate(mechanism.links):
        if link.name not in space.factors:
            continue
        mass = float(ten[k][0])
        com = ten[k][1:4] / ten[k][0]
        own = {q: rows[q, link.name] for q in LINKS}
        inertia = {n: own[f"I{n}"].value for n in ("xx", "yy", "zz", "xy", "xz", "yz")}
        inside = "; ".join(f"{n} {_describe_row(own[f'I{n}'])}" for n in ("xx", "yy", "zz"))
        places = "; ".join(_describe_row(own[f"com {a}"]) for a in "xyz")
        tables[f"links.{_format_key(link.name)}"] = {
            "mass_kg": (mass, _describe_row(own["mass"])),
            "com_m": (com.tolist(), places),
            "inertia_kgm2": (inertia, inside),
            "payload": ([], "part of the numbers above"),
        }


def _fill_joint_tables(
    mechanism: Mechanism, rows: Mapping[Any, Row], data: Mapping[str, Any], tables: Tables
) -> Iterator[tuple[str, str]]:
    prefix = "overlay.joints" if "urdf" in data else "joints"
    known = data.get("overlay", {}).get("joints", {}) if "urdf" in data else data.get("joints", {})
    for (kind, place), row in rows.items():
        stated = known.get(place, {})
        if kind == "place x" and "urdf" not in data:
            xyz = [row.value, *stated.get("placement", {}).get("xyz_m", [0.0, 0.0, 0.0])[1:]]
            tables.setdefault(f"joints.{_format_key(place)}.placement", {})["xyz_m"] = (xyz, _describe_row(row))
        elif kind in JOINTS and (place in known or "urdf" in data):
            joint = mechanism.joint_of[place]
            turning, sliding, own = JOINTS[kind]
            if "drive" in stated and own and joint.drive is not None:
                value = row.value / joint.drive.ratio ** POWER[kind]
                words = f"at the joint {format_short(row.value)} {row.unit}, {_describe_row(row)}"
                tables.setdefault(f"{prefix}.{_format_key(place)}.drive", {})[own] = (value, words)
            else:
                key = sliding if joint.kind == "prismatic" else turning
                tables.setdefault(f"{prefix}.{_format_key(place)}", {})[key] = (row.value, _describe_row(row))
        else:
            continue
        yield kind, place


def _fill_beam_tables(rows: Mapping[Any, Row], data: Mapping[str, Any], tables: Tables) -> Iterator[tuple[str, str]]:
    """Lengths, and a section of its own for each beam whose stiffness or damping was free."""
    for (kind, place), row in rows.items():
        table = data.get("links", {}).get(place, {})
        if kind == "beam length" and table:
            tables.setdefault(f"links.{_format_key(place)}", {})["length_m"] = (row.value, _describe_row(row))
        elif _is_section_parameter(kind, data, table):
            name = f"{table['section']} of {place}"
            tables.setdefault(f"links.{_format_key(place)}", {})["section"] = (name, "as identified")
            section = tables.setdefault(f"sections.{_format_key(name)}", {})
            for key, value in data["sections"][table["section"]].items():
                section.setdefault(key, (value, ""))
            if kind == "beam damping":
                section.pop("damping_matrix", None)  # in whose place the time is
                section["retardation_s"] = (row.value, _describe_row(row))
                yield kind, place
                continue
            for key in ({"GJ_Nm2"} if kind == "torsion stiffness" else OF_SECTION) & section.keys():
                before = f"{section[key][1]}; " if section[key][1] else ""
                section[key] = (
                    _scale_value(section[key][0], row.value),
                    f"{before}times {format_short(row.value)}; {_describe_row(row)}",
                )
        else:
            continue
        yield kind, place


def _is_section_parameter(kind: str, data: Mapping[str, Any], table: Mapping[str, Any]) -> bool:
    """Return true for parameters of a section: GJ apart from EI only where the section states it as a number."""
    if not isinstance(table.get("section"), str):
        return False
    stated = data["sections"][table["section"]]
    return kind in ("beam stiffness", "beam damping") or (kind == "torsion stiffness" and "GJ_Nm2" in stated)


def _fill_load_tables(
    mechanism: Mechanism, rows: Mapping[Any, Row], data: Mapping[str, Any], tables: Tables
) -> Iterator[tuple[str, str]]:
    for (kind, place), row in rows.items():
        if kind == "spring force":
            for key in SCALED & data["springs"][place].keys():
                value = _scale_value(data["springs"][place][key], row.value)
                words = f"times {format_short(row.value)}; {_describe_row(row)}"
                tables.setdefault(f"springs.{_format_key(place)}", {})[key] = (value, words)
            yield kind, place
    tilt = {axis: rows.get((f"gravity tilt {axis}", "world")) for axis in "xy"}
    if any(row is not None for row in tilt.values()):
        turn = [0.0 if row is None else row.value for row in tilt.values()]
        words = "; ".join(f"tilt {a} {_describe_row(row)}" for a, row in tilt.items() if row is not None)
        gravity = turn_gravity(np.asarray(mechanism.gravity), turn[0], turn[1]).tolist()
        tables.setdefault("", {})["gravity_m_per_s2"] = (gravity, words)
        yield from ((f"gravity tilt {a}", "world") for a, row in tilt.items() if row is not None)


def _scale_value(value: Any, factor: float) -> Any:
    if isinstance(value, Mapping):
        return {key: _scale_value(one, factor) for key, one in value.items()}
    return [_scale_value(one, factor) for one in value] if isinstance(value, list) else float(value) * factor


def _format_file_lines(
    mechanism: Mechanism, logs: list[str], over: str, tables: Tables, rest: list[Row]
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
        yield from (
            f"#   {row.parameter} of {row.place}: {format_short(row.value)} {row.unit}, {_describe_row(row)}"
            for row in rest
        )


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
    return f"{float(value):.9g}"
