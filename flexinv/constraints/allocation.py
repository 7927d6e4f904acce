"""Rigid closed loops: torques of the cut tree shared out to the actuators and the closures, and motions held against these.

Torques: the cut tree needs tau_tree = L T P; closures give G^T lambda, actuators S tau_a:

    S tau_a + G^T lambda = tau_tree           minimum of tau_a^T W tau_a where actuators are redundant

With N a basis of the motions that the closures allow (G N = 0): N^T S tau_a = N^T tau_tree, the null space of N^T S is internal
preload, and lambda follows (of least norm where constraints are redundant).  `allocation_kernel` does so in
compiled code; samples where it finds a rank in doubt, near singular positions, are solved here by singular values.

A consistent motion keeps  phi(q) = 0,  phi' = G qd = 0  and  phi'' = G qdd + G' qd = 0.  Where a whole motion is given, rates and
accelerations are compared with the sums of the joints' contributions, |G| |qd| and |G| |qdd| + |G' qd|, the largest of it all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexinv.constraints.allocation_kernel import AllocatedEfforts, make_places, split_samples
from flexinv.constraints.closures import Rows, build_constraint_rows, drop_rounding
from flexinv.constraints.continuation_kernel import Chain, evaluate_jacobians
from flexinv.errors import InputError
from flexinv.kernels.fronts import build_fronts
from flexinv.kernels.memory import make_contiguous
from flexinv.kinematics.configuration import build_nodes
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.tree import Frames
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array, Indices, Mask

# A singular value below this part of the largest is a redundant constraint: rounding leaves 1e-15 of it.
REDUNDANT = 1e-10
# How far a given motion may be from closed: in metres over the mechanism's length or radians, as six digits of coordinates leave
# it; its rates and accelerations relative to their size, as those of a spline through samples of a few hundred per period.
OPEN = 1e-6
OPEN_RATE = 1e-4
OPEN_ACCELERATION = 1e-3
# What opens no faster than this stands still [1/s], [1/s^2]: rounding over the step, and over its square, where constant samples
# were differentiated; a ten-millionth of gravity where a mechanism is a metre long.
STILL_RATE = 1e-8
STILL_ACCELERATION = 1e-6
# What neither drives nor closures carry, over the largest force or effort in the mechanism: beyond this (rounding of 1e-16,
# enlarged by the condition of the closures) it is an effort that no drive can give.
LEFT_OVER = 1e-9
# Samples whose rows G are in memory at once, where only the motion is looked at.
SAMPLES_IN_MEMORY = 4096
# What is held against the closures, how far it may be off, what of it counts as rest, and how it is measured.
_KINDS = (
    ("q", OPEN, 0.0, "|phi| (lengths over the mechanism's length)"),
    ("qd", OPEN_RATE, STILL_RATE, "|G qd| / (|G| |qd|)"),
    ("qdd", OPEN_ACCELERATION, STILL_ACCELERATION, "|G qdd + G' qd| / (|G| |qdd| + |G' qd|)"),
)


def split_efforts(
    g: Array, tau_tree: Array, driven: Mask, weight: Array | None = None, constraints: Rows | None = None
) -> AllocatedEfforts:
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
        scale = np.ones(rows)
        fronts = build_fronts(np.ones((rows, nv), dtype=bool), driven)
    else:
        scale = constraints.scale
        fronts = constraints.build_fronts(last=driven)
    most = max(len(drives) - max(nv - rows, 1), 0)  # preloads: at least so many freedoms are left to move
    tau = np.zeros((samples, nv))
    preload = np.zeros((samples, nv, most))
    made = AllocatedEfforts(tau, np.empty((samples, rows)), np.empty((samples, nv)), preload, np.empty(samples))
    g = g / scale[:, None]
    width = np.full(samples, -1, dtype=np.int64)
    if rows and len(drives):
        split_samples(
            make_places(fronts, rows, drives, root), make_contiguous(g), make_contiguous(tau_tree), made, width
        )
    doubtful = np.flatnonzero(width < 0)
    if len(doubtful) == samples:
        made = split_by_svd(g, tau_tree, driven, root)
    else:
        others = split_by_svd(g[doubtful], tau_tree[doubtful], driven, root) if len(doubtful) else None
        width[doubtful] = others.preload.shape[2] if others else 0
        least = int(width.min())
        made = made._replace(preload=made.preload[:, :, :least])
        if others is not None:
            others = others._replace(preload=others.preload[:, :, :least])
            for part, other in zip(made, others, strict=True):
                part[doubtful] = other
    return made._replace(multipliers=made.multipliers / scale)


def split_by_svd(g: Array, tau_tree: Array, driven: Mask, root: Array) -> AllocatedEfforts:
    """Return `split_efforts` [N m], [N] where ranks may be in doubt; root : (driven,) square roots of the weights [-]."""
    samples, nv = tau_tree.shape
    left, values, right = np.linalg.svd(g)
    rank = count_ranks(values)
    few = values.shape[1]
    first = int(rank.min(initial=nv))
    # N^T, zero for what cannot move (sample, freedom, nv)
    motions = np.where((np.arange(first, nv) < rank[:, None])[:, :, None], 0.0, right[:, first:])
    u, s, vt = np.linalg.svd(motions[:, :, driven] / root)
    most = s.shape[1]
    tau = np.zeros((samples, nv))
    along = np.einsum("sfk,sf->sk", u[:, :, :most], np.einsum("sfv,sv->sf", motions, tau_tree))
    tau[:, driven] = np.einsum("skd,sk->sd", vt[:, :most], _compute_inverses(s) * along) / root
    # G^T lambda = rest, of least norm: lambda = U S^-1 V^T rest
    rest = np.einsum("skv,sv->sk", right[:, :few], tau_tree - tau)
    multipliers = np.einsum("srk,sk->sr", left[:, :, :few], _compute_inverses(values) * rest)
    open_effort = tau_tree - tau - np.einsum("srv,sr->sv", g, multipliers)
    condition = _compute_condition(s, nv - rank, len(root))
    return AllocatedEfforts(tau, multipliers, open_effort, _find_preloads(s, vt, driven, root), condition)


def _compute_inverses(values: Array) -> Array:
    """One over singular values (samples, k), zero for those that are redundant."""
    sure = values > REDUNDANT * values.max(axis=-1, initial=0.0)[..., None]
    return np.divide(1.0, values, out=np.zeros_like(values), where=sure)


def _compute_condition(values: Array, freedoms: Indices, drives: int) -> Array:
    """The drives' authority over the motions that are left (samples,), infinite where there is none or nothing moves."""
    smallest = np.where(np.arange(values.shape[1]) < freedoms[:, None], values, 1.0).min(axis=1, initial=1.0)
    condition = np.full(len(values), np.inf)
    known = (smallest > 0.0) & (freedoms > 0) & (drives > 0)
    np.divide(values.max(axis=1, initial=1.0), smallest, out=condition, where=known)
    return condition


