"""Eigenvalues of M y'' + K y = 0 where some freedoms have no inertia and some motions no stiffness.

Freedoms without inertia follow the others: what they do is eliminated, exactly (`build_massless_elimination`).  Of the rest slow
motions are found exactly where K is positive definite; what moves without stiffness is taken out of K before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.dynamics.index1 import MASSLESS, NO_INERTIA
from flexinv.errors import ConvergenceError, InputError
from flexinv.typing import Array, Indices, RealOrComplex, Sparse

# Of w^2 over the largest one, what rounding leaves of a freedom without stiffness.
SOFT = 1e-12
# Motions with w^2 below so many shifts are told apart without it: the others are known to 1e-16 of fastest over slowest of them.
SOFTER = 1e3
# A w^2 below this part of its terms' absolute sum is what is left of terms that cancel: a rigid motion, neither stable nor
# unstable.  Some tens of operations leave 1e-15; where the terms are zero, rounding of the largest entry is left.
CANCELLED = 1e-13
LARGEST_ROUNDED = 1e-16
# Of a stiffness with a unit diagonal: what rounding leaves of its symmetry, and of an eigenvalue that is zero, for each freedom.
SYMMETRIC = 1e-9
LEAST = 1e-15
# Roundings of an omega^2 over the absolute sum of its terms, where K is not symmetric.
CIRCULATORY = 1e-13
# A shift over the size of an omega^2 near which it is: one that is minus the shift makes the matrix singular.
OFF_ROOT = 1.37
# Of a pivot of a stiffness with a unit diagonal: below this the freedom has none.
NO_STIFFNESS = 1e-14

# Pivots on the diagonal are safe as long as entries do not grow by more than this.
GROWTH = 1e6
# Freedoms up to which eigenvalues are found one and all, by dense matrices.
ONE_AND_ALL = 300
# Freedoms up to which eigenvalues are counted by a dense matrix, and how often others are moved by rounding before that fails.
COUNTED = 1500
MOST_MOVES = 8


class Split(NamedTuple):
    """Freedoms with inertia (freedoms, n), and those without (freedoms, m) as combinations of the march's: sparse bases."""

    massive: Sparse
    massless: Sparse


def split_by_inertia(mass: Sparse) -> Split:
    """Return bases of the motions with and without inertia; M [kg m^2] positive semidefinite, in scaled unknowns.

    M couples few freedoms with each other: each such set is judged by itself, over its own inertias.
    """
    diagonal = mass.diagonal()
    none = diagonal <= MASSLESS * diagonal.max(initial=0.0)
    size = np.where(none, 1.0, np.sqrt(np.abs(diagonal)))
    unit = scipy.sparse.csr_array(scipy.sparse.diags_array(1 / size) @ mass @ scipy.sparse.diags_array(1 / size))
    sets, label = scipy.sparse.csgraph.connected_components(unit, directed=False)
    order = np.argsort(label, kind="stable")
    ends = np.cumsum(np.bincount(label, minlength=sets))
    alone = np.diff(ends, prepend=0)[label] == 1
    massive = [_build_columns(np.flatnonzero(alone & ~none), size)]
    massless = [_build_columns(np.flatnonzero(alone & none), size)]
    for k in np.unique(label[~alone]):
        block = order[ends[k - 1] if k else 0 : ends[k]]
        values, vectors = scipy.linalg.eigh(unit[block][:, block].toarray())
        for found, which in ((massive, values > NO_INERTIA), (massless, values <= NO_INERTIA)):
            rows, columns = np.meshgrid(block, np.arange(which.sum()), indexing="ij")
            found.append((rows.ravel(), columns.ravel(), (vectors[:, which] / size[block, None]).ravel()))
    return Split(_build_basis(massive, len(size)), _build_basis(massless, len(size)))


def _build_columns(which: RealOrComplex, size: Array) -> tuple[RealOrComplex, ...]:
    """Columns of freedoms alone, of unit inertia as those of sets: thresholds compare entries of all of them."""
    return which, np.arange(len(which)), 1.0 / size[which]


def _build_basis(parts: list[tuple[RealOrComplex, ...]], size: int) -> Sparse:
    """Columns of all parts side by side."""
    first = 0
    shifted = []
    for _, columns, _ in parts:
        shifted.append(columns + first)
        first += int(columns.max(initial=-1)) + 1
    rows, values = (np.concatenate([part[k] for part in parts]) for k in (0, 2))
    places = rows.astype(np.int64), np.concatenate(shifted).astype(np.int64)
    return scipy.sparse.csc_array((values, places), shape=(size, first))


