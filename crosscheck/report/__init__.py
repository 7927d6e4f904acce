"""Render a report from ``results.json``: pages, a Markdown summary and a JUnit file."""

from __future__ import annotations

from pathlib import Path

from crosscheck import output_folder as owned
from crosscheck.report import html, junit, markdown
from crosscheck.verdicts.results import Results


def render(results: Results, out: Path) -> None:
    """Write ``index.html`` and its pages, ``summary.md`` and ``junit.xml`` into ``out``."""
    owned.adopt(out)
    owned.write(out / "summary.md", markdown.render(results))
    owned.write(out / "junit.xml", junit.render(results))
    html.render(results, out)
