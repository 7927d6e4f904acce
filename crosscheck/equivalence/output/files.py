"""Files of a comparison: a page, JSON, JUnit and Markdown in one folder."""

from __future__ import annotations

import datetime
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TypedDict
from xml.etree import ElementTree as ET

from crosscheck import output_folder as owned
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.output.text import (
    GROUPS,
    describe_difference,
    describe_repair,
    describe_rounding,
    render_markdown,
)
from crosscheck.equivalence.result import INCOMPARABLE, NOT_PROVEN, WORDS, Comparison
from crosscheck.report.html import copy_style, prepare_templates, write_page
from crosscheck.report.junit import FORBIDDEN
from crosscheck.verdicts.results import list_versions


class Stamp(TypedDict):
    """Time of a comparison, and the versions that made it."""

    started: str
    versions: dict[str, str]


class ComparisonView(TypedDict):
    """Contents of the page of a comparison."""

    found: Comparison
    groups: list[tuple[str, tuple[Difference, ...]]]
    words: Mapping[str, str]
    verdicts: list[tuple[str, str]]
    repaired: str
    rounding: list[str]
    results: Stamp
    root: str


def write(comparison: Comparison, out: Path) -> None:
    """Write index.html, results.json, junit.xml and summary.md into a folder.  Raises OSError."""
    out.mkdir(parents=True, exist_ok=True)
    copy_style(out)
    now = datetime.datetime.now().isoformat(timespec="seconds")
    stamp: Stamp = {"started": now, "versions": list_versions()}
    view: ComparisonView = {
        "found": comparison,
        "groups": [(title, getattr(comparison.judged, name)) for name, title in GROUPS],
        "words": WORDS,
        "verdicts": [(WORDS[f], comparison.verdict(f)) for f in comparison.told],
        "repaired": describe_repair(comparison),
        "rounding": describe_rounding(comparison),
        "results": stamp,
        "root": "",
    }
    write_page(prepare_templates(), "compare.html.j2", out / "index.html", **view)
    owned.write(out / "results.json", json.dumps({**comparison.plain, **stamp}, indent=1, ensure_ascii=False))
    owned.write(out / "summary.md", render_markdown(comparison))
    owned.write(out / "junit.xml", render_junit(comparison))


def render_junit(comparison: Comparison) -> bytes:
    """Return the comparison as JUnit XML: a test case for each family, a failure where differences count."""
    counted = comparison.differences
    root = ET.Element("testsuites", name="crosscheck compare", time=f"{comparison.elapsed:.3f}")
    suite = ET.SubElement(root, "testsuite", name=_replace_forbidden(f"{comparison.first} and {comparison.second}"))
    cases = [
        (WORDS[f], [describe_difference(d) for d in counted if d.family == f])
        for f in comparison.families
        if f in comparison.told
    ]
    cases.append(("efforts", [describe_repair(comparison)] if comparison.unexplained else []))
    if comparison.proofs:
        doubted = comparison.state in (INCOMPARABLE, NOT_PROVEN)
        proof = ET.SubElement(suite, "testcase", classname="compare", name="held against the readers' own models")
        if doubted:
            ET.SubElement(proof, "error", message=_replace_forbidden(comparison.doubts[0])).text = _replace_forbidden(
                "\n".join(comparison.doubts)
            )
        ET.SubElement(proof, "system-out").text = _replace_forbidden("\n".join(comparison.grounds))
    for name, lines in cases:
        case = ET.SubElement(suite, "testcase", classname="compare", name=name)
        if lines:
            ET.SubElement(case, "failure", message=_replace_forbidden(lines[0])).text = _replace_forbidden(
                "\n".join(lines)
            )
    suite.set("tests", str(len(suite)))
    suite.set("failures", str(len(suite.findall("testcase/failure"))))
    suite.set("errors", str(len(suite.findall("testcase/error"))))
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text


def _replace_forbidden(words: str) -> str:
    return FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", words)
