"""Where loops begin: what is stated of the joints is kept, or an error says what contradicts it and what to write."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import flexinv
from flexinv.files.load_cases import load_cases
from flexinv.model.mechanism import Mechanism

STILL = np.zeros((2, 1))
# Newton closes loops to 1e-12 of the length; rates to rounding over the condition of some tens.
CLOSED = 1e-11
CRANK, ROD = 0.15, 0.3  # [m], of slider_crank_flexible


@pytest.fixture(scope="module")
def slider(root: Path) -> Mechanism:
    return flexinv.load_mechanism(root / "models" / "slider_crank_flexible")


@pytest.fixture(scope="module")
def four_bar(root: Path) -> tuple[Mechanism, dict[str, np.ndarray]]:
    """The four-bar, and where its joints are at the start of its case."""
    folder = root / "models" / "four_bar"
    m = flexinv.load_mechanism(folder)
    case = load_cases(folder, m)["turn"]
    first = flexinv.solve(m, case.motion, step=0.1, start=case.start).q[0]
    return m, {j.name: first[m.q_slices[j.name]] for j in m.joints}


def forward(m: Mechanism, **start: object) -> flexinv.Solution:
    drives = int(m.actuated.sum())
    return flexinv.simulate(m, [0.0, 1e-4], np.zeros((2, drives)), 1e-5, **start)  # type: ignore[arg-type]


def closed(crank: float, side: int) -> tuple[float, float]:
    """Angle of the pin [rad] and place of the slide [m] of the slider-crank."""
    rod = -np.arcsin(CRANK * np.sin(crank) / ROD)
    rod = rod if side > 0 else np.pi - rod
    pin = (rod - crank + np.pi) % (2 * np.pi) - np.pi
    return pin, CRANK * np.cos(crank) + ROD * np.cos(rod)


@pytest.mark.parametrize("initial", ["consistent", "static"])
def test_simulate_begins_where_it_is_told_or_says_why_not(slider: Mechanism, initial: str) -> None:
    pin, slide = closed(1.0, 1)
    s = forward(slider, start={"main": 1.0, "crank_pin": round(pin, 2), "slide": round(slide, 2)}, initial=initial)
    assert s.q[0] == pytest.approx([1.0, pin, slide], abs=CLOSED)
    words = (
        r"start of joint 'crank_pin' is 0 rad, the closures give -1.43426 rad with main = 1 rad; "
        r"write start=\{'main': 1, 'crank_pin': -1.43426, 'slide': 0.3532\}"
    )
    with pytest.raises(flexinv.InputError, match=words):
        forward(slider, start={"main": 1.0, "crank_pin": 0.0, "slide": 0.45}, initial=initial)
    with pytest.raises(flexinv.InputError, match=r"start of joint 'slide' is 0.4 m, the closures give 0.45 m"):
        forward(slider, start={"slide": 0.4}, initial=initial)


def test_what_is_not_stated_follows(slider: Mechanism) -> None:
    """Of one joint alone, whichever: the others move onto the closures, and not by whole turns."""
    pin, slide = closed(1.0, 1)
    assert forward(slider, start={"main": 1.0, "slide": slide}).q[0] == pytest.approx([1.0, pin, slide], abs=CLOSED)
    assert abs(forward(slider, start={"main": 1.0}).q[0, 1]) < np.pi


@pytest.mark.parametrize("degrees", [70, -70, 90, -90, 110, -110])
@pytest.mark.parametrize("side", [1, -1])
def test_a_slide_picks_the_branch(slider: Mechanism, degrees: int, side: int) -> None:
    at = np.radians(degrees)
    turn = flexinv.Motion.point_to_point({"main": at}, {"main": at + 1e-3}, 0.02)
    result = flexinv.solve(slider, turn, 1e-3, start={"slide": 0.45 * side}).q[0]
    assert result[1:] == pytest.approx(closed(at, side), abs=CLOSED)


def test_a_slide_that_no_branch_has_is_named(slider: Mechanism) -> None:
    turn = flexinv.Motion.point_to_point({"main": np.pi}, {"main": np.pi + 1e-3}, 0.02)
    words = r"joint 'slide' at -0.45 m, 0.9 from its start of 0.45 m.*nearest is \{'slide': -0.45\}"
    with pytest.raises(flexinv.ConvergenceError, match=words):
        flexinv.solve(slider, turn, 1e-3, start={"slide": 0.45})


@pytest.mark.parametrize(("joint", "rate"), [("A", 5.0), ("B", 1.0), ("D", 2.0)])
def test_a_rate_is_kept_and_the_others_follow(
    four_bar: tuple[Mechanism, dict[str, np.ndarray]], joint: str, rate: float
) -> None:
    m, places = four_bar
    s = forward(m, start=places, start_rate={joint: rate})
    assert s.qd[0, m.v_slices[joint]] == pytest.approx(rate, rel=1e-12)
    assert abs(s.qd[0]).min() > 0.1
    again = forward(m, start=places, start_rate={j.name: s.qd[0, m.v_slices[j.name]] for j in m.joints})
    assert again.qd[0] == pytest.approx(s.qd[0], abs=CLOSED)


def test_rates_that_contradict_each_other_are_named(four_bar: tuple[Mechanism, dict[str, np.ndarray]]) -> None:
    m, places = four_bar
    words = (
        r"start_rate of joint 'D' is 2 rad/s, the closures give -1.45159 rad/s with A = 5 rad/s; "
        r"write start_rate=\{'A': 5, 'D': -1.45159\}"
    )
    with pytest.raises(flexinv.InputError, match=words):
        forward(m, start=places, start_rate={"A": 5.0, "D": 2.0})
    still = flexinv.Motion.point_to_point({"A": 0.3}, {"A": 1.3}, 1.0)
    with pytest.raises(flexinv.InputError, match=r"start_rate of joint 'D' is 2 rad/s, the closures give 0 rad/s"):
        flexinv.solve(m, still, 0.1, start={"B": 0.8, "D": 1.8}, start_rate={"D": 2.0})


def test_one_freedom_of_many_joints(root: Path) -> None:
    """Bricard's six hinges: told of one it was shared out among all."""
    m = flexinv.load_mechanism(root / "models" / "bricard")
    case = load_cases(root / "models" / "bricard", m)["fold"]
    first = flexinv.solve(m, case.motion, step=case.step, start=case.start).q[0]
    places = {j.name: first[m.q_slices[j.name]] for j in m.joints}
    driven = next(j.name for j in m.joints if j.actuated)
    s = forward(m, start=places, start_rate={driven: -1.0})
    assert s.qd[0, m.v_slices[driven]] == pytest.approx(-1.0, rel=1e-12)


def test_modes_and_statics_keep_the_drives(slider: Mechanism) -> None:
    """The guess of the passive joints is poor; the crank stays where it is told."""
    q = [1.0, 0.0, 0.45]
    assert flexinv.natural_modes(slider, q, count=1).q == pytest.approx([1.0, *closed(1.0, 1)], abs=CLOSED)
    assert flexinv.statics(slider, q=q).q[0] == pytest.approx([1.0, *closed(1.0, 1)], abs=1e-6)  # no gravity: as rigid
