"""Counts of the roots of det P(z) = 0 within a circle, by the argument principle: proof that none of the slowest is missed.

Where a matrix is not symmetric there is no law of inertia.  But the phase of det P(z) turns by 2 pi for each root on the way
around a circle, and det P(z) / prod (z - z_i) turns by none where the z_i within are all.  That quotient is smooth, so that few
places on the circle show it.  P is real for real z: the upper half of the circle is half of the way.
Source: Ahlfors, *Complex analysis*, 3rd ed., section 4.5.2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import NDArray

from flexinv.typing import Complex, Sparse

# Parts of the half circle at first, largest turn of the phase from place to place [rad], and how often a part is halved.
CIRCLE_SIDES = 24
LARGEST_PHASE = np.pi / 4
MOST_PARTINGS = 8
# Of a turn: the sum of all is a whole number but for rounding.
WHOLE_TURNS = 0.05
# Roots nearer to each other than this part of their size are one: of pairs both or one are known.
SAME_ROOT = 1e-6


def count_missing_roots(radius: float, known: Complex, matrix_at: Callable[[complex], Sparse]) -> int | None:
    """Return the number of roots within |z| < radius [1/s], [1/s^2] beside the ``known`` ones; None where it is not sure.

    known : all that are known, inside and outside, of a pair one or both; matrix_at : P(z), sparse, real for real z
    """

    twins = known.conj()[known.imag != 0.0]
    apart = np.abs(twins[:, None] - known[None]).min(axis=1, initial=np.inf)
    known = np.concatenate([known, twins[apart > SAME_ROOT * np.abs(twins)]])

    def compute_phase(angle: float) -> float:
        place = radius * np.exp(1j * angle)
        return _compute_phase(matrix_at(complex(place))) - float(np.angle(place - known).sum())

    angles = np.linspace(0.0, np.pi, CIRCLE_SIDES + 1)
    phases = [compute_phase(angle) for angle in angles]
    total = 0.0
    for k in range(CIRCLE_SIDES):
        turn = _turn(compute_phase, (angles[k], angles[k + 1]), (phases[k], phases[k + 1]), MOST_PARTINGS)
        if turn is None:
            return None
        total += turn
    count = total / np.pi
    return round(count) if abs(count - round(count)) < WHOLE_TURNS else None


def _turn(
    phase: Callable[[float], float], ends: tuple[float, float], values: tuple[float, float], halvings: int
) -> float | None:
    """By how much a phase turns between two angles; None where it turns too fast to be followed."""
    turn = float(np.angle(np.exp(1j * (values[1] - values[0]))))
    if abs(turn) < LARGEST_PHASE:
        return turn
    if not halvings:
        return None
    middle = (ends[0] + ends[1]) / 2
    value = phase(middle)
    first = _turn(phase, (ends[0], middle), (values[0], value), halvings - 1)
    second = _turn(phase, (middle, ends[1]), (value, values[1]), halvings - 1)
    return None if first is None or second is None else first + second


def _compute_phase(matrix: Sparse) -> float:
    """Phase of a determinant [rad]: of its pivots, and of the order in which they were taken."""
    size = np.sqrt(np.maximum(abs(matrix).max(axis=1).toarray().ravel(), np.finfo(float).tiny))
    unit = scipy.sparse.diags_array(1 / size)
    factors = scipy.sparse.linalg.splu(scipy.sparse.csc_array(unit @ matrix @ unit, dtype=complex))
    odd = _is_odd(factors.perm_r) != _is_odd(factors.perm_c)
    return float(np.angle(factors.U.diagonal()).sum()) + np.pi * odd


def _is_odd(order: NDArray[np.int32]) -> bool:
    """True for a permutation of an odd number of exchanges: of its freedoms less its cycles."""
    size = len(order)
    places = scipy.sparse.csr_array((np.ones(size), (np.arange(size), order)), shape=(size, size))
    cycles = scipy.sparse.csgraph.connected_components(places, directed=False)[0]
    return bool((size - cycles) % 2)
