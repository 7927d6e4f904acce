"""``crosscheck report``: the pages of a run again, from its results."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

import click
from rich.console import Console

from crosscheck import results as store
from crosscheck.runner import RESULTS
from crosscheck.terminal import Failure, finish


@click.command("report", short_help="Render the report in FOLDER again.")
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path), default=Path("reports/latest"))
def command(folder: Path) -> NoReturn:
    """Render the report in FOLDER again from its results.json and series (exit code as of the run)."""
    try:
        results = store.read(folder / RESULTS)
    except (OSError, ValueError) as error:
        raise Failure(f"cannot read {folder / RESULTS}: {error}") from error
    finish(Console(stderr=True), results, folder)
