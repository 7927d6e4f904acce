"""Torques of the cut tree shared out in compiled code, one sample a lane of a block, as long as no rank is in doubt.

Two Householder factorisations with pivoting, columns kept as rows of an array.  G = Q R gives the motions that the closures
allow, N = [1; -R_d^-1 R_i] of the independent coordinates; N^T S W^-1/2 x = N^T tau_tree, of least norm, gives the drives, and
G^T lambda = tau_tree - S tau_a, of least norm, the multipliers.  The samples of a block share pivots and ranks; blocks in doubt
are left to the singular values of `allocation`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.jit import jit, jit_inner
from flexinv.typing import Array

# Pivots over the longest column: above SURE one counts, below NONE it repeats others (rounding of 1e-16 in some tens of
# columns); between them singular values decide, whose own limit, 1e-10, lies well inside.
SURE, NONE = 1e-7, 1e-13
# Jacobi's rotations square what is left off the diagonal with every sweep: six reach rounding, these are never needed.
MOST_SWEEPS = 12
# Samples of a block: few enough to stay in the cache, and to share pivots.
LANES = 16
_TINY = 1e-300  # keeps 0 / 0 away where nothing is to be turned


class Factor(NamedTuple):
    """Q R of matrices whose columns are the rows of ``a`` (columns, rows, lanes), in ``order``."""

    a: Array
    beta: Array  # (columns, lanes)
    diagonal: Array  # (columns, lanes) of R
    sizes: Array  # (columns, lanes) squares of what is left of each
    scale: Array  # (lanes,) one over the square of the longest column
    sums: Array  # (lanes,)
    order: NDArray[np.int64]


class Place(NamedTuple):
    """Data and work space of the effort allocation kernel.

    drives : (drives,) velocity coordinates; root : (drives,) square roots of the weights
    """

    drives: NDArray[np.int64]
    root: Array
    closing: Factor  # (nv, rows)
    driving: Factor  # (nv, drives), as many columns as freedoms
    motions: Array  # (nv, nv, lanes) of which as many as freedoms
    h: Array  # (nv, nv, lanes)
    y: Array  # (rows + nv, lanes)
    turn: Array  # (2, lanes)


def places(rows: int, drives: NDArray[np.int64], root: Array, nv: int) -> Place:
    """Return the arrays of the kernel [any unit] for G of (rows, nv)."""

    def empty(length: int) -> Factor:
        beta, diagonal, sizes = np.zeros((3, nv, LANES))
        scale, sums = np.zeros((2, LANES))
        return Factor(np.zeros((nv, length, LANES)), beta, diagonal, sizes, scale, sums, np.zeros(nv, dtype=np.int64))

    motions, h = np.zeros((2, nv, nv, LANES))
    y, turn = np.zeros((rows + nv, LANES)), np.zeros((2, LANES))
    return Place(drives, root, empty(rows), empty(len(drives)), motions, h, y, turn)


@jit_inner
def _reflect(y, v, beta, j, sums, size):
    """y - beta v (v . y) from entry j on; set the squares of what then follows entry j."""
    for k in range(LANES):
        sums[k] = 0.0
    for i in range(j, y.shape[0]):
        for k in range(LANES):
            sums[k] += v[i, k] * y[i, k]
    for k in range(LANES):
        sums[k] *= beta[k]
        size[k] = 0.0
        y[j, k] -= sums[k] * v[j, k]
    for i in range(j + 1, y.shape[0]):
        for k in range(LANES):
            y[i, k] -= sums[k] * v[i, k]
            size[k] += y[i, k] * y[i, k]


@jit_inner
def _measure(y, size):
    """Set the squares of a column."""
    for k in range(LANES):
        size[k] = 0.0
    for i in range(y.shape[0]):
        for k in range(LANES):
            size[k] += y[i, k] * y[i, k]


@jit_inner
def _pivot(factor, j, columns):
    """Bring the column with the most left, in its worst lane, to place j: 1 where it counts, 0 where none does, -1 in doubt."""
    best, at, most = -1.0, j, 0.0
    for c in range(j, columns):
        least = np.inf
        for k in range(LANES):
            part = factor.sizes[factor.order[c], k] * factor.scale[k]
            if part < least or part != part:  # a NaN stays
                least = part
            if part > most or part != part:
                most = part
        if least > best:
            best, at = least, c
    factor.order[j], factor.order[at] = factor.order[at], factor.order[j]
    if best > SURE * SURE:
        return 1
    return 0 if most <= NONE * NONE else -1


@jit_inner
def factor(factor, columns):
    """Factor Q R of the first columns with pivoting, in place [any unit]; return the rank, -1 where it is in doubt."""
    for k in range(LANES):
        factor.scale[k] = 0.0
    for c in range(columns):
        factor.order[c] = c
        _measure(factor.a[c], factor.sizes[c])
        for k in range(LANES):
            factor.scale[k] = max(factor.scale[k], factor.sizes[c, k])
    for k in range(LANES):
        factor.scale[k] = 1.0 / factor.scale[k] if factor.scale[k] > 0.0 else 0.0
    for j in range(columns):
        counts = _pivot(factor, j, columns)
        if counts < 1:
            return j if counts == 0 else -1
        own = factor.order[j]
        for k in range(LANES):
            norm, first = math.sqrt(factor.sizes[own, k]), factor.a[own, j, k]
            factor.diagonal[j, k] = -math.copysign(norm, first)
            factor.beta[j, k] = 1.0 / (norm * (norm + abs(first)))
            factor.a[own, j, k] = first - factor.diagonal[j, k]
        for c in range(j + 1, columns):
            _reflect(
                factor.a[factor.order[c]], factor.a[own], factor.beta[j], j, factor.sums, factor.sizes[factor.order[c]]
            )
    return columns


@jit_inner
def _back(factor, rank, y):
    """Solve R z = y in place of y."""
    for j in range(rank - 1, -1, -1):
        for k in range(LANES):
            y[j, k] /= factor.diagonal[j, k]
        for i in range(j):
            for k in range(LANES):
                y[i, k] -= factor.a[factor.order[j], i, k] * y[j, k]


@jit_inner
def _forth(factor, rank, y):
    """Solve R^T z = y in place of y."""
    for j in range(rank):
        for i in range(j):
            for k in range(LANES):
                y[j, k] -= factor.a[factor.order[j], i, k] * y[i, k]
        for k in range(LANES):
            y[j, k] /= factor.diagonal[j, k]


@jit_inner
def _turn(factor, rank, y):
    """Q y in place of y."""
    for j in range(rank - 1, -1, -1):
        _reflect(y, factor.a[factor.order[j]], factor.beta[j], j, factor.sums, factor.sizes[factor.order[j]])


@jit_inner
def _allowed(place, rank):
    """Set the motions N^T that the closures allow, each with one independent coordinate at 1."""
    nv, y = place.motions.shape[0], place.y
    for n in range(nv - rank):
        own = place.closing.order[rank + n]
        for i in range(rank):
            for k in range(LANES):
                y[i, k] = place.closing.a[own, i, k]
        _back(place.closing, rank, y)
        for i in range(rank, nv):
            place.motions[n, place.closing.order[i]] = 1.0 if i == rank + n else 0.0
        for i in range(rank):
            for k in range(LANES):
                place.motions[n, place.closing.order[i], k] = -y[i, k]


@jit_inner
def _driving(place, freedoms):
    """Set and factor S^T N over the roots of the weights; whether every freedom is driven for certain."""
    for n in range(freedoms):
        for i in range(place.drives.shape[0]):
            for k in range(LANES):
                place.driving.a[n, i, k] = place.motions[n, place.drives[i], k] / place.root[i]
    return factor(place.driving, freedoms) == freedoms


@jit_inner
def _condition(place, freedoms):
    """Set place.y[0] to max(1, largest) / min(1, smallest singular value) of N^T S W^-1/2 [-].

    N of norm 1: the eigenvalues of R^-T N^T N R^-1 are one over their squares.
    """
    h, order = place.h, place.driving.order
    for n in range(freedoms):
        for m in range(freedoms):
            h[n, m] = 0.0
            for c in range(place.motions.shape[1]):
                for k in range(LANES):
                    h[n, m, k] += place.motions[order[n], c, k] * place.motions[order[m], c, k]
        _forth(place.driving, freedoms, h[n])
    for m in range(freedoms):
        for n in range(freedoms):
            for k in range(LANES):
                place.y[n, k] = h[n, m, k]
        _forth(place.driving, freedoms, place.y)
        for n in range(freedoms):
            for k in range(LANES):
                h[n, m, k] = place.y[n, k]
    _diagonalise(h, freedoms, place.turn)
    for k in range(LANES):
        largest, smallest = 1.0, 1.0
        for n in range(freedoms):
            largest, smallest = max(largest, h[n, n, k]), min(smallest, h[n, n, k])
        place.y[0, k] = math.sqrt(largest / smallest)


@jit_inner
def _diagonalise(h, size, turn):
    """Bring the eigenvalues of symmetric matrices onto their diagonals by Jacobi's rotations, in place [any unit]."""
    for _ in range(MOST_SWEEPS):
        moved = False
        for p in range(size - 1):
            for q in range(p + 1, size):
                some = False
                for k in range(LANES):  # above rounding of both
                    some |= h[p, q, k] * h[p, q, k] > 1e-32 * abs(h[p, p, k] * h[q, q, k])
                if some:
                    moved = True
                    _rotate(h, size, p, q, turn)
        if not moved:
            return


