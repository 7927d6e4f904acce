"""A board of a case in releases that the test makes: states, trends, what is computed again, and its files."""

from __future__ import annotations

import csv
import io
import json
import sys
import threading
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from distributed import LocalCluster
from local_index import UnzippingInstaller, write_wheel
from packaging.version import Version

from crosscheck.bisect.cases import CaseScript, find_case_limit, read_case_script
from crosscheck.bisect.environments import EnvironmentStore
from crosscheck.bisect.installers import InstallerError
from crosscheck.bisect.observations import Observation
from crosscheck.bisect.pythons import find_pythons
from crosscheck.bisect.releases import Release
from crosscheck.bisect.script import Script, run_script
from crosscheck.board import consensus, fill
from crosscheck.board.cells import CELLS, Cell, describe_trend, read_cells
from crosscheck.board.consensus import (
    BoardConsensus,
    collect_consensus,
    compute_consensus_distance,
    compute_digest,
    has_own_coordinates,
    read_consensus,
)
from crosscheck.board.fill import Board, BoardWorkers
from crosscheck.board.pages import collect_moves, draw_badge, write_board
from crosscheck.board.scripts import BoardScript
from crosscheck.cli import main
from crosscheck.corpus.authors import Author
from crosscheck.corpus.consensus import CaseConsensus, EnginePanel, find_case_consensus
from crosscheck.corpus.folder import write_corpus
from crosscheck.corpus.judging import CaseBands
from crosscheck.corpus.notes import CorpusTable
from crosscheck.engines import ENGINES
from crosscheck.measures.record import Record, Series
from crosscheck.output_folder import make_listed_folder
from crosscheck.verdicts.plan import Task, discover
from crosscheck.verdicts.results import Results
from flexinv.errors import InputError

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


def write_case(folder: Path) -> CaseScript:
    """The script of a case that gives FACTOR where 1 is expected."""
    folder.mkdir()
    (folder / "run.py").write_text(RUN)
    (folder / "expected.csv").write_text("time,hub\n0,0\n1,1\n")
    return read_case_script(folder, 60.0)


