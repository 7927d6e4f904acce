"""The ladder in a report: what an engine of the project states of itself explains a rung, and nothing else does."""

from __future__ import annotations

import pytest

from crosscheck.conform import study
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.results import CaseRow, Results, RunRow

SOFT = "closures are soft"


def climbed(engine: str, message: str, verdict: str) -> Results:
    """One rung of an engine: what its run says of itself, and what became of its torque."""
    torque = Comparison("loop", "turn", engine, "flexinv", "torque", "N m", verdict, "off", 1.0, scale=1.0, limit=1e-5)  # type: ignore[arg-type]
    run = RunRow("loop", "turn", engine, "ok", message)
    return Results("now", finished=True, cases=(CaseRow("loop", "turn"),), runs=(run,), comparisons=(torque,))


@pytest.mark.parametrize(
    ("engine", "message", "verdict", "expected"),
    [
        ("mujoco-equality", SOFT, "deviation", "skipped"),
        ("mujoco-equality", "", "deviation", "deviation"),  # it does not say why
        ("mujoco", SOFT, "deviation", "deviation"),  # nothing of its method is known to differ
        ("somebodys", SOFT, "deviation", "deviation"),  # others do not judge themselves
        ("mujoco-equality", SOFT, "error", "error"),
        ("mujoco", "", "within", "within"),
    ],
)
def test_who_explains_a_rung(engine: str, message: str, verdict: str, expected: str) -> None:
    tables = study.make_tables(climbed(engine, message, verdict), (engine,))
    (row,), ((rung,),) = tables["rows"], [table["rows"] for table in tables["tables"]]
    assert rung["verdict"] == expected
    assert row["verdict"] == expected
    assert row["holds"] == f"{int(verdict == 'within')} of 1"


def test_without_engines_there_is_no_table() -> None:
    assert study.make_tables(climbed("mujoco", "", "within"), ())["status"] == "skipped"
