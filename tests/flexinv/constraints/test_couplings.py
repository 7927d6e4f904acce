"""Couplings: gears between joints, in rigid loops, among beams and at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexible_examples import STRIP
from four_bar_example import START, TURN, four_bar

import flexinv
from flexinv.constraints.continuation import compute_mobility
from flexinv.kinematics.mesh import build
from flexinv.model.mechanism import Attachment, Beam, Body, Closure, Inertia, Joint, Link, Mechanism

RATIO, OFFSET = -3.0, 0.2
WORLD = Attachment("world")
GEAR = Closure("gear", "coupling", WORLD, WORLD, factors=(("motor", 1.0), ("wheel", RATIO)), offset=OFFSET)


def train() -> Mechanism:
    """A motor of 0.01 kg m^2 turns a wheel of 2 kg m^2 that is out of balance, through a gear."""
    motor = Link("motor", (Body("motor", Inertia(1.0, np.zeros(3), np.diag([0.01, 0.01, 0.01]))),))
    wheel = Link("wheel", (Body("wheel", Inertia(3.0, np.array([0.1, 0.0, 0.0]), np.diag([1.0, 1.0, 2.0]))),))
    joints = (
        Joint("motor", "revolute", "world", "motor"),
        Joint("wheel", "revolute", "world", "wheel", damping=0.3, actuated=False),
    )
    return Mechanism("train", (motor, wheel), joints, gravity=np.array([0.0, -9.81, 0.0]), closures=(GEAR,))


DRIVE = flexinv.Motion.point_to_point({"motor": 0.0}, {"motor": 9.0}, 1.0)


def test_a_gear_reduces_inertia_damping_and_weight() -> None:
    """By virtual work: tau = J_m a + n (J_w n a + d n w + m g l cos q_w), q_w = n (q_m - OFFSET), n = -1 / RATIO."""
    s = flexinv.solve(train(), DRIVE, step=0.01, start={"wheel": 0.0})
    speed = -1.0 / RATIO  # of the wheel over the motor's
    wheel = speed * (s.q[:, 0] - OFFSET)
    assert abs(s.q[:, 1] - wheel).max() < 1e-12
    moment = (2.0 + 3.0 * 0.01) * speed * s.qdd[:, 0] + 0.3 * speed * s.qd[:, 0] + 3.0 * 9.81 * 0.1 * np.cos(wheel)
    assert abs(s.torque[:, 0] - (0.01 * s.qdd[:, 0] + speed * moment)).max() < 1e-12 * abs(s.torque).max()
    assert abs(s.unactuated).max() < 1e-12 * abs(s.torque).max()
    assert compute_mobility(build(train()), s.q[0]).freedoms == 1


def test_a_gear_in_a_loop() -> None:
    """The rocker of a four-bar turns a flywheel four times as fast: its inertia counts sixteen times at the rocker."""
    m = four_bar()
    wheel = Link("fly", (Body("fly", Inertia(1.0, np.zeros(3), np.diag([0.01, 0.01, 0.01]))),))
    gear = Closure("gear", "coupling", WORLD, WORLD, factors=(("fly", 1.0), ("D", -4.0)))
    joint = Joint("fly", "revolute", "world", "fly", actuated=False)
    geared = replace(m, links=(*m.links, wheel), joints=(*m.joints, joint), closures=(*m.closures, gear))
    rocker = replace(m.joints[2], rotor_inertia=0.16)
    heavy = replace(m, joints=(*m.joints[:2], rocker))
    a = flexinv.solve(geared, TURN, step=0.01, start=START)
    b = flexinv.solve(heavy, TURN, step=0.01, start=START)
    assert abs(a.torque - b.torque).max() < 1e-11 * abs(b.torque).max()  # rounding times the condition of the loop


def flexible_train(rotor: float = 0.0) -> Mechanism:
    """The train with a beam on the wheel; or the wheel alone, with the motor's inertia as its rotor's."""
    m = train()
    tip = Link("whip", (), Beam(0.4, STRIP, 1, 4))
    weld = Joint("weld", "fixed", "wheel", "whip")
    if not rotor:
        return replace(m, links=(*m.links, tip), joints=(*m.joints, weld))
    wheel = replace(m.joints[1], actuated=True, rotor_inertia=rotor)
    return Mechanism("wheel", (m.links[1], tip), (wheel, weld), m.gravity)


def test_a_gear_in_the_march() -> None:
    """Motor with its motion, wheel with a beam following by the gear: the same as the wheel driven through RATIO."""
    s = flexinv.solve(flexible_train(), DRIVE, step=1e-3, start={"wheel": 0.0})
    turn = flexinv.Motion.point_to_point({"wheel": OFFSET / RATIO}, {"wheel": (OFFSET - 9.0) / RATIO}, 1.0)
    alone = flexinv.solve(flexible_train(0.01 * RATIO**2), turn, step=1e-3)
    # the wheel's rates are the integrator's there, and the motion's here: second order in the step, measured 1.4e-7
    assert abs(s.torque * -RATIO - alone.torque).max() < 1e-6 * abs(alone.torque).max()
    assert abs(s.unactuated).max() < 1e-9 * abs(s.torque).max()  # multipliers and accelerations of one instant
    assert abs(s.q[:, 1] - alone.q[:, 0]).max() < 1e-12


def test_forward_through_the_gear() -> None:
    """simulate: the motor turns wheel and beam, no joint with a motion."""
    m, step = flexible_train(), 1e-3
    s = flexinv.solve(m, DRIVE, step=step, start={"wheel": 0.0}, end=0.3)
    f = flexinv.simulate(m, s.time, s.torque, step, start={"motor": s.q[0, :1], "wheel": s.q[0, 1:]})
    assert abs(f.q - s.q).max() < 1e-5 * np.ptp(s.q)  # (step / motion)^2
    assert abs(f.q[:, 0] + RATIO * f.q[:, 1] - OFFSET).max() < 1e-12


def test_statics_through_the_gear() -> None:
    s = flexinv.statics(train(), q=np.array([0.5, 0.0]))
    wheel = (0.5 - OFFSET) / -RATIO
    assert s.torque[0, 0] == pytest.approx(3.0 * 9.81 * 0.1 * np.cos(wheel) / -RATIO, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"factors": (("motor", 1.0), ("wheal", 2.0))},
            r"ties revolute, prismatic and helical joints \(motor, wheel\), not 'wheal'",
        ),
        ({"active": ((0.0, 1.0),)}, r"acts all the time; leave its active intervals out"),
    ],
)
def test_a_coupling_that_cannot_be(change: dict[str, object], words: str) -> None:
    m = replace(train(), closures=(replace(GEAR, **change),))
    with pytest.raises(flexinv.InputError, match=words):
        flexinv.solve(m, DRIVE, step=0.01)
