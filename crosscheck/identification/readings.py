"""Readings: what the sensors of a machine should have shown under a measured motion, and what they have shown.

effort at a motor     (1 + c)^-T tau(mechanism) + drive,   `drives.efforts`;   behind the gear tau alone
its sensor            gain * delayed(lagged(effort / ratio + offset)),   both sides behind the same zero-phase low-pass;
                      over the torque constant, a current whose gain is free: it is compared in ampere
gauge                 gain * delayed(lagged(sign M L / (3 EI))) + zero + slope q,   through the rig's low-pass; strain: M h / EI
marker, accelerometer gain * delayed(lagged(signal)) + zero
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import NDArray

from crosscheck.identification.drives.efforts import (
    compute_channel_rate,
    compute_loaded_drive_effort,
    convert_to_motor_efforts,
)
from crosscheck.identification.filters import apply_lag, apply_low_pass_all, low_pass, make_signal_cache
from crosscheck.identification.logs.jumps import find_jumps, find_wrap_period
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Channel, Machine, has_friction, resolve_value
from crosscheck.identification.parameters import Key
from crosscheck.identification.points import list_point_sensors
from crosscheck.identification.responses.response import MeasuredMotion, Response, build_response
from crosscheck.identification.responses.wide_response import WideResponse, compute_wide_response
from crosscheck.identification.settings import ANGLES, RATES, AngleTable, IdentifyTable, RateTable
from flexinv.errors import InputError
from flexinv.typing import Array

# The motion keeps more than the efforts are compared at, so that both sides pass the same low-pass once.
WIDER = 2.5
# A rate is the slope of its angle to this part: quantised angles and delays of some samples change it by less.
SLOPE = 0.2
# At the ends of a log the low-pass knows one side only: so many periods of the bandwidth do not count.
EDGE = 1.5
LEAP = 8.0  # times the usual change: of a smooth effort the largest change is some three times the usual one
HIGHEST = 0.4  # of the sampling rate: no filter above


@dataclass(frozen=True)
class Run:
    """A log made ready.

    time : (samples,) [s] of the log; motion : of the measured joints; response : of the mechanism alone
    measured : (samples, channels) [units of the channels], low-passed; None without effort columns
    sliding, counted : (samples, channels) the joint is not standing; it is, and inside the window
    wide : of each channel its response above the bandwidth; None of gauges, and where the log has no room for one
    load : link that carries the payload of this log, "" if none does
    """

    name: str
    time: Array
    motion: MeasuredMotion
    response: Response
    measured: Array | None
    sliding: NDArray[np.bool_]
    counted: NDArray[np.bool_]
    wide: tuple[WideResponse | None, ...] = ()
    load: str = ""


def compute_measured_motion(machine: Machine, log: Log) -> MeasuredMotion:
    """Return the motion of the measured joints [rad], [m], low-passed without delay and differentiated by splines.

    Raises InputError: a column missing, constant numbers where every joint stands, angles in degrees that are said to be radians.
    """
    settings = machine.settings
    time = log.time - log.time[0]
    bandwidth = min(settings.motion_Hz or WIDER * settings.bandwidth_Hz, HIGHEST / log.spacing)
    if settings.bandwidth_Hz > HIGHEST / log.spacing:
        raise InputError(
            f"{log.name}: sampled at {1 / log.spacing:.4g} Hz, too slow for a bandwidth of {settings.bandwidth_Hz:g} Hz; "
            f"write bandwidth_Hz = {0.3 / log.spacing:.3g} or less in identify.toml"
        )
    columns = []
    rates = {}
    for k, (name, table) in enumerate(settings.joints.items()):
        raw = log.read_column(table.angle.column) * (ANGLES[table.angle.unit] / table.angle.over)
        _check_angle(machine, log, name, raw)
        columns.append(low_pass(raw, log.spacing, bandwidth))
        if table.rate is not None:
            rates[k] = low_pass(_read_rate(log, name, table.rate, raw), log.spacing, bandwidth)
    grid = time.tobytes()
    q, qd, qdd = (
        np.column_stack(parts) for parts in zip(*(_fit_splines(grid, c.tobytes()) for c in columns), strict=True)
    )
    for k, rate in rates.items():
        qd[:, k] = rate
        qdd[:, k] = scipy.interpolate.CubicSpline(time, rate)(time, 1)
    return MeasuredMotion(time, tuple(settings.joints), q, qd, qdd, _read_warmth(settings, log))


def _read_warmth(settings: IdentifyTable, log: Log) -> Array | None:
    """The warmth of drives beyond their references (samples, joints) [K]; None where no column says it."""
    tables = [table.temperature for table in settings.joints.values()]
    if not any(tables):
        return None
    none = np.zeros(len(log.time))
    return np.column_stack([none if t is None else log.read_column(t.column) - t.reference_degC for t in tables])


@make_signal_cache(64)
def _fit_splines(grid: bytes, values: bytes) -> tuple[Array, Array, Array]:
    """A spline through samples at times of a grid [s], and its first and second derivatives there (samples,) each."""
    time = np.frombuffer(grid)
    spline = scipy.interpolate.CubicSpline(time, np.frombuffer(values))
    return spline(time), spline(time, 1), spline(time, 2)


def _read_rate(log: Log, name: str, table: RateTable, angle: Array) -> Array:
    """The rate [rad/s], [m/s] of a joint that a column states; it has to be the slope of the angle (samples,)."""
    rate = log.read_column(table.column) * (RATES[table.unit] / table.over)
    slope = np.gradient(angle, log.spacing)
    size = float(rate @ slope) / float(slope @ slope)
    if abs(size - 1.0) > SLOPE:
        raise InputError(
            f"{log.name}: column {table.column!r} of joint {name} is {size:.4g} times the slope of its angle, expected 1; "
            f"write its unit ({', '.join(RATES)}) or over = the gear ratio into [joints.{name}] rate, or leave rate away"
        )
    return rate


def _check_angle(machine: Machine, log: Log, name: str, raw: Array) -> None:
    table = machine.settings.joints[name].angle
    _check_wraps(log, name, table, raw)
    if table.unit == "rad" and np.ptp(raw) > 20.0 * np.pi and np.abs(np.gradient(raw, log.spacing)).max() > 60.0:
        raise InputError(
            f"{log.name}: column {table.column!r} of joint {name} goes over {np.ptp(raw):.4g} rad at up to "
            f"{np.abs(np.gradient(raw, log.spacing)).max():.3g} rad/s, expected an angle in rad; "
            f'write unit = "deg" in [joints.{name}] angle if it is in degrees, or over = the gear ratio if it is the motor\'s'
        )


def _check_wraps(log: Log, name: str, table: AngleTable, raw: Array) -> None:
    """Raise InputError where an angle (samples,) [rad], [m] of a joint begins anew at the end of an encoder's range."""
    column = raw * table.over
    wraps = [
        (k, period) for k in find_jumps(column) if (period := find_wrap_period(column, k, table.unit in ("rad", "deg")))
    ]
    if wraps:
        k, period = wraps[0]
        size = abs(column[k + 1] - column[k]) / ANGLES[table.unit]
        raise InputError(
            f"{log.name}: column {table.column!r} of joint {name} leaps by {size:.4g} {table.unit} at {log.time[k + 1]:g} s "
            f"({len(wraps)} times in all), as an encoder does at the end of its range, expected an angle that goes on; "
            f"unwrap the column (numpy.unwrap(column, period={period / ANGLES[table.unit]:.4g})), or cut the log there"
        )


