"""Which cause is named: the one that explains the difference, with all that this motion cannot tell from it.

A cause is named when it leaves at most UNEXPLAINED of the difference (or no more than the error bars of the engines), and of
the efforts that the engine gave: what explains them predicts them.  An engine that gives next to nothing differs by all of
the reference, which a mechanism almost without mass would "explain", and would predict none of what the engine did give.
Every other cause that leaves about as little stands beside it: the motion cannot tell them apart.  Nothing is named
where nothing explains the difference, and nothing is asked where it is inside the error bars.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosscheck.causes.dictionary import DICTIONARY
from crosscheck.causes.evidence import Evidence
from crosscheck.causes.fit import Candidate, Fit, candidates, fit, possible, scan
from crosscheck.causes.model import Model, is_tree
from crosscheck.causes.subject import Array

UNEXPLAINED = 0.1  # of |r|: what a named cause may leave, 1 % of its square
SIMILAR = 3.0  # a cause that leaves up to this many times what the best one leaves is as good
ROUNDED = 1e-5  # of |r|: below this the sizes' own steps, and rounding, decide which one leaves less
NOISE = 2.0  # times the error bars: what is left within them says nothing
# Causes whose size is refined after a linear look at all, by whether the mechanism is a rigid tree: closing a loop or
# marching takes a hundred times as long.
SHORTLIST = {True: 16, False: 5}
MANY = 300  # columns, of robots with dozens of bodies: there only what looks likely is refined
ROUNDS = {True: 6, False: 3}
ASTRAY = 40  # sizes of several numbers that are fitted to the certificates where the motion led to nothing


@dataclass(frozen=True)
class Naming:
    """What a difference is due to.

    named : the causes that explain it, most special first; next : the best of the rest
    ruled_out : causes that explain it as well and that what else is known contradicts
    size : largest difference over the range [-]; noise : largest error bar over the range [-]
    """

    named: tuple[Fit, ...]
    next: Fit | None
    size: float
    noise: float
    words: str
    ruled_out: tuple[Fit, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the causes, each once."""
        return tuple(dict.fromkeys(f.cause.name for f in self.named))

    @property
    def found(self) -> bool:
        """Return whether the difference is larger than the error bars."""
        return self.size > self.noise


def name(
    model: Model,
    residual: Array,
    noise: Array | float,
    known: list[Candidate] | None = None,
    evidence: Evidence | None = None,
) -> Naming:
    """Return what explains a residual (samples nv,) over the range [-]; noise : error bars of the same shape, or one.

    known : the dictionary's columns where they are at hand (``candidates``)
    evidence : what else is known; where it bears out none of the causes that fit, it is not listened to
    """
    bars = np.broadcast_to(np.asarray(noise, dtype=np.float64), residual.shape)
    size, largest = float(np.abs(residual).max()), float(bars.max())
    if size <= largest:
        return Naming((), None, size, largest, "the difference is inside the error bars")
    total = float(np.linalg.norm(residual))
    part = float(np.linalg.norm(bars)) / total
    enough = allowed(part, float(np.linalg.norm(model.weighted(model.torque) + residual)) / total)
    known = candidates(model, DICTIONARY) if known is None else known
    fits = ranked(model, residual, known, part, enough)
    if evidence is not None and contradicted(fits, enough, evidence):
        fits = ranked(model, residual, known, part, enough, deep=True)
    return chosen(fits, part, enough, size, largest, evidence)


def contradicted(fits: list[Fit], enough: float, evidence: Evidence) -> bool:
    """Return whether what else is known contradicts all that explain the difference (leave no more than ``enough`` [-])."""
    explaining = [f for f in fits if f.left <= enough]
    return bool(explaining) and all(evidence.hear(f, enough) is None for f in explaining)


def ranked(
    model: Model, residual: Array, known: list[Candidate], noise: float, enough: float, deep: bool = False
) -> list[Fit]:
    """Return a fit [-] of every cause that shows, what explains most first; noise : part of |r| that says nothing.

    enough : what an explanation may leave of |r| [-]
    deep : refine the size of all of them, whatever the linear look says
    """
    quick = is_tree(model.base)
    first = {k: fit(model, residual, one) for k, one in enumerate(known)}
    order = sorted((k for k in first if known[k].cause.sized), key=lambda k: first[k].left)
    refined = order if deep and len(known) < MANY else order[: SHORTLIST[quick]]
    first |= {k: fit(model, residual, known[k], ROUNDS[quick], noise) for k in refined}
    if min((f.left for f in first.values()), default=0.0) > enough and len(known) < MANY:
        # Far away, or an angle whose effect begins with its square: a linear look says nothing.
        turning = [k for k in order if known[k].cause.turns] if quick else []
        first |= {k: fit(model, residual, known[k], ROUNDS[quick], noise) for k in turning}
        first |= {k: min(first[k], scan(model, residual, known[k], noise), key=lambda f: f.left) for k in order}
    return sorted((f for f in first.values() if possible(model, f)), key=lambda f: f.left)


def allowed(noise: float, given: float) -> float:
    """Return what a named cause may leave of |r| [-].

    noise, given : norms of the error bars and of the engine's efforts over that of the difference [-]
    """
    return max(UNEXPLAINED * min(1.0, given), min(NOISE * noise, 0.5), ROUNDED)


def chosen(
    fits: list[Fit], noise: float, enough: float, size: float, largest: float, evidence: Evidence | None = None
) -> Naming:
    """Return the naming of ranked fits; noise : norm of the error bars over that of the difference [-].

    enough : what an explanation may leave of the difference [-]
    """
    if not fits:
        return Naming((), None, size, largest, "no cause of the dictionary shows in this motion")
    fits, ruled_out = (fits, []) if evidence is None else heard(fits, enough, evidence)
    best = fits[0]
    if best.left > enough:
        words = f"no single cause explains it; the nearest, {best.cause.name}, leaves {best.left:.0%}"
        return Naming((), best, size, largest, words)
    limit = min(max(SIMILAR * best.left, NOISE * noise, ROUNDED), 0.5)
    alike = [f for f in fits if f.left <= limit]
    rest = next((f for f in fits if f.left > limit), None)
    named = tuple(sorted(_special(alike), key=lambda f: (f.cause.parameters, f.left)))
    out = tuple(f for f in _special(ruled_out) if f.left <= limit)
    return Naming(named, rest, size, largest, "", out)


def heard(fits: list[Fit], enough: float, evidence: Evidence) -> tuple[list[Fit], list[Fit]]:
    """Return the fits without those that evidence contradicts, and those; enough : what an explanation may leave [-].

    Where all that explain it are contradicted, the evidence is not of this difference: none is left out.
    """
    explaining = [f for f in fits if f.left <= enough]
    borne = [again for f in explaining if (again := evidence.hear(f, enough)) is not None]
    if explaining and not borne:  # the motion led a size of several numbers astray
        turned = [f for f in fits if f.left > enough and f.cause.parameters > 1]
        borne = [again for f in turned[:ASTRAY] if (again := evidence.hear(f, enough)) is not None]
    keys = {f.key for f in borne}
    out = [f for f in explaining if f.key not in keys]
    kept = sorted((*borne, *(f for f in fits if f.left > enough and f.key not in keys)), key=lambda f: f.left)
    return (kept, out) if borne else (fits, [])


def _special(fits: list[Fit]) -> list[Fit]:
    """Return the fits without causes of which a special case is among them."""
    names = {f.cause.name for f in fits}
    return [f for f in fits if not names & set(f.cause.covers)]
