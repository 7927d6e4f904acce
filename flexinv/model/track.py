"""Tracks: the coordinates of some joints over time, by laws or splines, as q, qd and qdd of joints of each kind.

A joint torque needs a continuous acceleration, an estimate of its rate a continuous jerk: the default is a quintic
spline (four continuous derivatives); a cubic one has a continuous acceleration whose slope jumps at every sample.

A law maps s = (t - start)/T in [0, 1] to (u, u', u''), derivatives by s; a move of length D in T seconds then has the speed
D u'/T and the acceleration D u''/T^2.  Source of the peaks: the formulas themselves, see any text on cam design.

| law       | u' peak | u'' peak | acceleration jumps at s |
|-----------|---------|----------|-------------------------|
| cycloid   | 2       | 2 pi     | none                    |
| quintic   | 15/8    | 10/sqrt3 | none                    |
| septic    | 35/16   | 84/(5 sqrt5) | none, nor of its next derivative |
| nonic     | 315/128 | 9.372    | none, nor of its two next derivatives |
| bang-bang | 2       | 4        | 0, 1/2, 1               |
| trapezoid | 3/2     | 9/2      | 0, 1/3, 2/3, 1          |
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for: reading a mechanism needs none

from flexinv.errors import InputError, ModelWarning
from flexinv.model.input_shaper import InputShaper
from flexinv.model.joint_kinds import KINDS, POSE, ROTATION
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Mask, Triple
from flexinv.validation import find_nearest_word, shown

HOLE = 10.0  # an interval this many times the median one is a hole in the data, not a change of pace
UNIT_NORM = 1e-2  # components written with two decimals leave the norm this uncertain
ABRUPT = 1e-3  # of the peak speed: a stop from less is lost among what any drive does in one sample
QUARTER_TURN = np.cos(np.pi / 4)  # |<q_k, q_k+1>| of two rotations a quarter turn apart
# Times k * step carry the rounding of a product (1e-16): a sample this close to a jump, far below any step, is meant to be there.
SNAP = 1e-9


@dataclass(frozen=True)
class Law:
    """One time law.

    jumps : fractions of the move [-] where u'' jumps, rest before and after the move included
    function : s (samples,) in [0, 1] -> u, u', u'' (samples,) each [-]; right-hand limits inside, u''(1) from the left
    """

    jumps: tuple[float, ...]
    function: Callable[[Array], Triple]


def _evaluate_cycloid(s: Array) -> Triple:
    turn = 2.0 * np.pi * s
    return s - np.sin(turn) / (2.0 * np.pi), 1.0 - np.cos(turn), 2.0 * np.pi * np.sin(turn)


def _make_smooth_law(power: int, peak: float, *series: float) -> Callable[[Array], Triple]:
    """u' = peak (s (1 - s))^power: what is left of both ends is symmetric, so that u near 1 rounds as near 0.

    series : what is completed at a distance p from the start, over p^(power + 1), by rising powers of p
    """

    def evaluate_law(s: Array) -> Triple:
        p = np.minimum(s, 1.0 - s)
        bell = s * (1.0 - s)
        part = p ** (power + 1) * np.polynomial.polynomial.polyval(p, series)
        slope = power * peak * bell ** (power - 1) * (1.0 - 2.0 * s)
        return np.where(s < 0.5, part, 1.0 - part), peak * bell**power, slope

    return evaluate_law


def _evaluate_bang_bang(s: Array) -> Triple:
    first = s < 0.5
    u = np.where(first, 2.0 * s**2, 1.0 - 2.0 * (1.0 - s) ** 2)
    return u, np.where(first, 4.0 * s, 4.0 * (1.0 - s)), np.where(first, 4.0, -4.0)


def _evaluate_trapezoid(s: Array) -> Triple:
    thirds = [s < 1.0 / 3.0, s < 2.0 / 3.0]
    u = np.select(thirds, [2.25 * s**2, 1.5 * s - 0.25], 1.0 - 2.25 * (1.0 - s) ** 2)
    speed = np.select(thirds, [4.5 * s, np.full_like(s, 1.5)], 4.5 * (1.0 - s))
    return u, speed, np.select(thirds, [np.full_like(s, 4.5), np.zeros_like(s)], -4.5)


LAWS: dict[str, Law] = {
    "cycloid": Law((), _evaluate_cycloid),
    "quintic": Law((), _make_smooth_law(2, 30.0, 10.0, -15.0, 6.0)),
    "septic": Law((), _make_smooth_law(3, 140.0, 35.0, -84.0, 70.0, -20.0)),
    "nonic": Law(
        (), _make_smooth_law(4, 630.0, 126.0, -420.0, 540.0, -315.0, 70.0)
    ),  # no corners in torques of arms that bend
    "bang-bang": Law((0.0, 1.0 / 2.0, 1.0), _evaluate_bang_bang),
    "trapezoid": Law((0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0), _evaluate_trapezoid),
}


def find_law(name: str) -> Law:
    """Return the law of that name; InputError names the laws [-] that exist."""
    if not isinstance(name, str) or name not in LAWS:
        known = ", ".join(LAWS)
        like = find_nearest_word(str(name), LAWS)
        raise InputError(f"law = {shown(name)}: expected one of {known}" + (f"; write {like!r}" if like else ""))
    return LAWS[name]


def evaluate_progress(law: Law, s: Array, remaining: Mask) -> Triple:
    """Evaluate a law for any s: at rest before 0 and after 1, right-hand limits at its jumps.

    s : (samples,) [-]; remaining : (samples,) True where the limit from the left is wanted instead
    returns u, u', u'' : (samples,) each [-]
    """
    inside = np.where(s > SNAP, s, 0.0)
    inside[s >= 1.0 - SNAP] = 1.0
    for mark in law.jumps[1:-1]:
        inside[np.abs(s - mark) <= SNAP] = mark
    u, speed, acceleration = law.function(inside)
    if law.jumps:  # u'' is constant between the jumps, so its limit from the left is its value a little earlier
        before = law.function(np.clip(inside - SNAP, 0.0, 1.0))[2]
        acceleration = np.where(remaining & np.isin(inside, law.jumps), before, acceleration)
    moving = np.where(remaining, (s > SNAP) & (s <= 1.0 + SNAP), (s >= -SNAP) & (s < 1.0 - SNAP))
    return u, np.where(moving, speed, 0.0), np.where(moving, acceleration, 0.0)


@dataclass(frozen=True, eq=False)
class Sampling:
    """Sample times and the spline that joins the samples.

    time : (samples,) [s], from 0, increasing; degree : 3 or 5
    rest : velocity 0, and with degree 5 acceleration 0, at both ends; False leaves the ends to the samples ("not a knot")
    """

    time: Array
    degree: int = 5
    rest: bool = False

    @make_owner_cache()
    def build_spline(self, values: Array) -> scipy.interpolate.BSpline:
        """Return the interpolating spline of values (samples, columns) [any unit]; it is kept, as motions ask time by time."""
        at_rest = [(order, np.zeros(values.shape[1])) for order in range(1, (self.degree + 1) // 2)]
        ends = (at_rest, at_rest) if self.rest else None
        return scipy.interpolate.make_interp_spline(self.time, values, k=self.degree, bc_type=ends)

    def check(self, max_gap: float | None) -> None:
        """Raise InputError unless the times can carry a spline; max_gap [s], None for 10 times the median interval."""
        time = self.time
        degree = self.degree
        if degree not in (3, 5):
            raise InputError(f"degree = {degree}: expected 5 (smooth jerk) or 3 (continuous acceleration)")
        if time.ndim != 1:
            raise InputError(f"time: expected one finite number per sample [s], got an array of shape {time.shape}")
        least = 2 if self.rest else degree + 1
        if time.size < least:
            raise InputError(f"{time.size} samples: a spline of degree {degree} needs at least {least}")
        steps = np.diff(time)
        if np.any(steps <= 0.0):
            k = int(np.argmax(steps <= 0.0))
            order = f"sample {k + 1} at {time[k + 1]:g} s does not come after sample {k} at {time[k]:g} s"
            raise InputError(f"time: {order}; sort the samples and remove repeated ones")
        if time[0] != 0.0:
            raise InputError(f"time starts at {time[0]:g} s: expected 0; write time - time[0]")
        longest = int(np.argmax(steps))
        allowed = HOLE * float(np.median(steps)) if max_gap is None else max_gap
        if steps[longest] > allowed:
            gap = f"a gap of {steps[longest]:g} s after sample {longest} at {time[longest]:g} s"
            advice = "fill the gap, or write max_gap if the spline may cross it"
            raise InputError(f"time: {gap}, more than {allowed:g} s; {advice}")


def scale_quaternions(quaternions: Array, where: str) -> Array:
    """Return quaternions (..., 4) [-] normalised; InputError where the norm is not 1 to within 1 %."""
    norm = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    wrong = np.abs(norm - 1.0) > UNIT_NORM
    if np.any(wrong):
        expected = "expected x, y, z, w of norm 1 (neutral: 0, 0, 0, 1)"
        raise InputError(f"{where}: a quaternion of norm {norm[wrong][0]:g}; {expected}")
    return np.asarray(quaternions / norm)


def choose_continuous_signs(quaternions: Array, where: str) -> Array:
    """Choose the sign of each quaternion (samples, 4) [-] that continues the one before (q and -q turn alike)."""
    cosines = np.sum(quaternions[1:] * quaternions[:-1], axis=1)
    if np.any(np.abs(cosines) < QUARTER_TURN):
        k = int(np.argmin(np.abs(cosines)))
        angle = np.degrees(2.0 * np.arccos(min(1.0, abs(cosines[k]))))
        needed = "a spline of rotations needs samples less than 90 deg apart"
        raise InputError(f"{where}: turns by {angle:.0f} deg between samples {k} and {k + 1}; {needed}")
    return quaternions * np.cumprod(np.concatenate([[1.0], np.sign(cosines)]))[:, None]


def _apply_rest_outside(
    sampling: Sampling, spline: scipy.interpolate.BSpline, at: Array, remaining: Mask, where: str, path: Triple
) -> Triple:
    """Rest before and after the samples; the stop itself belongs to the rest unless ``remaining`` asks for the move."""
    end = sampling.time[-1]
    snap = SNAP * sampling.time[-1]
    after = np.where(remaining, at > end + snap, at >= end - snap)
    before = np.where(remaining, at <= snap, at < -snap)
    if np.any(at > end + snap):
        peak = np.abs(spline(sampling.time, 1)).max()
        stop = np.abs(spline(end, 1)).max()
        if stop > ABRUPT * peak:
            advice = "evaluate no later, add samples that come to rest, or write rest=True"
            warnings.warn(f"{where}: the samples end while moving, then stop at once; {advice}", ModelWarning, 6)
    if sampling.rest and sampling.degree == 5:  # it starts from rest: rates and accelerations are none but for rounding
        before = before | (at <= snap)
    outside = (after | before)[:, None]
    return path[0], np.where(outside, 0.0, path[1]), np.where(outside, 0.0, path[2])


def _compute_product_vector(a: Array, b: Array) -> Array:
    """Vector part of conj(a) b for quaternions x, y, z, w: a_w b_v - b_w a_v - a_v x b_v."""
    return a[:, 3:] * b[:, :3] - b[:, 3:] * a[:, :3] - np.cross(a[:, :3], b[:, :3])


@dataclass(frozen=True, eq=False)
class Track:
    """Coordinates over time of the joints ``names`` (None: all joints of the mechanism, in its order).

    values : (rows, columns) [rad], [m] or [-]; two rows (start, end) with a law, one row per sample with a sampling
    delay, move : [s], when the move starts and how long it takes; shaper : the parts in which it is done, None for one
    """

    names: tuple[str, ...] | None
    values: Array
    widths: tuple[int, ...] | None
    move: float
    delay: float = 0.0
    law: str = ""
    sampling: Sampling | None = None
    shaper: InputShaper | None = None

    def __post_init__(self) -> None:
        self.values.flags.writeable = False

    @property
    def jumps(self) -> tuple[float, ...]:
        """Times [s] where the acceleration jumps."""
        if self.sampling is None:
            return self._list_times(self.delay + s * self.move for s in find_law(self.law).jumps)
        return () if self.sampling.rest and self.sampling.degree == 5 else self._list_times((0.0, self.move))

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times [s] between which the jerk is continuous: of samples joined by cubic splines all of them."""
        if self.sampling is None:
            return self._list_times(self.delay + s * self.move for s in sorted({0.0, 1.0, *find_law(self.law).jumps}))
        return self._list_times(self.sampling.time if self.sampling.degree == 3 else (0.0, self.move))

    @property
    def knots(self) -> tuple[float, ...]:
        """Times [s] between which the coordinates are one polynomial, or one smooth function."""
        return self.breaks if self.sampling is None else self._list_times(self.sampling.time)

    @property
    def parts(self) -> list[tuple[float, float]]:
        """The begin of each part [s], and its share of the whole [-]."""
        if self.shaper is None:
            return [(0.0, 1.0)]
        return list(zip(self.shaper.times.tolist(), self.shaper.parts.tolist(), strict=True))

    def _list_times(self, times: Iterable[float]) -> tuple[float, ...]:
        """The times [s] of all parts, in order, from those of the first."""
        if self.shaper is None:
            return tuple(times)
        return tuple(np.unique(np.add.outer(self.shaper.times, np.fromiter(times, float))).tolist())


