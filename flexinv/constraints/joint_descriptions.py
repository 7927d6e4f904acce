"""Words of joints in loops: where joints are and how fast they move, as a start states it."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from flexinv.model.joint_kinds import KINDS, POSE
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.typing import Array

# What rounding leaves where a number is zero [rad or m, s] is not shown.
SHOWN_AS_ZERO = 1e-12


def find_owner(mechanism: Mechanism, column: int) -> Joint:
    """Return the joint of a velocity coordinate, by its number [-]."""
    return [joint for joint in mechanism.joints for _ in range(joint.nv)][column]


def find_place(joint: Joint, q: Array) -> Array:
    """Return coordinates (nq of the joint,) as a start states them [rad], [m]: of a continuous joint its angle."""
    return np.arctan2(q[1:], q[:1]) if KINDS[joint.kind].circle else q


def write_numbers(values: Array) -> str:
    """Return numbers [-] as one writes them; six digits are far more than starts are typed with."""
    numbers = [f"{value if abs(value) > SHOWN_AS_ZERO else 0.0:.6g}" for value in values]
    return numbers[0] if len(numbers) == 1 else f"[{', '.join(numbers)}]"


def write_number(mechanism: Mechanism, name: str, values: Array, places: bool) -> str:
    """Return a joint's place, from coordinates (nq,), or its rate, from rates (nv,), as a start states it [rad or m, s]."""
    if places:
        return write_numbers(find_place(mechanism.joint_of[name], values[mechanism.q_slices[name]]))
    return write_numbers(values[mechanism.v_slices[name]])


def write_unit(joint: Joint, places: bool) -> str:
    """Return the unit of a joint's coordinates, or of its rates."""
    kind = KINDS[joint.kind]
    place = kind.units[0]
    rate = f"{kind.units[0]}/s"
    if kind.has_quaternion:
        place, rate = ("m and quaternion", "m/s and rad/s") if kind.layout == POSE else ("(quaternion)", "rad/s")
    return place if places else rate


def write_value(mechanism: Mechanism, name: str, values: Array, places: bool) -> str:
    """Return a joint's place or rate with its unit [rad or m, s]."""
    return f"{write_number(mechanism, name, values, places)} {write_unit(mechanism.joint_of[name], places)}"


def write_start(mechanism: Mechanism, names: Collection[str], values: Array, places: bool) -> str:
    """Return the table of joints that a start, or rates at the start, would be given as [rad or m, s]."""
    return "{" + ", ".join(f"{name!r}: {write_number(mechanism, name, values, places)}" for name in names) + "}"