def make_run(machine: Machine, log: Log, efforts: bool = True, once: bool = False, load: str = "") -> Run:
    """Return a log made ready [s, rad, N m]; without ``efforts`` no column of an effort or a gauge is looked at.

    once : its response is asked for at one set of values; load : as `Run` has it
    """
    settings = machine.settings
    motion = compute_measured_motion(machine, log)
    sliding = np.column_stack(
        [
            np.abs(compute_channel_rate(machine, motion, c)) > settings.still_rad_per_s
            if has_friction(machine, c)
            else np.ones(len(log.time), dtype=bool)
            for c in machine.channels
        ]
    )
    window = _find_window_samples(settings, log)
    edge = EDGE / settings.bandwidth_Hz
    window &= (motion.time >= edge) & (motion.time <= motion.time[-1] - edge)
    measured = read_measured_channels(machine, log) if efforts else None
    counted = sliding & window[:, None]
    if efforts and len(log.pauses):
        counted &= ~find_unseen_leaps(machine, log)
    response = build_response(machine.mechanism, machine.space, settings, motion, once)
    wide = compute_wide_responses(machine, log) if efforts else ()
    return Run(log.name, log.time, motion, response, measured, sliding, counted, wide, load)


def find_unseen_leaps(machine: Machine, log: Log) -> NDArray[np.bool_]:
    """Return the samples (samples, channels) [-] near a leap of an effort that fell into a pause of an uneven log.

    Dry friction turns round in one step: where that sample is missing nobody knows when, and a spline makes it up.  A leap is
    `LEAP` times what the effort usually changes by in as many samples; what the low-pass spreads of it does not count.
    """
    out = np.zeros((len(log.time), len(machine.channels)), dtype=bool)
    reach = EDGE / machine.settings.bandwidth_Hz
    first = np.clip(np.searchsorted(log.time, log.pauses[:, 0] + 1e-9) - 1, 0, len(log.time) - 1)
    last = np.clip(np.searchsorted(log.time, log.pauses[:, 1] - 1e-9), 0, len(log.time) - 1)
    for c, channel in enumerate(machine.channels):
        values = log.read_column(channel.column)
        for start, end in zip(first, last, strict=True):
            usual = float(np.median(np.abs(values[end - start :] - values[: len(values) - (end - start)])))
            if has_friction(machine, channel) and abs(values[end] - values[start]) > LEAP * usual:
                out[:, c] |= (log.time > log.time[start] - reach) & (log.time < log.time[end] + reach)
    return out


