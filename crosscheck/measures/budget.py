"""Error bars from refinement: three runs of one engine, each with half the step or mesh width of the one before.

With an error c h^p the differences of successive runs are a geometric series of ratio r = 2^-p, so that
    p = log2(|L1 - L0| / |L2 - L1|),      limit = L2 + (L2 - L1) r / (1 - r)
(Richardson's extrapolation with the observed order; |.| the RMS over the samples, so that zeros of a difference do no
harm).  Where the differences shrink so but point another way, nothing may be extrapolated and the bar is the largest
difference between the runs.  Where they grow, or shrink more slowly than with the order 1/2, the runs have no order: their
largest difference is shown, but it is no bar that explains anything (`has_no_order`), and of two runs alone nobody can tell.

An observed order above 2 is no promise: time integrations are of second order, and a mesh error that falls faster covers that
only while it is the larger one.  A bar therefore takes no higher order than `FORMAL`, whatever was observed.

Three runs say more than the bar of one of them: what they tend to, with a shorter bar of its own (`Estimate.left`).  A reference
is compared by that where its own bar is too wide, and an engine is held against it: a mistake stays when runs are refined.
Source: P. J. Roache, "Verification and Validation in Computational Science and Engineering", chapter 5, 1998.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np

from crosscheck.measures.record import BudgetLine, Record, Series
from flexinv.analysis.nearby import find_largest_nearby
from flexinv.typing import Array

SLOWEST = 0.5  # order below which runs do not count as convergent: Richardson would enlarge a difference 2.4 times
# Highest order that a bar trusts: that of the time integrations.  Where 4.5 was believed, 57 % of the values of the next run lay
# inside the bars of a beam (exudyn-ge, flex_one_link/quintic; crosscheck corpus --audit).
FORMAL = 2.0
# Differences below this part of a signal's size are its rounding: 1e4 operations of 1e-16 each.  There is no order in it.
ROUNDING = 1e-12

# How a bar was made where the runs show no order, or are too few to show one.
UNORDERED = "no order: the runs come no closer to each other"
TWO = "difference of two runs"
TWO_EXTRAPOLATED = "what the extrapolation changes"
NO_ORDER = (UNORDERED, TWO, TWO_EXTRAPOLATED)
# Of what extrapolation adds to the finest run, the part that it may be wrong by, whatever the change from extrapolation to
# extrapolation says: an order that three runs fit exactly (a single number, say) leaves no change.
DOUBT = 0.25
# An engine from outside says these bars itself: nobody asked for the runs behind them.
STATED = "stated by the engine itself"


@dataclass(frozen=True)
class Estimate:
    """Half-width of an error bar (samples,) [unit], the observed order [-] (None: not observable), and how it was made.

    tends_to, left : what the runs tend to, and the half-width of its own bar, (samples,) [unit]; None where they do not say
    """

    bar: Array
    order: float | None
    how: str
    tends_to: Array | None = None
    left: Array | None = None


class RefinedLimit(TypedDict, total=False):
    """Limit of the refinements of a series and the half-width of its bar, (samples,) [unit]; empty where they have none."""

    refined: Array
    left: Array


@dataclass(frozen=True)
class Family:
    """Runs of one refinement from coarse to fine; value: the one whose result is reported, or "limit" for
    (4 fine - coarse) / 3 of the last two.

    name : what is refined, "step", "mesh", "mesh and step"
    """

    name: str
    runs: Sequence[Mapping[str, Series]]
    value: int | str = -1


def compute_error_bar(levels: Sequence[Array], value: int = -1) -> Estimate:
    """Return the error bar of one of the levels.

    levels : two or three, coarse to fine, each (samples,) [unit]; value : which of them is reported
    """
    reported = levels[value]
    spread = np.max([np.abs(reported - one) for one in levels], axis=0)
    if len(levels) < 3:
        return Estimate(find_largest_nearby(spread), None, TWO)
    first = levels[-2] - levels[-3]
    second = levels[-1] - levels[-2]
    size = max(_compute_rms(one) for one in levels)
    if max(_compute_rms(first), _compute_rms(second)) <= ROUNDING * size:
        return Estimate(find_largest_nearby(spread), None, "rounding", reported, find_largest_nearby(spread))
    ratio = _compute_rms(second) / _compute_rms(first) if _compute_rms(first) > 0.0 else np.inf
    if ratio > 2.0**-SLOWEST:
        return Estimate(find_largest_nearby(spread), None, UNORDERED)
    if ratio == 0.0 or float(first @ second) <= 0.0:
        rest = np.abs(second) * ratio / (1.0 - ratio)  # all differences to come, of a series that shrinks so
        return Estimate(find_largest_nearby(spread), None, "largest difference", levels[-1], find_largest_nearby(rest))
    trusted = max(ratio, 2.0**-FORMAL)
    before, limit = (
        one + step * trusted / (1.0 - trusted) for one, step in ((levels[-2], first), (levels[-1], second))
    )
    left = np.maximum(np.abs(limit - before), DOUBT * np.abs(limit - levels[-1]))
    bar = find_largest_nearby(np.abs(reported - limit))
    return Estimate(bar, float(-np.log2(ratio)), "Richardson", limit, find_largest_nearby(left))


def compute_extrapolated_bar(levels: Sequence[Array]) -> Estimate:
    """Return the error bar of (4 fine - coarse) / 3: what one more refinement changed it.

    levels : two or three, coarse to fine, each (samples,) [unit].  The order of the extrapolated values would take
    a fourth run; the bar is their difference itself (of two runs: what the extrapolation changed)
    """
    limit = (4.0 * levels[-1] - levels[-2]) / 3.0
    before = levels[-1] if len(levels) < 3 else (4.0 * levels[-2] - levels[-3]) / 3.0
    inner = compute_error_bar(levels)
    # Where the runs do not converge, extrapolating them is no better than the runs: the largest difference.
    others = levels if inner.how in ("largest difference", UNORDERED) else [before]
    bar = find_largest_nearby(np.max([np.abs(limit - one) for one in others], axis=0))
    if len(levels) < 3:
        return Estimate(bar, None, TWO_EXTRAPOLATED)
    known = inner.tends_to is not None
    return Estimate(bar, inner.order, inner.how, limit if known else None, bar if known else None)


def has_no_order(line: BudgetLine) -> bool:
    """Return True if a series' line of budget (see ``add_error_bars``) shows that some refinement of it has no order."""
    return any(how in NO_ORDER for how in line.get("how", {}).values())


