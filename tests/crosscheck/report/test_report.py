"""What a report says and how it is built: structure, escaping, numbers, and nothing from elsewhere."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from crosscheck_examples import WICKED, Night, night_run
from report_page import Page

from crosscheck.measures.record import read_record
from crosscheck.report import html, junit, markdown, words
from crosscheck.report.write_report import render
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.results import CaseRow, EngineRow, Results, RunRow, StudyRow, read, write

NOW = "2026-03-01T12:00:00+00:00"


@pytest.fixture(scope="session")
def night(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Night:
    return night_run(root, tmp_path_factory.getbasetemp())


def pages(out: Path) -> list[Path]:
    return sorted(out.rglob("*.html"))


def targets(page: Page) -> list[str]:
    """What the browser loads by itself."""
    loads = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src"}
    return [str(a[loads[t]]) for t, a in page.elements if t in loads and a.get(loads[t])]


# --- pages ------------------------------------------------------------------------------------------------------------


def test_there_is_a_page_for_every_case_and_study(night: Night) -> None:
    cases = [c for c in night.results.cases if not c.problem]
    expected = ["index.html", *(f"cases/{c.slug}.html" for c in cases), "studies/rogue.html", "studies/sad.html"]
    assert [p.relative_to(night.out).as_posix() for p in pages(night.out)] == sorted(expected)


def test_pages_are_well_formed(night: Night) -> None:
    for file in pages(night.out):
        page = Page(file)
        assert page.source.startswith("<!doctype html>")
        assert (page.broken, page.open) == ([], [])
        assert [a["lang"] for a in page.all("html")] == ["en"]
        assert page.all("meta", name="viewport")
        assert len(page.all("h1")) == 1
        ids = [a["id"] for _, a in page.elements if a.get("id")]
        assert len(ids) == len(set(ids))


def test_nothing_is_loaded_from_elsewhere_and_every_link_leads_somewhere(night: Night) -> None:
    for file in pages(night.out):
        page = Page(file)
        for target in targets(page):
            assert target == "data:," or not re.match(r"[a-z]+:|//", target), target
        for target in [t for t in targets(page) if t != "data:,"] + [str(a["href"]) for a in page.all("a")]:
            if not target.startswith(("#", "http")):
                assert (file.parent / unquote(target)).is_file(), target
    for asset in ("report.css", "plots.js", "theme.js"):
        text = (night.out / "assets" / asset).read_text()
        assert not re.search(r"https?:|url\(|@import|fetch\(|XMLHttpRequest", text)


def test_a_wicked_name_is_only_text(night: Night) -> None:
    for file in pages(night.out):
        page = Page(file)
        assert not page.all("img")
        assert not page.all("b", onerror="alert(1)")
        assert not [a for _, a in page.elements if any(k.startswith("on") for k in a)]
    assert WICKED in Page(night.out / "index.html").text
    assert "<b>bold</b>" in Page(night.out / "studies" / "rogue.html").text


def test_the_first_page_says_what_is_wrong_and_where(night: Night) -> None:
    page = Page(night.out / "index.html")
    assert words.describe_run(night.results) in page.text
    assert "1 comparison deviates" in page.text
    assert "3 runs failed" in page.text
    assert "1 model cannot be read" in page.text
    for message in ("killed by signal 9 (SIGKILL)", "python -m pip install no-such-package", "the archive is empty"):
        assert message in page.text
    (scroll,) = [a for a in page.all("div", role="region") if "Matrix" in str(a["aria-label"])]
    assert scroll["tabindex"] == "0"


def test_the_page_of_a_case_has_every_comparison_run_and_file(night: Night) -> None:
    case = night.results.cases[-1]
    page = Page(night.out / "cases" / f"{case.slug}.html")
    flat = " ".join(page.text.split())
    for row in night.results.comparisons:
        for shown in (row.reason, row.message, words.format_short(row.fraction), row.series):
            assert " ".join(shown.split()) in flat
    for run in night.results.runs:
        assert run.engine in page.text
        assert run.message in page.text
    for name, text in case.files.items():
        assert name in page.text
        assert " ".join(text.split()) in flat
    assert "Traceback" not in page.text


def test_the_data_of_the_plots_are_the_series(night: Night) -> None:
    case = night.results.cases[-1]
    page = Page(night.out / "cases" / f"{case.slug}.html")
    manifest = json.loads(re.search(r'id="manifest">(.*?)</script>', page.source, re.DOTALL)[1])  # type: ignore[index]
    assert manifest["engines"] == ["flexinv", "pinocchio", "fine"]
    assert [q["name"] for q in manifest["quantities"]] == ["torque", "tip", "wrench"]
    text = (night.out / "data" / manifest["slug"] / "torque.js").read_text()
    data = json.loads(text.removeprefix(f'crosscheckData("{manifest["slug"]}/torque", ').removesuffix(");\n"))
    runs = {r.engine: read_record(night.out / r.series) for r in night.results.runs if r.series}
    one = data["series"]["torque/knee"]
    exact, other = (runs[e].series["torque/knee"].values for e in ("flexinv", "fine"))
    np.testing.assert_array_equal(decode(data["time"]), runs["flexinv"].time.astype("f4"))
    np.testing.assert_array_equal(decode(one["engines"]["flexinv"]["value"]), exact.astype("f4"))
    np.testing.assert_array_equal(decode(one["engines"]["fine"]["difference"]), (other - exact).astype("f4"))
    assert "difference" not in one["engines"]["flexinv"]
    assert set(one["spectrum"]["amplitude"]) == {"fine"}  # the others stand still after the motion


def decode(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype="<f4")


def test_a_report_is_rendered_again_from_its_results(night: Night, tmp_path: Path) -> None:
    before = {p: p.read_bytes() for p in [*pages(night.out), night.out / "summary.md", night.out / "junit.xml"]}
    render(read(night.out / "results.json"), night.out)
    assert {p: p.read_bytes() for p in before} == before


# --- words ------------------------------------------------------------------------------------------------------------


def example(*rows: Comparison, **more: object) -> Results:
    case = CaseRow("arm", "move")
    runs = (RunRow("arm", "move", "flexinv", "ok"), RunRow("arm", "move", "e", "ok", wall_time=0.5))
    engines = (EngineRow("flexinv", True), EngineRow("e", True))
    return replace(Results(NOW, finished=True, cases=(case,), runs=runs, engines=engines, comparisons=rows), **more)


def row(verdict: str, maximum: float | None = 1.0, limit: float | None = 1e-3, **more: object) -> Comparison:
    one = Comparison("arm", "move", "e", "flexinv", "torque", "N m", verdict, "why", maximum, 0.5, 10.0, limit)  # type: ignore[arg-type]
    return replace(one, **more)  # type: ignore[arg-type]


def studies(*verdicts: str) -> Results:
    """A run of studies alone, as the selftest and the benchmark are."""
    return Results(NOW, finished=True, studies=tuple(StudyRow(v, v, rows=({"verdict": v},)) for v in verdicts))


def test_a_run_of_studies_alone_has_no_empty_matrix(tmp_path: Path) -> None:
    render(studies("within"), tmp_path)
    assert not Page(tmp_path / "index.html").all("table", **{"class": "matrix"})
    render(example(row("within")), tmp_path)
    assert Page(tmp_path / "index.html").all("table", **{"class": "matrix"})


@pytest.mark.parametrize(
    ("results", "sentence"),
    [
        (example(row("within"), row("skipped")), "The comparison is within its limit."),
        (example(row("within"), row("within")), "All 2 comparisons are within their limits."),
        (example(row("skipped")), "Nothing was compared."),
        (
            example(row("within"), row("deviation")),
            "1 of 2 comparisons is within its limit; 1 comparison deviates.",
        ),
        (example(row("unjudged")), "0 of 1 comparison is within its limit; 1 comparison has no limit."),
        (example(row("error")), "0 of 1 comparison is within its limit; 1 comparison is impossible."),
        (
            example(row("within"), finished=False),
            "1 of 1 comparison is within its limit; the run has not finished.",
        ),
        (example(row("within"), finished=False, message="cut"), "1 of 1 comparison is within its limit; cut."),
        (
            example(row("deviation"), row("deviation")),
            "0 of 2 comparisons are within their limits; 2 comparisons deviate.",
        ),
        (studies("within"), "The study is within its target."),
        (studies("within", "within"), "All 2 studies are within their targets."),
        (studies("within", "deviation"), "1 of 2 studies is within its target; 1 study is off."),
        (studies("within", "explained"), "The study is within its target."),  # what has a named cause is not off
    ],
)
def test_the_first_sentence(results: Results, sentence: str) -> None:
    assert words.describe_run(results) == sentence


def test_engines_that_say_the_same_of_themselves_share_a_row() -> None:
    rows = [EngineRow(name, True, "1.0", can) for name, can in (("a", "beams"), ("c", "bodies"), ("b", "beams"))]
    alike_engines = words.join_alike_engines([*rows, EngineRow("d", False, message="gone")])
    assert [(names, row.abilities or row.message) for row, names in alike_engines] == [
        (["a", "b"], "beams"), (["c"], "bodies"), (["d"], "gone"),
    ]  # fmt: skip


def test_only_a_good_run_is_called_good() -> None:
    for bad in ("deviation", "error", "unjudged"):
        assert words.describe_run(example(row("within"), row(bad))).startswith(
            "1 of 2 comparisons is within its limit; "
        )
        assert words.list_troubles(example(row(bad)))
    failed = replace(example(row("within")), studies=(StudyRow("s", "S", status="timeout", message="slow"),))
    assert words.describe_run(failed).endswith("1 study is off.")
    assert words.list_troubles(failed)[0][3] == "timeout: slow"


def test_a_field_shows_the_comparison_nearest_its_limit() -> None:
    near = row("within", 0.009, 1e-3, quantity="tip")
    far = row("within", 5.0, 1.0, quantity="torque")
    field = words.make_cell(example(far, near), CaseRow("arm", "move"), "e")
    assert (field.verdict, field.headline, field.detail) == ("within", "9e-4", "tip ≤ 0.001")
    field = words.make_cell(example(near, row("deviation", 0.1, 1e-3)), CaseRow("arm", "move"), "e")
    assert (field.verdict, field.headline) == ("deviation", "0.01")
    assert words.make_cell(example(near), CaseRow("arm", "move"), "flexinv").headline == "reference"
    assert words.make_cell(example(near), CaseRow("arm", "move"), "absent").verdict is None


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (0.0, "0"),
        (1e-12, "1e-12"),
        (2.34e-7, "2.3e-7"),
        (0.0123, "0.012"),
        (123.4, "123"),
        (1.5e7, "1.5e7"),
        (float("inf"), "∞"),
        (None, ""),
    ],
)
def test_numbers_are_short(number: float | None, text: str) -> None:
    assert words.format_short(number) == text


@pytest.mark.parametrize("share", [3.0, 0.4, 1e-2, 3e-5, 1e-9])
@pytest.mark.parametrize("value", [1.0987654, -0.0123456, 9876.54321, 8.7654321e-7, 99999.9, 1e6])
def test_the_ends_of_an_interval_are_told_apart(value: float, share: float) -> None:
    """Two digits of the width are shown: an end is rounded by half of a tenth of it at most, or is as short as other numbers."""
    width = share * abs(value)
    low, high = value - 0.3 * width, value + 0.7 * width
    shown = [*words.format_interval(low, high).split(" to "), words.format_by_width(value, high - low)]
    for number, text in zip((low, high, value), shown, strict=True):
        assert abs(float(text) - number) <= 0.05 * width * (1.0 + 1e-6) or text == words.format_short(number)


def test_intervals_have_few_digits_where_few_will_do() -> None:
    assert words.format_interval(1.0991, 1.1012) == "1.0991 to 1.1012"
    assert words.format_interval(0.0, 5.25) == "0 to 5.2"
    assert words.format_interval(12345.6, 12367.8) == "1.2346e4 to 1.2368e4"
    assert words.format_interval(2.0, 2.0) == "2 to 2"
    assert words.format_interval(0.5, float("inf")) == "0.5 to ∞"


def test_durations_are_in_words() -> None:
    assert [words.format_duration(s) for s in (0.0042, 3.14159, 125.0)] == ["4.2 ms", "3.1 s", "2 min 5 s"]


# --- Markdown and JUnit -----------------------------------------------------------------------------------------------


def test_markdown_tables_keep_their_columns_whatever_is_in_them(night: Night) -> None:
    text = markdown.render(night.results)
    widths = []
    for line in text.splitlines():
        if line.startswith("|"):
            widths.append(len(re.findall(r"(?<!\\)\|", line)))
        elif widths:
            assert len(set(widths)) == 1
            widths = []
    assert "<img" not in re.sub(r"\\<", "", text)
    assert markdown.escape("a|b\n<c> `d` \\") == r"a\|b \<c\> \`d\` \\"
    assert "1 comparison deviates" in text.splitlines()[0]


def test_junit_counts_every_run_and_comparison(night: Night) -> None:
    root = ET.fromstring((night.out / "junit.xml").read_bytes())
    suites = {s.get("name"): s for s in root}
    suite = suites[f"{WICKED}/swing"]
    runs, rows = night.results.runs, night.results.comparisons
    assert int(suite.get("tests", "")) == len(runs) + len(rows) == len(suite.findall("testcase"))
    assert int(suite.get("errors", "")) == sum(x.verdict == "error" for x in (*runs, *rows))
    assert int(suite.get("failures", "")) == 1
    assert int(suite.get("skipped", "")) == sum(x.verdict == "skipped" for x in rows)
    (failure,) = suite.iter("failure")
    assert re.match(
        r"deviation: .* of the range, the limit is 1e-12 \(largest error .* N m in torque/pivot at t = ",
        str(failure.get("message")),
    )
    assert suites["broken/"].find("testcase/error") is not None
    assert suites["sad"].find("testcase/error") is not None
    assert len(list(suites["rogue"].iter("failure"))) == 1


def test_junit_is_xml_whatever_is_in_it() -> None:
    results = example(row("deviation", message="bell \x07, null \x00, ]]> & <"), finished=False)
    root = ET.fromstring(junit.render(results))
    assert "bell \N{REPLACEMENT CHARACTER}" in str(next(root.iter("failure")).get("message"))
    assert next(root.iter("error")).get("message") == "error: the run has not finished"


def test_rows_without_numbers_and_with_the_same_words_are_gathered() -> None:
    rows = [row("error", None), row("error", None, quantity="tip"), row("within"), row("error", None, message="other")]
    gathered = words.join_alike_comparisons(rows)
    assert [(r.verdict, r.quantity) for r in gathered] == [
        ("error", "torque, tip"),
        ("within", "torque"),
        ("error", "torque"),
    ]


def test_names_break_where_they_may_and_stay_escaped() -> None:
    assert html.format_breakable("a_b/<c>") == "a_<wbr>b/<wbr>&lt;c&gt;"


def test_what_is_gone_idle_or_changed_is_said_in_every_format(night: Night, tmp_path: Path) -> None:
    moved = {"what": "arm/swing mujoco against flexinv: torque", "before": 1e-4, "after": 2e-4}
    moved |= {"before_verdict": "within", "after_verdict": "deviation", "message": ""}
    moved |= {"mechanism": "arm", "case": "swing"}
    difference = {"night": "2026-02-28", "started": "", "values": [moved], "models": ["arm/swing"], "vanished": ["a"]}
    difference |= {"versions": [{"package": "mujoco", "before": "4.0", "after": "4.1"}], "appeared": [], "slower": []}
    known = {"reason": "looked at", "date": NOW, "versions": {}, "gone": ("arm swing mujoco flexinv tip m",)}
    known |= {"gone_keys": (("arm", "swing", "mujoco", "flexinv", "tip", "m"),)}
    case = CaseRow("arm", "swing", unused_limits=("twist, engines mujocco",))
    results = Results(
        NOW, finished=True, cases=(case,), baseline=known, changes=difference, comparisons=(row("within"),)
    )
    assert results.exit_code == 1
    render(results, tmp_path)
    page, text = Page(tmp_path / "index.html").text, (tmp_path / "summary.md").read_text()
    for said in (page, text):
        assert "Since 2026-02-28: 1 new deviation, 1 comparison moved, 1 version changed (mujoco)" in said
        assert "1 model changed (arm/swing)" in said
        assert "arm/swing: mujoco is not compared any more; 1 comparison is blessed (tip); bring it back, or " in said
        assert "twist, engines mujocco" in said
        assert "1 blessed comparison is gone" in said
    assert "4.1" in page
    (tmp_path / "trends").mkdir()
    (tmp_path / "trends" / "index.html").touch()
    render(results, tmp_path)
    assert "looked at. All nights" in Page(tmp_path / "index.html").text
    tree = ET.fromstring((tmp_path / "junit.xml").read_bytes())
    assert [(c.get("classname"), c.get("name")) for c in tree.iter("testcase")] == [
        ("arm/swing", "blessed comparisons")
    ]
    assert len(list(tree.iter("failure"))) == 1


def test_a_case_with_but_the_reference_is_skipped_not_passed(night: Night) -> None:
    """Nothing was compared: the page does not say "within", which it does as soon as one engine is."""
    case = next(row for row in night.results.cases if row.case)
    cells = [words.make_cell(night.results, case, engine) for engine in ("flexinv", "pinocchio")]
    alone = replace(cells[0], comparisons=(), verdict="within")
    assert html.find_case_verdict([alone]) == "skipped"
    assert html.find_case_verdict([alone, cells[1]]) == cells[1].verdict
    assert html.find_case_verdict([replace(alone, verdict="error")]) == "error"


def test_curves_of_a_study_stay_in_the_order_in_which_it_gives_them(tmp_path: Path) -> None:
    """Not by the alphabet: the naive answer first, the best one last."""
    curves = {name: {"x": [0.0], "y": [1.0]} for name in ("rigid", "flexible", "at rest")}
    figure = {"title": "tip", "x": "time [s]", "y": "y [m]", "curves": curves}
    rows = tuple({"kind": name, "x": 1, "y": 1.0, "verdict": "within"} for name in curves)
    plot = {"x": "x", "y": "y", "group": "kind", "log": False}
    columns = (("kind", "kind", ""), ("x", "x", ""), ("y", "y", ""))
    study = StudyRow("one", "one", columns=columns, rows=rows, plot=plot, figures=(figure,))
    results = Results("2026-03-01T01:00:00+00:00", finished=True, studies=(study,))
    write(results, tmp_path / "results.json")
    render(read(tmp_path / "results.json"), tmp_path)
    text = (tmp_path / "studies" / "one.html").read_text()
    for name in ("studyplot", "studyfigures"):
        result = json.loads(text.partition(f'id="{name}">')[2].partition("</script>")[0])
        assert list((result[0] if name == "studyfigures" else result)["curves"]) == list(curves)
