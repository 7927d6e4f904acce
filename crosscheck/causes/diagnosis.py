"""Diagnosis of an engine that deviates, in a child process: the cause, its share, and the rest once it is repaired."""

from __future__ import annotations

import traceback
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypedDict

import numpy as np

from crosscheck.causes.dictionary import collect_causes
from crosscheck.causes.evidence import Evidence
from crosscheck.causes.fit import Columns, Fit, describe_size
from crosscheck.causes.model import Model, make_model
from crosscheck.causes.naming import MOST, NOISE, ROUNDED, NamedCauses, find_causes
from crosscheck.causes.quantities import collect_quantities
from crosscheck.causes.quantity_causes import find_other_causes
from crosscheck.causes.repair import Repair, apply_repair
from crosscheck.causes.separate import find_separating_motion
from crosscheck.causes.single_samples import find_sample_causes
from crosscheck.causes.subject import Subject
from crosscheck.engines import Door, open_adapter
from crosscheck.engines.base import Adapter
from crosscheck.measures.certificate import build_certificate
from crosscheck.measures.limits import find
from crosscheck.measures.mechanisms import read_mechanism
from crosscheck.measures.record import Record, read_record
from crosscheck.verdicts.bars import find_checked_bar
from crosscheck.verdicts.results import DiagnosisQuestion, NamedCause
from flexinv.files.load_cases import load_cases
from flexinv.typing import Array

# Exact engines: rounding of some thousand operations, times the condition of loops, of the range.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Answer:
    """Naming of the difference of two records, with the model that it was found with.

    shown : whether the difference of the efforts is larger than the error bars; limit : what two engines are allowed [-]
    """

    model: Model
    record: Record
    reference: Record
    naming: NamedCauses
    shown: bool
    limit: float

    @property
    def enough(self) -> float:
        """Largest difference over the range [-] that an explanation may leave in full runs."""
        rounding = ROUNDED * self.naming.size if self.model.base.mechanism.is_rigid else 0.0
        return max(self.limit, NOISE * self.naming.noise, rounding)


class DiagnosisAnswer(TypedDict):
    """Answer of a child process: what a `crosscheck.verdicts.results.Diagnosis` says beside its place, differences [-]."""

    words: str
    named: list[NamedCause]
    separate: str
    difference: float
    noise: float
    repaired: float | None
    where: str


class DiagnosesAnswer(TypedDict):
    """Answer of a child process about several engines, in their order; None where a diagnosis has failed."""

    answers: list[DiagnosisAnswer | None]


def diagnose(
    folder: str,
    case: str,
    engine: str,
    ours: str,
    theirs: str,
    door: Door | None = None,
    columns: Columns | None = None,
) -> DiagnosisAnswer:
    """Return the diagnosis of two saved records (stems of their files) of a case [-] as JSON values.

    door : where the engine's adapter is (`crosscheck.engines.open_adapter`), None for one of ours
    columns : those of the diagnosis before, where several are asked for in one process
    """
    record_causes = find_record_causes(folder, case, ours, theirs, columns)
    naming = record_causes.naming
    settled = naming
    best = None
    if naming.named and record_causes.shown:
        behind = None if door is None else open_adapter(door, engine, folder)
        settled, best = check_by_full_runs(record_causes, engine, behind)
    fits = settled.named
    return {
        "words": describe_diagnosis(settled, best),
        "named": [describe_cause(f) for f in fits],
        "separate": find_separating_motion(record_causes.model, fits) if len({f.cause.name for f in fits}) > 1 else "",
        "difference": naming.size,
        "noise": naming.noise,
        "repaired": None if best is None else best.left,
        "where": "" if best is None else best.where,
    }


def make_diagnoses(asked: Iterable[DiagnosisQuestion]) -> DiagnosesAnswer:
    """Return the diagnoses of several engines in one case: ``answers`` in their order, None where one has failed.

    asked : what `diagnose` is called with, for each engine
    """
    columns = Columns()
    answers: list[DiagnosisAnswer | None] = []
    for options in asked:
        try:
            answers.append(diagnose(**options, columns=columns))
        except Exception:  # it is asked again alone, in a process that says what is wrong
            traceback.print_exc()
            answers.append(None)
    return {"answers": answers}


