"""Cards: what a result says of itself in some ten lines of text, or as a small table with pictures in a notebook.

The HTML is a fragment of well-formed XML without scripts, styles of its own page or anything from elsewhere.  Its text has the
colour of the page around it, and its lines colours that are seen on white and on dark ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import islice

from flexinv.display.words import CUT, convert_to_xml, make_printable, take_start

TEXT_LINES = 15  # of a text at most
TEXT_COLUMNS = 120
WIDEST = 44  # characters of a cell in a text
TEXT_FACTS = 5  # lines beside the table in a text, and
PAGE_FACTS = 8  # on a page
TEXT_ROWS = 6  # of the table in a text; what is more is counted
PAGE_ROWS = 12  # of the table on a page
LONGEST_FACT = 400  # characters of a fact, and
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
    """A result in short: a title, facts, the first rows of a table of ``count`` rows, and pictures.

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
    """Return a card as text of at most `TEXT_LINES` lines of `TEXT_COLUMNS` characters [-]."""
    lines = [make_printable(card.title), *(BESIDE + make_printable(fact) for fact in _list_facts(card, TEXT_FACTS))]
    if card.rows:
        lines += (BESIDE + line for line in _format_columns(card))
    if card.count > len(card.rows[:TEXT_ROWS]):
        lines.append(f"{BESIDE}... and {card.count - len(card.rows[:TEXT_ROWS])} more")
    return "\n".join(
        line.rstrip() if len(line) <= TEXT_COLUMNS else line[: TEXT_COLUMNS - len(CUT)] + CUT for line in lines
    )


def _list_facts(card: Card, most: int) -> list[str]:
    """The first facts, and how many more there are."""
    more = len(card.facts) - most
    return [*card.facts[:most], *([f"... and {more} more remark{'s' * (more > 1)}"] if more > 0 else [])]


def _format_columns(card: Card) -> list[str]:
    """Rows with their cells below each other."""
    table = [[take_start(cell, WIDEST) for cell in row] for row in (card.columns, *card.rows[:TEXT_ROWS])]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return [BESIDE.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in table]


def render_page(card: Card) -> str:
    """Return a card as HTML, a fragment of well-formed XML."""
    parts = [f"<div><b>{convert_to_xml(take_start(card.title, LONGEST_FACT))}</b></div>"]
    parts += [f"<div>{convert_to_xml(take_start(fact, LONGEST_FACT))}</div>" for fact in _list_facts(card, PAGE_FACTS)]
    pictures = "".join(map(_render_picture, card.draw()))
    if pictures:
        parts.append(f'<div style="display:flex;flex-wrap:wrap;gap:16px;align-items:flex-end">{pictures}</div>')
    if card.rows:
        parts.append(f'<div style="overflow-x:auto;margin-top:8px">{_render_table(card)}</div>')
    if card.count > len(card.rows):
        parts.append(f"<div>... and {card.count - len(card.rows)} more</div>")
    return f'<div style="max-width:900px;line-height:1.5">{"".join(parts)}</div>'


def _render_table(card: Card) -> str:
    head = "".join(f'<th style="{CELL}">{convert_to_xml(name)}</th>' for name in card.columns)
    rows = "".join(f"<tr>{''.join(map(_render_cell, row))}</tr>" for row in card.rows)
    style = "border-collapse:collapse;font-size:inherit"
    return f'<table style="{style}"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'


def _render_cell(cell: str) -> str:
    """A cell whose names may break after an underscore, so that the table fits narrow pages."""
    words = convert_to_xml(take_start(cell, LONGEST_CELL)).replace("_", "_<wbr/>")
    return f'<td style="{CELL}">{words}</td>'


def _render_picture(picture: Picture) -> str:
    words = f'<figcaption style="font-size:90%">{convert_to_xml(picture.words)}</figcaption>'
    return f'<figure style="margin:8px 0;width:{picture.width}px;max-width:100%">{picture.svg}{words}</figure>'


class Shown:
    """Base of results that show themselves by a card instead of all their numbers.

    Neither form solves anything or raises: a record that is half made, as a traceback or a debugger meets it, says so.
    """

    def _make_card(self) -> Card:
        """Return the card of it."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """Return some ten lines: title, facts, the first rows of a table, with units."""
        try:
            return render_text(self._make_card())
        except Exception as error:
            return take_start(f"<{type(self).__name__} that cannot be described: {error}>", TEXT_COLUMNS)

    def _repr_html_(self) -> str:
        """Return the card of notebooks: pictures, facts, and the first rows of a table, with units."""
        try:
            return render_page(self._make_card())
        except Exception:
            return f"<div>{convert_to_xml(repr(self))}</div>"
