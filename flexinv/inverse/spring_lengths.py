"""Lengths of springs between samples: a spring of no length pulls in no direction, which no result may pass in silence.

Where the motion is given the vector d from one end to the other is a function of time (`smooth_pieces`): it is zero only where
one of its components is, and only touches zero where that turns.  Where the motion was marched, d between two samples is the
quintic that has its values and both rates there; at the least of |d|^2 it is held against the cubic through values and first
rates, whose difference says how well it is known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.polynomial import Polynomial

from flexinv.errors import InputError
from flexinv.inverse.inverse_dynamics import compute_spring_gap
from flexinv.kernels.smooth_pieces import fit_pieces
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.attachments import Spring
from flexinv.typing import Array, Mask, Triple

if TYPE_CHECKING:
    from scipy.interpolate import BPoly

NO_LENGTH = 1e-9  # over the mechanism's length: shorter is a spring of no length
# Of the difference between cubic and quintic: what the quintic may be off.  Halfway between samples the error of the cubic is
# h^4 d / 384, that of the quintic h^6 d'' / 46080: of a motion that turns by a radian between samples, a 120th.
QUINTIC_ERROR = 1.0 / 120.0
GAPS_AT_ONCE = 4096  # instants whose nodes are in memory
# Where the coordinates on which all depend go no farther than this between two samples [rad], over the length [-], what the
# samples show of the loops' gear changes by less than the safety, but near singular positions, which are an error of their own.
FAR_APART = 0.3
GEAR_SAFETY = 4.0
FURTHER = 1.5  # as parts of an interval are of equal times and the speed is seen at other instants
MOST_TIMES = 4096  # that are asked beside the samples
SPEED_LOOKS = 9  # at the speed of these coordinates in an interval
GEAR_SAMPLES = 5  # samples whose gear is asked: where motions turn back it shows in those beside
AT_REST = 1e-6  # of the largest speed: slower shows no gear
MOST_SPANS = 8  # each is fitted alone, and follows the loops from the beginning


@dataclass(frozen=True)
class InterpolatedMotion:
    """A motion that can be asked at any instant.

    nodes : times (n,) [s], increasing, from that of the first sample on -> motion of the nodes
    knots : times [s] between which it is smooth
    speed : times (n,) [s] -> (n,) sum of the rates [rad/s], slides over the mechanism's length, of the coordinates on which all
        others depend; None where the nodes cost too little to ask first where they matter
    """

    nodes: Callable[[Array], NodalMotion]
    knots: tuple[float, ...]
    speed: Callable[[Array], Array] | None = None


def check_spring_lengths(mesh: Mesh, motion: NodalMotion, time: Array, given: InterpolatedMotion | None = None) -> None:
    """Raise InputError where a spring that pulls or pushes at no length has none, at a sample or between two.

    time : (samples,) [s] of a motion that is continuous; given : the motion between them, None where it was marched
    The error names spring and instant, to 1e-9 s where the motion is given and within a step where it was marched.
    """
    for spring in mesh.mechanism.springs:
        if float(spring.evaluate_pull(np.zeros(1))[0]) == 0.0:
            continue  # its force is smooth there
        if given is None or len(time) < 2:
            instant = find_zero_vector(compute_spring_gap(mesh, motion, spring), time, mesh.length)
        else:
            instant = _find_zero_length(mesh, spring, given, time, compute_spring_gap(mesh, motion, spring))
        if instant is not None:
            raise InputError(
                f"mechanism '{mesh.mechanism.name}', t = {instant:.10g} s: spring '{spring.name}' has no length there, so that "
                f"its pull has no direction (rest = {spring.rest:g} m); keep its ends apart, or write rest_m = 0 for a spring "
                "that pulls them together from every side"
            )


def _find_zero_length(mesh: Mesh, spring: Spring, given: InterpolatedMotion, time: Array, gap: Triple) -> float | None:
    """The first instant [s] at which a spring has no length, of a motion that can be asked at any instant.

    gap : at the samples
    """

    def evaluate_gap(times: Array) -> Triple:
        parts = [times[k : k + GAPS_AT_ONCE] for k in range(0, len(times), GAPS_AT_ONCE)]
        gaps = [compute_spring_gap(mesh, given.nodes(part), spring) for part in parts]
        d, rate, second = (np.concatenate(one) for one in zip(*gaps, strict=True))
        return d, rate, second

    least = NO_LENGTH * mesh.length
    spans = [(float(time[0]), float(time[-1]))]
    if given.speed is not None:
        fine = list_fine_times(time, given.speed)
        if len(fine) > len(time):
            gap = evaluate_gap(fine)
        spans = list_doubtful_spans(gap, fine, given.speed, least)
    for begin, end in spans:
        inside = [knot for knot in given.knots if begin < knot < end]
        pieces = fit_pieces(lambda times: evaluate_gap(times)[0], [begin, *inside, end], mesh.length)
        zero = pieces.find_zero(least)
        if zero is not None:
            return zero
    return None


def list_fine_times(time: Array, speed: Callable[[Array], Array]) -> Array:
    """Return times (n,) [s], samples among them, between which the coordinates on which all depend go at most `FAR_APART`.

    speed : as of an `InterpolatedMotion`; they are no more than `MOST_TIMES`, beside the samples
    """
    parts = np.ceil(_compute_ways(time, speed) / FAR_APART).clip(1, MOST_TIMES).astype(int)
    if parts.sum() > len(time) + MOST_TIMES:
        return time
    inside = [np.linspace(time[k], time[k + 1], n, endpoint=False) for k, n in enumerate(parts)]
    return np.concatenate([*inside, time[-1:]])


def _compute_ways(time: Array, speed: Callable[[Array], Array]) -> Array:
    """The way (samples - 1,) of the coordinates on which all depend between samples [rad], at the largest speed that is seen."""
    steps = np.diff(time)
    looks = time[:-1, None] + steps[:, None] * np.linspace(0.0, 1.0, SPEED_LOOKS)
    return np.asarray(steps * speed(looks.reshape(-1)).reshape(looks.shape).max(axis=1))


def list_doubtful_spans(
    gap: Triple, time: Array, speed: Callable[[Array], Array], least: float
) -> list[tuple[float, float]]:
    """Return the spans [s] of samples within which a vector may be shorter than ``least`` [m].

    Between two samples the vector d gets no shorter than that where

        |d_k| + |d_(k+1)|  >  GEAR_SAFETY  max |d'| / s  (h max s)  +  2 least

    s is the speed of the coordinates on which all depend, asked at `SPEED_LOOKS` instants of each interval, and |d'| / s what the
    samples nearby show of how the loops gear it.  An interval in which these coordinates go farther than `FAR_APART` is doubtful:
    there the gear may change.
    """
    size, rate = (np.linalg.norm(part, axis=1) for part in gap[:2])
    at_samples = speed(time)
    moving = at_samples > AT_REST * at_samples.max(initial=0.0)
    gear = _find_largest_nearby(np.divide(rate, at_samples, out=np.zeros_like(rate), where=moving))
    gear[~_find_largest_nearby(moving)] = gear.max(initial=0.0)  # at rest the way is next to nothing
    way = _compute_ways(time, speed)
    reach = GEAR_SAFETY * np.maximum(gear[1:], gear[:-1]) * way
    clear = (way <= FURTHER * FAR_APART) & (size[1:] + size[:-1] > reach + 2.0 * least)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], clear, [True]]).astype(np.int8)))
    spans = [(float(time[first]), float(time[last])) for first, last in edges.reshape(-1, 2)]
    return spans if len(spans) <= MOST_SPANS else [(float(time[0]), float(time[-1]))]


def _find_largest_nearby(values: Array | Mask) -> Any:
    """The largest value (samples,) of each sample and of those beside it."""
    padded = np.pad(values, GEAR_SAMPLES // 2, mode="edge")
    return sliding_window_view(padded, GEAR_SAMPLES).max(axis=1)


def find_zero_vector(gap: Triple, time: Array, length: float) -> float | None:
    """Return the first instant [s] at which a vector of three numbers is zero, None if it never is.

    gap : the vector and its two rates, (samples, 3) each [m, s]; length : what its size is measured against [m]
    """
    d, rate, second = gap
    size = np.linalg.norm(d, axis=1)
    least = NO_LENGTH * length
    if len(time) > 1:
        steps = np.diff(time)
        way = steps * np.maximum(np.linalg.norm(rate[1:], axis=1), np.linalg.norm(rate[:-1], axis=1))
        way += steps**2 * np.maximum(np.linalg.norm(second[1:], axis=1), np.linalg.norm(second[:-1], axis=1))
        for k in np.flatnonzero(size[1:] + size[:-1] <= way + 2.0 * least).tolist():
            ends = slice(k, k + 2)
            zero_between = _find_zero_between((d[ends], rate[ends], second[ends]), float(steps[k]), least)
            if zero_between is not None:
                return float(time[k]) + zero_between
    short = np.flatnonzero(size <= least)
    return float(time[short[0]]) if len(short) else None


def _find_zero_between(ends: Triple, step: float, least: float) -> float | None:
    """The time after the first of two samples at which the quintic through them is zero."""
    from scipy.interpolate import BPoly  # it loads much, which runs without such springs do not need

    quintic = [
        _convert_to_powers(BPoly.from_derivatives([0.0, 1.0], _list_end_values(ends, i, 3, step))) for i in range(3)
    ]
    cubic = [
        _convert_to_powers(BPoly.from_derivatives([0.0, 1.0], _list_end_values(ends, i, 2, step))) for i in range(3)
    ]
    square = sum((part**2 for part in quintic), Polynomial([0.0]))
    turns = square.deriv().roots()
    places = np.sort(np.concatenate([turns.real[np.abs(turns.imag) < 1e-3], [0.0, 1.0]]))  # a zero is a double root
    for place in places[(places >= 0.0) & (places <= 1.0)].tolist():
        size = float(np.sqrt(sum(part(place) ** 2 for part in quintic)))
        doubt = float(np.sqrt(sum((a(place) - b(place)) ** 2 for a, b in zip(quintic, cubic, strict=True))))
        if size <= least + QUINTIC_ERROR * doubt:
            return float(place) * step
    return None


def _list_end_values(ends: Triple, axis: int, orders: int, step: float) -> list[list[float]]:
    """One component at both ends: value and rates by parts of the step."""
    return [[float(part[end, axis]) * step**n for n, part in enumerate(ends[:orders])] for end in (0, 1)]


def _convert_to_powers(piece: BPoly) -> Polynomial:
    """The polynomial in powers of a piece over (0, 1)."""
    degree = len(piece.c) - 1
    places = np.linspace(0.0, 1.0, degree + 1)
    return Polynomial.fit(places, piece(places), degree).convert()
