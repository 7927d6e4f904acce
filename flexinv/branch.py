"""Following closed loops in compiled code, sample by sample, as long as the configuration is regular.

Newton on phi(q) = 0 with G_u step = -phi, from a prediction along G_u rate_u = -G_g rate_g; then the exact rates.  Every system
is a least-squares one of full rank (redundant constraints repeat others), solved by Householder reflections with pivoting.
Where it is not of full rank, where Newton fails or goes too far, the kernel stops at that sample: `loops` decides what to do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.compiled import jit, jit_inner
from flexinv.coordinates import move_nodes, step_coordinates
from flexinv.mechanism import Array
from flexinv.rows import geared, jacobian, residual

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
    """What the kernel needs to know, and where it works.

    given, unknown : velocity coordinates; owner : (nq,) whether a coordinate belongs to an unknown one
    scale : (rows,) [m], [-] of the equations; sizes : (nq,) of the coordinates
    """

    unknown: NDArray[np.int64]
    owner: NDArray[np.bool_]
    scale: Array
    sizes: Array
    g: Array  # (rows, nv)
    a: Array  # (rows, unknown) G_u, then its reflections and R
    y: Array  # (rows,) right-hand side
    beta: Array  # (unknown,)
    diagonal: Array  # (unknown,) of R
    pivot: NDArray[np.int64]
    x: Array  # (unknown,) solution
    step: Array  # (nv,)
    guess: Array  # (nq,)
    rest: Array  # (nv,) zeros


@jit_inner
def _swap(a, pivot, j, p):
    for i in range(a.shape[0]):
        a[i, j], a[i, p] = a[i, p], a[i, j]
    pivot[j], pivot[p] = pivot[p], pivot[j]


@jit_inner
def factor(p):
    """Factor Q R of p.a with pivoting, in place [any unit]; False where the rank may not be full."""
    rows, columns = p.a.shape
    if rows < columns:
        return False
    for j in range(columns):
        p.pivot[j] = j
    for j in range(columns):
        best, at = -1.0, j
        for c in range(j, columns):
            size = 0.0
            for i in range(j, rows):
                size += p.a[i, c] * p.a[i, c]
            if size > best:
                best, at = size, c
        _swap(p.a, p.pivot, j, at)
        norm, first = math.sqrt(best), p.a[j, j]
        if not norm > SMALLEST_PIVOT * (abs(p.diagonal[0]) if j else 0.0):  # a NaN is not either
            return False
        p.diagonal[j] = -norm if first >= 0.0 else norm
        p.a[j, j] = first - p.diagonal[j]
        p.beta[j] = 1.0 / (norm * (norm + abs(first)))
        for c in range(j + 1, columns):
            _reflect(p.a[:, c], p, j)
    return True


@jit_inner
def _reflect(y, p, j):
    """y - beta v (v . y) with the reflection v in column j."""
    s = 0.0
    for i in range(j, y.shape[0]):
        s += p.a[i, j] * y[i]
    s *= p.beta[j]
    for i in range(j, y.shape[0]):
        y[i] -= s * p.a[i, j]


@jit_inner
def _back(p, y):
    """Solve R z = y in place of y."""
    for j in range(p.a.shape[1] - 1, -1, -1):
        for c in range(j + 1, p.a.shape[1]):
            y[j] -= p.a[j, c] * y[c]
        y[j] /= p.diagonal[j]


@jit_inner
def solve_factored(p):
    """Set p.x to the least-squares solution of the factored system and the right-hand side p.y [any unit]."""
    for j in range(p.a.shape[1]):
        _reflect(p.y, p, j)
    _back(p, p.y)
    for j in range(p.a.shape[1]):
        p.x[p.pivot[j]] = p.y[j]


@jit_inner
def condition_bound(p):
    """Return |R| |R^-1| in Frobenius' norm [-]: at least the condition number, at most that many times the columns."""
    columns = p.a.shape[1]
    size = inverse = 0.0
    for j in range(columns):
        size += p.diagonal[j] ** 2
        for c in range(j + 1, columns):
            size += p.a[j, c] ** 2
        p.y[:columns] = 0.0
        p.y[j] = 1.0
        _back(p, p.y)
        for i in range(j + 1):
            inverse += p.y[i] ** 2
    return math.sqrt(size * inverse)


@jit_inner
def _equations(t, c, p, q, j, f):
    """Set p.g, p.a = G_u and p.y = phi at a configuration, all over their scales."""
    move_nodes(t, q, p.rest, p.rest, j, f)
    jacobian(t, c, f, p.g)
    for k in range(p.scale.shape[0]):
        p.y[k] = (residual(k, c, f)[0] + geared(k, c, q, p.rest, p.rest)[0]) / p.scale[k]
        for i in range(p.unknown.shape[0]):
            p.a[k, i] = p.g[k, p.unknown[i]] / p.scale[k]


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
def newton(t, c, p, j, f):
    """Move p.guess onto the closures [rad], [m]; whether it got there."""
    for _ in range(MOST_ITERATIONS):
        _equations(t, c, p, p.guess, j, f)
        if not factor(p):
            return False
        solve_factored(p)
        p.step[:] = 0.0
        for i in range(p.unknown.shape[0]):
            p.step[p.unknown[i]] = -p.x[i]
        step_coordinates(t, p.guess, p.step)
        if _largest(p.x) < LAST_INCREMENT:
            _equations(t, c, p, p.guess, j, f)
            return _largest(p.y) < CLOSED
    return False


