"""The studies that a report carries: their tables, and the verdicts that they would give if things were wrong."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crosscheck.robots import LARGEST_ERROR, RobotRow
from crosscheck.studies import STUDIES, incremental, robots
from flexinv import differences

ROBOT = RobotRow("arm_description/urdf/arm.urdf", "fixed", 6, 6, 10.0, (), 50.0, 1e-15, 1e-15)


@pytest.fixture(scope="module")
def table(root: Path) -> dict[str, Any]:
    return incremental.study(str(root / "models"))


def test_the_incremental_mode_falls_at_the_order_of_its_formula(table: dict[str, Any]) -> None:
    for law in ("cycloid", "quintic"):
        rows = [row for row in table["rows"] if row["law"] == law]
        assert [row["steps"] for row in rows][:4] == [10, 20, 50, 100]  # the paper's
        assert all(row["verdict"] == "within" for row in rows)
        assert all(a["error"] > b["error"] for a, b in pairwise(rows))
        # The study's own slack, SLACK, has its reason there.
        assert rows[-1]["order"] == pytest.approx(differences.ORDER, abs=incremental.SLACK)


def test_another_order_is_a_deviation(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(incremental, "ORDER", 3)
    rows = incremental.study(str(root / "models"))["rows"]
    assert rows[-1]["verdict"] == "deviation"
    assert "expected 3" in rows[-1]["message"]


def test_the_columns_are_those_of_the_rows(table: dict[str, Any]) -> None:
    keys = {key for key, _, _ in table["columns"]}
    assert keys <= set(table["rows"][0])
    assert {table["plot"][axis] for axis in ("x", "y", "group")} <= keys


def test_without_its_model_a_study_is_skipped(tmp_path: Path) -> None:
    answer = incremental.study(str(tmp_path))
    assert answer["status"] == "skipped"
    assert "rigid_3r" in answer["message"]


def test_observed_order() -> None:
    assert incremental.observed_order((10, 4e-2), (20, 1e-2)) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("change", "verdict"),
    [
        ({}, "within"),
        ({"pinocchio": 2 * LARGEST_ERROR}, "deviation"),
        ({"mujoco": 2 * LARGEST_ERROR}, "deviation"),
        ({"mujoco": 1e-5, "cause": "a fused link", "repaired": 1e-15}, "within"),
        ({"mujoco": 1e-5, "cause": "a fused link", "repaired": 1e-6}, "deviation"),
        ({"mujoco": 1e-5, "cause": "", "repaired": 1e-15}, "deviation"),
        ({"mujoco": None, "mujoco_words": "mass and inertia must be larger than mjMINVAL"}, "within"),
        ({"pinocchio": float("nan")}, "deviation"),
        ({"pinocchio": None, "words": "no such joint"}, "error"),
        ({"name": next(iter(robots.EMPTY)), "pinocchio": None, "words": "no links"}, "skipped"),
    ],
)
def test_verdicts_of_robots(change: dict[str, Any], verdict: str) -> None:
    row = replace(ROBOT, **change)
    assert robots.verdict(row) == verdict
    if not np.isnan(row.pinocchio or 0.0):
        line = robots.table_row(row)
        assert line["verdict"] == verdict
        assert row.mujoco_words in line["message"]


def test_one_robot_in_all_engines() -> None:
    pytest.importorskip("pinocchio")
    from crosscheck.robots import robot_table

    line = robots.table_row(robot_table(["ur_description/urdf/ur5_robot.urdf"], samples=2)[0])
    assert line["robot"] == "ur/ur5_robot"
    assert line["verdict"] == "within"


def test_every_study_names_a_function_that_is_there() -> None:
    modules = {"crosscheck.studies.robots": robots, "crosscheck.studies.incremental": incremental}
    for one in STUDIES.values():
        assert callable(getattr(modules[one.module], one.function))
