"""Table of readers in Markdown, as a page, as JSON and as JUnit: what each engine's own reader made of one file."""

from __future__ import annotations

import datetime
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from crosscheck import output_folder as owned
from crosscheck.equivalence.output.text import describe_difference, format_cell
from crosscheck.equivalence.readers import ReaderRow
from crosscheck.report.html import copy_style, prepare_templates, write_page
from crosscheck.report.junit import FORBIDDEN
from crosscheck.verdicts.results import list_versions


def write_table(file: str, rows: Sequence[ReaderRow], out: Path) -> None:
    """Write index.html, results.json, summary.md and junit.xml of the readers of a file into a folder.  Raises OSError."""
    out.mkdir(parents=True, exist_ok=True)
    copy_style(out)
    stamp = {"started": datetime.datetime.now().isoformat(timespec="seconds"), "versions": list_versions()}
    view = {
        "name": Path(file).name,
        "rows": rows,
        "sentence": describe_agreement(rows),
        "results": stamp,
        "root": "",
        "line": describe_difference,
    }
    write_page(prepare_templates(), "readers.html.j2", out / "index.html", **view)
    plain = {"format": "crosscheck-readers/1", "file": file, "readers": [row.plain for row in rows]} | stamp
    owned.write(out / "results.json", json.dumps(plain, indent=1, ensure_ascii=False))
    owned.write(out / "summary.md", render_readers_table(file, rows))
    owned.write(out / "junit.xml", _render_junit(file, rows))


def describe_agreement(rows: Sequence[ReaderRow]) -> str:
    """Return the number of readers that make the same machine of the file as the first, in a sentence."""
    words = {
        "equal": "the same machine", "different": "another one", "cannot": "nothing: it cannot read it",
        "not comparable": "not comparable, for a mechanism does not reproduce it", "not proven": "no difference, not proven",
    }  # fmt: skip
    counts = {word: [row.reader for row in rows[1:] if row.result == word] for word in words}
    parts = [f"{', '.join(names)}: {words[word]}" for word, names in counts.items() if names]
    if rows[0].result == "cannot":
        return f"No reader reads it: {', '.join(row.reader for row in rows)}."
    return f"Against the reader {rows[0].reader}, {'; '.join(parts)}." if parts else f"Read by {rows[0].reader} alone."


def render_readers_table(file: str, rows: Sequence[ReaderRow]) -> str:
    """Return the table for a pull request or the summary of a CI step."""
    return "\n".join(_list_markdown_lines(file, rows)) + "\n"


def _list_markdown_lines(file: str, rows: Sequence[ReaderRow]) -> Iterator[str]:
    yield f"## {format_cell(Path(file).name)}, as each engine reads it"
    yield ""
    yield format_cell(describe_agreement(rows))
    yield ""
    yield "| reader | joints | mass [kg] | result | differences |"
    yield "|---|--:|--:|---|---|"
    for row in rows:
        yield "| " + " | ".join(map(format_cell, (row.reader, row.joints, row.mass, row.result, row.refusal))) + " |"
    for row in rows:
        if row.dropped:
            yield f"\n<details><summary>what {format_cell(row.reader)} leaves out or takes for granted</summary>\n"
            yield from (f"* {format_cell(words)}" for words in row.dropped)
            yield "\n</details>"


def _render_junit(file: str, rows: Sequence[ReaderRow]) -> bytes:
    root = ET.Element("testsuites", name="crosscheck compare --readers")
    suite = ET.SubElement(root, "testsuite", name=_replace_forbidden(file), tests=str(len(rows)))
    suite.set("failures", str(sum(row.result == "different" for row in rows)))
    suite.set("errors", str(sum(row.result not in ("equal", "different") for row in rows)))
    for row in rows:
        case = ET.SubElement(suite, "testcase", classname="readers", name=row.reader)
        if row.result != "equal":
            ET.SubElement(
                case, "failure" if row.result == "different" else "error", message=_replace_forbidden(row.refusal)
            )
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text


def _replace_forbidden(words: str) -> str:
    return FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", words)
