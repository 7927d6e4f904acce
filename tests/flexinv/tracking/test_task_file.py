"""Tasks of an end effector in cases.toml: what they say, and what is answered where they are wrong."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from flexinv import InputError, load_mechanism
from flexinv.cli.commands import app
from flexinv.model.mechanism import Attachment
from flexinv.tracking.task_file import load_tasks

TASK = """
source = "a test"
[cases]
[tasks.one]
frame = "link2"
duration_s = 0.2
arc = { from_m = [0.3, 0, 0], centre_m = [0.2, 0, 0], angle_deg = 90 }
step_s = 1e-3
"""


def tasks_of(root: Path, tmp_path: Path, text: str, model: str = "flex_two_link") -> dict:  # type: ignore[type-arg]
    file = tmp_path / "cases.toml"
    file.write_text(text)
    return load_tasks(file, load_mechanism(root / "models" / model))


def test_the_page_of_the_models_is_right(root: Path, tmp_path: Path) -> None:
    page = (root / "models" / "README.md").read_text()
    (block,) = re.findall(r"^(\[tasks\.arc\].*?)```", page, re.M | re.S)
    task = tasks_of(root, tmp_path, f'source = "the page"\n[cases]\n{block}')["arc"]
    quarter = 0.1 * np.pi / 2
    assert task.frame == "link2"
    assert task.path.length == pytest.approx(quarter, rel=1e-6)  # of a polygon of 2000 sides
    assert task.start["joint1"] == pytest.approx([-0.5])
    at = task.path.evaluate([0.0, task.path.duration])
    assert at.x == pytest.approx(np.array([[0.3, 0, 0], [0.2, 0.1, 0]]), abs=1e-15)
    assert at.rotation is not None
    assert at.rotation[1, :, 0] == pytest.approx([0, 1, 0], abs=1e-15)


def test_a_point_of_a_section(root: Path, tmp_path: Path) -> None:
    task = tasks_of(root, tmp_path, TASK + "station = 0.5\nat_m = [0, 0.01, 0]\n")["one"]
    assert isinstance(task.frame, Attachment)
    assert task.frame.station == 0.5
    assert task.frame.placement.position == pytest.approx([0, 0.01, 0])


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('frame = "link2"', 'frame = "lnik2"', 'write:    frame = "link2"'),
        ("duration_s = 0.2", 'duration_s = 0.2\nlaw = "bang-bang"', "without jumps of the acceleration"),
        ("step_s = 1e-3", "step_s = 1e-3\npoints_m = [[0, 0, 0], [1, 0, 0]]", "given:    arc and points_m"),
        ("arc = {", "# arc = {", "given:    no path"),
        ("centre_m = [0.2, 0, 0]", "centre_m = [0.3, 0, 0]", "a start that is not on the axis"),
        ("step_s = 1e-3", "step_s = 1e-3\nstart = { joint3 = { rad = 1 } }", "joint2 instead of joint3|joint1 instead"),
        ("step_s = 1e-3", "step_ms = 1", "step_s"),
    ],
)
def test_what_is_wrong_is_answered(root: Path, tmp_path: Path, before: str, after: str, words: str) -> None:
    assert before in TASK
    with pytest.raises(InputError, match=words) as caught:
        tasks_of(root, tmp_path, TASK.replace(before, after))
    assert "tasks.one" in str(caught.value)


def test_closed_loops_are_refused(root: Path, tmp_path: Path) -> None:
    link = load_mechanism(root / "models" / "four_bar").links[-1].name
    with pytest.raises(InputError, match="not followed by closed loops"):
        tasks_of(root, tmp_path, TASK.replace("link2", link), "four_bar")


def test_a_station_of_a_rigid_link_is_refused(root: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no station: link2 is rigid"):
        tasks_of(root, tmp_path, TASK + "station = 0.5\n", "rigid_3r")


def test_the_command_writes_torques(root: Path, tmp_path: Path) -> None:
    out = tmp_path / "torque.csv"
    result = CliRunner().invoke(app, ["follow", str(root / "models" / "rigid_3r"), "--out", str(out), "--step", "5e-3"])
    assert result.exit_code == 0, result.output
    assert "stable inversion" in result.output
    assert "torque joint3 [N m]" in out.read_text().splitlines()[0].split(",")


def test_the_command_names_the_tasks_there_are(root: Path) -> None:
    result = CliRunner().invoke(app, ["follow", str(root / "models" / "rigid_3r"), "--task", "lin"])
    assert "no task 'lin'; tasks there: line" in str(result.exception)
