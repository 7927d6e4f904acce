"""Curves as CSV beside the pages: the numbers of the records, with every digit."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from crosscheck_examples import Night, night_run

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


def test_a_chart_over_nights_has_their_times_and_values() -> None:
    pytest.importorskip("sqlalchemy")
    from crosscheck.report.trends import build_chart, render_chart

    chart = build_chart("time", "s", {"a": [[0, 1.5], [2, None]], "b": [[1, 2.5]]})
    lines = list(csv.reader(render_chart(chart, ["monday", "tuesday", "wednesday"]).splitlines()))
    assert lines == [
        ["night", "time [s]: a", "night of time [s]: b", "time [s]: b"],
        ["monday", "1.5", "tuesday", "2.5"],
        ["wednesday", "", "", ""],
    ]
