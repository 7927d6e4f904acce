"""``crosscheck verify``: a summary of a mechanism, the engines' results, and limits that its error bars suggest."""

from __future__ import annotations

import datetime
import sys
from collections.abc import Callable
from pathlib import Path

import click
from rich.markup import escape
from rich.table import Table

from crosscheck import output_folder as owned
from crosscheck.commands.shared.options import CONFIG, NAMED, TRUST, check_trust, collect_engines
from crosscheck.commands.shared.terminal import (
    COLOURS,
    JOBS,
    MODELS,
    PATTERNS,
    TIMEOUT,
    Console,
    Failure,
    convert_sigterm,
    match_engines,
    open_progress,
    plan_of,
)
from crosscheck.doors.registry import add_engine_limits
from crosscheck.report.explanations import list_certificates
from crosscheck.report.words import describe_run, format_short
from crosscheck.report.write_report import render
from crosscheck.run.runner import run
from crosscheck.run.work import Options, Work
from crosscheck.secrets import format_command_line
from crosscheck.verdicts.plan import Plan, Task
from crosscheck.verdicts.results import Results, make_slug
from crosscheck.workflows.model_summary import ModelSummary, picture, portrait
from crosscheck.workflows.proposals import format_proposal_toml, list_proposals, split_cases_file, write
from flexinv.errors import FlexinvError, InputError


@click.command("verify", short_help="Explain mechanism NAME, compare engines, propose limits.")
@click.argument("name")
@MODELS
@PATTERNS
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of its report; reports/verify/NAME by default.",
)
@click.option(
    "--write",
    "writes",
    is_flag=True,
    help="Put the proposed limits into cases.toml: at its end, or in place of those proposed before below its mark.",
)
@JOBS
@TIMEOUT
@CONFIG
@NAMED
@TRUST
def command(
    name: str,
    models: Path,
    engines: str,
    out: Path | None,
    writes: bool,
    jobs: int,
    timeout: float,
    config: Path | None,
    engine: tuple[str, ...],
    trust_commands: bool,
) -> None:
    """Explain what is in the files of mechanism NAME, compare the engines on it, and propose limits.

    Degrees of freedom, redundancy of constraints and drives, mass, reach, natural frequencies, largest efforts, a picture
    at rest and in motion; then every engine that can, and limits from their error bars, each with its reason.
    """
    console = Console()
    known = collect_engines(models, config, engine)
    wanted = match_engines(known.engines, engines)
    check_trust(known, wanted, trust_commands, lambda line: console.print(escape(line), soft_wrap=True))
    plan = add_engine_limits(plan_of(models, (name,)), wanted)
    if plan.broken:
        raise Failure(f"{name} cannot be read: {plan.broken[0][1]}")
    file = plan.tasks[0].folder / "cases.toml"
    if writes:
        _run_or_fail(split_cases_file, file)  # said before the engines run
    folder = out or Path("reports") / "verify" / make_slug(name)
    try:
        with owned.open_report_folder(folder):
            seen = [_describe_case(console, task, folder) for task in plan.tasks]
            results = _compare(plan, wanted, folder, Options(timeout, jobs))
            for solved, drawing in seen:
                picture(solved, owned.add_to_folder_list(drawing))
    except (InputError, OSError) as error:
        raise Failure(str(error)) from error
    _write_certificates(console, results)
    _write_results(console, results)
    for found in results.diagnoses:
        console.print(f"  {found.engine}: {found.words}", markup=False, highlight=False, soft_wrap=True)
    today = datetime.date.today()
    proposals = list_proposals(results.comparisons, today)
    source = f"crosscheck verify, {today.isoformat()}, {', '.join(_list_engine_versions(results))}"
    console.print("\n[bold]limits that the error bars suggest[/bold]")
    console.print(
        "\n".join(format_proposal_toml(p, source) for p in proposals), markup=False, highlight=False, soft_wrap=True
    )
    if writes:
        _run_or_fail(write, file, proposals, source)
        console.print(f"wrote them into {file}", highlight=False)
    console.print(f"report: {folder / 'index.html'}", highlight=False)
    if any(run_.verdict == "error" for run_ in results.runs):
        sys.exit(2)


def _run_or_fail(work: Callable[..., object], *arguments: object) -> None:
    try:
        work(*arguments)
    except (InputError, OSError) as error:
        raise Failure(str(error)) from error


def _describe_case(console: Console, task: Task, folder: Path) -> tuple[ModelSummary, Path]:
    """Print what a case is, and return it with the file in which its picture will be."""
    try:
        seen = portrait(task)
    except FlexinvError as error:
        raise Failure(f"{task.folder.name}/{task.case.name}: {error}") from error
    file = folder / f"picture-{make_slug(task.case.name)}.svg"
    console.print(f"\n[bold]{escape(f'{task.folder.name}/{task.case.name}')}[/bold]  {escape(task.case.title)}")
    for what, words in (*seen.lines, ("picture", str(file))):
        console.print(f"  {what:<15} {words}", markup=False, highlight=False, soft_wrap=True)
    return seen, file


def _compare(plan: Plan, wanted: dict, folder: Path, options: Options) -> Results:  # type: ignore[type-arg]
    quiet = Console(stderr=True)
    with convert_sigterm(), open_progress(quiet) as notify:
        results = run(Work(plan, wanted, (), options), folder, notify, format_command_line(sys.argv[1:]))
    render(results, folder)
    return results


def _write_certificates(console: Console, results: Results) -> None:
    """Say whether the engines' own models are the same mechanism, before their dynamics are compared."""
    console.print("\n[bold]certificates: what the engines' own models say[/bold]")
    for case in results.cases:
        for sheet in list_certificates(results, case):
            text = f"  {case.case} {sheet.engine:<16} {sheet.text}"
            console.print(text, markup=False, highlight=False, style=COLOURS[sheet.verdict], soft_wrap=True)


def _write_results(console: Console, results: Results) -> None:
    table = Table("case", "engine", "quantity", "unit", "difference", "error bars", "", box=None, header_style="dim")
    for row in results.comparisons:
        if row.maximum is None or row.scale is None:
            continue
        bars = format_short(row.error_bar / row.scale) if row.error_bar is not None and row.scale else "–"
        engine = row.engine if row.reference == "flexinv" else f"{row.engine} (against {row.reference})"
        verdict = f"[{COLOURS[row.verdict]}]{row.verdict}[/]"
        table.add_row(escape(row.case), engine, row.quantity, row.unit, format_short(row.fraction), bars, verdict)
    skipped = {(r.engine, r.message) for r in results.runs if r.status == "skipped"}
    console.print("\n[bold]engines against each other, parts of the range[/bold]")
    console.print(table)
    for engine, message in sorted(skipped):
        console.print(f"  {engine} is left out: {message}", markup=False, highlight=False, style="dim", soft_wrap=True)
    for run_ in results.runs:
        if run_.verdict == "error":
            console.print(f"  {run_.engine} failed: {run_.message}", markup=False, highlight=False, style="red")
    console.print(f"\n{escape(describe_run(results))}")


def _list_engine_versions(results: Results) -> list[str]:
    """Return the engines that gave something, each with its version."""
    ran = {run_.engine for run_ in results.runs if run_.status == "ok"}
    return sorted({f"{e.name.partition('-')[0]} {e.version}" for e in results.engines if e.version and e.name in ran})
