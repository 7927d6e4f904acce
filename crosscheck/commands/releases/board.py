"""``crosscheck board``: cases by engines by releases, as a page."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import NoReturn

import click
from rich.markup import escape

from crosscheck import output_folder as owned
from crosscheck.bisect.cases import PACKAGES, find_package, resolve_engine
from crosscheck.bisect.environments import GIGABYTE, EnvironmentStore, find_store_folder
from crosscheck.bisect.installers import Index, choose_installer
from crosscheck.bisect.pythons import find_pythons
from crosscheck.bisect.releases import Release, ReleaseQuery, list_releases
from crosscheck.board.cells import CANNOT_RUN, NO_SCRIPT, OUTSIDE, WITHIN, Cell, read_cells
from crosscheck.board.fill import Board
from crosscheck.board.pages import VERDICTS, write_board
from crosscheck.board.scripts import BoardScript, prepare_script
from crosscheck.commands.shared.terminal import (
    FOLDER,
    MODELS,
    TIMEOUT,
    Console,
    Failure,
    convert_sigterm,
    open_progress,
    plan_of,
    split_patterns,
)
from crosscheck.engines import ENGINES, describe_missing_package
from crosscheck.run.forking import ForkServers
from crosscheck.run.isolation import ChildProcesses
from crosscheck.run.work import Event
from crosscheck.verdicts.plan import Task
from flexinv.errors import InputError

SCRIPTS = "scripts"
Notify = Callable[[Event], None]
DEFAULT = "mujoco,pinocchio,exudyn"


@click.command("board", short_help="Show which releases of the engines are right, case by case.")
@click.argument("names", nargs=-1)
@MODELS
@click.option(
    "--engines", default=DEFAULT, show_default=True, help=f"Engines with commas between: {', '.join(PACKAGES)}."
)
@click.option(
    "--releases", "count", type=click.IntRange(min=1), default=5, show_default=True, help="Newest releases of each."
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
@TIMEOUT
def command(
    names: tuple[str, ...],
    models: Path,
    engines: str,
    count: int,
    out: Path,
    environments: Path | None,
    disk: float,
    installer: str,
    find_links: tuple[str, ...],
    no_index: bool,
    timeout: float,
) -> NoReturn:
    """Run every case in several releases of the engines, each in an environment of its own, and write a board.

    NAMES are mechanisms, patterns or single cases; without names all. A case is exported as a script that needs one engine
    alone, and its efforts are held against flexinv's, within the limit of the case.

    \b
      crosscheck board --out board                                  the three engines, five releases each
      crosscheck board 'rigid_*' --engines mujoco --releases 20     one engine, further back

    The folder holds index.html, board.json, board.csv and badges/ENGINE.svg. A second run computes what is new: cases,
    releases, adapters and sources that have changed. After Ctrl-C the same command goes on.

    Packages of the index run with your rights, as those that crosscheck bisect tries.

    \b
    Exit codes: 0  every cell that was judged is within   1  some are outside   2  nothing could be judged, or it failed
    """
    console = Console(stderr=True)
    try:
        chosen = _choose_engines(engines)
        plan = plan_of(models, names)
        for name, words in plan.broken:
            console.print(escape(f"{name} cannot be read: {words}"), highlight=False, soft_wrap=True, style="red")
        with owned.open_report_folder(out), convert_sigterm():
            owned.make_listed_folder(out)
            made = choose_installer(installer, Index(links=find_links, offline=no_index), sources=False)
            store = EnvironmentStore(environments or find_store_folder(), made, disk * GIGABYTE)
            releases = {engine: _list_newest(engine, count, made.index) for engine in chosen}
            with open_progress(console) as notify:
                scripts = _prepare_scripts(plan.tasks, chosen, out / SCRIPTS, timeout, notify)
                board = Board(scripts, releases, store, out, read_cells(out), _make_notifier(notify))
                cells = board.fill_cells()
            versions = {engine: [str(release) for release in of_engine] for engine, of_engine in releases.items()}
            write_board(cells, versions, out)
    except KeyboardInterrupt:
        raise Failure("interrupted: what was computed is kept, the same command goes on") from None
    except (InputError, OSError) as error:
        raise Failure(str(error)) from error
    code = _write_summary(console, cells, board.computed, out)
    sys.exit(2 if plan.broken else code)


def _choose_engines(patterns: str) -> list[str]:
    """Return the engines by name.  Raises InputError for one that no package brings, or that is not installed here."""
    chosen = list(dict.fromkeys(resolve_engine(name) for name in split_patterns(patterns)))
    for name in chosen:
        if (reason := describe_missing_package(ENGINES[name])) is not None:
            raise InputError(
                f"{name} writes the scripts of its cases, with the release that is installed here: {reason}"
            )
    if not chosen:
        raise InputError(f"--engines names none; write some of {', '.join(PACKAGES)}")
    return chosen


def _list_newest(engine: str, count: int, index: Index) -> list[Release]:
    """Return the newest releases of an engine that have a wheel for this Python, the oldest of them first."""
    releases = list_releases(find_package(engine), find_pythons([]), index, ReleaseQuery())
    return [release for release in releases if release.python is not None][-count:]


def _prepare_scripts(
    tasks: Sequence[Task], engines: Sequence[str], folder: Path, timeout: float, notify: Notify
) -> dict[str, list[BoardScript]]:
    """Return the scripts of all cases by engine.  timeout : [s] of an export and of a run"""
    scripts: dict[str, list[BoardScript]] = {engine: [] for engine in engines}
    count = len(tasks) * len(engines)
    with closing(ForkServers()) as servers:  # engines are imported once
        children = ChildProcesses(servers=servers)
        for task, engine in itertools.product(tasks, engines):
            script = prepare_script(task, ENGINES[engine], folder, timeout, children)
            scripts[engine].append(script)
            label = f"{task.folder.name}/{task.case.name} for {engine}"
            verdict = "ok" if script.made else "skipped"
            notify(Event(label, verdict, script.refused, sum(map(len, scripts.values())), count))
    return scripts


def _make_notifier(notify: Notify) -> Callable[[Cell, int, int], None]:
    """Return the function that tells of each cell."""

    def send_event(cell: Cell, done: int, count: int) -> None:
        label = f"{cell.mechanism}/{cell.case} in {cell.engine} {cell.release}"
        notify(Event(label, VERDICTS[cell.state], cell.words, done, count))

    return send_event


def _write_summary(console: Console, cells: list[Cell], computed: int, out: Path) -> int:
    """Say what is on the board, and return the exit code."""
    counted = {state: sum(cell.state == state for cell in cells) for state in (WITHIN, OUTSIDE, CANNOT_RUN, NO_SCRIPT)}
    words = ", ".join(f"{number} {state}" for state, number in counted.items())
    console.print(
        f"[bold]{len(cells)} cells: {words}[/]; {computed} were computed now", highlight=False, soft_wrap=True
    )
    for cell in cells:
        if cell.state == OUTSIDE:
            line = f"{cell.mechanism}/{cell.case} in {cell.engine} {cell.release}: {cell.distance:.2g} of the range. {cell.words}"
            console.print(escape(line), highlight=False, soft_wrap=True, style="red")
    console.print(f"board: {out / 'index.html'}", highlight=False, soft_wrap=True)
    return 1 if counted[OUTSIDE] else 0 if counted[WITHIN] else 2
