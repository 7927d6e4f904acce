"""``crosscheck selftest``: plant every cause, and see that it is named."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import click
from rich.console import Console
from rich.table import Table

from crosscheck import results as store
from crosscheck.benches import BENCHES
from crosscheck.plan import Plan
from crosscheck.report import render
from crosscheck.report.words import SIGNS
from crosscheck.results import StudyRow
from crosscheck.runner import RESULTS, Options, Work, run
from crosscheck.studies.selftest import ALONE, studies, summary, targets
from crosscheck.terminal import COLOURS, JOBS, MODELS, Failure, progress, terminated
from crosscheck.terminal import out as out_option


@click.command("selftest", short_help="Plant every known cause, and demand that it is named.")
@click.argument("names", nargs=-1)
@MODELS
@out_option("reports/selftest")
@JOBS
@click.option(
    "--timeout",
    type=click.FloatRange(min=0.0, min_open=True),
    default=3600.0,
    show_default=True,
    help="Seconds that one bench may take: some hundred runs of an engine.",
)
def command(names: tuple[str, ...], models: Path, out: Path, jobs: int, timeout: float) -> NoReturn:
    """Plant every known cause in an engine's model and demand that it is named.

    NAMES are mechanisms of the benches; without names all of them.  The unharmed mechanisms demand silence.  The
    matrix planted x named is printed and stands in the report, with a table of every fault per bench.

    \b
    Exit codes: 0  95 % of the faults that matter are named, and nothing on the unharmed mechanisms; without NAMES, every
                   cause is named alone somewhere
                1  not so
                2  an engine, a model or the harness failed
    """
    known = [bench.mechanism for bench in BENCHES]
    if unknown := [n for n in names if n not in known]:
        raise Failure(f"no bench is called {unknown[0]!r}; known: {', '.join(dict.fromkeys(known))}")
    asked = dict.fromkeys(name for name in known if not names or name in names)
    if absent := [name for name in asked if not (models / name / "mechanism.toml").is_file()]:
        raise Failure(f"{models} has no mechanism {', '.join(absent)}: write --models with this project's own models")
    with terminated(), progress(Console(stderr=True)) as notify:
        line = shlex.join(["crosscheck", *sys.argv[1:]])
        results = run(Work(Plan(()), {}, studies(models, names), Options(timeout, jobs)), out, notify, line)
    whole = summary(results.studies, whole=not names)
    results = replace(results, studies=(whole, *results.studies))
    store.write(results, out / RESULTS)
    render(results, out)
    met = targets(results.studies[1:], whole=not names)
    _show(whole, met)
    Console(stderr=True).print(f"report: {out / 'index.html'}", highlight=False)
    failed = not results.finished or any(table.status != "ok" for table in results.studies)
    sys.exit(2 if failed else int(any(line["verdict"] != "within" for line in met)))


def _show(whole: StudyRow, met: Sequence[Mapping[str, Any]]) -> None:
    """Print the matrix with numbered columns, where each cause is named alone, and the targets."""
    console, benches = Console(), [key for key, _, _ in whole.columns[1:-1]]
    matrix = whole.rows[: -len(met)]
    table = Table("planted", box=None, header_style="dim", padding=(0, 1, 0, 0))
    for k in range(len(benches)):
        table.add_column(str(k + 1), no_wrap=True, min_width=2)
    where = Table("cause", "named alone on", box=None, header_style="dim")
    for row in matrix:
        table.add_row(row["cause"], *(row[b] for b in benches))
        where.add_row(row["cause"], row[ALONE])
    console.print(table)
    for k, bench in enumerate(benches):
        console.print(f"{k + 1:2d}  {bench}", highlight=False)
    console.print(where)
    for paragraph in whole.text.split("\n\n"):
        console.print(paragraph, highlight=False)
    for line in met:
        verdict = line["verdict"]
        sign = SIGNS.get(verdict, "✓")
        console.print(f"[{COLOURS[verdict]}]{sign}[/] {line['cause']}: {line[ALONE]}", highlight=False, soft_wrap=True)
