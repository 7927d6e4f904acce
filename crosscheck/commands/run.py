"""``crosscheck run``: mechanisms in all engines, compared, with a report."""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import click
from rich.console import Console

from crosscheck import baseline as blessed
from crosscheck import results as store
from crosscheck.engines import ENGINES
from crosscheck.runner import RESULTS, Options, run
from crosscheck.studies import STUDIES
from crosscheck.terminal import JOBS, MODELS, PATTERNS, TIMEOUT, Failure, chosen, finish, plan_of, progress, terminated
from flexinv.errors import InputError


@click.command("run")
@click.argument("names", nargs=-1)
@MODELS
@PATTERNS
@click.option("--studies", default="*", show_default=True, help="Names or patterns of the studies; '' for none.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("reports/latest"),
    show_default=True,
    help="Folder of the report; an older report there is replaced.",
)
@click.option(
    "--baseline",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the blessed night: what is worse than there by more than noise deviates (see crosscheck bless).",
)
@click.option(
    "--scheduler", default="", help="Address of a Dask scheduler, tcp://host:8786: engines run on its workers."
)
@click.option("--resume", is_flag=True, help="Take over what an interrupted run has left in the folder; run the rest.")
@JOBS
@TIMEOUT
def command(
    names: tuple[str, ...],
    models: Path,
    engines: str,
    studies: str,
    out: Path,
    baseline: Path | None,
    scheduler: str,
    resume: bool,
    jobs: int,
    timeout: float,
) -> NoReturn:
    """Run mechanisms in all engines, compare, and write a report.

    NAMES are mechanisms, patterns, or single cases ("flex_one_link", "flex_*", "flex_one_link/cycloid"); without
    names everything runs, and the studies too.  Every engine runs in a process of its own: one that crashes, hangs
    or returns NaN is a row of the report, and the others go on.  Ctrl-C stops all and still writes the report.

    \b
    The report folder then holds
      index.html     the matrix, and a page with curves per case (opens without server or network)
      results.json   every number and verdict; `crosscheck report` renders the rest from it
      summary.md     for a terminal or a pull request;  junit.xml for a CI system
      series/        all curves (NumPy .npz with a .json of names and units)
    """
    console = Console(stderr=True)
    wanted = chosen(ENGINES, engines, "engine")
    # A reader who names mechanisms wants those; the studies belong to the whole.
    known = {} if names and studies == "*" else chosen(STUDIES, studies, "study")
    tables = tuple(replace(study, options={"models": str(models.resolve())}) for study in known.values())
    plan = plan_of(models, names)
    try:
        known_good = blessed.find(baseline) if baseline is not None else None
    except blessed.BaselineError as error:
        raise Failure(str(error)) from error
    try:
        with terminated(), progress(console) as notify:
            results = run(
                plan,
                wanted,
                tables,
                Options(timeout, jobs, scheduler=scheduler, resume=resume),
                out,
                notify,
                shlex.join(["crosscheck", *sys.argv[1:]]),
            )
    except InputError as error:
        raise Failure(str(error)) from error
    if known_good is not None:
        whole = results.finished and not names and len(wanted) == len(ENGINES)
        results = blessed.apply(results, known_good, whole)
        store.write(results, out / RESULTS)
    finish(console, results, out)
