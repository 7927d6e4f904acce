"""A night: everything is run, judged against the blessed night, added to the history, and kept in a folder of its own.

Whatever goes wrong on the way is told and leaves what was there before as it was: one night at a time (a lock that the
system drops when its holder dies), the history in one transaction, ``latest`` exchanged as a whole.
"""

from __future__ import annotations

import datetime
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from crosscheck import output_folder as owned
from crosscheck.board.consensus import collect_consensus
from crosscheck.board.make import BoardWish, make_board
from crosscheck.board.pages import make_board_table, write_board
from crosscheck.checkout import open_checkout_module
from crosscheck.corpus.gather import find_all_consensus, make_panel
from crosscheck.corpus.notes import read_notes
from crosscheck.measures.record import RecordError
from crosscheck.report import change_summary, trends
from crosscheck.report.html import INDEX
from crosscheck.report.write_report import render
from crosscheck.run.run_state import RESULTS
from crosscheck.run.runner import KEPT, run
from crosscheck.run.work import Notify, Work
from crosscheck.studies import Study
from crosscheck.verdicts import baseline, changes, history
from crosscheck.verdicts import results as store
from crosscheck.verdicts.results import Results
from flexinv.errors import InputError

# [bytes] of a night at least; times its size: itself, its copy, what is written meanwhile
LEAST = 50_000_000
ROOM = 2.5
LATEST = "latest"
LOCK = "nightly.lock"
HOLDER = "nightly.json"
BOARD = "board"  # folder of cells that nights share, and that of the page in a night


class NightRunning(RuntimeError):
    """Another night is under way in the same folder of reports."""


@dataclass(frozen=True)
class NightSettings:
    """Settings of a night: its work, and the folders in which it is kept.

    reports : folder of all nights; baseline : folder of the blessed one; url : of the history
    against : "previous", or start or folder of the night to compare with; label : "" for an ordinary night
    bench : parts of the speed comparison, run after everything else; board : of releases that the night keeps, or None
    """

    work: Work
    reports: Path
    baseline: Path
    url: str
    against: str = "previous"
    label: str = ""
    command: str = ""
    bench: tuple[Study, ...] = ()
    board: BoardWish | None = None


def run_night(night: NightSettings, notify: Notify, tell: Callable[[str], None]) -> tuple[Results, Path]:
    """Run a night and return its results and its folder; what went wrong beside the engines is in ``message``.

    tell : is given one line about everything that a reader at the terminal has to know
    Raises NightRunning where one is under way, BaselineError where the blessed night cannot be read, InputError where no
    scheduler answers, no driver of the history's database is installed, or the disk has no room for a night.
    """
    night.reports.mkdir(parents=True, exist_ok=True)
    with take_reports_lock(night.reports):
        known = baseline.find(night.baseline)
        check_space(night.reports)
        database, trouble = open_history(night.url, tell)
        if database is not None:
            add_missing_nights(database, night.reports, tell)
        folder = make_night_folder(night.reports, night.label)
        if night.work.options.resume:
            take_over(night.reports, night.label, folder, tell)
        options = replace(night.work.options, baseline=known, fresh=True)
        with remove_unused_folder(folder):
            results = run(replace(night.work, options=options), folder, notify, night.command, tell)
        if night.bench and results.finished:
            results = add_speed_tables(results, night, notify)
        if night.board is not None and results.finished and night.work.plan.tasks:
            results = add_board(results, night, night.board, folder, notify, tell)
        results = add_to_history(database, night, add_failure(results, trouble), folder, tell)
        results = write_night(results, folder, None if night.label else night.reports / LATEST, database, tell)
    return results, folder


def add_speed_tables(results: Results, night: NightSettings, notify: Notify) -> Results:
    """Return the results with the tables of the speed comparison: alone on the machine, when all else has been done."""
    with TemporaryDirectory() as folder:
        parts = open_checkout_module("benchmarks.parts", "crosscheck nightly --bench")
        speed = parts.run_parts(night.bench, night.work.options.timeout, Path(folder), notify)
    tables = (*results.studies, *speed.studies)
    whole = replace(results, studies=tables, elapsed=results.elapsed + speed.elapsed)
    return whole if speed.finished else replace(add_failure(whole, speed.message), finished=False)


