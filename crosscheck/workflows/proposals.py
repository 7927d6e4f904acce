"""Limits proposed from the error budget: as much as both engines' error bars explain, with the reason filled in.

A small difference beyond the error bars gets a limit for a while that says so; a large one gets none: the models differ.
"""

from __future__ import annotations

import datetime
import math
import re
import tomllib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crosscheck.engines import ENGINES
from crosscheck.measures.limits import WIDEST_BAR
from crosscheck.output_folder import replace
from crosscheck.report.words import format_short
from crosscheck.verdicts.compare import Comparison, compute_fraction
from flexinv.errors import InputError

MARK = "# --- limits: crosscheck verify NAME --write replaces those below that it proposed ---"
MARKED = re.compile("^# --- limits: crosscheck verify NAME --write replaces .* ---$", re.MULTILINE)  # also an older one
OURS = ('source = "crosscheck verify', 'reason = "provisional: crosscheck verify')  # how a proposed limit is known
NO_LIMIT = "# no limit for "
# Below this part of the range nothing is meant: closed formulas agree to 1e-14, and the condition of a mechanism that
# somebody changes slightly may take two digits.
FINEST = 1e-12
# Of the range.  What is beyond the error bars may stay below this for ``FOR_A_WHILE`` [days]: refined runs of one model
# agree to it in every example here, and estimates of errors are sometimes too small (at a start, at a jump).
SMALL = 1e-3
FOR_A_WHILE = 90


@dataclass(frozen=True)
class Proposal:
    """A limit for some engines in one quantity, or why there is none (maximum None); expires: it is for a while."""

    quantity: str
    reference: str
    engines: tuple[str, ...]
    maximum: float | None
    reason: str
    expires: datetime.date | None = None


def list_proposals(rows: Iterable[Comparison], today: datetime.date) -> list[Proposal]:
    """Return proposals from the comparisons of a run, engines with the same limit together."""
    measured = _collect_differences(rows)
    groups: dict[tuple[str, str, str, float], list[str]] = {}
    for (quantity, reference, engine), pairs in measured.items():
        groups.setdefault((quantity, reference, *_choose_limit(pairs)), []).append(engine)
    out = []
    for (quantity, reference, kind, maximum), engines in groups.items():
        pairs = [pair for engine in engines for pair in measured[quantity, reference, engine]]
        expires = today + datetime.timedelta(days=FOR_A_WHILE) if kind == BEYOND else None
        limit = maximum if kind in (COVERED, BEYOND) else None
        out.append(Proposal(quantity, reference, tuple(engines), limit, _describe_reason(kind, pairs), expires))
    return out


def _collect_differences(rows: Iterable[Comparison]) -> dict[tuple[str, str, str], list[tuple[float, float | None]]]:
    """Return differences and error bars over the range [-], by quantity, reference and engine; frequencies are left out."""
    measured: dict[tuple[str, str, str], list[tuple[float, float | None]]] = {}
    for row in rows:
        known = row.engine in ENGINES and ENGINES[row.engine].native  # its cause is named; no limit judges it
        if row.maximum is not None and row.scale is not None and row.quantity != "frequency" and not known:
            bar = None if row.error_bar is None or row.unordered else compute_fraction(row.error_bar, row.scale)
            pair = compute_fraction(row.maximum, row.scale), bar
            measured.setdefault((row.quantity, row.reference, row.engine), []).append(pair)
    return measured


COVERED = "covered"
BEYOND = "beyond"
UNKNOWN = "unknown"
COARSE = "coarse"
APART = "apart"


def _choose_limit(pairs: list[tuple[float, float | None]]) -> tuple[str, float]:
    """Return the meaning of the measured differences and error bars, parts of the range, and the limit that follows."""
    share, bar = _find_largest(pairs)
    if any(pair[1] is None for pair in pairs):
        return UNKNOWN, math.nan
    if bar > WIDEST_BAR:
        return COARSE, math.nan
    maximum = find_next_round_number(max(bar, FINEST))
    if share <= maximum:
        return COVERED, maximum
    return (BEYOND, find_next_round_number(share)) if share <= SMALL else (APART, math.nan)


def _find_largest(pairs: list[tuple[float, float | None]]) -> tuple[float, float]:
    return max(pair[0] for pair in pairs), max(pair[1] or 0.0 for pair in pairs)


def _describe_reason(kind: str, pairs: list[tuple[float, float | None]]) -> str:
    share, bar = (format_short(number) for number in _find_largest(pairs))
    rounding = " (rounding of closed formulas)" if _find_largest(pairs)[1] < FINEST else ""
    return {
        COVERED: f"error bars of both engines together {bar} of the range{rounding}; measured difference {share}",
        BEYOND: f"measured difference {share} of the range, beyond the error bars of {bar}: not explained yet",
        UNKNOWN: f"differs by {share} of the range, and no error bar has an order of refinement: state a limit by hand",
        COARSE: f"the error bars add up to {bar} of the range: refine step_s or the mesh first",
        APART: f"differs by {share} of the range, of which the error bars explain {bar}: the models differ; find the cause",
    }[kind]


