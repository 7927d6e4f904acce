"""Dictionary of causes with one number that may be small; phi = 0 is no fault.

Of signals: delays, lags, gains, offsets, scales, a clock, drifts.  Of drives: friction, rotor inertia, a spring, the efficiency
of a gear.  Of the machine: tilted gravity, payload.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from crosscheck.identification.causes.cause import Cause, Undo, apply_to_column
from crosscheck.identification.drives.efforts import compute_drive_effort, compute_friction
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Channel, Machine, has_friction
from crosscheck.identification.parameters import KINDS, Values, find_prior_value
from crosscheck.identification.readings import (
    apply_delay,
    apply_first_order_lag,
    compute_measured_motion,
    remove_first_order_lag,
)
from crosscheck.identification.responses.response import compute_link_inertias
from crosscheck.identification.settings import ANGLES
from flexinv.model.links import Body, Inertia, Link
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

DriveLaw = Callable[[Array, Array, Array], Array]  # of q, qd, qdd
# Sizes that are tried [s]: above the bandwidth a delay turns the phase by whole turns, and the way from 0 ends in the wrong one.
LATE = tuple(0.002 * k for k in range(-10, 11) if k)
SLOW = (0.001, 0.002, 0.005, 0.01, 0.02)
# Largest sizes that can be, without being a gross fault: of a delay or lag [s], a relative error, an angle [rad].
LATEST = 0.2
LARGEST_SCALE = 0.5
# Times as large or small: of shunts, amplifiers and torque constants; units and gears are gross faults.
LARGEST_GAIN = 20.0
# Waves of an angle's error over a turn of the joint: an eccentric encoder makes one, an oval one two.
ORDERS = (1, 2)
LARGEST_ANGLE = 0.6
# Relative errors of a stiffness: its natural frequency passes those of the motion, and of two that are a tenth apart neither
# leads to the other.
STIFFNESSES = (-0.8, -0.7, -0.6, -0.5, -0.4, -0.3, -0.2, -0.1, 0.1, 0.25, 0.5, 1.0, 2.0)
STIFFER = 9.0  # relative: beyond ten times its stiffness a drive is another one
# Of gravity: on the Earth it is 9.764 to 9.834 m/s^2 (Hirt et al. 2013, doi:10.1002/grl.50838), and 10 is written for it.
HEAVIER = 0.03
# Of what is known, and as a number [unit of the law]: so much less than nothing may be there by the error of a fit.
LITTLE = 0.1
TINY = 1e-6
# Places on the line through the centre of mass of a link without a tip, in its distances, from which a payload is looked for.
OUTWARD = (1.0, 0.5, 1.5, 2.0, 2.5, 3.0)
# Of its distance from the origin: a payload farther from that line is told by its coordinates, one nearer to the centre of mass
# is said to be there.
BESIDE_LINE = 0.05
PAYLOAD = "payload beside what is known"


def list_possible_causes(machine: Machine, values: Values) -> Iterator[Cause]:
    """Yield all causes with one number that are possible here: phi = 0 is no fault; values : of the parameters [unit of each]."""
    for channel in machine.channels:
        yield from _list_channel_causes(channel)
    if np.linalg.norm(machine.mechanism.gravity):
        for axis in range(2):
            place = f"the world's {'xy'[axis]} axis"
            yield _make_bounded("tilt of gravity", place, "rad", LARGEST_ANGLE, _make_tilt_undo(axis))
        yield Cause(
            "size of gravity, relative error", "the world", "-", 1e-3, _scale_gravity, least=-HEAVIER, most=HEAVIER
        )
    for name, table in machine.settings.joints.items():
        yield from _list_angle_causes(name, table.angle.column, ANGLES[table.angle.unit] / table.angle.over, machine)
    efforts = tuple(channel.column for channel in machine.channels if channel.sense == "effort")
    if len(efforts) > 1:
        undo = _make_delay_undo(*efforts)
        yield _make_bounded("delay of the efforts", "all joints", "s", LATEST, undo, False, LATE, True)
    yield _make_bounded("slow clock, relative error", "the times", "-", LARGEST_SCALE, _scale_times)
    yield from _list_payload_causes(machine, values)
    for channel in machine.channels:
        if has_friction(machine, channel):
            yield from _list_drive_causes(machine, channel, values)
    yield from _list_stiffness_causes(machine)
    yield from _list_length_causes(machine)
    for channel in machine.channels:
        if has_friction(machine, channel):
            slow = _list_slow_causes(machine, channel, values)
            yield from (replace(one, rare=True) for one in (*slow, *_list_gear_causes(machine, channel, values)))


def _list_stiffness_causes(machine: Machine) -> Iterator[Cause]:
    """Yield springs of joints that no column measures, as of elastic drives, which are another than was identified."""
    for joint in machine.mechanism.joints:
        if joint.stiffness > 0.0 and joint.name not in machine.settings.joints:
            name = "stiffness of the joint, relative error"
            undo = partial(_scale_stiffness, joint.name)
            yield Cause(name, joint.name, "-", 1e-3, undo, scanned=STIFFNESSES, least=-1.0, most=STIFFER, rare=True)


def _scale_stiffness(name: str, log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
    """The machine with a joint that is so much stiffer [-]."""
    joints = tuple(replace(j, stiffness=j.stiffness * (1.0 + phi)) if j.name == name else j for j in mechanism.joints)
    return log, replace(mechanism, joints=joints)


def _list_length_causes(machine: Machine) -> Iterator[Cause]:
    """Yield by how much further out a joint sits on a link that moves [m]."""
    moved = {joint.child for joint in machine.mechanism.joints if joint.nv}
    for joint in machine.mechanism.joints:
        far = float(np.linalg.norm(joint.placement.position))
        link = machine.mechanism.link_of.get(joint.parent)
        if joint.parent in moved and far > 0.0 and link is not None and link.beam is None:
            undo = _make_length_undo(joint.name, joint.placement.position / far)
            name = f"length of the link up to joint {joint.name}"
            yield Cause(name, joint.parent, "m", 1e-3, undo, rare=True)


def _make_length_undo(name: str, along: Array) -> Undo:
    """The machine with a joint further out along a direction (3,)."""

    def move_joint(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        at = mechanism.joint_of[name].placement
        placed = replace(at, position=at.position + phi * along)
        joints = tuple(replace(j, placement=placed) if j.name == name else j for j in mechanism.joints)
        return log, replace(mechanism, joints=joints)

    return move_joint


def _list_slow_causes(machine: Machine, channel: Channel, values: Values) -> Iterator[Cause]:
    """Yield what grows from the first sample to the last, each by its change over the log."""
    name = channel.place
    table = machine.settings.joints[name].angle
    factor = ANGLES[table.unit] / table.over
    slides = machine.mechanism.joint_of[name].kind == "prismatic"
    effort = _make_column_undo(channel.column, lambda v, phi: v - phi / channel.factor * _make_ramp(v))
    yield Cause("drift of the effort", name, channel.unit, 1e-3, effort, False)
    gain = _make_column_undo(channel.column, lambda v, phi: v / (1.0 + phi * _make_ramp(v)))
    yield _make_bounded("drift of the torque constant, relative", name, "-", LARGEST_SCALE, gain, False)
    warmed = _make_effort_undo(
        machine, channel, lambda q, qd, qdd: _make_ramp(qd) * compute_friction(machine, name, qd, values)
    )
    yield Cause("growth of friction, relative", name, "-", 1e-3, warmed, False, least=-1.0)
    angle = _make_column_undo(table.column, lambda v, phi: v - phi / factor * _make_ramp(v))
    yield _make_bounded("drift of the angle", name, "m" if slides else "rad", LARGEST_ANGLE, angle)


def _list_gear_causes(machine: Machine, channel: Channel, values: Values) -> Iterator[Cause]:
    """Yield what a gear does with the effort that passes, of which it takes a part of the power, and an eccentric encoder."""
    name = channel.place
    table = machine.settings.joints[name].angle

    def remove_losses(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        motion = compute_measured_motion(machine, log)
        at = motion.names.index(name)
        rate = motion.qd[:, at]
        drive = compute_drive_effort(machine, name, rate, motion.qdd[:, at], values)
        load = log.read_column(channel.column) * channel.factor * channel.ratio - drive
        driven = np.sign(load) * np.tanh(
            rate / max(machine.settings.still_rad_per_s, TINY)
        )  # 1 where power goes to the load
        lost = load - load * (1.0 + phi) ** driven
        return apply_to_column(log, channel.column, lambda v: v - lost / (channel.factor * channel.ratio)), mechanism

    yield Cause("efficiency of the gear less one", name, "-", 1e-3, remove_losses, False, least=-1.0, most=0.0)
    slides = machine.mechanism.joint_of[name].kind == "prismatic"
    for order in () if slides else ORDERS:
        for wave in (np.sin, np.cos):
            undo = _make_column_undo(table.column, _make_ripple(ANGLES[table.unit] / table.over, order, wave))
            what = f"ripple of the angle, {order} a turn"
            yield Cause(what, name, "rad", 1e-3, undo, kin=f"{what} {name} {wave.__name__}", wave=True)


def _make_ripple(factor: float, order: int, wave: Callable[[Array], Array]) -> Callable[[Array, float], Array]:
    return lambda v, phi: v - phi / factor * wave(order * factor * v)


def _compute_sense(machine: Machine, rate: Array) -> Array:
    """The sense of rates (samples,) [rad/s], [m/s]: -1 to 1, steep where the joint hardly slides."""
    return np.asarray(np.tanh(rate / machine.settings.still_rad_per_s))


def _make_ramp(values: Array) -> Array:
    """From 0 at the first of so many samples to 1 at the last [-]."""
    return np.linspace(0.0, 1.0, len(values))


def _find_known_law(machine: Machine, values: Values, what: str, joint: str) -> float:
    """So much friction or rotor inertia [unit of it] a joint has that there may be less of; a spring may push or pull."""
    if what not in KINDS:
        return float("inf")
    known = values.get((what, joint), find_prior_value(machine.mechanism, machine.settings, KINDS[what], joint))
    return float(known) + LITTLE * abs(float(known)) + TINY


def _make_bounded(name: str, place: str, unit: str, most: float, undo: Undo, *more: Any) -> Cause:
    """A cause of step 1e-3 whose size is at most ``most`` [unit] on both sides."""
    return replace(Cause(name, place, unit, 1e-3, undo, *more), least=-most, most=most)


def _list_angle_causes(name: str, column: str, factor: float, machine: Machine) -> Iterator[Cause]:
    """Yield what the angle of a joint may have; factor : from its column to [rad], [m]."""
    yield _make_bounded("delay of the angle", name, "s", LATEST, _make_delay_undo(column), True, LATE, True)
    scale = "scale of the angle (gear), relative error"
    yield _make_bounded(scale, name, "-", LARGEST_SCALE, _make_gain_undo(column))
    slides = machine.mechanism.joint_of[name].kind == "prismatic"
    undo = _make_offset_undo(column, factor)
    yield _make_bounded("offset of the angle", name, "m" if slides else "rad", LARGEST_ANGLE, undo)


def _list_channel_causes(channel: Channel) -> Iterator[Cause]:
    kind = channel.sense
    place = channel.place
    delay = _make_delay_undo(channel.column)
    yield _make_bounded(f"delay of the {kind}", place, "s", LATEST, delay, False, LATE, True)
    what = "torque constant, relative error" if kind == "effort" else f"gain of the {kind}, relative error"
    gain = _make_gain_undo(channel.column)
    yield Cause(
        what,
        place,
        "-",
        1e-3,
        gain,
        False,
        least=1.0 / LARGEST_GAIN - 1.0,
        most=LARGEST_GAIN - 1.0,
        scales=channel.column,
    )
    lag = _make_lag_undo(channel.column)
    yield Cause(f"first-order lag of the {kind}", place, "s", 1e-3, lag, False, SLOW, True, 0.0, LATEST)
    offset = _make_offset_undo(channel.column, channel.factor)
    yield Cause(f"offset of the {kind}", place, channel.unit, 1e-3, offset, False)


def _list_drive_causes(machine: Machine, channel: Channel, values: Values) -> Iterator[Cause]:
    """Yield what a drive may need more than is known, as of another day: friction, rotor inertia, a spring."""
    name = channel.place
    slides = machine.mechanism.joint_of[name].kind == "prismatic"
    laws: tuple[tuple[str, str, DriveLaw], ...] = (
        ("viscous friction", "N s/m" if slides else "N m s/rad", lambda q, qd, qdd: qd),
        (
            "coulomb friction",
            "N" if slides else "N m",
            lambda q, qd, qdd: _compute_sense(machine, qd),
        ),
        ("rotor inertia", "kg" if slides else "kg m^2", lambda q, qd, qdd: qdd),
        ("spring", "N/m" if slides else "N m/rad", lambda q, qd, qdd: q - q.mean()),
    )
    share = _make_effort_undo(machine, channel, lambda q, qd, qdd: compute_friction(machine, name, qd, values))
    yield Cause("friction, relative error", name, "-", 1e-3, share, False, least=-1.0, daily=True)
    for what, unit, law in laws:
        undo = _make_effort_undo(machine, channel, law)
        least = -_find_known_law(machine, values, what, name)
        daily = what.endswith("friction")
        yield Cause(f"{what} beside what is known", name, unit, 1e-3, undo, False, least=least, daily=daily)


def _list_payload_causes(machine: Machine, values: Values) -> Iterator[Cause]:
    """Yield more mass on rigid links that move: first on those that end a chain or have several bodies, then on the others.

    Of several bodies it is at the last, and where a link states a tip it is there.  Else it is looked for from places on the
    line through the centre of mass.
    """
    mechanism = machine.mechanism
    inertias = dict(zip(mechanism.link_of, compute_link_inertias(machine.space, mechanism, values), strict=True))
    parents = {joint.parent for joint in mechanism.joints}
    moved = {joint.child for joint in mechanism.joints if joint.nv}
    massive = [one for one in mechanism.links if one.beam is None and one.bodies and float(inertias[one.name][0]) > 0.0]
    last = [one for one in massive if len(one.bodies) > 1 or one.name not in parents]
    for link in last:
        yield from _list_payload_places(link, inertias[link.name])
    for link in massive:
        if link.name in moved and link not in last:
            yield from (replace(one, rare=True) for one in _list_payload_places(link, inertias[link.name]))


def _list_payload_places(link: Link, ten: Array) -> Iterator[Cause]:
    """Yield more mass on a link with m, h, I (10,) [kg], [kg m], [kg m^2], from all places at which one begins to look."""
    mass = float(ten[0])
    several = len(link.bodies) > 1
    if several or np.any(link.tip):
        where = link.bodies[-1].inertia.com if several else link.tip
        place = f"{link.name}/{link.bodies[-1].name}" if several else f"{link.name}, at its tip"
        yield Cause(PAYLOAD, place, "kg", 0.1, _make_payload_undo(link.name, where), least=-mass)
        return
    com = ten[1:4] / mass
    size = float(np.sqrt(max(ten[4:7].sum(), 0.0) / (2.0 * mass)))  # radius of gyration about the origin of the frame
    yield from (_PayloadLine(link.name, com, size, mass, times).make_at((0.0, 0.0, 0.0)) for times in OUTWARD)


@dataclass(frozen=True)
class _PayloadLine:
    """Places of a payload on a link of a mass [kg]: around one so many times as far out as the centre of mass (3,) [m].

    size : how far from there it may be, as one standard deviation [m]
    """

    link: str
    com: Array
    size: float
    mass: float
    times: float

    def make_at(self, spot: tuple[float, ...]) -> Cause:
        """Return more mass at a place beside that one; spot : its distances (3,) in widths [-]."""
        where = self.times * self.com + self.size * np.array(spot)
        return Cause(
            PAYLOAD,
            f"{self.link}, {self._describe_place(where)}",
            "kg",
            0.1,
            _make_payload_undo(self.link, where),
            least=-self.mass,
            kin=f"{PAYLOAD} {self.link}",
            spot=spot,
            make_at=self.make_at,
        )

    def _describe_place(self, where: Array) -> str:
        """A place (3,) [m] in words: on the line through the centre of mass by how far out, else in the frame of the link."""
        times = float(where @ self.com) / max(float(self.com @ self.com), TINY**2)
        if np.linalg.norm(where - times * self.com) > BESIDE_LINE * np.linalg.norm(where):
            return "at " + ", ".join(f"{axis} = {x + 0.0:.3g} m" for axis, x in zip("xyz", where.round(4), strict=True))
        there = abs(times - 1.0) < BESIDE_LINE
        return ("at" if there else f"{times:.2g} times as far out as") + " its centre of mass"


def _make_delay_undo(*columns: str) -> Undo:
    def remove_delay(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        spacing = log.spacing
        for column in columns:
            log = apply_to_column(log, column, lambda v: apply_delay(v, spacing, -phi))
        return log, mechanism

    return remove_delay


def _make_column_undo(column: str, change: Callable[[Array, float], Array]) -> Undo:
    return lambda log, m, phi: (apply_to_column(log, column, lambda v: change(v, phi)), m)


def _make_offset_undo(column: str, factor: float) -> Undo:
    return lambda log, m, phi: (apply_to_column(log, column, lambda v: v - phi / factor), m)


def _make_effort_undo(machine: Machine, channel: Channel, law: DriveLaw) -> Undo:
    """The effort of a joint less phi times a law of its motion [N m], [N] at the joint."""

    def remove_effort(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        motion = compute_measured_motion(machine, log)
        at = motion.names.index(channel.place)
        more = law(motion.q[:, at], motion.qd[:, at], motion.qdd[:, at]) / (channel.ratio * channel.factor)
        return apply_to_column(log, channel.column, lambda v: v - phi * more), mechanism

    return remove_effort


def _scale_times(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
    """The log whose clock went slow by phi: its times say less than what went by."""
    return replace(log, time=log.time[0] + (log.time - log.time[0]) * (1.0 + phi)), mechanism


def _make_gain_undo(column: str) -> Undo:
    return lambda log, m, phi: (apply_to_column(log, column, lambda v: v / (1.0 + phi)), m)


def _make_lag_undo(column: str) -> Undo:
    """The input of a first-order lag; below 0 what the lag makes of the signal, so that small sizes meet."""

    def remove_lag(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        change = remove_first_order_lag if phi > 0.0 else apply_first_order_lag
        return apply_to_column(log, column, lambda v: change(v, log.spacing, abs(phi))), mechanism

    return remove_lag


def _scale_gravity(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
    return log, replace(mechanism, gravity=np.asarray(mechanism.gravity) * (1.0 + phi))


def _make_tilt_undo(axis: int) -> Undo:
    def turn_gravity(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        g = np.asarray(mechanism.gravity)
        turn = np.eye(3)[axis]
        return log, replace(mechanism, gravity=g * np.cos(phi) + np.cross(turn, g) * np.sin(phi))

    return turn_gravity


def _make_payload_undo(link: str, where: Array) -> Undo:
    """One more mass at a place in the frame of a link [m]; below 0 less of it."""

    def add_payload(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        more = Body("more", Inertia.build_unchecked(phi, where))
        links = tuple(replace(k, bodies=(*k.bodies, more)) if k.name == link else k for k in mechanism.links)
        return log, replace(mechanism, links=links)

    return add_payload
