"""The command line: ``crosscheck run``, ``list``, ``engines``, ``report``."""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
import sys
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn, TypeVar

import click
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from crosscheck import results as store
from crosscheck.engines import ENGINES, missing
from crosscheck.isolation import Children, ask
from crosscheck.plan import Plan, discover
from crosscheck.report import render
from crosscheck.report.words import SIGNS, sentence
from crosscheck.results import Results
from crosscheck.runner import DESCRIBE, RESULTS, Event, Options, run
from crosscheck.studies import STUDIES
from flexinv.errors import InputError

COLOURS = {
    "within": "green",
    "ok": "green",
    "deviation": "red",
    "error": "bold red",
    "unjudged": "yellow",
    "explained": "cyan",
    "skipped": "dim",
}
MODELS = click.option(
    "--models",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    default=Path("models"),
    show_default=True,
    help="Folder of mechanisms: one folder each, with mechanism.toml and cases.toml.",
)
T = TypeVar("T")
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Failure(click.ClickException):
    """What went wrong before anything ran, in words; exit code 2."""

    exit_code = 2


class _Main(click.Group):
    """A command line whose every failure has exit code 2: 1 means that engines deviate, and nothing else."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except (KeyboardInterrupt, click.Abort):
            raise _Failure("interrupted") from None
        except (click.ClickException, click.exceptions.Exit):
            raise
        except Exception as error:
            traceback.print_exc()
            raise _Failure(f"the harness failed: {type(error).__name__}: {error}") from error


@click.group(cls=_Main, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
def main() -> None:
    """Compute the same mechanism in several engines and say where they differ.

    \b
    First steps:
      crosscheck engines                        what is installed, and what each engine can do
      crosscheck list                           mechanisms, their cases and what is compared
      crosscheck run rigid_3r                   run one mechanism; open reports/latest/index.html
      crosscheck run --engines flexinv,exudyn*  some engines only

    \b
    Exit codes: 0  everything compared is within its limits (skipped is neither passed nor failed)
                1  a deviation, or a comparison without a limit
                2  an engine, a model or the harness failed
    """


@main.command("run")
@click.argument("names", nargs=-1)
@MODELS
@click.option("--engines", default="*", show_default=True, help="Names or patterns, separated by commas.")
@click.option("--studies", default="*", show_default=True, help="Names or patterns of the studies; '' for none.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("reports/latest"),
    show_default=True,
    help="Folder of the report; an older report there is replaced.",
)
@click.option("--jobs", type=click.IntRange(min=1), default=CORES, show_default=True, help="Engines running at a time.")
@click.option(
    "--timeout",
    type=click.FloatRange(min=0.0, min_open=True),
    default=900.0,
    show_default=True,
    help="Seconds that one engine may take for one case.",
)
def run_command(
    names: tuple[str, ...], models: Path, engines: str, studies: str, out: Path, jobs: int, timeout: float
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
    chosen = _chosen(ENGINES, engines, "engine")
    # A reader who names mechanisms wants those; the studies belong to the whole.
    known = {} if names and studies == "*" else _chosen(STUDIES, studies, "study")
    tables = tuple(replace(study, options={"models": str(models.resolve())}) for study in known.values())
    plan = _plan(models, names)
    with _terminated(), _progress(console) as notify:
        results = run(
            plan, chosen, tables, Options(timeout, jobs), out, notify, shlex.join(["crosscheck", *sys.argv[1:]])
        )
    _finish(console, results, out)


@main.command("report")
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path), default=Path("reports/latest"))
def report_command(folder: Path) -> NoReturn:
    """Render the report in FOLDER again from its results.json and series (exit code as of the run)."""
    try:
        results = store.read(folder / RESULTS)
    except (OSError, ValueError) as error:
        raise _Failure(f"cannot read {folder / RESULTS}: {error}") from error
    _finish(Console(stderr=True), results, folder)


@main.command("list")
@click.argument("names", nargs=-1)
@MODELS
def list_command(names: tuple[str, ...], models: Path) -> None:
    """List mechanisms, their cases, what is compared and the limits."""
    plan = _plan(models, names)
    table = Table("mechanism", "case", "what", "compared", box=None, header_style="dim")
    for task in plan.tasks:
        what = task.case.title or task.mechanism.title
        table.add_row(*map(escape, (task.folder.name, task.case.name, what, ", ".join(task.case.quantities))))
    for name, message in plan.broken:
        table.add_row(escape(name), "", f"[red]cannot be read: {escape(message)}[/red]", "")
    Console().print(table)
    if plan.broken:
        sys.exit(2)


@main.command("engines")
def engines_command() -> None:
    """Show which engines are installed, their versions and what each can do."""
    table = Table("engine", "version", "what it can do", box=None, header_style="dim")
    known: dict[str, tuple[Any, Any]] = {}
    for engine in ENGINES.values():
        if (reason := missing(engine)) is not None:
            table.add_row(engine.name, "[red]missing[/red]", escape(reason))
            continue
        if engine.module not in known:
            known[engine.module] = ask({"kind": "describe", "module": engine.module}, DESCRIBE, Children())
        answer, ending = known[engine.module]
        if answer is None:
            table.add_row(engine.name, "[red]broken[/red]", escape(ending.message))
        else:
            table.add_row(engine.name, escape(answer["version"]), escape(answer["abilities"]))
    Console().print(table)


def _plan(models: Path, names: tuple[str, ...]) -> Plan:
    try:
        return discover(models, names)
    except InputError as error:
        raise _Failure(str(error)) from error


def _chosen(known: Mapping[str, T], patterns: str, kind: str) -> dict[str, T]:
    """Return the entries that fit one of the patterns, in their own order."""
    wanted = [p.strip() for p in patterns.split(",") if p.strip()]
    for pattern in wanted:
        if pattern != "*" and not any(fnmatchcase(name, pattern) for name in known):
            raise _Failure(f"no {kind} is called {pattern!r}; known: {', '.join(known)}")
    return {name: thing for name, thing in known.items() if any(fnmatchcase(name, p) for p in wanted)}


def _finish(console: Console, results: Results, out: Path) -> NoReturn:
    render(results, out)
    console.print(f"[bold]{escape(sentence(results))}[/bold]")
    console.print(f"report: {out / 'index.html'}", highlight=False)
    sys.exit(results.exit_code)


@contextlib.contextmanager
def _progress(console: Console) -> Iterator[Any]:
    """Give a function that shows what finished: a bar on a terminal, lines elsewhere."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("running", total=None)

        def notify(event: Event) -> None:
            bar.update(task, total=event.total, completed=event.done, description=escape(event.label))
            if event.verdict not in ("ok", "within", "skipped") or not console.is_terminal:
                sign = SIGNS.get(event.verdict, "✓")
                line = f"[{COLOURS.get(event.verdict, 'green')}]{sign} {escape(event.label)}[/] {escape(event.message)}"
                console.print(line, highlight=False, soft_wrap=True)

        yield notify


@contextlib.contextmanager
def _terminated() -> Iterator[None]:
    """Treat a polite kill (SIGTERM) like Ctrl-C, so that no engine is left behind."""

    def interrupt(number: int, frame: FrameType | None) -> NoReturn:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
