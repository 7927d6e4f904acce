"""Closed mechanisms that the tests of the engines share: planar and spatial loops, springs and forces on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from flexinv.files.load_cases import Case
from flexinv.model.mechanism import (
    WORLD,
    Attachment,
    Body,
    Closure,
    Force,
    Inertia,
    Joint,
    Link,
    Mechanism,
    Placement,
    Spring,
)
from flexinv.model.motion import Motion
from flexinv.typing import Array

DOWN = np.array([0.0, -9.81, 0.0])
X, Y, Z = np.eye(3)


def rod(name: str, length: float, mass: float) -> Link:
    """A slender rod along x, its end the reported point."""
    tensor = mass * length**2 / 12 * np.diag([1e-3, 1.0, 1.0])
    body = Body(name, Inertia(mass, np.array([length / 2, 0.0, 0.0]), tensor))
    return Link(name, (body,), tip=np.array([length, 0.0, 0.0]))


def at(x: float, y: float = 0.0, z: float = 0.0) -> Placement:
    return Placement(np.array([x, y, z]))


def case_of(mechanism: Mechanism, motion: Motion, start: Mapping[str, float | list[float]], samples: int = 20) -> Case:
    guess = {name: np.atleast_1d(np.array(value, dtype=float)) for name, value in start.items()}
    step = motion.duration / samples
    return Case("case", "", motion, step, motion.duration, step, ("torque", "wrench", "tip"), (), start=guess)


Example = tuple[Mechanism, Case]


def four_bar(kind: str = "revolute", **change: object) -> Example:
    links = (rod("crank", 0.2, 0.3), rod("coupler", 0.5, 0.5), rod("rocker", 0.4, 0.4))
    joints = (
        Joint("A", "revolute", WORLD, "crank", rotor_inertia=0.01, damping=0.02, friction=0.05),
        Joint("B", "continuous", "crank", "coupler", at(0.2), actuated=False, damping=0.01),
        Joint("D", "revolute", WORLD, "rocker", at(0.45), actuated=False, rotor_inertia=0.004),
    )
    ends = Attachment("coupler", at(0.5)), Attachment("rocker", at(0.4))
    closure = Closure("C", kind, *ends, second_axis=X)
    mechanism = replace(Mechanism("four-bar", links, joints, DOWN, (closure,)), **change)  # type: ignore[arg-type]
    motion = Motion.point_to_point({"A": 0.3}, {"A": 0.3 + 2 * np.pi}, 1.0)
    return mechanism, case_of(mechanism, motion, {"B": 0.8, "D": 1.8})


def five_bar(drives: int) -> Example:
    """Two cranks on the base, two distal rods; a third drive between the distal ones is redundant."""
    links = (rod("left", 0.25, 0.4), rod("far left", 0.4, 0.5), rod("right", 0.25, 0.4), rod("far right", 0.4, 0.5))
    joints = (
        Joint("A", "revolute", WORLD, "left", damping=0.1),
        Joint("B", "revolute", "left", "far left", at(0.25), actuated=drives > 2, rotor_inertia=0.003),
        Joint("E", "revolute", WORLD, "right", at(0.3)),
        Joint("D", "revolute", "right", "far right", at(0.25), actuated=False),
    )
    closure = Closure("C", "revolute", Attachment("far left", at(0.4)), Attachment("far right", at(0.4)))
    mechanism = Mechanism(f"five-bar {drives}", links, joints, DOWN, (closure,))
    motion = Motion.point_to_point({"A": 2.2, "E": 0.9}, {"A": 1.5, "E": 0.3}, 0.6)
    return mechanism, case_of(mechanism, motion, {"B": -1.2, "D": 1.2})


def slider_crank(cut: str) -> Example:
    """Cut at the pin of the slider (a joint of the tree), or the slide itself is the closure of one of three kinds."""
    links: tuple[Link, ...] = (rod("crank", 0.15, 0.3), rod("rod", 0.45, 0.5))
    joints: tuple[Joint, ...] = (
        Joint("A", "revolute", WORLD, "crank"),
        Joint("B", "revolute", "crank", "rod", at(0.15), actuated=False),
    )
    block = Link("slider", (Body("slider", Inertia(0.8, np.zeros(3), 1e-3 * np.eye(3))),))
    motion = Motion.point_to_point({"A": 0.4}, {"A": 0.4 + 2 * np.pi}, 1.0)
    guess = {"B": -0.5}
    if cut == "pin":
        links, joints = (*links, block), (
            *joints, Joint("S", "prismatic", WORLD, "slider", axis=X, actuated=False, damping=2.0, friction=0.3)
        )  # fmt: skip
        closure = Closure("C", "revolute", Attachment("rod", at(0.45)), Attachment("slider"))
        mechanism = Mechanism("slider-crank", links, joints, DOWN, (closure,))
        return mechanism, case_of(mechanism, motion, {**guess, "S": 0.55})
    if cut == "point-on-line":
        closure = Closure("C", cut, Attachment(WORLD), Attachment("rod", at(0.45)), axis=X)
        mechanism = Mechanism("slider-crank", links, joints, DOWN, (closure,))
        return mechanism, case_of(mechanism, motion, guess)
    links, joints = (*links, block), (*joints, Joint("P", "revolute", "rod", "slider", at(0.45), actuated=False))
    closure = Closure("C", cut, Attachment(WORLD), Attachment("slider"), axis=X)
    mechanism = Mechanism("slider-crank", links, joints, DOWN, (closure,))
    return mechanism, case_of(mechanism, motion, {**guess, "P": 0.1})


def spatial() -> Example:
    """Crank, universal joint, coupler, ball, rocker: axes crossed in space, no constraint redundant."""
    links = (rod("crank", 0.1, 0.3), rod("coupler", 0.55, 0.5), rod("rocker", 0.35, 0.4))
    beside = replace(links[1].bodies[0], name="beside", inertia=Inertia(0.3, np.array([0.25, 0.06, -0.04])))
    links = (links[0], replace(links[1], bodies=(*links[1].bodies, beside)), links[2])
    tilt = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # the rocker turns about x
    joints = (
        Joint("A", "revolute", WORLD, "crank"),
        Joint("B", "universal", "crank", "coupler", at(0.1), axis=Z, second_axis=Y, actuated=False),
        Joint("D", "revolute", WORLD, "rocker", Placement(np.array([0.4, 0.1, 0.1]), tilt), actuated=False),
    )
    closure = Closure("C", "spherical", Attachment("coupler", at(0.55)), Attachment("rocker", at(0.35)))
    mechanism = Mechanism("spatial", links, joints, np.array([0.0, -3.0, -9.0]), (closure,))
    motion = Motion.point_to_point({"A": 0.5}, {"A": 2.0}, 1.0)
    return mechanism, case_of(mechanism, motion, {"B": [0.3, -0.4], "D": 0.5})


def platform() -> Example:
    """Stewart-Gough: the motion is the platform's, the drives are six legs of universal joint, slide and ball."""
    top = Link("platform", (Body("plate", Inertia(3.0, np.array([0.0, 0.02, 0.05]), np.diag([0.05, 0.06, 0.1]))),))
    links, closures = [top], []
    joints = [Joint("free", "free", WORLD, "platform", at(0.0, 0.0, 0.8), actuated=False)]
    for k in range(6):
        low, high = np.pi / 3 * (k + 0.35 * (-1) ** k), np.pi / 3 * (k + 0.65 - (k + 1) % 2 * 0.3)
        base = np.array([0.6 * np.cos(low), 0.6 * np.sin(low), 0.0])
        seat = np.array([0.3 * np.cos(high), 0.3 * np.sin(high), 0.0])
        along = seat + 0.8 * Z - base
        x = along / np.linalg.norm(along)
        y = np.cross(Z, x) / np.linalg.norm(np.cross(Z, x))
        axes = np.stack([x, y, np.cross(x, y)], axis=1)
        foot, stem = rod(f"foot{k}", 0.4, 0.7), rod(f"stem{k}", 0.3, 0.4)
        links += [foot, stem]
        joints += [
            Joint(f"u{k}", "universal", WORLD, foot.name, Placement(base, axes), axis=Z, second_axis=Y, actuated=False),
            Joint(f"p{k}", "prismatic", foot.name, stem.name, at(float(np.linalg.norm(along)) - 0.3), axis=X),
        ]
        closures.append(
            Closure(f"s{k}", "spherical", Attachment(stem.name, at(0.3)), Attachment("platform", at(*seat)))
        )
    mechanism = Mechanism("platform", tuple(links), tuple(joints), closures=tuple(closures))
    turned = [0.1, -0.05, 0.15, np.sqrt(1 - 0.1**2 - 0.05**2 - 0.15**2)]
    motion = Motion.point_to_point({"free": [0, 0, 0, 0, 0, 0, 1]}, {"free": [0.1, -0.05, 0.08, *turned]}, 0.8)
    return mechanism, case_of(mechanism, motion, {}, samples=10)


