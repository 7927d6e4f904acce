"""Random mechanisms for the campaign of spectra: trees and loops of rigid links and beams, with all that may act on them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.mechanism import (
    WORLD,
    Attachment,
    Beam,
    Body,
    Closure,
    Force,
    Inertia,
    Joint,
    Link,
    Mechanism,
    Placement,
    Section,
    Spring,
)
from flexinv.typing import Array

Dice = np.random.Generator
SCALARS = ("revolute", "continuous", "prismatic", "helical")
Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class DrawnMachine:
    """A mechanism, the joints that are free, the rates of those that turn [rad/s], and in words what it has."""

    mechanism: Mechanism
    free: tuple[str, ...]
    rates: dict[str, float]
    features: tuple[str, ...]


def drawn(seed: int, number: int) -> DrawnMachine:
    """Return mechanism ``number`` of a seed [m, kg, rad]: the same one each time."""
    dice = np.random.default_rng([34, seed, number])
    turning = dice.random() < 0.35
    based = not turning and dice.random() < 0.2
    inertia = str(dice.choice(["all", "no rotary inertia", "points"]))
    links: list[Link] = []
    joints: list[Joint] = []
    for k in range(int(dice.integers(1 + turning, 5))):
        flexible = dice.random() < 0.5 and not (k == 0 and (turning or based))
        link = draw_beam(dice, k, inertia) if flexible else draw_rigid_link(dice, k, inertia)
        joints.append(_joint(dice, k, links, turning, based))
        links.append(link)
    mechanism = Mechanism("drawn", tuple(links), tuple(joints), _gravity(dice, turning))
    mechanism = replace(mechanism, springs=tuple(draw_springs(dice, mechanism, turning)))
    mechanism = replace(mechanism, forces=tuple(_forces(dice, mechanism, turning)))
    moving = [j.name for j in joints if j.nv and (j.kind == "free" or dice.random() < 0.6)]
    if not moving and mechanism.is_rigid:
        moving = [j.name for j in joints if j.nv]
    mechanism = _tied(dice, mechanism, moving, turning)
    if mechanism.closures:
        passive = {name for name in moving if not (turning and name == "joint 0")}
        loose = tuple(replace(j, actuated=j.name not in passive) for j in mechanism.joints)
        mechanism = replace(mechanism, joints=loose)
    rates = {"joint 0": float(dice.uniform(1.0, 30.0))} if turning else {}
    return DrawnMachine(mechanism, tuple(moving), rates, _words(mechanism, inertia, rates))


def _words(mechanism: Mechanism, inertia: str, rates: dict[str, float]) -> tuple[str, ...]:
    """What a mechanism has, for counts."""
    has = {
        "beams": not mechanism.is_rigid,
        "closures": any(c.kind != "coupling" for c in mechanism.closures),
        "couplings": any(c.kind == "coupling" for c in mechanism.closures),
        "springs": bool(mechanism.springs),
        "dampers": any(j.damping for j in mechanism.joints) or any(s.damping for s in mechanism.springs),
        "damped beams": any(b.beam.section.damping is not None for b in mechanism.beams if b.beam is not None),
        "follower loads": any(f.follower for f in mechanism.forces),
        "dead loads": any(not f.follower for f in mechanism.forces),
        "gravity": bool(mechanism.gravity.any()),
        "rates": bool(rates),
        "free base": any(j.kind == "free" for j in mechanism.joints),
        inertia: inertia != "all",
    }
    return tuple(word for word, there in has.items() if there)


def _unit(dice: Dice) -> Array:
    axis = dice.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis))


def _turn(dice: Dice) -> Array:
    return np.asarray(Rotation.random(random_state=int(dice.integers(2**31))).as_matrix())


def _gravity(dice: Dice, turning: bool) -> Array:
    if dice.random() < 0.4:
        return np.zeros(3)
    return -9.81 * Z if turning else 9.81 * _unit(dice)


def _inertia(dice: Dice, points: bool) -> Inertia:
    mass = float(dice.uniform(0.2, 3.0))
    com = dice.uniform(-0.2, 0.2, 3)
    if points:
        return Inertia(mass, com)
    arms = dice.normal(size=(4, 3)) * 0.1
    tensor = sum((a @ a * np.eye(3) - np.outer(a, a) for a in arms), np.zeros((3, 3)))
    return Inertia(mass, com, tensor)


def draw_rigid_link(dice: Dice, k: int, inertia: str) -> Link:
    count = 2 if inertia == "points" else 1
    bodies = tuple(Body(f"body {k} {i}", _inertia(dice, inertia == "points")) for i in range(count))
    return Link(f"link {k}", bodies, tip=dice.uniform(0.1, 0.4, 3))


def draw_beam(dice: Dice, k: int, inertia: str) -> Link:
    """A slender beam, stiff enough for the loads here, with a body at its tip now and then."""
    length = float(dice.uniform(0.4, 1.0))
    bending = dice.uniform(50.0, 500.0, 2)
    shear = 10 ** dice.uniform(4.0, 7.0)
    stiffness = np.array([[3 * shear, shear, shear, dice.uniform(50.0, 500.0), *bending]])
    rotary = 1e-4 * dice.uniform(0.5, 2.0, (1, 3))
    if inertia != "all":
        rotary[0, 1:] = 0.0
    if inertia == "points":
        rotary[:] = 0.0
    damping = 10 ** dice.uniform(-5.0, -3.0) * stiffness if dice.random() < 0.3 else None
    section = Section(np.zeros(1), stiffness, dice.uniform(0.3, 2.0, 1), rotary, damping)
    bodies: tuple[Body, ...] = ()
    if dice.random() < 0.5:
        bodies = (Body(f"payload {k}", _inertia(dice, inertia == "points"), 1.0),)
    curvature = 0.3 * dice.normal(size=3) if dice.random() < 0.3 else np.zeros(3)
    beam = Beam(length, section, int(dice.integers(1, 3)), int(dice.integers(1, 4)), curvature)
    return Link(f"link {k}", bodies, beam)


def _joint(dice: Dice, k: int, links: list[Link], turning: bool, based: bool) -> Joint:
    if k == 0 and turning:
        return Joint("joint 0", "revolute", WORLD, "link 0", axis=Z, damping=float(dice.choice([0.0, 0.2])))
    if k == 0 and based:
        return Joint("joint 0", "free", WORLD, "link 0", actuated=False)
    kinds = (*SCALARS[:3], "fixed", "helical", "spherical", "universal")
    kind = str(dice.choice(kinds, p=[0.35, 0.1, 0.15, 0.15, 0.05, 0.1, 0.1]))
    parent = links[-1] if links and (turning or dice.random() < 0.8) else None
    station = None
    if parent is not None and parent.beam is not None:
        station = float(dice.choice([1.0, 0.5])) if parent.beam.elements * parent.beam.order % 2 == 0 else 1.0
        if kind == "universal":
            kind = "revolute"
    if parent is None and kind == "universal":
        kind = "revolute"
    at = Placement(dice.uniform(-0.3, 0.3, 3) if station is None else np.zeros(3), _turn(dice))
    axis = _unit(dice)
    second = np.cross(axis, _unit(dice))
    second /= np.linalg.norm(second)
    own: dict[str, float] = {}
    if kind in SCALARS:
        own["damping"] = float(dice.choice([0.0, 0.0, dice.uniform(0.01, 1.0)]))
        own["rotor_inertia"] = float(dice.choice([0.0, dice.uniform(0.0, 0.1)]))
    if kind in ("revolute", "prismatic", "helical") and dice.random() < 0.6:
        own["stiffness"] = float(10 ** dice.uniform(0.0, 3.0))
        own["rest"] = float(dice.uniform(-0.1, 0.1))
    pitch = float(dice.uniform(0.05, 0.3)) if kind == "helical" else 0.0
    return Joint(
        f"joint {k}", kind, WORLD if parent is None else parent.name, f"link {k}", at, station, axis, second,
        pitch=pitch, **own,
    )  # fmt: skip


def _end(dice: Dice, link: Link) -> Attachment:
    """A point of a link: of a beam one of its sections."""
    if link.beam is None:
        return Attachment(link.name, Placement(dice.uniform(-0.3, 0.3, 3)))
    return Attachment(link.name, Placement(dice.uniform(-0.05, 0.05, 3)), 1.0)


def draw_springs(dice: Dice, mechanism: Mechanism, turning: bool) -> list[Spring]:
    out = []
    for k in range(int(dice.choice([0, 0, 1, 2]))):
        first = mechanism.links[int(dice.integers(len(mechanism.links)))]
        others = [link for link in mechanism.links if link is not first]
        second = others[int(dice.integers(len(others)))] if others and (turning or dice.random() < 0.5) else None
        if second is None and turning:
            continue
        end = Attachment(WORLD, Placement(dice.uniform(-1.0, 1.0, 3))) if second is None else _end(dice, second)
        damping = float(dice.choice([0.0, dice.uniform(0.1, 2.0)]))
        out.append(
            Spring(f"spring {k}", _end(dice, first), end, float(dice.uniform(10, 200)), dice.uniform(0.2, 0.6), damping)
        )
    return out


def _forces(dice: Dice, mechanism: Mechanism, turning: bool) -> list[Force]:
    out = []
    for k in range(int(dice.choice([0, 1, 2]))):
        link = mechanism.links[int(dice.integers(len(mechanism.links)))]
        follower = bool(dice.random() < 0.7)
        wrench = np.concatenate([dice.uniform(-20.0, 20.0, 3), dice.uniform(-2.0, 2.0, 3)])
        if turning and not follower:
            wrench[[0, 1, 3, 4]] = 0.0
        out.append(Force(f"force {k}", _end(dice, link), wrench[None], follower=follower))
    return out


def _tied(dice: Dice, mechanism: Mechanism, moving: list[str], turning: bool) -> Mechanism:
    """The mechanism with a coupling or a loop, now and then; ``moving`` joints are those that it may tie."""
    if dice.random() > 0.35:
        return mechanism
    scalar = [j.name for j in mechanism.joints if j.name in moving and j.kind in ("revolute", "prismatic", "helical")]
    if turning:
        scalar = [name for name in scalar if name != "joint 0"]
    if len(scalar) > 1 and dice.random() < 0.6:
        one, other = dice.choice(scalar, 2, replace=False)
        factors = ((str(one), 1.0), (str(other), float(dice.uniform(-3, 3))))
        tie = Closure("gear", "coupling", Attachment(WORLD), Attachment(WORLD), factors=factors)
        return replace(mechanism, closures=(tie,))
    if turning or not moving:
        return mechanism
    return _closed(dice, mechanism)


def _closed(dice: Dice, mechanism: Mechanism) -> Mechanism:
    """The mechanism with its last link tied to the world where it stands."""
    kind = str(dice.choice(["spherical", "point-on-line", "cylindrical", "universal"]))
    return replace(mechanism, closures=(close_chain(mechanism, kind),))


def close_chain(mechanism: Mechanism, kind: str) -> Closure:
    """Return the closure that ties the end of the last link to the world where it stands."""
    mesh = build(mechanism)
    rest = np.zeros((1, mechanism.nv))
    motion = compute_rigid_motion(mesh, mechanism.neutral[None], rest, rest)
    link = mechanism.links[-1]
    node = mesh.tip_node.get(link.name, mesh.joint_node[mechanism.joints[-1].name])
    arm = np.zeros(3) if link.beam is not None else link.tip
    turn = motion.rotation[0, node]
    there = Placement(motion.x[0, node] + turn @ arm, turn)
    end = Attachment(link.name, Placement(arm), None if link.beam is None else 1.0)
    return Closure("loop", kind, Attachment(WORLD, there), end)
