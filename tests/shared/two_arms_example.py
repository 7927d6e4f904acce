"""Two arms that grasp a bar, carry and release it: the mechanism, its phases and its motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import flexinv
from flexinv.kernels.so3 import exp_so3
from flexinv.model.mechanism import Attachment, Body, Closure, Inertia, Joint, Link, Mechanism, Placement
from flexinv.typing import Array

UPPER, LOWER, HALF = 0.5, 0.4, 0.2  # lengths of the arms, half the length between the hands [m]


BASES = (np.array([0.0, 0.0]), np.array([1.2, 0.0]))


GRASP, RELEASE, END = 0.5, 1.0, 1.5  # [s]


STEP = 0.005


FROM, TO = np.array([0.6, 0.45, 0.0]), np.array([0.7, 0.6, 0.3])  # bar: x, y, angle


def _at(x: float, angle: float = 0.0) -> Placement:
    return Placement(np.array([x, 0.0, 0.0]), exp_so3(np.array([0.0, 0.0, angle])))


def _rod(name: str, length: float, mass: float) -> Link:
    tensor = np.diag([1e-5, mass * length**2 / 12, mass * length**2 / 12])
    return Link(name, (Body(name, Inertia(mass, np.array([length / 2, 0, 0]), tensor)),))


def _table(bar: Array) -> Attachment:
    return Attachment("world", Placement(np.array([bar[0], bar[1], 0.0]), exp_so3(np.array([0.0, 0.0, bar[2]]))))


def two_arms(timed: bool = True) -> Mechanism:
    """Two planar arms of three joints each and a bar that lies, is carried, and lies again; gravity in the plane."""
    links, joints = [], []
    for side, base in zip("AB", BASES, strict=True):
        links += [_rod(f"{side}1", UPPER, 2.0), _rod(f"{side}2", LOWER, 1.5), _rod(f"{side}3", 0.05, 0.3)]
        where = Placement(np.array([*base, 0.0]))
        joints += [
            Joint(f"{side}1", "revolute", "world", f"{side}1", where),
            Joint(f"{side}2", "revolute", f"{side}1", f"{side}2", _at(UPPER)),
            Joint(f"{side}3", "revolute", f"{side}2", f"{side}3", _at(LOWER)),
        ]
    bar = Link("bar", (Body("bar", Inertia(4.0, np.zeros(3), np.diag([0.01, 0.1, 0.1]))),))
    x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    links += [Link("slide"), Link("lift"), bar]
    joints += [
        Joint("x", "prismatic", "world", "slide", axis=x, actuated=False),
        Joint("y", "prismatic", "slide", "lift", axis=y, actuated=False),
        Joint("turn", "revolute", "lift", "bar", actuated=False),
    ]
    hold = {
        "lies": ((0.0, GRASP),),
        "left": ((GRASP, RELEASE),),
        "right": ((GRASP, RELEASE),),
        "lies again": ((RELEASE, 9.0),),
    }
    centre = Attachment("bar")
    closures = (
        Closure("lies", "fixed", _table(FROM), centre, active=hold["lies"]),
        Closure("left", "fixed", Attachment("A3"), Attachment("bar", _at(-HALF)), active=hold["left"]),
        Closure("right", "fixed", Attachment("B3"), Attachment("bar", _at(HALF, np.pi)), active=hold["right"]),
        Closure("lies again", "fixed", _table(TO), centre, active=hold["lies again"]),
    )
    gravity = np.array([0.0, -9.81, 0.0])
    if timed:
        return Mechanism("two arms", tuple(links), tuple(joints), gravity, closures)
    carried = tuple(replace(c, active=()) for c in closures[1:3])
    return Mechanism("two arms", tuple(links), tuple(joints), gravity, carried)


def _angles(bar: Array) -> Array:
    """Joint angles of both arms whose third links lie on the bar's ends, by the law of cosines; (samples, 6) [rad]."""
    out = []
    for side, base, bend in ((-1.0, BASES[0], -1.0), (1.0, BASES[1], 1.0)):
        turn = bar[:, 2]
        wrist = bar[:, :2] + side * HALF * np.stack([np.cos(turn), np.sin(turn)], axis=1) - base
        reach = np.hypot(*wrist.T)
        elbow = bend * np.arccos((reach**2 - UPPER**2 - LOWER**2) / (2 * UPPER * LOWER))
        shoulder = np.arctan2(wrist[:, 1], wrist[:, 0]) - np.arctan2(
            LOWER * np.sin(elbow), UPPER + LOWER * np.cos(elbow)
        )
        hand = turn + (0.0 if side < 0 else np.pi) - shoulder - elbow
        out += [shoulder, elbow, hand]
    return np.stack(out, axis=1)


def _soft(s: Array) -> Array:
    """From 0 to 1 with four derivatives zero at both ends, constant outside: splines of it stay smooth at switches."""
    s = np.clip(s, 0, 1)
    return np.asarray(s**5 * (126 - 420 * s + 540 * s**2 - 315 * s**3 + 70 * s**4))


def motion(hurry: float = 0.0) -> flexinv.Motion:
    """Reach from above, carry, draw back; with ``hurry`` the hands still move when they grasp [rad]."""
    time = np.arange(0, END + STEP / 10, STEP / 5)
    carry = FROM + _soft((time - GRASP) / (RELEASE - GRASP))[:, None] * (TO - FROM)
    q = _angles(carry)
    away = 0.3 * (1 - _soft(time / GRASP)) + 0.3 * _soft((time - RELEASE) / (END - RELEASE))
    q[:, [0, 3]] += away[:, None] * np.array([1.0, -1.0])
    if hurry:
        q[:, 0] += hurry * (time - GRASP) * (time < GRASP)
    return flexinv.Motion.from_samples(
        time, {f"{side}{k + 1}": q[:, 3 * i + k] for i, side in enumerate("AB") for k in range(3)}
    )


START = {"x": FROM[0], "y": FROM[1], "turn": FROM[2]}
