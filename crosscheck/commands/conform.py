"""``crosscheck conform``: the ladder that an engine climbs, and which of its rungs hold."""

from __future__ import annotations

import secrets
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import click
from rich.markup import escape

from crosscheck import output_folder as owned
from crosscheck.commands.shared.options import CONFIG, NAMED, TRUST, check_trust, collect_engines
from crosscheck.commands.shared.terminal import (
    COLOURS,
    JOBS,
    TIMEOUT,
    Console,
    Failure,
    convert_sigterm,
    match_entries,
    open_progress,
    plan_of,
)
from crosscheck.commands.shared.terminal import make_out_option as out_option
from crosscheck.conform import blind as rounds
from crosscheck.conform import ladder
from crosscheck.doors.registry import COMMAND, FMU, RECORD
from crosscheck.engines import Engine
from crosscheck.measures.limits import REFERENCE
from crosscheck.report.write_report import render
from crosscheck.run.isolation import open_scratch_folder
from crosscheck.run.run_state import RESULTS
from crosscheck.run.runner import run
from crosscheck.run.work import Options, Work
from crosscheck.secrets import format_command_line
from crosscheck.verdicts import results as store
from crosscheck.verdicts.results import Results
from flexinv.errors import InputError

OPEN = "The numbers of the mechanisms are those that every installation has."
BLIND = (
    "Blind: masses, lengths, placements, drives and motions were changed by seed {seed}, drawn when the round began; no expected "
    "value left this process.\n\nPrograms ran in an empty folder without this project in reach: {programs}. "
    "Engines inside our process could have asked it: {inside}."
)
FIXED = {RECORD: "a record", FMU: "an FMU, whose numbers are compiled in"}  # what answers for one mechanism alone


@click.command("conform", short_help="Say which rungs of the ladder an engine holds.")
@click.argument("engines")
@click.option(
    "--models",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("models"),
    show_default=True,
    help="Folder of mechanisms, above which crosscheck.toml is searched; it need not exist.",
)
@CONFIG
@NAMED
@TRUST
@click.option(
    "--blind", is_flag=True, help="Change all numbers by a seed that is drawn now; programs see nothing of ours."
)
@click.option("--seed", type=click.IntRange(min=0), help="With --blind: the seed of an earlier round.")
@click.option(
    "--rungs",
    default="*",
    show_default=True,
    help=f"Names or patterns of rungs, separated by commas: {', '.join(ladder.RUNGS)}.",
)
@out_option("reports/conform")
@JOBS
@TIMEOUT
def command(
    engines: str,
    models: Path,
    config: Path | None,
    engine: tuple[str, ...],
    trust_commands: bool,
    blind: bool,
    seed: int | None,
    rungs: str,
    out: Path,
    jobs: int,
    timeout: float,
) -> NoReturn:
    """Let ENGINES (names or patterns) climb the ladder: from a double pendulum to damped beams in space, and the certificate.

    The report has a page with every rung, results.json and junit.xml; the last line may be quoted.  Exit code 0: all rungs that
    were climbed hold, and one was; 1: one does not hold; 2: an engine failed.
    """
    console = Console(stderr=True)
    known = collect_engines(models, config, engine)
    wanted = {name: one for name, one in match_entries(known.engines, engines, "engine").items() if name != REFERENCE}
    if not wanted:
        raise Failure(f"{engines!r} leaves no engine beside {REFERENCE}, which is what they are compared with")
    if seed is not None and not blind:
        raise Failure("--seed belongs to --blind")
    check_trust(known, wanted, trust_commands, lambda line: console.print(escape(line), soft_wrap=True))
    if blind:
        for name, one in wanted.items():
            if why := FIXED.get(one.module):
                raise Failure(f"{name} is {why}: it cannot be asked blind")
        seed = secrets.randbits(32) if seed is None else seed
        wanted = {name: _make_blind_engine(one) for name, one in wanted.items()}
    names = tuple(match_entries(ladder.RUNGS, rungs, "rung"))
    taking = {REFERENCE: known.engines[REFERENCE], **wanted}
    with open_scratch_folder() as folder:
        place = ladder.FOLDER
        if seed is not None:
            place = folder / "models"
            rounds.write_blind_models(ladder.FOLDER, place, seed)
        work = Work(plan_of(place, names), taking, (), Options(timeout, jobs, climbing=True))
        try:
            with owned.open_report_folder(out), convert_sigterm(), open_progress(console) as notify:
                results = run(work, out, notify, format_command_line(sys.argv[1:]))
                results = _add_ladder_table(results, wanted, seed, out)
        except (InputError, OSError) as error:
            raise Failure(str(error)) from error
    _write_ladder_and_end(console, results, wanted, seed, out)


def _make_blind_engine(engine: Engine) -> Engine:
    """Return an engine as a blind round asks it: a program without anything of ours in reach."""
    if engine.module != COMMAND or engine.settings is None:
        return engine
    return replace(engine, settings={**engine.settings, "blind": True})


def _add_ladder_table(results: Results, engines: Mapping[str, Engine], seed: int | None, out: Path) -> Results:
    """Return the results with the table of the ladder, written and rendered."""
    outside = [name for name, one in engines.items() if one.module == COMMAND]
    inside = [name for name in engines if name not in outside]
    words = {"programs": ", ".join(outside) or "none", "inside": ", ".join(inside) or "none"}
    text = OPEN if seed is None else BLIND.format(seed=seed, **words)
    results = replace(results, studies=(ladder.make_ladder_table(results, tuple(engines), text),))
    store.write(results, out / RESULTS)
    render(results, out)
    return results


def _write_ladder_and_end(
    console: Console, results: Results, engines: Mapping[str, Engine], seed: int | None, out: Path
) -> NoReturn:
    """Show the rungs, the line to quote for each engine, and leave with the exit code."""
    code = 2 if results.message else 0
    for name, one in engines.items():
        blind = "" if seed is None else f", {'blind' if one.module == COMMAND else 'numbers unknown'} (seed {seed})"
        climbed = list(ladder.list_rungs(results, name))
        for rung in climbed:
            line = f"  {rung.name.replace('_', ' '):<17} {rung.message}"
            console.print(line, style=COLOURS[rung.verdict], markup=False, highlight=False, soft_wrap=True)
        code = max(code, ladder.find_exit_code(climbed))
        click.echo(ladder.describe_engine(results, name, blind))
    console.print(f"report: {out / 'studies' / 'conform.html'}", highlight=False, soft_wrap=True)
    sys.exit(code)
