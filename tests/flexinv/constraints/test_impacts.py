"""Impacts: closures that stop frames at once, against momentum and Carnot's theorem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexible_examples import STRIP

import flexinv
from flexinv.model.mechanism import Attachment, Beam, Body, Closure, Inertia, Joint, Link, Mechanism, Placement

X = np.array([1.0, 0.0, 0.0])
MASS, SPEED = 2.0, 1.5  # [kg], [m/s]
MEET = 0.1  # [s]


def carriages(impact: str = "plastic") -> Mechanism:
    """A driven carriage catches one that stands still until then."""
    links = tuple(Link(n, (Body(n, Inertia(MASS)),)) for n in ("driven", "caught"))
    joints = (
        Joint("drive", "prismatic", "world", "driven", axis=X),
        Joint("free", "prismatic", "world", "caught", axis=X, rotor_inertia=0.5, actuated=False),
    )
    closures = (
        Closure("stands", "fixed", Attachment("world", Placement(0.3 * X)), Attachment("caught"), active=((0.0, MEET),)),
        Closure(
            "coupled", "fixed", Attachment("driven"), Attachment("caught"), active=((MEET, 9.0),), capture=True,
            impact=impact,
        ),
    )  # fmt: skip
    return Mechanism("carriages", links, joints, gravity=np.zeros(3), closures=closures)


RUN = flexinv.Motion.from_samples(np.linspace(0, 0.2, 21), {"drive": SPEED * np.linspace(0, 0.2, 21)})


def test_a_carriage_that_is_caught_takes_its_momentum_from_the_drive() -> None:
    s = flexinv.solve(carriages(), RUN, step=0.01, start={"free": 0.3})
    assert s.loops is not None
    (impact,) = s.loops.impacts
    assert impact.closures == ("coupled",)
    assert impact.torque == pytest.approx([(MASS + 0.5) * SPEED, 0.0], abs=1e-12)  # rounding
    assert impact.reaction["coupled"][0] == pytest.approx((MASS + 0.5) * SPEED)
    assert impact.energy == pytest.approx(0.5 * (MASS + 0.5) * SPEED**2)  # half of the drive's work
    assert impact.work == pytest.approx((MASS + 0.5) * SPEED**2)
    assert s.q[-1, 1] == pytest.approx(0.3 + SPEED * 0.1)  # carried along where it was caught


def test_without_the_option_it_is_an_error() -> None:
    with pytest.raises(
        flexinv.InputError, match=r"'coupled' begins to act on frames that move against each other with 1\.5 m/s"
    ):
        flexinv.solve(carriages("error"), RUN, step=0.01, start={"free": 0.3})


def falling(elements: int = 1) -> Mechanism:
    """A carriage with a flexible mast slides freely, until its foot is caught by the world; a second arm holds still."""
    links = (Link("carriage", (Body("carriage", Inertia(MASS)),)), Link("mast", (), Beam(0.4, STRIP, elements, 4)))
    joints = (
        Joint("slide", "prismatic", "world", "carriage", axis=X, actuated=False),
        Joint("mast", "revolute", "carriage", "mast"),
    )
    wall = Closure(
        "wall",
        "fixed",
        Attachment("world"),
        Attachment("carriage"),
        active=((MEET, 9.0),),
        capture=True,
        impact="plastic",
    )
    return Mechanism("falling", links, joints, gravity=np.zeros(3), closures=(wall,))


def test_a_wall_takes_the_momentum_of_what_cannot_yield() -> None:
    """The carriage stops at once; the mast, whose lumped nodes beyond the root can yield, keeps its velocity and rings."""
    hold = flexinv.Motion.point_to_point({"mast": np.pi / 2}, {"mast": np.pi / 2}, 0.3)
    s = flexinv.solve(falling(), hold, step=1e-3, start_rate={"slide": SPEED})
    assert s.loops is not None
    (impact,) = s.loops.impacts
    root = 0.0224 / 20  # Gauss-Lobatto weight of the first of five nodes, 1/10 of a half length
    assert impact.reaction["wall"][0] == pytest.approx(-(MASS + root) * SPEED, rel=1e-9)
    assert impact.energy == pytest.approx(0.5 * (MASS + root) * SPEED**2, rel=1e-9)
    assert abs(s.qd[101:, 0]).max() < 1e-9
    assert s.balance.kinetic[101:].max() < 0.5 * 0.0224 * SPEED**2 * (1 + 1e-6)  # what is left is in the mast
    assert abs(s.balance.work).max() < 2e-3 * impact.energy  # the impact is in the balance; the rest is time error


def test_capture_and_impact_need_an_instant(tmp_path) -> None:
    m = carriages()
    held = replace(m, closures=(m.closures[0],))
    with pytest.raises(flexinv.InputError, match="follow from no closure that acts"):
        flexinv.solve(held, RUN, step=0.01, start={"free": 0.3})
