"""Functions of time as pieces of polynomials: where they turn, and where they reach a level, to rounding.

A function that is smooth between some breaks is interpolated there at the zeros of a Chebyshev polynomial; a piece is halved
until its last coefficients are rounding.  Its stationary points are then the eigenvalues of a matrix (polynomial roots), between
them it is monotone: a level is reached between two of them, or touched at one, and nothing is missed between samples.
Source: Trefethen, *Approximation Theory and Approximation Practice*, SIAM 2013, ch. 3 and 18; Boyd, *Computing zeros on a real
interval through Chebyshev expansion and polynomial rootfinding*, SIAM J. Numer. Anal. 40, 2002.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from flexinv.typing import Array

PIECE_DEGREE = 16  # of a piece: a sinusoid of a whole turn has 1e-13 of its size beyond it
# Of the largest value: what coefficients that are rounding come to, sixteen sums of numbers known to 1e-16 with a margin of six.
TAIL_ROUNDING = 1e-14
# Of the largest value: values that differ by less are the same.  A level reached with less to spare is touched, not passed.
SAME_VALUE = 1e-12
# A piece shorter than this [s] is not halved any more: a corner or a jump of the function lies in it.
SHORTEST_PIECE = 2e-10
# A tail that halving makes no smaller by this factor, where it is that small a part of the function, is rounding: not smoothness,
# which divides the tail by 2^17, nor a corner of the function or one of its rates, which divide it by 2 or more.
SMALLER = 0.7
SMALL_TAIL = 1e-8
# Imaginary parts of a stationary point that is real: rounding of a double one, where the function does not turn, is its root.
REAL = 1e-6

_ANGLES = np.pi * (np.arange(PIECE_DEGREE + 1) + 0.5) / (PIECE_DEGREE + 1)
_NODES = np.cos(_ANGLES)[::-1]  # in (-1, 1), increasing
_TO_COEFFICIENTS = np.cos(np.outer(np.arange(PIECE_DEGREE + 1), _ANGLES[::-1])) * 2.0 / (PIECE_DEGREE + 1)
_TO_COEFFICIENTS[0] *= 0.5


@dataclass(frozen=True)
class Pieces:
    """A function of time (samples, columns) in pieces.

    begin, end : (pieces,) [s]; coefficients : (pieces, degree + 1, columns) of Chebyshev polynomials over each piece
    scale : (columns,) the largest value of each column
    """

    begin: Array
    end: Array
    coefficients: Array
    scale: Array

    @property
    def rate(self) -> Pieces:
        """The derivative by time of every column [unit of the function/s]."""
        slope = chebyshev.chebder(self.coefficients, axis=1) * (2.0 / (self.end - self.begin))[:, None, None]
        return Pieces(self.begin, self.end, slope, np.abs(slope).sum(axis=1).max(axis=0, initial=0.0))

    def find_extremes(self, piece: int, column: int) -> Array:
        """Return the times [s] in a piece at which a column may have an extreme value: ends and stationary points, increasing."""
        slope = chebyshev.chebder(self.coefficients[piece, :, column])
        size = np.abs(slope).max(initial=0.0)
        kept = np.flatnonzero(np.abs(slope) > TAIL_ROUNDING * size)
        roots = chebyshev.chebroots(slope[: kept[-1] + 1]) if size > 0.0 and len(kept) else np.empty(0)
        real = roots.real[np.abs(roots.imag) < REAL]
        inside = np.sort(real[np.abs(real) < 1.0])
        half = 0.5 * (self.end[piece] - self.begin[piece])
        return np.asarray(self.begin[piece] + half * (np.r_[-1.0, inside, 1.0] + 1.0))

    def evaluate_column(self, piece: int, column: int, time: ArrayLike) -> Array:
        """Return a column at times [s] of a piece [unit of the function]."""
        share = (np.asarray(time) - self.begin[piece]) / (self.end[piece] - self.begin[piece])
        return np.asarray(chebyshev.chebval(2.0 * share - 1.0, self.coefficients[piece, :, column]))

    def find_largest(self, column: int) -> tuple[float, float]:
        """Return the largest value of a column [unit of the function] and its time [s]."""
        coefficients = self.coefficients[:, :, column]
        most = coefficients[:, 0] + np.abs(coefficients[:, 1:]).sum(axis=1)  # no value of the piece is larger
        best = -np.inf
        at = float(self.begin[0])
        for piece in np.argsort(-most).tolist():
            if most[piece] <= best:
                break
            times = self.find_extremes(piece, column)
            values = self.evaluate_column(piece, column, times)
            if (found := float(values.max())) > best:
                best = found
                at = float(times[int(np.argmax(values))])
        return best, at

    def has_value_above(self, column: int, level: float) -> bool:
        """Return True if a column lies above a level [unit of the function] anywhere, by more than rounding."""
        return self.find_largest(column)[0] > level + SAME_VALUE * max(abs(level), float(self.scale[column]))

    def find_crossing(self, column: int, level: float) -> float | None:
        """Return the first time [s] at which a column is at a level [unit of the function] or above it, None if it never is.

        A level is at its stationary point where that differs by no more than rounding (`SAME_VALUE`): it is touched.
        """
        bar = SAME_VALUE * max(abs(level), float(self.scale[column]))
        coefficients = self.coefficients[:, :, column]
        most = coefficients[:, 0] + np.abs(coefficients[:, 1:]).sum(axis=1)
        for piece in np.flatnonzero(most >= level - bar).tolist():
            times = self.find_extremes(piece, column)
            over = self.evaluate_column(piece, column, times) - level
            first = int(np.argmax(over >= -bar))
            if over[first] < -bar:
                continue
            if first == 0 or over[first] <= bar:
                return float(times[first])
            return self._find_crossing_between(piece, column, level, float(times[first - 1]), float(times[first]))
        return None

    def find_zero(self, least: float) -> float | None:
        """Return the first time [s] at which the vector of all columns is no longer than ``least`` [unit of the function].

        A zero of the vector is one of a component, or, where that only touches zero, a place where it turns.
        """
        lengths = np.linalg.norm(self.coefficients, axis=2)  # (piece, degree)
        near = lengths[:, 0] - lengths[:, 1:].sum(axis=1) <= least
        for piece in np.flatnonzero(near).tolist():
            times = np.unique(
                np.concatenate([self._find_zeros(piece, column) for column in range(self.coefficients.shape[2])])
            )
            size = self._evaluate_length(piece, times)
            first = int(np.argmax(size <= least))
            if size[first] > least:
                continue
            last = first
            while last + 1 < len(times) and self._evaluate_length(piece, times[last : last + 2].mean()) <= least:
                last += 1
            return self._choose_best_zero(piece, times[first : last + 1])
        return None

    def _choose_best_zero(self, piece: int, near: Array) -> float:
        """Of times [s] at which all columns are nearly zero where the column that moves most touches or crosses it."""
        column = int(np.argmax(np.abs(self.coefficients[piece, 1:]).sum(axis=0)))
        bar = SAME_VALUE * float(self.scale[column])
        zeros = self._find_zeros(piece, column)
        zeros = zeros[(zeros >= near[0]) & (zeros <= near[-1])]
        turns = self.find_extremes(piece, column)[1:-1]
        touching = turns[
            (turns >= near[0]) & (turns <= near[-1]) & (np.abs(self.evaluate_column(piece, column, turns)) <= bar)
        ]
        for some in (touching, zeros, near):
            if len(some):
                return float(some[int(np.argmin(self._evaluate_length(piece, some)))])
        return float(near[0])

    def _evaluate_length(self, piece: int, time: ArrayLike) -> Array:
        """Length of the vector of all columns at times [s] of a piece."""
        columns = range(self.coefficients.shape[2])
        return np.asarray(np.linalg.norm([self.evaluate_column(piece, column, time) for column in columns], axis=0))

    def _find_zeros(self, piece: int, column: int) -> Array:
        """The times [s] of a piece at which a column turns or is zero, and the ends."""
        times = self.find_extremes(piece, column)
        values = self.evaluate_column(piece, column, times)
        crossed = np.flatnonzero(values[:-1] * values[1:] < 0.0).tolist()
        signs = [1.0 if values[k + 1] > 0.0 else -1.0 for k in crossed]
        found = [
            self._find_crossing_between(piece, column, 0.0, times[k], times[k + 1], s)
            for k, s in zip(crossed, signs, strict=True)
        ]
        return np.concatenate([times, np.array(found)])

    def _find_crossing_between(
        self, piece: int, column: int, level: float, low: float, high: float, sign: float = 1.0
    ) -> float:
        """The time between two at which ``sign`` times a column, which rises there, is at a level, by halving to rounding."""
        while low < (middle := 0.5 * (low + high)) < high:
            if sign * self.evaluate_column(piece, column, middle) >= level:
                high = middle
            else:
                low = middle
        return high


def fit_pieces(function: Callable[[Array], Array], breaks: ArrayLike, size: ArrayLike = 0.0) -> Pieces:
    """Return a function of time as pieces [s], [unit of the function].

    function : times (n,) [s], increasing -> values (n, columns); it is never asked at a break itself
    breaks : (n,) times [s] between which it is smooth; where it is not it is cut into pieces down to `SHORTEST_PIECE`
    size : (columns,) what rounding is measured against where values are smaller [unit of the function]
    """
    marks = np.unique(np.asarray(breaks, dtype=float))
    begin = marks[:-1]
    end = marks[1:]
    before = np.full(len(begin), np.inf)
    done: list[tuple[Array, Array, Array]] = []
    scale = np.maximum(np.asarray(size, dtype=float), np.finfo(float).tiny)
    while len(begin):
        times = begin[:, None] + 0.5 * (end - begin)[:, None] * (_NODES + 1.0)
        values = function(times.reshape(-1)).reshape(len(begin), PIECE_DEGREE + 1, -1)
        coefficients = np.einsum("kn,pnc->pkc", _TO_COEFFICIENTS, values)
        scale = np.maximum(scale, np.abs(values).max(axis=(0, 1)))
        tail = (np.abs(coefficients[:, -3:]).max(axis=1) / scale).max(axis=1, initial=0.0)
        is_rounding = (tail < SMALL_TAIL) & (tail > SMALLER * before)
        smooth = (tail <= TAIL_ROUNDING) | is_rounding
        jumps = ~smooth & (end - begin <= SHORTEST_PIECE)
        coefficients[jumps] = _compute_lines(values[jumps])
        smooth |= jumps
        done.append((begin[smooth], end[smooth], coefficients[smooth]))
        before = np.repeat(tail[~smooth], 2)
        begin, end = _split_in_halves(begin[~smooth], end[~smooth])
    first, last, fitted = (np.concatenate([part[k] for part in done]) for k in range(3))
    order = np.argsort(first)
    return Pieces(first[order], last[order], fitted[order], scale)


def _split_in_halves(begin: Array, end: Array) -> tuple[Array, Array]:
    middle = 0.5 * (begin + end)
    return np.stack([begin, middle], axis=1).reshape(-1), np.stack([middle, end], axis=1).reshape(-1)


def _compute_lines(values: Array) -> Array:
    """Coefficients (n, degree + 1, columns) of straight lines between the outer two of values (n, degree + 1, columns).

    A polynomial through a jump would overshoot it.
    """
    out = np.zeros_like(values)
    out[:, 0] = 0.5 * (values[:, -1] + values[:, 0])
    out[:, 1] = 0.5 * (values[:, -1] - values[:, 0])
    return out


def join_samples(time: Array, values: list[Array]) -> Pieces:
    """Return the polynomials between samples that have the values and rates there, of degree 2 n - 1 for n arrays.

    time : (samples,) [s]; values : the function and its rates, (samples, columns) each [unit of the function, s]
    """
    from scipy.interpolate import BPoly  # it loads much

    joined = BPoly.from_derivatives(time, np.stack(values, axis=1))
    degree = len(joined.c) - 1
    nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    inside = time[:-1, None] + 0.5 * np.diff(time)[:, None] * (nodes + 1.0)
    table = np.linalg.inv(chebyshev.chebvander(nodes, degree))
    coefficients = np.einsum("kn,pnc->pkc", table, joined(inside.reshape(-1)).reshape(len(time) - 1, degree + 1, -1))
    return Pieces(time[:-1], time[1:], coefficients, np.abs(values[0]).max(axis=0, initial=0.0))
