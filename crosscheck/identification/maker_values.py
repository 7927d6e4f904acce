"""Values of the maker: what the robot file says, beside what was found, with intervals and whether the logs can tell it."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

from crosscheck.identification.identify import Identification
from crosscheck.identification.parameters import KINDS
from crosscheck.identification.pseudo_inertia import QUANTITIES, convert_to_com
from crosscheck.identification.table import Row
from crosscheck.identification.write_back import urdf
from crosscheck.identification.write_back.mjcf import LAWS
from crosscheck.identification.write_back.mjcf_file import read_mjcf
from crosscheck.identification.write_back.same_efforts import find_link_frames
from crosscheck.lifting.rigid import compute_relative_pose, move_inertia
from crosscheck.report.words import format_by_width, format_interval, format_short
from crosscheck.verdicts.study_table import Line, SideTable
from flexinv.files.from_urdf import STANDARD_GRAVITY, read_urdf
from flexinv.model.mechanism import Body, Link, Mechanism
from flexinv.rigid.torque_regressor import compute_link_parameters

COLUMNS = (
    ("parameter", "parameter", ""), ("place", "place", ""), ("maker", "in the file", "unit"), ("value", "found", "unit"),
    ("unit", "unit", ""), ("interval", "90 % interval", ""), ("inside", "file within it", ""), ("told", "told by the logs", ""),
)  # fmt: skip


def build_maker_tables(identification: Identification, mjcf: Path | None = None) -> list[SideTable]:
    """Return a table of the mechanism's URDF, and one of an MJCF of the machine, where there are such files [unit of each].

    Raises InputError where a file cannot be read.
    """
    mechanism = identification.machine.mechanism
    tables = []
    if mechanism.urdf is not None:
        stated = read_urdf(mechanism.urdf, (), "fixed", STANDARD_GRAVITY, ())[0]
        tables.append(_build_table(identification, mechanism.urdf, stated, urdf.LAWS))
    if mjcf is not None:
        stated = _move_links(mechanism, read_mjcf(mjcf).description.mechanism)
        tables.append(_build_table(identification, mjcf, stated, LAWS))
    return tables


def _build_table(identification: Identification, file: Path, stated: Mechanism, laws: Collection[str]) -> SideTable:
    """The parameters that a file states, those first that the logs tell; laws : parameters of joints that it can state."""
    values = dict(_list_values(stated, laws))
    known = [row for row in identification.parameters if (row.parameter, row.place) in values]
    rows = [
        _describe_row(row, values[row.parameter, row.place]) for row in sorted(known, key=lambda r: not r.identifiable)
    ]
    return {"title": f"Against the maker's values: {file.name}", "columns": COLUMNS, "rows": rows, "leads": True}


def _describe_row(row: Row, maker: float) -> Line:
    return {
        "parameter": row.parameter,
        "place": row.place,
        "maker": format_short(maker),
        "value": format_by_width(row.value, row.high - row.low),
        "unit": row.unit,
        "interval": format_interval(row.low, row.high),
        "inside": "yes" if row.low <= maker <= row.high else "no",
        "told": "yes" if row.identifiable else "no",
    }


def _list_values(stated: Mechanism, laws: Collection[str]) -> Iterator[tuple[tuple[str, str], float]]:
    """Yield what a file says of links and joints [unit of each], by parameter and place."""
    for link in stated.links:
        if sum(body.inertia.mass for body in link.bodies) > 0.0:
            ten = convert_to_com(compute_link_parameters(link))
            yield from (((quantity, link.name), float(x)) for quantity, x in zip(QUANTITIES, ten, strict=True))
    for joint in stated.joints:
        yield from (((kind, joint.name), KINDS[kind].known(joint)) for kind in laws)


def _move_links(mechanism: Mechanism, stated: Mechanism) -> Mechanism:
    """A file's mechanism with its bodies in the frames of the links of the same names of another one [m, kg, kg m^2]."""
    here = find_link_frames(mechanism)
    there = find_link_frames(stated)
    links = []
    for link in stated.links:
        frame = compute_relative_pose(here.get(link.name, there[link.name]), there[link.name])
        bodies = (Body(one.name, move_inertia(frame, one.inertia)) for one in link.bodies)
        links.append(Link(link.name, tuple(bodies)))
    return replace(stated, links=tuple(links))
