"""Readable account of a campaign: the sums as tables, every fault as a line of text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rich.table import Table

from campaigns.beyond.judge import BAD, GOOD, OUTCOMES

SHORT = 110  # [characters] of what was named in a line


def make_outcome_table(results: Mapping[str, Any], key: str) -> Table:
    """Return the outcomes by topic, engine or mechanism ("by topic", ...)."""
    table = Table(key.removeprefix("by "), box=None, header_style="dim", padding=(0, 1, 0, 0))
    used = [o for o in OUTCOMES if o in results["sums"]["counts"]]
    for word in (*used, "above", "right or in set"):
        table.add_column(word, justify="right")
    for name, one in (*results[key].items(), ("all", results["sums"])):
        counts = [str(one["counts"].get(o, "") or "") for o in used]
        share = f"{100 * one['share']:.0f} %" if one["above"] else "-"
        table.add_row(name, *counts, str(one["above"]), share)
    return table


def describe_fault(row: Mapping[str, Any]) -> str:
    """Return one fault in a line: number, outcome, where, what was planted, how large it is, and what was named."""
    named = "; ".join(f"{n['cause']} ({n['target']})" if n["target"] else str(n["cause"]) for n in row.get("named", ()))
    said = named or ("nothing named" if row["outcome"] not in ("refused", "failed") else row.get("words", ""))
    fails = row.get("certificate_fails", ())
    size = row.get("times_the_bar")
    how = f"{row.get('effect', '-')}{'' if size is None else f' x{size:.2g}'}, exit {row.get('exit_code', '-')}"
    where = f"{row['mechanism']}/{row['case']} {row['engine']}"
    certificate = f" | certificate: {', '.join(fails)}" if fails else ""
    return f"{row['number']:4d} {row['outcome']:11s} {where:40s} {row['fault']} [{how}] -> {said[:SHORT]}{certificate}"


def describe_campaign(results: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of a readable account: the bad ones first, then every fault."""
    yield describe_verdict(results)
    for title, chosen in (("bad", BAD), ("good", GOOD)):
        rows = [row for row in results["rows"] if row["outcome"] in chosen]
        yield f"\n{title}: {len(rows)}"
        yield from map(describe_fault, rows)
    rest = [row for row in results["rows"] if row["outcome"] not in (*BAD, *GOOD)]
    yield f"\nothers: {len(rest)}"
    yield from map(describe_fault, rest)


def describe_verdict(results: Mapping[str, Any]) -> str:
    """Return the last line: how many faults ended how, and whether that is good enough."""
    sums = results["sums"]
    counts = ", ".join(f"{sums['counts'][o]} {o}" for o in OUTCOMES if o in sums["counts"])
    unharmed = results["unharmed"]
    return (
        f"campaign {results['campaign']}, seed {results['seed']}: {sums['faults']} faults, {counts}; "
        f"{sums['good']} of {sums['above']} above the bars are right or in a set ({100 * sums['share']:.0f} %); "
        f"{unharmed['spoilt']} of {unharmed['tried']} unharmed engines were not left alone; "
        f"{'met' if results['met'] else 'NOT met'}"
    )
