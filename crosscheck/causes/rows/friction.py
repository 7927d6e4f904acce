"""Causes in what joints take: friction that is not the same both ways or at all speeds, drag, offsets, values at other joints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np

from crosscheck.causes.cause import (
    Cause,
    Change,
    Targets,
    compute_damping_scale,
    compute_effort_range,
    list_driven_joints,
)
from crosscheck.causes.model import Model
from crosscheck.causes.subject import States, Subject
from flexinv.errors import InputError
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.typing import Array

BOTH = "this joint moved to and fro, slowly and quickly"
SLOW = "this joint moved very slowly, then quickly: friction that falls off with speed shows at its beginning"
MANY = 8  # joints up to which every pair is tried; beyond, neighbours only
ARROW = " <-> "
FALLS = 0.1  # part of a joint's largest speed over which Stribeck's friction falls off, or a smoothed one rises
RISING = 0.01  # of the dry friction: what is nearer to none or all of it says little about the speed
Law = Callable[[Array, Array, Joint], Array]


def _make_friction_change(law: Law) -> Change:
    """Return the change that adds to the effort of one joint (samples, nv of the joint) what a law takes from its speed."""

    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
            out = effort.copy()
            part = mechanism.v_slices[target]
            out[:, part] += law(states.qd[:, part], size, mechanism.joint_of[target])
            return out

        return subject.add_effort_change(update_effort)

    return apply_change


def _evaluate_asymmetric_friction(qd: Array, size: Array, joint: Joint) -> Array:
    return np.asarray(size[0] * (qd > 0.0) - size[1] * (qd < 0.0), dtype=np.float64)


def _evaluate_quadratic_drag(qd: Array, size: Array, joint: Joint) -> Array:
    return np.asarray(size[0] * qd * np.abs(qd))


def _evaluate_constant_effort(qd: Array, size: Array, joint: Joint) -> Array:
    return np.full(qd.shape, float(size[0]))


def _evaluate_stribeck_friction(qd: Array, size: Array, joint: Joint) -> Array:
    """F exp(-(v / v_s)^2) sign(v), v_s = FALLS v_max (1 + second number)."""
    if not size[1] > -1.0:
        raise InputError(f"a speed times {1.0 + size[1]:g}: expected more than 0")
    falls = FALLS * float(np.abs(qd).max()) * (1.0 + float(size[1]))
    return np.asarray(size[0] * np.exp(-((qd / falls) ** 2)) * np.sign(qd)) if falls else 0.0 * qd


def _evaluate_smoothed_friction(qd: Array, size: Array, joint: Joint) -> Array:
    """F (tanh(v / v_s) - sign(v)) of the joint's own dry friction F."""
    if not size[0] > 0.0:
        return 0.0 * qd
    return np.asarray(joint.friction * (np.tanh(qd / float(size[0])) - np.sign(qd)))


def _apply_gear_efficiency(subject: Subject, target: str, size: Array) -> Subject:
    """Multiply the effort of one joint by 1 + first number where it drives, by 1 - second number where it is driven."""

    def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
        out = effort.copy()
        part = mechanism.v_slices[target]
        power = effort[:, part] * states.qd[:, part]
        out[:, part] *= 1.0 + size[0] * (power > 0.0) - size[1] * (power < 0.0)
        return out

    return subject.add_effort_change(update_effort)


def _list_joints_with_friction(model: Model) -> list[str]:
    return [n for n in list_driven_joints(model) if model.base.mechanism.joint_of[n].friction]


def _find_rise_speed(model: Model, target: str, seen: Array) -> list[Array]:
    """Return the speed over which the friction in given efforts (samples, nv) rises, if it does: tanh(v / v_s) says it."""
    mechanism = model.base.mechanism
    part = mechanism.v_slices[target]
    qd = model.states.qd[:, part]
    law = (seen - model.torque)[:, part] / mechanism.joint_of[target].friction
    part_of_friction = np.sign(qd) * law + 1.0
    rising = (qd != 0.0) & (part_of_friction > RISING) & (part_of_friction < 1.0 - RISING)
    speeds = np.abs(qd[rising]) / np.arctanh(part_of_friction[rising])
    return [np.array([np.median(speeds)])] if speeds.size else []


