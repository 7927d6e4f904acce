"""Verdict on one known fault: its names, and how they count."""

from __future__ import annotations

from dataclasses import dataclass

COUNTED = ("right", "not named", "wrong")


@dataclass(frozen=True)
class Verdict:
    """Names of one known fault, and how they count: one of `COUNTED`, and the names themselves."""

    word: str
    names: tuple[str, ...]
