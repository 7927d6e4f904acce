"""Long marches: one step of so many is kept, and only that takes memory."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from flexible_examples import HALF_TURN, arm, spatial_tree

import flexinv
from flexinv.model.mechanism import Mechanism

MODELS = Path(__file__).resolve().parents[3] / "models"
STEP = 2e-3


@pytest.mark.parametrize("mechanism", [arm(), spatial_tree()], ids=["plane", "space"])
def test_every_so_many_steps_are_kept_of_the_same_march(mechanism: Mechanism) -> None:
    motion = flexinv.Motion.point_to_point(np.zeros(mechanism.nq), np.full(mechanism.nq, 0.3), 0.3, law="bang-bang")
    whole = flexinv.solve(mechanism, motion, 1e-3)
    for every in (7, 50):  # the jump at 0.15 s falls between the samples that are kept, and on one of them
        some = flexinv.solve(mechanism, motion, 1e-3, every=every)
        np.testing.assert_array_equal(some.time, whole.time[::every])
        np.testing.assert_array_equal(some.torque, whole.torque[::every])
        np.testing.assert_array_equal(some.nodes.alpha, whole.nodes.alpha[::every])
        np.testing.assert_array_equal(some.balance.power, whole.balance.power[::every])
        np.testing.assert_array_equal(some.iterations, whole.iterations[::every])


def test_error_bars_of_what_is_kept() -> None:
    whole = flexinv.solve(arm(), HALF_TURN, STEP, error=True)
    some = flexinv.solve(arm(), HALF_TURN, STEP, error=True, every=5)
    assert whole.torque_error is not None
    assert some.torque_error is not None
    assert 0.5 < some.torque_error.max() / whole.torque_error.max() <= 1.0  # the largest of fewer samples


def test_a_long_march_takes_the_memory_of_what_is_kept() -> None:
    """60,000 steps of two nodes' histories would be 23 MB; of a hundred of them next to nothing is left."""
    rest = flexinv.Motion.point_to_point([0.0], [0.5], 6.0)
    flexinv.solve(arm(1, 1), rest, 1e-4, end=1e-3, every=2)  # which compiles, or reads, what would count as well
    tracemalloc.start()
    flexinv.solve(arm(1, 1), rest, 1e-4, every=600)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4e6  # the grid of 60,000 times takes 0.5 MB, a chunk of 4096 steps 1 MB


def test_every_is_refused_where_steps_are_needed() -> None:
    with pytest.raises(flexinv.InputError, match="every = 2: the incremental mode"):
        flexinv.solve(arm(), HALF_TURN, STEP, incremental=True, every=2)
    with pytest.raises(flexinv.InputError, match="every = 0: expected 1"):
        flexinv.solve(arm(), HALF_TURN, STEP, every=0)
    loop = flexinv.load_mechanism(MODELS / "four_bar_flexible")
    crank = flexinv.Motion.point_to_point({loop.joints[0].name: 0.0}, {loop.joints[0].name: 0.1}, 0.2)
    with pytest.raises(flexinv.InputError, match="has closures and beams, of which every step is kept; write every=1"):
        flexinv.solve(loop, crank, STEP, every=2)


def test_more_steps_than_there_are_keep_the_first() -> None:
    some = flexinv.solve(arm(), HALF_TURN, STEP, every=10_000)
    np.testing.assert_array_equal(some.torque, flexinv.solve(arm(), HALF_TURN, STEP).torque[:1])
