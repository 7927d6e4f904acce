"""Curves as CSV: one column each, its unit in the name, every digit of its numbers; names are no formulas of a spreadsheet."""

from __future__ import annotations

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
    import pandas as pd

    columns: list[tuple[str, pd.Series]] = []
    along: list[object] | None = None
    for curve in curves:
        places = list(curve.places)
        if along != places:
            named = any(curve.x == name for name, _ in columns)
            columns.append((f"{curve.x} of {curve.y}" if named else curve.x, pd.Series(places)))
            along = places
        columns.append((curve.y, pd.Series(curve.values)))
    if not columns:
        return ""
    table = pd.concat([column.map(_convert_cell) for _, column in columns], axis=1)
    table.columns = pd.Index([_convert_cell(name) for name, _ in columns])
    text: str = table.to_csv(index=False, lineterminator="\n")
    return text


def _convert_cell(value: object) -> object:
    """Return a value of a cell; a text that would be a formula begins with an apostrophe, as in spreadsheets."""
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value
