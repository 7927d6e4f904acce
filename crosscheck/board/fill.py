"""Fill a board: every script in every release, unless its cell is kept; what lies outside is asked for its cause."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass, field, replace
from pathlib import Path

from crosscheck.bisect.cases import BESIDE, CaseScript, find_case_limit, find_package, make_case_criterion
from crosscheck.bisect.causes import ask_cause, run_reference
from crosscheck.bisect.environments import EnvironmentStore
from crosscheck.bisect.observations import Observation
from crosscheck.bisect.releases import Release
from crosscheck.board.cells import (
    BY_CONSENSUS,
    BY_REFERENCE,
    CANNOT_RUN,
    NO_LIMIT,
    NO_SCRIPT,
    OUTSIDE,
    ROUNDING,
    WITHIN,
    Cell,
    write_cells,
)
from crosscheck.board.consensus import BoardConsensus, compute_consensus_distance, compute_digest, has_own_coordinates
from crosscheck.board.jobs import ReleaseJob, read_script_files, run_release, run_release_on_worker
from crosscheck.board.scripts import BoardScript
from crosscheck.corpus.judging import CaseBands
from crosscheck.run.cluster import open_workers
from crosscheck.run.isolation import open_scratch_folder
from crosscheck.run.jobs import describe_harness_failure
from flexinv.errors import InputError

NO_TOLERANCE = 0.0  # nothing is judged by it
ReleaseAnswer = list[Observation] | str


@dataclass(frozen=True)
class BoardWorkers:
    """Hands of a board: jobs at a time here, or the address of a Dask scheduler.

    own_folder : workers of a cluster make environments in the caches of their users, not in the folder of the store
    tell : is given a line about a cluster that has trouble
    """

    jobs: int = 1
    scheduler: str = ""
    own_folder: bool = True
    tell: Callable[[str], None] = lambda line: None


@dataclass(frozen=True)
class ReleaseShare:
    """New scripts of one release, and the cells that stand for them before they have run."""

    release: Release
    scripts: Sequence[BoardScript]
    blanks: Sequence[Cell]

    def make_job(self) -> ReleaseJob:
        """Return the job of the release."""
        assert self.release.python is not None
        made = [script.made for script in self.scripts if script.made is not None]
        requirements = (f"{find_package(self.scripts[0].engine)}=={self.release}", *BESIDE)
        files = tuple(read_script_files(one.folder) for one in made)
        return ReleaseJob(self.release.python, requirements, files, made[0].script.timeout)


@dataclass
class Board:
    """A board under way: scripts by engine, releases by engine, cells by key, and the consensus that judges them.

    folder : where cells are kept; notify : is told of each new cell with the number done and of all
    lost : cells that something of ours kept from their end, which are not kept
    causes : efforts outside and the words of their cause by the key of the script: releases that give the same are not asked
    """

    scripts: Mapping[str, Sequence[BoardScript]]
    releases: Mapping[str, Sequence[Release]]
    store: EnvironmentStore
    folder: Path
    cells: dict[str, Cell]
    consensus: BoardConsensus = field(default_factory=BoardConsensus)
    workers: BoardWorkers = field(default_factory=BoardWorkers)
    notify: Callable[[Cell, int, int], None] = lambda cell, done, count: None
    computed: int = 0
    lost: dict[str, Cell] = field(default_factory=dict)
    causes: dict[str, list[tuple[Observation, str]]] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of cells of the whole board."""
        return sum(len(self.scripts[engine]) * len(self.releases[engine]) for engine in self.scripts)

    def fill_cells(self) -> list[Cell]:
        """Return all cells of the board, engine by engine and release by release; they are kept as they come.

        Raises InputError where a cluster or the index does not answer: what has been computed by then is kept.
        """
        shares = [share for share in self._list_shares() if share.scripts]
        if shares:
            with open_workers(self.workers.scheduler, self.workers.jobs, self.workers.tell) as pool:
                self._run_shares(pool, shares)
        blanks = [self._make_blank(script, release) for script, release in self._list_places()]
        return [self.lost.get(blank.key) or self._find_kept(blank) or blank for blank in blanks]

    def _list_places(self) -> Iterator[tuple[BoardScript, Release]]:
        for engine, scripts in self.scripts.items():
            for release in self.releases[engine]:
                yield from ((script, release) for script in scripts)

    def _list_shares(self) -> Iterator[ReleaseShare]:
        """Yield what is new of every release: one job opens its environment once."""
        for engine, scripts in self.scripts.items():
            for release in self.releases[engine]:
                blanks = [(script, self._make_blank(script, release)) for script in scripts if script.made is not None]
                new = [(script, blank) for script, blank in blanks if blank.key not in self.cells]
                yield ReleaseShare(release, [script for script, _ in new], [blank for _, blank in new])

    def _find_kept(self, blank: Cell) -> Cell | None:
        return None if blank.state == NO_SCRIPT else self.cells.get(blank.key)

    def _make_blank(self, script: BoardScript, release: Release) -> Cell:
        """Return the cell of a script before it has run: it cannot run, or there is no script."""
        task = script.task
        state = NO_SCRIPT if script.made is None else CANNOT_RUN
        by = compute_digest(self.consensus.find_bands(task))
        key = "-".join(filter(None, (script.key, script.engine, str(release), by)))
        names = (task.folder.name, task.case.name, script.engine, str(release))
        return Cell(*names, state, None, None, "", script.refused, 0.0, key)

    def _run_shares(self, pool: Executor, shares: Sequence[ReleaseShare]) -> None:
        """Run all shares, and take what each gives as it comes; Ctrl-C ends the scripts here, and keeps what they gave."""
        stop = threading.Event()
        pending = {self._begin_share(pool, share, stop): share for share in shares}
        try:
            for future in as_completed(pending):
                self._take_answer(pending.pop(future), future)
        except BaseException:
            stop.set()
            for future in pending:
                future.cancel()
            if not self.workers.scheduler:
                self._take_rest(pending)
            write_cells(self.cells.values(), self.folder)
            raise

    def _begin_share(self, pool: Executor, share: ReleaseShare, stop: threading.Event) -> Future[ReleaseAnswer]:
        job = share.make_job()
        if self.workers.scheduler:
            return pool.submit(run_release_on_worker, job, self.store, self.workers.own_folder)
        return pool.submit(run_release, job, self.store, stop)

    def _take_rest(self, pending: Mapping[Future[ReleaseAnswer], ReleaseShare]) -> None:
        """Take what scripts gave before they were told to stop; causes are not looked for any more."""
        for future, share in pending.items():
            if not future.cancelled() and future.exception() is None:
                judged = [one for one in self._judge_answer(share, future.result(), False) if one.state != OUTSIDE]
                self.cells |= {cell.key: cell for cell in judged}

    def _take_answer(self, share: ReleaseShare, future: Future[ReleaseAnswer]) -> None:
        """Take the cells of a release; what a cluster has lost is not kept.  Raises InputError where nothing can be installed."""
        try:
            answer = future.result()
        except InputError:
            raise
        except Exception as error:
            words = describe_harness_failure(error)
            self.lost |= {blank.key: replace(blank, words=words) for blank in share.blanks}
            return
        for cell in self._judge_answer(share, answer, True):
            self.cells[cell.key] = cell
            self.computed += not isinstance(answer, str)
            self.notify(cell, self.computed, self.count)
        write_cells(self.cells.values(), self.folder)

    def _judge_answer(self, share: ReleaseShare, answer: ReleaseAnswer, asking: bool) -> Iterator[Cell]:
        """Yield the cells of a release; asking : for causes, too."""
        if isinstance(answer, str):
            yield from (replace(blank, words=answer) for blank in share.blanks)
            return
        for script, blank, observation in zip(share.scripts, share.blanks, answer, strict=False):
            assert script.made is not None
            cell = judge_cell(script, script.made, blank, observation, self.consensus.find_bands(script.task))
            if asking and cell.state == OUTSIDE:
                cell = replace(cell, words=self._find_cause(script, script.made, cell.release, observation))
            yield cell

    def _find_cause(self, script: BoardScript, made: CaseScript, release: str, observation: Observation) -> str:
        """Return the words of the cause, which is looked for once where several releases give the same efforts."""
        known = self.causes.setdefault(script.key, [])
        for other, words in known:
            if make_case_criterion(made, script.task, script.engine, False, ROUNDING).is_same(observation, other):
                return words
        words = _ask_cause(script, made, release, observation)
        known.append((observation, words))
        return words