def loaded(kind: str = "revolute") -> Example:
    """The four-bar with a spring and damper, a spring in a joint, a force in the world and one that follows its link."""
    mechanism, case = four_bar(kind)
    spring = Spring("spring", Attachment(WORLD, at(0.1, -0.3)), Attachment("coupler", at(0.3, 0.05)), 40.0, 0.2, 1.5)
    table = np.array([[3.0, -2.0, 0.0, 0.0, 0.0, 0.4], [-1.0, 5.0, 0.0, 0.0, 0.0, -0.2]])
    forces = (
        Force("load", Attachment("rocker", at(0.3, 0.02)), table, np.array([0.0, 1.0])),
        Force(
            "thrust",
            Attachment("coupler", Placement(np.array([0.2, 0.0, 0.0]), _about_z(0.4))),
            table[:1],
            follower=True,
        ),
    )
    joints = tuple(replace(j, stiffness=0.7, rest=0.3) if j.name in ("B", "D") else j for j in mechanism.joints)
    return replace(mechanism, joints=joints, springs=(spring,), forces=forces), case


def loaded_tree() -> Example:
    """An open arm in space with the same loads."""
    links = (rod("arm", 0.4, 0.6), rod("hand", 0.3, 0.4))
    axes = np.array([0.6, 0.0, 0.8]), np.array([0.0, 0.6, 0.8])
    joints = (
        Joint("J", "continuous", WORLD, "arm", axis=axes[0], stiffness=0.9, rest=-0.2),
        Joint("K", "revolute", "arm", "hand", at(0.4), axis=axes[1], stiffness=0.5, rest=0.1, damping=0.3),
    )
    spring = Spring("spring", Attachment("hand", at(0.1, 0.1)), Attachment(WORLD, at(0.0, 0.5, 0.6)), 30.0, 0.1, 2.0)
    table = np.array([[1.0, -2.0, 3.0, 0.3, 0.1, -0.2], [-1.0, 2.0, 1.0, 0.2, -0.1, 0.4]])
    forces = (
        Force("load", Attachment("hand", at(0.3)), table, np.array([0.1, 0.5])),
        Force(
            "thrust", Attachment("arm", Placement(np.array([0.2, 0.1, 0.0]), _about_z(0.4))), table[:1], follower=True
        ),
    )
    mechanism = Mechanism("arm", links, joints, springs=(spring,), forces=forces)
    motion = Motion.point_to_point({"J": 0.3, "K": 0.2}, {"J": 4.0, "K": -1.0}, 0.7)
    return mechanism, case_of(mechanism, motion, {})


def rack_and_pinion() -> Example:
    """A drive turns a pinion; a rack without a drive moves by 0.05 m per radian, upward."""
    links = (
        Link("pinion", (Body("pinion", Inertia(1.0, np.zeros(3), 0.02 * np.eye(3))),)),
        Link("rack", (Body("rack", Inertia(3.0, np.zeros(3), 0.01 * np.eye(3))),)),
    )
    joints = (
        Joint("turn", "revolute", WORLD, "pinion", damping=0.1),
        Joint("lift", "prismatic", WORLD, "rack", axis=Y, actuated=False),
    )
    world = Attachment(WORLD)
    gear = Closure("gear", "coupling", world, world, factors=(("turn", 0.05), ("lift", -1.0)), offset=-0.02)
    motion = Motion.point_to_point({"turn": 0.0}, {"turn": 2.0}, 1.0)
    mechanism = Mechanism("rack and pinion", links, joints, DOWN, (gear,))
    return mechanism, Case("c", "", motion, 0.05, 1.0, 0.05, ("torque",), (), start={"lift": np.array([0.02])})


def _about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
