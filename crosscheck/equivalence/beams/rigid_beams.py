"""Beams and meshes held in their stress-free shape: a mechanism of rigid links with the same joints, masses and frames.

section at s    X(s) = X_root exp(s (e_1, kappa))  in the link frame
body            rho A(s) ds at X(s), with rho I(s) ds along its axes, summed by Gauss points between the section's stations
what stands on a section is stated in the link frame: X(s) X_stated
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from crosscheck.lifting.rigid import apply_placement, join_bodies, move_inertia
from flexinv.kinematics.mesh import compute_section_frame
from flexinv.model.mechanism import Array, Attachment, Beam, Body, Inertia, Joint, Link, Mechanism, Placement
from flexinv.parts.reductions import find_reduction

POINTS = 8  # of Gauss on each half of a stretch: exact for straight beams, to rounding for arcs of a turn


def make_rigid_mechanism(mechanism: Mechanism) -> Mechanism:
    """Return the rigid mechanism of a flexible one [m, kg]; a rigid one is returned itself."""
    if mechanism.is_rigid:
        return mechanism
    flexible = {link.name: link for link in mechanism.flexible}
    return replace(
        mechanism,
        links=tuple(_make_rigid_link(link) for link in mechanism.links),
        joints=tuple(_make_rigid_joint(joint, flexible.get(joint.parent)) for joint in mechanism.joints),
        closures=tuple(
            replace(one, first=_end(one.first, flexible), second=_end(one.second, flexible))
            for one in mechanism.closures
        ),
        springs=tuple(
            replace(one, first=_end(one.first, flexible), second=_end(one.second, flexible))
            for one in mechanism.springs
        ),
        forces=tuple(replace(one, at=_end(one.at, flexible)) for one in mechanism.forces),
        modal_damping=None,
    )


def evaluate_section_frame(beam: Beam, station: float | None) -> Placement:
    """Return a section's frame [m] in the link frame, at a fraction 0..1 of the length [-]; None : at the end."""
    return apply_placement(
        beam.placement, compute_section_frame(beam, beam.length * (1.0 if station is None else station))
    )


def _find_seat(link: Link, station: float | None, interface: str) -> Placement | None:
    """The frame of a section or an interface in the link frame; None where the link frame itself carries."""
    if link.part is not None and interface:
        return Placement(link.part.interface_of[interface].origin)
    if link.beam is not None and station is not None:
        return evaluate_section_frame(link.beam, station)
    return None


def _make_rigid_link(link: Link) -> Link:
    if link.is_rigid:
        return link
    bodies = []
    for body in link.bodies:
        seat = _find_seat(link, body.station, body.interface)
        bodies.append(Body(body.name, body.inertia if seat is None else move_inertia(seat, body.inertia)))
    own, tip = _compute_beam_inertia(link.beam) if link.beam is not None else _compute_part_inertia(link)
    return Link(link.name, (Body(link.name, own), *bodies), tip=tip)


def _compute_beam_inertia(beam: Beam) -> tuple[Inertia, Array]:
    """Inertia and end of a beam in the link frame."""
    return join_bodies(_list_slice_inertias(beam)), evaluate_section_frame(beam, None).position


def _compute_part_inertia(link: Link) -> tuple[Inertia, Array]:
    """Inertia and tip of a mesh in the link frame."""
    assert link.part is not None
    reduced = find_reduction(link.part)
    weights = np.asarray(reduced.mass.sum(axis=0)).ravel()
    mass = float(weights.sum())
    centre = weights @ reduced.points / mass
    arms = reduced.points - centre
    second = arms.T @ (reduced.mass @ arms)
    tensor = np.trace(second) * np.eye(3) - second
    return Inertia(mass, centre, (tensor + tensor.T) / 2), link.part.interface_of[link.part.tip].origin


def _list_slice_inertias(beam: Beam) -> Iterator[Inertia]:
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    section = beam.section
    bounds = np.union1d(np.linspace(0.0, 1.0, 3), np.clip(section.stations, 0.0, 1.0))
    for low, high in pairwise(bounds):
        for at, weight in zip((low + high) / 2 + (high - low) / 2 * nodes, weights * (high - low) / 2, strict=True):
            per_length = section.evaluate_inertia(float(at))
            ds = weight * beam.length
            slice_inertia = Inertia(per_length.mass * ds, per_length.com, per_length.tensor * ds)
            yield move_inertia(evaluate_section_frame(beam, float(at)), slice_inertia)


def _make_rigid_joint(joint: Joint, parent: Link | None) -> Joint:
    seat = None if parent is None else _find_seat(parent, joint.station, joint.interface)
    if seat is None:
        return joint
    return replace(joint, station=None, interface="", placement=apply_placement(seat, joint.placement))


def _end(end: Attachment, flexible: Mapping[str, Link]) -> Attachment:
    link = flexible.get(end.link)
    seat = None if link is None else _find_seat(link, end.station, end.interface)
    return end if seat is None else Attachment(end.link, apply_placement(seat, end.placement))
