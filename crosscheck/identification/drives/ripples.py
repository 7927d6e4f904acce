"""Ripples: efforts that come and go with the angle of a joint, named by their order, periods a turn.

    effort_j = a sin(n q_j) + b cos(n q_j),   drop(n) = g^T S^-1 g

g, S : pull and information of a and b, less what the parameters can make up for.  Over a way Q of a joint orders are told apart
by 2 pi / Q, and the order of the largest drop is known to (12 / drop)^0.5 / Q: the bound of Cramer and Rao for a sine in noise.
What the low-pass lets through of an order depends on the rate: it is part of the columns.  A ripple is named where parts of the
logs that were left out are told better by it (`evidence`), and by more than the best of so many orders is by chance.

One or two periods a turn of the motor are an eccentric shaft or pulley and the two lobes of a harmonic drive's wave generator;
one and two a turn of the joint an eccentric or oval bearing or flexspline; others teeth of gears and belts, or the motor's poles.

Sources: D. Rife, R. Boorstyn, "Single-tone parameter estimation from discrete-time observations", IEEE Trans. Information
Theory 20 (1974), for the bound; T. Tuttle, W. Seering, "A nonlinear model of a harmonic drive gear transmission", IEEE Trans.
Robotics and Automation 12 (1996), for the orders.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosscheck.identification.drives.evidence import (
    EVIDENCE,
    TermEvidence,
    Terms,
    add_columns,
    compute_channel_columns,
    fill_other_channels,
    judge_term,
    solve_terms,
)
from crosscheck.identification.machine import Channel
from crosscheck.identification.readings import Run
from flexinv.typing import Array

STEPS = 4  # orders that are looked at in the distance at which two are told apart
FEWEST = 2.0  # periods on the way of a joint: of fewer, gravity and friction are no worse a cause
SLOWEST = 0.25  # of the samples are slower than the rate at which an order still passes the low-pass
FINE = 17  # orders around the best one: an eighth of a step is less than its error
TINY = 1e-12  # a way or a rate of a joint that stands
MOST = 3  # ripples of a joint
MOST_ORDERS = 4000  # that are looked at: a long way of a slow joint has more
LARGEST = 1e6  # numbers of waves at a time: all orders together take much memory
LEAST = 1e-12  # of the information of an order that the low-pass lets nothing through of
SURE = 3.0  # standard errors by which an order may miss a whole number
NEAR = 0.02  # of an order: how well it is known at best


@dataclass(frozen=True)
class Ripple:
    """A ripple of an effort: joint, order [1 / turn of the joint] with its standard error, amplitude [unit], what speaks for it.

    ratio : of the gear, 0 where it is not known
    """

    joint: str
    order: float
    error: float
    amplitude: float
    unit: str
    ratio: float
    evidence: TermEvidence

    @property
    def words(self) -> str:
        """The order in words, by what turns so often [-]."""
        if name := _describe_whole(self.order, self.error, "joint"):
            return name
        if self.ratio and (name := _describe_whole(self.order / self.ratio, self.error / self.ratio, "motor")):
            return name
        return f"{self.order:.4g} a turn of the joint: teeth of a gear or belt, or poles of the motor"


@dataclass(frozen=True)
class RippleScan:
    """RMS (orders,) [unit] that orders (orders,) [1 / turn] of a joint take away, each alone, and the ripples found."""

    joint: str
    unit: str
    orders: Array
    amplitudes: Array
    found: tuple[Ripple, ...]


def _describe_whole(order: float, error: float, what: str) -> str:
    """Words for an order that is a whole number of periods a turn of something, "" where it is none."""
    whole = round(order)
    if whole < 1 or whole > 12 or abs(order - whole) > SURE * error + NEAR * whole:
        return ""
    why = {
        ("joint", 1): ": an eccentric bearing or wheel",
        ("joint", 2): ": an oval bearing, or a flexspline that is no circle",
        ("motor", 1): ": an eccentric shaft or pulley",
        ("motor", 2): ": the wave generator of a harmonic drive",
    }.get((what, whole), "")
    times = {1: "once", 2: "twice"}.get(whole, f"{whole} times")
    return f"{times} a turn of the {what}{why}"


def find_ripples(terms: Terms) -> list[RippleScan]:
    """Return of each joint whose effort is measured what orders take away, and its ripples [unit of the channel]."""
    channels = [(c, channel) for c, channel in enumerate(terms.machine.channels) if channel.sense == "effort"]
    turning = [(c, one) for c, one in channels if terms.machine.mechanism.joint_of[one.place].kind != "prismatic"]
    return [scan for c, channel in turning if (scan := _find_joint_ripples(terms, c, channel)) is not None]


def _find_joint_ripples(terms: Terms, c: int, channel: Channel) -> RippleScan | None:
    angle, rate = _collect_way(terms, c)
    orders = list_orders(angle, rate, terms.machine.settings.bandwidth_Hz)
    if not len(orders):
        return None
    here = terms
    found: list[Ripple] = []
    first: Array | None = None
    for _ in range(MOST):
        drop, amplitude = _compute_order_effects(here, c, orders)
        first = amplitude if first is None else first
        fine = list_finer_orders(orders, float(orders[np.argmax(drop)]))
        drop = _compute_order_effects(here, c, fine)[0]
        best = float(fine[np.argmax(drop)])
        ripple, columns = _judge_order(here, c, best, float(drop.max()), float(np.ptp(angle)))
        independent = len(orders) / STEPS
        if not ripple.evidence.is_told or ripple.evidence.gain < EVIDENCE + np.log(independent):
            break
        found.append(ripple)
        here = add_columns(here, columns)
    assert first is not None
    return RippleScan(channel.place, channel.unit, orders, first, tuple(found))


def _collect_way(terms: Terms, c: int) -> tuple[Array, Array]:
    """Angles [rad] and rates [rad/s] (samples,) of a channel's joint where it counts."""
    place = terms.machine.channels[c].place
    angles = []
    rates = []
    for run, chosen in zip(terms.task.runs, terms.task.chosen, strict=True):
        at = run.motion.names.index(place)
        angles.append(run.motion.q[chosen[:, c], at])
        rates.append(run.motion.qd[chosen[:, c], at])
    return np.concatenate(angles), np.concatenate(rates)


