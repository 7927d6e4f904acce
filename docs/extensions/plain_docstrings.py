"""Docstrings of this project as they are written: paragraphs, lines "name : what it is", and formulas with indentation."""

from __future__ import annotations

import itertools
import re
import textwrap
from typing import Any

from sphinx.application import Sphinx

ENTRY = re.compile(r"^([\w.*`\"()/]+(?:, [\w.*`\"()/]+)*) : (.+)$")
SPECIAL = re.compile(r"([\\*|_])")
NAMED = re.compile(r"(^|[\s(])`([^`]+)`(?!`)")
LISTED = re.compile(r"^(\w[\w, .]*) : ")


def convert(app: Sphinx, what: str, name: str, owner: object, options: object, lines: list[str]) -> None:
    """Turn the lines of a docstring into reStructuredText, in place."""
    out: list[str] = []
    for paragraph in "\n".join(lines).split("\n\n"):
        rows = [row for row in paragraph.split("\n") if row.strip()]
        if rows:
            out += [*_paragraph(rows), ""]
    lines[:] = out


def _paragraph(rows: list[str]) -> list[str]:
    """Formulas and examples stay as they stand, entries become a list, all else is text."""
    if all(row.startswith("    ") for row in rows) or any(row.lstrip().startswith(">>>") for row in rows):
        return ["::", "", *(f"    {row}" for row in rows)]
    out: list[str] = []
    for row in rows:
        deeper = row.startswith(" ")
        if not deeper and LISTED.match(row):
            for entry in row.split("; ") if all(LISTED.match(part) for part in row.split("; ")) else [row]:
                key, _, text = entry.partition(" : ")
                out += ["", f"* **{_escaped(key)}** : {_escaped(text)}"]
        elif deeper and out and out[-1].startswith(("* ", "  ")):
            out.append(f"  {_escaped(row.strip())}")
        else:
            if out and out[-1].startswith(("* ", "  ")):
                out.append("")
            out.append(_escaped(row.strip()))
    return out


def _escaped(text: str) -> str:
    """Text in which only names in backquotes have a meaning: they are code."""
    parts = re.split(r"(``[^`]+``|`[^`]+`)", text)
    return "".join(f"``{p.strip('`')}``" if p.startswith("`") else SPECIAL.sub(r"\\\1", p) for p in parts)


def unmarked(app: Sphinx, context: object, lines: list[str]) -> None:
    """Turn the text of a command into reStructuredText, in place: what is laid out by hand (after \\b) stays as it stands."""
    out: list[str] = []
    for by_hand, rows in itertools.groupby(lines, lambda row: row.startswith("| ")):
        text = [*rows]
        if by_hand:
            laid = textwrap.dedent("\n".join(row[2:] for row in text)).split("\n")
            out += ["", ".. code-block:: text", "", *(f"    {row}" for row in laid), ""]
        else:
            out += [_escaped(row) for row in text]
    lines[:] = out


def named(app: Sphinx, context: object, lines: list[str]) -> None:
    """Let what stands in backquotes in the text of an option be code, in place."""
    lines[:] = [NAMED.sub(r"\1``\2``", line) for line in lines]


def setup(app: Sphinx) -> dict[str, Any]:
    """Convert before any other extension reads the docstring."""
    app.connect("autodoc-process-docstring", convert, priority=1)
    app.connect("sphinx-click-process-description", unmarked)
    app.connect("sphinx-click-process-options", named)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