@jit_inner
def _predict(t, c, p, q, rate, dt, j, f):
    """Set p.guess to q moved on by dt with the given rates, the unknown ones on the closures; whether they are determined."""
    _equations(t, c, p, q, j, f)
    _copy(rate, p.step)
    for i in range(p.unknown.shape[0]):
        p.step[p.unknown[i]] = 0.0
    for k in range(p.scale.shape[0]):
        p.y[k] = 0.0
        for i in range(p.step.shape[0]):
            p.y[k] += p.g[k, i] * p.step[i] / p.scale[k]
    if not factor(p):
        return False
    solve_factored(p)
    for i in range(p.unknown.shape[0]):
        p.step[p.unknown[i]] = -p.x[i]
    for i in range(p.step.shape[0]):
        p.step[i] *= dt
    _copy(q, p.guess)
    step_coordinates(t, p.guess, p.step)
    return True


@jit
def follow(t, c, p, time, q, qd, first, j, f):
    """Follow the branch from sample ``first`` - 1 on; return the first sample [-] that is not reached, or their number.

    q : (samples, nq) [rad], [m] holds the given coordinates, and in row ``first`` - 1 all; qd : (samples, nv) their rates [rad/s]
    """
    for k in range(first, q.shape[0]):
        if not _predict(t, c, p, q[k - 1], qd[k - 1], time[k] - time[k - 1], j, f):
            return k
        for i in range(p.owner.shape[0]):
            if not p.owner[i]:
                p.guess[i] = q[k, i]
        predicted = q[k]  # the row takes the prediction of what is not given
        _copy(p.guess, predicted)
        if not newton(t, c, p, j, f):
            return k
        for i in range(p.owner.shape[0]):
            if abs(p.guess[i] - predicted[i]) > LARGEST_SURPRISE * p.sizes[i]:
                return k
        _copy(p.guess, q[k])
    return q.shape[0]


@jit
def rates(t, c, p, q, qd, qdd, condition, j, f):
    """Set the unknown rates qd, qdd (samples, nv) [rad, m, s] from the closures, and a bound of each condition number [-].

    The unknown columns hold zeros on entry; samples whose condition is infinite afterwards are left to others.
    """
    for s in range(q.shape[0]):
        condition[s] = np.inf
        move_nodes(t, q[s], qd[s], qdd[s], j, f)
        jacobian(t, c, f, p.g)
        for k in range(p.scale.shape[0]):
            p.y[k] = residual(k, c, f)[1] + geared(k, c, q[s], qd[s], qdd[s])[1]
            for i in range(p.unknown.shape[0]):
                p.a[k, i] = p.g[k, p.unknown[i]]
        if not factor(p):
            continue
        solve_factored(p)
        for i in range(p.unknown.shape[0]):
            qd[s, p.unknown[i]] = -p.x[i]
        move_nodes(t, q[s], qd[s], qdd[s], j, f)
        for k in range(p.scale.shape[0]):
            p.y[k] = residual(k, c, f)[2] + geared(k, c, q[s], qd[s], qdd[s])[2]
        solve_factored(p)
        for i in range(p.unknown.shape[0]):
            qdd[s, p.unknown[i]] = -p.x[i]
        condition[s] = condition_bound(p)


@jit_inner
def _hold(worst, at, kind, value, s, k, size):
    """Remember the largest residual of one kind, where it is, and the largest size that it is held against."""
    if not value <= worst[kind, 0]:  # a NaN is the largest
        worst[kind, 0], at[kind, 0], at[kind, 1] = value, s, k
    worst[kind, 1] = max(worst[kind, 1], size)


@jit
def closing(t, c, scale, q, qd, qdd, g, worst, at, j, f):
    """Set G (samples, rows, nv) [m/rad], [-] of a motion that is given, and how far it is from closed.

    worst : (3, 2) the largest |phi| / scale, |phi'|, |phi''|, and 1, |G| |qd|, |G| |qdd| + |phi'' - G qdd|; at : (3, 2) their
    sample and row
    """
    for s in range(q.shape[0]):
        move_nodes(t, q[s], qd[s], qdd[s], j, f)
        jacobian(t, c, f, g[s])
        for k in range(scale.shape[0]):
            one, two = residual(k, c, f), geared(k, c, q[s], qd[s], qdd[s])
            phi, rate, second = one[0] + two[0], one[1] + two[1], one[2] + two[2]
            speed = size = turning = 0.0
            for i in range(qd.shape[1]):
                speed += abs(g[s, k, i] * qd[s, i])
                size += abs(g[s, k, i] * qdd[s, i])
                turning += g[s, k, i] * qdd[s, i]
            _hold(worst, at, 0, abs(phi) / scale[k], s, k, 1.0)
            _hold(worst, at, 1, abs(rate), s, k, speed)
            _hold(worst, at, 2, abs(second), s, k, size + abs(second - turning))
