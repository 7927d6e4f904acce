"""Paths: prescribed poses of a frame as exact functions of time, the task of an end effector.

A path is a curve c(u) that a time law u(s) runs through (`model.track`): x(t) = c(u(s)), s = t / duration.  With an orientation
the frame turns the shorter way from one to the other by the same law, R(t) = R_0 exp(u log(R_0^T R_1)).
Before time 0 and after its end a path rests.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, NamedTuple

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import ArrayLike

from flexinv.errors import InputError
from flexinv.kernels.so3 import exp_so3, log_so3
from flexinv.model import rules
from flexinv.model.frozen import Frozen
from flexinv.model.track import LAWS, evaluate_progress, find_law
from flexinv.typing import Array
from flexinv.validation import check_finite_array, check_number, check_seconds, convert_to_floats, shown

# u (samples,) [-] -> c, dc/du, d2c/du2 (samples, 3) [m]
Curve = Callable[[Array], tuple[Array, Array, Array]]
# Rotation matrices written with so many digits are meant to be orthogonal.
ORTHOGONAL = 1e-6
# Pieces into which a curve is cut to measure its length: the error of a smooth one falls with their square.
PIECES = 2000


class Poses(NamedTuple):
    """Poses of a frame at some times: x, v, a (samples, 3) [m, s] world; rotation (samples, 3, 3) R_W,frame with rates
    omega, alpha (samples, 3) [rad, s] in the frame's own axes, all None where its orientation is left free."""

    x: Array
    v: Array
    a: Array
    rotation: Array | None = None
    omega: Array | None = None
    alpha: Array | None = None


