"""Mistakes in what is done with an engine's output, and in the motion that it is given: units, columns, filters, time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, filtfilt, lfilter

from campaigns.beyond import motions
from campaigns.beyond.fault import ALL, CorrectAnswer, Fault, FaultScenario, RecipeTopic, draw_one
from crosscheck.measures.record import Record, Series
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism
from flexinv.model.track import find_law
from flexinv.typing import Array

CHAPTER = RecipeTopic("signals and time")
POUND_FOOT = 1.3558179483314004  # N m
KILOPOND = 9.80665  # N
Change = Callable[[Array], Array]


def make_effort_change(names: tuple[str, ...] | None, change: Change) -> Callable[[Record, Mechanism, Case], Record]:
    """Return a change of a record's efforts of some joints (None: of all), (samples,) [N m] or [N]."""

    def update_record(record: Record, mechanism: Mechanism, case: Case) -> Record:
        return replace(record, series=replace_efforts(record.series, names, change))

    return update_record


def replace_efforts(series: Mapping[str, Series], names: tuple[str, ...] | None, change: Change) -> dict[str, Series]:
    """Return the series with the efforts of some joints changed."""
    wanted = None if names is None else {f"torque/{name}" for name in names}
    return {
        n: replace(s, values=change(s.values)) if s.quantity == "torque" and (wanted is None or n in wanted) else s
        for n, s in series.items()
    }


def _list_effort_names(scenario: FaultScenario) -> list[str]:
    """Velocity names with an effort that is more than rounding beside the largest."""
    peaks = {n: float(np.abs(s.values).max()) for n, s in scenario.reference.series.items() if s.quantity == "torque"}
    return [n.removeprefix("torque/") for n, peak in peaks.items() if peak > 1e-6 * max(peaks.values())]


def _list_place_names(scenario: FaultScenario) -> tuple[str, ...]:
    """Places of what befalls all efforts: "all", and the only one, where there is one."""
    names = _list_effort_names(scenario)
    return (ALL, *(names if len(names) == 1 else ()))


def _make_signal_fault(scenario: FaultScenario, words: str, kinds: tuple[str, ...], change: Change) -> Fault:
    near = (CorrectAnswer(("filter", "time shift", "step", "effort scale", "derivative", "noise")),)
    return Fault(words, ((CorrectAnswer(kinds, ()),),), near, record=make_effort_change(None, change))


@CHAPTER("effort of a joint", 1 + 1e-13, 1.002, 1.02, 1.3, 1 / POUND_FOOT, 0.01, 1000.0)
def make_effort_scale_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The effort of one joint is in another unit, or on the motor's side of its gear."""
    if (name := draw_one(rng, _list_effort_names(scenario))) is None:
        return None
    alone = (ALL,) if len(_list_effort_names(scenario)) == 1 else ()
    return Fault(
        f"effort of {name} x{size:.5g}",
        ((CorrectAnswer(("effort scale", "gear ratio"), (name, *alone)),),),
        (),
        record=make_effort_change((name,), lambda tau: tau * size),
    )


@CHAPTER("all efforts", 1 + 1e-13, 1.002, 1.02, 1 / POUND_FOOT, 1 / KILOPOND, 1000.0, -1.0)
def make_all_efforts_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """All efforts are in another unit, by a factor of calibration, or of the other sign."""
    kind = ("effort sign",) if size < 0.0 else ("effort scale", "gear ratio")
    return Fault(
        f"all efforts x{size:.5g}",
        ((CorrectAnswer(kind, _list_place_names(scenario)),),),
        (CorrectAnswer(kind, tuple(_list_effort_names(scenario))),),
        record=make_effort_change(None, lambda tau: tau * size),
    )


