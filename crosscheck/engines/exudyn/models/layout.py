"""Layout of Exudyn's bodies: links that are fixed to each other become one group, beams hang on groups.

Every moving joint carries a group (its child and all that is fixed to it); so does every station of a beam to which
something is fixed or jointed.  A beam's root is fixed to a group.  All poses are taken where the motion starts.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from crosscheck.engines.exudyn.models.frames import (
    Array,
    compose,
    compute_joint_pose,
    compute_joint_twist,
    compute_section_pose,
    evaluate_damping,
    evaluate_section,
    join_inertias,
    take_joint_q,
)
from flexinv.model.mechanism import WORLD, Attachment, Beam, Inertia, Joint, Mechanism, Placement
from flexinv.model.part import MeshedPart

# Fractions of a length that are closer are one cross-section: between them rounding would make an element of no length.
SAME_STATION = 1e-9


@dataclass(frozen=True)
class Frame:
    """A frame that a group carries: ``placement`` in the frame of group ``group``."""

    group: int
    placement: Placement


@dataclass(frozen=True)
class Group:
    """Links that move as one rigid body; group 0 is the world.

    joint : the moving joint that carries it; station : or the beam link and the fraction of its length
    interface : or the meshed link and the name of its interface
    inertia : of all its bodies, in the group's frame; start : pose in the world at the first sample
    velocity, spin : of its origin [m/s] and its frame [rad/s], world, at the first sample, beams undeformed
    """

    joint: str | None
    station: tuple[str, float] | None
    inertia: Inertia
    start: Placement
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    spin: Array = field(default_factory=lambda: np.zeros(3))
    interface: tuple[str, str] | None = None


@dataclass(frozen=True)
class Layout:
    """Groups, and which frame carries what.

    link : frame of every link; root : frame of the root section of every beam; joint : frame of every moving joint
    on its parent; stations : by beam link, the fractions [-] at which there must be a node, 0 and 1 included
    section : frame of the cross-section at a beam link's fraction [-], where something is fixed or jointed to it
    interface : frame of every interface of every meshed link, by both names
    """

    groups: tuple[Group, ...]
    link: dict[str, Frame]
    root: dict[str, Frame]
    joint: dict[str, Frame]
    stations: dict[str, tuple[float, ...]]
    section: dict[tuple[str, float], Frame]
    interface: dict[tuple[str, str], Frame] = field(default_factory=dict)

    def compute_start_pose(self, frame: Frame) -> Placement:
        """Return the pose of a frame in the world where the motion starts."""
        return compose(self.groups[frame.group].start, frame.placement)


@dataclass
class LayoutBuilder:
    """A layout in the making, joint by joint from the world on.

    bodies : by group, the inertias that it carries and where; sections : by beam link and fraction [-], the group there
    """

    mechanism: Mechanism
    groups: list[Group] = field(default_factory=lambda: [Group(None, None, Inertia(0.0), Placement())])
    bodies: list[list[tuple[Inertia, Placement]]] = field(default_factory=lambda: [[]])
    link: dict[str, Frame] = field(default_factory=lambda: {WORLD: Frame(0, Placement())})
    root: dict[str, Frame] = field(default_factory=dict)
    joint: dict[str, Frame] = field(default_factory=dict)
    sections: dict[tuple[str, float], int] = field(default_factory=dict)
    interfaces: dict[tuple[str, str], Frame] = field(default_factory=dict)

    def add_joint(self, joint: Joint, q: Array, qd: Array) -> None:
        """Add a joint whose parent is there, with its child and the bodies of it; q, qd : of all coordinates [rad], [m], [s]."""
        seat = self.find_carrier_frame(joint.parent, joint.station)
        if joint.interface:
            seat = self.interfaces[joint.parent, joint.interface]
        seat = Frame(seat.group, compose(seat.placement, joint.placement))
        if joint.nv:
            self.joint[joint.name] = seat
            seat = self._add_group(_make_joint_group(self.groups, seat, self.mechanism, joint, q, qd))
        self.link[joint.child] = seat
        child = self.mechanism.link_of[joint.child]
        if child.beam is not None:
            self.root[joint.child] = Frame(seat.group, compose(seat.placement, child.beam.placement))
        if child.part is not None:
            self.add_interfaces(child.name, child.part, seat)
        for body in child.bodies:
            at = seat if child.beam is None else self.find_carrier_frame(child.name, body.station or 0.0)
            if body.interface:
                at = self.interfaces[child.name, body.interface]
            self.bodies[at.group].append((body.inertia, at.placement))

    def add_interfaces(self, name: str, part: MeshedPart, link: Frame) -> None:
        """Add a group for each interface of a meshed link but its root, which the link frame carries."""
        for one in part.interfaces:
            local = compose(link.placement, Placement(one.origin))
            frame = Frame(link.group, local)
            if one.name != part.root:
                carrier = self.groups[link.group]
                velocity, spin = _compute_frame_velocity(carrier, local)
                start = compose(carrier.start, local)
                frame = self._add_group(
                    Group(None, None, Inertia(0.0), start, velocity, spin, interface=(name, one.name))
                )
            self.interfaces[name, one.name] = frame

    def find_carrier_frame(self, name: str, station: float | None) -> Frame:
        """Return the frame at a joint's seat: the parent link's own, or that of one of its sections; station : [-]."""
        beam = None if name == WORLD else self.mechanism.link_of[name].beam
        if beam is None or station is None:
            return self.link[name]
        if station == 0.0:
            return self.root[name]
        if (name, station) not in self.sections:
            self.sections[name, station] = len(self.groups)
            self._add_group(_make_section_group(self.groups, self.root[name], name, beam, station))
        return Frame(self.sections[name, station], Placement())

    def _add_group(self, group: Group) -> Frame:
        """Add a group that carries nothing yet; return its own frame."""
        self.groups.append(group)
        self.bodies.append([])
        return Frame(len(self.groups) - 1, Placement())

    def build(self) -> Layout:
        """Return the layout, with the sections to which something is attached."""
        held = {
            (at.link, resolve_station(at.station)) for at in list_attachments(self.mechanism) if at.link in self.root
        }
        section = {(name, station): self.find_carrier_frame(name, station) for name, station in sorted(held)}
        groups = [replace(g, inertia=join_inertias(parts)) for g, parts in zip(self.groups, self.bodies, strict=True)]
        stations = {
            beam.name: tuple(sorted({0.0, 1.0, *(s for name, s in self.sections if name == beam.name)}))
            for beam in self.mechanism.beams
        }
        return Layout(tuple(groups), self.link, self.root, self.joint, stations, section, self.interfaces)


def build_layout(mechanism: Mechanism, q: Array, qd: Array) -> Layout:
    """Return the layout of a mechanism that starts at q (nq,) with qd (nv,), beams undeformed."""
    builder = LayoutBuilder(mechanism)
    for joint in mechanism.joints:
        builder.add_joint(joint, q, qd)
    return builder.build()


def list_attachments(mechanism: Mechanism) -> list[Attachment]:
    """Return the attachments of closures, springs and forces to links."""
    ends = [at for closure in mechanism.closures for at in (closure.first, closure.second)]
    ends += [at for spring in mechanism.springs for at in (spring.first, spring.second)]
    return [*ends, *(force.at for force in mechanism.forces)]


def resolve_station(station: float | None) -> float:
    """Return the fraction of a beam's length [-] that an attachment means: without one it is the tip."""
    return 1.0 if station is None else station


