"""Copies and pickles of public objects equal their originals, and do the same."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexinv
from flexinv.model.by_value import compute_hash, is_same

MODELS = Path(__file__).resolve().parents[3] / "models"
BENT = flexinv.load_mechanism(MODELS / "flex_one_link")
RIGID = flexinv.load_mechanism(MODELS / "rigid_3r")
TURN = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 1.0}, duration=0.2)
SAMPLED = flexinv.Motion.from_samples(np.linspace(0, 1, 9), {"hub": np.linspace(0, 1, 9) ** 2})
STATE = np.random.default_rng(1).uniform(-1, 1, (3, 4, 3))
Copy = Callable[[Any], Any]
COPIES: dict[str, Copy] = {
    "copied": copy.copy,
    "deeply": copy.deepcopy,
    "pickled": lambda one: pickle.loads(pickle.dumps(one)),
}


def following() -> Any:
    two = flexinv.load_mechanism(MODELS / "flex_two_link")
    up = flexinv.Path.line([0.3, 0.1, 0], [0.3, 0.15, 0], 0.2)
    return flexinv.follow(two, up, "link2", 1e-2, start={"joint1": -0.5, "joint2": 1.0})


MADE: dict[str, Callable[[], Any]] = {
    "Mechanism": lambda: BENT,
    "Motion by a law": lambda: TURN,
    "Motion by samples": lambda: SAMPLED,
    "Load": lambda: flexinv.Load("link", force=[0, 0, -1]),
    "Solution": lambda: flexinv.solve(BENT, TURN, step=1e-2),
    "Batch": lambda: flexinv.solve_many(BENT, [TURN, SAMPLED], step=1e-2, end=1.1),
    "Modes": lambda: flexinv.natural_modes(BENT),
    "SteadyModes": lambda: flexinv.steady_modes(BENT, rates={"hub": 1.0}),
    "LinearModel": lambda: flexinv.linear_model(BENT),
    "TorqueFunction": lambda: flexinv.prepare(RIGID),
    "TorqueDerivatives": lambda: flexinv.torque_derivatives(RIGID, *STATE),
    "Regressor": lambda: flexinv.torque_regressor(RIGID, *STATE),
    "BaseParameters": lambda: flexinv.base_parameters(flexinv.torque_regressor(RIGID, *STATE)),
    "Path": lambda: flexinv.Path.arc([1, 0, 0], [0, 0, 0], 1.0, 2.0).turning(np.eye(3), np.eye(3)),
    "Path by points": lambda: flexinv.Path.points(np.random.default_rng(1).normal(size=(7, 3)), 1.0),
    "Following": following,
    "Case": lambda: next(iter(flexinv.load_cases(MODELS / "flex_one_link", BENT).values())),
}


@pytest.mark.parametrize("name", MADE)
def test_a_copy_equals_its_original(name: str) -> None:
    one = MADE[name]()
    assert one == one  # arrays have no truth of their own
    for copied in (make(one) for make in COPIES.values()):
        assert copied == one
        assert copied is not None
        assert is_same(copied, one)
    assert one != 3


def test_equal_data_have_one_hash() -> None:
    for one in (BENT, TURN, BENT.joints[0], flexinv.Load("link"), flexinv.prepare(RIGID)):
        assert hash(pickle.loads(pickle.dumps(one))) == hash(one)
    assert compute_hash(np.array([0.0])) == compute_hash(np.array([-0.0]))


def test_other_data_are_not_equal() -> None:
    assert replace(BENT, gravity=BENT.gravity + 1e-15) != BENT
    assert flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 1.0 + 1e-15}, duration=0.2) != TURN
    whole = flexinv.solve(BENT, TURN, step=1e-2)
    assert replace(whole, torque_all=whole.torque_all + 1e-15) != whole
    assert not is_same(1.0, "1.0")
    assert not is_same(np.zeros(2), np.zeros(3))
    assert not is_same([1.0, 2.0], [1.0])
    assert is_same({"a": float("nan")}, {"a": float("nan")})


FLEXIBLE = ("flex_one_link", "flex_one_link_damped", "spatial_arm")


@pytest.mark.reported("A1")
@pytest.mark.parametrize("sudden", [False, True])
@pytest.mark.parametrize("name", FLEXIBLE)
def test_a_copied_controller_goes_on_where_its_original_stands(name: str, sudden: bool) -> None:
    """Each for itself: the one's steps leave the other alone, in a plane, in space, and within a sudden start."""
    mechanism = flexinv.load_mechanism(MODELS / name)
    whole, none = np.linspace(1.0, 0.5, mechanism.nv), np.zeros(mechanism.nv)

    def now(k: int) -> tuple[Any, ...]:
        t = 1e-3 * k
        return mechanism.neutral + 0.5 * t * t * whole, t * whole + sudden * whole, whole

    one = flexinv.Controller.of(mechanism, step=1e-3)
    one.start(mechanism.neutral, sudden * whole, whole if sudden else none)
    for k in range(1, 3):
        one.step(*now(k))
    others = [make(one) for make in COPIES.values()]
    rest = [one.step(*now(k)).copy() for k in range(3, 12)]
    for other in others:
        np.testing.assert_array_equal([other.step(*now(k)).copy() for k in range(3, 12)], rest)
        assert other.tau is not one.tau


def test_a_copied_controller_that_was_not_started_asks_for_it() -> None:
    rigid, bent = flexinv.Controller.of(RIGID), flexinv.Controller.of(BENT, step=1e-3)
    np.testing.assert_array_equal(copy.deepcopy(rigid).step(*STATE[:, 0]), rigid.step(*STATE[:, 0]))
    one = np.zeros(1)
    with pytest.raises(flexinv.InputError, match=r"write controller\.start"):
        copy.deepcopy(bent).step(one, one, one)
