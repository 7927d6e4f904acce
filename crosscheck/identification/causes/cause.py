"""A cause of what remains: a change of the log or of the mechanism with one number, and one that was named with its evidence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.identification.logs.log import Log
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

NOTHING_REMAINS = "nothing beyond noise remains"
Undo = Callable[[Log, Mechanism, float], tuple[Log, Mechanism]]


@dataclass(frozen=True)
class Cause:
    """A fault with one number: its name, where, unit and step of phi, and the log and mechanism with the fault phi undone.

    moves : the model's side changes with it, too, and not only what an effort column says
    tries : sizes from which the way to the best one starts, beside the linear estimate [unit]
    one_sided : below 0 it is against nature (a signal comes before what it tells), and has to explain more than what can be
    least, most : it is never named outside of these sizes [unit]: beyond, it cannot be
    scales : the column of an effort or a gauge that is 1 + phi times too large; what remains is measured in its units, or a
        column that is noise would best be made small
    kin : of causes with the same text one is named at most
    daily : it differs from day to day, and is no fault beside others
    rare : it is named only where it explains more than all others by as much as counts as evidence
    wave : it is the sine or the cosine of a wave; both together are one cause, whose size is the amplitude
    scanned : sizes that are looked at first, where the cost has several valleys [unit]
    spot, make_at : further numbers (numbers,) [-] that say where, before the log standard normal, and the same cause elsewhere
    """

    name: str
    place: str
    unit: str
    step: float
    undone: Undo
    moves: bool = True
    tries: tuple[float, ...] = ()
    one_sided: bool = False
    least: float = -np.inf
    most: float = np.inf
    scales: str = ""
    kin: str = ""
    daily: bool = False
    rare: bool = False
    wave: bool = False
    scanned: tuple[float, ...] = ()
    spot: tuple[float, ...] = ()
    make_at: Callable[[tuple[float, ...]], Cause] | None = None


@dataclass(frozen=True)
class NamedCause:
    """A cause with its size and its standard error [unit], the drop of the cost that speaks for it [-], and its evidence."""

    name: str
    place: str
    unit: str
    size: float
    error: float
    drop: float
    evidence: str

    @property
    def words(self) -> str:
        """The cause as a sentence [-]."""
        bar = f" +- {self.error:.2g}" if self.error else ""
        number = f"{self.size:.4g}{bar} {self.unit}".removesuffix(" -")
        return f"{self.name} of {self.place}: {number} ({self.evidence})"


def apply_to_column(log: Log, name: str, change: Callable[[Array], Array]) -> Log:
    """Return a log with another column of that name [any unit]; it stays as it is where it has no such column."""
    if name not in log.columns:
        return log
    return replace(log, columns={**log.columns, name: change(log.columns[name])})


def apply_column_swap(log: Log, one: str, other: str) -> Log:
    """Return a log in which two columns have each other's name [any unit]."""
    return replace(log, columns={**log.columns, one: log.columns[other], other: log.columns[one]})
