"""Planted faults by name: how each is made, and a word that what is said of it must have."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass

from campaigns.part_faults.draft import Draft

Maker = Callable[[random.Random], Draft]


@dataclass(frozen=True)
class PlantedFault:
    """A fault; words : a pattern of which something must stand in what is said, "" for a part that is right."""

    name: str
    make: Maker
    words: str


FAULTS: dict[str, PlantedFault] = {}


def fault(words: str, name: str = "") -> Callable[[Maker], Maker]:
    """Return the decorator that puts a maker of drafts into the table, under its own name by default."""

    def add(make: Maker) -> Maker:
        FAULTS[name or make.__name__] = PlantedFault(name or make.__name__, make, words)
        return make

    return add


def control(make: Maker) -> Maker:
    """Put a maker of a part that is right into the table."""
    return fault("")(make)