@CHAPTER("sign of an effort", -1.0)
def make_effort_sign_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The effort of one joint counts the other way."""
    if (name := draw_one(rng, _list_effort_names(scenario))) is None:
        return None
    return Fault(
        f"effort of {name} of the other sign",
        (
            (
                CorrectAnswer(
                    ("effort sign",),
                    (name, *(_list_place_names(scenario) if len(_list_effort_names(scenario)) == 1 else ())),
                ),
            ),
        ),
        (CorrectAnswer(("effort scale", "axis sign"), (name,)),),
        record=make_effort_change((name,), lambda tau: -tau),
    )


@CHAPTER("columns exchanged", 1.0)
def make_exchanged_columns_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Two columns of efforts are exchanged: another order of joints."""
    names = _list_effort_names(scenario)
    if len(names) < 2:
        return None
    a, b = (f"torque/{names[int(k)]}" for k in rng.choice(len(names), 2, replace=False))

    def update_record(record: Record, mechanism: Mechanism, case: Case) -> Record:
        one = record.series[a]
        two = record.series[b]
        new = {a: replace(one, values=two.values), b: replace(two, values=one.values)}
        return replace(record, series={**record.series, **new})

    at = (a.removeprefix("torque/"), b.removeprefix("torque/"))
    near = (CorrectAnswer(("coordinate order",), at),)
    return Fault(
        f"efforts of {at[0]} and {at[1]} exchanged",
        ((CorrectAnswer(("effort order",), at),),),
        near,
        record=update_record,
    )


@CHAPTER("one column twice", 1.0)
def make_repeated_column_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """One joint's effort was read from another's column."""
    names = _list_effort_names(scenario)
    if len(names) < 2:
        return None
    a, b = (names[int(k)] for k in rng.choice(len(names), 2, replace=False))

    def update_record(record: Record, mechanism: Mechanism, case: Case) -> Record:
        new = replace(record.series[f"torque/{a}"], values=record.series[f"torque/{b}"].values)
        return replace(record, series={**record.series, new.name: new})

    right = (CorrectAnswer(("effort order", "wrong column"), (a, b)),)
    return Fault(
        f"effort of {a} from the column of {b}", (right,), (CorrectAnswer(("coordinate order",)),), record=update_record
    )


@CHAPTER("bias", 1e-13, 0.002, 0.02)
def make_bias_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A sensor's zero: a constant beside one joint's effort, a part of its largest."""
    if (name := draw_one(rng, _list_effort_names(scenario))) is None:
        return None
    more = size * scenario.find_largest_effort(name)
    right = (CorrectAnswer(("effort offset",), (name,)),)
    return Fault(
        f"effort of {name} +{more:.3g}", (right,), (), record=make_effort_change((name,), lambda tau: tau + more)
    )


@CHAPTER("drift", 0.005, 0.05)
def make_drift_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A sensor drifts: a ramp beside one joint's effort."""
    if (name := draw_one(rng, _list_effort_names(scenario))) is None:
        return None
    more = size * scenario.find_largest_effort(name) * scenario.time / scenario.time[-1]
    right = (CorrectAnswer(("drift", "effort offset"), (name,)),)
    return Fault(f"effort of {name} drifts", (right,), (), record=make_effort_change((name,), lambda tau: tau + more))


@CHAPTER("mean taken off", 1.0)
def make_removed_mean_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The means of the efforts were taken off, as an amplifier without DC does."""
    names = _list_effort_names(scenario)
    one = names[0] if len(names) == 1 else ALL
    right = (CorrectAnswer(("effort offset",), (one, *names)),)
    return Fault(
        "means of the efforts taken off", (right,), (), record=make_effort_change(None, lambda tau: tau - tau.mean())
    )


@CHAPTER("samples late", 1.0, 3.0)
def make_late_effort_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The efforts come some samples late: a buffer."""
    n = int(size)
    words = f"efforts {n} samples late"
    return _make_signal_fault(
        scenario, words, ("time shift",), lambda tau: np.concatenate([np.repeat(tau[:1], n), tau[:-n]])
    )


@CHAPTER("half a sample late", 1e-6, 0.1, 0.5)
def make_half_sample_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The efforts are read between two samples."""
    time = scenario.time
    by = size * scenario.case.sample
    return _make_signal_fault(
        scenario, f"efforts {size:.3g} samples late", ("time shift",), lambda tau: np.interp(time - by, time, tau)
    )


@CHAPTER("motion late", 1e-6, 0.2, 2.0)
def make_late_motion_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The motion begins late by some samples."""
    by = size * scenario.case.sample
    return Fault(
        f"motion {by:.3g} s late",
        ((CorrectAnswer(("time shift",)),),),
        (CorrectAnswer(("motion", "step")),),
        case=lambda m, c: motions.replace_time(c, lambda t: t - by),
    )


