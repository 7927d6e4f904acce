"""The list of what is not right names each thing once, and so that a reader knows which it is."""

from __future__ import annotations

from dataclasses import replace

from crosscheck.report import words
from crosscheck.verdicts.baseline import HOW, UNBLESSED
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.results import CaseRow, Results, RunRow

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


def test_a_quantity_in_several_units_is_told_with_its_unit() -> None:
    rows = [replace(ONE, quantity="wrench", unit=unit) for unit in ("N", "N m")]
    troubles = words.list_troubles(night(*rows, ONE))
    assert [what for _, _, what, _ in troubles] == ["e wrench [N]", "e wrench [N m]", "e torque"]
