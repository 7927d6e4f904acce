"""Naming of causes: the one that explains the difference, with all others that nothing known tells from it.

A cause is named when three things are true.  It explains the efforts down to the engines' error bars.  What it changes in the
mechanism is what is wrong in the engine's own certificate, line by line.  It explains every other quantity that both engines
gave.  Causes of which only the amplitude is known (a long step) may leave UNEXPLAINED where the bars are less.  Every cause
of which all that is true stands beside it, at most MOST names, or MOST pairs: of more, none is printed.  Where no cause alone
will do, pairs are tried (`find_pairs`).  Otherwise nothing is named, and the words say which lines of the certificate fail.
Where the difference of the efforts is inside the error bars, what other quantities show is named alone (`beside`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from crosscheck.causes.dictionary import collect_causes
from crosscheck.causes.evidence import NOT_RUNNING, CauseAssessment, Evidence
from crosscheck.causes.fit import (
    HOPELESS,
    LARGEST,
    Candidate,
    Fit,
    find_large_size,
    fit,
    is_possible,
    is_sensible,
    list_candidates,
)
from crosscheck.causes.model import Model, is_tree
from crosscheck.causes.pairs import AND, find_pairs, is_part_of_pair, split_name
from flexinv.typing import Array

UNEXPLAINED = 0.1  # of |r|: what a cause may leave of which only the amplitude is fitted, and any other of a march
SIMILAR = 3.0  # a cause that leaves up to this many times what the best one leaves is as good
ROUNDED = 1e-7  # of |r|: below this the sizes' own steps, and rounding, decide which one leaves less
NOISE = 2.0  # times the error bars: what is left within them says nothing
HALF = 0.5  # of |r|: a cause that leaves more explains less than it leaves
# Of the largest difference of a march: the columns' long step (`model.STEPS`), and bars that are those of the unharmed mechanism.
MARCHED = 0.02
NOTHING = 1e-6  # of |r|: an engine that gives less gives nothing, which no cause explains
MOST = 3  # names that are printed; what leaves more open is not known
# Causes whose size is refined after a linear look at all, by whether the mechanism is a rigid tree: closing a loop or
# marching takes a hundred times as long.  Rounds of a refinement, by whether it is rigid: bars of rounding take more of them.
SHORTLIST = {True: 24, False: 6}
# Causes whose size is looked for far away, of rigid mechanisms that are no trees and of marches.
SCANNED = {True: 60, False: 8}
LOOK, TURNS, DEEP = range(3)  # the best of a linear look; angles, too; whatever may be far away
DEEPER = {True: 4, False: 2}  # times as many where what explains the efforts is contradicted, or nothing does
MANY = 600  # columns, of robots with dozens of bodies: there only what looks likely is refined
ROUNDS = {True: 8, False: 3}
TOLD = 40  # causes that are held against all else, those that explain most first


@dataclass(frozen=True)
class NamedCauses:
    """Causes of a difference, and their rivals.

    named : the causes that explain it, most special first; next : the best of the rest
    ruled_out : causes that explain the efforts as well, each with what contradicts it
    size : largest difference over the range [-]; noise : largest error bar over the range [-]
    failing : lines of the engine's certificate that do not hold
    """

    named: tuple[Fit, ...]
    next: Fit | None
    size: float
    noise: float
    words: str
    ruled_out: tuple[CauseAssessment, ...] = ()
    failing: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the causes, each once."""
        return tuple(dict.fromkeys(f.cause.name for f in self.named))

    @property
    def found(self) -> bool:
        """Return True if the difference is larger than the error bars."""
        return self.size > self.noise


