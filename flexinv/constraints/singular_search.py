"""Search for singular positions between samples: where a Jacobian that moves with the time loses its rank for an instant.

Samples see a singular position only if one lies on it.  Between two samples the smallest singular value s of a matrix G cannot
fall to zero unless

    s_k + s_(k+1) <= |G_(k+1) - G_k|      (singular values change by no more than the matrix, Weyl)

with some more for the bend of G.  Where that holds the interval is cut into parts, until s can be extrapolated.  With the
singular vectors U, V at the beginning of a part

    d(t) = det(U^T G(t) V) / (s_1 .. s_(n-1))

is smooth, equals s there, and is zero where s is: a change of sign and a touching are roots and least values of one polynomial.
Only what lies before the singular position is read, since behind it the branch may be another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from flexinv.kernels.smooth_pieces import fit_pieces
from flexinv.typing import Array, Indices, Mask, RealOrComplex


@dataclass(frozen=True)
class Branch:
    """A branch of configurations, and the matrix that may be singular on it.

    follow : some times (n,) [s], q (nq,) at the first -> q (m, nq) [rad], [m] at the m that are reached
    matrices : q (m, nq) -> G (m, rows, columns) [-]
    knots : times [s] between which the motion is smooth
    coordinate : times (n,) [s] -> the prescribed coordinate (n,) [rad], [m] where there is one, on which all others depend
    """

    follow: Callable[[Array, Array], Array]
    matrices: Callable[[Array], Array]
    knots: tuple[float, ...] = ()
    coordinate: Callable[[Array], Array] | None = None

    def evaluate_jacobians(self, times: Array, start: Array) -> tuple[Array, Array]:
        """Return q (m, nq) [rad], [m] and G (m, rows, columns) [-] at the times [s] that are reached from ``start`` (nq,)."""
        places = self.follow(times, start)
        return places, self.matrices(places)


# A configuration whose passive coordinates are this badly determined is singular: eight digits of the torque are lost.
WORST_CONDITION = 1e8
SAME_ESTIMATE = 1e-10  # [s]: two estimates of an instant as close as this are one
PARTS = 8  # of an interval that is cut
# A part in which G changes by less than this of itself is short enough to extrapolate: terms of the seventh order are rounding.
SHORT = 0.02
# Nodes of a part at which d is computed, and the degree of the polynomial through them: over a part in which G changes by SHORT
# the next term is SHORT^6, 6e-11, and twice as many nodes as coefficients divide the rounding of the places among them.
NODES = 12
DEGREE = 5
# Over two parts, of which the second begins where the first ends, d falls by a factor of 25: a polynomial of seventh degree
# enlarges rounding by T_7(1.08) = 8.
WIDE_DEGREE = 7
# Where d begins below this the zero of g(d) is known: d^6 of the next term is rounding, 1e-14, and so is what places have lost,
# 1e-16 / d, by a factor of 60 where a polynomial of fifth degree over (0.2, 1) is extrapolated to 0.  Both are below
# EXTRAPOLATED.
ZOOMED = 5e-3
EXTRAPOLATED = 1e-10
KEPT = 0.2  # of its first value, above which d is computed well enough to be extrapolated from
MOST_ZOOMS = 60
# of the first d: below it nodes are left out, and how far a polynomial through both sides may miss d
NEAR = 0.02
SMOOTH = 1e-9
# Change of G from where extrapolation begins to the part in question.  d begins at about as much; places are known there to
# 1e-16 / d, 5e-15, which extrapolation over (KEPT, 1) enlarges by T_5(1.5) = 61, to 3e-13: a thousandth of the time bar of 1e-9 s
# where d falls by 0.3 1/s or faster.
REGULAR = 2e-2
AT_ONCE = 1024  # intervals whose matrices are in memory
CLOSE = 1e-6  # d below which rounding of the places, 1e-16 / d, spoils what is extrapolated
# Bend of G between two samples over the square of the joints' way [-].  G leaves its chord by h^2 |G''| / 8 at most.  Its columns
# are arms turned by joints: |G''| is below |G| times the square of the sum of the rates for each of n columns, sqrt(n) in the
# norm: sqrt(n) / 8 of the way's square, on both sides of a singular position.  Four passive joints have 0.5; in longer loops
# several joints share the way.
OFF_LINE = 0.5
# And of accelerations, which are all that moves where joints turn back: h^2 q'' / 8 on both sides.
TURNING_BACK = 0.25


def find_singular(
    branch: Branch, time: Array, q: Array, condition: Array, change: Array, way: tuple[Array, Array]
) -> float | None:
    """Return the first instant [s] at which G is singular, at a sample or between two, None if there is none.

    time : (samples,) [s]; q : (samples, nq) [rad], [m] on the branch; condition : (samples,) not less than the condition number
    of G [-]; change : (samples,) of G since the sample before, over its largest singular value, or more [-]
    way : (samples - 1,) of all joints between two samples [rad], slides over the mechanism's length, by their rates, and by
        their accelerations, h^2 q''
    """
    least = np.divide(1.0, condition, out=np.zeros_like(condition), where=np.isfinite(condition) & (condition > 0.0))
    by_rates, by_accelerations = way
    bend = OFF_LINE * by_rates**2 + TURNING_BACK * by_accelerations
    reach = _find_largest_nearby(change[1:])
    intervals = np.flatnonzero(least[1:] + least[:-1] <= reach + bend)
    if len(intervals) == 0:
        return None
    done = np.cumsum(change)
    for k in intervals[_find_doubtful_intervals(branch, q, intervals, reach + bend)].tolist():
        singular = _find_between_samples(branch, time, q, done, k)
        if singular is not None:
            return singular
    return None


def find_within(branch: Branch, time: Array, q: Array, change: Array, k: int) -> float | None:
    """Return the first instant [s] between samples k and k + 1 at which G is singular, None if there is none.

    Where the branch ends there, k is the last sample that it reaches.  Arguments as in `find_singular`.
    """
    return _find_between_samples(branch, time, q, np.cumsum(change[: k + 1]), k)


def _find_between_samples(branch: Branch, time: Array, q: Array, done: Array, k: int) -> float | None:
    """As `find_within`, with the change of G up to each sample (samples,) [-]."""
    earlier = max(int(np.searchsorted(done, done[k] - REGULAR, side="right")) - 1, 0)
    return _find_in_interval(branch, float(time[k]), float(time[k + 1]), q[k], (float(time[earlier]), q[earlier]))


def _find_largest_nearby(change: Array) -> Array:
    """The largest change (intervals,) of G in each interval and in those beside it.

    A branch may come to a singular position and leave it again as it came, so that nothing of that is left between two samples:
    what comes before and after is as fast.
    """
    wide = np.concatenate([change[:1], change, change[-1:]])
    return np.asarray(np.maximum(np.maximum(wide[:-2], wide[2:]), change))


def _find_doubtful_intervals(branch: Branch, q: Array, intervals: Indices, reach: Array) -> Mask:
    """Mask of the intervals that singular values themselves do not exclude, a thousand at a time; reach : of all intervals."""
    out = np.ones(len(intervals), dtype=bool)
    for first in range(0, len(intervals), AT_ONCE):
        batch = intervals[first : first + AT_ONCE]
        before = branch.matrices(q[batch])
        after = branch.matrices(q[batch + 1])
        values, others = (np.linalg.svd(part, compute_uv=False) for part in (before, after))
        out[first : first + AT_ONCE] = values[:, -1] + others[:, -1] <= reach[batch] * values[:, 0]
    return out


def _find_in_interval(branch: Branch, start: float, end: float, q: Array, earlier: tuple[float, Array]) -> float | None:
    """The first instant of an interval at which G is singular; ``earlier``: an instant before and the place (nq,) there."""
    times = np.linspace(start, end, PARTS + 1)
    places, matrices = branch.evaluate_jacobians(times, q)
    if matrices.shape[2] == 0:
        return None
    values = np.linalg.svd(matrices, compute_uv=False)
    least = values[:, -1] / values[:, 0]
    size = values[:-1, 0]
    change = np.linalg.norm(np.diff(matrices, axis=0), ord=2, axis=(1, 2)) / size
    held = least[1:] + least[:-1] > _find_largest_nearby(change) + _compute_largest_bend(matrices) / size
    for k in range(len(times) - 1):
        if k < len(held) and held[k]:
            continue
        if k >= len(places):
            return None
        ends = float(times[k]), float(times[k + 1])
        before = (float(times[k - 1]), places[k - 1]) if k and change[k - 1] > REGULAR else earlier
        if k < len(held) and change[k] > SHORT and ends[1] - ends[0] > SAME_ESTIMATE:
            interval = _find_in_interval(branch, *ends, places[k], before)
        elif branch.coordinate is not None:
            interval = _find_by_coordinate(branch, branch.coordinate, (before[0], ends[1], end), before[1])
        else:
            interval = _find_by_extrapolation(branch, before[0], ends[1], before[1])
        if interval is not None:
            return interval
    return None


def _compute_largest_bend(matrices: Array) -> float:
    """The most by which G leaves the straight line between two of the matrices (m, rows, columns), by second differences."""
    second = np.diff(matrices, 2, axis=0)
    return 0.5 * float(np.linalg.norm(second, ord=2, axis=(1, 2)).max(initial=0.0))


def _find_by_coordinate(
    branch: Branch, coordinate: Callable[[Array], Array], span: tuple[float, float, float], q: Array
) -> float | None:
    """The instant at which the one prescribed coordinate g is where d is zero, in a short part or up to the interval's end.

    g is a smooth function of d, at dead points, where d = k (g - g*), as at ends of branches, where d^2 = k (g - g*): what is
    extrapolated to d = 0 is g, which no knot of the motion and no turn of it disturbs.  When g is there the motion says alone.
    What goes beyond g* by more than EXTRAPOLATED is there when it passes it; what goes less far, or comes as near as
    WORST_CONDITION, when it turns back.
    """
    found = _find_zero_coordinate(branch, coordinate, span, q)
    if found is None:
        return None
    star, slope = found
    start, _, last = span
    inside = [knot for knot in branch.knots if start < knot < last]
    ahead = 1.0 if star > float(coordinate(np.array([start]))[0]) else -1.0
    pieces = fit_pieces(lambda at: ahead * coordinate(at)[:, None], [start, *inside, last])
    most, when = pieces.find_largest(0)
    if most > ahead * star + EXTRAPOLATED:
        return pieces.find_crossing(0, ahead * star)
    near = max(abs(slope) / WORST_CONDITION, EXTRAPOLATED)
    goes_on = when == last and most < ahead * star - EXTRAPOLATED  # what follows says more
    return None if goes_on or most < ahead * star - near else when


def _find_zero_coordinate(
    branch: Branch, coordinate: Callable[[Array], Array], span: tuple[float, float, float], q: Array
) -> tuple[float, float] | None:
    """The coordinate at which d is zero, and its slope there, from ever nearer before it; None where d is zero nowhere."""
    start, limit, last = span
    end = limit
    first = q
    star = None
    slope = 0.0
    before: tuple[Array, Array] | None = None  # times and matrices of the part before
    for _ in range(MOST_ZOOMS):
        times = np.linspace(start, end, 2 * NODES)
        places, matrices = branch.evaluate_jacobians(times, first)
        d = _compute_smooth_values(matrices)
        kept = _count_leading(d > KEPT * d[0])
        if kept == len(times) and end == limit and star is None:
            return None
        if kept <= DEGREE + 1:
            end = float(times[max(kept, 1)])
            if d[0] < CLOSE or end - start < SAME_ESTIMATE:
                break
            continue
        now = times[:kept], matrices[:kept]
        star, slope = _compute_extrapolation(coordinate, before, now)
        if d[0] < ZOOMED or (kept == len(times) and end == last):
            break
        before = now if KEPT * d[0] < ZOOMED else None
        start = float(times[kept - 1])
        first = places[kept - 1]
        end = last
    return None if star is None else (star, slope)


def _compute_extrapolation(
    coordinate: Callable[[Array], Array], before: tuple[Array, Array] | None, now: tuple[Array, Array]
) -> tuple[float, float]:
    """The coordinate at which d is zero, and its slope there, from times [s] and matrices of a part and of the one before it."""
    times, matrices = now if before is None else (np.concatenate(both) for both in zip(before, now, strict=True))
    d = _compute_smooth_values(matrices)
    degree = DEGREE if before is None else WIDE_DEGREE
    fitted = Polynomial.fit(d, coordinate(times), degree, w=d)  # places are known to 1e-16 / d
    return float(fitted(0.0)), float(fitted.deriv()(0.0))


def _find_by_extrapolation(branch: Branch, start: float, limit: float, q: Array) -> float | None:
    """The instant in one short part, up to ``limit``, at which d is zero, by extrapolation from ever nearer before it."""
    end = limit
    estimates = [np.inf]
    first = (start, q)
    for _ in range(MOST_ZOOMS):
        times = np.linspace(start, end, NODES)
        places, matrices = branch.evaluate_jacobians(times, q)
        d = _compute_smooth_values(matrices)
        kept = _count_leading(d > KEPT * d[0])
        if end - start < SAME_ESTIMATE or d[0] < CLOSE:
            break
        if kept <= DEGREE:
            end = float(times[max(kept, 1)])
            continue
        first_zero = _find_first_zero(Polynomial.fit(times[:kept] - start, d[:kept], DEGREE), 0.0, limit - start)
        if first_zero is None and end == limit and kept == NODES:
            return None
        if first_zero is not None:
            estimates.append(start + first_zero)
            if abs(estimates[-1] - estimates[-2]) < SAME_ESTIMATE:
                break
        start = float(times[kept - 1])
        q = places[kept - 1]
        end = limit
        if first_zero is not None:  # a part that ends between here and there
            end = start + min(limit - start, 0.9 * (estimates[-1] - start))
    if len(estimates) > 2:  # the last ones may be spoiled by rounding
        return _find_polished_instant(branch, *first, estimates[2 + int(np.argmin(np.abs(np.diff(estimates[1:]))))])
    return _find_polished_instant(branch, *first, estimates[1]) if len(estimates) == 2 else None


def _find_polished_instant(branch: Branch, start: float, q: Array, estimate: float) -> float:
    """An instant at which d is zero [s], from both sides of it where d is smooth there: rounding grows in extrapolation."""
    wide = estimate - start
    times = np.linspace(-wide, wide, 3 * NODES)
    places, matrices = branch.evaluate_jacobians(estimate + times, q)
    if len(places) < len(times):
        return estimate
    d = _compute_smooth_values(matrices)
    sure = np.abs(d) > NEAR * d[0]
    fitted = Polynomial.fit(times[sure], d[sure], 2 * DEGREE, w=np.abs(d[sure]))
    if (
        np.abs(fitted(times[sure]) - d[sure]).max() > SMOOTH * d[0]
    ):  # the branch behind it is another, or the motion bends
        return estimate
    first_zero = _find_first_zero(fitted, -0.5 * wide, 0.5 * wide)
    return estimate if first_zero is None else estimate + first_zero


def _compute_smooth_values(matrices: Array) -> Array:
    """d of the matrices (m, rows, columns) with the singular vectors of the first, over its largest singular value, (m,)."""
    u, values, v = np.linalg.svd(matrices[0], full_matrices=False)
    sign, size = np.linalg.slogdet(u.T @ matrices @ v.T)
    sign = (
        sign * np.linalg.det(u.T @ matrices[0] @ v.T / np.maximum(values, np.finfo(float).tiny))
        if values[-1] > 0
        else sign
    )
    others = np.log(np.maximum(values[:-1], np.finfo(float).tiny)).sum() + np.log(values[0])
    with np.errstate(over="ignore"):
        return np.asarray(sign * np.exp(size - others))


def _count_leading(mask: Mask) -> int:
    """The number of entries that are True from the first on."""
    return len(mask) if mask.all() else int(np.argmin(mask))


def _find_first_zero(fitted: Polynomial, first: float, last: float) -> float | None:
    """The first time at which a polynomial touches or crosses zero in (first, last]; None if it does neither."""
    bar = 1.0 / WORST_CONDITION
    if abs(fitted(last)) < bar:  # a singular end counts, although zero lies a little behind it
        last = 2.0 * last
    turns = _list_roots_between(fitted.deriv().roots(), first, last)
    touching = turns[np.abs(fitted(turns)) < bar]
    zeros = touching if len(touching) else _list_roots_between(fitted.roots(), first, last)
    return float(zeros[0]) if len(zeros) else None


def _list_roots_between(roots: RealOrComplex, first: float, last: float) -> Array:
    """The real ones of some roots in (first, last], in their order."""
    real = roots[np.abs(roots.imag) < SAME_ESTIMATE].real
    return np.sort(real[(real > first) & (real <= last)])
