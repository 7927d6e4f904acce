"""Eigenvalues of M y'' + K y = 0 where some freedoms have no inertia and some motions no stiffness.

Slow motions are found exactly where K is positive definite; what moves without stiffness is taken out of K before.
"""

from __future__ import annotations

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.dynamics.index1 import MASSLESS
from flexinv.errors import InputError
from flexinv.typing import Array

# Of w^2 over the largest one, what rounding leaves of a freedom without stiffness.
SOFT = 1e-12
# Motions with w^2 below so many shifts are told apart without it: the others are known to 1e-16 of fastest over slowest of them.
SOFTER = 1e3
# A w^2 below this part of its terms' absolute sum is what is left of terms that cancel: a rigid motion, neither stable nor
# unstable.  Some tens of operations leave 1e-15; where the terms are zero, rounding of the largest entry is left.
CANCELLED, LARGEST_ROUNDED = 1e-13, 1e-16
# Of a stiffness with a unit diagonal: what rounding leaves of its symmetry, and of an eigenvalue that is zero, for each freedom.
SYMMETRIC, LEAST = 1e-9, 1e-15


def undamped(stiffness: Array, mass: Array, allowed: Array) -> tuple[Array, Array]:
    """Return omega^2 (modes,) [1/s^2], rising, and shapes (unknowns, modes) with unit modal mass.

    1 / omega^2 are eigenvalues of M by K where K is positive definite: so the low frequencies are the exact ones, and freedoms
    without inertia (1 / infinity) need no care.  What moves without stiffness, or falls, is taken out of K first.
    """
    k, m = (allowed.T @ part @ allowed for part in (stiffness, mass))
    k, m = (k + k.T) / 2, (m + m.T) / 2
    soft = _soft(k, m)
    # Q^T M x = 0 for the soft motions x: what is left of K moves by Q, and soft motions take no part in it
    rest = scipy.linalg.qr(m @ soft)[0][:, soft.shape[1] :] if soft.shape[1] else np.eye(len(k))
    inner, inertia = (rest.T @ part @ rest for part in (k, m))
    squared, shapes = _soft_squares(k, m, soft)
    if rest.shape[1]:
        values, vectors = scipy.linalg.eigh((inertia + inertia.T) / 2, (inner + inner.T) / 2)
        use = values > MASSLESS * values.max(initial=0.0)
        stiff = rest @ vectors[:, use][:, ::-1]
        # Of slow motions the eigenvalue, of fast ones Rayleigh's quotient: rounding is 1e-16 of 1 / omega^2 of the slowest, but
        # of K of the fastest, and each is the better one on its side of their mean.
        along = (np.einsum("km,kl,lm->m", stiff, part, stiff) for part in (k, m))
        inverse, quotient = 1.0 / values[use][::-1], np.divide(*along)
        slow = inverse <= np.sqrt(inverse.min() * inverse.max())
        squared, shapes = np.concatenate([squared, np.where(slow, inverse, quotient)]), np.hstack([shapes, stiff])
    order = np.argsort(squared, kind="stable")
    masses = np.einsum("km,kl,lm->m", shapes, m, shapes)  # (mode,)
    return squared[order], (allowed @ shapes / np.sqrt(masses))[:, order]


def negative(stiffness: Array) -> int:
    """Return the number of negative eigenvalues of K (freedoms, freedoms) [N m], beyond rounding [-].

    K is symmetric where loads have a potential.  Where moments keep their axes in space it is not: real eigenvalues are meant.
    """
    k = (stiffness + stiffness.T) / 2
    if _definite(k):
        return 0
    size = np.sqrt(np.abs(np.diag(stiffness)))
    size[size == 0.0] = 1.0  # a spherical joint about the axis of its link: nothing holds it
    unit = stiffness / np.outer(size, size)  # signs stay, and stiff motions hide no soft ones
    if np.abs(unit - unit.T).max() < SYMMETRIC:
        values = scipy.linalg.eigvalsh((unit + unit.T) / 2).astype(complex)
    else:
        values = np.asarray(scipy.linalg.eigvals(unit))
    return int(((values.real < -LEAST * len(k)) & (values.imag == 0.0)).sum())


def _soft(k: Array, m: Array) -> Array:
    """The motions (freedoms, soft) without which K is positive definite: none where it is so already.

    They are the slowest ones by K + shift M with the smallest shift that makes it definite.  So large a part of 1 / (omega^2 +
    shift) is theirs that nothing else can be read from these eigenvalues.
    """
    if not k.any() and _definite(m):  # all motions are, and no shift of K is in scale with M
        return np.eye(len(k))
    shift, smallest = 0.0, SOFT * np.abs(k).max() / max(np.abs(m).max(), np.finfo(float).tiny)
    while not _definite(k + shift * m):
        if shift > smallest / SOFT**2:
            raise InputError("modes: a freedom has neither inertia nor stiffness; give its link a mass")
        shift = max(10 * shift, smallest, np.finfo(float).tiny)
    if shift == 0.0:
        return np.empty((len(k), 0))
    values, vectors = scipy.linalg.eigh(m, k + shift * m)
    return np.asarray(vectors[:, values > 1.0 / ((1.0 + SOFTER) * shift)])


def _soft_squares(k: Array, m: Array, soft: Array) -> tuple[Array, Array]:
    """omega^2 [1/s^2] of the soft motions among each other, zero where it is rounding of K, and their shapes."""
    if not soft.shape[1]:
        return np.empty(0), soft
    squared, vectors = scipy.linalg.eigh(soft.T @ k @ soft, soft.T @ m @ soft)
    shapes, stiff = soft @ vectors, np.abs(k)
    size = np.abs(shapes)  # of unit modal mass
    rounding = (
        CANCELLED * np.einsum("km,kl,lm->m", size, stiff, size) + LARGEST_ROUNDED * stiff.max() * size.max(axis=0) ** 2
    )
    return np.where(np.abs(squared) <= rounding, 0.0, squared), shapes


def _definite(matrix: Array) -> bool:
    try:
        factor = scipy.linalg.cholesky(matrix)
    except scipy.linalg.LinAlgError:
        return False
    return bool((np.diag(factor) ** 2 > SOFT * np.abs(np.diag(matrix))).all())
