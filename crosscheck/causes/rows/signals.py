"""Causes in signals: what is done to efforts, or to the motion, between an engine and its file.

Efforts are filtered, delayed, held, rounded, cut off or set to zero at the start, all of them on the samples of the case.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise, permutations

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.causes.cause import Cause, Change, compute_effort_range, list_driven_joints, list_global_target
from crosscheck.causes.model import Model, is_tree
from crosscheck.causes.subject import States, Subject
from crosscheck.measures.record import list_effort_units
from flexinv.errors import InputError
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

SHARP = "a motion with sharp changes: what a filter does goes with frequency"
ANY = "any motion, sampled finely"
FIRST = "first order"
SECOND = "second order"
BOTH = "second order, forwards and backwards"
START = "the first sample"
MEAN = "the mean"
HELD = "held"
JOINED = "joined by lines"
EVERY = (2, 3, 4, 5, 8, 10, 20)  # samples
CAUSAL = "before"
CENTRED = "around"
WIDTHS = (3, 5, 7, 9, 11, 15, 21)  # samples
NEAREST = "to the nearest"
DOWN = "towards zero"
CUT = 0.05  # of the range of efforts: a limit below that leaves nothing to be seen
GRID = 1e-6  # of a step: what rounding leaves of a multiple
CENTRAL = "central differences"
BACKWARD = "backward differences"
THREE = "central differences of three neighbours"
SPEEDS = ", accelerations alone, from speeds"
# joints up to which every pair is tried; beyond, neighbours only
MANY = 8
FROM = " <- "
AT = ": "


def _make_signal_change(change: Callable[[Array, float, str, Array], Array]) -> Change:
    """Return the change of all efforts (samples, nv) by a size, with the sampling interval [s]."""

    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
            return change(effort, float(states.time[1] - states.time[0]), target, size)

        return subject.add_effort_change(update_effort, dense=True)

    return apply_change


def _move_effort_in_time(effort: Array, spacing: float, target: str, size: Array) -> Array:
    time = spacing * np.arange(len(effort))
    return np.stack([np.interp(time - size[0], time, column) for column in effort.T], axis=1)


def _apply_low_pass(effort: Array, spacing: float, target: str, size: Array) -> Array:
    """Take the time constant [s] of a low-pass of first order, or 1 / (2 pi f_c) of Butterworth's of second order."""
    lag = float(size[0])
    if lag < 0.0:
        raise InputError(f"a time constant of {lag:g} s: expected 0 or more")
    if lag == 0.0:
        return effort
    if target == FIRST:
        part = spacing / (lag + spacing)
        return np.asarray(
            scipy.signal.lfilter([part], [1.0, part - 1.0], effort, axis=0, zi=(1.0 - part) * effort[:1])[0]
        )
    corner = 2.0 * spacing / (2.0 * np.pi * lag)  # of half the sampling frequency
    if not corner < 1.0:
        raise InputError(f"a time constant of {lag:g} s is too short for samples every {spacing:g} s")
    b, a = scipy.signal.butter(2, corner)
    if target == BOTH:
        return np.asarray(scipy.signal.filtfilt(b, a, effort, axis=0))
    return np.asarray(
        scipy.signal.lfilter(b, a, effort, axis=0, zi=scipy.signal.lfilter_zi(b, a)[:, None] * effort[:1])[0]
    )


def _make_joint_signal_change(change: Callable[[Array, float, str, Array], Array]) -> Change:
    """Return the change of one joint's effort; targets are its name, and after AT the way of the change."""

    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        joint, _, way = target.partition(AT)

        def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
            out = effort.copy()
            part = mechanism.v_slices[joint]
            out[:, part] = change(effort[:, part], float(states.time[1] - states.time[0]), way, size)
            return out

        return subject.add_effort_change(update_effort, dense=True)

    return apply_change


def _list_single_joints(model: Model) -> list[str]:
    """Return the driven joints where there are several: of one what is done to all efforts says it."""
    joints = list_driven_joints(model)
    return joints if len(joints) > 1 else []


def _list_joint_filters(model: Model) -> list[str]:
    return [f"{joint}{AT}{way}" for joint in _list_single_joints(model) for way in (FIRST, SECOND, BOTH)]


def _apply_single_precision(subject: Subject, target: str, size: Array) -> Subject:
    return subject.add_effort_change(lambda mechanism, states, effort: effort.astype(np.float32).astype(np.float64))


def _compute_time_scale(model: Model, target: str) -> float:
    return 10.0 * model.base.case.sample


def _list_averages(model: Model) -> list[str]:
    return [f"{width} {where}" for width in WIDTHS for where in (CAUSAL, CENTRED)]


