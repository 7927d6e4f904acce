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
    coordinate,
    driven,
    effort,
    joints,
    more_than_nothing,
    per_acceleration,
    per_speed,
    per_travel,
    reach,
    scalar,
)
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Array, Subject
from flexinv.model.mechanism import Joint, Placement

FAST = "a quick motion of this joint from one place to the next and back (accelerations without much speed)"
ARROW = " -> "
STEADY = "the same path at half the speed: what goes with speed halves, with acceleration quarters, friction stays"


def _more(field: str) -> Change:
    """Return the change that adds a size to a number of one joint."""

    def change(subject: Subject, target: str, size: Array) -> Subject:
        return subject.with_joint(target, lambda j: replace(j, **{field: getattr(j, field) + float(size[0])}))

    return change


def _dropped(field: str) -> Change:
    """Return the change that scales a number of every joint by 1 - size: at 1 the engine has not applied it."""

    def change(subject: Subject, target: str, size: Array) -> Subject:
        return subject.with_joints(lambda j: replace(j, **{field: getattr(j, field) * (1.0 - float(size[0]))}))

    return change


def _having(field: str) -> Targets:
    """Return the one target of mechanisms in which a joint has this number."""
    return lambda model: [""] if any(getattr(j, field) for j in model.base.mechanism.joints) else []


def _placed(turn: Callable[[Joint, Array], Placement]) -> Change:
    def change(subject: Subject, target: str, size: Array) -> Subject:
        return subject.with_joint(target, lambda j: replace(j, placement=turn(j, size)))

    return change


def _offset(joint: Joint, size: Array) -> Placement:
    here = joint.placement
    if joint.kind == "prismatic":
        return replace(here, position=here.position + here.rotation @ joint.axis * size[0])
    return replace(
        here, rotation=here.rotation @ scipy.spatial.transform.Rotation.from_rotvec(joint.axis * size[0]).as_matrix()
    )


def _shifted(joint: Joint, size: Array) -> Placement:
    return replace(joint.placement, position=joint.placement.position + joint.placement.rotation @ size)


def _tilted(subject: Subject, target: str, size: Array) -> Subject:
    def change(joint: Joint) -> Joint:
        first = np.cross(joint.axis, np.eye(3)[int(np.argmin(np.abs(joint.axis)))])
        first = first / np.linalg.norm(first)
        both = size[0] * first + size[1] * np.cross(joint.axis, first)
        return replace(joint, axis=scipy.spatial.transform.Rotation.from_rotvec(both).apply(np.array(joint.axis)))

    return subject.with_joint(target, change)


def _reversed(subject: Subject, target: str, size: Array) -> Subject:
    return subject.with_joint(target, lambda j: replace(j, axis=-j.axis))


def _implicit(subject: Subject, target: str, size: Array) -> Subject:
    return subject.with_joints(lambda j: replace(j, rotor_inertia=j.rotor_inertia + float(size[0]) * j.damping))


def _step(model: Model, target: str) -> float:
    return model.base.case.end / 10.0


def _sprung(model: Model) -> list[str]:
    """Return the scalar joints with a drive, of mechanisms whose march takes springs in joints (rigid ones)."""
    return [n for n in driven(model) if n in scalar(model)] if model.base.mechanism.is_rigid else []


def _weighed(subject: Subject, target: str, size: Array) -> Subject:
    factor = 1.0 + more_than_nothing(size)
    return subject.with_joint(target, lambda j: replace(j, weight=j.weight * factor))


def _sharing(model: Model) -> list[str]:
    return driven(model) if model.base.mechanism.closures else []


def _passive(model: Model) -> list[str]:
    """Return "a -> b" for joints with a drive and joints that closures move, of a rigid mechanism with loops."""
    mechanism = model.base.mechanism
    if not mechanism.closures or not mechanism.is_rigid:
        return []
    free = [j.name for j in mechanism.joints if j.nv == 1 and not j.actuated]
    return [f"{a}{ARROW}{b}" for a in driven(model) for b in free]


def _driven_elsewhere(subject: Subject, target: str, size: Array) -> Subject:
    a, b = target.split(ARROW)
    has = {a: False, b: True}
    return subject.with_joints(lambda j: replace(j, actuated=has.get(j.name, j.actuated)))


ROWS = (
    Cause(
        "rotor inertia",
        "the rotor inertia (armature) of {target} differs by {size}",
        _more("rotor_inertia"),
        joints,
        scale=per_acceleration,
        unit="kg m^2 or kg",
        shows=FAST,
    ),
    Cause(
        "rotor inertia dropped",
        "the rotor inertia (armature) of all joints is not applied",
        _dropped("rotor_inertia"),
        _having("rotor_inertia"),
        parameters=0,
        shows=FAST,
    ),
    Cause(
        "viscous damping",
        "the viscous damping of {target} differs by {size}",
        _more("damping"),
        joints,
        scale=per_speed,
        unit="N m s/rad or N s/m",
        shows=STEADY,
    ),
    Cause(
        "damping dropped",
        "the viscous damping of the joints stands in the model but is not applied",
        _dropped("damping"),
        _having("damping"),
        parameters=0,
        shows=STEADY,
    ),
    Cause(
        "dry friction",
        "the dry friction of {target} differs by {size}",
        _more("friction"),
        joints,
        scale=effort,
        unit="N m or N",
        shows=STEADY,
    ),
    Cause(
        "friction dropped",
        "the dry friction of the joints stands in the model but is not applied",
        _dropped("friction"),
        _having("friction"),
        parameters=0,
        shows=STEADY,
    ),
    Cause(
        "implicit damping",
        "damping is taken implicitly: {size} times each joint's damping counts as rotor inertia",
        _implicit,
        _having("damping"),
        scale=_step,
        unit="s",
        shows="joints with different damping, each moved quickly: the added inertia goes with the damping",
    ),
    Cause(
        "joint stiffness",
        "a spring in {target} differs by {size}",
        _more("stiffness"),
        _sprung,
        scale=per_travel,
        unit="N m/rad or N/m",
        shows="this joint moved slowly over its whole range",
    ),
    Cause(
        "weight of a drive",
        "where drives share the work, the weight of {target} differs by the fraction {size}",
        _weighed,
        _sharing,
        shows="any motion of a mechanism with more drives than freedoms",
        fraction=True,
    ),
    Cause(
        "drive at another joint",
        "the effort is that of a drive at another joint: {target}",
        _driven_elsewhere,
        _passive,
        0,
        shows="the loop moved around once",
    ),
    Cause(
        "zero offset",
        "the zero of {target} is off by {size}",
        _placed(_offset),
        scalar,
        scale=coordinate,
        unit="rad or m",
        shows="the other joints moved while this one rests at several places",
    ),
    Cause(
        "axis sign",
        "the axis of {target} points the other way",
        _reversed,
        scalar,
        parameters=0,
        shows="this joint moved alone",
    ),
    Cause(
        "axis tilted",
        "the axis of {target} is tilted by {size}",
        _tilted,
        scalar,
        parameters=2,
        unit="rad",
        turns=True,
        shows="this joint turned far while the ones beyond it move",
    ),
    Cause(
        "joint misplaced",
        "{target} stands elsewhere on its parent, by {size}",
        _placed(_shifted),
        joints,
        parameters=3,
        scale=reach,
        unit="m",
        covers=("link length",),
        shows="the joints before and beyond this one moved together",
    ),
)
