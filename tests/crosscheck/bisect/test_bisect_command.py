"""`crosscheck bisect` as it is called, with pip and a folder of wheels: answer, files, one message for each wrong option."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from local_index import write_wheel

from crosscheck.cli import main
from crosscheck.output_folder import open_report_folder

FALL = "import ball\nassert ball.height() < 1.5, ball.height()\n"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two releases of a package; the second is another one."""
    folder = tmp_path_factory.mktemp("place")
    for k, value in enumerate((1.0, 2.0)):
        write_wheel(folder / "wheels", "ball", f"1.{k}", f"def height():\n    return {value}\n")
    (folder / "fall.py").write_text(FALL)
    return folder


def bisect(place: Path, *words: str, package: str = "ball") -> Result:
    options = [
        "--no-index",
        "--find-links",
        str(place / "wheels"),
        "--environments",
        str(place / "store"),
        "--installer",
        "pip",
    ]
    return CliRunner().invoke(main, ["bisect", "--package", package, *options, *words])


@pytest.mark.slow
def test_a_change_is_found_by_pip_and_written_down(place: Path) -> None:
    out = place / "answer"
    told = bisect(place, "..", "--out", str(out), "--", str(place / "fall.py"))
    assert told.exit_code == 0, told.output
    assert "ball: good up to 1.0 (exit code 0), bad from 1.1 on (AssertionError: 2.0)" in told.output
    assert "2 environments for 2 releases (at most 3 were expected), 2 made" in told.output
    answer = json.loads((out / "answer.json").read_text())
    assert [(change["before"], change["after"]) for change in answer["changes"]] == [("1.0", "1.1")]
    reproduction = out / "reproductions" / "ball-1.0-1.1"
    assert (reproduction / "pins-1.1.txt").read_text().startswith("ball==1.1 --hash=sha256:")
    assert (reproduction / "script" / "fall.py").read_text() == FALL
    assert "ball 1.1 gives another result than 1.0" in (reproduction / "issue.md").read_text()
    subprocess.run(["sh", "-n", reproduction / "reproduce.sh"], check=True)


def test_two_at_once_are_told_apart(place: Path) -> None:
    with open_report_folder(place / "busy"):
        told = subprocess_bisect(place, "..", "--out", str(place / "busy"), "--", str(place / "fall.py"))
    assert told.returncode == 2
    assert "another run writes into" in told.stderr


def subprocess_bisect(place: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [
        sys.executable,
        "-m",
        "crosscheck",
        "bisect",
        "--package",
        "ball",
        "--no-index",
        "--find-links",
        str(place / "wheels"),
    ]
    return subprocess.run([*command, *words], capture_output=True, text=True)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["..", "--", "nowhere.py"], "there is no script nowhere.py"),
        (["..", "--with", "model.xml", "--", "{fall}"], "--with model.xml: there is no such file or folder"),
        (["..", "--number", "a", "--csv", "b", "--", "{fall}"], "--number and --csv judge by other things"),
        (["..", "--changed", "--number", "a", "--", "{fall}"], "--changed judges by every byte"),
        (["..", "--bounds", "1:2", "--", "{fall}"], "--bounds judges a number or a CSV"),
        (["..", "--number", "a", "--bounds", "2:1", "--", "{fall}"], "--bounds 2:1: expected LOW:HIGH"),
        (["..", "--number", "a", "--bounds", "x:1", "--", "{fall}"], "--bounds x:1: expected LOW:HIGH"),
        (["..", "--column", "a", "--", "{fall}"], "--column chooses columns of a CSV"),
        (["..", "--verdict", "--", "{fall}"], "--verdict judges a case of ours"),
        (["..", "--engine", "mujoco", "--", "{fall}"], "write one of --engine NAME and --package NAME"),
    ],
)
def test_wrong_words_have_one_message(place: Path, words: list[str], message: str) -> None:
    told = bisect(place, *(word.format(fall=place / "fall.py") for word in words))
    assert told.exit_code == 2
    assert message in told.output
    assert "Traceback" not in told.output


def test_a_folder_of_others_is_not_written_into(place: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").touch()
    told = bisect(place, "..", "--out", str(tmp_path), "--", str(place / "fall.py"))
    assert told.exit_code == 2
    assert "holds mine.txt, which crosscheck did not write" in told.output


def test_engines_that_are_no_package_are_named() -> None:
    told = CliRunner().invoke(main, ["bisect", "--engine", "flexinv", "..", "rigid_3r"])
    assert told.exit_code == 2
    assert "expected one of mujoco, " in told.output


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["four_bar"], "four_bar has several cases: write four_bar/CASE with one of turn, "),
        (["rigid_3r/cycloyd"], "rigid_3r/cycloyd"),
        (["rigid_3r/cycloid", "--number", "a"], "a case is judged by its efforts"),
        (
            ["rigid_3r/cycloid", "--models", "nowhere"],
            "there is no folder nowhere: write --models FOLDER, or -- SCRIPT",
        ),
    ],
)
def test_cases_that_are_none_are_named(root: Path, words: list[str], message: str) -> None:
    models = [] if "--models" in words else ["--models", str(root / "models")]
    told = CliRunner().invoke(main, ["bisect", "--engine", "mujoco", "..", *words, *models])
    assert told.exit_code == 2
    assert message in told.output
