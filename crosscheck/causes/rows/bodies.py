"""Causes in bodies: masses, centres of mass, inertia tensors, gravity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.causes.cause import Cause, Change, bodies, mass, more_than_nothing, pull, pulled, reach, whole
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Array, Subject
from flexinv.model.mechanism import Beam, Body, Inertia, Link

TURN = "all joints moved quickly, each at a rhythm of its own, so that the body turns about all its axes"
HOLD = "holding still at several places (gravity alone)"


def _inertia(change: Callable[[Inertia, Array], Inertia]) -> Change:
    """Return the change of one body's inertia."""

    def changed(subject: Subject, target: str, size: Array) -> Subject:
        return subject.with_body(target, lambda body: replace(body, inertia=change(body.inertia, size)))

    return changed


def _heavier(inertia: Inertia, size: Array) -> Inertia:
    factor = 1.0 + more_than_nothing(size)
    return inertia.replace_unchecked(mass=inertia.mass * factor, tensor=inertia.tensor * factor)


def _shifted(inertia: Inertia, size: Array) -> Inertia:
    return inertia.replace_unchecked(com=inertia.com + size)


def _turned(inertia: Inertia, size: Array) -> Inertia:
    r = scipy.spatial.transform.Rotation.from_rotvec(size).as_matrix()
    return inertia.replace_unchecked(tensor=r @ inertia.tensor @ r.T)


def _stretched(inertia: Inertia, size: Array) -> Inertia:
    return inertia.replace_unchecked(tensor=inertia.tensor * (1.0 - float(size[0])))


def _moved(sign: float) -> Callable[[Inertia, Array], Inertia]:
    """Return the change to (or back from) the tensor about the frame's origin:  I + m (|c|^2 1 - c c^T)."""

    def change(inertia: Inertia, size: Array) -> Inertia:
        c = inertia.com
        steiner = inertia.mass * (c @ c * np.eye(3) - np.outer(c, c))
        return inertia.replace_unchecked(tensor=inertia.tensor + sign * float(size[0]) * steiner)

    return change


def _off_centre(model: Model) -> list[str]:
    return [name for name in bodies(model) if model.base.bodies[name][1].inertia.com.any()]


def _missing(subject: Subject, target: str, size: Array) -> Subject:
    link, body = subject.body_of(target)
    return subject.with_link(link, lambda one: replace(one, bodies=tuple(b for b in one.bodies if b is not body)))


def _payload(subject: Subject, target: str, size: Array) -> Subject:
    link = subject.mechanism.link_of[target]
    at, station = (link.tip, None) if link.beam is None else (np.zeros(3), 1.0)
    extra = Body("payload", Inertia.stated(float(size[0]), at), station)
    return subject.with_link(target, lambda one: replace(one, bodies=(*one.bodies, extra)))


def _carriers(model: Model) -> list[str]:
    return [link.name for link in model.base.mechanism.links]


def _scaled(subject: Subject, target: str, size: Array) -> Subject:
    factor = 1.0 + more_than_nothing(size)

    def beam(one: Beam) -> Beam:
        section = one.section
        return replace(
            one,
            section=replace(
                section,
                mass_per_length=section.mass_per_length * factor,
                rotary_inertia=section.rotary_inertia * factor,
            ),
        )

    def link(one: Link) -> Link:
        heavy = tuple(replace(b, inertia=_heavier(b.inertia, size)) for b in one.bodies)
        return replace(one, bodies=heavy, beam=None if one.beam is None else beam(one.beam))

    return subject.with_links(link)


def _gravity(change: Callable[[Array, Array], Array]) -> Change:
    """Return the change of gravity (3,) [m/s^2] by a size."""

    def changed(subject: Subject, target: str, size: Array) -> Subject:
        return subject.with_mechanism(gravity=change(subject.mechanism.gravity, size))

    return changed


# ------------------------------------------------------------------------------------------------------ fixed joints

ROTATION = "rotation of "
OFFSET = "offset of "
MASSLESS = "massless inertia on "


def _fixed(model: Model) -> list[str]:
    """Return the possible errors of fusing links into their parents: fixed joints whose child has inertia."""
    found = []
    for joint in model.base.mechanism.joints:
        link = model.base.mechanism.link_of[joint.child]
        if joint.kind != "fixed" or link.beam is not None or joint.parent == "world":
            continue
        r = joint.placement.rotation
        if any(not np.allclose(r @ b.inertia.tensor @ r.T, b.inertia.tensor, rtol=1e-6) for b in link.bodies):
            found.append(ROTATION + joint.name)
        if any(b.inertia.mass for b in link.bodies) and joint.placement.position.any():
            found.append(OFFSET + joint.name)
        if any(not b.inertia.mass and b.inertia.tensor.any() for b in link.bodies):
            found.append(MASSLESS + joint.name)
    return found


