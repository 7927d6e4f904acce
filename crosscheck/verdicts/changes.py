"""Differences between two nights: values, versions of engines, models, verdicts, causes, times."""

from __future__ import annotations

from collections.abc import Container, Iterable
from dataclasses import dataclass

import sqlalchemy as sql

from crosscheck.verdicts.baseline import compute_allowed_excess
from crosscheck.verdicts.history import (
    CAUSE,
    COMPARISON,
    MODEL,
    SIGNAL,
    TIMING,
    VERSION,
    Night,
    Row,
    list_nights,
    read_rows,
)
from crosscheck.verdicts.night_changes import (
    CauseChange,
    NightChanges,
    SignalChange,
    SlowerRun,
    ValueChange,
    VersionChange,
)
from crosscheck.verdicts.scope import Scope

CAUSES = ("mechanism", "case_name", "engine", "reference", "cause", "target")
SERIES = ("mechanism", "case_name", "engine", "series")
NAMES = ("mechanism", "case_name", "engine", "reference", "quantity", "unit")
# A run is slower when it takes this many times as long, and more than a second longer: what a machine does beside
# its night (measured here with another job on every core) stays below.
SLOWER = 2.0
SECONDS = 1.0
ROUNDING = 1e-12  # of the range: below it a difference of engines is the rounding of both
Name = tuple[str, ...]  # values of the columns that name a row
Rows = dict[Name, Row]


def find_previous_night(database: sql.Engine, number: int, target: str = "previous") -> Night | None:
    """Return the night to compare with: the last finished ordinary one before, or that whose folder or start is wanted.

    Raises LookupError where a name fits no night, HistoryError where the history cannot be read.
    """
    known = [night for night in list_nights(database) if night.id != number and night.label != "bench"]
    if target == "previous":
        ordinary = [night for night in known if night.finished and not night.label]
        return ordinary[-1] if ordinary else None
    for night in reversed(known):
        if target in (night.folder, night.started) or night.started.startswith(target):
            return night
    names = ", ".join(night.folder or night.started for night in known[-5:]) or "none"
    raise LookupError(f"no night is called {target!r}; the last ones are {names}")


def collect_changes(database: sql.Engine, before: Night, after: int, scope: Scope) -> NightChanges:
    """Return the changes from one night to another, as rows of words and numbers; errors over the range [-], times [s].

    Only what was run in both is compared; what appeared is said, and of what the later night was asked for what vanished.
    """
    nights = NightPair(database, before.id, after)
    old, new = nights.read_rows(COMPARISON, NAMES)
    ran_before = {name[:3] for name in old}
    ran = {name[:3] for name in new}
    appeared = [name for name in new.keys() - old.keys() if new[name]["fraction"] is not None]
    lost = [name for name in old.keys() - new.keys() if scope.has_comparison(name)]
    vanished = [name for name in lost if old[name]["fraction"] is not None]
    return {
        "night": before.folder or before.started,
        "started": before.started,
        "versions": _list_versions(nights),
        "models": _list_other_models(nights),
        "values": [_make_value_change(k, old[k], new[k]) for k in new if k in old and _has_moved(old[k], new[k])],
        "signals": _list_moves(nights),
        "appeared": sorted(map(_format_name, appeared)),
        "vanished": sorted(map(_format_name, vanished)),
        "causes": _list_causes(nights, ran_before, ran),
        "slower": _list_slower_runs(nights),
    }


@dataclass(frozen=True)
class NightPair:
    """Two nights of a history, by their numbers."""

    database: sql.Engine
    before: int
    after: int

    def read_rows(self, table: sql.Table, names: Iterable[str]) -> tuple[Rows, Rows]:
        """Return the rows of a table in both nights, by what names them.  Raises HistoryError."""
        old, new = (_map_by_key(read_rows(self.database, table, night), names) for night in (self.before, self.after))
        return old, new


def _list_versions(nights: NightPair) -> list[VersionChange]:
    old, new = nights.read_rows(VERSION, ("package",))
    before = {package: row["version"] for (package,), row in old.items()}
    return [
        {"package": package, "before": before.get(package, "–"), "after": row["version"]}
        for (package,), row in new.items()
        if before.get(package) != row["version"]
    ]


