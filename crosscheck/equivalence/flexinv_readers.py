"""Readers of MJCF, SDF and USD for flexinv: what `describe` makes of a file, offered as entry points ``flexinv.readers``."""

from __future__ import annotations

from pathlib import Path

from crosscheck.equivalence.sources import describe
from flexinv.model.mechanism import Mechanism


def read_by_engine(path: Path) -> tuple[Mechanism, tuple[str, ...]]:
    """Return the mechanism of a file [m, kg, rad], and in words what it says and no mechanism can.  Raises InputError."""
    found = describe(path)
    why = "efforts feel it, and no mechanism can say it"
    felt = tuple(f"{one.name} of {one.place} ({one.words}): {why}" for one in found.features if one.felt)
    return found.mechanism, (*felt, *found.dropped)
