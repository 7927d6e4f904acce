"""The recipes for GitHub, as written: their commands run on what `crosscheck init` writes, with two engines of one's own."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest
import yaml
from click.testing import CliRunner

from crosscheck.cli import main
from crosscheck.verdicts.results import read
from crosscheck.workflows.skeleton import write

RECIPES = ("nightly", "pull-request", "same-robot")
# A program that is no Python: it answers every kit with the folder that an earlier run of another program wrote.
PROGRAM = """#!/bin/sh
cp "$(dirname "$0")"/answer/* "$2"
"""
SETTINGS = """
[engines.shell]
command = ["sh", "tools/answer.sh", "{kit}", "{out}"]

[[engines.shell.limits]]
quantity = "torque"
maximum = 1e-9
reason = "it copies what a closed formula gave"
"""
ROBOT = """<robot name="arm"><link name="base"/><link name="rod"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>
"""


def list_commands(recipe: Path) -> list[str]:
    """Return what the steps of a recipe run, but for the installation."""
    plain = yaml.safe_load(recipe.read_text())
    steps = [step for job in plain["jobs"].values() for step in job["steps"]]
    return [step["run"] for step in steps if "run" in step and step.get("name") != "Install"]


@pytest.fixture
def team(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository with an engine in Python and one that is a shell script, which nobody has trusted."""
    folder = tmp_path / "team"
    write(folder)
    monkeypatch.chdir(folder)
    assert CliRunner().invoke(main, ["kit", "double_pendulum", "--case", "swing", "--out", "kit"]).exit_code == 0
    program = root / "tests" / "shared" / "kit_programs" / "rigid.py"
    (folder / "tools").mkdir()
    subprocess.run([sys.executable, str(program), "kit", "tools/answer"], check=True)
    (folder / "tools" / "answer.sh").write_text(PROGRAM)
    with (folder / "crosscheck.toml").open("a") as file:
        file.write(SETTINGS)
    (folder / "robots").mkdir()
    (folder / "robots" / "arm.urdf").write_text(ROBOT)
    for words in (["init", "-q"], ["add", "-A"], ["commit", "-q", "-m", "all"], ["branch", "-f", "main"]):
        own = ["-c", "user.name=team", "-c", "user.email=team@example.org"]
        subprocess.run(["git", *own, *words], check=True)
    subprocess.run(["git", "update-ref", "refs/remotes/origin/main", "HEAD"], check=True)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("name", RECIPES)
def test_the_commands_of_a_recipe_run_as_written(name: str, root: Path, team: Path, tmp_path: Path) -> None:
    commands = list_commands(root / "docs" / "workflows" / f"{name}.yml")
    assert commands
    own = {
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
        "PYTHONPATH": str(root),
        "CI": "true",
        "XDG_CONFIG_HOME": str(tmp_path / "config"),
        "GITHUB_BASE_REF": "main",
        "ROBOT": "robots/arm.urdf",
        "OMP_NUM_THREADS": "1",
    }
    for command in commands:
        done = subprocess.run(
            ["bash", "-e", "-c", command],
            cwd=team,
            env={**os.environ, **own},
            capture_output=True,
            text=True,
            timeout=600,
        )
        said = done.stdout + done.stderr
        # A night without a blessed one before it is unjudged, which is exit code 1 in every project.
        expected = 1 if "nightly" in command else 0
        assert done.returncode == expected, said
        assert "Traceback" not in said
        if "nightly" in command:
            assert "is not blessed yet" in said or "are not blessed yet" in said
    if name != "same-robot":
        report = {"nightly": "reports/latest", "pull-request": "reports/pull-request"}[name]
        ran = {row.engine: row.status for row in read(team / report / "results.json").runs}
        assert (ran["mine"], ran["shell"]) == ("ok", "ok")
    if name == "pull-request":
        junit = (team / "reports" / "pytest.xml").read_text()
        assert "mine" in junit
        assert "shell" in junit


def test_recipes_leave_out_no_language() -> None:
    """A change of an engine in C is a change: what is ignored are words alone."""
    text = (Path(__file__).resolve().parents[3] / "docs" / "workflows" / "pull-request.yml").read_text()
    events = yaml.safe_load(text)[True]["pull_request"]  # YAML reads the word on as True
    assert events == {"paths-ignore": ["docs/**", "**.md"]}


def test_the_command_of_the_board_is_understood(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It installs releases from an index, which tests have not: its words are read, and it is not run."""
    (command,) = list_commands(root / "docs" / "workflows" / "board.yml")
    (tmp_path / "models").mkdir()
    monkeypatch.chdir(tmp_path)
    program, name, *words = shlex.split(command.partition("||")[0])
    assert program == "crosscheck"
    known = main.get_command(click.Context(main), name)
    assert known is not None
    assert known.make_context(name, words).params["count"] == 5