def _find_window_samples(settings: IdentifyTable, log: Log) -> NDArray[np.bool_]:
    if settings.window_s is None:
        return np.ones(len(log.time), dtype=bool)
    return np.asarray((log.time >= settings.window_s[0] - 1e-9) & (log.time <= settings.window_s[1] + 1e-9))


def compute_wide_responses(machine: Machine, log: Log, only: int | None = None) -> tuple[WideResponse | None, ...]:
    """Return the response of every effort to its joint's acceleration above the bandwidth [units of the channels].

    only : of this channel, and None for the others
    """
    window = _find_window_samples(machine.settings, log)
    out: list[WideResponse | None] = []
    for c, channel in enumerate(machine.channels):
        asked = has_friction(machine, channel) and only in (None, c)
        table = machine.settings.joints[channel.place].angle if asked else None
        if table is None:
            out.append(None)
            continue
        angle = log.read_column(table.column)[window] * (ANGLES[table.unit] / table.over)
        effort = log.read_column(channel.column)[window] * channel.factor
        out.append(compute_wide_response(angle, effort, log.spacing, machine.settings.bandwidth_Hz))
    return tuple(out)


def read_measured_channels(machine: Machine, log: Log) -> Array:
    """Return the efforts and gauges of a log (samples, channels) [units of the channels], low-passed.  Raises InputError."""
    columns = []
    for channel in machine.channels:
        raw = log.read_column(channel.column) * channel.factor
        if np.ptp(raw) == 0.0:
            raise InputError(
                f"{log.name}: column {channel.column!r} is constant ({raw[0]:g}), expected what {channel.name} measured; "
                "remove the effort from identify.toml, or export the right column"
            )
        columns.append(raw if channel.sense == "gauge" else low_pass(raw, log.spacing, machine.settings.bandwidth_Hz))
    return np.column_stack(columns)


def compute_readings(machine: Machine, run: Run, values: Mapping[Key, float]) -> Array:
    """Return the expected readings (samples, channels) [units of the channels]."""
    return apply_bandwidth(machine, run, compute_raw_signals(machine, run.motion, run.response, values))


def apply_bandwidth(machine: Machine, run: Run, raw: Array) -> Array:
    """Return raw signals (samples, channels) [units of the channels], or differences of them, as readings are: low-passed."""
    return apply_bandwidth_to_all(machine, run, [raw])[0]


def apply_bandwidth_to_all(machine: Machine, run: Run, raw: Sequence[Array]) -> list[Array]:
    """Return several sets of raw signals, (samples, channels) each [units of the channels], as `apply_bandwidth` does one."""
    spacing = float(run.motion.time[1] - run.motion.time[0])
    passed = [k for k, channel in enumerate(machine.channels) if channel.sense != "gauge"]
    out = [one.copy() for one in raw]
    if passed:
        together = np.hstack([one[:, passed] for one in raw])
        parts = np.split(apply_low_pass_all(together, spacing, machine.settings.bandwidth_Hz), len(out), axis=1)
        for one, part in zip(out, parts, strict=True):
            one[:, passed] = part
    return out


def compute_raw_signals(
    machine: Machine, motion: MeasuredMotion, respond: Response, values: Mapping[Key, float]
) -> Array:
    """Return the raw signals of the sensors, before any low-pass of ours (samples, channels) [units of the channels]."""
    alone, moment, points = respond(values)
    effort = convert_to_motor_efforts(machine, motion, alone, values)
    spacing = float(motion.time[1] - motion.time[0])
    places = [(one.kind, one.place) for one in list_point_sensors(machine.settings)]
    columns = []
    for channel in machine.channels:
        if channel.sense == "effort":
            at = motion.names.index(channel.place)
            drive_effort = effort[:, at] + compute_loaded_drive_effort(
                machine, motion, channel.place, alone[:, at], values
            )
            offset = resolve_value(machine, values, "effort offset", channel.place)
            columns.append(
                _apply_sensor(
                    machine, channel, drive_effort / channel.ratio + offset / channel.constant, values, spacing
                )
            )
        elif channel.sense == "gauge":
            columns.append(_compute_gauge_signal(machine, motion, channel, moment, values, spacing))
        else:
            signal = points[:, places.index((channel.sense, channel.place))]
            zero = resolve_value(machine, values, f"{channel.sense} zero", channel.place)
            columns.append(_apply_sensor(machine, channel, signal, values, spacing) + zero)
    return np.column_stack(columns)


