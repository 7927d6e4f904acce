"""The blessed night: the value of every comparison when somebody last looked and found it good.

Text files that belong into version control: ``metrics.csv``, one line per comparison in a fixed order; ``signals.csv``, one line
per series of every engine; ``provenance.json``, what these depended on; and ``blessed.json``, when, why and with which versions.
A comparison that has become worse than its blessed value by more than noise is a deviation, even inside its limit; so is a value
of an engine that has moved by more than error bars, however well all engines agree.  ``crosscheck bless`` is the only thing that
writes here.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TypedDict

from crosscheck import output_folder as owned
from crosscheck.engines import ENGINES
from crosscheck.measures.record import read_record
from crosscheck.verdicts.bars import COARSE
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.provenance import (
    Provenance,
    collect_provenance,
    join_provenance,
    read_provenance,
    write_provenance,
)
from crosscheck.verdicts.results import BlessedNight, Results
from crosscheck.verdicts.scope import Scope
from crosscheck.verdicts.signals import Key as SignalKey
from crosscheck.verdicts.signals import Move, Signal, describe_signals, find_moves, read_signals, write_signals

METRICS = "metrics.csv"
BLESSED = "blessed.json"
HEAD = ("mechanism", "case", "engine", "reference", "quantity", "unit", "fraction")
HOW = 'crosscheck bless --reason "..."'
UNBLESSED = "there is no blessed value for it yet"
Key = tuple[str, ...]
NO_SIGNALS: Mapping[SignalKey, Signal] = MappingProxyType({})

# Noise: how much worse a comparison may be on another machine or on another day without anything having changed.
# Numbers come from the same releases and the same steps, so only last digits differ (other SIMD widths, other BLAS
# kernels, another libm), and where Newton stops by one iteration more or less.
# * What discretisation leaves does not care: two per cent of the blessed value cover a Newton iteration more.
# * A hundredth of the limit is below what anybody who stated the limit could mean, and covers values that are near zero
#   by accident.
# * A limit below 1e-8 of the range is a limit of rounding.  There the value itself is a sum of last digits, which
#   another order of additions multiplies by any small number.  The values of this project are below 1/150 of such limits:
#   a tenth leaves them a factor of 15, and still tells when digits get lost.
# * What an engine iterates until its own tolerance is reached may be as far off as it repeats to on another processor
#   (`engines.Engine.repeats`), up to a tenth of the limit.
# * What an engine makes of the last digits of its input (redundant constraints and 1 / h^2 enlarge 1e-16) is measured where a
#   comparison seems worse: the engine runs again with these digits moved (`repeatability.scattered`).
SHARE_OF_BLESSED = 0.02
SHARE_OF_LIMIT = 0.01
ROUNDING_LIMIT = 1e-8
SHARE_OF_ROUNDING = 0.1


class BlessedFile(TypedDict):
    """JSON of ``blessed.json``: why and when a night was blessed, and the versions of its packages."""

    reason: str
    date: str
    versions: Mapping[str, str]


class BaselineError(ValueError):
    """A baseline that is missing or cannot be read; the message says what to do."""


@dataclass(frozen=True)
class Baseline:
    """Blessed errors over the range of the signal [-] by comparison, signals, and how they came to be blessed."""

    fractions: Mapping[Key, float] = field(default_factory=dict)
    reason: str = ""
    date: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    signals: Mapping[SignalKey, Signal] = field(default_factory=dict)
    provenance: Provenance = field(default_factory=Provenance)


def make_comparison_key(row: Comparison) -> Key:
    """Return the key of a comparison."""
    return row.mechanism, row.case, row.engine, row.reference, row.quantity, row.unit


def find(folder: Path) -> Baseline:
    """Return the baseline in a folder; where there is none, one without values: every comparison says how to bless.

    Raises BaselineError where there is one that cannot be read.
    """
    return read(folder) if any((folder / name).exists() for name in (METRICS, BLESSED)) else Baseline()


def read(folder: Path) -> Baseline:
    """Read a baseline.  Raises BaselineError where there is none, or where it is damaged."""
    try:
        lines = list(csv.reader(io.StringIO((folder / METRICS).read_text(encoding="utf-8"))))
        words = json.loads((folder / BLESSED).read_text(encoding="utf-8"))
        if not lines or tuple(lines[0]) != HEAD:
            raise ValueError(f"{METRICS} has other columns than {', '.join(HEAD)}")
        fractions = {tuple(line[:-1]): _read_fraction(k, line) for k, line in enumerate(lines[1:], 2)}
        signals = read_signals(folder)
        provenance = read_provenance(folder)
        return Baseline(fractions, words["reason"], words["date"], words["versions"], signals, provenance)
    except FileNotFoundError:
        raise BaselineError(
            f"there is no blessed night in {folder}: look at the report of a whole run, and if it is good, {HOW}"
        ) from None
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise BaselineError(f"the baseline in {folder} cannot be read: {error}") from error


def _read_fraction(number: int, line: list[str]) -> float:
    """Return the blessed fraction in a line [-].  Raises ValueError where it is none."""
    if len(line) != len(HEAD):
        raise ValueError(f"{METRICS}, line {number} has {len(line)} columns, expected {len(HEAD)}")
    value = float(line[-1])
    if not 0.0 <= value < math.inf:
        raise ValueError(f"{METRICS}, line {number}: {line[-1]!r}, expected a finite part of the range, 0 or more")
    return value


def compute_allowed_excess(blessed: float, limit: float | None, repeats: float = 0.0) -> float:
    """Return the excess over its blessed value [-] that an error may have without having become worse [-].

    limit : as a fraction of the range [-], None where none is stated; repeats : as of `crosscheck.engines.Engine` [-]
    """
    allowed = limit or 0.0
    share = SHARE_OF_ROUNDING if allowed <= ROUNDING_LIMIT else SHARE_OF_LIMIT
    repeated = min(repeats, SHARE_OF_ROUNDING * allowed)
    return max(SHARE_OF_BLESSED * blessed, share * allowed, repeated)


def _compute_noise(row: Comparison, blessed: float) -> float:
    """The excess over its blessed value [-] that a comparison may have on another machine or on another day."""
    engine = ENGINES.get(row.engine)
    return compute_allowed_excess(blessed, row.limit, 0.0 if engine is None else engine.repeats)


def judge_by_baseline(row: Comparison, baseline: Baseline) -> Comparison:
    """Return a comparison with its blessed value; one that has become worse is a deviation."""
    share = row.fraction
    if share is None or not _is_judged(row):
        return row
    blessed = baseline.fractions.get(make_comparison_key(row))
    if blessed is None:
        words = f"{UNBLESSED}: {HOW}"
        return replace(row, verdict="unjudged", message=_join_messages(row.message, words))
    row = replace(row, blessed=blessed)
    slack = _compute_noise(row, blessed)
    if share <= blessed + slack:
        return row
    if share <= blessed + slack + (row.scatter or 0.0):
        scatter = f"the last digits of the input alone change it by {row.scatter:.1g}"
        words = f"{share:.3g} of the range, blessed are {blessed:.3g}: {scatter}"
        return replace(row, message=_join_messages(row.message, words))
    floor = "" if row.scatter is None else f", the last digits of the input change it by {row.scatter:.1g}"
    before = f"on {baseline.date[:10]} it was {blessed:.3g} (noise {slack:.1g}{floor})"
    words = f"worse than blessed: {share:.3g} of the range, {before}; mend the cause, or {HOW}"
    return replace(row, verdict="deviation", message=_join_messages(row.message, words))


def is_worse(row: Comparison, baseline: Baseline | None) -> bool:
    """Return True if a comparison is above its blessed value by more than noise [-]: the engine's scatter is to be measured."""
    blessed = None if baseline is None or not _is_judged(row) else baseline.fractions.get(make_comparison_key(row))
    return blessed is not None and row.fraction is not None and row.fraction > blessed + _compute_noise(row, blessed)


