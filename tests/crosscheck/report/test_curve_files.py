"""Curves as CSV beside the pages: the numbers of the records, every digit, and names that are no formulas and no markup."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from crosscheck_examples import Night, night_run

from crosscheck.report.curve_files import render_curves
from crosscheck.report.plots import read_records


@pytest.fixture(scope="session")
def night(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Night:
    return night_run(root, tmp_path_factory.getbasetemp())


def test_every_curve_of_a_case_has_its_column_with_every_digit(night: Night) -> None:
    case = night.results.cases[-1]
    text = (night.out / "cases" / f"{case.slug}.html").read_text()
    files = dict(re.findall(r'href="\.\./([^"]+\.csv)" download>([^<]+)<', text))
    assert list(files.values()) == ["torque", "spectrum of torque", "tip", "wrench"]
    records = read_records(night.results, case, night.out)
    for file, quantity in files.items():
        lines = list(csv.reader((night.out / file).read_text().splitlines()))
        table = dict(zip(lines[0], np.array(lines[1:], dtype=float).T, strict=True))
        if quantity.startswith("spectrum"):
            assert next(iter(table)) == "frequency [Hz]"
            continue
        for engine, record in records.items():
            assert np.array_equal(table["time [s]"], record.time)
            for one in record.series.values():
                if one.quantity == quantity:
                    assert np.array_equal(table[f"{engine}: {one.name} [{one.unit}]"], one.values)


def test_the_picture_of_a_study_has_its_numbers(night: Night) -> None:
    page = night.out / "studies" / "rogue.html"
    (file,) = re.findall(r'href="([^"]+\.csv)" download', page.read_text())
    assert (page.parent / file).is_file()


def test_curves_of_other_places_have_columns_of_their_own() -> None:
    text = render_curves("x [m]", [("a [N]", [0, 1], [1, 2]), ("b [N]", [0, 1], [3, None]), ("c [N]", [5], [6])])
    assert list(csv.reader(text.splitlines())) == [
        ["x [m]", "a [N]", "b [N]", "x [m] of c [N]", "c [N]"],
        ["0", "1", "3.0", "5.0", "6.0"],
        ["1", "2", "", "", ""],
    ]
    assert render_curves("x", []) == ""


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@SUM(A1)", 'a "name", with all\nof it', "<b>bold</b>"])
def test_a_name_is_no_formula_and_stays_in_its_cell(name: str) -> None:
    (head, row) = csv.reader(render_curves("x", [(name, [name], [1])]).splitlines(keepends=True))
    told = f"'{name}" if name[0] in "=+-@" else name
    assert head == ["x", told]
    assert row == [told, "1"]
