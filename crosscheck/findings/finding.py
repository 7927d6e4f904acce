"""Findings of lint: a place, a number, why it is suspicious, and what to write."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

# "error": no machine can have it, or readers refuse it; "warning": a machine could have it, but probably has not.
LEVELS = ("error", "warning")


@dataclass(frozen=True)
class Finding:
    """One finding: check, level, place, given number with its unit, why it is suspicious, what to write."""

    check: str
    level: str
    place: str
    given: str
    why: str
    write: str

    @property
    def plain(self) -> dict[str, Any]:
        """Return the finding as JSON values."""
        return dict(vars(self))


def make_error(check: str, place: str, given: str, why: str, write: str) -> Finding:
    """Return a finding of something that no machine can have [any unit]."""
    return Finding(check, "error", place, given, why, write)


def make_warning(check: str, place: str, given: str, why: str, write: str) -> Finding:
    """Return a finding of something that a machine probably does not have [any unit]."""
    return Finding(check, "warning", place, given, why, write)
