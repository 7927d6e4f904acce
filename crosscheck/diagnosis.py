"""Why an engine deviates, in a child process: the cause, how much it explains, and what remains once it is repaired."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.causes.apply import with_efforts
from crosscheck.causes.evidence import Evidence
from crosscheck.causes.fit import IMPOSSIBLE, Fit
from crosscheck.causes.model import Model, model_of
from crosscheck.causes.naming import Naming, name
from crosscheck.causes.separate import separating
from crosscheck.causes.subject import Array, Subject
from crosscheck.certificate import certificate
from crosscheck.engines import ENGINES, adapter
from crosscheck.record import Record, load
from flexinv.files.case import load_cases
from flexinv.files.mechanism_file import load_mechanism

# Exact engines: rounding of some thousand operations, times the condition of loops, of the range.
ROUNDING = 1e-9


def diagnose(folder: str, case: str, engine: str, ours: str, theirs: str) -> dict[str, Any]:
    """Return the diagnosis of two saved records (stems of their files) of a case [-] as JSON values."""
    mechanism = load_mechanism(folder)
    subject = Subject(mechanism, load_cases(folder, mechanism)[case])
    record, reference = load(Path(ours)), load(Path(theirs))
    model = model_of(subject, reference)
    residual = model.residual(record, reference)
    evidence = Evidence(model, residual, certificate(record.certificate), certificate(reference.certificate))
    naming = name(model, residual, noise_of(model, record, reference), evidence=evidence)
    fits = naming.named
    repaired, where = repair(model, fits[0], engine, reference, record) if fits else (None, "")
    return {
        "words": sentence(naming, fits, repaired, where),
        "named": [described(f) for f in fits],
        "separate": separating(model, fits) if len({f.cause.name for f in fits}) > 1 else "",
        "difference": naming.size,
        "noise": naming.noise,
        "repaired": repaired,
        "where": where,
    }


def noise_of(model: Model, *records: Record) -> Array:
    """Return the error bars of the records added up, per coordinate the largest, over the range, (samples nv,) [-]."""
    total = np.zeros(model.torque.shape)
    for record in records:
        for k, coordinate in enumerate(model.base.mechanism.velocity_names):
            bars = record.series[f"torque/{coordinate}"].error
            total[:, k] += 0.0 if bars is None else float(bars.max())
    return np.maximum(model.weighted(total), ROUNDING)


def repair(model: Model, fit: Fit, engine: str, reference: Record, record: Record) -> tuple[float | None, str]:
    """Return the largest difference left [-] after the cause is taken out of the engine, or put into the reference."""
    cause, tries = fit.cause, []
    if cause.sized and not cause.linear and cause.plant is None:
        opposite = _changed(fit, model, -fit.size)  # of a factor of 5.7 none: a fraction of -4.7 leaves nothing
        healed = None if opposite is None else _run(engine, opposite)
        tries.append((None if healed is None else _largest(model, healed, reference), f"taken out of {engine}"))
    harmed = _changed(fit, model, fit.size)
    if harmed is not None and harmed.effort and model.base.mechanism.closures:
        # The joints' motion is known to the model only.
        left = model.residual(record, reference) - model.difference(harmed)
        tries.append((float(np.abs(left).max()), "put into the reference"))
    elif harmed is not None and not cause.linear:
        other = _run("flexinv", harmed)
        tries.append((None if other is None else _largest(model, record, other), "put into the reference"))
    done = [(size, words) for size, words in tries if size is not None]
    return min(done, default=(None, ""), key=lambda one: one[0])


def _changed(fit: Fit, model: Model, size: Array) -> Subject | None:
    """Return the mechanism with the cause of this size [its unit], None where there is no such mechanism."""
    try:
        return fit.cause.change(model.base, fit.target, size)
    except IMPOSSIBLE:
        return None


def _largest(model: Model, a: Record, b: Record) -> float:
    return float(np.abs(model.residual(a, b)).max())


def _run(engine: str, subject: Subject) -> Record | None:
    """Return the full run of an engine on a changed subject, None where it cannot do it."""
    try:
        record = adapter(ENGINES[engine]).run(subject.mechanism, subject.case, engine, {"error": False})
    except (*IMPOSSIBLE, RuntimeError, KeyError):
        return None
    return with_efforts(record, subject) if record.status == "ok" else None


def described(fit: Fit) -> dict[str, Any]:
    """Return one cause for the report: name, target, the sentence with its size [unit], what it leaves [-]."""
    words = fit.cause.words.format(target=fit.target, size=amount(fit))
    return {"cause": fit.cause.name, "target": fit.target, "words": words, "left": fit.left, "shows": fit.cause.shows}


def amount(fit: Fit) -> str:
    """Return the size of a fit with its unit."""
    numbers = ", ".join(f"{x:.4g}" for x in fit.size)
    text = f"({numbers})" if len(fit.size) > 1 else numbers
    return f"{text} {fit.cause.unit}".strip()


def sentence(naming: Naming, fits: tuple[Fit, ...], repaired: float | None, where: str) -> str:
    """Return the diagnosis in a sentence or two."""
    if not fits:
        return f"{naming.words}."
    best = fits[0]
    text = best.cause.words.format(target=best.target, size=amount(best))
    text += f": explains {_share(1 - best.left**2)} of the difference"
    if repaired is not None:
        text += f"; {where}, {repaired:.1e} of the range remains of {naming.size:.1e}"
    others = len(fits) - 1
    text += f". This motion cannot tell it from {others} other{'s' * (others > 1)}." if others else "."
    out = list(dict.fromkeys(f.cause.name for f in naming.ruled_out if f.cause is not best.cause))
    return text + (f" What the engine's own model says of itself rules out: {', '.join(out)}." if out else "")


def _share(part: float) -> str:
    """Return a part of the squares in per cent, never rounded up to all of it."""
    return f"{min(part, 0.9999):.2%}" if part > 0.99 else f"{part:.0%}"
