"""Limits proposed from the error budget: as much as both engines' error bars explain, with the reason filled in.

A small difference beyond the error bars gets a limit for a while that says so; a large one gets none: the models differ.
"""

from __future__ import annotations

import datetime
import math
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from crosscheck.compare import Comparison, fraction
from crosscheck.engines import ENGINES
from crosscheck.limits import WIDEST_BAR
from crosscheck.report.words import short
from flexinv.errors import InputError

MARK = "# --- limits: crosscheck verify NAME --write replaces everything below ---"
# Below this part of the range nothing is meant: closed formulas agree to 1e-14, and the condition of a mechanism that
# somebody changes slightly may take two digits.
FINEST = 1e-12
# Of the range.  What is beyond the error bars may stay below this for ``FOR_A_WHILE`` [days]: refined runs of one model
# agree to it in every example here, and estimates of errors are sometimes too small (at a start, at a jump).
SMALL, FOR_A_WHILE = 1e-3, 90


@dataclass(frozen=True)
class Proposal:
    """A limit for some engines in one quantity, or why there is none (maximum None); expires: it is for a while."""

    quantity: str
    reference: str
    engines: tuple[str, ...]
    maximum: float | None
    reason: str
    expires: datetime.date | None = None


def propose(rows: Iterable[Comparison], today: datetime.date) -> list[Proposal]:
    """Return proposals from the comparisons of a run, engines with the same limit together."""
    measured: dict[tuple[str, str, str], list[tuple[float, float | None]]] = {}
    for row in rows:
        known = row.engine in ENGINES and ENGINES[row.engine].native  # its cause is named; no limit judges it
        if row.maximum is not None and row.scale is not None and row.quantity != "frequency" and not known:
            bar = None if row.error_bar is None else fraction(row.error_bar, row.scale)
            pair = fraction(row.maximum, row.scale), bar
            measured.setdefault((row.quantity, row.reference, row.engine), []).append(pair)
    groups: dict[tuple[str, str, str, float], list[str]] = {}
    for (quantity, reference, engine), pairs in measured.items():
        groups.setdefault((quantity, reference, *_kind(pairs)), []).append(engine)
    out = []
    for (quantity, reference, kind, maximum), engines in groups.items():
        pairs = [pair for engine in engines for pair in measured[quantity, reference, engine]]
        expires = today + datetime.timedelta(days=FOR_A_WHILE) if kind == BEYOND else None
        limit = maximum if kind in (COVERED, BEYOND) else None
        out.append(Proposal(quantity, reference, tuple(engines), limit, _reason(kind, pairs), expires))
    return out


COVERED, BEYOND, UNKNOWN, COARSE, APART = "covered", "beyond", "unknown", "coarse", "apart"


def _kind(pairs: list[tuple[float, float | None]]) -> tuple[str, float]:
    """Return what the measured differences and error bars, parts of the range, mean, and the limit that follows."""
    share, bar = _largest(pairs)
    if any(pair[1] is None for pair in pairs):
        return UNKNOWN, math.nan
    if bar > WIDEST_BAR:
        return COARSE, math.nan
    maximum = rounded_up(max(bar, FINEST))
    if share <= maximum:
        return COVERED, maximum
    return (BEYOND, rounded_up(share)) if share <= SMALL else (APART, math.nan)


def _largest(pairs: list[tuple[float, float | None]]) -> tuple[float, float]:
    return max(pair[0] for pair in pairs), max(pair[1] or 0.0 for pair in pairs)


def _reason(kind: str, pairs: list[tuple[float, float | None]]) -> str:
    share, bar = (short(number) for number in _largest(pairs))
    rounding = " (rounding of closed formulas)" if _largest(pairs)[1] < FINEST else ""
    return {
        COVERED: f"error bars of both engines together {bar} of the range{rounding}; measured difference {share}",
        BEYOND: f"measured difference {share} of the range, beyond the error bars of {bar}: not explained yet",
        UNKNOWN: f"differs by {share} of the range, and neither engine gives an error bar: state a limit by hand",
        COARSE: f"the error bars add up to {bar} of the range: refine step_s or the mesh first",
        APART: f"differs by {share} of the range, of which the error bars explain {bar}: the models differ; find the cause",
    }[kind]


def rounded_up(value: float) -> float:
    """Return the next of 1, 2, 5 times a power of ten [-]; what is one already stays itself."""
    power = 10.0 ** math.floor(math.log10(value))
    for factor in (1, 2, 5, 10):
        if value <= factor * power * (1 + 1e-9):  # a power of ten is one up to rounding
            return float(f"{factor * power:.0e}")
    return float(f"{10 * power:.0e}")


def toml(proposal: Proposal, source: str) -> str:
    """Return a proposal as a table of ``cases.toml``; without a maximum, as a comment that says why."""
    engines = ", ".join(f'"{name}"' for name in proposal.engines)
    if proposal.maximum is None:
        return f"# no limit for {proposal.quantity} of {', '.join(proposal.engines)}: {proposal.reason}\n"
    lines = [
        "[[limits]]",
        f'quantity = "{proposal.quantity}"',
        f"engines = [{engines}]",
        *([f'reference = "{proposal.reference}"'] if proposal.reference != "flexinv" else []),
        f"maximum = {_number(proposal.maximum)}",
        f'reason = "{proposal.reason}"',
        f'source = "{source}"',
        *([f"expires = {proposal.expires.isoformat()}"] if proposal.expires else []),
    ]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    digits, exponent = f"{value:.0e}".split("e")
    return f"{digits}e{int(exponent)}"


def parts(file: Path) -> tuple[str, str]:
    """Return ``cases.toml`` above the mark and below it; a file without any limit ends above it.

    Raises InputError where limits are stated and there is no mark: what somebody stated is not overwritten.
    """
    text = file.read_text(encoding="utf-8")
    head, mark, tail = text.partition(MARK)
    if not mark and _stated(text):
        raise InputError(
            f"{file} has no line '{MARK}': its limits were stated by hand; put the line above what may be replaced"
        )
    return (head, tail) if mark else (f"{text.rstrip()}\n\n", "")


def _stated(text: str) -> bool:
    table = tomllib.loads(text)
    return bool(table.get("limits")) or any(case.get("limits") for case in table.get("cases", {}).values())


def write(file: Path, proposals: Iterable[Proposal], source: str) -> None:
    """Replace the limits below the mark in ``cases.toml``, or add both; quantities without a proposal keep theirs.

    Raises InputError where there is no mark above stated limits.
    """
    head, tail = parts(file)
    made = list(proposals)
    covered = {p.quantity for p in made if p.maximum is not None}
    kept = [
        f"[[limits]]\n{block.strip()}\n" for block in tail.split("[[limits]]")[1:] if _quantity(block) not in covered
    ]
    limits = [toml(p, source) for p in made] + kept
    part = file.with_name(file.name + ".part")
    part.write_text(head + MARK + "\n\n" + "\n".join(limits), encoding="utf-8")
    part.replace(file)


def _quantity(block: str) -> str:
    found = [line.split("=", 1)[1].strip().strip('"') for line in block.splitlines() if line.startswith("quantity")]
    return found[0] if found else ""
