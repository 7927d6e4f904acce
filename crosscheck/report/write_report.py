"""Render a report from ``results.json``: pages, a Markdown summary and a JUnit file."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

from crosscheck import output_folder as owned
from crosscheck.report import html, junit, markdown
from crosscheck.verdicts.results import Results


class ReportError(OSError):
    """Parts of a report that could not be written; the others stand.  Whoever minds a full disk minds this, too."""


def render(results: Results, out: Path) -> None:
    """Write ``index.html`` and its pages, ``summary.md`` and ``junit.xml`` into ``out``.

    Raises ReportError once all that can be written is written, with the parts that cannot.
    """
    owned.make_listed_folder(out)
    parts: dict[str, Callable[[], object]] = {
        "summary.md": lambda: owned.write(out / "summary.md", markdown.render(results)),
        "junit.xml": lambda: owned.write(out / "junit.xml", junit.render(results)),
        **{name: functools.partial(page, out) for name, page in html.collect_pages(results).items()},
    }
    failed = []
    for name, write in parts.items():
        try:
            write()
        except Exception as error:
            failed.append(f"{name}: {type(error).__name__}: {error}")
    if failed:
        raise ReportError("; ".join(failed))
