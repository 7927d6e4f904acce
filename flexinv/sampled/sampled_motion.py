"""Samples of a motion in parts, with rates and accelerations: those that are given, else by the spline of `Motion.from_samples`.

A quintic spline through samples forgets a sample by 0.43 from one to the next, so a part is fitted with `OVERHANG` samples on
both sides of it: its derivatives are those of one spline through all samples, to rounding, whatever their number.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from flexinv.files.motion_columns import list_place_suffixes
from flexinv.files.motion_table import MotionPart, MotionSource, join_parts
from flexinv.files.toml_tables import make_input_error
from flexinv.model.joint_kinds import CIRCLE, KINDS, PLAIN, POSE
from flexinv.model.joints import Joint
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.model.track import HOLE, Sampling, scale_quaternions
from flexinv.typing import Array, Triple

# The slowest root of the quintic spline on even samples is -0.4306: 0.4306^64 is 4e-24, less than rounding of second derivatives.
OVERHANG = 64
EVEN = 0.75  # of the last digit of times: even times, rounded, are this near to a straight line
FINE = 0.25  # of the spacing: a last digit coarser than this could hide a lost sample


_S = Polynomial([0.0, 1.0])
_D = 1.0 - _S
_LEFT = (_D**3 * (1 + 3 * _S + 6 * _S**2), _D**3 * (_S + 3 * _S**2), 0.5 * _D**3 * _S**2)
BASIS = (*_LEFT, *(sign * one(_D) for sign, one in zip((1.0, -1.0, 1.0), _LEFT, strict=True)))


@dataclass(frozen=True)
class MotionSamples:
    """Consecutive samples of a motion in the layout of the mechanism.

    first : number of the first one, from 0; time : (samples,) [s] or None
    q : (samples, nq) [rad], [m], [-]; qd, qdd : (samples, nv) [rad/s], [m/s] and per second
    """

    first: int
    time: Array | None
    q: Array
    qd: Array
    qdd: Array


def list_place_slices(mechanism: Mechanism) -> list[tuple[Joint, slice]]:
    """Return the places of each joint's positions in `MotionPart.positions` [-]."""
    out = []
    at = 0
    for joint in mechanism.moving_joints:
        width = len(list_place_suffixes(joint))
        out.append((joint, slice(at, at + width)))
        at += width
    return out


def convert_to_coordinates(mechanism: Mechanism, positions: Array) -> Array:
    """Return q (samples, nq) [rad], [m], [-] of positions as files have them: angles of continuous joints as cosine and sine."""
    if mechanism.nq == positions.shape[1] and all(KINDS[j.kind].layout == PLAIN for j in mechanism.joints):
        return positions
    q = np.empty((len(positions), mechanism.nq))
    for joint, places in list_place_slices(mechanism):
        coordinates = q[:, mechanism.q_slices[joint.name]]
        kind = KINDS[joint.kind]
        coordinates[:] = positions[:, places] if kind.layout != CIRCLE else 0.0
        if kind.layout == CIRCLE:
            coordinates[:, 0] = np.cos(positions[:, places.start])
            coordinates[:, 1] = np.sin(positions[:, places.start])
        elif kind.has_quaternion:
            coordinates[:, -4:] = scale_quaternions(coordinates[:, -4:], f"joint {joint.name!r}")
    return q


def compute_increments(mechanism: Mechanism, positions: Array) -> Array:
    """Return by how much each velocity coordinate moves from a sample to the next (samples - 1, nv) [rad], [m].

    An angle of a continuous joint goes the shorter way; a rotation is its vector in the moving frame, a way is seen from the
    frame halfway.
    """
    before = positions[:-1]
    after = positions[1:]
    if before.shape[1] == mechanism.nv and all(KINDS[j.kind].layout == PLAIN for j in mechanism.joints):
        return after - before
    out = np.empty((len(before), mechanism.nv))
    for joint, places in list_place_slices(mechanism):
        increments = out[:, mechanism.v_slices[joint.name]]
        kind = KINDS[joint.kind]
        if not kind.has_quaternion:
            step = after[:, places] - before[:, places]
            increments[:] = np.remainder(step + np.pi, 2.0 * np.pi) - np.pi if kind.layout == CIRCLE else step
            continue
        first = Rotation.from_quat(before[:, places][:, -4:])
        turn = (first.inv() * Rotation.from_quat(after[:, places][:, -4:])).as_rotvec()
        increments[:, -3:] = turn
        if kind.layout == POSE:
            halfway = first * Rotation.from_rotvec(0.5 * turn)
            increments[:, :3] = halfway.inv().apply(after[:, places][:, :3] - before[:, places][:, :3])
    return out


