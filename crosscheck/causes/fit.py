"""Fit of causes to a difference: least squares over a cause's size, by Gauss-Newton where the size is not small.

r = tau_engine - tau_reference over the range (all samples, all coordinates)
minimise |r - d(p)|,   d(p) = tau(subject with the cause at size p) - tau(subject)
unexplained = |r - d(p)| / |r|
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from crosscheck.causes.cause import Cause
from crosscheck.causes.model import Model
from flexinv.errors import ConvergenceError, InputError
from flexinv.typing import Array

# Of a rigid model, whose rounding is 1e-12 of the range or less; of a march, whose Newton iterations leave 1e-9.
PROBE = {True: 1e-5, False: 1e-4}
# Of the range: a column below this, for a size that matters, is what the probes leave and does not show in this motion.
NOTHING = {True: 1e-9, False: 1e-5}
ROUNDING = 1e-12  # of the largest component of a size: less is none
LARGEST = 5.0  # times a size that matters: no fit goes beyond by itself
# Of |r|: what leaves less by its columns at size zero alone is proportional to its size, and may be as large as it likes.
PROPORTIONAL = 0.01
HALVINGS = 4
SMALL = 1e-6  # of the largest singular value: sizes that hardly change anything keep their place
TINY = 0.1  # times a size that matters: below it the linear fit is a good start
ASIDE = (0.02, 0.2)  # [rad]
FAR = (0.03, 0.1, 0.3, 0.8)  # times a size that matters
# Of sizes that are fractions, each three times the one before: whatever is proportional to a size, or to one over it, leaves
# at most two thirds (HOPELESS) at one of them.  Up to a thousand, as of kN for N.
FAR_FACTORS = (1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 0.7, 1.4, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3)
# Of an effect: what difference quotients (PROBE) leave of a derivative where the effect is proportional to the size.
PROBED = 1e-6
HOPELESS = 0.7  # of |r|: beyond, no refinement is tried; what rough marches are off by (`Model.rough_error`) is added
SCANNED = 4  # rounds of Gauss-Newton from there
ENOUGH = (
    0.05  # a step that gains less than this part of what is left is the last one: near a solution it gains nearly all
)
HALF_GAIN = 0.5  # of what was left: a step that leaves more is held against half of it
IMPOSSIBLE = (InputError, ConvergenceError, ValueError, ArithmeticError, np.linalg.LinAlgError)


@dataclass(frozen=True)
class Fit:
    """Fit of one cause at one target to a difference.

    size : (parameters,) [unit of the cause]; residual : what it leaves, |r - d| over |r| [-]
    column : (samples nv,) what it explains, over the range [-]
    """

    cause: Cause
    target: str
    size: Array
    residual: float
    column: Array

    @property
    def key(self) -> tuple[str, str]:
        """Name and target."""
        return self.cause.name, self.target


@dataclass(frozen=True)
class Candidate:
    """A cause at a target with its columns at size zero, (samples nv, parameters), per ``scale`` [unit].

    look : the columns, of marches rough ones (`Model.rough`); model : that finer ones are computed with, None for no finer ones
    far : effects (samples nv,) [-] at sizes that no engine's answer has chosen, by their bytes; None where nothing runs
    """

    cause: Cause
    target: str
    scale: float
    look: Array
    model: Model | None = field(default=None, compare=False, repr=False)
    far: dict[bytes, Array | None] = field(default_factory=dict, compare=False, repr=False)

    @property
    def key(self) -> tuple[str, str]:
        """Name and target."""
        return self.cause.name, self.target

    @cached_property
    def columns(self) -> Array:
        """The columns, of marches those of the model's own step: computed when somebody needs them."""
        if self.model is None or self.model.rough is self.model:
            return self.look
        try:
            found = _compute_columns(self.model, self.cause, self.target, self.scale)
        except IMPOSSIBLE:
            return self.look
        return found if np.isfinite(found).all() else self.look

    def compute_far_effect(self, model: Model, place: Array) -> Array | None:
        """Return the effect of a size of ``place`` times ``scale`` [unit], (samples nv,) [-], None where nothing runs.

        Marches take ROUGH_STEPS.  It is computed once for all engines of a case, for it does not depend on what they gave.
        """
        key = place.tobytes()
        if key not in self.far:
            column = _compute_effect_or_none(model.rough, self.cause, self.target, place * self.scale)
            self.far[key] = column if column is not None and np.isfinite(column).all() else None
        return self.far[key]


