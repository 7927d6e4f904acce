"""Files that ended in a wrong verdict, or in none: each with the exit code and the words that are right."""

from __future__ import annotations

from dataclasses import replace

import pytest
from case_files import DIFFERENT, PLAIN, Case, case, complaints


@pytest.mark.reported("F1 to F10")
@pytest.mark.parametrize("one", PLAIN, ids=lambda one: one.name)
def test_a_case_is_right(one: Case) -> None:
    if any(".usda" in word for word in one.command):
        pytest.importorskip("pxr", reason="USD is not installed (python -m pip install usd-core)")
    assert complaints(one) == []


def test_a_case_that_is_wrong_is_said() -> None:
    right = case("lint c33_pad.urdf", 0, "MuJoCo takes 0.236 kg")
    assert complaints(right) == []
    assert complaints(replace(right, code=DIFFERENT))[0] == "exit code 0, expected 1"
    assert complaints(replace(right, words=("takes 2 kg",)))[0] == "it does not say: takes 2 kg"
    assert complaints(replace(right, never=("0.236",)))[0] == "it says: 0.236"
