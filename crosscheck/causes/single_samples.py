"""Single samples that stand out where all others agree: outliers, dropouts, held values; no fit over all samples shows them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from crosscheck.causes.cause import Cause
from crosscheck.causes.dictionary import collect_causes
from crosscheck.causes.evidence import EFFORTS, Evidence
from crosscheck.causes.fit import Candidate, Fit, compute_effect, list_candidates
from crosscheck.causes.model import Model
from crosscheck.causes.naming import ROUNDED, NamedCauses, find_causes
from crosscheck.causes.pairs import AND
from crosscheck.causes.subject import Subject
from crosscheck.measures.record import Record, list_effort_units
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array, Indices, Mask

NAME = "single samples"
FEWEST = 20  # samples of which one may stand out
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


def find_sample_causes(
    naming: NamedCauses,
    evidence: Evidence,
    record: Record,
    reference: Record,
    bars: Array,
    agreed: float = 0.0,
    known: list[Candidate] | None = None,
) -> tuple[Model, NamedCauses]:
    """Return a naming with the model that it holds for: where it names nothing, that of single samples, alone or beside a cause.

    bars : error bars (samples nv,) over the range [-]; agreed, known : as of `find_causes`
    """
    model = evidence.model
    if naming.named:
        return model, naming
    given, expected = (_collect_efforts(one, model.base.mechanism) for one in (record, reference))
    allowed = np.maximum(bars.reshape(model.torque.shape)[0], agreed)
    differences = Differences(model, record.time, given, expected, allowed)
    if not evidence.shows_elsewhere and (alone := find_single_samples(differences)) is not None:
        return model, alone
    return find_causes_beside_samples(differences, naming, evidence, bars, agreed, known)


@dataclass(frozen=True)
class Differences:
    """Efforts of an engine and of a reference at all samples of a case, (samples, nv) [N m] or [N].

    allowed : (nv,) largest difference over the range [-] of samples that agree
    """

    model: Model
    time: Array
    given: Array
    expected: Array
    allowed: Array

    @property
    def apart(self) -> Array:
        """Differences without a sign over the range, (samples, nv) [-]."""
        return np.asarray(np.abs(self.given - self.expected) / self.model.scale)


def _collect_efforts(record: Record, mechanism: Mechanism) -> Array:
    return np.array([record.series[f"{EFFORTS}/{name}"].values for name in mechanism.velocity_names]).T


def find_single_samples(differences: Differences) -> NamedCauses | None:
    """Return the naming of single samples, None where more differs than they do."""
    apart = differences.apart
    found = list_single_samples(differences)
    if not found:
        return None
    model = differences.model
    difference = (differences.given - differences.expected) / model.scale
    beyond = apart > differences.allowed
    column = np.where(beyond, difference, 0.0)[model.rows].ravel()
    fit = Fit(_make_cause(found), ", ".join(one.name for one in found), np.array([float(beyond.sum())]), 0.0, column)
    return NamedCauses((fit,), None, float(apart.max()), float(differences.allowed.max()), "")


def list_single_samples(differences: Differences) -> list[SingleSamples]:
    """Return the samples that stand out, by coordinates; none where more differs than they do."""
    apart = differences.apart
    beyond = apart > differences.allowed
    if not all(map(_is_explained_by_few, apart.T, beyond.T)):
        return []
    mechanism = differences.model.base.mechanism
    units = list_effort_units(mechanism)
    return [
        SingleSamples(
            name,
            units[k],
            np.flatnonzero(beyond[:, k]),
            differences.time,
            differences.given[:, k],
            differences.expected[:, k],
        )
        for k, name in enumerate(mechanism.velocity_names)
        if beyond[:, k].any()
    ]


def find_causes_beside_samples(
    differences: Differences,
    naming: NamedCauses,
    evidence: Evidence,
    bars: Array,
    agreed: float,
    known: list[Candidate] | None,
) -> tuple[Model, NamedCauses]:
    """Return the causes that explain all but single samples, with the model that leaves out suspects; else what was given.

    The suspects are left out of the fit.  A cause that then explains the rest says which samples do stand out: they are to be
    few, and by GAP times what it leaves of all others.  Of marches none is looked for: their columns take too long.
    """
    model = evidence.model
    suspects = find_suspects(differences)
    if not model.base.mechanism.is_rigid or not suspects[model.rows].any():
        return model, naming
    some = replace(model, seen=~suspects[model.rows])
    seen = np.asarray(some.seen).ravel()
    candidates = (
        list_candidates(some, collect_causes()) if known is None else [_drop_unseen(c, some, seen) for c in known]
    )
    others = evidence.quantities and replace(
        evidence.quantities,
        agreed={key: size for key, size in evidence.quantities.agreed.items() if not key.startswith(f"{EFFORTS}/")},
    )
    heard = replace(evidence, model=some, residual=evidence.residual * seen, quantities=others)
    found = find_causes(some, heard.residual, bars, candidates, heard, agreed)
    named = tuple(one for fit in found.named if (one := _join_samples(differences, fit)) is not None)
    return (some, replace(found, named=named, size=naming.size)) if named else (model, naming)


def _drop_unseen(one: Candidate, model: Model, seen: Mask) -> Candidate:
    """Return a candidate whose columns (samples nv, parameters) are zero where nothing is seen."""
    return replace(one, look=one.look * seen[:, None], model=model, far={})


def _join_samples(differences: Differences, fit: Fit) -> Fit | None:
    """Return a fit whose cause says the samples that stand out beside it; None where more than they differ."""
    whole = differences.model.whole
    effect = compute_effect(whole, fit.cause, fit.target, fit.size).reshape(whole.torque.shape)
    expected = differences.expected + effect * whole.scale
    # A fit stops where its steps are rounding.
    allowed = np.maximum(differences.allowed, ROUNDED * float(differences.apart.max()))
    found = list_single_samples(replace(differences, expected=expected, allowed=allowed))
    if not found:
        return None
    words = f"two at once: {fit.cause.words}; and {_format_braces(_describe_samples(found))}"
    return replace(fit, cause=replace(fit.cause, name=f"{fit.cause.name}{AND}{NAME}", words=words))


def find_suspects(differences: Differences) -> Mask:
    """Return the samples (samples, nv) that may stand out of a difference that is smooth: few of each coordinate, or none.

    They are zero or repeat the one before where the reference does not, and those farthest from the cubic through two neighbours
    on each side; none of a coordinate without a gap (GAP) between these and all others.
    """
    if len(differences.time) < FEWEST:
        return np.zeros(differences.given.shape, dtype=bool)
    changed = (
        np.abs(np.diff(differences.expected, axis=0, prepend=np.nan)) > differences.allowed * differences.model.scale
    )
    same = np.diff(differences.given, axis=0, prepend=np.nan) == 0.0
    off = (same & changed) | ((differences.given == 0.0) & (differences.apart > differences.allowed))
    rough = _compute_roughness((differences.given - differences.expected) / differences.model.scale)
    out = np.zeros(rough.shape, dtype=bool)
    for k, (stuck, size) in enumerate(zip(off.T, rough.T, strict=True)):
        chosen, rest = _take_roughest(stuck, size)
        if stuck.any() or size.max() > max(GAP * rest, float(differences.allowed[k])):
            out[chosen, k] = True
    return out


def _take_roughest(stuck: Mask, roughness: Array) -> tuple[Mask, float]:
    """Return the few samples (samples,) that are stuck or roughest, and the roughness of the rest; none where many are stuck.

    What is off by d makes its two neighbours on each side rough by up to 2/3 d: they do not count beside it.
    """
    most = count_few(len(stuck))
    chosen = stuck.copy()
    size = roughness.copy()
    if stuck.sum() > most:
        return np.zeros_like(stuck), np.inf
    places = [int(k) for k in np.flatnonzero(stuck)]
    for n in range(most):
        k = places[n] if n < len(places) else int(size.argmax())
        chosen[k] = True
        size[max(k - 2, 0) : k + 3] = 0.0
    return chosen, float(size.max())


def _compute_roughness(values: Array) -> Array:
    """Return the distance of each sample (samples, nv) from the cubic through two neighbours on each side [any unit].

    The first two and the last two have none.
    """
    near = values[1:-3] + values[3:-1]
    far = values[:-4] + values[4:]
    out = np.zeros(values.shape)
    out[2:-2] = np.abs(values[2:-2] - (4.0 * near - far) / 6.0)
    return out


def count_few(count: int) -> int:
    """Return the most samples of ``count`` that are single ones [-]."""
    return max(1, int(FEW * count))


def _is_explained_by_few(apart: Array, beyond: Mask) -> bool:
    """Return True if the samples of one coordinate that differ are few, and all others differ by much less."""
    count = int(beyond.sum())
    if count == 0:
        return True
    rest = float(apart[~beyond].max(initial=0.0))
    return count <= count_few(len(apart)) and float(apart[beyond].min()) > GAP * rest


def _make_cause(found: list[SingleSamples]) -> Cause:
    """Return the samples as a cause: it is known by its effect alone, no run has it."""

    def apply_nothing(subject: Subject, target: str, size: Array) -> Subject:
        return subject

    words = _format_braces(_describe_samples(found))
    return Cause(NAME, words, apply_nothing, linear=True, shows="the same motion again")


def _describe_samples(found: list[SingleSamples]) -> str:
    return "; ".join(one.describe() for one in found) + "; all other samples agree"


def _format_braces(text: str) -> str:
    """Return a text in which braces stand for themselves."""
    return text.replace("{", "{{").replace("}", "}}")
