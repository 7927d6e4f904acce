"""``crosscheck corpus``: every case as a kit with consensus values; its bars audited; answers to the kits judged."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import click
from rich.markup import escape
from rich.table import Table

from crosscheck import output_folder as owned
from crosscheck.commands.shared.options import DOORS, RunSelection
from crosscheck.commands.shared.terminal import (
    FOLDER,
    JOBS,
    PATTERNS,
    TIMEOUT,
    Console,
    Failure,
    convert_sigterm,
    open_progress,
)
from crosscheck.commands.shared.terminal import make_out_option as out_option
from crosscheck.corpus.audit import TARGET, AuditRow, collect_by_class, is_target_met, run_audit, write_audit
from crosscheck.corpus.consensus import DISAGREEMENT
from crosscheck.corpus.folder import Corpus, write_corpus
from crosscheck.corpus.gather import find_all_consensus, run_panel
from crosscheck.corpus.judging import INSIDE, SKIPPED, find_exit_code, judge_answers
from crosscheck.corpus.notes import check_published, read_notes
from crosscheck.corpus.pages import render
from crosscheck.measures.record import RecordError
from crosscheck.report.words import format_short
from crosscheck.run.answer_cache import find_user_folder
from crosscheck.run.isolation import open_scratch_folder
from crosscheck.secrets import format_command_line
from crosscheck.verdicts.results import CaseRow, Results
from flexinv.errors import InputError


def _add_engine_options(command: click.decorators.FC) -> click.decorators.FC:
    for option in reversed(DOORS):
        command = option(command)
    return command


@click.command("corpus", short_help="Write every case as a kit with consensus values, or judge answers to them.")
@click.argument("names", nargs=-1)
@click.option(
    "--models",
    type=FOLDER,  # answers are judged where there is none
    default=Path("models"),
    show_default=True,
    help="Folder of mechanisms: one folder each, with mechanism.toml and cases.toml.  Not read with --judge.",
)
@PATTERNS
@out_option("corpus")
@click.option("--fresh", is_flag=True, help="Compute everything, also what has not changed since an earlier run.")
@click.option(
    "--audit",
    "audited",
    is_flag=True,
    help="Also run engines with twice the resolution, and count values inside the bars.",
)
@click.option(
    "--judge", type=FOLDER, metavar="ANSWERS", help="Judge answers instead: a folder of answer folders named by id."
)
@click.option("--against", type=FOLDER, default=Path("corpus"), show_default=True, help="With --judge: the corpus.")
@JOBS
@TIMEOUT
@_add_engine_options
def command(
    names: tuple[str, ...],
    models: Path,
    engines: str,
    out: Path,
    fresh: bool,
    audited: bool,
    judge: Path | None,
    against: Path,
    jobs: int,
    timeout: float,
    config: Path | None,
    engine: tuple[str, ...],
    trust_commands: bool,
) -> NoReturn:
    """Write every case of a folder of models as a kit with consensus values, and pages that say who agrees and who does not.

    NAMES are mechanisms, patterns or single cases; without names all. The consensus of a series is the interval in which the
    error bars of engines of different authors meet. What `crosscheck run` has kept is taken.

    \b
      crosscheck corpus --out corpus             kits, consensus, manifest.json, index.html
      crosscheck corpus --out corpus --audit     the same, and the audit of the error bars
      crosscheck corpus --judge answers --against corpus

    \b
    Exit codes: 0 no disagreement (all answers inside); 1 some authors disagree, or the audit misses its target (an answer lies
    outside); 2 an engine or a model failed, nothing could be judged
    """
    console = Console(stderr=True)
    if judge is not None:
        _judge(judge, against)
    if not models.is_dir():
        raise click.BadParameter(f"Directory '{models}' does not exist.", param_hint="'--models'")
    run_selection = RunSelection(names, models, engines, "", "", False, jobs, timeout, config, engine, trust_commands)
    work = run_selection.prepare_work(lambda line: console.print(escape(line), soft_wrap=True))
    options = replace(work.options, kept=find_user_folder(), fresh=fresh or bool(os.environ.get("CI")))
    work = replace(work, options=options)
    try:
        notes = read_notes(models)
        check_published(notes, work.plan.tasks, models, whole=not names)
        with (
            owned.open_report_folder(out),
            open_scratch_folder() as place,
            convert_sigterm(),
            open_progress(console) as notify,
        ):
            panel = run_panel(work, notes, place / "run", notify, format_command_line(sys.argv[1:]))
            if not panel.results.finished:
                raise Failure(
                    f"{panel.results.message or 'interrupted'}; nothing was written, and what was computed is kept"
                )
            found = list(find_all_consensus(work, panel, place / "run"))
            rows = run_audit(work, found, place, notify) if audited else []
            owned.begin(out)
            corpus = write_corpus(found, notes, panel.results, out)
            if audited:
                write_audit(rows, out)
            render(corpus, found, rows)
    except (InputError, RecordError, OSError) as error:
        raise Failure(str(error)) from error
    _write_summary_and_end(console, corpus, panel.results, rows if audited else None)


def _write_summary_and_end(
    console: Console, corpus: Corpus, results: Results, rows: Sequence[AuditRow] | None
) -> NoReturn:
    """Say what was written, and leave with the exit code."""
    if rows is not None:
        console.print(_make_audit_table(rows))
    broken = [case for case in results.cases if case.problem]
    failed = [run for run in results.runs if run.verdict == "error"]
    split = [one for one in corpus.entries if one["status"] == DISAGREEMENT]
    _write_troubles(console, broken, split)
    whole = sum(bool(one["every series"]) for one in corpus.entries)
    words = f"{corpus.reached} of {len(corpus.entries)} cases have a consensus in every torque, {whole} of them in every series"
    more = f"; {len(failed)} runs failed" if failed else ""
    console.print(f"[bold]{words}{more}.[/]", highlight=False, soft_wrap=True)
    console.print(f"corpus: {corpus.folder / 'index.html'}", highlight=False, soft_wrap=True)
    if failed or broken or not corpus.entries:
        sys.exit(2)
    missed = rows is not None and not is_target_met(rows)
    sys.exit(int(bool(split) or missed))


def _write_troubles(console: Console, broken: Iterable[CaseRow], split: Iterable[Mapping[str, Any]]) -> None:
    """Say which models cannot be read, and of which cases authors disagree."""
    for case in broken:
        console.print(f"[bold red]![/] {escape(f'{case.mechanism}: {case.problem}')}", highlight=False, soft_wrap=True)
    for one in split:
        line = f"{one['mechanism']}/{one['case']}: authors disagree; cases/{one['id']}.html says why"
        console.print(escape(line), style="red", highlight=False, soft_wrap=True)


def _make_audit_table(rows: Sequence[AuditRow]) -> Table:
    """Return the audit as a table for a terminal."""
    table = Table(title=f"Error bars: values of the finer run inside them, target {100 * TARGET:g} %")
    for name in ("class", "engine", "what was finer", "series", "samples", "inside", "worst series"):
        table.add_column(name, justify="right" if name in ("series", "samples", "inside") else "left")
    for one in [*rows, *collect_by_class(rows)]:
        style = "bold" if one.engine == "all" else ""
        worst = f"{one.worst} {100 * one.worst_share:.1f} %"
        cells = (one.kind, one.engine, one.how, str(one.series), str(one.samples), f"{100 * one.share:.2f} %", worst)
        table.add_row(*map(escape, cells), style=style)
    return table


def _judge(answers: Path, corpus: Path) -> NoReturn:
    """Judge answers, print what they are worth, and leave with the exit code."""
    try:
        rows = judge_answers(answers, corpus)
    except (InputError, OSError) as error:
        raise Failure(str(error)) from error
    for row in rows:
        apart = (
            ""
            if row.verdict in (INSIDE, SKIPPED) or not row.outside
            else (f", {100 * row.outside:.3g} % of the samples, by up to {format_short(row.distance)} of the range")
        )
        click.echo(f"{row.verdict:<8} {row.id} {row.series}{apart}{': ' + row.words if row.words else ''}")
    inside = sum(row.verdict == INSIDE for row in rows)
    counted = sum(row.verdict != SKIPPED for row in rows)
    among = len({row.id for row in rows if row.verdict != SKIPPED})
    click.echo(f"{inside} of {counted} series lie inside the consensus, in {among} cases.")
    sys.exit(find_exit_code(rows))
