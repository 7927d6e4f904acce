"""The benchmark of motions in files runs, and its motion is one that flexinv finds true; no time is judged here."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

import flexinv
from benchmarks import torque_files


def test_the_motion_is_read_whole_and_each_part_takes_time(tmp_path: Path) -> None:
    robot = flexinv.load_mechanism(torque_files.ROBOT)
    motion = tmp_path / "motion.csv"
    torque_files.write_motion(robot, 3_000, motion)
    found = flexinv.torques(robot, motion)
    assert found.shape == (3_000, 6)
    seconds = torque_files.sample_part_seconds(robot, motion, tmp_path / "parts.csv")
    assert set(seconds) == {"read", "call", "write", "write by to_csv"}
    assert all(one > 0.0 for one in seconds.values())
    written = pd.read_csv(tmp_path / "parts.csv", header=None, nrows=3_000).to_numpy()
    assert abs(written[:, 1:] - found.to_numpy()).max() < 1e-12 * abs(found.to_numpy()).max()


@pytest.mark.slow
def test_the_benchmark_says_its_figures(capsys: pytest.CaptureFixture[str]) -> None:
    torque_files.main(3_000)
    said = capsys.readouterr().out
    assert "whole over read + call + write:" in said
    assert "MB for 3000" in said
