"""Repeatability: an error bar explains a difference only where the engine gives the same again; scatter is no deterioration.

An engine whose results scatter has wide error bars from refinement, whatever it computes.  What its bars would explain is
therefore run once more, as it was; two runs of the same may differ by no more than the limit.

Where an engine enlarges rounding, its distance from the reference changes with the last digits of its input.  What seems
worse than blessed is therefore run again with these digits moved; a difference as large as that makes is none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from crosscheck.measures.record import Record
from crosscheck.verdicts.compare import Comparison, compute_fraction

SHAKEN = (1, 2, 3, 4)  # the ways in which the last digits of the input are moved: each costs a run


def add_scatter(row: Comparison, reference: Record, shaken: Sequence[Record]) -> Comparison:
    """Return a comparison with the scatter of its fraction [-] between its run and those with other last digits of the input.

    A run that failed says nothing.
    """
    found = [share for one in shaken if (share := _compute_share(row, one, reference)) is not None]
    if not found or row.fraction is None:
        return row
    return replace(row, scatter=max(*found, row.fraction) - min(*found, row.fraction))


def _compute_share(row: Comparison, record: Record, reference: Record) -> float | None:
    """Return the largest distance of a record from the reference in the quantity of a comparison, over its range [-]."""
    ours = record.series
    theirs = reference.series
    names = [
        n for n, one in theirs.items() if (one.quantity, one.unit) == (row.quantity, row.unit)
        and n in ours and ours[n].values.shape == one.values.shape
    ]  # fmt: skip
    if record.status != "ok" or not names:
        return None
    largest = max(float(np.abs(ours[n].values - theirs[n].values).max()) for n in names)
    return compute_fraction(largest, row.scale or 0.0)


def is_doubtful(row: Comparison) -> bool:
    """Return True if a comparison is beyond its limit and explained by error bars: both engines have to repeat."""
    return row.verdict == "explained" and row.limit is not None and row.maximum is not None


def judge_by_repetition(row: Comparison, first: Mapping[str, Record], again: Mapping[str, Record]) -> Comparison:
    """Return a doubtful comparison as it is where both engines repeat, else as a deviation that says which does not.

    first, again : records of both engines, by name
    """
    for engine in (row.engine, row.reference):
        if words := _describe_scatter(row, first[engine], again[engine]):
            said = f"{row.fraction:.3g} of the range, the limit is {row.limit:.3g}"
            bars = f"so that its error bars explain nothing: {engine} {words}"
            return replace(row, verdict="deviation", message=f"{said}; run once more, {bars}")
    return row


def _describe_scatter(row: Comparison, first: Record, again: Record) -> str:
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
    share = compute_fraction(largest, row.scale or 0.0)
    return f"differs from itself by {share:.3g} of the range" if share > (row.limit or 0.0) else ""