def _apply_moving_average(effort: Array, spacing: float, target: str, size: Array) -> Array:
    width = int(target.split()[0])
    where = target.split()[1]
    behind, ahead = (width - 1, 0) if where == CAUSAL else (width // 2, width // 2)
    padded = np.concatenate([np.repeat(effort[:1], behind, 0), effort, np.repeat(effort[-1:], ahead, 0)])
    total = np.cumsum(np.concatenate([np.zeros((1, effort.shape[1])), padded]), axis=0)
    return np.asarray((total[width:] - total[:-width]) / width)


def _list_sampling_rates(model: Model) -> list[str]:
    return [f"{count} {how}" for count in EVERY for how in (HELD, JOINED)]


def _sample_coarsely(effort: Array, spacing: float, target: str, size: Array) -> Array:
    count = int(target.split(" ", 1)[0])
    how = target.split(" ", 1)[1]
    rows = np.arange(len(effort))
    if how == HELD:
        return np.asarray(effort[rows // count * count])
    known = rows[::count]
    return np.stack([np.interp(rows, known, column[known]) for column in effort.T], axis=1)


def _apply_quantisation(subject: Subject, target: str, size: Array) -> Subject:
    step = float(size[0])

    def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
        if step <= 0.0:
            return effort
        cut = np.round(effort / step) if target == NEAREST else np.trunc(effort / step)
        return np.asarray(cut * step)

    return subject.add_effort_change(update_effort)


def _list_roundings(model: Model) -> list[str]:
    return [NEAREST, DOWN]


def _find_quantisation_step(model: Model, target: str, seen: Array) -> Sequence[Array]:
    """Return the step of which all efforts (samples, nv) are multiples, if there is one: the smallest between two of them."""
    values = np.unique(np.abs(seen[np.abs(seen) > 0.0]))
    if len(values) < 2:
        return []
    apart = np.diff(values)
    apart = apart[apart > GRID * values[-1]]
    step = float(apart.min()) if apart.size else float(values[-1])
    whole_numbers = values / step
    if float(np.abs(whole_numbers - np.round(whole_numbers)).max()) > GRID * max(1.0, float(whole_numbers.max())):
        return []
    # All of them together know the step better than two of them.
    return [np.array([float((values @ np.round(whole_numbers)) / (np.round(whole_numbers) @ np.round(whole_numbers)))])]


def _find_largest_range(model: Model, target: str) -> float:
    return float(model.scale.max())


def _apply_saturation(subject: Subject, target: str, size: Array) -> Subject:
    most = float(size[0])

    def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
        if most <= 0.0:
            return effort
        out = effort.copy()
        part = mechanism.v_slices[target] if target else slice(None)
        out[:, part] = np.clip(out[:, part], -most, most)
        return out

    return subject.add_effort_change(update_effort)


def _list_places(model: Model) -> list[str]:
    return ["", *list_driven_joints(model)] if len(list_driven_joints(model)) > 1 else list_driven_joints(model)


def _find_effort_limit(model: Model, target: str, seen: Array) -> Sequence[Array]:
    """Return the largest effort (samples, nv) that an engine gave, if it gave it more than once."""
    part = model.base.mechanism.v_slices[target] if target else slice(None)
    values = np.abs(seen[:, part])
    most = float(values.max(initial=0.0))
    often = int((values >= most * (1.0 - GRID)).sum())
    # An engine that gives next to nothing is not cut off: it predicts none of what it does give.
    return [np.array([most])] if often > 1 and most > CUT * _compute_effort_scale(model, target) else []


def _compute_effort_scale(model: Model, target: str) -> float:
    return compute_effort_range(model, target) if target else _find_largest_range(model, target)


def _remove_effort_offset(effort: Array, spacing: float, target: str, size: Array) -> Array:
    return np.asarray(effort - (effort[:1] if target == START else effort.mean(axis=0)))


def _add_drift(subject: Subject, target: str, size: Array) -> Subject:
    end = subject.case.end

    def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
        out = effort.copy()
        part = mechanism.v_slices[target] if target else slice(None)
        out[:, part] += float(size[0]) * states.time[:, None] / end
        return out

    return subject.add_effort_change(update_effort)


def _list_column_pairs(model: Model) -> list[str]:
    """Return "a <- b" for joints of one coordinate and one unit whose efforts are not the same."""
    mechanism = model.base.mechanism
    units = dict(zip(mechanism.velocity_names, list_effort_units(mechanism), strict=True))
    names = [n for n in list_driven_joints(model) if mechanism.joint_of[n].nv == 1]
    pairs = permutations(names, 2) if len(names) <= MANY else pairwise(names)
    return [f"{a}{FROM}{b}" for a, b in pairs if units[a] == units[b]]


def _copy_column(subject: Subject, target: str, size: Array) -> Subject:
    a, b = target.split(FROM)

    def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
        out = effort.copy()
        out[:, mechanism.v_slices[a]] = effort[:, mechanism.v_slices[b]]
        return out

    return subject.add_effort_change(update_effort)


def _apply_differences(subject: Subject, target: str, size: Array) -> Subject:
    """Take speeds from places, and accelerations from those, by differences over the samples of the case."""
    inner = subject.case.motion
    spacing = subject.case.sample
    last = subject.case.end
    central = target.startswith(CENTRAL)

    def update_states(mechanism: Mechanism, states: States) -> States:
        def evaluate_position(time: Array) -> Array:
            return inner.evaluate(mechanism, time)[0]

        def evaluate_speed(time: Array) -> Array:
            return (
                inner.evaluate(mechanism, time)[1]
                if target.endswith(SPEEDS)
                else compute_slope(evaluate_position, time)
            )

        def compute_slope(of: Callable[[Array], Array], time: Array) -> Array:
            ahead = np.minimum(time + spacing, last) if central else time
            behind = np.maximum(time - spacing, 0.0)
            span = np.where(ahead > behind, ahead - behind, 1.0)[:, None]
            return np.asarray((of(ahead) - of(behind)) / span)

        time = states.time
        inside = np.clip(time, spacing, last - spacing)
        second = (
            evaluate_position(inside + spacing) - 2.0 * evaluate_position(inside) + evaluate_position(inside - spacing)
        )
        qdd = second / spacing**2 if target == THREE else compute_slope(evaluate_speed, time)
        return replace(states, qd=evaluate_speed(time), qdd=qdd)

    return subject.add_state_change(update_states)


def _list_difference_ways(model: Model) -> list[str]:
    moving = is_tree(model.base) and model.states.qd.any()
    simple = all(j.nv == j.nq == 1 for j in model.base.mechanism.joints if j.nv)
    ways = [CENTRAL, BACKWARD, THREE, CENTRAL + SPEEDS, BACKWARD + SPEEDS]
    return ways if moving and simple else []


ROWS = (
    Cause(
        "efforts late",
        "all efforts come late by {size} (a delay of the signal, not of the motion)",
        _make_signal_change(_move_effort_in_time),
        list_global_target,
        scale=_compute_time_scale,
        unit="s",
        shows=SHARP,
    ),
    Cause(
        "effort of a joint late",
        "the effort of {target} comes late by {size} (a delay of its signal)",
        _make_joint_signal_change(_move_effort_in_time),
        _list_single_joints,
        scale=_compute_time_scale,
        unit="s",
        shows=SHARP,
    ),
    Cause(
        "low-pass filter",
        "all efforts passed a low-pass filter ({target}) of the time constant {size}",
        _make_signal_change(_apply_low_pass),
        lambda model: [FIRST, SECOND, BOTH],
        scale=_compute_time_scale,
        unit="s",
        shows=SHARP,
    ),
    Cause(
        "low-pass filter of a joint",
        "the effort of one joint passed a low-pass filter ({target}) of the time constant {size}",
        _make_joint_signal_change(_apply_low_pass),
        _list_joint_filters,
        scale=_compute_time_scale,
        unit="s",
        shows=SHARP,
    ),
    Cause(
        "moving average",
        "all efforts are averages over samples: {target}",
        _make_signal_change(_apply_moving_average),
        _list_averages,
        0,
        shows=SHARP,
    ),
    Cause(
        "resampled",
        "of the efforts only every few samples are kept, the others are filled in: {target}",
        _make_signal_change(_sample_coarsely),
        _list_sampling_rates,
        0,
        shows=ANY,
    ),
    Cause(
        "quantisation",
        "all efforts are rounded {target}, to multiples of {size}",
        _apply_quantisation,
        _list_roundings,
        scale=_find_largest_range,
        unit="N m or N",
        shows=ANY,
        guess=_find_quantisation_step,
    ),
    Cause(
        "single precision",
        "all efforts are rounded to single precision",
        _apply_single_precision,
        parameters=0,
        shows=ANY,
    ),
    Cause(
        "saturation",
        "efforts ({target}) are cut off at {size}",
        _apply_saturation,
        _list_places,
        scale=_compute_effort_scale,
        unit="N m or N",
        shows="a motion with larger efforts",
        guess=_find_effort_limit,
    ),
    Cause(
        "effort offset taken off",
        "of all efforts {target} is taken off",
        _make_signal_change(_remove_effort_offset),
        lambda model: [START, MEAN],
        0,
        shows="a start from another place",
    ),
    Cause(
        "drift",
        "efforts ({target}) drift, by {size} over the case",
        _add_drift,
        _list_places,
        scale=_compute_effort_scale,
        unit="N m or N",
        shows="a rest at the end",
    ),
    Cause(
        "column given twice",
        "the effort of one joint is that of another: {target}",
        _copy_column,
        _list_column_pairs,
        0,
        shows="one joint moved at a time",
    ),
    Cause(
        "differentiated motion",
        "speeds and accelerations come from places by {target} over the samples",
        _apply_differences,
        _list_difference_ways,
        0,
        shows=ANY,
    ),
)
