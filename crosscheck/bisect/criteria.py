"""Criteria: which label an observation has, so that two releases with other labels differ.

exit        good with exit code 0, bad with any other
bounds      good where the number, or every value of the table, lies within them
same        like the first release that was asked for, or like another one: within a tolerance of its value
changed     like it to the last byte that is printed and written
verdict     good where the table is within the tolerance of one that is expected
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from crosscheck.bisect.observations import Observation
from crosscheck.bisect.search import Label
from crosscheck.report.words import format_short
from flexinv.typing import Array

Kind = Literal["exit", "bounds", "same", "changed", "verdict"]
GOOD = "good"
BAD = "bad"
# Of its scale: rounding of a compiler or a library is smaller, unless the motion makes it grow.
TOLERANCE = 1e-6
SMALLEST_SCALE = 1e-12  # of the largest column: a smaller one holds rounding


@dataclass
class Criterion:
    """A criterion with the values that it has met.

    bounds : lowest and highest value that are good; tolerance : of the scale of the first release's values [-]
    absolute : difference that never counts [any unit]
    columns : of the table that are compared, all without any
    references : name and observation of the first release of each label; expected : the table that a verdict holds others against
    """

    kind: Kind
    bounds: tuple[float, float] = (-np.inf, np.inf)
    tolerance: float = TOLERANCE
    absolute: float = 0.0
    columns: tuple[str, ...] = ()
    one_scale: bool = False
    references: list[tuple[str, Observation]] = field(default_factory=list)
    expected: Observation | None = None

    def find_label(self, release: str, observation: Observation) -> str | None:
        """Return the label of an observation, None where it could not run."""
        if observation.reason:
            return None
        if self.kind == "exit":
            return GOOD if observation.code == 0 else BAD
        if self.kind == "bounds":
            return GOOD if self._is_within_bounds(observation) else BAD
        if self.expected is not None:
            return GOOD if self.compute_distance(observation, self.expected) <= self.tolerance else BAD
        for name, reference in self.references:
            if self.is_same(observation, reference):
                return name
        self.references.append((release, observation))
        return release

    def is_same(self, one: Observation, reference: Observation) -> bool:
        """Return True if an observation is like a reference."""
        if self.kind == "changed":
            return one.digest == reference.digest
        return self.compute_distance(one, reference) <= self.tolerance

    def compute_distance(self, one: Observation, reference: Observation) -> float:
        """Return the largest difference over the scale of the reference [-]; infinite where the tables have other forms."""
        if reference.number is not None:
            return _compute_number_distance(one.number, reference.number, self.absolute)
        names = list(self.columns or reference.names)
        if one.names != reference.names or one.table.shape != reference.table.shape:
            return float("inf")
        chosen = [reference.names.index(name) for name in names]
        return compute_table_distance(one.table[:, chosen], reference.table[:, chosen], self.one_scale, self.absolute)

    def _is_within_bounds(self, observation: Observation) -> bool:
        """Return True if the number, or every value of the chosen columns, lies within the bounds."""
        low, high = self.bounds
        if observation.number is not None:
            values = np.array([observation.number])
        else:
            chosen = [k for k, name in enumerate(observation.names) if name in self.columns or not self.columns]
            values = observation.table[:, chosen]
        return bool(((values >= low) & (values <= high)).all())

    def describe_label(self, label: Label | None) -> str:
        """Return a label in words: a release is the first of those that are like it."""
        if label is None:
            return "cannot run"
        return str(label) if label in (GOOD, BAD) else f"as {label}"

    def describe_value(self, observation: Observation) -> str:
        """Return the value of an observation, in a word or two."""
        if observation.reason:
            return f"cannot run: {observation.reason}"
        if observation.number is not None:
            return format_value(observation.number)
        if observation.names and self.expected is not None:
            return (
                f"{format_short(self.compute_distance(observation, self.expected))} of the range from what is expected"
            )
        if observation.names and self.references:
            name, reference = self.references[0]
            distance = self.compute_distance(observation, reference)
            return (
                f"{format_short(distance)} of the range from {name}"
                if np.isfinite(distance)
                else f"another table than {name}"
            )
        return (
            observation.last_words if observation.code and observation.last_words else f"exit code {observation.code}"
        )


def _compute_number_distance(one: float | None, reference: float, absolute: float) -> float:
    """Return the difference of two numbers over the size of the reference [-]; two that are no numbers are alike."""
    if one is None:
        return float("inf")
    if one == reference or abs(one - reference) <= absolute or (np.isnan(one) and np.isnan(reference)):
        return 0.0
    scale = abs(reference) or abs(one)
    distance = abs(one - reference) / scale
    return float(distance) if np.isfinite(distance) else float("inf")


def compute_table_distance(one: Array, reference: Array, one_scale: bool = False, absolute: float = 0.0) -> float:
    """Return the largest difference of two tables (rows, columns) over the range of its column of the reference [-].

    one_scale : all columns have one unit, and the largest range counts for each; absolute : what never counts [any unit]
    """
    with np.errstate(invalid="ignore"):
        difference = np.abs(one - reference)
    alike = (one == reference) | (difference <= absolute) | (np.isnan(one) & np.isnan(reference))
    difference[alike] = 0.0
    difference[np.isnan(difference)] = np.inf
    finite = np.where(np.isfinite(reference), reference, 0.0)
    scale = np.maximum(np.ptp(finite, axis=0), np.abs(finite).max(axis=0))  # (column,)
    largest = scale.max(initial=0.0)
    scale = np.full(len(scale), largest) if one_scale else np.maximum(scale, SMALLEST_SCALE * largest)
    worst = difference.max(axis=0, initial=0.0)
    shares = np.divide(worst, scale, out=np.where(worst > 0.0, np.inf, 0.0), where=scale > 0.0)
    return float(shares.max(initial=0.0))


def compute_scatter(criterion: Criterion, observations: Sequence[Observation]) -> float:
    """Return the largest distance of repeated runs from the first of them [-]."""
    first, *others = observations
    return max((criterion.compute_distance(one, first) for one in others), default=0.0)


def format_value(number: float) -> str:
    """Return a number with the digits that tell it from others."""
    return f"{number:.9g}"
