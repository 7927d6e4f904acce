"""A share of the campaign between samples: random motions that cross, touch and miss; and judges that can say no."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def campaign(root: Path) -> Iterator[ModuleType]:
    sys.path.insert(0, str(root / "campaigns"))
    import between_samples

    yield between_samples
    sys.path.remove(str(root / "campaigns"))


@pytest.mark.filterwarnings("ignore:.*the samples end while moving")
@pytest.mark.parametrize("kind", ["limit", "four-bar", "slider", "five-bar", "spring", "march"])
def test_nothing_is_missed_between_samples(campaign: ModuleType, kind: str) -> None:
    outcomes = [campaign.run_case(kind, number, 1) for number in range(6)]
    wrong = [one for one in outcomes if not one.is_right]
    assert not wrong
    assert any(one.expected is not None for one in outcomes)


def test_a_wrong_instant_and_a_missed_one_are_wrong(campaign: ModuleType) -> None:
    outcome = campaign.Outcome("limit", 0, "crosses", 0.5, 0.5)
    assert outcome.is_right
    assert not replace(outcome, found=0.5 + 2e-9).is_right
    assert not replace(outcome, found=None).is_right
    assert not replace(outcome, expected=None).is_right