def _is_judged(row: Comparison) -> bool:
    return row.verdict in ("within", "explained") and row.limit is not None


def list_missing_keys(results: Results, baseline: Baseline, scope: Scope) -> list[Key]:
    """Return the blessed comparisons that were asked for and are not measured, without a failure that says why."""
    measured = {make_comparison_key(row) for row in results.comparisons if row.fraction is not None}
    unread = {case.mechanism for case in results.cases if case.problem}
    failed = {(run.mechanism, run.case, run.engine) for run in results.runs if run.verdict == "error"}
    missing = [k for k in baseline.fractions if k not in measured and scope.has_comparison(k)]
    return [k for k in missing if k[0] not in unread and not {k[:3], (*k[:2], k[3])} & failed]


def choose_blessable(results: Results) -> tuple[list[Comparison], list[str]]:
    """Return the comparisons that can be blessed, and why others cannot: what is beyond its limit, or failed."""
    good = []
    bad = []
    for row in results.comparisons:
        name = f"{row.mechanism}/{row.case} {row.engine} {row.quantity} [{row.unit}]"
        if row.verdict == "skipped":
            continue
        if row.fraction is None or row.limit is None or row.uncertified or row.message.startswith(COARSE):
            bad.append(f"{name}: {row.uncertified or row.message}")
        elif row.fraction <= row.limit or row.verdict == "explained" or "by discretisation" in row.message:
            good.append(row)
        else:
            bad.append(f"{name}: {row.fraction:.3g} of the range is beyond its limit of {row.limit:.3g}")
    return good, bad