@dataclass(frozen=True)
class ResidualQuestion:
    """A residual (samples nv,) over the range [-], its error bars of the same shape, and what an explanation may leave.

    agreed : largest difference [-] of engines that have the same mechanism, where a limit states one
    """

    model: Model
    residual: Array
    bars: Array
    agreed: float = 0.0

    @cached_property
    def fits(self) -> dict[tuple[int, str], Fit]:
        """Fits that were made, by the number of the candidate and how they were made: every deeper look asks for them again."""
        return {}

    @cached_property
    def total(self) -> float:
        """|r| [-]."""
        return float(np.linalg.norm(self.residual))

    @cached_property
    def part(self) -> float:
        """Norm of the error bars over that of the difference [-]."""
        return float(np.linalg.norm(self.bars)) / self.total

    @cached_property
    def given(self) -> float:
        """Norm of the efforts that the engine gave over that of the difference [-]."""
        return float(np.linalg.norm(self.model.scale_efforts(self.model.torque) + self.residual)) / self.total

    @cached_property
    def most(self) -> float:
        """Return the largest part of |r| that a named cause may leave [-], and of the efforts that the engine gave.

        What explains them predicts them: an engine that gives next to nothing differs by all of the reference.
        """
        return max(UNEXPLAINED * min(1.0, self.given), min(NOISE * self.part, HALF), ROUNDED)

    def can_fully_explain(self, one: Fit) -> bool:
        """Return True if a fit leaves no more than the right cause may: the bars, once, at every sample.

        Of a march the model's own step leaves MARCHED of the difference, and of a linear cause only the amplitude is known.
        """
        if one.cause.linear:
            return self.can_explain(one)
        part = ROUNDED if self.model.base.mechanism.is_rigid else MARCHED
        bars = np.maximum(self.bars, part * float(np.abs(self.residual).max()))
        return bool((np.abs(self.residual - one.column) <= bars).all())

    def is_credible(self, best: Fit) -> bool:
        """Return True if the best cause stands out of the error bars.

        Where they hide half of the difference the right cause may be among those that leave more than HALF, and one that
        leaves more than UNEXPLAINED may be a chance.
        """
        return NOISE * self.part <= HALF or best.residual <= UNEXPLAINED

    @cached_property
    def enough(self) -> float:
        """Return the part of |r| [-] up to which the residual of a fit need not be looked at again."""
        rigid = self.model.base.mechanism.is_rigid
        return min(self.most, max(NOISE * self.part, ROUNDED if rigid else MARCHED))

    @cached_property
    def allowed(self) -> Array:
        """Return the largest residual that an explanation may leave at each sample (samples nv,) [-]."""
        largest = float(np.abs(self.residual).max())
        # A fit stops where its steps are rounding: of a rigid mechanism ROUNDED of the difference.
        part = (ROUNDED if self.model.base.mechanism.is_rigid else MARCHED) * largest
        return np.maximum(NOISE * self.bars, max(self.agreed, part))

    def can_explain(self, one: Fit) -> bool:
        """Return True if a fit explains the efforts: to the bars at every sample, or to UNEXPLAINED by its amplitude alone."""
        if one.residual > self.most or self.given < NOTHING:
            return False
        if one.cause.linear and one.residual <= UNEXPLAINED * min(1.0, self.given):
            return True
        return bool((np.abs(self.residual - one.column) <= self.allowed).all())


def find_causes(
    model: Model,
    residual: Array,
    noise: Array | float,
    known: list[Candidate] | None = None,
    evidence: Evidence | None = None,
    agreed: float = 0.0,
) -> NamedCauses:
    """Return the naming of a residual (samples nv,) over the range [-]; noise : error bars of the same shape, or one.

    known : the dictionary's columns where they are at hand (``list_candidates``); evidence : what else is known
    agreed : largest difference [-] that a limit allows engines with the same mechanism
    """
    bars = np.broadcast_to(np.asarray(noise, dtype=np.float64), residual.shape)
    size = float(np.abs(residual).max())
    largest = float(bars.max())
    if size <= largest:
        return NamedCauses((), None, size, largest, "the difference is inside the error bars")
    residual_question = ResidualQuestion(model, residual, bars, agreed)
    known = list_candidates(model, collect_causes()) if known is None else known
    fits: list[Fit] = []
    heard: tuple[CauseAssessment, ...] = ()
    levels = (LOOK, TURNS, DEEP) if is_tree(model.base) else (LOOK, DEEP)
    for look in levels if len(known) < MANY else levels[:1]:
        fits = list_ranked_fits(residual_question, known, look)
        heard = list_explaining_causes(residual_question, fits, evidence)
        if look == LOOK and not list_agreeing_causes(heard) and evidence is not None and evidence.failing:
            heard = (
                *heard,
                *list_explaining_causes(
                    residual_question, list_certificate_fits(residual_question, known, evidence), evidence
                ),
            )
        if any(residual_question.can_fully_explain(one.fit) for one in list_agreeing_causes(heard)):
            break
    if not list_agreeing_causes(heard):
        both = find_pairs(model, residual, known, residual_question.can_explain, residual_question.part)
        heard = (*heard, *list_explaining_causes(residual_question, both, evidence))
    return choose_causes(residual_question, fits, heard, evidence)


def list_agreeing_causes(heard: Iterable[CauseAssessment]) -> list[CauseAssessment]:
    """Return the causes that nothing contradicts."""
    return [one for one in heard if not one.against]