def add_board(
    results: Results,
    night: NightSettings,
    wish: BoardWish,
    folder: Path,
    notify: Notify,
    tell: Callable[[str], None],
) -> Results:
    """Return the results with the board of releases, judged by what the engines of this night agree on; its page is in the night.

    Cells are kept beside the nights, so that a night computes what is new.  A board that cannot be made is told.
    """
    tasks = night.work.plan.tasks
    kept = night.reports / BOARD
    try:
        notes = read_notes(tasks[0].folder.parent)
        panel = make_panel(night.work, notes, results)
        consensus = collect_consensus(find_all_consensus(night.work, panel, folder))
        with owned.open_report_folder(kept):
            board = make_board(wish, tasks, consensus, kept, notify)
        write_board(board.cells, board.releases, folder / BOARD, consensus.notes, f"../{INDEX}")
    except KeyboardInterrupt:
        words = "the board was interrupted: what was computed is kept"
    except (InputError, RecordError, OSError) as error:
        words = f"the board could not be made: {error}"
    else:
        tell(f"board: {len(board.cells)} cells, {board.computed} were computed now")
        return replace(results, studies=(*results.studies, make_board_table(board.cells, board.releases)))
    tell(words)
    return add_failure(results, words)


@contextmanager
def take_reports_lock(reports: Path) -> Iterator[None]:
    """Hold the lock of a folder of reports.  Raises NightRunning with what is known of the other night."""
    try:
        with owned.take_folder_lock(reports, LOCK, HOLDER, "a night is under way in"):
            yield
    except owned.FolderBusy as error:
        raise NightRunning(str(error)) from None


def make_night_folder(reports: Path, label: str = "") -> Path:
    """Return a new folder for a night: its date, and a number from the second on."""
    date = datetime.date.today().isoformat() + (f"-{label}" if label else "")
    names = (date if k == 1 else f"{date}-{k}" for k in range(1, 1000))
    return next(reports / name for name in names if not (reports / name).exists())


@contextmanager
def remove_unused_folder(folder: Path) -> Iterator[None]:
    """Remove the folder where a night cannot even begin (no scheduler answers), unless it holds what is to be resumed."""
    try:
        yield
    except InputError:
        owned.remove_empty_folder(folder)
        raise


def take_over(reports: Path, label: str, folder: Path, tell: Callable[[str], None]) -> None:
    """Move what the last night of the same label left that was cut short into the folder of this one; else tell."""
    left = [f for f in reports.glob(f"[0-9]*/{KEPT}") if _read_label(f.parent.name) == label]
    if not left:
        tell("nothing to resume: no night was cut short")
        return
    last = max(left, key=lambda f: f.stat().st_mtime)
    tell(f"resuming {last.parent.name}")
    owned.move(last.parent, folder, KEPT)


def _read_label(name: str) -> str:
    """Return the label in the name of a night's folder: between its date and its number."""
    return re.sub(r"-\d+$", "", name[len("2026-01-01") :]).removeprefix("-")


def check_space(reports: Path) -> None:
    """Raise InputError where the disk has no room for another night as large as the largest one that is kept."""
    nights = [folder for folder in reports.glob("[0-9]*") if folder.is_dir()]
    sizes = [sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) for folder in nights]
    needed = ROOM * max([LEAST, *sizes])
    free = shutil.disk_usage(reports).free
    if free < needed:
        raise InputError(
            f"{reports}: {free / 1e6:.0f} MB are free on its disk, a night needs {needed / 1e6:.0f} MB with its copy; remove old "
            "nights there, or write --reports with a folder elsewhere"
        )


