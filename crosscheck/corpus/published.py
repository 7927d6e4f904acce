"""Published numbers beside the consensus: whether they lie in it, up to the digits that were printed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from crosscheck.corpus.consensus import CaseConsensus, SeriesConsensus
from crosscheck.corpus.notes import PublishedValue
from crosscheck.lifting.printed import compute_half_digit


@dataclass(frozen=True)
class PublishedComparison:
    """A published number and what stands beside it: low and high end of the consensus [unit], None where there is none.

    agrees : it lies there up to its digits; distance : from the nearer end [unit], 0 inside
    """

    value: PublishedValue
    low: float | None
    high: float | None
    agrees: bool | None
    distance: float | None

    @property
    def when(self) -> str:
        """Return in words which value of the series is meant."""
        return "largest magnitude" if self.value.at_s is None else f"at {self.value.at_s:g} s"


def compare_published(case: CaseConsensus, values: Iterable[PublishedValue]) -> Iterator[PublishedComparison]:
    """Yield the published numbers of a case [unit of each] with its consensus."""
    known = {one.name: one for one in case.series}
    for value in values:
        if (value.mechanism, value.case) == (case.task.folder.name, case.task.case.name):
            yield _compare_value(case, value, known.get(value.series))


def _compare_value(case: CaseConsensus, value: PublishedValue, one: SeriesConsensus | None) -> PublishedComparison:
    if one is None or one.interval is None or one.unit != value.unit:
        return PublishedComparison(value, None, None, None, None)
    low = one.interval.low
    high = one.interval.high
    if value.at_s is None:
        smallest = np.maximum(np.maximum(low, -high), 0.0)  # of magnitudes in [low, high]
        ends = float(smallest.max()), float(np.maximum(np.abs(low), np.abs(high)).max())
    else:
        k = int(np.abs(case.task.time - value.at_s).argmin())
        ends = float(low[k]), float(high[k])
    distance = max(ends[0] - value.value, value.value - ends[1], 0.0)
    return PublishedComparison(
        value, *ends, distance <= (value.digits or compute_half_digit(repr(value.value))), distance
    )
