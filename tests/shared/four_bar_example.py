"""A four-bar linkage of rigid rods, its start and a turn of its crank."""

from __future__ import annotations

import numpy as np

import flexinv
from flexinv.model.mechanism import Attachment, Body, Closure, Inertia, Joint, Link, Mechanism, Placement


def _rod(name: str, length: float, mass: float) -> Link:
    tensor = np.diag([1e-6, mass * length**2 / 12, mass * length**2 / 12])
    return Link(
        name, (Body(name, Inertia(mass, np.array([length / 2, 0, 0]), tensor)),), tip=np.array([length, 0.0, 0.0])
    )


def _at(x: float) -> Placement:
    return Placement(np.array([x, 0.0, 0.0]))


def four_bar(
    crank: float = 0.2, coupler: float = 0.5, rocker: float = 0.4, base: float = 0.45, kind: str = "revolute"
) -> Mechanism:
    links = (_rod("crank", crank, 0.3), _rod("coupler", coupler, 0.5), _rod("rocker", rocker, 0.4))
    joints = (
        Joint("A", "revolute", "world", "crank"),
        Joint("B", "revolute", "crank", "coupler", _at(crank), actuated=False),
        Joint("D", "revolute", "world", "rocker", _at(base), actuated=False),
    )
    ends = Attachment("coupler", _at(coupler)), Attachment("rocker", _at(rocker))
    return Mechanism("four-bar", links, joints, np.array([0.0, -9.81, 0.0]), (Closure("C", kind, *ends),))


START = {"B": 0.8, "D": 1.8}


TURN = flexinv.Motion.point_to_point({"A": 0.3}, {"A": 0.3 + 2 * np.pi}, 1.0)