def is_checked(budget: Mapping[str, BudgetLine], name: str) -> bool:
    """Return True if the bar of a series comes from runs that this project asked for; one that an engine states does not."""
    return name in budget and STATED not in budget[name].get("how", {})


def apply_stated_bars(record: Record) -> Record:
    """Return the record of an engine from outside that made its bars by itself: they are shown, and count for nothing."""
    budget = {name: _make_stated_line(one) for name, one in record.series.items() if one.error is not None}
    plain = {name: replace(one, refined=None, left=None) for name, one in record.series.items()}
    return replace(record, series=plain, budget=budget)


def _make_stated_line(one: Series) -> BudgetLine:
    """Return the line of a series whose engine states its bar; numbers that are none are refused with the record."""
    bar, peak = (float(np.nan_to_num(np.abs(part)).max(initial=0.0)) for part in (np.asarray(one.error), one.values))
    how = {STATED: "no refinement that was asked for shows it"}
    return {"bar": bar, "peak": peak, "peak_bar": bar, "order": {}, "how": how}


def add_error_bars(
    values: Mapping[str, Series], families: Sequence[Family]
) -> tuple[dict[str, Series], dict[str, BudgetLine]]:
    """Return the series with error bars [unit of each], and one line of budget per series; families add up.

    Where all families say what their runs tend to, the series says it, too: errors of families are added, and what they change
    together is of the size of their product over the largest value.
    """
    made = dict(values)
    budget: dict[str, BudgetLine] = {}
    for name, one in values.items():
        bars = {f.name: _compute_family_bars(f, name) for f in families}
        known = {k: e for k, e in bars.items() if e is not None}
        if not known or len(known) < len(families):  # a bar that leaves out a cause of error would be too short
            continue
        bar = np.sum([series.bar for series, _ in known.values()], axis=0)
        made[name] = replace(one, error=bar, **_compute_refined_limit(one, [series for series, _ in known.values()]))
        budget[name] = {
            "bar": float(bar.max()),
            "peak": float(np.abs(one.values).max()),
            "peak_bar": float(sum(peak.bar[0] for _, peak in known.values())),
            "order": {k: series.order for k, (series, _) in known.items()},
            "how": {k: series.how for k, (series, _) in known.items()},
            "bars": {k: float(series.bar.max()) for k, (series, _) in known.items()},
            "left": {k: float(series.left.max()) for k, (series, _) in known.items() if series.left is not None},
        }
    return made, budget


def _compute_refined_limit(one: Series, families: Sequence[Estimate]) -> RefinedLimit:
    """Return the limit of the runs of all families and the half-width of its bar (samples,) [unit], {} where they show none."""
    steps = [family.tends_to - one.values for family in families if family.tends_to is not None]
    left = [family.left for family in families if family.left is not None]
    if len(steps) < len(families) or len(left) < len(families):
        return {}
    size = float(np.abs(one.values).max())
    largest = [float(np.abs(step).max()) for step in steps]
    mixed = float(np.prod(largest)) / size ** (len(steps) - 1) if len(steps) > 1 and size > 0.0 else 0.0
    return {"refined": one.values + np.sum(steps, axis=0), "left": np.sum(left, axis=0) + mixed}


def _compute_family_bars(family: Family, name: str) -> tuple[Estimate, Estimate] | None:
    """Return the estimates of a series and of its peak, or None where not all runs (two or more) have it, finite."""
    levels = [run[name].values for run in family.runs if name in run]
    if len(levels) < 2 or len(levels) < len(family.runs) or not all(np.isfinite(level).all() for level in levels):
        return None
    peaks = [np.abs(level).max(keepdims=True) for level in levels]
    if isinstance(family.value, str):
        return compute_extrapolated_bar(levels), compute_extrapolated_bar(peaks)
    return compute_error_bar(levels, family.value), compute_error_bar(peaks, family.value)


def compute_richardson_limit(runs: Sequence[Mapping[str, Series]]) -> dict[str, Series]:
    """Return (4 fine - coarse) / 3 of the last two runs: the limit of an error a l^2 + b h^2, halved from run to run."""
    return {n: replace(s, values=(4.0 * s.values - runs[-2][n].values) / 3.0) for n, s in runs[-1].items()}


def _compute_rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
