"""Thresholds that are halved and doubled: every one is there, changes wherever it is held, and comes back."""

from __future__ import annotations

import pytest

from campaigns.thresholds.__main__ import format_table
from campaigns.thresholds.constants import LOGS, TORQUES, Threshold, list_thresholds, replace_threshold, scale_value
from campaigns.thresholds.trials import COUNTED
from crosscheck.identification.causes import name_causes, rounds


@pytest.mark.parametrize("kind", [TORQUES, LOGS])
def test_every_threshold_is_a_number_or_some(kind: str) -> None:
    for threshold in list_thresholds(kind):
        numbers = threshold.value.values() if isinstance(threshold.value, dict) else [threshold.value]
        assert all(isinstance(number, int | float) for number in numbers), threshold


def test_a_threshold_changes_while_it_is_tried_and_comes_back() -> None:
    before = rounds.SEEN
    half = name_causes.HALF
    with replace_threshold(Threshold(LOGS, rounds.__name__, "SEEN"), 2.0) as new:
        assert new == rounds.SEEN == 2.0 * before
        assert half == name_causes.HALF  # another constant stays
    assert before == rounds.SEEN


def test_whole_numbers_stay_whole_and_above_none() -> None:
    assert scale_value(3, 0.5) == 2
    assert scale_value(1, 0.5) == 1
    assert scale_value({True: 24, False: 6}, 2.0) == {True: 48, False: 12}
    assert scale_value(0.3, 0.5) == 0.15


def test_the_table_has_both_ways_of_each() -> None:
    counts = dict.fromkeys(COUNTED, "4")
    rows = [
        {"kind": LOGS, "module": "m", "name": "N", "factor": factor, **counts | {"right": right}}
        for factor, right in (("0.5", "9"), ("2", "8"))
    ]
    assert "| `m.N` | 9 / 4 / 4 | 8 / 4 / 4 |" in format_table(rows)
