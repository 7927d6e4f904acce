"""Cells of a board: one case in one release of one engine, and the file in which they are kept between runs."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Literal, get_args

from crosscheck import output_folder as owned

CellState = Literal["within", "outside", "no limit", "cannot run", "no script"]
WITHIN: CellState = "within"
OUTSIDE: CellState = "outside"
NO_LIMIT: CellState = "no limit"
CANNOT_RUN: CellState = "cannot run"
NO_SCRIPT: CellState = "no script"
STATES: tuple[CellState, ...] = get_args(CellState)
BY_CONSENSUS = "consensus"
BY_REFERENCE = "flexinv"
CELLS = "cells.json"
# Of the distance: what is farther from or nearer to the expected efforts by this factor than in the release before has moved.
MOVED = 10.0
ROUNDING = 1e-12  # of the range: distances below it are alike


@dataclass(frozen=True)
class Cell:
    """One case in one release: state, largest distance from what is expected over the range [-], words, and its key.

    limit : that the case allows [-], None where it states none; against : the consensus of the case, or flexinv's efforts
    seconds : of the run; key : of all that decides the cell
    """

    mechanism: str
    case: str
    engine: str
    release: str
    state: CellState
    distance: float | None
    limit: float | None
    against: str
    words: str
    seconds: float
    key: str


def read_cells(folder: Path) -> dict[str, Cell]:
    """Return the cells that an earlier run has kept, by key; {} where there are none that can be read."""
    names = {field.name for field in fields(Cell)}
    try:
        rows = json.loads((folder / CELLS).read_text(encoding="utf-8"))
        cells = [Cell(**row) for row in rows if row.keys() == names and row["state"] in STATES]
    except (OSError, ValueError, TypeError, AttributeError):
        return {}
    return {cell.key: cell for cell in cells}


def write_cells(cells: Iterable[Cell], folder: Path) -> None:
    """Write the newest cell of each place.  Raises OSError."""
    newest = {(cell.mechanism, cell.case, cell.engine, cell.release): cell for cell in cells}
    owned.write(folder / CELLS, json.dumps([asdict(cell) for cell in newest.values()], indent=1))


def describe_trend(before: Cell | None, cell: Cell) -> str:
    """Return the trend of a cell since the release before: "better", "worse", "" for as before or unknown."""
    if before is None or before.state == cell.state == CANNOT_RUN or NO_SCRIPT in (before.state, cell.state):
        return ""
    if CANNOT_RUN in (before.state, cell.state):
        return "worse" if cell.state == CANNOT_RUN else "better"
    if before.state != cell.state:
        return "better" if cell.state == WITHIN else "worse"
    old = max(before.distance or 0.0, ROUNDING)
    new = max(cell.distance or 0.0, ROUNDING)
    if new > MOVED * old:
        return "worse"
    return "better" if old > MOVED * new else ""
