"""Figures of logs: a title, words of the axes and curves with all their numbers, drawn in part and written as CSV in whole."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from crosscheck.verdicts.study_table import Curve, StudyFigure
from flexinv.display.curve_table import DrawnCurve
from flexinv.typing import Array

MOST_LETTERS = 80  # of a file's name


@dataclass(frozen=True)
class LogFigure:
    """A figure of a log with all its numbers: words of the axes, places and curves by name (points,) [units of the axes].

    shown : what is drawn, in the names of file and columns; most : points of a curve that are drawn
    """

    log: str
    shown: str
    title: str
    x: str
    y: str
    places: Array
    curves: Mapping[str, Array]
    most: int

    def list_columns(self) -> Iterator[DrawnCurve]:
        """Yield the columns of its CSV file, with all samples [unit in each name]."""
        for name, values in self.curves.items():
            yield DrawnCurve(self.x, f"{self.log}, {name}: {self.y}", self.places, values)

    def build_table_name(self, number: int) -> str:
        """Return the name of its CSV file [-], with its number on the page: two logs may have one name."""
        return f"{number}_{re.sub('[^A-Za-z0-9]+', '_', f'{self.log} {self.shown}')[:MOST_LETTERS].strip('_')}"

    def build_drawing(self, number: int) -> StudyFigure:
        """Return as much of it as the page draws [units of the axes]."""
        every = max(1, len(self.places) // self.most)
        places = self.places[::every].round(4).tolist()
        curves: dict[str, Curve] = {n: {"x": places, "y": _drop_digits(v[::every])} for n, v in self.curves.items()}
        table = self.build_table_name(number)
        return {"title": self.title, "x": self.x, "y": self.y, "curves": curves, "table": table}


def _drop_digits(values: Array) -> list[float]:
    return [float(f"{x:.5g}") for x in values]
