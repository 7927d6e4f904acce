"""Repeatability: an error bar explains a difference only where the engine gives the same again.

An engine whose results scatter has wide error bars from refinement, whatever it computes.  What its bars would explain is
therefore run once more, as it was; two runs of the same may differ by no more than the limit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from crosscheck.measures.record import Record
from crosscheck.verdicts.compare import Comparison, fraction


def doubtful(row: Comparison) -> bool:
    """Return True if a comparison is beyond its limit and explained by error bars: both engines have to repeat."""
    return row.verdict == "explained" and row.limit is not None and row.maximum is not None


def repeated(row: Comparison, first: Mapping[str, Record], again: Mapping[str, Record]) -> Comparison:
    """Return a doubtful comparison as it is where both engines repeat, else as a deviation that says which does not.

    first, again : records of both engines, by name
    """
    for engine in (row.engine, row.reference):
        if words := _scatter(row, first[engine], again[engine]):
            said = f"{row.fraction:.3g} of the range, the limit is {row.limit:.3g}"
            bars = f"so that its error bars explain nothing: {engine} {words}"
            return replace(row, verdict="deviation", message=f"{said}; run once more, {bars}")
    return row


def _scatter(row: Comparison, first: Record, again: Record) -> str:
    """Return in words how two runs of one engine differ by more than the limit of a comparison; "" where they do not."""
    if again.status != "ok":
        return f"did not run again: {again.message}"
    names = [one.name for one in first.series.values() if (one.quantity, one.unit) == (row.quantity, row.unit)]
    if not names:
        return "cannot be compared with its first run, whose series are lost"
    if any(
        name not in again.series or again.series[name].values.shape != first.series[name].values.shape for name in names
    ):
        return "gave other series"
    largest = max(float(np.abs(again.series[n].values - first.series[n].values).max()) for n in names)
    share = fraction(largest, row.scale or 0.0)
    return f"differs from itself by {share:.3g} of the range" if share > (row.limit or 0.0) else ""
