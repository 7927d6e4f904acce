"""Curves of a report for CSV files beside its pages: series by engine with their error bars, and figures of studies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from crosscheck.measures.record import Record
from crosscheck.verdicts.study_table import StudyFigure
from flexinv.display.curve_table import DrawnCurve


def list_engine_curves(records: Mapping[str, Record], quantity: str) -> Iterator[DrawnCurve]:
    """Yield the series of a quantity over time [s] by engine, each with its error bars where it has some [unit in each name]."""
    for engine, record in records.items():
        for one in record.series.values():
            if one.quantity == quantity:
                yield DrawnCurve("time [s]", f"{engine}: {one.name} [{one.unit}]", record.time, one.values)
                if one.error is not None:
                    yield DrawnCurve(
                        "time [s]", f"{engine}: {one.name}, error bar [{one.unit}]", record.time, one.error
                    )


def list_figure_curves(figure: StudyFigure) -> Iterator[DrawnCurve]:
    """Yield the curves of a study's figure [units of the axes]."""
    for name, curve in figure["curves"].items():
        yield DrawnCurve(figure["x"], f"{name}: {figure['y']}", curve["x"], curve["y"])