@dataclass
class Columns:
    """Candidates of the model that was asked about last: many engines, or many faults of one, are held against the same.

    model, dictionary : what they belong to; candidates : (candidates,), which are the same for equal motions, efforts and scales
    """

    model: Model | None = None
    dictionary: dict[str, Cause] = field(default_factory=dict)
    candidates: list[Candidate] = field(default_factory=list)

    def collect_candidates(self, model: Model, dictionary: dict[str, Cause]) -> list[Candidate]:
        """Return `list_candidates` of a model, computed where it or the dictionary is another one than before."""
        if self.model is None or dictionary != self.dictionary or not self.model.is_like(model):
            self.model = model
            self.dictionary = dictionary
            self.candidates = list_candidates(model, dictionary)
        return self.candidates


def list_candidates(model: Model, dictionary: dict[str, Cause]) -> list[Candidate]:
    """Return every cause that can sit somewhere in the subject and that shows in its motion."""
    return [one for cause in dictionary.values() for one in _list_cause_candidates(model, cause)]


def _list_cause_candidates(model: Model, cause: Cause) -> Iterator[Candidate]:
    for target in cause.targets(model):
        scale = cause.scale(model, target)
        if not scale:
            continue
        try:
            look = _compute_columns(model.rough, cause, target, scale)
        except IMPOSSIBLE:
            continue
        if np.isfinite(look).all() and _is_visible(model, cause, look):
            yield Candidate(cause, target, scale, look, model)


def _is_visible(model: Model, cause: Cause, columns: Array) -> bool:
    return cause.turns or float(np.abs(columns).max(initial=0.0)) > NOTHING[model.base.mechanism.is_rigid]


def is_possible(model: Model, one: Fit) -> bool:
    """Return True if a mechanism with the cause in it exists: a linear fit may leave less than no mass."""
    try:
        one.cause.change(model.base, one.target, one.size)
    except IMPOSSIBLE:
        return False
    return True


# Units that are mistaken for each other: a size that is a fraction may be as large as they are.
UNITS = (
    *(10.0, 1e2, 1e3, 1e4, 1e6, 1e9),  # powers of ten
    *(25.4, 0.3048, 12.0, 144.0),  # inches and feet
    *(0.45359237, 9.80665, 4.4482216, 1.3558179, 0.1129848),  # pounds, and their forces and moments
    *(57.29577951, 2 * np.pi, 60.0, 9.5492966),  # degrees, turns, minutes
)
USUAL = (0.1, 10.0)  # factors that a user may well have meant
CLOSE = 1e-3  # of a factor: the units above are known better than bars of marches tell a size


def is_sensible(one: Fit) -> bool:
    """Return True if a user may have meant a size: a factor of 0.1 to 10, or that of a unit."""
    if not (one.cause.fraction and one.cause.sized):
        return True
    factors = np.abs(1.0 + one.size)
    return all(USUAL[0] <= f <= USUAL[1] or f == 0.0 or _is_unit_factor(f) for f in factors)


def _is_unit_factor(factor: float) -> bool:
    return any(abs(factor * unit - 1.0) < CLOSE or abs(factor / unit - 1.0) < CLOSE for unit in UNITS)


def _fit_from_guesses(model: Model, residual: Array, candidate: Candidate, total: float) -> Fit:
    """Return the best of the sizes that the engine's own efforts suggest, or nothing."""
    cause = candidate.cause
    target = candidate.target
    seen = model.torque + residual.reshape(model.torque.shape) * model.scale
    sizes = [] if cause.guess is None else cause.guess(model, target, seen)
    tries = [_evaluate_fit(model, residual, candidate, size / candidate.scale, total, LARGEST) for size in sizes]
    nothing = _fit(candidate, np.zeros(cause.parameters), 0.0 * residual, residual, total)
    return min((f for f in (nothing, *tries) if f is not None), key=lambda f: f.residual)


def describe_size(size: Array, unit: str) -> str:
    """Return a size in words, with its unit; beside larger components of one unit rounding is nothing."""
    least = 0.0 if ";" in unit else ROUNDING * float(np.abs(size).max(initial=0.0))
    numbers = ", ".join(f"{x if abs(x) > least else 0.0:.4g}" for x in size)
    text = f"({numbers})" if len(size) > 1 else numbers
    return f"{text} {unit}".strip()


def compute_effect(model: Model, cause: Cause, target: str, size: Array) -> Array:
    """Return the change of the efforts by a cause of a size [unit], over the range, (samples nv,) [-]."""
    column = model.compute_difference(cause.change(model.base, target, size))
    return column - model.compute_difference(cause.change(model.base, target, 0.0 * size)) if cause.remeshes else column


