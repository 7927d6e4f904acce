"""Findings of lint: a place, a number, why it is suspicious, and what to write."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypedDict

# "error": no machine can have it, or readers refuse it; "warning": a machine could have it, but probably has not.
LEVELS = ("error", "warning")


class FindingEntry(TypedDict):
    """A finding as JSON values."""

    check: str
    level: str
    place: str
    given: str
    why: str
    write: str


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
    def plain(self) -> FindingEntry:
        """Return the finding as JSON values."""
        return {
            "check": self.check,
            "level": self.level,
            "place": self.place,
            "given": self.given,
            "why": self.why,
            "write": self.write,
        }


def make_error(check: str, place: str, given: str, why: str, write: str) -> Finding:
    """Return a finding of something that no machine can have [any unit]."""
    return Finding(check, "error", place, given, why, write)


def make_warning(check: str, place: str, given: str, why: str, write: str) -> Finding:
    """Return a finding of something that a machine probably does not have [any unit]."""
    return Finding(check, "warning", place, given, why, write)
