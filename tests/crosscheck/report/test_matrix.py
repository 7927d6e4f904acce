"""The matrix of the first page: a field for every engine that takes part, and why the others do not, said once."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from crosscheck_examples import Night, night_run
from report_page import Page

from crosscheck.report import words
from crosscheck.report.write_report import render


@pytest.fixture(scope="session")
def night(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Night:
    return night_run(root, tmp_path_factory.getbasetemp())


def fields(page: Page) -> list[str]:
    """Verdicts of the fields of the matrix, in order."""
    return [str(a["class"]) for a in page.all("td") if a.get("class") in {*words.MEANINGS, "none"}]


def test_the_matrix_has_a_field_per_case_and_engine_and_a_drawing(night: Night) -> None:
    page = Page(night.out / "index.html")
    assert fields(page) == ["within", "within", "deviation", "error", "error", "error"]
    assert "cannot be read" in page.text  # the broken model, in words
    assert len(page.all("svg", role="img")) == 1  # of the one mechanism that could be read
    assert not page.all("details", **{"class": "absent"})
    assert "1 mechanism, 1 case, in 6 engines (flexinv, pinocchio, fine, killed, nan, absent)." in " ".join(
        page.text.split()
    )


def test_an_engine_that_can_do_nothing_has_no_field_but_its_reason_once(night: Night, tmp_path: Path) -> None:
    """On the first page and on the case's; one that was not asked is named, too, and one that failed keeps its field."""
    reason = "rigid bodies only <here>"
    runs = tuple(
        replace(r, status="skipped", message=reason, series="") if r.engine in ("fine", "nan") else r
        for r in night.results.runs
        if r.engine != "absent"
    )
    rows = tuple(
        replace(c, verdict="skipped", message=reason, maximum=None) if c.engine in ("fine", "nan") else c
        for c in night.results.comparisons
        if c.engine != "absent"
    )
    results = replace(night.results, runs=runs, comparisons=rows)
    case = next(c for c in results.cases if c.case)
    assert words.list_absent_engines(results, [case]) == [(reason, ["fine", "nan"]), ("not run", ["absent"])]
    out = shutil.copytree(night.out, tmp_path / "out")
    render(results, out)
    page = Page(out / "index.html")
    assert fields(page) == ["within", "within", "error"]
    assert "Not possible in fine, nan, absent" in page.text
    assert page.text.count(reason) == 1
    assert "comparisons are skipped" in page.text
    assert reason in Page(out / "cases" / f"{case.slug}.html").text


def test_a_number_without_a_limit_that_its_engine_explains_is_called_not_judged(night: Night, tmp_path: Path) -> None:
    """A large number in a field of the matrix reads as a claim; beside a limit, and where nobody explains it, it stays."""
    rows = tuple(
        replace(c, verdict="skipped", limit=None, maximum=210.0, scale=1.0) if c.engine == "fine" else c
        for c in night.results.comparisons
    )
    results = replace(night.results, comparisons=rows)
    case = next(c for c in results.cases if c.case)
    cell = words.make_cell(results, case, "fine")
    assert (cell.verdict, cell.headline) == ("skipped", "not judged")
    assert cell.detail.endswith(" 210 apart")
    bare = replace(
        results, comparisons=tuple(replace(c, verdict="unjudged") if c.engine == "fine" else c for c in rows)
    )
    assert words.make_cell(bare, case, "fine").headline == "210"
    out = shutil.copytree(night.out, tmp_path / "out")
    render(results, out)
    assert "skipped" in fields(Page(out / "index.html"))
    assert "explained" not in fields(Page(out / "index.html"))
