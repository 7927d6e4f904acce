"""A board of a case in releases that the test makes: states, trends, what is computed again, and its files."""

from __future__ import annotations

import csv
import io
import json
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from local_index import UnzippingInstaller, write_wheel
from packaging.version import Version

from crosscheck.bisect.cases import CaseScript
from crosscheck.bisect.environments import EnvironmentStore
from crosscheck.bisect.observations import Observation
from crosscheck.bisect.pythons import find_pythons
from crosscheck.bisect.releases import Release
from crosscheck.bisect.script import Script
from crosscheck.board import fill
from crosscheck.board.cells import CELLS, Cell, describe_trend, read_cells
from crosscheck.board.fill import Board
from crosscheck.board.pages import collect_moves, draw_badge, write_board
from crosscheck.board.scripts import BoardScript
from crosscheck.cli import main
from crosscheck.output_folder import make_listed_folder
from crosscheck.verdicts.plan import Task, discover

RELEASES = {
    "1.0": "FACTOR = 1.0\n",
    "1.1": "FACTOR = 1.5\n",
    "1.2": "raise ImportError('a library is gone')\n",
    "1.3": "FACTOR = 1.0\n",
}
RUN = "import mujoco\nopen('computed.csv', 'w').write(f'time,hub\\n0,0\\n1,{mujoco.FACTOR}\\n')\n"


@pytest.fixture(scope="module")
def task(root: Path) -> Task:
    return discover(root / "models", ["rigid_one_link/cycloid"]).tasks[0]


@pytest.fixture
def board(task: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Board:
    """A board whose engine gives FACTOR where 1 is expected; the cause of a deviation is not looked for."""
    monkeypatch.setattr(fill, "_find_cause", lambda *_: "a scale of 1.5")
    for version, source in RELEASES.items():
        write_wheel(tmp_path / "wheels", "mujoco", version, source)
    write_wheel(tmp_path / "wheels", "numpy", "1", "")
    (tmp_path / "run.py").write_text(RUN)
    expected = Observation("", 0, None, ("time", "hub"), np.array([[0.0, 0.0], [1.0, 1.0]]), "", "", 0.0, 0.0)
    made = CaseScript(tmp_path, Script((str(tmp_path / "run.py"),)), expected)
    other = replace(task, case=replace(task.case, name="other"))
    scripts = [
        BoardScript(task, "mujoco", "one", made),
        BoardScript(other, "mujoco", "two", None, "a loop is not exported"),
    ]
    releases = [Release(Version(version), find_pythons([])[0]) for version in RELEASES]
    store = EnvironmentStore(tmp_path / "store", UnzippingInstaller(tmp_path / "wheels"))  # type: ignore[arg-type]
    make_listed_folder(tmp_path / "out")
    return Board({"mujoco": scripts}, {"mujoco": releases}, store, tmp_path / "out", read_cells(tmp_path / "out"))


def test_cells_say_who_is_right_and_who_cannot_run(board: Board) -> None:
    cells = board.fill_cells()
    first = [cell for cell in cells if cell.key.startswith("one")]
    assert [(cell.release, cell.state) for cell in first] == [
        ("1.0", "within"), ("1.1", "outside"), ("1.2", "cannot run"), ("1.3", "within"),
    ]  # fmt: skip
    assert first[1].distance == pytest.approx(0.5)
    assert first[1].words == "a scale of 1.5"
    assert first[2].words == "ImportError: a library is gone"
    assert {cell.state for cell in cells if cell.key.startswith("two")} == {"no script"}
    assert board.count == len(cells) == 8


def test_a_second_run_computes_what_is_new(board: Board) -> None:
    cells = board.fill_cells()
    assert board.computed == 4
    again = replace(board, cells=read_cells(board.folder), computed=0)
    assert again.fill_cells() == cells
    assert again.computed == 0
    script = board.scripts["mujoco"][0]
    changed = replace(again, scripts={"mujoco": [replace(script, key="three")]})
    changed.fill_cells()
    assert changed.computed == 4


def test_cells_that_cannot_be_read_are_computed(board: Board) -> None:
    for text in ("", "{}", "[1]", '[{"mechanism": "a"}]'):
        (board.folder / CELLS).write_text(text)
        assert read_cells(board.folder) == {}


def make_cell(state: str, distance: float | None) -> Cell:
    return Cell("m", "c", "e", "1", state, distance, 1e-6, "", 0.0, "")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("before", "after", "trend"),
    [
        (("within", 1e-9), ("within", 2e-9), ""),
        (("within", 1e-9), ("within", 2e-8), "worse"),
        (("within", 1e-8), ("within", 1e-10), "better"),
        (("within", 1e-16), ("within", 1e-14), ""),  # rounding is no trend
        (("outside", 1.0), ("within", 1e-9), "better"),
        (("within", 1e-9), ("cannot run", None), "worse"),
        (("cannot run", None), ("outside", 1.0), "better"),
        (("cannot run", None), ("cannot run", None), ""),
        (("no script", None), ("within", 0.0), ""),
    ],
)
def test_trends_are_told_from_rounding(
    before: tuple[str, float | None], after: tuple[str, float | None], trend: str
) -> None:
    assert describe_trend(make_cell(*before), make_cell(*after)) == trend
    assert describe_trend(None, make_cell(*after)) == ""


