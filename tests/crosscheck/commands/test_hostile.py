"""Hostile files and answers end in words, within their limits, and leave nothing: a share of `campaigns/hostile.py`."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path

import hostile
import pytest
from hostile_files import MAKERS

# One of each kind: no regular file, XML, a chain, an include, a mesh, a log; each command once.
FILES = (
    ("pipe", "lint"),
    ("pipe_in_folder", "run"),
    ("deep_urdf", "info"),
    ("includes_pipe", "compare"),
    ("attaches_itself", "readers"),
    ("stl_promise", "lint"),
    ("log_pipe", "identify"),
)
ANSWERS = (
    "huge",
    "returns",
    "link_circle",
    "leave_session",
    "kill_group",
    "odd_status",
    "unsupported_of_numbers",
    "deep_folders",
)


def rows() -> Iterator[dict[str, str]]:
    for row in hostile.read_table("files.csv"):
        if (row["file"], row["command"]) in FILES:
            yield row


def test_every_maker_has_its_line() -> None:
    files = hostile.read_table("files.csv")
    assert {row["file"] for row in files} == set(MAKERS)
    assert len(files) >= 100
    assert len(hostile.read_table("answers.csv")) >= 100
    assert {(row["file"], row["command"]) for row in rows()} == set(FILES)


@pytest.mark.parametrize("row", list(rows()), ids=lambda row: f"{row['file']}-{row['command']}")
def test_a_hostile_file_ends_in_words(row: dict[str, str]) -> None:
    if row["command"] in ("compare", "readers") and importlib.util.find_spec("mujoco") is None:
        pytest.skip("mujoco is not installed (python -m pip install mujoco)")
    assert hostile.judge_file(row, hostile.run_file(row)) == ""


@pytest.mark.slow
def test_hostile_answers_are_rows(tmp_path: Path) -> None:
    some = [
        row["id"] for row in hostile.read_table("answers.csv") if row["kind"] in ANSWERS and row["door"] != "record"
    ]
    assert len(some) == len(ANSWERS)
    assert hostile.run_answers(tuple(some), None, tmp_path) == 0


def test_a_wrong_end_is_told() -> None:
    row = {"code": "2", "words": "a named pipe"}
    good = hostile.CommandEnd(2, "Error: a named │ pipe", (), 1.0)
    assert hostile.judge_file(row, good) == ""
    for ended, words in (
        (hostile.CommandEnd(None, "", (), 300.0), "it hangs"),
        (hostile.CommandEnd(2, f"{hostile.TRACEBACK}\na named pipe", (), 1.0), "a traceback"),
        (hostile.CommandEnd(2, "a named pipe", ("sleep 3000",), 1.0), "it left sleep"),
        (hostile.CommandEnd(0, "a named pipe", (), 1.0), "exit code 0, expected 2"),
        (hostile.CommandEnd(2, "no such file", (), 1.0), "other words"),
    ):
        assert hostile.judge_file(row, ended).startswith(words)
