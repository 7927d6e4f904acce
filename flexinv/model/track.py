"""Tracks: the coordinates of some joints over time, and their conversion to q, qd and qdd of joints of each kind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import NDArray

from flexinv.errors import InputError
from flexinv.model.joint_kinds import KINDS, POSE, ROTATION
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.model.owned_cache import kept_with_owner
from flexinv.model.splines import UNIT_NORM, Sampling, plain_path, rotation_path, unit_quaternions
from flexinv.model.time_laws import find_law, progress
from flexinv.typing import Array, Triple
from flexinv.validation import nearest


@dataclass(frozen=True, eq=False)
class Track:
    """Coordinates over time of the joints ``names`` (None: all joints of the mechanism, in its order).

    values : (rows, columns) [rad], [m] or [-]; two rows (start, end) with a law, one row per sample with a sampling
    delay, move : [s], when the move starts and how long it takes
    """

    names: tuple[str, ...] | None
    values: Array
    widths: tuple[int, ...] | None
    move: float
    delay: float = 0.0
    law: str = ""
    sampling: Sampling | None = None

    def __post_init__(self) -> None:
        self.values.flags.writeable = False

    @property
    def jumps(self) -> tuple[float, ...]:
        """Times [s] where the acceleration jumps."""
        if self.sampling is None:
            return tuple(self.delay + s * self.move for s in find_law(self.law).jumps)
        smooth = self.sampling.rest and self.sampling.degree == 5
        return () if smooth else (0.0, self.move)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times [s] between which the jerk is continuous: of samples joined by cubic splines all of them."""
        if self.sampling is None:
            return tuple(self.delay + s * self.move for s in sorted({0.0, 1.0, *find_law(self.law).jumps}))
        return tuple(self.sampling.time) if self.sampling.degree == 3 else (0.0, self.move)


def joint_path(track: Track, joint: Joint, values: Array, at: Array, left: NDArray[np.bool_]) -> Triple:
    """Return q, qd and qdd of one joint at the times ``at`` [s]; values (rows, columns) are that joint's.

    left : (samples,) where an acceleration jump gives its limit from the left
    returns q (samples, nq) [rad], [m]; qd (samples, nv) [rad/s], [m/s]; qdd (samples, nv) [rad/s^2], [m/s^2]
    """
    where = f"joint {joint.name!r}"
    kind = KINDS[joint.kind]
    if kind.layout == ROTATION:
        return _rotation(track, values, at, left, where)
    if kind.layout == POSE:
        position, v, a = _plain(track, values[:, :3], at, left, where)
        quaternion, omega, alpha = _rotation(track, values[:, 3:], at, left, where)
        to_body = scipy.spatial.transform.Rotation.from_quat(quaternion).inv()
        v, a = to_body.apply(v), to_body.apply(a)
        a = a - np.cross(omega, v)
        return np.hstack([position, quaternion]), np.hstack([v, omega]), np.hstack([a, alpha])
    if kind.circle:
        angle, rate, acceleration = _plain(track, _angles(values, track.sampling is not None, where), at, left, where)
        return np.hstack([np.cos(angle), np.sin(angle)]), rate, acceleration
    return _plain(track, values, at, left, where)


def _plain(track: Track, values: Array, at: Array, left: NDArray[np.bool_], where: str) -> Triple:
    """Coordinates in a linear space: (samples, columns) each."""
    if track.sampling is not None:
        return plain_path(track.sampling, values, at, left, where)
    u, u1, u2 = _law(track, at, left)
    step = values[1] - values[0]
    return values[0] + u * step, u1 * step, u2 * step