def build_massless_elimination(stiffness: Sparse, split: Split) -> Sparse:
    """Return N (freedoms, massive) [-]: all freedoms by those with inertia, others in equilibrium, K_00 b = -K_01 a.

    Raises InputError where a freedom has neither inertia nor stiffness.
    """
    count = split.massless.shape[1]
    if not count:
        return split.massive
    massless = scipy.sparse.csc_array(split.massless.T @ stiffness @ split.massless)
    across = scipy.sparse.csc_array(split.massless.T @ stiffness @ split.massive)
    touched = np.flatnonzero(np.diff(across.indptr))
    follow = np.zeros(across.shape)
    follow[:, touched] = solve_held(massless, across[:, touched].toarray())
    return scipy.sparse.csc_array(split.massive - split.massless @ scipy.sparse.csc_array(follow))


def solve_held(stiffness: Sparse, sides: Array) -> Array:
    """Return K^-1 sides (freedoms, sides); raises InputError where a freedom has no stiffness [N m]."""
    size = np.sqrt(np.abs(stiffness).max(axis=1).toarray().ravel())
    nothing = "modes: a freedom has neither inertia nor stiffness; give its link a mass"
    if not size.all():
        raise InputError(nothing)
    unit = scipy.sparse.csc_array(scipy.sparse.diags_array(1 / size) @ stiffness @ scipy.sparse.diags_array(1 / size))
    try:
        factors = scipy.sparse.linalg.splu(unit)
    except RuntimeError:  # exactly singular
        raise InputError(nothing) from None
    if np.abs(factors.U.diagonal()).min() < NO_STIFFNESS:
        raise InputError(nothing)
    return np.asarray(factors.solve(sides / size[:, None]) / size[:, None])


def find_undamped_modes(stiffness: Sparse, mass: Sparse) -> tuple[Array, Array]:
    """Return omega^2 (modes,) [1/s^2], rising, and shapes (freedoms, modes) with unit modal mass, of a symmetric K.

    Freedoms without inertia follow the others.  What moves without stiffness, or falls, is taken out of K first.  What is left
    is positive definite, and found from both ends.

    Elimination and factorization of n rows move entries of K by some n eps sqrt(k_ii k_jj), so that a slow omega^2 is known a
    hundred times less than K itself is.  Shapes x are off by as much; x^T K x over x^T M x by its square, and by rounding of its
    own terms.  Sources: Higham, Accuracy and Stability, 10.1; Parlett, The Symmetric Eigenvalue Problem, 1.5.
    """
    moves = build_massless_elimination(stiffness, split_by_inertia(mass))
    k, m = ((moves.T @ part @ moves).toarray() for part in (stiffness, mass))
    k = (k + k.T) / 2
    m = (m + m.T) / 2
    soft = _find_soft_motions(k, m)
    # Q^T M x = 0 for the soft motions x: what is left of K moves by Q, and soft motions take no part in it
    rest = scipy.linalg.qr(m @ soft)[0][:, soft.shape[1] :] if soft.shape[1] else np.eye(len(k))
    inner, inertia = (rest.T @ part @ rest for part in (k, m))
    squared, shapes = _find_soft_modes(k, m, soft)
    if rest.shape[1]:
        others, stiff = _solve_from_both_ends((inner + inner.T) / 2, (inertia + inertia.T) / 2)
        others = np.where(others <= _compute_pivot_rounding(inner, inertia, stiff), 0.0, others)
        squared = np.concatenate([squared, others])
        shapes = np.hstack([shapes, rest @ stiff])
    whole = np.asarray(moves @ shapes)
    inert, stiff = (np.einsum("um,um->m", whole, part @ whole) for part in (mass, stiffness))
    squared = np.where(squared == 0.0, 0.0, stiff / inert)
    order = np.argsort(squared, kind="stable")
    return squared[order], (whole / np.sqrt(inert))[:, order]


def _solve_from_both_ends(k: Array, m: Array) -> tuple[Array, Array]:
    """Return all omega^2 (modes,) [1/s^2], rising, and shapes (freedoms, modes) of a positive definite K [N m].

    Slow ones by 1 / omega^2 of M by K, which is known to 1e-16 of that of the slowest.  They are taken out of K, by Q with
    x^T M Q = 0, and fast ones found by omega^2 of K by M, known to 1e-16 of the fastest.  They part at the mean of both ends:
    each loses the root of what one end alone would lose of the other, and as many are found as there are freedoms.
    """
    values, vectors, shift = _find_inverse_roots(k, m)
    fastest = float(np.divide(*(np.einsum("km,kl,lm->m", vectors, part, vectors) for part in (k, m))).max())
    slow = values >= np.sqrt(values[-1] / fastest)
    found = vectors[:, slow][:, ::-1]
    rest = scipy.linalg.qr(m @ found)[0][:, found.shape[1] :]
    inner, inertia = (rest.T @ part @ rest for part in (k, m))
    squared, fast = scipy.linalg.eigh((inner + inner.T) / 2, (inertia + inertia.T) / 2)
    return np.concatenate([1.0 / values[slow][::-1] - shift, squared]), np.hstack([found, rest @ fast])


