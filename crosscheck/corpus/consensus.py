"""Consensus of a case: by series the interval in which engines of different authors meet, who agrees, who does not and why.

An engine takes part with its error bar.  It does not where its certificate does not hold (another mechanism), where its bar is
none (its refinement has no order, or it gives none), where it states the bar by itself, where the bar is wider than a tenth of
the range, or where its own result is known to differ; such values are shown beside, inside or outside.

Where two formulations of one author agree with the others and not with each other, none of them is preferred: the consensus
reaches over both intersections.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from crosscheck.corpus.authors import Author
from crosscheck.corpus.intervals import (
    FLOOR,
    EngineValues,
    Interval,
    collect_authors,
    compute_hull,
    compute_intersection,
    compute_largest_magnitudes,
    find_agreeing_groups,
    find_samples_inside,
    has_common_point,
    make_interval,
)
from crosscheck.engines import Engine
from crosscheck.kit.resolved import list_idle_velocities
from crosscheck.measures.budget import has_no_order, is_checked
from crosscheck.measures.limits import REFERENCE, WIDEST_BAR
from crosscheck.measures.record import Record, Series
from crosscheck.report.explanations import describe_diagnosis, describe_failing_lines, find_diagnosis
from crosscheck.verdicts.compare import COMPARED, WHOLE, compute_signal_range
from crosscheck.verdicts.plan import Task
from crosscheck.verdicts.results import Results

CONSENSUS = "consensus"
CLOSED_FORM = "closed form"
DISAGREEMENT = "disagreement"
SINGLE = "single"
REACHED = (CONSENSUS, CLOSED_FORM)
AGREES = "agrees"
DISAGREES = "disagrees"
INSIDE = "inside"
OUTSIDE = "outside"
ALONE = "alone"
NO_PART = "takes no part"
UNNAMED = "no cause is named"


@dataclass(frozen=True)
class Contribution:
    """One engine on one series: author, version, its part, and why; part : one of the six words above.

    outside : share of samples outside the consensus [-], None where there is none
    """

    engine: str
    author: str
    version: str
    part: str
    reason: str = ""
    outside: float | None = None


@dataclass(frozen=True)
class SeriesConsensus:
    """Consensus on one series: its status, its interval [unit] where there is one, and all engines that gave it.

    size : largest magnitude of the quantity [unit]; sole : what the reference gave, or the first engine
    cause : of a disagreement
    """

    name: str
    unit: str
    status: str
    size: float
    voices: tuple[Contribution, ...]
    interval: Interval | None = None
    sole: Series | None = None
    cause: str = ""

    @property
    def quantity(self) -> str:
        """Return the part of the name before the first slash."""
        return self.name.split("/", 1)[0]


@dataclass(frozen=True)
class CaseConsensus:
    """Consensus on a case: what is asked for and given, by series."""

    task: Task
    series: tuple[SeriesConsensus, ...]
    records: Mapping[str, Record] = field(default_factory=dict)

    @property
    def status(self) -> str:
        """Return the status of a case: that of all its torques, which every answer has to give.

        A case has reached consensus where every torque has; one torque without makes it a disagreement, or single.
        """
        found = [one.status for one in self.series if one.quantity in WHOLE]
        for status in (DISAGREEMENT, SINGLE, CONSENSUS, CLOSED_FORM):
            if status in found:
                return status
        return SINGLE

    @property
    def whole(self) -> bool:
        """Return True if every series that is asked for has reached consensus, torques and all others."""
        return bool(self.series) and all(one.status in REACHED for one in self.series)


@dataclass(frozen=True)
class EnginePanel:
    """Engines of a corpus with their authors, and the results of the run that asked them.

    authors_of_loops : where a mechanism has closures, whose text several engines share
    """

    engines: Mapping[str, Engine]
    authors: Mapping[str, Author]
    authors_of_loops: Mapping[str, Author]
    results: Results

    def judge_loops(self) -> EnginePanel:
        """Return the panel as it judges mechanisms with closures."""
        return replace(self, authors=self.authors_of_loops)


def find_case_consensus(task: Task, records: Mapping[str, Record], panel: EnginePanel) -> CaseConsensus:
    """Return the consensus on a case from the records of its engines [units of the series]."""
    given = {name: record for name, record in records.items() if record.status == "ok"}
    size = compute_largest_magnitudes(
        {n: (s.unit, s.values) for n, s in record.series.items()} for record in given.values()
    )
    made = [
        _find_series_consensus(task, name, given, size, panel) for name in list_compared_series(task, given.values())
    ]
    return CaseConsensus(task, tuple(made), given)


def list_compared_series(task: Task, records: Iterable[Record]) -> list[str]:
    """Return the names of the series that are compared and that some engine gives; efforts of idle joints [-] are not."""
    wanted = [q for q in COMPARED if q in task.case.quantities]
    still = {f"torque/{name}" for name in list_idle_velocities(task.mechanism, task.case)}
    names = dict.fromkeys(n for record in records for n in record.series if n not in still)
    return [n for q in wanted for n in names if n.split("/", 1)[0] == q]


def _find_series_consensus(
    task: Task, name: str, given: Mapping[str, Record], size: Mapping[tuple[str, str], float], panel: EnginePanel
) -> SeriesConsensus:
    """Return the consensus on one series."""
    have = {engine: record for engine, record in sorted(given.items()) if name in record.series}
    unit = next(iter(have.values())).series[name].unit
    have = {engine: record for engine, record in have.items() if record.series[name].unit == unit}
    scale = size[name.split("/", 1)[0], unit]
    hindered = {e: _describe_hindrance(task, name, r, scale, panel) for e, r in have.items()}
    takes = [_make_contribution(e, r.series[name], panel) for e, r in have.items() if not hindered[e]]
    consensus = _find_consensus(takes, scale, panel)
    voices = tuple(_make_voice(task, have[e].series[name], have[e], hindered[e], consensus, panel) for e in have)
    sole = next(have[e].series[name] for e in (REFERENCE, *have) if e in have)
    cause = "" if consensus.status != DISAGREEMENT else "; ".join(f"{v.engine}: {v.reason}" for v in voices if v.reason)
    return SeriesConsensus(
        name, unit, consensus.status, scale, voices, consensus.interval, sole, cause or consensus.cause
    )


@dataclass(frozen=True)
class SeriesAgreement:
    """Status of a series, its interval [unit] where there is one, the engines that agree on it, and why there is none."""

    status: str
    interval: Interval | None = None
    agree: frozenset[str] = frozenset()
    cause: str = ""


def _find_consensus(takes: Sequence[EngineValues], size: float, panel: EnginePanel) -> SeriesAgreement:
    """Return the consensus of engines with bars, or why there is none; size : largest magnitude of the quantity [unit]."""
    exact = next((one for one in takes if panel.authors[one.engine].closed_form), None)
    if exact is not None:
        where = make_interval(exact, size)
        inside = (one for one in takes if has_common_point(make_interval(one, size), where))
        return SeriesAgreement(CLOSED_FORM, where, _list_engines(inside))
    if len(collect_authors(takes)) < 2:
        return SeriesAgreement(SINGLE)
    groups = find_agreeing_groups(takes, size)
    if not groups:
        return SeriesAgreement(DISAGREEMENT, cause="no two authors meet at every sample")
    if len({collect_authors(group) for group in groups}) > 1:
        words = " or ".join(" and ".join(one.engine for one in group) for group in groups)
        return SeriesAgreement(DISAGREEMENT, cause=f"{words} agree, and nobody tells which")
    met = [compute_intersection([make_interval(one, size) for one in group]) for group in groups]
    return SeriesAgreement(CONSENSUS, compute_hull(met), _list_engines(chain.from_iterable(groups)))


def _list_engines(takes: Iterable[EngineValues]) -> frozenset[str]:
    return frozenset(one.engine for one in takes)


def _make_contribution(engine: str, one: Series, panel: EnginePanel) -> EngineValues:
    bar = np.zeros_like(one.values) if one.error is None else one.error
    return EngineValues(engine, panel.authors[engine].name, one.values, bar)


def _describe_hindrance(task: Task, name: str, record: Record, size: float, panel: EnginePanel) -> str:
    """Return the reason for which a bar takes no part, "" where it does; size : of the quantity [unit]."""
    one = record.series[name]
    if lines := describe_failing_lines(panel.results, task.folder.name, task.case.name, record.engine):
        return f"its certificate does not hold: {lines}"
    if panel.engines[record.engine].native:
        return record.message or "its own result, which is known to differ"
    if one.error is None:
        return "" if panel.authors[record.engine].closed_form else "it gives no error bar"
    if not is_checked(record.budget, name):
        return "it states its error bar by itself, and no refinement that was asked for shows it"
    if has_no_order(record.budget.get(name, {})):
        return "its refinement has no order, so that its bar is none"
    widest = float(one.error.max())
    span = compute_signal_range([one.values])
    if widest > max(WIDEST_BAR * span, FLOOR * size):
        return f"its bar is wider than {WIDEST_BAR:g} of the range"
    return ""


def _make_voice(
    task: Task, one: Series, record: Record, hindrance: str, found: SeriesAgreement, panel: EnginePanel
) -> Contribution:
    """Return the part of an engine in what was found on a series."""
    who = record.engine, panel.authors[record.engine].name, record.version
    if found.interval is None:
        why_not = _find_cause(task, one, record, panel) if found.status == DISAGREEMENT else ""
        return Contribution(*who, part=NO_PART if hindrance else ALONE, reason=hindrance or why_not)
    off = 1.0 - float(find_samples_inside(one.values, found.interval).mean())
    if record.engine in found.agree:
        return Contribution(*who, part=AGREES, outside=off)
    if hindrance:
        reason = (
            hindrance if off == 0.0 else "; ".join(filter(None, [hindrance, _find_cause(task, one, record, panel)]))
        )
        return Contribution(*who, part=INSIDE if off == 0.0 else OUTSIDE, reason=reason, outside=off)
    return Contribution(*who, part=DISAGREES, reason=_find_cause(task, one, record, panel) or UNNAMED, outside=off)


def _find_cause(task: Task, one: Series, record: Record, panel: EnginePanel) -> str:
    """Return the cause of an engine's difference in a series, as diagnosis or verdict name it; "" where nothing does."""
    here = task.folder.name, task.case.name, record.engine
    diagnosis = find_diagnosis(panel.results, *here)
    if diagnosis is not None and diagnosis.named:
        return describe_diagnosis(diagnosis)
    rows = [
        row
        for row in panel.results.comparisons
        if (row.mechanism, row.case, row.engine) == here and (row.quantity, row.unit) == (one.quantity, one.unit)
    ]
    named = [row.reason if row.verdict in ("within", "explained") else row.message for row in rows]
    return "; ".join(dict.fromkeys(words for words in named if words))
