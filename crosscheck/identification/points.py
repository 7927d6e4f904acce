"""Sensors at points of links: where a marker is seen, and what an accelerometer reads.

marker           x                      position of the point [m], along the axes of the world
accelerometer    (R R_s)^T (a - g)      acceleration less gravity [m/s^2], along its own axes; R_s turns it in the link or section
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crosscheck.identification.settings import FILE, AccelerometerTable, IdentifyTable, MarkerTable
from flexinv.files.joints import read_placement
from flexinv.files.toml_tables import Location
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.links import Body, Inertia, Link, Placement
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

Kind = str
TABLES: dict[Kind, str] = {"marker": "markers", "accelerometer": "accelerometers"}


@dataclass(frozen=True)
class PointSensor:
    """One axis of a marker or an accelerometer: kind and name of its table, axis 0, 1, 2, and the column of a log."""

    kind: Kind
    name: str
    axis: int
    column: str

    @property
    def place(self) -> str:
        """Table and axis, under which its parameters are asked for [-]."""
        return f"{self.name}.{'xyz'[self.axis]}"


def list_point_sensors(settings: IdentifyTable) -> tuple[PointSensor, ...]:
    """Return the axes of markers, then of accelerometers, in the order of identify.toml [-]."""
    return tuple(
        PointSensor(kind, name, "xyz".index(axis), column)
        for kind, tables in TABLES.items()
        for name, table in getattr(settings, tables).items()
        for axis, column in table.columns.named.items()
    )


def add_sensor_bodies(mechanism: Mechanism, settings: IdentifyTable) -> Mechanism:
    """Return the mechanism with a body without mass [kg] at each sensor: the mesh has a node there."""

    def add_to_link(link: Link) -> Link:
        bodies = tuple(
            _make_sensor_body(kind, name, table)
            for kind, name, table in _list_sensor_tables(settings)
            if table.link == link.name
        )
        return replace(link, bodies=(*link.bodies, *bodies)) if bodies else link

    return replace(mechanism, links=tuple(add_to_link(link) for link in mechanism.links))


@dataclass(frozen=True)
class PointMotion:
    """Motion of the points of sensors, one for each axis that is measured.

    x, a : (samples, sensors) position [m] along the world's axis, acceleration [m/s^2] along the sensor's
    axis : (samples, sensors, 3) the sensor's axis in the world [-]; includes_gravity : (sensors,) whether gravity is part of
        the reading
    """

    x: Array
    a: Array
    axis: Array
    includes_gravity: NDArray[np.bool_]

    @classmethod
    def make_empty(cls, samples: int) -> PointMotion:
        """Return the motion of no sensors, of so many samples [-]."""
        return cls(np.zeros((samples, 0)), np.zeros((samples, 0)), np.zeros((samples, 0, 3)), np.zeros(0, dtype=bool))

    def compute_readings(self, gravity: Array) -> Array:
        """Return the readings of the sensors (samples, sensors) [m], [m/s^2] under gravity (3,) [m/s^2]."""
        return np.where(self.includes_gravity, self.a - self.axis @ gravity, self.x)


def build_point_motion(settings: IdentifyTable, mesh: Mesh, nodes: NodalMotion) -> PointMotion:
    """Return the motion of the sensors of a mechanism that `add_sensor_bodies` has given nodes for them [m], [m/s^2]."""
    sensors = list_point_sensors(settings)
    samples = len(nodes.x)
    x, a = np.zeros((2, samples, len(sensors)))
    axis = np.zeros((samples, len(sensors), 3))
    for k, sensor in enumerate(sensors):
        table = getattr(settings, TABLES[sensor.kind])[sensor.name]
        node = mesh.body_node[table.link, _make_sensor_name(sensor.kind, sensor.name)]
        axis[:, k] = nodes.rotation[:, node] @ _read_sensor_placement(table).rotation[:, sensor.axis]
        x[:, k] = nodes.x[:, node, sensor.axis]
        a[:, k] = np.einsum("ti,ti->t", axis[:, k], nodes.a[:, node])
    return PointMotion(x, a, axis, np.array([sensor.kind == "accelerometer" for sensor in sensors], dtype=bool))


def _list_sensor_tables(settings: IdentifyTable) -> Iterator[tuple[Kind, str, MarkerTable | AccelerometerTable]]:
    for kind, tables in TABLES.items():
        for name, table in getattr(settings, tables).items():
            yield kind, name, table


def _make_sensor_body(kind: Kind, name: str, table: MarkerTable | AccelerometerTable) -> Body:
    return Body(_make_sensor_name(kind, name), Inertia(0.0, _read_sensor_placement(table).position), table.station)


def _read_sensor_placement(table: MarkerTable | AccelerometerTable) -> Placement:
    return read_placement(table, Location(Path(FILE)))


def _make_sensor_name(kind: Kind, name: str) -> str:
    return f"{kind} {name}"
