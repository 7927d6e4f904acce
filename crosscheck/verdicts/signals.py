"""Signals that were blessed: the values of every engine, not only differences between engines.

All engines follow a changed model, and no difference moves.  So each series that is compared is blessed as well: its peak, its
RMS, and values at samples that lie evenly over the time, with their error bars.  A value has moved where it is farther from the
blessed one than both error bars together; of an engine without bars, than a millionth of the range of the signal.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from crosscheck import output_folder as owned
from crosscheck.engines import ENGINES, ROUNDING
from crosscheck.measures.record import Record, Series
from crosscheck.verdicts.compare import COMPARED
from flexinv.typing import Array

FILE = "signals.csv"
SAMPLES = 16  # values of a series that are blessed
UNKNOWN_BAR = 1e-6  # of the range: an engine that states no bar is taken to repeat to that
EXACT = 17  # digits that tell any two doubles apart
HEAD = ("mechanism", "case", "engine", "series", "unit", "range", "peak", "rms", "bar", "values", "bars")
Key = tuple[str, str, str, str]  # mechanism, case, engine, series
Place = tuple[str, str, str]  # mechanism, case, engine


class SignalsError(ValueError):
    """Blessed signals that cannot be read; the message says where."""


@dataclass(frozen=True)
class Signal:
    """A series in few numbers, all in its unit.

    size : largest less smallest value, or the largest magnitude where that is more; peak : largest magnitude; bar : largest
    half-width of the error bar; values, bars : (SAMPLES,) at samples that lie evenly over the time
    """

    unit: str
    size: float
    peak: float
    rms: float
    bar: float
    values: Array
    bars: Array


@dataclass(frozen=True)
class Move:
    """A value of an engine that has moved since it was blessed by more than error bars.

    what : "peak", "RMS", "value", or "missing" where the series is not given any more; before, after : [unit]
    share, bar : the difference, and both error bars together, over the range of the signal [-]
    reason : what else has changed since, in words; "" where nothing that is known has
    """

    mechanism: str
    case: str
    engine: str
    series: str
    unit: str
    what: str
    before: float
    after: float | None
    share: float | None
    bar: float
    reason: str = ""

    @property
    def words(self) -> str:
        """Return the move in words."""
        where = f"{self.mechanism}/{self.case} {self.engine}: {self.series}"
        if self.after is None or self.share is None:
            return f"{where} was {self.before:.6g} {self.unit} and is not given any more"
        old, new = format_apart(self.before, self.after, 6)
        how_far = f"moved by {100.0 * self.share:.3g} % of the range, bars {self.bar:.1g}"
        return f"{where}, {self.what} {old} -> {new} {self.unit}: {how_far}"


def format_apart(before: float, after: float, fewest: int) -> tuple[str, str]:
    """Return two numbers with as many digits as tell them apart, with the fewest that are wanted where these are enough."""
    texts = f"{before:.{fewest}g}", f"{after:.{fewest}g}"
    for digits in range(fewest + 1, EXACT + 1):
        if texts[0] != texts[1] or before == after:
            break
        texts = f"{before:#.{digits}g}".rstrip("."), f"{after:#.{digits}g}".rstrip(".")
    return texts


def describe_signals(record: Record, quantities: Iterable[str]) -> dict[str, Signal]:
    """Return the signals of a record by name, those of quantities that are compared sample by sample.

    Bars are no smaller than what an engine repeats to, of the largest component of a quantity: a moment about an axis that
    nothing turns is rounding of those about the others.
    """
    engine = ENGINES.get(record.engine)
    repeats = ROUNDING if engine is None else engine.repeats
    wanted = [quantity for quantity in quantities if quantity in COMPARED]
    chosen = {name: one for name, one in record.series.items() if one.quantity in wanted}
    largest: dict[tuple[str, str], float] = {}
    for one in chosen.values():
        kind = one.quantity, one.unit
        largest[kind] = max(largest.get(kind, 0.0), float(np.abs(one.values).max(initial=0.0)))
    return {name: describe_series(one, repeats * largest[one.quantity, one.unit]) for name, one in chosen.items()}


def describe_series(series: Series, floor: float = 0.0) -> Signal:
    """Return a series in few numbers; floor : half-width of the smallest bar, beside rounding [unit of the series]."""
    values = series.values
    peak = float(np.abs(values).max())
    size = max(float(np.ptp(values)), peak)
    bars = np.full(values.shape, UNKNOWN_BAR * size) if series.error is None else series.error
    floored = np.maximum(bars, max(floor, ROUNDING * size))
    at = np.unique(np.linspace(0, values.size - 1, SAMPLES).round().astype(int))
    rms = float(np.sqrt(np.mean((values / (peak or 1.0)) ** 2)) * peak)
    return Signal(series.unit, size, peak, rms, float(floored.max()), values[at], floored[at])


def find_moves(key: Key, before: Signal, after: Signal | None, reason: str = "") -> Move | None:
    """Return the move of a signal that is the largest beside its bars, None where it lies within them [unit of the signal]."""
    if after is None or after.unit != before.unit:
        return Move(*key, before.unit, "missing", before.peak, None, None, 0.0, reason)
    numbers = [("peak", before.peak, after.peak, before.bar + after.bar)]
    numbers += [("RMS", before.rms, after.rms, before.bar + after.bar)]
    if before.values.shape == after.values.shape:
        bars = before.bars + after.bars
        numbers += [("value", *row) for row in zip(before.values, after.values, bars, strict=True)]
    size = max(before.size, after.size)
    what, old, new, bar = max(numbers, key=lambda row: abs(row[2] - row[1]) / row[3] if row[3] > 0.0 else 0.0)
    if abs(new - old) <= bar or size == 0.0:
        return None
    return Move(
        *key, before.unit, what, float(old), float(new), float(abs(new - old)) / size, float(bar) / size, reason
    )


def read_signals(folder: Path) -> dict[Key, Signal]:
    """Return the blessed signals of a folder; {} where there are none.  Raises SignalsError."""
    try:
        text = (folder / FILE).read_text(encoding="utf-8")
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise SignalsError(f"{folder / FILE} cannot be read: {error}") from error
    lines = list(csv.reader(io.StringIO(text)))
    if not lines or tuple(lines[0]) != HEAD:
        raise SignalsError(f"{folder / FILE} has other columns than {', '.join(HEAD)}")
    return dict(_read_line(folder / FILE, number, line) for number, line in enumerate(lines[1:], 2))


def _read_line(file: Path, number: int, line: list[str]) -> tuple[Key, Signal]:
    try:
        mechanism, case, engine, series, unit, *numbers, values, bars = line
        size, peak, rms, bar = (float(word) for word in numbers)
        rows = [np.array([float(word) for word in words.split()]) for words in (values, bars)]
        signal = Signal(unit, size, peak, rms, bar, *rows)
        if rows[0].shape != rows[1].shape or not all(map(math.isfinite, (size, peak, rms, bar, *rows[0], *rows[1]))):
            raise ValueError("expected finite numbers, as many bars as values")
    except ValueError as error:
        raise SignalsError(f"{file}, line {number}: {error}; bless a run again") from error
    return (mechanism, case, engine, series), signal


def write_signals(folder: Path, signals: Mapping[Key, Signal]) -> None:
    """Write signals as a table, one line each in a fixed order: values with ten digits, bars with three.  Raises OSError."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(HEAD)
    table.writerows(_list_lines(signals))
    owned.replace(folder / FILE, text.getvalue())


def _list_lines(signals: Mapping[Key, Signal]) -> Iterator[tuple[str, ...]]:
    for key, one in sorted(signals.items(), key=lambda item: item[0]):
        values = " ".join(f"{value:.10g}" for value in one.values)
        bars = " ".join(map(_format_bar, one.bars))
        numbers = (f"{one.size:.10g}", f"{one.peak:.10g}", f"{one.rms:.10g}", _format_bar(one.bar))
        yield (*key, one.unit, *numbers, values, bars)


def _format_bar(bar: float) -> str:
    """A bar with three digits, which may not make it shorter; one that has three already stays as it is."""
    nearest = f"{bar:.3g}"
    return nearest if float(nearest) >= bar else f"{1.005 * bar:.3g}"
