"""Faults of machines and loggers: each is a function that spoils what truly is, or what was written of it.

``@machine_fault`` changes a `World` before it is logged, ``@logger_fault`` a `Record` after that.  A place is a joint from 0, for
bodies the link that it moves; -1 is all joints.  The size has the unit that the docstring states; ``other`` is a second number,
of a meaning of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from campaigns.log_faults.machines import CREEP, SPACING, Body, Motion, Record, World, compute_load
from flexinv.typing import Array

Random = np.random.Generator
MachineFault = Callable[[World, int, float, float], World]
LoggerFault = Callable[[Record, int, float, float, Random], Record]
MACHINE: dict[str, MachineFault] = {}
LOGGER: dict[str, LoggerFault] = {}


@dataclass(frozen=True)
class Plant:
    """A fault as faults.csv states it: kind @ place size other."""

    kind: str
    place: int
    size: float
    other: float = 0.0


def parse_plants(text: str) -> list[Plant]:
    """Return the faults of ``kind @ place size other; ...`` [units of the kinds]."""
    plants = []
    for part in filter(None, (p.strip() for p in text.split(";"))):
        kind, numbers = part.split("@")
        place, *sizes = numbers.split()
        plants.append(Plant(kind.strip(), int(place), *(float(s) for s in sizes)))
    return plants


def spoil_machine(world: World, plants: list[Plant]) -> World:
    """Return the machine [units of its fields] with those faults that are a machine's."""
    for one in plants:
        if one.kind in MACHINE:
            world = MACHINE[one.kind](world, one.place, one.size, one.other)
    return world


def spoil_record(record: Record, plants: list[Plant], random: Random) -> Record:
    """Return the record [s, rad, N m] with those faults that are a logger's or a sensor's."""
    for one in plants:
        if one.kind in LOGGER:
            record = LOGGER[one.kind](record, one.place, one.size, one.other, random)
    return record


def machine_fault(function: MachineFault) -> MachineFault:
    """Add a fault of machines under the name of its function."""
    MACHINE[_read_name(function)] = function
    return function


def logger_fault(function: LoggerFault) -> LoggerFault:
    """Add a fault of loggers under the name of its function."""
    LOGGER[_read_name(function)] = function
    return function


def _read_name(function: Callable[..., object]) -> str:
    return function.__name__.removeprefix("apply_").replace("_", " ")


def _scale(values: Array, place: int, factor: float) -> Array:
    return values * np.where(np.arange(len(values)) == place, factor, 1.0)


def _shift(values: Array, place: int, size: float) -> Array:
    return values + np.where(np.arange(len(values)) == place, size, 0.0)


def _change_column(values: Array, place: int, change: Callable[[Array], Array]) -> Array:
    """Change the column of a joint; those of all joints where the place is -1."""
    return np.column_stack([change(c) if place in (k, -1) else c for k, c in enumerate(values.T)])


def _change_effort(record: Record, place: int, change: Callable[[Array], Array]) -> Record:
    return replace(record, effort=_change_column(record.effort, place, change))


def _change_angle(record: Record, place: int, change: Callable[[Array], Array]) -> Record:
    return replace(record, angle=_change_column(record.angle, place, change))


def _add_extra(world: World, place: int, effort: Callable[[Motion, Array], Array]) -> World:
    """Add an effort (samples,) [N m] of motion and load at a joint."""

    def extra(motion: Motion, load: Array) -> Array:
        out = np.zeros_like(load)
        out[:, place] = effort(motion, load)
        return out

    return replace(world, extra=(*world.extra, extra))


# What machines have


@machine_fault
def apply_payload(world: World, place: int, size: float, other: float) -> World:
    """Add a point mass [kg] on a link, ``other`` [m] along it; a negative one was lost."""
    return replace(world, bodies=(*world.bodies, Body(place, size, (other, 0.0))))


@machine_fault
def apply_rotor(world: World, place: int, size: float, other: float) -> World:
    """Change the rotor inertia by ``size`` [kg m^2]: another motor was fitted."""
    return replace(world, rotor=_shift(world.rotor, place, size))


