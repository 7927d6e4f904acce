"""``crosscheck selftest``: plant every cause, and see that it is named."""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import click
from rich.console import Console
from rich.table import Table

from crosscheck import results as store
from crosscheck.benches import BENCHES
from crosscheck.plan import Plan
from crosscheck.report import render
from crosscheck.results import StudyRow
from crosscheck.runner import RESULTS, Options, Work, run
from crosscheck.studies.selftest import studies, summary
from crosscheck.terminal import JOBS, MODELS, TIMEOUT, Failure, progress, terminated
from crosscheck.terminal import out as out_option


@click.command("selftest")
@click.argument("names", nargs=-1)
@MODELS
@out_option("reports/selftest")
@JOBS
@TIMEOUT
def command(names: tuple[str, ...], models: Path, out: Path, jobs: int, timeout: float) -> NoReturn:
    """Plant every known cause in an engine's model and demand that it is named.

    NAMES are mechanisms of the benches; without names all of them.  The unharmed mechanisms demand silence.  The
    matrix planted x named is printed and stands in the report, with a table of every fault per bench.

    \b
    Exit codes: 0  95 % of the faults that matter are named, and nothing on the unharmed mechanisms
                1  not so
                2  an engine, a model or the harness failed
    """
    known = [bench.mechanism for bench in BENCHES]
    if unknown := [n for n in names if n not in known]:
        raise Failure(f"no bench is called {unknown[0]!r}; known: {', '.join(dict.fromkeys(known))}")
    with terminated(), progress(Console(stderr=True)) as notify:
        line = shlex.join(["crosscheck", *sys.argv[1:]])
        results = run(Work(Plan(()), {}, studies(models, names), Options(timeout, jobs)), out, notify, line)
    whole = summary(results.studies)
    results = replace(results, studies=(whole, *results.studies))
    store.write(results, out / RESULTS)
    render(results, out)
    _show(whole)
    Console(stderr=True).print(f"report: {out / 'index.html'}", highlight=False)
    failed = not results.finished or any(table.status != "ok" for table in results.studies)
    sys.exit(2 if failed else int(whole.rows[-1]["verdict"] != "within"))


def _show(whole: StudyRow) -> None:
    """Print the matrix and the figures."""
    table = Table(*(title.replace(" in ", "\n") for _, title, _ in whole.columns), box=None, header_style="dim")
    for row in whole.rows[:-1]:
        table.add_row(*({True: "yes", False: "no"}.get(row[key], row[key]) for key, _, _ in whole.columns))
    Console().print(table)
    for paragraph in whole.text.split("\n\n"):
        Console().print(paragraph, highlight=False)
