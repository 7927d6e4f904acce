"""Beams held in their stress-free shape: a mechanism of rigid links with the same joints, masses and frames.

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
from flexinv.model.mechanism import WORLD, Attachment, Beam, Body, Inertia, Joint, Link, Mechanism, Placement

POINTS = 8  # of Gauss on each half of a stretch: exact for straight beams, to rounding for arcs of a turn


def make_rigid_mechanism(mechanism: Mechanism) -> Mechanism:
    """Return the rigid mechanism of a flexible one [m, kg]; a rigid one is returned itself."""
    if mechanism.is_rigid:
        return mechanism
    beams = {link.name: link.beam for link in mechanism.beams}
    return replace(
        mechanism,
        links=tuple(_make_rigid_link(link, beams.get(link.name)) for link in mechanism.links),
        joints=tuple(_make_rigid_joint(joint, beams.get(joint.parent)) for joint in mechanism.joints),
        closures=tuple(
            replace(one, first=_end(one.first, beams), second=_end(one.second, beams)) for one in mechanism.closures
        ),
        modal_damping=None,
    )


def evaluate_section_frame(beam: Beam, station: float | None) -> Placement:
    """Return a section's frame [m] in the link frame, at a fraction 0..1 of the length [-]; None : at the end."""
    return apply_placement(
        beam.placement, compute_section_frame(beam, beam.length * (1.0 if station is None else station))
    )


def _make_rigid_link(link: Link, beam: Beam | None) -> Link:
    if beam is None:
        return link
    bodies = [
        Body(
            body.name,
            body.inertia
            if body.station is None
            else move_inertia(evaluate_section_frame(beam, body.station), body.inertia),
        )
        for body in link.bodies
    ]
    return Link(
        link.name,
        (Body(link.name, join_bodies(_list_slice_inertias(beam))), *bodies),
        tip=evaluate_section_frame(beam, None).position,
    )


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


def _make_rigid_joint(joint: Joint, beam: Beam | None) -> Joint:
    if beam is None or joint.parent == WORLD:
        return joint
    return replace(
        joint, station=None, placement=apply_placement(evaluate_section_frame(beam, joint.station), joint.placement)
    )


def _end(end: Attachment, beams: Mapping[str, Beam | None]) -> Attachment:
    beam = beams.get(end.link)
    if beam is None or end.station is None:
        return end
    return Attachment(end.link, apply_placement(evaluate_section_frame(beam, end.station), end.placement))
