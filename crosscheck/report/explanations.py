"""Certificates and causes as the pages show them."""

from __future__ import annotations

from dataclasses import dataclass

from crosscheck.measures.certificate import Check, is_certified
from crosscheck.measures.limits import Verdict
from crosscheck.verdicts.results import (
    BROKEN_CERTIFICATE,
    NO_CERTIFICATE,
    CaseRow,
    Diagnosis,
    NamedCause,
    Results,
    is_failing,
)


@dataclass(frozen=True)
class CertificateSummary:
    """The certificate of one engine: its lines, what they amount to as a verdict, and in words."""

    engine: str
    verdict: Verdict
    text: str
    lines: tuple[Check, ...]


def list_certificates(results: Results, case: CaseRow) -> list[CertificateSummary]:
    """Return the certificates of a case, engine by engine."""
    mine = [line for line in results.certificates if (line.mechanism, line.case) == (case.mechanism, case.case)]
    return [
        _make_certificate(engine, tuple(x for x in mine if x.engine == engine))
        for engine in dict.fromkeys(x.engine for x in mine)
    ]


def _make_certificate(engine: str, lines: tuple[Check, ...]) -> CertificateSummary:
    if [line.what for line in lines] == [NO_CERTIFICATE]:
        return CertificateSummary(engine, "unjudged", NO_CERTIFICATE, lines)
    if [line.what for line in lines] == [BROKEN_CERTIFICATE]:
        return CertificateSummary(engine, "deviation", f"{BROKEN_CERTIFICATE}: it is there and cannot be read", lines)
    if is_certified(lines):
        return CertificateSummary(engine, "within", "holds", lines)
    return CertificateSummary(
        engine, "deviation", "another mechanism: " + ", ".join(x.what for x in lines if not x.holds), lines
    )


def describe_failing_lines(results: Results, mechanism: str, case: str, engine: str) -> str:
    """Return the lines of an engine's certificate that do not hold, "" where all do or there is none."""
    lines = results.certificates_of.get((mechanism, case, engine), ())
    return ", ".join(line.what for line in lines if is_failing(line))


def collect_warnings(results: Results, case: CaseRow) -> dict[str, str]:
    """Return the warning beside the dynamics of engines whose certificate is missing or does not hold."""
    return {sheet.engine: sheet.text for sheet in list_certificates(results, case) if sheet.verdict != "within"}


def list_diagnoses(results: Results, case: CaseRow) -> list[Diagnosis]:
    """Return the diagnoses of engines that deviate in a case."""
    return [d for d in results.diagnoses if (d.mechanism, d.case) == (case.mechanism, case.case)]


def find_diagnosis(results: Results, mechanism: str, case: str, engine: str) -> Diagnosis | None:
    """Return the diagnosis of an engine that deviates in a case, where there is one."""
    here = (mechanism, case, engine)
    return next((d for d in results.diagnoses if (d.mechanism, d.case, d.engine) == here), None)


def describe_causes(diagnosis: Diagnosis | None) -> str:
    """Return the names of the causes that explain a deviation, in a few words; "" where none does."""
    if diagnosis is None or not diagnosis.named:
        return ""
    names = list(dict.fromkeys(_format_cause(one) for one in diagnosis.named))
    others = len(names) - 1
    return names[0] + (f", or {others} other{'s' * (others > 1)}" if others else "")


def _format_cause(one: NamedCause) -> str:
    return f"{one['cause']} ({one['target']})" if one.get("target") else str(one["cause"])


def describe_diagnosis(diagnosis: Diagnosis) -> str:
    """Return a diagnosis in one line: the cause, what it explains, and where there are several what tells them apart."""
    apart = f" To tell them apart: {diagnosis.separate}." if diagnosis.separate else ""
    return diagnosis.words + apart
