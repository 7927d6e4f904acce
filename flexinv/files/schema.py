"""Tables of a mechanism file: every key with its unit, what is expected, an example; and how bodies are read from them."""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PlainValidator, WithJsonSchema

from flexinv.errors import InputError
from flexinv.files.toml_tables import Location, Table, make_key, make_optional_key
from flexinv.files.values import (
    Count,
    Format,
    Fraction,
    Name,
    NotNegative,
    Number,
    Positive,
    Text,
    Vector,
    check_bounded,
)
from flexinv.model.links import Body, Inertia, Link, describe_impossible_inertia
from flexinv.typing import Array
from flexinv.validation import find_nearest_word

NumbersByName = dict[str, float]


def read_finite_number(value: Any) -> float:
    """Read a finite number [unit of the key]; ValueError when it is none."""
    return float(check_bounded(value))


def read_named_numbers(value: Any, required: str, optional: str = "") -> NumbersByName:
    """Read ``{ y = 1.0, z = 2.0 }`` into numbers by name [unit of the key]; ValueError when names are wrong."""
    names = required.split()
    may = optional.split()
    if not isinstance(value, dict) or not set(names) <= set(value) <= {*names, *may}:
        wanted = ", ".join(f"{name} = ..." for name in names)
        raise ValueError(f"should be {{ {wanted} }}" + (f" and may have {', '.join(may)}" if may else ""))
    return {name: read_finite_number(number) for name, number in value.items()}


def _read_matrix(value: Any, size: int = 3) -> np.ndarray[Any, np.dtype[np.float64]]:
    rows = value if isinstance(value, list) else []
    if len(rows) != size or any(not isinstance(row, list) or len(row) != size for row in rows):
        many = "three" if size == 3 else "six"
        raise ValueError(f"should have {many} rows of {many} numbers")
    return np.array([[read_finite_number(x) for x in row] for row in rows])


def _read_one_or_named(value: Any, required: str, optional: str = "", zero: bool = True) -> NumbersByName:
    """A table of numbers by name, or one number for all that are required; none is negative, nor 0 unless it may be."""
    table = value if isinstance(value, dict) else dict.fromkeys(required.split(), value)
    numbers = read_named_numbers(table, required, optional)
    if min(numbers.values()) < 0 or (min(numbers.values()) == 0 and not zero):
        raise ValueError("should not be negative" if zero else "should be greater than 0")
    return numbers


def _read_across(value: Any) -> tuple[float, float]:
    pair = _read_one_or_named(value, "y z", zero=False)
    return pair["y"], pair["z"]


def _read_rotary(value: Any) -> tuple[float, float, float]:
    parts = _read_one_or_named(value, "y z", "x")
    return parts.get("x", parts["y"] + parts["z"]), parts["y"], parts["z"]


def _read_times(value: Any) -> tuple[float, ...]:
    part = _read_one_or_named(value, "axial shear twist bending")
    return part["axial"], part["shear"], part["shear"], part["twist"], part["bending"], part["bending"]


