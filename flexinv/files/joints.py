"""Joints of a mechanism file, their drives and their tree: one table per kind, so that every key has the unit of that kind."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal

import numpy as np

from flexinv.errors import ModelWarning
from flexinv.files.schema import PLACEMENT, SOURCE, PlacementTable
from flexinv.files.toml_tables import (
    Location,
    Table,
    check_table,
    make_input_error,
    make_key,
    make_optional_key,
    read_option,
)
from flexinv.files.values import Fraction, Name, NotNegative, Number, Positive, Text, Vector, split_unit
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import WORLD, Drive, Joint, Limits, Placement
from flexinv.typing import Array
from flexinv.validation import find_nearest_word


class MotorTable(Table):
    """The motor, its friction, and what is moved."""

    motor_inertia_kgm2: NotNegative = make_key("inertia of the rotor at the motor's shaft, >= 0 [kg m^2]", "1e-4", 0.0)
    torque_constant_Nm_per_A: Positive | None = make_optional_key(
        "torque of the motor per current, > 0 [N m/A]", "0.05"
    )
    viscous_Nms_per_rad: NotNegative = make_key("viscous friction at the motor's shaft, >= 0 [N m s/rad]", "1e-5", 0.0)
    coulomb_Nm: NotNegative = make_key("dry friction at the motor's shaft, >= 0 [N m]", "0.01", 0.0)
    static_Nm: NotNegative = make_key("friction when it begins to turn, not below coulomb_Nm [N m]", "0.015", 0.0)
    stribeck_rad_per_s: Positive = make_key(
        "rate of the motor at which static friction has gone to a third [rad/s]", "1.0", 1.0
    )
    moves: Literal["link", "motor"] = make_key(
        'what the motion of this joint is, "link" or "motor" (its angle over the gear ratio)', '"motor"', "link"
    )


class DriveTable(MotorTable):
    """Motor, gear and elastic joint of a joint that turns."""

    gear_ratio: Positive = make_key("turns of the motor per turn of the joint, > 0 [-]", "100", 1.0)
    stiffness_Nm_per_rad: NotNegative = make_key(
        "stiffness of the elastic joint at the link, >= 0 [N m/rad]; 0: a rigid gear", "5e3", 0.0
    )
    damping_Nms_per_rad: NotNegative = make_key("damping of the elastic joint at the link, >= 0 [N m s/rad]", "5", 0.0)


class LinearDriveTable(MotorTable):
    """Motor, screw (or rack, or drum) and elastic joint of a joint that slides."""

    gear_ratio_rad_per_m: Positive = make_key(
        "angle of the motor per way of the joint, > 0 [rad/m]; of a screw 2 pi over its lead", "1257"
    )
    stiffness_N_per_m: NotNegative = make_key(
        "stiffness of the elastic joint at the link, >= 0 [N/m]; 0: a rigid gear", "5e5", 0.0
    )
    damping_Ns_per_m: NotNegative = make_key("damping of the elastic joint at the link, >= 0 [N s/m]", "500", 0.0)


# By kind of joint: what its table ``read_drive_properties`` is.
MOTORS: dict[str, type[MotorTable]] = {
    name: LinearDriveTable if any(kind.translations) else DriveTable for name, kind in KINDS.items() if len(kind.v) == 1
}


def read_drive(table: MotorTable | None, where: Location) -> Drive | None:
    """Return the drive [kg m^2, N m/rad, N/m, N m s/rad, N m/A, N m] of a joint, or None."""
    if table is None:
        return None
    if table.static_Nm and table.static_Nm < table.coulomb_Nm:
        given = f"static_Nm = {table.static_Nm:g} below coulomb_Nm = {table.coulomb_Nm:g}"
        raise where.make_error(
            "static_Nm", given, "at least coulomb_Nm [N m]", f"static_Nm = {1.5 * table.coulomb_Nm:g}"
        )
    stated = {split_unit(key)[0]: value for key, value in table if value is not None}
    return Drive(ratio=stated.pop("gear_ratio"), rotor_inertia=stated.pop("motor_inertia"), **stated)


NAMES = " or ".join(", ".join(f'"{name}"' for name in part) for part in (list(KINDS)[:-1], list(KINDS)[-1:]))
DRIVE = "[joints.NAME.drive]"
JOINT_AXIS = "the axis in the joint frame, three numbers [-]"
# The length of an axis may be off by this much before it is worth a warning: seven digits were typed.
UNIT_LENGTH = 1e-6


class LimitsTable(Table):
    """Limits of a rotary drive; a continuous joint has no position limits."""

    effort_Nm: Positive | None = make_optional_key("the largest torque, > 0 [N m]", "150")
    velocity_rad_per_s: Positive | None = make_optional_key("the largest speed, > 0 [rad/s]", "3.15")


class RotaryLimitsTable(LimitsTable):
    """Limits of a rotary drive, position limits included."""

    lower_rad: Number | None = make_optional_key("the lowest angle [rad]", "-3.14")
    upper_rad: Number | None = make_optional_key("the highest angle [rad]", "3.14")


class LinearLimitsTable(Table):
    """Limits of a linear drive, position limits included."""

    effort_N: Positive | None = make_optional_key("the largest force, > 0 [N]", "500")
    velocity_m_per_s: Positive | None = make_optional_key("the largest speed, > 0 [m/s]", "0.5")
    lower_m: Number | None = make_optional_key("the lowest position [m]", "0.0")
    upper_m: Number | None = make_optional_key("the highest position [m]", "0.3")


class ActuatedTable(Table):
    """Drive of a joint: there or not, and its part where drives are redundant."""

    actuated: bool = make_key("true, or false for a passive joint", "false", True)
    weight: Positive = make_key(
        "weight > 0 of the square of its effort where drives are redundant [-]: the heavier, the less it gives",
        "4", 1.0,
    )  # fmt: skip


class RotaryLosses(ActuatedTable):
    """Damping and friction of a joint that turns."""

    damping_Nms_per_rad: NotNegative = make_key("viscous damping, >= 0 [N m s/rad]", "0.1", 0.0)
    friction_Nm: NotNegative = make_key("dry friction, >= 0 [N m]", "0.5", 0.0)


class RotaryDrive(RotaryLosses):
    """Rotor, damping and friction of a joint that turns."""

    rotor_inertia_kgm2: NotNegative = make_key("rotor inertia at the joint, >= 0 [kg m^2]", "0.01", 0.0)


class SprungDrive(RotaryDrive):
    """Rotor, damping, friction and spring of a joint with one angle."""

    stiffness_Nm_per_rad: NotNegative = make_key("stiffness of a spring in the joint, >= 0 [N m/rad]", "20", 0.0)
    rest_rad: Number | None = make_optional_key("the angle at which the spring rests [rad]", "0.5")
    rest_deg: Number | None = make_optional_key("the angle at which the spring rests [deg]", "30")


class LinearDrive(ActuatedTable):
    """Rotor, damping, friction and spring of a joint that slides."""

    rotor_inertia_kg: NotNegative = make_key("rotor inertia as a mass at the joint, >= 0 [kg]", "1.5", 0.0)
    damping_Ns_per_m: NotNegative = make_key("viscous damping, >= 0 [N s/m]", "10", 0.0)
    friction_N: NotNegative = make_key("dry friction, >= 0 [N]", "5", 0.0)
    stiffness_N_per_m: NotNegative = make_key("stiffness of a spring in the joint, >= 0 [N/m]", "500", 0.0)
    rest_m: Number = make_key("the position at which the spring rests [m]", "0.1", 0.0)


class JointTable(Table):
    """Keys of every joint: the links that it connects and its placement; all keys of a fixed joint and of a free one."""

    kind: str = make_key(f"one of {NAMES}", '"revolute"')
    parent: Name = make_key('the link it hangs on, or "world"', '"world"')
    child: Name = make_key("the link that it carries", '"forearm"')
    placement: PlacementTable | None = make_optional_key(PLACEMENT, "{ xyz_m = [0.4, 0, 0] }")
    station: Fraction | None = make_optional_key("on a beam parent: the fraction 0..1 of its length [-]", "1.0")
    interface: Name | None = make_optional_key("on a meshed parent: the interface that carries it", '"flange"')
    source: Text = SOURCE


class SphericalTable(RotaryLosses, JointTable):
    """Three rotations."""


class ContinuousTable(SprungDrive, JointTable):
    """A rotation without end."""

    drive: DriveTable | None = make_optional_key("a table: gear_ratio, motor_inertia_kgm2, ...", DRIVE)
    axis: Vector = make_key(JOINT_AXIS, "[0, 0, 1]")
    limits: LimitsTable | None = make_optional_key("a table: effort_Nm, velocity_rad_per_s", "{ effort_Nm = 150 }")


class RevoluteTable(ContinuousTable):
    """A rotation."""

    limits: RotaryLimitsTable | None = make_optional_key(
        "a table: effort_Nm, velocity_rad_per_s, lower_rad, upper_rad", "{ effort_Nm = 150 }"
    )


class HelicalTable(RevoluteTable):
    """A screw: a rotation and a translation along its axis in a fixed ratio."""

    pitch_m: Number = make_key("the way along the axis for a whole turn about it [m]; negative: left-handed", "0.005")


class PrismaticTable(LinearDrive, JointTable):
    """A translation."""

    drive: LinearDriveTable | None = make_optional_key("a table: gear_ratio_rad_per_m, motor_inertia_kgm2, ...", DRIVE)
    axis: Vector = make_key(JOINT_AXIS, "[1, 0, 0]")
    limits: LinearLimitsTable | None = make_optional_key(
        "a table: effort_N, velocity_m_per_s, lower_m, upper_m", "{ effort_N = 500 }"
    )


class UniversalTable(RotaryDrive, JointTable):
    """Two rotations about axes at right angles."""

    axis: Vector = make_key("the first axis in the joint frame, three numbers [-]", "[1, 0, 0]")
    second_axis: Vector = make_key("the second axis, across the first, three numbers [-]", "[0, 1, 0]")


JOINT_TABLES: dict[str, type[JointTable]] = {
    "revolute": RevoluteTable, "continuous": ContinuousTable, "prismatic": PrismaticTable, "helical": HelicalTable,
    "spherical": SphericalTable, "universal": UniversalTable, "fixed": JointTable, "free": JointTable,
}  # fmt: skip
# By kind of joint: the drive of its table, the last of these, which may be laid over a URDF.
_DRIVEN = RotaryDrive, SprungDrive, LinearDrive
DRIVES: dict[str, type[Table]] = {
    k: own for k, table in JOINT_TABLES.items() for own in _DRIVEN if issubclass(table, own)
}


def read_joint(data: Any, where: Location, name: str) -> Joint:
    """Read ``[joints.NAME]`` into a joint [m, rad, kg m^2, N m s/rad, N m] of its kind."""
    kind = read_option(data, where, "kind", KINDS, f"one of {NAMES}", "revolute")
    table = check_table(JOINT_TABLES[kind or "revolute"], data, where)
    axes = read_axes(table, where)
    pitch = getattr(table, "pitch_m", None)
    if "second_axis" in axes and abs(axes["axis"] @ axes["second_axis"]) > UNIT_LENGTH:
        expected = "a second axis at right angles to the first [-]"
        advice = "second_axis = [0, 1, 0] with axis = [1, 0, 0]; else two revolute joints with a massless link between"
        raise where.make_error("second_axis", f"second_axis = {axes['second_axis'].tolist()}", expected, advice)
    stated = getattr(table, "limits", None) or ()
    limits = Limits(**{split_unit(key)[0]: value for key, value in stated if value is not None})
    if limits.lower > limits.upper:
        given = f"lower {limits.lower:g}, upper {limits.upper:g}"
        raise where.make_inner_location("limits").make_error(
            "upper", given, "lower <= upper", "the two exchanged, if so meant"
        )
    if pitch == 0.0:
        raise where.make_error("pitch_m", "pitch_m = 0", "a pitch other than zero [m]", 'kind = "revolute", no pitch_m')
    return Joint(
        name, table.kind, table.parent, table.child, read_placement(table.placement, where.make_inner_location("placement")),
        table.station, **axes, **read_drive_properties(table, where), limits=limits,
        drive=read_drive(getattr(table, "drive", None), where.make_inner_location("drive")), pitch=pitch or 0.0,
        interface=table.interface or "",
    )  # fmt: skip


def read_drive_properties(table: Table, where: Location) -> dict[str, Any]:
    """Return rotor [kg m^2 or kg], damping, friction, spring and actuation as a drive or joint table states them."""
    names = ("rotor_inertia", "damping", "friction", "stiffness", "actuated", "weight")
    stated = {name: value for key, value in table if (name := split_unit(key)[0]) in names}
    if "stiffness" in stated:
        named = [k for k in ("rest_rad", "rest_deg", "rest_m") if k in table.model_fields_set]
        if len(named) > 1:
            raise where.make_error(named[1], " and ".join(named), "one of them", f"{named[0]} alone")
        if named and not stated["stiffness"]:
            spring = next(k for k in type(table).model_fields if k.startswith("stiffness"))
            expected = f"a stiffness too: {type(table).model_fields[spring].description}"
            raise where.make_error(named[0], f"{named[0]} alone", expected, f"{spring} = 20")
        value = float(getattr(table, named[0])) if named else 0.0
        stated["rest"] = float(np.radians(value)) if named == ["rest_deg"] else value
    return stated if "actuated" in stated else {**stated, "actuated": False}


def read_axes(table: Table, where: Location) -> dict[str, Any]:
    """Read the keys axis and second_axis, (3,) [-] each, where the table has them."""
    names = [name for name in ("axis", "second_axis") if hasattr(table, name)]
    return {
        name: scale_to_unit_axis(getattr(table, name), where.describe_key(name), f"{name} = [0, 0, 1]")
        for name in names
    }


def scale_to_unit_axis(axis: Any, where: str, write: str) -> Array:
    """Normalise an axis (3,) [-]: ModelWarning where it was not of length 1, InputError where it is zero."""
    vector = np.asarray(axis, dtype=np.float64)
    largest = float(np.abs(vector).max())
    length = largest * float(np.linalg.norm(vector / largest)) if largest else 0.0
    if length == 0.0:
        raise make_input_error(
            where, f"a zero axis, {vector.tolist()}", "a direction: three numbers, not all zero [-]", write
        )
    if abs(length - 1) > UNIT_LENGTH:
        said = f"{where}: {vector.tolist()} has length {length:.7g}, normalised to 1"
        warnings.warn(said, ModelWarning, stacklevel=2)
    return vector / length


def compute_rpy_rotation(rpy: Any) -> Array:
    """Return R = R_z(yaw) R_y(pitch) R_x(roll), (3, 3) [-], from rpy (3,) [rad]: URDF's fixed-axis angles."""
    sr, sp, sy = np.sin(rpy)
    cr, cp, cy = np.cos(rpy)
    x = [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr]
    y = [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr]
    return np.array([x, y, [-sp, cp * sr, cp * cr]])


