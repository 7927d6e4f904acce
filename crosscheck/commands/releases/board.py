"""``crosscheck board``: cases by engines by releases, as a page."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import click
from rich.markup import escape

from crosscheck import output_folder as owned
from crosscheck.bisect.cases import PACKAGES
from crosscheck.bisect.environments import GIGABYTE, EnvironmentStore, find_store_folder
from crosscheck.bisect.installers import Index, choose_installer
from crosscheck.board.cells import CANNOT_RUN, NO_SCRIPT, OUTSIDE, WITHIN
from crosscheck.board.consensus import NO_CORPUS, BoardConsensus, read_consensus
from crosscheck.board.fill import BoardWorkers
from crosscheck.board.make import USUAL, BoardWish, FilledBoard, choose_engines, make_board
from crosscheck.board.pages import write_board
from crosscheck.commands.shared.terminal import (
    FOLDER,
    JOBS,
    MODELS,
    TIMEOUT,
    Console,
    Failure,
    convert_sigterm,
    open_progress,
    plan_of,
    split_patterns,
)
from crosscheck.corpus.folder import MANIFEST
from crosscheck.verdicts.plan import Task
from flexinv.errors import InputError

CORPUS = Path("corpus")


@click.command("board", short_help="Show which releases of the engines are right, case by case.")
@click.argument("names", nargs=-1)
@MODELS
@click.option(
    "--engines",
    default=",".join(USUAL),
    show_default=True,
    help=f"Engines with commas between: {', '.join(PACKAGES)}.",
)
@click.option(
    "--releases", "count", type=click.IntRange(min=1), default=5, show_default=True, help="Newest releases of each."
)
@click.option(
    "--against",
    type=FOLDER,
    help="Corpus whose consensus judges.  [default: corpus, where that is one; else flexinv's efforts judge]",
)
@click.option("--out", type=FOLDER, default=Path("board"), show_default=True, help="Folder of the board.")
@click.option("--environments", type=FOLDER, help="Folder of the environments.  [default: the user's cache]")
@click.option(
    "--disk", type=click.FloatRange(min=0.1), default=10.0, show_default=True, help="Gigabytes that they may take."
)
@click.option(
    "--installer",
    type=click.Choice(["auto", "uv", "pip"]),
    default="auto",
    show_default=True,
    help="What makes environments; auto: uv where it is installed.",
)
@click.option("--find-links", multiple=True, help="Folder or page with files. Repeatable.")
@click.option("--no-index", is_flag=True, help="Only what --find-links names.")
@click.option(
    "--scheduler", default="", help="Address of a Dask scheduler, tcp://host:8786: releases run on its workers."
)
@JOBS
@TIMEOUT
def command(
    names: tuple[str, ...],
    models: Path,
    engines: str,
    count: int,
    against: Path | None,
    out: Path,
    environments: Path | None,
    disk: float,
    installer: str,
    find_links: tuple[str, ...],
    no_index: bool,
    scheduler: str,
    jobs: int,
    timeout: float,
) -> NoReturn:
    """Run every case in several releases of the engines, each in an environment of its own, and write a board.

    NAMES are mechanisms, patterns or single cases; without names all. A case is exported as a script that needs one engine
    alone. Its efforts are held against the consensus of the case, as `crosscheck corpus` has written it, and where there is
    none against flexinv's, within the limit of the case.

    \b
      crosscheck corpus --out corpus                                what engines of different authors agree on
      crosscheck board --out board                                  the three engines, five releases each
      crosscheck board 'rigid_*' --engines mujoco --releases 20     one engine, further back

    The folder holds index.html, board.json, board.csv and badges/ENGINE.svg. A second run computes what is new: cases,
    releases, adapters, sources and consensus values that have changed. After Ctrl-C the same command goes on.

    Releases are computed several at a time (--jobs), or by a cluster (--scheduler), each in one go by one worker.
    Packages of the index run with your rights, as those that crosscheck bisect tries.

    \b
    Exit codes: 0  every cell that was judged is within   1  some are outside   2  nothing could be judged, or it failed
    """
    console = Console(stderr=True)

    def write_line(line: str) -> None:
        console.print(escape(line), highlight=False, soft_wrap=True)

    try:
        chosen = choose_engines(split_patterns(engines))
        plan = plan_of(models, names)
        for name, words in plan.broken:
            console.print(escape(f"{name} cannot be read: {words}"), highlight=False, soft_wrap=True, style="red")
        consensus = _read_consensus(against, plan.tasks)
        made = choose_installer(installer, Index(links=find_links, offline=no_index), sources=False)
        store = EnvironmentStore(environments or find_store_folder(), made, disk * GIGABYTE)
        workers = BoardWorkers(jobs, scheduler, environments is None, write_line)
        wish = BoardWish(chosen, count, store, workers, timeout)
        with owned.open_report_folder(out), convert_sigterm():
            with open_progress(console) as notify:
                board = make_board(wish, plan.tasks, consensus, out, notify)
            write_board(board.cells, board.releases, out, consensus.notes)
    except KeyboardInterrupt:
        raise Failure("interrupted: what was computed is kept, the same command goes on") from None
    except (InputError, OSError) as error:
        raise Failure(str(error)) from error
    code = _write_summary(console, board, out)
    sys.exit(2 if plan.broken else code)


def _read_consensus(against: Path | None, tasks: Sequence[Task]) -> BoardConsensus:
    """Return the consensus of a corpus.  Raises InputError where one is asked for that is not there."""
    if against is None and not (CORPUS / MANIFEST).is_file():
        return BoardConsensus(notes=(NO_CORPUS,))
    return read_consensus(against or CORPUS, tasks)


def _write_summary(console: Console, board: FilledBoard, out: Path) -> int:
    """Say what is on the board, and return the exit code."""
    cells = board.cells
    counted = {state: sum(cell.state == state for cell in cells) for state in (WITHIN, OUTSIDE, CANNOT_RUN, NO_SCRIPT)}
    words = ", ".join(f"{number} {state}" for state, number in counted.items())
    console.print(
        f"[bold]{len(cells)} cells: {words}[/]; {board.computed} were computed now", highlight=False, soft_wrap=True
    )
    for cell in cells:
        if cell.state == OUTSIDE:
            where = f"{cell.mechanism}/{cell.case} in {cell.engine} {cell.release}"
            line = f"{where}: {cell.distance:.2g} of the range from {cell.against}. {cell.words}"
            console.print(escape(line), highlight=False, soft_wrap=True, style="red")
    console.print(f"board: {out / 'index.html'}", highlight=False, soft_wrap=True)
    return 1 if counted[OUTSIDE] else 0 if counted[WITHIN] else 2
