"""The pages of a report: ``index.html``, one page per case and per study, and the assets they share.

Everything a page needs lies beside it (plotly.js comes from the installed package): no server, no network.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, partial
from importlib import resources
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import jinja2
from markupsafe import Markup

from crosscheck import output_folder as owned
from crosscheck.measures.limits import Verdict, find_worst_verdict
from crosscheck.report import animation, change_summary, words
from crosscheck.report import explanations as reasons
from crosscheck.report.curve_files import list_figure_curves
from crosscheck.report.plots import CaseManifest, read_records, write_case
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.results import CaseRow, Diagnosis, EngineRow, Results, RunRow, StudyRow, make_slug
from crosscheck.verdicts.study_table import Curve, SideTable, StudyFigure, StudyPlot
from flexinv.display.curve_table import render_curves

INDEX = "index.html"
ASSETS = ("report.css", "theme.js", "plots.js", "trends.js", "animation.js")


Page = Callable[[Path], None]  # writes one page below the folder of a report


def collect_pages(results: Results) -> dict[str, Page]:
    """Return the writer of each page, and of the assets that all share, by its path below the folder of a report."""
    pages: dict[str, Page] = {"assets": copy_assets}
    for case in results.cases:
        if not case.problem:
            pages[f"cases/{case.slug}.html"] = partial(_write_case_page, results, case)
    for study in results.studies:
        pages[f"studies/{make_slug(study.name)}.html"] = partial(_write_study_page, results, study)
    pages["index.html"] = partial(_write_index, results)
    return pages


def _write_case_page(results: Results, case: CaseRow, out: Path) -> None:
    (out / "cases").mkdir(exist_ok=True)
    view = build_case_view(results, case, out)
    write_page(prepare_templates(), "case.html.j2", out / "cases" / f"{case.slug}.html", **view)


def _write_study_page(results: Results, study: StudyRow, out: Path) -> None:
    (out / "studies").mkdir(exist_ok=True)
    view = build_study_view(results, study)
    folder = out / "data" / make_slug(study.name)
    for name, figure in list_drawn_figures(study, view["plot"]).items():
        if "table" in figure and (folder / f"{name}.csv").is_file():
            continue
        folder.mkdir(parents=True, exist_ok=True)
        owned.write(folder / f"{name}.csv", render_curves(list_figure_curves(figure)))
    write_page(prepare_templates(), "study.html.j2", out / "studies" / f"{make_slug(study.name)}.html", **view)


def _write_index(results: Results, out: Path) -> None:
    beside = [name for name in ("trends", "board") if (out / name / INDEX).is_file()]
    write_page(prepare_templates(), "index.html.j2", out / INDEX, **build_index_view(results, out, beside))


@cache
def prepare_templates() -> jinja2.Environment:
    """Return the templates, compiled once in a process, with everything escaped that is not markup of our own."""
    env = jinja2.Environment(
        loader=jinja2.PackageLoader("crosscheck.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    env.filters |= {
        "short": words.format_short,
        "duration": words.format_duration,
        "slug": make_slug,
        "value": format_value,
        "breakable": format_breakable,
    }
    env.policies["json.dumps_kwargs"] = {}  # curves stay in the order in which they were given
    env.globals |= {"SIGNS": words.SIGNS, "MEANINGS": words.MEANINGS, "study_line": words.describe_study}
    env.globals |= {"describe_group": words.describe_group, "describe_moved": words.describe_moved}
    env.globals |= {"format_change": words.format_change}
    return env


def write_page(env: jinja2.Environment, template: str, file: Path, **view: Any) -> None:
    """Render one page."""
    owned.write(file, env.get_template(template).render(**view))


def copy_style(out: Path, names: Iterable[str] = ASSETS[:2]) -> None:
    """Copy assets of our own, by default those of a page without plots."""
    folder = out / "assets"
    folder.mkdir(exist_ok=True)
    for name in names:
        owned.write(folder / name, resources.files("crosscheck.report").joinpath("assets", name).read_bytes())


def copy_assets(out: Path) -> None:
    """Copy style, scripts and the plotting library."""
    folder = out / "assets"
    copy_style(out, ASSETS)
    library = resources.files("plotly").joinpath("package_data", "plotly.min.js")
    owned.write(folder / "plotly.min.js", library.read_bytes())


class StudyCurves(TypedDict):
    """Curves of a study's plot: words of the axes, whether these are logarithmic, values by curve."""

    x: str
    y: str
    log: bool
    curves: dict[str, Curve]


class ShownTable(SideTable):
    """A table as it is shown; judged : with verdicts; numeric : keys of the columns that hold numbers; heading : "" for none."""

    judged: bool
    numeric: set[str]
    heading: str


class SingleStudy(TypedDict):
    """Contents of the first page about a study; None where there are cases, or other studies."""

    study: StudyRow | None
    plot: NotRequired[StudyCurves | None]
    tables: NotRequired[list[ShownTable]]


