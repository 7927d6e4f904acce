"""``crosscheck report``: the pages of a run again, from its results."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

import click

from crosscheck import output_folder as owned
from crosscheck.commands.shared.terminal import Console, Failure, write_report_and_end
from crosscheck.run.run_state import RESULTS
from crosscheck.verdicts import results as store
from flexinv.errors import InputError


@click.command("report", short_help="Render the report in FOLDER again.")
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path), default=Path("reports/latest"))
def command(folder: Path) -> NoReturn:
    """Render the report in FOLDER again from its results.json and series (exit code as of the run)."""
    try:
        results = store.read(folder / RESULTS)
    except (OSError, ValueError) as error:
        raise Failure(f"cannot read {folder / RESULTS}: {error}") from error
    try:
        with owned.take_folder_lock(folder):
            write_report_and_end(Console(stderr=True), results, folder)
    except InputError as error:
        raise Failure(str(error)) from error