def evaluate_joint_path(track: Track, joint: Joint, values: Array, at: Array, remaining: Mask) -> Triple:
    """Return q, qd and qdd of one joint at the times ``at`` [s]; values (rows, columns) are that joint's.

    remaining : (samples,) where an acceleration jump gives its limit from the left
    returns q (samples, nq) [rad], [m]; qd (samples, nv) [rad/s], [m/s]; qdd (samples, nv) [rad/s^2], [m/s^2]
    """
    where = f"joint {joint.name!r}"
    kind = KINDS[joint.kind]
    if kind.layout == ROTATION:
        return _evaluate_rotation(track, values, at, remaining, where)
    if kind.layout == POSE:
        position, v, a = _evaluate_linear(track, values[:, :3], at, remaining, where)
        quaternion, omega, alpha = _evaluate_rotation(track, values[:, 3:], at, remaining, where)
        to_body = scipy.spatial.transform.Rotation.from_quat(quaternion).inv()
        v = to_body.apply(v)
        a = to_body.apply(a)
        return np.hstack([position, quaternion]), np.hstack([v, omega]), np.hstack([a - np.cross(omega, v), alpha])
    if kind.circle:
        angle, rate, acceleration = _evaluate_linear(
            track, _resolve_angles(values, track.sampling is not None, where), at, remaining, where
        )
        return np.hstack([np.cos(angle), np.sin(angle)]), rate, acceleration
    return _evaluate_linear(track, values, at, remaining, where)


