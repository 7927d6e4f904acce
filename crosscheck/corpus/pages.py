"""Pages of a corpus: one of every case, one of all, and one of the audit; they look as those of a report and ask nobody."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TypedDict

import numpy as np

from crosscheck.corpus.audit import AuditRow
from crosscheck.corpus.consensus import AGREES, CLOSED_FORM, CONSENSUS, DISAGREEMENT, REACHED, SINGLE, CaseConsensus
from crosscheck.corpus.entry import CLASSES, FLOOR_REASON, CaseEntry, SeriesEntry, VoiceEntry
from crosscheck.corpus.folder import Corpus
from crosscheck.report.html import copy_style, prepare_templates, write_page
from crosscheck.verdicts.compare import WHOLE
from flexinv.typing import Array

VERDICTS = {CONSENSUS: "within", CLOSED_FORM: "within", DISAGREEMENT: "deviation", SINGLE: "skipped"}
MEANINGS = {
    CONSENSUS: "engines of two authors at least put every torque into intervals that meet at every sample",
    CLOSED_FORM: "a formula gives every torque",
    DISAGREEMENT: "intervals of different authors do not meet: who, and why, is on its page",
    SINGLE: "one author alone gives it with an error bar: no check case yet, and not counted",
}
# of a sketch [px], [px], [-]
WIDTH = 640.0
HEIGHT = 150.0
POINTS = 400


class SeriesGroup(TypedDict):
    """Series of a case of which the same is said; half : largest half-width [unit], share : of the size [-], None: none."""

    quantity: str
    names: list[str]
    unit: str
    status: str
    cause: str
    half: float | None
    share: float | None
    agree: list[str]
    others: list[VoiceEntry]


class Sketch(TypedDict):
    """Picture of a series with its consensus: ends [unit], end of the time [s], points of band and middle [px]."""

    name: str
    unit: str
    low: float
    high: float
    end: float
    band: str
    line: str


class CasePage(TypedDict):
    """Contents of the page of a case; neighbours : the cases before and after it."""

    root: str
    one: CaseEntry
    groups: list[SeriesGroup]
    sketches: list[Sketch]
    neighbours: tuple[CaseEntry | None, CaseEntry | None]


def render(corpus: Corpus, cases: Iterable[CaseConsensus], audited: Sequence[AuditRow] = ()) -> None:
    """Write ``index.html``, a page per case, and the audit's page where there is one, below a corpus that is ours."""
    env = prepare_templates()
    env.globals |= {"STATUS": VERDICTS, "STATUSES": MEANINGS}
    copy_style(corpus.folder)
    (corpus.folder / "cases").mkdir(exist_ok=True)
    entries = list(corpus.entries)
    for case, one, before, after in zip(cases, entries, [None, *entries], [*entries[1:], None], strict=False):
        page: CasePage = {
            "root": "../",
            "one": one,
            "groups": collect_groups(one),
            "sketches": draw_sketches(case),
            "neighbours": (before, after),
        }
        write_page(env, "corpus_case.html.j2", corpus.folder / "cases" / f"{one['id']}.html", **page)
    by_class = {name: [one for one in entries if one["class"] == name] for name in CLASSES}
    tally = Counter(one["status"] for one in entries)
    view = {
        "root": "",
        "corpus": corpus,
        "classes": by_class,
        "tally": tally,
        "floor": FLOOR_REASON,
        "audited": audited,
    }
    write_page(env, "corpus_index.html.j2", corpus.folder / "index.html", **view)


def collect_groups(one: CaseEntry) -> list[SeriesGroup]:
    """Return the series of a case gathered: those of one quantity and unit with the same status and the same voices."""
    found: dict[tuple[object, ...], list[SeriesEntry]] = {}
    for row in one["series"]:
        heard = tuple((v["engine"], v["part"], v.get("reason", "")) for v in row["engines"])
        key = row["name"].split("/", 1)[0], row["unit"], row["status"], heard, row.get("cause", "")
        found.setdefault(key, []).append(row)
    return [_make_group(rows) for rows in found.values()]


def _make_group(rows: Sequence[SeriesEntry]) -> SeriesGroup:
    first = rows[0]
    widths = [row["half-width"] for row in rows if "half-width" in row]
    shares = [row["half-width"] / row["size"] for row in rows if "half-width" in row and row["size"] > 0.0]
    return {
        "quantity": first["name"].split("/", 1)[0],
        "names": [row["name"] for row in rows],
        "unit": first["unit"],
        "status": first["status"],
        "cause": first.get("cause", ""),
        "half": max(widths, default=None),
        "share": max(shares, default=None),
        "agree": [v["engine"] for v in first["engines"] if v["part"] == AGREES],
        "others": [v for v in first["engines"] if v["part"] != AGREES],
    }


def draw_sketches(case: CaseConsensus) -> list[Sketch]:
    """Return a sketch of every torque that has a consensus: points of its band in a picture [px], and its ends [unit]."""
    sketches: list[Sketch] = []
    for one in case.series:
        if one.quantity in WHOLE and one.status in REACHED and one.interval is not None:
            low = float(one.interval.low.min())
            high = float(one.interval.high.max())
            edge, line = draw_band(case.task.time, one.interval.low, one.interval.high)
            end = float(case.task.time[-1])
            sketches.append(
                {"name": one.name, "unit": one.unit, "low": low, "high": high, "end": end, "band": edge, "line": line}
            )
    return sketches


def draw_band(time: Array, low: Array, high: Array) -> tuple[str, str]:
    """Return the points of a band and of its middle in a picture [px]; time : (samples,) [s], low, high : (samples,) [unit]."""
    rows = np.unique(np.linspace(0, time.size - 1, min(time.size, POINTS)).astype(int))
    bottom = float(low.min())
    top = float(high.max())
    span = (top - bottom) or 1.0
    x = WIDTH * (time[rows] - time[0]) / ((time[-1] - time[0]) or 1.0)
    y = [HEIGHT * (top - values[rows]) / span for values in (low, high, 0.5 * (low + high))]
    edge = [*zip(x, y[1], strict=True), *reversed(list(zip(x, y[0], strict=True)))]
    return _format_points(edge), _format_points(zip(x, y[2], strict=True))


def _format_points(pairs: Iterable[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in pairs)