def open_history(url: str, tell: Callable[[str], None]) -> tuple[Any, str]:
    """Return the history, or None and why it cannot be opened: that is told, and the night goes on.

    Raises InputError where it can never be opened: no driver is installed, or the address is none.
    """
    try:
        database = history.open_database(url)
        history.check_writing(database)
        return database, ""
    except history.HistorySetupError as error:
        raise InputError(str(error)) from error
    except history.HistoryError as error:
        tell(str(error))
        return None, str(error)


def add_missing_nights(database: Any, reports: Path, tell: Callable[[str], None]) -> None:
    """Add the nights whose folders are there and that the history does not know (it was locked, or the disk full)."""
    for file in sorted(reports.glob(f"[0-9]*/{RESULTS}")):
        try:
            results = store.read(file)
            if results.settings.get("night") and not history.has_night(database, results):
                label = str(results.settings["night"]["label"])
                signals = baseline.collect_signals(results, file.parent)
                history.add_night(
                    database, results, file.parent.name, label, history.list_metrics(results.studies), signals
                )
                tell(f"added {file.parent.name} to the history, which was missing there")
        except (OSError, ValueError, LookupError, TypeError, history.HistoryError) as error:
            tell(f"{file.parent.name} could not be added to the history: {error}")


def add_to_history(
    database: Any, night: NightSettings, results: Results, folder: Path, tell: Callable[[str], None]
) -> Results:
    """Add the night to the history and return the results with what changed, or with why that is not known."""
    settings = {**results.settings, "night": {"label": night.label, "folder": folder.name}}
    results = replace(results, settings=settings)
    if database is None:
        return results
    try:
        signals = baseline.collect_signals(results, folder)
        number = history.add_night(
            database, results, folder.name, night.label, history.list_metrics(results.studies), signals
        )
        before = changes.find_previous_night(database, number, night.against)
        if before is None:
            return results
        results = replace(results, changes=changes.collect_changes(database, before, number, night.work.options.scope))
        tell(change_summary.describe_changes(results.changes))
    except (history.HistoryError, RecordError) as error:
        return add_failure(results, str(error))
    except LookupError as error:
        return add_failure(results, str(error.args[0]))
    return results


def write_night(
    results: Results, folder: Path, latest: Path | None, database: Any, tell: Callable[[str], None]
) -> Results:
    """Write results, trends and pages, exchange ``latest`` for a copy of the night, and return the results; a full disk is told.

    latest : None of a night that is no ordinary one (the newest engines are not what the project stands for)
    """
    try:
        results = draw_trends(results, folder, database)
        store.write(results, folder / RESULTS)
        render(results, folder)
        if latest is not None:
            replace_latest(folder, latest)
    except OSError as error:
        tell(f"the report could not be written: {error}; {LATEST} is as it was before")
        raise
    return results


def draw_trends(results: Results, folder: Path, database: Any) -> Results:
    """Draw the trends of a history, where there is one, and return the results, with why it cannot be read."""
    if database is None:
        return results
    try:
        trends.write(database, folder)
    except history.HistoryError as error:
        return add_failure(results, str(error))
    return results


def replace_latest(folder: Path, latest: Path) -> None:
    """Make ``latest`` a copy of a folder: it is the old one or the new one, never a part.

    Raises OSError, also where it holds what crosscheck did not write.
    """
    if latest.exists() and (others := owned.list_foreign_files(latest)):
        raise FileExistsError(f"{latest} holds {others[0]}, which crosscheck did not write: move it away")
    with TemporaryDirectory(prefix=f".{latest.name}-", dir=latest.parent, ignore_cleanup_errors=True) as beside:
        new = Path(beside) / "new"
        old = Path(beside) / "old"
        shutil.copytree(folder, new, ignore=shutil.ignore_patterns(owned.LOCK, owned.HOLDER))
        if latest.exists():
            latest.rename(old)
        try:
            new.rename(latest)
        except OSError:
            old.rename(latest)
            raise


def add_failure(results: Results, words: str) -> Results:
    """Return the results with a failure of the harness, which makes their exit code 2 (without words, as they are)."""
    return replace(results, message="; ".join(filter(None, [results.message, words])))