def _evaluate_linear(track: Track, values: Array, at: Array, remaining: Mask, where: str) -> Triple:
    """Coordinates in a linear space and their two derivatives: (samples, columns) each, at rest outside the samples."""
    if track.sampling is None:
        u, u1, u2 = _evaluate_law(track, at, remaining)
        step = values[1] - values[0]
        return values[0] + u * step, u1 * step, u2 * step
    spline = track.sampling.build_spline(values)
    paths = [_evaluate_spline(track.sampling, spline, at - begin, remaining, where) for begin, _ in track.parts]
    return _add_parts(track, paths)


def _evaluate_spline(
    sampling: Sampling, spline: scipy.interpolate.BSpline, at: Array, remaining: Mask, where: str
) -> Triple:
    """A spline and its two derivatives at ``at`` [s]: (samples, columns) each, at rest outside the samples."""
    inside = np.clip(at, 0.0, sampling.time[-1])
    path = spline(inside), spline(inside, 1), spline(inside, 2)
    return _apply_rest_outside(sampling, spline, at, remaining, where, path)


def _add_parts(track: Track, paths: list[Triple]) -> Triple:
    """The sum of what each part of a track does, times its share: a place and its two derivatives."""
    if track.shaper is None:
        return paths[0]
    place, rate, acceleration = (
        np.tensordot(track.shaper.parts, np.array(part), 1) for part in zip(*paths, strict=True)
    )
    return place, rate, acceleration


