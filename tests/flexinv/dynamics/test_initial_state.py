"""Rest positions of mechanisms with passive joints: one law for all who ask, below where the mechanism starts."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csc_array

import flexinv
from campaigns.spectra_closed_forms import ziegler
from flexinv.analysis.controller import Controller
from flexinv.linearized.eigenvalues import count_negative_eigenvalues
from flexinv.model.mechanism import Attachment, Body, Force, Inertia, Joint, Link, Placement
from flexinv.typing import Array

HALVES = """
title = "Two beams on a hinge and a slide"
source = "made for this test"
gravity_m_per_s2 = [0, -9.81, 0]

[sections.l1]
shape = "tube"
outer_diameter_m = 0.0185
wall_m = 0.00185
E_Pa = 2.5e9
nu = 0.33
rho_kg_per_m3 = 1150.0

[sections.l2]
shape = "tube"
outer_diameter_m = 0.0141
wall_m = 0.00141
E_Pa = 2.1e11
nu = 0.33
rho_kg_per_m3 = 7850.0

[links.l1]
kind = "beam"
length_m = 0.154
section = "l1"

[links.l2]
kind = "beam"
length_m = 0.218
section = "l2"
payload = [{ name = "load", station = 1.0, mass_kg = 0.0855, com_m = [0, 0, 0], inertia_kgm2 = 0 }]

[joints.j1]
kind = "revolute"
parent = "world"
child = "l1"
axis = [0, 0, -1]
actuated = false

