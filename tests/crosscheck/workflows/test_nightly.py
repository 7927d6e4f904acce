"""Nights for real: two in a row, and every way in which one can go wrong.  What is sound is reported, always."""

from __future__ import annotations

import functools
import json
import os
import resource
import signal
import sqlite3
import subprocess
import sys
import time as clock
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import filelock
import pytest
import rogue_engines as rogue
from click.testing import CliRunner, Result
from crosscheck_examples import write_models
from local_index import UnzippingInstaller, write_real_wheel

from crosscheck import output_folder as owned
from crosscheck.bisect.environments import EnvironmentStore
from crosscheck.bisect.installers import Index, Installer
from crosscheck.board.make import BoardWish
from crosscheck.cli import main
from crosscheck.commands import nightly as nightly_command
from crosscheck.engines import ENGINES, Engine
from crosscheck.run.work import Options, Work
from crosscheck.verdicts import history
from crosscheck.verdicts.plan import discover
from crosscheck.verdicts.results import Results, read
from crosscheck.workflows import latest_engines as fresh
from crosscheck.workflows.night import NightSettings, add_board, replace_latest

ROOT = Path(__file__).resolve().parents[3]
REASON = ("--reason", "an example of the tests")
Invoke = Callable[..., Result]


@pytest.fixture
def reports(root: Path, tmp_path: Path) -> Path:
    """A folder of reports beside the models of an example."""
    write_models(tmp_path / "models", root)
    return tmp_path / "reports"


@pytest.fixture
def nightly(reports: Path) -> Invoke:
    def go(*words: str) -> Result:
        where = ["--models", str(reports.parent / "models"), "--reports", str(reports), "--studies", "", "--jobs", "1"]
        few = [] if "--engines" in words else ["--engines", "flexinv,pinocchio"]
        return CliRunner().invoke(main, ["nightly", *where, *few, *words])

    return go


@pytest.fixture
def rogues(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., None]:
    """Put rogue engines beside flexinv and Pinocchio."""

    def register(*kinds: str) -> None:
        sound = {name: ENGINES[name] for name in ("flexinv", "pinocchio")}
        monkeypatch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
        monkeypatch.setattr("crosscheck.doors.registry.ENGINES", sound | {k: rogue.engine(k) for k in kinds})

    return register


def folders(reports: Path) -> list[str]:
    return sorted(p.name for p in reports.iterdir() if p.is_dir() and p.name[0].isdigit())


def last(reports: Path) -> Results:
    return read(reports / "latest" / "results.json")


def known(reports: Path) -> list[history.Night]:
    return history.list_nights(history.open_database(f"sqlite:///{reports / 'history.sqlite'}"))


@pytest.mark.slow
def test_two_nights_one_blessing_and_what_changed(nightly: Invoke, reports: Path) -> None:
    first = nightly()
    assert first.exit_code == 1, first.output  # nothing is blessed yet, and every row says how
    assert {c.verdict for c in last(reports).comparisons} == {"unjudged"}
    blessed = CliRunner().invoke(
        main, ["bless", *REASON, "--from", str(reports / "latest"), "--baseline", str(reports / "baseline")]
    )
    assert blessed.exit_code == 0, blessed.output
    second = nightly()
    assert second.exit_code == 0, second.output
    date = folders(reports)[0]
    assert folders(reports) == [date, f"{date}-2"]
    assert (
        f"Since {date}: 4 deviations less, 4 comparisons moved" in second.output
    )  # a busy machine may add a slower run
    assert [(n.folder, n.exit_code) for n in known(reports)] == [(date, 1), (f"{date}-2", 0)]
    page = (reports / "latest" / "index.html").read_text()
    assert "4 deviations less" in page
    assert "an example of the tests" in page
    trend = (reports / "latest" / "trends" / "double_pendulum-swing.html").read_text()
    assert f"{date}" in trend
    assert '"fraction"' not in trend  # numbers only
    assert (
        'href="../trends/double_pendulum-swing.html"' in next((reports / "latest" / "cases").glob("*.html")).read_text()
    )


