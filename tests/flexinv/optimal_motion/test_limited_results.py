"""Limits of loads in joints, strains of beams and paths of tips: slopes equal differences, motions keep them on finer grids."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import flexinv
from flexinv.errors import InputError
from flexinv.optimal_motion.limited_results import (
    LimitedLoad,
    LimitedPath,
    LimitedStrain,
    list_limited_results,
    list_needed_results,
)
from flexinv.optimal_motion.motion_limits import MotionLimits, StrainLimit
from flexinv.optimal_motion.optimize_motion import optimize_motion

STEP = 1e-3
THIN = StrainLimit(2e-4, 0.0005, 0.01)
BETWEEN_POINTS = 5e-3  # as in `test_optimize_motion`


@pytest.fixture(scope="module")
def arm(root):
    return flexinv.load_mechanism(root / "models" / "flex_two_link")


@pytest.fixture(scope="module")
def move():
    return flexinv.Motion.point_to_point(
        {"joint1": 0.0, "joint2": 0.0}, {"joint1": 0.5, "joint2": 1.0}, duration=0.2, law="nonic"
    )


def _make_results(solution):
    path = solution.tip["link2"][[0, -1]]
    loads = [LimitedLoad(kind, "joint2") for kind in ("force", "moment")]
    return [*loads, LimitedStrain("link1", THIN), LimitedPath("link2", path)]


def test_slopes_equal_differences_of_solve(arm, move):
    found = flexinv.differentiate(arm, move, "motion.joint2[1]", step=STEP, of=["wrench", "strain"])
    change = 1e-3

    def solve(end):
        moved = flexinv.Motion.point_to_point(
            {"joint1": 0.0, "joint2": 0.0}, {"joint1": 0.5, "joint2": end}, duration=0.2, law="nonic"
        )
        return flexinv.solve(arm, moved, step=STEP)

    beside = {k: solve(1.0 + k * change) for k in (-2, -1, 1, 2)}
    for result in _make_results(found.solution):
        values = {k: result.compute_values(one) for k, one in beside.items()}
        wanted = (8 * (values[1] - values[-1]) - (values[2] - values[-2])) / (12 * change)
        slopes = result.compute_slopes(found)[:, 0]
        # Sizes have a corner where they vanish, and so have distances where another piece of the path is nearest.
        smooth = np.abs(wanted - slopes) < 1e-5 * np.abs(wanted).max()
        assert smooth.mean() > 0.95
        assert np.abs(wanted).max() > 0.0


def test_fibres_are_strained_by_extension_and_both_curvatures():
    strained = SimpleNamespace(strain={"beam": np.array([[[1e-3, 0.0, 0.0, 7.0, 0.2, 0.3]]])})
    values = LimitedStrain("beam", StrainLimit(1.0, y=0.01, z=0.02)).compute_values(strained)
    assert np.sort(values) == pytest.approx(
        np.sort([1e-3 + z * 0.2 - y * 0.3 for y in (0.01, -0.01) for z in (0.02, -0.02)])
    )


def test_a_path_beside_a_straight_line_is_as_far_as_it_is_shifted():
    moved = SimpleNamespace(tip={"link": np.array([[0.5, 0.03, 0.0], [1.2, 0.0, 0.04]])})
    line = LimitedPath("link", np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    assert line.compute_values(moved) == pytest.approx([0.03, np.hypot(0.2, 0.04)])


def test_the_strain_at_the_root_is_that_of_its_moment(root):
    """The first of four Gauss points is 7 % of the length away; what the polynomial leaves out falls with the mesh."""
    arm = flexinv.load_mechanism(root / "models" / "flex_one_link")
    turn = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 0.5}, duration=0.15)
    solution = flexinv.solve(arm, turn, step=STEP)
    bending = solution.root["link"][:, 5] / arm.link_of["link"].beam.section.stiffness[0, 5]
    (limited,) = list_limited_results(MotionLimits(strain={"link": StrainLimit(1.0, y=1.0, z=0.0)}), solution)
    fibres = limited.compute_values(solution).reshape(len(bending), -1, 4)
    assert abs(fibres[:, 0, 0] + bending).max() < 0.02 * abs(bending).max()
    assert abs(fibres[:, 1, 0] + bending).max() > 0.05 * abs(bending).max()  # the first station is not the root


def test_a_motion_keeps_the_strain_of_its_beam_on_a_finer_grid(root):
    strip = flexinv.load_mechanism(root / "models" / "flex_one_link")
    turn = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 0.5}, duration=0.15)
    free = optimize_motion(strip, turn, knots=6)
    (beam,) = [link.name for link in strip.beams]
    outer = StrainLimit(1.0, y=0.0005, z=0.0)
    largest = np.abs(LimitedStrain(beam, outer).compute_values(free.solutions[0])).max()
    limit = StrainLimit(0.8 * largest, outer.y, outer.z)
    found = optimize_motion(strip, turn, MotionLimits(strain={beam: limit}), knots=6)
    assert found.duration > free.duration  # the limit binds
    step = found.duration / 1000
    finer = flexinv.solve(strip, found.motion, step=step, end=found.duration + 2 * step, initial="static")
    (limited,) = list_limited_results(MotionLimits(strain={beam: limit}), finer)
    used = np.abs(limited.compute_values(finer)).max() / limit.largest
    assert 0.9 < used < 1.0 + BETWEEN_POINTS
    assert found.frame().loc[f"strain {beam}", "used"] == pytest.approx(used, abs=BETWEEN_POINTS)


def test_a_tip_stays_near_its_path(arm, move):
    wide = optimize_motion(arm, move, knots=6)
    path = list_limited_results(MotionLimits(path={"link2": 1.0}), wide.before[0])[0]
    farthest = path.compute_values(wide.solutions[0]).max()
    limits = MotionLimits(path={"link2": 0.3 * farthest})
    assert list_needed_results(list_limited_results(limits, wide.before[0])) == []  # tips are there already
    found = optimize_motion(arm, move, limits, knots=6)
    assert path.compute_values(found.solutions[0]).max() < (0.3 + BETWEEN_POINTS) * farthest
    assert found.used["path link2"] <= 1.0 + BETWEEN_POINTS


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"moment": {"joint": 1.0}}, "moment of joint 'joint': 'flex_two_link' has joint1, joint2; write 'joint2'"),
        ({"strain": {"link": THIN}}, "strain of beam 'link': 'flex_two_link' has link1, link2; write 'link2'"),
        ({"path": {"tip": 0.1}}, "path of link 'tip': 'flex_two_link' has link1, link2"),
    ],
)
def test_names_that_are_none_are_refused(arm, move, limits, words):
    with pytest.raises(InputError, match=words):
        optimize_motion(arm, move, MotionLimits(**limits))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: StrainLimit(-1e-3, 0.01, 0.01), "largest strain = -0.001: expected a finite number above 0"),
        (lambda: StrainLimit(1e-3, -0.01, 0.01), "y = -0.01: expected a finite distance"),
        (lambda: MotionLimits(strain={"beam": 1e-3}), "strain"),
        (lambda: MotionLimits(path={"link": 0.0}), "path of link 'link' = 0: expected a finite number above 0"),
        (lambda: MotionLimits(force={"joint": np.inf}), "force of joint 'joint' = inf"),
    ],
)
def test_limits_that_are_none_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
