"""Faults of gears: efforts that come and go with the angle, play between motor and link, efforts that another motor carries.

ripple     effort_j + a sin(n q_j + p);   n, p are order and phase by which the cost falls most (`drives.ripples`)
backlash   the encoder of the motor reads q + (p / 2) sign(tau), and its rotor and friction follow that
twist      the same with q + c tau
belt       a part of the effort or of the angle of another joint in those of this one; crosstalk: of what another sensor reads
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import partial

import numpy as np

from crosscheck.identification.causes.cause import Cause, apply_to_column
from crosscheck.identification.causes.rounds import CauseRound
from crosscheck.identification.drives.efforts import compute_drive_effort
from crosscheck.identification.drives.ripples import (
    compute_order_drops,
    compute_waves,
    list_finer_orders,
    list_orders,
)
from crosscheck.identification.filters import apply_low_pass_all
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Channel, Machine, has_friction
from crosscheck.identification.parameters import Values
from crosscheck.identification.readings import compute_measured_motion, make_run
from crosscheck.identification.settings import ANGLES
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

LARGEST_PLAY = 0.2  # [rad], [m]: a gear with more has lost its teeth
LARGEST_PART = 1.5  # of the effort of another joint: belts have about one to one
CARRIED = "part of the effort of another joint, carried too"
READ = "part of the reading of another effort"
TURNED = "part of the angle of another joint"
# Of the spread of its load: a gear is in its play while it carries less.  It may be twice or half of that.
PASSED = 0.15
TINY = 1e-300  # a gear without load is always in its play
FEWEST = 1.25  # periods of a ripple on the way: gravity that is wrongly known has less
ORDERS = 200  # at a time


def list_ripple_causes(here: CauseRound, at: Array, noisy: Collection[int]) -> Iterator[Cause]:
    """Yield the wave over the angle that takes away most of each effort [unit of the channel].

    at : sizes of the causes; noisy : numbers of the channels of which more is left than noise
    """
    machine = here.search.machine
    left = here.compute_weighed_residual(at)
    for c in noisy:
        channel = machine.channels[c]
        if channel.sense == "effort" and machine.mechanism.joint_of[channel.place].kind != "prismatic":
            wave = _find_wave(here, c, left)
            if wave is not None:
                yield _make_ripple(machine, channel, *wave)


def _find_wave(here: CauseRound, c: int, left: Array) -> tuple[float, float] | None:
    """Order [1 / turn] and phase [rad] that take away most of channel c; left : (rows,) weighed residual."""
    channel = here.search.machine.channels[c]
    run = here.task.runs[0]
    k = run.motion.names.index(channel.place)
    chosen = here.task.chosen[0][:, c]
    bandwidth = here.search.machine.settings.bandwidth_Hz
    orders = list_orders(run.motion.q[chosen, k], run.motion.qd[chosen, k], bandwidth, FEWEST)
    if not len(orders):
        return None
    rows = slice(here.ends[c] - int(chosen[:: here.task.every[0]].sum()), here.ends[c])
    basis = here.basis[rows]

    def compute_drops(some: Array) -> tuple[Array, Array]:
        passed = apply_low_pass_all(compute_waves(run, channel, some), float(run.time[1] - run.time[0]), bandwidth)
        x = here.weight[c] * passed[:: here.task.every[0]][chosen[:: here.task.every[0]]]
        return compute_order_drops(x, left[rows], basis, np.eye(basis.shape[1]))

    drops = np.concatenate([compute_drops(some)[0] for some in np.array_split(orders, max(1, len(orders) // ORDERS))])
    fine = list_finer_orders(orders, float(orders[np.argmax(drops)]))
    drop, sizes = compute_drops(fine)
    best = int(np.argmax(drop))
    return float(fine[best]), float(np.arctan2(sizes[best, 1], sizes[best, 0]))


def _make_ripple(machine: Machine, channel: Channel, order: float, phase: float) -> Cause:
    name = f"ripple of the effort, {order:.4g} a turn"
    table = machine.settings.joints[channel.place].angle
    factor = ANGLES[table.unit] / table.over

    def remove_ripple(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        swing = np.sin(order * factor * log.read_column(table.column) + phase) / channel.factor
        return apply_to_column(log, channel.column, lambda v: v - phi * swing), mechanism

    return Cause(name, channel.place, channel.unit, 1e-3, remove_ripple, False, rare=True)


def list_play_causes(machine: Machine, values: Values, noisy: Collection[int]) -> Iterator[Cause]:
    """Yield backlash [rad], [m] and twist of drives, and what they have of another joint [-].

    values : of the parameters; noisy : numbers of the channels of which more is left than noise
    """
    drives = [channel for channel in machine.channels if has_friction(machine, channel)]
    for channel in (machine.channels[c] for c in noisy if machine.channels[c] in drives):
        yield _make_play_cause(machine, channel, values, (0.0,))
        unit = "m/N" if machine.mechanism.joint_of[channel.place].kind == "prismatic" else "rad/(N m)"
        undo = partial(_remove_play, machine, channel, values, lambda load: load)
        yield Cause("twist of the gear by its load", channel.place, unit, 1e-6, undo, rare=True, least=0.0)
        for other in drives:
            if other is not channel:
                yield from _list_pair_causes(machine, channel, other, values)


def _list_pair_causes(machine: Machine, channel: Channel, other: Channel, values: Values) -> Iterator[Cause]:
    """Yield parts of the effort and of the angle of another joint in those of a joint [-]."""
    place = f"{channel.place} and {other.place}"
    carried = partial(_remove_carried_part, machine, channel, other, values)
    one, another = (machine.settings.joints[c.place].angle for c in (channel, other))
    to_angle = ANGLES[another.unit] / another.over / (ANGLES[one.unit] / one.over)
    read = partial(_remove_part, channel.column, other.column, other.factor / channel.factor)
    turned = partial(_remove_part, one.column, another.column, to_angle)
    for name, undo, moves in ((CARRIED, carried, False), (READ, read, False), (TURNED, turned, True)):
        yield Cause(name, place, "-", 1e-3, undo, moves, rare=True, least=-LARGEST_PART, most=LARGEST_PART)


def _remove_part(
    column: str, other: str, factor: float, log: Log, mechanism: Mechanism, phi: float
) -> tuple[Log, Mechanism]:
    """The log without phi times a column in another one; factor : from its unit to that of the other [-]."""
    return apply_to_column(log, column, partial(_add_part, -phi * factor, log.read_column(other))), mechanism


def _make_play_cause(machine: Machine, channel: Channel, values: Values, spot: tuple[float, ...]) -> Cause:
    """Play of a gear; spot : logarithm to the base 2 of the load below which it is in between, over the usual one [-]."""
    passed = PASSED * 2.0 ** spot[0]
    slides = machine.mechanism.joint_of[channel.place].kind == "prismatic"
    return Cause(
        "backlash of the gear",
        channel.place,
        "m" if slides else "rad",
        1e-3,
        partial(_remove_play, machine, channel, values, partial(_compute_play, passed)),
        rare=True,
        least=0.0,
        most=LARGEST_PLAY,
        spot=spot,
        make_at=partial(_make_play_cause, machine, channel, values),
    )


def _remove_carried_part(
    machine: Machine, channel: Channel, other: Channel, values: Values, log: Log, mechanism: Mechanism, phi: float
) -> tuple[Log, Mechanism]:
    """The log of a motor that carries no part of the effort of another joint: no belt runs over its axis."""
    run = make_run(machine, log, efforts=False, once=True)
    load = run.response(values)[0][:, run.motion.names.index(other.place)]
    less = phi * load / (channel.ratio * channel.factor)
    return apply_to_column(log, channel.column, lambda v: v - less), mechanism


def _add_part(size: float, other: Array, values: Array) -> Array:
    """The values (samples,) and so many times other ones."""
    return values + size * other


def _compute_play(passed: float, load: Array) -> Array:
    """The side of its play (samples,) [-] on which a gear is, from -1/2 to 1/2, by its load [N m], [N].

    passed : part of the spread of its load below which it is in between [-]
    """
    return np.asarray(np.tanh(load / (passed * float(np.std(load)) + TINY)) / 2.0)


def _remove_play(
    machine: Machine,
    channel: Channel,
    values: Values,
    give: Callable[[Array], Array],
    log: Log,
    mechanism: Mechanism,
    phi: float,
) -> tuple[Log, Mechanism]:
    """The log of a gear that does not give: link angles for those of the motor, and efforts that its rotor would need then.

    give : by its load (samples,) [N m], [N], for a size of 1
    """
    run = make_run(machine, log, efforts=False, once=True)
    at = run.motion.names.index(channel.place)
    load = run.response(values)[0][:, at]
    table = machine.settings.joints[channel.place].angle
    changed = apply_to_column(log, table.column, partial(_add_part, -phi * table.over / ANGLES[table.unit], give(load)))
    motion = compute_measured_motion(machine, changed)
    moved = compute_drive_effort(machine, channel.place, run.motion.qd[:, at], run.motion.qdd[:, at], values)
    still = compute_drive_effort(machine, channel.place, motion.qd[:, at], motion.qdd[:, at], values)
    more = (moved - still) / (channel.ratio * channel.factor)
    return apply_to_column(changed, channel.column, lambda v: v - more), mechanism
