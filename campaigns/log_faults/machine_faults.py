"""Faults of machines: what a `World` truly has beside what was identified, or instead of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from campaigns.log_faults.machines import CREEP, Body, Motion, World, compute_load
from campaigns.log_faults.plants import add_machine_fault
from flexinv.typing import Array


def _scale_at(values: Array, place: int, factor: float) -> Array:
    return values * np.where(np.arange(len(values)) == place, factor, 1.0)


def _add_at(values: Array, place: int, size: float) -> Array:
    return values + np.where(np.arange(len(values)) == place, size, 0.0)


def _add_extra(world: World, place: int, effort: Callable[[Motion, Array], Array]) -> World:
    """Add an effort (samples,) [N m] of motion and load at a joint."""

    def add_effort(motion: Motion, load: Array) -> Array:
        out = np.zeros_like(load)
        out[:, place] = effort(motion, load)
        return out

    return replace(world, extra=(*world.extra, add_effort))


@add_machine_fault
def apply_payload(world: World, place: int, size: float, other: float) -> World:
    """Add a point mass [kg] on a link, ``other`` [m] along it; a negative one was lost."""
    return replace(world, bodies=(*world.bodies, Body(place, size, (other, 0.0))))


@add_machine_fault
def apply_rotor(world: World, place: int, size: float, other: float) -> World:
    """Change the rotor inertia by ``size`` [kg m^2]: another motor was fitted."""
    return replace(world, rotor=_add_at(world.rotor, place, size))


@add_machine_fault
def apply_drag(world: World, place: int, size: float, other: float) -> World:
    """Add dry friction [N m]: a brake that does not lift."""
    return replace(world, coulomb=_add_at(world.coulomb, place, size))


@add_machine_fault
def apply_cold_grease(world: World, place: int, size: float, other: float) -> World:
    """Add viscous friction [N m s/rad]."""
    return replace(world, viscous=_add_at(world.viscous, place, size))


@add_machine_fault
def apply_stiction(world: World, place: int, size: float, other: float) -> World:
    """Let dry friction be larger by this part [-] at low rates (0.2 rad/s)."""
    return replace(world, stribeck=_add_at(world.stribeck, place, size))


@add_machine_fault
def apply_asymmetry(world: World, place: int, size: float, other: float) -> World:
    """Let friction be larger one way than the other by twice this [N m]."""
    return replace(world, asymmetry=_add_at(world.asymmetry, place, size))


@add_machine_fault
def apply_warming(world: World, place: int, size: float, other: float) -> World:
    """Let all friction of a joint grow by this part [-] from the first sample to the last."""
    return replace(world, growth=_add_at(world.growth, place, size))


@add_machine_fault
def apply_efficiency(world: World, place: int, size: float, other: float) -> World:
    """Let a gear give this part [-] of the power that it takes."""
    return replace(world, efficiency=_scale_at(world.efficiency, place, size))


@add_machine_fault
def apply_backlash(world: World, place: int, size: float, other: float) -> World:
    """Let a gear have this play [rad] between motor with encoder, and link."""
    return replace(world, backlash=_add_at(world.backlash, place, size))


@add_machine_fault
def apply_base_tilt(world: World, place: int, size: float, other: float) -> World:
    """Turn the base about the axis y of the joints by an angle [rad]: the world's gravity turns back in its frame."""
    x, z = world.gravity
    turned = complex(x, z) * np.exp(1j * size)
    return replace(world, gravity=(turned.real, turned.imag))


@add_machine_fault
def apply_base_lean(world: World, place: int, size: float, other: float) -> World:
    """Turn the base about the axis x by an angle [rad]: gravity in the plane of motion is smaller by its cosine."""
    return replace(world, gravity=(world.gravity[0], world.gravity[1] * np.cos(size)))


@add_machine_fault
def apply_soft_gear(world: World, place: int, size: float, other: float) -> World:
    """Let the elastic gear have this part [-] of its stiffness: a loose screw."""
    return replace(world, spring=size * world.spring)


@add_machine_fault
def apply_spring(world: World, place: int, size: float, other: float) -> World:
    """Add a torsion spring [N m/rad] that rests at ``other`` [rad]."""
    return _add_extra(world, place, lambda motion, load: size * (motion.angle[:, place] - other))


def _add_end_spring(world: World, place: int, stiffness: float, way: float) -> World:
    """Add an effort [N m] on the last part of a joint's way [rad], with a stiffness [N m/rad]."""

    def compute_push(motion: Motion, load: Array) -> Array:
        angle = motion.angle[:, place]
        return np.asarray(stiffness * np.maximum(angle - (angle.max() - way), 0.0))

    return _add_extra(world, place, compute_push)