def sample_motion(table: MotionSource, parts: Iterator[MotionPart]) -> Iterator[MotionSamples]:
    """Yield the samples of a motion with rates and accelerations [1/s], those given, else derivatives of splines.

    Raises InputError: no times where derivatives are needed, times that do not increase, holes between samples.
    """
    if table.columns.accelerations:
        for part in parts:
            assert part.rates is not None
            assert part.accelerations is not None
            q = convert_to_coordinates(table.mechanism, part.positions)
            yield MotionSamples(part.first, part.time, q, part.rates, part.accelerations)
        return
    if not table.timed:
        expected = "a column of times [s], or the spacing of the samples: rates and accelerations are derivatives"
        raise make_input_error(table.label, "no times", expected, "time_s as the first column, or spacing 0.001 s")
    yield from (_fit_splines(table, *window) for window in _list_windows(parts))


def _list_windows(parts: Iterator[MotionPart]) -> Iterator[tuple[MotionPart, int, int]]:
    """Each part with margins on both sides, and where its own samples begin and end in that."""
    before: MotionPart | None = None
    here: MotionPart | None = None
    for after in parts:
        if here is not None:
            yield _add_margins(before, here, after)
            before = here
        here = after
    if here is not None:
        yield _add_margins(before, here, None)


def _add_margins(before: MotionPart | None, here: MotionPart, after: MotionPart | None) -> tuple[MotionPart, int, int]:
    start = 0 if before is None else min(len(before.positions), OVERHANG)
    sides = [here]
    if before is not None:
        sides.insert(0, before.take(slice(-OVERHANG, None)))
    if after is not None:
        sides.append(after.take(slice(0, OVERHANG)))
    return join_parts(sides), start, start + len(here.positions)


def _fit_splines(table: MotionSource, whole: MotionPart, start: int, end: int) -> MotionSamples:
    """The samples from ``start`` to ``end`` of a part with margins: splines through positions, or through given rates."""
    mechanism = table.mechanism
    assert whole.time is not None
    _check_times(table, whole, whole.time)
    time = make_even_times(whole.time, table.time_digit)
    time = time - time[0]
    piece = slice(start, end)
    first = whole.first + start
    if whole.rates is not None:
        sampling = Sampling(time)
        sampling.check(np.inf)
        qdd = sampling.build_spline(whole.rates)(time[piece], 1)
        q = convert_to_coordinates(mechanism, whole.positions[piece])
        return MotionSamples(first, whole.time[piece], q, whole.rates[piece], qdd)
    names = {joint.name: whole.positions[:, places] for joint, places in list_place_slices(mechanism)}
    motion = Motion.from_samples(time, names, max_gap=float(time[-1]) + 1.0)
    return MotionSamples(first, whole.time[piece], *motion.evaluate(mechanism, time[piece]))


def make_even_times(time: Array, digit: float) -> Array:
    """Return times (samples,) [s] as they were before they were rounded to ``digit`` [s]: even ones where that can be."""
    if len(time) < 3:
        return time
    number = np.arange(len(time))
    middle = 0.5 * (len(time) - 1)
    spacing = float((number - middle) @ (time - time.mean()) / ((number - middle) @ (number - middle)))
    even = time.mean() + spacing * (number - middle)
    rounding = max(EVEN * digit, float(np.spacing(np.abs(time).max())) * 4.0)
    return even if digit <= FINE * spacing and np.abs(even - time).max() <= rounding else time


