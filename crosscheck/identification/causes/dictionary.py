"""Dictionary of causes with one number that may be small: delays, lags, scales, tilted gravity, payload; phi = 0 is no fault."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from crosscheck.identification.causes.cause import Cause, Undo, apply_to_column
from crosscheck.identification.logs.log import Log
from crosscheck.identification.readings import (
    Channel,
    Machine,
    apply_delay,
    apply_first_order_lag,
    remove_first_order_lag,
)
from flexinv.model.links import Body, Inertia, Link
from flexinv.model.mechanism import Mechanism

# Sizes that are tried [s]: above the bandwidth a delay turns the phase by whole turns, and the way from 0 ends in the wrong one.
LATE = tuple(0.002 * k for k in range(-10, 11) if k)
SLOW = (0.001, 0.002, 0.005, 0.01, 0.02)


def list_possible_causes(machine: Machine) -> Iterator[Cause]:
    """Yield all causes with one number that are possible here: phi = 0 is no fault [unit of each]."""
    for channel in machine.channels:
        yield from _list_channel_causes(channel)
    for name, table in machine.settings.joints.items():
        yield Cause("delay of the angle", name, "s", 1e-3, _make_delay_undo(table.angle.column), True, LATE, True)
        yield Cause("scale of the angle (gear), relative error", name, "-", 1e-3, _make_gain_undo(table.angle.column))
    efforts = tuple(channel.column for channel in machine.channels if channel.sense == "effort")
    if len(efforts) > 1:
        yield Cause("delay of the efforts", "all joints", "s", 1e-3, _make_delay_undo(*efforts), False, LATE, True)
    if np.linalg.norm(machine.mechanism.gravity):
        for axis in range(2):
            yield Cause("tilt of gravity", f"the world's {'xy'[axis]} axis", "rad", 1e-3, _make_tilt_undo(axis))
    yield from _list_payload_causes(machine.mechanism)


def _list_channel_causes(channel: Channel) -> Iterator[Cause]:
    kind = channel.sense
    delay = _make_delay_undo(channel.column)
    yield Cause(f"delay of the {kind}", channel.place, "s", 1e-3, delay, False, LATE, True)
    what = "torque constant, relative error" if kind == "effort" else f"gain of the {kind}, relative error"
    yield Cause(what, channel.place, "-", 1e-3, _make_gain_undo(channel.column), False, scales=channel.column)
    lag = _make_lag_undo(channel.column)
    yield Cause(f"first-order lag of the {kind}", channel.place, "s", 1e-3, lag, False, SLOW, True, 0.0)


def _list_payload_causes(mechanism: Mechanism) -> Iterator[Cause]:
    """Yield more mass on rigid links: at the last of several bodies, or at the single one of a link that ends a chain."""
    parents = {joint.parent for joint in mechanism.joints}
    for link in mechanism.links:
        several = len(link.bodies) > 1
        if link.beam is None and link.bodies and (several or link.name not in parents):
            place = f"{link.name}/{link.bodies[-1].name}" if several else f"{link.name}, at its centre of mass"
            yield Cause("payload beside what is known", place, "kg", 0.1, _make_payload_undo(link.name))


def _make_delay_undo(*columns: str) -> Undo:
    def remove_delay(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        spacing = log.spacing
        for column in columns:
            log = apply_to_column(log, column, lambda v: apply_delay(v, spacing, -phi))
        return log, mechanism

    return remove_delay


def _make_gain_undo(column: str) -> Undo:
    return lambda log, m, phi: (apply_to_column(log, column, lambda v: v / (1.0 + phi)), m)


def _make_lag_undo(column: str) -> Undo:
    """The input of a first-order lag; below 0 what the lag makes of the signal, so that small sizes meet."""

    def remove_lag(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        change = remove_first_order_lag if phi > 0.0 else apply_first_order_lag
        return apply_to_column(log, column, lambda v: change(v, log.spacing, abs(phi))), mechanism

    return remove_lag


def _make_tilt_undo(axis: int) -> Undo:
    def turn_gravity(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        g = np.asarray(mechanism.gravity)
        turn = np.eye(3)[axis]
        return log, replace(mechanism, gravity=g * np.cos(phi) + np.cross(turn, g) * np.sin(phi))

    return turn_gravity


def _is_at_tip(link: Link) -> bool:
    return len(link.bodies) == 1 and bool(np.any(link.tip))


def _make_payload_undo(link: str) -> Undo:
    """One more mass at the last body of a link, or at the tip of a single one; below 0 less of it."""

    def add_payload(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        own = mechanism.link_of[link]
        more = Body("more", Inertia.build_unchecked(phi, own.tip if _is_at_tip(own) else own.bodies[-1].inertia.com))
        links = tuple(replace(k, bodies=(*k.bodies, more)) if k.name == link else k for k in mechanism.links)
        return log, replace(mechanism, links=links)

    return add_payload
