"""The campaign of exported libraries can say no: a refusal that is not listed is wrong, and what is refused does not count."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import flexinv
from campaigns import exported
from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism


def refuse(said: str) -> object:
    def raise_refusal(mechanism: Mechanism, case: Case, folder: Path) -> exported.Outcome:
        raise InputError(said)

    return raise_refusal


def test_a_refusal_that_is_not_listed_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = flexinv.load_mechanism("models/rigid_one_link")
    cases = flexinv.load_cases("models/rigid_one_link", arm)
    monkeypatch.setattr(exported, "compare_case", refuse("export: mechanism 'x' has closures that act for a while"))
    unlisted = list(exported.compare_all("rigid_one_link", arm, cases, known=True))
    assert len(unlisted) == len(cases)
    assert all("refused: export: mechanism 'x'" in one.wrong for one in unlisted)
    assert not any(one.wrong for one in exported.compare_all("two_arms_flexible", arm, cases, known=True))
    assert not any(one.wrong for one in exported.compare_all("random 1", arm, cases, known=False))
    monkeypatch.setattr(exported, "compare_case", refuse("something else"))
    assert all(one.wrong for one in exported.compare_all("two_arms_flexible", arm, cases, known=True))


def test_random_mechanisms_are_drawn_until_so_many_were_compared() -> None:
    asked = list[str]()

    def compare(name: str, mechanism: Mechanism, cases: dict[str, Case]) -> Iterator[exported.Outcome]:
        asked.append(name)
        yield exported.Outcome(name, len(asked) % 2, 0.0, "")  # every other one is refused

    assert sum(one.calls for one in exported.compare_random(3, 1, compare)) == 3
    assert len(asked) == 5
    assert not list(exported.compare_random(0, 1, compare))