def _find_inverse_roots(k: Array, m: Array) -> tuple[Array, Array, float]:
    """Return 1 / (omega^2 + shift) (modes,) [s^2], rising, their shapes, and the shift [1/s^2].

    It is 0 but where rounding hides that K is positive definite, of which one library of linear algebra judges otherwise than
    another.
    """
    shift = 0.0
    smallest = _compute_smallest_shift(k, m)
    while True:
        try:
            values, vectors = scipy.linalg.eigh(m, k + shift * m)
        except scipy.linalg.LinAlgError:
            if shift > smallest / SOFT**2:
                raise
            shift = max(10.0 * shift, smallest)
        else:
            return values, vectors, shift


def _compute_smallest_shift(k: Array, m: Array) -> float:
    """Return the omega^2 [1/s^2] that is just above rounding of the fastest, above zero."""
    tiny = float(np.finfo(float).tiny)
    return max(SOFT * float(np.abs(k).max(initial=0.0)) / max(float(np.abs(m).max(initial=0.0)), tiny), tiny)


def choose_shift(squared: RealOrComplex, shift: float) -> float:
    """Return a shift [1/s^2] as large as the slowest motion with stiffness, of omega^2 (modes,) that a small shift has shown."""
    size = np.abs(squared)
    slow = size <= shift
    if not slow.any() or slow.all():
        return shift
    return OFF_ROOT * float(size[~slow].min())


def drop_rounded_parts(
    squared: RealOrComplex, shapes: RealOrComplex, known: Array
) -> tuple[RealOrComplex, RealOrComplex]:
    """Return omega^2 (modes,) [1/s^2] that are zero or real but for what they are ``known`` to, and their shapes, real ones.

    A real double root comes as a pair a +- i b of shapes, of which a and b are shapes of its own.
    """
    twin = squared.imag < 0.0
    out = np.where(np.abs(squared) <= known, 0.0, squared)
    out = np.where(np.abs(out.imag) <= known, out.real, out)
    return out, np.where(out.imag == 0.0, np.where(twin, shapes.imag, shapes.real), shapes)


def compute_order(squared: RealOrComplex) -> Indices:
    """Return the order of omega^2 (modes,) [1/s^2]: rising where all are real, by size where some are not.

    Of a pair the one comes first whose motion grows with a positive imaginary part, omega^2 = a - i b.
    """
    if not squared.imag.any():
        return np.argsort(squared.real, kind="stable")
    order = np.argsort(np.abs(squared), kind="stable")
    for k in range(len(order) - 1):
        one = squared[order[k]]
        other = squared[order[k + 1]]
        if one.imag > 0.0 and abs(one - np.conj(other)) < SYMMETRIC * abs(one):
            order[k], order[k + 1] = order[k + 1], order[k]
    return order


def is_symmetric(stiffness: Sparse) -> bool:
    """Return True where K with a unit diagonal [-] is symmetric but for rounding."""
    unit = scale_to_unit_diagonal(stiffness)
    return bool(abs(unit - unit.T).max() <= SYMMETRIC) if unit.shape[0] else True


def _find_soft_motions(k: Array, m: Array) -> Array:
    """The motions (freedoms, soft) without which K is positive definite: none where it is so already.

    They are the slowest ones by K + shift M with the smallest shift that makes it definite.  So large a part of 1 / (omega^2 +
    shift) is theirs that nothing else can be read from these eigenvalues.
    """
    if not k.any() and _is_definite(m):  # all motions are, and no shift of K is in scale with M
        return np.eye(len(k))
    shift = 0.0
    smallest = _compute_smallest_shift(k, m)
    while not _is_definite(k + shift * m):
        if shift > smallest / SOFT**2:
            raise InputError("modes: a freedom has neither inertia nor stiffness; give its link a mass")
        shift = max(10.0 * shift, smallest)
    if shift == 0.0:
        return np.empty((len(k), 0))
    values, vectors = scipy.linalg.eigh(m, k + shift * m)
    return np.asarray(vectors[:, values > 1.0 / ((1.0 + SOFTER) * shift)])


