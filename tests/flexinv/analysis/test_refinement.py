"""The ladder of refinements and the bars of its answers: what the module derives holds for made-up sequences."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from flexible_examples import arm

from flexinv.analysis.refinement import (
    Level,
    Quantities,
    apply_mesh,
    compute_refinement,
    make_extrapolated_answer,
    make_plain_answer,
)
from flexinv.analysis.task import Settings
from flexinv.kinematics.mesh import build

TIME = np.linspace(0.0, 1.0, 41)
WAVE, SHAPE = np.sin(7 * TIME), np.cos(3 * TIME)
MESH = build(arm())


def level(finer: int, error: float) -> Level:
    """A run whose torque is a wave and an error of one shape [N m]."""
    torque = (WAVE + error * SHAPE)[:, None]
    quantities = Quantities(torque, np.zeros((41, 1, 3)), np.zeros((41, 0)))
    return Level(finer, 1, MESH, Settings(), cast(Any, None), quantities)


def test_rungs_grow_by_a_third_and_a_half() -> None:
    assert [compute_refinement(k) for k in range(10)] == [1, 2, 3, 4, 6, 8, 12, 16, 24, 32]


@pytest.mark.parametrize("power", [1.5, 3.0, 4.0, 6.0])
def test_bars_hold_whatever_power_is_left(power: float) -> None:
    """Torques with c h^2 + e h^p: the second triple's bar is above the error, and less than 10 times (p = 6: 2^(6/2) - 1)."""
    before = None
    for index in (1, 3):
        ladder = [compute_refinement(index + k) for k in range(3)]
        three = [level(n, 0.3 / n**2 + 0.1 / n**power) for n in ladder]
        answer = make_extrapolated_answer((three[0], three[1], three[2]), before)
        own = [one.quantities.torque for one in answer.levels]
        error = np.abs(answer.weight[0] * own[0] + answer.weight[1] * own[1] - WAVE[:, None]).max() / np.ptp(WAVE)
        if before is not None:
            assert error <= answer.bar <= 10 * error
        before = answer


def test_steps_that_do_not_converge_have_no_plain_answer() -> None:
    apart = [level(n, e) for n, e in ((1, 0.1), (2, -0.1), (3, 0.3))]
    assert make_plain_answer((apart[0], apart[1], apart[2])).bar == np.inf
    close = [level(n, 0.1 / n) for n in (1, 2, 4)]
    answer = make_plain_answer((close[0], close[1], close[2]))
    error = 0.1 / 4 / np.ptp(WAVE)
    assert error <= answer.bar <= 4 * error


def test_a_mesh_of_many_linear_elements_becomes_one_of_high_order() -> None:
    first = apply_mesh(arm(elements=16, order=1), 0).links[0].beam
    second = apply_mesh(arm(elements=2, order=4), 4).links[0].beam
    assert first is not None
    assert second is not None
    assert (first.elements, first.order) == (1, 4)
    assert (second.elements, second.order) == (4, 8)
    assert replace(first, elements=16, order=1).length == first.length
