"""The card of a comparison: the verdict, the differences that count in a table, and how much each of them moves an effort."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePath

from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.result import Comparison
from flexinv.display.bars import draw_bars
from flexinv.display.card import Card, Picture, make_rows
from flexinv.display.words import format_number

DIFFERENCE_COLUMNS = ("cause", "place", "in A", "in B", "differ by", "of the effort's range [%]")


def make_comparison_card(comparison: Comparison) -> Card:
    """Return the card of a comparison: what differs, by how much [unit], and its share of the range of an effort [%]."""
    names = [PurePath(name).name for name in (comparison.first, comparison.second)]
    differences = comparison.differences
    title = f"Comparison of A = {names[0]} with B = {names[1]}: {comparison.state}"
    rows = make_rows(map(_list_difference_row, differences))
    facts = tuple(_describe_comparison(comparison))
    return Card(title, facts, DIFFERENCE_COLUMNS, rows, len(differences), lambda: _draw_shares(differences))


def _list_difference_row(difference: Difference) -> tuple[str, ...]:
    unit = difference.unit
    cause = difference.cause if unit == "-" else f"{difference.cause} [{unit}]"
    size = "-" if unit == "-" else f"{format_number(difference.size)} {unit}"
    share = "-" if difference.share is None else format_number(100.0 * difference.share)
    return cause, difference.place, difference.first, difference.second, size, share


def _describe_comparison(comparison: Comparison) -> Iterator[str]:
    """Yield the sentence of the result, what efforts say, and what to write."""
    yield comparison.sentence
    before = format_number(100.0 * comparison.judged.before)
    after = format_number(100.0 * comparison.judged.after)
    if comparison.differences:
        yield f"efforts differ by {before} % of their range, by {after} % once the differences are put right"
    yield from (f"{place}: {line}" for place, several in comparison.advice for line in several)


def _draw_shares(differences: tuple[Difference, ...]) -> tuple[Picture, ...]:
    bars = [(one.subject, 100.0 * one.share) for one in differences if one.share is not None]
    if not bars:
        return ()
    words = "what each difference moves of an effort, of its range [%]"
    return (Picture(draw_bars(sorted(bars, key=lambda bar: -bar[1]), "%", words), words, 480),)
