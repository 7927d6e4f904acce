"""Motions: what the joints do, as exact functions of time.

A motion is independent of the mechanism until it is evaluated: joints are named, or all are given in the order of the mechanism.
``evaluate`` gives q, qd and qdd in the mechanism's layout (Pinocchio's): a continuous joint is (cos, sin) with one angular
velocity, a rotation is a quaternion x, y, z, w with the angular velocity in the moving frame, a free joint adds the position, and
its linear velocity there, v = R^T p', v' = R^T p'' - omega x v.  Before time 0 and after its end a motion rests.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexinv import validation as arguments
from flexinv.display.card import Card, Shown
from flexinv.errors import InputError
from flexinv.model.by_value import ByValue
from flexinv.model.input_shaper import InputShaper
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.model.owned_cache import make_owner_cache
from flexinv.model.track import (
    SNAP,
    Sampling,
    Track,
    evaluate_joint_path,
    find_law,
    format_names,
    list_joint_columns,
    scale_quaternions,
)
from flexinv.typing import Array, Triple

Values = ArrayLike | Mapping[str, ArrayLike]
ByJoint = Mapping[str, ArrayLike] | None
Columns = tuple[tuple[str, ...] | None, Array, tuple[int, ...] | None]  # names of joints, numbers, and how many of each


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Shown, ByValue):
    """Prescribed motion of joints; make one with ``point_to_point``, ``from_samples`` or ``merge``.

    duration : [s], with the rests before and after the move
    """

    tracks: tuple[Track, ...]
    duration: float

    def __post_init__(self) -> None:
        """Raise InputError unless it is made of tracks and has a duration [s]."""
        if not isinstance(self.tracks, tuple) or not all(isinstance(track, Track) for track in self.tracks):
            arguments.refuse("tracks", self.tracks, "a tuple, each a Track", "Motion.point_to_point(...)")
        arguments.check_seconds("duration", self.duration, "a time, 0 or more [s]", zero=True)

    def _make_card(self) -> Card:
        from flexinv.model.motion_card import make_motion_card

        return make_motion_card(self)

    def __hash__(self) -> int:
        """Return the hash of its duration [s] and of the names of its joints."""
        return hash((self.duration, tuple(track.names for track in self.tracks)))

    @staticmethod
    def point_to_point(
        start: Values, end: Values, duration: float, hold: float = 0.0, law: str = "cycloid", delay: float = 0.0
    ) -> Motion:
        """Move from start to end: q(t) = q_0 + u(s) (q_1 - q_0), rotations R(t) = R_0 exp(u(s) log(R_0^T R_1)).

        start, end : (nq,) [rad], [m] in the order of the mechanism (a continuous joint as cos, sin or as one angle),
            or joint name -> value (number; 2 of a universal joint; quaternion x, y, z, w; position and quaternion)
        duration : of the move [s]; hold : rest after it [s]; delay : rest before it [s]
        law : "cycloid", "quintic", "septic", "nonic", "bang-bang" or "trapezoid", see ``flexinv.model.track``
        Rotations and (cos, sin) take the shorter way round; angles go as far as given.  Raises InputError.
        """
        find_law(law)
        duration = arguments.check_seconds("duration", duration, "a positive time [s]")
        rests = ("hold", hold), ("delay", delay)
        hold, delay = (arguments.check_seconds(name, t, "a time, 0 or more [s]", zero=True) for name, t in rests)
        names, first, widths = _read_row(start, "start")
        names_end, last, widths_end = _read_row(end, "end")
        if names != names_end:
            given = f"start gives {format_names(names)}, end gives {format_names(names_end)}"
            raise InputError(f"{given}: expected the same joints in both")
        if first.shape != last.shape or widths != widths_end:
            raise InputError(f"start has {first.size} numbers, end has {last.size}: expected as many in both")
        track = Track(names, np.stack([first, last]), widths, float(duration), float(delay), law)
        return Motion((track,), float(delay + duration + hold))

    @staticmethod
    def from_samples(
        time: ArrayLike, q: Values, names: tuple[str, ...] | list[str] | None = None,
        degree: int = 5, rest: bool = False, max_gap: float | None = None,
    ) -> Motion:  # fmt: skip
        """Join samples by a spline; rotations by a normalised spline of quaternions, angular velocity exact to it.

        time : (samples,) [s], from 0; q : (samples, nq) [rad], [m] in the order of the mechanism or of ``names``
            (joints, each with all its coordinates), or joint name -> (samples,) or (samples, coordinates)
        degree : 5, with a continuous rate of acceleration, or 3, whose acceleration has a corner at every sample
        rest : True makes velocity (and with degree 5 acceleration) zero at both ends
        max_gap : longest interval [s] that the spline may cross, default 10 times the median interval
        An angle of a continuous joint may wrap; it is unwrapped.  Raises InputError: unsorted, gap, NaN, too few.
        """
        degree = arguments.check_whole_number("degree", degree, 0, "5 (smooth jerk) or 3 (continuous acceleration)")
        sampling = Sampling(_copy_read_only(time, "time"), degree, arguments.check_flag("rest", rest))
        longest = (
            None if max_gap is None else arguments.check_number("max_gap", max_gap, "the longest interval [s], or None")
        )
        if longest is not None and not longest > 0.0:
            arguments.refuse("max_gap", max_gap, "the longest interval [s], above 0, or None")
        sampling.check(longest)
        columns, values, widths = _read_table(q, names, sampling.time.size)
        track = Track(columns, values, widths, float(sampling.time[-1]), sampling=sampling)
        return Motion((track,), track.move)

    @staticmethod
    def merge(*motions: Motion) -> Motion:
        """Join motions of different joints; it lasts as long as the longest [s], the others rest at their end."""
        for motion in motions:
            arguments.check_kind("merge: motion", motion, Motion)
        tracks = tuple(track for motion in motions for track in motion.tracks)
        if not tracks:
            raise InputError("merge: expected at least one motion")
        seen: set[str] = set()
        for track in tracks:
            if track.names is None:
                raise InputError("merge: a motion of all joints by position; expected motions that name their joints")
            twice = seen.intersection(track.names)
            if twice:
                raise InputError(f"merge: two motions give joint {min(twice)!r}; expected each joint once")
            seen.update(track.names)
        return Motion(tracks, max(motion.duration for motion in motions))

    def shaped(self, shaper: InputShaper) -> Motion:
        """Return the motion in the parts of an input shaper, which takes ``shaper.duration`` [s] longer.

        q(t) = sum_i A_i q_0(t - t_i); rotations go in these parts along their way.  A motion that is shaped already is shaped for
        both.  Raises InputError for another kind of shaper; samples of rotations are refused when they are evaluated.
        """
        arguments.check_kind("shaper", shaper, InputShaper)
        if type(self) is not Motion:
            raise InputError(
                f"shaped: a {type(self).__name__} has no parts; write Motion.from_samples(time, q).shaped(...)"
            )
        tracks = (
            replace(track, shaper=shaper if track.shaper is None else track.shaper.join(shaper))
            for track in self.tracks
        )
        return Motion(tuple(tracks), self.duration + shaper.duration)

    @property
    def jumps(self) -> tuple[float, ...]:
        """Times [s] where the acceleration jumps, the start from rest and the stop included."""
        times = sorted(t for track in self.tracks for t in track.jumps)
        apart = [True, *(b - a > SNAP * self.duration for a, b in pairwise(times))]
        return tuple(t for t, new in zip(times, apart, strict=False) if new)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times [s] between which acceleration and jerk are continuous."""
        return tuple(sorted({t for track in self.tracks for t in track.breaks}))

    @cached_property
    def knots(self) -> tuple[float, ...]:
        """Times [s] between which every coordinate is one polynomial of its samples, or one smooth function of its law."""
        return tuple(sorted({t for track in self.tracks for t in track.knots}))

    def joints(self, mechanism: Mechanism) -> tuple[str, ...]:
        """Return the names of the joints [-] that the motion gives; the others are passive.  Raises InputError."""
        arguments.check_kind("mechanism", mechanism, Mechanism)
        given = {joint.name for track in self.tracks for joint, _ in list_joint_columns(mechanism, track)}
        missing = [j.name for j in mechanism.moving_joints if j.actuated and j.name not in given]
        if missing and not mechanism.closures:  # in a loop the closures move the joints that the motion leaves out
            others = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
            advice = f"give it a motion (start = end holds it) or write actuated = false{others}"
            raise InputError(f"the motion gives no joint {missing[0]!r}, which has an actuator; {advice}")
        return tuple(joint.name for joint in mechanism.joints if joint.name in given)

    def evaluate(self, mechanism: Mechanism, time: ArrayLike, side: Literal["left", "right"] = "right") -> Triple:
        """Return q, qd and qdd at any times; joints that the motion does not give stay at zero.

        time : (samples,) [s]; side : which limit an acceleration jump gives, "right" (after it) or "left" (before);
            at the very end of the motion, without a rest there, always the one before
        returns q (samples, nq) [rad], [m]; qd (samples, nv) [rad/s], [m/s]; qdd (samples, nv) [rad/s^2], [m/s^2]
        Raises InputError: unknown joint, actuated joint without motion, wrong number of coordinates.
        """
        at = _copy_read_only(time, "time")
        if at.ndim != 1:
            raise InputError(f"time: expected shape (samples,), got {at.shape}")
        arguments.check_choice("side", side, {"left": "before a jump", "right": "after it"})
        self.joints(mechanism)
        left = np.full(at.shape, side == "left") | (np.abs(at - self.duration) <= SNAP * self.duration)
        q = np.tile(mechanism.neutral, (at.size, 1))
        qd = np.zeros((at.size, mechanism.nv))
        qdd = np.zeros((at.size, mechanism.nv))
        for track in self.tracks:
            for joint, part in list_joint_columns(mechanism, track):
                rows = mechanism.q_slices[joint.name]
                columns = mechanism.v_slices[joint.name]
                q[:, rows], qd[:, columns], qdd[:, columns] = evaluate_joint_path(
                    track, joint, track.values[:, part], at, left
                )
        return q, qd, qdd


