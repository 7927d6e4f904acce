"""The list of what is not right names each thing once, and so that a reader knows which it is."""

from __future__ import annotations

from dataclasses import replace

import pytest

from crosscheck.commands.shared.terminal import Console, open_progress, write_troubles
from crosscheck.report import words
from crosscheck.run.work import Event
from crosscheck.verdicts.baseline import HOW, UNBLESSED
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.results import CaseRow, EngineRow, Results, RunRow
from crosscheck.verdicts.signals import Move

ONE = Comparison("arm", "move", "e", "flexinv", "torque", "N m", "deviation", "why", 1.0, 0.5, 10.0, 1e-3)


def night(*rows: Comparison) -> Results:
    runs = tuple(RunRow("arm", "move", name, "ok") for name in ("flexinv", "e", "f"))
    return Results("now", finished=True, cases=(CaseRow("arm", "move"),), runs=runs, comparisons=rows)


def test_what_is_only_not_blessed_yet_is_one_line_of_a_mechanism() -> None:
    """Sixteen rows with the same words hide the one that differs."""
    new = f"{UNBLESSED}: {HOW}"
    rows = [
        replace(ONE, verdict="unjudged", quantity=q, engine=e, message=new)
        for q in ("torque", "tip", "axial")
        for e in ("e", "f")
    ]
    troubles = words.list_troubles(night(*rows, replace(ONE, quantity="reaction")))
    assert [(verdict, what) for verdict, _, what, _ in troubles] == [
        ("deviation", "e reaction"), ("unjudged", "6 comparisons (e, f)"),
    ]  # fmt: skip
    assert troubles[1][3] == new


def test_what_was_compared_names_the_engine_that_builds_nothing_by_itself() -> None:
    """The exported library runs our own kernels: it confirms the export, not the mechanics."""
    said = {
        name: words.describe_scope(
            replace(
                night(replace(ONE, engine=name, maximum=1e-9)),
                engines=(EngineRow("flexinv", True), EngineRow(name, True)),
                runs=tuple(RunRow("arm", "move", one, "ok") for one in ("flexinv", name)),
            )
        )
        for name in ("mujoco", "flexinv-c")
    }
    assert "Every engine builds them by itself from the same data" in said["mujoco"]
    assert (
        "Every engine but flexinv-c, which runs the kernels of flexinv in C, builds them by itself" in said["flexinv-c"]
    )


def test_a_quantity_in_several_units_is_told_with_its_unit() -> None:
    rows = [replace(ONE, quantity="wrench", unit=unit) for unit in ("N", "N m")]
    troubles = words.list_troubles(night(*rows, ONE))
    assert [what for _, _, what, _ in troubles] == ["e wrench [N]", "e wrench [N m]", "e torque"]


def test_old_and_new_have_the_digits_that_tell_them_apart() -> None:
    pairs = {
        (19.004, 19.011): ("19.00", "19.01"),
        (1.0, 2.0): ("1", "2"),
        (1234.2, 1234.4): ("1234.2", "1234.4"),
        (1.0, 1.0 + 2e-16): ("1.0000000000000000", "1.0000000000000002"),
        (0.5, 0.5): ("0.5", "0.5"),
        (None, 0.5): ("", "0.5"),
    }
    assert {pair: words.format_change(*pair) for pair in pairs} == pairs
    move = Move("arm", "move", "e", "torque/joint2", "N m", "peak", 19.0000001, 19.0000004, 1e-8, 1e-9)
    assert "19.0000001 -> 19.0000004 N m" in move.words


def test_the_lines_at_the_end_are_those_of_the_report_the_gravest_first() -> None:
    """What moved or is gone says its model and how to bless it."""
    move = Move("arm", "move", "e", "torque", "N m", "peak", 1.0, 2.0, 0.5, 1e-9, "the model arm (mechanism.toml)")
    base = night(ONE, replace(ONE, quantity="tip", verdict="unjudged", message="no limit"))
    broken = CaseRow("leg", "", problem="InputError: links")
    result = replace(
        base, cases=(*base.cases, broken), moves=(move,), baseline={"gone_keys": [["a", "b", "e", "f", "tip", "m"]]}
    )
    lines = words.list_trouble_lines(result)
    assert lines == [
        "! leg model: InputError: links",
        "✗ arm/move e torque: why",
        "✗ 1 signal of 1 run moved; changed since: the model arm (mechanism.toml): "
        f"arm/move e: torque, peak 1 -> 2 N m: moved by 50 % of the range, bars 1e-09; mend the cause, or {HOW}",
        f"✗ a/b: not there any more; 1 comparison is blessed (e); bring it back, or {HOW}",
        "? arm/move e tip: no limit",
    ]


def test_of_many_troubles_the_terminal_shows_ten(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [replace(ONE, engine=f"e{k}") for k in range(12)]
    write_troubles(Console(width=40), night(*rows))
    assert capsys.readouterr().out.splitlines()[9:] == [
        "✗ arm/move e9 torque: why", "and 2 more, all of them in the report",
    ]  # fmt: skip


def test_the_mark_of_an_answer_is_not_that_of_a_limit_kept(capsys: pytest.CaptureFixture[str]) -> None:
    with open_progress(Console()) as notify:
        notify(Event("arm/move e", "ok", "", 1, 2))
        notify(Event("a study", "within", "", 2, 2))
    assert [line[0] for line in capsys.readouterr().out.splitlines() if line.strip()] == ["·", "✓"]