def _compute_columns(model: Model, cause: Cause, target: str, scale: float) -> Array:
    if not cause.sized or cause.linear:
        return compute_effect(model, cause, target, np.ones(1))[:, None]
    if cause.guess is not None:  # it jumps: there is no derivative
        return compute_effect(model, cause, target, 0.1 * scale * np.ones(1))[:, None]
    step = PROBE[model.base.mechanism.is_rigid]
    units = np.eye(cause.parameters) * step * scale
    found = [_compute_two_sided_effect(model, cause, target, unit) for unit in units]
    if all(one is None for one in found):
        raise InputError(f"no {cause.name} of {target or 'it'} leaves a mechanism that runs")
    return np.stack([0.0 * model.torque.ravel() if one is None else one / step for one in found], axis=1)


def _compute_two_sided_effect(model: Model, cause: Cause, target: str, size: Array) -> Array | None:
    """Return the effect of a size, or of its opposite with its sign turned: at the end of a beam a body can only go back."""
    there = _compute_effect_or_none(model, cause, target, size)
    if there is not None or (back := _compute_effect_or_none(model, cause, target, -size)) is None:
        return there
    return -back


def _compute_effect_or_none(model: Model, cause: Cause, target: str, size: Array) -> Array | None:
    """Return the effect of a size, None where it leaves no mechanism that runs: out of its plane a loop does not close."""
    try:
        return compute_effect(model, cause, target, size)
    except IMPOSSIBLE:
        return None


def fit(model: Model, residual: Array, candidate: Candidate, rounds: int = 0, noise: float = 0.0) -> Fit:
    """Return the best size of one cause; rounds : of Gauss-Newton after the linear fit, none for a first look.

    noise : part of |r| [-] that says nothing: a fit that leaves half as much is good enough
    """
    cause = candidate.cause
    if cause.guess is not None:
        return _fit_from_guesses(model, residual, candidate, float(np.linalg.norm(residual)))
    first = _fit_linearly(residual, candidate, candidate.look)
    hopeless = HOPELESS + model.rough_error
    if model.rough is not model and first.residual <= hopeless:
        first = _fit_linearly(residual, candidate, candidate.columns)
    if cause.linear or not cause.sized or not rounds:
        return first
    p = first.size / candidate.scale
    most = np.inf if first.residual <= PROPORTIONAL else LARGEST
    start = np.clip(p, -most, most)
    if model.rough is not model and first.residual > HOPELESS:
        rough = _solve_size(model.rough, residual, candidate, start, rounds, noise / 2, most)
        if rough.residual > hopeless:
            return min(first, rough, key=lambda f: f.residual)
    return _solve_size(model, residual, candidate, start, rounds, noise / 2, most)


def _fit_linearly(residual: Array, candidate: Candidate, columns: Array) -> Fit:
    """Return the least squares of a cause's size by columns (samples nv, parameters) [-]; of a cause without one, its effect."""
    total = float(np.linalg.norm(residual))
    if not candidate.cause.sized:
        return _fit(candidate, np.ones(1), columns[:, 0], residual, total)
    p = np.asarray(np.linalg.lstsq(columns, residual, rcond=SMALL)[0], dtype=np.float64)
    return _fit(candidate, p, columns @ p, residual, total)


def fit_from(model: Model, residual: Array, candidate: Candidate, size: Array, rounds: int, noise: float) -> Fit | None:
    """Return the best size [unit] near one that something else suggests, None where that leaves no mechanism that runs."""
    p = size / candidate.scale
    if _evaluate_fit(model, residual, candidate, p, float(np.linalg.norm(residual)), np.inf) is None:
        return None
    return _solve_size(model, residual, candidate, p, rounds, noise / 2, np.inf)


def fit_to_remainder(model: Model, one: Fit, left: Array) -> Fit | None:
    """Return a fit whose size takes up what a full run with it leaves, (samples nv,) [-]; None where no such size runs.

    The derivative is the model's, at the fit's size.
    """
    cause = one.cause
    target = one.target
    scale = cause.scale(model, target)
    candidate = Candidate(cause, target, scale, np.zeros((len(left), 0)))
    place = one.size / scale
    try:
        here = compute_effect(model, cause, target, one.size)
        step = np.linalg.lstsq(_compute_derivative(model, candidate, place, here), left, rcond=SMALL)[0]
    except IMPOSSIBLE:
        return None
    wanted = here + left
    return _evaluate_fit(model, wanted, candidate, place + step, float(np.linalg.norm(wanted)), np.inf)