def find_attachment_frame(layout: Layout, at: Attachment) -> Frame:
    """Return the frame of an attachment."""
    seat = layout.section.get((at.link, resolve_station(at.station)), layout.link[at.link])
    if at.interface:
        seat = layout.interface[at.link, at.interface]
    return Frame(seat.group, compose(seat.placement, at.placement))


def _make_section_group(groups: list[Group], root: Frame, name: str, beam: Beam, station: float) -> Group:
    local = compose(root.placement, compute_section_pose(beam, station * beam.length))
    carrier = groups[root.group]
    velocity, spin = _compute_frame_velocity(carrier, local)
    return Group(None, (name, station), Inertia(0.0), compose(carrier.start, local), velocity, spin)


def _make_joint_group(
    groups: list[Group], frame: Frame, mechanism: Mechanism, joint: Joint, q: Array, qd: Array
) -> Group:
    joint_q = take_joint_q(mechanism, joint, q[None])
    p, r = compute_joint_pose(joint, joint_q)
    v, w = compute_joint_twist(joint, joint_q[0], qd[mechanism.v_slices[joint.name]])
    local = compose(frame.placement, Placement(p[0], r[0]))
    start = compose(groups[frame.group].start, local)
    velocity, spin = _compute_frame_velocity(groups[frame.group], local)
    return Group(joint.name, None, Inertia(0.0), start, velocity + start.rotation @ v, spin + start.rotation @ w)


def _compute_frame_velocity(carrier: Group, local: Placement) -> tuple[Array, Array]:
    """Return velocity [m/s] and spin [rad/s] of a frame that a moving group carries."""
    arm = carrier.start.rotation @ local.position
    return carrier.velocity + np.cross(carrier.spin, arm), carrier.spin


@dataclass(frozen=True)
class Mesh:
    """Nodes and elements of one beam.

    fraction : (nodes,) [-], increasing; pose : of every node in the root frame; lengths : (elements,) [m]
    sections : per element stiffness (6,) [N, N m^2], mass per length [kg/m], rotary inertia (3,) [kg m], at mid element
    damping : per element (6,) [N s, N m^2 s], at mid element
    """

    fraction: Array
    pose: tuple[Placement, ...]
    lengths: Array
    sections: tuple[tuple[Array, float, Array], ...]
    damping: tuple[Array, ...]

    def find_node(self, station: float) -> int:
        """Return the node that stands at a station [-]."""
        return int(np.argmin(np.abs(self.fraction - station)))


def build_mesh(beam: Beam, stations: tuple[float, ...], elements: int, nodes: int = 2) -> Mesh:
    """Return about ``elements`` elements of ``nodes`` nodes each, so that every station [-] has a node.

    stations : increasing, from 0 to 1; those that are equal up to rounding share a node
    """
    ends = [0.0]
    apart = [s for s in stations if SAME_STATION < s < 1.0 - SAME_STATION]
    apart = [s for before, s in pairwise([0.0, *apart]) if s - before > SAME_STATION]
    for a, b in pairwise([0.0, *apart, 1.0]):
        n = max(1, round(elements * (b - a)))
        ends += list(a + (b - a) * np.arange(1, n + 1) / n)
    cells = list(pairwise(ends))
    fraction = np.array([0.0, *(a + (b - a) * k / (nodes - 1) for a, b in cells for k in range(1, nodes))])
    return Mesh(
        fraction=fraction,
        pose=tuple(compute_section_pose(beam, f * beam.length) for f in fraction),
        lengths=np.array([(b - a) * beam.length for a, b in cells]),
        sections=tuple(evaluate_section(beam, (a + b) / 2) for a, b in cells),
        damping=tuple(evaluate_damping(beam, (a + b) / 2) for a, b in cells),
    )
