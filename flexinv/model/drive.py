"""Drives as frozen data: motor, gear and elastic joint (`motor_side` has the equations)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Drive:
    """Motor, gear and elastic joint of a joint with one coordinate; the equations are in `motor_side`.

    ratio : [-], turns of the motor per turn of the joint, of one that slides [rad/m]; rotor_inertia : of the motor [kg m^2]
    stiffness, damping : of the elastic joint, on its link's side [N m/rad], [N m s/rad] or [N/m], [N s/m]; stiffness 0: a rigid
        gear
    torque_constant : [N m/A], 0 unknown; viscous [N m s/rad], coulomb, static [N m], stribeck [rad/s] : friction of the motor
    moves : "link" or "motor", which of the two the joint's coordinate is (the motor's over the ratio)
    """

    ratio: float = 1.0
    rotor_inertia: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    torque_constant: float = 0.0
    viscous: float = 0.0
    coulomb: float = 0.0
    static: float = 0.0
    stribeck: float = 1.0
    moves: str = "link"
