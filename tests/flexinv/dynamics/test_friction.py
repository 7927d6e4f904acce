"""Dry friction of a joint without a drive: where a pendulum stops, and how it creeps where it should stick."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

import flexinv
from flexinv.elements.joint_law import FRICTION_RATE
from flexinv.model.mechanism import Body, Inertia, Joint, Link, Mechanism, Placement

MASS, ARM, FRICTION, PULL = 1.0, 0.3, 0.3, 9.81  # [kg], [m], [N m], [m/s^2]
HELD = 1.0  # [s] after it stopped


def pendulum() -> Mechanism:
    """A bob on a pivot with dry friction, a tenth of its weight's moment; on it a driven joint that rests."""
    bob = Body("bob", Inertia(MASS, np.array([ARM, 0.0, 0.0]), np.eye(3) * 0.02))
    feather = Body("feather", Inertia(1e-9, np.zeros(3), np.eye(3) * 1e-12))
    joints = (
        Joint("pivot", "revolute", "world", "bob", actuated=False, friction=FRICTION),
        Joint("drive", "revolute", "bob", "tip", Placement(np.array([ARM, 0.0, 0.0]))),
    )
    return Mechanism("pendulum", (Link("bob", (bob,)), Link("tip", (feather,))), joints, np.array([0.0, -PULL, 0.0]))


def stop(angle: float) -> tuple[float, float]:
    """Where it sticks [rad], and the moment [N m] that friction then holds: every swing loses the work of friction.

    m g r (sin q0 - sin q1) = friction |q1 - q0| from one turning point to the next
    """
    while abs(load := MASS * PULL * ARM * np.cos(angle)) > FRICTION:
        way = -np.sign(load)

        def gained(swing: float, start: float = angle, way: float = way) -> float:
            return float(MASS * PULL * ARM * (np.sin(start) - np.sin(start + way * swing)) - FRICTION * swing)

        angle += way * float(brentq(gained, 1e-3, 3.0))
    return angle, load


def test_a_pendulum_stops_where_coulomb_says_and_creeps_as_smoothed_friction_does() -> None:
    start, step = 1.0 - np.pi / 2, 1e-3
    rest = flexinv.Motion.point_to_point({"drive": 0.0}, {"drive": 0.0}, 3.1 + HELD)
    s = flexinv.solve(pendulum(), rest, step, start={"pivot": start})
    angle, load = stop(start)
    stopped = s.q[round(3.1 / step), 0]
    # What is smooth within 1e-3 rad/s stops where sharp friction does to the same order: measured 1e-4 rad.
    assert abs(stopped - angle) < 2e-4
    assert 0.7 < abs(load) / FRICTION < 0.8  # it stops with friction nearly used up
    # friction tanh(rate / FRICTION_RATE) holds the load there is at this rate, to what inertia does to a slow decay: the price
    # is 9e-4 rad in a second
    creep = -FRICTION_RATE * np.arctanh(MASS * PULL * ARM * np.cos(s.q[-1, 0]) / FRICTION)
    assert abs(s.qd[-1, 0] - creep) < 1e-3 * abs(creep)
    assert abs(s.q[-1, 0] - stopped) < 1.1 * abs(creep) * HELD


def test_what_sticks_is_not_extrapolated() -> None:
    rest = flexinv.Motion.point_to_point({"drive": 0.0}, {"drive": 0.0}, 0.5)
    for friction in (FRICTION, 0.0):
        joints = (replace(pendulum().joints[0], friction=friction), pendulum().joints[1])
        options = {"step": 1e-3, "start": {"pivot": 1.0 - np.pi / 2}}
        plain, barred = (
            flexinv.solve(replace(pendulum(), joints=joints), rest, error=e, **options) for e in (False, True)
        )
        assert np.array_equal(plain.q, barred.q) == ("extrapolated" not in barred.settings) == bool(friction)
