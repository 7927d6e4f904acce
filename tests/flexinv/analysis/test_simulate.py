"""simulate: forward of inverse is the identity, up to the time error of both."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flexible_examples import observed_order

import flexinv
from flexinv.files.load_cases import load_cases
from flexinv.model.mechanism import Body, Inertia, Joint, Link, Mechanism


def there_and_back(root: Path, model: str, case_name: str, step: float, end: float | None = None) -> float:
    """Largest difference of joint coordinates over their largest range: the motion, and what its torque makes of the arm."""
    folder = root / "models" / model
    m = flexinv.load_mechanism(folder)
    case = load_cases(folder, m)[case_name]
    m = case.meshed(m)
    one = flexinv.solve(m, case.motion, step, end=end or case.end, start=case.start, initial=case.initial)
    places = {j.name: one.q[0, m.q_slices[j.name]] for j in m.joints if j.nv}
    rates = {j.name: one.qd[0, m.v_slices[j.name]] for j in m.joints if j.nv}
    two = flexinv.simulate(m, one.time, one.torque, step, start=places, start_rate=rates, initial=case.initial)
    # the inverse dynamics of the motion found gives the torque back: Newton's increment of 1e-8, squared, times inertia / h^2
    assert abs(two.torque - one.torque).max() < 1e-8 * np.ptp(one.torque)
    return float(abs(two.q - one.q).max() / np.ptp(one.q, axis=0).max())


CASES = [
    ("rigid_3r", "cycloid", 4e-4, 0.2),
    ("ur5", "reach", 1e-3, 0.3),  # an arm that stands up falls: not for longer than it takes to fall over
    ("four_bar", "turn", 1e-3, 0.2),
    ("flex_one_link", "cycloid", 1e-4, 0.1),
    ("spatial_arm", "reach", 5e-4, 0.1),
    ("four_bar_flexible", "turn", 2.5e-4, 0.1),
]


@pytest.mark.parametrize(("model", "case", "step", "end"), CASES, ids=[c[0] for c in CASES])
def test_forward_of_inverse_is_the_identity(root: Path, model: str, case: str, step: float, end: float) -> None:
    errors = [there_and_back(root, model, case, step / k, end) for k in (1, 2)]
    assert errors[1] < 1e-5
    assert errors[1] < 1e-9 or observed_order(errors) > 1.8  # of second order, where it is more than rounding


@pytest.mark.slow
@pytest.mark.parametrize(("model", "case", "step"), [("rigid_3r", "cycloid", 1e-4), ("flex_two_link", "cycloid", 1e-4)])
def test_identity_to_a_millionth_over_the_whole_motion(root: Path, model: str, case: str, step: float) -> None:
    assert there_and_back(root, model, case, step) < 1.01e-6


def wheel() -> Mechanism:
    body = Link("wheel", (Body("wheel", Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 2.0]))),))
    return Mechanism("wheel", (body,), (Joint("axle", "revolute", "world", "wheel"),), gravity=np.zeros(3))


def test_a_torque_that_grows_turns_a_wheel() -> None:
    """2 kg m^2 under t N m: t^3 / 12 rad; generalized-alpha gives cubes up to its second order, h^2."""
    s = flexinv.simulate(wheel(), [0.0, 1.0], [[0.0], [1.0]], step=1e-3)
    assert s.q[-1, 0] == pytest.approx(1 / 12, rel=1e-5)
    assert s.torque[:, 0] == pytest.approx(s.time, abs=1e-12)


def test_a_torque_that_jumps_is_met_exactly() -> None:
    """2 kg m^2 under nothing until 0.5 s and 1 N m from then on: (t - 0.5)^2 / 4 rad, a parabola, exactly."""
    s = flexinv.simulate(wheel(), [0.0, 0.5, 0.5, 1.0], [[0.0], [0.0], [1.0], [1.0]], step=1e-2)
    np.testing.assert_allclose(s.q[:, 0], np.clip(s.time - 0.5, 0.0, None) ** 2 / 4, rtol=0, atol=1e-12)
    ramp = flexinv.simulate(wheel(), [0.0, 0.49, 0.5, 1.0], [[0.0], [0.0], [1.0], [1.0]], step=1e-2)
    assert abs(ramp.q - s.q).max() > 1e-3


@pytest.mark.parametrize(
    ("time", "torque", "words"),
    [
        ([0.0, 1.0], [[0.0, 1.0]], r"torque has shape \(1, 2\), expected finite numbers \(2, 1\).*axle"),
        ([0.0, 0.0], [[0.0], [1.0]], r"two or more times that increase \[s\]"),
        ([0.0, 1.0, 1.0], 3 * [[0.0]], r"between the first and the last a time may be given twice"),
        ([0.0, 0.5, 0.5, 0.5, 1.0], 5 * [[0.0]], r"a time may be given twice"),
        ([0.0, 1.0], [[0.0], [np.nan]], r"finite numbers"),
        ([0.0, 1e-4], [[0.0], [1.0]], r"step = 0\.001 s is longer than the torque's 0\.0001 s"),
    ],
)
def test_input_that_cannot_be(time: list[float], torque: list[list[float]], words: str) -> None:
    with pytest.raises(flexinv.InputError, match=words):
        flexinv.simulate(wheel(), time, torque, step=1e-3)


def test_an_unknown_start_is_refused() -> None:
    with pytest.raises(flexinv.InputError, match=r"initial = 'rest', expected 'consistent'"):
        flexinv.simulate(wheel(), [0.0, 1.0], [[0.0], [0.0]], step=0.1, initial="rest")