def judge_cell(
    script: BoardScript, made: CaseScript, blank: Cell, observation: Observation, bands: CaseBands | None
) -> Cell:
    """Return the cell of an observation: within the consensus of its case, or its limit about flexinv, or outside [-]."""
    cell = replace(blank, seconds=observation.wall, words="")
    if observation.reason:
        return replace(cell, state=CANNOT_RUN, words=observation.reason)
    limit = find_case_limit(script.task, script.engine)
    if bands is None or has_own_coordinates(script.task, bands, made.expected):
        criterion = make_case_criterion(made, script.task, script.engine, False, NO_TOLERANCE)
        distance = criterion.compute_distance(observation, made.expected)
        cell = replace(cell, distance=distance, limit=limit, against=BY_REFERENCE)
        if limit is None:
            return replace(cell, state=NO_LIMIT, words="the case states no limit of this engine")
    else:
        limit = limit or 0.0
        distance = compute_consensus_distance(bands, observation)
        cell = replace(cell, distance=distance, limit=limit, against=BY_CONSENSUS)
    return replace(cell, state=WITHIN if distance <= limit else OUTSIDE)


def _ask_cause(script: BoardScript, made: CaseScript, release: str, observation: Observation) -> str:
    """Return the words of the cause; those of flexinv where it gives no answer to hold the efforts against."""
    with open_scratch_folder() as place:
        try:
            reference = run_reference(script.task, place)
        except InputError as error:
            return str(error)
        return ask_cause(script.task, (script.engine, release), observation, made.expected, reference, place)