def _compute_slow_speed(model: Model, target: str) -> float:
    return FALLS * float(np.abs(model.states.qd[:, model.base.mechanism.v_slices[target]]).max())


def _compute_friction_scale(model: Model, target: str) -> float:
    return (
        compute_effort_range(model, target) if model.states.qd[:, model.base.mechanism.v_slices[target]].any() else 0.0
    )


def _compute_drag_scale(model: Model, target: str) -> float:
    speed = float(np.abs(model.states.qd[:, model.base.mechanism.v_slices[target]]).max())
    return compute_damping_scale(model, target) / speed if speed else 0.0


def _make_unequal_pair_targets(field: str) -> Targets:
    """Return the pairs of joints with a drive whose numbers differ."""

    def list_targets(model: Model) -> list[str]:
        joints = [model.base.mechanism.joint_of[n] for n in list_driven_joints(model)]
        pairs = combinations(joints, 2) if len(joints) <= MANY else pairwise(joints)
        return [f"{a.name}{ARROW}{b.name}" for a, b in pairs if getattr(a, field) != getattr(b, field)]

    return list_targets


def _make_field_exchange(field: str) -> Change:
    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        a, b = (subject.mechanism.joint_of[n] for n in target.split(ARROW))
        values = {a.name: getattr(b, field), b.name: getattr(a, field)}
        return subject.replace_joints(lambda j: replace(j, **{field: values[j.name]}) if j.name in values else j)

    return apply_change


def _make_exchange_cause(field: str, words: str) -> Cause:
    return Cause(
        f"{words} exchanged",
        f"the {words} of two joints is mixed up: {{target}}",
        _make_field_exchange(field),
        _make_unequal_pair_targets(field),
        0,
        shows="one joint moved at a time",
    )


ROWS = (
    Cause(
        "asymmetric friction",
        "the dry friction of {target} differs by {size} forwards and backwards",
        _make_friction_change(_evaluate_asymmetric_friction),
        list_driven_joints,
        2,
        _compute_friction_scale,
        "N m or N",
        covers=("dry friction",),
        shows=BOTH,
    ),
    Cause(
        "Stribeck friction",
        f"{{target}} has friction that falls off with speed: {{size}}, more at rest, and by what the speed of {FALLS:g} of the "
        "largest is exceeded at which it has fallen",
        _make_friction_change(_evaluate_stribeck_friction),
        list_driven_joints,
        2,
        _compute_friction_scale,
        "(N m or N, -)",
        shows=SLOW,
    ),
    Cause(
        "smoothed friction",
        "the dry friction of {target} is smoothed: it rises over a speed of {size}",
        _make_friction_change(_evaluate_smoothed_friction),
        _list_joints_with_friction,
        1,
        _compute_slow_speed,
        "rad/s or m/s",
        shows=SLOW,
        guess=_find_rise_speed,
    ),
    Cause(
        "quadratic damping",
        "{target} has a drag with the square of its speed, {size}",
        _make_friction_change(_evaluate_quadratic_drag),
        list_driven_joints,
        1,
        _compute_drag_scale,
        "N m s^2/rad^2 or N s^2/m^2",
        shows="the same path at half the speed: what goes with the square falls to a quarter",
    ),
    Cause(
        "gear efficiency",
        "friction in {target} goes with its load: {size} of the effort where it drives, and where it is driven",
        _apply_gear_efficiency,
        list_driven_joints,
        2,
        covers=("effort scale", "effort sign of a joint"),
        shows="a load lifted and lowered at the same speed",
    ),
    Cause(
        "effort offset",
        "the effort of {target} is off by the constant {size}",
        _make_friction_change(_evaluate_constant_effort),
        list_driven_joints,
        1,
        compute_effort_range,
        "N m or N",
        shows="any motion: what is constant stays when the joint moves the other way",
    ),
    _make_exchange_cause("damping", "viscous damping"),
    _make_exchange_cause("friction", "dry friction"),
    _make_exchange_cause("rotor_inertia", "rotor inertia"),
)
