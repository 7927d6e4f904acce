"""``crosscheck bless``: the measured values of a run become those that later runs are judged by."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import click
from rich.markup import escape

from crosscheck.commands.shared.terminal import FOLDER, Console, Failure
from crosscheck.report.words import describe_group
from crosscheck.run.run_state import RESULTS
from crosscheck.verdicts import baseline as blessed
from crosscheck.verdicts import results as store


@click.command("bless", short_help="Bless a run: later ones may not be worse.")
@click.option(
    "--reason", required=True, help="Why these values are right: a sentence for whoever reads the file's history."
)
@click.option(
    "--from",
    "folder",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    default=Path("reports/latest"),
    show_default=True,
    help="Report of the run to bless.",
)
@click.option(
    "--baseline",
    type=FOLDER,
    default=Path("reports/baseline"),
    show_default=True,
    help="Folder of the blessed night.",
)
def command(reason: str, folder: Path, baseline: Path) -> NoReturn:
    """Bless a run: what it measured is right, and later runs may not be worse.

    Look at its report first.  Every comparison that is inside its limit gets its value of today; the others are
    listed, keep the value that they had, and make the exit code 1.  With them the signals of every engine are blessed: peak, RMS
    and values with their error bars.  What moves is shown, old and new.  Of a run over a part only that part changes.
    The files of the baseline belong into version control, so that a change of them can be reviewed.
    """
    if not reason.strip():
        raise Failure(
            '--reason is empty: say why these values are right, such as "Exudyn 1.14 has a finer default step"'
        )
    try:
        results = store.read(folder / RESULTS)
        old = blessed.find(baseline)
        before = old.fractions
    except (OSError, ValueError) as error:
        raise Failure(f"cannot read what to bless: {error}") from error
    if not results.finished:
        raise Failure(f"the run in {folder} has not finished ({results.message or 'no message'}): bless a complete one")
    good, bad = blessed.choose_blessable(results)
    try:
        signals = blessed.choose_blessed_signals(results, blessed.collect_signals(results, folder), good)
        moves = blessed.find_all_moves(results, signals, old)
        blessed.write(baseline, results, good, reason.strip(), signals)
        after = blessed.read(baseline).fractions
    except (OSError, ValueError) as error:
        raise Failure(f"the baseline in {baseline} could not be written: {error}") from error
    console = Console()
    moved = [k for k in after if k in before and after[k] != before[k]]
    new = after.keys() - before.keys()
    gone = before.keys() - after.keys()
    console.print(f"{len(good)} comparisons blessed: {len(new)} new, {len(moved)} changed, {len(gone)} dropped")
    for k in moved:
        console.print(f"  {escape(' '.join(k))}: {before[k]:.3g} -> {after[k]:.3g}", highlight=False, soft_wrap=True)
    fresh = len(signals.keys() - old.signals.keys())
    console.print(f"{len(signals)} signals blessed: {fresh} new, {len(moves)} moved by more than their error bars")
    for group in replace(results, moves=moves).moves_by_reason.values():
        for line in describe_group(group):
            console.print(f"  {escape(line)}", highlight=False, soft_wrap=True)
    for line in bad:
        console.print(f"[red]not blessed[/] {escape(line)}", highlight=False, soft_wrap=True)
    sys.exit(1 if bad else 0)