class StudyView(TypedDict):
    """Contents of the page of a study."""

    results: Results
    root: str
    study: StudyRow
    plot: StudyCurves | None
    tables: list[ShownTable]


class MatrixBlock(TypedDict):
    """Part of the matrix for one mechanism; rows : cases with a field for each engine; absent : reasons, and engines of each."""

    mechanism: str
    title: str
    problems: list[str]
    engines: list[str]
    rows: list[tuple[CaseRow, list[words.Cell]]]
    absent: list[tuple[str, list[str]]]
    drawing: Markup | None


class IndexView(SingleStudy):
    """Contents of the first page; troubles : verdict, link and name of a page, what, in words."""

    results: Results
    root: str
    sentence: str
    verdict: Verdict
    scope: str
    unchanged: str
    counts: dict[Verdict, int]
    troubles: list[tuple[str, str, str, str, str]]
    matrix: list[MatrixBlock]
    engines: list[tuple[EngineRow, list[str]]]
    limits: list[tuple[CaseRow, str]]
    changed: str
    gone: list[str]
    trends: bool
    board: bool


class CaseView(TypedDict):
    """Contents of the page of a case; trend : link to its trend, ""."""

    results: Results
    root: str
    case: CaseRow
    verdict: Verdict
    cells: list[words.Cell]
    comparisons: list[Comparison]
    absent: list[tuple[str, list[str]]]
    runs: list[RunRow]
    manifest: CaseManifest
    neighbours: tuple[CaseRow | None, CaseRow | None]
    summaries: list[reasons.CertificateSummary]
    uncertified: dict[str, str]
    diagnoses: list[Diagnosis]
    trend: str


def build_index_view(results: Results, out: Path, beside: Sequence[str] = ()) -> IndexView:
    """Return the contents of the first page; the drawings are of the series below ``out``.

    beside : which of the pages that a night has are there: trends, board
    """
    groups = words.split_by_mechanism(results.cases)
    matrix = [build_matrix_block(results, mechanism, cases, out) for mechanism, cases in groups.items()]
    return {
        "results": results,
        "root": "",
        "sentence": words.describe_run(results),
        "verdict": words.find_run_verdict(results),
        "scope": words.describe_scope(results),
        "unchanged": words.describe_unchanged(results),
        "counts": words.count_verdicts(results),
        "troubles": [
            (v, make_page_link(where), make_page_label(where), what, text)
            for v, where, what, text in words.list_troubles(results)
        ],
        "matrix": matrix,
        "engines": words.join_alike_engines(results.engines),
        "limits": [(c, line) for c in results.cases for line in c.unused_limits],
        "changed": change_summary.describe_changes(results.changes),
        "gone": words.describe_gone(results),
        "trends": "trends" in beside,
        "board": "board" in beside,
        **build_single_study_view(results),
    }


def build_single_study_view(results: Results) -> SingleStudy:
    """Return the contents of a study for the first page of a run that has nothing else; no study beside others."""
    if results.cases or len(results.studies) != 1:
        return {"study": None}
    view = build_study_view(results, results.studies[0])
    return {"study": view["study"], "plot": view["plot"], "tables": view["tables"]}


def build_matrix_block(results: Results, mechanism: str, cases: Sequence[CaseRow], out: Path) -> MatrixBlock:
    """Return the part of the matrix for one mechanism: a field for every case and every engine that takes part."""
    read = [case for case in cases if not case.problem]
    rows = [(case, [words.make_cell(results, case, e.name) for e in results.engines]) for case in read]
    columns = [k for k in range(len(results.engines)) if words.has_taken_part(cells[k] for _, cells in rows)]
    return {
        "mechanism": mechanism,
        "title": next((case.mechanism_title for case in read if case.mechanism_title), ""),
        "problems": [case.problem for case in cases if case.problem],
        "engines": [results.engines[k].name for k in columns],
        "rows": [(case, [cells[k] for k in columns]) for case, cells in rows],
        "absent": words.list_absent_engines(results, read) if read else [],
        "drawing": _draw_first_case(results, read, out),
    }


def _draw_first_case(results: Results, cases: Iterable[CaseRow], out: Path) -> Markup | None:
    stills = (animation.draw_still(case.skeleton, read_records(results, case, out)) for case in cases if case.skeleton)
    return next((one for one in stills if one is not None), None)


