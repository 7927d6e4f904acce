"""Error bars of two records in one comparison: which were checked, and whether both together carry a difference.

A bar counts where runs show it that this project asked for (`crosscheck.measures.budget.is_checked`).  The reference has to know
better than a tenth of the limit (`PART`): where its own bar is wider it is compared by what its refinements tend to, and where
that is too wide as well, nothing is judged but what no refinement can change:

    difference + bar of the reference <= limit                     within
    difference > limit + bar of the reference + bar of the engine  deviation

A mistake stays when the runs of an engine are refined, and a discretisation error goes.  Beyond its limit a difference is
therefore explained only where what the engine's runs tend to is nearer as well: as near as its bar says, or inside the limit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from crosscheck.measures.budget import has_no_order, is_checked
from crosscheck.measures.limits import BY_DISCRETISATION, WIDEST_BAR, Verdict
from crosscheck.measures.record import Record
from flexinv.typing import Array

PART = 0.1  # of a limit: a reference that knows better than this changes no verdict that anybody would look at
COARSE = "not judged: reference too coarse"


def find_checked_bar(record: Record, name: str) -> float | None:
    """Return the largest error bar of a series [unit] that runs show which were asked for; None where there is none."""
    error = record.series[name].error
    return float(error.max()) if error is not None and is_checked(record.budget, name) else None


def find_stated_bar(record: Record, name: str) -> float | None:
    """Return the largest error bar of a series [unit] that its engine states by itself, None where there is none."""
    error = record.series[name].error
    return None if error is None or is_checked(record.budget, name) else float(error.max())


def compute_total_bar(ours: Record, theirs: Record, name: str) -> float | None:
    """Return both engines' largest checked bars of a series added up [unit], None where not both have one."""
    bars = [bar for one in (ours, theirs) if (bar := find_checked_bar(one, name)) is not None]
    return sum(bars) if len(bars) == 2 else None


@dataclass(frozen=True)
class Reference:
    """The reference of a comparison, by series: values (samples,) and largest checked bar [unit].

    refined : they are what refinements tend to
    """

    values: Mapping[str, Array]
    bars: Mapping[str, float | None]
    refined: bool = False

    def find_widest_bar(self, names: Sequence[str]) -> float | None:
        """Return the largest bar of some series [unit]; None where one of them has none."""
        bars = [self.bars[name] for name in names]
        known = [bar for bar in bars if bar is not None]
        return max(known, default=None) if len(known) == len(bars) else None


def choose_reference(record: Record, names: Sequence[str], allowed: float | None) -> Reference:
    """Return the reference's values where their bars are a tenth of what is allowed, else what its refinements tend to [unit].

    names : of all series of one quantity and unit; allowed : limit times range [unit], None without a limit
    """
    reference = Reference({n: record.series[n].values for n in names}, {n: find_checked_bar(record, n) for n in names})
    widest = reference.find_widest_bar(names)
    if allowed is None or widest is None or widest <= PART * allowed:
        return reference
    values = dict(reference.values)
    bars = dict(reference.bars)
    for name in names:
        one = record.series[name]
        if one.refined is not None and one.left is not None and float(one.left.max()) < (reference.bars[name] or 0.0):
            values[name] = one.refined
            bars[name] = float(one.left.max())
    taken = Reference(values, bars, refined=True)
    return taken if (taken.find_widest_bar(names) or 0.0) < widest else reference


