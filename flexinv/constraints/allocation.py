"""Rigid closed loops: torques of the cut tree shared out to the actuators and the closures.

Torques: the cut tree needs tau_tree = L T P; closures give G^T lambda, actuators S tau_a:

    S tau_a + G^T lambda = tau_tree           minimum of tau_a^T W tau_a where actuators are redundant

With N a basis of the motions that the closures allow (G N = 0): N^T S tau_a = N^T tau_tree, the null space of N^T S is internal
preload, and lambda follows (of least norm where constraints are redundant).  `allocation_kernel` does so in
compiled code; samples where it finds a rank in doubt, near singular positions, are solved here by singular values.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexinv.constraints.allocation_kernel import Efforts, places, share
from flexinv.kernels.fronts import Fronts, fronts_of
from flexinv.kernels.memory import plain
from flexinv.typing import Array

# A singular value below this part of the largest is a redundant constraint: rounding leaves 1e-15 of it.
REDUNDANT = 1e-10


@dataclass(frozen=True)
class Shares:
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


def share_out(
    g: Array,
    tau_tree: Array,
    driven: NDArray[np.bool_],
    weight: Array | None = None,
    scale: Array | None = None,
    fronts: Fronts | None = None,
) -> Shares:
    """Return actuator efforts and multipliers of  S tau_a + G^T lambda = tau_tree  [N m], [N].

    g : (samples, rows, nv); tau_tree : (samples, nv); driven : (nv,) bool; weight : (driven,) of the squares of tau_a [-], 1
        by default: the minimum of tau_a^T W tau_a is taken where drives are redundant
    scale : (rows,) [m], [-] of the equations (`closures.row_scales`): over these ranks are told, and redundant multipliers least
    fronts : of G, drives last (`closures.closure_fronts`); without, G may have entries everywhere
    """
    if scale is not None:
        found = share_out(g / scale[:, None], tau_tree, driven, weight, fronts=fronts)
        return replace(found, multipliers=found.multipliers / scale)
    samples, rows, nv = g.shape
    drives = np.flatnonzero(driven)
    root = np.sqrt(np.ones(len(drives)) if weight is None else weight)
    if not samples or not rows or not len(drives):
        return by_singular_values(g, tau_tree, driven, root)
    most = max(len(drives) - max(nv - rows, 1), 0)  # preloads: at least so many freedoms are left to move
    made = Shares(
        np.zeros((samples, nv)),
        np.empty((samples, rows)),
        np.empty((samples, nv)),
        np.zeros((samples, nv, most)),
        np.empty(samples),
    )
    width = np.empty(samples, dtype=np.int64)
    efforts = Efforts(made.tau, made.multipliers, made.left, made.preload, made.condition, width)
    fronts = fronts_of(np.ones((rows, nv), dtype=bool), driven) if fronts is None else fronts
    share(places(fronts, rows, drives, root), plain(g), plain(tau_tree), efforts)
    doubtful = np.flatnonzero(width < 0)
    if not len(doubtful):
        return replace(made, preload=made.preload[:, :, : int(width.min())])
    others = by_singular_values(g[doubtful], tau_tree[doubtful], driven, root)
    if len(doubtful) == samples:
        return others
    width[doubtful] = others.preload.shape[2]
    least = int(width.min())
    made = replace(made, preload=made.preload[:, :, :least])
    for part, other in ((made.tau, others.tau), (made.multipliers, others.multipliers), (made.left, others.left)):
        part[doubtful] = other
    made.preload[doubtful], made.condition[doubtful] = others.preload[:, :, :least], others.condition
    return made


def by_singular_values(g: Array, tau_tree: Array, driven: NDArray[np.bool_], root: Array) -> Shares:
    """Return `share_out` [N m], [N] where ranks may be in doubt; root : (driven,) square roots of the weights [-]."""
    samples, rows, nv = g.shape
    left, values, right = (
        np.linalg.svd(g) if rows and samples else (g, np.zeros((samples, 0)), np.tile(np.eye(nv), (samples, 1, 1)))
    )
    rank = ranks(values)
    tau, multipliers, condition = np.zeros((samples, nv)), np.zeros((samples, rows)), np.ones(samples)
    spaces = np.zeros((samples, len(root), len(root)))  # (sample, drive, preload), what is not used is zero
    width = np.zeros(samples, dtype=np.int64)
    for r in np.unique(rank):
        own = np.flatnonzero(rank == r)
        motions = right[own, r:]  # N^T (sample, freedom, nv)
        asked = np.einsum("sfv,sv->sf", motions, tau_tree[own])
        part, condition[own], spaces[own], width[own] = _least_efforts(motions[:, :, driven] / root, asked)
        tau[np.ix_(own, driven)] = part / root
        # G^T lambda = rest, of least norm: lambda = U S^-1 V^T rest
        rest = np.einsum("srv,sv->sr", right[own, :r], tau_tree[own] - tau[own]) / values[own, :r]
        multipliers[own] = np.einsum("srk,sk->sr", left[own, :, :r], rest)
    least = int(width.min(initial=len(root)))
    preload = np.zeros((samples, nv, least))
    preload[:, driven] = (spaces / root[:, None])[:, :, :least]
    return Shares(tau, multipliers, tau_tree - tau - np.einsum("srv,sr->sv", g, multipliers), preload, condition)


def ranks(values: NDArray[np.floating[Any]]) -> NDArray[np.int64]:
    """Return the ranks (...) of Jacobians: the number of singular values (..., k) [m/rad], [-] that are not redundant.

    A Jacobian that is rounding as a whole is zero already (`closures.without_rounding`).
    """
    return np.asarray((values > REDUNDANT * values.max(axis=-1, initial=0.0)[..., None]).sum(axis=-1))


def _least_efforts(a: Array, asked: Array) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Least-norm efforts of a x = asked, (samples, drives), condition numbers, null spaces (samples, drives, k) and their k."""
    samples, freedoms, drives = a.shape
    if not freedoms or not drives:
        condition = np.full(samples, np.inf)
        return (
            np.zeros((samples, drives)),
            condition,
            np.tile(np.eye(drives), (samples, 1, 1)),
            np.full(samples, drives),
        )
    u, s, vt = np.linalg.svd(a)
    use = s > REDUNDANT * s.max(axis=1, initial=np.finfo(float).tiny)[:, None]
    condition = np.full(samples, np.inf)
    np.divide(s.max(axis=1, initial=1.0), s.min(axis=1, initial=1.0), out=condition, where=s.min(axis=1) > 0.0)
    few = s.shape[1]
    along = np.einsum("sfk,sf->sk", u[:, :, :few], asked)
    x = np.einsum("skd,sk->sd", vt[:, :few], np.divide(along, s, out=np.zeros_like(s), where=use))
    count = use.sum(axis=1)
    spaces = np.zeros((samples, drives, drives))
    for c in np.unique(count):
        own = np.flatnonzero(count == c)
        spaces[own, :, : drives - c] = vt[own, c:].transpose(0, 2, 1)
    return x, condition, spaces, drives - count
