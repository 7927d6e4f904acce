"""Passive joints: the march finds their motion; inverse dynamics then needs no effort there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexible_examples import STRIP, arm, observed_order
from scipy.integrate import solve_ivp

import flexinv
from flexinv.kernels.so3 import exp_so3
from flexinv.model.mechanism import Beam, Body, Inertia, Joint, Link, Mechanism, Placement

FLYING = Inertia(0.7, np.array([0.1, 0.05, -0.02]), np.diag([0.01, 0.02, 0.025]))


def _pendulum(damping: float = 0.0) -> Mechanism:
    bob = Link("bob", (Body("bob", Inertia(1.0, np.array([0.0, 0.0, -1.0]))),))
    joint = Joint("pivot", "revolute", "world", "bob", axis=np.array([1.0, 0, 0]), actuated=False, damping=damping)
    return Mechanism("pendulum", (bob,), (joint,))


def _rest(duration: float) -> flexinv.Motion:
    return flexinv.Motion.point_to_point({}, {}, duration)


def test_pendulum_follows_its_equation() -> None:
    """m l^2 q'' + d q' + m g l sin q = 0, integrated by scipy to 1e-12; the march is second order."""
    exact = solve_ivp(
        lambda t, y: [y[1], -9.81 * np.sin(y[0]) - 0.3 * y[1]], (0, 1), [2.0, 0.5], rtol=1e-12, atol=1e-12
    )
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        s = flexinv.solve(_pendulum(0.3), _rest(1.0), step=step, start={"pivot": 2.0}, start_rate={"pivot": 0.5})
        errors.append(abs(s.q[-1, 0] - exact.y[0, -1]))
        assert abs(s.unactuated).max() < 1e-9 * 9.81  # Newton's last increment squared, times the stiffness
    assert 1.9 < observed_order(errors) < 2.1


@pytest.mark.parametrize("kind", ["spherical", "free", "universal", "continuous", "prismatic"])
def test_every_kind_of_passive_joint_needs_no_effort(kind: str) -> None:
    """Inverse dynamics of the free motion gives zero effort on the free joint: forward and inverse agree."""
    first = Link("carrier", (Body("b", Inertia(1.0, np.array([0.1, 0, 0]), 0.01 * np.eye(3))),))
    second = Link("free", (Body("b", FLYING),))
    place = Placement(np.array([0.3, 0.0, 0.1]), exp_so3(np.array([0.2, -0.4, 0.3])))
    second_axis = np.array([0.6, 0.8, 0.0])
    joints = (
        Joint("drive", "revolute", "world", "carrier"),
        Joint(
            "loose",
            kind,
            "carrier",
            "free",
            place,
            second_axis=second_axis,
            actuated=False,
            rotor_inertia=0.0 if kind == "free" else 0.01,
        ),
    )
    mechanism = Mechanism("m", (first, second), joints)
    move = flexinv.Motion.point_to_point({"drive": 0.0}, {"drive": 1.5}, 0.5)
    rate = 0.8 if kind in ("prismatic", "continuous") else np.linspace(0.5, 1.5, mechanism.nv - 1)
    s = flexinv.solve(mechanism, move, step=1e-3, start_rate={"loose": rate})
    scale = abs(s.torque).max()
    assert abs(s.unactuated).max() < 1e-8 * scale  # Newton's last increment is below 1e-8
    again = flexinv.joint_torques(mechanism, s.q, s.qd, s.qdd)
    assert abs(again - s.torque_all).max() < 1e-8 * scale  # coordinates read back describe the same motion
    # the read-back rates are the derivatives of the read-back coordinates: second-order differences, h = 1e-3
    if kind in ("prismatic", "universal"):
        q = s.q[:, 1:]
        difference = (q[2:] - q[:-2]) / 2e-3
        assert abs(difference - s.qd[1:-1, 1:]).max() < 1e-4 * abs(s.qd[:, 1:]).max() + 1e-3