def _evaluate_rotation(track: Track, values: Array, at: Array, remaining: Mask, where: str) -> Triple:
    """Quaternion (samples, 4), angular velocity and acceleration (samples, 3) in the moving frame.

    The spline S(t) through the four components of samples (made continuous in sign) is normalised, q = S/|S|.  Then exactly
        omega = 2 vec(S* S') / |S|^2,   omega' = 2 vec(S* S'') / |S|^2 - 2 omega (S . S') / |S|^2
    (the terms of d|S|/dt are along the scalar part; vec(S'* S') = 0).
    """
    unit = scale_quaternions(values, where)
    if track.sampling is None:
        u, u1, u2 = _evaluate_law(track, at, remaining)
        rotation = scipy.spatial.transform.Rotation
        first, last = rotation.from_quat(unit)
        vector = (first.inv() * last).as_rotvec()  # (xyz,), along the geodesic
        return (first * rotation.from_rotvec(u * vector)).as_quat(), u1 * vector, u2 * vector
    if track.shaper is not None:
        advice = "shape the motion of the other joints and merge both, or give this one start and end with a law"
        raise InputError(f"{where}: samples of rotations are no sum of parts, and are not shaped; {advice}")
    spline = track.sampling.build_spline(choose_continuous_signs(unit, where))
    inside = np.clip(at, 0.0, track.sampling.time[-1])
    # (n, xyzw)
    s = spline(inside)
    s1 = spline(inside, 1)
    s2 = spline(inside, 2)
    square = np.sum(s * s, axis=1, keepdims=True)
    omega = 2.0 * _compute_product_vector(s, s1) / square
    alpha = 2.0 * _compute_product_vector(s, s2) / square - 2.0 * omega * np.sum(s * s1, axis=1, keepdims=True) / square
    return _apply_rest_outside(track.sampling, spline, at, remaining, where, (s / np.sqrt(square), omega, alpha))