LARGE = 100_000  # samples of a table that is not kept


def evaluate_motion(motion: Motion, mechanism: Mechanism, time: NDArray[np.floating]) -> Triple:
    """Return the arrays of ``motion.evaluate`` at some times (samples,) [s], not to be written into.

    Small tables are kept for a while, as batches and loops over designs share a motion; those of other kinds of motions are not,
    as they may look at the mechanism.
    """
    if len(time) > LARGE or type(motion) is not Motion:
        return _evaluate_read_only(motion, mechanism, time)
    joints = tuple((joint.name, joint.kind, joint.actuated) for joint in mechanism.joints)
    return _evaluate_cached(
        motion, _Layout(joints, bool(mechanism.closures), mechanism), np.asarray(time, dtype=np.float64)
    )


@dataclass(frozen=True)
class _Layout:
    """Layout of a mechanism as a motion reads it: the same for all its payloads and stiffnesses."""

    joints: tuple[tuple[str, str, bool], ...]
    closed: bool
    mechanism: Mechanism = field(compare=False)


@make_owner_cache(most=8)
def _evaluate_cached(motion: Motion, layout: _Layout, time: Array) -> Triple:
    return _evaluate_read_only(motion, layout.mechanism, time)


def _evaluate_read_only(motion: Motion, mechanism: Mechanism, time: ArrayLike) -> Triple:
    for part in (found := motion.evaluate(mechanism, time)):
        part.flags.writeable = False
    return found


