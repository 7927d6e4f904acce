"""Faults to plant: ``kind @ place size other``, looked up by their names and made one after the other.

`machine_faults` change a `World` before it is logged, `logger_faults` a `Record` after that.  A place is a joint from 0, for
bodies the link that it moves; -1 is all joints.  The size has the unit that the docstring of the kind states; ``other`` is a
second number, of a meaning of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from campaigns.log_faults.machines import Record, World

Random = np.random.Generator
MachineFault = Callable[[World, int, float, float], World]
LoggerFault = Callable[[Record, int, float, float, Random], Record]
MACHINE: dict[str, MachineFault] = {}
LOGGER: dict[str, LoggerFault] = {}


@dataclass(frozen=True)
class Plant:
    """A fault as faults.csv states it: kind @ place size other."""

    kind: str
    place: int
    size: float
    other: float = 0.0


def parse_plants(text: str) -> list[Plant]:
    """Return the faults of ``kind @ place size other; ...`` [units of the kinds]."""
    plants = []
    for part in filter(None, (p.strip() for p in text.split(";"))):
        kind, numbers = part.split("@")
        place, *sizes = numbers.split()
        plants.append(Plant(kind.strip(), int(place), *(float(s) for s in sizes)))
    return plants


def apply_machine_faults(world: World, plants: list[Plant]) -> World:
    """Return the machine [units of its fields] with those faults that are a machine's."""
    for one in plants:
        if one.kind in MACHINE:
            world = MACHINE[one.kind](world, one.place, one.size, one.other)
    return world


def apply_logger_faults(record: Record, plants: list[Plant], random: Random) -> Record:
    """Return the record [s, rad, N m] with those faults that are a logger's or a sensor's."""
    for one in plants:
        if one.kind in LOGGER:
            record = LOGGER[one.kind](record, one.place, one.size, one.other, random)
    return record


def add_machine_fault(function: MachineFault) -> MachineFault:
    """Add a fault of machines under the name of its function."""
    MACHINE[_read_name(function)] = function
    return function


def add_logger_fault(function: LoggerFault) -> LoggerFault:
    """Add a fault of loggers under the name of its function."""
    LOGGER[_read_name(function)] = function
    return function


def _read_name(function: Callable[..., object]) -> str:
    return function.__name__.removeprefix("apply_").replace("_", " ")
