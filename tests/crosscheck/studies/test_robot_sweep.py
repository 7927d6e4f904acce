"""The table of real robots: flexinv equals Pinocchio and MuJoCo on all, refusals are words, bolt has a cause."""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path

import numpy as np
import pytest
from rigid_trees import footed, urdf

from crosscheck.engines.mujoco import fuse as mujoco_fuse
from crosscheck.studies import robot_sweep as robots
from crosscheck.studies.robot_sweep import (
    LARGEST_ERROR,
    RobotRow,
    build_robot_table,
    list_bases,
    list_robot_names,
    make_robot_row,
    sample_states,
)
from flexinv.files.from_urdf import from_urdf

BOLT = "bolt_description/robots/bolt.urdf"


@pytest.fixture(scope="module")
def table() -> list[RobotRow]:
    return build_robot_table()


def test_every_robot_that_pinocchio_loads(table: list[RobotRow]) -> None:
    """68 of 69 files (example-robot-data 6.0.0); the other one is a stub without links."""
    assert len(list_robot_names()) == 69
    assert {row.name for row in table} == set(list_robot_names())
    refused = {row.name: row.words for row in table if row.words}
    assert list(refused) == ["ur_description/urdf/ur3.urdf"]
    assert "without links" in refused["ur_description/urdf/ur3.urdf"]
    assert {row.name for row in table if row.empty} == set(refused)
    errors = [row.pinocchio for row in table if not row.words]
    assert len({row.name for row in table if row.pinocchio is not None}) == 68
    assert all(error is not None and error <= LARGEST_ERROR for error in errors)


@pytest.mark.parametrize(
    ("text", "empty"),
    [
        ("<robot/>", True),
        ('<robot name="a"><link name="one"><inertial/></link></robot>', False),
        ("<robot>", False),
        ("", False),
    ],
)
def test_only_a_sound_file_without_links_is_empty(text: str, empty: bool, tmp_path: Path) -> None:
    """What is broken, or has a link that cannot be read, is an error of the table and not skipped."""
    (tmp_path / "a.urdf").write_text(text)
    row = make_robot_row(tmp_path / "a.urdf", "a.urdf")
    assert row.words
    assert row.empty is empty


def test_every_robot_that_mujoco_loads(table: list[RobotRow]) -> None:
    """Each row has MuJoCo's error or its words; errors beyond rounding have a cause, and are gone without it."""
    for row in table:
        assert (row.mujoco is None) == bool(row.words or row.mujoco_words)
        if row.mujoco is not None and row.mujoco > LARGEST_ERROR:
            assert row.cause
            assert row.repaired is not None
            assert row.repaired <= LARGEST_ERROR
    assert len({row.name for row in table if row.mujoco is not None}) == 47
    assert any("A + B >= C" in row.mujoco_words for row in table)


def test_bolt_is_explained(table: list[RobotRow]) -> None:
    row = next(row for row in table if row.name == BOLT and row.base == "fixed")
    assert row.mujoco is not None
    assert row.mujoco > 1e-6
    assert "FL_FOOT" in row.cause
    assert "FR_FOOT" in row.cause
    assert [r.name for r in table if r.cause] == [BOLT, BOLT]


def test_mimic_joints_are_reported(table: list[RobotRow]) -> None:
    gripper = next(row for row in table if row.name.endswith("talos_left_arm.urdf"))
    assert len(gripper.mimic) == 6
    assert gripper.mimic[0] == "gripper_left_inner_double_joint"


def test_the_table_is_json(table: list[RobotRow]) -> None:
    text = json.dumps([dataclasses.asdict(row) for row in table], allow_nan=False)
    assert BOLT in text
    assert str(Path(robots.find_robots_folder())) not in text


def test_walkers_have_a_free_base() -> None:
    assert list_bases("talos_data/robots/talos_full_v2.urdf") == ("fixed", "free")
    assert list_bases("talos_data/robots/talos_left_arm.urdf") == ("fixed",)
    assert list_bases("ur_description/urdf/ur5_robot.urdf") == ("fixed",)
    assert [row.base for row in build_robot_table(["hector_description/robots/quadrotor_base.urdf"])] == ["free"]


# --------------------------------------------------------------------------------------------- the table can fail


def test_a_wrong_inertia_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """flexinv computes with a rounded number in one link: far beyond the limit, in both columns."""
    path = urdf(tmp_path)
    monkeypatch.setattr(robots, "joint_torques", lambda m, *state, **k: TORQUES(m, *state, **k) * (1 + 1e-9))
    row = make_robot_row(path, "robot")
    assert row.pinocchio is not None
    assert row.pinocchio > LARGEST_ERROR
    assert row.mujoco is not None
    assert row.mujoco > LARGEST_ERROR
    assert row.cause == ""  # nothing that fusing lost explains it
    assert row.repaired is not None
    assert row.repaired > LARGEST_ERROR


TORQUES = robots.joint_torques


def test_a_foot_without_mass_is_named(tmp_path: Path) -> None:
    footed(tmp_path, 0.0)
    row = make_robot_row(tmp_path / "robot.urdf", "robot")
    assert "tool (0.025 kg m^2) in hand" in row.cause
    footed(tmp_path, 0.5)
    row = make_robot_row(tmp_path / "robot.urdf", "robot")
    assert row.cause == ""
    assert row.mujoco is not None
    assert row.mujoco <= LARGEST_ERROR


def test_no_cause_without_evidence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The difference goes away without fusing, but the inertias do not say why: then nothing is claimed."""
    footed(tmp_path, 0.0)
    monkeypatch.setattr(mujoco_fuse, "list_losses", lambda mechanism: ())
    row = make_robot_row(tmp_path / "robot.urdf", "robot")
    assert row.cause == ""
    assert row.mujoco is not None
    assert row.mujoco > LARGEST_ERROR


def test_nothing_reaches_the_console(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Pinocchio's parser writes to stderr from C++; its words are in the row instead."""
    path = urdf(tmp_path)
    path.write_text(path.read_text().replace('<limit effort="9" velocity="9" lower="-9" upper="9"/>', ""))
    os.write(2, b"before|")
    row = make_robot_row(path, "odd")
    os.write(2, b"after")
    assert capfd.readouterr() == ("", "before|after")
    assert "does not specify limits" in row.words
    assert str(tmp_path) not in row.words


def test_states_cover_what_they_say() -> None:
    mechanism = from_urdf(
        robots.find_robots_folder() / "double_pendulum_description/urdf/double_pendulum_continuous.urdf"
    )
    q, qd, qdd = sample_states(mechanism, 1000, np.random.default_rng(0))
    np.testing.assert_allclose(q[:, 0] ** 2 + q[:, 1] ** 2, 1.0, rtol=0, atol=1e-15)
    assert np.abs(np.arctan2(q[:, 1], q[:, 0])).max() > 3.1
    assert qd.shape == qdd.shape == (1000, 2)
