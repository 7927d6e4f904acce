"""Torques of the cut tree shared out in compiled code, one sample a lane of a block, as long as no rank is in doubt.

Two QR factorisations (`kernels.sparse_qr`).  That of G gives the motions that the closures allow, N = [1; -R_d^-1 R_i] of the
independent coordinates, drives if they can be; that of W^-1/2 S^T N the drives, N^T S W^-1/2 x = N^T tau_tree of least norm; and
G^T lambda = tau_tree - S tau_a, of least norm, the multipliers.  The samples of a block share pivots and ranks; what is in doubt
is left to the singular values of `allocation`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexinv.kernels import sparse_qr
from flexinv.kernels.fronts import Fronts, build_fronts
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.sparse_qr import SURE_PIVOT, FrontFactors
from flexinv.typing import Array, Indices

# Jacobi's rotations square what is left off the diagonal with every sweep: six reach rounding, these are never needed.
MOST_SWEEPS = 12
# Samples of a block: few enough to stay in the cache, and to share pivots.
SAMPLES_OF_BLOCK = 16
_TINY = 1e-300  # keeps 0 / 0 away where nothing is to be turned


@send_by_address
class AllocatedEfforts(NamedTuple):
    """Torques of a closed mechanism.

    tau : (samples, nv) effort of the drives [N m], [N], zero on passive coordinates
    multipliers : (samples, rows) [N], [N m]; left : (samples, nv) what neither drives nor closures carry (rounding)
    preload : (samples, nv, k) null space of the drives: efforts that only stress the mechanism [-]
    condition : (samples,) of N^T S [-]: 1 over its smallest singular value, as its largest is at most 1 (N has norm 1)
    """

    tau: Array
    multipliers: Array
    left: Array
    preload: Array
    condition: Array


@send_by_address
class AllocationWork(NamedTuple):
    """Data and work space of the effort allocation kernel.

    drives : (drives,) velocity coordinates; root : (drives,) square roots of the weights
    """

    drives: Indices
    root: Array
    fronts: Fronts  # of G
    closing: FrontFactors
    whole: Fronts  # of (drives, drives), entries everywhere
    driving: FrontFactors  # of a column a freedom, zero for those that are not there
    motions: Array  # (freedoms, nv, lanes)
    h: Array  # (freedoms, freedoms, lanes)
    y: Array  # (rows + nv, lanes)
    x: Array  # (nv, lanes)
    turn: Array  # (2, lanes)


def make_places(fronts: Fronts, rows: int, drives: Indices, root: Array) -> AllocationWork:
    """Return the arrays of the kernel [any unit] for G of so many rows, with so many freedoms as there are drives at most."""
    nv = fronts.columns
    most = len(drives)
    motions = np.zeros((most, nv, SAMPLES_OF_BLOCK))
    h = np.zeros((most, most, SAMPLES_OF_BLOCK))
    y, x, turn = (np.zeros((size, SAMPLES_OF_BLOCK)) for size in (rows + nv, nv, 2))
    whole = build_fronts(np.ones((most, most), dtype=bool))
    closing, driving = (FrontFactors.build_for(one, SAMPLES_OF_BLOCK) for one in (fronts, whole))
    return AllocationWork(drives, root, fronts, closing, whole, driving, motions, h, y, x, turn)


@jit_inner
def _compute_allowed_motions(place, freedoms):
    """Set the motions N^T that the closures allow, each with one independent coordinate at 1, and factor S^T N over the roots of
    the weights; whether every freedom is driven for certain."""
    fronts = place.fronts
    free = 0
    for f in range(fronts.parent.shape[0]):
        for at in range(fronts.first[f], fronts.first[f] + fronts.pivots[f]):
            if place.closing.pivot[at] < 0:
                place.motions[free] = 0.0
                place.motions[free, fronts.column[at]] = 1.0
                sparse_qr.solve_upper(fronts, place.closing, place.motions[free])
                free += 1
    sparse_qr.fill_zeros(place.driving)
    for e in range(place.whole.entry.shape[0]):
        i = place.whole.entry[e, 0]
        n = place.whole.entry[e, 1]
        for k in range(SAMPLES_OF_BLOCK if n < freedoms else 0):
            value = place.motions[n, place.drives[i], k] / place.root[i]
            sparse_qr.write_entry(place.whole, place.driving, e, k, value)
    return sparse_qr.factorise_qr(place.whole, place.driving) == freedoms


@jit_inner
def _compute_condition(place, freedoms):
    """Set place.y[0] to max(1, largest) / min(1, smallest singular value) of N^T S W^-1/2 [-].

    N of norm 1: the eigenvalues of R^-T N^T N R^-1 are one over their squares.
    """
    h = place.h
    for n in range(freedoms):
        for m in range(freedoms):
            h[n, m] = 0.0
            for c in range(place.motions.shape[1]):
                for k in range(SAMPLES_OF_BLOCK):
                    h[n, m, k] += place.motions[n, c, k] * place.motions[m, c, k]
        sparse_qr.solve_lower(place.whole, place.driving, h[n])
    for m in range(freedoms):
        for n in range(freedoms):
            for k in range(SAMPLES_OF_BLOCK):
                place.y[n, k] = h[n, m, k]
        sparse_qr.solve_lower(place.whole, place.driving, place.y)
        for n in range(freedoms):
            for k in range(SAMPLES_OF_BLOCK):
                h[n, m, k] = place.y[n, k]
    _find_eigenvalues(h, freedoms, place.turn)
    for k in range(SAMPLES_OF_BLOCK):
        largest = 1.0
        smallest = 1.0
        for n in range(freedoms):
            largest = max(largest, h[n, n, k])
            smallest = min(smallest, h[n, n, k])
        place.y[0, k] = math.sqrt(largest / smallest)


@jit_inner
def _find_eigenvalues(h, size, turn):
    """Bring the eigenvalues of symmetric matrices onto their diagonals by Jacobi's rotations, in place [any unit]."""
    for _ in range(MOST_SWEEPS):
        moved = False
        for p in range(size - 1):
            for q in range(p + 1, size):
                some = False
                for k in range(SAMPLES_OF_BLOCK):  # above rounding of both
                    some |= h[p, q, k] * h[p, q, k] > 1e-32 * abs(h[p, p, k] * h[q, q, k])
                if some:
                    moved = True
                    _apply_rotation(h, size, p, q, turn)
        if not moved:
            return