def _rotation(track: Track, values: Array, at: Array, left: NDArray[np.bool_], where: str) -> Triple:
    """Quaternion (samples, 4), angular velocity and acceleration (samples, 3) in the moving frame."""
    if track.sampling is not None:
        return rotation_path(track.sampling, values, at, left, where)
    u, u1, u2 = _law(track, at, left)
    rotation = scipy.spatial.transform.Rotation
    first, last = rotation.from_quat(unit_quaternions(values, where))
    vector = (first.inv() * last).as_rotvec()  # (xyz,), along the geodesic
    return (first * rotation.from_rotvec(u * vector)).as_quat(), u1 * vector, u2 * vector


def _law(track: Track, at: Array, left: NDArray[np.bool_]) -> Triple:
    """u (samples, 1) [-], u' [1/s], u'' [1/s^2] of the track's law."""
    u, u1, u2 = progress(find_law(track.law), (at - track.delay) / track.move, left)
    return u[:, None], u1[:, None] / track.move, u2[:, None] / track.move**2


def _angles(values: Array, sampled: bool, where: str) -> Array:
    """Angle (rows, 1) [rad] of a continuous joint from angles or from (cos, sin)."""
    if values.shape[1] == 2:
        norm = np.linalg.norm(values, axis=1)
        if np.any(np.abs(norm - 1.0) > UNIT_NORM):
            k = int(np.argmax(np.abs(norm - 1.0)))
            raise InputError(
                f"{where}: ({values[k, 0]:g}, {values[k, 1]:g}) is no cosine and sine; write the angle [rad]"
            )
        values = np.arctan2(values[:, 1:], values[:, :1])
        return np.unwrap(values, axis=0)
    return np.unwrap(values, axis=0) if sampled else values


def parts(track: Track, mechanism: Mechanism) -> tuple[tuple[Joint, slice], ...]:
    """Return the columns of the track that belong to each joint [-]; a continuous joint has (cos, sin) or one angle.

    Raises InputError: unknown or fixed joint, wrong number of coordinates.
    """
    return _parts(mechanism, track)


@kept_with_owner()
def _parts(mechanism: Mechanism, track: Track) -> tuple[tuple[Joint, slice], ...]:
    joints = _named(track.names, mechanism)
    full, short = [j.nq for j in joints], [1 if KINDS[j.kind].circle else j.nq for j in joints]
    width = track.values.shape[1]
    if track.widths is not None:
        _check_widths(track.widths, joints)
        full = list(track.widths)
    elif width not in (sum(full), sum(short)):
        angles = f" (or {sum(short)}, with one angle per continuous joint)" if sum(short) != sum(full) else ""
        raise InputError(
            f"{width} coordinates: expected {sum(full)}{angles}: "
            + ", ".join(f"{j.name} {n}" for j, n in zip(joints, full, strict=True))
        )
    elif width != sum(full):
        full = short
    ends = np.cumsum(full)
    return tuple((j, slice(int(b) - n, int(b))) for j, n, b in zip(joints, full, ends, strict=True))


def _named(names: tuple[str, ...] | None, mechanism: Mechanism) -> list[Joint]:
    movable = {j.name: j for j in mechanism.joints if j.nv}
    for name in names or ():
        if name not in movable:
            fixed = name in mechanism.joint_of
            like = nearest(name, movable)
            raise InputError(
                f"a motion for joint {name!r}, which "
                + ("is fixed" if fixed else "does not exist")
                + (f"; write {like!r}" if like and not fixed else "")
                + f"; {mechanism.name} moves by {listed(tuple(movable))}"
            )
    return list(movable.values()) if names is None else [movable[name] for name in names]


def _check_widths(widths: tuple[int, ...], joints: list[Joint]) -> None:
    for width, joint in zip(widths, joints, strict=True):
        circle = KINDS[joint.kind].circle
        if width != joint.nq and not (circle and width == 1):
            raise InputError(
                f"joint {joint.name!r} ({joint.kind}) takes {'1 or 2' if circle else joint.nq} numbers, got {width}"
            )


def listed(names: tuple[str, ...] | None) -> str:
    """Return names for a message; None means that all joints are given by their position."""
    return "all joints by position" if names is None else ", ".join(names) or "no joint"
