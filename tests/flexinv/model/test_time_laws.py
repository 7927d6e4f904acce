"""Time laws as theorems: they start and end at rest, their derivatives are derivatives, their peaks are known."""

from __future__ import annotations

import numpy as np
import pytest

from flexinv.errors import InputError
from flexinv.model.track import LAWS, Law, evaluate_progress, find_law

ROUNDING = 4e-15  # a handful of operations on numbers up to 10
# truncation h^6/140 times the 7th derivative of u', (2 pi)^7: 3e-15; rounding of u times the stencil's magnitudes
DIFFERENCES = ROUNDING * 110.0 / (60.0 * 1e-3)
# u' and u'' peaks by hand: cycloid 2 at 1/2 and 2 pi at 1/4; quintic 30/16 and 60 s(1-s)(1-2s) at (1 - 1/sqrt 3)/2;
# septic 140/4^3 and 420 p^2 sqrt(1 - 4 p) at p = s(1-s) = 1/5; nonic 630/4^4 and 2520 p^3 sqrt(1 - 4 p) at p = s(1-s) = 3/14;
# bang-bang: half the way at constant acceleration a, a/8 = 1/2; trapezoid: v/6 + v/3 + v/6 = 1, a = 3 v.
PEAKS = {
    "cycloid": (2.0, 2.0 * np.pi),
    "quintic": (1.875, 10.0 / np.sqrt(3.0)),
    "septic": (35.0 / 16.0, 84.0 / (5.0 * np.sqrt(5.0))),
    "nonic": (630.0 / 256.0, 2520.0 * (3.0 / 14.0) ** 3 / np.sqrt(7.0)),
    "bang-bang": (2.0, 4.0),
    "trapezoid": (1.5, 4.5),
}


def evaluate(law: Law, s: np.ndarray, left: bool = False) -> tuple[np.ndarray, ...]:
    return evaluate_progress(law, s, np.full(s.shape, left))


def worst_derivative_error(law: Law) -> float:
    """Largest error of u' and u'' against sixth-order differences that do not straddle a jump."""
    h = 1e-3
    jumps = np.array(sorted({0.0, *law.jumps, 1.0}))
    s = np.linspace(0.0, 1.0, 1237)
    s = s[np.min(np.abs(s[:, None] - jumps), axis=1) > 3 * h]
    stencil = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / (60.0 * h)
    around = [evaluate(law, s + k * h) for k in range(-3, 4)]
    u1 = sum(c * a[0] for c, a in zip(stencil, around, strict=True))
    u2 = sum(c * a[1] for c, a in zip(stencil, around, strict=True))
    _, exact1, exact2 = evaluate(law, s)
    return max(np.abs(u1 - exact1).max(), np.abs(u2 - exact2).max())


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_derivatives_are_derivatives(law: Law) -> None:
    assert worst_derivative_error(law) < DIFFERENCES


def test_a_wrong_derivative_is_caught() -> None:
    cycloid = LAWS["cycloid"].function
    wrong = Law((), lambda s: (cycloid(s)[0], cycloid(s)[1], cycloid(s)[2] * (1.0 + 1e-8)))
    assert worst_derivative_error(wrong) > DIFFERENCES


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_starts_and_ends_at_rest(law: Law) -> None:
    u, speed, acceleration = evaluate(law, np.array([-1.0, 0.0, 1.0, 2.0]))
    np.testing.assert_allclose(u, [0.0, 0.0, 1.0, 1.0], rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(speed[[0, 2, 3]], 0.0)
    np.testing.assert_allclose(speed[1], 0.0, rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(acceleration[[0, 2, 3]], 0.0)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_second_half_mirrors_the_first(law: Law) -> None:
    s = np.linspace(0.011, 0.489, 101)
    u, speed, acceleration = evaluate(law, s)
    mirrored = evaluate(law, 1.0 - s)
    np.testing.assert_allclose(mirrored[0], 1.0 - u, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(mirrored[1], speed, rtol=0, atol=ROUNDING)
    # 1 - s carries rounding 1e-16, which u'' takes up with its slope, 60 at most
    np.testing.assert_allclose(mirrored[2], -acceleration, rtol=0, atol=60 * ROUNDING)


@pytest.mark.parametrize("name", LAWS)
def test_peaks(name: str) -> None:
    places = np.array([0.0, 0.25, 0.5 - 0.5 / np.sqrt(3.0), 0.5, 0.5 + 0.5 / np.sqrt(3.0), 0.75])
    places = np.concatenate([places, 0.5 + np.array([-0.5, 0.5]) / np.sqrt(7.0)])  # p = 3/14
    places = np.concatenate([places, 0.5 + np.array([-0.5, 0.5]) / np.sqrt(5.0)])  # p = 1/5
    s = np.union1d(np.linspace(0.0, 1.0, 5001), places)
    _, speed, acceleration = evaluate(LAWS[name], s)
    assert np.abs(speed).max() == pytest.approx(PEAKS[name][0], rel=ROUNDING)
    assert np.abs(acceleration).max() == pytest.approx(PEAKS[name][1], rel=ROUNDING)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_the_stated_jumps_are_all_the_jumps(law: Law) -> None:
    s = np.linspace(-0.1, 1.1, 12001)
    _, _, acceleration = evaluate(law, s)
    # u'' varies by less than (its slope, 60) * (spacing, 1e-4) from sample to sample; the smallest jump is 4
    jumped = s[1:][np.abs(np.diff(acceleration)) > 0.1]
    assert jumped.size == len(law.jumps)
    np.testing.assert_allclose(jumped, law.jumps, rtol=0, atol=1.01e-4)  # one spacing


def test_limits_from_both_sides() -> None:
    for name, before, after in (
        ("bang-bang", [0.0, 4.0, -4.0], [4.0, -4.0, 0.0]),
        ("trapezoid", [0.0, 4.5, 0.0, -4.5], [4.5, 0.0, -4.5, 0.0]),
    ):
        jumps = np.array(LAWS[name].jumps)
        for shift in (-1e-13, 0.0, 1e-13):  # times k*h carry such rounding; they still mean the jump
            np.testing.assert_array_equal(evaluate(LAWS[name], jumps + shift, left=True)[2], before)
            np.testing.assert_array_equal(evaluate(LAWS[name], jumps + shift)[2], after)


def test_unknown_law_is_answered_by_name() -> None:
    with pytest.raises(InputError, match=r"^law = 'cyclod': expected one of cycloid, quintic, .*; write 'cycloid'$"):
        find_law("cyclod")
