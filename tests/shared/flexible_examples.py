"""Small flexible mechanisms and measures that several tests share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexinv import Motion
from flexinv.kernels.so3 import exp_so3
from flexinv.model.mechanism import Beam, Body, Inertia, Joint, Link, Mechanism, Placement, Section
from flexinv.typing import Array

# The strip of the paper's one-link example: 0.0224 kg on 0.4 m, EI = 0.46 N m^2, 1.95 mm thick.
LENGTH, MASS_PER_LENGTH, EI = 0.4, 0.056, 0.46
STRIP = Section(
    np.array([0.0]),
    np.array([[1.452e6, 4.65e5, 4.65e5, 0.626, 13.7, EI]]),
    np.array([MASS_PER_LENGTH]),
    np.array([[5.4577e-7, 5.28e-7, 1.77e-8]]),
)
HALF_TURN = Motion.point_to_point([0.0], [np.pi], 0.2, hold=0.3)


def arm(
    elements: int = 1, order: int = 4, gravity: tuple[float, float, float] = (0, 0, 0), section: Section = STRIP
) -> Mechanism:
    """The paper's flexible link on a vertical hub axis."""
    link = Link("link", (), Beam(LENGTH, section, elements, order))
    return Mechanism(
        "arm", (link,), (Joint("hub", "revolute", "world", "link"),), gravity=np.array(gravity, dtype=float)
    )


def uniform(
    length: float, ea: float, ga: float, gj: float, ei: tuple[float, float], curvature: Array | None = None
) -> Beam:
    """A uniform beam of unit mass per length."""
    stiffness = np.array([[ea, ga, ga, gj, *ei]])
    section = Section(np.array([0.0]), stiffness, np.ones(1), np.ones((1, 3)))
    return Beam(length, section, curvature=np.zeros(3) if curvature is None else curvature)


def clamped(beam: Beam, elements: int, order: int) -> Mechanism:
    """A beam fixed to the world, no gravity."""
    link = Link("beam", (), replace(beam, elements=elements, order=order))
    return Mechanism("cantilever", (link,), (Joint("root", "fixed", "world", "beam"),), gravity=np.zeros(3))


def spatial_tree() -> Mechanism:
    """Rigid shoulder, flexible upper arm with a wrist half way and one at its tip, payload, skew axes, gravity."""
    beam = Beam(
        0.5, STRIP, 1, 3, curvature=np.array([0.4, -0.3, 0.5]), placement=Placement(np.array([0.02, 0.01, 0.0]))
    )
    box = np.diag([2e-3, 3e-3, 4e-3])
    links = (
        Link("base", (Body("base", Inertia(1.2, np.array([0.05, 0.02, 0.1]), box)),)),
        Link("boom", (Body("camera", Inertia(0.02, np.array([0.0, 0.01, 0.02]), 1e-5 * np.eye(3)), 1.0),), beam),
        Link("side", (Body("side", Inertia(0.03, np.array([0.1, 0.0, 0.0]), 1e-4 * np.eye(3))),)),
        Link("hand", (Body("hand", Inertia(0.05, np.array([0.03, 0.0, 0.01]), 1e-4 * np.eye(3))),)),
    )
    turned = Placement(np.array([0.0, 0.0, 0.2]), exp_so3(np.array([0.3, -0.2, 0.1])))
    joints = (
        Joint("slew", "revolute", "world", "base", rotor_inertia=0.01, damping=0.2, friction=0.05),
        Joint("luff", "revolute", "base", "boom", turned, axis=np.array([0.0, -1.0, 0.0])),
        Joint("middle", "revolute", "boom", "side", station=0.5, axis=np.array([0.6, 0.0, 0.8])),
        Joint(
            "wrist", "prismatic", "boom", "hand", Placement(np.array([0.0, 0.01, 0.0])), axis=np.array([0.0, 1.0, 0.0])
        ),
    )
    return Mechanism("tree", links, joints, gravity=np.array([0.0, 0.0, -9.81]))


TREE_MOTION = Motion.point_to_point([0.0, 0.0, 0.0, 0.0], [1.0, 0.6, -0.8, 0.05], 0.4, hold=0.1)


def torque_range(torque: Array) -> float:
    """Largest range over time of any column: what differences are measured against [N m]."""
    return float(np.ptp(torque, axis=0).max())


def observed_order(errors: list[float]) -> float:
    """Order from the last two of a sequence of errors under halving."""
    return float(np.log2(errors[-2] / errors[-1]))
