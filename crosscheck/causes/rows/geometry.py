"""Causes in geometry: lengths of links, frames of joints, where closures hold, gear ratios, where beams are clamped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import scipy  # its parts are loaded when they are asked for

from crosscheck.causes.cause import (
    Cause,
    Change,
    check_fraction,
    compute_typical_length,
    list_beams,
    list_moving_joints,
)
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Subject
from flexinv.errors import InputError
from flexinv.model.mechanism import Attachment, Beam, Body, Closure, Joint, Placement
from flexinv.typing import Array

TOGETHER = "the joints before and beyond this one moved together"
AROUND = "the loop moved around once"
ENDS = ("first", "second")


def _turn_placement(place: Placement, size: Array) -> Placement:
    return replace(place, rotation=place.rotation @ scipy.spatial.transform.Rotation.from_rotvec(size).as_matrix())


def _move_placement(place: Placement, size: Array) -> Placement:
    return replace(place, position=place.position + size)


def _make_joint_change(change: Callable[[Joint, Array], Joint]) -> Change:
    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        return subject.replace_joint(target, lambda j: change(j, size))

    return apply_change


def _scale_offset(joint: Joint, size: Array) -> Joint:
    factor = 1.0 + check_fraction(size)
    return replace(joint, placement=replace(joint.placement, position=joint.placement.position * factor))


def _list_offset_joints(model: Model) -> list[str]:
    """Return the joints, fixed ones too, that stand away from their parent's origin on a rigid link."""
    found = [j for j in model.base.mechanism.joints if j.station is None and j.parent != "world"]
    return [j.name for j in found if j.placement.position.any()]


def _list_closure_ends(model: Model) -> list[str]:
    closures = [c for c in model.base.mechanism.closures if c.kind != "coupling"]
    return [f"{c.name}: {end}" for c in closures for end in ENDS]


def _make_closure_frame_change(change: Callable[[Placement, Array], Placement]) -> Change:
    """Return the change of where a closure holds one of its links."""

    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        name, end = target.rsplit(": ", 1)

        def update_closure(closure: Closure) -> Closure:
            here: Attachment = getattr(closure, end)
            moved = replace(here, placement=change(here.placement, size))
            if closure.name != name:
                return closure
            return replace(closure, first=moved) if end == "first" else replace(closure, second=moved)

        return subject.replace_closures(update_closure)

    return apply_change


def _list_couplings(model: Model) -> list[str]:
    return [c.name for c in model.base.mechanism.closures if c.kind == "coupling"]


def _make_coupling_change(change: Callable[[Closure, Array], Closure]) -> Change:
    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        return subject.replace_closures(lambda c: change(c, size) if c.name == target else c)

    return apply_change


def _scale_gear_ratio(closure: Closure, size: Array) -> Closure:
    (first, factor), *rest = closure.factors
    return replace(closure, factors=((first, factor * (1.0 + check_fraction(size))), *rest))


def _add_coupling_offset(closure: Closure, size: Array) -> Closure:
    return replace(closure, offset=closure.offset + float(size[0]))


def _make_clamp_change(change: Callable[[Placement, Array], Placement]) -> Change:
    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        return subject.replace_beam(target, lambda beam: replace(beam, placement=change(beam.placement, size)))

    return apply_change


def _add_curvature(beam: Beam, size: Array) -> Beam:
    return replace(beam, curvature=beam.curvature + size)


def _apply_curvature(subject: Subject, target: str, size: Array) -> Subject:
    return subject.replace_beam(target, lambda beam: _add_curvature(beam, size))


def _compute_curvature_scale(model: Model, target: str) -> float:
    beam = model.base.mechanism.link_of[target].beam
    assert beam is not None
    return 1.0 / beam.length


def _list_bodies_along_beams(model: Model) -> list[str]:
    """Return the bodies that sit along a beam, not at its root."""
    links = model.base.mechanism.beams
    return [f"{link.name}/{b.name}" for link in links for b in link.bodies if b.station]


def _move_body_along_beam(subject: Subject, target: str, size: Array) -> Subject:
    def update_body(body: Body) -> Body:
        station = (body.station or 0.0) + float(size[0])
        if not 0.0 <= station <= 1.0:
            raise InputError(f"a body at {station:g} of the length: expected 0 to 1")
        return replace(body, station=station)

    return subject.replace_body(target, update_body)


ROWS = (
    Cause(
        "link length",
        "{target} is farther from the origin of its parent, by the fraction {size} (a length of the link)",
        _make_joint_change(_scale_offset),
        _list_offset_joints,
        shows=TOGETHER,
        fraction=True,
    ),
    Cause(
        "joint frame turned",
        "the frame of {target} is turned by {size} on its parent",
        _make_joint_change(lambda joint, size: replace(joint, placement=_turn_placement(joint.placement, size))),
        list_moving_joints,
        3,
        unit="rad",
        turns=True,
        covers=("zero offset", "axis tilted"),
        shows=TOGETHER,
    ),
    Cause(
        "closure point misplaced",
        "the closure {target} holds its link elsewhere, by {size}",
        _make_closure_frame_change(_move_placement),
        _list_closure_ends,
        3,
        compute_typical_length,
        "m",
        shows=AROUND,
    ),
    Cause(
        "closure frame turned",
        "the frame of the closure {target} is turned by {size}",
        _make_closure_frame_change(_turn_placement),
        _list_closure_ends,
        3,
        unit="rad",
        shows=AROUND,
    ),
    Cause(
        "coupling ratio",
        "the ratio of the gear {target} differs by the fraction {size}",
        _make_coupling_change(_scale_gear_ratio),
        _list_couplings,
        shows=AROUND,
        fraction=True,
    ),
    Cause(
        "coupling offset",
        "the gear {target} is off by {size}",
        _make_coupling_change(_add_coupling_offset),
        _list_couplings,
        unit="rad or m",
        shows=AROUND,
    ),
    Cause(
        "clamp misplaced",
        "the clamp of {target} is off by {size}",
        _make_clamp_change(_move_placement),
        list_beams,
        3,
        compute_typical_length,
        "m",
        shows="holding still at several places, and turning quickly",
    ),
    Cause(
        "clamp turned",
        "the clamp of {target} is turned by {size}",
        _make_clamp_change(_turn_placement),
        list_beams,
        3,
        unit="rad",
        shows="holding still at several places",
    ),
    Cause(
        "initial curvature",
        "{target} is bent by {size} more where nothing pulls it",
        _apply_curvature,
        list_beams,
        3,
        _compute_curvature_scale,
        "1/m",
        covers=("curvature dropped",),
        shows="holding still at several places",
    ),
    Cause(
        "body along the beam",
        "{target} sits farther along its beam, by {size} of the length",
        _move_body_along_beam,
        _list_bodies_along_beams,
        shows="a stop and a rest long enough to ring",
    ),
)