@pytest.fixture
def board(task: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Board:
    """A board whose engine gives FACTOR where 1 is expected; the cause of a deviation is not looked for."""
    monkeypatch.setattr(fill, "_ask_cause", lambda *_: "a scale of 1.5")
    for version, source in RELEASES.items():
        write_wheel(tmp_path / "wheels", "mujoco", version, source)
    write_wheel(tmp_path / "wheels", "numpy", "1", "")
    made = write_case(tmp_path / "case")
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
    return Cell("m", "c", "e", "1", state, distance, 1e-6, "flexinv", "", 0.0, "")  # type: ignore[arg-type]


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
        (("cannot run", None), ("within", 1e-9), "better"),
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


def interrupt(cell: Cell, done: int, count: int) -> None:
    raise KeyboardInterrupt


def test_ctrl_c_keeps_what_was_computed_and_the_next_run_goes_on(board: Board) -> None:
    with pytest.raises(KeyboardInterrupt):
        replace(board, notify=interrupt).fill_cells()
    kept = read_cells(board.folder)
    again = replace(board, cells=dict(kept), computed=0)
    assert [cell.state for cell in again.fill_cells()].count("within") == 2
    assert again.computed == 4 - len(kept) < 4


def test_a_script_that_is_told_to_stop_ends(tmp_path: Path) -> None:
    (tmp_path / "sleep.py").write_text("import time\ntime.sleep(600)\n")
    stop = threading.Event()
    stop.set()
    with run_script(Script((str(tmp_path / "sleep.py"),)), sys.executable, stop=stop) as (end, _):
        assert end.reason == "it was stopped: the run was interrupted"


def test_a_release_that_cannot_be_installed_cannot_run_and_a_dead_index_is_no_cell(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    board.store.installer.refused["mujoco==1.1"] = "no wheel fits"  # type: ignore[attr-defined]
    cells = {cell.release: cell for cell in board.fill_cells() if cell.case != "other"}
    assert (cells["1.1"].state, cells["1.1"].words) == ("cannot run", "no wheel fits")
    assert board.computed == 3

    def fail(*_: object) -> str:
        raise InstallerError("the index cannot be reached")

    monkeypatch.setattr(UnzippingInstaller, "resolve_pins", fail)
    changed = replace(board, scripts={"mujoco": [replace(board.scripts["mujoco"][0], key="four")]})
    later = replace(changed, releases={"mujoco": [Release(Version("9"), find_pythons([])[0])]})
    with pytest.raises(InputError, match="the index cannot be reached"):
        later.fill_cells()
    assert not any(cell.release == "9" for cell in read_cells(board.folder).values())


def test_workers_of_a_cluster_give_the_same_cells(board: Board) -> None:
    """One worker in this process: what it is given is sent all the same."""
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        there = replace(board, workers=BoardWorkers(scheduler=cluster.scheduler_address, own_folder=False))
        cells = there.fill_cells()
    assert there.computed == 4
    here = replace(board, cells={}, computed=0).fill_cells()
    assert [replace(cell, seconds=0.0) for cell in cells] == [replace(cell, seconds=0.0) for cell in here]


def test_what_a_cluster_loses_is_said_and_computed_the_next_time(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("the worker died")

    with monkeypatch.context() as patch:
        patch.setattr(fill, "run_release", fail)
        cells = board.fill_cells()
    assert {cell.words for cell in cells if cell.case != "other"} == {
        "the harness failed: RuntimeError: the worker died"
    }
    assert read_cells(board.folder) == {}
    again = replace(board, lost={})
    assert again.fill_cells()[0].state == "within"


# ------------------------------------------------------------------------------------------------------------- consensus


def make_consensus(task: Task, value: float, half: float = 1e-3) -> BoardConsensus:
    """A consensus on an effort that rises from 0 to a value, for the scripts of these tests."""
    middle = Series("torque/hub", "N m", np.array([0.0, value]), np.array([half, half]))
    rows = {"torque/hub": {"range": value, "size": value}}
    bands = CaseBands("rigid_one_link-cycloid", np.array([0.0, 1.0]), rows, {"torque/hub": middle})
    return BoardConsensus({("rigid_one_link", "cycloid"): bands})


def test_the_consensus_of_a_case_judges_where_there_is_one(board: Board, task: Task) -> None:
    """The same releases: what flexinv gives is 1, what engines agree on is here 1.5."""
    assert {cell.against for cell in board.fill_cells() if cell.state == "within"} == {"flexinv"}
    judged = replace(board, consensus=make_consensus(task, 1.5), computed=0)
    cells = [cell for cell in judged.fill_cells() if cell.case != "other"]
    assert [cell.state for cell in cells] == ["outside", "within", "cannot run", "outside"]
    assert judged.computed == 4  # held against something else: not taken from before
    assert [cell.distance for cell in cells] == [pytest.approx((0.5 - 1e-3) / 1.5), 0.0, None, cells[0].distance]
    assert {cell.against for cell in cells if cell.distance is not None} == {"consensus"}
    assert replace(judged, computed=0).fill_cells()[0] == cells[0]


def test_one_line_more_than_the_limit_allows_is_outside(board: Board, task: Task) -> None:
    limit = find_case_limit(task, "mujoco")
    assert limit is not None
    for share, state in ((0.5, "within"), (3.0, "outside")):  # of which one is the floor of every bar
        agreed = make_consensus(task, 1.0 + share * limit, half=0.0)
        assert replace(board, consensus=agreed, cells={}).fill_cells()[0].state == state


@pytest.mark.parametrize(
    ("table", "names", "distance"),
    [
        ([[0.0, 0.0], [1.0, 1.0]], ("time", "hub"), 0.0),
        ([[0.0, 0.0], [1.0, 1.1]], ("time", "hub"), 0.099),
        ([[0.0, 0.0], [2.0, 1.0]], ("time", "hub"), np.inf),  # at other times
        ([[0.0, 0.0]], ("time", "hub"), np.inf),  # cut short
        ([[0.0, 0.0], [1.0, np.nan]], ("time", "hub"), np.inf),
        ([[0.0, 0.0], [1.0, 1.0]], ("time", "free 1"), np.inf),
    ],
)
def test_distances_from_a_consensus(
    task: Task, table: list[list[float]], names: tuple[str, ...], distance: float
) -> None:
    bands = make_consensus(task, 1.0).find_bands(task)
    assert bands is not None
    observation = Observation("", 0, None, names, np.array(table), "", "", 0.0, 0.0)
    assert compute_consensus_distance(bands, observation) == pytest.approx(distance, abs=1e-9)


@pytest.mark.parametrize(
    ("names", "value", "kind", "own"),
    [
        (("time", "hub"), 1.0, "revolute", False),
        (("time", "hub"), -1.0, "revolute", False),  # flexinv is outside the consensus
        (("time", "hub"), 1.0, "free", False),
        (("time", "hub"), -1.0, "free", True),  # a basis that is turned
        (("time", "pivot"), 1.0, "revolute", True),
        (("time", "hub", "pivot"), 1.0, "revolute", True),
    ],
)
def test_coordinates_of_an_engines_own_are_told_by_names_and_numbers(
    task: Task, names: tuple[str, ...], value: float, kind: str, own: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(consensus, "TURNED", ("revolute",) if kind == "free" else ())  # the hub stands for such a joint
    bands = make_consensus(task, 1.0).find_bands(task)
    assert bands is not None
    table = np.array([[0.0] * len(names), [1.0, *[value] * (len(names) - 1)]])
    expected = Observation("", 0, None, names, table, "", "", 0.0, 0.0)
    assert has_own_coordinates(task, bands, expected) is own


def test_a_cause_is_looked_for_once_where_releases_give_the_same(
    board: Board, task: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    monkeypatch.setattr(fill, "_ask_cause", lambda script, made, release, observation: asked.append(release) or release)
    cells = replace(board, consensus=make_consensus(task, 9.0)).fill_cells()
    words = {cell.release: cell.words for cell in cells if cell.state == "outside"}
    assert sorted(words) == ["1.0", "1.1", "1.3"]
    assert sorted(asked) == sorted({words["1.0"], "1.1"})  # 1.0 and 1.3 give the same
    assert words["1.3"] == words["1.0"]


def make_case_consensus(task: Task, shift: float = 0.0) -> CaseConsensus:
    """What two engines of different authors agree on, the second of them farther off."""
    records = {}
    for name, off in (("flexinv", 0.0), ("pinocchio", shift)):
        one = Series("torque/hub", "N m", np.sin(task.time) + off, np.full(task.time.size, 1e-3))
        how = {"torque/hub": {"how": {"step": "Richardson"}}}
        records[name] = Record(name, time=task.time, series={"torque/hub": one}, budget=how)
    authors = {name: Author(name) for name in records}
    engines = {name: ENGINES[name] for name in records}
    return find_case_consensus(task, records, EnginePanel(engines, authors, authors, Results(started="")))


def test_a_corpus_and_a_night_give_the_same_consensus(task: Task, tmp_path: Path) -> None:
    found = [make_case_consensus(task)]
    write_corpus(found, CorpusTable(licence="MIT"), Results(started=""), tmp_path)
    read = read_consensus(tmp_path, [task])
    assert read.notes == ()
    both = [one.find_bands(task) for one in (read, collect_consensus(found))]
    assert both[0] is not None
    assert compute_digest(both[0]) == compute_digest(both[1]) != ""


def test_cases_without_a_consensus_of_their_own_are_held_against_flexinv(task: Task, tmp_path: Path) -> None:
    """Authors disagree; the corpus has another case; the case has changed since, which is said."""
    assert collect_consensus([make_case_consensus(task, 1.0)]).cases == {}
    write_corpus([make_case_consensus(task)], CorpusTable(licence="MIT"), Results(started=""), tmp_path)
    other = replace(task, case=replace(task.case, name="other"))
    assert read_consensus(tmp_path, [other]) == BoardConsensus()
    slower = replace(task, case=replace(task.case, end=2.0 * task.case.end))
    changed = read_consensus(tmp_path, [slower])
    assert changed.cases == {}
    assert changed.notes == (
        "The corpus has a consensus on another state of rigid_one_link/cycloid: write it anew with crosscheck corpus.",
    )


# --------------------------------------------------------------------------------------------------- command and badges


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["rigid_3r", "--against", "."], "manifest.json: there is no such file, expected the manifest of a corpus"),
        (["rigid_3r", "--scheduler", "nowhere"], "--scheduler nowhere: no scheduler answers there"),
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
