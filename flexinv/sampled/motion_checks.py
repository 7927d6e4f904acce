"""Checks of a motion against itself: given rates are slopes of positions, given accelerations slopes of rates; noise of digits.

Between samples k and k + 1 of a column x with the stated slopes v

    d_k = x_k+1 - x_k,   m_k = (t_k+1 - t_k) (v_k + v_k+1) / 2,   factor = (d . m) / (m . m),

1 for true slopes.  It may be off by `ALLOWED`; by what the spacing of the samples leaves, for between two samples a slope may
jump anywhere from one to the other, which changes d_k by half of (t_k+1 - t_k) |v_k+1 - v_k| (of the largest such change nearby,
where the slope has a peak); and by what the digits of the file leave: each x is known to half a digit, which summed by parts is
at most half a digit times the total variation of m / (t_k+1 - t_k).  Each is multiplied by |m| and divided by m . m.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from flexinv.files.motion_columns import ACCELERATION_COLUMNS, POSITION_COLUMNS, RATE_COLUMNS, MotionColumn
from flexinv.files.motion_table import MotionPart, MotionSource, join_parts
from flexinv.files.toml_tables import make_input_error
from flexinv.model.joint_kinds import KINDS
from flexinv.model.track import Sampling
from flexinv.sampled.sampled_motion import (
    OVERHANG,
    MotionSamples,
    compute_increments,
    list_place_slices,
    make_even_times,
)
from flexinv.typing import Array, Mask

ALLOWED = 0.02  # of the factor: planners that differentiate by differences, and clocks, are off by less; units and gears by more
UNKNOWN = 0.5  # a factor that is not known to better than this is none
# What makes a stated slope this many times the true one, to within the part that is allowed.
CAUSES = {
    180.0
    / np.pi: "it is in degrees: write [deg/s] or [deg/s^2] in its header; or the other is in radians: write [rad] there",
    np.pi
    / 180.0: "it is in radians: write [rad/s] or [rad/s^2] in its header; or the other is in degrees: write [deg] there",
    1000.0: "it is in thousandths, or times are in milliseconds: write [mm/s] in its header or [ms] in that of times",
    0.001: "the other is in thousandths: write [mm] in its header",
    30.0 / np.pi: "it is in turns per minute: write [rpm] in its header",
    -1.0: "its sign is the other one",
}
STANDS = 1e-9  # [rad], [m]: a joint whose samples differ by less in all stands still
HALF_TURN = np.pi
NOISE_SAMPLES = 16  # samples of a part at which the torque of a noise is computed
Torques = Callable[[Array, Array, Array], Array]


@dataclass
class SlopeCheck:
    """Stated slopes of a motion, part by part, and whether any was compared.

    compared : by sense (nv,) the joint's slopes were compared with what they are slopes of
    """

    table: MotionSource
    last: MotionPart | None = None
    compared: dict[str, Mask] = field(default_factory=dict)
    moving: dict[str, Mask] = field(default_factory=dict)

    def check_parts(self, parts: Iterator[MotionPart]) -> Iterator[MotionPart]:
        """Yield parts [rad], [m], [1/s] that have been checked.  Raises InputError with the factor of each wrong joint."""
        for part in parts:
            self._check_turns(part)
            if part.time is not None and part.rates is not None:
                whole = part if self.last is None else join_parts([self.last.take(slice(-1, None)), part])
                self._check_part(whole)
                self.last = part
            yield part

    def describe_unchecked(self) -> list[str]:
        """Return in words what was not compared [-]: times, digits or spacing leave it open."""
        if not self.table.columns.rates:
            return []
        if not self.table.timed:
            return ["rates and accelerations are taken as they are: without times nothing can be compared with them"]
        out = []
        for sense, compared in self.compared.items():
            unknown = self.moving[sense] & ~compared
            names = [name for name, one in zip(self.table.mechanism.velocity_names, unknown, strict=True) if one]
            if names:
                out.append(
                    f"{sense}s of {', '.join(names)} are taken as they are: digits and spacing leave open what they should be"
                )
        return out

    def _check_turns(self, part: MotionPart) -> None:
        """Refuse an angle of a joint that counts turns and jumps by more than half of one from a sample to the next."""
        for joint, places in list_place_slices(self.table.mechanism):
            if joint.kind != "revolute" or len(part.positions) < 2:
                continue
            steps = np.abs(np.diff(part.positions[:, places.start]))
            k = int(np.argmax(steps))
            if steps[k] > HALF_TURN:
                raise make_input_error(
                    f"{self.table.label}: joint {joint.name}", f"a jump of {steps[k]:.4g} rad after row {part.first + k + 1}",
                    "angles that go on, less than half a turn from a sample to the next",
                    "numpy.unwrap(angles), where they jump by whole turns; else the samples between",
                )  # fmt: skip

    def _check_part(self, part: MotionPart) -> None:
        mechanism = self.table.mechanism
        rates = part.rates
        assert rates is not None
        faults = self._compare(part, RATE_COLUMNS, rates, compute_increments(mechanism, part.positions))
        if part.accelerations is not None and not faults:  # of rates that are wrong nobody knows the slopes
            faults = self._compare(part, ACCELERATION_COLUMNS, part.accelerations, np.diff(rates, axis=0))
        if faults:
            rows = f"rows {part.first + 1} to {part.first + len(part.positions)}"
            expected = f"slopes of positions, and of rates, to {ALLOWED:.0%} and what spacing and digits leave open"
            write = "; ".join(dict.fromkeys(cause for _, cause in faults))
            given = "; ".join(words for words, _ in faults)
            raise make_input_error(f"{self.table.label}: {rows}", given, expected, write)

    def _compare(self, part: MotionPart, sense: str, slopes: Array, moved: Array) -> list[tuple[str, str]]:
        assert part.time is not None
        of = POSITION_COLUMNS if sense == RATE_COLUMNS else RATE_COLUMNS
        time = make_even_times(part.time, self.table.time_digit)
        digits = (list_digits(self.table, one) for one in (of, sense))
        factor, allowed = compute_slope_factors(time, slopes, moved, *digits)
        known = allowed < UNKNOWN
        self.compared[sense] = self.compared.get(sense, np.zeros_like(known)) | known
        self.moving[sense] = self.moving.get(sense, np.zeros_like(known)) | (np.ptp(slopes, axis=0) > 0.0)
        columns = self.table.columns.rates if sense == RATE_COLUMNS else self.table.columns.accelerations
        return _describe_faults(self.table.mechanism.velocity_names, sense, of, columns, factor, allowed)


def compute_slope_factors(
    time: Array, slopes: Array, moved: Array, digits: Array, slope_digits: Array
) -> tuple[Array, Array]:
    """Return by which factor of the stated slopes a column moves (columns,) [-], and how far from 1 that may be [-].

    time : (samples,) [s]; slopes : (samples, columns); moved : from each sample to the next (samples - 1, columns); digits : of
    what moves (columns,), and of the slopes.  What is said to stand has the factor 1, or an infinite one where it moves.
    """
    if len(time) < 4:
        return np.ones(slopes.shape[1]), np.full(slopes.shape[1], np.inf)
    width = np.diff(time)[:, None]
    mean = 0.5 * (slopes[1:] + slopes[:-1])
    size = np.abs(mean)
    change = np.abs(np.diff(slopes, axis=0))
    nearby = change.copy()
    np.maximum(nearby[1:], change[:-1], out=nearby[1:])
    np.maximum(nearby[:-1], change[1:], out=nearby[:-1])
    total = np.einsum("ij,ij->j", mean, mean * width)
    jumps = 0.5 * np.einsum("ij,ij->j", size, nearby * width)
    variation = np.abs(np.diff(mean, axis=0)).sum(axis=0) + size[0] + size[-1]
    rounding = 0.5 * (digits * variation + slope_digits * (np.diff(time) @ size))
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.einsum("ij,ij->j", moved, mean) / total
        allowed = ALLOWED + (jumps + rounding) / total
    still = total == 0.0
    gone = still & (np.abs(moved).sum(axis=0) > STANDS + 2.0 * digits)
    factor[still] = 1.0
    allowed[still] = np.inf
    factor[gone] = np.inf
    allowed[gone] = ALLOWED
    return factor, allowed


def _describe_faults(
    names: tuple[str, ...], sense: str, of: str, columns: tuple[MotionColumn, ...], factor: Array, allowed: Array
) -> list[tuple[str, str]]:
    """Words on each joint whose stated slopes are wrong, and what to write."""
    headers = {column.coordinate: column.name for column in columns}
    out = []
    for name, size, most in zip(names, factor, allowed, strict=True):
        if name not in headers or not abs(size - 1.0) > most:
            continue
        times = 0.0 if np.isinf(size) else 1.0 / size if size else np.inf
        many = f"{times:.4g} times the slope" if np.isfinite(times) and abs(times) < 1e4 else "no multiple of the slope"
        cause = next((words for one, words in CAUSES.items() if abs(times / one - 1.0) < max(most, ALLOWED)), "")
        advice = cause or f"the {sense}s of these positions, or no column of {sense}s"
        out.append((f"{headers[name]!r} is {many} of the {of}s of {name} (allowed: 1 ± {most:.2g})", advice))
    return out


def list_digits(table: MotionSource, sense: str) -> Array:
    """Return the last digit of each velocity coordinate's column of a sense (nv,) [rad], [m], [1/s]."""
    columns = {
        POSITION_COLUMNS: table.columns.positions,
        RATE_COLUMNS: table.columns.rates,
        ACCELERATION_COLUMNS: table.columns.accelerations,
    }[sense]
    out = np.zeros(table.mechanism.nv)
    names = list(table.mechanism.velocity_names)
    for column, digit in zip(columns, table.digits[sense], strict=True):
        joint = table.mechanism.joint_of[column.joint]
        freedoms = table.mechanism.v_slices[column.joint]
        if column.coordinate in names:
            out[names.index(column.coordinate)] = digit
        elif KINDS[joint.kind].has_quaternion:
            out[freedoms] = np.maximum(out[freedoms], 2.0 * digit)
    return out


