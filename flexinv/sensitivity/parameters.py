"""Parameters by which an inverse dynamics is differentiated: numbers of a mechanism or of a motion, named by where they stand.

| name                                  | the number                                                          |
|---------------------------------------|---------------------------------------------------------------------|
| ``gravity[2]``                        | the third component of the mechanism's gravity                       |
| ``links.forearm.bodies.tool.inertia.mass`` | a field of a record; records in a list by their name or number   |
| ``links.forearm.beam.section.stiffness[0,5]`` | an entry of an array                                          |
| ``joints.elbow.damping``              | a field of a joint                                                  |
| ``motion.elbow[1]``                   | row 1 of the samples of a joint (0 and 1: start and end of a move)    |
| ``motion.duration``                   | the duration of the motion, which is stretched as a whole            |

Whatever else depends on a number is a `Parameter` with a function of it.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from flexinv.errors import InputError, ModelWarning
from flexinv.model.joint_kinds import KINDS
from flexinv.model.links import Inertia
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.model.motion import Motion
from flexinv.model.track import SNAP, Track, evaluate_joint_path, list_joint_columns
from flexinv.typing import Array, Triple
from flexinv.validation import check_number, find_nearest_word, refuse

VariedSetup = tuple[Mechanism, Motion]

VARIED_PART = 2e-3  # of the number: 1e-16 of the sixth power are left out, and three digits are lost
# Numbers below the first, in their own unit, are varied as if they were as large, where that can be, or as the second: most of
# what they do is linear, and a digit of a place, times an axial stiffness, is much of a force.
SMALLEST_VARIED = (0.25, 0.05)
JERK_STEP = 1e-3  # of the duration: four of the sixteen digits of accelerations are lost
# Weights of f(p + k s) over s: exact for polynomials of degree six, of degree two, and of degree four.
CENTRAL = {-3: -1 / 60, -2: 9 / 60, -1: -45 / 60, 1: 45 / 60, 2: -9 / 60, 3: 1 / 60}
TWO_SIDED = {-1: -0.5, 1: 0.5}
FORWARD = {0: -25 / 12, 1: 4.0, 2: -3.0, 3: 4 / 3, 4: -1 / 4}
# Weights at the same places, exact for polynomials of two degrees less and of one.
LOWER = {
    tuple(CENTRAL): {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12},
    tuple(FORWARD): {0: -11 / 6, 1: 3.0, 2: -1.5, 3: 1 / 3},
}

_PART = re.compile(r"(?P<name>[^.\[\]]+)(\[(?P<index>[\d,\s]+)\])?(\.|$)")


@dataclass(frozen=True)
class Parameter:
    """A number on which a mechanism or a motion depends.

    value : where it stands [its own unit]; make : value -> the mechanism, the motion, or both as a tuple
    """

    name: str
    value: float
    make: Callable[[float], Mechanism | Motion | VariedSetup]

    def __post_init__(self) -> None:
        """Raise InputError for a name that is no text, a value that is no number [any unit], and what is no function."""
        if not isinstance(self.name, str) or not self.name:
            refuse("name", self.name, "a text that names the parameter", "'payload'")
        object.__setattr__(self, "value", check_number("value", self.value, "a finite number"))
        if isinstance(self.make, type) or not callable(self.make):
            refuse("make", self.make, "a function of the value that returns a Mechanism, a Motion or a tuple of both")

    def build_setup(self, mechanism: Mechanism, motion: Motion, value: float) -> VariedSetup:
        """Return the mechanism and the motion at a value [any unit].  Raises InputError for another result."""
        made = self.make(value)
        if isinstance(made, Mechanism):
            return made, motion
        if isinstance(made, Motion):
            return mechanism, made
        if (
            isinstance(made, tuple)
            and len(made) == 2
            and isinstance(made[0], Mechanism)
            and isinstance(made[1], Motion)
        ):
            return made
        raise InputError(
            f"parameter {self.name!r}: its function returns {type(made).__name__}; expected a Mechanism, a Motion, or a tuple "
            "of both"
        )


@dataclass(frozen=True)
class RowParameter(Parameter):
    """A number in the rows of a motion, of which a joint with one coordinate is a sum of parts.

    track : number of the motion's track; joint : name; row : of its samples
    """

    track: int
    joint: str
    row: int


@dataclass(frozen=True)
class StretchParameter(Parameter):
    """The duration of a motion, which is stretched as a whole."""


@dataclass(frozen=True)
class ParameterVariation:
    """Setups beside the present one: what to multiply a result at each by, summed up it is the derivative [1/unit].

    offsets : by how much the parameter is another in each of them [its unit]
    None where the motion itself has a derivative (`evaluate_rows`, `evaluate_stretch`).
    """

    weights: tuple[float, ...]
    setups: tuple[VariedSetup, ...]
    offsets: tuple[float, ...]
    changes_mechanism: bool

    def join_results(self, results: Iterable[Any]) -> Any:
        """Return the derivative [any unit] from the results at the setups."""
        return sum(weight * result for weight, result in zip(self.weights, results, strict=True))

    def take_lower_order(self) -> ParameterVariation:
        """Return the same setups with weights [1/unit] of a lower order; both differ by what is left out, or more."""
        step = min(offset for offset in self.offsets if offset > 0.0)
        places = tuple(round(offset / step) for offset in self.offsets)
        weights = LOWER[places]
        return replace(self, weights=tuple(weights.get(place, 0.0) / step for place in places))


def build_variation(parameter: Parameter, mechanism: Mechanism, motion: Motion) -> ParameterVariation:
    """Return the setups by which a parameter is varied [1/unit], none for one of a motion.  Raises InputError."""
    if isinstance(parameter, RowParameter | StretchParameter):
        return ParameterVariation((), (), (), False)
    return build_differences(parameter, mechanism, motion)


def build_differences(
    parameter: Parameter,
    mechanism: Mechanism,
    motion: Motion,
    part: float = 1.0,
    central: Mapping[int, float] = CENTRAL,
) -> ParameterVariation:
    """Return the setups of central differences [1/unit], or of one-sided ones where numbers below cannot be.

    part : of the usual change [-]; central : weights of the central differences
    Raises InputError where neither side can be.
    """
    large, small = (part * VARIED_PART * max(abs(parameter.value), size) for size in SMALLEST_VARIED)
    try:
        weights, setups, offsets = _build_setups(parameter, mechanism, motion, large, central)
    except InputError:
        try:
            weights, setups, offsets = _build_setups(parameter, mechanism, motion, small, central)
        except InputError:
            weights, setups, offsets = _build_setups(parameter, mechanism, motion, small, FORWARD)
    changes = any(one is not mechanism and one != mechanism for one, _ in setups)
    if not changes and all(one is motion or one == motion for _, one in setups):
        warnings.warn(
            f"by: nothing depends on parameter {parameter.name!r}: mechanism and motion are the same at {parameter.value:g} and "
            "beside it",
            ModelWarning,
            stacklevel=2,
        )
    return ParameterVariation(weights, setups, offsets, changes)


def _build_setups(
    parameter: Parameter, mechanism: Mechanism, motion: Motion, step: float, weights: Mapping[int, float]
) -> tuple[tuple[float, ...], tuple[VariedSetup, ...], tuple[float, ...]]:
    setups = [parameter.build_setup(mechanism, motion, parameter.value + k * step) for k in weights]
    return tuple(weight / step for weight in weights.values()), tuple(setups), tuple(k * step for k in weights)


def resolve_parameters(
    by: str | Parameter | Iterable[str | Parameter], mechanism: Mechanism, motion: Motion
) -> tuple[Parameter, ...]:
    """Return the parameters [any unit] of names and parameters; raises InputError for what is none, and for one there twice."""
    given = [by] if isinstance(by, str | Parameter) or not isinstance(by, Iterable) else list(by)
    if not given:
        raise InputError("by: expected at least one parameter, for example by=['motion.duration']")
    found = [_resolve_parameter(one, mechanism, motion) for one in given]
    names = Counter(parameter.name for parameter in found)
    for name, count in names.items():
        if count > 1:
            raise InputError(f"by: parameter {name!r} is there twice; expected each once")
    return tuple(found)


def _resolve_parameter(given: object, mechanism: Mechanism, motion: Motion) -> Parameter:
    if isinstance(given, Parameter):
        return given
    if not isinstance(given, str):
        raise InputError(f"by: {given!r}: expected a name, as 'joints.elbow.damping', or a Parameter")
    parts = _split_name(given)
    if parts[0][0] == "motion":
        return _find_motion_parameter(given, parts[1:], mechanism, motion)
    value = _read_number(mechanism, parts, given)
    return Parameter(given, value, lambda new: _replace_number(mechanism, parts, new))


NamePart = tuple[str, tuple[int, ...]]


def _split_name(name: str) -> list[NamePart]:
    """The parts of a name and their indices; InputError for what is none."""
    parts: list[NamePart] = []
    at = 0
    while at < len(name):
        found = _PART.match(name, at)
        if found is None:
            raise InputError(f"by: {name!r}: expected parts with points between, as 'links.forearm.beam.length'")
        index = found["index"]
        parts.append((found["name"], () if index is None else tuple(int(k) for k in index.split(","))))
        at = found.end()
    if not parts:
        raise InputError("by: a name of nothing; expected one as 'gravity[2]'")
    return parts


# ------------------------------------------------------------------------------------------ numbers of a mechanism


def _read_number(record: Any, parts: list[NamePart], name: str) -> float:
    """The number that a name stands for; InputError with what there is instead."""
    value = record
    for k, (part, index) in enumerate(parts):
        value = _take_part(value, part, name)
        if value is None:
            raise InputError(f"by: {name!r}: there is no {part} there")
        if index:
            value = _take_entry(value, part, index, name)
        if k < len(parts) - 1 and not (is_dataclass(value) or isinstance(value, tuple)):
            raise InputError(f"by: {name!r}: {part} has no parts; expected the name to end there")
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"by: {name!r} is no number{_list_parts(value)}")
    return float(value)


def _take_entry(value: Any, part: str, index: tuple[int, ...], name: str) -> float:
    """The entry of an array; InputError where there is none."""
    if not isinstance(value, np.ndarray):
        raise InputError(f"by: {name!r}: {part} is no array; leave [...] out")
    if len(index) != value.ndim or any(i >= n for i, n in zip(index, value.shape, strict=True)):
        raise InputError(f"by: {name!r}: {part} has shape {value.shape}; expected an index of {value.ndim} within it")
    return float(value[index])


def _list_parts(value: Any) -> str:
    """Words that say what a name may go on with."""
    if isinstance(value, np.ndarray):
        return f"; it is an array of shape {value.shape}: write an index, as [{','.join('0' * value.ndim)}]"
    if isinstance(value, tuple):
        names = ", ".join(str(getattr(one, "name", k)) for k, one in enumerate(value))
        return f"; it is a list: go on with one of {names or 'nothing, it is empty'}"
    if is_dataclass(value):
        return f"; go on with one of {', '.join(field.name for field in fields(value))}"
    return ""


def _take_part(value: Any, part: str, name: str) -> Any:
    """A field of a record, or a record of a list by its name or number."""
    if isinstance(value, tuple):
        return value[_find_place(value, part, name)]
    names = [field.name for field in fields(value)]
    if part not in names:
        like = find_nearest_word(part, names)
        hint = f"; write {like!r}" if like else ""
        raise InputError(
            f"by: {name!r}: {type(value).__name__} has no {part!r}, expected one of {', '.join(names)}{hint}"
        )
    return getattr(value, part)


def _find_place(records: tuple[Any, ...], part: str, name: str) -> int:
    names = [str(getattr(one, "name", "")) for one in records]
    if part in names:
        return names.index(part)
    if part.isdigit() and int(part) < len(records):
        return int(part)
    raise InputError(f"by: {name!r}: there is no {part!r}{_list_parts(records)}")


def _replace_number(record: Any, parts: list[NamePart], number: float) -> Any:
    """The record with another number in the place of a name."""
    part, index = parts[0]
    rest = parts[1:]
    if isinstance(record, tuple):
        place = _find_place(record, part, part)
        changed = _replace_number(record[place], rest, number)
        return (*record[:place], changed, *record[place + 1 :])
    value = getattr(record, part)
    if rest:
        value = _replace_number(value, rest, number)
    elif index:
        value = np.array(value, dtype=float)
        value[index] = number
        if part == "tensor" or value.ndim == 3:  # symmetric: it has this number twice
            value[(*index[:-2], index[-1], index[-2])] = number
    else:
        value = number
    if isinstance(record, Inertia):
        return record.replace_unchecked(**{part: value})
    return replace(record, **{part: value})


# ---------------------------------------------------------------------------------------------- numbers of a motion


def _find_motion_parameter(name: str, parts: list[NamePart], mechanism: Mechanism, motion: Motion) -> Parameter:
    """The parameter of a motion; InputError for a name that is none."""
    if len(parts) != 1 or type(motion) is not Motion:
        raise _make_motion_error(name, mechanism, motion)
    part, index = parts[0]
    if part == "duration" and not index:
        scale_duration(motion, 1.0)  # what cannot be stretched says so
        return StretchParameter(
            name, motion.duration, lambda duration: scale_duration(motion, duration / motion.duration)
        )
    for number, track in enumerate(motion.tracks):
        for joint, columns in list_joint_columns(mechanism, track):
            if joint.name == part:
                return _find_row(name, motion, number, joint, columns, index)
    raise _make_motion_error(name, mechanism, motion)


def _make_motion_error(name: str, mechanism: Mechanism, motion: Motion) -> InputError:
    """The error that names what there is."""
    known = ", ".join(motion.joints(mechanism))
    return InputError(
        f"by: {name!r}: expected 'motion.duration', or a joint and a row, as 'motion.NAME[1]', with NAME one of {known}"
    )


def _find_row(
    name: str, motion: Motion, number: int, joint: Joint, columns: slice, index: tuple[int, ...]
) -> Parameter:
    """The parameter of a row of a joint in a track; InputError where there is none."""
    table = motion.tracks[number].values
    rows = len(table)
    wide = columns.stop - columns.start
    place = (*index, 0) if len(index) == 1 and wide == 1 else index
    if len(place) != 2 or place[0] >= rows or place[1] >= wide:
        also = " and a column" if wide > 1 else ""
        raise InputError(
            f"by: {name!r}: joint '{joint.name}' has {rows} rows of {wide}; expected a row from 0 to {rows - 1}{also}"
        )
    entry = place[0], columns.start + place[1]
    make = _make_row_replacement(motion, number, entry)
    if wide == 1 and KINDS[joint.kind].counts_turns:
        return RowParameter(name, float(table[entry]), make, number, joint.name, place[0])
    return Parameter(name, float(table[entry]), make)


def _make_row_replacement(motion: Motion, number: int, place: tuple[int, int]) -> Callable[[float], Motion]:
    """A function of one entry of a track's rows."""

    def replace_row(value: float) -> Motion:
        table = motion.tracks[number].values.copy()
        table[place] = value
        track = replace(motion.tracks[number], values=table)
        return replace(motion, tracks=(*motion.tracks[:number], track, *motion.tracks[number + 1 :]))

    return replace_row


