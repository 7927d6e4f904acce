"""solve, simulate and follow with an accuracy: true errors are within it, bars cover them, balances are the answer's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flexible_examples import arm
from scipy.special import ellipk

import flexinv
from flexinv.errors import ConvergenceError, InputError
from flexinv.model.mechanism import Body, Inertia, Joint, Link, Mechanism, with_retardation

SMOOTH = flexinv.Motion.point_to_point([0.0], [np.pi], 0.2, hold=0.1, law="nonic")
JUMPS = flexinv.Motion.point_to_point([0.0], [np.pi], 0.2, hold=0.05, law="bang-bang")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"step": 1e-3, "accuracy": 1e-4}, "both given"),
        ({}, "neither step nor accuracy"),
        ({"accuracy": 0.5}, "between 1e-09 and 0.1"),
        ({"accuracy": 1e-4, "every": 2}, "leave out"),
    ],
)
def test_what_cannot_be_asked_is_an_error_in_words(given: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        flexinv.solve(arm(), SMOOTH, **given)  # type: ignore[arg-type]


@pytest.mark.parametrize(("mechanism", "motion"), [(arm(), SMOOTH), (with_retardation(arm(), 2e-4), JUMPS)])
def test_true_errors_are_within_the_accuracy_and_the_bars(mechanism: Mechanism, motion: flexinv.Motion) -> None:
    """Against the same at a 30th of what is asked, whose error is a 20th or less: its own bars say so."""
    fine = flexinv.solve(mechanism, motion, accuracy=3e-5)
    wide = np.ptp(fine.torque)
    for asked in (1e-2, 1e-3):
        solution = flexinv.solve(mechanism, motion, accuracy=asked)
        here = np.abs(fine.time[:, None] - solution.time).argmin(axis=0)
        same = np.abs(fine.time[here] - solution.time) < 1e-9
        assert same.sum() >= 20
        error = np.abs(solution.torque - fine.torque[here])[same]
        assert solution.torque_error is not None
        assert fine.torque_error is not None
        assert fine.torque_error.max() <= asked / 20 * wide
        assert error.max() <= asked * wide
        assert solution.torque_error.max() <= asked * wide * (1 + 1e-3)  # the ranges of both differ by the error
        assert (error <= (solution.torque_error + fine.torque_error[here])[same]).mean() >= 0.95


def test_the_answer_keeps_its_balances() -> None:
    """Forces, efforts and factors are of one motion to rounding; energy and momentum to the accuracy."""
    solution = flexinv.solve(arm(), SMOOTH, accuracy=1e-4)
    parts = solution.factors(40)
    assert np.abs(parts.L @ parts.T @ parts.P - solution.torque[40]).max() < 1e-12 * np.ptp(solution.torque)
    assert np.abs(solution.balance.work).max() < 1e-4 * solution.energy_exchanged
    assert np.abs(solution.torque_all - solution.reaction).max() < 1e-4 * np.ptp(solution.torque)
    assert solution.settings["extrapolated"] is True
    turned = solution.nodes.rotation
    assert np.abs(np.swapaxes(turned, -1, -2) @ turned - np.eye(3)).max() < 1e-13


def test_undamped_vibrations_without_end_are_an_error_that_says_what_to_change() -> None:
    with pytest.raises(ConvergenceError, match=r"accuracy = 1e-06 is out of reach.*damping.*smoother law.*accuracy = "):
        flexinv.solve(arm(), JUMPS, accuracy=1e-6)


def test_rigid_motion_is_exact_at_once(root: Path) -> None:
    rigid = flexinv.load_mechanism(root / "models" / "rigid_3r")
    motion = flexinv.Motion.point_to_point(np.zeros(rigid.nq), np.ones(rigid.nq), 1.0)
    solution = flexinv.solve(rigid, motion, accuracy=1e-9)
    q, qd, qdd = motion.evaluate(rigid, solution.time)
    largest = np.abs(solution.torque).max()
    assert np.abs(flexinv.joint_torques(rigid, q, qd, qdd) - solution.torque).max() < 1e-12 * largest
    assert solution.torque_error is not None
    assert solution.torque_error.max() < 1e-12 * largest


def test_simulate_without_drives_swings_as_the_closed_form() -> None:
    """A point mass on 0.5 m from 1 rad aside swings over in 2 K(sin(1/2)) sqrt(l / g); its own inertia is 1e-12 of m l^2."""
    bob = Link("bob", (Body("bob", Inertia(1.0, np.array([0.5, 0.0, 0.0]), 1e-12 * np.eye(3))),))
    joint = Joint("pin", "revolute", "world", "bob", axis=np.array([0.0, -1.0, 0.0]), actuated=False)
    pendulum = Mechanism("pendulum", (bob,), (joint,), gravity=np.array([0.0, 0.0, -9.81]))
    period = 4 * ellipk(np.sin(0.5) ** 2) * np.sqrt(0.5 / 9.81)
    solution = flexinv.simulate(pendulum, [0.0, period / 2], start={"pin": 1.0 - np.pi / 2}, accuracy=1e-6)
    assert abs(solution.q[-1, 0] - (-1.0 - np.pi / 2)) < 2e-6  # 1e-6 of a range of 2 rad
    assert np.abs(solution.balance.work).max() < 1e-6 * solution.energy_exchanged


def test_simulate_of_solve_gives_the_motion_back() -> None:
    """Torques are linear between samples 0.5 ms apart: that, not the accuracy, is what is left."""
    driven = flexinv.solve(arm(), SMOOTH, step=5e-4)
    solution = flexinv.simulate(arm(), driven.time, driven.torque, accuracy=1e-4)
    expected = np.interp(solution.time, driven.time, driven.q[:, 0])
    assert np.abs(solution.q[:, 0] - expected).max() < 1e-3 * np.pi


@pytest.mark.slow
def test_follow_with_an_accuracy(root: Path) -> None:
    """The frame is on the path at every instant; torques at 1e-2 and 1e-3 differ by less than 1e-2 of their range."""
    two = flexinv.load_mechanism(root / "models" / "flex_two_link")
    arc = flexinv.Path.arc([0.3, 0, 0], centre=[0.2, 0, 0], angle=np.pi / 2, duration=0.2)
    guess = {"joint1": -0.5, "joint2": 1.0}
    rough, fine = (flexinv.follow(two, arc, "link2", start=guess, accuracy=asked) for asked in (1e-2, 1e-4))
    assert max(one.distance(one.solution).max() for one in (rough, fine)) < 1e-9
    here = np.abs(fine.time[:, None] - rough.time).argmin(axis=0)
    apart = np.abs(rough.solution.torque - fine.solution.torque[here]) / np.ptp(fine.solution.torque, axis=0)
    assert apart.max() < 1e-2
