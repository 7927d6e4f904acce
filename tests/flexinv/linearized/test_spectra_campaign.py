"""A share of the campaign of spectra (`python campaigns/spectra.py`), and whether its judge sees what is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from campaigns import spectra
from campaigns.spectra import compared, judged
from campaigns.spectra_closed_forms import closed_forms
from campaigns.spectra_machines import drawn
from campaigns.spectra_reference import Spectrum
from flexinv.errors import ConvergenceError, FlexinvError, InputError
from flexinv.linearized.steady_modes import steady_modes

SEED = 1
# A closure with beams, a free base, couplings at rates, a massless damper, gyroscopic terms without rotary inertia, springs,
# one that `linear_model` alone refuses (138), a massless motion with a damper beside one whose damper is let go (149).
SHARE = (0, 4, 6, 12, 18, 22, 23, 34, 83, 138, 149)


# Of other seeds: a hub that nothing holds beside fast motions without rotary inertia, of which one was lost; a motion without
# stiffness whose own forces cancel, of which differences are known less well than of its moments alone; a free mechanism whose
# matrix a shift made singular; roots +w and -w, one of which was there twice; dampers without inertia among the slowest modes;
# one that is soft among stiff ones, whose root of -8e9 1/s was left out; eight zeros together, of which the slow end saw nothing
# and had all others wrong with them.
OTHERS = ((2, 13), (3, 117), (3, 132), (4, 3), (4, 10), (4, 57), (4, 159))


@pytest.mark.parametrize(("seed", "number"), OTHERS)
def test_those_that_were_wrong_are_right(seed: int, number: int) -> None:
    outcome = judged(drawn(seed, number), number)
    assert outcome.word == "right", outcome.said


@pytest.mark.parametrize("number", SHARE)
def test_a_share_of_the_mechanisms_is_right(number: int) -> None:
    outcome = judged(drawn(SEED, number), number)
    assert outcome.word == "right", outcome.said


def test_the_share_has_what_it_is_to_have() -> None:
    has = {word for number in SHARE for word in drawn(SEED, number).features}
    assert {
        "beams",
        "closures",
        "couplings",
        "springs",
        "dampers",
        "follower loads",
        "rates",
        "free base",
        "points",
    } <= has


def test_closed_forms_are_kept() -> None:
    wrong = [name for name, off, allowed in closed_forms() if not off <= allowed]
    assert not wrong


def test_the_judge_sees_a_root_that_is_off_missing_or_invented() -> None:
    exact = Spectrum(np.array([2j, -2j, -1.0]), np.full(3, 4.0), np.full(3, 4.0), np.full(3, 1.0), 2.0)
    bars = np.zeros(3)
    assert compared(exact.root, bars, exact)[0] == ""
    assert "expected" in compared(exact.root * (1 + 1e-6), bars, exact)[0]
    assert "expected 3" in compared(exact.root[:2], bars[:2], exact)[0]
    assert "expected 3" in compared(np.append(exact.root, 5.0), np.zeros(4), exact)[0]


def test_the_judge_sees_roots_that_are_off_by_little(monkeypatch: pytest.MonkeyPatch) -> None:
    def off(*arguments: object, **named: object) -> object:
        modes = steady_modes(*arguments, **named)  # type: ignore[arg-type]
        return replace(modes, root=modes.root * (1 + 1e-5))

    monkeypatch.setattr(spectra, "steady_modes", off)
    assert judged(drawn(SEED, 23), 23).word == "wrong"


@pytest.mark.parametrize(
    ("error", "word"),
    [
        (ConvergenceError("modes: of 8 roots 2 are lost, or there twice, as rounding hides slow ones"), "lost"),
        (ConvergenceError("modes: whether all of the 4 slowest roots are found is not proved: too close"), "lost"),
        (ConvergenceError("mechanism 'arm': no steady shape at 3 rad/s"), "refused"),
        (InputError("modes: nothing of 'arm' can move"), "refused"),
    ],
)
def test_a_lost_root_is_no_refusal(error: FlexinvError, word: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was counted as one, and another mechanism was drawn."""

    def refuse(*_: object) -> object:
        raise error

    monkeypatch.setattr(spectra, "steady_modes", refuse)
    assert judged(drawn(SEED, 23), 23).word == word


def test_the_judge_sees_bars_that_leave_no_digit() -> None:
    exact = Spectrum(np.array([2j, -2j, -1.0]), np.full(3, 4.0), np.full(3, 4.0), np.full(3, 1.0), 2.0)
    assert not spectra.are_wide(exact.root, np.full(3, 0.01), exact)
    assert spectra.are_wide(exact.root, np.array([0.01, 0.01, 0.5]), exact)


def test_the_judge_measures_a_zero_against_the_slowest_root() -> None:
    """Bars of zeros were wide whatever they were, as a part of nothing; those of roots that are no zeros still are."""
    exact = Spectrum(np.array([2j, -2j, 0.0]), np.full(3, 4.0), np.full(3, 4.0), np.full(3, 1.0), 2.0)
    assert not spectra.are_wide(exact.root, np.array([0.01, 0.01, 0.1]), exact)
    assert spectra.are_wide(exact.root, np.array([0.01, 0.01, 0.3]), exact)
    other = Spectrum(np.array([2j, -2j, -1e-3]), np.full(3, 4.0), np.full(3, 4.0), np.full(3, 1.0), 2.0)
    assert spectra.are_wide(exact.root, np.array([0.01, 0.01, 0.1]), other)
    assert spectra.are_wide(other.root, np.array([0.01, 0.01, 0.1]), other)