@jit_inner
def _rotate(h, size, p, q, turn):
    """Turn rows and columns p and q so that their common entry vanishes."""
    for k in range(LANES):
        apart, common = h[q, q, k] - h[p, p, k], 2.0 * h[p, q, k]
        t = common / (apart + math.copysign(math.sqrt(apart * apart + common * common) + _TINY, apart))
        turn[0, k] = 1.0 / math.sqrt(t * t + 1.0)
        turn[1, k] = t * turn[0, k]
    for i in range(size):
        for k in range(LANES):
            one, two = h[p, i, k], h[q, i, k]
            h[p, i, k] = turn[0, k] * one - turn[1, k] * two
            h[q, i, k] = turn[1, k] * one + turn[0, k] * two
    for i in range(size):
        for k in range(LANES):
            one, two = h[i, p, k], h[i, q, k]
            h[i, p, k] = turn[0, k] * one - turn[1, k] * two
            h[i, q, k] = turn[1, k] * one + turn[0, k] * two
    h[p, q] = 0.0
    h[q, p] = 0.0


@jit_inner
def _drive(place, freedoms, s, tree, tau, preload):
    """Set the least efforts of the drives and the efforts that only stress the mechanism, samples s and on."""
    drives = place.drives.shape[0]
    x = place.y[:drives]
    x[:] = 0.0
    for n in range(freedoms):
        for i in range(tree.shape[1]):
            for k in range(LANES):
                x[n, k] += place.motions[place.driving.order[n], i, k] * tree[min(s + k, tree.shape[0] - 1), i]
    _forth(place.driving, freedoms, x)
    _turn(place.driving, freedoms, x)
    for i in range(drives):
        for k in range(min(LANES, tree.shape[0] - s)):
            tau[s + k, place.drives[i]] = x[i, k] / place.root[i]
    for n in range(drives - freedoms):
        x[:] = 0.0
        x[freedoms + n] = 1.0
        _turn(place.driving, freedoms, x)
        for i in range(drives):
            for k in range(min(LANES, tree.shape[0] - s)):
                preload[s + k, place.drives[i], n] = x[i, k] / place.root[i]