@dataclass(frozen=True)
class Bars:
    """Bars and errors of the series of one comparison, all [-], over the range.

    errors : largest error by series; engine_bars, reference_bars : largest checked bars, None where there is none;
    stated_bars : what an engine says
    of itself
    staying : by series, the distance from the reference to which an engine's refinements tend, where that is beyond its bar
    unordered : engines, by series, whose runs come no closer to each other
    """

    engine: str
    reference: str
    errors: Mapping[str, float]
    engine_bars: Mapping[str, float | None]
    reference_bars: Mapping[str, float | None]
    stated_bars: Mapping[str, float]
    staying: Mapping[str, float]
    unordered: Mapping[str, str]

    @property
    def widest(self) -> float | None:
        """Return the widest bar of the reference [-], None where a series has none."""
        known = [bar for bar in self.reference_bars.values() if bar is not None]
        return max(known) if known and len(known) == len(self.reference_bars) else None

    def judge_comparison(self, verdict: Verdict, message: str, maximum: float) -> tuple[Verdict, str]:
        """Return verdict and message of a comparison with its limit [-] as the bars of both engines leave it.

        verdict, message : by the limit alone, "within" or "deviation"
        """
        largest = max(self.errors.values())
        widest = self.widest
        coarse = widest is not None and widest > PART * maximum
        if verdict == "within":
            open_ = coarse and largest + (widest or 0.0) > maximum
            return ("unjudged", self._describe_coarse_reference(largest, maximum)) if open_ else (verdict, message)
        beyond = any(error > maximum + self._compute_covered_error(name) for name, error in self.errors.items())
        if coarse and not beyond:
            return "unjudged", self._describe_coarse_reference(largest, maximum)
        return self._judge_by_bars(message, maximum)

    def _describe_coarse_reference(self, largest: float, maximum: float) -> str:
        return (
            f"{COARSE}: the error bar of {self.reference} is {self.widest:.3g} of the range, {largest:.3g} apart, "
            f"the limit is {maximum:.3g}"
        )

    def _compute_covered_error(self, name: str) -> float:
        """Return the largest error that both bars of a series carry [-]: no bar, and one that shows no order, carry nothing."""
        ours = 0.0 if self.engine in self.unordered.get(name, "").split(" and ") else self.engine_bars[name] or 0.0
        return ours + (self.reference_bars[name] or 0.0)

    def _judge_by_bars(self, message: str, maximum: float) -> tuple[Verdict, str]:
        """Return verdict and message of a difference beyond its limit [-]: explained where checked bars of both carry it."""
        over = [name for name, error in self.errors.items() if error > maximum]
        if said := [self.stated_bars[name] for name in over if name in self.stated_bars]:
            words = f"{self.engine} states error bars of {max(said):.3g} by itself, which no run has shown: they explain nothing"
            return "deviation", f"{message}; {words}"
        if any(self.engine_bars[n] is None or self.reference_bars[n] is None for n in over):
            return "deviation", message
        if any(error > sum(self._list_both_bars(name)) for name, error in self.errors.items()):
            return "deviation", message
        ours, theirs = self._list_both_bars(max(self.errors, key=lambda name: self.errors[name]))
        if words := self._describe_weakness(over, ours + theirs):
            return "deviation", f"{message}; the error bars add up to {ours + theirs:.3g}, {words}"
        sides = f"{self.engine} {ours:.3g}, {self.reference} {theirs:.3g}"
        return "explained", f"{BY_DISCRETISATION}{message}, and the error bars add up to {ours + theirs:.3g}: {sides}"

    def _list_both_bars(self, name: str) -> tuple[float, float]:
        """Return the checked bars of the engine and of the reference [-], 0 where there is none."""
        return self.engine_bars[name] or 0.0, self.reference_bars[name] or 0.0

    def _describe_weakness(self, over: Sequence[str], total: float) -> str:
        """Return the reason why bars that are wide enough explain nothing, "" where they do; over : series beyond the limit."""
        if lost := next((self.unordered[n] for n in over if self.unordered.get(n)), ""):
            return f"but explain nothing: refined, the runs of {lost} come no closer to each other"
        if total > WIDEST_BAR:
            return "which is too wide to explain it: refine"
        if stay := [self.staying[name] for name in over if name in self.staying]:
            return f"but {max(stay):.3g} is left where the refined runs of {self.engine} tend to"
        return ""


def build_bars(
    ours: Record, theirs: Record, reference: Reference, names: Sequence[str], scale: float, limit: float
) -> Bars:
    """Return the bars of a comparison.

    names : series that both have; scale : the range [unit]; limit : allowed part of it [-]
    """
    scaled = scale or np.inf  # a signal that is zero has no bars that could explain anything
    errors = {n: float(np.abs(ours.series[n].values - reference.values[n]).max()) for n in names}
    told = {n: bar for n in names if (bar := find_stated_bar(ours, n)) is not None}
    return Bars(
        engine=ours.engine,
        reference=theirs.engine,
        errors={n: error / scale if scale > 0.0 else (np.inf if error > 0.0 else 0.0) for n, error in errors.items()},
        engine_bars=_scale_bars({n: find_checked_bar(ours, n) for n in names}, scaled),
        reference_bars=_scale_bars({n: reference.bars[n] for n in names}, scaled),
        stated_bars={n: bar / scaled for n, bar in told.items()},
        staying={
            n: far / scaled for n in names if (far := _compute_limit_gap(ours, reference, n, limit * scale)) is not None
        },
        unordered={n: words for n in names if (words := describe_unordered(ours, theirs, n))},
    )


def _scale_bars(bars: Mapping[str, float | None], scale: float) -> dict[str, float | None]:
    return {name: None if bar is None else bar / scale for name, bar in bars.items()}


def _compute_limit_gap(ours: Record, reference: Reference, name: str, allowed: float) -> float | None:
    """Return the distance of the limit of an engine's runs from the reference [unit], None where bars or its limit cover it."""
    one = ours.series[name]
    if one.refined is None or one.left is None:
        return None
    far = float(np.abs(one.refined - reference.values[name]).max())
    covered = float(one.left.max()) + (reference.bars[name] or 0.0)
    return far if far > max(covered, allowed) else None


def describe_unordered(ours: Record, theirs: Record, name: str) -> str:
    """Return the engines whose refinement of a series has no order, in words; "" where none."""
    return " and ".join(one.engine for one in (ours, theirs) if has_no_order(one.budget.get(name, {})))
