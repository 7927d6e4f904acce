"""``crosscheck nightly``: everything, kept and compared with the nights before."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import click
from rich.markup import escape

from crosscheck.bisect.environments import EnvironmentStore, find_store_folder
from crosscheck.bisect.installers import Index, choose_installer
from crosscheck.board.fill import BoardWorkers
from crosscheck.board.make import USUAL, BoardWish, choose_engines
from crosscheck.checkout import open_checkout_module
from crosscheck.commands.shared.options import RunSelection, add_run_options, collect_engines
from crosscheck.commands.shared.terminal import (
    FOLDER,
    Console,
    Failure,
    convert_sigterm,
    match_engines,
    open_progress,
    write_troubles,
)
from crosscheck.engines import describe_missing_package
from crosscheck.report.words import describe_run
from crosscheck.secrets import format_command_line
from crosscheck.studies import Study
from crosscheck.verdicts.baseline import BaselineError
from crosscheck.verdicts.history import HistoryError
from crosscheck.workflows import latest_engines as fresh
from crosscheck.workflows.night import NightRunning, NightSettings, run_night
from flexinv.errors import InputError


@click.command("nightly", short_help="Run everything, judge it, and add it to the history.")
@add_run_options
@click.option("--reports", type=FOLDER, default=Path("reports"), show_default=True, help="Folder of all nights.")
@click.option("--baseline", type=FOLDER, help="Folder of the blessed night.  [default: baseline in the reports]")
@click.option(
    "--history",
    envvar="CROSSCHECK_HISTORY",
    help="URL of the history's database, such as postgresql://team@host/nights.  [default: history.sqlite in the reports]",
)
@click.option(
    "--against", default="previous", show_default=True, help="Night to compare with: its folder's name, or its start."
)
@click.option("--latest-engines", is_flag=True, help="In a fresh environment with the newest release of every engine.")
@click.option(
    "--bench",
    is_flag=True,
    help="At the end the speed comparison of `crosscheck bench`, its ratios in the history (in a checkout).",
)
@click.option(
    "--board",
    "releases",
    type=click.IntRange(min=1),
    metavar="RELEASES",
    help="Also a board of all cases in so many newest releases of the engines: see crosscheck board.",
)
@click.option("--label", default="", hidden=True, help="What kind of night it is, for the history.")
def command(
    asked: RunSelection,
    reports: Path,
    baseline: Path | None,
    history: str | None,
    against: str,
    latest_engines: bool,
    bench: bool,
    releases: int | None,
    label: str,
) -> NoReturn:
    """Run everything, judge it against the blessed night, and add it to the history.

    \b
    The folder of reports then holds
      <date>/           the report of this night, with trend pages over all nights
      latest/           a copy of the last one
      history.sqlite    every value, verdict, version and time of every night
      board/            cells of the board of releases (--board), whose page is in the night
      baseline/         the blessed night: `crosscheck bless` writes it, and it belongs into version control

    A comparison that has become worse than its blessed value by more than noise is a deviation, even inside its
    limit; one without a blessed value fails until it is blessed.  One night runs at a time; with --resume it takes over
    what the last one left that was cut short.  Exit codes are those of `crosscheck run`; 2 also where the history or the
    report could not be written.
    """
    console = Console(stderr=True)

    def write_line(line: str) -> None:
        console.print(escape(line), soft_wrap=True)

    if latest_engines:
        with convert_sigterm():
            sys.exit(fresh.run_in_fresh_environment(reports, fresh.remove_flag(sys.argv[1:]), write_line))
    try:
        board = None if releases is None else _make_board_wish(asked, releases, write_line)
    except InputError as error:
        raise Failure(str(error)) from error
    night = NightSettings(
        work=asked.prepare_work(write_line),
        reports=reports,
        baseline=baseline or reports / "baseline",
        url=history or f"sqlite:///{reports / 'history.sqlite'}",
        against=against,
        label=label,
        command=format_command_line(sys.argv[1:]),
        bench=_list_speed_studies(asked.models) if bench else (),
        board=board,
    )
    try:
        with convert_sigterm(), open_progress(console) as notify:
            results, folder = run_night(night, notify, write_line)
    except (NightRunning, BaselineError, InputError) as error:
        raise Failure(str(error)) from error
    except (OSError, HistoryError) as error:
        raise Failure(f"the night could not be kept: {error}") from error
    write_troubles(console, results)
    console.print(f"[bold]{escape(describe_run(results))}[/bold]", soft_wrap=True)
    also = "" if label else f", also {reports / 'latest' / 'index.html'}"
    console.print(f"report: {folder / 'index.html'}{also}", highlight=False, soft_wrap=True)
    sys.exit(results.exit_code)


def _make_board_wish(asked: RunSelection, releases: int, write_line: Callable[[str], None]) -> BoardWish:
    """Return the wish for a board: those of its usual engines that the night runs.  Raises InputError where that is none."""
    wanted = match_engines(collect_engines(asked.models, asked.config, asked.engine).engines, asked.engines)
    chosen = [name for name in USUAL if name in wanted and describe_missing_package(wanted[name]) is None]
    if not chosen:
        raise InputError(f"--board: the night runs none of {', '.join(USUAL)}; write --engines with one of them")
    store = EnvironmentStore(find_store_folder(), choose_installer("auto", Index(), sources=False))
    workers = BoardWorkers(asked.jobs, asked.scheduler, tell=write_line)
    return BoardWish(choose_engines(chosen), releases, store, workers, asked.timeout)


def _list_speed_studies(models: Path) -> tuple[Study, ...]:
    """Return the parts of the speed comparison that a night makes.  Raises Failure where this is no checkout."""
    try:
        parts = open_checkout_module("benchmarks.parts", "crosscheck nightly --bench")
    except InputError as error:
        raise Failure(str(error)) from error
    studies: tuple[Study, ...] = parts.list_night_studies(models)
    return studies
