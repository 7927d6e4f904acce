"""Curves as CSV: one column each, its unit in the name, every digit of its numbers; names are no formulas of a spreadsheet."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from flexinv.typing import Array

FORMULA = ("=", "+", "-", "@", "\t", "\r")  # what a spreadsheet takes for the beginning of a formula


@dataclass(frozen=True)
class DrawnCurve:
    """A curve by the names of its axes, with their units, and its points [units of the axes]."""

    x: str
    y: str
    places: Sequence[object] | Array
    values: Sequence[object] | Array


def render_curves(curves: Iterable[DrawnCurve]) -> str:
    """Return curves as CSV [unit in each name]; those along the same places share the column of these."""
    columns: list[tuple[str, list[object]]] = []
    along: list[object] | None = None
    for curve in curves:
        places = list(curve.places)
        if along != places:
            named = any(curve.x == name for name, _ in columns)
            columns.append((f"{curve.x} of {curve.y}" if named else curve.x, places))
            along = places
        columns.append((curve.y, list(curve.values)))
    if not columns:
        return ""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([_format_cell(name) for name, _ in columns])
    cells = ([_format_cell(value) for value in values] for _, values in columns)
    table.writerows(itertools.zip_longest(*cells, fillvalue=""))
    return text.getvalue()


def _format_cell(value: object) -> str:
    """A value as text, "" for one that is missing; a text that would be a formula begins with an apostrophe."""
    if isinstance(value, str):
        return f"'{value}" if value.startswith(FORMULA) else value
    if value is None or value != value:
        return ""
    return repr(float(value)) if isinstance(value, float) else str(value)
