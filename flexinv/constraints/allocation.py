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
from flexinv.constraints.closures import Rows
from flexinv.kernels.fronts import fronts_of
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
    g: Array, tau_tree: Array, driven: NDArray[np.bool_], weight: Array | None = None, constraints: Rows | None = None
) -> Shares:
    """Return actuator efforts and multipliers of  S tau_a + G^T lambda = tau_tree  [N m], [N].

    g : (samples, rows, nv); tau_tree : (samples, nv); driven : (nv,) bool; weight : (driven,) of the squares of tau_a [-], 1
        by default: the minimum of tau_a^T W tau_a is taken where drives are redundant
    constraints : whose G it is: over their scales ranks are told, and redundant multipliers least; without, G may have entries
        everywhere
    """
    samples, rows, nv = g.shape
    drives = np.flatnonzero(driven)
    root = np.sqrt(np.ones(len(drives)) if weight is None else weight)
    if constraints is None:
        scale, fronts = np.ones(rows), fronts_of(np.ones((rows, nv), dtype=bool), driven)
    else:
        scale, fronts = constraints.scale, constraints.fronts(last=driven)
    most = max(len(drives) - max(nv - rows, 1), 0)  # preloads: at least so many freedoms are left to move
    tau, preload = np.zeros((samples, nv)), np.zeros((samples, nv, most))
    made = Shares(tau, np.empty((samples, rows)), np.empty((samples, nv)), preload, np.empty(samples))
    g, width = g / scale[:, None], np.full(samples, -1, dtype=np.int64)
    if rows and len(drives):
        efforts = Efforts(made.tau, made.multipliers, made.left, made.preload, made.condition, width)
        share(places(fronts, rows, drives, root), plain(g), plain(tau_tree), efforts)
    doubtful = np.flatnonzero(width < 0)
    if len(doubtful) == samples:
        made = by_singular_values(g, tau_tree, driven, root)
    else:
        others = by_singular_values(g[doubtful], tau_tree[doubtful], driven, root) if len(doubtful) else None
        width[doubtful] = others.preload.shape[2] if others else 0
        least = int(width.min())
        made = replace(made, preload=made.preload[:, :, :least])
        if others is not None:
            others = replace(others, preload=others.preload[:, :, :least])
            for part, other in zip(vars(made).values(), vars(others).values(), strict=True):
                part[doubtful] = other
    return replace(made, multipliers=made.multipliers / scale)


def by_singular_values(g: Array, tau_tree: Array, driven: NDArray[np.bool_], root: Array) -> Shares:
    """Return `share_out` [N m], [N] where ranks may be in doubt; root : (driven,) square roots of the weights [-]."""
    samples, nv = tau_tree.shape
    left, values, right = np.linalg.svd(g)
    rank, few = ranks(values), values.shape[1]
    motions = np.where((np.arange(nv) < rank[:, None])[:, :, None], 0.0, right)  # N^T, zero for what cannot move
    u, s, vt = np.linalg.svd(motions[:, :, driven] / root)
    driving, most = ranks(s), s.shape[1]
    tau = np.zeros((samples, nv))
    along = np.einsum("sfk,sf->sk", u[:, :, :most], np.einsum("sfv,sv->sf", motions, tau_tree))
    tau[:, driven] = np.einsum("skd,sk->sd", vt[:, :most], _inverse(s) * along) / root
    # G^T lambda = rest, of least norm: lambda = U S^-1 V^T rest
    rest = np.einsum("skv,sv->sk", right[:, :few], tau_tree - tau)
    multipliers = np.einsum("srk,sk->sr", left[:, :, :few], _inverse(values) * rest)
    smallest = np.where(np.arange(most) < nv - rank[:, None], s, 1.0).min(axis=1, initial=1.0)
    condition = np.full(samples, np.inf)
    known = (smallest > 0.0) & (rank < nv) & (len(root) > 0)
    np.divide(s.max(axis=1, initial=1.0), smallest, out=condition, where=known)
    least = len(root) - int(driving.max(initial=0))
    beyond = (driving[:, None] + np.arange(least))[:, :, None]  # (sample, preload, 1)
    preload = np.zeros((samples, nv, least))
    preload[:, driven] = np.take_along_axis(vt, beyond, axis=1).transpose(0, 2, 1) / root[:, None]
    return Shares(tau, multipliers, tau_tree - tau - np.einsum("srv,sr->sv", g, multipliers), preload, condition)


def _inverse(values: Array) -> Array:
    """One over singular values (..., k), zero for those that are redundant."""
    largest = values.max(axis=-1, initial=0.0)[..., None]
    return np.divide(1.0, values, out=np.zeros_like(values), where=values > REDUNDANT * largest)


def ranks(values: NDArray[np.floating[Any]]) -> NDArray[np.int64]:
    """Return the ranks (...) of Jacobians: the number of singular values (..., k) [m/rad], [-] that are not redundant.

    A Jacobian that is rounding as a whole is zero already (`closures.without_rounding`).
    """
    return np.asarray((values > REDUNDANT * values.max(axis=-1, initial=0.0)[..., None]).sum(axis=-1))
