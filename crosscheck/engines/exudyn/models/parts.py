"""Parts that the planar and the spatial models of Exudyn have in common: a system under construction, a run's outcome."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, SupportsInt

import exudyn as exu
import numpy as np
from exudyn.itemInterface import LoadMassProportional, MarkerBodyMass, ObjectGround

from crosscheck.engines.exudyn.integration import Driver
from crosscheck.engines.exudyn.models.frames import Array
from crosscheck.engines.exudyn.script import make_listener

Poses = tuple[Array, Array]


@dataclass(frozen=True)
class Model:
    """An Exudyn system under construction; its dictionaries fill while it is built.

    mbs : the system (container keeps it alive); ground : its ground object
    body, node : object and node number of the body of a group; beam : node numbers along a beam
    loads : user functions of loads that vary, by load number
    joint : object numbers of the connectors of a joint; lock : of what holds a beam's root; closure : of a closure's
    spring : of the connector of a spring between points
    """

    container: Any
    mbs: Any
    ground: Any
    body: dict[int, Any] = field(default_factory=dict)
    node: dict[int, Any] = field(default_factory=dict)
    beam: dict[str, list[Any]] = field(default_factory=dict)
    joint: dict[str, tuple[Any, ...]] = field(default_factory=dict)
    lock: dict[str, SupportsInt] = field(default_factory=dict)
    closure: dict[str, SupportsInt] = field(default_factory=dict)
    spring: dict[str, SupportsInt] = field(default_factory=dict)
    drivers: list[Driver] = field(default_factory=list)
    loads: dict[Any, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run, in the world unless said otherwise.

    pose : of every group (samples, 3) [m] and (samples, 3, 3) [-]; end : of every beam (samples, 3) [m]
    wrench : by moving joint (samples, 6) [N], [N m], on the child, at the joint, in the child's frame
    root : the same of the lock of a beam's root, on the beam, in its root frame
    closure : the same of closures, on the second frame, there, along its axes
    """

    pose: dict[int, Poses]
    end: dict[str, Array]
    wrench: dict[str, Array]
    root: dict[str, Array]
    closure: dict[str, Array] = field(default_factory=dict)


def make_empty_model() -> Model:
    """Return a system with nothing but the ground in it."""
    container = exu.SystemContainer()
    mbs = make_listener(container.AddSystem())
    return Model(container, mbs, mbs.AddObject(ObjectGround()))


def add_gravity(model: Model, number: Any, gravity: Array) -> None:
    """Put gravity (3,) [m/s^2] on an object with mass."""
    if gravity.any():
        marker = model.mbs.AddMarker(MarkerBodyMass(bodyNumber=number))
        model.mbs.AddLoad(LoadMassProportional(markerNumber=marker, loadVector=list(gravity)))


def build_pose_matrix(position: Array, rotation: Array) -> Array:
    """Return the 4 x 4 matrix of a pose."""
    h = np.eye(4)
    h[:3, :3] = rotation
    h[:3, 3] = position
    return h
