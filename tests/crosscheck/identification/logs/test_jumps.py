"""Jumps of angles are found where they are, and smooth, quantised and standing signals have none."""

from __future__ import annotations

import numpy as np
import pytest

from crosscheck.identification.logs.jumps import TURN, find_jumps, find_wrap_period
from flexinv.typing import Array

TIME = np.arange(0.0, 8.0, 0.004)
SMOOTH = np.sin(0.7 * TIME) + 0.3 * np.sin(3.0 * TIME)
ROUND = 1e-3 * np.round(SMOOTH / 1e-3)
STANDING = np.where(TIME < 7.9, 0.0, np.minimum(TIME - 7.9, 0.05))  # moves in 13 of 2000 samples
NOISY = SMOOTH + 1e-3 * np.random.default_rng(0).normal(size=len(TIME))


@pytest.mark.parametrize(
    "values", [SMOOTH, ROUND, 0.01 * ROUND, STANDING, NOISY, 0.0 * TIME, np.sign(SMOOTH) * 0.0 + 3.0]
)
def test_what_moves_on_has_no_jump(values: Array) -> None:
    assert find_jumps(values) == []


@pytest.mark.parametrize("values", [SMOOTH, ROUND, NOISY])
@pytest.mark.parametrize("size", [0.15, -0.5])
def test_a_step_is_found_where_it_is(values: Array, size: float) -> None:
    jumped = values + np.where(np.arange(len(values)) > 700, size, 0.0)
    assert find_jumps(jumped) == [700]
    assert find_wrap_period(jumped, 700, True) == 0.0


def test_a_sample_that_is_out_is_two_jumps_and_no_end_of_a_range() -> None:
    out = SMOOTH.copy()
    out[700] += 5.0
    assert find_jumps(out) == [699, 700]
    assert [find_wrap_period(out, k, True) for k in (699, 700)] == [0.0, 0.0]


@pytest.mark.parametrize(("period", "turns"), [(TURN, True), (0.5, False), (0.5, True)])
def test_an_angle_that_begins_anew_tells_its_period(period: float, turns: bool) -> None:
    """A whole turn exactly; of another range what the joint moves in one sample is missing, 1.6e-3 of 0.5 rad at most."""
    wrapped = np.mod(4.0 * SMOOTH if period == TURN else SMOOTH, period)
    ends = [k for k in find_jumps(wrapped) if find_wrap_period(wrapped, k, turns)]
    assert ends == np.flatnonzero(np.abs(np.diff(wrapped)) > 0.5 * period).tolist()
    assert ends
    assert [find_wrap_period(wrapped, k, turns) for k in ends] == pytest.approx([period] * len(ends), rel=0.02)
