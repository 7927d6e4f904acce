"""Pages of a board: one table, the same as JSON and CSV, and a badge for each engine."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import TypedDict

from crosscheck import output_folder as owned
from crosscheck.board.cells import (
    BY_CONSENSUS,
    CANNOT_RUN,
    NO_LIMIT,
    NO_SCRIPT,
    OUTSIDE,
    STATES,
    WITHIN,
    Cell,
    CellState,
    describe_trend,
)
from crosscheck.report.html import copy_style, prepare_templates, write_page
from crosscheck.report.words import format_short
from crosscheck.verdicts.results import StudyRow
from crosscheck.verdicts.study_table import Line

VERDICTS = {WITHIN: "within", OUTSIDE: "deviation", NO_LIMIT: "unjudged", CANNOT_RUN: "skipped", NO_SCRIPT: "skipped"}
MEANINGS = {
    WITHIN: "the efforts lie in the consensus of the case, or off it by no more than the limit of the case; where there is no "
    "consensus, off those of flexinv by no more",
    OUTSIDE: "they lie outside; the cause is named below",
    NO_LIMIT: "the case states no limit of this engine: only the distance is shown",
    CANNOT_RUN: "the release cannot run the script of the case, or cannot be installed here",
    NO_SCRIPT: "the case cannot be exported for the engine",
}
SIGNS = {"better": "▲", "worse": "▼", "": ""}
BADGE = """<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="20" role="img" aria-label="{left}: {right}">
<rect width="{split}" height="20" fill="#444"/><rect x="{split}" width="{rest}" height="20" fill="{colour}"/>
<g fill="#fff" font-family="Verdana,sans-serif" font-size="11"><text x="6" y="14">{left}</text>
<text x="{text}" y="14">{right}</text></g></svg>
"""
BOARD_COLUMNS = (("release", "release", ""), *((state, state, "-") for state in STATES))
CHARACTER = 7  # [px], the mean width of one in a badge
GREEN = "#2a7d3f"
RED = "#b3261e"
GREY = "#666"


class BoardSquare(TypedDict):
    """One cell as the page shows it: release, verdict, text, trend, and the words behind it."""

    release: str
    verdict: str
    text: str
    trend: str
    words: str


class BoardRow(TypedDict):
    """One case: its name, and for each engine its squares, from the oldest release to the newest."""

    name: str
    engines: dict[str, list[BoardSquare]]


class BoardMove(TypedDict):
    """Move from one release of an engine to the next: releases, words for the change and its reason, and the cases."""

    engine: str
    before: str
    after: str
    change: str
    words: str
    cases: list[str]


def write_board(
    cells: Sequence[Cell],
    releases: Mapping[str, Sequence[str]],
    folder: Path,
    notes: Sequence[str] = (),
    back: str = "",
) -> None:
    """Write ``index.html``, ``board.json``, ``board.csv``, ``badges/ENGINE.svg`` into a folder that is ours.

    back : address of the page that leads to this one, "" for none
    Raises OSError.
    """
    folder.mkdir(parents=True, exist_ok=True)
    owned.write(folder / "board.json", json.dumps([asdict(cell) for cell in cells], indent=1))
    owned.write(folder / "board.csv", format_csv(cells))
    (folder / "badges").mkdir(exist_ok=True)
    for engine, versions in releases.items():
        newest = [cell for cell in cells if cell.engine == engine and cell.release == versions[-1]]
        owned.write(folder / "badges" / f"{engine}.svg", draw_badge(engine, versions[-1], newest))
    copy_style(folder)
    outside = [cell for cell in cells if cell.state == OUTSIDE]
    view = {
        "root": "",
        "releases": releases,
        "rows": collect_rows(cells, releases),
        "tally": Counter(cell.state for cell in cells),
        "states": VERDICTS,
        "meanings": MEANINGS,
        "outside": outside,
        "moved": collect_moves(cells),
        "notes": notes,
        "cases": len({(cell.mechanism, cell.case) for cell in cells}),
        "agreed": len({(cell.mechanism, cell.case) for cell in cells if cell.against == BY_CONSENSUS}),
        "back": back,
    }
    write_page(prepare_templates(), "board.html.j2", folder / "index.html", **view)


def format_csv(cells: Iterable[Cell]) -> str:
    """Return the cells as CSV, one a row; the distance is a part of the range [-]."""
    text = io.StringIO()
    names = ("mechanism", "case", "engine", "release", "state", "distance", "limit", "against", "words")
    table = csv.DictWriter(text, names, extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    table.writerows(asdict(cell) for cell in cells)
    return text.getvalue()


def collect_rows(cells: Sequence[Cell], releases: Mapping[str, Sequence[str]]) -> list[BoardRow]:
    """Return the rows of the table, a case each, in the order of the cells."""
    found = {(cell.mechanism, cell.case, cell.engine, cell.release): cell for cell in cells}
    rows = []
    for mechanism, case in dict.fromkeys((cell.mechanism, cell.case) for cell in cells):
        engines = {}
        for engine, versions in releases.items():
            line = [found.get((mechanism, case, engine, version)) for version in versions]
            engines[engine] = [_make_square(cell, before) for before, cell in zip([None, *line], line, strict=False)]
        rows.append(BoardRow(name=f"{mechanism}/{case}", engines=engines))
    return rows


def _make_square(cell: Cell | None, before: Cell | None) -> BoardSquare:
    if cell is None:
        return {"release": "", "verdict": "", "text": "", "trend": "", "words": ""}
    text = {CANNOT_RUN: "cannot run", NO_SCRIPT: "–"}.get(cell.state) or format_short(cell.distance)
    against = f" (against {cell.against})" if cell.against else ""
    words = f"{cell.engine} {cell.release}: {cell.state}{against}{f', {cell.words}' if cell.words else ''}"
    trend = SIGNS[describe_trend(before, cell)]
    return {"release": cell.release, "verdict": VERDICTS[cell.state], "text": text, "trend": trend, "words": words}


def collect_moves(cells: Sequence[Cell]) -> list[BoardMove]:
    """Return the moves between neighbouring releases; cases of which the same is said stand together."""
    moves: dict[tuple[str, str, str, str, str], BoardMove] = {}
    lines: dict[tuple[str, str, str], Cell] = {}
    for cell in cells:
        here = (cell.mechanism, cell.case, cell.engine)
        before = lines.get(here)
        lines[here] = cell
        if before is None or not (trend := describe_trend(before, cell)):
            continue
        change = (
            f"{before.state} becomes {cell.state}"
            if before.state != cell.state
            else f"{cell.state}, {trend} by its distance"
        )
        key = (cell.engine, before.release, cell.release, change, cell.words or before.words)
        move = moves.setdefault(
            key, BoardMove(engine=key[0], before=key[1], after=key[2], change=change, words=key[4], cases=[])
        )
        move["cases"].append(f"{cell.mechanism}/{cell.case}")
    return list(moves.values())


def make_board_table(cells: Sequence[Cell], releases: Mapping[str, Sequence[str]]) -> StudyRow:
    """Return a board as a table of a night: cells by engine, release and state [-]; a newest release that is outside deviates."""
    rows = []
    for engine, versions in releases.items():
        for version in versions:
            counted = Counter(cell.state for cell in cells if (cell.engine, cell.release) == (engine, version))
            rows.append(_make_board_line(engine, version, counted, version == versions[-1]))
    return StudyRow(
        "board",
        "Board of releases",
        "Cases by releases of the engines. board/index.html of the night shows every cell.",
        BOARD_COLUMNS,
        tuple(rows),
    )


def _make_board_line(engine: str, version: str, counted: Mapping[CellState, int], newest: bool) -> Line:
    """Return the line of a release [-]; only the newest one has a limit: what older ones give is never mended."""
    outside = counted.get(OUTSIDE, 0)
    judged = counted.get(WITHIN, 0) + outside
    verdict = "skipped" if not judged else "within" if not outside else "deviation" if newest else "explained"
    message = (
        ""
        if not outside
        else "the board names the causes"
        if newest
        else "an older release; the board names the causes"
    )
    metric = {
        "name": f"board: cases outside in {engine} {version}",
        "value": float(outside),
        "unit": "-",
        "lower": None,
        "upper": 0.0 if newest else None,
        "note": "",
    }
    line: dict[str, object] = {"release": f"{engine} {version}", "verdict": verdict, "message": message}
    line |= {state: counted.get(state, 0) for state in STATES}
    return {**line, "metric": metric} if judged else line


def draw_badge(engine: str, release: str, cells: Sequence[Cell]) -> str:
    """Return the badge of an engine's release as SVG: how many of the cases that it was judged by are within."""
    counted = Counter(cell.state for cell in cells)
    judged = counted[WITHIN] + counted[OUTSIDE]
    right = f"{counted[WITHIN]} of {judged} cases within" if judged else "nothing judged"
    colour = GREY if not judged else RED if counted[OUTSIDE] else GREEN
    left = f"{engine} {release}"
    split = CHARACTER * len(left) + 12
    rest = CHARACTER * len(right) + 12
    return BADGE.format(
        width=split + rest,
        split=split,
        rest=rest,
        colour=colour,
        left=escape(left),
        right=escape(right),
        text=split + 6,
    )


assert set(VERDICTS) == set(MEANINGS) == set(STATES)