@dataclass
class DigitNoise:
    """Noise that the last digits of a motion make in its efforts: roundings are independent, and uniform in a digit.

    acceleration : (nv,) standard deviation in the accelerations [rad/s^2], [m/s^2]; effort : (nv,) what it makes [N m], [N]
    """

    table: MotionSource
    acceleration: Array | None = None
    effort: Array | None = None

    def update(self, samples: MotionSamples, torques: Torques | None) -> None:
        """Look at some samples [rad], [m], [s]; torques : the efforts of a rigid mechanism, None of one that bends."""
        sense, gain = self._find_gain(samples)
        sigma = gain * list_digits(self.table, sense) / np.sqrt(12.0)
        self.acceleration = sigma if self.acceleration is None else np.maximum(self.acceleration, sigma)
        if torques is None or not sigma.any():
            return
        some = slice(0, None, max(len(samples.q) // NOISE_SAMPLES, 1))
        q = np.ascontiguousarray(samples.q[some])
        qd = np.ascontiguousarray(samples.qd[some])
        qdd = np.ascontiguousarray(samples.qdd[some])
        without = torques(q, qd, qdd)
        square = np.zeros_like(qd)
        for k in np.flatnonzero(sigma):
            moved = qdd.copy()
            moved[:, k] += sigma[k]
            square += (torques(q, qd, moved) - without) ** 2
        effort = np.sqrt(square.mean(axis=0))
        self.effort = effort if self.effort is None else np.maximum(self.effort, effort)

    def _find_gain(self, samples: MotionSamples) -> tuple[str, float]:
        """Whose digits count, and the acceleration [1/s^2], [1/s] that a unit of scatter makes in these."""
        if self.table.columns.accelerations:
            return ACCELERATION_COLUMNS, 1.0
        sense, order = (RATE_COLUMNS, 1) if self.table.columns.rates else (POSITION_COLUMNS, 2)
        assert samples.time is not None
        if len(samples.time) < 6:
            return sense, 0.0
        spacing = float(np.median(np.diff(samples.time)))
        return sense, compute_noise_gain(order) / spacing**order


def compute_noise_gain(order: int) -> float:
    """Return the standard deviation of the derivative of a quintic spline [-] through white noise of 1 at samples 1 s apart.

    It is the root of the sum of squares of the derivatives at all samples of the spline through one 1 among zeros.
    """
    count = 2 * OVERHANG + 1
    one = np.zeros((count, 1))
    one[OVERHANG] = 1.0
    time = np.arange(count, dtype=np.float64)
    return float(np.linalg.norm(Sampling(time).build_spline(one)(time, order)))