[joints.j2]
kind = "prismatic"
parent = "l1"
child = "l2"
station = 1.0
axis = [0, 1, 0]
"""
STEP, DURATION = 0.002, 0.3
# Newton's method at rest stops at increments of 1e-8, whose square is left.
SAME = 1e-9
# What the beams, as they sag, turn by about an axis that nothing holds: the square of some 1e-4 rad.
SAGGING = 1e-7
TIP = np.array([0.3, 0.0, 0.0])
ROUNDED = 1.1  # numbers of two digits


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> flexinv.Mechanism:
    folder = tmp_path_factory.mktemp("halves")
    (folder / "mechanism.toml").write_text(HALVES, encoding="utf-8")
    return flexinv.load_mechanism(folder)


def begun(mechanism: flexinv.Mechanism, angle: float) -> flexinv.Solution:
    """A solution whose hinge is told to begin at an angle, the slide 2 mm out."""
    motion = flexinv.Motion.point_to_point({"j2": 0.002}, {"j2": 0.003}, duration=DURATION)
    return flexinv.solve(mechanism, motion, STEP, start={"j1": angle}, initial="static")


def hinge(solution: flexinv.Solution) -> float:
    return float(solution.q[0, 0])


@pytest.mark.parametrize("angle", [-1.3, -0.13, 0.9, 1.5776, 2.9])
def test_a_pendulum_hangs_wherever_it_begins(pendulum: flexinv.Mechanism, angle: float) -> None:
    """From -1.3 rad, 16 degrees beside upright, as from 1.5776 rad, where it hangs: Newton's method alone stayed above, or
    found nothing at all from where it hangs, as an undeformed beam has no stiffness against turning in its hinge."""
    assert abs(hinge(begun(pendulum, angle)) - hinge(begun(pendulum, 1.5))) < SAME


@pytest.mark.parametrize("angle", [-0.13, 1.5776])
def test_the_controller_begins_where_solve_does(pendulum: flexinv.Mechanism, angle: float) -> None:
    """The same start gives the same rest position, and so the same torque."""
    solution = begun(pendulum, angle)
    controller = Controller.of(pendulum, step=STEP)
    for start in (solution.q[0], np.array([angle, 0.002])):
        torque = controller.start(start, np.zeros(2), np.zeros(2), initial="static")
        weight = 9.81 * 0.4
        np.testing.assert_allclose(torque, solution.torque_all[0], rtol=0, atol=SAME * weight)


def test_simulate_begins_where_solve_does(pendulum: flexinv.Mechanism) -> None:
    """The drives are held while the passive joints sink."""
    solution = begun(pendulum, -0.13)
    time, torque = np.array([0.0, DURATION]), np.full((2, 1), solution.torque[0, 0])
    start = {"j1": -0.13, "j2": 0.002}
    again = flexinv.simulate(pendulum, time, torque, STEP, start=start, initial="static")
    assert abs(hinge(again) - hinge(solution)) < SAME


def test_an_unstable_rest_position_is_told(pendulum: flexinv.Mechanism) -> None:
    """Exactly above its hinge the pendulum stays, with a word; with its weight a little to the side it does not stay."""
    up = {"j2": 0.0}
    motion = flexinv.Motion.point_to_point(up, {"j2": 0.001}, duration=DURATION)
    with pytest.warns(flexinv.ModelWarning, match="unstable.*start beside it for j1"):
        stays = flexinv.solve(pendulum, motion, STEP, start={"j1": -np.pi / 2}, initial="static")
    assert abs(hinge(stays) + np.pi / 2) < SAME
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        falls = flexinv.solve(pendulum, motion, STEP, start={"j1": -np.pi / 2 + 1e-6}, initial="static")
    assert abs(hinge(falls) - np.pi / 2) < SAME


def upright(count: int) -> flexinv.Mechanism:
    """Rods that stand on each other on passive hinges, gravity down."""
    links = tuple(Link(f"rod {k}", (Body("ball", Inertia(1.0, TIP)),), tip=TIP) for k in range(count))
    parents = ("world", *(link.name for link in links))
    joints = tuple(
        Joint(f"hinge {k}", "revolute", parents[k], f"rod {k}", Placement(TIP if k else np.zeros(3)), actuated=False)
        for k in range(count)
    )
    return flexinv.Mechanism("upright", links, joints, np.array([-9.81, 0.0, 0.0]))


def begin_at_rest(mechanism: flexinv.Mechanism) -> flexinv.Solution:
    """A march of a few steps that begins at rest, nothing prescribed."""
    time = np.array([0.0, DURATION])
    return flexinv.simulate(mechanism, time, np.zeros((2, 0)), 0.1, initial="static")


@pytest.mark.parametrize(
    ("mechanism", "words"),
    [
        (upright(1), r"\(1 independent motion of it, alone or swinging, would grow\).*start beside it for hinge 0,"),
        (
            upright(2),
            r"\(2 independent motions of it, alone or swinging, would grow\).*beside it for hinge 0, hinge 1,",
        ),
        # flutter: no eigenvalue of the stiffness is negative, and yet a pair of motions grows
        (ziegler(2.5, (0.0, 0.0)), r"\(2 independent motions of it, alone or swinging, would grow\)"),
    ],
)
def test_the_warning_counts_the_motions_that_would_grow(mechanism: flexinv.Mechanism, words: str) -> None:
    passive = replace(mechanism, joints=tuple(replace(joint, actuated=False) for joint in mechanism.joints))
    with pytest.warns(flexinv.ModelWarning, match=words):
        begin_at_rest(passive)


def test_ziegler_below_its_flutter_load_begins_without_a_word() -> None:
    mechanism = ziegler(2.0, (0.0, 0.0))
    passive = replace(mechanism, joints=tuple(replace(joint, actuated=False) for joint in mechanism.joints))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        begin_at_rest(passive)


def test_a_slide_that_nothing_holds_is_named_with_its_way() -> None:
    """It falls on and on: step after step by the same way, which the error has, and not an increment of 0."""
    slope = Joint("slide", "prismatic", "world", "rod", axis=np.array([0.0, 0.6, 0.8]), actuated=False)
    rod = Link("rod", (Body("ball", Inertia(1.0, TIP)),), tip=TIP)
    mechanism = flexinv.Mechanism("slope", (rod,), (slope,), np.array([0.0, 0.0, -9.81]))
    with pytest.raises(flexinv.ConvergenceError, match=r"joint 'slide' has moved by .* m in 500 steps.*hold") as error:
        begin_at_rest(mechanism)
    match = re.search(r"moved by (\S+) m in .*, by (\S+) m in the last one", str(error.value))
    assert match is not None
    way, last = (float(number) for number in match.groups())
    assert 0.0 < last < way  # 500 steps of that at most, and fewer, as every other is too long
    assert way < 500 * last * ROUNDED


def test_a_force_that_turns_along_drives_the_joint_that_is_named() -> None:
    """Nothing is at rest where a force across a rod's tip turns with it."""
    mechanism = upright(1)
    push = Force("jet", Attachment("rod 0", Placement(TIP)), np.array([[0.0, 50.0, 0.0, 0.0, 0.0, 0.0]]), follower=True)
    with pytest.raises(
        flexinv.ConvergenceError, match=r"joint 'hinge 0' has moved by .* rad in 500 steps and moves on"
    ):
        begin_at_rest(replace(mechanism, forces=(push,)))


def test_what_nothing_moves_stays(pendulum: flexinv.Mechanism, tmp_path: Path) -> None:
    """About a vertical axis every angle is a rest position: it is the one that was told."""
    (tmp_path / "mechanism.toml").write_text(HALVES.replace("[0, -9.81, 0]", "[0, 0, -9.81]"), encoding="utf-8")
    level: Array = np.array([hinge(begun(flexinv.load_mechanism(tmp_path), angle)) for angle in (0.4, -1.0)])
    np.testing.assert_allclose(level, [0.4, -1.0], rtol=0, atol=SAGGING)


def test_a_freedom_without_any_stiffness_is_judged_without_a_warning() -> None:
    """A link on a spherical joint turns about its own axis: K has a row of zeros, which is neither stable nor unstable."""
    assert count_negative_eigenvalues(csc_array(np.diag([2.0, 0.0]))) == 0
    assert count_negative_eigenvalues(csc_array(np.diag([2.0, 0.0, -1.0]))) == 1
    assert count_negative_eigenvalues(csc_array([[2.0, 0.1], [0.1, 0.0]])) == 1  # a saddle