def _read_row(values: Values, where: str) -> Columns:
    """Names, (columns,) values and widths of one configuration, joints sorted by name."""
    if not isinstance(values, Mapping):
        row = _copy_read_only(values, where)
        if row.ndim != 1:
            raise InputError(f"{where}: expected shape (nq,), got {row.shape}")
        return None, row, None
    ordered = sorted(values, key=str)
    parts = {str(name): np.atleast_1d(_copy_read_only(values[name], f"{where}, joint {name!r}")) for name in ordered}
    for name, part in parts.items():
        if part.ndim != 1:
            raise InputError(f"{where}, joint {name!r}: expected a number or a list of them, got shape {part.shape}")
    return tuple(parts), np.concatenate([*parts.values(), np.empty(0)]), tuple(p.size for p in parts.values())


def _read_table(values: Values, names: tuple[str, ...] | list[str] | None, samples: int) -> Columns:
    """Names, (samples, columns) values and widths of samples."""
    if isinstance(values, Mapping):
        if names is not None:
            arguments.refuse("names", names, "None where q is a table of joints, whose names these are")
        parts = {str(name): _read_matrix(column, samples, f"joint {name!r}") for name, column in values.items()}
        joined = np.hstack([*parts.values(), np.empty((samples, 0))])
        return tuple(parts), joined, tuple(p.shape[1] for p in parts.values())
    order = None if names is None else arguments.check_names("names", names, "joints")
    if order is not None and len(set(order)) != len(order):
        raise InputError(f"names: {format_names(order)}: expected each joint once")
    return order, _read_matrix(values, samples, "q"), None