def _fused(subject: Subject, target: str, size: Array) -> Subject:
    """Fuse a link without turning its tensor, without moving it by the joint's offset, or without what has no mass."""
    part = next(word for word in (ROTATION, OFFSET, MASSLESS) if target.startswith(word))
    joint = subject.mechanism.joint_of[target.removeprefix(part)]
    r = joint.placement.rotation

    def body(one: Body) -> Body:
        inertia = one.inertia
        if part == ROTATION:
            inertia = inertia.replace_unchecked(tensor=r.T @ inertia.tensor @ r)
        elif part == OFFSET:
            inertia = inertia.replace_unchecked(com=inertia.com - r.T @ joint.placement.position)
        elif not inertia.mass:
            inertia = inertia.replace_unchecked(tensor=np.zeros((3, 3)))
        return replace(one, inertia=inertia)

    return subject.with_link(joint.child, lambda link: replace(link, bodies=tuple(map(body, link.bodies))))


ROWS = (
    Cause("gravity sign", "gravity points the other way", _gravity(lambda g, s: -g), pulled, 0, shows=HOLD),
    Cause("gravity off", "gravity is not applied", _gravity(lambda g, s: 0.0 * g), pulled, 0, shows=HOLD),
    Cause(
        "gravity twice",
        "gravity is applied twice (as a field and as an acceleration of the base)",
        _gravity(lambda g, s: 2.0 * g),
        pulled,
        0,
        shows=HOLD,
    ),
    Cause(
        "gravity magnitude",
        "gravity differs by the fraction {size}",
        _gravity(lambda g, s: g * (1.0 + float(s[0]))),
        pulled,
        covers=("gravity sign", "gravity off", "gravity twice"),
        fraction=True,
        shows=HOLD,
    ),
    Cause(
        "base acceleration",
        "the base is accelerated by {size} more (or gravity points elsewhere)",
        _gravity(lambda g, s: g - s),
        whole,
        3,
        pull,
        "m/s^2",
        covers=("gravity sign", "gravity off", "gravity twice", "gravity magnitude"),
        shows=HOLD,
    ),
    Cause("mass scale", "all masses and inertias differ by the fraction {size}", _scaled, fraction=True, shows=HOLD),
    Cause(
        "body mass",
        "mass and inertia of {target} differ by the fraction {size}",
        _inertia(_heavier),
        bodies,
        covers=("missing body",),
        fraction=True,
        shows=TURN,
    ),
    Cause("missing body", "{target} is missing", _missing, bodies, 0, shows=TURN),
    Cause("payload", "{target} carries {size} more at its tip", _payload, _carriers, 1, mass, "kg", shows=HOLD),
    Cause(
        "centre of mass shifted",
        "the centre of mass of {target} is shifted by {size}",
        _inertia(_shifted),
        bodies,
        3,
        reach,
        "m",
        covers=("fixed joint fused wrongly", "centres of mass scaled", "centre of mass mirrored"),
        shows=HOLD,
    ),
    Cause(
        "inertia about the origin",
        "the inertia of {target} about its frame's origin is taken for the one about its centre of mass",
        _inertia(_moved(1.0)),
        _off_centre,
        0,
        shows=TURN,
    ),
    Cause(
        "inertia about the wrong point",
        "the inertia of {target} is taken about another point: {size} of m (|c|^2 1 - c c^T) is added",
        _inertia(_moved(1.0)),
        _off_centre,
        covers=("inertia about the origin",),
        fraction=True,
        shows=TURN,
    ),
    Cause(
        "inertial frame rotated",
        "the inertia tensor of {target} is rotated by {size}",
        _inertia(_turned),
        bodies,
        3,
        unit="rad",
        turns=True,
        covers=("fixed joint fused wrongly",),
        shows=TURN,
    ),
    Cause(
        "rotary inertia dropped",
        "{target} is a point mass: its inertia about its centre of mass is dropped by the fraction {size}",
        _inertia(_stretched),
        bodies,
        fraction=True,
        shows=TURN,
    ),
    Cause(
        "fixed joint fused wrongly",
        "fused into its parent without the {target}",
        _fused,
        _fixed,
        0,
        shows=TURN,
    ),
)
