"""Fill a board: every script in every release, unless its cell is kept; what lies outside is asked for its cause."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from crosscheck.bisect.cases import (
    BESIDE,
    CaseScript,
    find_case_limit,
    find_package,
    make_case_criterion,
    make_case_reading,
)
from crosscheck.bisect.causes import ask_cause, run_reference
from crosscheck.bisect.criteria import Criterion
from crosscheck.bisect.environments import Environment, EnvironmentStore, EnvironmentWish
from crosscheck.bisect.installers import CannotInstall
from crosscheck.bisect.observations import Observation, read_observation
from crosscheck.bisect.releases import Release
from crosscheck.bisect.script import run_script
from crosscheck.board.cells import CANNOT_RUN, NO_LIMIT, NO_SCRIPT, OUTSIDE, WITHIN, Cell, write_cells
from crosscheck.board.scripts import BoardScript
from crosscheck.run.isolation import open_scratch_folder
from flexinv.errors import InputError

NO_LIMIT_TOLERANCE = 0.0  # nothing is judged by it


@dataclass
class Board:
    """A board under way: scripts by engine, releases by engine, cells by key.

    folder : where cells are kept; notify : is told of each cell with the number done and of all
    """

    scripts: Mapping[str, Sequence[BoardScript]]
    releases: Mapping[str, Sequence[Release]]
    store: EnvironmentStore
    folder: Path
    cells: dict[str, Cell]
    notify: Callable[[Cell, int, int], None] = lambda cell, done, count: None
    computed: int = 0

    @property
    def count(self) -> int:
        """Number of cells of the whole board."""
        return sum(len(self.scripts[engine]) * len(self.releases[engine]) for engine in self.scripts)

    def fill_cells(self) -> list[Cell]:
        """Return all cells of the board, engine by engine and release by release; they are kept as they come."""
        filled: list[Cell] = []
        for engine, scripts in self.scripts.items():
            for release in self.releases[engine]:
                for cell in self._fill_release(release, scripts):
                    filled.append(cell)
                    self.cells[cell.key] = cell
                    self.notify(cell, len(filled), self.count)
                write_cells(self.cells.values(), self.folder)
        return filled

    def _fill_release(self, release: Release, scripts: Sequence[BoardScript]) -> Iterator[Cell]:
        """Yield the cells of one release; its environment is opened where one of them is new."""
        blanks = [_make_blank(script, release) for script in scripts]
        kept = {
            blank.key: self.cells[blank.key] for blank in blanks if blank.state != NO_SCRIPT and blank.key in self.cells
        }
        new = [blank for blank in blanks if blank.state != NO_SCRIPT and blank.key not in kept]
        if not new:
            yield from (kept.get(blank.key, blank) for blank in blanks)
            return
        assert release.python is not None
        wish = EnvironmentWish(release.python, (f"{find_package(new[0].engine)}=={release}", *BESIDE))
        try:
            with self.store.open_environment(wish) as environment:
                for script, blank in zip(scripts, blanks, strict=True):
                    yield kept.get(blank.key) or self._fill_cell(script, blank, environment)
        except CannotInstall as error:
            yield from (replace(blank, words=str(error)) if blank in new else blank for blank in blanks)

    def _fill_cell(self, script: BoardScript, blank: Cell, environment: Environment) -> Cell:
        """Return the cell of a script in an environment."""
        if script.made is None:
            return blank
        self.computed += 1
        with run_script(script.made.script, environment.python) as (end, folder):
            observation = read_observation(end, folder, make_case_reading())
        return judge_cell(script, script.made, blank, observation)


def _make_blank(script: BoardScript, release: Release) -> Cell:
    """Return the cell of a script before it has run: it cannot run, or there is no script."""
    task = script.task
    state = NO_SCRIPT if script.made is None else CANNOT_RUN
    key = f"{script.key}-{script.engine}-{release}"
    names = (task.folder.name, task.case.name, script.engine, str(release))
    return Cell(*names, state, None, None, script.refused, 0.0, key)


def judge_cell(script: BoardScript, made: CaseScript, blank: Cell, observation: Observation) -> Cell:
    """Return the cell of an observation: within the limit of its case or outside, with the cause [-]."""
    cell = replace(blank, seconds=observation.wall, words="")
    if observation.reason:
        return replace(cell, state=CANNOT_RUN, words=observation.reason)
    limit = find_case_limit(script.task, script.engine)
    criterion = _make_criterion(script, made, limit)
    distance = criterion.compute_distance(observation, made.expected)
    cell = replace(cell, distance=distance, limit=limit)
    if limit is None:
        return replace(cell, state=NO_LIMIT, words="the case states no limit of this engine")
    if distance <= limit:
        return replace(cell, state=WITHIN)
    return replace(cell, state=OUTSIDE, words=_find_cause(script, blank.release, observation))


def _make_criterion(script: BoardScript, made: CaseScript, limit: float | None) -> Criterion:
    tolerance = NO_LIMIT_TOLERANCE if limit is None else limit
    return make_case_criterion(made, script.task, script.engine, False, tolerance)


def _find_cause(script: BoardScript, release: str, observation: Observation) -> str:
    """Return the words of the cause; "" where flexinv itself gives no answer to hold it against."""
    with open_scratch_folder() as place:
        try:
            reference = run_reference(script.task, place)
        except InputError as error:
            return str(error)
        return ask_cause(script.task, script.engine, release, observation, reference, place)
