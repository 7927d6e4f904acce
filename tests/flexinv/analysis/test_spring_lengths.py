"""Springs that come to no length: an error that names spring and instant, at samples and between them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import flexinv
from flexinv.files.load_cases import Case, load_cases
from flexinv.inverse import spring_lengths
from flexinv.inverse.inverse_dynamics import compute_spring_gap as compute_gap
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.mechanism import WORLD, Attachment, Placement, Spring

SLIDE = """title = "t"
source = "s"
gravity_m_per_s2 = [0, 0, 0]
[links.mass]
kind = "rigid"
mass_kg = 1
com_m = [0, 0, 0]
inertia_kgm2 = 0
[joints.x]
kind = "prismatic"
parent = "world"
child = "mass"
axis = [1, 0, 0]
[springs.coil]
first = {{ link = "world", xyz_m = [0, {aside}, 0] }}
second = {{ link = "mass" }}
stiffness_N_per_m = 100
rest_m = {rest}
"""
THROUGH = flexinv.Motion.point_to_point({"x": -0.4}, {"x": 0.6}, duration=1.0)


def mechanism(folder: Path, aside: float, rest: float) -> flexinv.Mechanism:
    (folder / "mechanism.toml").write_text(SLIDE.format(aside=aside, rest=rest), encoding="utf-8")
    return flexinv.load_mechanism(folder)


@pytest.mark.reported("D8")
@pytest.mark.parametrize("step", [0.1, 1e-2, 7e-3, 1e-3])
def test_a_spring_without_length_is_an_error(tmp_path: Path, step: float) -> None:
    with pytest.raises(flexinv.InputError, match=r"spring 'coil' has no length there") as caught:
        flexinv.solve(mechanism(tmp_path, 0.0, 0.05), THROUGH, step=step)
    match = re.search(r"t = (\S+) s", str(caught.value))
    assert match is not None
    place = THROUGH.evaluate(mechanism(tmp_path, 0.0, 0.05), [float(match[1])])[0][0, 0]
    speed = 2.0  # at most
    fine = step < 2e-2  # where the quintic is exact to 1e-9: its error is h^6 q^(6) / 46080, q^(6) up to (2 pi)^5
    assert abs(place) < speed * (1e-9 if fine else 1e-4)


def test_springs_that_stay_regular_are_left_alone(tmp_path: Path) -> None:
    passing = flexinv.solve(mechanism(tmp_path, 1e-3, 0.05), THROUGH, step=1e-3)
    assert np.isfinite(passing.torque).all()
    smooth = flexinv.solve(mechanism(tmp_path, 0.0, 0.0), THROUGH, step=1e-2)
    assert smooth.torque[:, 0] == pytest.approx(smooth.qdd[:, 0] + 100 * smooth.q[:, 0], abs=1e-12)


def test_in_a_march(tmp_path: Path) -> None:
    """A mass that flies through the spring's other end: found within the step."""
    free = mechanism(tmp_path, 0.0, 0.05)
    (tmp_path / "mechanism.toml").write_text(
        SLIDE.format(aside=0.0, rest=0.05).replace("axis = [1, 0, 0]", "axis = [1, 0, 0]\nactuated = false"),
        encoding="utf-8",
    )
    free = flexinv.load_mechanism(tmp_path)
    still = flexinv.Motion((), 0.5)
    with pytest.raises(flexinv.InputError, match=r"spring 'coil' has no length there"):
        flexinv.solve(free, still, step=1e-3, start={"x": -0.3}, start_rate={"x": 4.0})


# ------------------------------------------------------------------------------------------------- in rigid closed loops


def loop_with_spring(root: Path, instant: float, aside: float) -> tuple[flexinv.Mechanism, Case]:
    """The four-bar with a spring from its coupler to where that point of the coupler is at an instant, or ``aside`` [m] of it."""
    mechanism = flexinv.load_mechanism(root / "models" / "four_bar")
    case = load_cases(root / "models" / "four_bar", mechanism)["turn"]
    time = np.array([0.0, instant / 2, instant])
    there = flexinv.solve(mechanism, case.motion, step=instant / 50, end=instant, start=case.start)
    assert there.time[-1] == pytest.approx(time[-1], abs=1e-12)
    middle = Attachment("coupler", Placement(np.array([0.25, 0.0, 0.0])))
    marked = replace(mechanism, springs=(Spring("probe", Attachment(WORLD, Placement(np.zeros(3))), middle, 1.0, 0.0),))
    mesh = build(marked)
    place = compute_gap(
        mesh, compute_rigid_motion(mesh, there.q[-1:], there.qd[-1:], there.qdd[-1:]), marked.springs[0]
    )[0][0]
    end = Attachment(WORLD, Placement(place + np.array([0.0, 0.0, aside])))
    return replace(mechanism, springs=(Spring("coil", end, middle, 50.0, 0.1),)), case


@pytest.mark.parametrize("step", [0.1, 0.03, 5e-3])
def test_a_spring_in_a_loop_is_looked_at_between_samples(root: Path, step: float) -> None:
    """At steps in which the crank goes up to 60 degrees: to 1e-9 s; beside it, above the plane, nothing is said."""
    instant = 0.4137
    mechanism, case = loop_with_spring(root, instant, 0.0)
    with pytest.raises(flexinv.InputError, match=r"spring 'coil' has no length there") as caught:
        flexinv.solve(mechanism, case.motion, step=step, start=case.start)
    match = re.search(r"t = (\S+) s", str(caught.value))
    assert match is not None
    assert float(match[1]) == pytest.approx(instant, abs=1e-9)
    mechanism, case = loop_with_spring(root, instant, 1e-4)
    assert np.isfinite(flexinv.solve(mechanism, case.motion, step=step, start=case.start).torque).all()


def test_a_spring_that_stays_long_costs_no_second_way_through_the_loops(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its bound between samples is enough: the search with polynomials, which follows the loops seven times, never begins."""
    mechanism, case = loop_with_spring(root, 0.4137, 0.5)
    calls: list[object] = []
    monkeypatch.setattr(spring_lengths, "fit_pieces", lambda *_: calls.append(1))
    flexinv.solve(mechanism, case.motion, step=5e-3, start=case.start)
    assert calls == []
    mechanism, case = loop_with_spring(root, 0.4137, 1e-4)
    with pytest.raises(AttributeError):  # here it begins
        flexinv.solve(mechanism, case.motion, step=5e-3, start=case.start)


def test_spans_are_doubtful_where_a_vector_may_vanish() -> None:
    """A vector (t - 0.5, 0, 0) of a coordinate of rate 1: doubtful near 0.5 alone; where the coordinate leaps, throughout."""
    time = np.linspace(0.0, 1.0, 101)
    d = np.stack([time - 0.5, 0.0 * time, 0.0 * time], axis=1)
    gap = d, np.tile([1.0, 0.0, 0.0], (101, 1)), np.zeros((101, 3))
    ((begin, end),) = spring_lengths.list_doubtful_spans(gap, time, np.ones_like, 1e-9)
    assert 0.45 < begin < 0.5 < end < 0.55
    leaping = spring_lengths.list_doubtful_spans(gap, time, lambda times: 100.0 * np.ones_like(times), 1e-9)
    assert leaping == [(0.0, 1.0)]
    far = (d + np.array([0.0, 1.0, 0.0]), *gap[1:])
    assert spring_lengths.list_doubtful_spans(far, time, np.ones_like, 1e-9) == []