def list_explaining_causes(
    question: ResidualQuestion, fits: list[Fit], evidence: Evidence | None
) -> tuple[CauseAssessment, ...]:
    """Return the causes that explain the efforts, each with what contradicts it.

    Of a cause whose size has several numbers the motion may show some only: it is held against the certificate all the same
    where it does not explain the efforts yet.
    """
    explaining = [f for f in fits if question.can_explain(f)]
    if evidence is None:
        return tuple(map(CauseAssessment, explaining))
    sure = max(NOISE * question.part, 0.0 if question.model.base.mechanism.is_rigid else MARCHED)
    heard = [evidence.judge_fit(f, question.can_explain, sure) for f in explaining[:TOLD]]
    # What else may know a size of several numbers: where that agrees with the reference, no such size is hidden.
    if evidence.shows_elsewhere and not list_agreeing_causes(heard):  # the motion led a size of several numbers astray
        turned = [f for f in fits if not question.can_explain(f) and f.cause.parameters > 1]
        again = (evidence.judge_fit(f, question.can_explain, sure) for f in turned[:TOLD])
        heard += [one for one in again if question.can_explain(one.fit)]
    return tuple(sorted(heard, key=lambda one: one.fit.residual))


def list_certificate_fits(question: ResidualQuestion, known: list[Candidate], evidence: Evidence) -> list[Fit]:
    """Return the fits of causes whose size the certificate says, what explains most first."""
    rounds = ROUNDS[question.model.base.mechanism.is_rigid]
    usable = (c for c in known if c.cause.sized and not c.cause.linear and c.cause.guess is None)
    found = (evidence.fit_to_certificate(c, rounds, question.part) for c in usable)
    return sorted((f for f in found if f is not None), key=_take_remainder)


def list_ranked_fits(question: ResidualQuestion, known: list[Candidate], look: int = LOOK) -> list[Fit]:
    """Return a fit of every cause that shows, what explains most first; look : how many of them are refined."""
    first = {k: _make_fit_once(question, known, k, "linear") for k in range(len(known))}
    order = sorted((k for k in first if known[k].cause.sized), key=lambda k: first[k].residual)
    refined = _choose_refined(question, known, first, order, look)
    first |= {k: _make_fit_once(question, known, k, "refined") for k in refined}
    if look == DEEP:
        far = _choose_far(question, known, first, order)
        first |= {k: min(first[k], _make_fit_once(question, known, k, "far"), key=_take_remainder) for k in far}
    return sorted((f for f in first.values() if is_possible(question.model, f)), key=_take_remainder)


def _choose_refined(
    question: ResidualQuestion, known: list[Candidate], first: Mapping[int, Fit], order: list[int], look: int
) -> list[int]:
    """Return the causes whose linear look is refined; order : of all, what explains most first."""
    quick = is_tree(question.model.base)
    refined = order[: SHORTLIST[quick] * (DEEPER[quick] if look == DEEP else 1)]
    # A linear look that explains all is only a look; of an angle whose effect begins with its square it says nothing.
    refined += [k for k in order if first[k].residual <= question.enough and k not in refined]
    if look != LOOK and quick:
        refined += [k for k in order if known[k].cause.turns and k not in refined]
    return refined


def _choose_far(
    question: ResidualQuestion, known: list[Candidate], first: Mapping[int, Fit], order: list[int]
) -> list[int]:
    """Return the causes whose size is looked for far away, too; order : of all, what explains most first."""
    base = question.model.base
    far = order if is_tree(base) else order[: SCANNED[base.mechanism.is_rigid]]
    # A linear look at a size that no mechanism can have says nothing of what acts by its inverse.
    hopeful = (k for k in order if known[k].cause.fraction and first[k].residual < HOPELESS)
    return far + [k for k in hopeful if k not in far and _is_beyond_linear_look(first[k])]


def _make_fit_once(question: ResidualQuestion, known: list[Candidate], k: int, way: str) -> Fit:
    """Return the fit of a candidate: ``linear``, ``refined`` from there, or near sizes that are ``far``; made once."""
    if (k, way) not in question.fits:
        question.fits[k, way] = _make(question, known[k], way)
    return question.fits[k, way]


def _make(question: ResidualQuestion, one: Candidate, way: str) -> Fit:
    if way == "linear":
        return fit(question.model, question.residual, one)
    if way == "refined":
        return fit(
            question.model, question.residual, one, ROUNDS[question.model.base.mechanism.is_rigid], question.part
        )
    return find_large_size(question.model, question.residual, one, question.part)


