"""Dead points of drives: positions at which some motion that the closures allow moves no drive, so that none can give it.

Where the motion is given at other joints than the drives', positions are regular there and efforts are not: they grow as one over
the way to it.  A motion v of the joints without a drive alone keeps the closures where  G_u v = 0,  with the columns G_u of these
joints: a dead point is where G_u loses a rank for an instant, touched or passed, and it is one whether a force is needed or not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexinv.constraints.closures import Rows, list_velocity_scales
from flexinv.constraints.continuation import Follower
from flexinv.constraints.singular_search import OFF_LINE, TURNING_BACK, WORST_CONDITION, find_singular
from flexinv.errors import ConvergenceError
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import JointHistory
from flexinv.typing import Array, Mask, Triple

SAMPLES_AT_ONCE = 4096  # whose Jacobians are in memory
DOUBTFUL = 1e-3  # of singular values: below it the square of their ratio has lost six of sixteen digits


def check_drives(
    mesh: Mesh,
    rows: Rows,
    given: tuple[JointHistory, tuple[float, ...]],
    unknown: Mask,
    time: Array,
    joints: Triple,
    g: Array | None = None,
) -> None:
    """Raise ConvergenceError with the instant at which drives come to a dead point, at a sample or between two.

    rows : constraints of the closures that act; given : the motion and its knots [s]; unknown : (nv,) what follows from it
    time : (samples,) [s]; joints : q (samples, nq), qd, qdd (samples, nv) of the closed loops [rad or m, s]
    g : (samples, rows, nv) gradients of the closures there, where they are known
    Nothing is said where the unknown joints are those without a drive, as `continuation` has looked at them, where there are too
    few drives everywhere, and where there is none.
    """
    m = mesh.mechanism
    undriven = ~m.actuated
    if len(time) < 2 or undriven.all() or not undriven.any() or np.array_equal(undriven, unknown):
        return
    history, knots = given
    follower = Follower(mesh, rows, undriven)
    way = follower.compute_ways(time, joints)
    if g is not None and _is_excluded(g[:, :, undriven], follower, way):
        return
    branch = replace(
        Follower(mesh, rows, unknown).build_branch(history, knots), matrices=follower.compute_passive_columns
    )
    q = joints[0]
    condition, change = _compute_conditions(follower, q, g)
    if not (condition < WORST_CONDITION).any():
        return
    instant = find_singular(branch, time, q, condition, change, way)
    on_it = np.flatnonzero(~(condition < WORST_CONDITION))
    if len(on_it) and (instant is None or time[on_it[0]] < instant):
        instant = float(time[on_it[0]])
    if instant is not None:
        names = ", ".join(f"'{joint.name}'" for joint in m.joints if joint.actuated)
        raise ConvergenceError(
            f"mechanism '{m.name}', t = {instant:.10g} s: dead point of the drives at {names}: some motion that the closures "
            "allow moves none of them there, and their efforts grow without bound on the way to it; write actuated = true for "
            "another joint, or keep the motion away from this position"
        )


def _is_excluded(g: Array, follower: Follower, way: tuple[Array, Array]) -> bool:
    """Return True where sums of squares of two columns exclude a dead point at all samples, as `find_singular` would.

    With the trace t of G^T G and its determinant d:  s_2 / s_1 >= sqrt(d) / t,  s_1^2 >= t / 2,  and the norm of a change is at
    most its Frobenius norm.
    """
    if g.shape[2] != 2 or g.shape[1] < 2 or len(g) > SAMPLES_AT_ONCE:
        return False
    scales = list_velocity_scales(follower.mesh)[follower.unknown]
    first, second = (np.ascontiguousarray(g[:, :, k].T) * (scales[k] / follower.rows.scale[:, None]) for k in range(2))
    one, other, across = (np.einsum("rs,rs->s", a, b) for a, b in ((first, first), (second, second), (first, second)))
    trace = one + other
    smallest = trace.min()
    least = np.sqrt(max((one * other - across**2).min(), 0.0)) / max(trace.max(), np.finfo(float).tiny)
    if not least > DOUBTFUL:
        return False
    steps = (np.diff(first) ** 2 + np.diff(second) ** 2).sum(axis=0)
    rates, accelerations = way
    bend = OFF_LINE * rates.max() ** 2 + TURNING_BACK * accelerations.max()
    return bool(2.0 * least > np.sqrt(2.0 * steps.max() / smallest) + bend)


def _compute_conditions(follower: Follower, q: Array, whole: Array | None) -> tuple[Array, Array]:
    """Condition of G_u at q (samples, nq), and its change since the sample before over its largest singular value [-]."""
    condition = np.empty(len(q))
    change = np.zeros(len(q))
    for first in range(0, len(q), SAMPLES_AT_ONCE):
        begin = max(first - 1, 0)
        last = first + SAMPLES_AT_ONCE
        columns = None if whole is None else follower.take_passive_columns(whole[begin:last])
        g = follower.compute_passive_columns(q[begin:last]) if columns is None else columns
        size, least = find_singular_values(g)
        size = np.maximum(size, np.finfo(float).tiny)
        piece = slice(begin, begin + len(g))
        condition[piece] = np.divide(size, least, out=np.full(len(g), np.inf), where=least > 0.0)
        if g.shape[1] < g.shape[2]:
            condition[piece] = np.inf
        steps = find_largest_value(np.diff(g, axis=0))
        change[begin + 1 : begin + len(g)] = steps / np.minimum(size[1:], size[:-1])
    return condition, change


def find_singular_values(g: Array) -> tuple[Array, Array]:
    """Return the largest and the least singular value (samples,) of matrices (samples, rows, columns) [any unit].

    Of two columns they are roots of a square equation, many times as fast as by LAPACK; the least one is lost near zero, and
    found by LAPACK there.
    """
    if g.shape[2] != 2 or g.shape[1] < 2:
        values: Array = np.linalg.svd(g, compute_uv=False).astype(float, copy=False)
        return values[:, 0], values[:, -1]
    one, other, across = _compute_products(g)
    largest = _compute_larger_root(one, other, across)
    least = np.sqrt(np.maximum(one * other - across**2, 0.0)) / np.maximum(largest, np.finfo(float).tiny)
    doubtful = np.flatnonzero(~(least > DOUBTFUL * largest))
    if len(doubtful):
        least[doubtful] = np.linalg.svd(g[doubtful], compute_uv=False)[:, -1]
    return largest, least


def find_largest_value(g: Array) -> Array:
    """Return the largest singular value (samples,) of matrices (samples, rows, columns) [any unit]."""
    if g.shape[2] != 2:
        return np.asarray(np.linalg.norm(g, ord=2, axis=(1, 2)))
    return _compute_larger_root(*_compute_products(g))


def _compute_larger_root(one: Array, other: Array, across: Array) -> Array:
    """The root of the larger eigenvalue of G^T G (samples,), of two columns."""
    return np.sqrt(0.5 * (one + other + np.hypot(one - other, 2.0 * across)))


def _compute_products(g: Array) -> tuple[Array, Array, Array]:
    """The products (samples,) of each of two columns with itself, and of both."""
    first, second = np.ascontiguousarray(np.moveaxis(g, 2, 0))
    return (
        np.einsum("sr,sr->s", first, first),
        np.einsum("sr,sr->s", second, second),
        np.einsum("sr,sr->s", first, second),
    )
