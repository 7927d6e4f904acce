"""Differences between two nights: values, versions of engines, models, verdicts, causes, times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import sqlalchemy as sql

from crosscheck.verdicts.baseline import compute_allowed_excess
from crosscheck.verdicts.history import CAUSE, COMPARISON, MODEL, SIGNAL, TIMING, VERSION, Night, list_nights, read_rows

CAUSES = ("mechanism", "case_name", "engine", "reference", "cause", "target")
SERIES = ("mechanism", "case_name", "engine", "series")
NAMES = ("mechanism", "case_name", "engine", "reference", "quantity", "unit")
# A run is slower when it takes this many times as long, and more than a second longer: what a machine does beside
# its night (measured here with another job on every core) stays below.
SLOWER = 2.0
SECONDS = 1.0
ROUNDING = 1e-12  # of the range: below it a difference of engines is the rounding of both
Row = Mapping[str, Any]


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


def collect_changes(database: sql.Engine, before: Night, after: int) -> dict[str, Any]:
    """Return the changes from one night to another, as rows of words and numbers; errors over the range [-], times [s].

    Only what was run in both is compared; what appeared and what vanished is said.
    """
    old, new = (_map_by_key(read_rows(database, COMPARISON, n), NAMES) for n in (before.id, after))
    models = [_map_by_key(read_rows(database, MODEL, n), ("mechanism", "case_name")) for n in (before.id, after)]
    versions = [{r["package"]: r["version"] for r in read_rows(database, VERSION, n)} for n in (before.id, after)]
    timings = [
        _map_by_key(read_rows(database, TIMING, n), ("mechanism", "case_name", "engine")) for n in (before.id, after)
    ]
    ran = {k[:3] for k in new}
    ran_before = {k[:3] for k in old}
    causes = [_map_by_key(read_rows(database, CAUSE, n), CAUSES) for n in (before.id, after)]
    return {
        "night": before.folder or before.started,
        "started": before.started,
        "versions": [
            {"package": p, "before": versions[0].get(p, "–"), "after": v}
            for p, v in versions[1].items()
            if versions[0].get(p) != v
        ],
        "models": sorted("/".join(k) for k in models[0].keys() & models[1].keys() if _has_other_model(models, k)),
        "values": [_make_value_change(k, old[k], new[k]) for k in new if k in old and _has_moved(old[k], new[k])],
        "signals": _list_moves(database, before.id, after),
        "appeared": sorted(_format_name(k) for k in new.keys() - old.keys() if new[k]["fraction"] is not None),
        "vanished": sorted(
            _format_name(k) for k in old.keys() - new.keys() if k[:3] in ran and old[k]["fraction"] is not None
        ),
        "causes": [
            *(
                _make_cause_change("appeared", k, causes[1][k])
                for k in causes[1]
                if k not in causes[0] and k[:3] in ran_before
            ),
            *(
                _make_cause_change("vanished", k, causes[0][k])
                for k in causes[0]
                if k not in causes[1] and k[:3] in ran
            ),
        ],
        "slower": [
            {"run": " ".join(k), "before": timings[0][k]["wall_time"], "after": t["wall_time"]}
            for k, t in timings[1].items()
            if k in timings[0] and t["status"] == "ok" == timings[0][k]["status"] and _is_slower(timings[0][k], t)
        ],
    }


def _list_moves(database: sql.Engine, before: int, after: int) -> list[dict[str, Any]]:
    """Return the values of engines that moved by more than the error bars of both nights, the largest first."""
    old, new = (_map_by_key(read_rows(database, SIGNAL, n), SERIES) for n in (before, after))
    found = []
    for name in old.keys() & new.keys():
        was = old[name]
        now = new[name]
        bars = was["bar"] + now["bar"]
        largest = max((abs(now[what] - was[what]), what) for what in ("peak", "rms"))
        size = max(was["size"], now["size"])
        if largest[0] > bars and size > 0.0:
            what = largest[1]
            values = {"before": was[what], "after": now[what], "share": largest[0] / size, "bar": bars / size}
            found.append({"what": " ".join((*name, what)), "unit": now["unit"], **values})
    return sorted(found, key=lambda row: -row["share"])


def _make_value_change(name: tuple[str, ...], old: Row, new: Row) -> dict[str, Any]:
    return {
        "what": _format_name(name),
        **{"mechanism": name[0], "case": name[1], "before": old["fraction"], "after": new["fraction"]},
        **{
            "before_verdict": old["verdict"],
            "after_verdict": new["verdict"],
            "message": new["message"],
            "before_message": old["message"],
        },
    }


def _make_cause_change(what: str, name: tuple[str, ...], row: Row) -> dict[str, str]:
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


def _has_other_model(models: list[dict[tuple[str, ...], Row]], name: tuple[str, ...]) -> bool:
    return bool(models[0][name]["hash"] != models[1][name]["hash"])


def _map_by_key(rows: Iterable[Row], names: tuple[str, ...]) -> dict[tuple[str, ...], Row]:
    return {tuple(str(row[n]) for n in names): row for row in rows}


def _format_name(name: tuple[str, ...]) -> str:
    mechanism, case, engine, reference, quantity, unit = name
    return f"{mechanism}/{case} {engine} against {reference}: {quantity}" + (f" [{unit}]" if unit else "")