def _apply_sensor(
    machine: Machine, channel: Channel, signal: Array, values: Mapping[Key, float], spacing: float
) -> Array:
    """A signal (samples,) [any unit] through what every sensor may have: lag, delay, gain."""
    lag_s, delay, gain = (
        resolve_value(machine, values, f"{channel.sense} {k}", channel.place) for k in ("lag", "delay", "gain")
    )
    return gain * apply_delay(apply_first_order_lag(signal, spacing, lag_s), spacing, delay)


def _compute_gauge_signal(
    machine: Machine,
    motion: MeasuredMotion,
    channel: Channel,
    moment: Array,
    values: Mapping[Key, float],
    spacing: float,
) -> Array:
    table = machine.settings.gauges[channel.place]
    bent = (
        compute_gauge_flexibility(machine, channel.place)
        * moment[:, list(machine.settings.gauges).index(channel.place)]
    )
    told = _apply_sensor(machine, channel, bent, values, spacing) + resolve_value(
        machine, values, "gauge zero", channel.place
    )
    if table.slope_joint:
        at = motion.names.index(table.slope_joint)
        told = told + resolve_value(machine, values, "gauge slope", channel.place) * motion.q[:, at]
    return apply_lag(told, spacing, table.lag_Hz, table.lag_damping) if table.lag_Hz else told


def compute_gauge_flexibility(machine: Machine, gauge: str) -> float:
    """Return signed ``L / (3 EI)`` of a gauge's beam [rad/(N m)], of a strain ``h / EI`` [1/(N m)], by its table or the beam."""
    table = machine.settings.gauges[gauge]
    if table.flexibility_rad_per_Nm is not None:
        return table.sign * table.flexibility_rad_per_Nm
    link = machine.mechanism.link_of.get(table.beam)
    if link is None or link.beam is None:
        raise InputError(
            f"identify.toml, gauges.{gauge}: {table.beam!r} is no beam of {machine.mechanism.name}; "
            "write flexibility_rad_per_Nm, what the rig makes of a moment"
        )
    section = link.beam.section
    # 1 / EI with no stress but the moment, whatever bending is coupled with
    coupled = section.has_coupled_strains
    across = np.linalg.inv(section.stiffness_matrices)[:, 5, 5] if coupled else 1.0 / section.stiffness[:, 5]
    bent = float(np.interp(table.station or 0.0, section.stations, across))
    return table.sign * bent * (link.beam.length / 3.0 if table.height_m is None else table.height_m)


def apply_delay(values: Array, spacing: float, delay: float) -> Array:
    """Return a signal (samples,) [any unit] a delay [s] later, below 0 earlier; its ends stay as they are."""
    if not delay:
        return values
    time = spacing * np.arange(len(values))
    spline = _build_spline(np.asarray(values, dtype=np.float64).tobytes(), spacing)
    return np.asarray(spline(np.clip(time - delay, 0.0, time[-1])))


@make_signal_cache(64)  # many delays of a signal are tried
def _build_spline(values: bytes, spacing: float) -> scipy.interpolate.CubicSpline:
    signal = np.frombuffer(values)
    return scipy.interpolate.CubicSpline(spacing * np.arange(len(signal)), signal)


def apply_first_order_lag(values: Array, spacing: float, constant: float) -> Array:
    """Return a signal (samples,) [any unit] behind a first-order lag [s] that stood still before; exact for linear pieces."""
    if constant <= 0.0:
        return values
    b, a = _build_first_order_filter(spacing, constant)
    return np.asarray(scipy.signal.lfilter(b, a, values, zi=[values[0] * (1.0 - b[0])])[0])


def remove_first_order_lag(values: Array, spacing: float, constant: float) -> Array:
    """Return the signal (samples,) [any unit] of which `apply_first_order_lag` makes ``values``."""
    if constant <= 0.0:
        return values
    b, a = _build_first_order_filter(spacing, constant)
    return np.asarray(
        scipy.signal.lfilter(np.array(a) / b[0], [1.0, b[1] / b[0]], values, zi=[values[0] * (1.0 - 1.0 / b[0])])[0]
    )


def _build_first_order_filter(spacing: float, constant: float) -> tuple[list[float], list[float]]:
    """Numerator and denominator of a first-order lag [s] of what is linear between samples [s]."""
    r = spacing / constant
    e = float(np.exp(-r))
    return [1.0 - (1.0 - e) / r, (1.0 - e) / r - e], [1.0, -e]
