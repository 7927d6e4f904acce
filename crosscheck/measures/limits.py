"""Limits of comparisons: the one that holds, and the verdict on an error."""

from __future__ import annotations

import datetime
from collections.abc import Iterable
from fnmatch import fnmatchcase
from typing import Literal

from packaging.specifiers import SpecifierSet
from packaging.version import InvalidVersion

from flexinv.files.load_cases import Limit

Verdict = Literal["skipped", "within", "explained", "unjudged", "deviation", "error"]
# From the mildest to the most severe: of several verdicts the one that stands last is the worst.
VERDICTS: tuple[Verdict, ...] = ("skipped", "within", "explained", "unjudged", "deviation", "error")
REFERENCE = "flexinv"
# Of the range of the signal.  Wider error bars excuse nothing: they say that the runs are too coarse to be compared (a
# tenth is what an untrained eye sees in a plot of both).
WIDEST_BAR = 0.1
BY_DISCRETISATION = "by discretisation: "
UNCLAIMED = "not judged: no limit is stated, and the engine itself says why"


def list_references(limits: Iterable[Limit], engine: str) -> tuple[str, ...]:
    """Return the engines that ``engine`` is compared with: those its limits name, or flexinv."""
    named = {limit.reference for limit in limits if _has_engine(limit, engine)}
    if engine != REFERENCE:
        named.add(REFERENCE)
    return tuple(sorted(named - {engine}))


def find(limits: Iterable[Limit], quantity: str, engine: str, reference: str, version: str = "") -> Limit | None:
    """Return the limit that holds: of those that fit, the first one in the file (special ones stand first).

    version : of the engine; a limit that names versions fits no engine that tells none
    """
    for limit in limits:
        named = limit.quantity == quantity and limit.reference == reference and _has_engine(limit, engine)
        if named and (not limit.versions or _is_in_version_range(version, limit.versions)):
            return limit
    return None


def is_expired(limit: Limit, today: datetime.date) -> bool:
    """Return True if the limit was stated for a time that is over."""
    return limit.expires is not None and limit.expires < today


def judge_by_limit(fraction: float, limit: Limit | None, today: datetime.date, cause: str = "") -> tuple[Verdict, str]:
    """Return verdict and message of an error.

    fraction : largest error over the range of the signal [-]; cause : why this engine's own result is known to differ: without
        a limit the difference is then shown, and nothing is claimed of it
    """
    if limit is None and cause:
        return "skipped", f"{UNCLAIMED}: {fraction:.3g} of the range: {cause}"
    if limit is None:
        return "unjudged", "no limit is stated for this quantity and engine: crosscheck verify proposes one"
    if is_expired(limit, today):
        return "unjudged", f"the limit expired on {limit.expires}: state it anew, or mend the cause"
    if fraction <= limit.maximum:
        return "within", ""
    return "deviation", f"{fraction:.3g} of the range, the limit is {limit.maximum:.3g}"


def list_unused_limits(limits: Iterable[Limit], used: Iterable[Limit]) -> list[Limit]:
    """Return the limits that no comparison asked for (a misspelt engine, a quantity nobody gives)."""
    asked = {id(limit) for limit in used}
    return [limit for limit in limits if id(limit) not in asked]


def find_worst_verdict(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the gravest verdict; "skipped" where there is none: nothing was shown."""
    return max(verdicts, key=VERDICTS.index, default="skipped")


def compute_exit_code(verdicts: Iterable[Verdict]) -> int:
    """Return 2 with an error, 1 with a deviation or a missing limit, else 0."""
    return {"error": 2, "deviation": 1, "unjudged": 1}.get(find_worst_verdict(verdicts), 0)


def _is_in_version_range(version: str, range_: str) -> bool:
    """Return True if a release is in a range of versions; what is no release ("source tree") is in none."""
    try:
        return SpecifierSet(range_).contains(version, prereleases=True)
    except InvalidVersion:
        return False


def _has_engine(limit: Limit, engine: str) -> bool:
    return any(fnmatchcase(engine, pattern) for pattern in limit.engines)
