"""Terminal: options that commands share, failures in words with exit code 2, a progress bar, the last line."""

from __future__ import annotations

import contextlib
import math
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import click
from rich import console as rich_console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from crosscheck.report.words import SIGNS, describe_run, describe_unchanged, list_trouble_lines
from crosscheck.run.reading_limits import GIGABYTES, SECONDS
from crosscheck.run.work import Event
from crosscheck.secrets import remove_passwords
from crosscheck.start import convert_to_interrupt
from crosscheck.verdicts.plan import Plan, discover
from crosscheck.verdicts.results import Results
from flexinv.errors import InputError

COMPUTED = "·"  # what has an answer, of which nothing is judged yet
COLOURS = {
    "within": "green",
    "deviation": "red",
    "error": "bold red",
    "unjudged": "yellow",
    "explained": "cyan",
    "skipped": "dim",
}


class Seconds(click.FloatRange):
    """A span of time [s]: positive, and a number."""

    name = "seconds"

    def __init__(self) -> None:
        super().__init__(min=0.0, min_open=True)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the value [s].  Raises BadParameter."""
        seconds = float(super().convert(value, param, ctx))
        if not math.isfinite(seconds):
            self.fail(f"{value} is no span of time; write seconds, such as 900", param, ctx)
        return seconds


MODELS = click.option(
    "--models",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    default=Path("models"),
    show_default=True,
    help="Folder of mechanisms: one folder each, with mechanism.toml and cases.toml.",
)
FOLDER = click.Path(file_okay=False, path_type=Path)
# What ASCII, Latin-1 and Unicode have for terminals and for the direction of writing, apart from tabs and line breaks.
CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
T = TypeVar("T")
C = TypeVar("C", bound=Callable[..., Any])
SHOWN_TROUBLES = 10  # lines at the end of a run about what is not as it should be
LARGEST_SUMMARY = 900_000  # [bytes]: GitHub refuses a step's summary of more than 1 MiB
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
JOBS = click.option(
    "--jobs", type=click.IntRange(min=1), default=CORES, show_default=True, help="Engines running at a time."
)
TIMEOUT = click.option(
    "--timeout",
    type=Seconds(),
    default=900.0,
    show_default=True,
    help="Seconds that one engine may take for one case.",
)
TIME_FOR_FILE = click.option(
    "--timeout", type=Seconds(), default=SECONDS, show_default=True, help="Seconds that reading one file may take."
)
MEMORY_FOR_FILE = click.option(
    "--memory",
    type=click.FloatRange(min=0.5, max=1e6),
    default=GIGABYTES,
    show_default=True,
    help="Gigabytes of memory that reading one file may take.",
)
PATTERNS = click.option(
    "--engines", default="*", show_default=True, help="Names or patterns of the engines, separated by commas."
)


def make_out_option(default: str) -> Callable[[C], C]:
    """Return the option for the folder of a report."""
    words = "Folder of the report; an older report there is replaced, and nothing else."
    return click.option("--out", type=FOLDER, default=Path(default), show_default=True, help=words)


class Failure(click.ClickException):
    """Failure before anything ran, in words and without passwords; exit code 2."""

    exit_code = 2

    def __init__(self, message: str) -> None:
        super().__init__(replace_control_characters(remove_passwords(message)))


def replace_control_characters(text: str) -> str:
    """Return a text without characters that a terminal obeys: names and messages of strangers may hold some."""
    return CONTROLS.sub("\N{REPLACEMENT CHARACTER}", text)


class Console(rich_console.Console):
    """A terminal; where its reader goes away (``| head``) nothing more is said, and nothing is called a deviation.

    Characters that a terminal obeys are shown as replacements, whoever wrote them.
    """

    def render_str(self, text: str, **options: Any) -> Text:
        """Return a text with its markup, tamed."""
        return super().render_str(replace_control_characters(text), **options)

    def on_broken_pipe(self) -> NoReturn:
        """Leave quietly with the exit code of a failure."""
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(Failure.exit_code)


def plan_of(models: Path, names: tuple[str, ...]) -> Plan:
    """Return the plan of a run; names or a folder that lead to nothing are a Failure."""
    try:
        return discover(models, names)
    except InputError as error:
        raise Failure(str(error)) from error


def match_entries(known: Mapping[str, T], patterns: str, kind: str) -> dict[str, T]:
    """Return the entries that fit one of the patterns, in their own order; a pattern that fits none is a Failure."""
    wanted = split_patterns(patterns)
    for pattern in wanted:
        if pattern != "*" and not any(fnmatchcase(name, pattern) for name in known):
            raise Failure(f"no {kind} is called {pattern!r}; known: {', '.join(known)}")
    return {name: thing for name, thing in known.items() if any(fnmatchcase(name, p) for p in wanted)}


def split_patterns(patterns: str) -> list[str]:
    """Return the patterns that stand between commas."""
    return [pattern.strip() for pattern in patterns.split(",") if pattern.strip()]


def match_engines(known: Mapping[str, T], patterns: str) -> dict[str, T]:
    """Return the engines that fit the patterns, at least two of them: fewer are a Failure, nothing would be compared."""
    engines = match_entries(known, patterns, "engine")
    if len(engines) < 2:
        left = f"leaves only {next(iter(engines))}" if engines else "names no engine"
        raise Failure(
            f"--engines {patterns!r} {left}: nothing would be compared; write two or more of {', '.join(known)}"
        )
    return engines


def write_report_and_end(console: Console, results: Results, out: Path) -> NoReturn:
    """Write the report, say how it went, and leave with the exit code of the results."""
    from crosscheck.report.write_report import render  # who writes none does not wait for it

    try:
        render(results, out)
    except OSError as error:
        write_troubles(console, results)
        raise Failure(f"{describe_run(results)} The report could not be written: {error}") from error
    try:
        add_step_summary(out)
    except OSError as error:
        console.print(escape(f"the summary could not be added to the page of this job: {error}"), soft_wrap=True)
    write_troubles(console, results)
    console.print(f"[bold]{escape(describe_run(results))}[/bold]", soft_wrap=True)
    if words := describe_unchanged(results):
        console.print(escape(words), soft_wrap=True)
    console.print(f"report: {out / 'index.html'}", highlight=False, soft_wrap=True)
    sys.exit(results.exit_code)


def write_troubles(console: Console, results: Results) -> None:
    """Say what is not as it should be, the gravest first; of many the first ones."""
    lines = list_trouble_lines(results)
    left = len(lines) - SHOWN_TROUBLES
    for line in [*lines[:SHOWN_TROUBLES], *([f"and {left} more, all of them in the report"] if left > 0 else [])]:
        console.print(escape(line), highlight=False, soft_wrap=True)


def add_step_summary(out: Path) -> None:
    """Add the summary of the report in ``make_out_option`` to the page of a job on GitHub, where this is one."""
    if page := os.environ.get("GITHUB_STEP_SUMMARY"):
        text = (out / "summary.md").read_text(encoding="utf-8")
        if len(text.encode()) > LARGEST_SUMMARY:
            text = text.encode()[:LARGEST_SUMMARY].decode(errors="ignore").rpartition("\n")[0]
            text += "\n\nCut off here: the whole is summary.md of the report.\n"
        with open(page, "a", encoding="utf-8") as file:
            file.write(text)


@contextlib.contextmanager
def open_progress(console: Console) -> Iterator[Any]:
    """Give a function that shows what finished: a bar on a terminal, lines elsewhere."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("running", total=None)

        def update_bar(event: Event) -> None:
            bar.update(task, total=event.total, completed=event.done, description=escape(event.label))
            if event.verdict not in ("ok", "within", "skipped") or not console.is_terminal:
                sign = SIGNS.get(event.verdict, COMPUTED)
                line = (
                    f"[{COLOURS.get(event.verdict, 'default')}]{sign} {escape(event.label)}[/] {escape(event.message)}"
                )
                console.print(line, highlight=False, soft_wrap=True)

        yield update_bar


@contextlib.contextmanager
def convert_sigterm() -> Iterator[None]:
    """Treat a polite kill (SIGTERM) like Ctrl-C, so that no engine is left behind."""

    before = signal.signal(signal.SIGTERM, convert_to_interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
