"""Error bars of engines from outside: those that a refinement shows which this project asked for, and those that are but stated.

A program with ``refine`` and an FMU are run by doors of ours, which make their bars.  A record cannot be asked for anything.  A
Python package may offer ``refines = True``: it then hears the option "refinement" k, which takes steps and meshes 2^k times as
fine, and is asked for three such runs.  Whatever else has a bar states it by itself.
"""

from __future__ import annotations

from dataclasses import replace

from crosscheck.engines.base import Adapter, Options
from crosscheck.measures.budget import Family, add_error_bars, apply_stated_bars, is_checked
from crosscheck.measures.record import Record
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

LEVELS = (0, 1, 2)  # of the option "refinement": times 2^k as fine


def accepts_refinement(adapter: Adapter) -> bool:
    """Return True if an adapter of a package says that it hears the option "refinement"."""
    return getattr(adapter, "refines", False) is True


def of_package(adapter: Adapter, mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
    """Return the record of a package, with bars of three runs that it is asked for [units of its series], or those it states.

    options : "error" False asks for no bars; raises what the adapter raises
    """
    if not accepts_refinement(adapter) or not options.get("error", True):
        return apply_stated_bars(adapter.run(mechanism, case, engine, options))
    base = int(options.get("refinement", 0))
    asked = [{**options, "error": False, "refinement": base + level} for level in LEVELS]
    runs: list[Record] = []
    for told in asked:
        runs.append(adapter.run(mechanism, case, engine, told))
        if runs[-1].status != "ok":
            return runs[-1]
    plain = apply_stated_bars(runs[-1])
    made, budget = add_error_bars(plain.series, [Family("refinement", [one.series for one in runs])])
    return replace(plain, series=made, budget={**plain.budget, **budget}, wall_time=sum(one.wall_time for one in runs))


def convert_door_bars(record: Record) -> Record:
    """Return the record of a door of ours: a bar that the door has not made itself is one that the engine states."""
    ours = {name: line for name, line in record.budget.items() if is_checked(record.budget, name)}
    told = apply_stated_bars(record)
    series = {name: record.series[name] if name in ours else one for name, one in told.series.items()}
    return replace(told, series=series, budget={**told.budget, **ours})
