"""Machines of known truth in closed form: a pendulum, an arm and an elastic drive, each turning about y in the plane x, z.

Efforts follow from accelerations of points, by no code of flexinv:

tau_j = sum_i (r_i - p_j) x m_i (a_i - g) + I_i alpha_i    over the bodies i beyond joint j

The effort of a drive is tau_j behind its gear, and rotor, friction and offset.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from flexinv.typing import Array

SPACING = 0.004  # [s]
SECONDS = 8.0  # [s]
GRAVITY = 9.81
CREEP = 0.02  # [rad/s]: below this dry friction has not its full size
TURN = 0.5  # [N m]: a gear passes its backlash while its load changes by this
ENCODER_NOISE = 1e-5  # [rad]


@dataclass(frozen=True)
class Body:
    """A body of a link: mass [kg], place (x, z) in the frame of the link [m], inertia about its centre and y [kg m^2]."""

    link: int
    mass: float
    place: tuple[float, float]
    inertia: float = 0.0


@dataclass(frozen=True)
class Motion:
    """Motion of all joints: time (samples,) [s]; angle, rate, acceleration (samples, joints) [rad] and per second."""

    time: Array
    angle: Array
    rate: Array
    acceleration: Array


ExtraEffort = Callable[[Motion, Array], Array]


@dataclass(frozen=True)
class World:
    """A machine as it truly is.

    lengths : from joint to joint [m]; gravity : (x, z) [m/s^2]; seconds : of a log [s]; noise : of efforts [N m]
    centre : of the motion of each joint [rad]; spring : of an elastic gear [N m/rad], damper [N m s/rad], no spring: stiff
    rotor [kg m^2], viscous [N m s/rad], coulomb, offset, asymmetry [N m], stribeck [-], growth of friction within the log [-],
    efficiency [-], backlash [rad], twist of drives [rad/(N m)] : (joints,)
    extra : further efforts (samples, joints) [N m] of motion and load
    """

    lengths: tuple[float, ...]
    bodies: tuple[Body, ...]
    rotor: Array
    viscous: Array
    coulomb: Array
    offset: Array
    noise: float
    centre: tuple[float, ...]
    gravity: tuple[float, float] = (0.0, -GRAVITY)
    seconds: float = SECONDS
    spring: float = 0.0
    damper: float = 0.0
    asymmetry: Array = field(default_factory=lambda: np.zeros(2))
    stribeck: Array = field(default_factory=lambda: np.zeros(2))
    growth: Array = field(default_factory=lambda: np.zeros(2))
    efficiency: Array = field(default_factory=lambda: np.ones(2))
    backlash: Array = field(default_factory=lambda: np.zeros(2))
    twist: Array = field(default_factory=lambda: np.zeros(2))
    extra: tuple[ExtraEffort, ...] = ()

    @property
    def joints(self) -> int:
        """The number of joints [-]."""
        return len(self.lengths)


@dataclass(frozen=True)
class Record:
    """The numbers of a log: time (samples,) [s]; angle, effort (samples, joints) [rad], [N m]."""

    time: Array
    angle: Array
    effort: Array


def turn_place(angle: Array, place: tuple[float, float]) -> Array:
    """Return a place (x, z) [m] turned about y by angles [rad] (samples,), as (samples, 2)."""
    x, z = place
    return np.column_stack([x * np.cos(angle) + z * np.sin(angle), z * np.cos(angle) - x * np.sin(angle)])


def _compute_acceleration(angle: Array, rate: Array, acceleration: Array, place: tuple[float, float]) -> Array:
    across = turn_place(angle + np.pi / 2, place)
    return acceleration[:, None] * across - (rate**2)[:, None] * turn_place(angle, place)


def compute_load(world: World, motion: Motion) -> Array:
    """Return the efforts (samples, joints) [N m] that move the links alone: no rotors, no friction."""
    angle, rate, acceleration = (np.cumsum(a, axis=1) for a in (motion.angle, motion.rate, motion.acceleration))
    count = len(motion.time)
    joint_place = [np.zeros((count, 2))]
    joint_acceleration = [np.zeros((count, 2))]
    for k, length in enumerate(world.lengths):
        arm = (length, 0.0)
        joint_place.append(joint_place[k] + turn_place(angle[:, k], arm))
        joint_acceleration.append(
            joint_acceleration[k] + _compute_acceleration(angle[:, k], rate[:, k], acceleration[:, k], arm)
        )
    load = np.zeros((count, world.joints))
    for body in world.bodies:
        k = body.link
        place = joint_place[k] + turn_place(angle[:, k], body.place)
        own = joint_acceleration[k] + _compute_acceleration(angle[:, k], rate[:, k], acceleration[:, k], body.place)
        force = body.mass * (own - np.array(world.gravity))
        for j in range(k + 1):
            lever = place - joint_place[j]
            load[:, j] += lever[:, 1] * force[:, 0] - lever[:, 0] * force[:, 1] + body.inertia * acceleration[:, k]
    return load


def compute_motion(time: Array, angle: Array) -> Motion:
    """Return a motion of angles (samples, joints) [rad] with rate and acceleration by splines."""
    spline = CubicSpline(time, angle)
    return Motion(time, angle, spline(time, 1), spline(time, 2))


def find_static_moment(world: World) -> complex:
    """Return the sum of mass times place, x + i z, of a single link [kg m]."""
    return sum((b.mass * complex(*b.place) for b in world.bodies), 0j)


def integrate_elastic_link(world: World, motor: Motion) -> Motion:
    """Return the motion of a link behind an elastic gear [rad]: I q'' = M_g(q) - k (q - theta) - d (q' - theta').

    From rest in equilibrium, by the Runge-Kutta method of fourth order in four steps a sample.
    """
    moment = find_static_moment(world)
    gravity = complex(*world.gravity)
    inertia = sum(b.inertia + b.mass * (b.place[0] ** 2 + b.place[1] ** 2) for b in world.bodies)
    parts = 4
    fine = np.linspace(0.0, motor.time[-1], 2 * parts * (len(motor.time) - 1) + 1)
    spline = CubicSpline(motor.time, motor.angle[:, 0])
    theta = spline(fine)
    omega = spline(fine, 1)

    def compute_pull(q: float) -> float:
        turned = moment * np.exp(-1j * q)
        return float((np.conj(gravity) * turned).imag)

    def compute_slope(state: Array, i: int) -> Array:
        elastic = world.spring * (state[0] - theta[i]) + world.damper * (state[1] - omega[i])
        return np.array([state[1], (compute_pull(state[0]) - elastic) / inertia])

    start = theta[0]
    for _ in range(50):  # the spring is stiff beside gravity: each round leaves a small part of the error
        start = theta[0] + compute_pull(start) / world.spring
    states = _integrate(compute_slope, np.array([start, 0.0]), 2.0 * (fine[1] - fine[0]), len(fine) // 2)
    return compute_motion(motor.time, states[::parts, :1])


def _integrate(slope: Callable[[Array, int], Array], state: Array, step: float, count: int) -> Array:
    """States (count + 1, 2) by Runge-Kutta; ``slope`` is asked for by the number of half a step."""
    out = [state]
    for i in range(0, 2 * count, 2):
        a = slope(state, i)
        b = slope(state + step / 2 * a, i + 1)
        c = slope(state + step / 2 * b, i + 1)
        d = slope(state + step * c, i + 2)
        state = state + step / 6 * (a + 2 * b + 2 * c + d)
        out.append(state)
    return np.array(out)


def compute_friction(world: World, motion: Motion) -> Array:
    """Return the friction (samples, joints) [N m] of the drives."""
    n = world.joints
    sense = np.tanh(motion.rate / CREEP)
    dry = world.coulomb[:n] * (1.0 + world.stribeck[:n] * np.exp(-((motion.rate / 0.2) ** 2)))
    warm = 1.0 + world.growth[:n] * motion.time[:, None] / motion.time[-1]
    both_ways = warm * (dry * sense + world.viscous[:n] * motion.rate)
    return np.asarray(both_ways + world.asymmetry[:n] * np.abs(sense))


def run_machine(world: World, motion: Motion) -> Record:
    """Return the record [s, rad, N m] of a machine whose motors make a motion, as a logger without faults writes it."""
    n = world.joints
    link = integrate_elastic_link(world, motion) if world.spring else motion
    load = compute_load(world, link)
    motor = motion
    if world.backlash.any() or world.twist.any():
        play = world.backlash[:n] / 2 * np.tanh(load / TURN)
        motor = compute_motion(motion.time, motion.angle + play + world.twist[:n] * load)
    load = load + sum((extra(link, load) for extra in world.extra), np.zeros_like(load))
    drives = np.tanh(load * motor.rate / 0.05)  # 1 where the motor drives the load, -1 where the load drives it
    behind = load * world.efficiency[:n] ** -drives
    effort = behind + world.rotor[:n] * motor.acceleration + compute_friction(world, motor) + world.offset[:n]
    return Record(motion.time, motor.angle, effort)


def add_noise(record: Record, world: World, random: np.random.Generator) -> Record:
    """Return a record with noise on efforts [N m] and encoders [rad]."""
    shape = record.effort.shape
    return replace(
        record,
        angle=record.angle + ENCODER_NOISE * random.normal(size=shape),
        effort=record.effort + world.noise * random.normal(size=shape),
    )


def sample_motion(world: World, random: np.random.Generator, moves: bool) -> Motion:
    """Return a motion [rad] that begins at rest: sums of sines, or with ``moves`` from point to point with rests."""
    time = np.asarray(SPACING * np.arange(round(world.seconds / SPACING)), dtype=np.float64)
    angle = np.column_stack([_sample_angle(time, random, moves) + centre for centre in world.centre])
    return compute_motion(time, angle)


def _sample_angle(time: Array, random: np.random.Generator, moves: bool) -> Array:
    angle = np.zeros_like(time)
    if not moves:
        for frequency, size in ((0.125, 0.45), (0.25, 0.35), (0.5, 0.25), (0.9, 0.12)):
            size *= random.uniform(0.7, 1.2)
            angle += size * np.sin(2 * np.pi * frequency * time + random.uniform(0, 2 * np.pi))
        return np.asarray((angle - angle[0]) * _build_step(time))
    start = 0.2
    at = 0.0
    while start < time[-1] - 1.0:
        goal = float(random.uniform(0.4, 1.0) * (-1 if at > 0 else 1))
        takes = float(random.uniform(0.6, 1.1))
        angle += (goal - at) * _build_step((time - start) / takes)
        at = goal
        start += takes + float(random.uniform(0.1, 0.3))
    return angle


def _build_step(s: Array) -> Array:
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def sample_day(world: World, random: np.random.Generator) -> World:
    """Return the machine on another day: friction and offsets [N m] are 10 to 20 % more or less."""

    def draw(values: Array) -> Array:
        return values * (1.0 + random.choice([-1.0, 1.0], values.shape) * random.uniform(0.1, 0.2, values.shape))

    return replace(world, viscous=draw(world.viscous), coulomb=draw(world.coulomb), offset=draw(world.offset))


PENDULUM = World(
    lengths=(0.5,),
    bodies=(Body(0, 4.0, (0.25, 0.0), 0.10),),
    rotor=np.array([0.2]),
    viscous=np.array([1.5]),
    coulomb=np.array([1.2]),
    offset=np.array([0.2]),
    noise=0.03,
    centre=(1.0,),
)
ARM = World(
    lengths=(0.4, 0.35),
    bodies=(Body(0, 5.0, (0.2, 0.0), 0.10), Body(1, 3.0, (0.15, 0.02), 0.04)),
    rotor=np.array([0.3, 0.1]),
    viscous=np.array([4.0, 1.0]),
    coulomb=np.array([2.0, 1.0]),
    offset=np.array([0.3, -0.15]),
    noise=0.05,
    centre=(0.8, 0.3),
)
ELASTIC = World(
    lengths=(0.6,),
    bodies=(Body(0, 3.0, (0.3, 0.0), 0.12),),
    rotor=np.array([0.3]),
    viscous=np.array([1.2]),
    coulomb=np.array([1.0]),
    offset=np.array([0.15]),
    noise=0.03,
    centre=(1.0,),
    seconds=4.5,
    spring=500.0,
    damper=1.5,
)
WORLDS = {"pendulum": PENDULUM, "arm": ARM, "elastic": ELASTIC}
JOINTS = {"pendulum": ("hinge",), "arm": ("shoulder", "elbow"), "elastic": ("motor",)}
CURRENT = {"pendulum": 5.0}  # [N m/A]: machines whose log has currents


def write_log(name: str, record: Record, file: Path) -> Path:
    """Write a record [s, rad, N m or A] as the CSV file that a logger leaves; return the file."""
    columns = {"time_s": record.time}
    for j in range(record.angle.shape[1]):
        columns[f"q{j + 1}"] = record.angle[:, j]
        columns[f"t{j + 1}"] = record.effort[:, j] / CURRENT.get(name, 1.0)
    rows = np.column_stack(list(columns.values()))
    np.savetxt(file, rows, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
    return file
