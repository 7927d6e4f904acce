"""Springs, dampers and given forces in the march: against oscillators, and against the inverse dynamics of the motion found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bending_four_bar import bending
from flexible_examples import STRIP, observed_order
from four_bar_example import START, TURN

import flexinv
from flexinv.model.mechanism import Attachment, Beam, Body, Force, Inertia, Joint, Link, Mechanism, Placement, Spring

X = np.array([1.0, 0.0, 0.0])
HOLD = flexinv.Motion.point_to_point({"hold": 0.0}, {"hold": 0.0}, 1.0)


def body(name: str, mass: float = 2.0) -> Link:
    return Link(name, (Body(name, Inertia(mass, np.zeros(3), mass * np.diag([0.1, 0.2, 0.3]))),))


def oscillator(damping: float = 0.0, in_joint: bool = False) -> Mechanism:
    """2 kg on a spring of 50 N/m, stretched by 0.1 m: in the joint, or from the world to the body."""
    own = {"stiffness": 50.0, "rest": 0.3, "damping": damping} if in_joint else {}
    joints = (
        Joint("hold", "revolute", "world", "held"),
        Joint("slide", "prismatic", "world", "mass", axis=X, actuated=False, **own),  # type: ignore[arg-type]
    )
    # the spring runs from x = -0.2 to the mass, rest length 0.5: at rest x = 0.3
    spring = Spring("spring", Attachment("world", Placement(-0.2 * X)), Attachment("mass"), 50.0, 0.5, damping)
    return Mechanism(
        "oscillator", (body("held"), body("mass")), joints, gravity=np.zeros(3), springs=() if in_joint else (spring,)
    )


@pytest.mark.parametrize("in_joint", [False, True])
@pytest.mark.parametrize("damping", [0.0, 4.0])
def test_an_oscillator(in_joint: bool, damping: float) -> None:
    """x = 0.3 + 0.1 exp(-d t) (cos wt + d/w sin wt), d = c / 2m, w^2 = k/m - d^2; second order in the step."""
    d = damping / 4.0
    w = np.sqrt(25.0 - d * d)
    errors = []
    for step in (0.01, 0.005):
        s = flexinv.solve(oscillator(damping, in_joint), HOLD, step=step, start={"slide": 0.4})
        t = s.time
        exact = 0.3 + 0.1 * np.exp(-d * t) * (np.cos(w * t) + d / w * np.sin(w * t))
        errors.append(abs(s.q[:, 1] - exact).max())
    assert errors[0] < 0.1 * 5.0 * (5.0 * 0.01) ** 2  # amplitude times periods passed times (w h)^2
    assert observed_order(errors) > 1.8


def tangled(continuous: str = "revolute") -> Mechanism:
    """A flexible boom with passive bodies, springs across blocks and to the world, forces that vary and that follow."""
    links = (Link("boom", (), Beam(0.5, STRIP, 2, 3)), body("fore", 0.02), body("hind", 0.03))
    tilted = np.array([0.6, 0.0, 0.8])
    joints = (
        Joint("hold", "revolute", "world", "boom"),
        Joint("fore", continuous, "boom", "fore", Placement(0.02 * X), 1.0, stiffness=0.01, rest=0.4, actuated=False),
        Joint("hind", "revolute", "boom", "hind", Placement(0.02 * X), 0.5, axis=tilted, damping=1e-4, actuated=False),
    )
    off = Placement(np.array([0.05, 0.02, 0.01]))
    springs = (
        Spring("across", Attachment("fore", off), Attachment("hind", off), 3.0, 0.1, 2.0),
        Spring(
            "tied", Attachment("world", Placement(np.array([0.2, 0.3, 0.1]))), Attachment("boom", off, 0.75), 5.0, 0.37
        ),
    )
    # from zero, as the stretched springs: a blow on a section's rotary inertia of 1e-9 kg m^2 would ring
    gust = np.array([6 * [0.0], [0.02, -0.01, 0.03, 1e-3, 2e-3, -1e-3], [-0.01, 0.02, 0.01, -1e-3, 0.0, 1e-3]])
    forces = (
        Force("gust", Attachment("boom", off, 0.75), gust, np.array([0.0, 0.1, 0.3])),
        Force("jet", Attachment("fore", off), gust[1:2], follower=True),
        Force(
            "turned", Attachment("hind", Placement(off.position, np.diag([1.0, -1.0, -1.0]))), gust[1:2], follower=True
        ),
    )
    return Mechanism("tangled", links, joints, springs=springs, forces=forces)


MOVE = flexinv.Motion.point_to_point({"hold": 0.0}, {"hold": 0.6}, 0.3)


@pytest.mark.parametrize("kind", ["revolute", "continuous"])
def test_inverse_dynamics_of_the_march_leaves_passive_joints_without_effort(kind: str) -> None:
    """The march carries springs and loads by its own code; L T P with `applied` gives them back: zero where nothing drives."""
    s = flexinv.solve(tangled(kind), MOVE, step=1e-3)
    assert abs(s.q[:, 1:]).max() > 0.1  # they move
    scale = abs(s.torque).max()
    assert abs(s.unactuated).max() < 1e-9 * scale  # Newton's increment of 1e-8, squared, times EA / inertia
    assert abs(s.torque_all - s.reaction).max() < 1e-9 * scale
    assert abs(s.momentum_residual).max() < 1e-9 * abs(s.wrench["hold"]).max()


@pytest.mark.parametrize("harm", ["stiffness", "rest", "damping"])
def test_a_wrong_spring_is_seen(harm: str) -> None:
    m = tangled()
    s = flexinv.solve(m, MOVE, step=1e-3)
    wrong = replace(m.springs[0], **{harm: 1.01 * getattr(m.springs[0], harm)})
    other = flexinv.solve(replace(m, springs=(wrong, m.springs[1])), MOVE, step=1e-3)
    assert abs(other.torque - s.torque).max() > 1e-7 * abs(s.torque).max()


def rope(damping: float = 0.0) -> Spring:
    post = Attachment("world", Placement(np.array([0.3, 0.6, 0.0])))
    return Spring("pull", post, Attachment("coupler", station=0.5), 20.0, 0.2, damping)


def test_work_is_counted_in_a_flexible_loop() -> None:
    m = bending()
    pull = rope(damping=0.1)
    push = Force("push", Attachment("rocker"), np.array([[0.5, 0.2, 0, 0, 0, 0.3]]), follower=True)
    sprung = tuple(replace(j, stiffness=2.0, rest=1.0) if j.name == "D" else j for j in m.joints)
    loaded = replace(m, joints=sprung, springs=(pull,), forces=(push,))
    errors = []
    for step in (2e-3, 1e-3, 5e-4):
        s = flexinv.solve(loaded, TURN, step=step, start=START, initial="static")
        errors.append(abs(s.balance.work).max())
        assert abs(s.unactuated).max() < 1e-10 * abs(s.torque).max()
    assert 1.8 < observed_order(errors) < 2.2


def test_static_start_carries_springs() -> None:
    """At rest from the first sample: nothing moves when the motion is to stay."""
    m = bending()
    pull = rope()
    stay = flexinv.Motion.point_to_point({"A": 0.3}, {"A": 0.3}, 0.05)
    s = flexinv.solve(replace(m, springs=(pull,)), stay, step=1e-3, start=START, initial="static")
    # Newton at rest ends at an increment of 1e-8 and gains four digits at a time there (`dynamics.stepper.HELD_STIFFNESS`)
    assert abs(s.qd).max() < 1e-6
    assert np.ptp(s.torque) < 1e-6 * abs(s.torque).max()
