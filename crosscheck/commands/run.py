"""``crosscheck run``: mechanisms in all engines, compared, with a report."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import click
from rich.markup import escape

from crosscheck import output_folder as owned
from crosscheck.commands.shared.options import RunSelection, add_run_options
from crosscheck.commands.shared.terminal import (
    FOLDER,
    Console,
    Failure,
    convert_sigterm,
    open_progress,
    write_report_and_end,
)
from crosscheck.commands.shared.terminal import make_out_option as out_option
from crosscheck.run.answer_cache import find_user_folder
from crosscheck.run.runner import run
from crosscheck.secrets import format_command_line
from crosscheck.verdicts import baseline as blessed
from flexinv.errors import InputError


@click.command("run", short_help="Run mechanisms in all engines, compare, and write a report.")
@add_run_options
@out_option("reports/latest")
@click.option(
    "--baseline",
    type=FOLDER,
    help="Folder of the blessed night: what is worse than there by more than noise deviates (see crosscheck bless).",
)
@click.option(
    "--fresh",
    is_flag=True,
    help="Compute everything, also what has not changed since an earlier run (as always in CI).",
)
def command(asked: RunSelection, out: Path, baseline: Path | None, fresh: bool) -> NoReturn:
    """Run mechanisms in all engines, compare, and write a report.

    NAMES are mechanisms, patterns, or single cases ("flex_one_link", "flex_*", "flex_one_link/cycloid"); without
    names everything runs, and the studies that belong to the models (studies.toml there).
    Every engine runs in a process of its own: one that crashes, hangs
    or returns NaN is a row of the report, and the others go on.  Ctrl-C stops all and still writes the report.

    What is computed is kept in the user's cache (CROSSCHECK_KEPT names another folder, or none if it is empty) and taken
    from there while mechanism, case, engine, packages, sources, Python and processor are the same; the report says so.

    \b
    The report folder then holds
      index.html     the matrix, and a page with curves per case (opens without server or network)
      results.json   every number and verdict; `crosscheck report` renders the rest from it
      summary.md     for a terminal or a pull request;  junit.xml for a CI system
      series/        all curves (NumPy .npz with a .json of names and units)
      data/          what the pages draw, as CSV with units in the names of the columns
    """
    console = Console(stderr=True)

    def write_line(line: str) -> None:
        console.print(escape(line), soft_wrap=True)

    work = asked.prepare_work(write_line)
    try:
        known = blessed.find(baseline) if baseline is not None else None
        fresh = fresh or bool(os.environ.get("CI"))
        options = replace(work.options, baseline=known, kept=find_user_folder(), fresh=fresh)
        work = replace(work, options=options)
        with owned.open_report_folder(out):
            with convert_sigterm(), open_progress(console) as notify:
                results = run(work, out, notify, format_command_line(sys.argv[1:]), write_line)
            write_report_and_end(console, results, out)
    except (blessed.BaselineError, InputError) as error:
        raise Failure(str(error)) from error
