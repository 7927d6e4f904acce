"""Curves as CSV beside the pages that draw them: one column a curve, its unit in the name, every digit of its numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import pandas as pd

from crosscheck.measures.record import Record
from crosscheck.verdicts.study_table import StudyFigure
from flexinv.typing import Array

FORMULA = ("=", "+", "-", "@", "\t", "\r")  # what a spreadsheet takes for the beginning of a formula
Values = Sequence[object] | Array
Curve = tuple[str, Values, Values]  # name with its unit, values along x and y


def render_curves(x: str, curves: Iterable[Curve]) -> str:
    """Return curves as CSV [unit in each name]; a curve whose values along x are not those before has a column of its own.

    x : name and unit of the first column
    """
    columns: list[tuple[str, pd.Series]] = []
    along: list[object] | None = None
    for name, places, values in curves:
        if along is None or along != list(places):
            columns.append((x if along is None else f"{x} of {name}", pd.Series(places)))
            along = list(places)
        columns.append((name, pd.Series(values)))
    if not columns:
        return ""
    table = pd.concat([column.map(_convert_cell) for _, column in columns], axis=1)
    table.columns = pd.Index([_convert_cell(name) for name, _ in columns])
    text: str = table.to_csv(index=False, lineterminator="\n")
    return text


def _convert_cell(value: object) -> object:
    """Return a value of a cell; a text that would be a formula begins with an apostrophe, as in spreadsheets."""
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value


def list_engine_curves(records: Mapping[str, Record], quantity: str) -> Iterable[Curve]:
    """Yield the series of a quantity over time [s] by engine, each with its error bars where it has some [unit in each name]."""
    for engine, record in records.items():
        for one in record.series.values():
            if one.quantity == quantity:
                yield f"{engine}: {one.name} [{one.unit}]", record.time, one.values
                if one.error is not None:
                    yield f"{engine}: {one.name}, error bar [{one.unit}]", record.time, one.error


def render_figure(figure: StudyFigure) -> str:
    """Return the curves of a study's figure as CSV [units of the axes]."""
    curves = [(f"{name}: {figure['y']}", curve["x"], curve["y"]) for name, curve in figure["curves"].items()]
    return render_curves(figure["x"], curves)
