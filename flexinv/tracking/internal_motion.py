"""Internal motions while a frame is held: the zeros of a mechanism from its efforts to the frame, and those that swing.

With z = N w, c N = 0 (the frame rests) and W^T S = 0 (no effort):  (W^T (K + s^2 M) N) w = 0,  damping is left out.  A zero with
a real part fades before or after the path.  One without swings: its motion is bounded from a start at rest on, but has no end at
which it rests.  So of each of these motions the conditions at both ends,  r = 0  there, become two at the start,

    r(y_0, 0, 0) - S tau_0 = 0  and  l^T M (y_1 - y_0) = 0,     at the end  r(y_n, 0, N w p) - S tau_n = 0

with l the left eigenvector and the acceleration p at the end unknown: a border of one row and one column in the equations of
`collocation`.  A motion faster than two a step is none that steps swing with (its differences fade), and keeps both ends.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.errors import InputError
from flexinv.typing import Array, Complex, Mask

if TYPE_CHECKING:
    from flexinv.tracking.collocation import Horizon, LinearisedEquations, NodePoses

# A rate whose real part is a smaller part of it swings: it has no end to wait for.
SWINGING = 1e-3
# An eigenvalue this many times the largest that the mesh resolves in a path belongs to a freedom without inertia.
ENDLESS = 1e10
# Zeros that a message names: the slowest ones.
ZEROS_NAMED = 4


@dataclass(frozen=True)
class InternalMotions:
    """Motions inside while the frame rests, at one end of the window, slowest first.

    rates : (motions,) s [1/s], Re >= 0; left, right : (rows, motions) l, N w with l^T M N w = 1; inertia : (rows, rows) M
    """

    rates: Complex
    left: Complex
    right: Complex
    inertia: Array

    @property
    def swinging(self) -> Mask:
        """Mask (motions,) [-] of those that neither fade nor grow."""
        return (self.rates.real <= SWINGING * np.abs(self.rates)) & (self.rates.imag > 0)


@dataclass(frozen=True)
class Swings:
    """Swinging motions in the equations of a window.

    start : (rows, swings) M^T l at its first instant
    end : (rows, swings) M N w at its last; acceleration : (swings, unknowns) N w there
    """

    start: Array
    end: Array
    acceleration: Array

    @property
    def count(self) -> int:
        """Number of swinging motions [-]."""
        return int(self.start.shape[1])


def find_internal_motions(horizon: Horizon, sample: int, stiffness: float = 1.0) -> InternalMotions:
    """Return the internal motions while the frame rests [1/s], at one instant, beams ``stiffness`` times as stiff [-]."""
    instant = horizon.take_instant(sample)
    pick = horizon.layout.pick
    one = instant.evaluate(instant.rigid, stiffness)
    sizes = np.sqrt(pick**2 @ horizon.layout.solver.topology.scale**2)  # lengths over that of the mechanism
    by = one.by[0] * sizes
    efforts = sizes[:, None] * (pick @ horizon.layout.drives.T)
    allowed = [scipy.linalg.null_space(part / np.abs(part).max(axis=1, keepdims=True)) for part in (by, efforts.T)]
    n, w = (sizes[:, None] * part for part in allowed)
    stiff = one.tangent[0, 0]
    inert = one.tangent[2, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        squared, left, right = scipy.linalg.eig(-w.T @ stiff @ n, w.T @ inert @ n, left=True, right=True)
    finite = np.isfinite(squared)
    kept = np.flatnonzero(finite & (np.abs(squared) < ENDLESS * np.abs(squared[finite]).min(initial=np.inf)))
    rates = np.sqrt(squared[kept].astype(complex))
    order = np.argsort(rates.real, kind="stable")
    kept = kept[order]
    rates = rates[order]
    left = w @ left[:, kept].conj()
    right = n @ right[:, kept]
    return InternalMotions(rates, left, right / np.einsum("rm,rm->m", left, inert @ right), inert)


def find_internal_rates(horizon: Horizon, sample: int) -> Complex:
    """Return the rates s [1/s] (Re >= 0, slowest first) of what moves inside while the frame rests, at one end of the window.

    exp(s t) before the path and exp(-s t) after it; an imaginary s swings and never ends.
    """
    return find_internal_motions(horizon, sample).rates


def find_swings(horizon: Horizon, stiffness: float) -> Swings:
    """Return the motions that swing inside at both ends of the window [-], as far as the steps see them.

    Raises InputError where that is not the same motions at both ends, as no bounded motion is then known to join them.
    """
    ends = [find_internal_motions(horizon, k, stiffness) for k in (0, -1)]
    seen = [np.flatnonzero(one.swinging & (np.abs(one.rates) * horizon.h < 2.0)) for one in ends]
    if len(seen[0]) != len(seen[1]):
        raise InputError(
            f"mechanism '{horizon.way.mesh.mechanism.name}': inside, {len(seen[0])} motions swing where the path begins and "
            f"{len(seen[1])} where it ends, so that no bounded motion leads from rest to rest (at the start "
            f"{describe_zeros(ends[0].rates)}, at the end {describe_zeros(ends[1].rates)}); follow another point of the tool or "
            "another path"
        )
    first = ends[0].left[:, seen[0]].real
    last = ends[1].right[:, seen[1]].real
    return Swings(ends[0].inertia.T @ first, ends[1].inertia @ last, last.T @ horizon.layout.pick)


def take_step(horizon: Horizon, at: NodePoses, now: LinearisedEquations, swings: Swings) -> tuple[NodePoses, Array]:
    """Return poses with another acceleration at the last instant, and Newton's increments y (samples, unknowns) [m], [rad].

    What swings inside has no conditions at the end: its acceleration there is an unknown beside the others,
    zero velocity at the first an equation.
    """
    pick = horizon.layout.pick
    h = horizon.h
    u, du, _ = horizon.layout.compute_differences(at, h)
    first = (h * u[1] - 0.5 * h**2 * du[1]) @ pick.T  # y_1 - y_0
    solve = horizon.build_linear_solver(at, now)
    plain = solve(now.residual, now.missed)
    none = np.zeros_like(now.missed)
    columns = []
    for k in range(swings.count):
        pushed = np.zeros_like(now.residual)
        pushed[-1] = swings.end[:, k]
        columns.append(solve(pushed, none))
    reached = np.stack([swings.start.T @ (one[1] - one[0]) for one in columns], axis=1)  # (swing, swing)
    missing = swings.start.T @ (first + plain[1] - plain[0])
    more = -np.linalg.solve(reached, missing)
    y = plain + sum(share * one for share, one in zip(more, columns, strict=True))
    last = more @ swings.acceleration + (0.0 if at.last is None else at.last)
    return replace(at, last=last), np.asarray(y @ pick)


def describe_zeros(rates: Complex) -> str:
    """Return the slowest zeros in words [1/s], those that swing with their frequency [Hz]."""
    unlike = np.unique(np.round(np.abs(rates), 9), return_index=True)[1][:ZEROS_NAMED]
    said = []
    for rate in rates[unlike]:
        if rate.real <= SWINGING * abs(rate):
            said.append(f"+-{abs(rate):.4g}i 1/s, {abs(rate) / (2 * np.pi):.3g} Hz")
        elif abs(rate.imag) <= SWINGING * abs(rate):
            said.append(f"+-{rate.real:.4g} 1/s")
        else:
            said.append(f"+-{rate.real:.4g} +- {abs(rate.imag):.4g}i 1/s")
    return "zeros: " + "; ".join(said)