def _find_soft_modes(k: Array, m: Array, soft: Array) -> tuple[Array, Array]:
    """omega^2 [1/s^2] of the soft motions among each other, zero where it is rounding of K, and their shapes."""
    if not soft.shape[1]:
        return np.empty(0), soft
    squared, vectors = scipy.linalg.eigh(soft.T @ k @ soft, soft.T @ m @ soft)
    shapes = soft @ vectors
    stiff = np.abs(k)
    size = np.abs(shapes)  # of unit modal mass
    rounding = (
        CANCELLED * np.einsum("km,kl,lm->m", size, stiff, size) + LARGEST_ROUNDED * stiff.max() * size.max(axis=0) ** 2
    )
    return np.where(np.abs(squared) <= rounding, 0.0, squared), shapes


def _compute_pivot_rounding(k: Array, m: Array, shapes: Array) -> Array:
    """The omega^2 (modes,) [1/s^2] up to which rounding makes a K positive definite that is not.

    A factorization of n rows is exact for entries off by n eps sqrt(k_ii k_jj) (Higham, Accuracy and Stability, 10.1).
    """
    masses = np.einsum("km,kl,lm->m", shapes, m, shapes)
    return len(k) * float(np.finfo(float).eps) * np.asarray(np.abs(np.diag(k)) @ shapes**2 / masses)


def _is_definite(matrix: Array) -> bool:
    try:
        factor = scipy.linalg.cholesky(matrix)
    except scipy.linalg.LinAlgError:
        return False
    return bool((np.diag(factor) ** 2 > SOFT * np.abs(np.diag(matrix))).all())


def scale_to_unit_diagonal(stiffness: Sparse) -> Sparse:
    """Return a matrix scaled so that its diagonal is 1, -1 or 0 [-]: signs stay, and stiff motions hide no soft ones."""
    size = np.sqrt(np.abs(stiffness.diagonal()))
    size[size == 0.0] = 1.0  # a spherical joint about the axis of its link: nothing holds it
    return scipy.sparse.csc_array(scipy.sparse.diags_array(1 / size) @ stiffness @ scipy.sparse.diags_array(1 / size))


def count_negative_eigenvalues(stiffness: Sparse) -> int:
    """Return the number of negative eigenvalues of a symmetric K (freedoms, freedoms) [N m], beyond rounding [-].

    By Sylvester's law of inertia it is the number of negative pivots of K + shift 1, whatever the order of elimination.
    """
    unit = scale_to_unit_diagonal(stiffness)
    count = unit.shape[0]
    if count <= ONE_AND_ALL:
        return int((scipy.linalg.eigvalsh((unit + unit.T).toarray() / 2) < -LEAST * count).sum())
    unit = (unit + unit.T) / 2 + LEAST * count * scipy.sparse.eye_array(count)
    return count_negative_pivots(scipy.sparse.csc_array(unit))


def count_negative_pivots(symmetric: Sparse) -> int:
    """Return the number of negative pivots [-] of a symmetric matrix with a unit diagonal: that of its negative eigenvalues.

    Where that is not sure, the diagonal is moved by some more roundings; of a matrix of few freedoms eigenvalues are counted.
    Raises ConvergenceError where neither helps.
    """
    count = count_sure_negative_pivots(symmetric)
    if count is None and symmetric.shape[0] <= COUNTED:
        count = int((scipy.linalg.eigvalsh(symmetric.toarray()) < 0.0).sum())
    for more in range(1, MOST_MOVES + 1):
        if count is None:
            moved = symmetric + more * LEAST * symmetric.shape[0] * scipy.sparse.eye_array(symmetric.shape[0])
            count = count_sure_negative_pivots(scipy.sparse.csc_array(moved))
    if count is None:
        raise ConvergenceError(
            "modes: whether the equilibrium is stable is not sure: pivots of its stiffness are rounding; write fewer elements"
        )
    return count


def count_sure_negative_pivots(symmetric: Sparse) -> int | None:
    """Return the number of negative pivots [-] of a symmetric matrix; None where one is so small that it is not sure.

    Pivots stay on the diagonal.
    """
    options = {"SymmetricMode": True}
    try:
        factors = scipy.sparse.linalg.splu(symmetric, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    except RuntimeError:  # exactly singular
        return None
    largest = np.abs(symmetric.data).max(initial=1.0)
    sure = np.array_equal(factors.perm_r, factors.perm_c)
    sure = sure and np.abs(factors.U.data).max(initial=0.0) < GROWTH * largest
    return int((factors.U.diagonal() < 0.0).sum()) if sure else None
