"""Certificates in a run: every engine's against the reference's, and comparisons of engines whose certificate does not hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from crosscheck.measures.certificate import Check, build_certificate, checks
from crosscheck.measures.limits import BY_DISCRETISATION, REFERENCE
from crosscheck.measures.record import Record
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.plan import Task
from crosscheck.verdicts.results import BROKEN_CERTIFICATE, NO_CERTIFICATE, is_failing


def list_certificate_lines(task: Task, records: Mapping[str, Record]) -> tuple[Check, ...]:
    """Return every line of every engine's certificate against the reference's; an engine without one has one line."""
    reference = records.get(REFERENCE)
    if reference is None or reference.status != "ok":
        return ()
    ours = build_certificate(reference.certificate)
    found: list[Check] = []
    for name, record in records.items():
        if name == REFERENCE or record.status == "skipped" or not record.certificate:
            continue
        here = (task.folder.name, task.case.name, name)
        if words := record.certificate.get("broken"):
            found.append(Check(*here, BROKEN_CERTIFICATE, "-", False, words=str(words)))
            continue
        lines = checks(*here, build_certificate(record.certificate), ours)
        missing = str(record.certificate.get("problem", "the engine gives nothing that the reference has"))
        found += lines or (Check(*here, NO_CERTIFICATE, "-", False, words=missing),)
    return tuple(found)


def judge_by_certificate(rows: Iterable[Comparison], lines: Iterable[Check]) -> list[Comparison]:
    """Return the comparisons, those of engines whose certificate does not hold as deviations: they have another mechanism.

    Where an engine has no certificate nothing is known, and nothing changes; one that is broken is none that holds.
    """
    failed: dict[tuple[str, str, str], list[str]] = {}
    for line in lines:
        if is_failing(line):
            failed.setdefault((line.mechanism, line.case, line.engine), []).append(line.what)
    return [_judge_row(row, failed) for row in rows]


def _judge_row(row: Comparison, failed: Mapping[tuple[str, str, str], list[str]]) -> Comparison:
    found = {e: failed.get((row.mechanism, row.case, e)) for e in (row.engine, row.reference)}
    parts = [_describe_failure(engine, what) for engine, what in found.items() if what]
    if not parts or row.verdict in ("skipped", "error"):
        return row
    words = f"the certificate does not hold: {'; '.join(parts)}"
    verdict = row.verdict if row.verdict == "unjudged" else "deviation"
    return replace(
        row,
        verdict=verdict,
        message="; ".join(filter(None, [row.message.removeprefix(BY_DISCRETISATION), words])),
        uncertified=words,
    )


def _describe_failure(engine: str, what: list[str]) -> str:
    """Return in words what of an engine's certificate does not hold."""
    if what == [BROKEN_CERTIFICATE]:
        return f"that of {engine} is broken and cannot be read"
    return f"{engine} has another {', '.join(what)}"
