"""The table ``[joints.NAME.drive]``: motor, gear, elastic joint and friction, with units in its keys."""

from __future__ import annotations

from typing import Literal

from flexinv.files.toml_tables import Location, Table, key, optional
from flexinv.files.unit_keys import split_unit
from flexinv.files.values import NotNegative, Positive
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Drive


class MotorTable(Table):
    """The motor, its friction, and what is moved."""

    motor_inertia_kgm2: NotNegative = key(
        "inertia of the rotor at the motor's shaft, >= 0 [kg m^2]", "1e-4", default=0.0
    )
    torque_constant_Nm_per_A: Positive | None = optional("torque of the motor per current, > 0 [N m/A]", "0.05")
    viscous_Nms_per_rad: NotNegative = key(
        "viscous friction at the motor's shaft, >= 0 [N m s/rad]", "1e-5", default=0.0
    )
    coulomb_Nm: NotNegative = key("dry friction at the motor's shaft, >= 0 [N m]", "0.01", default=0.0)
    static_Nm: NotNegative = key("friction when it begins to turn, not below coulomb_Nm [N m]", "0.015", default=0.0)
    stribeck_rad_per_s: Positive = key(
        "rate of the motor at which static friction has gone to a third [rad/s]", "1.0", default=1.0
    )
    moves: Literal["link", "motor"] = key(
        'what the motion of this joint is, "link" or "motor" (its angle over the gear ratio)', '"motor"', default="link"
    )


class DriveTable(MotorTable):
    """Motor, gear and elastic joint of a joint that turns."""

    gear_ratio: Positive = key("turns of the motor per turn of the joint, > 0 [-]", "100", default=1.0)
    stiffness_Nm_per_rad: NotNegative = key(
        "stiffness of the elastic joint at the link, >= 0 [N m/rad]; 0: a rigid gear", "5e3", default=0.0
    )
    damping_Nms_per_rad: NotNegative = key(
        "damping of the elastic joint at the link, >= 0 [N m s/rad]", "5", default=0.0
    )


class LinearDriveTable(MotorTable):
    """Motor, screw (or rack, or drum) and elastic joint of a joint that slides."""

    gear_ratio_rad_per_m: Positive = key(
        "angle of the motor per way of the joint, > 0 [rad/m]; of a screw 2 pi over its lead", "1257"
    )
    stiffness_N_per_m: NotNegative = key(
        "stiffness of the elastic joint at the link, >= 0 [N/m]; 0: a rigid gear", "5e5", default=0.0
    )
    damping_Ns_per_m: NotNegative = key("damping of the elastic joint at the link, >= 0 [N s/m]", "500", default=0.0)


# By kind of joint: what its table ``drive`` is.
MOTORS: dict[str, type[MotorTable]] = {
    name: LinearDriveTable if any(kind.translations) else DriveTable for name, kind in KINDS.items() if len(kind.v) == 1
}


def read_drive(table: MotorTable | None, where: Location) -> Drive | None:
    """Return the drive [kg m^2, N m/rad, N/m, N m s/rad, N m/A, N m] of a joint, or None."""
    if table is None:
        return None
    if table.static_Nm and table.static_Nm < table.coulomb_Nm:
        given = f"static_Nm = {table.static_Nm:g} below coulomb_Nm = {table.coulomb_Nm:g}"
        raise where.wrong("static_Nm", given, "at least coulomb_Nm [N m]", f"static_Nm = {1.5 * table.coulomb_Nm:g}")
    stated = {split_unit(key)[0]: value for key, value in table if value is not None}
    return Drive(ratio=stated.pop("gear_ratio"), rotor_inertia=stated.pop("motor_inertia"), **stated)
