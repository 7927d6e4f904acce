"""All roots of A z = s B z from both ends, fast ones of B^-1 A and slow ones of (A - shift B)^-1 B, and that none is lost.

Each end loses 1e-16 of its largest value, and so the other end: they part at a place between two roots.  Each end gives as many
values as the pencil has roots, each once.  But rounding may move one across that place, and it is lost, or there twice.  So the
roots are counted by the argument principle (`root_counts`) within a circle that none reaches with its error bar: with as many
inside, and as many outside as are left, none is lost.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import NDArray

from flexinv.errors import ConvergenceError, ModelWarning
from flexinv.linearized.eigenvalues import choose_shift
from flexinv.linearized.root_counts import count_missing_roots
from flexinv.typing import Array, Complex, Sparse

# Of A, rows and columns of unit size: a pivot below this part is rounding, that of a motion without stiffness.
SMALLEST_PIVOT = 1e-13
# Roots whose sizes differ by less, as +w and -w, are on the same side: each end may find another one of them below the place.
NO_GAP = 1e-3
# A gap one e-fold wider is worth as much as one so many e-folds nearer to the mean of the slowest and the fastest.
PART_OF_MEAN = 0.2
# A bar beyond this part of its root leaves no digit of it.
NO_DIGIT = 0.1
# Places where the ends may part that are tried one after the other, the best first.
MOST_PLACES = 4

PencilRoots = tuple[Complex, Complex, Complex]
# Roots, right and left vectors, bars of rounding, and what else is not known of a root.
Corrected = tuple[Complex, Complex, Complex, Array, Array]


def counted_roots(
    a: Array,
    b: Array,
    smallest: float,
    corrected: Callable[[PencilRoots, float], Corrected],
    matrix_at: Callable[[complex], Sparse],
) -> Corrected:
    """Return all roots [1/s], [1/s^2] of A - s B as they are ``corrected`` at the shift of the slow ones.

    smallest : shift; corrected : roots, vectors and bars by values of the pencil and that shift
    matrix_at : P(s), sparse, whose determinant has the same roots, and faster ones
    Raises ConvergenceError where a root is lost; a ModelWarning says where that none is lost is not proved.
    """
    fast = _direct(a, b)
    slow, shift = _slow(a, b, smallest)
    missed = []
    for place, values in _parted(slow, fast):
        result = corrected(values, shift)
        root, _, _, bar, lost = result
        missed.append(_missed(place, root, bar + lost, matrix_at))
        if missed[-1] == 0:
            return result
        if missed[-1] is None:
            warnings.warn(
                f"modes: that none of {len(root)} roots is lost is not proved: they are too close together to be counted near "
                f"{place:.3g} 1/s; compare with another number of elements",
                ModelWarning,
                stacklevel=2,
            )
            return result
    raise ConvergenceError(
        f"modes: of {len(a)} roots {max(map(abs, filter(None, missed)))} are lost, or there twice, as rounding hides slow ones "
        "from fast ones; write fewer elements, or stiffness and inertia of more like sizes"
    )


def _parted(slow: PencilRoots, fast: PencilRoots) -> Iterator[tuple[float, PencilRoots]]:
    """Yield places [1/s], the best first, with slow values within them and fast ones beyond; at last fast ones alone."""
    size = np.abs(fast[0])
    for place in _places(np.abs(slow[0]), np.sort(size)):
        within = np.abs(slow[0]) <= place
        beyond = size > place
        root, x, y = (
            np.concatenate([s[..., within], f[..., beyond]], axis=-1) for s, f in zip(slow, fast, strict=True)
        )
        yield place, (root, x, y)
    yield float(np.sqrt(max(size.min(), np.finfo(float).tiny) * size.max())), fast


def _places(slow: Array, fast: Array) -> list[float]:
    """Places [1/s] where both ends have found as many on each side, by rising sizes: the widest gaps about the mean first."""
    count = len(fast)
    if count < 2:
        return []
    floor = max(float(fast[-1]) * np.finfo(float).eps, np.finfo(float).tiny)
    level = np.log(np.maximum(fast, floor))
    middle = (level[0] + level[-1]) / 2
    worth = {}
    for k in range(1, count):
        gap = level[k] - level[k - 1]
        place = float(np.exp((level[k - 1] + level[k]) / 2))
        if gap >= NO_GAP and (slow <= place).sum() + (fast > place).sum() == count:
            worth[place] = gap - abs(np.log(place) - middle) * PART_OF_MEAN
    return sorted(worth, key=lambda place: -worth[place])[:MOST_PLACES]


def _missed(place: float, root: Complex, bar: Array, matrix_at: Callable[[complex], Sparse]) -> int | None:
    """Return the number of roots that are missed within the circle nearest to a place [1/s]; None where it is not sure.

    A root of which no digit is known, as one of several together that are zero, may be anything slower: circles beyond are tried
    first.  Where no circle parts the roots, all are alike to what is known of them, and of one end.
    """
    size = np.abs(root)
    sure = _radius(place, size, np.where(bar > NO_DIGIT * size, np.maximum(bar, size), bar))
    radius = _radius(place, size, bar) if sure is None else sure
    if radius is None:
        return 0
    try:
        missed = count_missing_roots(radius, root, matrix_at)
    except RuntimeError:  # exactly singular on the circle
        return None
    return None if sure is None and missed else missed


def _radius(place: float, size: Array, bar: Array) -> float | None:
    """The middle of the gap between roots with their bars that is nearest to a place [1/s]; None where there is none."""
    order = np.argsort(size)
    inner = np.maximum.accumulate((size + bar)[order])[:-1]
    outer = np.minimum.accumulate((size - bar)[order][::-1])[::-1][1:]
    gaps = outer > (1.0 + NO_GAP) * inner
    if not gaps.any():
        return None
    floor = max(float(outer.max()) * np.finfo(float).eps, np.finfo(float).tiny)
    middle = np.sqrt(np.maximum(inner[gaps], floor)) * np.sqrt(outer[gaps])
    return float(middle[np.abs(np.log(middle / place)).argmin()])


def _direct(a: Array, b: Array) -> PencilRoots:
    """Roots of B^-1 A; of its left vectors u those of the pencil are B^-H u."""
    factors = factors_of(b)
    root, left, right = scipy.linalg.eig(scipy.linalg.lu_solve(factors, a), left=True, right=True)
    return root, right, scipy.linalg.lu_solve(factors, left, trans=2)


def _inverse(a: Array, b: Array, shift: float) -> PencilRoots:
    """Roots of (A - shift B)^-1 B, shift + 1 / mu; of its left vectors u those of the pencil are (A - shift B)^-H u."""
    factors = factors_of(a - shift * b)
    values, left, right = scipy.linalg.eig(scipy.linalg.lu_solve(factors, b), left=True, right=True)
    safe = np.where(values == 0.0, np.finfo(float).tiny, values)
    return np.asarray(shift + 1 / safe, dtype=complex), right, scipy.linalg.lu_solve(factors, left, trans=2)


def _slow(a: Array, b: Array, smallest: float) -> tuple[PencilRoots, float]:
    """Slow roots about zero where A, rows and columns of unit size, is regular beyond rounding, else about a shift [1/s].

    So small a shift as the ``smallest`` hides all but motions without stiffness: near the slowest others all are known.
    """
    unit = a / np.maximum(np.abs(a).max(axis=1), np.finfo(float).tiny)[:, None]
    unit = unit / np.maximum(np.abs(unit).max(axis=0), np.finfo(float).tiny)
    if np.abs(np.diag(scipy.linalg.lu(unit, permute_l=True)[1])).min() > SMALLEST_PIVOT:
        return _inverse(a, b, 0.0), 0.0
    found = _inverse(a, b, smallest)
    shift = choose_shift(found[0], smallest)
    return (found if shift == smallest else _inverse(a, b, shift)), shift


def factors_of(matrix: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """LU of a matrix that may be singular: a pivot of nothing is rounding, and what it belongs to is as large as that."""
    factorise = scipy.linalg.get_lapack_funcs("getrf", (matrix,))
    factors, swaps, _ = factorise(matrix)
    pivots = np.diag(factors)
    nothing = np.flatnonzero(pivots == 0.0)
    factors[nothing, nothing] = np.finfo(float).eps * np.abs(pivots).max(initial=np.finfo(float).tiny)
    return factors, swaps
