"""Dead points of drives where the motion is given at other joints: named to 1e-9 s, touched or passed, with and without force."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy
from four_bar_example import START, TURN, four_bar

import flexinv
from flexinv.constraints import drive_dead_points
from flexinv.constraints.drive_dead_points import find_largest_value, find_singular_values
from flexinv.model.mechanism import Attachment, Closure, Inertia, Joint, Mechanism, Placement

# The time bar of events where the motion is prescribed; messages carry ten digits.
TIME_BAR = 1e-9
CRANK = 0.2
ROD = 0.5
TURNS = 0.5173  # [s]


def driven_slider(gravity: float = -9.81) -> Mechanism:
    """A slider-crank that its slide drives: dead where crank and rod are in line."""
    four = four_bar(CRANK, ROD, 0.1)
    joints = (
        replace(four.joints[0], actuated=False),
        four.joints[1],
        Joint("S", "prismatic", "world", "rocker", axis=np.array([1.0, 0.0, 0.0])),
    )
    ends = Attachment("coupler", Placement(np.array([ROD, 0.0, 0.0]))), Attachment("rocker")
    closures = (Closure("C", "revolute", *ends),)
    return replace(four, joints=joints, closures=closures, gravity=np.array([0.0, gravity, 0.0]))


def list_start(angle: float) -> dict[str, float]:
    rod = -np.arcsin(CRANK * np.sin(angle) / ROD)
    return {"B": float(rod - angle), "S": float(CRANK * np.cos(angle) + ROD * np.cos(rod))}


def find_instant(mechanism: Mechanism, motion: flexinv.Motion, step: float, start: dict[str, float]) -> float:
    with pytest.raises(flexinv.ConvergenceError, match="dead point of the drives at '") as caught:
        flexinv.solve(mechanism, motion, step=step, start=start)
    match = re.search(r"t = (\S+) s", str(caught.value))
    assert match is not None
    return float(match[1])


@pytest.mark.parametrize("step", [0.1, 1e-2, 7e-3, 1e-3])
@pytest.mark.parametrize("law", ["cycloid", "bang-bang"])
@pytest.mark.parametrize("gravity", [0.0, -9.81])
def test_a_dead_point_is_found_at_any_step(step: float, law: str, gravity: float) -> None:
    """The effort grows as one over the way to it: 238 N at steps of 1e-2 s, 4529 N at 1e-3 s, 21638 N at 1e-4 s."""
    mechanism = driven_slider(gravity)
    motion = flexinv.Motion.point_to_point({"A": -0.9}, {"A": 1.0}, 1.0, law=law)

    def angle(time: float) -> float:
        return float(motion.evaluate(mechanism, [time])[0][0, 0])

    expected = float(scipy.optimize.brentq(angle, 0.1, 0.9, xtol=1e-15))
    assert find_instant(mechanism, motion, step, list_start(-0.9)) == pytest.approx(expected, abs=TIME_BAR)


@pytest.mark.parametrize("step", [0.25, 0.04, 1e-3])
def test_a_dead_point_that_is_touched_is_found(step: float) -> None:
    mechanism = driven_slider()
    time = np.linspace(0.0, 1.0, 41)
    touching = flexinv.Motion.from_samples(time, {"A": -((time - TURNS) ** 2)})
    assert find_instant(mechanism, touching, step, list_start(-(TURNS**2))) == pytest.approx(TURNS, abs=TIME_BAR)
    missing = flexinv.Motion.from_samples(time, {"A": -((time - TURNS) ** 2) - 1e-3})
    flexinv.solve(mechanism, missing, step=step, start=list_start(-(TURNS**2) - 1e-3))


def test_a_dead_point_at_which_no_force_is_needed_counts() -> None:
    """As good as nothing has mass, and nothing weight."""
    mechanism = driven_slider(0.0)
    inertia = Inertia(1e-9, np.zeros(3), 1e-12 * np.eye(3))
    light = tuple(replace(link, bodies=(replace(link.bodies[0], inertia=inertia),)) for link in mechanism.links)
    motion = flexinv.Motion.point_to_point({"A": -0.5}, {"A": 0.5}, 1.0)
    instant = find_instant(replace(mechanism, links=light), motion, 0.01, list_start(-0.5))
    assert instant == pytest.approx(0.5, abs=TIME_BAR)


@pytest.mark.parametrize("step", [0.1, 1e-2])
def test_a_motion_that_is_given_whole_is_looked_at(step: float) -> None:
    """All joints of a parallelogram are given through its flat position, where its one drive decides nothing."""
    mechanism = four_bar(0.2, 0.45, 0.2, 0.45)
    motion = flexinv.Motion.point_to_point({"A": 1.0, "B": -1.0, "D": 1.0}, {"A": -0.7, "B": 0.7, "D": -0.7}, 1.0)

    def angle(time: float) -> float:
        return float(motion.evaluate(mechanism, [time])[0][0, 0])

    expected = float(scipy.optimize.brentq(angle, 0.1, 0.9, xtol=1e-15))
    assert find_instant(mechanism, motion, step, {}) == pytest.approx(expected, abs=TIME_BAR)


def test_drives_that_can_are_left_alone() -> None:
    """The crank's own drive, another one beside it, and one at the rocker, short of its dead point at 0.564 rad."""
    flexinv.solve(four_bar(), TURN, step=0.01, start=START)
    both = tuple(replace(joint, actuated=joint.name != "B") for joint in four_bar().joints)
    flexinv.solve(replace(four_bar(), joints=both), TURN, step=0.01, start=START)
    rocker = tuple(replace(joint, actuated=joint.name == "D") for joint in four_bar().joints)
    short = flexinv.Motion.point_to_point({"A": 0.3}, {"A": 0.5}, 1.0)
    flexinv.solve(replace(four_bar(), joints=rocker), short, step=0.01, start=START)
    with pytest.raises(flexinv.ConvergenceError, match="dead point of the drives at 'D'"):
        flexinv.solve(replace(four_bar(), joints=rocker), TURN, step=0.01, start=START)