def scale_duration(motion: Motion, factor: float) -> Motion:
    """Return the motion at ``factor`` times its times [s], rests and samples included; raises InputError for a shaped one."""
    return replace(
        motion,
        tracks=tuple(_scale_track(track, factor) for track in motion.tracks),
        duration=motion.duration * factor,
    )


def _scale_track(track: Track, factor: float) -> Track:
    if track.shaper is not None:
        raise InputError(
            "by: 'motion.duration': the parts of an input shaper have times of their own; stretch what is shaped"
        )
    sampling = track.sampling
    if sampling is not None:
        sampling = replace(sampling, time=sampling.time * factor)
    return replace(track, move=track.move * factor, delay=track.delay * factor, sampling=sampling)


def evaluate_rows(motion: Motion, mechanism: Mechanism, rows: Sequence[RowParameter], time: Array) -> Triple:
    """Return the derivatives (samples, rows) of place, rate and acceleration by rows of one joint in one track [-], [1/s].

    A joint with one coordinate is a sum of its rows, each times a function of time: that of a row is the path of a unit there.
    """
    track = motion.tracks[rows[0].track]
    joint = mechanism.joint_of[rows[0].joint]
    units = np.eye(len(track.values))[:, [parameter.row for parameter in rows]]
    at_end = np.abs(time - motion.duration) <= SNAP * motion.duration
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # of paths that stop abruptly, as those of single rows may
        return evaluate_joint_path(track, joint, units, time, at_end)


