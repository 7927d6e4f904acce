"""Message of a comparison that failed in a test run: what differs, by how much, where, how sure that is, and what to do."""

from __future__ import annotations

from crosscheck.report.words import format_short
from crosscheck.verdicts.baseline import HOW, UNBLESSED, compute_allowed_excess
from crosscheck.verdicts.compare import Comparison

HEADS = {
    "deviation": "differs from {reference} by more than its limit",
    "worse": "differs from {reference} by more than when it was blessed",
    "unblessed": "is compared with {reference}, but nothing is blessed yet",
    "unjudged": "is compared with {reference}, but no limit holds",
    "error": "cannot be compared with {reference}",
}


def describe_failure(row: Comparison, cause: str = "", exported: bool = False) -> str:
    """Return the message of one comparison, several lines.

    cause : what the difference comes from, where that is known; exported : what the engine was given can be written for it
    """
    case = f"{row.mechanism}/{row.case}"
    head = HEADS.get(_resolve_kind(row), "is {verdict} against {reference}")
    said = head.format(reference=row.reference, verdict=row.verdict)
    lines = {"": f"{case}, {row.quantity}: {row.engine} {said}"}
    if row.maximum is not None:
        lines |= _collect_measured(row)
        if cause:
            lines["cause"] = cause
        lines["to accept"] = _describe_acceptance(row)
    else:
        lines["why"] = row.message
    lines["to look"] = f"crosscheck run {case} --engines {row.engine},{row.reference}"
    if row.maximum is not None and exported:
        lines["to reproduce"] = f"crosscheck export {row.mechanism} --case {row.case} --engine {row.engine}"
    return "\n".join([lines.pop(""), *(f"  {what:<13} {words}" for what, words in lines.items())])


def _resolve_kind(row: Comparison) -> str:
    """Return the verdict, or which part of it the blessed night has."""
    if row.verdict == "deviation" and row.blessed is not None:
        return "worse"
    return "unblessed" if row.verdict == "unjudged" and UNBLESSED in row.message else row.verdict


def _collect_measured(row: Comparison) -> dict[str, str]:
    unit = f" {row.unit}" if row.unit else ""
    where = f", at t = {row.time:.6g} s" if row.time is not None else ""
    lines = {
        "difference": f"{format_short(row.maximum)}{unit}, {format_short(row.fraction)} of the range of "
        f"{format_short(row.scale)}{unit}",
        "where": f"{row.series}{where}",
        "limit": "none" if row.limit is None else f"{format_short(row.limit)} of the range: {row.reason}",
    }
    if row.blessed is not None:
        lines["blessed"] = (
            f"{format_short(row.blessed)} of the range; {format_short(compute_allowed_excess(row.blessed, row.limit))} more is "
            f"noise"
        )
    if _resolve_kind(row) not in ("deviation", "worse", "unblessed") and row.message:
        lines["why"] = row.message
    if row.error_bar is None:
        lines["error bars"] = "not both engines have one that a refinement has shown"
    else:
        share = row.error_bar / row.maximum if row.maximum else float("inf")
        part = "all" if share >= 1 else f"at most {100 * share:.2g} %" if share > 1e-3 else "less than 0.1 %"
        lines["error bars"] = f"{format_short(row.error_bar)}{unit} of both engines together: {part} of the difference"
        if row.stated_bar is not None:
            lines["error bars"] += f"; {row.engine} states {format_short(row.stated_bar)}{unit} by itself"
        if row.unordered:
            lines["error bars"] += f"; no bar of {row.unordered}, whose runs show no order"
    return lines


def _describe_acceptance(row: Comparison) -> str:
    file = f"models/{row.mechanism}/cases.toml"
    again = f"crosscheck run {row.mechanism}/{row.case}"
    if row.limit is None:
        return f"state a limit with its reason in {file}"
    if _resolve_kind(row) == "unblessed":
        return f"{again}, look at its report, then {HOW}"
    if _resolve_kind(row) == "worse":
        return f"mend the cause; or {again}, look at its report, then {HOW}"
    return f"mend the model; or raise the limit in {file} with its reason, {again}, then {HOW}"
