"""Render a report from ``results.json``: pages, a Markdown summary and a JUnit file."""

from __future__ import annotations

from pathlib import Path

from crosscheck.report import html, junit, markdown
from crosscheck.results import Results


def render(results: Results, out: Path) -> None:
    """Write ``index.html`` and its pages, ``summary.md`` and ``junit.xml`` into ``out``."""
    (out / "summary.md").write_text(markdown.render(results), encoding="utf-8")
    (out / "junit.xml").write_bytes(junit.render(results))
    html.render(results, out)
