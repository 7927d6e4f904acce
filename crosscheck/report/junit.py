"""``junit.xml``: every run and every comparison as a test case, for CI systems."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

from crosscheck.report.words import describe_gone, describe_group, find_cause, format_short
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.results import CaseRow, Results, RunRow, StudyRow

# XML 1.0 has no way to write these characters (https://www.w3.org/TR/xml/#charsets).
FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
TAGS = {"skipped": "skipped", "deviation": "failure", "unjudged": "failure", "error": "error"}


def render(results: Results) -> bytes:
    """Return the JUnit XML document."""
    root = ET.Element("testsuites", name="crosscheck", time=f"{results.elapsed:.3f}")
    for case in results.cases:
        _add_case(root, results, case)
    for study in results.studies:
        _add_study(root, study)
    for line in describe_gone(results):
        suite = ET.SubElement(root, "testsuite", name="crosscheck")
        name, _, said = line.partition(": ")
        _add_item(suite, name, "blessed comparisons", "deviation", said)
    for moves in results.moves_by_reason.values():
        suite = ET.SubElement(root, "testsuite", name="crosscheck")
        _add_item(suite, "crosscheck", "blessed values", "deviation", "\n".join(describe_group(moves)))
    if not results.finished or results.message:
        suite = ET.SubElement(root, "testsuite", name="crosscheck")
        _add_item(suite, "crosscheck", "run", "error", results.message or "the run has not finished")
    for suite in root:
        for attribute, tag in (("tests", "testcase"), ("failures", "failure"), ("errors", "error")):
            suite.set(attribute, str(sum(1 for _ in suite.iter(tag))))
        suite.set("skipped", str(sum(1 for _ in suite.iter("skipped"))))
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text


def _add_case(root: ET.Element, results: Results, case: CaseRow) -> None:
    name = f"{case.mechanism}/{case.case}"
    suite = ET.SubElement(root, "testsuite", name=_replace_forbidden(name))
    if case.problem:
        _add_item(suite, name, "model", "error", case.problem)
    for run in results.runs:
        if (run.mechanism, run.case) == (case.mechanism, case.case):
            _run(suite, name, run)
    for row in results.comparisons:
        if (row.mechanism, row.case) == (case.mechanism, case.case):
            _add_comparison(suite, name, row, find_cause(results, row))


def _run(suite: ET.Element, name: str, run: RunRow) -> None:
    message = run.message if run.status == "skipped" else f"{run.status}: {run.message}"
    item = _add_item(suite, name, f"{run.engine} runs", run.verdict, message)
    item.set("time", f"{run.elapsed:.3f}")
    if run.printed and run.verdict == "error":
        ET.SubElement(item, "system-err").text = _replace_forbidden(run.printed)


def _add_comparison(suite: ET.Element, name: str, row: Comparison, cause: str) -> None:
    label = f"{row.engine} against {row.reference}: {row.quantity}" + (f" [{row.unit}]" if row.unit else "")
    where = f" in {row.series}" if row.series else ""
    when = "" if row.time is None else f" at t = {row.time:.6g} s"
    size = "" if row.maximum is None else f" (largest error {format_short(row.maximum)} {row.unit}{where}{when})"
    _add_item(suite, name, label, row.verdict, row.message + size + (cause and f"; {cause}"))


def _add_study(root: ET.Element, study: StudyRow) -> None:
    suite = ET.SubElement(root, "testsuite", name=_replace_forbidden(study.name))
    if study.status != "ok":
        _add_item(suite, study.name, "study", study.verdict, study.message)
    first = study.columns[0][0] if study.columns else ""
    for row in study.rows:
        _add_item(suite, study.name, str(row.get(first, "")), row.get("verdict", "error"), str(row.get("message", "")))


def _add_item(suite: ET.Element, group: str, name: str, verdict: str, message: str) -> ET.Element:
    item = ET.SubElement(suite, "testcase", classname=_replace_forbidden(group), name=_replace_forbidden(name))
    if verdict in TAGS:
        ET.SubElement(item, TAGS[verdict], message=_replace_forbidden(f"{verdict}: {message}"))
    return item


def _replace_forbidden(text: str) -> str:
    return FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
