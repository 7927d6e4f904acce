"""Singular positions and ends of branches between samples: found to 1e-9 s at any step, touched or passed."""

from __future__ import annotations

import re

import numpy as np
import pytest
import scipy
from four_bar_example import START, TURN, four_bar
from numpy.polynomial import Polynomial

import flexinv
from flexinv.constraints.singular_search import Branch, find_singular

# The time bar of events where the motion is prescribed; messages carry ten digits.
TIME_BAR = 1e-9
FLAT = {"B": -1.0, "D": 1.0}  # the parallelogram, not the crossed one


def instant(mechanism: flexinv.Mechanism, motion: flexinv.Motion, step: float, start: dict[str, float]) -> float:
    with pytest.raises(flexinv.ConvergenceError, match="drive another joint") as caught:
        flexinv.solve(mechanism, motion, step=step, start=start)
    match = re.search(r"t = (\S+) s", str(caught.value))
    assert match is not None
    return float(match[1])


def zero_of(motion: flexinv.Motion, mechanism: flexinv.Mechanism, angle: float, before: float, after: float) -> float:
    def miss(time: float) -> float:
        return float(motion.evaluate(mechanism, [time])[0][0, 0]) - angle

    return float(scipy.optimize.brentq(miss, before, after, xtol=1e-14))


@pytest.mark.reported("D7")
@pytest.mark.parametrize("step", [0.3, 0.05, 1e-2, 7e-3, 3.33e-4, 1e-4])
@pytest.mark.parametrize("law", ["cycloid", "quintic", "bang-bang"])
@pytest.mark.parametrize("kind", ["revolute", "spherical"])
def test_a_change_point_is_found_at_any_step(step: float, law: str, kind: str) -> None:
    """A parallelogram passes its flat position where its crank has no angle, with and without redundant constraints."""
    mechanism = four_bar(0.2, 0.45, 0.2, 0.45, kind)
    motion = flexinv.Motion.point_to_point({"A": 1.0}, {"A": -0.7}, 1.0, law=law)
    expected = zero_of(motion, mechanism, 0.0, 0.1, 0.9)
    assert instant(mechanism, motion, step, FLAT) == pytest.approx(expected, abs=TIME_BAR)


@pytest.mark.parametrize("step", [0.04, 7e-3, 3.3e-4])
def test_a_change_point_that_is_touched_is_found(step: float) -> None:
    """The crank comes to the flat position and turns back: nothing changes its sign."""
    mechanism, time = four_bar(0.2, 0.45, 0.2, 0.45), np.linspace(0.0, 1.0, 41)
    touching = flexinv.Motion.from_samples(time, {"A": (time - 0.5173) ** 2})
    assert instant(mechanism, touching, step, {"B": -0.26, "D": 0.26}) == pytest.approx(0.5173, abs=TIME_BAR)
    missing = flexinv.Motion.from_samples(time, {"A": (time - 0.5173) ** 2 + 1e-3})
    flexinv.solve(mechanism, missing, step=step, start={"B": -0.26, "D": 0.26})  # condition numbers of 1e4: it passes


# A motion that turns back at this instant [s]; beyond a singular position by so little it crosses it at a rate of 1e-4 1/s.
TURNS, BEYOND = 0.5173, 1e-8


@pytest.mark.parametrize("step", [0.25, 0.04, 7e-3, 3.3e-4])
def test_a_change_point_that_is_passed_by_little_is_found(step: float) -> None:
    """Forth and back between two samples: what changes from one to the other is less than what lies between."""
    mechanism, time = four_bar(0.2, 0.45, 0.2, 0.45), np.linspace(0.0, 1.0, 41)
    motion = flexinv.Motion.from_samples(time, {"A": (time - TURNS) ** 2 - BEYOND})
    result = instant(mechanism, motion, step, {"B": -0.26, "D": 0.26})
    assert result == pytest.approx(TURNS - np.sqrt(BEYOND), abs=TIME_BAR)


@pytest.mark.parametrize("step", [0.25, 0.04, 7e-3, 3.3e-4])
def test_the_end_of_a_branch_that_is_passed_by_little_is_found(step: float) -> None:
    """Extrapolated from as near as the motion comes, and not from where a part of an interval ends."""
    crank, coupler, rocker, base = 0.4, 0.3, 0.4, 0.45
    mechanism, time = four_bar(crank, coupler, rocker, base), np.linspace(0.0, 1.0, 41)
    most = np.arccos((crank**2 + base**2 - (coupler + rocker) ** 2) / (2 * crank * base))
    motion = flexinv.Motion.from_samples(time, {"A": most + BEYOND - (time - TURNS) ** 2})
    result = instant(mechanism, motion, step, {"B": -1.0, "D": 1.5})
    assert result == pytest.approx(TURNS - np.sqrt(BEYOND), abs=TIME_BAR)


@pytest.mark.parametrize("step", [0.1, 1e-2])
def test_the_end_of_a_branch_is_found(step: float) -> None:
    """A crank that is too long rocks: coupler and rocker are one straight line where it must turn back."""
    crank, coupler, rocker, base = 0.4, 0.3, 0.4, 0.45
    mechanism = four_bar(crank, coupler, rocker, base)
    motion = flexinv.Motion.point_to_point({"A": 1.2}, {"A": np.pi}, 1.0)
    most = np.arccos((crank**2 + base**2 - (coupler + rocker) ** 2) / (2 * crank * base))
    expected = zero_of(motion, mechanism, most, 0.1, 0.9)
    assert instant(mechanism, motion, step, {"B": -1.0, "D": 1.5}) == pytest.approx(expected, abs=TIME_BAR)


def test_a_linkage_that_turns_is_left_alone() -> None:
    for step in (0.2, 0.05, 1e-3):
        flexinv.solve(four_bar(), TURN, step=step, start=START)


@pytest.mark.parametrize("touches", [0.0, 1e-7, 1e-6])
def test_the_search_alone(touches: float) -> None:
    """diag(1, 2, (t - 0.3)^2 + c): singular where the last is below 1e-8 of the largest."""
    values = Polynomial([0.09 + touches, -0.6, 1.0])

    def matrices(q: np.ndarray) -> np.ndarray:
        return np.stack([np.diag([1.0, 2.0, values(one)]) for one in q[:, 0]])

    branch = Branch(lambda times, start: times[:, None], matrices)
    time = np.linspace(0.0, 1.0, 8)
    change = np.concatenate([[0.0], np.abs(np.diff(values(time))) / 2.0 * 3**0.5])
    condition = 2.0 / values(time)
    singular = find_singular(branch, time, time[:, None], condition, change, (np.diff(time), np.zeros(7)))
    if touches:
        assert singular is None
    else:
        assert singular == pytest.approx(0.3, abs=TIME_BAR)
