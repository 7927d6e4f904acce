"""Proof of closures: what ties the lifted mechanism against what ties the reader's own model, on closed configurations.

    places        Newton on the mechanism's closures from the reader's own reference configuration, and steps away from it
    residual      of the reader's equations there is zero: they close the same loops
    rows          both Jacobians G leave the same motions: the projectors on their row spaces agree

Equations are no forces: how stiff a reader holds them is about its integrator.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.lifting.reader_dynamics import ReaderDynamics
from flexinv.constraints.closures import list_velocity_scales
from flexinv.constraints.continuation import build_start_follower
from flexinv.constraints.loop_starts import list_closed_nearby
from flexinv.errors import ConvergenceError, InputError
from flexinv.kinematics.mesh import build
from flexinv.model.mechanism import Array, Mechanism

# Newton leaves 1e-12 of the mechanism's length; rows of a loop that is a thousandth from a change point turn by 1e-9 then.
OPEN = 1e-9
TURNED = 1e-7
RANK = 1e-9  # singular values below that, of the largest, tie nothing
HELD = "held"
LOST = "lost"
UNJUDGED = "not judged"


@dataclass(frozen=True)
class ClosureProof:
    """The result: ``HELD``, ``LOST`` or ``UNJUDGED``; reason : in what they differ, or why nothing could be said."""

    state: str
    reason: str = ""


def check_ties(mechanism: Mechanism, dynamics: ReaderDynamics, without: Collection[str]) -> ClosureProof:
    """Hold a mechanism's closures against its reader's own equations [m], [rad]; without : names of features left out."""
    start = dynamics.start
    guess = mechanism.neutral if start is None else start
    theirs = dynamics.closing(guess, without)
    if theirs is None:
        return (
            ClosureProof(HELD)
            if not mechanism.closures
            else ClosureProof(UNJUDGED, "closures are no part of its model")
        )
    if not mechanism.closures:
        return (
            ClosureProof(HELD)
            if not len(theirs[0])
            else ClosureProof(LOST, f"it ties the tree by {len(theirs[0])} equations more")
        )
    try:
        places = _find_closed_configurations(mechanism, guess)
    except (ConvergenceError, InputError) as error:
        return ClosureProof(UNJUDGED, f"closures: {error}")
    if not places:
        return ClosureProof(UNJUDGED, "closures: the loops do not close near its reference configuration")
    for place in places:
        found = dynamics.closing(place, without)
        assert found is not None
        if words := _describe_closure_gap(mechanism, place, *found):
            return ClosureProof(LOST, words)
    return ClosureProof(HELD)


def _find_closed_configurations(mechanism: Mechanism, guess: Array) -> list[Array]:
    mesh = build(_remove_applied_forces(mechanism))
    closed = build_start_follower(mesh).solve(guess)
    return [] if closed is None else [closed, *list_closed_nearby(mesh, closed)]


def _remove_applied_forces(mechanism: Mechanism) -> Mechanism:
    return replace(mechanism, springs=(), forces=())


def _describe_closure_gap(mechanism: Mechanism, place: Array, residual: Array, jacobian: Array) -> str:
    """In what the reader's equations differ at a closed place, in words; "" where they do not."""
    mesh = build(_remove_applied_forces(mechanism))
    left = float(np.abs(residual).max(initial=0.0))
    if not left <= OPEN * max(1.0, mesh.length):
        return f"where the mechanism is closed, its own equations are open by {left:.3g} m or rad"
    ours = build_start_follower(mesh).evaluate_closures(place)[1]
    one = _compute_row_space(ours)
    two = _compute_row_space(jacobian * list_velocity_scales(mesh))
    if len(one) != len(two):
        return f"its own equations leave {mechanism.nv - len(two)} freedoms, the mechanism's {mechanism.nv - len(one)}"
    gap = float(np.abs(one.T @ one - two.T @ two).max(initial=0.0))
    return f"its own equations leave other motions, turned by {gap:.3g}" if not gap <= TURNED else ""


def _compute_row_space(rows: Array) -> Array:
    """An orthonormal basis (rank, nv) [-] of the rows of a matrix, each of them of length one."""
    sizes = np.linalg.norm(rows, axis=1)
    rows = rows[sizes > 0.0] / sizes[sizes > 0.0, None]
    if not len(rows):
        return np.zeros((0, rows.shape[1]))
    _, values, right = np.linalg.svd(rows, full_matrices=False)
    basis: Array = right[values > RANK * values[0]]
    return basis
