"""Repair of a cause by full runs: what it leaves decides whether the cause stays named.

The columns of a fit come from a model of fewer samples and longer steps.  Here the cause is put into the reference and taken
out of the engine, each with the step of the case.  What a run with the cause still leaves corrects the cause's size, by the
model's derivative: where the model is wrong by a part e, each round leaves about e of what was left before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosscheck.causes.fit import IMPOSSIBLE, Fit, fit_to_remainder
from crosscheck.causes.model import Model, apply_to_record
from crosscheck.causes.subject import Subject
from crosscheck.engines import ENGINES, adapter
from crosscheck.engines.base import Adapter, is_repeatable
from crosscheck.measures.record import Record
from flexinv.typing import Array

# Of corrections of a size: the model's long steps are wrong by a few per cent, and a square of that is below most bars.
ROUNDS = 2


@dataclass(frozen=True)
class Repair:
    """A cause as full runs know it.

    fit : with the size that leaves least; left : the largest difference over the range that it leaves [-], None where no
    run with it could be made; where : which side was changed
    """

    fit: Fit
    left: float | None = None
    where: str = ""

    @property
    def most(self) -> float:
        """Largest difference left over the range [-], infinite where no run could be made."""
        return np.inf if self.left is None else self.left

    def is_sufficient(self, enough: float) -> bool:
        """Return True if nothing beyond ``enough`` [-] is left, or nothing could be run."""
        return self.left is None or self.left <= enough


def apply_repair(
    model: Model,
    fit: Fit,
    engine: str,
    reference: Record,
    record: Record,
    door: Adapter | None = None,
    enough: float = 0.0,
) -> Repair:
    """Return the cause with what is left after it is put into the reference, or taken out of the engine.

    door : the engine's adapter, None for one of ours; a record, which cannot be run again, is repaired in the reference alone
    enough : largest difference [-] that is looked at no further
    """
    # Only the amplitude of a linear cause's effect is known: no run has it.
    if fit.cause.linear:
        return Repair(fit)
    put_in = add_to_reference(model, fit, record, enough)
    taken_out = take_out(model, put_in.fit, engine, reference, door)
    return taken_out if taken_out.most < put_in.most else put_in


def add_to_reference(model: Model, fit: Fit, record: Record, enough: float) -> Repair:
    """Return the repair of the reference: the cause is put in, its size corrected by the remainders of full runs."""
    best = Repair(fit)
    for _ in range(1 + ROUNDS):
        remainder = _compute_remainder(model, fit, record)
        if remainder is None:
            break
        repair = Repair(fit, _find_largest(remainder), "put into the reference")
        if repair.most >= best.most:
            break
        best = repair
        if best.is_sufficient(enough) or not fit.cause.sized or fit.cause.guess is not None:
            break
        better = fit_to_remainder(model, fit, remainder)
        if better is None:
            break
        fit = better
    return best


def take_out(model: Model, fit: Fit, engine: str, reference: Record, door: Adapter | None) -> Repair:
    """Return the repair of the engine: its run with the opposite of the cause, where that is a mechanism that it runs."""
    again = door is None or is_repeatable(door)
    if not again or not fit.cause.sized or fit.cause.plant is not None:
        return Repair(fit)
    opposite = _apply_cause(fit, model, -fit.size)  # of a factor of 5.7 none: a fraction of -4.7 leaves nothing
    healed = None if opposite is None else _run(engine, opposite, door)
    if healed is None:
        return Repair(fit)
    largest = _find_largest(model.compute_residual(healed, reference))
    return Repair(fit, largest, f"taken out of {engine}") if np.isfinite(largest) else Repair(fit)


def _compute_remainder(model: Model, fit: Fit, record: Record) -> Array | None:
    """Return the difference of the engine from the reference with the cause (samples nv,) [-], None where there is none."""
    harmed = _apply_cause(fit, model, fit.size)
    other = None if harmed is None else _run("flexinv", harmed)
    if other is None:
        return None
    residual = model.compute_residual(record, other)
    return residual if np.isfinite(residual).all() else None


def _apply_cause(fit: Fit, model: Model, size: Array) -> Subject | None:
    """Return the mechanism with the cause of this size [its unit], None where there is no such mechanism."""
    try:
        return fit.cause.change(model.base, fit.target, size)
    except IMPOSSIBLE:
        return None


def _find_largest(left: Array) -> float:
    return float(np.abs(left).max())


def _run(engine: str, subject: Subject, door: Adapter | None = None) -> Record | None:
    """Return the full run of an engine on a changed subject, None where it cannot do it."""
    try:
        behind = door or adapter(ENGINES[engine])
        record = behind.run(subject.mechanism, subject.case, engine, {"error": False})
        # no filter looks ahead: it cannot be undone
        return apply_to_record(record, subject) if record.status == "ok" else None
    except (*IMPOSSIBLE, RuntimeError, KeyError):
        return None