def build_case_view(results: Results, case: CaseRow, out: Path) -> CaseView:
    """Return the contents of the page of a case; its data files are written on the way."""
    cells = [words.make_cell(results, case, e.name) for e in results.engines]
    return {
        "results": results,
        "root": "../",
        "case": case,
        "verdict": find_case_verdict(cells),
        "cells": cells,
        "comparisons": words.join_alike_comparisons(
            sorted((c for one in cells if words.has_taken_part([one]) for c in one.comparisons), key=is_empty_row)
        ),
        "absent": words.list_absent_engines(results, [case]),
        "runs": [one.run for one in cells if one.run is not None],
        "manifest": write_case(results, case, out),
        "neighbours": find_neighbours(results, case),
        "summaries": reasons.list_certificates(results, case),
        "uncertified": reasons.collect_warnings(results, case),
        "diagnoses": reasons.list_diagnoses(results, case),
        "trend": f"../trends/{case.slug}.html" if (out / "trends" / f"{case.slug}.html").is_file() else "",
    }


def find_case_verdict(cells: Iterable[words.Cell]) -> Verdict:
    """Return the gravest verdict of a case; "skipped" where there is but the reference: skipped is not passed."""
    return find_worst_verdict(
        [c.verdict for c in cells if c.verdict is not None and (c.comparisons or c.verdict == "error")]
    )


def is_empty_row(row: Comparison) -> bool:
    """Return True if there is nothing to read in a comparison (a key to sort by)."""
    return row.verdict == "skipped"


def build_study_view(results: Results, study: StudyRow) -> StudyView:
    """Return the contents of the page of a study."""
    plot = build_study_plot(study, study.plot) if study.plot is not None and study.rows else None
    judged: SideTable = {"title": study.title, "columns": study.columns, "rows": study.rows}
    tables = [
        *(_make_shown_table(judged, study.heading, True) for _ in study.rows[:1]),
        *(_make_shown_table(one, one["title"], False) for one in study.tables if one["rows"]),
    ]
    return {"results": results, "root": "../", "study": study, "plot": plot, "tables": tables}


def _make_shown_table(table: SideTable, heading: str, judged: bool) -> ShownTable:
    return {
        "title": table["title"],
        "columns": table["columns"],
        "rows": table["rows"],
        "leads": table.get("leads", False),
        "judged": judged,
        "numeric": list_numeric_columns(table),
        "heading": heading,
    }


def list_numeric_columns(table: SideTable) -> set[str]:
    """Return the keys of the columns that hold numbers [any unit]."""
    return {
        key for key, _, _ in table["columns"] if any(isinstance(row.get(key), int | float) for row in table["rows"])
    }


def build_study_plot(study: StudyRow, spec: StudyPlot) -> StudyCurves:
    """Return the curves of a study's plot: one per value of the column that groups them."""
    titles = {key: f"{title} [{unit}]" if unit else title for key, title, unit in study.columns}
    points: dict[str, tuple[list[Any], list[Any]]] = {}
    for row in study.rows:
        xs, ys = points.setdefault(str(row.get(spec["group"])), ([], []))
        xs.append(row.get(spec["x"]))
        ys.append(row.get(spec["y"]))
    curves: dict[str, Curve] = {name: {"x": xs, "y": ys} for name, (xs, ys) in points.items()}
    return {"x": titles[spec["x"]], "y": titles[spec["y"]], "log": bool(spec["log"]), "curves": curves}


def list_drawn_figures(study: StudyRow, plot: StudyCurves | None) -> dict[str, StudyFigure]:
    """Return the figures on the page of a study, by the names of the files of their numbers [units of the axes]."""
    drawn = {figure.get("table", f"figure{k}"): figure for k, figure in enumerate(study.figures)}
    if plot is not None:
        drawn["plot"] = {"title": study.title, "x": plot["x"], "y": plot["y"], "curves": plot["curves"]}
    return drawn


def find_neighbours(results: Results, case: CaseRow) -> tuple[CaseRow | None, CaseRow | None]:
    """Return the cases before and after this one."""
    shown = [c for c in results.cases if not c.problem]
    k = shown.index(case)
    return shown[k - 1] if k else None, shown[k + 1] if k + 1 < len(shown) else None


def make_page_link(where: CaseRow | StudyRow) -> str:
    """Return the page of a case or a study, relative to the index."""
    if isinstance(where, StudyRow):
        return f"studies/{make_slug(where.name)}.html"
    return "" if where.problem else f"cases/{where.slug}.html"


def make_page_label(where: CaseRow | StudyRow) -> str:
    """Return the name of a case or a study."""
    if isinstance(where, StudyRow):
        return where.title
    return f"{where.mechanism} / {where.case}" if where.case else where.mechanism


def format_breakable(text: str) -> Markup:
    """Return a name, escaped, that may break after an underscore or a slash."""
    return Markup("<wbr>").join(re.split("(?<=[_/])", text))


def format_value(thing: Any) -> str:
    """Return a value of a table or of the settings in words."""
    if thing is None:
        return "–"
    if isinstance(thing, bool):
        return "yes" if thing else "no"
    if isinstance(thing, float):
        return words.format_short(thing) if 0 < abs(thing) < 1e-3 else f"{thing:.4g}"
    if isinstance(thing, Mapping | list | tuple):
        return json.dumps(thing)
    return str(thing)
