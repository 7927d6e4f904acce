"""Cards: what a result says of itself in some ten lines of text, or as a small table with pictures in a notebook.

The HTML is a fragment of well-formed XML without scripts, styles of its own page or anything from elsewhere.  Its text has the
colour of the page around it, and its lines colours that are seen on white and on dark ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import islice


from flexinv.display.words import CUT, cut_text, escape_text, make_printable

LINES = 15  # of a text at most
COLUMNS = 120
WIDEST = 44  # characters of a cell in a text
FACTS = 5  # lines beside the table in a text
ROWS = 6  # of the table in a text; what is more is counted
PAGE_ROWS = 12  # of the table on a page
LONGEST = 400  # characters of a fact, and
LONGEST_CELL = 80  # of a cell on a page
BESIDE = "  "  # between columns
RULE = "1px solid rgba(128,128,128,0.4)"
CELL = f"text-align:left;padding:2px 12px 2px 0;border-bottom:{RULE};background:none;color:inherit;vertical-align:top"


@dataclass(frozen=True)
class Picture:
    """A picture as SVG with the words below it; width : of the page that it takes at most [px]."""

    svg: str
    words: str
    width: int = 240


@dataclass(frozen=True)
class Card:
    """What a result says of itself: a title, facts, the first rows of a table of ``count`` rows, and pictures.

    draw : makes the pictures, when a page wants them
    """

    title: str
    facts: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    count: int = 0
    draw: Callable[[], tuple[Picture, ...]] = tuple


def make_rows(rows: Iterable[tuple[str, ...]]) -> tuple[tuple[str, ...], ...]:
    """Return the first rows of a table, as many as a card shows at most."""
    return tuple(islice(rows, PAGE_ROWS))


def render_text(card: Card) -> str:
    """Return a card as text of at most `LINES` lines of `COLUMNS` characters [-]."""
    lines = [make_printable(card.title), *(BESIDE + make_printable(fact) for fact in card.facts[:FACTS])]
    if card.rows:
        lines += (BESIDE + line for line in _align_columns(card))
    if card.count > len(card.rows[:ROWS]):
        lines.append(f"{BESIDE}... and {card.count - len(card.rows[:ROWS])} more")
    return "\n".join(line.rstrip() if len(line) <= COLUMNS else line[: COLUMNS - len(CUT)] + CUT for line in lines)


def _align_columns(card: Card) -> list[str]:
    """Rows with their cells below each other."""
    table = [[cut_text(cell, WIDEST) for cell in row] for row in (card.columns, *card.rows[:ROWS])]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return [BESIDE.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in table]


def render_page(card: Card) -> str:
    """Return a card as HTML, a fragment of well-formed XML."""
    parts = [f"<div><b>{escape_text(cut_text(card.title, LONGEST))}</b></div>"]
    parts += [f"<div>{escape_text(cut_text(fact, LONGEST))}</div>" for fact in card.facts]
    pictures = "".join(map(_render_picture, card.draw()))
    if pictures:
        parts.append(f'<div style="display:flex;flex-wrap:wrap;gap:16px;align-items:flex-end">{pictures}</div>')
    if card.rows:
        head = "".join(f'<th style="{CELL}">{escape_text(name)}</th>' for name in card.columns)
        rows = "".join(f"<tr>{''.join(map(_render_cell, row))}</tr>" for row in card.rows)
        table = f'<table style="border-collapse:collapse;font-size:inherit"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
        parts.append(f'<div style="overflow-x:auto;margin-top:8px">{table}</div>')
    if card.count > len(card.rows):
        parts.append(f"<div>... and {card.count - len(card.rows)} more</div>")
    return f'<div style="max-width:900px;line-height:1.5">{"".join(parts)}</div>'


def _render_cell(cell: str) -> str:
    return f'<td style="{CELL}">{escape_text(cut_text(cell, LONGEST_CELL))}</td>'


def _render_picture(picture: Picture) -> str:
    words = f'<figcaption style="font-size:90%">{escape_text(picture.words)}</figcaption>'
    return f'<figure style="margin:8px 0;width:{picture.width}px;max-width:100%">{picture.svg}{words}</figure>'


class Shown:
    """Base of results that show themselves by a card instead of all their numbers.

    Neither form solves anything or raises: a record that is half made, as a traceback or a debugger meets it, says so.
    """

    def _make_card(self) -> Card:
        """Return what is shown of it."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """Return some ten lines: title, facts, the first rows of a table, with units."""
        try:
            return render_text(self._make_card())
        except Exception as error:
            return cut_text(f"<{type(self).__name__} that cannot be described: {error}>", COLUMNS)

    def _repr_html_(self) -> str:
        """Return the card of notebooks: pictures, facts, and the first rows of a table, with units."""
        try:
            return render_page(self._make_card())
        except Exception:
            return f"<div>{escape_text(repr(self))}</div>"


