"""Curves as CSV: every digit, shared places once, names that are no formulas, and the numbers of a figure."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from flexinv.display.curve_table import DrawnCurve, render_curves
from flexinv.display.figures import list_curves


def test_curves_of_other_places_have_columns_of_their_own() -> None:
    curves = [("a [N]", [0, 1], [1, 2]), ("b [N]", [0, 1], [3, None]), ("c [N]", [5], [6])]
    text = render_curves(DrawnCurve("x [m]", *curve) for curve in curves)
    assert list(csv.reader(text.splitlines())) == [
        ["x [m]", "a [N]", "b [N]", "x [m] of c [N]", "c [N]"],
        ["0", "1", "3", "5", "6"],
        ["1", "2", "", "", ""],
    ]
    assert render_curves([]) == ""


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@SUM(A1)", 'a "name", with all\nof it', "<b>bold</b>"])
def test_a_name_is_no_formula_and_stays_in_its_cell(name: str) -> None:
    head, row = csv.reader(render_curves([DrawnCurve("x", name, [name], [1])]).splitlines(keepends=True))
    told = f"'{name}" if name[0] in "=+-@" else name
    assert head == ["x", told]
    assert row == [told, "1"]


def test_a_figure_gives_the_numbers_of_its_curves_and_steps_but_no_marks() -> None:
    figure = pytest.importorskip("matplotlib.figure").Figure()
    left, right = figure.subplots(1, 2)
    time = np.array([0.0, 0.1, 1 / 3])
    left.plot(time, time**2, label="torque")
    left.plot(time, time**3)
    left.axvline(0.2, label="a mark")
    left.set(xlabel="time [s]", ylabel="[N m]", title="one")
    right.stairs([2, 5], [1.0, 10.0, 100.0], label="steps")
    right.set(xlabel="time of a step [µs]", ylabel="steps")
    lines = list(csv.reader(render_curves(list_curves(figure)).splitlines()))
    assert lines[0] == ["time [s]", "one: torque [N m]", "one: curve 2 [N m]", "time of a step [µs]", "steps steps"]
    told = [[float(cell) for cell in line if cell] for line in lines[1:]]
    assert told == [[0, 0, 0, 1, 2], [0.1, 0.1**2, 0.1**3, 10, 5], [1 / 3, (1 / 3) ** 2, (1 / 3) ** 3, 100]]
