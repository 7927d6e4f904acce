"""``crosscheck identify``: from logs to parameters with intervals, torques with bands, and what remains."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from rich.markup import escape
from rich.table import Table

from crosscheck import output_folder as owned
from crosscheck.commands.shared.terminal import MODELS, Console, Failure
from crosscheck.identification.bands import Judged
from crosscheck.identification.causes import name_causes
from crosscheck.identification.files import write_judged, write_parameters, write_prediction
from crosscheck.identification.identify import Identified, blocks, identify, machine_of
from crosscheck.identification.log import read_log
from crosscheck.report.words import short
from flexinv.errors import FlexinvError

FOLD = "Cut the window of the first log into so many blocks; each is judged by what the others tell."


@click.command("identify", short_help="Find the parameters of NAME in logs, with intervals.")
@click.argument("name")
@MODELS
@click.option(
    "--log",
    "logs",
    multiple=True,
    required=True,
    help="Log that identifies (.csv, .csv.gz, .parquet, .mat); LOG@START:END takes these seconds of it. Repeatable.",
)
@click.option("--hold-out", multiple=True, help="Log that only judges. Repeatable.")
@click.option("--predict", "wanted", help="Log whose efforts are predicted; its own efforts are not looked at.")
@click.option("--blocks", "count", type=click.IntRange(min=2), help=FOLD)
@click.option(
    "--causes", "asked", is_flag=True, help="Name what the logs held out (else the first log) show beside the model."
)
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), help="Folder; reports/identify/NAME by default."
)
def command(
    name: str,
    models: Path,
    logs: tuple[str, ...],
    hold_out: tuple[str, ...],
    wanted: str | None,
    count: int | None,
    asked: bool,
    out: Path | None,
) -> None:
    """Identify parameters of mechanism NAME from logs, with intervals; predict other logs, with bands.

    identify.toml beside mechanism.toml says which column is what, which parameters are free, and what is known of them.
    """
    console = Console()
    folder = out or Path("reports") / "identify" / name
    source = models / name
    try:
        with owned.report(folder):
            found = identify(source, _located(source, logs), _located(source, hold_out))
            write_parameters(found.parameters, owned.claim(folder / "parameters.csv"))
            write_judged(found.seen, found.judged, owned.claim(folder / "judged.csv"))
            if wanted is not None:
                log = read_log(_located(source, (wanted,))[0], found.machine.settings.time)
                write_prediction(found.machine, found.predict(log), owned.claim(folder / "prediction.csv"))
            _say(console, found)
            for held in (_located(source, hold_out) or _located(source, logs[:1])) if asked else ():
                _causes(console, found, held)
            if count is not None:
                log = read_log(_located(source, logs[:1])[0], found.machine.settings.time)
                _table(console, f"{count} blocks in turn", blocks(machine_of(source), log, count))
    except (FlexinvError, OSError) as error:
        raise Failure(str(error)) from error
    console.print(f"results: {folder}", highlight=False, soft_wrap=True)
    sys.exit(0)


def _located(folder: Path, logs: tuple[str, ...]) -> list[str]:
    """Return logs by their paths; one that is not there is looked for beside the mechanism."""
    return [
        str(folder / log)
        if not Path(log.partition("@")[0]).exists() and (folder / log.partition("@")[0]).exists()
        else log
        for log in logs
    ]


def _say(console: Console, found: Identified) -> None:
    told = [row for row in found.parameters if row.identifiable]
    console.print(
        f"{len(told)} of {len(found.parameters)} parameters are told by the logs; intervals hold 90 %", highlight=False
    )
    table = Table("parameter", "place", "value", "90 % interval", "before", "unit", box=None, header_style="dim")
    for row in told:
        interval = f"{short(row.low)} to {short(row.high)}"
        table.add_row(row.parameter, row.place, short(row.value), interval, short(row.before), row.unit)
    console.print(table)
    _table(console, "logs that identify", found.seen)
    if found.judged:
        _table(console, "logs held out", found.judged)
    for words in found.words:
        console.print(escape(words), highlight=False, soft_wrap=True, style="dim")


def _causes(console: Console, found: Identified, log: str) -> None:
    named = name_causes(found.machine, found.fit, read_log(log, found.machine.settings.time))
    lines = [one.words for one in named] or ["no cause of the dictionary explains what remains: unknown"]
    console.print(f"\n[bold]what remains of {escape(Path(log).name)}[/bold]")
    for words in lines:
        console.print(escape(words), highlight=False, soft_wrap=True)


def _table(console: Console, title: str, rows: list[Judged]) -> None:
    heads = ("log", "channel", "explained", "all samples", "in 90 % band", "width / RMS error", "RMS error", "unit")
    table = Table(*heads, box=None)
    for r in rows:
        numbers = (f"{r.explained:.4f}", f"{r.explained_all:.4f}", f"{r.coverage:.1%}", f"{r.width:.2f}", short(r.rms))
        table.add_row(escape(r.log), r.channel, *numbers, r.unit)
    console.print(f"\n[bold]{escape(title)}[/bold]")
    console.print(table)
