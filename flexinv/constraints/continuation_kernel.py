"""Following closed loops in compiled code, sample by sample, as long as the configuration is regular.

Newton on phi(q) = 0 with G_u step = -phi, from a prediction along G_u rate_u = -G_g rate_g; then the exact rates.  Every system
is a least-squares one of full rank (redundant constraints repeat others), solved by a sparse QR (`kernels.sparse_qr`).
Where it is not of full rank, where Newton fails or goes too far, the kernel stops at that sample: `continuation` decides
what to do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexinv.constraints.equations import Rows, compute_coupling_terms, fill_closure_residuals, fill_closure_rows
from flexinv.kernels.fronts import Fronts
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.sparse_qr import (
    FrontFactors,
    compute_condition_estimate,
    factorise_qr,
    fill_zeros,
    solve_least_squares,
    write_entry,
)
from flexinv.kinematics.configuration import Nodes, integrate_coordinates, move_nodes
from flexinv.kinematics.tree import Frames, Joints, make_room, take_sample
from flexinv.typing import Array, Indices, Mask

# Newton ends with an increment below this, in radians or metres: its error is about the square, which is rounding.
LAST_INCREMENT = 1e-9
# Closure equations are then met to this, in metres over the mechanism's length or radians: rounding of 1e-16 a node in chains
# of up to some thousand nodes.  A loop that cannot close (constraints that contradict each other) stays open by far more.
CLOSED = 1e-12
MOST_ITERATIONS = 30
# A passive coordinate may differ from its prediction by this, or the step between samples is halved: it is the largest
# step over which Newton is trusted to stay on its branch.
LARGEST_SURPRISE = 0.05  # [rad] or of the mechanism's length


@send_by_address
class Chain(NamedTuple):
    """Closed chain of a mechanism: its nodes, the equations of its closures, and room for its motion at one instant."""

    nodes: Nodes
    rows: Rows
    joints: Joints
    frames: Frames
    phi: Array  # (rows, 3) closure equations and their rates

    @classmethod
    def build_for(cls, nodes: Nodes, rows: Rows) -> Chain:
        """Return the chain with arrays for its motion [m, rad, s]."""
        size = len(nodes.parent)
        return cls(nodes, rows, make_room(Joints, size), make_room(Frames, size), np.zeros((len(rows.a), 3)))


@send_by_address
class Continuation(NamedTuple):
    """Data and work space of the continuation kernel.

    unknown : velocity coordinates; owner : (nq,) whether a coordinate belongs to an unknown one
    scale : (rows,) [m], [-] of the equations; sizes : (nq,), measure : (unknown,) of the coordinates [m], [-]
    change : (samples,) of G_u over its scales since the sample before, over its largest singular value at least [-]; of no length
        where it is not wanted
    """

    unknown: Indices
    owner: Mask
    scale: Array
    sizes: Array
    g: Array  # (rows, nv)
    fronts: Fronts  # of G_u
    qr: FrontFactors  # of G_u over its scales, one lane
    y: Array  # (rows, 1) right-hand side
    x: Array  # (unknown, 1) solution over its measure
    sign: Array  # (unknown, 1)
    step: Array  # (nv,)
    guess: Array  # (nq,)
    rest: Array  # (nv,) zeros
    measure: Array = np.ones(0)
    before: Array = np.zeros(0)  # (entries,) of G_u over its scales at the sample before
    change: Array = np.zeros(0)


@jit_inner
def compute_qr(problem):
    """Factor Q R of problem.qr [any unit]; False where the rank may not be full."""
    return factorise_qr(problem.fronts, problem.qr) == problem.x.shape[0]


@jit_inner
def solve_factored(problem, step):
    """Set problem.x to the least-squares solution of the factored system and problem.y, and ``step`` (nv,) to less it [any unit].

    Only unknown coordinates of ``step`` are set.
    """
    solve_least_squares(problem.fronts, problem.qr, problem.y, problem.x)
    for i in range(problem.unknown.shape[0]):
        step[problem.unknown[i]] = -problem.x[i, 0] * problem.measure[i]


@jit
def fill_closure_equations(chain, q, rest, g):
    """Set G (rows, nv) [m/rad], [-], zero on entry, and chain.phi to phi [m], [-] at q (nq,) [rad], [m]; rest : (nv,) zeros."""
    move_nodes(chain.nodes, q, rest, rest, chain.joints, chain.frames)
    fill_closure_rows(chain.nodes, chain.rows, chain.frames, chain.phi, g)
    for k in range(g.shape[0]):
        chain.phi[k, 0] += compute_coupling_terms(k, chain.rows, q, rest, rest)[0]


@jit_inner
def _fill_equations(chain, problem, q):
    """Set problem.g, problem.qr = G_u and problem.y = phi at a configuration, all over their scales."""
    fill_closure_equations(chain, q, problem.rest, problem.g)
    for k in range(problem.scale.shape[0]):
        problem.y[k, 0] = chain.phi[k, 0] / problem.scale[k]
    _fill_matrix(problem)


@jit_inner
def _fill_matrix(problem):
    fill_zeros(problem.qr)
    for e in range(problem.fronts.entry.shape[0]):
        k = problem.fronts.entry[e, 0]
        i = problem.fronts.entry[e, 1]
        value = problem.g[k, problem.unknown[i]] * problem.measure[i] / problem.scale[k]
        write_entry(problem.fronts, problem.qr, e, 0, value)


@jit_inner
def _copy(source, to):
    for i in range(source.shape[0]):
        to[i] = source[i]


@jit_inner
def _find_largest_magnitude(y):
    size = 0.0
    for i in range(y.shape[0]):
        if not abs(y[i]) <= size:  # a NaN stays
            size = abs(y[i])
    return size


@jit_inner
def close_by_newton(chain, problem):
    """Move problem.guess onto the closures [rad], [m], and set their equations there; whether it got there."""
    for _ in range(MOST_ITERATIONS):
        _fill_equations(chain, problem, problem.guess)
        if not compute_qr(problem):
            return False
        problem.step[:] = 0.0
        solve_factored(problem, problem.step)
        integrate_coordinates(chain.nodes, problem.guess, problem.step)
        if _find_largest_magnitude(problem.x[:, 0]) < LAST_INCREMENT:
            _fill_equations(chain, problem, problem.guess)
            return _find_largest_magnitude(problem.y[:, 0]) < CLOSED
    return False


@jit
def find_branch(chain, problem, time, q, qd, qdd, condition, first):
    """Follow the branch from sample ``first`` - 1 on, then set all rates; return the first sample [-] that is not reached.

    Where all are reached it returns their number; only then are the rates set.
    q : (samples, nq) [rad], [m] holds the given coordinates, and in row ``first`` - 1 all
    qd, qdd : (samples, nv) rates [rad/s], [rad/s^2], zeros where they are unknown
    condition : (samples,) an estimate of each condition number [-]; samples where it is infinite are left to others
    """
    _fill_equations(chain, problem, q[first - 1])
    for k in range(first, q.shape[0]):  # Newton ends with the equations where it ends
        if not _fill_prediction(chain, problem, q[k - 1], qd[k - 1], time[k] - time[k - 1]):
            return k
        for i in range(problem.owner.shape[0]):
            if not problem.owner[i]:
                problem.guess[i] = q[k, i]
        predicted = q[k]  # the row takes the prediction of what is not given
        _copy(problem.guess, predicted)
        if not close_by_newton(chain, problem):
            return k
        for i in range(problem.owner.shape[0]):
            if abs(problem.guess[i] - predicted[i]) > LARGEST_SURPRISE * problem.sizes[i]:
                return k
        _copy(problem.guess, q[k])
    for k in range(q.shape[0]):
        condition[k] = _solve_rates(chain, problem, q[k], qd[k], qdd[k])
        if problem.change.shape[0] > 0:
            _compute_change(problem, k)
    return q.shape[0]


@jit_inner
def _fill_prediction(chain, problem, q, qd, step):
    """Move problem.guess from q by the rates at a sample, the unknown ones solved for; False where these are not told."""
    _copy(qd, problem.step)
    for i in range(problem.unknown.shape[0]):
        problem.step[problem.unknown[i]] = 0.0
    for r in range(problem.scale.shape[0]):
        problem.y[r, 0] = 0.0
        for i in range(problem.step.shape[0]):
            problem.y[r, 0] += problem.g[r, i] * problem.step[i] / problem.scale[r]
    if not compute_qr(problem):
        return False
    solve_factored(problem, problem.step)
    for i in range(problem.step.shape[0]):
        problem.step[i] *= step
    _copy(q, problem.guess)
    integrate_coordinates(chain.nodes, problem.guess, problem.step)
    return True


@jit_inner
def _compute_change(problem, k):
    """Set the change of G_u since the last call: |G_u - G_before|_F / |G_u|_F sqrt(columns)."""
    moved = size = 0.0
    for e in range(problem.fronts.entry.shape[0]):
        r = problem.fronts.entry[e, 0]
        i = problem.fronts.entry[e, 1]
        value = problem.g[r, problem.unknown[i]] * problem.measure[i] / problem.scale[r]
        moved += (value - problem.before[e]) ** 2
        size += value**2
        problem.before[e] = value
    problem.change[k] = math.sqrt(moved * problem.unknown.shape[0] / size) if size > 0.0 else 0.0


@jit_inner
def _solve_rates(chain, problem, q, qd, qdd):
    """Set the unknown rates of one sample, zero on entry, from the closures; return an estimate of the condition number."""
    move_nodes(chain.nodes, q, qd, qdd, chain.joints, chain.frames)
    fill_closure_rows(chain.nodes, chain.rows, chain.frames, chain.phi, problem.g)
    _fill_matrix(problem)
    if not compute_qr(problem):
        return np.inf
    for order in range(1, 3):
        if order == 2:
            move_nodes(chain.nodes, q, qd, qdd, chain.joints, chain.frames)
            fill_closure_residuals(chain.rows, chain.frames, chain.phi)
        for k in range(problem.scale.shape[0]):
            problem.y[k, 0] = (
                chain.phi[k, order] + compute_coupling_terms(k, chain.rows, q, qd, qdd)[order]
            ) / problem.scale[k]
        solve_factored(problem, qd if order == 1 else qdd)
    return compute_condition_estimate(problem.fronts, problem.qr, problem.x, problem.sign)


@jit_inner
def _update_largest_residual(worst, at, kind, value, s, k, size):
    """Remember the largest residual of one kind, where it is, and the largest size that it is held against."""
    if not value <= worst[kind, 0]:  # a NaN is the largest
        worst[kind, 0] = value
        at[kind, 0] = s
        at[kind, 1] = k
    worst[kind, 1] = max(worst[kind, 1], size)


@jit
def evaluate_jacobians(chain, scale, motion, given, g, worst, at):
    """Set G (samples, rows, nv) [m/rad], [-], zero on entry, of a motion that is given, and how far it is from closed.

    motion : of all nodes in the world, (samples, nodes, ...) [m, rad, s], which is set, or room for one sample
    given : q (samples, nq), qd, qdd (samples, nv) [rad or m, s]
    worst : (3, 2) the largest |phi|, |phi'|, |phi''|, and 1, |G| |qd|, |G| |qdd| + |phi'' - G qdd|, all over the scale
    at : (3, 2) their sample and row
    """
    rows = chain.rows
    keeps = motion.x.shape[0] > 1
    q, qd, qdd = given
    for s in range(q.shape[0]):
        frames = take_sample(motion, s if keeps else 0)
        move_nodes(chain.nodes, q[s], qd[s], qdd[s], chain.joints, frames)
        fill_closure_rows(chain.nodes, rows, frames, chain.phi, g[s])
        for k in range(scale.shape[0]):
            one = chain.phi[k]
            two = compute_coupling_terms(k, rows, q[s], qd[s], qdd[s])
            phi = one[0] + two[0]
            rate = one[1] + two[1]
            second = one[2] + two[2]
            speed = size = turning = 0.0
            for i in range(qd.shape[1]):
                speed += abs(g[s, k, i] * qd[s, i])
                size += abs(g[s, k, i] * qdd[s, i])
                turning += g[s, k, i] * qdd[s, i]
            _update_largest_residual(worst, at, 0, abs(phi) / scale[k], s, k, 1.0)
            _update_largest_residual(worst, at, 1, abs(rate) / scale[k], s, k, speed / scale[k])
            _update_largest_residual(
                worst, at, 2, abs(second) / scale[k], s, k, (size + abs(second - turning)) / scale[k]
            )