def _find_preloads(values: Array, vt: Array, driven: Mask, root: Array) -> Array:
    """Efforts (samples, nv, k) that only stress the mechanism: right vectors beyond the rank of the drives."""
    driving = count_ranks(values)
    least = len(root) - int(driving.max(initial=0))
    beyond = (driving[:, None] + np.arange(least))[:, :, None]
    preload = np.zeros((len(values), len(driven), least))
    preload[:, driven] = np.take_along_axis(vt, beyond, axis=1).transpose(0, 2, 1) / root[:, None]
    return preload


def count_ranks(values: NDArray[np.floating[Any]]) -> Indices:
    """Return the ranks (...) of Jacobians: the number of singular values (..., k) [m/rad], [-] that are not redundant.

    A Jacobian that is rounding as a whole is zero already (`closures.without_rounding`).
    """
    return np.asarray((values > REDUNDANT * values.max(axis=-1, initial=0.0)[..., None]).sum(axis=-1))


@dataclass(frozen=True, eq=False)
class PrescribedLoops:
    """The closures of a mechanism, held against motions that are given."""

    mesh: Mesh

    @property
    def rows(self) -> Rows:
        """Constraints of the closures [m], [-]."""
        return build_constraint_rows(self.mesh)

    def compute_jacobian(self, q: Array, qd: Array, qdd: Array, motion: NodalMotion | None = None) -> Array:
        """Return G (samples, rows, nv) [m/rad], [-] of a consistent motion q (samples, nq), qd, qdd (samples, nv) [rad or m, s].

        motion : of the nodes, which is set, where it is wanted [m, rad, s]
        Raises InputError for a motion that the closures do not allow.
        """
        g, worst, at = self._evaluate_closures(q, qd, qdd, motion)
        self._check_closed(worst, at)
        return g

    def check(self, q: Array, qd: Array, qdd: Array) -> None:
        """Raise InputError for a motion q (samples, nq), qd, qdd (samples, nv) [rad or m, s] that the closures do not allow."""
        worst = np.zeros((3, 2))
        at = np.zeros((3, 2), dtype=np.int64)
        for start in range(0, len(q), SAMPLES_IN_MEMORY):
            part = slice(start, start + SAMPLES_IN_MEMORY)
            _, found, where = self._evaluate_closures(q[part], qd[part], qdd[part])
            more = ~(found[:, 0] <= worst[:, 0])  # a NaN is the largest
            worst[more, 0] = found[more, 0]
            at[more] = where[more] + [start, 0]
            worst[:, 1] = np.maximum(worst[:, 1], found[:, 1])
        self._check_closed(worst, at)

    def _evaluate_closures(
        self, q: Array, qd: Array, qdd: Array, motion: NodalMotion | None = None
    ) -> tuple[Array, Array, Indices]:
        """G, how far the motion is from closed, and where: see `continuation_kernel.jacobian_and_residuals`."""
        g = np.zeros((len(q), len(self.rows.closure), qd.shape[1]))
        worst = np.zeros((3, 2))
        at = np.zeros((3, 2), dtype=np.int64)
        frames = Frames(*(motion or NodalMotion.make_uninitialized(1, self.mesh.size)).parts)
        chain = Chain.build_for(build_nodes(self.mesh), self.rows)
        given = (make_contiguous(q), make_contiguous(qd), make_contiguous(qdd))
        evaluate_jacobians(chain, self.rows.scale, frames, given, g, worst, at)
        return drop_rounding(self.mesh, self.rows.direction, g), worst, at

    def _check_closed(self, worst: Array, at: Indices) -> None:
        """Raise InputError where the motion is further from closed than is allowed."""
        for found, (sample, row), (label, most, floor, measure) in zip(worst, at, _KINDS, strict=True):
            if found[0] > most * found[1] + floor or np.isnan(found[0]):
                name = self.mesh.mechanism.closures[int(self.rows.closure[row])].name
                raise InputError(
                    f"mechanism '{self.mesh.mechanism.name}': {label} violates closure '{name}' at sample {sample}: "
                    f"{measure} = {found[0] / found[1]:.2g}, expected at most {most:g}; give consistent q, qd, qdd "
                    "of all joints as flexinv.solve returns them, or call flexinv.solve with the independent joints only"
                )

    def compute_shares(self, q: Array, qd: Array, qdd: Array, tau: Array) -> AllocatedEfforts:
        """Return the drives' efforts and the multipliers [N m], [N] for the cut tree's efforts, tau (samples, nv): "
        "`split_efforts`.

        q : (samples, nq), qd, qdd : (samples, nv) of all joints [rad or m, s]
        Raises InputError for a motion that the closures do not allow, or that the drives cannot give.
        """
        return self._split_samples(self.compute_jacobian(q, qd, qdd), tau, np.arange(len(tau)))

    def apply_shares(self, which: Mask, q: Array, qd: Array, qdd: Array, tau: Array) -> None:
        """Put them into ``tau`` at some samples (samples,) of a motion that is known to keep the closures [N m], [N]."""
        samples = np.flatnonzero(which)
        g = self._evaluate_closures(q[samples], qd[samples], qdd[samples])[0]
        tau[samples] = self._split_samples(g, tau[samples], samples).tau

    def _split_samples(self, g: Array, tau: Array, samples: Indices) -> AllocatedEfforts:
        m = self.mesh.mechanism
        shares = split_efforts(g, tau, m.actuated, m.weights[m.actuated], self.rows)
        largest = max(np.abs(tau).max(initial=0.0), np.abs(shares.multipliers).max(initial=0.0))
        check_carried(m, shares.left, largest, lambda sample: f"sample {samples[sample]}")
        return shares


def check_carried(mechanism: Mechanism, left: Array, largest: float, when: Callable[[int], str]) -> None:
    """Raise InputError where neither drives nor closures carry an effort (samples, nv) [N m], [N] that is ``left``.

    largest : force or effort in the mechanism, of which rounding leaves LEFT_OVER; when : names a sample by its number
    """
    if np.abs(left).max(initial=0.0) > LEFT_OVER * largest:
        sample, column = np.unravel_index(int(np.argmax(np.abs(left))), left.shape)
        raise InputError(
            f"mechanism '{mechanism.name}', {when(int(sample))}: the actuated joints cannot give this motion "
            f"({np.abs(left).max():.3g} N m or N is left at '{mechanism.velocity_names[column]}'): "
            "write actuated = true for as many independent joints as the mechanism has freedoms"
        )