@dataclass(frozen=True, eq=False)
class Path(Frozen):
    """Path of a frame; make one with ``line``, ``arc`` or ``points``.

    duration : of the move [s]; law : of time, one without jumps of the acceleration; text : what it is, in words
    turn : orientations (2, 3, 3) at start and end, None to leave it free [-]
    """

    curve: Curve
    duration: float
    law: str
    text: str
    turn: Array | None = None

    RULES: ClassVar[rules.Rules] = {
        "duration": rules.make_real_rule("s", 0.0, above=True), "law": rules.check_text, "text": rules.check_text,
        "turn": rules.make_optional_rule(rules.make_array_rule((2, 3, 3), "-")),
    }  # fmt: skip

    @staticmethod
    def line(start: ArrayLike, end: ArrayLike, duration: float, law: str = "nonic") -> Path:
        """Run straight from ``start`` to ``end``, (3,) [m] in the world, in ``duration`` [s].  Raises InputError."""
        ends = [_check_point(start, "start"), _check_point(end, "end")]
        spline = scipy.interpolate.make_interp_spline([0.0, 1.0], ends, k=1)
        return _build_checked_path(partial(_evaluate_spline, spline), duration, law, "line")

    @staticmethod
    def arc(
        start: ArrayLike, centre: ArrayLike, angle: float, duration: float, axis: ArrayLike = (0, 0, 1), law: str = "nonic"
    ) -> Path:  # fmt: skip
        """Run from ``start`` (3,) [m] by ``angle`` [rad] about an ``axis`` through ``centre`` (3,) [m].  Raises InputError."""
        a = _check_point(start, "start")
        c = _check_point(centre, "centre")
        n = _check_point(axis, "axis")
        if not np.linalg.norm(n) > 0 or not np.linalg.norm(np.cross(n, a - c)) > 0:
            raise InputError("arc: expected an axis that is not zero, and a start that is not on the axis")
        angle = check_number("angle", angle, "a finite number of radians")
        if not np.isfinite(angle):
            raise InputError(f"arc: angle = {angle}: expected a finite number of radians")
        return _build_checked_path(
            partial(_evaluate_arc, a, c, float(angle) * n / np.linalg.norm(n)), duration, law, "arc"
        )

    @staticmethod
    def points(points: ArrayLike, duration: float, law: str = "nonic") -> Path:
        """Run through ``points`` (n >= 2, 3) [m] on a spline (quintic from six on), evenly by chords.  Raises InputError."""
        at = convert_to_floats("points", points)
        if at.ndim != 2 or at.shape[1] != 3 or len(at) < 2 or not np.isfinite(at).all():
            raise InputError(f"points have shape {at.shape}, expected two or more finite points (n, 3) [m]")
        chords = np.linalg.norm(np.diff(at, axis=0), axis=1)
        if not (chords > 0).all():
            raise InputError(f"points[{int(np.argmin(chords))}] and the next are the same: expected points that differ")
        along = np.concatenate([[0.0], np.cumsum(chords)]) / chords.sum()
        degree = min(5, len(at) - 1)
        spline = scipy.interpolate.make_interp_spline(along, at, k=degree - (degree == 4))  # odd degrees are symmetric
        return _build_checked_path(partial(_evaluate_spline, spline), duration, law, f"spline through {len(at)} points")

    def turning(self, start: ArrayLike, end: ArrayLike) -> Path:
        """Return the path with orientations R_W,frame (3, 3) [-] at its start and its end.  Raises InputError."""
        pair = [convert_to_floats(name, value) for name, value in (("start", start), ("end", end))]
        turn = np.array(pair) if pair[0].shape == pair[1].shape else np.empty(0)
        orthogonal = turn.shape == (2, 3, 3) and np.allclose(turn @ turn.transpose(0, 2, 1), np.eye(3), atol=ORTHOGONAL)
        if not orthogonal or (np.linalg.det(turn) < 0.0).any():
            raise InputError("turning: expected two rotation matrices (3, 3) [-]")
        return replace(self, turn=turn)

    @property
    def length(self) -> float:
        """Length of the curve [m]."""
        c = self.curve(np.linspace(0.0, 1.0, PIECES + 1))[0]
        return float(np.linalg.norm(np.diff(c, axis=0), axis=1).sum())

    def evaluate(self, time: ArrayLike) -> Poses:
        """Return position, velocity and acceleration [m, s], and orientation where it is given, at ``time`` (samples,) [s]."""
        at = convert_to_floats("time", time)
        if at.ndim != 1:
            raise InputError(f"time: expected shape (samples,), got {at.shape}")
        s = check_finite_array("time", at, (None,), "s") / self.duration
        u, speed, rate = evaluate_progress(find_law(self.law), s, np.zeros(s.shape, dtype=bool))
        # (sample, 1)
        u1 = (speed / self.duration)[:, None]
        u2 = (rate / self.duration**2)[:, None]
        c, c1, c2 = self.curve(u)
        poses = Poses(c, c1 * u1, c2 * u1**2 + c1 * u2)
        if self.turn is None:
            return poses
        angle = log_so3(self.turn[0].T @ self.turn[1])
        rotation = self.turn[0] @ exp_so3(u[:, None] * angle)
        return poses._replace(rotation=rotation, omega=u1 * angle, alpha=u2 * angle)


def _build_checked_path(curve: Curve, duration: float, law: str, text: str) -> Path:
    if find_law(law).jumps:
        smooth = ", ".join(name for name, one in LAWS.items() if not one.jumps)
        raise InputError(
            f"law = {law!r}: its acceleration jumps, and a flexible arm cannot follow a jump with a finite torque; "
            f"write law = 'nonic' (smooth laws: {smooth})"
        )
    return Path(curve, check_seconds("duration", duration, "a positive time [s]"), law, text)


def _check_point(value: ArrayLike, name: str) -> Array:
    point = convert_to_floats(name, value)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InputError(f"{name} = {shown(value)}: expected three finite numbers [m]")
    return point


def _evaluate_arc(start: Array, centre: Array, turn: Array, u: Array) -> tuple[Array, Array, Array]:
    arm = exp_so3(u[:, None] * turn) @ (start - centre)
    swing = np.cross(turn, arm)
    return centre + arm, swing, np.cross(turn, swing)


def _evaluate_spline(spline: Callable[..., Array], u: Array) -> tuple[Array, Array, Array]:
    return spline(u), spline(u, nu=1), spline(u, nu=2)
