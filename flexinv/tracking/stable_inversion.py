"""Stable inversion: the motion of a flexible mechanism whose *deformed* frame follows a path, bounded before and after it.

From torque to tip a flexible arm is not of minimum phase: marched forward in time, the motion that belongs to a prescribed tip
grows without bound.  Solved as a boundary-value problem, at rest at both ends of a window, it is bounded: what grows forward
in time is fixed by the end (the arm moves before its tip does), what decays by the start.
All instants are unknown at once (`collocation`), and Newton solves for them; the first guess is the rigid mechanism on the path,
and where Newton does not converge from there the beams begin stiffer.
Source: Devasia, Chen, Paden, *Nonlinear inversion-based output tracking*, IEEE Trans. Automatic Control 41, 1996; as a
boundary-value problem of multibody systems Seifried, *Dynamics of Underactuated Multibody Systems*, 2014, ch. 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import NDArray

from flexinv.dynamics.solver import Trajectory
from flexinv.errors import ConvergenceError
from flexinv.tracking.collocation import Horizon, Placed, TurnedTooMuch
from flexinv.typing import Array

# Newton stops when an increment, relative to the mechanism's length or in radians, is below this; convergence is quadratic, so
# that the next would be its square.
INCREMENT = 1e-8
MOST_ITERATIONS = 20
# An increment this large, in lengths of the mechanism or radians, means that Newton is lost.
LOST = 30.0
# Continuation begins this many times as stiff, and gives up where the factor has to fall by less than SMALLEST in one go.
STIFF, SMALLEST = 1000.0, 1.02


@dataclass(frozen=True)
class Inverse:
    """Result of stable inversion: poses, trajectory of all nodes, efforts (samples, drives) [N m], [N], iterations [-]."""

    placed: Placed
    trajectory: Trajectory
    efforts: Array
    iterations: int


def invert(horizon: Horizon, guess: Placed | None = None) -> Inverse:
    """Return the bounded motion and the efforts [N m], [N] of a task; ``guess`` of the poses, the rigid mechanism's without.

    r(y_k, u_k, u'_k) - S tau_k = 0,  c(y_k) = 0  at all instants k, at rest at the first and the last.

    Raises ConvergenceError where Newton finds no motion, from stiffer beams neither.
    """
    rigid = horizon.layout.undeformed(horizon.task.reach.q) if guess is None else guess
    found = _newton(horizon, rigid, 1.0)
    return found if found is not None else _from_stiffer(horizon, rigid)


def _from_stiffer(horizon: Horizon, rigid: Placed) -> Inverse:
    stiffness, factor = STIFF, STIFF ** (1 / 4)
    found = _newton(horizon, rigid, stiffness)
    while found is not None and stiffness > 1.0:
        target = max(1.0, stiffness / factor)
        softer = _newton(horizon, found.placed, target)
        if softer is not None:
            found, stiffness = softer, target
        elif (factor := np.sqrt(factor)) < SMALLEST:
            break
    if found is not None and stiffness == 1.0:
        return found
    name = horizon.layout.solver.mesh.mechanism.name
    raise ConvergenceError(
        f"mechanism '{name}': no bounded motion found whose frame on '{horizon.task.frame.name}' follows the path, only with "
        f"beams {stiffness:.3g} times as stiff; give the path more time, a smaller step, or check the stiffness"
    )


def _newton(horizon: Horizon, at: Placed, stiffness: float) -> Inverse | None:
    """Newton's method on all instants; None where it does not converge."""
    for iteration in range(1, MOST_ITERATIONS + 1):
        try:
            now = horizon.evaluate(at, stiffness)
            y, efforts = horizon.step(at, now)
        except (TurnedTooMuch, scipy.linalg.LinAlgError):
            return None
        size = horizon.scaled(y)
        if not size < LOST:
            return None
        at = horizon.layout.moved(at, y)
        if size < INCREMENT:
            done = horizon.evaluate(at, stiffness, want=False)
            return Inverse(at, done.trajectory, efforts, iteration)
    return None


# ----------------------------------------------------------------------------------------------------------- the window

# An eigenvalue this many times the largest that the mesh resolves in a path belongs to a freedom without inertia.
ENDLESS = 1e10


def internal_rates(horizon: Horizon, sample: int) -> NDArray[np.complex128]:
    """Return the rates s [1/s] (Re >= 0, slowest first) of what moves inside while the frame rests, at one end of the window.

    With z = N w, c N = 0 (the frame rests) and W^T S = 0 (no effort): (W^T (K + s^2 M) N) w = 0; damping is left out.
    exp(s t) before the path and exp(-s t) after it; an imaginary s swings and never ends.
    """
    still = horizon.layout.undeformed(horizon.task.reach.q[[sample]])
    one = horizon.at(sample).evaluate(still)
    pick = horizon.layout.pick
    sizes = np.sqrt(pick**2 @ horizon.layout.solver.topology.scale**2)  # lengths over that of the mechanism
    by, efforts = one.by[0] * sizes, sizes[:, None] * (pick @ horizon.layout.drives.T)
    n, w = (
        sizes[:, None] * scipy.linalg.null_space(part / np.abs(part).max(axis=1, keepdims=True))
        for part in (by, efforts.T)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        squared = scipy.linalg.eigvals(-w.T @ one.k[0] @ n, w.T @ one.m[0] @ n)
    squared = squared[np.isfinite(squared)]
    rates = np.sqrt(squared[np.abs(squared) < ENDLESS * np.abs(squared).min(initial=np.inf)].astype(complex))
    return np.asarray(rates[np.argsort(rates.real)])


def unrest(time: Array, found: Inverse) -> tuple[float, float]:
    """Return the speed just inside the window's start and end over the largest in it [-]: zero where it is long enough."""
    speed = np.abs(found.trajectory.motion.v).max(axis=(1, 2))
    largest = float(speed.max()) or 1.0
    return float(speed[1] / largest), float(speed[-2] / largest)
