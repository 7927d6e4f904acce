"""Faults that put an effort of a known shape into one channel: of each family the shape by which the cost falls most.

    effort_j + phi s(spot),   drop(spot) = (s . r)^2 / (s . s)    of s less what the parameters can make up for

Shapes over time (a zero that jumps or settles, an oscillation), over the angle (friction of a bent shaft, an end
stop), of friction (stiction, square of the rate) and of the sensor's own curve.  A spot is when, how fast or where.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from crosscheck.identification.causes.cause import Cause, apply_to_column
from crosscheck.identification.causes.rounds import CauseRound
from crosscheck.identification.drives.efforts import compute_friction
from crosscheck.identification.drives.ripples import compute_order_drops
from crosscheck.identification.filters import apply_low_pass_all
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Channel, Machine, has_friction, resolve_value
from crosscheck.identification.parameters import Values
from crosscheck.identification.readings import compute_measured_motion
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

COARSE = 48  # spots of a family, and as many around the best
EDGE = 0.05  # of the samples that count have to lie on either side of a step
SHORTEST = 0.05  # of a log: the shortest time in which a zero settles
SLOWEST = 2.0  # periods of an oscillation in a log, at least
STEPS = 4  # frequencies in the distance at which two are told apart
SLOWER = (1.5, 150.0)  # rates of stiction, in the rate below which a joint stands
WAY = (0.02, 0.7)  # of a joint's way that lies behind an end stop
REPEATED = 4  # undoing of a curve by its own values
QUARTER = np.pi / 2.0  # [rad] by which the other wave is later that tells the phase together with the best one
TINY = 1e-300


@dataclass(frozen=True)
class Known:
    """A log as shapes need it: time (samples,) [s], angle and rate of a joint, its effort as logged [unit of the channel].

    counted : (counted,) times that count [s]; friction : (samples,) [N m], [N] by parameters of the joint that are another
    """

    time: Array
    counted: Array
    angle: Array
    rate: Array
    effort: Array
    friction: Callable[[dict[str, float]], Array]
    still: float
    bandwidth: float


Shape = Callable[[Known, float], Array]


@dataclass(frozen=True)
class Family:
    """A family of shapes: its name, with the spot in words, its unit over that of the joint's effort, spots that are looked at.

    make : the shape at a spot (samples,) [1 / unit], in the unit of the joint's effort
    turned : the shape a quarter of a period later, which is told together with it; of_sensor : in the unit of the channel
    refined : the best spot is looked for between those beside it; least : the least size
    of_turns : of joints that turn alone
    """

    name: str
    said: str
    unit: str
    spots: Callable[[Known], Array]
    make: Shape
    turned: Shape | None = None
    of_sensor: bool = False
    refined: bool = True
    least: float = -np.inf
    of_turns: bool = False


def _list_none(known: Known) -> Array:
    return np.zeros(1)


def _list_instants(known: Known) -> Array:
    return np.asarray(np.quantile(known.counted, np.linspace(EDGE, 1.0 - EDGE, COARSE)))


def _list_settling_times(known: Known) -> Array:
    whole = float(known.time[-1] - known.time[0])
    return np.geomspace(SHORTEST * whole, whole, COARSE // 2)


def _list_frequencies(known: Known) -> Array:
    apart = 1.0 / float(known.time[-1] - known.time[0])
    return np.arange(SLOWEST * apart, known.bandwidth, apart / STEPS)


def _list_rates(known: Known) -> Array:
    return known.still * np.geomspace(*SLOWER, COARSE // 4)


def _list_stops(known: Known) -> Array:
    """Ways behind a stop (spots,) [rad], [m]: of the upper end, and below 0 of the lower one."""
    ways = float(np.ptp(known.angle)) * np.linspace(*WAY, COARSE // 2)
    return np.concatenate([-ways[::-1], ways])


def _make_stop(known: Known, way: float) -> Array:
    past = known.angle - ((known.angle.max() if way > 0.0 else known.angle.min()) - way)
    return np.asarray(np.maximum(past, 0.0) if way > 0.0 else np.minimum(past, 0.0))


def _compute_sense(known: Known) -> Array:
    return np.asarray(np.tanh(known.rate / known.still))


def _make_friction(kind: str, known: Known, spot: float) -> Array:
    """Friction per unit of one of its parameters (samples,) [N m], [N], which is linear in it."""
    others = {"stribeck rate": spot} if kind == "stribeck share" else {}
    return np.asarray(known.friction(others | {kind: 1.0}) - known.friction(others | {kind: 0.0}))


def _list_over_time() -> Iterator[Family]:
    yield Family(
        "step of the effort",
        ", at {:.3g} s",
        "",
        _list_instants,
        lambda k, s: np.where(k.time >= s, 1.0, 0.0),
        of_sensor=True,
    )
    yield Family(
        "settling of the effort's zero",
        ", within {:.2g} s",
        "",
        _list_settling_times,
        lambda k, s: np.exp(-(k.time - k.time[0]) / s),
        of_sensor=True,
    )
    yield Family(
        "oscillation of the effort",
        ", {:.4g} Hz",
        "",
        _list_frequencies,
        lambda k, s: np.sin(2.0 * np.pi * s * k.time),
        lambda k, s: np.cos(2.0 * np.pi * s * k.time),
        of_sensor=True,
    )


def _list_over_angle() -> Iterator[Family]:
    yield Family(
        "dry friction that changes with the angle, 1 a turn",
        "",
        "",
        _list_none,
        lambda k, s: np.sin(k.angle) * _compute_sense(k),
        lambda k, s: np.cos(k.angle) * _compute_sense(k),
        of_turns=True,
    )
    yield Family("end stop", ", on the last {:.2g}", "/rad", _list_stops, _make_stop, least=0.0)


def _list_of_friction() -> Iterator[Family]:
    for kind, name, said, unit, spots, least in (
        ("stribeck share", "stiction", ", below {:.2g} rad/s", "-", _list_rates, 0.0),
        ("quadratic friction", "quadratic friction", "", " s^2/rad^2", _list_none, -np.inf),
    ):
        yield Family(f"{name} beside what is known", said, unit, spots, partial(_make_friction, kind), least=least)


def _compute_top(known: Known) -> float:
    return float(np.abs(known.effort).max()) + TINY


def _list_of_sensor() -> Iterator[Family]:
    """Curves of a sensor or an amplifier, by the largest effort that is logged."""
    curves: tuple[tuple[str, str, float, Shape], ...] = (
        ("saturation of the effort, relative", "-", -np.inf, lambda k, s: k.effort * (k.effort / _compute_top(k)) ** 2),
        ("curvature of the effort's sensor, relative", "-", -np.inf, lambda k, s: k.effort**2 / _compute_top(k)),
        ("gain of positive efforts alone, relative error", "-", -np.inf, lambda k, s: np.maximum(k.effort, 0.0)),
        ("dead band of the effort", "", 0.0, lambda k, s: -np.sign(k.effort)),
    )
    for name, unit, least, make in curves:
        yield Family(name, "", unit, _list_none, make, of_sensor=True, least=least)


FAMILIES = (*_list_over_time(), *_list_over_angle(), *_list_of_friction(), *_list_of_sensor())


def list_shape_causes(here: CauseRound, values: Values, noisy: Collection[int]) -> Iterator[Cause]:
    """Yield of each family the shape that takes away most of an effort, for channels of which more is left than noise.

    values : of the parameters [unit of each]; noisy : numbers of those channels
    """
    machine = here.search.machine
    left = here.compute_weighed_residual(here.at)
    for c in noisy:
        channel = machine.channels[c]
        if not has_friction(machine, channel):
            continue
        known = _collect_known(machine, channel, values, here.log)
        known = replace(known, counted=known.time[here.task.chosen[0][:, c]])
        slides = machine.mechanism.joint_of[channel.place].kind == "prismatic"
        for family in FAMILIES:
            if slides and family.of_turns:
                continue
            spot, phase = _find_best_spot(here, c, left, family, known)
            for turn in (0.0, QUARTER) if family.turned else (0.0,):
                yield _make_shape_cause(_FoundShape(machine, channel, values, family, spot, phase + turn))


def _collect_known(machine: Machine, channel: Channel, values: Values, log: Log) -> Known:
    motion = compute_measured_motion(machine, log)
    at = motion.names.index(channel.place)
    rate = motion.qd[:, at]

    def compute_changed(others: dict[str, float]) -> Array:
        changed = dict(values) | {(kind, channel.place): value for kind, value in others.items()}
        return compute_friction(machine, channel.place, rate, changed)

    still = resolve_value(machine, values, "transition rate", channel.place)
    effort = log.read_column(channel.column) * channel.factor
    return Known(
        motion.time, motion.time, motion.q[:, at], rate, effort, compute_changed, still, machine.settings.bandwidth_Hz
    )


def _find_best_spot(here: CauseRound, c: int, left: Array, family: Family, known: Known) -> tuple[float, float]:
    """The spot [-] and the phase [rad] by which the cost of channel c falls most; left : (rows,) weighed residual."""
    spots = family.spots(known)
    drop, sizes = _compute_spot_drops(here, c, left, family, known, spots)
    best = int(np.argmax(drop))
    if family.refined and len(spots) > 1:
        spots = np.linspace(spots[max(best - 1, 0)], spots[min(best + 1, len(spots) - 1)], COARSE)
        spots = spots[spots != 0.0]
        drop, sizes = _compute_spot_drops(here, c, left, family, known, spots)
        best = int(np.argmax(drop))
    return float(spots[best]), float(np.arctan2(sizes[best, 1], sizes[best, 0])) if family.turned else 0.0


def _compute_spot_drops(
    here: CauseRound, c: int, left: Array, family: Family, known: Known, spots: Array
) -> tuple[Array, Array]:
    """By how much the cost falls (spots,) [-], and sizes of the shape and of that a quarter later (spots, 2) [unit]."""
    run = here.task.runs[0]
    every = here.task.every[0]
    chosen = here.task.chosen[0][::every, c]
    rows = slice(here.ends[c] - int(chosen.sum()), here.ends[c])
    basis = here.basis[rows]
    second = family.turned or (lambda k, s: np.zeros(len(k.time)))
    shapes = np.column_stack([make(known, float(s)) for s in spots for make in (family.make, second)])
    passed = apply_low_pass_all(shapes, float(run.time[1] - run.time[0]), known.bandwidth)
    x = here.weight[c] * passed[::every][chosen]
    size = np.sqrt(np.maximum(np.sum(x * x, axis=0), TINY))
    drop, sizes = compute_order_drops(x / size, left[rows], basis, np.eye(basis.shape[1]))
    return drop, sizes / size.reshape(-1, 2)


@dataclass(frozen=True)
class _FoundShape:
    """A shape of a family at its best spot and phase [rad], and the channel whose effort has it."""

    machine: Machine
    channel: Channel
    values: Values
    family: Family
    spot: float
    phase: float

    def remove(self, log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        """Return the log without phi times the shape; one of the effort itself is told by the effort that is left."""
        family = self.family
        channel = self.channel
        known = _collect_known(self.machine, channel, self.values, log)
        wave = [(np.cos(self.phase), family.make)] + ([(np.sin(self.phase), family.turned)] if family.turned else [])
        more = np.zeros(len(known.time))
        for _ in range(REPEATED if family.of_sensor else 1):
            left = replace(known, effort=known.effort - phi * more)
            more = np.sum([part * make(left, self.spot) for part, make in wave], axis=0)
        less = phi * more / (channel.factor * (1.0 if family.of_sensor else channel.ratio))
        return apply_to_column(log, channel.column, lambda v: v - less), mechanism


def _make_shape_cause(found: _FoundShape) -> Cause:
    family = found.family
    channel = found.channel
    of_joint = "N" if found.machine.mechanism.joint_of[channel.place].kind == "prismatic" else "N m"
    unit = "-" if family.unit == "-" else (channel.unit if family.of_sensor else of_joint) + family.unit
    name = family.name + family.said.format(abs(found.spot))
    if of_joint == "N":
        unit, name = (text.replace("rad", "m") for text in (unit, name))
    usual = Cause(name, channel.place, unit, 1e-3, found.remove, False, rare=True, least=family.least)
    return replace(usual, kin=f"{name} {channel.place} {found.phase:g}", wave=True) if family.turned else usual
