"""Splines through samples: of plain coordinates and of rotations given as quaternions.

A joint torque needs a continuous acceleration, an estimate of its rate a continuous jerk: the default is a quintic
spline (four continuous derivatives); a cubic one has a continuous acceleration whose slope jumps at every sample.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for: reading a mechanism needs none
from numpy.typing import NDArray

from flexinv.errors import InputError, ModelWarning
from flexinv.model.owned_cache import kept_with_owner
from flexinv.model.time_laws import SNAP
from flexinv.typing import Array, Triple

Mask = NDArray[np.bool_]

GAP = 10.0  # an interval this many times the median one is a hole in the data, not a change of pace
UNIT_NORM = 1e-2  # components written with two decimals leave the norm this uncertain
ABRUPT = 1e-3  # of the peak speed: a stop from less is lost among what any drive does in one sample
QUARTER_TURN = np.cos(np.pi / 4)  # |<q_k, q_k+1>| of two rotations a quarter turn apart


@dataclass(frozen=True, eq=False)
class Sampling:
    """Sample times and the spline that joins the samples.

    time : (samples,) [s], from 0, increasing; degree : 3 or 5
    rest : True where the motion starts and ends at rest (velocity 0, and with degree 5 acceleration 0);
        False leaves the ends to the samples ("not a knot")
    """

    time: Array
    degree: int = 5
    rest: bool = False

    def spline(self, values: Array) -> scipy.interpolate.BSpline:
        """Return the interpolating spline of values (samples, columns) [any unit]; it is kept, as motions ask time by time."""
        return _spline(self, np.asarray(values, dtype=np.float64).tobytes(), values.shape[1])


@kept_with_owner()
def _spline(sampling: Sampling, values: bytes, columns: int) -> scipy.interpolate.BSpline:
    zero = np.zeros(columns)
    at_rest = [(order, zero) for order in range(1, (sampling.degree + 1) // 2)]
    ends = (at_rest, at_rest) if sampling.rest else None
    rows = np.frombuffer(values).reshape(-1, columns)
    return scipy.interpolate.make_interp_spline(sampling.time, rows, k=sampling.degree, bc_type=ends)


def check_sampling(sampling: Sampling, max_gap: float | None) -> None:
    """Raise InputError unless the times can carry a spline; max_gap [s], None for 10 times the median interval."""
    time, degree = sampling.time, sampling.degree
    if degree not in (3, 5):
        raise InputError(f"degree = {degree}: expected 5 (smooth jerk) or 3 (continuous acceleration)")
    if time.ndim != 1 or not np.all(np.isfinite(time)):
        raise InputError(f"time: expected one finite number per sample [s], got {_describe(time)}")
    least = 2 if sampling.rest else degree + 1
    if time.size < least:
        raise InputError(f"{time.size} samples: a spline of degree {degree} needs at least {least}")
    steps = np.diff(time)
    if np.any(steps <= 0.0):
        k = int(np.argmax(steps <= 0.0))
        raise InputError(
            f"time: sample {k + 1} at {time[k + 1]:g} s does not come after sample {k} at {time[k]:g} s; "
            "sort the samples and remove repeated ones"
        )
    if time[0] != 0.0:
        raise InputError(f"time starts at {time[0]:g} s: expected 0; write time - time[0]")
    longest, allowed = int(np.argmax(steps)), GAP * float(np.median(steps)) if max_gap is None else max_gap
    if steps[longest] > allowed:
        raise InputError(
            f"time: a gap of {steps[longest]:g} s after sample {longest} at {time[longest]:g} s, "
            f"more than {allowed:g} s; fill the gap, or write max_gap if the spline may cross it"
        )


def plain_path(sampling: Sampling, values: Array, at: Array, left: Mask, where: str) -> Triple:
    """Return the spline through values and its two derivatives at times ``at`` [s], at rest outside the samples.

    values : (samples, columns) [rad] or [m]; left : (len(at),) True where the stop belongs to the move
    returns (len(at), columns) [rad] or [m], [rad/s] or [m/s], [rad/s^2] or [m/s^2]
    """
    spline = sampling.spline(values)
    inside = np.clip(at, 0.0, sampling.time[-1])
    return _rest_outside(sampling, spline, at, left, where, (spline(inside), spline(inside, 1), spline(inside, 2)))


def rotation_path(sampling: Sampling, quaternions: Array, at: Array, left: Mask, where: str) -> Triple:
    """Return the rotation through sampled quaternions, its body angular velocity and its acceleration.

    The spline S(t) through the four components (made continuous in sign) is normalised, q = S/|S|.  Then exactly
        omega = 2 vec(S* S') / |S|^2,   omega' = 2 vec(S* S'') / |S|^2 - 2 omega (S . S') / |S|^2
    (the terms of d|S|/dt are along the scalar part; vec(S'* S') = 0).

    quaternions : (samples, 4) [-], x, y, z, w; at, left : (n,) as in ``plain_path``; where : named in errors
    returns (n, 4) [-], (n, 3) [rad/s], (n, 3) [rad/s^2]
    """
    spline = sampling.spline(continuous_signs(unit_quaternions(quaternions, where), where))
    inside = np.clip(at, 0.0, sampling.time[-1])
    s, s1, s2 = spline(inside), spline(inside, 1), spline(inside, 2)  # (n, xyzw)
    square = np.sum(s * s, axis=1, keepdims=True)
    omega = 2.0 * _vector_of_product(s, s1) / square
    alpha = 2.0 * _vector_of_product(s, s2) / square - 2.0 * omega * np.sum(s * s1, axis=1, keepdims=True) / square
    return _rest_outside(sampling, spline, at, left, where, (s / np.sqrt(square), omega, alpha))


def unit_quaternions(quaternions: Array, where: str) -> Array:
    """Return quaternions (..., 4) [-] normalised; InputError where the norm is not 1 to within 1 %."""
    norm = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    wrong = np.abs(norm - 1.0) > UNIT_NORM
    if np.any(wrong):
        raise InputError(
            f"{where}: a quaternion of norm {norm[wrong][0]:g}; expected x, y, z, w of norm 1 (neutral: 0, 0, 0, 1)"
        )
    unit: Array = quaternions / norm
    return unit


def continuous_signs(quaternions: Array, where: str) -> Array:
    """Choose the sign of each quaternion (samples, 4) [-] that continues the one before (q and -q turn alike)."""
    cosines = np.sum(quaternions[1:] * quaternions[:-1], axis=1)
    if np.any(np.abs(cosines) < QUARTER_TURN):
        k = int(np.argmin(np.abs(cosines)))
        angle = np.degrees(2.0 * np.arccos(min(1.0, abs(cosines[k]))))
        raise InputError(
            f"{where}: turns by {angle:.0f} deg between samples {k} and {k + 1}; "
            "a spline of rotations needs samples less than 90 deg apart"
        )
    signs = np.cumprod(np.concatenate([[1.0], np.sign(cosines)]))
    continued: Array = quaternions * signs[:, None]
    return continued


def _rest_outside(
    sampling: Sampling, spline: scipy.interpolate.BSpline, at: Array, left: Mask, where: str, path: Triple
) -> Triple:
    """Rest before and after the samples; the stop itself belongs to the rest unless ``left`` asks for the move."""
    end = sampling.time[-1]
    snap = SNAP * end
    after = np.where(left, at > end + snap, at >= end - snap)
    before = np.where(left, at <= snap, at < -snap)
    if np.any(at > end + snap):
        peak, stop = np.abs(spline(sampling.time, 1)).max(), np.abs(spline(end, 1)).max()
        if stop > ABRUPT * peak:
            advice = "evaluate no later, add samples that come to rest, or write rest=True"
            warnings.warn(f"{where}: the samples end while moving, then stop at once; {advice}", ModelWarning, 6)
    outside = (after | before)[:, None]
    return path[0], np.where(outside, 0.0, path[1]), np.where(outside, 0.0, path[2])


def _vector_of_product(a: Array, b: Array) -> Array:
    """Vector part of conj(a) b for quaternions x, y, z, w: a_w b_v - b_w a_v - a_v x b_v."""
    vector: Array = a[:, 3:] * b[:, :3] - b[:, 3:] * a[:, :3] - np.cross(a[:, :3], b[:, :3])
    return vector


def _describe(values: Array) -> str:
    if values.ndim != 1:
        return f"an array of shape {values.shape}"
    k = int(np.argmax(~np.isfinite(values)))
    return f"{values[k]} at sample {k}"
