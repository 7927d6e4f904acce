"""Trend pages: every comparison, every metric and every time over the nights, with the versions of the engines.

One page per case and one for all; each holds its own numbers, so that years of nights stay quick to open.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import sqlalchemy as sql

from crosscheck import output_folder as owned
from crosscheck.report import html
from crosscheck.verdicts.history import COMPARISON, METRIC, TIMING, VERSION, Night, Row, ask, list_nights
from crosscheck.verdicts.results import make_slug
from flexinv.display.curve_table import DrawnCurve, render_curves

MOST = 400  # nights that are drawn, the newest ones: more than a year
Point = list[float | str | None]  # number of the night, value, perhaps verdict or status
Case = tuple[str, str]


def write(database: sql.Engine, out: Path) -> None:
    """Write ``trends/index.html`` and one page per case below ``out``.  Raises HistoryError, OSError."""
    shown = list_nights(database)[-MOST:]
    order = {night.id: k for k, night in enumerate(shown)}
    owned.make_listed_folder(out)
    folder = out / "trends"
    folder.mkdir(parents=True, exist_ok=True)
    values = _split_by_case(_read_night_rows(database, COMPARISON, order))
    times = _split_by_case(_read_night_rows(database, TIMING, order))
    marks = list_version_marks(shown, _read_night_rows(database, VERSION, order))
    axis = [night.started[:16].replace("T", " ") for night in shown]
    common = {"root": "../", "nights": shown, "marks": marks, "axis": axis}
    for case in sorted(times):
        charts = [
            build_chart(
                "Largest error over the range",
                "-",
                build_curves(values.get(case, ()), order, make_legend_name, "fraction"),
                log=True,
            ),
            build_chart(
                "Time of the engine",
                "s",
                build_curves(times[case], order, lambda row: row["engine"], "wall_time"),
                log=True,
            ),
        ]
        title = " / ".join(case)
        view = {**common, "title": title, "charts": charts, "back": f"../cases/{make_slug('-'.join(case))}.html"}
        _write_trend_page(folder, make_slug("-".join(case)), {**view, "links": []})
    charts = [
        build_chart("Time of the whole night", "s", {"night": [[order[n.id], n.elapsed] for n in shown if not n.label]})
    ]
    charts += build_metric_charts(_read_night_rows(database, METRIC, order), order)
    links = [(" / ".join(case), f"{make_slug('-'.join(case))}.html") for case in sorted(times)]
    view = {**common, "title": "All nights", "charts": charts, "links": links, "back": "../index.html"}
    _write_trend_page(folder, "index", view)


def _write_trend_page(folder: Path, stem: str, view: Mapping[str, Any]) -> None:
    """Write a page of charts, and a CSV of each."""
    files = [f"{stem}-chart{k}.csv" for k in range(len(view["charts"]))]
    for file, chart in zip(files, view["charts"], strict=True):
        owned.write(folder / file, render_chart(chart, view["axis"]))
    html.write_page(html.prepare_templates(), "trends.html.j2", folder / f"{stem}.html", **view, files=files)


def render_chart(chart: Chart, axis: Sequence[str]) -> str:
    """Return the curves of a chart over the nights as CSV [unit of the chart]; axis : the time of each night."""
    return render_curves(
        DrawnCurve(
            "night",
            f"{chart['title']} [{chart['unit']}]: {name}",
            [axis[int(point[0] or 0)] for point in points],
            [point[1] for point in points],
        )
        for name, points in chart["curves"].items()
    )


class Chart(TypedDict):
    """Data of one chart of a page; curves : by name, values [unit]; lower, upper : limits [unit]."""

    title: str
    unit: str
    curves: dict[str, list[Point]]
    log: bool
    lower: NotRequired[float | None]
    upper: NotRequired[float | None]


class VersionMark(TypedDict):
    """Change of versions between two nights; night : number of the later one, text : "mujoco 4.0.0 to 4.1.0"."""

    night: int
    text: str


def build_chart(title: str, unit: str, curves: Mapping[str, list[Point]], log: bool = False) -> Chart:
    """Return the data of one chart of a page; curves : by name, values [unit]."""
    return {"title": title, "unit": unit, "curves": dict(curves), "log": log}


def build_curves(
    rows: Iterable[Row], order: Mapping[int, int], name: Callable[[Row], str], what: str
) -> dict[str, list[Point]]:
    """Return one curve per name, in the order of the nights: [number of the night, value, verdict or status]."""
    curves: dict[str, list[Point]] = {}
    for row in sorted(rows, key=lambda row: order[row["night"]]):
        if row[what] is not None:
            state = row.get("verdict") or row.get("status")
            curves.setdefault(name(row), []).append([order[row["night"]], row[what], state])
    return dict(sorted(curves.items()))


def make_legend_name(row: Row) -> str:
    """Return the name of a comparison in a legend."""
    against = "" if row["reference"] == "flexinv" else f" against {row['reference']}"
    return f"{row['engine']}{against} {row['quantity']}" + (f" [{row['unit']}]" if row["unit"] else "")


def build_metric_charts(rows: Sequence[Row], order: Mapping[int, int]) -> list[Chart]:
    """Return one chart per metric, with its last limits [unit of the metric]."""
    charts: list[Chart] = []
    for name in sorted({row["name"] for row in rows}):
        metric_rows = sorted((row for row in rows if row["name"] == name), key=lambda row: order[row["night"]])
        curve: list[Point] = [[order[row["night"]], row["value"]] for row in metric_rows]
        chart = build_chart(name, metric_rows[-1]["unit"], {name: curve})
        chart["lower"] = metric_rows[-1]["lower"]
        chart["upper"] = metric_rows[-1]["upper"]
        charts.append(chart)
    return charts


def list_version_marks(shown: Sequence[Night], rows: Iterable[Row]) -> list[VersionMark]:
    """Return the changes of versions from night to night."""
    known: dict[int, dict[str, str]] = {}
    for row in rows:
        known.setdefault(row["night"], {})[row["package"]] = row["version"]
    marks: list[VersionMark] = []
    for number, (before, after) in enumerate(pairwise(shown), 1):
        old = known.get(before.id, {})
        new = known.get(after.id, {})
        changed = [f"{p} {old[p]} to {v}" for p, v in sorted(new.items()) if p in old and old[p] != v]
        if changed:
            marks.append({"night": number, "text": ", ".join(changed)})
    return marks


def _read_night_rows(database: sql.Engine, table: sql.Table, order: Mapping[int, int]) -> list[Row]:
    first = min(order, default=0)
    rows = [dict(row._mapping) for row in ask(database, sql.select(table).where(table.c.night >= first))]
    return [row for row in rows if row["night"] in order]


def _split_by_case(rows: Iterable[Row]) -> dict[Case, list[Row]]:
    groups: dict[Case, list[Row]] = {}
    for row in rows:
        groups.setdefault((row["mechanism"], row["case_name"]), []).append(row)
    return groups
