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
from typing import Any

import jinja2
from markupsafe import Markup

from crosscheck import output_folder as owned
from crosscheck.measures.limits import Verdict, worst
from crosscheck.report import animation, changed, words
from crosscheck.report import explanations as reasons
from crosscheck.report.plots import read_records, write_case
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.results import CaseRow, Results, StudyRow, slug

ASSETS = ("report.css", "theme.js", "plots.js", "trends.js", "animation.js")


Page = Callable[[Path], None]  # writes one page below the folder of a report


def pages(results: Results) -> dict[str, Page]:
    """Return the writer of each page, and of the assets that all share, by its path below the folder of a report."""
    made: dict[str, Page] = {"assets": assets}
    for case in results.cases:
        if not case.problem:
            made[f"cases/{case.slug}.html"] = partial(_write_case_page, results, case)
    for study in results.studies:
        made[f"studies/{slug(study.name)}.html"] = partial(_write_study_page, results, study)
    made["index.html"] = partial(_write_index, results)
    return made


def _write_case_page(results: Results, case: CaseRow, out: Path) -> None:
    (out / "cases").mkdir(exist_ok=True)
    view = case_view(results, case, out)
    write_page(environment(), "case.html.j2", out / "cases" / f"{case.slug}.html", **view)


def _write_study_page(results: Results, study: StudyRow, out: Path) -> None:
    (out / "studies").mkdir(exist_ok=True)
    view = study_view(results, study)
    write_page(environment(), "study.html.j2", out / "studies" / f"{slug(study.name)}.html", **view)


def _write_index(results: Results, out: Path) -> None:
    has_trends = (out / "trends" / "index.html").is_file()
    write_page(environment(), "index.html.j2", out / "index.html", **index_view(results, out, has_trends))