def test_the_page_and_its_files_say_the_same(board: Board) -> None:
    cells = board.fill_cells()
    write_board(cells, {"mujoco": list(RELEASES)}, board.folder)
    page = (board.folder / "index.html").read_text()
    assert "a library is gone" in page
    assert "a scale of 1.5" in page
    assert "<script" not in page.split("</head>")[1] or "http" not in page.split("<script")[1][:200]
    rows = list(csv.DictReader(io.StringIO((board.folder / "board.csv").read_text())))
    plain = json.loads((board.folder / "board.json").read_text())
    assert [row["state"] for row in rows] == [one["state"] for one in plain] == [cell.state for cell in cells]
    badge = (board.folder / "badges" / "mujoco.svg").read_text()
    assert ElementTree.fromstring(badge).attrib["aria-label"] == "mujoco 1.3: 1 of 1 cases within"
    moved = [(move["before"], move["after"], move["change"]) for move in collect_moves(cells)]
    assert moved == [
        ("1.0", "1.1", "within becomes outside"),
        ("1.1", "1.2", "outside becomes cannot run"),
        ("1.2", "1.3", "cannot run becomes within"),
    ]
    twice = collect_moves([replace(cell, case=name) for name in ("a", "b") for cell in cells if cell.key[:3] == "one"])
    assert [len(move["cases"]) for move in twice] == [2, 2, 2]


def test_badges_say_when_nothing_was_judged_and_hide_no_markup() -> None:
    assert "nothing judged" in draw_badge("<e>", "1", [make_cell("cannot run", None)])
    assert "&lt;e&gt;" in draw_badge("<e>", "1", [])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--engines", "flexinv"], "no package of the index brings 'flexinv'; expected one of mujoco, "),
        (["--engines", ","], "--engines names none; write some of mujoco, "),
        (["nothing_of_the_kind"], "nothing_of_the_kind"),
        (["rigid_3r", "--engines", "mujoco", "--no-index", "--find-links", "."], "has no release of mujoco"),
    ],
)
def test_wrong_words_have_one_message(root: Path, tmp_path: Path, words: list[str], message: str) -> None:
    options = ["--models", str(root / "models"), "--out", str(tmp_path / "out"), "--installer", "pip"]
    offline = [] if "--no-index" in words else ["--no-index"]
    told = CliRunner().invoke(main, ["board", *words, *options, *offline])
    assert told.exit_code == 2
    assert message in told.output
    assert "Traceback" not in told.output