def read_placement(table: PlacementTable | None, where: Location) -> Placement:
    """Read a placement [m, rad]; the rotation may be stated in one way only."""
    if table is None:
        return Placement()
    stated = [name for name in ("rpy_deg", "rpy_rad", "rotation") if getattr(table, name) is not None]
    if len(stated) > 1:
        raise where.make_error(
            stated[1], " and ".join(stated), "one of rpy_deg, rpy_rad, rotation", f"{stated[0]} alone"
        )
    degrees = table.rpy_deg or [0.0, 0.0, 0.0]
    rotation = compute_rpy_rotation(np.radians(degrees) if table.rpy_rad is None else table.rpy_rad)
    if table.rotation is not None:
        rotation = np.asarray(table.rotation)
    elif table.rpy_rad is None and all(angle % 90 == 0 for angle in degrees):
        rotation = np.rint(rotation) + 0.0  # 90 degrees typed as 90 are a whole quarter turn: 0 and 1, not 6e-17
    return Placement(np.array(table.xyz_m, dtype=np.float64), rotation)


# ("joint" or "link", its name, the key) -> the words that name the place in the file
Where = Callable[[str, str, str], str]


def list_depth_first(joints: Sequence[Joint], links: Iterable[str], where: Where) -> tuple[Joint, ...]:
    """Return the joints depth-first from the world, children in the order given [-].

    InputError: a joint to nowhere, two joints that carry one link, a cycle, a link that nothing carries.
    """
    names = dict.fromkeys(links)
    check_ends(joints, [WORLD, *names], names, where)
    children: dict[str, list[Joint]] = {}
    carried: dict[str, Joint] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint)
        first = carried.setdefault(joint.child, joint)
        if first is not joint:
            given = f'child = "{joint.child}", which joint {first.name} carries already'
            expected = "a tree: one joint carries each link; what closes a loop is a closure"
            advice = f"[closures.{joint.name}] with kind, first and second in a mechanism file instead of this joint"
            raise make_input_error(where("joint", joint.name, "child"), given, expected, advice)
    ordered: list[Joint] = []
    waiting = children.get(WORLD, [])[::-1]
    while waiting:
        joint = waiting.pop()
        ordered.append(joint)
        waiting.extend(children.get(joint.child, [])[::-1])
    reached = {joint.child for joint in ordered}
    unreached = [link for link in names if link not in reached]
    for link in unreached:
        if link not in carried:
            expected = "every link carried by one joint"
            advice = f'a joint with child = "{link}" and parent = "{WORLD}" or another link'
            raise make_input_error(where("link", link, ""), "a link that no joint carries", expected, advice)
    if unreached:  # each of them is carried, none from the world: they go round
        path = [unreached[0]]  # along its parents, from a link back to itself
        while path[-1] not in path[:-1]:
            path.append(carried[path[-1]].parent)
        path = path[path.index(path[-1]) :]
        given = f"a cycle: {' <- '.join(path)}"
        name = carried[path[-1]].name
        expected = f'a tree that hangs on "{WORLD}"; what closes a loop is a closure'
        closure = f"[closures.{name}] with first and second where the loop closes"
        advice = f'parent = "{WORLD}" for one of these joints; {closure}'
        raise make_input_error(where("joint", name, "parent"), given, expected, advice)
    return tuple(ordered)


def check_ends(joints: Sequence[Joint], parents: Iterable[str], links: Iterable[str], where: Where) -> None:
    """Check that every joint joins two links that exist [-]; InputError names a joint to nowhere."""
    ends = {"parent": dict.fromkeys(parents), "child": dict.fromkeys(links)}
    for joint in joints:
        for end, known in ends.items():
            name = getattr(joint, end)
            if name not in known:
                near = find_nearest_word(name, known)
                expected = "one of the links " + ", ".join(list(known)[:20]) + (", ..." if len(known) > 20 else "")
                advice = f'{end} = "{near}"' if near else f"a link {name}, or the name of one that exists"
                raise make_input_error(where("joint", joint.name, end), f'{end} = "{name}"', expected, advice)
        if joint.parent == joint.child:
            given = f'parent and child are both "{joint.child}"'
            raise make_input_error(where("joint", joint.name, "child"), given, "two links", "another parent")
