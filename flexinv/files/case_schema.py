"""The tables of a cases file: motions, steps, quantities and limits, every key with its unit."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import scipy  # its parts are loaded when they are asked for
from pydantic import Field

from flexinv import validation as arguments
from flexinv.files.toml_tables import Location, Table, key, optional, read_toml, validate
from flexinv.files.values import Format, Name, NotNegative, Number, Positive, Text, Vector
from flexinv.typing import Array

QUANTITIES = ("torque", "wrench", "reaction", "tip", "deflection", "axial", "internal", "frequency")
# Comparisons with a release, separated by commas, as in requirements of packages (PEP 440).
VERSIONS = r"^$|^\s*(==|!=|<=|>=|<|>|~=)\s*\d[\w.*+!]*\s*(,\s*(==|!=|<=|>=|<|>|~=)\s*\d[\w.*+!]*\s*)*$"
OF_BEAMS = ("deflection", "axial", "internal", "frequency")
Law = Literal["cycloid", "quintic", "septic", "nonic", "bang-bang", "trapezoid"]
LAWS = '"cycloid", "quintic", "septic", "nonic", "bang-bang" or "trapezoid"'
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]


class MoveTable(Table):
    """Move of one joint; law and times default to those of the motion."""

    law: Law | None = optional(f"one of {LAWS}", 'law = "cycloid"')
    duration_s: Positive | None = optional("how long the move takes, > 0 [s]", "duration_s = 1.0")
    hold_s: NotNegative | None = optional("rest after the move, >= 0 [s]", "hold_s = 0.5")
    delay_s: NotNegative | None = optional("rest before the move, >= 0 [s]", "delay_s = 0.1")


class AngleTable(MoveTable):
    """A revolute or continuous joint."""

    from_deg: Number | None = optional("the angle at the start [deg]", "from_deg = 0")
    to_deg: Number | None = optional("the angle at the end [deg]", "to_deg = 90")
    at_deg: Number | None = optional("the angle at which it rests [deg]", "at_deg = 30")
    from_rad: Number | None = optional("the angle at the start [rad]", "from_rad = 0")
    to_rad: Number | None = optional("the angle at the end [rad]", "to_rad = 1.0")
    at_rad: Number | None = optional("the angle at which it rests [rad]", "at_rad = 0.5")


class PositionTable(MoveTable):
    """A prismatic joint."""

    from_m: Number | None = optional("the position at the start [m]", "from_m = 0")
    to_m: Number | None = optional("the position at the end [m]", "to_m = 0.1")
    at_m: Number | None = optional("the position at which it rests [m]", "at_m = 0.05")


class TwoAnglesTable(MoveTable):
    """A universal joint."""

    from_deg: Pair | None = optional("two angles at the start [deg]", "from_deg = [0, 0]")
    to_deg: Pair | None = optional("two angles at the end [deg]", "to_deg = [30, 20]")
    at_deg: Pair | None = optional("two angles at which it rests [deg]", "at_deg = [0, 0]")
    from_rad: Pair | None = optional("two angles at the start [rad]", "from_rad = [0, 0]")
    to_rad: Pair | None = optional("two angles at the end [rad]", "to_rad = [0.5, 0.2]")
    at_rad: Pair | None = optional("two angles at which it rests [rad]", "at_rad = [0, 0]")


class RotationTable(MoveTable):
    """A spherical joint."""

    from_quaternion: Quaternion | None = optional("x, y, z, w at the start [-]", "from_quaternion = [0, 0, 0, 1]")
    to_quaternion: Quaternion | None = optional("x, y, z, w at the end [-]", "to_quaternion = [0, 0, 0.6, 0.8]")
    at_quaternion: Quaternion | None = optional("x, y, z, w where it rests [-]", "at_quaternion = [0, 0, 0, 1]")
    from_rpy_deg: Vector | None = optional("roll, pitch, yaw at the start [deg]", "from_rpy_deg = [0, 0, 0]")
    to_rpy_deg: Vector | None = optional("roll, pitch, yaw at the end [deg]", "to_rpy_deg = [0, 0, 90]")
    at_rpy_deg: Vector | None = optional("roll, pitch, yaw where it rests [deg]", "at_rpy_deg = [0, 0, 0]")


class PoseTable(RotationTable):
    """A free joint."""

    from_xyz_m: Vector | None = optional("the position at the start [m]", "from_xyz_m = [0, 0, 1]")
    to_xyz_m: Vector | None = optional("the position at the end [m]", "to_xyz_m = [0, 0, 0.9]")
    at_xyz_m: Vector | None = optional("the position where it rests [m]", "at_xyz_m = [0, 0, 1]")


class AngleStartTable(Table):
    """Start angle of a revolute or continuous joint."""

    deg: Number | None = optional("the angle [deg]", "deg = 30")
    rad: Number | None = optional("the angle [rad]", "rad = 0.5")


class PositionStartTable(Table):
    """Start position of a prismatic joint."""

    m: Number | None = optional("the position [m]", "m = 0.1")


class TwoAnglesStartTable(Table):
    """Start angles of a universal joint."""

    deg: Pair | None = optional("two angles [deg]", "deg = [10, -5]")
    rad: Pair | None = optional("two angles [rad]", "rad = [0.2, -0.1]")


class RotationStartTable(Table):
    """Start orientation of a spherical joint."""

    quaternion: Quaternion | None = optional("x, y, z, w [-]", "quaternion = [0, 0, 0, 1]")
    rpy_deg: Vector | None = optional("roll, pitch, yaw [deg]", "rpy_deg = [0, 0, 90]")


class PoseStartTable(RotationStartTable):
    """Start pose of a free joint."""

    xyz_m: Vector | None = optional("the position [m]", "xyz_m = [0, 0, 1]")


Reader = Callable[[Any], Array]


def plain(value: Any) -> Array:
    """Read numbers that are in SI units already [rad], [m], [-]."""
    return np.atleast_1d(np.array(value, dtype=np.float64))


def _radians(value: Any) -> Array:
    return np.radians(plain(value))


def _quaternion(rpy_deg: Any) -> Array:
    return np.asarray(scipy.spatial.transform.Rotation.from_euler("xyz", rpy_deg, degrees=True).as_quat())


# Units of the velocity coordinates of a kind of joint -> its table, the parts of its coordinates (by their keys), an example.
ANGLE: dict[str, Reader] = {"deg": _radians, "rad": plain}
TURN: dict[str, Reader] = {"quaternion": plain, "rpy_deg": _quaternion}
MOVES: dict[tuple[str, ...], tuple[type[MoveTable], tuple[dict[str, Reader], ...], str]] = {
    ("rad",): (AngleTable, (ANGLE,), "{ from_deg = 0, to_deg = 90 }"),
    ("m",): (PositionTable, ({"m": plain},), "{ from_m = 0, to_m = 0.1 }"),
    2 * ("rad",): (TwoAnglesTable, (ANGLE,), "{ from_deg = [0, 0], to_deg = [30, 20] }"),
    3 * ("rad",): (RotationTable, (TURN,), "{ from_rpy_deg = [0, 0, 0], to_rpy_deg = [0, 0, 90] }"),
    (*3 * ("m",), *3 * ("rad",)): (
        PoseTable,
        ({"xyz_m": plain}, TURN),
        "{ at_xyz_m = [0, 0, 1], at_rpy_deg = [0, 0, 0] }",
    ),
}

# The same of where a joint starts.
STARTS: dict[tuple[str, ...], tuple[type[Table], tuple[dict[str, Reader], ...], str]] = {
    ("rad",): (AngleStartTable, (ANGLE,), "{ deg = 30 }"),
    ("m",): (PositionStartTable, ({"m": plain},), "{ m = 0.1 }"),
    2 * ("rad",): (TwoAnglesStartTable, (ANGLE,), "{ deg = [10, -5] }"),
    3 * ("rad",): (RotationStartTable, (TURN,), "{ rpy_deg = [0, 0, 90] }"),
    (*3 * ("m",), *3 * ("rad",)): (
        PoseStartTable,
        ({"xyz_m": plain}, TURN),
        "{ xyz_m = [0, 0, 1], rpy_deg = [0, 0, 0] }",
    ),
}


class MotionTable(Table):
    """A move from point to point by a law, joint by joint, or samples from a CSV file."""

    law: Literal["cycloid", "quintic", "septic", "nonic", "bang-bang", "trapezoid", "sampled"] = key(
        f'{LAWS}, or "sampled" with csv', 'law = "cycloid"', default="cycloid"
    )
    duration_s: Positive | None = optional("how long the move takes, > 0 [s]", "duration_s = 1.0")
    hold_s: NotNegative = key("rest after the move, >= 0 [s]", "hold_s = 0.5", default=0.0)
    delay_s: NotNegative = key("rest before the move, >= 0 [s]", "delay_s = 0.1", default=0.0)
    joints: dict[str, Any] = key("a table per joint", "joints.elbow = { from_deg = 0, to_deg = 90 }", default={})
    others: Literal["at_zero"] | None = optional(
        '"at_zero" to hold the joints that are not listed at zero', 'others = "at_zero"'
    )
    csv: Text | None = optional("a CSV file beside this one, column time_s first", 'csv = "swing.csv"')
    rest: bool = key("true when the samples start and end at rest", "rest = true", default=False)
    largest_gap_s: Positive | None = optional(
        "the longest interval that the spline may cross [s]; three times the median one when absent",
        "largest_gap_s = 0.1",
    )


class LimitTable(Table):
    """Largest allowed difference of an engine from the reference, and the reason for it."""

    quantity: Literal["torque", "wrench", "reaction", "tip", "deflection", "axial", "internal", "frequency"] = key(
        f"one of {', '.join(QUANTITIES)}", 'quantity = "torque"'
    )
    engines: Annotated[list[Name], Field(min_length=1)] = key("names or patterns of engines", 'engines = ["exudyn*"]')
    reference: Name = key("the engine that is compared with", 'reference = "flexinv"', default="flexinv")
    maximum: Annotated[Positive, Field(le=1)] = key(
        "the largest difference as a fraction of the range, 0..1 [-]", "maximum = 1e-3"
    )
    reason: Text = key("why this limit is right, a text", 'reason = "both round off: 1e-16 times the number of links"')
    source: Text = key("where the reason comes from, a text", 'source = "convergence study in ..."', default="")
    versions: Annotated[str, Field(pattern=VERSIONS)] = key(
        "versions of the engine for which it holds, all by default", 'versions = ">=1.13, <1.14"', default=""
    )
    expires: datetime.date | None = optional(
        "the day after which the limit must be looked at again", "expires = 2027-01-31"
    )


class MeshTable(Table):
    """The mesh that flexinv takes for every beam in one case."""

    elements: Annotated[int, Field(ge=1)] = key("number of elements of each beam, >= 1 [-]", "elements = 2")
    order: Annotated[int, Field(ge=1)] = key("polynomial order of each element, >= 1 [-]", "order = 8")


class CaseTable(Table):
    """One case."""

    title: Text = key("one line that says what it is", 'title = "180 degrees in 0.2 s"', default="")
    source: Text = key("where the case comes from, a text", 'source = "Isobe et al., example 3"', default="")
    notes: list[Text] = key("a list of texts that a reader of results must know", 'notes = ["..."]', default=[])
    step_s: Positive = key("the time step, > 0 [s]", "step_s = 5e-4")
    accuracy: Annotated[Number, Field(ge=1e-9, le=0.1)] | None = optional(
        "largest error of every torque and tip in parts of its range, 1e-9..0.1 [-]: flexinv solve chooses steps and mesh for it "
        "in place of step_s, which other engines keep",
        "accuracy = 1e-4",
    )
    end_s: Positive | None = optional("when the case ends [s]; with the motion when absent", "end_s = 0.5")
    sample_s: Positive | None = optional("the spacing of results [s]; the step when absent", "sample_s = 1e-3")
    spectral_radius: Annotated[Number, Field(ge=0, le=1)] = key(
        "of the time integration at infinite frequency, 0..1 [-]", "spectral_radius = 0.8", default=0.8
    )
    initial: Literal["consistent", "static"] = key(
        '"consistent" (undeformed) or "static" (equilibrium under gravity first)',
        'initial = "static"',
        default="consistent",
    )
    mesh: MeshTable | None = optional(
        "flexinv's mesh in this case, where the mechanism's own is too coarse for it",
        "mesh = { elements = 2, order = 8 }",
    )
    start: dict[str, Any] = key(
        "a table per joint that the motion leaves out: where it starts, in a loop the guess that picks the branch",
        "start.rocker = { deg = 100 }",
        default={},
    )
    measured: Text | None = optional(
        "a CSV file beside this one with what was measured on a machine that did this", 'measured = "measured.csv"'
    )
    quantities: Annotated[
        list[Literal["torque", "wrench", "reaction", "tip", "deflection", "axial", "internal", "frequency"]],
        Field(min_length=1),
    ] = key(f"which of {', '.join(QUANTITIES)} are compared", 'quantities = ["torque", "tip"]', default=["torque"])
    limits: list[LimitTable] = key("tables [[cases.NAME.limits]]", "[[cases.NAME.limits]]", default=[])
    motion: MotionTable = key("a table [cases.NAME.motion]", "[cases.NAME.motion]")


class CasesTable(Table):
    """The whole file."""

    format: Format = key("the version of the file's format, 1 when absent", "format = 1", default=1)
    source: Text = key("where the cases come from, a text", 'source = "Isobe et al., example 3"')
    cases: dict[str, Any] = key("tables [cases.NAME]", "[cases.NAME]")
    tasks: dict[str, Any] = key("tables [tasks.NAME]: paths of a frame", "[tasks.NAME]", default={})
    limits: list[LimitTable] = key("tables [[limits]] that hold for every case of the file", "[[limits]]", default=[])


def read_cases(path: str | Path) -> tuple[Path, CasesTable]:
    """Return a cases file and its table as it stands there, units in its keys [unit]; path : ``models/<name>`` or the file.

    Raises InputError, which names file, table, key, what was given, what is expected and what to write.
    """
    path = Path(arguments.path("path", path, "a folder that has a cases.toml"))
    file = path if path.suffix == ".toml" else path / "cases.toml"
    return file, validate(CasesTable, read_toml(file), Location(file))
