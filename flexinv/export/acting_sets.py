"""Sets of closures that act at one time, of a mechanism whose closures come and go: a library holds each of them, and is told."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flexinv.constraints.closures import find_acting_closures
from flexinv.export.names import format_markdown, make_words
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Mask

NOTHING = "nothing"  # the name of a set without closures
SWITCH_ROUNDING = 1e-9  # [s]: instants closer than this are one, of which a file has two roundings


@dataclass(frozen=True)
class ActingSet:
    """A set of closures that act at one time.

    name : of its closures, in words; first : the time [s] at which it first acts
    mechanism : the one that has these closures all the time, and no others; acting : (closures,) which these are
    """

    name: str
    first: float
    mechanism: Mechanism
    acting: Mask


def has_phases(mechanism: Mechanism) -> bool:
    """Return True where closures act for a while [-]."""
    return any(closure.active for closure in mechanism.closures)


def list_acting_sets(mechanism: Mechanism) -> list[ActingSet]:
    """Return the sets of closures [-] that act at some time from 0 s on, each once, in the order of time."""
    if not has_phases(mechanism):
        return [ActingSet("", 0.0, mechanism, np.ones(len(mechanism.closures), dtype=bool))]
    switches = {t for closure in mechanism.closures for span in closure.active for t in span if 0.0 < t < np.inf}
    found = dict[tuple[bool, ...], ActingSet]()
    for time in (0.0, *sorted(switches)):
        acts = find_acting_closures(mechanism, time + SWITCH_ROUNDING)
        closures = tuple(replace(c, active=()) for c, on in zip(mechanism.closures, acts, strict=True) if on)
        name = " and ".join(closure.name for closure in closures) or NOTHING
        found.setdefault(tuple(acts.tolist()), ActingSet(name, time, replace(mechanism, closures=closures), acts))
    return list(found.values())


def find_acting_set(mechanism: Mechanism, time: float) -> int:
    """Return the number of the set of closures [-] that act at a time [s], 0 where they act all the time."""
    if not has_phases(mechanism):
        return 0
    acts = find_acting_closures(mechanism, time + SWITCH_ROUNDING)
    return [one.acting.tolist() for one in list_acting_sets(mechanism)].index(acts.tolist())


def format_acting_sets(mechanism: Mechanism, prefix: str) -> dict[str, str]:
    """Return the members of an enumeration and the rows of a table [-], as the template `phases` names them."""
    sets = list_acting_sets(mechanism)
    words = make_words("sets of closures", [one.name for one in sets]).values()
    members = [f"{prefix.upper()}_PHASE_{word}" for word in words]
    rows = [
        f"| {k} | `{member}` | {format_markdown(one.name)} | {one.first:g} s |"
        for k, (member, one) in enumerate(zip(members, sets, strict=True))
    ]
    return {
        "phases_enum": ",\n".join(f"    {member} = {k}" for k, member in enumerate(members)),
        "phase_rows": "\n".join(rows),
    }
