"""The slowest roots of (s^2 M + s C + K) x = 0 where freedoms are many: sparse factors and Krylov subspaces.

With z = (x, v) and the pencil  A z = s B z,  A = [[0, 1], [-K, -C]], B = [[1, 0], [0, M]],  mu = 1 / (s - shift) are eigenvalues
of

    (A - shift B)^-1 B      x = -K_s^-1 (M w_2 + (C + shift M) w_1),  v = w_1 + shift x      K_s = K + shift C + shift^2 M

so that one factorisation does, and what has no inertia (mu = 0) needs no care.  Roots are corrected as in `complex_roots`.  All
that are slower than a gap are held by discs of the pencil between their vectors, which see wrong ones and roots that are there
twice (`root_discs`), and that none is missed there is proved by the argument principle (`root_counts`).
Source: Tisseur, Meerbergen, *The quadratic eigenvalue problem*, SIAM Review 43(2), 2001, section 5; ARPACK.
"""

from __future__ import annotations

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.errors import ConvergenceError, InputError
from flexinv.linearized.complex_roots import SMALLEST_SHIFT, Roots, match_conjugate_roots, update_roots
from flexinv.linearized.eigenvalues import NO_STIFFNESS, choose_shift
from flexinv.linearized.first_order import Corrected
from flexinv.linearized.root_counts import count_missing_roots
from flexinv.linearized.root_discs import compute_root_discs
from flexinv.linearized.slowest_modes import (
    MOST_DOUBLINGS,
    NO_SHIFT,
    ROUNDED_PIVOT,
    SPARE_MODES,
    ShiftedStiffness,
    apply_to_columns,
    find_gap_beyond,
    find_two_sided_eigenvalues,
    refuse_loose,
)
from flexinv.typing import Array, Complex, Mask, Sparse

Terms = tuple[Sparse, Sparse, Sparse]


def find_slowest_roots(mass: Sparse, damping: Sparse, stiffness: Sparse, count: int) -> Roots:
    """Return the ``count`` slowest roots [1/s] of (root^2 M + root C + K) x = 0, of each pair one, with vectors and error bars.

    Raises InputError where a freedom has neither inertia nor stiffness, ConvergenceError where that none is missed is not proved.
    """
    m, c, k = parts = tuple(scipy.sparse.csc_array(part) for part in (mass, damping, stiffness))
    refuse_loose(k, m)
    most = 2 * k.shape[0] - 2
    looked_for = min(2 * (count + SPARE_MODES), most)
    smallest = SMALLEST_SHIFT * float(np.sqrt(np.abs(k.diagonal()).max() / np.abs(m.diagonal()).max())) or 1.0
    regular = k.diagonal().all() and ShiftedStiffness(k).least > ROUNDED_PIVOT
    shift = 0.0 if regular else choose_shift(_run_arnoldi(parts, smallest, looked_for)[0], smallest)
    for _ in range(MOST_DOUBLINGS + 1):
        looked_for = min(looked_for, most)
        root, right, left = _run_arnoldi(parts, shift, looked_for)
        place = find_gap_beyond(np.abs(root), min(2 * count, len(root) - 1))
        corrected = update_roots(list(parts), root, right, left, shift)
        beyond = _compute_disc_bars(parts, corrected, shift, np.abs(root) < place)
        sure = np.isfinite(beyond).all()
        if sure and count_missing_roots(place, root, lambda s: k + s * c + s * s * m) == 0:
            break
        looked_for *= 2
    else:
        raise ConvergenceError(
            f"modes: whether all of the {count} slowest roots are found is not proved: they are too close together; "
            "write another count"
        )
    slow = np.abs(root) < place
    root, right, left, bar, lost = corrected
    conjugate_roots = match_conjugate_roots(root[slow], right[:, slow], left[:, slow], bar[slow], lost[slow] + beyond)
    return Roots(
        conjugate_roots.root[:count],
        conjugate_roots.shapes[:, :count],
        conjugate_roots.left[:, :count],
        conjugate_roots.bar[:count],
    )


def _compute_disc_bars(parts: Terms, corrected: Corrected, shift: float, slow: Mask) -> Array:
    """Radii of discs of the ``slow`` roots beyond their bars (slow,) [1/s], of the pencil with y^H (C + s M, 1) on the left."""
    m, c, k = parts
    size = k.shape[0]
    root = corrected[0][slow]
    x = corrected[1][:, slow]
    y = corrected[2][:, slow]
    one = scipy.sparse.eye_array(size)
    a = scipy.sparse.block_array([[None, one], [-k, -c]], format="csc")
    b = scipy.sparse.block_array([[one, None], [None, m]], format="csc")
    z = np.concatenate([x, root * x])
    w = np.concatenate([c.T @ y + root.conj() * (m.T @ y), y])
    centre, radius = compute_root_discs(a, b, root, z, w, shift)
    return np.maximum(radius + np.abs(root - centre) - corrected[3][slow], 0.0)


def _run_arnoldi(parts: Terms, shift: float, count: int) -> tuple[Complex, Complex, Complex]:
    """Roots (count,) and right and left vectors (freedoms, count) about a shift; left ones those of the nearest value."""
    m, c, k = parts
    size = k.shape[0]
    factors = ShiftedStiffness(k + shift * c + shift**2 * m)
    if factors.least < NO_STIFFNESS:
        raise InputError(NO_SHIFT)
    first = c + shift * m

    def apply_inverse(w: Array) -> Array:
        x = -factors.solve(m @ w[size:] + first @ w[:size])
        return np.concatenate([x, w[:size] + shift * x])

    def solve_left_part(u: Array) -> Array:
        return -factors.solve(u[:size] + shift * u[size:], transposed=True)

    def apply_transposed_inverse(u: Array) -> Array:
        y = solve_left_part(u)
        return np.concatenate([u[size:] + first.T @ y, m.T @ y])

    start = apply_inverse(np.random.default_rng(0).standard_normal(2 * size))
    values, right, left = find_two_sided_eigenvalues(apply_inverse, apply_transposed_inverse, count, start)
    # what fast motions have of rounding is taken away: z = (A - shift B)^-1 B z / mu
    right = apply_to_columns(apply_inverse, right) / values
    y = apply_to_columns(solve_left_part, left)
    return np.asarray(shift + 1 / values, dtype=complex), np.asarray(right[:size]), np.conj(y)
