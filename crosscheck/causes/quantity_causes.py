"""Causes that no effort shows: what is named where the efforts agree and another quantity does not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from crosscheck.causes.cause import Cause
from crosscheck.causes.dictionary import collect_causes
from crosscheck.causes.evidence import NOT_RUNNING, CauseAssessment, Evidence
from crosscheck.causes.fit import IMPOSSIBLE, Fit
from crosscheck.causes.model import Model
from crosscheck.causes.naming import MARCHED, NamedCauses, ResidualQuestion, choose_causes
from crosscheck.causes.quantities import Quantities

# What leaves more of the differences after a linear look is not refined; so many are, by whether the mechanism is rigid.
DISTANT = 0.7
REFINED = {True: 12, False: 6}


def find_other_causes(evidence: Evidence, before: NamedCauses) -> NamedCauses:
    """Return the naming of what other quantities than the efforts show; ``before`` where they agree or are not known.

    A base that stands elsewhere, a clamp that is turned, an axis that points the other way: the motor feels none of that, and
    still the mechanism is another one.  Every cause of the dictionary is fitted to all quantities at once, each over how far
    the engines may be apart in it, and has to agree with the certificate as well.
    """
    beside = evidence.quantities
    if beside is None or not (apart := beside.list_deviating_quantities()):
        return before
    difference = beside.compute_difference()
    residual_question = ResidualQuestion(evidence.model, difference, np.ones_like(difference))
    rigid = evidence.model.base.mechanism.is_rigid
    first = sorted(_fit_other_causes(evidence.model, beside), key=lambda one: one.residual)
    likely = [one for one in first if one.residual < DISTANT][: REFINED[rigid]]
    fits = sorted((_fit_closer(beside, one) for one in likely), key=lambda one: one.residual)
    heard = tuple(CauseAssessment(one, _list_contradictions(evidence, one, 0.0 if rigid else MARCHED)) for one in fits)
    causes = choose_causes(residual_question, fits, heard, evidence)
    words = causes.words.replace("the efforts", "the efforts and all else") if causes.words else ""
    return replace(causes, size=max(apart.values()), noise=before.noise, words=words)


def _fit_other_causes(model: Model, beside: Quantities) -> Iterator[Fit]:
    """Yield a linear fit of every cause that changes more than what is done to efforts."""
    for cause in collect_causes().values():
        if cause.linear or cause.guess is not None or cause.remeshes:
            continue
        for target in cause.targets(model):
            try:
                if cause.scale(model, target) and _is_visible(model, cause, target):
                    yield beside.fit_linearly(cause, target)
            except IMPOSSIBLE:
                continue


def _is_visible(model: Model, cause: Cause, target: str) -> bool:
    """Return True if a cause changes the mechanism or its motion."""
    size = np.full(max(cause.parameters, 1), 1e-3 * cause.scale(model, target))
    harmed = cause.change(model.base, target, size)
    return harmed.mechanism is not model.base.mechanism or harmed.case is not model.base.case


def _fit_closer(beside: Quantities, one: Fit) -> Fit:
    if not one.cause.sized:
        return one
    try:
        better = beside.evaluate_fit(beside.fit_size(one))
    except IMPOSSIBLE:
        return one
    return min(one, better, key=lambda fit: fit.residual)


def _list_contradictions(evidence: Evidence, one: Fit, sure: float) -> tuple[str, ...]:
    try:
        return evidence.list_contradictions(one, sure)
    except (*IMPOSSIBLE, RuntimeError, KeyError):
        return (NOT_RUNNING,)
