"""Files of findings: a page, JSON, JUnit and Markdown in one folder."""

from __future__ import annotations

import datetime
import json
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from crosscheck import output_folder as owned
from crosscheck.equivalence.output.text import format_cell
from crosscheck.linting.lint import LintReport
from crosscheck.report.html import copy_style, prepare_templates, write_page
from crosscheck.report.junit import FORBIDDEN
from crosscheck.verdicts.results import list_versions


def write(reports: Sequence[LintReport], out: Path) -> None:
    """Write index.html, results.json, junit.xml and summary.md into a folder.  Raises OSError."""
    out.mkdir(parents=True, exist_ok=True)
    copy_style(out)
    stamp = {"started": datetime.datetime.now().isoformat(timespec="seconds"), "versions": list_versions()}
    view = {
        "found": reports,
        "clean": all(one.clean for one in reports),
        "sentence": describe_counts(reports),
        "results": stamp,
        "root": "",
    }
    write_page(prepare_templates(), "lint.html.j2", out / "index.html", **view)
    plain = {"format": "crosscheck-lint/1", "files": [one.plain for one in reports]} | stamp
    owned.write(out / "results.json", json.dumps(plain, indent=1, ensure_ascii=False))
    owned.write(out / "junit.xml", build_junit_xml(reports))
    owned.write(out / "summary.md", render_markdown(reports))


def describe_counts(reports: Sequence[LintReport]) -> str:
    """Return the numbers of findings and of files in a sentence."""
    files = "one file" if len(reports) == 1 else f"{len(reports)} files"
    with_any = sum(bool(one.findings) for one in reports)
    if not with_any:
        return f"Nothing found in {files}."
    return f"{sum(len(one.findings) for one in reports)} findings in {with_any} of {files}."


def list_lines(report: LintReport) -> list[str]:
    """Return the findings of one description, each in one line that begins with its file."""
    texts = (
        f"{report.label}: {f.level}: {f.check}: {f.place}: {f.given}: {f.why}; write {f.write}" for f in report.findings
    )
    return [" ".join(text.split()) for text in texts]


def render_markdown(reports: Sequence[LintReport]) -> str:
    """Return findings as Markdown: a table for each file."""
    lines = [f"## {describe_counts(reports)}"]
    for one in reports:
        lines += ["", f"### {format_cell(one.label)}: {one.words}"]
        if one.findings:
            lines += ["", "| check | where | given | why | write |", "|---|---|---|---|---|"]
        for f in one.findings:
            lines.append("| " + " | ".join(map(format_cell, (f.check, f.place, f.given, f.why, f.write))) + " |")
    return "\n".join(lines) + "\n"


def build_junit_xml(reports: Sequence[LintReport]) -> bytes:
    """Return findings as JUnit XML: a suite for each file, a failure for each finding that counts."""
    root = ET.Element("testsuites", name="crosscheck lint")
    for one in reports:
        suite = ET.SubElement(root, "testsuite", name=_remove_forbidden(one.label), tests=str(len(one.findings) or 1))
        counted = [f for f in one.findings if f.level == "error" or one.strict]
        suite.set("failures", str(len(counted)))
        for finding in one.findings:
            case = ET.SubElement(suite, "testcase", classname=finding.check, name=_remove_forbidden(finding.place))
            if finding in counted:
                message = _remove_forbidden(f"{finding.given}: {finding.why}; write {finding.write}")
                ET.SubElement(case, "failure", message=message)
        if not one.findings:
            ET.SubElement(suite, "testcase", classname="lint", name="nothing found")
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text


def _remove_forbidden(words: str) -> str:
    return FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", words)