def _check_times(table: MotionSource, part: MotionPart, time: Array) -> None:
    steps = np.diff(time)
    name = table.columns.time[1] if table.columns.time is not None else "time"
    where = f"{table.label}: column {name}"
    if len(steps) and steps.min() <= 0.0:
        k = int(np.argmax(steps <= 0.0))
        row = part.first + k + 2
        given = f"{time[k + 1]:.9g} s in row {row} of numbers after {time[k]:.9g} s"
        raise make_input_error(where, given, "times that increase [s]", "the rows sorted by time, each time once")
    usual = float(np.median(steps)) if len(steps) else 0.0
    if len(steps) and steps.max() > HOLE * usual:
        k = int(np.argmax(steps))
        given = (
            f"a hole of {steps[k]:g} s after row {part.first + k + 1} of numbers, where samples are {usual:g} s apart"
        )
        expected = f"at most {HOLE:g} times the usual spacing: a spline through a hole is no motion"
        raise make_input_error(where, given, expected, "the samples between, or two files")


def read_whole_motion(table: MotionSource, rows: int) -> MotionPart:
    """Return all samples of a motion as one part [rad], [m], [s]."""
    return join_parts(list(table.read_parts(rows, None)))


@dataclass(frozen=True, eq=False)
class HermiteMotion:
    """A motion of joints whose coordinates are numbers of their own, with its rates and accelerations, for `solve`.

    Between two samples it is the polynomial of degree 5 that has q, qd, qdd of both.  With s = (t - t_k) / h and d = 1 - s it is

        q(s) = sum over both ends of  q H0 + h qd H1 + h^2 qdd H2,
        H0 = d^3 (1 + 3 s + 6 s^2),  H1 = d^3 (s + 3 s^2),  H2 = d^3 s^2 / 2,

    at the other end with s and d exchanged, and H1 with its sign (interpolation by Hermite).

    time : (samples,) [s], from 0; angles, rates, accelerations : (samples, nv) [rad], [m], [1/s]; moved : names of the joints
    """

    time: Array
    angles: Array
    rates: Array
    accelerations: Array
    moved: tuple[str, ...]

    @property
    def duration(self) -> float:
        """The time of the last sample [s]."""
        return float(self.time[-1])

    @property
    def jumps(self) -> tuple[float, ...]:
        """Times [s] where the acceleration may jump: both ends, as before and after the samples a motion rests."""
        return (0.0, self.duration)

    @property
    def knots(self) -> tuple[float, ...]:
        """Times [s] between which every coordinate is one polynomial."""
        return tuple(self.time)

    breaks = knots

    def joints(self, mechanism: Mechanism) -> tuple[str, ...]:
        """Return the names of the joints [-] that the motion gives."""
        return tuple(joint.name for joint in mechanism.joints if joint.name in self.moved)

    def evaluate(self, mechanism: Mechanism, time: ArrayLike, side: Literal["left", "right"] = "right") -> Triple:
        """Return q (samples, nq), qd and qdd (samples, nv) at times [rad], [m], [1/s]; at samples those that are given."""
        at = np.asarray(time, dtype=np.float64)
        inside = np.clip(at, 0.0, self.duration)
        k = np.clip(np.searchsorted(self.time, inside, side="right") - 1, 0, len(self.time) - 2)
        width = self.time[k + 1] - self.time[k]
        s = (inside - self.time[k]) / width
        h = width[:, None]
        ends = [(self.angles[i], h * self.rates[i], h**2 * self.accelerations[i]) for i in (k, k + 1)]
        path = []
        for order in range(3):
            values = [basis.deriv(order)(s) if order else basis(s) for basis in BASIS]
            parts = (value[:, None] * part for value, part in zip(values, [*ends[0], *ends[1]], strict=True))
            path.append(sum(parts) / h**order)
        angles, rates, accelerations = (np.asarray(part) for part in path)
        q = np.tile(mechanism.neutral, (at.size, 1))
        for joint in mechanism.joints:
            coordinates = q[:, mechanism.q_slices[joint.name]]
            angle = angles[:, mechanism.v_slices[joint.name]]
            coordinates[:] = np.hstack([np.cos(angle), np.sin(angle)]) if KINDS[joint.kind].circle else angle
        outside = ((at < 0.0) | (at > self.duration))[:, None]
        return q, np.where(outside, 0.0, rates), np.where(outside, 0.0, accelerations)


AnyMotion = Motion | HermiteMotion
