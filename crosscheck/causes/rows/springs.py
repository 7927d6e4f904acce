"""Causes in springs and given forces: stiffness, rest length, damping, where they attach, what is left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crosscheck.causes.cause import Cause, Change, driven, effort, per_travel, reach, scalar
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Array, Subject
from flexinv.model.mechanism import Attachment, Force, Placement, Spring

OVER = "the spring stretched slowly over its whole range"
ENDS = ("first", "second")
TINY = 1e-9  # [N m/rad], [N/m]: a spring so long that its effort is constant


def _springs(model: Model) -> list[str]:
    return [s.name for s in model.base.mechanism.springs]


def _damped(model: Model) -> list[str]:
    return [s.name for s in model.base.mechanism.springs if s.damping]


def _ends(model: Model) -> list[str]:
    return [f"{name}: {end}" for name in _springs(model) for end in ENDS]


def _changed(change: Callable[[Spring, Array], Spring]) -> Change:
    def changed(subject: Subject, target: str, size: Array) -> Subject:
        springs = subject.mechanism.springs
        return subject.with_mechanism(springs=tuple(change(s, size) if s.name == target else s for s in springs))

    return changed


def _part(field: str) -> Change:
    """Return the change of a number of a spring by a fraction."""
    return _changed(lambda spring, size: replace(spring, **{field: getattr(spring, field) * (1.0 + float(size[0]))}))


def _stiffer(spring: Spring, size: Array) -> Spring:
    factor = 1.0 + float(size[0])
    return replace(spring, stiffness=spring.stiffness * factor, law=spring.law and spring.law.scale_forces(factor))


def _missing(subject: Subject, target: str, size: Array) -> Subject:
    return subject.with_mechanism(springs=tuple(s for s in subject.mechanism.springs if s.name != target))


def _moved(subject: Subject, target: str, size: Array) -> Subject:
    name, end = target.rsplit(": ", 1)

    def change(spring: Spring, size: Array) -> Spring:
        at = getattr(spring, end)
        place = replace(at.placement, position=at.placement.position + size)
        return replace(spring, **{end: replace(at, placement=place)})

    return _changed(change)(subject, name, size)


def _sprung(model: Model) -> list[str]:
    return [n for n in scalar(model) if model.base.mechanism.joint_of[n].stiffness]


def _rest(subject: Subject, target: str, size: Array) -> Subject:
    return subject.with_joint(target, lambda j: replace(j, rest=j.rest + float(size[0])))


def _bare(model: Model) -> list[str]:
    """Return the driven scalar joints without a spring."""
    return [n for n in driven(model) if n in scalar(model) and not model.base.mechanism.joint_of[n].stiffness]


def _sprung_elsewhere(subject: Subject, target: str, size: Array) -> Subject:
    """Put in a spring of stiffness size[0] whose effort at zero is -size[1]: it is without effort at their ratio."""
    stiffness = float(size[0])
    preload = float(size[1])
    if not stiffness:
        return (
            subject
            if not preload
            else subject.with_joint(target, lambda j: replace(j, stiffness=TINY, rest=preload / TINY))
        )
    return subject.with_joint(target, lambda j: replace(j, stiffness=stiffness, rest=preload / stiffness))


def _angle(model: Model, target: str) -> float:
    return effort(model, target) / (per_travel(model, target) or 1.0)


def _forces(model: Model) -> list[str]:
    return [f.name for f in model.base.mechanism.forces]


def _pushed(change: Callable[[Force, Array], Force | None]) -> Change:
    def changed(subject: Subject, target: str, size: Array) -> Subject:
        made = (change(f, size) if f.name == target else f for f in subject.mechanism.forces)
        return subject.with_mechanism(forces=tuple(f for f in made if f is not None))

    return changed


def _links(model: Model) -> list[str]:
    """Return the links that something moves."""
    return [j.child for j in model.base.mechanism.joints]


def _force_at_tip(subject: Subject, target: str, size: Array) -> Subject:
    link = subject.mechanism.link_of[target]
    at = Attachment(target, Placement(link.tip)) if link.beam is None else Attachment(target, station=1.0)
    one = Force("at the tip", at, np.concatenate([size, np.zeros(3)])[None])
    return subject.with_mechanism(forces=(*subject.mechanism.forces, one))


def _newton(model: Model, target: str) -> float:
    """Return the range of efforts over the length of a link [N]."""
    return float(model.scale.max()) / reach(model)


ROWS = (
    Cause(
        "spring stiffness",
        "the spring {target} is stiffer by the fraction {size}",
        _changed(_stiffer),
        _springs,
        covers=("spring missing",),
        shows=OVER,
        fraction=True,
    ),
    Cause(
        "spring rest length",
        "the spring {target} is without force at a length that differs by {size}",
        _changed(lambda spring, size: replace(spring, rest=spring.rest + float(size[0]))),
        _springs,
        scale=reach,
        unit="m",
        shows=OVER,
    ),
    Cause(
        "spring damping",
        "the damping of the spring {target} differs by the fraction {size}",
        _part("damping"),
        _damped,
        shows="the spring stretched quickly",
        fraction=True,
    ),
    Cause("spring missing", "the spring {target} is missing", _missing, _springs, 0, shows=OVER),
    Cause(
        "spring end misplaced",
        "the spring {target} attaches elsewhere, by {size}",
        _moved,
        _ends,
        3,
        reach,
        "m",
        shows=OVER,
    ),
    Cause(
        "rest of a joint spring",
        "the spring in {target} is without effort elsewhere, by {size}",
        _rest,
        _sprung,
        scale=_angle,
        unit="rad or m",
        shows="this joint held still at several places",
    ),
    Cause(
        "spring in a joint",
        "a spring of {size} in {target}: stiffness, and its effort before it is without any",
        _sprung_elsewhere,
        _bare,
        2,
        per_travel,
        "N m/rad or N/m; N m or N",
        covers=("joint stiffness", "effort offset"),
        shows="this joint moved slowly over its whole range",
    ),
    Cause(
        "given force",
        "the given force {target} differs by the fraction {size}",
        _pushed(lambda force, size: replace(force, wrench=force.wrench * (1.0 + float(size[0])))),
        _forces,
        covers=("given force missing",),
        shows="holding still at several places",
        fraction=True,
    ),
    Cause(
        "force at the tip",
        "a constant force of {size} in the world pulls at the tip of {target}",
        _force_at_tip,
        _links,
        3,
        _newton,
        "N",
        shows="holding still at several places",
    ),
    Cause(
        "given force missing",
        "the given force {target} is missing",
        _pushed(lambda force, size: None),
        _forces,
        0,
        shows="holding still at several places",
    ),
    Cause(
        "axes of a given force",
        "the given force {target} is taken along the world's axes in the place of the link's, or the other way round",
        _pushed(lambda force, size: replace(force, follower=not force.follower)),
        _forces,
        0,
        shows="the link turned far",
    ),
)
