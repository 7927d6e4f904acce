"""One robot told twice is the same machine, and a fault beside is named alone: a share of `campaigns/same_robot.py`."""

from __future__ import annotations

from itertools import islice

import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("mujoco")
from same_robot import faults, outcomes

# Every kind of change is in one of them, held and floating robots, and trees of all kinds of joint in all formats.
PAIRS = (0, 2, 5, 9, 14, 33, 35, 37, 43, 47, 51, 53, 55, 57)


@pytest.mark.parametrize("number", PAIRS)
def test_one_robot_told_twice_is_the_same_machine(number: int) -> None:
    for one in outcomes([number]):
        assert one.found is not None, one.words
        assert one.named == []
        assert one.same


def test_a_fault_on_top_is_named_alone() -> None:
    for one in islice(faults(6), 6):
        assert one.told, one.pair.fault
        assert one.false == []
