"""Closures of loops, springs between points and applied forces: tables of a mechanism file beside links and joints."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import PlainValidator, WithJsonSchema

from flexinv.files.joints import read_axes, read_placement
from flexinv.files.schema import SOURCE, PlacementTable, check_interface, check_station, read_finite_number
from flexinv.files.toml_tables import (
    Location,
    Table,
    check_table,
    format_toml,
    make_key,
    make_optional_key,
    read_option,
)
from flexinv.files.values import Fraction, Name, NotNegative, Number, Pair, Positive, Text, Vector
from flexinv.model.attachments import COUPLED_JOINTS, GasLaw, TableLaw
from flexinv.model.mechanism import CLOSURES, GEARED, IMPACTS, WORLD, Attachment, Closure, Force, Joint, Link, Spring
from flexinv.validation import find_nearest_word

CLOSURE_NAMES = (
    '"revolute", "prismatic", "cylindrical", "universal", "spherical", "point-on-line", "fixed" or "coupling"'
)
LAW = '"linear" (the default), "gas" or "table"'
IMPACT = '"error" (the default) or "plastic", which stops them at once'
END = "a table: link, and where on it: xyz_m [m], rpy_deg [deg], on a beam station [-], on a mesh interface"
FREE_AXIS = "the free axis in both frames, three numbers [-]"


def _read_rows(value: Any) -> list[list[float]]:
    rows = value if isinstance(value, list) and value and isinstance(value[0], list) else [value]
    if any(not isinstance(row, list) or len(row) != 3 for row in rows):
        raise ValueError("should be three numbers, or a row of three for every time")
    return [[read_finite_number(x) for x in row] for row in rows]


_VECTOR = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
RowList = Annotated[
    Any, PlainValidator(_read_rows), WithJsonSchema({"anyOf": [_VECTOR, {"type": "array", "items": _VECTOR}]})
]


class EndTable(PlacementTable):
    """A frame on a link or on the world."""

    link: Name = make_key('the link that carries it, or "world"', '"coupler"')
    station: Fraction | None = make_optional_key("on a beam: the fraction 0..1 of its length [-]", "1.0")
    interface: Name | None = make_optional_key("on a mesh: the interface whose frame it is in", '"flange"')


class PairTable(Table):
    """Two frames that something joins."""

    first: EndTable = make_key(END, '{ link = "coupler", xyz_m = [0.5, 0, 0] }')
    second: EndTable = make_key(END, '{ link = "rocker", xyz_m = [0.4, 0, 0] }')
    source: Text = SOURCE


class ClosureTable(PairTable):
    """A joint that closes a loop: without an axis a ball joint or a weld."""

    kind: str = make_key(f"one of {CLOSURE_NAMES}", '"revolute"')
    active_s: list[Pair] = make_key(
        "intervals [start, end] in which it acts, one after the other [s]; always when absent", "[[0.0, 0.5]]", []
    )
    capture: bool = make_key(
        "true ties the frames where they stand when it begins to act, false asks that they have met", "true", False
    )
    impact: str = make_key(
        f"what it does to frames that move against each other when it begins to act: {IMPACT}", '"plastic"', "error"
    )


class AxisClosureTable(ClosureTable):
    """A closure that leaves an axis or a line free."""

    axis: Vector = make_key(FREE_AXIS, "[0, 0, 1]")


class UniversalClosureTable(ClosureTable):
    """A closure that leaves two axes free, which stay at right angles."""

    axis: Vector = make_key("the axis that stays with the first frame, three numbers [-]", "[1, 0, 0]")
    second_axis: Vector = make_key("the axis that stays with the second frame, three numbers [-]", "[0, 1, 0]")


class CouplingTable(Table):
    """A gear: an equation between coordinates of joints, and no frames."""

    kind: str = make_key(f"one of {CLOSURE_NAMES}", '"coupling"')
    factors: dict[str, Number] = make_key(
        "joint = factor, whose products with the joints' coordinates [rad], [m] add up to offset [-]",
        "{ motor = 1, wheel = -5 }",
    )
    offset: Number = make_key("what the products add up to [rad], [m]", "0.1", 0.0)
    source: Text = SOURCE


class SpringTable(PairTable):
    """A spring and damper along the line between two points."""

    damping_Ns_per_m: NotNegative = make_key("viscous damping, >= 0 [N s/m]", "10", 0.0)


class LinearSpringTable(SpringTable):
    """A linear spring."""

    law: Literal["linear"] = make_key(LAW, '"gas"', "linear")
    stiffness_N_per_m: NotNegative = make_key("the stiffness, >= 0 [N/m]", "4530")
    rest_m: NotNegative = make_key("the length without force, >= 0 [m]", "0.08", 0.0)


class GasSpringTable(SpringTable):
    """A gas behind a piston: force / (1 - (l - rest) / travel)^exponent."""

    law: Literal["gas"] = make_key(LAW, '"gas"')
    force_N: Number = make_key("the pull at the length rest_m, below 0 for a strut that pushes [N]", "27000")
    rest_m: NotNegative = make_key("the length at which the pull is force_N, >= 0 [m]", "0.6")
    travel_m: Number = make_key(
        "volume of the gas at rest_m over the piston's area, below 0 where shortening compresses it [m]", "0.57"
    )
    exponent: Positive = make_key("polytropic exponent, 1 isothermal, 1.4 adiabatic [-]", "1.2", 1.0)


class TableSpringTable(SpringTable):
    """A table of pull over length, monotone cubics between its rows."""

    law: Literal["table"] = make_key(LAW, '"table"')
    length_m: list[Number] = make_key("lengths that increase, two or more [m]", "[0.60, 0.65, 0.70]")
    force_N: list[Number] = make_key("the pull at each of them [N]", "[27000, 28200, 29500]")


class ForceTable(Table):
    """A force and a moment on a point of a link, constant or linear between times."""

    at: EndTable = make_key(END, '{ link = "hand", xyz_m = [0, 0, 0.1] }')
    force_N: RowList = make_optional_key("three numbers, or a row of three for every time [N]", "[0, 0, -10]")
    moment_Nm: RowList = make_optional_key("three numbers, or a row of three for every time [N m]", "[0, 0, 1]")
    time_s: list[Number] | None = make_optional_key(
        "the times of the rows, increasing [s]; absent for constant ones", "[0.0, 0.5]"
    )
    follower: bool = make_key("true for axes that move with the link, false for world axes", "true", False)
    source: Text = SOURCE


SPRING_TABLES: dict[str, type[SpringTable]] = {
    "linear": LinearSpringTable,
    "gas": GasSpringTable,
    "table": TableSpringTable,
}
CLOSURE_TABLES: dict[str, type[ClosureTable]] = dict.fromkeys(CLOSURES, AxisClosureTable)
CLOSURE_TABLES |= {"fixed": ClosureTable, "spherical": ClosureTable, "universal": UniversalClosureTable}


def read_closure(
    data: Any, links: Mapping[str, Link], joints: Mapping[str, Joint], where: Location, name: str
) -> Closure:
    """Read ``[closures.NAME]`` [m, rad, s]; joints : joints, whose names a closure may not have."""
    kind = read_option(data, where, "kind", CLOSURES, f"one of {CLOSURE_NAMES}", "revolute")
    if name in joints:
        expected = "a name of its own: a closure is a joint too, and results are named after both"
        raise where.make_error("", f'"{name}", also a joint', expected, f"[{where.table}_closure]")
    if kind == "coupling":
        return _read_coupling(check_table(CouplingTable, data, where), joints, where, name)
    table = check_table(CLOSURE_TABLES[kind or "revolute"], data, where)
    first, second = _read_end_pair(table, links, where)
    axes = read_axes(table, where)
    _check_switching(table, where)
    active = tuple((start, end) for start, end in table.active_s)
    return Closure(name, table.kind, first, second, **axes, active=active, capture=table.capture, impact=table.impact)


def _read_coupling(table: CouplingTable, joints: Mapping[str, Joint], where: Location, name: str) -> Closure:
    """A coupling of two joints or more."""
    write = "factors = { motor = 1, wheel = -5 }"
    scalar = [j for j, joint in joints.items() if joint.kind in GEARED]
    for other in table.factors:
        if other not in scalar:
            expected = f"{COUPLED_JOINTS}: " + (", ".join(scalar[:20]) or "there are none")
            near = find_nearest_word(other, scalar)
            raise where.make_error("factors", f'"{other}"', expected, f"{near} = 1" if near else write)
    used = tuple((j, factor) for j, factor in table.factors.items() if factor)
    if len(used) < 2:
        given = format_toml(table.factors)
        raise where.make_error("factors", given, "two joints or more with factors other than 0", write)
    return Closure(name, table.kind, Attachment(WORLD), Attachment(WORLD), factors=used, offset=table.offset)


def _check_switching(table: ClosureTable, where: Location) -> None:
    """Check when a closure acts, and how it begins to."""
    times = [time for interval in table.active_s for time in interval]
    if any(b <= a for a, b in pairwise(times)):
        given = format_toml(table.active_s)
        expected = "intervals [start, end] with start < end, one after the other [s]"
        raise where.make_error("active_s", f"active_s = {given}", expected, "active_s = [[0.0, 0.5], [1.0, 2.0]]")
    if table.impact not in IMPACTS:
        write = f'impact = "{find_nearest_word(table.impact, IMPACTS) or "plastic"}"'
        raise where.make_error("impact", f"impact = {format_toml(table.impact)}", IMPACT, write)
    for word, stated in (("capture", table.capture), ("impact", table.impact != "error")):
        if stated and not table.active_s:
            expected = f"active_s with the time at which it begins to act, or no {word}"
            raise where.make_error(word, f"{word} without active_s", expected, "active_s = [[0.5, 1.0]]")


def read_spring(data: Any, links: Mapping[str, Link], where: Location, name: str) -> Spring:
    """Read ``[springs.NAME]`` [N/m, m, N s/m, N]: linear, a gas, or a table of pull over length."""
    law = read_option(data, where, "law", SPRING_TABLES, '"linear", "gas" or "table"', "gas") or "linear"
    table = check_table(SPRING_TABLES[law], data, where)
    first, second = _read_end_pair(table, links, where)
    if isinstance(table, LinearSpringTable):
        return Spring(name, first, second, table.stiffness_N_per_m, table.rest_m, table.damping_Ns_per_m)
    if isinstance(table, GasSpringTable):
        if not table.travel_m:
            expected = "the volume of the gas over the piston's area, other than 0 [m]"
            raise where.make_error("travel_m", "travel_m = 0", expected, "travel_m = 0.57")
        gas = GasLaw(table.force_N, table.travel_m, table.exponent)
        return Spring(name, first, second, 0.0, table.rest_m, table.damping_Ns_per_m, gas)
    assert isinstance(table, TableSpringTable)
    length = np.array(table.length_m)
    force = np.array(table.force_N)
    if len(length) < 2 or (np.diff(length) <= 0).any():
        given = f"length_m = {format_toml(table.length_m)}"
        write = "length_m = [0.60, 0.65, 0.70]"
        raise where.make_error("length_m", given, "two lengths or more, increasing [m]", write)
    if len(force) != len(length):
        expected = f"{len(length)} numbers, one for each of length_m [N]"
        raise where.make_error("force_N", f"{len(force)} numbers", expected, f"{len(length)} numbers")
    return Spring(name, first, second, 0.0, 0.0, table.damping_Ns_per_m, TableLaw(length, force))


def read_force(data: Any, links: Mapping[str, Link], where: Location, name: str) -> Force:
    """Read ``[forces.NAME]`` [N, N m, s]: constant, or a table whose rows belong to ``time_s``."""
    table = check_table(ForceTable, data, where)
    time = np.array(table.time_s or [0.0])
    if (np.diff(time) <= 0).any():
        given = f"time_s = {format_toml(table.time_s)}"
        write = "time_s = [0.0, 0.5]"
        raise where.make_error("time_s", given, "times that increase [s]", write)
    if table.force_N is None and table.moment_Nm is None:
        raise where.make_error("force_N", "nothing", "force_N [N], moment_Nm [N m] or both", "force_N = [0, 0, -10]")
    parts = []
    for word, rows in (("force_N", table.force_N), ("moment_Nm", table.moment_Nm)):
        values = np.array([[0.0, 0.0, 0.0]] if rows is None else rows)
        if len(values) not in (1, time.size):
            given = f"{len(values)} rows"
            several = f"one row, or {time.size}: one for each of time_s"
            expected = several if time.size > 1 else "one row, or time_s with the times"
            raise where.make_error(word, given, expected, f"time_s with {len(values)} times")
        parts.append(np.broadcast_to(values, (time.size, 3)))
    return Force(
        name, read_end(table.at, links, where.make_inner_location("at")), np.hstack(parts), time, table.follower
    )


def _read_end_pair(table: PairTable, links: Mapping[str, Link], where: Location) -> tuple[Attachment, Attachment]:
    first, second = (read_end(getattr(table, k), links, where.make_inner_location(k)) for k in ("first", "second"))
    if first.link == second.link:
        given = f'first and second are both on "{second.link}"'
        write = (
            'second = { link = "world" }, or another link'
            if second.link != WORLD
            else 'another link in place of one "world"'
        )
        raise where.make_inner_location("second").make_error("link", given, "two different links", write)
    return first, second


def read_end(table: EndTable, links: Mapping[str, Link], where: Location) -> Attachment:
    """Return the frame on a link or the world [m], [rad], [-].  Raises InputError: no such link, or a station off a beam."""
    if table.link != WORLD and table.link not in links:
        near = find_nearest_word(table.link, [WORLD, *links])
        expected = f'"{WORLD}" or one of the links ' + ", ".join(list(links)[:20])
        write = f'link = "{near}"' if near else "the name of one of these"
        raise where.make_error("link", f'link = "{table.link}"', expected, write)
    on_beam = table.link != WORLD and links[table.link].beam is not None
    beam = f"the beam {table.link} that carries it"
    other = f"{table.link} is not a beam"
    check_station(table.station, on_beam, where, beam, other, "xyz_m = [0.4, 0, 0]")
    check_interface(table.interface, None if table.link == WORLD else links[table.link], where)
    return Attachment(table.link, read_placement(table, where), table.station, table.interface or "")
