"""Mechanisms that move in a plane, with everything that the planar march takes, and each stood upright anywhere in space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from flexible_examples import HALF_TURN, STRIP, arm

import flexinv
from flexinv.kernels.so3 import exp_so3
from flexinv.model.mechanism import Attachment, Beam, Body, Closure, Inertia, Joint, Link, Mechanism, Placement, Section
from flexinv.typing import Array

# Strains of some per cent, so that rounding of strains is rounding of forces too: EA 40 N, GA 15 N, EI about y and z.
SOFT = Section(
    np.array([0.0, 1.0]),
    np.array([[40.0, 15.0, 18.0, 0.1, 0.05, 0.03], [30.0, 10.0, 12.0, 0.1, 0.04, 0.02]]),
    np.array([0.05, 0.04]),
    np.array([[3e-6, 2e-6, 1e-6], [2e-6, 1e-6, 1e-6]]),
)
Y, Z = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def about_z(angle: float, x: float = 0.0, y: float = 0.0) -> Placement:
    return Placement(np.array([x, y, 0.0]), exp_so3(angle * Z))


def body(mass: float, x: float, y: float) -> Body:
    return Body("body", Inertia(mass, np.array([x, y, 0.0]), mass * np.diag([1e-3, 2e-3, 3e-3])))


def two_links(elements: int, order: int) -> Mechanism:
    """A soft beam, a rigid elbow with a placement, a second beam whose axis of rotation points down, a payload off its axis."""
    links = (
        Link("one", (), Beam(0.3, SOFT, elements, order)),
        Link("elbow", (body(0.01, 0.02, 0.01),)),
        Link("two", (replace(body(0.004, 0.01, 0.02), name="payload", station=1.0),), Beam(0.2, SOFT, elements, order)),
    )
    joints = (
        Joint("hub", "revolute", "world", "one", about_z(0.3, 0.1, -0.2)),
        Joint("elbow", "revolute", "one", "elbow", about_z(-0.4, 0.01, 0.02)),
        Joint("two", "revolute", "elbow", "two", about_z(0.2, 0.04, 0.0), axis=-Z),
    )
    return Mechanism("two links", links, joints, gravity=np.array([0.3, -1.0, 0.0]))


def branches(friction: float = 0.0) -> Mechanism:
    """Beams of unequal order on one beam, curved, one bending about its y axis; passive joints between."""
    upright = exp_so3(0.5 * np.pi * np.array([1.0, 0.0, 0.0]))  # the section's y axis becomes the normal
    links = (
        Link("trunk", (), Beam(0.3, SOFT, 2, 3, curvature=np.array([0.0, 0.0, 0.8]))),
        Link("swing", (body(0.02, 0.05, 0.01),)),
        Link(
            "leaf",
            (),
            Beam(0.2, SOFT, 1, 4, curvature=np.array([0.0, 0.5, 0.0]), placement=Placement(np.zeros(3), upright)),
        ),
        Link("slider", (body(0.01, 0.0, 0.01),)),
        Link("twig", (), Beam(0.1, SOFT, 2, 1)),
    )
    joints = (
        Joint("root", "continuous", "world", "trunk", about_z(0.1)),
        Joint(
            "swing", "revolute", "trunk", "swing", about_z(0.2, 0.0, 0.01), station=0.5, actuated=False, rotor_inertia=1e-5,
            damping=1e-4, friction=friction,
        ),
        Joint("leaf", "revolute", "swing", "leaf", about_z(0.1, 0.06, 0.0), axis=-Z),
        Joint(
            "slider", "prismatic", "trunk", "slider", about_z(0.3), axis=np.array([0.6, 0.8, 0.0]), actuated=False, damping=0.02
        ),
        Joint("twig", "prismatic", "slider", "twig", about_z(-0.5), axis=np.array([1.0, 0.0, 0.0])),
    )  # fmt: skip
    return Mechanism("branches", links, joints, gravity=np.array([0.0, -2.0, 0.0]))


def hanging() -> Mechanism:
    """A passive pendulum on the world carries a driven beam: the unknowns of a block on the world."""
    links = (Link("bob", (body(0.1, 0.1, 0.0),)), Link("beam", (), Beam(0.2, SOFT, 1, 3)))
    joints = (
        Joint("pivot", "revolute", "world", "bob", actuated=False, damping=1e-3),
        Joint("drive", "revolute", "bob", "beam", about_z(0.5, 0.1, 0.05)),
    )
    return Mechanism("hanging", links, joints, gravity=np.array([0.0, -9.81, 0.0]))


def four_bar(kind: str = "revolute") -> Mechanism:
    """A soft coupler between a driven crank and a rocker; its closure ties the rocker's end to the coupler's."""
    links = (
        Link("crank", (body(0.05, 0.05, 0.0),)),
        Link("coupler", (body(0.01, 0.0, 0.01),), Beam(0.3, SOFT, 2, 3)),
        Link("rocker", (body(0.05, 0.1, 0.0),)),
    )
    joints = (
        Joint("A", "revolute", "world", "crank", rotor_inertia=1e-4),
        Joint("B", "revolute", "crank", "coupler", about_z(0.0, 0.1), actuated=False, damping=1e-4),
        Joint("D", "continuous", "world", "rocker", about_z(0.0, 0.3), actuated=False, rotor_inertia=1e-5),
    )
    ends = Attachment("coupler", about_z(0.0), 1.0), Attachment("rocker", about_z(0.3 if kind == "fixed" else 0.0, 0.2))
    return Mechanism("four-bar", links, joints, np.array([0.0, -2.0, 0.0]), (Closure("C", kind, *ends),))


def braced(kind: str) -> Mechanism:
    """A driven beam whose end is tied to the world: a rail along it (prismatic), or nothing but a point (spherical)."""
    links = (Link("hub", (body(0.05, 0.05, 0.0),)), Link("beam", (), Beam(0.3, SOFT, 1, 4)))
    joints = (
        Joint("slide", "prismatic", "world", "hub", axis=np.array([1.0, 0.0, 0.0])),
        Joint("turn", "revolute", "hub", "beam", about_z(0.2), actuated=False, damping=1e-3),
    )
    ends = (
        Attachment("beam", about_z(-0.2), 1.0),
        Attachment("world", about_z(0.0, 0.3 * np.cos(0.2), 0.3 * np.sin(0.2))),
    )
    axis = np.array([1.0, 0.0, 0.0])
    return Mechanism("braced", links, joints, np.array([0.0, -2.0, 0.0]), (Closure("rail", kind, *ends, axis=axis),))


def damped(mechanism: Mechanism, size: float = 1.0) -> Mechanism:
    """The same with damping of all beams that is not proportional to stiffness, and varies along them.

    At 100 rad/s, of the order of their lower bending modes, stresses by rates are some per cent of those by strains.
    """
    parts = size * np.array([3e-4, 1e-3, 2e-3, 5e-4, 8e-4, 4e-4])

    def with_damping(link: Link) -> Link:
        if link.beam is None:
            return link
        section = link.beam.section
        varying = np.linspace(1.0, 1.5, len(section.stations))[:, None] * section.stiffness * parts
        return replace(link, beam=replace(link.beam, section=replace(section, damping=varying)))

    return replace(mechanism, links=tuple(with_damping(link) for link in mechanism.links))


def stood(mechanism: Mechanism, psi: Array, shift: Array) -> Mechanism:
    """The same mechanism with the world turned by exp(psi) and shifted along the new normal and in the plane."""
    turn = exp_so3(psi)

    def placed(p: Placement) -> Placement:
        return Placement(shift + turn @ p.position, turn @ p.rotation)

    joints = tuple(replace(j, placement=placed(j.placement)) if j.parent == "world" else j for j in mechanism.joints)
    closures = tuple(
        replace(c, second=replace(c.second, placement=placed(c.second.placement))) if c.second.link == "world" else c
        for c in mechanism.closures
    )
    return replace(mechanism, joints=joints, gravity=turn @ mechanism.gravity, closures=closures)


def quick(*angles: float, law: str = "cycloid") -> flexinv.Motion:
    return flexinv.Motion.point_to_point(np.zeros(len(angles)), list(angles), 0.15, hold=0.05, law=law)


def named(law: str = "cycloid", **angles: float) -> flexinv.Motion:
    return flexinv.Motion.point_to_point(dict.fromkeys(angles, 0.0), dict(angles), 0.2, law=law)


def with_couplings(mechanism: Mechanism) -> Mechanism:
    """The same with sections that couple strains in the plane, whichever axis is normal to it, and mass off the axis in it.

    Axial strain, the shear and the bending in the plane; beside them what lies out of it: twist with the other shear.
    """

    def coupled(link: Link) -> Link:
        if link.beam is None:
            return link
        upright = abs(link.beam.placement.rotation[2, 2]) > 0.5  # z of the section is normal to the plane
        within, outside, side = ((0, 1, 5), (2, 3, 4), (1.0, 0.0)) if upright else ((0, 2, 4), (1, 3, 5), (0.0, 1.0))
        own = link.beam.section
        stiffness = own.stiffness_matrices.copy()
        root = np.sqrt(own.stiffness)
        for group in (within, outside):
            for (i, j), part in zip(((0, 1), (0, 2), (1, 2)), (0.2, -0.35, 0.15), strict=True):
                a = group[i]
                b = group[j]
                stiffness[:, a, b] = stiffness[:, b, a] = part * root[:, a] * root[:, b]
        centre = np.outer(np.linspace(1.0, 0.5, len(root)), side) * 0.01
        made = replace(own, stiffness=stiffness, mass_centre=centre)
        return replace(link, beam=replace(link.beam, section=made))

    return replace(mechanism, links=tuple(coupled(link) for link in mechanism.links))


def retarded_matrices(mechanism: Mechanism, seconds: float) -> Mechanism:
    """The same with damping matrices, of which those within the plane and out of it are not proportional to stiffness."""

    def damped_link(link: Link) -> Link:
        if link.beam is None:
            return link
        own = link.beam.section
        sizes = np.sqrt([1.0, 2.0, 1.5, 1.0, 0.7, 0.5])
        damping = seconds * sizes[:, None] * own.stiffness_matrices * sizes
        return replace(link, beam=replace(link.beam, section=replace(own, damping=damping)))

    return replace(mechanism, links=tuple(damped_link(link) for link in mechanism.links))


Case = Callable[[], tuple[Mechanism, flexinv.Motion, dict[str, Any]]]
TILT, SHIFT = np.array([0.7, -0.4, 1.9]), np.array([0.3, -0.1, 0.2])
SOFT_CASES: dict[str, Case] = {
    "order 1": lambda: (two_links(3, 1), quick(1.0, -0.5, 0.8), {}),
    "order 4": lambda: (two_links(1, 4), quick(1.0, -0.5, 0.8), {}),
    "two of order 3": lambda: (two_links(2, 3), quick(1.0, -0.5, 0.8), {"initial": "static"}),
    "bang-bang": lambda: (two_links(1, 3), quick(0.5, -0.2, 0.3, law="bang-bang"), {}),
    "branches": lambda: (branches(), named(root=0.8, leaf=0.5, twig=0.02), {"start": {"swing": 0.2}}),
    "branches, jumps": lambda: (branches(), named("bang-bang", root=0.4, leaf=0.5, twig=0.02), {}),
    "hanging": lambda: (hanging(), named(drive=1.0), {"start": {"pivot": -0.4}, "start_rate": {"pivot": 2.0}}),
    "coupled": lambda: (with_couplings(two_links(1, 4)), quick(1.0, -0.5, 0.8), {"initial": "static"}),
    "coupled branches": lambda: (
        with_couplings(branches()),
        named(root=0.8, leaf=0.5, twig=0.02),
        {"start": {"swing": 0.2}},
    ),
    "coupled, damped": lambda: (
        retarded_matrices(with_couplings(two_links(2, 3)), 1e-4),
        quick(1.0, -0.5, 0.8),
        {},
    ),
    "tilted": lambda: (stood(two_links(1, 4), TILT, SHIFT), quick(1.0, -0.5, 0.8), {}),
    "damped": lambda: (damped(two_links(1, 4)), quick(1.0, -0.5, 0.8), {"initial": "static"}),
    "damped, jumps": lambda: (damped(two_links(2, 1)), quick(0.5, -0.2, 0.3, law="bang-bang"), {}),
    "damped branches": lambda: (damped(branches()), named(root=0.8, leaf=0.5, twig=0.02), {"start": {"swing": 0.2}}),
    "tilted branches": lambda: (stood(branches(), TILT, SHIFT), named(root=0.8, leaf=0.5, twig=0.02), {}),
}
RAIL = {"start": {"turn": 0.0}}
CLOSED_CASES: dict[str, Case] = {
    "four-bar": lambda: (four_bar(), named(A=2.0), {"start": {"B": 0.72, "D": 1.44}}),
    "four-bar, static": lambda: (four_bar(), named(A=2.0), {"start": {"B": 0.72, "D": 1.44}, "initial": "static"}),
    "four-bar, jumps": lambda: (four_bar(), named("bang-bang", A=0.5), {"start": {"B": 0.72, "D": 1.44}}),
    "four-bar, redundant": lambda: (four_bar("spherical"), named(A=2.0), {"start": {"B": 0.72, "D": 1.44}}),
    "tilted four-bar": lambda: (stood(four_bar(), TILT, SHIFT), named(A=2.0), {"start": {"B": 0.72, "D": 1.44}}),
    "point": lambda: (braced("spherical"), named(slide=0.01), RAIL),
    "tilted rail": lambda: (stood(braced("prismatic"), TILT, SHIFT), named(slide=0.01), RAIL),
}
PAPER_CASES: dict[str, Case] = {
    "one link, 4 x order 1": lambda: (arm(4, 1), HALF_TURN, {}),
    "one link, 1 x order 4": lambda: (arm(1, 4), HALF_TURN, {}),
    "one link with gravity": lambda: (arm(2, 2, gravity=(0.0, -9.81, 0.0)), HALF_TURN, {"initial": "static"}),
    "two links": lambda: (paper_two_links(), quick(0.5, 1.0), {}),
    "one link, damped": lambda: (damped(arm(1, 4), 0.2), HALF_TURN, {}),
}


def paper_two_links() -> Mechanism:
    """The paper's example 4."""
    thin = replace(STRIP, stiffness=np.array([[1.452e6, 4.65e5, 4.65e5, 0.07, 137.0, 0.046]]))
    links = (Link("link1", (), Beam(0.2, STRIP, 1, 4)), Link("link2", (), Beam(0.2, thin, 1, 4)))
    joints = (Joint("joint1", "revolute", "world", "link1"), Joint("joint2", "revolute", "link1", "link2"))
    return Mechanism("two links", links, joints, gravity=np.zeros(3))
