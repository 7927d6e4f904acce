"""The tables of a cases file: motions, steps, quantities and limits, every key with its unit."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args

import numpy as np
import scipy  # its parts are loaded when they are asked for
from pydantic import Field, create_model

from flexinv.files.toml_tables import (
    Location,
    Table,
    check_table,
    make_key,
    make_optional_key,
    read_toml,
    resolve_toml_file,
)
from flexinv.files.values import Count, Format, Fraction, Name, NotNegative, Number, Pair, Positive, Text, Vector
from flexinv.typing import Array

Quantity = Literal["torque", "wrench", "reaction", "tip", "deflection", "axial", "internal", "frequency"]
QUANTITIES: tuple[str, ...] = get_args(Quantity)
# Comparisons with a release, separated by commas, as in requirements of packages (PEP 440).
VERSIONS = r"^$|^\s*(==|!=|<=|>=|<|>|~=)\s*\d[\w.*+!]*\s*(,\s*(==|!=|<=|>=|<|>|~=)\s*\d[\w.*+!]*\s*)*$"
OF_BEAMS = ("deflection", "axial", "internal", "frequency")
LawName = Literal["cycloid", "quintic", "septic", "nonic", "bang-bang", "trapezoid"]
LAW_NAMES = '"cycloid", "quintic", "septic", "nonic", "bang-bang" or "trapezoid"'
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]


class MoveTable(Table):
    """Move of one joint; law and times default to those of the motion."""

    law: LawName | None = make_optional_key(f"one of {LAW_NAMES}", '"cycloid"')
    duration_s: Positive | None = make_optional_key("how long the move takes, > 0 [s]", "1.0")
    hold_s: NotNegative | None = make_optional_key("rest after the move, >= 0 [s]", "0.5")
    delay_s: NotNegative | None = make_optional_key("rest before the move, >= 0 [s]", "0.1")


def read_si_numbers(value: Any) -> Array:
    """Read numbers that are in SI units already [rad], [m], [-]."""
    return np.atleast_1d(np.array(value, dtype=np.float64))


def _convert_degrees(value: Any) -> Array:
    return np.radians(read_si_numbers(value))


def _convert_rpy(rpy_deg: Any) -> Array:
    return np.asarray(scipy.spatial.transform.Rotation.from_euler("xyz", rpy_deg, degrees=True).as_quat())


class CoordinateForm(NamedTuple):
    """A way to state coordinates of a joint: type of the value, words and unit, how it is read, where it rests in words.

    examples : of a move its start, its end and a rest; of a start
    """

    kind: Any
    description: str
    unit: str
    read: Callable[[Any], Array]
    rests: str
    examples: tuple[str, str, str, str]


Parts = tuple[dict[str, CoordinateForm], ...]  # of a joint's coordinates, each by the keys that may state it
ANGLE = {
    "deg": CoordinateForm(Number, "the angle", "deg", _convert_degrees, "at which it rests", ("0", "90", "30", "30")),
    "rad": CoordinateForm(Number, "the angle", "rad", read_si_numbers, "at which it rests", ("0", "1.0", "0.5", "0.5")),
}
LENGTH = {
    "m": CoordinateForm(Number, "the position", "m", read_si_numbers, "at which it rests", ("0", "0.1", "0.05", "0.1"))
}
ZEROS = "[0, 0]"
ANGLES = {
    "deg": CoordinateForm(
        Pair, "two angles", "deg", _convert_degrees, "at which it rests", (ZEROS, "[30, 20]", ZEROS, "[10, -5]")
    ),
    "rad": CoordinateForm(
        Pair, "two angles", "rad", read_si_numbers, "at which it rests", (ZEROS, "[0.5, 0.2]", ZEROS, "[0.2, -0.1]")
    ),
}
NEUTRAL = "[0, 0, 0, 1]"
LEVEL = "[0, 0, 0]"
QUARTER = "[0, 0, 90]"
ABOVE = "[0, 0, 1]"
TURNED_EXAMPLES = NEUTRAL, "[0, 0, 0.6, 0.8]", NEUTRAL, NEUTRAL
ORIENTATION_WAYS = {
    "quaternion": CoordinateForm(Quaternion, "x, y, z, w", "-", read_si_numbers, "where it rests", TURNED_EXAMPLES),
    "rpy_deg": CoordinateForm(
        Vector, "roll, pitch, yaw", "deg", _convert_rpy, "where it rests", (LEVEL, QUARTER, LEVEL, QUARTER)
    ),
}
POSITION_WAYS = {
    "xyz_m": CoordinateForm(
        Vector, "the position", "m", read_si_numbers, "where it rests", (ABOVE, "[0, 0, 0.9]", ABOVE, ABOVE)
    )
}
# Units of the velocity coordinates of a kind of joint -> name of its tables, what it is, what starts, the parts of its
# coordinates, and examples of a move and of a start.
JOINTS: dict[tuple[str, ...], tuple[str, str, str, Parts, str, str]] = {
    ("rad",): (
        "Angle", "a revolute or continuous joint", "angle", (ANGLE,), "{ from_deg = 0, to_deg = 90 }", "{ deg = 30 }",
    ),
    ("m",): ("Position", "a prismatic joint", "position", (LENGTH,), "{ from_m = 0, to_m = 0.1 }", "{ m = 0.1 }"),
    2 * ("rad",): (
        "TwoAngles", "a universal joint", "angles", (ANGLES,), "{ from_deg = [0, 0], to_deg = [30, 20] }",
        "{ deg = [10, -5] }",
    ),
    3 * ("rad",): (
        "Rotation", "a spherical joint", "orientation", (ORIENTATION_WAYS,),
        "{ from_rpy_deg = [0, 0, 0], to_rpy_deg = [0, 0, 90] }", "{ rpy_deg = [0, 0, 90] }",
    ),
    (*3 * ("m",), *3 * ("rad",)): (
        "Pose", "a free joint", "pose", (POSITION_WAYS, ORIENTATION_WAYS), "{ at_xyz_m = [0, 0, 1], at_rpy_deg = [0, 0, 0] }",
        "{ xyz_m = [0, 0, 1], rpy_deg = [0, 0, 0] }",
    ),
}  # fmt: skip


def _build_joint_tables(name: str, joint: str, what: str, parts: Parts) -> tuple[type[MoveTable], type[Table]]:
    moves: dict[str, Any] = {}
    starts: dict[str, Any] = {}
    for unit, way in (both for part in parts for both in part.items()):
        for k, (at, when) in enumerate((("from", "at the start"), ("to", "at the end"), ("at", way.rests))):
            words = f"{way.description} {when} [{way.unit}]"
            moves[f"{at}_{unit}"] = (way.kind | None, make_optional_key(words, way.examples[k]))
        starts[unit] = (way.kind | None, make_optional_key(f"{way.description} [{way.unit}]", way.examples[3]))
    doc = f"{joint[0].upper()}{joint[1:]}."
    moving = create_model(f"{name}Table", __base__=MoveTable, __doc__=doc, **moves)
    return moving, create_model(f"{name}StartTable", __base__=Table, __doc__=f"Start {what} of {joint}.", **starts)


# Units -> table of a move of such a joint, the parts of its coordinates, an example; and the same of where it starts.
MOVES: dict[tuple[str, ...], tuple[type[MoveTable], Parts, str]] = {}
STARTS: dict[tuple[str, ...], tuple[type[Table], Parts, str]] = {}
for _units, (_name, _joint, _what, _parts, _move, _start) in JOINTS.items():
    _moving, _starting = _build_joint_tables(_name, _joint, _what, _parts)
    MOVES[_units] = (_moving, _parts, _move)
    STARTS[_units] = (_starting, _parts, _start)


class MotionTable(Table):
    """A move from point to point by a law, joint by joint, or samples from a CSV file."""

    law: Literal[LawName, "sampled"] = make_key(f'{LAW_NAMES}, or "sampled" with csv', '"cycloid"', "cycloid")
    duration_s: Positive | None = make_optional_key("how long the move takes, > 0 [s]", "1.0")
    hold_s: NotNegative = make_key("rest after the move, >= 0 [s]", "0.5", 0.0)
    delay_s: NotNegative = make_key("rest before the move, >= 0 [s]", "0.1", 0.0)
    joints: dict[str, Any] = make_key("a table per joint", "joints.elbow = { from_deg = 0, to_deg = 90 }", {})
    others: Literal["at_zero"] | None = make_optional_key(
        '"at_zero" to hold the joints that are not listed at zero', '"at_zero"'
    )
    csv: Text | None = make_optional_key("a CSV file beside this one, column time_s first", '"swing.csv"')
    rest: bool = make_key("true when the samples start and end at rest", "true", False)
    largest_gap_s: Positive | None = make_optional_key(
        "the longest interval that the spline may cross [s]; three times the median one when absent", "0.1"
    )


class LimitTable(Table):
    """Largest allowed difference of an engine from the reference, and the reason for it."""

    quantity: Quantity = make_key(f"one of {', '.join(QUANTITIES)}", '"torque"')
    engines: Annotated[list[Name], Field(min_length=1)] = make_key("names or patterns of engines", '["exudyn*"]')
    reference: Name = make_key("the engine that is compared with", '"flexinv"', "flexinv")
    maximum: Annotated[Positive, Field(le=1)] = make_key(
        "the largest difference as a fraction of the range, 0..1 [-]", "1e-3"
    )
    reason: Text = make_key("why this limit is right, a text", '"both round off: 1e-16 times the number of links"')
    source: Text = make_key("where the reason comes from, a text", '"convergence study in ..."', "")
    versions: Annotated[str, Field(pattern=VERSIONS)] = make_key(
        "versions of the engine for which it holds, all by default", '">=1.13, <1.14"', ""
    )
    expires: datetime.date | None = make_optional_key(
        "the day after which the limit must be looked at again", "2027-01-31"
    )


class MeshTable(Table):
    """The mesh that flexinv takes for every beam in one case."""

    elements: Count = make_key("number of elements of each beam, >= 1 [-]", "2")
    order: Count = make_key("polynomial order of each element, >= 1 [-]", "8")


class CaseTable(Table):
    """One case."""

    title: Text = make_key("one line that says what it is", '"180 degrees in 0.2 s"', "")
    source: Text = make_key("where the case comes from, a text", '"Isobe et al., example 3"', "")
    notes: list[Text] = make_key("a list of texts that a reader of results must know", '["..."]', [])
    step_s: Positive = make_key("the time step, > 0 [s]", "5e-4")
    accuracy: Annotated[Number, Field(ge=1e-9, le=0.1)] | None = make_optional_key(
        "largest error of every torque and tip in parts of its range, 1e-9..0.1 [-]: flexinv solve chooses steps and mesh for it "
        "in place of step_s, which other engines keep",
        "1e-4",
    )
    end_s: Positive | None = make_optional_key("when the case ends [s]; with the motion when absent", "0.5")
    sample_s: Positive | None = make_optional_key("the spacing of results [s]; the step when absent", "1e-3")
    spectral_radius: Fraction = make_key("of the time integration at infinite frequency, 0..1 [-]", "0.8", 0.8)
    initial: Literal["consistent", "static"] = make_key(
        '"consistent" (undeformed) or "static" (equilibrium under gravity first)', '"static"', "consistent"
    )
    mesh: MeshTable | None = make_optional_key(
        "flexinv's mesh in this case, where the mechanism's own is too coarse for it", "{ elements = 2, order = 8 }"
    )
    start: dict[str, Any] = make_key(
        "a table per joint that the motion leaves out: where it starts, in a loop the guess that picks the branch",
        "start.rocker = { deg = 100 }",
        {},
    )
    measured: Text | None = make_optional_key(
        "a CSV file beside this one with what was measured on a machine that did this", '"measured.csv"'
    )
    quantities: Annotated[list[Quantity], Field(min_length=1)] = make_key(
        f"which of {', '.join(QUANTITIES)} are compared", '["torque", "tip"]', ["torque"]
    )
    limits: list[LimitTable] = make_key("tables [[cases.NAME.limits]]", "[[cases.NAME.limits]]", [])
    motion: MotionTable = make_key("a table [cases.NAME.motion]", "[cases.NAME.motion]")


class CasesTable(Table):
    """The whole file."""

    format: Format = make_key("the version of the file's format, 1 when absent", "1", 1)
    source: Text = make_key("where the cases come from, a text", '"Isobe et al., example 3"')
    cases: dict[str, Any] = make_key("tables [cases.NAME]", "[cases.NAME]")
    tasks: dict[str, Any] = make_key("tables [tasks.NAME]: paths of a frame", "[tasks.NAME]", {})
    optima: dict[str, Any] = make_key("tables [optima.NAME]: motions to be chosen", "[optima.NAME]", {})
    limits: list[LimitTable] = make_key("tables [[limits]] that hold for every case of the file", "[[limits]]", [])


def read_cases(path: str | Path) -> tuple[Path, CasesTable]:
    """Return a cases file and its table as it stands there, units in its keys [unit]; path : ``models/<name>`` or the file.

    Raises InputError, which names file, table, key, what was given, what is expected and what to write.
    """
    file = resolve_toml_file(path, "cases.toml")
    return file, check_table(CasesTable, read_toml(file), Location(file))