@jit_inner
def _apply_rotation(matrix, size, first, second, turn):
    """Turn two rows and columns so that their common entry vanishes."""
    for k in range(SAMPLES_OF_BLOCK):
        apart = matrix[second, second, k] - matrix[first, first, k]
        common = 2.0 * matrix[first, second, k]
        t = common / (apart + math.copysign(math.sqrt(apart * apart + common * common) + _TINY, apart))
        turn[0, k] = 1.0 / math.sqrt(t * t + 1.0)
        turn[1, k] = t * turn[0, k]
    for i in range(size):
        for k in range(SAMPLES_OF_BLOCK):
            one = matrix[first, i, k]
            two = matrix[second, i, k]
            matrix[first, i, k] = turn[0, k] * one - turn[1, k] * two
            matrix[second, i, k] = turn[1, k] * one + turn[0, k] * two
    for i in range(size):
        for k in range(SAMPLES_OF_BLOCK):
            one = matrix[i, first, k]
            two = matrix[i, second, k]
            matrix[i, first, k] = turn[0, k] * one - turn[1, k] * two
            matrix[i, second, k] = turn[1, k] * one + turn[0, k] * two
    matrix[first, second] = 0.0
    matrix[second, first] = 0.0


@jit_inner
def _compute_drive_efforts(place, freedoms, s, tree, tau, preload):
    """Set the least efforts of the drives and the efforts that only stress the mechanism, samples s and on."""
    drives = place.drives.shape[0]
    x = place.x
    y = place.y[:drives]
    x[:] = 0.0
    for n in range(freedoms):
        for i in range(tree.shape[1]):
            for k in range(SAMPLES_OF_BLOCK):
                x[n, k] += place.motions[n, i, k] * tree[min(s + k, tree.shape[0] - 1), i]
    sparse_qr.solve_least_norm(place.whole, place.driving, x, y)
    for i in range(drives):
        for k in range(min(SAMPLES_OF_BLOCK, tree.shape[0] - s)):
            tau[s + k, place.drives[i]] = y[i, k] / place.root[i]
    for n in range(drives - freedoms):
        sparse_qr.turn_beside(place.whole, place.driving, n, y)
        for i in range(drives):
            for k in range(min(SAMPLES_OF_BLOCK, tree.shape[0] - s)):
                preload[s + k, place.drives[i], n] = y[i, k] / place.root[i]


@jit_inner
def _close(place, s, g, left, multipliers):
    """Set the multipliers of least norm that carry ``left``, and take from it what they do, samples s and on."""
    y = place.y[: g.shape[1]]
    x = place.x
    entry = place.fronts.entry
    for i in range(x.shape[0]):
        for k in range(SAMPLES_OF_BLOCK):
            x[i, k] = left[min(s + k, g.shape[0] - 1), i]
    y[:] = 0.0
    sparse_qr.solve_least_norm(place.fronts, place.closing, x, y)
    for k in range(min(SAMPLES_OF_BLOCK, g.shape[0] - s)):
        for r in range(g.shape[1]):
            multipliers[s + k, r] = y[r, k]
        for e in range(entry.shape[0]):
            left[s + k, entry[e, 1]] -= g[s + k, entry[e, 0], entry[e, 1]] * y[entry[e, 0], k]


@jit
def split_samples(place, g, tree, out, width):
    """Share out the efforts ``tree`` (samples, nv) [N m], [N].

    g : (samples, rows, nv); out : `AllocatedEfforts`, tau zero on entry; as `allocation.share_out`
    width : (samples,) of preload [-], -1 where a rank is in doubt.  Lanes beyond the last sample repeat it.
    """
    samples = tree.shape[0]
    nv = tree.shape[1]
    drives = place.drives.shape[0]
    for s in range(0, samples, SAMPLES_OF_BLOCK):
        end = min(s + SAMPLES_OF_BLOCK, samples)
        width[s:end] = -1
        sparse_qr.fill_zeros(place.closing)
        for e in range(place.fronts.entry.shape[0]):
            r = place.fronts.entry[e, 0]
            i = place.fronts.entry[e, 1]
            for k in range(SAMPLES_OF_BLOCK):
                sparse_qr.write_entry(place.fronts, place.closing, e, k, g[min(s + k, samples - 1), r, i])
        rank = sparse_qr.factorise_qr(place.fronts, place.closing)
        freedoms = nv - rank
        if rank < 0 or freedoms == 0 or freedoms > drives or not _compute_allowed_motions(place, freedoms):
            continue
        width[s:end] = drives - freedoms
        _compute_drive_efforts(place, freedoms, s, tree, out.tau, out.preload)
        for k in range(s, end):
            for i in range(nv):
                out.left[k, i] = tree[k, i] - out.tau[k, i]
        _close(place, s, g, out.left, out.multipliers)
        _compute_condition(place, freedoms)
        for k in range(s, end):
            out.condition[k] = place.y[0, k - s]
            if not out.condition[k] * SURE_PIVOT < 1.0:
                width[k] = -1
