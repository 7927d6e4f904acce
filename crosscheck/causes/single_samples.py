"""Single samples that stand out where all others agree: outliers, dropouts, held values; no fit over all samples shows them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosscheck.causes.cause import Cause
from crosscheck.causes.evidence import EFFORTS, Evidence
from crosscheck.causes.fit import Fit
from crosscheck.causes.naming import NamedCauses
from crosscheck.causes.subject import Subject
from crosscheck.measures.record import Record, list_effort_units
from flexinv.typing import Array, Indices, Mask

NAME = "single samples"
FEW = 0.05  # of the samples of a joint: more are no single ones
# Times the largest difference of all other samples: what changes slowly from sample to sample leaves no such gap.
GAP = 3.0
ZERO = "are zero"
HELD = "repeat the sample before"
OUT = "stand out"
OF_ONE = {ZERO: "is zero", HELD: "repeats the one before", OUT: "stands out"}


@dataclass(frozen=True)
class SingleSamples:
    """Samples of one coordinate that differ: their numbers, and by how much [N m] or [N].

    name : of the coordinate; unit : of its effort; values, expected : (samples,) of the engine and of the reference
    """

    name: str
    unit: str
    rows: Indices
    time: Array
    values: Array
    expected: Array

    @property
    def kind(self) -> str:
        """Sort of the samples: ZERO, HELD or OUT."""
        given = self.values[self.rows]
        if not given.any():
            return ZERO
        before = self.values[np.maximum(self.rows - 1, 0)]
        return HELD if self.rows[0] > 0 and np.array_equal(given, before) else OUT

    def describe(self) -> str:
        """Return the samples in words."""
        first = int(self.rows[0])
        off = self.values[first] - self.expected[first]
        instant = f"t = {self.time[first]:.6g} s by {off:.3g} {self.unit}"
        if len(self.rows) == 1:
            return f"1 sample of {len(self.values)} of the effort of {self.name} {OF_ONE[self.kind]}, at {instant}"
        some = f"{len(self.rows)} samples of {len(self.values)} of the effort of {self.name}"
        return f"{some} {self.kind}, the first at {instant}"


def find_single_samples(evidence: Evidence, record: Record, reference: Record, allowed: Array) -> NamedCauses | None:
    """Return the naming of single samples, None where more differs than they do.

    allowed : (nv,) largest difference over the range [-] of samples that agree
    """
    if evidence.shows_elsewhere:
        return None
    mechanism = evidence.model.base.mechanism
    given, expected = (
        np.array([one.series[f"{EFFORTS}/{name}"].values for name in mechanism.velocity_names]).T
        for one in (record, reference)
    )
    apart = np.abs(given - expected) / evidence.model.scale
    beyond = apart > allowed
    if not beyond.any() or not all(map(_is_explained_by_few, apart.T, beyond.T)):
        return None
    units = list_effort_units(mechanism)
    found = [
        SingleSamples(name, units[k], np.flatnonzero(beyond[:, k]), record.time, given[:, k], expected[:, k])
        for k, name in enumerate(mechanism.velocity_names)
        if beyond[:, k].any()
    ]
    rows = evidence.model.rows
    column = np.where(beyond[rows], (given - expected)[rows] / evidence.model.scale, 0.0).ravel()
    fit = Fit(_make_cause(found), ", ".join(one.name for one in found), np.array([float(beyond.sum())]), 0.0, column)
    return NamedCauses((fit,), None, float(apart.max()), float(allowed.max()), "")


def _is_explained_by_few(apart: Array, beyond: Mask) -> bool:
    """Return True if the samples of one coordinate that differ are few, and all others differ by much less."""
    count = int(beyond.sum())
    if count == 0:
        return True
    rest = float(apart[~beyond].max(initial=0.0))
    return count <= max(1, int(FEW * len(apart))) and float(apart[beyond].min()) > GAP * rest


def _make_cause(found: list[SingleSamples]) -> Cause:
    """Return the samples as a cause: it is known by its effect alone, no run has it."""
    text = "; ".join(one.describe() for one in found) + "; all other samples agree"

    def apply_nothing(subject: Subject, target: str, size: Array) -> Subject:
        return subject

    words = text.replace("{", "{{").replace("}", "}}")
    return Cause(NAME, words, apply_nothing, linear=True, shows="the same motion again")
