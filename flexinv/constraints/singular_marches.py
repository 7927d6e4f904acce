"""Search for singular positions of closures in a march, at its samples and between two: where a Jacobian loses a rank.

A march finds positions step by step and goes over a singular position as if nothing were: rows that have become dependent drop
out of its border, or their forces grow as the way to the position shrinks.  Afterwards the Jacobian A of what is free
(`free_jacobian`) is known at all samples.  Its smallest singular value s, of those that are no redundant constraint, does not
come to zero between the samples k and n unless

    s_k + s_n <= sum |A_(i+1) - A_i|      (Weyl)

with some more for the bend of A.  So a few singular values speak for a whole march; where they do not, stretches are cut down to
single steps.  Within a step A is the polynomial through samples before it, which no other branch behind a singular position
disturbs, and the same bound cuts the step into parts until s is below what the march itself takes for zero.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from flexinv.constraints.closures import Stretch
from flexinv.constraints.free_jacobian import FreeJacobian, build_free_jacobians
from flexinv.errors import ConvergenceError
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.typing import Array, Indices

# Singular value below which rows are dependent, of the largest: the root of `dynamics.constraint_rows.REDUNDANT_PIVOT`, below
# which the march itself takes a row of A M^-1 A^T for a redundant one.
DEPENDENT_ROWS = 1e-5
# Rows and columns are divided by their largest entry of the march, but by no less than this part of the largest of all, so that
# axes that are parallel but for the digits of a file stay so.
LEAST_SCALE = 1e-3
# Change of A, of its largest norm, between two samples of which singular values are computed.
ANCHORS_APART = 0.1
# A leaves its chord by an eighth of its second difference; twice that on either side of an interval, for what it bends more.
BEND_OF_CHORD = 0.5
STEP_PARTS = 8  # of a step that is cut
WINDOW = 6  # samples of the polynomial; one through one sample less says how well it is known
END_DEGREE = 3  # of the polynomial of s^2 by which an end of a branch is extrapolated
SAME_END = 0.25  # of a step: as near is that of the polynomial of a degree less, where s^2 is smooth
REAL_PLACE = 1e-9  # imaginary parts below this are rounding, of steps
WHERE = 1e-5  # of a step: how well the place of the least s in it is looked for
AGREES = 0.1  # of s on both sides: as near a polynomial comes to the next sample that is on the same branch
AHEAD = 4.0  # steps that it is looked for in
ENTRIES_AT_ONCE = 1 << 20  # of Jacobians in memory


def check_march(
    mesh: Mesh,
    motion: NodalMotion,
    time: Array,
    stretches: list[Stretch],
    passive: Collection[str],
    failed_at: float | None = None,
) -> None:
    """Raise ConvergenceError where the closures of a march pass a singular position, at a sample or between two.

    motion : of the nodes at ``time`` (samples,) [s]
    stretches : which closures act when; passive : joints that are free
    failed_at : time of the instant behind the last sample [s] where the march has failed: then the end of a branch counts
    The error names the instant, known within a step, the step and the closures.
    """
    ends = [*(stretch.phase.first + 1 for stretch in stretches[1:]), len(time)]
    for stretch, end in zip(stretches, ends, strict=True):
        piece = slice(stretch.phase.first, end)
        active = stretch.phase.active
        for structure in build_free_jacobians(mesh, frozenset(passive), active):
            jacobian = structure.replace_rows(stretch.rows.take_active(active))
            march = MarchedJacobian.build_for(mesh, jacobian, motion.take_samples(piece), time[piece])
            ahead = failed_at if stretch is stretches[-1] else None
            if (instant := march.find_singular(ahead)) is not None:
                raise _make_error(
                    mesh, jacobian, time[piece] if ahead is None else np.append(time[piece], ahead), instant
                )


def _make_error(mesh: Mesh, jacobian: FreeJacobian, time: Array, instant: float) -> ConvergenceError:
    m = mesh.mechanism
    names = ", ".join(f"'{m.closures[k].name}'" for k in np.unique(jacobian.rows.closure))
    after = int(np.clip(np.searchsorted(time, instant), 1, max(len(time) - 1, 1)))
    within = f" (found by a march, within its step of {time[after] - time[after - 1]:.3g} s)" if len(time) > 1 else ""
    return ConvergenceError(
        f"mechanism '{m.name}', t = {instant:.10g} s{within}: singular configuration: the constraints of {names} depend on each "
        "other there, so that neither their forces nor the passive coordinates behind it are determined; drive another joint, or "
        "keep the motion away from this position (a dead point or change point)"
    )


@dataclass(frozen=True)
class MarchedJacobian:
    """A Jacobian along a march.

    entries : (samples, entries) of A at ``time`` (samples,) [s], rows and columns scaled
    """

    jacobian: FreeJacobian
    entries: Array
    time: Array

    @classmethod
    def build_for(cls, mesh: Mesh, jacobian: FreeJacobian, motion: NodalMotion, time: Array) -> MarchedJacobian:
        """Return the Jacobian along the motion of the nodes at ``time`` (samples,) [s]."""
        row, column = jacobian.entry
        part = max(1, ENTRIES_AT_ONCE // len(row))
        spans = [slice(k, k + part) for k in range(0, len(time), part)]
        entries = np.concatenate([jacobian.evaluate_entries(mesh, motion.take_samples(span)) for span in spans])
        sizes = np.abs(entries).max(axis=0)
        for index, count in ((row, jacobian.shape[0]), (column, jacobian.shape[1])):
            largest = np.zeros(count)
            np.maximum.at(largest, index, sizes)
            over = 1.0 / np.maximum(largest, max(LEAST_SCALE * float(largest.max()), np.finfo(float).tiny))
            sizes = sizes * over[index]
            entries *= over[index]
        return cls(jacobian, entries, time)

    def find_singular(self, failed_at: float | None = None) -> float | None:
        """Return the first instant [s] at which A has fewer independent rows than elsewhere, None if there is none.

        failed_at : time of the instant behind the last sample [s] where the march has failed: then it is looked for up to there,
            and so is the end of a branch
        """
        change = np.linalg.norm(np.diff(self.entries, axis=0), axis=1)
        done = np.concatenate([[0.0], np.cumsum(change)])
        size = float(np.linalg.norm(self.entries, axis=1).max())
        if size == 0.0:
            return None
        apart = np.diff(np.floor(done / (ANCHORS_APART * size)), prepend=-1.0) > 0.0
        apart[-1] = True
        places = np.flatnonzero(apart)
        values = self.compute_singular_values(places)
        rank = int((values > DEPENDENT_ROWS * values[:, :1]).sum(axis=1).max())
        if rank == 0:
            return None
        known = dict(zip(places.tolist(), values[:, rank - 1].tolist(), strict=True))
        bar = DEPENDENT_ROWS * float(values[:, 0].max())
        latest = float(self.time[-1]) if failed_at is None else np.inf  # that of a march that has failed is ahead of it
        search = _Search(self, done, self._compute_bends(), rank, known, bar, latest)
        for k, n in zip(places[:-1].tolist(), places[1:].tolist(), strict=True):
            if (instant := search.find_between(k, n)) is not None:
                return instant
        if failed_at is not None:
            return search.find_behind(failed_at)
        return float(self.time[-1]) if known[len(done) - 1] <= search.bar else None

    def _compute_bends(self) -> Array:
        """The most by which A leaves its chord in each interval (samples - 1,)."""
        second = np.linalg.norm(np.diff(self.entries, 2, axis=0), axis=1)
        if not len(second):
            return np.asarray(np.linalg.norm(np.diff(self.entries, axis=0), axis=1))
        return np.asarray(BEND_OF_CHORD * np.maximum(np.append(second, second[-1]), np.insert(second, 0, second[0])))

    def compute_singular_values(self, samples: Indices) -> Array:
        """Return the singular values (n, k) [-] of A at some samples (n,), falling."""
        return compute_singular_values(self.jacobian, self.entries[samples])


def compute_singular_values(jacobian: FreeJacobian, entries: Array) -> Array:
    """Return the singular values (n, k) [-] of A from its entries (n, entries), falling."""
    return np.asarray(np.linalg.svd(jacobian.assemble(entries), compute_uv=False))


@dataclass(frozen=True)
class _Search:
    """The search along a march.

    done : (samples,) change of A up to each sample; bend : (samples - 1,) between; rank : of A; known : s at some samples
    bar : what is zero; latest : instant that is looked at [s]
    """

    march: MarchedJacobian
    done: Array
    bend: Array
    rank: int
    known: dict[int, float]
    bar: float
    latest: float

    def find_between(self, k: int, n: int) -> float | None:
        """Return the first instant [s] from the sample k on and before the sample n at which s is zero."""
        time = self.march.time
        if self.known[k] <= self.bar:
            return self._find_least(k, 0.0)
        reach = self.done[n] - self.done[k] + self.bend[k:n].max()
        if self.known[k] + self.known[n] > reach + 2.0 * self.bar:
            return None
        if n - k == 1:
            step = self._build_step(k, float(time[n]))
            place = self._find_in_part(step, 0.0, 1.0)
            return None if place is None or not self._is_confirmed(k, step) else self._find_least(k, place)
        middle = (k + n) // 2
        self._evaluate_sample(middle)
        first = self.find_between(k, middle)
        return self.find_between(middle, n) if first is None else first

    def _is_confirmed(self, k: int, step: _Step) -> bool:
        """True where what lies behind sample k does not contradict that s is zero in the step from it.

        Near the end of a branch that is just not reached, A bends in less than a step.  Its polynomial goes on to zero, and
        misses the next sample; but s^2 is smooth on both sides, whether s turns back at zero or before.
        """
        miss = float(np.linalg.norm(step.evaluate_entries(np.ones(1))[0] - self.march.entries[k + 1]))
        if miss <= AGREES * (self._evaluate_sample(k) + self._evaluate_sample(k + 1)):
            return True
        time = self.march.time
        first = int(np.clip(k - WINDOW // 2 + 1, 0, max(len(time) - WINDOW, 0)))
        samples = np.arange(first, min(first + WINDOW, len(time)))
        at = (time[samples] - time[k]) / (time[k + 1] - time[k])
        squares = np.array([self._evaluate_sample(n) for n in samples.tolist()]) ** 2
        places = np.linspace(0.0, 1.0, STEP_PARTS**2 + 1)
        inner = np.abs(at - 0.5).argsort(kind="stable")[: WINDOW - 2]
        values = _compute_lagrange_weights(at, places) @ squares
        doubt = np.abs(_compute_lagrange_weights(at[inner], places) @ squares[inner] - values)
        return bool((values <= self.bar**2 + doubt).any())

    def find_behind(self, end: float) -> float | None:
        """Return the first instant [s] behind the last sample, of a march that failed at ``end``, at which s is zero or ends.

        Near a singular position a march may fail some steps before it: that of A is looked for AHEAD steps.
        """
        last = len(self.march.time) - 1
        begin = float(self.march.time[last])
        place = self._find_end_of_branch(last, end)
        step = self._build_step(last, end)
        least = self._evaluate_sample(last)
        if place is None and (least <= self.bar or step.bar < least):  # beyond that nothing is known behind it
            place = self._find_in_part(step, 0.0, AHEAD)
            place = None if place is None else step.find_least(place)
        return None if place is None else begin + place * (end - begin)

    def _find_end_of_branch(self, last: int, end: float) -> float | None:
        """The place of the end of a branch in the step from the last sample to ``end`` or in the next, None if there is none.

        There s^2 falls to zero as a smooth function of time: polynomials of two degrees say so.
        """
        samples = np.arange(max(last - WINDOW + 1, 0), last + 1)
        squares = np.array([self._evaluate_sample(k) for k in samples.tolist()]) ** 2
        ahead = (self.march.time[samples] - self.march.time[last]) / (end - self.march.time[last])
        found = []
        for degree in (END_DEGREE, END_DEGREE - 1):
            roots = Polynomial.fit(ahead, squares, degree).roots() if last >= degree else np.empty(0)
            places = np.sort(roots.real[np.abs(roots.imag) < REAL_PLACE])
            places = places[(places > 0.0) & (places <= 2.0)]
            if not len(places):
                return None
            found.append(float(places[0]))
        return found[0] if abs(found[1] - found[0]) < SAME_END else None

    def _evaluate_sample(self, k: int) -> float:
        """The value of s at a sample, which is kept."""
        if k not in self.known:
            (values,) = self.march.compute_singular_values(np.array([k]))
            self.known[k] = float(values[self.rank - 1])
        return self.known[k]

    def _find_least(self, k: int, place: float) -> float:
        """The instant from a place in the step behind sample k on at which s is least, as far as the march goes."""
        time = self.march.time
        if k + 1 == len(time):
            return float(time[k])
        step = self._build_step(k, float(time[k + 1]))
        return min(float(time[k] + step.find_least(place) * (time[k + 1] - time[k])), self.latest)

    def _build_step(self, k: int, end: float) -> _Step:
        """The polynomial of A from sample k to ``end``, through samples before it where there are enough."""
        time = self.march.time
        last = max(k, min(WINDOW, len(time)) - 1)
        nodes = np.arange(max(last - WINDOW + 1, 0), last + 1)
        at = (time[nodes] - time[k]) / (end - time[k])
        entries = self.march.entries[nodes]
        middle = np.array([0.5])
        fewer = _compute_lagrange_weights(at[-WINDOW + 1 :], middle) @ entries[-WINDOW + 1 :]
        doubt = float(np.linalg.norm(_compute_lagrange_weights(at, middle) @ entries - fewer))
        return _Step(self.march.jacobian, self.rank, at, entries, self.bar + doubt)

    def _find_in_part(self, step: _Step, start: float, end: float) -> float | None:
        """The first place in a part of a step at which s is below the bar, or comes as near as the part is small."""
        places = np.linspace(start, end, STEP_PARTS + 1)
        entries = step.evaluate_entries(places)
        least = step.compute_least(places)
        change = np.linalg.norm(np.diff(entries, axis=0), axis=1)
        change += BEND_OF_CHORD * float(np.linalg.norm(np.diff(entries, 2, axis=0), axis=1).max())
        for k in np.flatnonzero(least[1:] + least[:-1] <= change + 2.0 * step.bar).tolist():
            if least[k] <= step.bar or change[k] <= step.bar:
                return float(places[k])
            place = self._find_in_part(step, float(places[k]), float(places[k + 1]))
            if place is not None:
                return place
        return float(places[-1]) if least[-1] <= step.bar else None


@dataclass(frozen=True)
class _Step:
    """A step of a march, from place 0 to 1: A as the polynomial through entries (n, entries) at some places (n,).

    rank : of A elsewhere; bar : below which s is zero, with how well the polynomial is known
    """

    jacobian: FreeJacobian
    rank: int
    at: Array
    entries: Array
    bar: float

    def evaluate_entries(self, places: Array) -> Array:
        """Return the entries of A [-] at some places (n,)."""
        return _compute_lagrange_weights(self.at, places) @ self.entries

    def compute_least(self, places: Array) -> Array:
        """Return s [-] at some places (n,)."""
        return compute_singular_values(self.jacobian, self.evaluate_entries(places))[:, self.rank - 1]

    def find_least(self, place: float) -> float:
        """Return the place [-] from one on at which s is least, by cutting ever smaller parts; AHEAD of it at most.

        Where the march has come below its zero its own positions say no more: the polynomial goes on.
        """
        start = place
        end = place + AHEAD
        while end - start > WHERE:
            places = np.linspace(start, end, STEP_PARTS + 1)
            k = int(np.argmin(self.compute_least(places)))
            start = float(places[max(k - 1, 0)])
            end = float(places[min(k + 1, STEP_PARTS)])
        return 0.5 * (start + end)


def _compute_lagrange_weights(nodes: Array, places: Array) -> Array:
    """Weights (places, nodes) [-] of values at the nodes in those of the polynomial through them."""
    weights = np.ones((len(places), len(nodes)))
    for k, node in enumerate(nodes):
        for n, other in enumerate(nodes):
            if n != k:
                weights[:, k] *= (places - other) / (node - other)
    return weights
