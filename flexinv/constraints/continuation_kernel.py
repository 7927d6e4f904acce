"""Following closed loops in compiled code, sample by sample, as long as the configuration is regular.

Newton on phi(q) = 0 with G_u step = -phi, from a prediction along G_u rate_u = -G_g rate_g; then the exact rates.  Every system
is a least-squares one of full rank (redundant constraints repeat others), solved by Householder reflections with pivoting.
Where it is not of full rank, where Newton fails or goes too far, the kernel stops at that sample: `continuation` decides
what to do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.constraints.equations import geared, jacobian, residual
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kinematics.configuration import move_nodes, step_coordinates
from flexinv.typing import Array

# Newton ends with an increment below this, in radians or metres: its error is about the square, which is rounding.
LAST_INCREMENT = 1e-9
# Closure equations are then met to this, in metres over the mechanism's length or radians: rounding of 1e-16 a node in chains
# of up to some thousand nodes.  A loop that cannot close (constraints that contradict each other) stays open by far more.
CLOSED = 1e-12
MOST_ITERATIONS = 30
# A passive coordinate may differ from its prediction by this, or the step between samples is halved: it is the largest
# step over which Newton is trusted to stay on its branch.
LARGEST_SURPRISE = 0.05  # [rad] or of the mechanism's length
# A pivot below this part of the first may belong to a rank that is not full: the singular values decide, not the kernel.
SMALLEST_PIVOT = 1e-7


class Problem(NamedTuple):
    """Data and work space of the continuation kernel.

    given, unknown : velocity coordinates; owner : (nq,) whether a coordinate belongs to an unknown one
    scale : (rows,) [m], [-] of the equations; sizes : (nq,), measure : (unknown,) of the coordinates [m], [-]
    """

    unknown: NDArray[np.int64]
    owner: NDArray[np.bool_]
    scale: Array
    sizes: Array
    g: Array  # (rows, nv)
    a: Array  # (rows, unknown) G_u over its scales, then its reflections and R
    y: Array  # (rows,) right-hand side
    beta: Array  # (unknown,)
    diagonal: Array  # (unknown,) of R
    pivot: NDArray[np.int64]
    x: Array  # (unknown,) solution over its measure
    step: Array  # (nv,)
    guess: Array  # (nq,)
    rest: Array  # (nv,) zeros
    measure: Array = np.ones(0)


@jit_inner
def _swap(a, pivot, j, p):
    for i in range(a.shape[0]):
        a[i, j], a[i, p] = a[i, p], a[i, j]
    pivot[j], pivot[p] = pivot[p], pivot[j]


@jit_inner
def factor(problem):
    """Factor Q R of problem.a with pivoting, in place [any unit]; False where the rank may not be full."""
    rows, columns = problem.a.shape
    if rows < columns:
        return False
    for j in range(columns):
        problem.pivot[j] = j
    for j in range(columns):
        best, at = -1.0, j
        for c in range(j, columns):
            size = 0.0
            for i in range(j, rows):
                size += problem.a[i, c] * problem.a[i, c]
            if size > best:
                best, at = size, c
        _swap(problem.a, problem.pivot, j, at)
        norm, first = math.sqrt(best), problem.a[j, j]
        if not norm > SMALLEST_PIVOT * (abs(problem.diagonal[0]) if j else 0.0):  # a NaN is not either
            return False
        problem.diagonal[j] = -norm if first >= 0.0 else norm
        problem.a[j, j] = first - problem.diagonal[j]
        problem.beta[j] = 1.0 / (norm * (norm + abs(first)))
        for c in range(j + 1, columns):
            _reflect(problem.a[:, c], problem, j)
    return True


@jit_inner
def _reflect(y, problem, j):
    """y - beta v (v . y) with the reflection v in column j."""
    s = 0.0
    for i in range(j, y.shape[0]):
        s += problem.a[i, j] * y[i]
    s *= problem.beta[j]
    for i in range(j, y.shape[0]):
        y[i] -= s * problem.a[i, j]


@jit_inner
def _back(problem, y):
    """Solve R z = y in place of y."""
    for j in range(problem.a.shape[1] - 1, -1, -1):
        for c in range(j + 1, problem.a.shape[1]):
            y[j] -= problem.a[j, c] * y[c]
        y[j] /= problem.diagonal[j]


@jit_inner
def solve_factored(problem):
    """Set problem.x to the least-squares solution of the factored system and the right-hand side problem.y [any unit]."""
    for j in range(problem.a.shape[1]):
        _reflect(problem.y, problem, j)
    _back(problem, problem.y)
    for j in range(problem.a.shape[1]):
        problem.x[problem.pivot[j]] = problem.y[j]


@jit_inner
def condition_bound(problem):
    """Return |R| |R^-1| in Frobenius' norm [-]: at least the condition number, at most that many times the columns."""
    columns = problem.a.shape[1]
    size = inverse = 0.0
    for j in range(columns):
        size += problem.diagonal[j] ** 2
        for c in range(j + 1, columns):
            size += problem.a[j, c] ** 2
        problem.y[:columns] = 0.0
        problem.y[j] = 1.0
        _back(problem, problem.y)
        for i in range(j + 1):
            inverse += problem.y[i] ** 2
    return math.sqrt(size * inverse)