@machine_fault
def apply_drag(world: World, place: int, size: float, other: float) -> World:
    """Add dry friction [N m]: a brake that does not lift."""
    return replace(world, coulomb=_shift(world.coulomb, place, size))


@machine_fault
def apply_cold_grease(world: World, place: int, size: float, other: float) -> World:
    """Add viscous friction [N m s/rad]."""
    return replace(world, viscous=_shift(world.viscous, place, size))


@machine_fault
def apply_stiction(world: World, place: int, size: float, other: float) -> World:
    """Let dry friction be larger by this part [-] at low rates (0.2 rad/s)."""
    return replace(world, stribeck=_shift(world.stribeck, place, size))


@machine_fault
def apply_asymmetry(world: World, place: int, size: float, other: float) -> World:
    """Let friction be larger one way than the other by twice this [N m]."""
    return replace(world, asymmetry=_shift(world.asymmetry, place, size))


@machine_fault
def apply_warming(world: World, place: int, size: float, other: float) -> World:
    """Let all friction of a joint grow by this part [-] from the first sample to the last."""
    return replace(world, growth=_shift(world.growth, place, size))


@machine_fault
def apply_efficiency(world: World, place: int, size: float, other: float) -> World:
    """Let a gear give this part [-] of the power that it takes."""
    return replace(world, efficiency=_scale(world.efficiency, place, size))


@machine_fault
def apply_backlash(world: World, place: int, size: float, other: float) -> World:
    """Let a gear have this play [rad] between motor with encoder, and link."""
    return replace(world, backlash=_shift(world.backlash, place, size))


@machine_fault
def apply_base_tilt(world: World, place: int, size: float, other: float) -> World:
    """Turn the base about the axis y of the joints by an angle [rad]: the world's gravity turns back in its frame."""
    x, z = world.gravity
    c, s = np.cos(size), np.sin(size)
    return replace(world, gravity=(c * x - s * z, c * z + s * x))


@machine_fault
def apply_base_lean(world: World, place: int, size: float, other: float) -> World:
    """Turn the base about the axis x by an angle [rad]: gravity in the plane of motion is smaller by its cosine."""
    return replace(world, gravity=(world.gravity[0], world.gravity[1] * np.cos(size)))


@machine_fault
def apply_soft_gear(world: World, place: int, size: float, other: float) -> World:
    """Let the elastic gear have this part [-] of its stiffness: a loose screw."""
    return replace(world, spring=size * world.spring)


@machine_fault
def apply_spring(world: World, place: int, size: float, other: float) -> World:
    """Add a torsion spring [N m/rad] that rests at ``other`` [rad]."""
    return _add_extra(world, place, lambda motion, load: size * (motion.angle[:, place] - other))


def _push_at_end(world: World, place: int, stiffness: float, way: float) -> World:
    """Add an effort [N m] on the last part of a joint's way [rad], with a stiffness [N m/rad]."""

    def push(motion: Motion, load: Array) -> Array:
        angle = motion.angle[:, place]
        return np.asarray(stiffness * np.maximum(angle - (angle.max() - way), 0.0))

    return _add_extra(world, place, push)


@machine_fault
def apply_cable(world: World, place: int, size: float, other: float) -> World:
    """Add a hose that hangs loose but on the last ``other`` [rad], where it pulls with a stiffness [N m/rad]."""
    return _push_at_end(world, place, size, other)


@machine_fault
def apply_gear_ripple(world: World, place: int, size: float, other: float) -> World:
    """Add an effort [N m] with ``other`` periods for each turn of the joint."""
    return _add_extra(world, place, lambda motion, load: size * np.sin(other * motion.angle[:, place] + 0.7))


@machine_fault
def apply_bump(world: World, place: int, size: float, other: float) -> World:
    """Let somebody push a joint [N m] for 0.3 s at ``other`` [s]."""
    return _add_extra(world, place, lambda motion, load: size * np.exp(-(((motion.time - other) / 0.15) ** 2)))


