"""``crosscheck lint``: one description alone, and what in it is suspicious."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from functools import partial
from pathlib import Path

import click
from rich.markup import escape
from rich.table import Table

from crosscheck.commands.shared.terminal import FOLDER, MEMORY_FOR_FILE, TIME_FOR_FILE, Console, Failure
from crosscheck.linting.lint import LintReport, check_sources, lint
from crosscheck.linting.output import build_junit_xml as written_junit
from crosscheck.linting.output import list_lines, write
from crosscheck.run.reading_limits import ReadingLimits


@click.command("lint", short_help="Say what is suspicious in one description.")
@click.argument("files", nargs=-1, required=True)
@click.option("--strict", is_flag=True, help="Warnings count for the exit code, too: for CI.")
@click.option(
    "--meshes/--no-meshes", default=True, show_default=True, help="Look at shapes, too; at meshes with trimesh."
)
@TIME_FOR_FILE
@MEMORY_FOR_FILE
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
@click.option("--out", type=FOLDER, help="Folder for a page, results.json, junit.xml and summary.md.")
@click.option("--junit", type=click.Path(dir_okay=False), help="Write the findings as JUnit XML.")
def command(
    files: tuple[str, ...],
    strict: bool,
    meshes: bool,
    timeout: float,
    memory: float,
    as_json: bool,
    out: Path | None,
    junit: str | None,
) -> None:
    """Say what in a description no machine can have, or what its readers make different things of.

    \b
      crosscheck lint arm.urdf
      crosscheck lint robots/*.urdf --strict --junit lint.xml

    Each file is read in a process of its own, within --timeout and --memory; what is no regular file is refused.  Where the
    output is no terminal each finding is one line.

    \b
    Exit codes: 0 nothing found (without --strict: no error), 1 findings, 2 a file cannot be read
    """
    try:
        found = check_sources(files, strict, meshes, partial(ReadingLimits(timeout, memory).run_function, lint))
        if out is not None:
            write(found, out)
        if junit is not None:
            with open(junit, "wb") as stream:
                stream.write(written_junit(found))
    except OSError as problem:
        raise Failure(f"{out or junit or files[0]}: {problem}") from problem
    if as_json:
        click.echo(json.dumps([one.plain for one in found], indent=1))
    else:
        _write_reports(found, out)
    if refused := [one.refused for one in found if one.refused]:
        raise Failure("\n".join(refused))
    sys.exit(0 if all(one.clean for one in found) else 1)


def _write_reports(found: Iterable[LintReport], out: Path | None) -> None:
    for one in found:
        if not one.refused:
            _write_findings(Console(), one)
    if out is not None:
        Console().print(f"page: {out / 'index.html'}", highlight=False, soft_wrap=True)


def _write_findings(console: Console, found: LintReport) -> None:
    if not console.is_terminal:
        for line in list_lines(found):
            console.print(escape(line), highlight=False, soft_wrap=True)
    elif found.findings:
        table = Table(title=found.label, title_justify="left")
        for name in ("level", "check", "where", "given", "why", "write"):
            table.add_column(name, overflow="fold")
        for one in found.findings:
            colour = "red" if one.level == "error" else "yellow"
            cells = map(escape, (one.check, one.place, one.given, one.why, one.write))
            table.add_row(f"[{colour}]{one.level}[/]", *cells)
        console.print(table)
    console.print(f"{escape(found.label)}: {found.words}", highlight=False, soft_wrap=True)