@cache
def environment() -> jinja2.Environment:
    """Return the templates, compiled once in a process, with everything escaped that is not markup of our own."""
    env = jinja2.Environment(
        loader=jinja2.PackageLoader("crosscheck.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    env.filters |= {
        "short": words.short,
        "duration": words.duration,
        "slug": slug,
        "value": value,
        "breakable": breakable,
    }
    env.policies["json.dumps_kwargs"] = {}  # curves stay in the order in which they were given
    env.globals |= {"SIGNS": words.SIGNS, "MEANINGS": words.MEANINGS, "study_line": words.study_line}
    env.globals |= {"describe_group": words.describe_group}
    return env


def write_page(env: jinja2.Environment, template: str, file: Path, **view: Any) -> None:
    """Render one page."""
    owned.write(file, env.get_template(template).render(**view))


def style(out: Path, names: Iterable[str] = ASSETS[:2]) -> None:
    """Copy assets of our own, by default those of a page without plots."""
    folder = out / "assets"
    folder.mkdir(exist_ok=True)
    for name in names:
        owned.write(folder / name, resources.files("crosscheck.report").joinpath("assets", name).read_bytes())


def assets(out: Path) -> None:
    """Copy style, scripts and the plotting library."""
    folder = out / "assets"
    style(out, ASSETS)
    library = resources.files("plotly").joinpath("package_data", "plotly.min.js")
    owned.write(folder / "plotly.min.js", library.read_bytes())


def index_view(results: Results, out: Path, trends: bool = False) -> dict[str, Any]:
    """Return the contents of the first page; the drawings are of the series below ``out``."""
    groups = words.by_mechanism(results.cases)
    matrix = [block(results, mechanism, cases, out) for mechanism, cases in groups.items()]
    return {
        "results": results,
        "root": "",
        "sentence": words.sentence(results),
        "scope": words.scope(results),
        "unchanged": words.unchanged(results),
        "counts": words.counts(results),
        "troubles": [(v, link(where), label(where), what, text) for v, where, what, text in words.troubles(results)],
        "matrix": matrix,
        "engines": words.engines_alike(results.engines),
        "limits": [(c, line) for c in results.cases for line in c.unused_limits],
        "changed": changed.sentence(results.changes),
        "trends": trends,
        **alone(results),
    }


def alone(results: Results) -> dict[str, Any]:
    """Return the contents of a study for the first page of a run that has nothing else; no study beside others."""
    if results.cases or len(results.studies) != 1:
        return {"study": None}
    return study_view(results, results.studies[0]) | {"root": ""}


def block(results: Results, mechanism: str, cases: Sequence[CaseRow], out: Path) -> dict[str, Any]:
    """Return the part of the matrix for one mechanism: a field for every case and every engine that takes part."""
    read = [case for case in cases if not case.problem]
    rows = [(case, [words.cell(results, case, e.name) for e in results.engines]) for case in read]
    columns = [k for k in range(len(results.engines)) if words.takes_part(cells[k] for _, cells in rows)]
    stills = (animation.still(case.skeleton, read_records(results, case, out)) for case in read if case.skeleton)
    return {
        "mechanism": mechanism,
        "title": next((case.mechanism_title for case in read if case.mechanism_title), ""),
        "problems": [case.problem for case in cases if case.problem],
        "engines": [results.engines[k].name for k in columns],
        "rows": [(case, [cells[k] for k in columns]) for case, cells in rows],
        "absent": words.left_out(results, read) if read else [],
        "drawing": next((one for one in stills if one is not None), None),
    }


def case_view(results: Results, case: CaseRow, out: Path) -> dict[str, Any]:
    """Return the contents of the page of a case; its data files are written on the way."""
    cells = [words.cell(results, case, e.name) for e in results.engines]
    return {
        "results": results,
        "root": "../",
        "case": case,
        "verdict": standing(cells),
        "cells": cells,
        "comparisons": words.gathered(
            sorted((c for one in cells if words.takes_part([one]) for c in one.comparisons), key=skipped_last)
        ),
        "absent": words.left_out(results, [case]),
        "runs": [one.run for one in cells if one.run is not None],
        "manifest": write_case(results, case, out),
        "neighbours": neighbours(results, case),
        "sheets": reasons.sheets(results, case),
        "uncertified": reasons.uncertified(results, case),
        "diagnoses": reasons.diagnoses(results, case),
        "trend": f"../trends/{case.slug}.html" if (out / "trends" / f"{case.slug}.html").is_file() else "",
    }


def standing(cells: Iterable[words.Cell]) -> Verdict:
    """Return the gravest verdict of a case; "skipped" where there is but the reference: skipped is not passed."""
    return worst([c.verdict for c in cells if c.verdict is not None and (c.comparisons or c.verdict == "error")])


def skipped_last(row: Comparison) -> bool:
    """Return True if there is nothing to read in a comparison (a key to sort by)."""
    return row.verdict == "skipped"


def study_view(results: Results, study: StudyRow) -> dict[str, Any]:
    """Return the contents of the page of a study."""
    plot = study_plot(study) if study.plot is not None and study.rows else None
    judged = {"title": study.title, "columns": study.columns, "rows": study.rows, "judged": True}
    tables = [
        t | {"numeric": numeric(t)} for t in (judged, *({**t, "judged": False} for t in study.tables)) if t["rows"]
    ]
    return {"results": results, "root": "../", "study": study, "plot": plot, "tables": tables}


def numeric(table: Mapping[str, Any]) -> set[str]:
    """Return the keys of the columns that hold numbers [any unit]."""
    return {
        key for key, _, _ in table["columns"] if any(isinstance(row.get(key), int | float) for row in table["rows"])
    }


def study_plot(study: StudyRow) -> dict[str, Any]:
    """Return the curves of a study's plot: one per value of the column that groups them."""
    spec = study.plot or {}
    titles = {key: f"{title} [{unit}]" if unit else title for key, title, unit in study.columns}
    curves: dict[str, dict[str, list[Any]]] = {}
    for row in study.rows:
        curve = curves.setdefault(str(row.get(spec["group"])), {"x": [], "y": []})
        curve["x"].append(row.get(spec["x"]))
        curve["y"].append(row.get(spec["y"]))
    return {"x": titles[spec["x"]], "y": titles[spec["y"]], "log": bool(spec["log"]), "curves": curves}


def neighbours(results: Results, case: CaseRow) -> tuple[CaseRow | None, CaseRow | None]:
    """Return the cases before and after this one."""
    shown = [c for c in results.cases if not c.problem]
    k = shown.index(case)
    return shown[k - 1] if k else None, shown[k + 1] if k + 1 < len(shown) else None


def link(where: CaseRow | StudyRow) -> str:
    """Return the page of a case or a study, relative to the index."""
    if isinstance(where, StudyRow):
        return f"studies/{slug(where.name)}.html"
    return "" if where.problem else f"cases/{where.slug}.html"


def label(where: CaseRow | StudyRow) -> str:
    """Return the name of a case or a study."""
    if isinstance(where, StudyRow):
        return where.title
    return f"{where.mechanism} / {where.case}" if where.case else where.mechanism


def breakable(text: str) -> Markup:
    """Return a name, escaped, that may break after an underscore or a slash."""
    return Markup("<wbr>").join(re.split("(?<=[_/])", text))


def value(thing: Any) -> str:
    """Return a value of a table or of the settings in words."""
    if thing is None:
        return "–"
    if isinstance(thing, bool):
        return "yes" if thing else "no"
    if isinstance(thing, float):
        return words.short(thing) if 0 < abs(thing) < 1e-3 else f"{thing:.4g}"
    if isinstance(thing, Mapping | list | tuple):
        return json.dumps(thing)
    return str(thing)
