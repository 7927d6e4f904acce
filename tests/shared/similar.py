"""Exactly similar mechanisms: lengths and times by one factor, density and stiffness of the material as they are.

Speeds stay, accelerations (and gravity) go with 1 / factor, masses with its cube, forces with its square: elastic and inertial
forces of a beam keep their ratio, so that every answer is that of the original, scaled.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexinv.model.mechanism import (
    Attachment,
    Beam,
    Body,
    Closure,
    Force,
    Joint,
    Link,
    Mechanism,
    Placement,
    Section,
    Spring,
)

# Powers of the factor in six numbers per length: stiffness (EA, GA, GA, GJ, EI, EI), and a wrench (force, moment).
STIFFNESS = np.array([2.0, 2.0, 2.0, 4.0, 4.0, 4.0])
WRENCH = np.array([2.0, 2.0, 2.0, 3.0, 3.0, 3.0])


def similar(m: Mechanism, factor: float) -> Mechanism:
    """Return the mechanism whose lengths are ``factor`` times as large, of the same materials."""
    return replace(
        m,
        links=tuple(_link(link, factor) for link in m.links),
        joints=tuple(_joint(joint, factor) for joint in m.joints),
        gravity=m.gravity / factor,
        closures=tuple(_closure(m, one, factor) for one in m.closures),
        springs=tuple(_spring(one, factor) for one in m.springs),
        forces=tuple(_force(one, factor) for one in m.forces),
    )


def coordinates(m: Mechanism, q: np.ndarray, factor: float) -> np.ndarray:
    """Return q (..., nq) or a rate (..., nv) whose slides are ``factor`` times as long."""
    powers = np.zeros(q.shape[-1])
    slices = m.q_slices if q.shape[-1] == m.nq else m.v_slices
    for joint in m.joints:
        first = slices[joint.name].start
        powers[first : first + {"prismatic": 1, "free": 3}.get(joint.kind, 0)] = 1.0
    return q * factor**powers


def efforts(m: Mechanism, tau: np.ndarray, factor: float) -> np.ndarray:
    """Return efforts (..., nv) of the similar mechanism: moments by the cube, forces by the square."""
    return factor**3 * coordinates(m, tau, 1.0 / factor)


def _place(at: Placement, s: float) -> Placement:
    return Placement(s * at.position, at.rotation)


def _attached(at: Attachment, s: float) -> Attachment:
    return replace(at, placement=_place(at.placement, s))


def _link(link: Link, s: float) -> Link:
    return replace(
        link,
        bodies=tuple(_body(body, s) for body in link.bodies),
        beam=None if link.beam is None else _beam(link.beam, s),
        tip=s * link.tip,
    )


def _body(body: Body, s: float) -> Body:
    of = body.inertia
    return replace(body, inertia=replace(of, mass=s**3 * of.mass, com=s * of.com, tensor=s**5 * of.tensor))


def _beam(beam: Beam, s: float) -> Beam:
    return replace(
        beam,
        length=s * beam.length,
        section=_section(beam.section, s),
        curvature=beam.curvature / s,
        placement=_place(beam.placement, s),
    )


def _section(of: Section, s: float) -> Section:
    return replace(
        of,
        stiffness=of.stiffness * s**STIFFNESS,
        mass_per_length=s**2 * of.mass_per_length,
        rotary_inertia=s**4 * of.rotary_inertia,
        damping=None if of.damping is None else of.damping * s ** (STIFFNESS + 1),
    )


def _joint(joint: Joint, s: float) -> Joint:
    turns = 0 if joint.kind == "prismatic" else 2
    return replace(
        joint,
        placement=_place(joint.placement, s),
        rotor_inertia=s ** (3 + turns) * joint.rotor_inertia,
        damping=s ** (2 + turns) * joint.damping,
        friction=s ** (3 if turns else 2) * joint.friction,
        stiffness=s ** (3 if turns else 1) * joint.stiffness,
        rest=joint.rest if turns else s * joint.rest,
    )


def _closure(m: Mechanism, one: Closure, s: float) -> Closure:
    """Of a coupling the equation stays in radians: what slides has a factor in 1/m."""
    slides = {joint.name for joint in m.joints if joint.kind == "prismatic"}
    factors = tuple((name, factor / s if name in slides else factor) for name, factor in one.factors)
    times = tuple((s * first, s * last) for first, last in one.active)
    return replace(one, first=_attached(one.first, s), second=_attached(one.second, s), factors=factors, active=times)


def _spring(one: Spring, s: float) -> Spring:
    return replace(
        one,
        first=_attached(one.first, s),
        second=_attached(one.second, s),
        stiffness=s * one.stiffness,
        rest=s * one.rest,
        damping=s**2 * one.damping,
    )


def _force(one: Force, s: float) -> Force:
    return replace(one, at=_attached(one.at, s), wrench=one.wrench * s**WRENCH, time=s * one.time)
