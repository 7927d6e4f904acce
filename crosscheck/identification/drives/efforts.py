"""Efforts of drives: rotor and friction of a motor by its rate, load and temperature, and motors that follow several joints.

drive   rotor a + viscous exp(k_v w) v + quadratic |v| v + exp(k_c w) dry + asymmetry |tanh(v / v_t)|
dry     tanh(v / v_t) (coulomb (1 + share exp(-(v / v_s)^2)) + load friction |tau|)

w : how much warmer than its reference the drive is; tau : of the joint without drives, which the gear carries

v = (1 + c) q',   efforts of motors = (1 + c)^-T tau:   the power is the same

c_jk : by how much the motor of joint j follows joint k
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from crosscheck.identification.machine import Channel, Machine, resolve_value
from crosscheck.identification.parameters import COUPLING, Key
from crosscheck.identification.responses.response import MeasuredMotion
from flexinv.typing import Array

NUMBERS = (
    *("rotor inertia", "viscous friction", "coulomb friction", "transition rate"),
    *("stribeck share", "stribeck rate", "friction asymmetry", "quadratic friction"),
)


def compute_drive_effort(
    machine: Machine,
    joint: str,
    rate: Array,
    acceleration: Array,
    values: Mapping[Key, float],
    load: Array | None = None,
    warmth: Array | None = None,
) -> Array:
    """Return the effort of rotor and friction of a joint (samples,) [N m], [N] at its rates and accelerations (samples,).

    load : (samples,) [N m], [N] that the gear carries, 0 where absent; warmth : (samples,) [K] beyond the reference
    """
    numbers = tuple(resolve_value(machine, values, kind, joint) for kind in NUMBERS)
    viscous, dry, side, rest = _compute_parts(rate.tobytes(), acceleration.tobytes(), numbers)
    loaded = resolve_value(machine, values, "load friction", joint)
    if loaded and load is not None:
        dry = dry + loaded * np.abs(load) * side
    if warmth is not None:
        kelvins = [
            resolve_value(machine, values, f"{kind} friction per kelvin", joint) for kind in ("viscous", "coulomb")
        ]
        viscous = viscous * np.exp(kelvins[0] * warmth)
        dry = dry * np.exp(kelvins[1] * warmth)
    return np.asarray(viscous + dry + rest)


@lru_cache(maxsize=64)  # a difference quotient by one parameter leaves most joints as they were
def _compute_parts(rate: bytes, acceleration: bytes, numbers: tuple[float, ...]) -> Array:
    """Viscous and dry friction, the sense of the rate, and all else that a drive needs (4, samples), by its numbers."""
    v = np.frombuffer(rate)
    a = np.frombuffer(acceleration)
    rotor, viscous, coulomb, turn, share, wide, skew, quadratic = numbers
    side = np.tanh(v / turn)
    dry = coulomb * side * (1.0 + share * np.exp(-((v / wide) ** 2)))
    out = np.array([viscous * v, dry, side, rotor * a + quadratic * np.abs(v) * v + skew * np.abs(side)])
    out.setflags(write=False)
    return out


def compute_loaded_drive_effort(
    machine: Machine, motion: MeasuredMotion, joint: str, load: Array, values: Mapping[Key, float]
) -> Array:
    """Return the effort of a drive (samples,) [N m], [N] along a measured motion; load : (samples,) [N m], [N] of its joint."""
    rate, acceleration = compute_motor_motion(machine, motion, joint, values)
    warmth = None if motion.warmth is None else motion.warmth[:, motion.names.index(joint)]
    return compute_drive_effort(machine, joint, rate, acceleration, values, load, warmth)


def compute_motor_motion(
    machine: Machine, motion: MeasuredMotion, joint: str, values: Mapping[Key, float]
) -> tuple[Array, Array]:
    """Return rate [rad/s], [m/s] and acceleration (samples,) of the motor of a joint, which may follow other joints, too."""
    at = motion.names.index(joint)
    rate = motion.qd[:, at]
    acceleration = motion.qdd[:, at]
    for other in machine.settings.joints[joint].follows:
        part = resolve_value(machine, values, COUPLING, f"{joint}/{other}")
        k = motion.names.index(other)
        rate = rate + part * motion.qd[:, k]
        acceleration = acceleration + part * motion.qdd[:, k]
    return rate, acceleration


def compute_channel_rate(
    machine: Machine, motion: MeasuredMotion, channel: Channel, values: Mapping[Key, float] | None = None
) -> Array:
    """Return the rate (samples,) [rad/s], [m/s] at which the drive of an effort slides; values : the known ones where absent."""
    return compute_motor_motion(machine, motion, channel.place, values or {})[0]


def convert_to_motor_efforts(
    machine: Machine, motion: MeasuredMotion, effort: Array, values: Mapping[Key, float]
) -> Array:
    """Return the efforts of motors without drives (samples, joints) [N m], [N] by those of the joints: (1 + c)^-T tau."""
    couplings = np.eye(len(motion.names))
    for j, joint in enumerate(motion.names):
        for other in machine.settings.joints[joint].follows:
            value = resolve_value(machine, values, COUPLING, f"{joint}/{other}")
            couplings[j, motion.names.index(other)] += value
    if np.array_equal(couplings, np.eye(len(couplings))):
        return effort
    return np.asarray(np.linalg.solve(couplings.T, effort.T).T)


def compute_friction(
    machine: Machine, joint: str, v: Array, values: Mapping[Key, float], load: Array | None = None
) -> Array:
    """Return the friction of a joint (samples,) [N m], [N] at rates v (samples,) [rad/s], [m/s]; load : as above."""
    return compute_drive_effort(machine, joint, v, np.zeros_like(v), values, load)


def compute_friction_reading(
    machine: Machine, channel: Channel, v: Array, values: Mapping[Key, float], load: Array | None = None
) -> Array:
    """Return friction as the sensor of an effort reads it (samples,) [unit of the channel] at rates v (samples,)."""
    gain = resolve_value(machine, values, "effort gain", channel.place)
    return gain * compute_friction(machine, channel.place, v, values, load) / channel.ratio