@jit_inner
def _equations(nodes, rows, problem, q, joints, frames):
    """Set problem.g, problem.a = G_u and problem.y = phi at a configuration, all over their scales."""
    move_nodes(nodes, q, problem.rest, problem.rest, joints, frames)
    jacobian(nodes, rows, frames, problem.g)
    for k in range(problem.scale.shape[0]):
        problem.y[k] = (
            residual(k, rows, frames)[0] + geared(k, rows, q, problem.rest, problem.rest)[0]
        ) / problem.scale[k]
        for i in range(problem.unknown.shape[0]):
            problem.a[k, i] = problem.g[k, problem.unknown[i]] * problem.measure[i] / problem.scale[k]


@jit_inner
def _copy(source, to):
    for i in range(source.shape[0]):
        to[i] = source[i]


@jit_inner
def _largest(y):
    size = 0.0
    for i in range(y.shape[0]):
        if not abs(y[i]) <= size:  # a NaN stays
            size = abs(y[i])
    return size


@jit_inner
def newton(nodes, rows, problem, joints, frames):
    """Move problem.guess onto the closures [rad], [m]; whether it got there."""
    for _ in range(MOST_ITERATIONS):
        _equations(nodes, rows, problem, problem.guess, joints, frames)
        if not factor(problem):
            return False
        solve_factored(problem)
        problem.step[:] = 0.0
        for i in range(problem.unknown.shape[0]):
            problem.step[problem.unknown[i]] = -problem.x[i] * problem.measure[i]
        step_coordinates(nodes, problem.guess, problem.step)
        if _largest(problem.x) < LAST_INCREMENT:
            _equations(nodes, rows, problem, problem.guess, joints, frames)
            return _largest(problem.y) < CLOSED
    return False


@jit_inner
def _predict(nodes, rows, problem, q, rate, dt, joints, frames):
    """Set problem.guess to q moved on by dt, unknown rates as closures demand; return whether these are determined."""
    _equations(nodes, rows, problem, q, joints, frames)
    _copy(rate, problem.step)
    for i in range(problem.unknown.shape[0]):
        problem.step[problem.unknown[i]] = 0.0
    for k in range(problem.scale.shape[0]):
        problem.y[k] = 0.0
        for i in range(problem.step.shape[0]):
            problem.y[k] += problem.g[k, i] * problem.step[i] / problem.scale[k]
    if not factor(problem):
        return False
    solve_factored(problem)
    for i in range(problem.unknown.shape[0]):
        problem.step[problem.unknown[i]] = -problem.x[i] * problem.measure[i]
    for i in range(problem.step.shape[0]):
        problem.step[i] *= dt
    _copy(q, problem.guess)
    step_coordinates(nodes, problem.guess, problem.step)
    return True