def list_orders(angle: Array, rate: Array, bandwidth: float, fewest: float = FEWEST) -> Array:
    """Return the orders (orders,) [1 / turn] that angles (samples,) [rad] tell apart and a low-pass [Hz] lets through.

    rate : (samples,) [rad/s]; fewest : periods on the way [-]
    """
    apart = 2.0 * np.pi / max(float(np.ptp(angle)), TINY)
    slow = float(np.quantile(np.abs(rate), SLOWEST))
    most = 2.0 * np.pi * bandwidth / max(slow, TINY)
    first = fewest * apart
    return np.asarray(np.arange(first, min(most, first + MOST_ORDERS * apart / STEPS), apart / STEPS))


def list_finer_orders(orders: Array, best: float) -> Array:
    """Return orders (fine,) [1 / turn] around the best of evenly spaced ones."""
    step = float(orders[1] - orders[0]) if len(orders) > 1 else 0.0
    return np.linspace(best - step, best + step, FINE)


def compute_waves(run: Run, channel: Channel, orders: Array) -> Array:
    """Return sines and cosines (samples, 2 orders) [-] of the angle of a joint."""
    angle = np.outer(run.motion.q[:, run.motion.names.index(channel.place)], orders)
    return np.stack([np.sin(angle), np.cos(angle)], axis=-1).reshape(len(angle), -1)


def _compute_order_effects(terms: Terms, c: int, orders: Array) -> tuple[Array, Array]:
    """By how much the cost falls (orders,) [-] by each order alone, and the RMS (orders,) [unit] that it takes away."""
    change, covariance = solve_terms(terms)
    left = terms.residuals[c] - terms.slopes[c] @ change
    together = max(1, int(LARGEST / max(len(run.time) for run in terms.task.runs)))
    drops = []
    for some in np.array_split(orders, max(1, len(orders) // together)):
        x = _compute_wave_columns(terms, c, some)
        drops.append(compute_order_drops(x, left, terms.slopes[c], covariance)[0])
    drop = np.concatenate(drops)
    return drop, np.sqrt(drop / len(left)) / terms.weights[c]


def compute_order_drops(x: Array, left: Array, slopes: Array, covariance: Array) -> tuple[Array, Array]:
    """Return by how much the cost falls (orders,) [-] by a sine and a cosine of each order, and their sizes (orders, 2) [-].

    x : (counted, 2 orders) columns of both in turn; left : (counted,) what remains
    slopes, covariance : (counted, size), (size, size) of what can make up for them
    """
    pull = (x.T @ left).reshape(-1, 2)
    pairs = x.reshape(len(x), -1, 2)  # (sample, order, 2)
    information = np.einsum("toi,toj->oij", pairs, pairs, optimize=True)
    beside = (slopes.T @ x).reshape(slopes.shape[1], -1, 2)  # (parameter, order, 2)
    taken = np.einsum("poi,pq,qoj->oij", beside, covariance, beside, optimize=True)
    size = np.linalg.solve(information - taken + LEAST * np.eye(2), pull[:, :, None])[:, :, 0]
    return np.asarray(np.sum(size * pull, axis=1)), np.asarray(size)


def _compute_wave_columns(terms: Terms, c: int, orders: Array) -> Array:
    """Columns (counted, 2 orders) [-] of a channel."""
    channel = terms.machine.channels[c]
    return compute_channel_columns(terms, c, lambda run: compute_waves(run, channel, orders))


def _judge_order(terms: Terms, c: int, order: float, drop: float, way: float) -> tuple[Ripple, list[Array]]:
    """The ripple of an order, and its columns."""
    channel = terms.machine.channels[c]
    columns = fill_other_channels(terms, c, _compute_wave_columns(terms, c, np.array([order])))
    evidence = judge_term(terms, columns)
    drive = terms.machine.mechanism.joint_of[channel.place].drive
    ratio = abs(drive.ratio) if drive is not None and abs(drive.ratio) != 1.0 else 0.0
    error = np.sqrt(12.0 / max(drop, 1.0)) / way
    amplitude = float(np.hypot(*evidence.sizes))
    return Ripple(channel.place, order, float(error), amplitude, channel.unit, ratio, evidence), columns
