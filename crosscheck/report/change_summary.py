"""Changes since another night, in one line (`crosscheck.verdicts.changes` finds them; here is no database)."""

from __future__ import annotations

from collections.abc import Sequence

from crosscheck.verdicts.night_changes import NightChanges

NAMED = 3  # models or packages that the line names
BAD = ("deviation", "error", "unjudged")


def describe_changes(changes: NightChanges) -> str:
    """Return the changes since another night in one line."""
    if not changes:
        return ""
    fresh = [v for v in changes["values"] if v["after_verdict"] in BAD and v["before_verdict"] not in BAD]
    mended = [v for v in changes["values"] if v["before_verdict"] in BAD and v["after_verdict"] not in BAD]
    came, went = ([c for c in changes.get("causes", ()) if c["what"] == w] for w in ("appeared", "vanished"))
    parts = [
        _count(len(fresh), "new deviation"),
        _count(len(mended), "deviation less", "deviations less"),
        _count(len(came), "cause appeared", "causes appeared"),
        _count(len(went), "cause vanished", "causes vanished"),
        _count(len(changes["values"]), "comparison moved", "comparisons moved"),
        _count(len(changes.get("signals", ())), "signal moved", "signals moved"),
        _count_named([v["package"] for v in changes["versions"]], "version changed", "versions changed"),
        _count_named(changes["models"], "model changed", "models changed"),
        _count(len(changes["appeared"]), "comparison appeared", "comparisons appeared"),
        _count(len(changes["vanished"]), "comparison vanished", "comparisons vanished"),
        _count(len(changes["slower"]), "run slower", "runs slower"),
    ]
    told = ", ".join(part for part in parts if part)
    return f"Since {changes['night']}: {told or 'nothing changed'}."


def _count_named(names: Sequence[str], one: str, many: str) -> str:
    """Return the number of things with the first ones by name, "" for none."""
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"{_count(len(names), one, many)} ({', '.join(names[:NAMED])}{more})" if names else ""


def _count(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}" if number else ""
