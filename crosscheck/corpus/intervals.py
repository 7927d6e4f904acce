"""Intervals in which engines put a series, and where the intervals of different authors meet.

An engine puts a value into [v - b, v + b] with its error bar b.  Two engines agree on a series where their intervals meet at
every sample.  Intervals on a line that meet pair by pair have a point in common (Helly's theorem in one dimension, Helly 1923),
so the engines that agree are a clique, and the consensus is the intersection of their intervals.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from crosscheck.measures.budget import ROUNDING
from flexinv.typing import Array

# Half-width that every bar has at least, over the largest value of its quantity and unit.  A bar of closed formulas is what some
# last digits of the input change; where they cancel it is zero, but another code still rounds in another order.  It is the same
# number below which `crosscheck.measures.budget` sees no order: 1e4 operations of 1e-16 each.
FLOOR = ROUNDING


@dataclass(frozen=True)
class Interval:
    """Interval of a series: low and high (samples,) [unit]."""

    low: Array
    high: Array

    @property
    def middle(self) -> Array:
        """Return the middle (samples,) [unit]."""
        return self.low + 0.5 * (self.high - self.low)

    @property
    def half(self) -> Array:
        """Return the half-width (samples,) [unit], rounded up so that middle and half-width reach both ends."""
        middle = self.middle
        return np.nextafter(np.maximum(self.high - middle, middle - self.low), np.inf)


@dataclass(frozen=True)
class EngineValues:
    """Values of one engine: name, author, values and error bar (samples,) [unit]."""

    engine: str
    author: str
    values: Array
    bar: Array


def make_interval(given: EngineValues, size: float) -> Interval:
    """Return the interval of an engine; size : largest magnitude of its quantity [unit], of which `FLOOR` is the least bar."""
    half = np.maximum(given.bar, FLOOR * size)
    return Interval(given.values - half, given.values + half)


def has_common_point(first: Interval, second: Interval) -> bool:
    """Return True if two intervals have a point in common at every sample [-]."""
    return bool(np.all(np.maximum(first.low, second.low) <= np.minimum(first.high, second.high)))


def find_samples_inside(values: Array, where: Interval) -> NDArray[np.bool_]:
    """Return at which samples values (samples,) [unit] lie in an interval."""
    return np.asarray((where.low <= values) & (values <= where.high))


def compute_intersection(intervals: Sequence[Interval]) -> Interval:
    """Return the intersection of intervals that meet [unit]."""
    low, high = (np.stack([getattr(one, end) for one in intervals]) for end in ("low", "high"))
    return Interval(low.max(axis=0), high.min(axis=0))


def compute_hull(intervals: Sequence[Interval]) -> Interval:
    """Return the smallest interval that holds all of them [unit]."""
    low, high = (np.stack([getattr(one, end) for one in intervals]) for end in ("low", "high"))
    return Interval(low.min(axis=0), high.max(axis=0))


def find_agreeing_groups(engine_values: Sequence[EngineValues], size: float) -> tuple[tuple[EngineValues, ...], ...]:
    """Return the largest groups of engines that agree [unit]: most authors first, then most engines; several where equally large.

    A group has two authors at least; () where no two authors agree.
    """
    where = {one.engine: make_interval(one, size) for one in engine_values}
    linked = {
        frozenset((a.engine, b.engine))
        for a, b in combinations(engine_values, 2)
        if has_common_point(where[a.engine], where[b.engine])
    }
    groups = [group for group in _list_cliques(engine_values, linked) if len(collect_authors(group)) > 1]
    if not groups:
        return ()
    best = max(_count_members(group) for group in groups)
    return tuple(group for group in groups if _count_members(group) == best)


def collect_authors(group: Iterable[EngineValues]) -> frozenset[str]:
    """Return the authors of a group [-]."""
    return frozenset(one.author for one in group)


def _count_members(group: Sequence[EngineValues]) -> tuple[int, int]:
    return len(collect_authors(group)), len(group)


def _list_cliques(
    engine_values: Sequence[EngineValues], linked: set[frozenset[str]]
) -> Iterator[tuple[EngineValues, ...]]:
    """Yield the groups of engines that agree pair by pair and cannot be enlarged (Bron and Kerbosch 1973)."""
    near = {
        a.engine: {b.engine for b in engine_values if frozenset((a.engine, b.engine)) in linked} for a in engine_values
    }
    known = {one.engine: one for one in engine_values}

    def list_larger_cliques(held: tuple[str, ...], left: list[str], seen: list[str]) -> Iterator[tuple[str, ...]]:
        if not left and not seen:
            yield held
        for name in list(left):
            yield from list_larger_cliques(
                (*held, name), [n for n in left if n in near[name]], [n for n in seen if n in near[name]]
            )
            left.remove(name)
            seen.append(name)

    for names in list_larger_cliques((), [one.engine for one in engine_values], []):
        yield tuple(known[name] for name in names)


def compute_largest_magnitudes(series: Iterable[Mapping[str, tuple[str, Array]]]) -> dict[tuple[str, str], float]:
    """Return the largest magnitude [unit] by quantity and unit; series : of each engine, name -> (unit, values)."""
    largest_magnitudes: dict[tuple[str, str], float] = {}
    for record in series:
        for name, (unit, values) in record.items():
            key = name.split("/", 1)[0], unit
            largest_magnitudes[key] = max(largest_magnitudes.get(key, 0.0), float(np.abs(values).max(initial=0.0)))
    return largest_magnitudes
