"""Plans of closed loops can be read: their steps are records with names, and a print of them says what happens."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import loop_examples
import numpy as np
import pytest
from four_bar_example import four_bar
from loop_examples import Example

import flexinv
from flexinv.rnea.loop_layout import FILLS, STEPS, LoopPlan, Operation

MODELS = Path(__file__).resolve().parents[3] / "models"
FOUR_BAR = """\
plane, work space of 181 rows
bodies: root turn, turn, root turn
closures: whole
  1  pair           G[C.0, D] is the pivot, G[C.1, D] -> 0; so G[C.0, B] by G[C.1, B], G[C.0, A] by G[C.1, A]
  2  solve          lambda = tau[D] / G[C.0, D], held against size[D]; tau[A] -= lambda G[C.0, A]; tau[B] -= lambda G[C.0, B]
  3  solve          lambda = tau[B] / G[C.1, B], held against size[B]; tau[A] -= lambda G[C.1, A]"""


def plan_of(example: Example) -> LoopPlan:
    return flexinv.prepare(example[0], threads=1).plan


def test_a_plan_prints_as_steps_with_names() -> None:
    assert str(flexinv.prepare(four_bar(), threads=1).plan) == FOUR_BAR


@pytest.mark.parametrize("name", ["four_bar", "spatial", "platform", "rack_and_pinion"])
def test_the_steps_are_all_words_of_the_plan(name: str) -> None:
    """The words of the steps stand between the tables and the entries that are zero at first, none left over."""
    plan = plan_of(getattr(loop_examples, name)())
    first, end = int(plan.plan[STEPS]), int(plan.plan[FILLS])
    assert len(plan.steps) == int(plan.plan[STEPS + 1]) == len(str(plan).splitlines()) - 3
    assert [word for step in plan.steps for word in step.words] == plan.plan[first:end].tolist()
    assert {step.operation for step in plan.steps} & {Operation.SOLVE, Operation.ALL_SIX}


def test_bodies_of_one_loop_alone_share_rows() -> None:
    """Axes that nobody else asks for are not kept; a second closure that needs them keeps them, with the same efforts."""
    bricard, platform = (flexinv.load_mechanism(MODELS / name) for name in ("bricard", "stewart_platform"))
    (closure,) = bricard.closures
    twice = replace(bricard, closures=(closure, replace(closure, name="again")))
    one, both = (flexinv.prepare(m, threads=1) for m in (bricard, twice))
    assert "bodies: root turn, chain, chain, chain, chain\n" in str(one.plan)
    assert "bodies: root turn, tilt, tilt, tilt, tilt\n" in str(both.plan)
    assert "bodies: two turns, slide, float, two turns, slide," in str(flexinv.prepare(platform, threads=1).plan)
    case = flexinv.load_cases(MODELS / "bricard", bricard)["fold"]
    solution = flexinv.solve(bricard, case.motion, case.end / 150, start=case.start)
    state = solution.q, solution.qd, solution.qdd
    tau = one.torques(*state)
    np.testing.assert_allclose(
        both.torques(*state), tau, atol=1e-11 * np.abs(tau).max()
    )  # rounding over pivots of 1e-3


def test_redundant_drives_are_projected() -> None:
    """A drive more than needed: norms and inner products with weights, then what drives do against each other goes."""
    text = str(plan_of(loop_examples.five_bar(3)))
    assert [word in text for word in ("norm ", "inner ", "project ")] == [True, True, True]