@pytest.mark.slow
def test_a_night_with_a_hang_a_crash_and_nan_is_complete_for_the_rest(
    nightly: Invoke, reports: Path, rogues: Callable[..., None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rogues("hanging", "crashing", "nan")
    # The hanging one leaves its process number in a folder, which it is told as an option.
    told = functools.partial(Options, engine={"pids": str(tmp_path)})
    monkeypatch.setattr("crosscheck.commands.shared.options.Options", told)
    done = nightly("--engines", "*", "--timeout", "8")  # a sound engine takes half a second, on a busy machine three
    assert done.exit_code == 2, done.output
    results = last(reports)
    runs = {r.engine: r for r in results.runs}
    assert runs["hanging"].message.startswith("stopped after the time limit of 8 s")
    assert runs["crashing"].message == "killed by signal 6 (SIGABRT)"
    assert "not finite" in runs["nan"].message
    sound = [c for c in results.comparisons if c.engine == "pinocchio"]
    assert len(sound) == 4
    assert all(c.fraction is not None and c.limit is not None and c.fraction <= c.limit for c in sound)
    assert len(known(reports)) == 1


@pytest.mark.slow
def test_a_locked_history_is_told_and_caught_up_by_the_next_night(
    nightly: Invoke, reports: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reports.mkdir()
    history.open_database(f"sqlite:///{reports / 'history.sqlite'}").dispose()
    other = sqlite3.connect(reports / "history.sqlite")
    other.execute("BEGIN EXCLUSIVE")
    with monkeypatch.context() as hurried:  # a busy machine may need longer to write than this
        hurried.setattr(history, "PATIENCE", 0.2)
        done = nightly()
    assert done.exit_code == 2
    assert "database is locked" in done.output
    assert "database is locked" in (reports / "latest" / "index.html").read_text()
    assert len(last(reports).comparisons) == 4
    other.rollback()
    other.close()
    assert known(reports) == []
    done = nightly()
    date = folders(reports)[0]
    assert f"added {date} to the history" in done.output
    assert [n.folder for n in known(reports)] == [date, f"{date}-2"]


WITH_PASSWORDS = pytest.mark.parametrize(
    "words",
    [
        ("--history", "postgresql://me:hush%40x@localhost/nights"),
        ("--history=postgresql://me:hush@x@localhost/nights",),
        ("--history", "postgresql://me@localhost/nights?password=hush"),
        ("--history", "nosuch://me:hush@localhost"),
        ("--history", "me:hush@localhost/nights"),
        ("--history", "postgresql://me:hush@localhost:port/nights"),
    ],
)


@WITH_PASSWORDS
def test_a_history_that_can_never_be_opened_is_said_before_the_night(
    words: tuple[str, ...], nightly: Invoke, reports: Path
) -> None:
    """No driver is installed, or the address is none: nothing runs, no folder is left, and no password is shown."""
    done = nightly(*words)
    assert done.exit_code == 2
    said = " ".join(done.output.split())
    assert "cannot open the history" in said
    assert "hush" not in said
    assert folders(reports) == []
    if "localhost/nights" in words[-1] and "postgresql" in words[-1]:
        assert "pip install 'psycopg[binary]', and begin the address with postgresql+psycopg://" in said


def test_a_night_without_room_on_its_disk_does_not_begin(
    nightly: Invoke, reports: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crosscheck.workflows.night.LEAST", 10**18)  # [bytes]
    done = nightly()
    assert done.exit_code == 2
    assert "are free on its disk, a night needs" in " ".join(done.output.split())
    assert folders(reports) == []


def test_a_history_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    history.open_database(f"sqlite:///{tmp_path / 'nights.sqlite'}").dispose()
    reading = history.open_database(f"sqlite:///file:{tmp_path / 'nights.sqlite'}?mode=ro&uri=true")
    with pytest.raises(history.HistoryError, match="attempt to write a readonly database"):
        history.check_writing(reading)
    writing = history.open_database(f"sqlite:///{tmp_path / 'nights.sqlite'}")
    history.check_writing(writing)
    assert history.list_nights(writing) == []


@WITH_PASSWORDS
def test_passwords_are_in_no_file_and_no_message(
    words: tuple[str, ...], nightly: Invoke, reports: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    absent = {name: Engine(name, "x", "no_such_package", "never") for name in ("flexinv", "pinocchio")}
    monkeypatch.setattr("crosscheck.doors.registry.ENGINES", absent)
    monkeypatch.setattr(sys, "argv", ["crosscheck", "nightly", *words])

    def fail(url: str) -> None:
        raise history.HistoryError(f"cannot open the history: {history._format_address(url)} does not answer")

    monkeypatch.setattr(history, "open_database", fail)
    done = nightly(*words)
    assert done.exit_code == 2
    assert "cannot open the history" in " ".join(done.output.split())
    assert "hush" not in done.output
    files = [f for f in reports.rglob("*") if f.is_file()]
    assert {"index.html", "results.json"} <= {f.name for f in files}
    assert [f for f in files if b"hush" in f.read_bytes()] == []
    assert "--history" in (reports / "latest" / "index.html").read_text()


def test_a_second_night_at_once_is_refused_and_harms_nothing(nightly: Invoke, reports: Path) -> None:
    reports.mkdir()
    with filelock.FileLock(reports / "nightly.lock"):
        (reports / "nightly.json").write_text(json.dumps({"process": 4711, "started": "2026-03-01T01:00:00+00:00"}))
        done = nightly()
    assert done.exit_code == 2
    assert f"a night is under way in {reports} since 2026-03-01T01:00:00+00:00 (process 4711)" in done.output
    assert folders(reports) == []
    assert not (reports / "history.sqlite").exists()


def test_a_night_without_its_cluster_leaves_no_trace(
    nightly: Invoke, reports: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crosscheck.run.cluster.CONNECT", 0.5)
    done = nightly("--scheduler", "tcp://127.0.0.1:9")
    assert done.exit_code == 2
    assert "--scheduler tcp://127.0.0.1:9: no scheduler answers there" in done.output
    assert folders(reports) == []
    assert known(reports) == []


def start(reports: Path, *words: str, **more: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "crosscheck", "nightly", "--models", str(reports.parent / "models"), "--jobs", "1"]
    command += ["--reports", str(reports), "--studies", "", "--engines", "flexinv,pinocchio", *words]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=reports.parent, env=environment, **more)  # type: ignore[call-overload,no-any-return]


@pytest.mark.slow
def test_ctrl_c_in_the_middle_leaves_a_report_a_history_that_is_whole_and_what_to_resume_from(
    nightly: Invoke, reports: Path, root: Path
) -> None:
    for name in ("a", "b", "c"):
        write_models(reports.parent / "models", root, name)
    run = start(reports, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    end = clock.monotonic() + 120.0
    # one run after the other: when the third is written, the first is known
    while clock.monotonic() < end and len(list(reports.glob("[0-9]*/series/*/*.npz"))) < 3:
        clock.sleep(0.05)
    other = nightly()  # a second night meanwhile
    assert other.exit_code == 2
    assert f"a night is under way in {reports} since" in other.output
    run.send_signal(signal.SIGINT)
    _, printed = run.communicate(timeout=60.0)
    assert run.returncode == 2, printed
    assert "interrupted before everything was run" in " ".join(printed.split())
    results = last(reports)
    states = {r.status for r in results.runs}
    assert states == {"ok", "error"}
    assert len(results.runs) == 4 * 2  # a row for everything, run or not
    (night,) = known(reports)
    assert (night.finished, night.exit_code) == (False, 2)
    with filelock.FileLock(reports / "nightly.lock").acquire(timeout=0):  # nothing is left that bars the next night
        pass
    again = nightly("--resume")
    assert f"resuming {night.folder}" in again.output
    assert [(n.folder, n.finished) for n in known(reports)] == [(night.folder, False), (f"{night.folder}-2", True)]
    took = {(r.mechanism, r.engine): r.elapsed for r in results.runs if r.status == "ok"}
    now = {(r.mechanism, r.engine): r.elapsed for r in last(reports).runs}
    assert len(now) == 4 * 2
    assert {
        place: now[place] for place in took
    } == took  # taken over: no run takes as long as another to the last digit
    assert not list(reports.glob("*/attempts"))
    assert "nothing to resume: no night was cut short" in nightly("--resume", "a").output


def small_files() -> None:
    """A disk that is nearly full: no file may grow beyond some kilobytes."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))


def test_what_somebody_put_into_the_latest_report_is_not_lost(tmp_path: Path) -> None:
    night, latest = tmp_path / "2026-01-01", tmp_path / "latest"
    for k in range(2):
        owned.make_listed_folder(night)
        owned.write(night / "index.html", f"night {k}")
        replace_latest(night, latest)
        assert (latest / "index.html").read_text() == f"night {k}"
    (latest / "notes.txt").write_text("keep me")
    with pytest.raises(FileExistsError, match=r"latest holds notes\.txt, which crosscheck did not write: move it away"):
        replace_latest(night, latest)
    assert (latest / "notes.txt").read_text() == "keep me"
    assert sorted(f.name for f in tmp_path.iterdir()) == ["2026-01-01", "latest"]


@pytest.mark.slow
def test_a_full_disk_leaves_the_last_report_and_the_history_as_they_were(nightly: Invoke, reports: Path) -> None:
    assert nightly().exit_code == 1
    before = {f: f.read_bytes() for f in (reports / "latest").rglob("*") if f.is_file()}
    known_before = known(reports)
    run = start(reports, preexec_fn=small_files)
    _, printed = run.communicate(timeout=120.0)
    assert run.returncode == 2, printed
    assert "File too large" in printed  # the database's words and those of the pages differ; one of them is there
    assert {f: f.read_bytes() for f in (reports / "latest").rglob("*") if f.is_file()} == before
    assert known(reports)[: len(known_before)] == known_before
    with closing(sqlite3.connect(reports / "history.sqlite")) as database:
        assert database.execute("pragma integrity_check").fetchone() == ("ok",)
    assert nightly().exit_code == 1  # and the next night goes on


# ------------------------------------------------------------------------------------------------------------ the board


def put_releases(wheels: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An index with two releases of pin: one that cannot be imported, and the one that is installed here."""
    write_real_wheel(wheels, "pin", "1.0", "pinocchio", "raise ImportError('a library is gone')")
    write_real_wheel(wheels, "pin", "1.1", "pinocchio")
    write_real_wheel(wheels, "numpy", "1.0", "numpy")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(wheels))
    monkeypatch.setenv("CROSSCHECK_ENVIRONMENTS", str(wheels.parent / "environments"))
    monkeypatch.setattr(nightly_command, "choose_installer", lambda *_, **__: UnzippingInstaller(wheels))


@pytest.mark.slow
def test_a_night_keeps_the_board_and_its_page(
    nightly: Invoke, reports: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_releases(tmp_path / "wheels", monkeypatch)
    first = nightly("--board", "2")
    assert "board: 2 cells, 2 were computed now" in first.output, first.output
    cells = json.loads((reports / "latest" / "board" / "board.json").read_text())
    assert [(one["release"], one["state"], one["against"]) for one in cells] == [
        ("1.0", "cannot run", ""),
        ("1.1", "within", "consensus"),
    ]
    page = (reports / "latest" / "board" / "index.html").read_text()
    assert "0 ▲</td>" in page
    assert 'href="../index.html"' in page
    assert 'href="board/index.html"' in (reports / "latest" / "index.html").read_text()
    (table,) = last(reports).studies
    assert [(row["release"], row["verdict"]) for row in table.rows] == [
        ("pinocchio 1.0", "skipped"),
        ("pinocchio 1.1", "within"),
    ]
    database = history.open_database(f"sqlite:///{reports / 'history.sqlite'}")
    (metric,) = history.read_rows(database, history.METRIC, 1)
    assert (metric["name"], metric["value"]) == ("board: cases outside in pinocchio 1.1", 0.0)
    (tmp_path / "wheels" / "pin-1.0-py3-none-any.whl").unlink()
    second = nightly("--board", "2")  # the same values: nothing is new
    assert "board: 1 cells, 0 were computed now" in second.output, second.output


def test_a_board_that_cannot_be_made_is_told_and_the_night_goes_on(reports: Path, tmp_path: Path) -> None:
    work = Work(discover(reports.parent / "models"), {"pinocchio": ENGINES["pinocchio"]})
    settings = NightSettings(work, reports, reports / "baseline", "")
    store = EnvironmentStore(tmp_path / "environments", Installer(Index(links=(str(tmp_path),), offline=True)))
    told: list[str] = []
    made = add_board(
        Results(started=""), settings, BoardWish(("pinocchio",), 1, store), tmp_path, lambda _: None, told.append
    )
    assert told == [made.message]
    assert made.message.startswith("the board could not be made: the index")
    assert "has no release of pin" in made.message
    assert (made.exit_code, made.studies) == (2, ())


def test_a_board_of_engines_that_the_night_does_not_run_is_refused(nightly: Invoke, reports: Path) -> None:
    done = nightly("--board", "2", "--engines", "flexinv,flexinv-c")
    assert done.exit_code == 2
    said = " ".join(done.output.split())
    assert "--board: the night runs none of mujoco, pinocchio, exudyn; write --engines with one of them" in said
    assert not reports.exists()


# ------------------------------------------------------------------------------------------------------ newest engines


def test_the_newest_engines_are_what_the_registry_names() -> None:
    assert fresh.list_engine_packages() == ["pin", "mujoco", "exudyn"]
    assert fresh.list_project_packages() == [f"{ROOT}[engines,robots,report,history]"]
    assert fresh.remove_flag(["nightly", "--latest-engines", "--jobs", "1"]) == ["nightly", "--jobs", "1"]


@pytest.mark.slow
def test_an_environment_that_cannot_be_filled_says_what_pip_says(
    nightly: Invoke, reports: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """pip looks into an empty folder only: no download."""
    (tmp_path / "wheels").mkdir()
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "wheels"))
    monkeypatch.setattr(fresh, "list_project_packages", lambda: ["no-such-project-here"])
    done = nightly("--latest-engines")
    assert done.exit_code == 2
    said = " ".join(done.output.split())
    assert "the newest engines could not be installed" in said
    assert "no-such-project-here" in said
    assert not (reports / ".latest-engines").exists() or not folders(reports)
