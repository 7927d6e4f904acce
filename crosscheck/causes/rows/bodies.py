"""Causes in bodies: masses, centres of mass, inertia tensors, gravity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.causes.cause import (
    Cause,
    Change,
    check_fraction,
    compute_gravity_scale,
    compute_mean_mass,
    compute_typical_length,
    list_bodies,
    list_global_target,
    list_gravity_target,
)
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Subject
from flexinv.model.mechanism import Beam, Body, Inertia, Link
from flexinv.model.parallel_axis import compute_parallel_axis_term
from flexinv.typing import Array

TURN = "all joints moved quickly, each at a rhythm of its own, so that the body turns about all its axes"
HOLD = "holding still at several places (gravity alone)"


def _make_inertia_change(change: Callable[[Inertia, Array], Inertia]) -> Change:
    """Return the change of one body's inertia."""

    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        return subject.replace_body(target, lambda body: replace(body, inertia=change(body.inertia, size)))

    return apply_change


def _scale_mass(inertia: Inertia, size: Array) -> Inertia:
    factor = 1.0 + check_fraction(size)
    return inertia.replace_unchecked(mass=inertia.mass * factor, tensor=inertia.tensor * factor)


def _move_com(inertia: Inertia, size: Array) -> Inertia:
    return inertia.replace_unchecked(com=inertia.com + size)


def _turn_tensor(inertia: Inertia, size: Array) -> Inertia:
    r = scipy.spatial.transform.Rotation.from_rotvec(size).as_matrix()
    return inertia.replace_unchecked(tensor=r @ inertia.tensor @ r.T)


def _scale_tensor(inertia: Inertia, size: Array) -> Inertia:
    return inertia.replace_unchecked(tensor=inertia.tensor * (1.0 - float(size[0])))


def add_parallel_axis_term(inertia: Inertia, part: float) -> Inertia:
    """Return an inertia with a part [-] of the term to the frame's origin added to its tensor:  m (|c|^2 1 - c c^T)."""
    term = compute_parallel_axis_term(inertia.mass, inertia.com)
    return inertia.replace_unchecked(tensor=inertia.tensor + part * term)


def _make_parallel_axis_change(sign: float) -> Callable[[Inertia, Array], Inertia]:
    """Return the change to (or back from) the tensor about the frame's origin."""
    return lambda inertia, size: add_parallel_axis_term(inertia, sign * float(size[0]))


def list_eccentric_bodies(model: Model) -> list[str]:
    """Return the bodies whose centre of mass is not at their frame's origin."""
    return [name for name in list_bodies(model) if model.base.bodies[name][1].inertia.com.any()]


def remove_body(subject: Subject, target: str, size: Array) -> Subject:
    """Return the subject without one body."""
    link, body = subject.find_body(target)
    return subject.replace_link(link, lambda one: replace(one, bodies=tuple(b for b in one.bodies if b is not body)))


def _add_payload(subject: Subject, target: str, size: Array) -> Subject:
    link = subject.mechanism.link_of[target]
    at, station = (link.tip, None) if link.beam is None else (np.zeros(3), 1.0)
    extra = Body("payload", Inertia.build_unchecked(float(size[0]), at), station)
    return subject.replace_link(target, lambda one: replace(one, bodies=(*one.bodies, extra)))


def _list_links(model: Model) -> list[str]:
    return [link.name for link in model.base.mechanism.links]


def _scale_all_masses(subject: Subject, target: str, size: Array) -> Subject:
    factor = 1.0 + check_fraction(size)

    def update_beam(one: Beam) -> Beam:
        section = one.section
        return replace(
            one,
            section=replace(
                section,
                mass_per_length=section.mass_per_length * factor,
                rotary_inertia=section.rotary_inertia * factor,
            ),
        )

    def update_link(one: Link) -> Link:
        heavy = tuple(replace(b, inertia=_scale_mass(b.inertia, size)) for b in one.bodies)
        return replace(one, bodies=heavy, beam=None if one.beam is None else update_beam(one.beam))

    return subject.replace_links(update_link)


def _make_gravity_change(change: Callable[[Array, Array], Array]) -> Change:
    """Return the change of gravity (3,) [m/s^2] by a size."""

    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        return subject.replace_mechanism(gravity=change(subject.mechanism.gravity, size))

    return apply_change


# ------------------------------------------------------------------------------------------------------ fixed joints

ROTATION = "rotation of "
OFFSET = "offset of "
MASSLESS = "massless inertia on "


def _list_fusing_errors(model: Model) -> list[str]:
    """Return the possible errors of fusing links into their parents: fixed joints whose child has inertia."""
    fusing_errors = []
    for joint in model.base.mechanism.joints:
        link = model.base.mechanism.link_of[joint.child]
        if joint.kind != "fixed" or link.beam is not None or joint.parent == "world":
            continue
        r = joint.placement.rotation
        if any(not np.allclose(r @ b.inertia.tensor @ r.T, b.inertia.tensor, rtol=1e-6) for b in link.bodies):
            fusing_errors.append(ROTATION + joint.name)
        if any(b.inertia.mass for b in link.bodies) and joint.placement.position.any():
            fusing_errors.append(OFFSET + joint.name)
        if any(not b.inertia.mass and b.inertia.tensor.any() for b in link.bodies):
            fusing_errors.append(MASSLESS + joint.name)
    return fusing_errors