def _read_matrix(values: ArrayLike, samples: int, where: str) -> Array:
    table = _copy_read_only(values, where)
    table = table[:, None] if table.ndim == 1 else table
    if table.ndim != 2 or table.shape[0] != samples:
        raise InputError(f"{where}: expected {samples} rows, one per time, got shape {table.shape}")
    return table


def _copy_read_only(values: ArrayLike, where: str) -> Array:
    """A read-only copy as floats; InputError where a number is missing, not finite or not a number."""
    copy: Array = np.array(arguments.convert_to_floats(where, values))
    if not np.all(np.isfinite(copy)):
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(copy))[0])
        place = f" at sample {index[0]}" if index else ""
        place += f", column {index[-1]}" if len(index) > 1 else ""
        raise InputError(f"{where}: {copy[index]}{place}; expected finite numbers")
    copy.flags.writeable = False
    return copy


def resolve_start_coordinates(
    mechanism: Mechanism, passive: Collection[str], start: ByJoint, rate: ByJoint = None
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return initial coordinates (nq,) [rad], [m] and rates (nv,) [1/s] by joint; of a continuous joint an angle is enough.

    Raises InputError for a joint that is not ``passive`` and for numbers that are none or too many.
    """
    start = arguments.check_mapping("start", start, "a table of joints and their coordinates", 'start={"joint": 0.1}')
    rate = arguments.check_mapping("start_rate", rate, "a table of joints and their rates", 'start_rate={"joint": 0.1}')
    for label, given in (("start", start), ("start_rate", rate)):
        for name in given:
            if name not in passive:
                others = ", ".join(sorted(passive)) or "none"
                rule = "only unactuated joints that the motion leaves out take a start"
                raise InputError(f"{label}: joint {name!r} is not passive here (passive: {others}); {rule}")
    places = {}
    for name, value in start.items():
        kind = KINDS[mechanism.joint_of[name].kind]
        place = _read_numbers("start", name, value, (1, 2) if kind.circle else (len(kind.q),))
        if kind.circle and place.size == 1:
            place = np.array([np.cos(place[0]), np.sin(place[0])])
        if kind.has_quaternion:
            place[-4:] = scale_quaternions(place[-4:], f"start: joint {name!r}")
        places[name] = place
    rates = {
        name: _read_numbers("start_rate", name, value, (mechanism.joint_of[name].nv,)) for name, value in rate.items()
    }
    return places, rates


def _read_numbers(label: str, name: str, value: ArrayLike, counts: tuple[int, ...]) -> Array:
    try:
        numbers = np.array(np.atleast_1d(arguments.convert_to_floats(label, value)))
    except InputError:
        numbers = np.empty(0)
    if numbers.ndim != 1 or numbers.size not in counts or not np.isfinite(numbers).all():
        wanted = " or ".join(map(str, counts)) + " finite number" + "s" * (counts != (1,))
        raise InputError(f"{label}: joint {name!r} takes {wanted}, got {arguments.shown(value)}")
    return numbers