@machine_fault
def apply_shaking_floor(world: World, place: int, size: float, other: float) -> World:
    """Add an effort [N m] that swings with ``other`` [Hz]: a machine beside it runs."""
    return _add_extra(world, place, lambda motion, load: size * np.sin(2 * np.pi * other * motion.time + 0.4))


@machine_fault
def apply_eddy_brake(world: World, place: int, size: float, other: float) -> World:
    """Add a drag [N m s^2/rad^2] with the square of the rate: a fan on the shaft."""
    return _add_extra(world, place, lambda motion, load: size * motion.rate[:, place] * np.abs(motion.rate[:, place]))


@machine_fault
def apply_end_stop(world: World, place: int, size: float, other: float) -> World:
    """Let a rubber stop stand ``other`` [rad] below the largest angle, with a stiffness [N m/rad]."""
    return _push_at_end(world, place, size, other)


@machine_fault
def apply_counterbalance(world: World, place: int, size: float, other: float) -> World:
    """Add a gas spring that lifts a share [N m] of the weight: an effort with the cosine of the angle, without any inertia."""
    return _add_extra(world, place, lambda motion, load: size * np.cos(motion.angle[:, place]))


@machine_fault
def apply_dropped_payload(world: World, place: int, size: float, other: float) -> World:
    """Let a point mass [kg] at 0.3 m be lost at ``other`` [s]."""
    heavy = replace(world, bodies=(*world.bodies, Body(place, size, (0.3, 0.0))))

    def carry(motion: Motion, load: Array) -> Array:
        there = (motion.time < other)[:, None]
        return np.where(there, compute_load(heavy, motion) - compute_load(world, motion), 0.0)

    return replace(world, extra=(*world.extra, carry))


@machine_fault
def apply_belt(world: World, place: int, size: float, other: float) -> World:
    """Let this part [-] of the elbow's effort be carried by the shoulder's motor: the belt of the elbow runs over its axis."""
    return _add_extra(world, 0, lambda motion, load: size * load[:, 1])


@machine_fault
def apply_soft_drive(world: World, place: int, size: float, other: float) -> World:
    """Let a drive that was thought stiff twist by load over a stiffness [N m/rad] between encoder and link."""
    return replace(world, twist=_shift(world.twist, place, 1.0 / size))


@machine_fault
def apply_longer_link(world: World, place: int, size: float, other: float) -> World:
    """Let the next joint stand further out by this [m]: a tube of another length."""
    return replace(world, lengths=tuple(_shift(np.array(world.lengths), place, size)))


@machine_fault
def apply_moved_mass(world: World, place: int, size: float, other: float) -> World:
    """Move the body of a link outward by this [m]."""

    def move(body: Body) -> Body:
        return replace(body, place=(body.place[0] + size * (body.link == place), body.place[1]))

    return replace(world, bodies=tuple(move(body) for body in world.bodies))


@machine_fault
def apply_weak_gravity(world: World, place: int, size: float, other: float) -> World:
    """Let gravity have this part [-] of what was believed."""
    return replace(world, gravity=(size * world.gravity[0], size * world.gravity[1]))


@machine_fault
def apply_load_friction(world: World, place: int, size: float, other: float) -> World:
    """Add dry friction of this part [-] of the load: worm gears, bearings."""
    return _add_extra(
        world, place, lambda motion, load: size * np.abs(load[:, place]) * np.tanh(motion.rate[:, place] / CREEP)
    )


@machine_fault
def apply_rough_spot(world: World, place: int, size: float, other: float) -> World:
    """Add dry friction [N m] that comes and goes with the sine of the angle: a bent shaft."""

    def rub(motion: Motion, load: Array) -> Array:
        angle, rate = motion.angle[:, place], motion.rate[:, place]
        return np.asarray(size * np.sin(angle + other) * np.tanh(rate / CREEP))

    return _add_extra(world, place, rub)


# What sensors and loggers do