@CHAPTER("motion faster", 1 + 1e-7, 1.005, 1.05)
def make_duration_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The motion takes less time: another duration, or a clock that is off."""
    return Fault(
        f"motion x{size:.5g} as fast",
        ((CorrectAnswer(("motion", "time scale")),),),
        (CorrectAnswer(("time shift",)),),
        case=lambda m, c: motions.replace_time(c, lambda t: t * size, size),
    )


@CHAPTER("another law", 1.0)
def make_motion_law_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The same move by another time law."""
    track = scenario.case.motion.tracks[0]
    name = next((n for n in ("quintic", "cycloid") if n != getattr(track, "law", "")), "")
    if getattr(track, "sampling", None) is not None or not getattr(track, "law", "") or track.law == "bang-bang":
        return None
    find_law(name)
    tracks = tuple(replace(t, law=name) for t in scenario.case.motion.tracks)
    return Fault(
        f"motion by {name}",
        ((CorrectAnswer(("motion",)),),),
        (CorrectAnswer(("time shift", "time scale")),),
        case=lambda m, c: replace(c, motion=replace(c.motion, tracks=tracks)),
    )


@CHAPTER("differences", 1.0, 0.0)
def make_differences_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Rates and accelerations by differences of sampled angles instead of exact ones."""
    if not scenario.rigid or scenario.closed or scenario.engine == "exudyn-dae":
        return None
    sample = scenario.case.sample
    word = "backward" if size else "central"
    return Fault(
        f"rates and accelerations by {word} differences",
        ((CorrectAnswer(("derivative",)),),),
        (CorrectAnswer(("time shift", "filter", "step", "motion")),),
        case=lambda m, c: motions.replace_by_differences(c, sample, bool(size)),
    )


@CHAPTER("rates or accelerations missing", 0.0, 1.0)
def make_missing_rates_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The rates (or the accelerations) were not passed on to the inverse dynamics."""
    if not scenario.rigid or scenario.closed or scenario.engine == "exudyn-dae":
        return None
    rates = bool(size)
    return Fault(
        "rates are zero" if rates else "accelerations are zero",
        ((CorrectAnswer(("velocity terms",) if rates else ("acceleration terms", "derivative")),),),
        (CorrectAnswer(("derivative", "viscous", "dry friction")),),
        case=lambda m, c: motions.replace_motion(
            c, lambda _, q, qd, qdd: (q, np.zeros_like(qd) if rates else qd, qdd if rates else np.zeros_like(qdd))
        ),
    )


def _compute_low_pass(scenario: FaultScenario, part: float) -> tuple[Array, Array]:
    """Coefficients of a first-order low-pass whose time constant is a part of the case's length."""
    pole = float(np.exp(-scenario.case.sample / (part * scenario.case.end)))
    return np.array([1.0 - pole]), np.array([1.0, -pole])


@CHAPTER("low-pass", 1e-4, 0.005, 0.03)
def make_low_pass_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The efforts went through a sensor's filter of first order."""
    b, a = _compute_low_pass(scenario, size)

    def compute_filtered_effort(tau: Array) -> Array:
        return np.asarray(lfilter(b, a, tau - tau[0]) + tau[0])

    return _make_signal_fault(
        scenario, f"low-pass of {size * scenario.case.end:.3g} s", ("filter",), compute_filtered_effort
    )


@CHAPTER("zero-phase filter", 0.4, 0.1)
def make_zero_phase_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The efforts were smoothed forward and backward by a Butterworth filter."""
    b, a = butter(2, size)
    return _make_signal_fault(
        scenario, f"Butterworth at {size} of Nyquist", ("filter",), lambda tau: np.asarray(filtfilt(b, a, tau))
    )


@CHAPTER("moving average", 3, 7)
def make_moving_average_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The efforts were averaged over some samples."""
    n = int(size)
    return _make_signal_fault(
        scenario, f"moving average of {n}", ("filter",), lambda tau: np.asarray(uniform_filter1d(tau, n))
    )


