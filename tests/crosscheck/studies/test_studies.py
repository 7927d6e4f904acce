"""The studies that a report carries: their tables, and the verdicts that they would give if things were wrong."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import logged_arm
import numpy as np
import pytest

from crosscheck.studies import STUDIES, identifications, incremental, robots, switching
from crosscheck.studies.robot_sweep import LARGEST_ERROR, RobotRow
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.kinematics import nodal_motion as differences
from flexinv.model.mechanism import Mechanism

ROBOT = RobotRow("arm_description/urdf/arm.urdf", "fixed", 6, 6, 10.0, (), 50.0, 1e-15, 1e-15)


@pytest.fixture(scope="module")
def table(root: Path) -> dict[str, Any]:
    return incremental.run_study(str(root / "models"))


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
    rows = incremental.run_study(str(root / "models"))["rows"]
    assert rows[-1]["verdict"] == "deviation"
    assert "expected 3" in rows[-1]["message"]


def test_the_columns_are_those_of_the_rows(table: dict[str, Any]) -> None:
    keys = {key for key, _, _ in table["columns"]}
    assert keys <= set(table["rows"][0])
    assert {table["plot"][axis] for axis in ("x", "y", "group")} <= keys


def test_without_its_model_a_study_is_skipped(tmp_path: Path) -> None:
    answer = incremental.run_study(str(tmp_path))
    assert answer["status"] == "skipped"
    assert "rigid_3r" in answer["message"]


def test_observed_order() -> None:
    assert incremental.compute_observed_order((10, 4e-2), (20, 1e-2)) == pytest.approx(2.0)


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
        ({"empty": True, "pinocchio": None, "words": "no links"}, "skipped"),
    ],
)
def test_verdicts_of_robots(change: dict[str, Any], verdict: str) -> None:
    row = replace(ROBOT, **change)
    assert robots.judge_robot(row) == verdict
    if not np.isnan(row.pinocchio or 0.0):
        line = robots.make_table_row(row)
        assert line["verdict"] == verdict
        assert row.mujoco_words in line["message"]


def test_one_robot_in_all_engines() -> None:
    pytest.importorskip("pinocchio")
    from crosscheck.studies.robot_sweep import build_robot_table

    line = robots.make_table_row(build_robot_table(["ur_description/urdf/ur5_robot.urdf"], samples=2)[0])
    assert line["robot"] == "ur/ur5_robot"
    assert line["verdict"] == "within"


def test_every_study_names_a_function_that_is_there() -> None:
    for one in STUDIES.values():
        assert callable(getattr(importlib.import_module(one.module), one.function))


# ------------------------------------------------------------------------------- phases against separate mechanisms


def carried(root: Path) -> tuple[Mechanism, Case]:
    mechanism = load_mechanism(root / "models" / "two_arms")
    return mechanism, load_cases(root / "models" / "two_arms", mechanism)["carry"]


def test_separate_mechanisms_are_other_mechanisms(root: Path) -> None:
    """Two open arms without the bar, then a closed mechanism that is given as many joints as it has freedoms."""
    reach, carry, back = switching.split_phases(*carried(root))
    for part in (reach, back):
        assert not part.mechanism.closures
        assert "bar" not in part.mechanism.link_of
        assert switching.describe(part) == "open tree"
    assert [c.name for c in carry.mechanism.closures] == ["left", "right"]
    assert not any(c.active for c in carry.mechanism.closures)
    assert len(carry.case.motion.joints(carry.mechanism)) == 3
    assert all(part.at_rest for part in (reach, carry, back))


@pytest.mark.parametrize(
    "engine", ["pinocchio", *(pytest.param(e, marks=pytest.mark.slow) for e in ("flexinv", "mujoco"))]
)
def test_phases_equal_their_separate_mechanisms(root: Path, engine: str) -> None:
    """The issue's bound of 1e-9."""
    parts = switching.split_phases(*carried(root))
    rows = list(switching.list_engine_rows(engine, *carried(root), parts, switching.BOUNDS[engine]))
    assert [row["closures"] for row in rows] == ["lies", "left, right", "lies_again"]
    assert all(row["verdict"] == "within" and row["error"] <= 1e-9 for row in rows)
    assert {key for key, _, _ in switching.COLUMNS} <= set(rows[0])


@pytest.mark.slow
def test_another_bar_is_a_deviation_of_the_closed_phase(root: Path) -> None:
    mechanism, case = carried(root)
    links = [replace(x, bodies=(replace(b, inertia=b.inertia.replace_unchecked(mass=4.001)),)) if x.name == "bar" else x
             for x in mechanism.links for b in x.bodies[:1] or (None,)]  # fmt: skip
    parts = switching.split_phases(replace(mechanism, links=tuple(links)), case)
    rows = list(switching.list_engine_rows("pinocchio", mechanism, case, parts, 1e-9))
    assert [row["verdict"] for row in rows] == ["within", "deviation", "within"]


def test_without_switched_closures_the_study_is_skipped(tmp_path: Path) -> None:
    assert switching.run_study(str(tmp_path))["status"] == "skipped"


def test_a_night_identifies_and_judges_logs_of_machines(tmp_path: Path) -> None:
    """By another log, and by blocks in turn; limits decide, a log that is not there is an error of that row alone."""
    judges = {"held": 'hold_out = ["two.csv"]', "parts": "blocks = 4", "lost": 'hold_out = ["three.csv"]', "none": ""}
    for name, judge in judges.items():
        base = logged_arm.write_arm(tmp_path / name)
        night = (
            f'[night]\nlog = ["one.csv"]\n{judge}\n[[night.limits]]\nchannel = ["*/elbow"]\nexplained = 0.99999999\n'
        )
        text = (base / "identify.toml").read_text()
        window = "window_s = [0.5, 3.5]\n" if name == "parts" else ""
        (base / "identify.toml").write_text(window + text + night if judge else text)
        for seed, log in enumerate(("one", "two")):
            logged_arm.frame(base, seed).to_csv(base / f"{log}.csv", index=False)
    rows = identifications.run_study(str(tmp_path))["rows"]
    told = {(row["mechanism"], row.get("channel")): row for row in rows}
    json.dumps(rows, allow_nan=False)  # as a night hands them over: a window leaves samples that nothing predicts
    for name in ("held", "parts"):
        assert told[name, "torque/shoulder"]["verdict"] == "skipped"  # it has no limit
        assert told[name, "torque/elbow"]["verdict"] == "deviation"
        assert told[name, "torque/elbow"]["explained"] > 0.999
    assert told["lost", None]["verdict"] == "error"
    assert "no such file" in told["lost", None]["message"]
    assert not any(row["mechanism"] == "none" for row in rows)


def test_models_without_logs_are_skipped(tmp_path: Path) -> None:
    assert identifications.run_study(str(tmp_path))["status"] == "skipped"
