"""A machine: a mechanism with what identify.toml says of it, its sensors as channels, and the value of each parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from crosscheck.identification.parameters import KINDS, TWICE, Key, ParameterSpace, find_prior_value
from crosscheck.identification.points import PointSensor, list_point_sensors
from crosscheck.identification.settings import (
    ACCELERATIONS,
    ANGLES,
    EFFORTS,
    LENGTHS,
    STRAINS,
    EffortTable,
    IdentifyTable,
)
from flexinv.errors import InputError
from flexinv.model.mechanism import Mechanism

POINT_UNITS = {"marker": "m", "accelerometer": "m/s^2"}


@dataclass(frozen=True)
class Channel:
    """A sensor: its name with what it measures, the unit it is compared in, and its joint, gauge or point.

    sense : "effort", "gauge", "marker" or "accelerometer"; factor : of its column [unit per that of the column]
    constant : torque [N m] or force [N] at the sensor per unit; ratio : effort of the joint per unit: times the gear before it
    """

    name: str
    unit: str
    place: str
    sense: str = "effort"
    ratio: float = 1.0
    factor: float = 1.0
    column: str = ""
    constant: float = 1.0


@dataclass(frozen=True)
class Machine:
    """A mechanism with what identify.toml says of it."""

    mechanism: Mechanism
    settings: IdentifyTable
    space: ParameterSpace

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """Sensors in the order of all arrays of readings."""
        out = []
        for name, table in self.settings.joints.items():
            if table.effort is not None:
                out.append(self._build_effort_channel(name, table.effort))
        for name, gauge in self.settings.gauges.items():
            unit = "m/m" if gauge.unit in STRAINS else "rad"
            out.append(Channel(f"gauge/{name}", unit, name, "gauge", 1.0, (ANGLES | STRAINS)[gauge.unit], gauge.column))
        for one in list_point_sensors(self.settings):
            name = f"{one.kind}/{one.place}"
            unit = POINT_UNITS[one.kind]
            out.append(Channel(name, unit, one.place, one.kind, 1.0, self._find_point_factor(one), one.column))
        return tuple(out)

    def _build_effort_channel(self, name: str, effort: EffortTable) -> Channel:
        """The effort of a joint in N m or N; a current whose gain is free in ampere: nobody knows how many N m it is."""
        joint = self.mechanism.joint_of[name]
        ratio = joint.drive.ratio if joint.drive is not None and effort.side == "motor" else 1.0
        factor = self._find_effort_factor(name, effort)
        if effort.unit == "A" and ("effort gain", name) in {one.key for one in self.space.parameters}:
            return Channel(f"torque/{name}", "A", name, "effort", ratio * factor, 1.0, effort.column, factor)
        unit = "N" if joint.kind == "prismatic" and ratio == 1.0 else "N m"
        return Channel(f"torque/{name}", unit, name, "effort", ratio, factor, effort.column)

    def _find_point_factor(self, one: PointSensor) -> float:
        if one.kind == "marker":
            return LENGTHS[self.settings.markers[one.name].unit]
        return ACCELERATIONS[self.settings.accelerometers[one.name].unit]

    def _find_effort_factor(self, name: str, effort: EffortTable) -> float:
        joint = self.mechanism.joint_of[name]
        if effort.unit != "A":
            return EFFORTS[effort.unit]
        if effort.constant_Nm_per_A is not None:
            return effort.constant_Nm_per_A
        drive = joint.drive
        if drive is None or not drive.torque_constant:
            raise InputError(
                f"identify.toml, joints.{name}.effort: a current [A] without torque constant; "
                "write constant_Nm_per_A, or torque_constant_Nm_per_A in the joint's drive"
            )
        return drive.torque_constant * (1.0 if effort.side == "motor" else drive.ratio)


def has_friction(machine: Machine, channel: Channel) -> bool:
    """Return True for a channel that shows rotor and friction of a drive: the effort of a motor, not that of its link."""
    return channel.sense == "effort" and not machine.settings.joints[channel.place].has_link_sensor


def resolve_value(machine: Machine, values: Mapping[Key, float], kind: str, place: str) -> float:
    """Return a parameter [unit of it] by the values, or by the mechanism and the settings where it is not free."""
    if (kind, place) in values:
        return values[kind, place]
    drive, joint = TWICE
    if kind == drive and (joint, place) in values:  # which has all of it
        return 0.0
    return find_prior_value(machine.mechanism, machine.settings, KINDS[kind], place)
