"""Report about drives: laws of friction with their evidence, reversals, what follows angles, and coupled motors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosscheck.identification.drives.couplings import MotorCoupling, find_couplings
from crosscheck.identification.drives.efforts import compute_channel_rate
from crosscheck.identification.drives.evidence import Terms, build_terms, solve_terms
from crosscheck.identification.drives.friction_laws import FrictionTerm, choose_friction_laws, join_chosen_terms
from crosscheck.identification.drives.ripples import Ripple, RippleScan, find_ripples
from crosscheck.identification.figures import LogFigure
from crosscheck.identification.identify import Identification
from crosscheck.identification.machine import Channel, has_friction
from crosscheck.identification.parameters import Values
from crosscheck.identification.readings import Run, apply_bandwidth, compute_raw_signals
from crosscheck.report.words import format_short
from crosscheck.verdicts.study_table import Line, SideTable
from flexinv.typing import Array

NEAR = 1.0  # periods of the bandwidth around a reversal: what the low-pass spreads of it
BINS = 60  # points of a curve over rate or angle
SAMPLES = 8  # of a point, at least
FEW = 3  # of a point, in either sense
POINTS = 800  # of a curve over orders that are drawn
FRICTION = (
    *("viscous friction", "coulomb friction", "friction asymmetry", "load friction", "quadratic friction"),
    *("stribeck share", "stribeck rate", "transition rate"),
    *("viscous friction per kelvin", "coulomb friction per kelvin"),
)
ABSENT = ("viscous friction", "coulomb friction", "friction asymmetry", "load friction", "quadratic friction")


@dataclass(frozen=True)
class Reversals:
    """Reversals of a joint: how many, and the RMS error near them and elsewhere [unit]."""

    joint: str
    count: int
    near: float
    elsewhere: float
    unit: str


@dataclass(frozen=True)
class DriveReport:
    """Findings about drives: terms of friction, reversals, ripples by order, couplings.

    terms : the residuals that they are told by
    """

    terms: Terms
    laws: list[FrictionTerm]
    reversals: list[Reversals]
    scans: list[RippleScan]
    couplings: list[MotorCoupling]

    @property
    def ripples(self) -> list[Ripple]:
        """All ripples, joint by joint [unit of each]."""
        return [one for scan in self.scans for one in scan.found]


def find_drive_report(identification: Identification) -> DriveReport:
    """Return the findings of the logs that identified about friction, angles and couplings of drives [unit of each]."""
    terms = build_terms(identification.task, identification.days)
    laws = choose_friction_laws(terms)
    reversals = list(_list_reversals(identification))
    return DriveReport(terms, laws, reversals, find_ripples(terms), find_couplings(terms))


def _list_reversals(identification: Identification) -> Iterator[Reversals]:
    machine = identification.machine
    for c, channel in enumerate(machine.channels):
        if not has_friction(machine, channel):
            continue
        count = 0
        parts: dict[bool, list[Array]] = {True: [], False: []}
        for run, told in identification.shown:
            assert run.measured is not None
            at = _find_reversal_times(run, compute_channel_rate(machine, run.motion, channel), run.sliding[:, c])
            count += len(at)
            reach = NEAR / machine.settings.bandwidth_Hz
            near = (np.abs(run.time[:, None] - at) < reach).any(axis=1)
            for side in (True, False):
                rows = run.counted[:, c] & (near == side)
                parts[side].append((run.measured - told.value)[rows, c])
        rms = {side: _compute_rms(np.concatenate(some)) for side, some in parts.items()}
        yield Reversals(channel.place, count, rms[True], rms[False], channel.unit)


def _compute_rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _find_reversal_times(run: Run, rate: Array, slides: NDArray[np.bool_]) -> Array:
    """Times [s] at which a joint that slid one way begins to slide the other way."""
    moving = np.flatnonzero(slides)
    turns = np.flatnonzero(np.diff(np.sign(rate[moving])) != 0.0)
    return run.time[moving[turns + 1]]


# ------------------------------------------------------------------------------------------------------------- tables


def build_drive_tables(report: DriveReport) -> list[SideTable]:
    """Return the tables of the page about drives [unit of each]."""
    return [_build_law_table(report), _build_ripple_table(report), _build_reversal_table(report)]


def list_drive_words(report: DriveReport) -> Iterator[str]:
    """Yield in words what of drives identify.toml should say, and what follows angles [unit of each]."""
    yield from (one.words for one in report.couplings)
    for one in report.laws:
        if one.chosen and not one.free:
            size = f"{format_short(one.size)} {one.unit}".removesuffix(" -")
            yield (
                f"friction of {one.joint}: the logs speak for a term that is not free, {one.term} ({one.kind}), of "
                f'{size}: {one.words}; write friction = "evidence" into identify.toml, or the table '
                f'[[free]] with parameter = "{one.kind}"'
            )
    for ripple in report.ripples:
        yield (
            f"effort of {ripple.joint}: {format_short(ripple.amplitude)} {ripple.unit} come and go with the angle, {ripple.words}"
        )


def _build_law_table(report: DriveReport) -> SideTable:
    rows: list[Line] = [
        {
            "joint": one.joint,
            "term": one.term,
            "size": one.size,
            "unit": one.unit,
            "gain": one.evidence.gain,
            "error": one.evidence.error,
            "verdict": _describe_choice(one),
        }
        for one in report.laws
    ]
    columns = [
        ("joint", "joint", ""), ("term", "beside Coulomb and viscous", ""), ("size", "size", "unit"), ("unit", "unit", ""),
        ("gain", "gain of parts left out", "-"), ("error", "standard error", "-"), ("verdict", "the logs", ""),
    ]  # fmt: skip
    return {"title": "Friction: which law the logs speak for", "columns": columns, "rows": rows}


def _describe_choice(one: FrictionTerm) -> str:
    if one.free:
        return "tell it: it is free" if one.chosen else "do not need it: it is free"
    return "speak for it" if one.chosen else "do not need it"


def _build_ripple_table(report: DriveReport) -> SideTable:
    rows: list[Line] = [
        {
            "joint": one.joint,
            "order": one.order,
            "error": one.error,
            "motor": one.order / one.ratio if one.ratio else None,
            "amplitude": one.amplitude,
            "unit": one.unit,
            "gain": one.evidence.gain,
            "words": one.words,
        }
        for one in report.ripples
    ]
    columns = [
        ("joint", "joint", ""), ("order", "periods a turn of the joint", ""), ("error", "standard error", ""),
        ("motor", "periods a turn of the motor", ""), ("amplitude", "amplitude", "unit"), ("unit", "unit", ""),
        ("gain", "gain of parts left out", "-"), ("words", "what turns so", ""),
    ]  # fmt: skip
    return {"title": "Ripple: what follows the angle", "columns": columns, "rows": rows}


def _build_reversal_table(report: DriveReport) -> SideTable:
    rows: list[Line] = [
        {
            "joint": one.joint,
            "count": one.count,
            "near": one.near if np.isfinite(one.near) else None,
            "elsewhere": one.elsewhere if np.isfinite(one.elsewhere) else None,
            "unit": one.unit,
        }
        for one in report.reversals
    ]
    columns = [
        ("joint", "joint", ""), ("count", "reversals", ""), ("near", "RMS error near them", "unit"),
        ("elsewhere", "RMS error elsewhere", "unit"), ("unit", "unit", ""),
    ]  # fmt: skip
    return {"title": "Reversals", "columns": columns, "rows": rows}


# ------------------------------------------------------------------------------------------------------------ figures


def list_drive_figures(identification: Identification, report: DriveReport) -> Iterator[LogFigure]:
    """Yield friction over rate and what remains over angle of each joint, and over orders where there is a ripple."""
    names = [run.name for run, _ in identification.shown]
    log = names[0] if len(names) == 1 else "all logs"
    for c, channel in enumerate(identification.machine.channels):
        if has_friction(identification.machine, channel):
            yield _build_friction_figure(report, c, log)
        if channel.sense == "effort":
            yield _build_angle_figure(report, c, log)
    for scan in report.scans:
        if scan.found:
            title = f"What remains of {scan.joint}, by order"
            y = f"RMS that an order takes away [{scan.unit}]"
            curves = {scan.joint: scan.amplitudes}
            yield LogFigure(
                log, f"orders {scan.joint}", title, "periods a turn of the joint", y, scan.orders, curves, POINTS
            )


def _build_friction_figure(report: DriveReport, c: int, log: str) -> LogFigure:
    """Friction over rate: what was measured less all else of the model, the law that was fitted, and the one with more terms."""
    terms = report.terms
    channel = terms.machine.channels[c]
    rate = _collect(terms, c, lambda run: compute_channel_rate(terms.machine, run.motion, channel))
    law = _collect(terms, c, lambda run: _compute_law(terms, run, c))
    curves = {"measured": law + terms.residuals[c] / terms.weights[c], "law": law}
    more = [one for one in report.laws if one.joint == channel.place and one.chosen and not one.free]
    if more:
        curves["law with what the logs speak for"] = law + _compute_change(terms, c, more)
    places, means = _compute_means(rate, curves)
    x = f"rate of {channel.place} [{_find_rate_unit(terms, channel)}]"
    title = f"Friction of {channel.place} over rate"
    return LogFigure(log, f"friction {channel.place}", title, x, f"friction [{channel.unit}]", places, means, BINS)


def _build_angle_figure(report: DriveReport, c: int, log: str) -> LogFigure:
    """The residual over angle, by the sense in which the joint moves."""
    terms = report.terms
    channel = terms.machine.channels[c]
    at = terms.task.runs[0].motion.names.index(channel.place)
    angle = _collect(terms, c, lambda run: run.motion.q[:, at])
    rate = _collect(terms, c, lambda run: run.motion.qd[:, at])
    rest = terms.residuals[c] / terms.weights[c]
    edges = _list_edges(angle)
    places = 0.5 * (edges[:-1] + edges[1:])
    means = {}
    for name, rows in (("forward", rate > 0.0), ("backward", rate < 0.0)):
        means[name] = _compute_bin_means(angle[rows], rest[rows], edges)
    there = np.isfinite(list(means.values())).all(axis=0)
    unit = "m" if terms.machine.mechanism.joint_of[channel.place].kind == "prismatic" else "rad"
    title = f"What remains of {channel.place} over its angle"
    curves = {name: values[there] for name, values in means.items()}
    x = f"coordinate of {channel.place} [{unit}]"
    return LogFigure(
        log, f"angle {channel.place}", title, x, f"what remains [{channel.unit}]", places[there], curves, BINS
    )


def _find_rate_unit(terms: Terms, channel: Channel) -> str:
    return "m/s" if terms.machine.mechanism.joint_of[channel.place].kind == "prismatic" else "rad/s"


def _collect(terms: Terms, c: int, signal: object) -> Array:
    """Counted samples (counted,) of a channel of a signal of each run (samples,) [any unit]."""
    channels = len(terms.weights)
    arrays = [np.repeat(signal(run)[:, None], channels, axis=1) for run in terms.task.runs]  # type: ignore[operator]
    return terms.task.collect_counted_samples(arrays)[c]


def _compute_law(terms: Terms, run: Run, c: int) -> Array:
    """Friction that was found, as the sensor of channel c reads it behind the low-pass (samples,) [unit of the channel]."""
    machine = terms.machine
    place = machine.channels[c].place
    values: Values = machine.space.compute_values(terms.z[: len(machine.space.parameters)], run.load)
    none = {(kind, place): 0.0 for kind in ABSENT}
    pair = [compute_raw_signals(machine, run.motion, run.response, one) for one in (values, values | none)]
    return apply_bandwidth(machine, run, pair[0] - pair[1])[:, c]


def _compute_change(terms: Terms, c: int, more: list[FrictionTerm]) -> Array:
    """The change of the law by further terms (counted,) [unit of the channel]: they, and what the other numbers of it become."""
    wider = join_chosen_terms(terms, more)
    change = solve_terms(wider)[0]
    place = terms.machine.channels[c].place
    of_law = [k for k, one in enumerate(terms.machine.space.parameters) if one.place == place and one.kind in FRICTION]
    of_law += range(len(terms.z), len(change))
    return np.asarray(wider.slopes[c][:, of_law] @ change[of_law] / terms.weights[c])


def _list_edges(places: Array) -> Array:
    """Edges (points + 1,) between which as many samples lie, `SAMPLES` at least."""
    points = int(np.clip(len(places) // SAMPLES, 1, BINS))
    return np.quantile(places, np.linspace(0.0, 1.0, points + 1))


def _compute_means(places: Array, curves: dict[str, Array]) -> tuple[Array, dict[str, Array]]:
    """Places (points,), and means of the curves there; where there are samples enough."""
    edges = _list_edges(places)
    means = {name: _compute_bin_means(places, values, edges) for name, values in curves.items()}
    there = np.isfinite(next(iter(means.values())))
    return (0.5 * (edges[:-1] + edges[1:]))[there], {name: values[there] for name, values in means.items()}


def _compute_bin_means(places: Array, values: Array, edges: Array) -> Array:
    """Means of values (samples,) [any unit] between edges (points + 1,); nan where there are less than `FEW`."""
    number = np.clip(np.searchsorted(edges, places, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(number, minlength=len(edges) - 1)
    total = np.bincount(number, values, minlength=len(edges) - 1)
    return np.where(count >= FEW, total / np.maximum(count, 1), np.nan)
