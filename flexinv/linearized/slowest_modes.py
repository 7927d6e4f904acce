"""The slowest modes of M y'' + K y = 0 where freedoms are many: sparse factors and Krylov subspaces, memory and time linear.

Eigenvalues mu of (K + shift M)^-1 M are 1 / (omega^2 + shift): the slowest motions are the largest, and freedoms without inertia
(mu = 0) need no care.  The shift makes K + shift M positive definite but for such freedoms, so that nothing is below it; it is
zero where K is so by itself.  That no mode is left out is proved each time by Sylvester's law of inertia: K - omega^2 M has as
many negative pivots as there are modes below omega; where K is not symmetric, by the argument principle (`root_counts`).
Source: Ericsson, Ruhe, *The spectral transformation Lanczos method*, Math. Comp. 35(152), 1980; ARPACK.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.errors import ConvergenceError, InputError
from flexinv.linearized.eigenvalues import (
    CANCELLED,
    CIRCULATORY,
    NO_STIFFNESS,
    SOFT,
    choose_shift,
    compute_order,
    count_sure_negative_pivots,
    drop_rounded_parts,
    solve_held,
    split_by_inertia,
)
from flexinv.linearized.root_counts import count_missing_roots
from flexinv.linearized.root_discs import compute_root_discs
from flexinv.typing import Array, Indices, RealOrComplex, Sparse

# A pivot of K with a unit diagonal below this part is rounding, that of a motion without stiffness: some hundreds of roundings.
# That of a beam of n nodes is 1 / (4 n^3).
ROUNDED_PIVOT = 1e-13
# So many modes more than are asked for are found: between two of them lies the place where modes are counted.
SPARE_MODES = 4
# Times that the number of modes looked for is doubled, as modes of the same frequency may be found late.
MOST_DOUBLINGS = 3
# Vectors of Arnoldi's method for each root that is looked for, and more: ARPACK's own choice fails where many lie together.
WIDER = 3
WIDER_STILL = 20
# Where no mode more than the count is known: they are counted within so many times the size of the last.
BEYOND_LAST = 1 + 1e-6
# Factor by which a shift grows until it makes K definite; further than this over the smallest one it never does.
GROWS = 10.0
MOST_SHIFT = 1e24
NO_SHIFT = (
    "modes: a freedom has neither inertia nor stiffness, or what has no inertia is unstable; give its link a mass"
)


class ShiftedStiffness:
    """K + shift M in factors, with a unit diagonal; held : its least pivot is none of rounding."""

    def __init__(self, matrix: Sparse) -> None:
        """Raise InputError where the matrix (freedoms, freedoms) is singular."""
        size = np.sqrt(np.abs(matrix.diagonal()))
        self.size = np.where(size > 0.0, size, 1.0)
        unit = scipy.sparse.diags_array(1 / self.size)
        try:
            self.inner = scipy.sparse.linalg.splu(scipy.sparse.csc_array(unit @ matrix @ unit))
        except RuntimeError:  # exactly singular
            raise InputError(NO_SHIFT) from None
        self.least = float(np.abs(self.inner.U.diagonal()).min())

    def solve(self, side: Array, transposed: bool = False) -> Array:
        """Return (K + shift M)^-1 side (freedoms,) [m], [rad], or that of the transposed matrix."""
        return np.asarray(self.inner.solve(side / self.size, "T" if transposed else "N") / self.size)


def find_slowest_modes(stiffness: Sparse, mass: Sparse, count: int) -> tuple[Array, Array]:
    """Return omega^2 (count,) [1/s^2], rising, and shapes (freedoms, count) with unit modal mass, of a symmetric K.

    Raises InputError where a freedom has neither inertia nor stiffness, ConvergenceError where some are missed.
    """
    k, m = (scipy.sparse.csc_array((part + part.T) / 2) for part in (stiffness, mass))
    massless = _count_negative_massless(k, m)
    shift = _find_definite_shift(k, m, massless)
    if shift > 0.0:  # so small a shift hides all but motions without stiffness: near the slowest others all are known
        squared, _ = _run_lanczos(k, m, shift, min(count + SPARE_MODES, _compute_most_modes(k)))
        shift = choose_shift(squared, shift)
        while _count_below(k, m, -shift) != massless:
            shift *= GROWS
    looked_for = count + SPARE_MODES
    for _ in range(MOST_DOUBLINGS + 1):
        looked_for = min(looked_for, _compute_most_modes(k))
        squared, shapes = _run_lanczos(k, m, shift, looked_for)
        if _is_complete(k, m, squared, count, massless):
            break
        looked_for *= 2
    else:
        raise ConvergenceError(
            f"modes: of the {count} slowest modes some are missed: they are too close together; write another count"
        )
    squared = squared[:count]
    shapes = shapes[:, :count]
    if shift > 0.0:
        size = np.abs(shapes)
        known = CANCELLED * np.einsum("km,km->m", size, abs(k) @ size)
        squared = np.where(np.abs(squared) <= known, 0.0, squared)
    return squared, shapes


def _compute_most_modes(k: Sparse) -> int:
    """Most modes that ARPACK finds at once [-]."""
    return int(k.shape[0]) - 2


def _run_lanczos(k: Sparse, m: Sparse, shift: float, count: int) -> tuple[Array, Array]:
    """omega^2 (count,), rising, and shapes of unit modal mass about a shift."""
    factors = ShiftedStiffness(k + shift * m)
    if factors.least < NO_STIFFNESS:
        raise InputError(NO_SHIFT)
    inverse = scipy.sparse.linalg.LinearOperator(k.shape, matvec=factors.solve, dtype=float)
    start = factors.solve(m @ np.random.default_rng(0).standard_normal(k.shape[0]))
    squared, shapes = scipy.sparse.linalg.eigsh(k, count, m, sigma=-shift, OPinv=inverse, v0=start)
    # what freedoms without inertia have of rounding is taken away: x = (K + shift M)^-1 M x / mu
    shapes = (
        factors.solve(m @ shapes) if shapes.ndim == 1 else np.column_stack([factors.solve(m @ x) for x in shapes.T])
    )
    order = np.argsort(squared, kind="stable")
    shapes = shapes[:, order]
    return squared[order], shapes / np.sqrt(np.einsum("km,km->m", shapes, m @ shapes))


def _count_negative_massless(k: Sparse, m: Sparse) -> int:
    """Number of negative pivots of the freedoms without inertia [-]: they are below every omega^2."""
    none = split_by_inertia(m).massless
    if not none.shape[1]:
        return 0
    massless = scipy.sparse.csc_array(none.T @ k @ none)
    solve_held(massless, np.zeros((massless.shape[0], 1)))  # refuses what has no stiffness either
    count = count_sure_negative_pivots(massless)
    if count is None:
        raise InputError(NO_SHIFT)
    return count


def _count_below(stiffness: Sparse, mass: Sparse, squared: float) -> int | None:
    """Number of modes with omega^2 below a value [-], those without inertia with them; None where it is not sure."""
    matrix = stiffness - squared * mass
    size = np.sqrt(np.abs(stiffness.diagonal()) + abs(squared) * mass.diagonal())
    if not size.all():
        raise InputError(NO_SHIFT)
    unit = scipy.sparse.diags_array(1 / size)
    return count_sure_negative_pivots(scipy.sparse.csc_array(unit @ matrix @ unit))


def _find_definite_shift(stiffness: Sparse, mass: Sparse, massless: int) -> float:
    """The smallest shift [1/s^2], of powers of ten, that leaves nothing below zero; 0 where K is definite, beyond rounding."""
    if (
        stiffness.diagonal().all()
        and _count_below(stiffness, mass, 0.0) == massless
        and ShiftedStiffness(stiffness).least > ROUNDED_PIVOT
    ):
        return 0.0
    smallest = SOFT * np.abs(stiffness.diagonal()).max() / np.abs(mass.diagonal()).max() or np.finfo(float).tiny
    shift = smallest
    while _count_below(stiffness, mass, -shift) != massless:
        shift *= GROWS
        if shift > MOST_SHIFT * smallest:
            raise InputError(NO_SHIFT)
    return shift


def _is_complete(k: Sparse, m: Sparse, squared: Array, count: int, massless: int) -> bool:
    """True where as many modes as were found lie below a place between two of them, the count-th below it."""
    if len(squared) <= count:
        return True
    gap = np.diff(squared[count - 1 :])
    at = count - 1 + int(gap.argmax())
    place = (squared[at] + squared[at + 1]) / 2
    return _count_below(k, m, float(place)) == massless + at + 1


def find_slowest_circulatory(stiffness: Sparse, mass: Sparse, count: int) -> tuple[RealOrComplex, RealOrComplex, Array]:
    """Return omega^2 (count,) [1/s^2], by size, shapes (freedoms, count) of unit modal mass, and error bars; K is not symmetric.

    As `circulatory`, by Arnoldi's method; of a pair that the count parts both are returned.  There is no law of inertia here:
    that none is missed is proved by the argument principle (`root_counts`), and discs of the pencil between the vectors see wrong
    ones and roots that are there twice (`root_discs`).
    Raises InputError where a freedom has neither inertia nor stiffness, ConvergenceError where some are missed.
    """
    k, m = (scipy.sparse.csc_array(part) for part in (stiffness, mass))
    refuse_loose(k, m)
    smallest = SOFT * np.abs(k.diagonal()).max() / np.abs(m.diagonal()).max()
    shift = 0.0 if k.diagonal().all() and ShiftedStiffness(k).least > ROUNDED_PIVOT else smallest
    looked_for = min(count + SPARE_MODES, _compute_most_modes(k))
    if shift > 0.0:
        shift = choose_shift(_run_arnoldi(k, m, shift, looked_for)[0], shift)
    squared, right, left, discs = _find_complete_set(k, m, shift, count, looked_for)
    weight = np.abs(np.einsum("km,km->m", left, m @ right))
    known = CIRCULATORY * np.einsum("km,km->m", np.abs(left), abs(k) @ np.abs(right)) / weight
    if shift == 0.0:
        known = np.minimum(known, SOFT**0.5 * np.abs(squared))  # K is definite beyond rounding: nothing is zero
    squared, right = drop_rounded_parts(squared, right, known)
    centre, radius = discs
    known = np.maximum(known, radius + np.abs(squared - centre))
    shapes = right / np.sqrt(np.einsum("km,km->m", right.conj(), m @ right).real)
    order = _list_slowest(squared, count)
    order = order[compute_order(squared[order])]
    squared = squared[order]
    shapes = shapes[:, order]
    known = known[order]
    return (squared, shapes, known) if squared.imag.any() else (squared.real, shapes.real, known)


def _find_complete_set(
    k: Sparse, m: Sparse, shift: float, count: int, looked_for: int
) -> tuple[RealOrComplex, RealOrComplex, RealOrComplex, tuple[RealOrComplex, Array]]:
    """omega^2, right and left shapes of at least ``count`` modes about a shift, none of them missed, and their discs."""
    for _ in range(MOST_DOUBLINGS + 1):
        looked_for = min(looked_for, _compute_most_modes(k))
        squared, right, left = _run_arnoldi(k, m, shift, looked_for)
        place = find_gap_beyond(np.abs(squared), count)
        slow = np.abs(squared) < place
        centre, radius = compute_root_discs(k, m, squared[slow], right[:, slow], left[:, slow].conj(), shift)
        if np.isfinite(radius).all() and count_missing_roots(place, squared, lambda z: k - z * m) == 0:
            return squared[slow], right[:, slow], left[:, slow], (centre, radius)
        looked_for *= 2
    raise ConvergenceError(
        f"modes: whether all of the {count} slowest modes under loads that turn along are found is not proved: they are too "
        "close together; write another count"
    )


def _list_slowest(squared: RealOrComplex, count: int) -> Indices:
    """Numbers of the ``count`` slowest modes; of a pair that the count parts both."""
    order = np.argsort(np.abs(squared), kind="stable")
    if count < len(order) and np.isclose(squared[order[count]], squared[order[count - 1]].conj()):
        count += bool(squared[order[count - 1]].imag)
    return order[:count]


def find_krylov_eigenvalues(operator: Any, count: int, start: Array) -> tuple[RealOrComplex, RealOrComplex]:
    """Return the largest eigenvalues (count,) [any unit] of an operator, and vectors, by Arnoldi's method from a start.

    Raises ConvergenceError where they are not found.
    """
    basis = min(operator.shape[0], WIDER * count + WIDER_STILL)
    try:
        values, vectors = scipy.sparse.linalg.eigs(operator, count, v0=start, ncv=basis)
    except scipy.sparse.linalg.ArpackNoConvergence:
        raise ConvergenceError(
            f"modes: Arnoldi's method does not find {count} roots: they are too close together; write another count"
        ) from None
    return values, vectors


def find_two_sided_eigenvalues(
    apply: Callable[[Array], Array], apply_transposed: Callable[[Array], Array], count: int, start: Array
) -> tuple[RealOrComplex, RealOrComplex, RealOrComplex]:
    """Return the largest eigenvalues (count,) [any unit] of an operator, right and left vectors (size, count) in their order.

    apply, apply_transposed : the operator and its transpose, on (size,); each value has the left vector of the nearest of those
    of the transpose that no value before it has taken
    Raises ConvergenceError where they are not found.
    """
    shape = (len(start), len(start))
    operators = (scipy.sparse.linalg.LinearOperator(shape, matvec=f, dtype=float) for f in (apply, apply_transposed))
    (values, right), (others, left) = (find_krylov_eigenvalues(f, count, start) for f in operators)
    free = np.ones(len(others), dtype=bool)
    order = []
    for value in values:
        nearest = int(np.where(free, np.abs(others - value), np.inf).argmin()) if free.any() else 0
        free[nearest] = False
        order.append(nearest)
    return values, right, left[:, order]


def apply_to_columns(operator: Callable[[Array], Array], vectors: RealOrComplex) -> RealOrComplex:
    """Return the images (size, count) of complex columns under a real operator [any unit]."""
    return np.column_stack([operator(x.real) + 1j * operator(x.imag) for x in vectors.T])


def find_gap_beyond(size: Array, count: int) -> float:
    """Return the middle of the widest gap [any unit] between sizes of roots (modes,), beyond the first ``count``."""
    level = np.sort(size)
    if len(level) <= count:
        return float(level[-1] * BEYOND_LAST)
    ratio = level[count:] / np.maximum(level[count - 1 : -1], np.finfo(float).tiny)
    at = count + int(ratio.argmax())
    return float(np.sqrt(level[at] * level[at - 1])) if level[at - 1] > 0.0 else float(level[at] / 2)


def refuse_loose(k: Sparse, m: Sparse) -> None:
    """Raise InputError where a freedom has neither inertia nor stiffness [N m]."""
    none = split_by_inertia(m).massless
    if none.shape[1]:
        solve_held(scipy.sparse.csc_array(none.T @ k @ none), np.zeros((none.shape[1], 1)))


def _run_arnoldi(k: Sparse, m: Sparse, shift: float, count: int) -> tuple[RealOrComplex, RealOrComplex, RealOrComplex]:
    """omega^2 (count,), right and left shapes (freedoms, count) about a shift; left ones those of the nearest value."""
    factors = ShiftedStiffness(k + shift * m)
    if factors.least < NO_STIFFNESS:
        raise InputError(NO_SHIFT)
    start = factors.solve(m @ np.random.default_rng(0).standard_normal(k.shape[0]))

    def apply_inverse(x: Array) -> Array:
        return factors.solve(m @ x)

    def apply_transposed_inverse(x: Array) -> Array:
        return factors.solve(m.T @ x, transposed=True)

    values, right, left = find_two_sided_eigenvalues(apply_inverse, apply_transposed_inverse, count, start)
    # what fast motions have of rounding is taken away: x = (K + shift M)^-1 M x / mu
    right = apply_to_columns(apply_inverse, right) / values
    return 1 / values - shift, right, apply_to_columns(apply_transposed_inverse, left)
