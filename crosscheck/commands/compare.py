"""``crosscheck compare``: two descriptions of a machine, and whether they are the same one."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import click
from rich.markup import escape
from rich.table import Table

from crosscheck.commands.shared.terminal import FOLDER, MEMORY_FOR_FILE, TIME_FOR_FILE, Console, Failure
from crosscheck.equivalence.compare import TOLERANCE, compare
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.output.files import write
from crosscheck.equivalence.output.readers import describe_agreement, render_readers_table, write_table
from crosscheck.equivalence.output.text import GROUPS, describe_repair, describe_rounding, render_markdown
from crosscheck.equivalence.readers import ComparisonSettings, ReaderRow, compare_readers
from crosscheck.equivalence.result import JUDGED, Comparison
from crosscheck.equivalence.sources import check_readable
from crosscheck.report.words import format_short
from crosscheck.run.reading_limits import ReadingLimits, UnreadFile
from flexinv.errors import InputError


@click.command("compare", short_help="Say whether A and B are the same machine, and what differs.")
@click.argument("a")
@click.argument("b", required=False)
@click.option(
    "--tolerance", type=float, default=TOLERANCE, show_default=True, help="Of an effort, relative to its range."
)
@click.option(
    "--match", "stated", multiple=True, metavar="A=B", help="Joint of A that is joint B of B, where it is not clear."
)
@click.option("--judge", default=",".join(JUDGED), show_default=True, help="What counts for the exit code.")
@click.option("--strict", is_flag=True, help="Count what no torque can tell, and rounding of printed digits, too.")
@click.option(
    "--ignore", "ignored", multiple=True, metavar="NAME", help="Leave out what engines do beside: gravcomp, fluid, ..."
)
@click.option("--unproven", is_flag=True, help="Exit 0 also where no reader's own model could be asked.")
@click.option("--readers", help="'all', or engines by comma: what their own readers make of A.")
@TIME_FOR_FILE
@MEMORY_FOR_FILE
@click.option("--out", type=FOLDER, help="Folder for a page, results.json, junit.xml and summary.md.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--markdown", "as_markdown", is_flag=True, help="Print the result as Markdown.")
def command(
    a: str,
    b: str | None,
    tolerance: float,
    stated: tuple[str, ...],
    judge: str,
    strict: bool,
    ignored: tuple[str, ...],
    unproven: bool,
    readers: str | None,
    timeout: float,
    memory: float,
    out: Path | None,
    as_json: bool,
    as_markdown: bool,
) -> None:
    """Say whether A and B describe the same machine, and name what differs.

    A and B are URDF, MJCF, SDF, USD, a mechanism of ours, a case kit, or FILE@ENGINE: what that engine's own reader makes of the
    file as it is shipped.

    \b
      crosscheck compare arm.urdf arm.xml
      crosscheck compare arm.urdf@pinocchio arm.urdf@mujoco
      crosscheck compare old/arm.urdf arm.urdf --out same
      crosscheck compare arm.urdf --readers all

    Files are read in a process of their own, within --timeout and --memory; what is no regular file is refused.

    \b
    Exit codes: 0 the same, 1 different, 2 cannot be compared, not comparable in what is named, or not proven
    """
    families = _parse_families(judge)
    guard = ReadingLimits(timeout, memory)
    form = "json" if as_json else "markdown" if as_markdown else ""
    try:
        if readers is not None:
            if b is not None or stated:
                raise Failure("--readers compares the readers of one file: leave out B and --match")
            rows = compare_readers(
                a, readers, ComparisonSettings(tolerance, families, strict, ignored, unproven), guard.run_function
            )
            _write_readers(a, rows, out, form)
            sys.exit(_find_worst_code(rows))
        if b is None:
            raise Failure("one description is given: write a second one, or --readers all")
        found = _run_comparison(guard, a, b, (tolerance, _parse_matches(stated), families, strict, ignored, unproven))
        if out is not None:
            write(found, out)
    except InputError as error:
        raise Failure(str(error)) from error
    except OSError as error:
        raise Failure(f"{out or a}: {error}") from error
    _add_summary(render_markdown(found))
    if form:
        click.echo(json.dumps(found.plain, indent=1) if form == "json" else render_markdown(found))
    else:
        _write_comparison(Console(), found, out)
    sys.exit(found.code)


def _run_comparison(guard: ReadingLimits, a: str, b: str, rest: tuple[Any, ...]) -> Comparison:
    """The comparison, made in a process of its own; where that comes to no end, the words say which file it is."""
    try:
        return guard.run_function(compare, a, b, *rest)
    except UnreadFile:
        for source in (a, b):
            guard.run_function(check_readable, source)
        raise


def _parse_matches(stated: tuple[str, ...]) -> dict[str, str]:
    pairs = [one.partition("=") for one in stated]
    for one, (a, _, b) in zip(stated, pairs, strict=True):
        if not a or not b:
            raise Failure(f"--match {one!r}: expected two joints; write --match elbow=joint3")
    return {a: b for a, _, b in pairs}


def _parse_families(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _write_comparison(console: Console, comparison: Comparison, out: Path | None) -> None:
    colour = {0: "green", 1: "red"}.get(comparison.code, "yellow")
    console.print(f"A  {escape(comparison.first)}\nB  {escape(comparison.second)}", highlight=False, soft_wrap=True)
    for name, title in GROUPS:
        if group := getattr(comparison.judged, name):
            console.print(_make_difference_table(title, group))
    for line in [*describe_rounding(comparison), describe_repair(comparison)]:
        console.print(escape(line), highlight=False, soft_wrap=True)
    if comparison.suspects:
        console.print(f"[bold]{escape(comparison.suspects)}[/]", highlight=False, soft_wrap=True)
    for place, lines in comparison.advice:
        console.print(f"[bold]{escape(place)}[/]", highlight=False, soft_wrap=True)
        for line in lines:
            console.print(f"  {escape(line)}", highlight=False, soft_wrap=True)
    for line in comparison.grounds:
        console.print(f"[dim]{escape(line)}[/]", highlight=False, soft_wrap=True)
    for note in comparison.notes:
        console.print(f"[dim]{escape(note)}[/]", highlight=False, soft_wrap=True)
    for side, lines in comparison.dropped:
        for line in lines:
            console.print(f"[dim]{escape(side)}: {escape(line)}[/]", highlight=False, soft_wrap=True)
    console.print(f"[bold {colour}]{escape(comparison.sentence)}[/]", soft_wrap=True)
    if out is not None:
        console.print(f"page: {out / 'index.html'}", highlight=False, soft_wrap=True)


def _make_difference_table(title: str, group: tuple[Difference, ...]) -> Table:
    table = Table(title=title, title_justify="left")
    for name in ("what", "where", "A", "B", "size", "times its range", "looks like"):
        table.add_column(name, justify="right" if name in ("size", "times its range") else "left", overflow="fold")
    for d in group:
        size = "" if d.unit == "-" else f"{d.size:.4g} {d.unit}"
        cells = (
            d.cause,
            d.place,
            d.first,
            d.second,
            size,
            format_short(d.share) if d.share is not None else "",
            "; ".join(d.hints),
        )
        table.add_row(*map(escape, cells))
    return table


def _write_readers(file: str, rows: list[ReaderRow], out: Path | None, form: str) -> None:
    if out is not None:
        write_table(file, rows, out)
    _add_summary(render_readers_table(file, rows))
    if form:
        plain = [row.plain for row in rows]
        click.echo(json.dumps(plain, indent=1) + "\n" if form == "json" else render_readers_table(file, rows), nl=False)
        return
    Console().print(_make_reader_table(file, rows))
    for row in rows:
        for words in row.dropped:
            Console().print(f"[dim]{escape(row.reader)}: {escape(words)}[/]", highlight=False, soft_wrap=True)
    Console().print(escape(describe_agreement(rows)), highlight=False, soft_wrap=True)
    if out is not None:
        Console().print(f"page: {out / 'index.html'}", highlight=False, soft_wrap=True)


def _add_summary(words: str) -> None:
    """Add Markdown to the page of a step of GitHub's workflows, where there is one."""
    if page := os.environ.get("GITHUB_STEP_SUMMARY"):
        with open(page, "a", encoding="utf-8") as file:
            file.write(words)


def _find_worst_code(rows: list[ReaderRow]) -> int:
    """The worst of all rows: 2 where one cannot be compared or is not proven, 1 where one differs."""
    return max(2 if row.comparison is None else row.comparison.code for row in rows)


def _make_reader_table(file: str, rows: list[ReaderRow]) -> Table:
    table = Table(title=f"{file}, as each engine reads it, against {rows[0].reader}", title_justify="left")
    for name in ("reader", "joints", "mass [kg]", "result", "differences"):
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*map(escape, (row.reader, row.joints, row.mass, row.result, row.refusal)))
    return table
