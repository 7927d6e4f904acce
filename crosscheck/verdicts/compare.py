"""Comparison of two records: errors over the range of the signal, dominant frequencies, verdicts.

Series are compared in groups: all series of one quantity and one unit (all joint torques in N m) share the range
of the largest of them, so that a joint with hardly any torque is not judged by its own rounding.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np

from crosscheck.engines import ENGINES
from crosscheck.measures.limits import Verdict, find, judge_by_limit
from crosscheck.measures.metrics import compute_sprague_geers
from crosscheck.measures.record import Record, Series
from crosscheck.measures.spectrum import find_dominant_frequency
from crosscheck.verdicts.bars import (
    Bars,
    Reference,
    build_bars,
    choose_reference,
    describe_unordered,
    find_checked_bar,
    find_stated_bar,
)
from flexinv.files.load_cases import Case, Limit
from flexinv.typing import Array

# A signal that moves by less than this fraction of its own size is a holding torque: its size is its range (a motor of
# 0.033 N m that varies by 1e-7 would otherwise be judged by that variation, which is interpolation error).
STILL = 1e-3
# Moments of 1e-15 N m beside forces of 10 N are no moments but the rounding of those forces times a length of some metres
# (and the other way round): below this part of a quantity's largest value in any unit a group is zero.
NOTHING = 1e-13
# Quantities that are compared sample by sample, and that a cause of a difference has to explain.
COMPARED = ("torque", "wrench", "reaction", "tip", "deflection", "axial", "internal")
# Quantities of which a part is not enough.  Of others an engine may know less (no wrench of a joint that it welded).
WHOLE = ("torque",)


@dataclass(frozen=True)
class Comparison:
    """One engine against one reference in one quantity and unit.

    maximum, rms, scale, error_bar : [unit]; the largest error, the RMS error of the series that has it, the range
        that both are divided by, and the checked error bars of both engines added up (None where not both have one)
    magnitude, phase, comprehensive : Sprague and Geers' errors of that series [-]
    limit : largest fraction of the range allowed [-]; series, time [s] : where the largest error is
    blessed : the fraction that was measured when the night was last blessed [-]
    scatter : by how much the fraction differs between runs whose input differs in its last digits [-], where that was asked
    unordered : engines of the pair whose refinement has no order there, so that the error bar is none
    uncertified : what of the engines' certificates does not hold: they have not the same mechanism
    engine_bar, reference_bar : checked error bars of that series; stated_bar : the engine's own, which nobody has checked [unit]
    refined : the reference is what its refinements tend to, for its own bar is wider than a tenth of the limit
    """

    mechanism: str
    case: str
    engine: str
    reference: str
    quantity: str
    unit: str
    verdict: Verdict
    message: str = ""
    maximum: float | None = None
    rms: float | None = None
    scale: float | None = None
    limit: float | None = None
    reason: str = ""
    series: str = ""
    time: float | None = None
    error_bar: float | None = None
    magnitude: float | None = None
    phase: float | None = None
    comprehensive: float | None = None
    blessed: float | None = None
    scatter: float | None = None
    unordered: str = ""
    uncertified: str = ""
    engine_bar: float | None = None
    reference_bar: float | None = None
    stated_bar: float | None = None
    refined: bool = False

    @property
    def fraction(self) -> float | None:
        """Largest error over the range of the signal [-]."""
        if self.maximum is None or self.scale is None:
            return None
        return compute_fraction(self.maximum, self.scale)


@dataclass(frozen=True)
class RecordPair:
    """Two records of one case to compare; rest [s] is the time at which the prescribed motion has come to rest."""

    mechanism: str
    case: Case
    engine: Record
    reference: Record
    rest: float
    today: datetime.date


def compare(pair: RecordPair) -> list[Comparison]:
    """Return one comparison per quantity of the case and unit."""
    if (verdict := _find_hindrance(pair)) is not None:
        return [_make_row(pair, q, "", *verdict) for q in pair.case.quantities]
    return [row for quantity in pair.case.quantities for row in _compare_quantity(pair, quantity)]


def _find_hindrance(pair: RecordPair) -> tuple[Verdict, str] | None:
    """Return verdict and message where one of the records has no series."""
    for record, who in ((pair.engine, ""), (pair.reference, f"reference {pair.reference.engine}: ")):
        if record.status == "skipped":
            return "skipped", who + record.message
        if record.status != "ok":
            return "error", f"{who}{record.status}: {record.message}"
    hashes = pair.engine.model_hash, pair.reference.model_hash
    if hashes[0] != hashes[1]:
        return "error", f"was given another model than {pair.reference.engine} (the files changed during the run)"
    return None


def _compare_quantity(pair: RecordPair, quantity: str) -> list[Comparison]:
    if quantity == "frequency":
        return [_compare_frequency(pair)]
    groups = split_by_unit(pair.reference.series, quantity)
    rows = [_compare_group(pair, quantity, unit, names) for unit, names in groups.items()]
    if not rows:
        return [_make_row(pair, quantity, "", "skipped", f"{pair.reference.engine} does not give it")]
    return rows


def split_by_unit(series: Mapping[str, Series], quantity: str) -> dict[str, list[str]]:
    """Return the names of the series of a quantity by unit."""
    groups: dict[str, list[str]] = {}
    for one in series.values():
        if one.quantity == quantity:
            groups.setdefault(one.unit, []).append(one.name)
    return groups


def _compare_group(pair: RecordPair, quantity: str, unit: str, names: Sequence[str]) -> Comparison:
    ours = pair.engine.series
    theirs = pair.reference.series
    common = [n for n in names if n in ours]
    if not common:
        return _make_row(pair, quantity, unit, "skipped", f"{pair.engine.engine} does not give it")
    if wrong := [n for n in common if ours[n].unit != unit]:
        return _make_row(pair, quantity, unit, "error", f"{wrong[0]} is in {ours[wrong[0]].unit}, not in {unit}")
    limit = _find_limit(pair, quantity)
    scale = scale_of(pair.reference, quantity, [theirs[n].values for n in names])
    reference = _take_reference(pair, common, None if limit is None else limit.maximum * scale)
    errors = {n: ours[n].values - reference.values[n] for n in common}
    worst = max(common, key=lambda n: float(np.abs(errors[n]).max()))
    at = int(np.abs(errors[worst]).argmax())
    measured = ComparisonNumbers(
        maximum=float(np.abs(errors[worst][at])),
        rms=float(np.sqrt(np.mean(errors[worst] ** 2))),
        scale=scale,
        series=worst,
        time=float(pair.reference.time[at]),
        **_collect_bars(pair, worst, reference),
        refined=reference.refined,
        unordered=describe_unordered(pair.engine, pair.reference, worst),
        **compute_sprague_geers(ours[worst].values, reference.values[worst]),
    )
    gap = [n for n in names if n not in ours]
    words = f"{len(common)} of {len(names)} series; {gap[0]} is missing" if gap else ""
    bars = build_bars(pair.engine, pair.reference, reference, common, scale, 0.0 if limit is None else limit.maximum)
    return _judge_quantity(pair, quantity, unit, measured, words, bars)


def _take_reference(pair: RecordPair, names: Sequence[str], allowed: float | None) -> Reference:
    """Return the reference's values of some series [unit]: of an engine that makes the same steps as they are, without bars.

    allowed : limit times range [unit], None without a limit
    """
    if pair.engine.engine in ENGINES and ENGINES[pair.engine.engine].same_steps:
        return Reference({n: pair.reference.series[n].values for n in names}, dict.fromkeys(names))
    return choose_reference(pair.reference, names, allowed)


class ComparisonBars(TypedDict):
    """Error bars of a comparison [unit]; the fields of ``Comparison`` say what they are."""

    error_bar: float | None
    engine_bar: float | None
    reference_bar: float | None
    stated_bar: float | None


def _collect_bars(pair: RecordPair, name: str, reference: Reference) -> ComparisonBars:
    """Return the bars of a series as a comparison shows them [unit]: checked ones of both sides, and what an engine states."""
    checked_bar = find_checked_bar(pair.engine, name)
    theirs = reference.bars[name]
    both = None if checked_bar is None or theirs is None else checked_bar + theirs
    return {
        "error_bar": both,
        "engine_bar": checked_bar,
        "reference_bar": theirs,
        "stated_bar": find_stated_bar(pair.engine, name),
    }


def _find_limit(pair: RecordPair, quantity: str) -> Limit | None:
    return find(pair.case.limits, quantity, pair.engine.engine, pair.reference.engine, pair.engine.version)


@dataclass(frozen=True)
class ComparisonNumbers:
    """The numbers of one comparison; the fields of ``Comparison`` say what they are."""

    maximum: float
    rms: float
    scale: float
    series: str
    time: float | None = None
    error_bar: float | None = None
    engine_bar: float | None = None
    reference_bar: float | None = None
    stated_bar: float | None = None
    refined: bool = False
    magnitude: float | None = None
    phase: float | None = None
    comprehensive: float | None = None
    unordered: str = ""


def _judge_quantity(
    pair: RecordPair, quantity: str, unit: str, measured: ComparisonNumbers, gap: str = "", bars: Bars | None = None
) -> Comparison:
    limit = _find_limit(pair, quantity)
    share = compute_fraction(measured.maximum, measured.scale)
    known = pair.engine.engine in ENGINES and ENGINES[pair.engine.engine].native
    verdict, message = judge_by_limit(share, limit, pair.today, pair.engine.message if known else "")
    if bars is not None and limit is not None and verdict in ("within", "deviation"):
        verdict, message = bars.judge_comparison(verdict, message, limit.maximum)
    if gap:
        verdict = "error" if quantity in WHOLE else verdict
        message = "; ".join(filter(None, [message, gap]))
    return _make_row(pair, quantity, unit, verdict, message, measured, limit)


def _make_row(
    pair: RecordPair,
    quantity: str,
    unit: str,
    verdict: Verdict,
    message: str,
    measured: ComparisonNumbers | None = None,
    limit: Limit | None = None,
) -> Comparison:
    row = Comparison(
        pair.mechanism,
        pair.case.name,
        pair.engine.engine,
        pair.reference.engine,
        quantity,
        unit,
        verdict,
        message,
        **({} if measured is None else vars(measured)),
    )
    return row if limit is None else replace(row, limit=limit.maximum, reason=limit.reason)


def compute_fraction(maximum: float, scale: float) -> float:
    """Return the error over the range [-]; of a signal that is zero throughout any error is infinitely large."""
    if scale > 0.0:
        return maximum / scale
    return 0.0 if maximum == 0.0 else float("inf")


def compute_signal_range(signals: Sequence[Array]) -> float:
    """Return the range of the signal that moves most: its largest less its smallest value.

    signals : each (samples,) [unit]; returns [unit].  Where all stand still (a constant holding torque), the
    largest magnitude.
    """
    spread = max(float(np.ptp(s)) for s in signals)
    size = max(float(np.abs(s).max()) for s in signals)
    return spread if spread > STILL * size else size


def scale_of(reference: Record, quantity: str, signals: Sequence[Array]) -> float:
    """Return the divisor of a group's errors: its range, or that of its quantity where the group is zero but for rounding.

    signals : each (samples,) [unit]; returns [unit]
    """
    signal_range = compute_signal_range(signals)
    whole = max(float(np.abs(s.values).max()) for s in reference.series.values() if s.quantity == quantity)
    return signal_range if signal_range > NOTHING * whole else whole


def _compare_frequency(pair: RecordPair) -> Comparison:
    name = find_ringing_series(pair.reference)
    if name is None or name not in pair.engine.series:
        return _make_row(pair, "frequency", "Hz", "skipped", "no deflection or torque in common to take it from")
    ours, theirs = (
        find_dominant_frequency(r.time, r.series[name].values, pair.rest) for r in (pair.engine, pair.reference)
    )
    if ours is None or theirs is None:
        return _make_row(pair, "frequency", "Hz", "skipped", f"{name} has no peak in its spectrum")
    difference = abs(ours - theirs)
    measured = ComparisonNumbers(maximum=difference, rms=difference, scale=theirs, series=name)
    return _judge_quantity(pair, "frequency", "Hz", measured)


def find_ringing_series(record: Record) -> str | None:
    """Return the deflection (else the torque) that moves most: the one whose frequency is compared."""
    for quantity in ("deflection", "torque"):
        named = [s for s in record.series.values() if s.quantity == quantity]
        if named:
            return max(named, key=lambda s: float(np.ptp(s.values))).name
    return None
