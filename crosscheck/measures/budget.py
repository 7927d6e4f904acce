"""Error bars from refinement: three runs of one engine, each with half the step or mesh width of the one before.

With an error c h^p the differences of successive runs are a geometric series of ratio r = 2^-p, so that
    p = log2(|L1 - L0| / |L2 - L1|),      limit = L2 + (L2 - L1) r / (1 - r)
(Richardson's extrapolation with the observed order; |.| the RMS over the samples, so that zeros of a difference do no
harm).  Where the differences shrink so but point another way, nothing may be extrapolated and the bar is the largest
difference between the runs.  Where they grow, or shrink more slowly than with the order 1/2, the runs have no order: their
largest difference is shown, but it is no bar that explains anything (`no_order`), and of two runs alone nobody can tell.

An observed order above 2 is no promise: time integrations are of second order, and a mesh error that falls faster covers that
only while it is the larger one.  A bar therefore takes no higher order than `FORMAL`, whatever was observed.
Source: P. J. Roache, "Verification and Validation in Computational Science and Engineering", chapter 5, 1998.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosscheck.measures.record import Series
from flexinv.analysis.extrapolation import largest_nearby

Array = NDArray[np.float64]
SLOWEST = 0.5  # order below which runs do not count as convergent: Richardson would enlarge a difference 2.4 times
# Highest order that a bar trusts: that of the time integrations.  Where 4.5 was believed, 57 % of the values of the next run lay
# inside the bars of a beam (exudyn-ge, flex_one_link/quintic; crosscheck corpus --audit).
FORMAL = 2.0
# Differences below this part of a signal's size are its rounding: 1e4 operations of 1e-16 each.  There is no order in it.
ROUNDING = 1e-12

# How a bar was made where the runs show no order, or are too few to show one.
UNORDERED = "no order: the runs come no closer to each other"
TWO, TWO_EXTRAPOLATED = "difference of two runs", "what the extrapolation changes"
NO_ORDER = (UNORDERED, TWO, TWO_EXTRAPOLATED)


@dataclass(frozen=True)
class Estimate:
    """Half-width of an error bar (samples,) [unit], the observed order [-] (None: not observable), and how it was made."""

    bar: Array
    order: float | None
    how: str


@dataclass(frozen=True)
class Family:
    """Runs of one refinement from coarse to fine; value: the one whose result is reported, or "limit" for
    (4 fine - coarse) / 3 of the last two.

    name : what is refined, "step", "mesh", "mesh and step"
    """

    name: str
    runs: Sequence[Mapping[str, Series]]
    value: int | str = -1


def estimate(levels: Sequence[Array], value: int = -1) -> Estimate:
    """Return the error bar of one of the levels.

    levels : two or three, coarse to fine, each (samples,) [unit]; value : which of them is reported
    """
    reported = levels[value]
    spread = np.max([np.abs(reported - one) for one in levels], axis=0)
    if len(levels) < 3:
        return Estimate(largest_nearby(spread), None, TWO)
    first, second = levels[-2] - levels[-3], levels[-1] - levels[-2]
    size = max(_rms(one) for one in levels)
    if max(_rms(first), _rms(second)) <= ROUNDING * size:
        return Estimate(largest_nearby(spread), None, "rounding")
    ratio = _rms(second) / _rms(first) if _rms(first) > 0.0 else np.inf
    if ratio > 2.0**-SLOWEST:
        return Estimate(largest_nearby(spread), None, UNORDERED)
    if ratio == 0.0 or float(first @ second) <= 0.0:
        return Estimate(largest_nearby(spread), None, "largest difference")
    trusted = max(ratio, 2.0**-FORMAL)
    limit = levels[-1] + second * trusted / (1.0 - trusted)
    return Estimate(largest_nearby(np.abs(reported - limit)), float(-np.log2(ratio)), "Richardson")


def extrapolated(levels: Sequence[Array]) -> Estimate:
    """Return the error bar of (4 fine - coarse) / 3: what one more refinement changed it.

    levels : two or three, coarse to fine, each (samples,) [unit].  The order of the extrapolated values would take
    a fourth run; the bar is their difference itself (of two runs: what the extrapolation changed)
    """
    limit = (4.0 * levels[-1] - levels[-2]) / 3.0
    before = levels[-1] if len(levels) < 3 else (4.0 * levels[-2] - levels[-3]) / 3.0
    inner = estimate(levels)
    # Where the runs do not converge, extrapolating them is no better than the runs: the largest difference.
    others = levels if inner.how in ("largest difference", UNORDERED) else [before]
    bar = np.max([np.abs(limit - one) for one in others], axis=0)
    return Estimate(largest_nearby(bar), inner.order, inner.how if len(levels) > 2 else TWO_EXTRAPOLATED)


def no_order(line: Mapping[str, Any]) -> bool:
    """Return True if a series' line of budget (see ``with_bars``) shows that some refinement of it has no order."""
    return any(how in NO_ORDER for how in line.get("how", {}).values())


def with_bars(
    values: Mapping[str, Series], families: Sequence[Family]
) -> tuple[dict[str, Series], dict[str, dict[str, Any]]]:
    """Return the series with error bars [unit of each], and one line of budget per series; families add up.

    A line is {"bar": largest half-width, "peak": largest magnitude, "peak_bar": its own bar from the peaks of the runs,
    "order": {family: observed order or None}, "how": {family: words}}.
    """
    made, budget = dict(values), {}
    for name, one in values.items():
        bars = {f.name: _of_family(f, name) for f in families}
        known = {k: e for k, e in bars.items() if e is not None}
        if not known or len(known) < len(families):  # a bar that leaves out a cause of error would be too short
            continue
        bar = np.sum([series.bar for series, _ in known.values()], axis=0)
        made[name] = replace(one, error=bar)
        budget[name] = {
            "bar": float(bar.max()),
            "peak": float(np.abs(one.values).max()),
            "peak_bar": float(sum(peak.bar[0] for _, peak in known.values())),
            "order": {k: series.order for k, (series, _) in known.items()},
            "how": {k: series.how for k, (series, _) in known.items()},
        }
    return made, budget


def _of_family(family: Family, name: str) -> tuple[Estimate, Estimate] | None:
    """Return the estimates of a series and of its peak, or None where not all runs (two or more) have it, finite."""
    levels = [run[name].values for run in family.runs if name in run]
    if len(levels) < 2 or len(levels) < len(family.runs) or not all(np.isfinite(level).all() for level in levels):
        return None
    peaks = [np.abs(level).max(keepdims=True) for level in levels]
    if isinstance(family.value, str):
        return extrapolated(levels), extrapolated(peaks)
    return estimate(levels, family.value), estimate(peaks, family.value)


def limit_of(runs: Sequence[Mapping[str, Series]]) -> dict[str, Series]:
    """Return (4 fine - coarse) / 3 of the last two runs: the limit of an error a l^2 + b h^2, halved from run to run."""
    return {n: replace(s, values=(4.0 * s.values - runs[-2][n].values) / 3.0) for n, s in runs[-1].items()}


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
