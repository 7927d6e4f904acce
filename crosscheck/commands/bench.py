"""``crosscheck bench``: the speed of flexinv beside other engines, on this machine."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NoReturn

import click
from rich.markup import escape
from rich.table import Table

from crosscheck import output_folder as owned
from crosscheck.checkout import open_checkout_module
from crosscheck.commands.shared.terminal import (
    COLOURS,
    MODELS,
    TIMEOUT,
    Console,
    Failure,
    convert_sigterm,
    open_progress,
)
from crosscheck.commands.shared.terminal import make_out_option as out_option
from crosscheck.report.html import format_value
from crosscheck.report.words import SIGNS
from crosscheck.report.write_report import render
from crosscheck.run.run_state import RESULTS
from crosscheck.secrets import format_command_line
from crosscheck.verdicts import history
from crosscheck.verdicts import results as store
from crosscheck.verdicts.results import Results
from flexinv.errors import InputError


@click.command("bench", short_help="Measure how fast flexinv is beside the other engines.")
@click.argument("parts", nargs=-1)
@MODELS
@click.option("--quick", is_flag=True, help="A minute or so, with fewer sizes: to see that all is well, not to quote.")
@out_option("reports/bench")
@click.option(
    "--history",
    "url",
    envvar="CROSSCHECK_HISTORY",
    help="URL of a history that the ratios are added to, such as sqlite:///reports/history.sqlite; left out: none.",
)
@TIMEOUT
def command(parts: tuple[str, ...], models: Path, quick: bool, out: Path, url: str | None, timeout: float) -> NoReturn:
    """Measure how fast flexinv is beside Pinocchio, MuJoCo and Exudyn, and beside what it shall reach.

    PARTS are what is measured; without names all of it.

    \b
      rigid     torques of 100 to 131,072 samples: flexinv, pin.rnea, rneaInParallel, mj_inverse
      single    one sample through a prepared function; the first call of a fresh process
      first     the first torque of a process, cold and warm; minutes of compiling
      latency   100,000 cycles of a controller, rigid and flexible: a histogram of what every call takes
      chains    from 1 to 64 joints
      loops     from 2 to 40 closed loops in a row: solved, simulated, with beams
      one-link, two-link, spatial   arms that bend, beside Exudyn: error and time
      accuracy  time to torque errors of 1e-3 to 1e-6: plain steps, one extrapolation, two, accuracy=
      torque-errors   the same beside Exudyn, with its best mesh and steps for each error
      elements  from 4 to 256 elements
      others    closed loops beside trees, solve_many on two threads

    \b
      crosscheck bench --quick             one look, about a minute
      crosscheck bench                     all of it, some minutes: leave the machine alone meanwhile
      crosscheck bench rigid one-link      these parts only
      python docs/figures/make_figures.py reports/bench/results.json     the plot of time and error as a picture

    It needs a checkout: its parts stand in the folder benchmarks/, which an installed package does not have.
    The engines take turns in one process, results are compared before anything is timed, and what is judged are
    ratios of medians.  `crosscheck nightly --bench` does the same at the end of a night.

    \b
    Exit codes: 0  every target is reached that could be measured (the table says first which could not)
                1  one is missed
                2  a part failed, or the report or the history could not be written
    """
    try:
        known = open_checkout_module("benchmarks.parts", "crosscheck bench")
    except InputError as error:
        raise Failure(str(error)) from error
    if unknown := [name for name in parts if name not in known.PARTS]:
        raise Failure(f"no part is called {unknown[0]!r}; known: {', '.join(known.PARTS)}")
    try:
        with owned.open_report_folder(out):
            with convert_sigterm(), open_progress(Console(stderr=True)) as notify:
                line = format_command_line(sys.argv[1:])
                results = known.run_parts(known.list_studies(models, parts, quick), timeout, out, notify, line)
            store.write(results, out / RESULTS)
            render(results, out)
    except (InputError, OSError) as error:
        raise Failure(str(error)) from error
    _write_targets(results)
    if url is not None:
        _add_to_history(results, url)
    Console(stderr=True).print(f"report: {out / 'index.html'}", highlight=False)
    failed = not results.finished or any(table.status != "ok" for table in results.studies)
    sys.exit(2 if failed else int(results.studies[0].verdict == "deviation"))


def _write_targets(results: Results) -> None:
    """Print the table of targets, and what failed."""
    console = Console()
    console.print(results.studies[0].text.split("\n\n")[0], highlight=False)
    table = Table("", "what", "measured", "asked", "", box=None, header_style="dim")
    for row in results.studies[0].rows:
        sign = f"[{COLOURS[row['verdict']]}]{SIGNS[row['verdict']]}[/]"
        measured = f"{format_value(row['value'])} {row['unit'].strip('-')}" if "value" in row else ""
        table.add_row(sign, escape(row["what"]), measured, row["limit"], row["spread"])
    console.print(table)
    for part in results.studies[1:]:
        if part.status != "ok":
            console.print(f"[red]{escape(part.title)}: {escape(part.message)}[/]")


def _add_to_history(results: Results, url: str) -> None:
    try:
        history.add_metrics(history.open_database(url), history.list_metrics(results.studies), elapsed=results.elapsed)
    except history.HistoryError as error:
        raise Failure(str(error)) from error