def collect_signals(results: Results, out: Path) -> dict[SignalKey, Signal]:
    """Return the signals of a run's engines, from the series in the folder of its report.  Raises RecordError."""
    quantities = {(case.mechanism, case.case): case.quantities for case in results.cases}
    signals: dict[SignalKey, Signal] = {}
    for run in results.runs:
        if not run.series:
            continue
        record = read_record(out / run.series)
        described = describe_signals(record, quantities[run.mechanism, run.case])
        signals |= {(run.mechanism, run.case, run.engine, name): signal for name, signal in described.items()}
    return signals


def find_all_moves(results: Results, signals: Mapping[SignalKey, Signal], baseline: Baseline) -> tuple[Move, ...]:
    """Return the values that have moved since they were blessed, each with what else has changed, the largest first.

    signals : those of the run [units of the series]; what did not run, or failed, has not moved
    """
    answered = {(run.mechanism, run.case, run.engine) for run in results.runs if run.status == "ok"}
    now = collect_provenance(results)
    found = []
    for name, before in baseline.signals.items():
        if name[:3] not in answered:
            continue
        if (move := find_moves(name, before, signals.get(name))) is not None:
            found.append(replace(move, reason=now.describe_source_changes(baseline.provenance, *name[:3])))
    return tuple(sorted(found, key=lambda move: -math.inf if move.share is None else -move.share))


def choose_blessed_signals(
    results: Results, signals: Mapping[SignalKey, Signal], rows: Iterable[Comparison]
) -> dict[SignalKey, Signal]:
    """Return the signals that are blessed with comparisons: those of engines of which no comparison is refused."""
    good = {make_comparison_key(row) for row in rows}
    refused = {
        (row.mechanism, row.case, row.engine)
        for row in results.comparisons
        if row.fraction is not None and row.limit is not None and make_comparison_key(row) not in good
    }
    return {name: signal for name, signal in signals.items() if name[:3] not in refused}


def write(
    folder: Path,
    results: Results,
    rows: Iterable[Comparison],
    reason: str,
    signals: Mapping[SignalKey, Signal] = NO_SIGNALS,
) -> None:
    """Write the baseline.  Comparisons that the results do not contain keep the value that they have, unless the run missed
    them: blessing that run is agreeing that they are gone.

    signals : of the run [units of the series]; of an engine in a case they replace all that were blessed before
    What is blessed of comparisons are three digits: more would change with every run, and noise is larger.
    """
    rows = list(rows)
    before = find(folder)
    known = dict(before.fractions)
    lost = [tuple(k) for k in results.baseline.get("gone_keys", ())]
    for k in lost:
        known.pop(k, None)
    known |= {make_comparison_key(row): float(f"{row.fraction:.3g}") for row in rows if row.fraction is not None}
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(HEAD)
    table.writerows((*k, repr(value)) for k, value in sorted(known.items()))
    folder.mkdir(parents=True, exist_ok=True)
    words: BlessedFile = {
        "reason": reason,
        "date": results.started,
        "versions": dict(sorted(results.versions.items())),
    }
    replaced = {name[:3] for name in signals} | {k[:3] for k in lost}
    kept = {name: signal for name, signal in before.signals.items() if name[:3] not in replaced}
    provenance = join_provenance(before.provenance, collect_provenance(results))
    with owned.uninterrupted():
        owned.replace(folder / METRICS, text.getvalue())
        write_signals(folder, {**kept, **signals})
        write_provenance(folder, provenance)
        owned.replace(folder / BLESSED, json.dumps(words, indent=1) + "\n")


def apply(
    results: Results, baseline: Baseline, scope: Scope | None, signals: Mapping[SignalKey, Signal] = NO_SIGNALS
) -> Results:
    """Return the results judged against the baseline.

    scope : what was asked for, so that what of it is missing is gone; None of a run that has not come to its end
    signals : of the run [units of the series]
    """
    rows = tuple(judge_by_baseline(row, baseline) for row in results.comparisons)
    missing = list_missing_keys(results, baseline, scope) if scope is not None else []
    words: BlessedNight = {
        "reason": baseline.reason,
        "date": baseline.date,
        "versions": dict(baseline.versions),
        "gone": tuple(" ".join(k) for k in missing),
        "gone_keys": tuple(missing),
    }
    moves = find_all_moves(results, signals, baseline)
    return dataclasses.replace(results, comparisons=rows, baseline=words, moves=moves)


def _join_messages(*messages: str) -> str:
    return "; ".join(filter(None, messages))
