"""Causes in joints: rotors, damping, friction and springs; zero position, axis and placement of the joint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.causes.cause import (
    Cause,
    Change,
    Targets,
    check_fraction,
    compute_coordinate_scale,
    compute_damping_scale,
    compute_effort_range,
    compute_inertia_scale,
    compute_stiffness_scale,
    compute_typical_length,
    list_driven_joints,
    list_moving_joints,
    list_scalar_joints,
)
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Subject
from flexinv.model.mechanism import Joint, Placement
from flexinv.typing import Array

FAST = "a quick motion of this joint from one place to the next and back (accelerations without much speed)"
ARROW = " -> "
STEADY = "the same path at half the speed: what goes with speed halves, with acceleration quarters, friction stays"


def _make_field_addition(field: str) -> Change:
    """Return the change that adds a size to a number of one joint."""

    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        return subject.replace_joint(target, lambda j: replace(j, **{field: getattr(j, field) + float(size[0])}))

    return apply_change


def _make_field_removal(field: str) -> Change:
    """Return the change that scales a number of every joint by 1 - size: at 1 the engine has not applied it."""

    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        return subject.replace_joints(lambda j: replace(j, **{field: getattr(j, field) * (1.0 - float(size[0]))}))

    return apply_change


def _make_field_targets(field: str) -> Targets:
    """Return the one target of mechanisms in which a joint has this number."""
    return lambda model: [""] if any(getattr(j, field) for j in model.base.mechanism.joints) else []


def _make_placement_change(turn: Callable[[Joint, Array], Placement]) -> Change:
    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        return subject.replace_joint(target, lambda j: replace(j, placement=turn(j, size)))

    return apply_change


def _move_zero_position(joint: Joint, size: Array) -> Placement:
    here = joint.placement
    if joint.kind == "prismatic":
        return replace(here, position=here.position + here.rotation @ joint.axis * size[0])
    return replace(
        here, rotation=here.rotation @ scipy.spatial.transform.Rotation.from_rotvec(joint.axis * size[0]).as_matrix()
    )


def _move_placement(joint: Joint, size: Array) -> Placement:
    return replace(joint.placement, position=joint.placement.position + joint.placement.rotation @ size)


def _turn_axis(subject: Subject, target: str, size: Array) -> Subject:
    def update_joint(joint: Joint) -> Joint:
        first = np.cross(joint.axis, np.eye(3)[int(np.argmin(np.abs(joint.axis)))])
        first = first / np.linalg.norm(first)
        both = size[0] * first + size[1] * np.cross(joint.axis, first)
        return replace(joint, axis=scipy.spatial.transform.Rotation.from_rotvec(both).apply(np.array(joint.axis)))

    return subject.replace_joint(target, update_joint)


def _turn_axis_sign(subject: Subject, target: str, size: Array) -> Subject:
    return subject.replace_joint(target, lambda j: replace(j, axis=-j.axis))


def _apply_implicit_damping(subject: Subject, target: str, size: Array) -> Subject:
    return subject.replace_joints(lambda j: replace(j, rotor_inertia=j.rotor_inertia + float(size[0]) * j.damping))


def _compute_step_scale(model: Model, target: str) -> float:
    return model.base.case.end / 10.0


def _list_spring_joints(model: Model) -> list[str]:
    """Return the scalar joints with a drive, of mechanisms whose march takes springs in joints (rigid ones)."""
    return (
        [n for n in list_driven_joints(model) if n in list_scalar_joints(model)]
        if model.base.mechanism.is_rigid
        else []
    )


def _scale_drive_weight(subject: Subject, target: str, size: Array) -> Subject:
    factor = 1.0 + check_fraction(size)
    return subject.replace_joint(target, lambda j: replace(j, weight=j.weight * factor))


def _list_sharing_drives(model: Model) -> list[str]:
    return list_driven_joints(model) if model.base.mechanism.closures else []


def _list_drive_moves(model: Model) -> list[str]:
    """Return "a -> b" for joints with a drive and joints that closures move, of a rigid mechanism with loops."""
    mechanism = model.base.mechanism
    if not mechanism.closures or not mechanism.is_rigid:
        return []
    free = [j.name for j in mechanism.joints if j.nv == 1 and not j.actuated]
    return [f"{a}{ARROW}{b}" for a in list_driven_joints(model) for b in free]


def _move_drive(subject: Subject, target: str, size: Array) -> Subject:
    a, b = target.split(ARROW)
    has = {a: False, b: True}
    return subject.replace_joints(lambda j: replace(j, actuated=has.get(j.name, j.actuated)))


ROWS = (
    Cause(
        "rotor inertia",
        "the rotor inertia (armature) of {target} differs by {size}",
        _make_field_addition("rotor_inertia"),
        list_moving_joints,
        scale=compute_inertia_scale,
        unit="kg m^2 or kg",
        shows=FAST,
    ),
    Cause(
        "rotor inertia dropped",
        "the rotor inertia (armature) of all joints is not applied",
        _make_field_removal("rotor_inertia"),
        _make_field_targets("rotor_inertia"),
        parameters=0,
        shows=FAST,
    ),
    Cause(
        "viscous damping",
        "the viscous damping of {target} differs by {size}",
        _make_field_addition("damping"),
        list_moving_joints,
        scale=compute_damping_scale,
        unit="N m s/rad or N s/m",
        shows=STEADY,
    ),
    Cause(
        "damping dropped",
        "the viscous damping of the joints stands in the model but is not applied",
        _make_field_removal("damping"),
        _make_field_targets("damping"),
        parameters=0,
        shows=STEADY,
    ),
    Cause(
        "dry friction",
        "the dry friction of {target} differs by {size}",
        _make_field_addition("friction"),
        list_moving_joints,
        scale=compute_effort_range,
        unit="N m or N",
        shows=STEADY,
    ),
    Cause(
        "friction dropped",
        "the dry friction of the joints stands in the model but is not applied",
        _make_field_removal("friction"),
        _make_field_targets("friction"),
        parameters=0,
        shows=STEADY,
    ),
    Cause(
        "implicit damping",
        "damping is taken implicitly: {size} times each joint's damping counts as rotor inertia",
        _apply_implicit_damping,
        _make_field_targets("damping"),
        scale=_compute_step_scale,
        unit="s",
        shows="joints with different damping, each moved quickly: the added inertia goes with the damping",
    ),
    Cause(
        "joint stiffness",
        "a spring in {target} differs by {size}",
        _make_field_addition("stiffness"),
        _list_spring_joints,
        scale=compute_stiffness_scale,
        unit="N m/rad or N/m",
        shows="this joint moved slowly over its whole range",
    ),
    Cause(
        "weight of a drive",
        "where drives share the work, the weight of {target} differs by the fraction {size}",
        _scale_drive_weight,
        _list_sharing_drives,
        shows="any motion of a mechanism with more drives than freedoms",
        fraction=True,
    ),
    Cause(
        "drive at another joint",
        "the effort is that of a drive at another joint: {target}",
        _move_drive,
        _list_drive_moves,
        0,
        shows="the loop moved around once",
    ),
    Cause(
        "zero offset",
        "the zero of {target} is off by {size}",
        _make_placement_change(_move_zero_position),
        list_scalar_joints,
        scale=compute_coordinate_scale,
        unit="rad or m",
        shows="the other joints moved while this one rests at several places",
    ),
    Cause(
        "axis sign",
        "the axis of {target} points the other way",
        _turn_axis_sign,
        list_scalar_joints,
        parameters=0,
        shows="this joint moved alone",
    ),
    Cause(
        "axis tilted",
        "the axis of {target} is tilted by {size}",
        _turn_axis,
        list_scalar_joints,
        parameters=2,
        unit="rad",
        turns=True,
        shows="this joint turned far while the ones beyond it move",
    ),
    Cause(
        "joint misplaced",
        "{target} stands elsewhere on its parent, by {size}",
        _make_placement_change(_move_placement),
        list_moving_joints,
        parameters=3,
        scale=compute_typical_length,
        unit="m",
        covers=("link length",),
        shows="the joints before and beyond this one moved together",
    ),
)