@jit_inner
def _close(place, rank, s, g, left, multipliers):
    """Set the multipliers of least norm that carry ``left``, and take from it what they do, samples s and on."""
    y = place.y[: g.shape[1]]
    y[:] = 0.0
    for i in range(rank):
        for k in range(LANES):
            y[i, k] = left[min(s + k, g.shape[0] - 1), place.closing.order[i]]
    _forth(place.closing, rank, y)
    _turn(place.closing, rank, y)
    for k in range(min(LANES, g.shape[0] - s)):
        for r in range(g.shape[1]):
            multipliers[s + k, r] = y[r, k]
            for i in range(g.shape[2]):
                left[s + k, i] -= g[s + k, r, i] * y[r, k]


@jit
def share(place, g, tree, tau, multipliers, left, preload, width, condition):
    """Share out the efforts ``tree`` (samples, nv) [N m], [N]; ``width`` (samples,) of preload is -1 where a rank is in doubt.

    g : (samples, rows, nv); tau is zero on entry; as `allocation.share_out`.  Lanes beyond the last sample repeat it.
    """
    samples, nv, drives = tree.shape[0], tree.shape[1], place.drives.shape[0]
    for s in range(0, samples, LANES):
        end = min(s + LANES, samples)
        width[s:end] = -1
        for k in range(LANES):
            own = g[min(s + k, samples - 1)]
            for r in range(g.shape[1]):
                for i in range(nv):
                    place.closing.a[i, r, k] = own[r, i]
        rank = factor(place.closing, nv)
        freedoms = nv - rank
        if rank < 0 or freedoms == 0 or freedoms > drives:
            continue
        _allowed(place, rank)
        if not _driving(place, freedoms):
            continue
        width[s:end] = drives - freedoms
        _drive(place, freedoms, s, tree, tau, preload)
        for k in range(s, end):
            for i in range(nv):
                left[k, i] = tree[k, i] - tau[k, i]
        _close(place, rank, s, g, left, multipliers)
        _condition(place, freedoms)
        for k in range(s, end):
            condition[k] = place.y[0, k - s]