def _solve_size(
    model: Model, residual: Array, candidate: Candidate, p: Array, rounds: int, enough: float, most: float
) -> Fit:
    """Gauss-Newton on the size from p up to ``most`` [-], with halved steps where a full one does not help."""
    total = float(np.linalg.norm(residual))
    nothing = _fit(candidate, 0 * p, 0 * residual, residual, total)
    places = [p, *([] if np.abs(p).max() < TINY else [p / 4]), *_list_start_sizes(candidate)]
    starts = [
        f for f in (_evaluate_fit(model, residual, candidate, place, total, most) for place in places) if f is not None
    ]
    best = min([nothing, *starts], key=lambda f: f.residual)
    for _ in range(rounds if best.residual > enough else 0):
        p = best.size / candidate.scale
        try:
            slope = _compute_derivative(model, candidate, p, best.column)
            step = np.asarray(np.linalg.lstsq(slope, residual - best.column, rcond=SMALL)[0], dtype=np.float64)
        except IMPOSSIBLE:
            break
        better = _find_shortened_step(model, residual, candidate, p, step, best.residual, most)
        if better is None:
            break
        best, gain = better, best.residual - better.residual
        if gain < ENOUGH * best.residual or best.residual < enough:
            break
    return best


def _is_proportional(model: Model, candidate: Candidate, size: float) -> bool:
    """Return True if the effect of a size [-] far away is what the columns say: the linear look has looked everywhere.

    Of several numbers each is looked at alone, the products of two are not.
    """
    for k, unit in enumerate(np.eye(candidate.cause.parameters)):
        told = size * candidate.look[:, k]
        far_effect = candidate.compute_far_effect(model, size * unit)
        if far_effect is None or np.abs(far_effect - told).max() > PROBED * np.abs(told).max():
            return False
    return True


def _find_shortened_step(
    model: Model, residual: Array, candidate: Candidate, p: Array, step: Array, left: float, most: float
) -> Fit | None:
    """Return the fit at p plus the longest of the halved steps that leaves less than ``left`` [-], None where none does.

    What acts by its inverse is overshot by as much as was missing: where a step gains little, half of it is looked at, too.
    """
    total = float(np.linalg.norm(residual))
    better: Fit | None = None
    for k in range(HALVINGS):
        found = _evaluate_fit(model, residual, candidate, p + step / 2**k, total, most)
        if found is not None and found.residual < (left if better is None else better.residual):
            if better is not None or found.residual < HALF_GAIN * left:
                return found
            better = found
        elif better is not None:
            return better
    return better


def find_large_size(model: Model, residual: Array, candidate: Candidate, noise: float) -> Fit:
    """Return the best size near any of some large ones; noise : part of |r| [-] that says nothing."""
    cause = candidate.cause
    total = float(np.linalg.norm(residual))
    if cause.linear or not cause.sized or cause.guess is not None:
        return fit(model, residual, candidate)
    sizes = [factor - 1.0 for factor in FAR_FACTORS] if cause.fraction else [*FAR, *(-size for size in FAR)]
    first = fit(model, residual, candidate)
    if _is_proportional(model, candidate, max(sizes)):
        return first
    places = [size * unit for unit in np.eye(cause.parameters) for size in sizes]
    columns = [(place, candidate.compute_far_effect(model, place)) for place in places]
    fits = [_fit(candidate, place, column, residual, total) for place, column in columns if column is not None]
    best = min(fits, key=lambda f: f.residual, default=first)
    if best.residual > HOPELESS + model.rough_error:
        return best
    most = max(LARGEST, 2.0 * float(np.abs(best.size / candidate.scale).max()))
    return _solve_size(model, residual, candidate, best.size / candidate.scale, SCANNED, noise / 2, most)


def _list_start_sizes(candidate: Candidate) -> list[Array]:
    """Return sizes to start from where the derivative at zero may say nothing."""
    if not candidate.cause.turns:
        return []
    return [sign * size * unit for unit in np.eye(candidate.cause.parameters) for size in ASIDE for sign in (1.0, -1.0)]


def _evaluate_fit(
    model: Model, residual: Array, candidate: Candidate, p: Array, total: float, most: float
) -> Fit | None:
    if np.abs(p).max() > most:
        return None
    try:
        column = compute_effect(model, candidate.cause, candidate.target, p * candidate.scale)
    except IMPOSSIBLE:
        return None
    return _fit(candidate, p, column, residual, total) if np.isfinite(column).all() else None


def _compute_derivative(model: Model, candidate: Candidate, p: Array, here: Array) -> Array:
    step = PROBE[model.base.mechanism.is_rigid]
    moved = [(p + step * unit) * candidate.scale for unit in np.eye(len(p))]
    found = [_compute_effect_or_none(model, candidate.cause, candidate.target, q) for q in moved]
    return np.stack([0.0 * here if one is None else (one - here) / step for one in found], axis=1)


def _fit(candidate: Candidate, p: Array, column: Array, residual: Array, total: float) -> Fit:
    left = float(np.linalg.norm(residual - column)) / total if total else 0.0
    return Fit(candidate.cause, candidate.target, p * (candidate.scale if candidate.cause.sized else 1.0), left, column)