def find_next_round_number(value: float) -> float:
    """Return the next of 1, 2, 5 times a power of ten [-]; what is one already stays itself."""
    power = 10.0 ** math.floor(math.log10(value))
    for factor in (1, 2, 5, 10):
        if value <= factor * power * (1 + 1e-9):  # a power of ten is one up to rounding
            return float(f"{factor * power:.0e}")
    return float(f"{10 * power:.0e}")


def format_proposal_toml(proposal: Proposal, source: str) -> str:
    """Return a proposal as a table of ``cases.toml``; without a maximum, as a comment that says why."""
    engines = ", ".join(f'"{name}"' for name in proposal.engines)
    if proposal.maximum is None:
        return f"{NO_LIMIT}{proposal.quantity} of {', '.join(proposal.engines)}: {proposal.reason}\n"
    lines = [
        "[[limits]]",
        f'quantity = "{proposal.quantity}"',
        f"engines = [{engines}]",
        *([f'reference = "{proposal.reference}"'] if proposal.reference != "flexinv" else []),
        f"maximum = {_format_number(proposal.maximum)}",
        f'reason = "{proposal.reason}"',
        f'source = "{source}"',
        *([f"expires = {proposal.expires.isoformat()}"] if proposal.expires else []),
    ]
    return "\n".join(lines) + "\n"


def _format_number(value: float) -> str:
    digits, exponent = f"{value:.0e}".split("e")
    return f"{digits}e{int(exponent)}"


def split_cases_file(file: Path) -> tuple[str, str]:
    """Return ``cases.toml`` above the mark and below it; a file without any limit ends above it.

    Raises InputError where limits are stated and there is no mark: what somebody stated is not overwritten.
    """
    text = file.read_text(encoding="utf-8")
    mark = MARKED.search(text)
    if mark is None and _has_limits(text):
        raise InputError(
            f"{file} has no line '{MARK}': its limits were stated by hand; put the line above what may be replaced"
        )
    return (text[: mark.start()], text[mark.end() :]) if mark else (f"{text.rstrip()}\n\n", "")


def _has_limits(text: str) -> bool:
    table = tomllib.loads(text)
    return bool(table.get("limits")) or any(case.get("limits") for case in table.get("cases", {}).values())


def write(file: Path, proposals: Iterable[Proposal], source: str) -> None:
    """Replace the limits below the mark in ``cases.toml`` that were proposed before, or add mark and limits.

    Quantities without a proposal keep theirs, and whatever else stands below the mark stays.
    Raises InputError where there is no mark above stated limits, or where anything else would be lost.
    """
    head, tail = split_cases_file(file)
    made = list(proposals)
    covered = {p.quantity for p in made if p.maximum is not None}
    before, after = _remove_proposals(tail, covered)
    limits = "\n".join(format_proposal_toml(p, source) for p in made)
    text = (
        head + MARK + "".join(f"\n\n{part.strip(chr(10))}" for part in (before, limits, after) if part.strip()) + "\n"
    )
    _check_completeness(file, text, covered)
    replace(file, text)


def _remove_proposals(tail: str, covered: Collection[str]) -> tuple[str, str]:
    """Return the text below the mark without proposals for these quantities: before their place, and after it."""
    kept: list[str] = []
    place = None
    for block in re.split(r"^(?=[ \t]*\[)", tail, flags=re.MULTILINE):
        lines = [line for line in block.splitlines(keepends=True) if not line.startswith(NO_LIMIT)]
        if block.startswith("[[limits]]") and _is_ours(block) and _read_quantity(block) in covered:
            place = len(kept) if place is None else place
            lines = [line for line in lines if line.lstrip().startswith("#")]
        kept.append("".join(lines))
    place = len(kept) if place is None else place
    return "".join(kept[:place]), "".join(kept[place:])


def _is_ours(block: str) -> bool:
    """Return True if a table of limits was written by `crosscheck verify` or `crosscheck new`, and not by hand."""
    return any(line.startswith(OURS) for line in block.splitlines())


def _check_completeness(file: Path, text: str, covered: Collection[str]) -> None:
    """Raise InputError where the new text has less of the old file than it should, or is no TOML."""
    old = tomllib.loads(file.read_text(encoding="utf-8"))
    try:
        new = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{file}: limits cannot be put in without harm ({error}); state them by hand") from error
    stay = [limit for limit in old.pop("limits", []) if limit.get("quantity") not in covered or not _is_proposed(limit)]
    limits = new.pop("limits", [])
    if old != new or any(limit not in limits for limit in stay):
        raise InputError(f"{file}: limits cannot be put in without losing something else; state them by hand")


def _is_proposed(limit: Mapping[str, Any]) -> bool:
    return any(f'{key} = "{limit.get(key, "")}'.startswith(OURS) for key in ("source", "reason"))


def _read_quantity(block: str) -> str:
    found = [line.split("=", 1)[1].strip().strip('"') for line in block.splitlines() if line.startswith("quantity")]
    return found[0] if found else ""
