"""Diagnosis of an engine that deviates, in a child process: the cause, its share, and the rest once it is repaired."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.causes.dictionary import all_causes
from crosscheck.causes.evidence import Evidence
from crosscheck.causes.fit import IMPOSSIBLE, Columns, Fit, amount
from crosscheck.causes.model import Model, answered, model_of
from crosscheck.causes.naming import MOST, NOISE, Naming, name, named_beside
from crosscheck.causes.quantities import quantities
from crosscheck.causes.separate import separating
from crosscheck.causes.subject import Array, Subject
from crosscheck.engines import ENGINES, adapter, opened
from crosscheck.engines.base import Adapter, repeatable
from crosscheck.measures.certificate import certificate
from crosscheck.measures.limits import find
from crosscheck.measures.mechanisms import read_mechanism
from crosscheck.measures.record import Record, load
from crosscheck.verdicts.bars import checked_bar
from flexinv.files.load_cases import load_cases

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
    naming: Naming
    shown: bool
    limit: float


def diagnose(
    folder: str,
    case: str,
    engine: str,
    ours: str,
    theirs: str,
    door: Mapping[str, Any] | None = None,
    columns: Columns | None = None,
) -> dict[str, Any]:
    """Return the diagnosis of two saved records (stems of their files) of a case [-] as JSON values.

    door : where the engine's adapter is (`crosscheck.engines.opened`), None for one of ours
    columns : those of the diagnosis before, where several are asked for in one process
    """
    found = named(folder, case, ours, theirs, columns)
    model, naming, fits = found.model, found.naming, found.naming.named
    behind = None if door is None else opened({**door, "engine": engine, "mechanism": folder})
    repaired, where = None, ""
    if fits and found.shown:
        repaired, where = repair(model, fits[0], engine, found.reference, found.record, behind)
    return {
        "words": sentence(naming, fits, repaired, where, max(found.limit, NOISE * naming.noise)),
        "named": [described(f) for f in fits],
        "separate": separating(model, fits) if len({f.cause.name for f in fits}) > 1 else "",
        "difference": naming.size,
        "noise": naming.noise,
        "repaired": repaired,
        "where": where,
    }


def named(folder: str, case: str, ours: str, theirs: str, columns: Columns | None = None) -> Answer:
    """Return the naming by two saved records (stems of their files) of a case [-]; no engine is run."""
    mechanism = read_mechanism(folder)
    subject = Subject(mechanism, load_cases(folder, mechanism)[case])
    record, reference = load(Path(ours)), load(Path(theirs))
    model = model_of(subject, reference)
    residual = model.residual(record, reference)
    evidence = Evidence(
        model,
        residual,
        certificate(record.certificate),
        certificate(reference.certificate),
        quantities(model, record, reference),
    )
    bars, limit = noise_of(model, record, reference), agreed(model, record, reference)
    known = None if columns is None else columns.of(model, all_causes())
    naming = name(model, residual, bars, known, evidence, limit)
    shown = naming.found
    naming = naming if shown else named_beside(evidence, naming)
    return Answer(model, record, reference, naming, shown, limit)


def noise_of(model: Model, *records: Record) -> Array:
    """Return the checked error bars of the records added up, per coordinate the largest, over the range, (samples nv,) [-]."""
    total = np.zeros(model.torque.shape)
    for record in records:
        for k, coordinate in enumerate(model.base.mechanism.velocity_names):
            total[:, k] += checked_bar(record, f"torque/{coordinate}") or 0.0
    return np.maximum(model.weighted(total), ROUNDING)


def agreed(model: Model, record: Record, reference: Record) -> float:
    """Return the largest difference of efforts [-] that a limit allows the two engines, 0 where none is stated."""
    limit = find(model.base.case.limits, "torque", record.engine, reference.engine, record.version)
    return 0.0 if limit is None else limit.maximum


def repair(
    model: Model, fit: Fit, engine: str, reference: Record, record: Record, door: Adapter | None = None
) -> tuple[float | None, str]:
    """Return the largest difference left [-] after the cause is taken out of the engine, or put into the reference.

    door : the engine's adapter, None for one of ours; a record, which cannot be run again, is repaired in the reference alone
    """
    cause, tries = fit.cause, []
    again = door is None or repeatable(door)
    if again and cause.sized and not cause.linear and cause.plant is None:
        opposite = _changed(fit, model, -fit.size)  # of a factor of 5.7 none: a fraction of -4.7 leaves nothing
        healed = None if opposite is None else _run(engine, opposite, door)
        tries.append((None if healed is None else _largest(model, healed, reference), f"taken out of {engine}"))
    harmed = _changed(fit, model, fit.size)
    if harmed is not None and not cause.linear:
        other = _run("flexinv", harmed)
        tries.append((None if other is None else _largest(model, record, other), "put into the reference"))
    done = [(size, words) for size, words in tries if size is not None and np.isfinite(size)]
    return min(done, default=(None, ""), key=lambda one: one[0])


def _changed(fit: Fit, model: Model, size: Array) -> Subject | None:
    """Return the mechanism with the cause of this size [its unit], None where there is no such mechanism."""
    try:
        return fit.cause.change(model.base, fit.target, size)
    except IMPOSSIBLE:
        return None


def _largest(model: Model, a: Record, b: Record) -> float:
    return float(np.abs(model.residual(a, b)).max())


def _run(engine: str, subject: Subject, door: Adapter | None = None) -> Record | None:
    """Return the full run of an engine on a changed subject, None where it cannot do it."""
    try:
        behind = door or adapter(ENGINES[engine])
        record = behind.run(subject.mechanism, subject.case, engine, {"error": False})
        # no filter looks ahead: it cannot be undone
        return answered(record, subject) if record.status == "ok" else None
    except (*IMPOSSIBLE, RuntimeError, KeyError):
        return None


def described(fit: Fit) -> dict[str, Any]:
    """Return one cause for the report: name, target, the sentence with its size [unit], what it leaves [-]."""
    words = fit.cause.words.format(target=fit.target or "all", size=amount(fit.size, fit.cause.unit))
    return {"cause": fit.cause.name, "target": fit.target, "words": words, "left": fit.left, "shows": fit.cause.shows}


def sentence(naming: Naming, fits: tuple[Fit, ...], repaired: float | None, where: str, enough: float = np.inf) -> str:
    """Return the diagnosis in a sentence or two; enough : what may remain after the repair [-] of one cause alone."""
    fails = f" Lines of its certificate that fail: {', '.join(naming.failing)}." if naming.failing else ""
    if not fits:
        return f"{naming.words}.{fails}"
    best = fits[0]
    text = best.cause.words.format(target=best.target or "all", size=amount(best.size, best.cause.unit))
    text += f": explains {_share(1 - best.left**2)} of the difference"
    if repaired is not None:
        text += f"; {where}, {repaired:.1e} of the range remains of {naming.size:.1e}"
        if repaired > enough:
            text += ", more than the error bars: something else differs as well"
    others = len(fits) - 1
    text += f". This motion cannot tell it from {others} other{'s' * (others > 1)}." if others else "."
    out = dict.fromkeys(
        f"{one.fit.cause.name} ({', '.join(one.against)})"
        for one in naming.ruled_out
        if one.fit.cause.name not in naming.names
    )
    told = list(out)[:MOST]
    return text + (f" Ruled out by what the engine says besides: {'; '.join(told)}." if told else "") + fails


def _share(part: float) -> str:
    """Return a part of the squares in per cent, never rounded up to all of it."""
    return f"{min(part, 0.9999):.2%}" if part > 0.99 else f"{part:.0%}"
