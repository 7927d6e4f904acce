"""Mistakes in an outside engine's own program: a sample of the campaign in tests/shared/program_faults.py, drawn by a seed."""

from __future__ import annotations

from pathlib import Path

import program_faults
import pytest

SEED, COUNT = 16, 2


def test_every_mistake_is_one_piece_of_the_program() -> None:
    source = program_faults.SOURCE.read_text()
    assert len(program_faults.MISTAKES) >= 8
    for name, mistake in program_faults.MISTAKES.items():
        assert source.count(mistake.old) == 1, name
        compile(source.replace(mistake.old, mistake.new), name, "exec")


def test_a_campaign_with_a_wrong_name_does_not_pass() -> None:
    mistake = program_faults.MISTAKES["no rotors"]
    right = program_faults.FaultOutcome(("rotor inertia dropped",), "")
    several = program_faults.FaultOutcome(("a", "b", "c", "rotor inertia"), "")
    other, silent = program_faults.FaultOutcome(("payload",), ""), program_faults.FaultOutcome((), "unknown")
    assert [one.right(mistake) for one in (right, several, other, silent)] == [True, False, False, False]
    assert [one.wrong(mistake) for one in (right, several, other, silent)] == [False, False, True, False]


@pytest.mark.slow
def test_mistakes_drawn_by_a_seed_are_named(tmp_path: Path) -> None:
    names = program_faults.drawn(COUNT, SEED)
    assert names == program_faults.drawn(COUNT, SEED)
    for name, result in program_faults.campaign(names, tmp_path).items():
        assert result.right(program_faults.MISTAKES[name]), f"{name}: {result.words}"