@add_machine_fault
def apply_cable(world: World, place: int, size: float, other: float) -> World:
    """Add a hose that hangs loose but on the last ``other`` [rad], where it pulls with a stiffness [N m/rad]."""
    return _add_end_spring(world, place, size, other)


@add_machine_fault
def apply_gear_ripple(world: World, place: int, size: float, other: float) -> World:
    """Add an effort [N m] with ``other`` periods for each turn of the joint."""
    return _add_extra(world, place, lambda motion, load: size * np.sin(other * motion.angle[:, place] + 0.7))


@add_machine_fault
def apply_bump(world: World, place: int, size: float, other: float) -> World:
    """Let somebody push a joint [N m] for 0.3 s at ``other`` [s]."""
    return _add_extra(world, place, lambda motion, load: size * np.exp(-(((motion.time - other) / 0.15) ** 2)))


@add_machine_fault
def apply_shaking_floor(world: World, place: int, size: float, other: float) -> World:
    """Add an effort [N m] that swings with ``other`` [Hz]: a machine beside it runs."""
    return _add_extra(world, place, lambda motion, load: size * np.sin(2 * np.pi * other * motion.time + 0.4))


@add_machine_fault
def apply_eddy_brake(world: World, place: int, size: float, other: float) -> World:
    """Add a drag [N m s^2/rad^2] with the square of the rate: a fan on the shaft."""
    return _add_extra(world, place, lambda motion, load: size * motion.rate[:, place] * np.abs(motion.rate[:, place]))


@add_machine_fault
def apply_end_stop(world: World, place: int, size: float, other: float) -> World:
    """Let a rubber stop stand ``other`` [rad] below the largest angle, with a stiffness [N m/rad]."""
    return _add_end_spring(world, place, size, other)


@add_machine_fault
def apply_counterbalance(world: World, place: int, size: float, other: float) -> World:
    """Add a gas spring that lifts a share [N m] of the weight: an effort with the cosine of the angle, without any inertia."""
    return _add_extra(world, place, lambda motion, load: size * np.cos(motion.angle[:, place]))


@add_machine_fault
def apply_dropped_payload(world: World, place: int, size: float, other: float) -> World:
    """Let a point mass [kg] at 0.3 m be lost at ``other`` [s]."""
    heavy = replace(world, bodies=(*world.bodies, Body(place, size, (0.3, 0.0))))

    def compute_weight(motion: Motion, load: Array) -> Array:
        there = (motion.time < other)[:, None]
        return np.where(there, compute_load(heavy, motion) - compute_load(world, motion), 0.0)

    return replace(world, extra=(*world.extra, compute_weight))


@add_machine_fault
def apply_belt(world: World, place: int, size: float, other: float) -> World:
    """Let this part [-] of the elbow's effort be carried by the shoulder's motor: the belt of the elbow runs over its axis."""
    return _add_extra(world, 0, lambda motion, load: size * load[:, 1])


@add_machine_fault
def apply_soft_drive(world: World, place: int, size: float, other: float) -> World:
    """Let a drive that was thought stiff twist by load over a stiffness [N m/rad] between encoder and link."""
    return replace(world, twist=_add_at(world.twist, place, 1.0 / size))


@add_machine_fault
def apply_longer_link(world: World, place: int, size: float, other: float) -> World:
    """Let the next joint stand further out by this [m]: a tube of another length."""
    return replace(world, lengths=tuple(_add_at(np.array(world.lengths), place, size)))


@add_machine_fault
def apply_moved_mass(world: World, place: int, size: float, other: float) -> World:
    """Move the body of a link outward by this [m]."""

    def move(body: Body) -> Body:
        return replace(body, place=(body.place[0] + size * (body.link == place), body.place[1]))

    return replace(world, bodies=tuple(move(body) for body in world.bodies))


@add_machine_fault
def apply_weak_gravity(world: World, place: int, size: float, other: float) -> World:
    """Let gravity have this part [-] of what was believed."""
    return replace(world, gravity=(size * world.gravity[0], size * world.gravity[1]))


@add_machine_fault
def apply_load_friction(world: World, place: int, size: float, other: float) -> World:
    """Add dry friction of this part [-] of the load: worm gears, bearings."""
    return _add_extra(
        world, place, lambda motion, load: size * np.abs(load[:, place]) * np.tanh(motion.rate[:, place] / CREEP)
    )


@add_machine_fault
def apply_rough_spot(world: World, place: int, size: float, other: float) -> World:
    """Add dry friction [N m] that comes and goes with the sine of the angle: a bent shaft."""

    def compute_rubbing(motion: Motion, load: Array) -> Array:
        sense = np.tanh(motion.rate[:, place] / CREEP)
        return np.asarray(size * np.sin(motion.angle[:, place] + other) * sense)

    return _add_extra(world, place, compute_rubbing)
