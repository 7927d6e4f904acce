"""All roots of A z = s B z from both ends, fast ones of B^-1 A and slow ones of (A - shift B)^-1 B, and that none is lost.

Each end loses 1e-16 of its largest value, and so the other end: they part at a place between two roots.  Each end gives as many
values as the pencil has roots.  What it gives on its own side of that place may be one too many, as rounding moves another one
across.  So the number of roots within |s| = place is counted by the argument principle (`root_counts`): with as many found there,
and as many beyond as are left, none is lost and none is there twice.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import NDArray

from flexinv.errors import ConvergenceError, ModelWarning
from flexinv.linearized.eigenvalues import near_slowest
from flexinv.linearized.root_counts import missed_within
from flexinv.typing import Array, Complex, Sparse

# Of A, rows and columns of unit size: a pivot below this part is rounding, that of a motion without stiffness.
SMALLEST_PIVOT = 1e-13
# Roots whose sizes differ by less, as +w and -w, are on the same side: each end may find another one of them below the place.
NO_GAP = 1e-3
# A gap one e-fold wider is worth as much as one so many e-folds nearer to the mean of the slowest and the fastest.
PART_OF_MEAN = 0.2
# Places where the ends may part that are tried one after the other, the best first.
MOST_PLACES = 4

Values = tuple[Complex, Complex, Complex]


def roots_of_pencil(
    a: Array, b: Array, smallest: float, matrix_at: Callable[[complex], Sparse]
) -> tuple[Values, float]:
    """Return all roots [1/s], [1/s^2] with right and left vectors of A - s B, and the shift of the slow ones.

    smallest : shift; matrix_at : P(s), sparse, whose determinant has the same roots within any place where the ends part
    Raises ConvergenceError where a root is lost; a ModelWarning says where that none is lost is not proved.
    """
    fast = _direct(a, b)
    slow, shift = _slow(a, b, smallest)
    places = _places(slow[0], fast[0])
    if not places:
        return fast, shift
    missed = []
    for place in places:
        found = _parted(slow, fast, place)
        missed.append(_missed(place, found[0], matrix_at))
        if missed[-1] == 0:
            return found, shift
    if any(number is not None for number in missed):
        raise ConvergenceError(
            f"modes: of {len(a)} roots {abs(next(number for number in missed if number))} are lost, or there twice, as rounding "
            f"hides those slower than {places[0]:.3g} 1/s from the faster ones; write fewer elements, or stiffness and inertia "
            "of more like sizes"
        )
    warnings.warn(
        f"modes: that none of {len(a)} roots is lost is not proved: they are too close together to be counted within "
        f"{places[0]:.3g} 1/s; compare with another number of elements",
        ModelWarning,
        stacklevel=2,
    )
    return _parted(slow, fast, places[0]), shift


def _places(slow: Complex, fast: Complex) -> list[float]:
    """Places [1/s] where both ends have found as many on each side, the widest gaps about the mean first."""
    size = np.sort(np.abs(fast))
    count = len(size)
    if count < 2:
        return []
    floor = max(float(size[-1]) * np.finfo(float).eps, np.finfo(float).tiny)
    level = np.log(np.maximum(size, floor))
    middle = (level[0] + level[-1]) / 2
    worth = {}
    for k in range(1, count):
        gap = level[k] - level[k - 1]
        place = float(np.exp((level[k - 1] + level[k]) / 2))
        within = int((np.abs(slow) <= place).sum())
        beyond = int((size > place).sum())
        if gap >= NO_GAP and within + beyond == count:
            worth[place] = gap - abs(np.log(place) - middle) * PART_OF_MEAN
    return sorted(worth, key=lambda place: -worth[place])[:MOST_PLACES]


def _parted(slow: Values, fast: Values, place: float) -> Values:
    """Slow values within a place [1/s], and fast ones beyond."""
    within = np.abs(slow[0]) <= place
    beyond = np.abs(fast[0]) > place
    root, x, y = (np.concatenate([s[..., within], f[..., beyond]], axis=-1) for s, f in zip(slow, fast, strict=True))
    return root, x, y


def _missed(place: float, root: Complex, matrix_at: Callable[[complex], Sparse]) -> int | None:
    try:
        return missed_within(place, root, matrix_at)
    except RuntimeError:  # exactly singular on the circle
        return None


def _direct(a: Array, b: Array) -> Values:
    """Roots of B^-1 A; of its left vectors u those of the pencil are B^-H u."""
    factors = factors_of(b)
    root, left, right = scipy.linalg.eig(scipy.linalg.lu_solve(factors, a), left=True, right=True)
    return root, right, scipy.linalg.lu_solve(factors, left, trans=2)


def _inverse(a: Array, b: Array, shift: float) -> Values:
    """Roots of (A - shift B)^-1 B, shift + 1 / mu; of its left vectors u those of the pencil are (A - shift B)^-H u."""
    factors = factors_of(a - shift * b)
    values, left, right = scipy.linalg.eig(scipy.linalg.lu_solve(factors, b), left=True, right=True)
    safe = np.where(values == 0.0, np.finfo(float).tiny, values)
    return np.asarray(shift + 1 / safe, dtype=complex), right, scipy.linalg.lu_solve(factors, left, trans=2)


def _slow(a: Array, b: Array, smallest: float) -> tuple[Values, float]:
    """Slow roots about zero where A, rows and columns of unit size, is regular beyond rounding, else about a shift [1/s].

    So small a shift as the ``smallest`` hides all but motions without stiffness: near the slowest others all are known.
    """
    unit = a / np.maximum(np.abs(a).max(axis=1), np.finfo(float).tiny)[:, None]
    unit = unit / np.maximum(np.abs(unit).max(axis=0), np.finfo(float).tiny)
    if np.abs(np.diag(scipy.linalg.lu(unit, permute_l=True)[1])).min() > SMALLEST_PIVOT:
        return _inverse(a, b, 0.0), 0.0
    found = _inverse(a, b, smallest)
    shift = near_slowest(found[0], smallest)
    return (found if shift == smallest else _inverse(a, b, shift)), shift


def factors_of(matrix: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """LU of a matrix that may be singular: a pivot of nothing is rounding, and what it belongs to is as large as that."""
    factorise = scipy.linalg.get_lapack_funcs("getrf", (matrix,))
    factors, swaps, _ = factorise(matrix)
    pivots = np.diag(factors)
    nothing = np.flatnonzero(pivots == 0.0)
    factors[nothing, nothing] = np.finfo(float).eps * np.abs(pivots).max(initial=np.finfo(float).tiny)
    return factors, swaps