def test_free_flight_falls_and_keeps_its_spin() -> None:
    body = replace(FLYING, com=np.zeros(3))
    mechanism = Mechanism(
        "thrown", (Link("body", (Body("b", body),)),), (Joint("base", "free", "world", "body", actuated=False),)
    )
    spin = np.array([0.0, 0.0, 0.0, 1.0, 2.0, 3.0])
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        s = flexinv.solve(mechanism, _rest(0.5), step=step, start_rate={"base": spin})
        momentum = np.einsum("sij,jk,sk->si", s.nodes.rotation[:, 0], body.tensor, s.nodes.omega[:, 0])
        errors.append(abs(momentum - momentum[0]).max())
        assert s.tip["body"][-1, 2] == pytest.approx(-0.5 * 9.81 * 0.25, rel=1e-12)  # a parabola is exact
    assert observed_order(errors) > 1.9


def test_passive_joint_on_a_flexible_link_balances() -> None:
    """A pendulum hangs from the tip of the flexible arm: no effort there, balances close."""
    base = arm(gravity=(0.0, -9.81, 0.0))
    bob = Link("bob", (Body("bob", Inertia(0.005, np.array([0.0, -0.1, 0.0]))),))
    hung = replace(
        base, links=(*base.links, bob), joints=(*base.joints, Joint("loose", "revolute", "link", "bob", actuated=False))
    )
    move = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 1.0}, 0.3)
    s = flexinv.solve(hung, move, step=5e-4, initial="static")
    scale = abs(s.torque).max()
    assert abs(s.unactuated).max() < 1e-8 * scale
    assert abs(s.torque - s.reaction[:, :1]).max() < 1e-8 * scale
    assert np.ptp(s.q[:, 1]) > 0.05  # it does swing


def test_a_free_beam_keeps_its_momentum() -> None:
    """A flexible rod on a passive free joint, thrown and spinning without gravity: linear momentum to rounding."""
    rod = Link("rod", (), Beam(0.4, STRIP, 1, 4))
    mechanism = Mechanism("rod", (rod,), (Joint("base", "free", "world", "rod", actuated=False),), gravity=np.zeros(3))
    s = flexinv.solve(
        mechanism, _rest(0.05), step=1e-4, start_rate={"base": np.array([1.0, 0.5, 0.2, 3.0, -4.0, 10.0])}
    )
    momentum = np.einsum("n,sni->si", s.mesh.mass, s.nodes.v)
    assert abs(momentum - momentum[0]).max() < 1e-9 * abs(momentum).max()  # EA ulp / (mass) over 500 steps


def test_rotor_on_a_loose_free_joint_is_refused() -> None:
    body = Link("body", (Body("b", FLYING),))
    mechanism = Mechanism(
        "thrown", (body,), (Joint("base", "free", "world", "body", actuated=False, rotor_inertia=0.1),)
    )
    with pytest.raises(
        flexinv.InputError, match=r"joint 'base': rotor_inertia = 0\.1 on a free joint without motion, expected 0"
    ):
        flexinv.solve(mechanism, _rest(0.1), step=0.01)


def test_start_of_a_driven_joint_is_refused() -> None:
    with pytest.raises(flexinv.InputError, match=r"joint 'hub' is not passive here \(passive: none\)"):
        flexinv.solve(arm(), flexinv.Motion.point_to_point([0.0], [1.0], 0.1), step=1e-3, start={"hub": 1.0})


@pytest.mark.parametrize(
    ("starts", "words"),
    [
        ({"start": {"pivot": [1.0, 2.0]}}, r"start: joint 'pivot' takes 1 finite number, got \[1\.0, 2\.0\]"),
        ({"start": {"pivot": np.nan}}, "start: joint 'pivot' takes 1 finite number, got nan"),
        ({"start_rate": {"pivot": "fast"}}, "start_rate: joint 'pivot' takes 1 finite number, got 'fast'"),
        ({"start_rate": {"pivot": [1.0, 2.0]}}, "start_rate: joint 'pivot' takes 1 finite number"),
        ({"start_rate": {"hinge": 1.0}}, r"start_rate: joint 'hinge' is not passive here \(passive: pivot\)"),
    ],
)
def test_starts_that_cannot_be_are_explained(starts: dict[str, dict[str, object]], words: str) -> None:
    with pytest.raises(flexinv.InputError, match=words):
        flexinv.solve(_pendulum(0.3), _rest(1.0), step=0.1, **starts)  # type: ignore[arg-type]