@logger_fault
def apply_effort_offset(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Add a constant [N m] to an effort."""
    return _change_effort(record, place, lambda v: v + size)


@logger_fault
def apply_effort_gain(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Multiply an effort [-]: a wrong torque constant, sign or unit."""
    return _change_effort(record, place, lambda v: v * size)


@logger_fault
def apply_effort_drift(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let the zero of an effort drift by this [N m] from the first sample to the last."""
    return _change_effort(record, place, lambda v: v + size * np.linspace(0.0, 1.0, len(v)))


@logger_fault
def apply_gain_drift(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let the gain of an effort grow by this part [-] from the first sample to the last: magnets that warm up."""
    return _change_effort(record, place, lambda v: v * (1.0 + size * np.linspace(0.0, 1.0, len(v))))


@logger_fault
def apply_effort_step(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let the zero of an effort jump by this [N m] at ``other`` [s]."""
    return _change_effort(record, place, lambda v: v + size * (record.time >= other))


@logger_fault
def apply_effort_spikes(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let ``other`` single samples of an effort be off by this [N m], either way."""

    def add(v: Array) -> Array:
        at = random.choice(np.arange(300, len(v) - 300), int(other), replace=False)
        v = v.copy()
        v[at] += size * random.choice([-1.0, 1.0], len(at))
        return v

    return _change_effort(record, place, add)


@logger_fault
def apply_effort_dropout(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an effort read zero for this time [s] from ``other`` [s]."""
    inside = (record.time >= other) & (record.time < other + size)
    return _change_effort(record, place, lambda v: np.where(inside, 0.0, v))


@logger_fault
def apply_effort_frozen(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an effort keep its last value for this time [s] from ``other`` [s]."""
    inside = (record.time >= other) & (record.time < other + size)
    return _change_effort(record, place, lambda v: np.where(inside, v[np.argmax(inside)], v))


@logger_fault
def apply_effort_clipped(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an effort stop at this part [-] of its largest size."""
    return _change_effort(record, place, lambda v: np.clip(v, -size * np.abs(v).max(), size * np.abs(v).max()))


@logger_fault
def apply_effort_noise(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Add white noise [N m] to an effort."""
    return _change_effort(record, place, lambda v: v + size * random.normal(size=len(v)))


@logger_fault
def apply_effort_held(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an effort be fresh only every so many samples [-]."""
    return _change_effort(record, place, lambda v: v[np.arange(len(v)) // int(size) * int(size)])


@logger_fault
def apply_effort_coarse(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Round an effort to multiples of this [N m]."""
    return _change_effort(record, place, lambda v: size * np.round(v / size))


@logger_fault
def apply_effort_unsigned(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log the size [N m] of an effort without its sign."""
    return _change_effort(record, place, np.abs)


def _delay(v: Array, late: float) -> Array:
    at = np.arange(len(v)) * SPACING
    return np.asarray(np.interp(at - late, at, v))


def _lag(v: Array, constant: float) -> Array:
    keep = np.exp(-SPACING / constant)
    out = np.empty_like(v)
    out[0] = v[0]
    for i in range(1, len(v)):
        out[i] = keep * out[i - 1] + (1.0 - keep) * v[i]
    return out


@logger_fault
def apply_effort_delay(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log an effort late by this [s]."""
    return _change_effort(record, place, lambda v: _delay(v, size))


@logger_fault
def apply_effort_lag(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log an effort behind a first-order lag [s]."""
    return _change_effort(record, place, lambda v: _lag(v, size))


@logger_fault
def apply_angle_delay(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log an angle late by this [s]."""
    return _change_angle(record, place, lambda v: _delay(v, size))


@logger_fault
def apply_angle_lag(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log an angle behind a first-order lag [s]."""
    return _change_angle(record, place, lambda v: _lag(v, size))


@logger_fault
def apply_angle_offset(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Add a constant [rad] to an angle: homed at the wrong place."""
    return _change_angle(record, place, lambda v: v + size)


@logger_fault
def apply_angle_gain(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Multiply an angle [-]: wrong counts per turn, sign or unit."""
    return _change_angle(record, place, lambda v: v * size)


@logger_fault
def apply_angle_drift(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an angle creep by this [rad] from the first sample to the last: a coupling that slips."""
    return _change_angle(record, place, lambda v: v + size * np.linspace(0.0, 1.0, len(v)))


@logger_fault
def apply_angle_jump(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an angle jump by this [rad] at ``other`` [s]: lost counts."""
    return _change_angle(record, place, lambda v: v + size * (record.time >= other))


@logger_fault
def apply_angle_wrapped(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Wrap an angle into a turn that begins at this [rad]."""
    return _change_angle(record, place, lambda v: (v - size) % (2 * np.pi) + size)


@logger_fault
def apply_angle_spikes(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let ``other`` single samples of an angle be off by this [rad]: lost bits."""

    def add(v: Array) -> Array:
        at = random.choice(np.arange(300, len(v) - 300), int(other), replace=False)
        v = v.copy()
        v[at] += size
        return v

    return _change_angle(record, place, add)


@logger_fault
def apply_angle_frozen(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an angle keep its last value for this time [s] from ``other`` [s]."""
    inside = (record.time >= other) & (record.time < other + size)
    return _change_angle(record, place, lambda v: np.where(inside, v[np.argmax(inside)], v))


@logger_fault
def apply_angle_coarse(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Round an angle to multiples of this [rad]: lost lower bits."""
    return _change_angle(record, place, lambda v: size * np.round(v / size))


@logger_fault
def apply_angle_eccentric(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an encoder's disc run out: the angle is off by this [rad], ``other`` periods a turn."""
    return _change_angle(record, place, lambda v: v + size * np.sin(other * v + 0.3))


@logger_fault
def apply_swapped_efforts(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Swap the columns of the efforts [N m] of two joints."""
    return replace(record, effort=record.effort[:, ::-1])


@logger_fault
def apply_swapped_angles(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Swap the columns of the angles [rad] of two joints."""
    return replace(record, angle=record.angle[:, ::-1])


@logger_fault
def apply_swapped_joints(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Swap angles [rad] and efforts [N m] of two joints."""
    return replace(record, angle=record.angle[:, ::-1], effort=record.effort[:, ::-1])


@logger_fault
def apply_copied_effort(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Write the effort [N m] of the other joint into the column of this one."""
    return replace(record, effort=np.column_stack([record.effort[:, 1 - place]] * 2))


@logger_fault
def apply_crosstalk(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let this part [-] of the other joint's effort leak into this one's."""
    return _change_effort(record, place, lambda v: v + size * record.effort[:, 1 - place])


@logger_fault
def apply_absolute_angle(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log the elbow's angle [rad] against the world instead of the upper arm."""
    return _change_angle(record, 1, lambda v: v + record.angle[:, 0])


@logger_fault
def apply_clock(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Multiply the time stamps [s] by this [-]."""
    return replace(record, time=record.time * size)


@logger_fault
def apply_jitter(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let samples be taken early or late by this [s] (standard deviation), and stamped evenly."""
    at = record.time + size * random.normal(size=len(record.time))

    def take(values: Array) -> Array:
        return _change_column(values, -1, lambda v: np.interp(at, record.time, v))

    return replace(record, angle=take(record.angle), effort=take(record.effort))


@logger_fault
def apply_lost_rows(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Lose this time [s] of rows at ``other`` [s]; the time stamps are numbered through, as if nothing was lost."""
    keep = (record.time < other) | (record.time >= other + size)
    count = int(keep.sum())
    return Record(record.time[:count], record.angle[keep], record.effort[keep])


@logger_fault
def apply_gap(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Lose this time [s] of rows at ``other`` [s]; the time stamps tell of it."""
    keep = (record.time < other) | (record.time >= other + size)
    return Record(record.time[keep], record.angle[keep], record.effort[keep])


@logger_fault
def apply_empty_cells(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Leave this many cells [-] of an effort empty."""

    def empty(v: Array) -> Array:
        v = v.copy()
        v[random.choice(len(v), int(size), replace=False)] = np.nan
        return v

    return _change_effort(record, place, empty)


@logger_fault
def apply_iron_saturation(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let a motor need this part [-] more current at the largest effort, and less of it below, by the square."""
    return _change_effort(record, place, lambda v: v * (1.0 + size * (v / np.abs(v).max()) ** 2))


@logger_fault
def apply_dead_band(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an effort below this [N m] read zero, and all others so much less."""
    return _change_effort(record, place, lambda v: np.sign(v) * np.maximum(np.abs(v) - size, 0.0))


@logger_fault
def apply_one_sided_gain(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Multiply positive efforts alone [-]: one half of an amplifier."""
    return _change_effort(record, place, lambda v: np.where(v > 0.0, size * v, v))


@logger_fault
def apply_overflow(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let an effort wrap round beyond this part [-] of its largest size, as an integer does."""

    def wrap(v: Array) -> Array:
        top = size * np.abs(v).max()
        return np.asarray((v + top) % (2.0 * top) - top)

    return _change_effort(record, place, wrap)


@logger_fault
def apply_mean_removed(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Take its mean [N m] off an effort."""
    return _change_effort(record, place, lambda v: v - v.mean())


@logger_fault
def apply_high_pass(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log an effort behind a high-pass with this time constant [s]: an input coupled for alternating current."""
    return _change_effort(record, place, lambda v: v - _lag(v, size))


@logger_fault
def apply_smoothed_effort(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Average an effort over this time [s], centred."""
    count = 2 * round(size / SPACING / 2) + 1

    def smooth(v: Array) -> Array:
        return np.convolve(np.pad(v, count // 2, "edge"), np.ones(count) / count, "valid")

    return _change_effort(record, place, smooth)


@logger_fault
def apply_hum(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Add a sine [N m] of ``other`` [Hz] to an effort: mains, aliased."""
    return _change_effort(record, place, lambda v: v + size * np.sin(2 * np.pi * other * record.time))


@logger_fault
def apply_late_after(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let efforts come late by this [s] from ``other`` [s] on: a buffer that has filled."""
    return _change_effort(record, place, lambda v: np.where(record.time < other, v, _delay(v, size)))


@logger_fault
def apply_uneven_clock(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Stamp evenly what was sampled ever faster: by this part [-] at the last sample."""
    at = record.time - size * record.time**2 / 2.0 / record.time[-1]

    def take(values: Array) -> Array:
        return _change_column(values, -1, lambda v: np.interp(at, record.time, v))

    return replace(record, angle=take(record.angle), effort=take(record.effort))


@logger_fault
def apply_coupled_angle(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let the elbow's encoder turn by this part [-] of the shoulder's angle: a belt over the shoulder's axis."""
    return _change_angle(record, 1, lambda v: v + size * record.angle[:, 0])


@logger_fault
def apply_zeroed_angle(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Count an angle [rad] from where the log begins."""
    return _change_angle(record, place, lambda v: v - v[0])


@logger_fault
def apply_commanded_angle(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Log where the joint should be, which it reaches this much later [s]."""
    return _change_angle(record, place, lambda v: _delay(v, -size))


@logger_fault
def apply_flipped_bits(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let this many single samples [-] of an effort have the other sign."""

    def flip(v: Array) -> Array:
        at = random.choice(np.arange(300, len(v) - 300), int(size), replace=False)
        v = v.copy()
        v[at] *= -1.0
        return v

    return _change_effort(record, place, flip)


@logger_fault
def apply_warm_up(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Let the zero of an effort be off by this [N m] at first, and settle with a time constant of ``other`` [s]."""
    return _change_effort(record, place, lambda v: v + size * np.exp(-record.time / other))


@logger_fault
def apply_bent_sensor(record: Record, place: int, size: float, other: float, random: Random) -> Record:
    """Add this part [-] of an effort's square over its largest size: a sensor that is not linear."""
    return _change_effort(record, place, lambda v: v + size * v**2 / np.abs(v).max())
