"""Causes in what joints take: friction that is not the same both ways or at all speeds, drag, offsets, values at other joints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np

from crosscheck.causes.cause import Cause, Change, Targets, driven, effort, per_speed
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Array, States, Subject
from flexinv.errors import InputError
from flexinv.model.mechanism import Joint, Mechanism

BOTH = "this joint moved to and fro, slowly and quickly"
SLOW = "this joint moved very slowly, then quickly: friction that falls off with speed shows at its beginning"
MANY = 8  # joints up to which every pair is tried; beyond, neighbours only
ARROW = " <-> "
FALLS = 0.1  # part of a joint's largest speed over which Stribeck's friction falls off, or a smoothed one rises
RISING = 0.01  # of the dry friction: what is nearer to none or all of it says little about the speed
Law = Callable[[Array, Array, Joint], Array]


def _taken(law: Law) -> Change:
    """Return the change that adds to the effort of one joint (samples, nv of the joint) what a law takes from its speed."""

    def changed(subject: Subject, target: str, size: Array) -> Subject:
        def change(mechanism: Mechanism, states: States, effort: Array) -> Array:
            out = effort.copy()
            part = mechanism.v_slices[target]
            out[:, part] += law(states.qd[:, part], size, mechanism.joint_of[target])
            return out

        return subject.with_effort(change)

    return changed


def _two_ways(qd: Array, size: Array, joint: Joint) -> Array:
    return np.asarray(size[0] * (qd > 0.0) - size[1] * (qd < 0.0), dtype=np.float64)


def _quadratic(qd: Array, size: Array, joint: Joint) -> Array:
    return np.asarray(size[0] * qd * np.abs(qd))


def _constant(qd: Array, size: Array, joint: Joint) -> Array:
    return np.full(qd.shape, float(size[0]))


def _stribeck(qd: Array, size: Array, joint: Joint) -> Array:
    """F exp(-(v / v_s)^2) sign(v), v_s = FALLS v_max (1 + second number)."""
    if not size[1] > -1.0:
        raise InputError(f"a speed times {1.0 + size[1]:g}: expected more than 0")
    falls = FALLS * float(np.abs(qd).max()) * (1.0 + float(size[1]))
    return np.asarray(size[0] * np.exp(-((qd / falls) ** 2)) * np.sign(qd)) if falls else 0.0 * qd


def _smoothed(qd: Array, size: Array, joint: Joint) -> Array:
    """F (tanh(v / v_s) - sign(v)) of the joint's own dry friction F."""
    if not size[0] > 0.0:
        return 0.0 * qd
    return np.asarray(joint.friction * (np.tanh(qd / float(size[0])) - np.sign(qd)))


def _efficient(subject: Subject, target: str, size: Array) -> Subject:
    """Multiply the effort of one joint by 1 + first number where it drives, by 1 - second number where it is driven."""

    def change(mechanism: Mechanism, states: States, effort: Array) -> Array:
        out = effort.copy()
        part = mechanism.v_slices[target]
        power = effort[:, part] * states.qd[:, part]
        out[:, part] *= 1.0 + size[0] * (power > 0.0) - size[1] * (power < 0.0)
        return out

    return subject.with_effort(change)


def _rubbing(model: Model) -> list[str]:
    return [n for n in driven(model) if model.base.mechanism.joint_of[n].friction]


def _rise(model: Model, target: str, seen: Array) -> list[Array]:
    """Return the speed over which the friction in given efforts (samples, nv) rises, if it does: tanh(v / v_s) says it."""
    mechanism = model.base.mechanism
    part = mechanism.v_slices[target]
    qd = model.states.qd[:, part]
    law = (seen - model.torque)[:, part] / mechanism.joint_of[target].friction
    part_of_friction = np.sign(qd) * law + 1.0
    rising = (qd != 0.0) & (part_of_friction > RISING) & (part_of_friction < 1.0 - RISING)
    speeds = np.abs(qd[rising]) / np.arctanh(part_of_friction[rising])
    return [np.array([np.median(speeds)])] if speeds.size else []


def _slow(model: Model, target: str) -> float:
    return FALLS * float(np.abs(model.states.qd[:, model.base.mechanism.v_slices[target]]).max())


def _force(model: Model, target: str) -> float:
    return effort(model, target) if model.states.qd[:, model.base.mechanism.v_slices[target]].any() else 0.0


def _drag(model: Model, target: str) -> float:
    speed = float(np.abs(model.states.qd[:, model.base.mechanism.v_slices[target]]).max())
    return per_speed(model, target) / speed if speed else 0.0


def _unlike(field: str) -> Targets:
    """Return the pairs of joints with a drive whose numbers differ."""

    def targets(model: Model) -> list[str]:
        joints = [model.base.mechanism.joint_of[n] for n in driven(model)]
        pairs = combinations(joints, 2) if len(joints) <= MANY else pairwise(joints)
        return [f"{a.name}{ARROW}{b.name}" for a, b in pairs if getattr(a, field) != getattr(b, field)]

    return targets


def _exchanged(field: str) -> Change:
    def changed(subject: Subject, target: str, size: Array) -> Subject:
        a, b = (subject.mechanism.joint_of[n] for n in target.split(ARROW))
        values = {a.name: getattr(b, field), b.name: getattr(a, field)}
        return subject.with_joints(lambda j: replace(j, **{field: values[j.name]}) if j.name in values else j)

    return changed


def _swap(field: str, words: str) -> Cause:
    return Cause(
        f"{words} exchanged",
        f"the {words} of two joints is mixed up: {{target}}",
        _exchanged(field),
        _unlike(field),
        0,
        shows="one joint moved at a time",
    )


ROWS = (
    Cause(
        "asymmetric friction",
        "the dry friction of {target} differs by {size} forwards and backwards",
        _taken(_two_ways),
        driven,
        2,
        _force,
        "N m or N",
        covers=("dry friction",),
        shows=BOTH,
    ),
    Cause(
        "Stribeck friction",
        f"{{target}} has friction that falls off with speed: {{size}}, more at rest, and by what the speed of {FALLS:g} of the "
        "largest is exceeded at which it has fallen",
        _taken(_stribeck),
        driven,
        2,
        _force,
        "(N m or N, -)",
        shows=SLOW,
    ),
    Cause(
        "smoothed friction",
        "the dry friction of {target} is smoothed: it rises over a speed of {size}",
        _taken(_smoothed),
        _rubbing,
        1,
        _slow,
        "rad/s or m/s",
        shows=SLOW,
        guess=_rise,
    ),
    Cause(
        "quadratic damping",
        "{target} has a drag with the square of its speed, {size}",
        _taken(_quadratic),
        driven,
        1,
        _drag,
        "N m s^2/rad^2 or N s^2/m^2",
        shows="the same path at half the speed: what goes with the square falls to a quarter",
    ),
    Cause(
        "gear efficiency",
        "friction in {target} goes with its load: {size} of the effort where it drives, and where it is driven",
        _efficient,
        driven,
        2,
        covers=("effort scale", "effort sign of a joint"),
        shows="a load lifted and lowered at the same speed",
    ),
    Cause(
        "effort offset",
        "the effort of {target} is off by the constant {size}",
        _taken(_constant),
        driven,
        1,
        effort,
        "N m or N",
        shows="any motion: what is constant stays when the joint moves the other way",
    ),
    _swap("damping", "viscous damping"),
    _swap("friction", "dry friction"),
    _swap("rotor_inertia", "rotor inertia"),
)
