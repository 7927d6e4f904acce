"""Descent to a rest position: where passive joints leave a choice, a mechanism sinks from where it starts.

A step of h from rest, with a scheme that keeps no rates, ends where  f(x + d) = 2 M d / h^2:  a step down the slope of the energy
that is short where h is short, and leads to a rest position where h is long.  A step that would climb, f(x) d < 0, is made
shorter.  So a mechanism comes to rest below where it starts, and passes by what it would fall from (proximal point method;
Rockafellar, *Monotone operators and the proximal point algorithm*, SIAM J. Control Optim. 14, 1976).
"""

from __future__ import annotations

import numpy as np

from flexinv.dynamics.generalized_alpha import STATICS, Scheme, generalized_alpha
from flexinv.dynamics.linearization import linearise
from flexinv.dynamics.solver import Solver
from flexinv.dynamics.stepper import CONVERGED, NOT_CONVERGED
from flexinv.kinematics.tree import Joints

# The first step [-], in times in which the mechanism falls its own length.  One that fails, climbs or goes too far is made again
# with a quarter of it, at most MOST_SHORTER times from the first; one that goes less than half as far as it may is followed by
# one of four times its length.
FIRST, FACTOR, MOST_SHORTER = 0.25, 4.0, 16
# How far a step may go, over the mechanism's length or in radians: farther, and it could miss a rest position that lies between.
FARTHEST = 0.5
# Where a step goes less than NEAR, Newton's method is asked for the rest position itself; below STILL nothing moves, and the
# sign of its work is rounding.
NEAR, STILL = 1e-3, 1e-10
# Leaving an unstable position by a part of 1e-10 takes some fifty steps.
MOST_STEPS = 500


def descend(solver: Solver, joints: Joints, when: str) -> None:
    """Bring a mechanism at rest under its whole load [N], [N m] to the rest position below it; the unknowns change.

    Where nothing holds a joint and nothing moves it (a vertical axis), it stays where it is.
    Raises ConvergenceError where no step succeeds.
    """
    solver.loads.level[0] = 1.0
    gravity = float(np.linalg.norm(solver.topology.gravity))
    longest = FIRST * (np.sqrt(2 * solver.mesh.length / gravity) if gravity > 0.0 else 1.0)
    step, shortest = longest, longest / FACTOR**MOST_SHORTER
    for _ in range(MOST_STEPS):
        moved, failed = _moved(solver, joints, generalized_alpha(step, 0.0), FARTHEST)
        if moved is None:
            step /= FACTOR
            if step < shortest:
                raise solver.complain(*failed, f"{when}, on the way down to a rest position")
            continue
        if moved < NEAR and _rests(solver, joints, step >= longest and moved < STILL):
            return
        step *= FACTOR if moved < FARTHEST / 2 else 1.0
    raise solver.complain(NOT_CONVERGED, MOST_STEPS, moved or 0.0, f"{when}, on the way down to a rest position")


def _moved(
    solver: Solver, joints: Joints, scheme: Scheme, farthest: float
) -> tuple[float | None, tuple[int, int, float]]:
    """Make one step from rest; return how far it went [-], None (and why) where it failed, went too far or climbed."""
    s, multiplier = solver.state, solver.border.ties.multiplier
    s.u[:] = s.u0[:] = s.du[:] = s.du0[:] = s.pseudo[:] = s.d[:] = 0.0
    before = [part.copy() for part in (s.x, s.r, s.place, multiplier)]
    linearise(solver.system, STATICS, joints, True)
    load = -solver.work.residual[0]
    failed = solver.newton(scheme, joints)
    gone = s.place - before[2]
    moved = float(np.abs(gone / solver.topology.scale).max(initial=0.0))
    s.u[:] = s.u0[:] = s.du[:] = s.du0[:] = s.pseudo[:] = s.d[:] = 0.0
    if failed[0] == CONVERGED and moved <= farthest and (moved < STILL or float(load @ gone) >= 0.0):
        return moved, failed
    for part, kept in zip((s.x, s.r, s.place, multiplier), before, strict=True):
        part[:] = kept
    return None, (NOT_CONVERGED, failed[1], moved) if failed[0] == CONVERGED else failed


def _rests(solver: Solver, joints: Joints, still: bool) -> bool:
    """Whether Newton's method finds the rest position close by; where a motion is free of forces and ``still`` it need not."""
    return _moved(solver, joints, STATICS, FACTOR * NEAR)[0] is not None or still
