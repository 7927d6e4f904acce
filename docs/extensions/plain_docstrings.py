"""Docstrings of this project as they are written: paragraphs, lines "name : what it is", and formulas with indentation."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

ENTRY = re.compile(r"^([\w.*`\"()/]+(?:, [\w.*`\"()/]+)*) : (.+)$")
SPECIAL = re.compile(r"([\\*|_])")
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
    """Let stars, bars and underscores in the text of a command be themselves, in place."""
    lines[:] = [SPECIAL.sub(r"\\\1", line) for line in lines]


def setup(app: Sphinx) -> dict[str, Any]:
    """Convert before any other extension reads the docstring."""
    app.connect("autodoc-process-docstring", convert, priority=1)
    app.connect("sphinx-click-process-description", unmarked)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