@jit
def follow(nodes, rows, problem, time, q, qd, first, joints, frames):
    """Follow the branch from sample ``first`` - 1 on; return the first sample [-] that is not reached, or their number.

    q : (samples, nq) [rad], [m] holds the given coordinates, and in row ``first`` - 1 all; qd : (samples, nv) their rates [rad/s]
    """
    for k in range(first, q.shape[0]):
        if not _predict(nodes, rows, problem, q[k - 1], qd[k - 1], time[k] - time[k - 1], joints, frames):
            return k
        for i in range(problem.owner.shape[0]):
            if not problem.owner[i]:
                problem.guess[i] = q[k, i]
        predicted = q[k]  # the row takes the prediction of what is not given
        _copy(problem.guess, predicted)
        if not newton(nodes, rows, problem, joints, frames):
            return k
        for i in range(problem.owner.shape[0]):
            if abs(problem.guess[i] - predicted[i]) > LARGEST_SURPRISE * problem.sizes[i]:
                return k
        _copy(problem.guess, q[k])
    return q.shape[0]


@jit
def rates(nodes, rows, problem, q, qd, qdd, condition, joints, frames):
    """Set the unknown rates qd, qdd (samples, nv) [rad, m, s] from the closures, and a bound of each condition number [-].

    The unknown columns hold zeros on entry; samples whose condition is infinite afterwards are left to others.
    """
    for s in range(q.shape[0]):
        condition[s] = np.inf
        move_nodes(nodes, q[s], qd[s], qdd[s], joints, frames)
        jacobian(nodes, rows, frames, problem.g)
        for k in range(problem.scale.shape[0]):
            problem.y[k] = (residual(k, rows, frames)[1] + geared(k, rows, q[s], qd[s], qdd[s])[1]) / problem.scale[k]
            for i in range(problem.unknown.shape[0]):
                problem.a[k, i] = problem.g[k, problem.unknown[i]] * problem.measure[i] / problem.scale[k]
        if not factor(problem):
            continue
        solve_factored(problem)
        for i in range(problem.unknown.shape[0]):
            qd[s, problem.unknown[i]] = -problem.x[i] * problem.measure[i]
        move_nodes(nodes, q[s], qd[s], qdd[s], joints, frames)
        for k in range(problem.scale.shape[0]):
            problem.y[k] = (residual(k, rows, frames)[2] + geared(k, rows, q[s], qd[s], qdd[s])[2]) / problem.scale[k]
        solve_factored(problem)
        for i in range(problem.unknown.shape[0]):
            qdd[s, problem.unknown[i]] = -problem.x[i] * problem.measure[i]
        condition[s] = condition_bound(problem)


@jit_inner
def _hold(worst, at, kind, value, s, k, size):
    """Remember the largest residual of one kind, where it is, and the largest size that it is held against."""
    if not value <= worst[kind, 0]:  # a NaN is the largest
        worst[kind, 0], at[kind, 0], at[kind, 1] = value, s, k
    worst[kind, 1] = max(worst[kind, 1], size)


@jit
def closing(nodes, rows, scale, q, qd, qdd, g, worst, at, joints, frames):
    """Set G (samples, rows, nv) [m/rad], [-] of a motion that is given, and how far it is from closed.

    worst : (3, 2) the largest |phi|, |phi'|, |phi''|, and 1, |G| |qd|, |G| |qdd| + |phi'' - G qdd|, all over the scale
    at : (3, 2) their sample and row
    """
    for s in range(q.shape[0]):
        move_nodes(nodes, q[s], qd[s], qdd[s], joints, frames)
        jacobian(nodes, rows, frames, g[s])
        for k in range(scale.shape[0]):
            one, two = residual(k, rows, frames), geared(k, rows, q[s], qd[s], qdd[s])
            phi, rate, second = one[0] + two[0], one[1] + two[1], one[2] + two[2]
            speed = size = turning = 0.0
            for i in range(qd.shape[1]):
                speed += abs(g[s, k, i] * qd[s, i])
                size += abs(g[s, k, i] * qdd[s, i])
                turning += g[s, k, i] * qdd[s, i]
            _hold(worst, at, 0, abs(phi) / scale[k], s, k, 1.0)
            _hold(worst, at, 1, abs(rate) / scale[k], s, k, speed / scale[k])
            _hold(worst, at, 2, abs(second) / scale[k], s, k, (size + abs(second - turning)) / scale[k])