def check_by_full_runs(found: Answer, engine: str, door: Adapter | None) -> tuple[NamedCauses, Repair]:
    """Return the naming without the causes that full runs refute, and the repair of the first that is left.

    A cause that leaves more than enough in its own run does not explain the difference, whatever the model's columns
    say: where all are refuted, the cause is unknown.
    """
    naming = found.naming
    tried: list[Repair] = []
    for k, fit in enumerate(naming.named):
        one = apply_repair(found.model, fit, engine, found.reference, found.record, door, found.enough)
        if one.is_sufficient(found.enough):
            return replace(naming, named=(one.fit, *naming.named[k + 1 :])), one
        tried.append(one)
    best = min(tried, key=lambda one: one.most)
    return replace(naming, named=(), next=best.fit, words=describe_refutation(best, naming.size)), best


def describe_refutation(one: Repair, size: float) -> str:
    """Return the reason against a cause that explains a difference in the model, and not in full runs; size : of it [-]."""
    return (
        f"the cause is unknown: {one.fit.cause.name} would explain "
        f"{_format_share(1 - one.fit.residual**2)} of the difference, but "
        f"{one.where}, {one.left:.1e} of the range remains of {size:.1e}, more than the error bars"
    )


def find_record_causes(
    folder: str, case: str, engine_record: str, reference_record: str, columns: Columns | None = None
) -> Answer:
    """Return the naming by two saved records (stems of their files) of a case [-]; no engine is run."""
    mechanism = read_mechanism(folder)
    subject = Subject(mechanism, load_cases(folder, mechanism)[case])
    record = read_record(Path(engine_record))
    reference = read_record(Path(reference_record))
    model = make_model(subject, reference)
    residual = model.compute_residual(record, reference)
    evidence = Evidence(
        model,
        residual,
        build_certificate(record.certificate),
        build_certificate(reference.certificate),
        collect_quantities(model, record, reference),
    )
    bars = compute_noise(model, record, reference)
    limit = find_allowed_difference(model, record, reference)
    known = None if columns is None else columns.collect_candidates(model, collect_causes())
    naming = find_causes(model, residual, bars, known, evidence, limit)
    model, naming = find_sample_causes(naming, evidence, record, reference, bars, limit, known)
    shown = naming.found
    naming = naming if shown else find_other_causes(evidence, naming)
    return Answer(model, record, reference, naming, shown, limit)


def compute_noise(model: Model, *records: Record) -> Array:
    """Return the checked error bars of the records added up, per coordinate the largest, over the range, (samples nv,) [-]."""
    total = np.zeros(model.torque.shape)
    for record in records:
        for k, coordinate in enumerate(model.base.mechanism.velocity_names):
            total[:, k] += find_checked_bar(record, f"torque/{coordinate}") or 0.0
    return np.maximum(model.scale_efforts(total), ROUNDING)


def find_allowed_difference(model: Model, record: Record, reference: Record) -> float:
    """Return the largest difference of efforts [-] that a limit allows the two engines, 0 where none is stated."""
    limit = find(model.base.case.limits, "torque", record.engine, reference.engine, record.version)
    return 0.0 if limit is None else limit.maximum


def describe_cause(fit: Fit) -> NamedCause:
    """Return one cause for the report: name, target, the sentence with its size [unit], what it leaves [-]."""
    words = fit.cause.words.format(target=fit.target or "all", size=describe_size(fit.size, fit.cause.unit))
    return {
        "cause": fit.cause.name,
        "target": fit.target,
        "words": words,
        "left": fit.residual,
        "shows": fit.cause.shows,
    }


def describe_diagnosis(naming: NamedCauses, repaired: Repair | None = None) -> str:
    """Return the diagnosis in a sentence or two; repaired : what full runs with the first cause say of it."""
    fails = f" Lines of its certificate that fail: {', '.join(naming.failing)}." if naming.failing else ""
    fits = naming.named
    if not fits:
        return f"{naming.words}.{fails}"
    best = fits[0]
    text = best.cause.words.format(target=best.target or "all", size=describe_size(best.size, best.cause.unit))
    text += f": explains {_format_share(1 - best.residual**2)} of the difference"
    if repaired is not None and repaired.left is not None:
        text += f"; {repaired.where}, {repaired.left:.1e} of the range remains of {naming.size:.1e}"
    others = len(fits) - 1
    text += f". This motion cannot tell it from {others} other{'s' * (others > 1)}." if others else "."
    out = dict.fromkeys(
        f"{one.fit.cause.name} ({', '.join(one.against)})"
        for one in naming.ruled_out
        if one.fit.cause.name not in naming.names
    )
    told = list(out)[:MOST]
    return text + (f" Ruled out by what the engine says besides: {'; '.join(told)}." if told else "") + fails


def _format_share(part: float) -> str:
    """Return a part of the squares in per cent, never rounded up to all of it."""
    return f"{min(part, 0.9999):.2%}" if part > 0.99 else f"{part:.0%}"