@pytest.mark.parametrize("columns", [1, 2, 3])
def test_singular_values_are_those_of_lapack(columns):
    """In closed form of two columns, near singular ones among them: a ratio of 1e-3 loses six digits of its square."""
    dice = np.random.default_rng(columns)
    g = dice.standard_normal((200, 5, columns))
    g[::4, :, -1] = g[::4, :, 0] * (1.0 + 10.0 ** -dice.uniform(1, 12, (50, 5)))
    values = np.linalg.svd(g, compute_uv=False)
    largest, least = find_singular_values(g)
    np.testing.assert_allclose(largest, values[:, 0], rtol=1e-14)
    np.testing.assert_allclose(least, values[:, -1], rtol=1e-9)
    np.testing.assert_allclose(find_largest_value(g), values[:, 0], rtol=1e-14)


@pytest.mark.parametrize(("first", "last", "dead"), [(0.5, 1.0, False), (-0.9, 1.0, True)])
def test_bounds_exclude_no_dead_point_where_all_joints_are_given(first: float, last: float, dead: bool) -> None:
    """The crank alone drives, so that the way through the dead point of the slide is known, and its samples are given."""
    slide = driven_slider()
    crank = replace(slide, joints=(replace(slide.joints[0], actuated=True), *slide.joints[1:-1], slide.joints[-1]))
    crank = replace(crank, joints=(*crank.joints[:-1], replace(crank.joints[-1], actuated=False)))
    motion = flexinv.Motion.point_to_point({"A": first}, {"A": last}, 1.0)
    found = flexinv.solve(crank, motion, step=1e-3, start=list_start(first))
    given = flexinv.Motion.from_samples(found.time, found.q, ["A", "B", "S"])
    if dead:
        with pytest.raises(flexinv.ConvergenceError, match="dead point of the drives at 'S'"):
            flexinv.solve(slide, given, step=1e-3)
        return
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drive_dead_points, "find_singular_values", None)  # what the bound spares
        flexinv.solve(slide, given, step=1e-3)