def _evaluate_law(track: Track, at: Array, remaining: Mask) -> Triple:
    """u (samples, 1) [-], u' [1/s], u'' [1/s^2] of the track's law."""
    law = find_law(track.law)
    begins = [track.delay + begin for begin, _ in track.parts]
    u, u1, u2 = _add_parts(track, [evaluate_progress(law, (at - begin) / track.move, remaining) for begin in begins])
    return u[:, None], u1[:, None] / track.move, u2[:, None] / track.move**2


def _resolve_angles(values: Array, sampled: bool, where: str) -> Array:
    """Angle (rows, 1) [rad] of a continuous joint from angles or from (cos, sin)."""
    if values.shape[1] == 2:
        norm = np.linalg.norm(values, axis=1)
        if np.any(np.abs(norm - 1.0) > UNIT_NORM):
            k = int(np.argmax(np.abs(norm - 1.0)))
            pair = f"({values[k, 0]:g}, {values[k, 1]:g})"
            raise InputError(f"{where}: {pair} is no cosine and sine; write the angle [rad]")
        return np.unwrap(np.arctan2(values[:, 1:], values[:, :1]), axis=0)
    return np.unwrap(values, axis=0) if sampled else values


@make_owner_cache()
def list_joint_columns(mechanism: Mechanism, track: Track) -> tuple[tuple[Joint, slice], ...]:
    """Return the columns of the track that belong to each joint [-]; a continuous joint has (cos, sin) or one angle.

    Raises InputError: unknown or fixed joint, wrong number of coordinates.
    """
    joints = _find_joints(track.names, mechanism)
    full = [j.nq for j in joints]
    short = [1 if KINDS[j.kind].circle else j.nq for j in joints]
    width = track.values.shape[1]
    if track.widths is not None:
        for given, joint, most, least in zip(track.widths, joints, full, short, strict=True):
            if given not in (most, least):
                wanted = "1 or 2" if least < most else most
                raise InputError(f"joint {joint.name!r} ({joint.kind}) takes {wanted} numbers, got {given}")
        full = list(track.widths)
    elif width not in (sum(full), sum(short)):
        angles = f" (or {sum(short)}, with one angle per continuous joint)" if sum(short) != sum(full) else ""
        each = ", ".join(f"{j.name} {n}" for j, n in zip(joints, full, strict=True))
        raise InputError(f"{width} coordinates: expected {sum(full)}{angles}: {each}")
    elif width != sum(full):
        full = short
    return tuple((j, slice(int(b) - n, int(b))) for j, n, b in zip(joints, full, np.cumsum(full), strict=True))


def _find_joints(names: tuple[str, ...] | None, mechanism: Mechanism) -> list[Joint]:
    movable = {j.name: j for j in mechanism.moving_joints}
    for name in names or ():
        if name not in movable:
            like = find_nearest_word(name, movable)
            why = "is fixed" if name in mechanism.joint_of else "does not exist" + (f"; write {like!r}" if like else "")
            moved = format_names(tuple(movable))
            raise InputError(f"a motion for joint {name!r}, which {why}; {mechanism.name} moves by {moved}")
    return list(movable.values()) if names is None else [movable[name] for name in names]


def format_names(names: tuple[str, ...] | None) -> str:
    """Return names for a message; None means that all joints are given by their position."""
    return "all joints by position" if names is None else ", ".join(names) or "no joint"