def evaluate_stretch(motion: Motion, mechanism: Mechanism, time: Array) -> Triple:
    """Return the derivatives (samples, nv) of place, rate and acceleration by the duration T of a motion [rad/s], [m/s].

        dq/dT = -t/T v        dv/dT = -(v + t a)/T        da/dT = -(2 a + t j)/T        v, a, j : rate, acceleration, jerk

    Where the jerk jumps it is that before, which a longer motion has there.
    """
    _, rate, acceleration = motion.evaluate(mechanism, time)
    part = (time / motion.duration)[:, None]
    over = 1.0 / motion.duration
    jerk = compute_jerk(motion, mechanism, time)
    return -part * rate, -over * rate - part * acceleration, -2.0 * over * acceleration - part * jerk


def compute_jerk(motion: Motion, mechanism: Mechanism, time: Array) -> Array:
    """Return the jerk (samples, nv) [rad/s^3], [m/s^3]: of five accelerations each, all from one smooth piece of the motion."""
    breaks = np.unique([0.0, *motion.breaks, motion.duration])
    piece = np.clip(np.searchsorted(breaks, time, side="left"), 1, len(breaks) - 1)
    first = breaks[piece - 1]
    last = breaks[piece]
    step = np.minimum(JERK_STEP * motion.duration, (last - first) / 8)
    middle = np.clip(time, first + 2 * step, last - 2 * step)
    at = (time - middle) / step  # from -2 to 2
    out = np.zeros((len(time), mechanism.nv))
    for place, slope in zip(range(-2, 3), _list_slopes(at), strict=True):
        acceleration = motion.evaluate(mechanism, middle + place * step)[2]
        out += (slope / step)[:, None] * acceleration
    out[(time > motion.duration) | (time < 0.0)] = 0.0
    return out


def _list_slopes(x: Array) -> list[Array]:
    """The slopes of Lagrange's polynomials on -2, -1, 0, 1, 2 at some places x."""
    return [
        (4 * x**3 - 6 * x**2 - 2 * x + 2) / 24,
        -(4 * x**3 - 3 * x**2 - 8 * x + 4) / 6,
        (4 * x**3 - 10 * x) / 4,
        -(4 * x**3 + 3 * x**2 - 8 * x - 4) / 6,
        (4 * x**3 + 6 * x**2 - 2 * x - 2) / 24,
    ]
