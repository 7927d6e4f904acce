"""``summary.md``: the report for a terminal, a pull request or a CI step summary."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator

from crosscheck.report import change_summary, words
from crosscheck.report.explanations import describe_causes, describe_diagnosis
from crosscheck.report.words import (
    SIGNS,
    describe_gone,
    describe_group,
    describe_run,
    describe_study,
    describe_unchanged,
    format_change,
    format_duration,
    format_place,
    format_short,
    list_troubles,
    make_cell,
)
from crosscheck.verdicts.results import Results
from crosscheck.verdicts.study_table import SideTable

SPECIAL = re.compile(r"([\\`*_\[\]|~<>&$@])")


def render(results: Results) -> str:
    """Return the summary as GitHub-flavoured Markdown."""
    parts = [f"# {describe_run(results)}", "", f"{escape(results.started)}, {format_duration(results.elapsed)}", ""]
    if said := describe_unchanged(results):
        parts += [escape(said), ""]
    for render_section in SECTIONS:
        parts += render_section(results)
    return "\n".join(parts) + "\n"


def _render_section(title: str, head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[str]:
    return [f"## {title}", "", *render_table(head, rows)]


def _render_changes(results: Results) -> Iterator[str]:
    if results.changes:
        yield from ("## Changes", "", escape(change_summary.describe_changes(results.changes)), "")
        moved = [
            (v["what"], v["before_verdict"], old, v["after_verdict"], new)
            for v in results.changes["values"]
            for old, new in [format_change(v["before"], v["after"])]
        ]
        if moved:
            yield from render_table(("comparison", "was", "", "is", ""), moved)
        if new := [(c["what"], c["name"], c["words"]) for c in results.changes.get("causes", ())]:
            yield from render_table(("cause", "of what", "in words"), new)


def _render_moves(results: Results) -> Iterator[str]:
    if results.moves:
        yield from ("## Values that moved since they were blessed", "")
        for moves in results.moves_by_reason.values():
            yield from (f"* {escape(line)}" for line in describe_group(moves))
            yield ""


def _render_gone(results: Results) -> Iterator[str]:
    if gone := describe_gone(results):
        yield from ("## Gone", "", *(f"* {escape(line)}" for line in gone), "")


def _render_unused_limits(results: Results) -> list[str]:
    idle = [(f"{c.mechanism}/{c.case}", line) for c in results.cases for line in c.unused_limits]
    return _render_section("Limits that no comparison asked for", ("case", "limit"), idle) if idle else []


def _render_troubles(results: Results) -> list[str]:
    rows = [(f"{SIGNS[v]} {v}", format_place(where), what, words) for v, where, what, words in list_troubles(results)]
    return _render_section("Where not", ("verdict", "where", "what", "message"), rows) if rows else []


def _render_matrix(results: Results) -> Iterator[str]:
    if results.studies and not results.cases:  # nothing was compared, and nothing was to be
        return
    yield from ("## Matrix", "", "Largest error over the range of the signal, for the quantity nearest its limit.", "")
    yield from render_table(("case", *(e.name for e in results.engines)), _list_matrix_rows(results))


def _render_diagnoses(results: Results) -> list[str]:
    asked = [
        (f"{d.mechanism}/{d.case}", d.engine, describe_causes(d) or "none", describe_diagnosis(d))
        for d in results.diagnoses
    ]
    head = ("case", "engine", "cause", "what it explains")
    return _render_section("Why they differ", head, asked) if asked else []


def _render_studies(results: Results) -> list[str]:
    if not results.studies:
        return []
    assumed = [line for study in results.studies if study.assumed for line in (escape(study.assumed), "")]
    return [*_render_section("Studies", ("study", "verdict", "rows"), _list_study_rows(results)), *assumed]


def _render_leading_tables(results: Results) -> Iterator[str]:
    """The tables of studies that were asked for, then the one that is judged where they lead, and others that belong here."""
    for study in results.studies:
        judged: SideTable = {"title": study.heading, "columns": study.columns, "rows": study.rows}
        leading = [table for table in study.tables if table.get("leads")]
        others = [table for table in study.tables if table.get("summarised")]
        for table in [*leading, *([judged] if study.heading else []), *others]:
            if table["rows"]:
                keys = [key for key, _, _ in table["columns"]]
                head = tuple(title for _, title, _ in table["columns"])
                rows = [tuple(_format_value(row.get(key)) for key in keys) for row in table["rows"]]
                yield from _render_section(escape(table["title"]), head, rows)


def _format_value(value: object) -> str:
    return format_short(value) if isinstance(value, int | float) else str(value or "")


def _render_comparisons(results: Results) -> list[str]:
    if results.studies and not results.cases:
        return []
    return _render_section("Comparisons", HEAD, _list_comparison_rows(results))


def _render_engines(results: Results) -> list[str]:
    rows = [(e.name, e.version or "–", e.message or e.abilities) for e in results.engines]
    return _render_section("Engines", ("engine", "version", "what it can do"), rows) if rows else []


SECTIONS: tuple[Callable[[Results], Iterable[str]], ...] = (
    _render_changes,
    _render_moves,
    _render_gone,
    _render_unused_limits,
    _render_troubles,
    _render_matrix,
    _render_diagnoses,
    _render_studies,
    _render_leading_tables,
    _render_comparisons,
    _render_engines,
)


HEAD = ("case", "engine", "reference", "quantity", "largest error", "RMS", "of range", "limit", "verdict", "message")


def _list_matrix_rows(results: Results) -> Iterable[tuple[str, ...]]:
    for case in results.cases:
        cells = [make_cell(results, case, e.name) for e in results.engines]
        texts = [f"{SIGNS[c.verdict]} {c.headline}{c.cause and f': {c.cause}'}" if c.verdict else "" for c in cells]
        yield format_place(case), *texts


def _list_comparison_rows(results: Results) -> Iterable[tuple[str, ...]]:
    for c in words.join_alike_comparisons(results.comparisons):
        yield (
            f"{c.mechanism}/{c.case}",
            c.engine,
            c.reference,
            c.quantity,
            f"{format_short(c.maximum)} {c.unit}" if c.maximum is not None else "",
            f"{format_short(c.rms)} {c.unit}" if c.rms is not None else "",
            format_short(c.fraction),
            format_short(c.limit),
            f"{SIGNS[c.verdict]} {c.verdict}",
            c.message,
        )


def _list_study_rows(results: Results) -> Iterable[tuple[str, ...]]:
    return ((s.title, f"{SIGNS[s.verdict]} {s.verdict}", describe_study(s)) for s in results.studies)


def render_table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[str]:
    """Return the lines of a table, every field escaped, with an empty line after it."""
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    return [*lines, *("| " + " | ".join(escape(field) for field in row) + " |" for row in rows), ""]


def escape(text: str) -> str:
    """Return text that Markdown shows as it is, on one line."""
    return SPECIAL.sub(r"\\\1", " ".join(str(text).split()))