def _list_other_models(nights: NightPair) -> list[str]:
    old, new = nights.read_rows(MODEL, ("mechanism", "case_name"))
    return sorted("/".join(name) for name in old.keys() & new.keys() if old[name]["hash"] != new[name]["hash"])


def _list_causes(nights: NightPair, ran_before: Container[Name], ran: Container[Name]) -> list[CauseChange]:
    """Return the causes that appeared and that vanished, of runs of both nights."""
    old, new = nights.read_rows(CAUSE, CAUSES)
    return [
        *(_make_cause_change("appeared", k, new[k]) for k in new if k not in old and k[:3] in ran_before),
        *(_make_cause_change("vanished", k, old[k]) for k in old if k not in new and k[:3] in ran),
    ]


def _list_slower_runs(nights: NightPair) -> list[SlowerRun]:
    old, new = nights.read_rows(TIMING, ("mechanism", "case_name", "engine"))
    return [
        {"run": " ".join(name), "before": old[name]["wall_time"], "after": row["wall_time"]}
        for name, row in new.items()
        if name in old and row["status"] == "ok" == old[name]["status"] and _is_slower(old[name], row)
    ]


def _list_moves(nights: NightPair) -> list[SignalChange]:
    """Return the values of engines that moved by more than the error bars of both nights, the largest first."""
    old, new = nights.read_rows(SIGNAL, SERIES)
    found: list[SignalChange] = []
    for name in old.keys() & new.keys():
        was = old[name]
        now = new[name]
        bars = was["bar"] + now["bar"]
        largest = max((abs(now[what] - was[what]), what) for what in ("peak", "rms"))
        size = max(was["size"], now["size"])
        if largest[0] > bars and size > 0.0:
            what = largest[1]
            change: SignalChange = {
                "what": " ".join((*name, what)),
                "unit": now["unit"],
                "before": was[what],
                "after": now[what],
                "share": largest[0] / size,
                "bar": bars / size,
            }
            found.append(change)
    return sorted(found, key=lambda row: -row["share"])


def _make_value_change(name: Name, old: Row, new: Row) -> ValueChange:
    return {
        "what": _format_name(name),
        "mechanism": name[0],
        "case": name[1],
        "before": old["fraction"],
        "after": new["fraction"],
        "before_verdict": old["verdict"],
        "after_verdict": new["verdict"],
        "message": new["message"],
        "before_message": old["message"],
    }


def _make_cause_change(what: str, name: Name, row: Row) -> CauseChange:
    mechanism, case, engine, reference, cause, target = name
    words = f"{mechanism}/{case} {engine} against {reference}: {cause}" + (f" ({target})" if target else "")
    return {"what": what, "name": words, "words": row["words"]}


def _has_moved(old: Row, new: Row) -> bool:
    """Return True if a comparison has another verdict, or another value by more than noise."""
    if old["verdict"] != new["verdict"]:
        return True
    if old["fraction"] is None or new["fraction"] is None:
        return (old["fraction"] is None) != (new["fraction"] is None)
    low, high = sorted((old["fraction"], new["fraction"]))
    return bool(
        high
        > low + max(compute_allowed_excess(low, new["limit"]), _add_error_bars(old) + _add_error_bars(new), ROUNDING)
    )


def _add_error_bars(row: Row) -> float:
    """Return the error bars of a comparison over the range of the signal [-]; 0 where it has none."""
    bar = row["error_bar"]
    scale = row["scale"]
    return float(bar / scale) if bar is not None and scale else 0.0


def _is_slower(old: Row, new: Row) -> bool:
    return bool(new["wall_time"] > SLOWER * old["wall_time"] and new["wall_time"] > old["wall_time"] + SECONDS)


def _map_by_key(rows: Iterable[Row], names: Iterable[str]) -> Rows:
    return {tuple(str(row[n]) for n in names): row for row in rows}


def _format_name(name: Name) -> str:
    mechanism, case, engine, reference, quantity, unit = name
    return f"{mechanism}/{case} {engine} against {reference}: {quantity}" + (f" [{unit}]" if unit else "")