def _join_link_to_parent(subject: Subject, target: str, size: Array) -> Subject:
    """Fuse a link without turning its tensor, without moving it by the joint's offset, or without what has no mass."""
    part = next(word for word in (ROTATION, OFFSET, MASSLESS) if target.startswith(word))
    joint = subject.mechanism.joint_of[target.removeprefix(part)]
    r = joint.placement.rotation

    def update_body(one: Body) -> Body:
        inertia = one.inertia
        if part == ROTATION:
            inertia = inertia.replace_unchecked(tensor=r.T @ inertia.tensor @ r)
        elif part == OFFSET:
            inertia = inertia.replace_unchecked(com=inertia.com - r.T @ joint.placement.position)
        elif not inertia.mass:
            inertia = inertia.replace_unchecked(tensor=np.zeros((3, 3)))
        return replace(one, inertia=inertia)

    return subject.replace_link(joint.child, lambda link: replace(link, bodies=tuple(map(update_body, link.bodies))))


ROWS = (
    Cause(
        "gravity sign",
        "gravity points the other way",
        _make_gravity_change(lambda g, s: -g),
        list_gravity_target,
        0,
        shows=HOLD,
    ),
    Cause(
        "gravity off",
        "gravity is not applied",
        _make_gravity_change(lambda g, s: 0.0 * g),
        list_gravity_target,
        0,
        shows=HOLD,
    ),
    Cause(
        "gravity twice",
        "gravity is applied twice (as a field and as an acceleration of the base)",
        _make_gravity_change(lambda g, s: 2.0 * g),
        list_gravity_target,
        0,
        shows=HOLD,
    ),
    Cause(
        "gravity magnitude",
        "gravity differs by the fraction {size}",
        _make_gravity_change(lambda g, s: g * (1.0 + float(s[0]))),
        list_gravity_target,
        covers=("gravity sign", "gravity off", "gravity twice"),
        fraction=True,
        shows=HOLD,
    ),
    Cause(
        "base acceleration",
        "the base is accelerated by {size} more (or gravity points elsewhere)",
        _make_gravity_change(lambda g, s: g - s),
        list_global_target,
        3,
        compute_gravity_scale,
        "m/s^2",
        covers=("gravity sign", "gravity off", "gravity twice", "gravity magnitude"),
        shows=HOLD,
    ),
    Cause(
        "mass scale",
        "all masses and inertias differ by the fraction {size}",
        _scale_all_masses,
        fraction=True,
        shows=HOLD,
    ),
    Cause(
        "body mass",
        "mass and inertia of {target} differ by the fraction {size}",
        _make_inertia_change(_scale_mass),
        list_bodies,
        covers=("missing body",),
        fraction=True,
        shows=TURN,
    ),
    Cause("missing body", "{target} is missing", remove_body, list_bodies, 0, shows=TURN),
    Cause(
        "payload",
        "{target} carries {size} more at its tip",
        _add_payload,
        _list_links,
        1,
        compute_mean_mass,
        "kg",
        shows=HOLD,
    ),
    Cause(
        "centre of mass shifted",
        "the centre of mass of {target} is shifted by {size}",
        _make_inertia_change(_move_com),
        list_bodies,
        3,
        compute_typical_length,
        "m",
        covers=("fixed joint fused wrongly", "centres of mass scaled", "centre of mass mirrored"),
        shows=HOLD,
    ),
    Cause(
        "inertia about the origin",
        "the inertia of {target} about its frame's origin is taken for the one about its centre of mass",
        _make_inertia_change(_make_parallel_axis_change(1.0)),
        list_eccentric_bodies,
        0,
        shows=TURN,
    ),
    Cause(
        "inertia about the wrong point",
        "the inertia of {target} is taken about another point: {size} of m (|c|^2 1 - c c^T) is added",
        _make_inertia_change(_make_parallel_axis_change(1.0)),
        list_eccentric_bodies,
        covers=("inertia about the origin",),
        fraction=True,
        shows=TURN,
    ),
    Cause(
        "inertial frame rotated",
        "the inertia tensor of {target} is rotated by {size}",
        _make_inertia_change(_turn_tensor),
        list_bodies,
        3,
        unit="rad",
        turns=True,
        covers=("fixed joint fused wrongly",),
        shows=TURN,
    ),
    Cause(
        "rotary inertia dropped",
        "{target} is a point mass: its inertia about its centre of mass is dropped by the fraction {size}",
        _make_inertia_change(_scale_tensor),
        list_bodies,
        fraction=True,
        shows=TURN,
    ),
    Cause(
        "fixed joint fused wrongly",
        "fused into its parent without the {target}",
        _join_link_to_parent,
        _list_fusing_errors,
        0,
        shows=TURN,
    ),
)