def _is_beyond_linear_look(one: Fit) -> bool:
    """Return True if a size that is a fraction [-] takes all away, or is larger than any that a linear look can tell."""
    return bool((one.size <= -1.0).any() or (np.abs(one.size) > LARGEST).any())


def _take_remainder(one: Fit) -> float:
    return one.residual


def choose_causes(
    question: ResidualQuestion, fits: list[Fit], heard: tuple[CauseAssessment, ...], evidence: Evidence | None
) -> NamedCauses:
    """Return the naming of fits that were held against all that is known."""
    size = float(np.abs(question.residual).max())
    largest = float(question.bars.max())
    failing = () if evidence is None else evidence.failing
    out = tuple(one for one in heard if one.against)
    best = fits[0] if fits else None
    good = list_similar_fits(question, [one.fit for one in list_agreeing_causes(heard)])
    if (count := _count_answers(good)) > MOST:
        words = f"the cause is unknown: {count} explain it, and nothing that the engine gave tells them apart"
        return NamedCauses((), good[0], size, largest, words, out, failing)
    # Lines of the certificate that fail, and that the cause explains, show it whatever the bars are.
    if good and not failing and not question.is_credible(good[0]):
        return NamedCauses((), good[0], size, largest, describe_hidden_cause(question, good[0]), out, failing)
    if good:
        rest = next((f for f in fits if f.key not in {g.key for g in good}), None)
        return NamedCauses(good, rest, size, largest, "", out, failing)
    return NamedCauses((), best, size, largest, describe_unknown_cause(question, best, out), out, failing)


def _count_answers(good: Iterable[Fit]) -> int:
    """Return the number of answers: names, for one name at several places says what is wrong; of pairs, which say less, all."""
    names = {part for f in good for part in split_name(f.cause.name)}
    return max(len(names), sum(AND in f.cause.name for f in good))


def list_similar_fits(question: ResidualQuestion, fits: list[Fit]) -> tuple[Fit, ...]:
    """Return the fits that leave about as little as the best: without those that no user means beside ones that one does,
    and without causes of which a special case is among them."""
    known = [f for f in fits if is_sensible(f)]
    least = min((f.residual for f in known), default=np.inf)
    if not any(question.can_fully_explain(f) for f in known):
        # A size that no user means is an answer where it leaves nothing, and what users mean leaves more than it may.
        far = [f for f in fits if not is_sensible(f) and not f.cause.linear and question.can_fully_explain(f)]
        known += [f for f in far if SIMILAR * f.residual < least]
        least = min((f.residual for f in known), default=0.0)
    limit = min(max(SIMILAR * least, NOISE * question.part, ROUNDED), HALF)
    found = _drop_general_causes([f for f in known if f.residual <= limit])
    return tuple(sorted(found, key=lambda f: (f.cause.parameters, f.residual)))


def describe_hidden_cause(question: ResidualQuestion, best: Fit) -> str:
    """Return the reason for naming nothing where the error bars hide too much of the difference, in words."""
    return (
        f"the cause is unknown: the error bars are {question.part:.0%} of the difference, and the nearest, {best.cause.name}, "
        f"leaves {_format_share(best.residual)}"
    )


def describe_unknown_cause(question: ResidualQuestion, best: Fit | None, out: tuple[CauseAssessment, ...]) -> str:
    """Return the reason for naming nothing, in words."""
    if best is None:
        return "no cause of the dictionary shows in this motion"
    if out:
        # What no mechanism can have explains nothing to a reader: such a fit is told where there is no other.
        first = min(out, key=lambda one: (NOT_RUNNING in one.against, len(one.against), one.fit.residual))
        return (
            f"the cause is unknown: {first.fit.cause.name} would explain the efforts, but is contradicted by "
            f"{', '.join(first.against)}"
        )
    return f"no single cause explains it, and no two; the nearest, {best.cause.name}, leaves {_format_share(best.residual)}"


def _format_share(left: float) -> str:
    return f"{left:.0%}" if left >= 0.01 else f"{left:.1e} of it, more than the error bars"


def _drop_general_causes(fits: list[Fit]) -> list[Fit]:
    """Return the fits without causes of which a special case is among them, and pairs of which a part is."""
    names = {f.cause.name for f in fits}
    return [f for f in fits if not names & set(f.cause.covers) and not any(is_part_of_pair(f, one) for one in fits)]