def _read_tensor(value: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    if isinstance(value, list):
        return _read_matrix(value)
    if not isinstance(value, dict):
        if read_finite_number(value) != 0.0:
            raise ValueError("one number can only be 0, a point mass")
        return np.zeros((3, 3))
    i = read_named_numbers(value, "xx yy zz", "xy xz yz")
    xy, xz, yz = (i.get(name, 0.0) for name in ("xy", "xz", "yz"))
    return np.array([[i["xx"], xy, xz], [xy, i["yy"], yz], [xz, yz, i["zz"]]])


def _read_six(value: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return _read_matrix(value, 6)


def _read_rotation(value: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    matrix = _read_matrix(value)
    # 1e-6: a matrix typed with seven digits; anything further off is no rotation but a mistake
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-6 or np.linalg.det(matrix) < 0:
        raise ValueError("rows should be of length 1, at right angles and right-handed")
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ vt)


_NUMBER = {"type": "number"}
_THREE = {"type": "array", "minItems": 3, "maxItems": 3}
_ROWS = {**_THREE, "items": {**_THREE, "items": _NUMBER}}


def _make_number_schema(required: str, optional: str = "", *others: dict[str, Any]) -> WithJsonSchema:
    """Return the JSON Schema of one number, of a table of them by name, or of ``others``."""
    names = required.split()
    parts = {"type": "object", "properties": dict.fromkeys([*names, *optional.split()], _NUMBER), "required": names}
    return WithJsonSchema({"anyOf": [_NUMBER, {**parts, "additionalProperties": False}, *others]})


Across = Annotated[tuple[float, float], PlainValidator(_read_across), _make_number_schema("y z")]
Rotary = Annotated[tuple[float, float, float], PlainValidator(_read_rotary), _make_number_schema("y z", "x")]
Times = Annotated[tuple[float, ...], PlainValidator(_read_times), _make_number_schema("axial shear twist bending")]
Tensor = Annotated[Any, PlainValidator(_read_tensor), _make_number_schema("xx yy zz", "xy xz yz", _ROWS)]
_SIX = {"type": "array", "minItems": 6, "maxItems": 6}
SixBySix = Annotated[Any, PlainValidator(_read_six), WithJsonSchema({**_SIX, "items": {**_SIX, "items": _NUMBER}})]
Rotation = Annotated[Any, PlainValidator(_read_rotation), WithJsonSchema(_ROWS)]
Along = Literal["x", "y", "z"]

SOURCE = make_key("where the numbers come from, a text", '"data sheet of ..., table 2"', "")
PLACEMENT = "a table: xyz_m [m] and one of rpy_deg [deg], rpy_rad [rad], rotation [-]"


class PlacementTable(Table):
    """A frame in a frame: position, and rotation by fixed-axis roll, pitch, yaw (as URDF) or as a matrix."""

    xyz_m: Vector = make_key("three numbers [m]", "[0.0, 0.0, 0.1]", [0.0, 0.0, 0.0])
    rpy_deg: Vector | None = make_optional_key("roll, pitch, yaw about fixed axes [deg]", "[0, 90, 0]")
    rpy_rad: Vector | None = make_optional_key("roll, pitch, yaw about fixed axes [rad]", "[0, 1.57, 0]")
    rotation: Rotation | None = make_optional_key(
        "a rotation matrix, three rows [-]", "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]"
    )


class RodTable(Table):
    """A slender uniform rod from the frame's origin along one of its axes: m L^2/12 across."""

    length_m: Positive = make_key("the length of the rod, a number > 0 [m]", "0.4")
    axial_inertia_kgm2: NotNegative = make_key("the small inertia about the rod's own axis, >= 0 [kg m^2]", "1e-5", 0.0)
    along: Along = make_key('the axis of the frame along which it lies, "x", "y" or "z"', '"z"', "x")


class BoxTable(Table):
    """A uniform box, its faces along the frame's axes."""

    size_m: Annotated[list[Positive], Field(min_length=3, max_length=3)] = make_key(
        "three edge lengths > 0 along x, y, z [m]", "[0.4, 0.05, 0.05]"
    )


class CylinderTable(Table):
    """A uniform solid cylinder from the frame's origin along one of its axes."""

    length_m: Positive = make_key("the length, a number > 0 [m]", "0.4")
    along: Along = make_key('the axis of the frame along which it lies, "x", "y" or "z"', '"z"', "x")
    radius_m: Positive = make_key("the radius, a number > 0 [m]", "0.02")


class SphereTable(Table):
    """A uniform solid sphere."""

    radius_m: Positive = make_key("the radius, a number > 0 [m]", "0.02")


class BodyTable(Table):
    """Mass, centre of mass, and inertia about the centre of mass: as numbers or by a uniform shape."""

    mass_kg: Positive | None = make_optional_key("the mass, a number > 0 [kg]", "0.215")
    com_m: Vector | None = make_optional_key("the centre of mass, three numbers [m]", "[0.2, 0.0, 0.0]")
    inertia_kgm2: Tensor | None = make_optional_key(
        "about the centre of mass [kg m^2]: { xx, yy, zz } and xy, xz, yz if not 0; three rows; or 0, a point mass",
        "{ xx = 1e-4, yy = 2.9e-3, zz = 2.9e-3 }",
    )
    rod: RodTable | None = make_optional_key("a table: length_m [m]", "{ length_m = 0.4 }")
    box: BoxTable | None = make_optional_key("a table: size_m [m]", "{ size_m = [0.4, 0.05, 0.05] }")
    cylinder: CylinderTable | None = make_optional_key(
        "a table: length_m, radius_m [m]", "{ length_m = 0.4, radius_m = 0.02 }"
    )
    sphere: SphereTable | None = make_optional_key("a table: radius_m [m]", "{ radius_m = 0.02 }")
    source: Text = SOURCE


class PayloadTable(BodyTable):
    """A body that a link carries beside its own: payload, flange, motor."""

    name: Name = make_key("the name of the payload", '"gripper"')
    station: Fraction | None = make_optional_key(
        "on a beam: the fraction 0..1 of its length that carries it [-]", "1.0"
    )
    interface: Name | None = make_optional_key("on a mesh: the interface that carries it", '"flange"')


class RigidLinkTable(BodyTable):
    """A rigid link; without mass only when it says so."""

    kind: Literal["rigid"] = make_key('"rigid", "beam" or "mesh"', '"rigid"')
    mass_kg: Positive | None = make_optional_key(
        "the mass, a number > 0 [kg]", "0.215   (or massless = true for a link that is only a frame)"
    )
    massless: bool = make_key("true for a frame that has no mass", "true", False)
    tip_m: Vector | None = make_optional_key("the point whose motion is reported, three numbers [m]", "[0.4, 0, 0]")
    payload: list[PayloadTable] = make_key("tables [[links.NAME.payload]]", "[[links.NAME.payload]]", [])


class CurvatureTable(Table):
    """Initial twist and curvature of a beam, constant along its length."""

    twist: Number = make_key("initial twist [rad/m]", "0.0", 0.0)
    y: Number = make_key("initial curvature about y [1/m]", "0.0", 0.0)
    z: Number = make_key("initial curvature about z [1/m]", "0.5", 0.0)


class MeshTable(Table):
    """Mesh and section of a beam: the keys that native and overlaid beams share."""

    section: Any = make_key(
        'the name of a [sections.NAME], or stations [{ at = 0, section = "A" }, ...], two at the same place at a step',
        '"tube"',
    )
    elements: Annotated[int, Field(ge=1, le=1000)] = make_key("the number of elements, 1..1000 [-]", "1", 1)
    order: Annotated[int, Field(ge=1, le=32)] = make_key("the order of each element, 1..32 [-]", "4", 4)


class BeamLinkTable(MeshTable):
    """A beam from the link frame (or from ``root``) along x."""

    kind: Literal["beam"] = make_key('"rigid", "beam" or "mesh"', '"beam"')
    length_m: Positive = make_key("the arc length of the beam, a number > 0 [m]", "0.4")
    curvature_per_m: CurvatureTable | None = make_optional_key("a table: twist, y, z [1/m]", "{ z = 0.5 }")
    root: PlacementTable | None = make_optional_key(PLACEMENT, "{ xyz_m = [0.05, 0, 0] }")
    payload: list[PayloadTable] = make_key("tables [[links.NAME.payload]]", "[[links.NAME.payload]]", [])
    source: Text = SOURCE


class DampingTable(Table):
    """Damping of all beams: a retardation time, or the ratio that one natural mode has."""

    retardation_s: NotNegative | None = make_optional_key(
        "stress by rate of strain over stress by strain, >= 0 [s]", "1e-3"
    )
    ratio: Fraction | None = make_optional_key("of critical damping of one natural mode, 0..1 [-]", "0.01")
    mode: Count = make_key("which natural mode, all joints held at zero: 1 the lowest [-]", "1", 1)
    source: Text = SOURCE


class UrdfTable(Table):
    """The URDF that the mechanism is made from."""

    path: Text = make_key(
        "the URDF, a path inside the models folder or inside the package", '"ur_description/urdf/ur5_robot.urdf"'
    )
    package: Literal["example-robot-data"] | None = make_optional_key(
        '"example-robot-data", or leave it out for a file of your own', '"example-robot-data"'
    )
    base: Literal["fixed", "free"] = make_key('"fixed" or "free"', '"fixed"', "fixed")
    lock: list[Name] = make_key("names of joints to hold at zero", '["finger_joint"]', [])
    mimic: Literal["independent"] | None = make_optional_key(
        '"independent" when mimic joints are meant to be coordinates of their own', '"independent"'
    )


class OverlayBeamTable(MeshTable):
    """A link of the URDF made a beam that leads straight to one of its joints."""

    to_joint: Name = make_key("the joint of this link at which the beam ends", '"wrist_1_joint"')
    y_axis: Vector = make_key(
        "a direction in the link frame; the section's y is its part across the beam [-]", "[0, 1, 0]"
    )
    own_inertia: Literal["replaced", "at_root"] = make_key(
        '"replaced" by the section\'s mass, or "at_root": kept as a rigid body at the root', '"replaced"'
    )
    root_xyz_m: Vector = make_key("where the beam begins in the link frame [m]", "[0, 0, 0.1]", [0.0, 0.0, 0.0])
    source: Text = SOURCE


class OverlayLinkTable(BodyTable):
    """Overlay of one link of the URDF; a mass, with centre and inertia, stands in place of the URDF's own."""

    beam: OverlayBeamTable | None = make_optional_key("a table [overlay.links.NAME.beam]", "[overlay.links.NAME.beam]")
    mesh: dict[str, Any] | None = make_optional_key(
        "a table [overlay.links.NAME.mesh], as of links that are meshes", "[overlay.links.NAME.mesh]"
    )
    payload: list[PayloadTable] = make_key(
        "tables [[overlay.links.NAME.payload]]", "[[overlay.links.NAME.payload]]", []
    )
    tip_m: Vector | None = make_optional_key("the point whose motion is reported, three numbers [m]", "[0.1, 0, 0]")


class OverlayTable(Table):
    """Overlay of the URDF: its links and joints."""

    links: dict[str, Any] = make_key("tables [overlay.links.NAME]", "[overlay.links.NAME]", {})
    joints: dict[str, Any] = make_key("tables [overlay.joints.NAME]", "[overlay.joints.NAME]", {})


class MechanismTable(Table):
    """The whole file."""

    format: Format = make_key("the version of the file's format, 1 when absent", "1", 1)
    over: Text | None = make_optional_key("the mechanism file that this one is laid over", '"mechanism.toml"')
    name: Name | None = make_optional_key("the name of the mechanism; the folder's when absent", '"arm"')
    title: Text = make_key("one line that says what it is", '"Two flexible links"', "")
    source: Text = make_key("where the data come from, a text", '"Isobe et al., case 3"')
    gravity_m_per_s2: Vector | None = make_optional_key(
        "gravity in the world frame, three numbers [m/s^2]", "[0, 0, -9.81]"
    )
    notes: list[Text] = make_key("a list of texts that a reader of results must know", '["..."]', [])
    sections: dict[str, Any] = make_key("tables [sections.NAME]", "[sections.NAME]", {})
    links: dict[str, Any] = make_key("tables [links.NAME]", "[links.NAME]", {})
    joints: dict[str, Any] = make_key("tables [joints.NAME]", "[joints.NAME]", {})
    closures: dict[str, Any] = make_key("tables [closures.NAME], joints that close loops", "[closures.NAME]", {})
    springs: dict[str, Any] = make_key("tables [springs.NAME] between two points", "[springs.NAME]", {})
    forces: dict[str, Any] = make_key("tables [forces.NAME] on points", "[forces.NAME]", {})
    damping: DampingTable | None = make_optional_key(
        "a table: retardation_s [s], or ratio [-] and mode", "{ ratio = 0.01, mode = 1 }"
    )
    urdf: UrdfTable | None = make_optional_key("a table: path, package, base, lock", "[urdf]")
    overlay: OverlayTable | None = make_optional_key(
        "tables [overlay.links.NAME] and [overlay.joints.NAME]", "[overlay.links.NAME]"
    )


INERTIA_SHAPES = ("inertia_kgm2", "rod", "box", "cylinder", "sphere")


def compute_far_end(table: RodTable | CylinderTable) -> Array:
    """Return the end point of a rod or cylinder, (3,) [m]; it begins at the frame's origin."""
    end = np.zeros(3)
    end["xyz".index(table.along)] = table.length_m
    return end


def read_inertia(table: BodyTable, where: Location) -> Inertia:
    """Read one body's inertia [kg, m, kg m^2] from its table; InputError when no body can have it."""
    if table.mass_kg is None:
        info = type(table).model_fields["mass_kg"]
        raise where.make_error("mass_kg", "nothing", info.description or "", str((info.examples or [""])[0]))
    given = [name for name in INERTIA_SHAPES if getattr(table, name) is not None]
    if len(given) != 1:
        advice = "inertia_kgm2 = { xx = 1e-4, yy = 2.9e-3, zz = 2.9e-3 }, or inertia_kgm2 = 0 for a point mass"
        expected = f"exactly one of {', '.join(INERTIA_SHAPES)}"
        raise where.make_error("inertia_kgm2", " and ".join(given) or "nothing", expected, advice)
    mass = table.mass_kg
    tensor = _compute_shape_tensor(table, mass)
    long = table.rod or table.cylinder
    com = None if long is None else compute_far_end(long) / 2
    if table.com_m is not None:
        com = np.array(table.com_m, dtype=np.float64)
    if com is None:
        raise where.make_error("com_m", "nothing", "the centre of mass, three numbers [m]", "com_m = [0, 0, 0]")
    if reason := describe_impossible_inertia(tensor):
        expected = "the inertia of a body about its centre of mass [kg m^2]: symmetric, moments p1 + p2 >= p3 >= 0"
        advice = "the tensor about the centre of mass, not about the joint; check signs and order of its numbers"
        rows = np.array2string(tensor, separator=", ").replace("\n", "")
        raise where.make_error(given[0], f"{rows}: {reason}", expected, advice)
    return Inertia(mass, com, (tensor + tensor.T) / 2)


def _compute_shape_tensor(table: BodyTable, mass: float) -> Array:
    """Return the inertia about the centre of mass of the one shape that a body states, or the tensor that it does."""
    if table.rod is not None:
        return _build_long_tensor(table.rod, table.rod.axial_inertia_kgm2, mass * table.rod.length_m**2 / 12)
    if table.cylinder is not None:
        radius = table.cylinder.radius_m
        across = mass * (3 * radius**2 + table.cylinder.length_m**2) / 12
        return _build_long_tensor(table.cylinder, mass * radius**2 / 2, across)
    if table.box is not None:  # m (b^2 + c^2)/12
        squares = np.square(table.box.size_m)
        return np.diag(mass * (squares.sum() - squares) / 12)
    if table.sphere is not None:
        return np.eye(3) * (0.4 * mass * table.sphere.radius_m**2)
    return np.asarray(table.inertia_kgm2, dtype=np.float64)


def _build_long_tensor(table: RodTable | CylinderTable, axial: float, across: float) -> Array:
    moments = np.full(3, across)
    moments["xyz".index(table.along)] = axial
    return np.diag(moments)


def read_payloads(
    tables: list[PayloadTable], beam: bool, body_name: str, where: Location, interfaces: Collection[str] = ()
) -> tuple[Body, ...]:
    """Read the bodies that a link carries; on a beam each names its station [-], on a rigid link none does.

    body_name : the name of the link's own body, which no payload may have
    interfaces : of a mesh, of which a body may name one
    """
    bodies: list[Body] = []
    for k, table in enumerate(tables):
        here = where.make_inner_location(f"payload[{k}]")
        on = "the beam's length that carries it"
        off = "the link is rigid"
        check_station(table.station, beam, here, on, off, "com_m alone, in the link frame")
        if table.name in (body_name, *(body.name for body in bodies)):
            expected = "a name of its own for each body of a link"
            raise here.make_error("name", f'"{table.name}" twice', expected, f'name = "{table.name}_2"')
        if table.interface is not None and table.interface not in interfaces:
            raise make_interface_error(table.interface, interfaces, here)
        bodies.append(Body(table.name, read_inertia(table, here), table.station, table.interface or ""))
    return tuple(bodies)


def check_station(station: float | None, on_beam: bool, where: Location, beam: str, other: str, write: str) -> None:
    """Check that what a beam carries names its station [-], and nothing else does; ``beam``, ``other`` : in words."""
    if on_beam and station is None:
        raise where.make_error("station", "nothing", f"the fraction 0..1 of {beam} [-]", "station = 1.0   (the tip)")
    if not on_beam and station is not None:
        raise where.make_error("station", f"station = {station}", f"no station: {other}", write)


def check_interface(name: str | None, link: Link | None, where: Location) -> None:
    """Check that an interface is one of the link's mesh [-]; link : None for the world."""
    known = () if link is None or link.part is None else tuple(link.part.interface_of)
    if name is not None and name not in known:
        raise make_interface_error(name, known, where)


def make_interface_error(name: str, known: Collection[str], where: Location) -> InputError:
    """Return the error about an interface that is none of those that are known [-]."""
    expected = f"an interface of the mesh: {', '.join(known)}" if known else "no interface: that link is no mesh"
    near = find_nearest_word(name, list(known)) or next(iter(known), "")
    write = f'interface = "{near}"' if near else "xyz_m = [0.4, 0, 0]"
    return where.make_error("interface", f'interface = "{name}"', expected, write)
