"""Make a board: the newest releases of each engine, scripts of all cases, cells; for the command, and for nights."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from crosscheck import output_folder as owned
from crosscheck.bisect.cases import PACKAGES, find_package, resolve_engine
from crosscheck.bisect.environments import EnvironmentStore
from crosscheck.bisect.installers import Index
from crosscheck.bisect.pythons import find_pythons
from crosscheck.bisect.releases import Release, ReleaseQuery, list_releases
from crosscheck.board.cells import Cell, read_cells
from crosscheck.board.consensus import BoardConsensus
from crosscheck.board.fill import Board, BoardWorkers
from crosscheck.board.pages import VERDICTS
from crosscheck.board.scripts import BoardScript, prepare_script
from crosscheck.engines import ENGINES, describe_missing_package
from crosscheck.run.cluster import open_workers
from crosscheck.run.forking import KEPT_SERVERS
from crosscheck.run.isolation import ChildProcesses
from crosscheck.run.work import Event, Notify
from crosscheck.verdicts.plan import Task
from flexinv.errors import InputError

SCRIPTS = "scripts"
USUAL = ("mujoco", "pinocchio", "exudyn")


@dataclass(frozen=True)
class BoardWish:
    """Wish for a board: engines, how many of their newest releases, environments, hands, time of an export and of a run [s]."""

    engines: tuple[str, ...]
    count: int
    store: EnvironmentStore
    workers: BoardWorkers = field(default_factory=BoardWorkers)
    timeout: float = 900.0


@dataclass(frozen=True)
class FilledBoard:
    """A board that is filled: cells, releases by engine from the oldest to the newest, and how many cells were computed now."""

    cells: Sequence[Cell]
    releases: Mapping[str, Sequence[str]]
    computed: int


def choose_engines(names: Sequence[str]) -> tuple[str, ...]:
    """Return the engines by name.  Raises InputError for one that no package brings, or that is not installed here."""
    chosen = tuple(dict.fromkeys(resolve_engine(name) for name in names))
    for name in chosen:
        if (reason := describe_missing_package(ENGINES[name])) is not None:
            raise InputError(
                f"{name} writes the scripts of its cases, with the release that is installed here: {reason}"
            )
    if not chosen:
        raise InputError(f"--engines names none; write some of {', '.join(PACKAGES)}")
    return chosen


def make_board(
    wish: BoardWish, tasks: Sequence[Task], consensus: BoardConsensus, folder: Path, notify: Notify
) -> FilledBoard:
    """Return a board of cases; scripts and cells are kept in a folder that is ours, and taken from there.

    Raises InputError where an engine has no release, or the index or the cluster does not answer.
    """
    owned.make_listed_folder(folder)
    if wish.workers.scheduler:
        with open_workers(wish.workers.scheduler, wish.workers.jobs):
            pass  # a cluster that does not answer is said before anything is exported
    releases = {engine: list_newest_releases(engine, wish.count, wish.store.installer.index) for engine in wish.engines}
    scripts = _prepare_scripts(tasks, wish, folder / SCRIPTS, notify)
    board = Board(
        scripts, releases, wish.store, folder, read_cells(folder), consensus, wish.workers, _make_notifier(notify)
    )
    cells = board.fill_cells()
    named = {engine: [str(release) for release in of_engine] for engine, of_engine in releases.items()}
    return FilledBoard(cells, named, board.computed)


def list_newest_releases(engine: str, count: int, index: Index) -> list[Release]:
    """Return the newest releases of an engine that have a wheel for this Python, the oldest of them first."""
    package = find_package(engine)
    releases = list_releases(package, find_pythons([]), index, ReleaseQuery())
    chosen = [release for release in releases if release.python is not None][-count:]
    if not chosen:
        raise InputError(f"no release of {package} has a wheel for this Python: leave {engine} out of --engines")
    return chosen


def _prepare_scripts(
    tasks: Sequence[Task], wish: BoardWish, folder: Path, notify: Notify
) -> dict[str, list[BoardScript]]:
    """Return the scripts of all cases by engine."""
    scripts: dict[str, list[BoardScript]] = {engine: [] for engine in wish.engines}
    count = len(tasks) * len(wish.engines)
    with KEPT_SERVERS.open_servers() as servers:  # engines are imported once
        children = ChildProcesses(servers=servers)
        for task, engine in itertools.product(tasks, wish.engines):
            script = prepare_script(task, ENGINES[engine], folder, wish.timeout, children)
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
