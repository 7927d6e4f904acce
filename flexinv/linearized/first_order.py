"""All roots of A z = s B z from both ends, fast ones of B^-1 A and slow ones of (A - shift B)^-1 B, and that none is lost.

Each end loses 1e-16 of its largest value, and so the other end: they part at a place between two roots.  Each end gives as many
values as the pencil has roots, each once.  But rounding may move one across that place, and it is lost, or there twice.  So the
roots are counted by the argument principle (`root_counts`) within a circle that none reaches with its error bar: with as many
inside, and as many outside as are left, none is lost.

The slow end sees nothing where its shift is less than what rounding leaves of zeros that are together, and no count tells values
that are wrong from others within the circle.  So all are held by discs (`root_discs`), and of the places where the ends may part
the one is taken that leaves the fewest roots without a digit, and the smallest bars.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.dynamics.loads import TINY
from flexinv.errors import ConvergenceError, ModelWarning
from flexinv.linearized.eigenvalues import choose_shift
from flexinv.linearized.root_counts import count_missing_roots
from flexinv.linearized.root_discs import compute_root_discs
from flexinv.typing import Array, Complex, Mask, RealOrComplex, Sparse

# Of A, rows and columns of unit size: a pivot below this part is rounding, that of a motion without stiffness.
SMALLEST_PIVOT = 1e-13
# Roots whose sizes differ by less, as +w and -w, are on the same side: each end may find another one of them below the place.
NO_GAP = 1e-3
# A gap one e-fold wider is worth as much as one so many e-folds nearer to the mean of the slowest and the fastest.
PART_OF_MEAN = 0.2
# A bar beyond this part of its root leaves no digit of it.
NO_DIGIT = 0.1
# |s| times the longest time of what follows: below this its square, which vectors without it leave of a root, is rounding.
SLOW_ENOUGH = 1e-8
# Places where the ends may part that are tried one after the other, the best first.
MOST_PLACES = 4

PencilRoots = tuple[Complex, Complex, Complex]
# Roots, right and left vectors, bars of rounding, and what else is not known of a root.
Corrected = tuple[Complex, Complex, Complex, Array, Array]


def find_all_roots(
    a: Array,
    b: Array,
    smallest: float,
    corrected: Callable[[PencilRoots, float], Corrected],
    matrix_at: Callable[[complex], Sparse],
    lag: float = 0.0,
) -> Corrected:
    """Return all roots [1/s], [1/s^2] of A - s B as they are ``corrected`` at the shift of the slow ones.

    smallest : shift; corrected : roots, vectors and bars by values of the pencil and that shift
    matrix_at : P(s), sparse, whose determinant has the same roots, and faster ones
    lag : longest time [s] in which motions follow that A and B have not
    Raises ConvergenceError where a root is lost; a ModelWarning says where that none is lost is not proved.
    """
    fast = _solve_direct(a, b)
    slow, shift = _find_slow_roots(a, b, smallest)
    found = []
    for place, values in _join_both_ends(slow, fast):
        late = find_late(values[0], lag)
        found.append(_make_candidate(place, corrected(values, shift), compute_root_discs(a, b, *values, shift), late))
        if found[-1].unknown == 0:
            break
    return _choose(sorted(found, key=lambda one: (one.unknown, one.width)), matrix_at)


def _choose(candidates: list[Candidate], matrix_at: Callable[[complex], Sparse]) -> Corrected:
    """Return the first roots of which none is missed; a ModelWarning says where that is not proved of any."""
    counts = []
    for one in candidates:
        counts.append(_count_missing_near(one.place, one.found[0], one.bar, matrix_at))
        if counts[-1] == 0 and one.is_proved:
            return one.roots
    unsure = [one for one, count in zip(candidates, counts, strict=True) if not count]
    if not unsure:
        most = max(map(abs, filter(None, counts)))
        raise ConvergenceError(
            f"modes: of {len(candidates[0].bar)} roots {most} are lost, or there twice, as rounding hides slow ones from fast "
            "ones; write fewer elements, or stiffness and inertia of more like sizes"
        )
    warnings.warn(
        f"modes: that none of {len(unsure[0].bar)} roots is lost is not proved: they are too close together to be counted near "
        f"{unsure[0].place:.3g} 1/s; compare with another number of elements",
        ModelWarning,
        stacklevel=2,
    )
    return unsure[0].roots


@dataclass(frozen=True)
class Candidate:
    """Roots as they are found where both ends part at a place [1/s], corrected.

    beyond : (roots,) what discs leave of them beyond their bars [1/s]
    """

    place: float
    found: Corrected
    beyond: Array

    @property
    def roots(self) -> Corrected:
        """Roots with all that is not known of them."""
        root, right, left, bar, lost = self.found
        return root, right, left, bar, lost + self.beyond

    @property
    def bar(self) -> Array:
        """(roots,) bars without discs [1/s], by which roots are counted: where a root is there twice these have no discs."""
        return self.found[3] + self.found[4]

    @property
    def is_proved(self) -> bool:
        """True where each root has a disc [-]."""
        return bool(np.isfinite(self.beyond).all())

    @property
    def unknown(self) -> int:
        """Number of roots of which no digit is known [-]."""
        return int((self.bar + self.beyond > NO_DIGIT * np.abs(self.found[0])).sum())

    @property
    def width(self) -> float:
        """Mean order of all bars [-]; of those that are infinite that of the largest number that can be written."""
        limits = np.finfo(float)
        return float(np.log(np.clip(self.bar + self.beyond, limits.tiny, limits.max)).mean())


def find_late(root: Complex, lag: float) -> Mask:
    """Return a mask of roots [1/s] so fast that motions follow them late: A - s B has them but nearly."""
    return np.abs(root) * lag > SLOW_ENOUGH


def _make_candidate(place: float, found: Corrected, discs: tuple[Complex, Array], late: Mask) -> Candidate:
    """Roots with what discs of the pencil leave of them beyond their bars; late ones are beside those of the pencil."""
    centre, radius = discs
    away = np.where(late, 0.0, np.abs(found[0] - centre))
    return Candidate(place, found, np.maximum(radius + away - found[3], 0.0))


def _join_both_ends(slow: PencilRoots, fast: PencilRoots) -> Iterator[tuple[float, PencilRoots]]:
    """Yield places [1/s], the best first, with slow values within them and fast ones beyond; at last fast ones alone."""
    size = np.abs(fast[0])
    for place in _list_division_points(np.abs(slow[0]), np.sort(size)):
        within = np.abs(slow[0]) <= place
        beyond = size > place
        root, x, y = (
            np.concatenate([s[..., within], f[..., beyond]], axis=-1) for s, f in zip(slow, fast, strict=True)
        )
        yield place, (root, x, y)
    yield float(np.sqrt(max(size.min(), TINY) * size.max())), fast


def _list_division_points(slow: Array, fast: Array) -> list[float]:
    """Places [1/s] where both ends have found as many on each side, by rising sizes: the widest gaps about the mean first."""
    count = len(fast)
    if count < 2:
        return []
    floor = max(float(fast[-1]) * np.finfo(float).eps, TINY)
    level = np.log(np.maximum(fast, floor))
    middle = (level[0] + level[-1]) / 2
    worth = {}
    for k in range(1, count):
        gap = level[k] - level[k - 1]
        place = float(np.exp((level[k - 1] + level[k]) / 2))
        if gap >= NO_GAP and (slow <= place).sum() + (fast > place).sum() == count:
            worth[place] = gap - abs(np.log(place) - middle) * PART_OF_MEAN
    return sorted(worth, key=lambda place: -worth[place])[:MOST_PLACES]


def _count_missing_near(place: float, root: Complex, bar: Array, matrix_at: Callable[[complex], Sparse]) -> int | None:
    """Return the number of roots that are missed within the circle nearest to a place [1/s]; None where it is not sure.

    A root of which no digit is known, as one of several together that are zero, may be anything slower: circles beyond are tried
    first.  Where no circle parts the roots, all are alike to what is known of them, and of one end.
    """
    size = np.abs(root)
    sure = _find_circle_radius(place, size, np.where(bar > NO_DIGIT * size, np.maximum(bar, size), bar))
    radius = _find_circle_radius(place, size, bar) if sure is None else sure
    if radius is None:
        return 0
    try:
        missed = count_missing_roots(radius, root, matrix_at)
    except RuntimeError:  # exactly singular on the circle
        return None
    return None if sure is None and missed else missed


def _find_circle_radius(place: float, size: Array, bar: Array) -> float | None:
    """The middle of the gap between roots with their bars that is nearest to a place [1/s]; None where there is none."""
    order = np.argsort(size)
    inner = np.maximum.accumulate((size + bar)[order])[:-1]
    outer = np.minimum.accumulate((size - bar)[order][::-1])[::-1][1:]
    gaps = outer > (1.0 + NO_GAP) * inner
    if not gaps.any():
        return None
    floor = max(float(outer.max()) * np.finfo(float).eps, TINY)
    middle = np.sqrt(np.maximum(inner[gaps], floor)) * np.sqrt(outer[gaps])
    return float(middle[np.abs(np.log(middle / place)).argmin()])


def _solve_direct(a: Array, b: Array) -> PencilRoots:
    """Roots of B^-1 A; of its left vectors u those of the pencil are B^-H u."""
    factors = compute_lu_factors(b)
    root, left, right = scipy.linalg.eig(scipy.linalg.lu_solve(factors, a), left=True, right=True)
    return root, right, scipy.linalg.lu_solve(factors, left, trans=2)


def _solve_shift_inverse(a: Array, b: Array, shift: float) -> PencilRoots:
    """Roots of (A - shift B)^-1 B, shift + 1 / mu; of its left vectors u those of the pencil are (A - shift B)^-H u."""
    factors = compute_lu_factors(a - shift * b)
    values, left, right = scipy.linalg.eig(scipy.linalg.lu_solve(factors, b), left=True, right=True)
    safe = np.where(values == 0.0, TINY, values)
    return np.asarray(shift + 1 / safe, dtype=complex), right, scipy.linalg.lu_solve(factors, left, trans=2)


def _find_slow_roots(a: Array, b: Array, smallest: float) -> tuple[PencilRoots, float]:
    """Slow roots about zero where A, rows and columns of unit size, is regular beyond rounding, else about a shift [1/s].

    So small a shift as the ``smallest`` hides all but motions without stiffness: near the slowest others all are known.
    """
    unit = a / np.maximum(np.abs(a).max(axis=1), TINY)[:, None]
    unit = unit / np.maximum(np.abs(unit).max(axis=0), TINY)
    if np.abs(np.diag(scipy.linalg.lu(unit, permute_l=True)[1])).min() > SMALLEST_PIVOT:
        return _solve_shift_inverse(a, b, 0.0), 0.0
    found = _solve_shift_inverse(a, b, smallest)
    shift = choose_shift(found[0], smallest)
    return (found if shift == smallest else _solve_shift_inverse(a, b, shift)), shift


def compute_lu_factors(matrix: RealOrComplex) -> tuple[RealOrComplex, RealOrComplex]:
    """LU of a matrix that may be singular: a pivot of nothing is rounding, and what it belongs to is as large as that."""
    factorise = scipy.linalg.get_lapack_funcs("getrf", (matrix,))
    factors, swaps, _ = factorise(matrix)
    pivots = np.diag(factors)
    nothing = np.flatnonzero(pivots == 0.0)
    factors[nothing, nothing] = np.finfo(float).eps * np.abs(pivots).max(initial=TINY)
    return factors, swaps
