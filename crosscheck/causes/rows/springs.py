"""Causes in springs and given forces: stiffness, rest length, damping, where they attach, what is left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crosscheck.causes.cause import (
    Cause,
    Change,
    compute_effort_range,
    compute_stiffness_scale,
    compute_typical_length,
    list_driven_joints,
    list_scalar_joints,
)
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Subject
from flexinv.model.mechanism import Attachment, Force, Placement, Spring
from flexinv.typing import Array

OVER = "the spring stretched slowly over its whole range"
ENDS = ("first", "second")
TINY = 1e-9  # [N m/rad], [N/m]: a spring so long that its effort is constant


def _list_springs(model: Model) -> list[str]:
    return [s.name for s in model.base.mechanism.springs]


def _list_damped_springs(model: Model) -> list[str]:
    return [s.name for s in model.base.mechanism.springs if s.damping]


def _list_spring_ends(model: Model) -> list[str]:
    return [f"{name}: {end}" for name in _list_springs(model) for end in ENDS]


def _make_spring_change(change: Callable[[Spring, Array], Spring]) -> Change:
    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        springs = subject.mechanism.springs
        return subject.replace_mechanism(springs=tuple(change(s, size) if s.name == target else s for s in springs))

    return apply_change


def _make_field_scale(field: str) -> Change:
    """Return the change of a number of a spring by a fraction."""
    return _make_spring_change(
        lambda spring, size: replace(spring, **{field: getattr(spring, field) * (1.0 + float(size[0]))})
    )


def _scale_stiffness(spring: Spring, size: Array) -> Spring:
    factor = 1.0 + float(size[0])
    return replace(spring, stiffness=spring.stiffness * factor, law=spring.law and spring.law.scale_forces(factor))


def _remove_spring(subject: Subject, target: str, size: Array) -> Subject:
    return subject.replace_mechanism(springs=tuple(s for s in subject.mechanism.springs if s.name != target))


def _move_spring_end(subject: Subject, target: str, size: Array) -> Subject:
    name, end = target.rsplit(": ", 1)

    def update_spring(spring: Spring, size: Array) -> Spring:
        at = getattr(spring, end)
        place = replace(at.placement, position=at.placement.position + size)
        return replace(spring, **{end: replace(at, placement=place)})

    return _make_spring_change(update_spring)(subject, name, size)


def _list_sprung_joints(model: Model) -> list[str]:
    return [n for n in list_scalar_joints(model) if model.base.mechanism.joint_of[n].stiffness]


def _move_rest_position(subject: Subject, target: str, size: Array) -> Subject:
    return subject.replace_joint(target, lambda j: replace(j, rest=j.rest + float(size[0])))


def _list_joints_without_spring(model: Model) -> list[str]:
    """Return the driven scalar joints without a spring."""
    return [
        n
        for n in list_driven_joints(model)
        if n in list_scalar_joints(model) and not model.base.mechanism.joint_of[n].stiffness
    ]


def _add_joint_spring(subject: Subject, target: str, size: Array) -> Subject:
    """Put in a spring of stiffness size[0] whose effort at zero is -size[1]: it is without effort at their ratio."""
    stiffness = float(size[0])
    preload = float(size[1])
    if not stiffness:
        return (
            subject
            if not preload
            else subject.replace_joint(target, lambda j: replace(j, stiffness=TINY, rest=preload / TINY))
        )
    return subject.replace_joint(target, lambda j: replace(j, stiffness=stiffness, rest=preload / stiffness))


def _compute_rest_scale(model: Model, target: str) -> float:
    return compute_effort_range(model, target) / (compute_stiffness_scale(model, target) or 1.0)


def _list_forces(model: Model) -> list[str]:
    return [f.name for f in model.base.mechanism.forces]


def _make_force_change(change: Callable[[Force, Array], Force | None]) -> Change:
    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        made = (change(f, size) if f.name == target else f for f in subject.mechanism.forces)
        return subject.replace_mechanism(forces=tuple(f for f in made if f is not None))

    return apply_change


def _list_moving_links(model: Model) -> list[str]:
    """Return the links that something moves."""
    return [j.child for j in model.base.mechanism.joints]


def _add_tip_force(subject: Subject, target: str, size: Array) -> Subject:
    link = subject.mechanism.link_of[target]
    at = Attachment(target, Placement(link.tip)) if link.beam is None else Attachment(target, station=1.0)
    one = Force("at the tip", at, np.concatenate([size, np.zeros(3)])[None])
    return subject.replace_mechanism(forces=(*subject.mechanism.forces, one))


def _compute_force_scale(model: Model, target: str) -> float:
    """Return the range of efforts over the length of a link [N]."""
    return float(model.scale.max()) / compute_typical_length(model)


ROWS = (
    Cause(
        "spring stiffness",
        "the spring {target} is stiffer by the fraction {size}",
        _make_spring_change(_scale_stiffness),
        _list_springs,
        covers=("spring missing",),
        shows=OVER,
        fraction=True,
    ),
    Cause(
        "spring rest length",
        "the spring {target} is without force at a length that differs by {size}",
        _make_spring_change(lambda spring, size: replace(spring, rest=spring.rest + float(size[0]))),
        _list_springs,
        scale=compute_typical_length,
        unit="m",
        shows=OVER,
    ),
    Cause(
        "spring damping",
        "the damping of the spring {target} differs by the fraction {size}",
        _make_field_scale("damping"),
        _list_damped_springs,
        shows="the spring stretched quickly",
        fraction=True,
    ),
    Cause("spring missing", "the spring {target} is missing", _remove_spring, _list_springs, 0, shows=OVER),
    Cause(
        "spring end misplaced",
        "the spring {target} attaches elsewhere, by {size}",
        _move_spring_end,
        _list_spring_ends,
        3,
        compute_typical_length,
        "m",
        shows=OVER,
    ),
    Cause(
        "rest of a joint spring",
        "the spring in {target} is without effort elsewhere, by {size}",
        _move_rest_position,
        _list_sprung_joints,
        scale=_compute_rest_scale,
        unit="rad or m",
        shows="this joint held still at several places",
    ),
    Cause(
        "spring in a joint",
        "a spring of {size} in {target}: stiffness, and its effort before it is without any",
        _add_joint_spring,
        _list_joints_without_spring,
        2,
        compute_stiffness_scale,
        "N m/rad or N/m; N m or N",
        covers=("joint stiffness", "effort offset"),
        shows="this joint moved slowly over its whole range",
    ),
    Cause(
        "given force",
        "the given force {target} differs by the fraction {size}",
        _make_force_change(lambda force, size: replace(force, wrench=force.wrench * (1.0 + float(size[0])))),
        _list_forces,
        covers=("given force missing",),
        shows="holding still at several places",
        fraction=True,
    ),
    Cause(
        "force at the tip",
        "a constant force of {size} in the world pulls at the tip of {target}",
        _add_tip_force,
        _list_moving_links,
        3,
        _compute_force_scale,
        "N",
        shows="holding still at several places",
    ),
    Cause(
        "given force missing",
        "the given force {target} is missing",
        _make_force_change(lambda force, size: None),
        _list_forces,
        0,
        shows="holding still at several places",
    ),
    Cause(
        "axes of a given force",
        "the given force {target} is taken along the world's axes in the place of the link's, or the other way round",
        _make_force_change(lambda force, size: replace(force, follower=not force.follower)),
        _list_forces,
        0,
        shows="the link turned far",
    ),
)