@CHAPTER("coarse samples", 2, 5)
def make_resampling_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Every few samples only were stored; the others lie on lines between them, or are held."""
    n = int(size)
    hold = bool(rng.integers(2))

    def compute_resampled_effort(tau: Array) -> Array:
        k = np.arange(tau.size)
        return tau[k - k % n] if hold else np.asarray(np.interp(k, k[::n], tau[::n]))

    kinds = ("resampling", "filter", *(("time shift",) if hold else ()))
    return _make_signal_fault(
        scenario, f"every {n} samples, {'held' if hold else 'joined'}", kinds, compute_resampled_effort
    )


@CHAPTER("quantised", 16, 12, 8)
def make_quantisation_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The efforts went through a converter of some bits."""
    top = max(scenario.find_largest_effort(name) for name in _list_effort_names(scenario))
    lsb = 2.0 * top / 2 ** int(size)
    return _make_signal_fault(
        scenario, f"{int(size)} bits", ("quantisation", "noise"), lambda tau: np.round(tau / lsb) * lsb
    )


@CHAPTER("saturated", 0.98, 0.8)
def make_saturation_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The efforts stop at an actuator's limit."""
    if (name := draw_one(rng, _list_effort_names(scenario))) is None:
        return None
    top = size * scenario.find_largest_effort(name)
    right = (CorrectAnswer(("saturation",), (name, *_list_place_names(scenario))),)
    near = (CorrectAnswer(("effort scale",), (name,)),)
    return Fault(
        f"effort of {name} stops at {top:.3g}",
        (right,),
        near,
        record=make_effort_change((name,), lambda tau: tau.clip(-top, top)),
    )


@CHAPTER("outliers", 0.02, 0.5)
def make_outlier_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Single samples are far off."""
    if (name := draw_one(rng, _list_effort_names(scenario))) is None:
        return None
    at = rng.choice(scenario.time.size, 3, replace=False)
    more = np.zeros(scenario.time.size)
    more[at] = size * scenario.find_largest_effort(name)
    right = (CorrectAnswer(("outliers", "noise"), (name, ALL)),)
    return Fault(f"3 outliers in {name}", (right,), (), record=make_effort_change((name,), lambda tau: tau + more))


@CHAPTER("dropped samples", 3, 10)
def make_dropped_samples_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Some samples in a row were lost; the last value stands for them."""
    n = int(size)
    at = int(rng.integers(1, scenario.time.size - n))

    def compute_held_effort(tau: Array) -> Array:
        out = tau.copy()
        out[at : at + n] = tau[at - 1]
        return out

    return _make_signal_fault(scenario, f"{n} samples lost", ("outliers", "dropped samples"), compute_held_effort)


class Noise:
    """White noise that is never the same twice, of a seed."""

    def __init__(self, seed: int, size: float) -> None:
        """size : standard deviation over the largest effort [-]."""
        self.rng = np.random.default_rng(seed)
        self.size = size

    def __call__(self, tau: Array) -> Array:
        """Return the signal with noise [unit of the signal]."""
        return tau + self.size * float(np.abs(tau).max()) * self.rng.normal(size=tau.shape)


@CHAPTER("noise of the output", 1e-15, 1e-6, 1e-3, 0.016)
def make_noise_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """White noise on the efforts, another one every time the engine is asked."""
    change = Noise(int(rng.integers(2**31)), size)
    return _make_signal_fault(scenario, f"noise of {size:.3g}", ("noise",), change)


@CHAPTER("noise inside", 1e-6, 1e-3, 0.016)
def make_inner_noise_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """White noise on the efforts of every single run of an engine that refines itself: its runs do not agree any more."""
    if not scenario.engine.startswith("exudyn-"):
        return None
    change = Noise(int(rng.integers(2**31)), size)
    return Fault(
        f"noise of {size:.3g} in every run",
        ((CorrectAnswer(("noise",)),),),
        (CorrectAnswer(("filter", "step", "mesh")),),
        raw=lambda series: replace_efforts(series, None, change),
    )
