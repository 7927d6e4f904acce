"""What a comparison that failed says in a test run: what differs, by how much, where, how sure that is, and what to do."""

from __future__ import annotations

from crosscheck.compare import Comparison
from crosscheck.report.words import short

HEADS = {
    "deviation": "differs from {reference} by more than its limit",
    "unjudged": "is compared with {reference}, but no limit holds",
    "error": "cannot be compared with {reference}",
}


def failure(row: Comparison, cause: str = "") -> str:
    """Return the message of one comparison, several lines.

    cause : what the difference comes from, where that is known
    """
    case = f"{row.mechanism}/{row.case}"
    head = HEADS.get(row.verdict, "is {verdict} against {reference}")
    said = head.format(reference=row.reference, verdict=row.verdict)
    lines = {"": f"{case}, {row.quantity}: {row.engine} {said}"}
    if row.maximum is not None:
        lines |= _measured(row)
        if cause:
            lines["cause"] = cause
        lines["to accept"] = _accept(row)
    else:
        lines["why"] = row.message
    lines["to look"] = f"crosscheck run {case} --engines {row.engine},{row.reference}"
    if row.maximum is not None:
        lines["to reproduce"] = f"crosscheck export {row.mechanism} --case {row.case} --engine {row.engine}"
    return "\n".join([lines.pop(""), *(f"  {what:<13} {words}" for what, words in lines.items())])


def _measured(row: Comparison) -> dict[str, str]:
    unit = f" {row.unit}" if row.unit else ""
    where = f", at t = {row.time:.6g} s" if row.time is not None else ""
    lines = {
        "difference": f"{short(row.maximum)}{unit}, {short(row.fraction)} of the range of {short(row.scale)}{unit}",
        "where": f"{row.series}{where}",
        "limit": "none" if row.limit is None else f"{short(row.limit)} of the range: {row.reason}",
    }
    if row.verdict != "deviation" and row.message:
        lines["why"] = row.message
    if row.error_bar is None:
        lines["error bars"] = "neither engine gives one"
    else:
        share = row.error_bar / row.maximum if row.maximum else float("inf")
        part = "all" if share >= 1 else f"at most {100 * share:.2g} %"
        lines["error bars"] = f"{short(row.error_bar)}{unit} of both engines together: {part} of the difference"
    return lines


def _accept(row: Comparison) -> str:
    file = f"models/{row.mechanism}/cases.toml"
    if row.limit is None:
        return f"state a limit with its reason in {file}"
    return f'mend the model; or raise the limit in {file} with its reason, then crosscheck bless --reason "..."'
