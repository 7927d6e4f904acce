"""The mechanism as arrays: nodes in tree order, and beam elements on them.

Every point that carries mass, a joint or a beam cross-section is a *node* with a frame.  A node hangs on an earlier
one, either rigidly (a centre of mass), or through a joint, or as the next cross-section of a beam:
    X_W,node = X_W,parent  .  placement  .  X_joint(q)
A rigid link is a joint node and one node at the centre of mass of each of its bodies; a beam link is a joint node
(the link frame), a root node, its Gauss-Lobatto nodes, and one node per body carried by a section.  A meshed link is a joint
node, a node for each interface, the point masses that move as its mesh does, and one node per body.  Universal joints are two
revolute ones with a massless node between, so that every joint has constant axes in the frame of its own node.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from flexinv.elements.beam_element import Elements
from flexinv.elements.beam_law import split_coupling
from flexinv.elements.quadrature import build_reference
from flexinv.elements.shapes import PartLaw, PartShapes, ShapedNode, build_shapes
from flexinv.errors import InputError
from flexinv.kernels.so3 import exp_so3, log_so3, tangent3
from flexinv.model.joint_kinds import CONFIGURATIONS, KINDS, RIGID, SECTION, SHAPED, VELOCITIES
from flexinv.model.mechanism import WORLD, Attachment, Beam, Joint, Link, Mechanism, Placement, Section, check_expanded
from flexinv.model.owned_cache import make_owner_cache
from flexinv.model.part import MeshedPart
from flexinv.model.section_matrices import split_mass_matrix
from flexinv.parts.point_masses import build_point_masses
from flexinv.parts.reductions import find_reduction
from flexinv.typing import Array, Indices, Mask

# Axis, first coordinate in q and in the velocities, and motion subspace of a node without a joint.
_NO_JOINT = np.zeros(3), -1, -1, np.zeros((0, 3)), np.zeros((0, 3))
KINK = (
    1.0  # change of a section's relative slope over the length of one element [-], from which on an element ends there
)
SAME_STATION = 1e-9  # two stations of one beam closer than this fraction of its length are one cross-section


@dataclass(frozen=True, eq=False)
class MeshPlaces:
    """Nodes of the joints, sections and bodies of a mechanism, by name.

    joint_node : joint name -> node of the child's link frame; tip_node : link name -> node of a beam's end
    section_nodes : beam link name -> node numbers along the beam, root first
    section_stations : beam link name -> their fractions of the length [-]
    body_node : (link name, body name) -> node at the body's centre of mass
    interface_node : (link name, interface name) -> node of the interface's frame
    """

    mechanism: Mechanism
    joint_node: dict[str, int]
    tip_node: dict[str, int]
    section_nodes: dict[str, Indices]
    section_stations: dict[str, Array]
    body_node: dict[tuple[str, str], int]
    interface_node: dict[tuple[str, str], int]

    def find_section_node(self, link: str, station: float) -> int:
        """Return the node of a beam's section nearest to ``station`` [-] (the mesh has one wherever something is attached)."""
        return int(self.section_nodes[link][np.argmin(np.abs(self.section_stations[link] - station))])


@dataclass(frozen=True, eq=False)  # a mesh is itself only: what is known of it can be kept
class Mesh(MeshPlaces):
    """Nodes of a mechanism in tree order (parents first) and its beam elements.

    parent : (nodes,), -1 the world; kind : (nodes,) RIGID, REVOLUTE, ... of `joint_kinds`
    offset, rotation : (nodes, 3) [m], (nodes, 3, 3): placement of the joint (or of the node) in the parent's frame,
        for a SECTION that of the stress-free beam
    axis : (nodes, 3); q_index, v_index : (nodes,) first coordinate in q and in the velocities, -1 without
    freedoms : (nodes,) velocity coordinates of the node's joint; slide, turn : (nodes, 6, 3) its motion subspace, in its own
        frame: translation and rotation of the node for a unit of each of them [-], zero beyond (`joint_kinds`)
    mass : (nodes,) [kg]; inertia : (nodes, 3, 3) [kg m^2] about the node, in its frame
    link : (nodes,) index into mechanism.links
    shapes : of meshed links, whose amplitudes move their nodes
    """

    parent: Indices
    kind: Indices
    offset: Array
    rotation: Array
    axis: Array
    q_index: Indices
    v_index: Indices
    freedoms: Indices
    slide: Array
    turn: Array
    mass: Array
    inertia: Array
    link: Indices
    elements: Elements
    shapes: PartShapes

    @property
    def size(self) -> int:
        """Number of nodes [-]."""
        return len(self.parent)

    @property
    def length(self) -> float:
        """Return the length that positions are scaled by [m]: the sum of all offsets, or a metre where there are none.

        Point masses of meshed links have places that are none of the mechanism's.
        """
        placed = (self.kind != SHAPED) | (self.mass == 0.0)
        return float(np.abs(self.offset[placed]).sum()) or 1.0

    def build_drive_table(self) -> Array:
        """Return the law of each node's joint as `mechanism.Mechanism.drive_table` [kg m^2], [N m], (5, nodes), else zeros."""
        out = np.zeros((5, self.size))
        moves = self.v_index >= 0
        out[:, moves] = self.mechanism.drive_table[:, self.v_index[moves]]
        return out


_AT_ITS_PARENT = Placement()  # of the second axis of a joint on its first


def list_tips(mesh: Mesh) -> list[tuple[str, int, Array]]:
    """Return of each joint's child link its name, the node that its tip is on, and the tip in that node's frame (3,) [m]."""
    m = mesh.mechanism
    links = [(m.link_of[joint.child], mesh.joint_node[joint.name]) for joint in m.joints]
    return [
        (link.name, mesh.tip_node.get(link.name, node), np.zeros(3) if link.beam else link.tip) for link, node in links
    ]


@dataclass(frozen=True, eq=False)
class _Builder(MeshPlaces):
    """Grows the node and element lists; becomes a Mesh at the end."""

    rows: list[list[Any]] = field(default_factory=list)  # parent, kind, placement, link, and as `_NO_JOINT`
    mass: list[float] = field(default_factory=list)
    inertia: list[Array] = field(default_factory=list)
    elements: list[list[Array]] = field(default_factory=list)  # of each the arrays of `Elements`
    shaped: list[ShapedNode] = field(default_factory=list)
    masses: list[ShapedNode] = field(default_factory=list)
    parts: list[PartLaw] = field(default_factory=list)
    part: dict[int, int] = field(default_factory=dict)  # node -> its part

    def add_node(self, parent: int, kind: int, placement: Placement, link: int) -> int:
        self.rows.append([parent, kind, placement, link, *_NO_JOINT])
        self.mass.append(0.0)
        self.inertia.append(np.zeros((3, 3)))
        return len(self.rows) - 1

    def add_joint(self, joint: Joint, link: int) -> None:
        node = find_attachment_node(self, Attachment(joint.parent, station=joint.station, interface=joint.interface))
        placement = joint.placement
        q, v = (slices[joint.name].start for slices in (self.mechanism.q_slices, self.mechanism.v_slices))
        number = KINDS[joint.kind].number
        owner = self.mechanism.links[link]
        for axis in joint.axes:
            node = self.add_node(node, number, placement, link)
            self.rows[node][4:] = axis, *((q, v) if joint.nv else (-1, -1)), *joint.compute_motion_subspace(axis)
            placement = _AT_ITS_PARENT
            q = q + CONFIGURATIONS[number]
            v = v + VELOCITIES[number]
        self.joint_node[joint.name] = node
        if owner.beam is not None:
            self.add_beam(owner, owner.beam, link, node)
        if owner.part is not None:
            self.add_part(owner.name, owner.part, link, node)
        for body in owner.bodies:
            at = (
                node if body.station is None or owner.beam is None else self.find_section_node(owner.name, body.station)
            )
            if body.interface:
                at = self.interface_node[(owner.name, body.interface)]
            if body.inertia.com.any():
                at = self.add_node(at, RIGID, Placement(body.inertia.com), link)
            self.body_node[(owner.name, body.name)] = at
            self.mass[at] += body.inertia.mass
            self.inertia[at] = self.inertia[at] + body.inertia.tensor

    def add_part(self, name: str, part: MeshedPart, link: int, root: int) -> None:
        """Append the nodes of a meshed link: frames of its interfaces, and the point masses that have its inertia."""
        reduced = find_reduction(part)
        number = len(self.parts)
        damping = part.drag * reduced.modal_mass + part.retardation * reduced.modal_stiffness
        points = build_point_masses(reduced)
        self.parts.append(PartLaw(root, link, reduced.soft, points.mass, reduced.modal_stiffness, damping))
        clamped = part.interface_of[part.root]
        self.interface_node[(name, part.root)] = self.add_node(root, RIGID, Placement(clamped.origin), link)
        frames = zip(reduced.moves, reduced.turns, reduced.second_moves, reduced.second_turns, strict=True)
        for one, derivatives in zip(part.moved, frames, strict=True):
            node = self.add_shaped_node(root, link, number, one.origin)
            self.shaped.append(ShapedNode(node, one.origin, *derivatives))
            self.interface_node[(name, one.name)] = node
        for place, slide, bend in zip(points.place, points.shapes, points.second, strict=True):
            node = self.add_shaped_node(root, link, number, place)
            self.masses.append(ShapedNode(node, place, slide, np.zeros_like(slide), bend, np.zeros_like(bend)))
            self.mass[node] = points.mass
        self.tip_node[name] = self.interface_node[(name, part.tip)]

    def build_part_shapes(self) -> PartShapes:
        part = np.full(len(self.rows), -1)
        part[list(self.part)] = list(self.part.values())
        return build_shapes(part, self.shaped, self.masses, self.parts)

    def add_shaped_node(self, root: int, link: int, part: int, place: Array) -> int:
        node = self.add_node(root, SHAPED, Placement(place), link)
        self.part[node] = part
        return node

    def add_beam(self, link: Link, beam: Beam, index: int, node: int) -> None:
        hung = [j.station for j in self.mechanism.joints if j.parent == link.name] + [b.station for b in link.bodies]
        hung += [end.station for end in self.mechanism.attachments if end.link == link.name]
        wanted = [station for station in hung if station is not None]
        nodes = [self.add_node(node, RIGID, beam.placement, index)]
        stations = [0.0]
        coupled_mass: dict[int, Array] = defaultdict(lambda: np.zeros((6, 6)))
        for start, end in pairwise(_list_element_bounds(beam, wanted)):
            self.add_element(beam, index, start, end, nodes, stations, coupled_mass)
        for section, mass in coupled_mass.items():
            self.add_coupled_mass(section, mass, index)
        self.tip_node[link.name] = nodes[-1]
        self.section_nodes[link.name] = np.array(nodes)
        self.section_stations[link.name] = np.array(stations)

    def add_element(
        self, beam: Beam, link: int, start: float, end: float, nodes: list[int], stations: list[float],
        coupled_mass: dict[int, Array],
    ) -> None:  # fmt: skip
        """Append one element between two fractions of the length: its nodes, lumped mass, stiffness, shape.

        Mass with a centre off the axis, or with products of inertia, goes to ``coupled_mass`` of the nodes (6, 6).
        """
        ref = build_reference(beam.order)
        half = 0.5 * (end - start)
        element_nodes = [nodes[-1]]
        jacobian = half * beam.length  # ds/dxi
        at_nodes = start + half * (1 + ref.nodes)
        at_points = start + half * (1 + ref.points)
        for previous, here in pairwise(at_nodes):
            element_nodes.append(
                self.add_node(
                    element_nodes[-1], SECTION, compute_section_frame(beam, (here - previous) * beam.length), link
                )
            )
        nodes += element_nodes[1:]
        stations += list(at_nodes[1:])
        self.add_lumped_mass(beam, (start, end), element_nodes, at_nodes, coupled_mass)
        gamma0, kappa0 = _compute_initial_strains(beam, at_nodes, ref.shape, ref.slope / jacobian)
        laws = _evaluate_laws(beam, (start, end), at_points)
        self.elements.append([
            np.array(beam.order), np.array(element_nodes, dtype=float), *laws, gamma0, kappa0,
            ref.point_weights * jacobian, ref.shape, ref.slope / jacobian, at_points, np.array(link),
        ])  # fmt: skip

    def add_lumped_mass(
        self,
        beam: Beam,
        bounds: tuple[float, float],
        element_nodes: list[int],
        at: Array,
        coupled_mass: dict[int, Array],
    ) -> None:
        """Add the mass of an element to its nodes, which stand at fractions ``at``, each that of its part of the length."""
        section = beam.section
        half = 0.5 * (bounds[1] - bounds[0]) * beam.length
        weights = build_reference(beam.order).weights * half
        if section.has_coupled_mass:
            (masses,) = _evaluate_sections(beam, bounds, at, section.mass_matrices)
            for node, w, matrix in zip(element_nodes, weights, masses, strict=True):
                coupled_mass[node] = coupled_mass[node] + w * matrix
            return
        rho_a, rho_i = _evaluate_sections(beam, bounds, at, section.mass_per_length, section.rotary_inertia)
        for node, w, mass, rotary in zip(element_nodes, weights, rho_a, rho_i, strict=True):
            self.mass[node] += float(w * mass)
            self.inertia[node] = self.inertia[node] + w * np.diag(rotary)

    def add_coupled_mass(self, section: int, matrix: Array, link: int) -> None:
        """Add a mass (6, 6) about a section's node: as a node of its own where its centre is off the axis."""
        if not matrix.any():
            return
        mass, centre, inertia = split_mass_matrix(matrix, "mass of a beam's node")
        at = section
        if centre.any():
            at = self.add_node(section, RIGID, Placement(np.array([0.0, *centre])), link)
        self.mass[at] += mass
        self.inertia[at] = self.inertia[at] + inertia


def _evaluate_laws(beam: Beam, bounds: tuple[float, float], at: Array) -> tuple[Array, Array, Array, Array]:
    """Stiffness and damping of `Elements` at fractions ``at``, and what couples strains beside both."""
    section = beam.section
    of_rate = np.zeros_like(section.stiffness) if section.damping is None else section.damping
    stiffness, damping = _evaluate_sections(beam, bounds, at, section.stiffness, of_rate)
    direct, coupling = split_coupling(stiffness)
    direct_rate, coupling_rate = split_coupling(damping)
    return direct, direct_rate, coupling, coupling_rate


def _list_element_bounds(beam: Beam, wanted: list[float]) -> list[float]:
    """Element ends as fractions of the length: equal parts, cut again where the section steps or bends abruptly.

    And where something is attached between nodes.

    One cut at a time: it moves the nodes of the element that it cuts, so that another station may need one too.
    """
    fractions = 0.5 * (1 + build_reference(beam.order).nodes)
    bounds = np.linspace(0.0, 1.0, beam.elements + 1)
    for place in list_section_breaks(beam):
        if np.min(np.abs(bounds - place)) > SAME_STATION:
            bounds = np.sort(np.append(bounds, place))
    while True:
        nodes = np.concatenate([a + (b - a) * fractions for a, b in pairwise(bounds)])
        between = [s for s in wanted if np.min(np.abs(nodes - s)) > SAME_STATION]
        if not between:
            return [float(bound) for bound in bounds]
        bounds = np.sort(np.append(bounds, between[0]))


def list_section_breaks(beam: Beam) -> list[float]:
    """Return the fractions of a beam's length at which its section steps or bends abruptly [-]: elements end there.

    An element of any order converges by the first power of its length across a kink, so that neither a higher order nor the
    difference of two meshes says much.  Kinks are told by the change of the relative slope of any number of the section over one
    element's length (`KINK`); stations that stand for a smooth taper have small ones.
    """
    section = beam.section
    at = beam.section.stations
    if len(at) < 3:
        return []
    columns, sizes = _list_section_columns(section)
    size = np.maximum(sizes[1:], sizes[:-1])
    width = np.maximum(np.diff(at), SAME_STATION)[:, None]
    slope = np.diff(columns, axis=0) / np.where(size > 0.0, size, 1.0) / width
    kinked = (np.abs(np.diff(slope, axis=0)) > KINK * beam.elements).any(axis=1)
    return [float(place) for place in at[1:-1][kinked]]


def _list_section_columns(section: Section) -> tuple[Array, Array]:
    """Numbers of a section (stations, numbers) and sizes to compare them with, of a coupling those of what it couples."""
    if not section.is_coupled:
        columns = np.column_stack([section.stiffness, section.mass_per_length, section.rotary_inertia])
        return columns, np.abs(columns)
    both = np.stack([section.stiffness_matrices, section.mass_matrices], axis=1)
    root = np.sqrt(np.abs(np.diagonal(both, axis1=2, axis2=3)))
    sizes = root[..., :, None] * root[..., None, :]
    return both.reshape(len(both), -1), sizes.reshape(len(both), -1)


def compute_section_frame(beam: Beam, length: float) -> Placement:
    """Return the section frame [m] after ``length`` [m] of the stress-free beam: R = exp(s kappa), x = H(s kappa)^T s e1."""
    psi = length * beam.curvature
    return Placement(tangent3(psi).T @ np.array([length, 0.0, 0.0]), exp_so3(psi))


def _evaluate_sections(beam: Beam, bounds: tuple[float, float], at: Array, *tables: Array) -> list[Array]:
    """Section tables at fractions ``at`` of one element, linear between the stations, constant beyond them.

    Where two stations are equal the section steps, and each end of an element takes the value on its own side.
    """
    stations = beam.section.stations
    if np.any(np.diff(stations) == 0.0):
        inside = SAME_STATION * (bounds[1] - bounds[0])
        at = np.clip(at, bounds[0] + inside, bounds[1] - inside)
    return [np.apply_along_axis(lambda column: np.interp(at, stations, column), 0, table) for table in tables]


def _compute_initial_strains(beam: Beam, at_nodes: Array, shape: Array, slope: Array) -> tuple[Array, Array]:
    """Strains that the element's own interpolation sees in the undeformed shape: they are subtracted."""
    places = [compute_section_frame(beam, (s - at_nodes[0]) * beam.length) for s in at_nodes]
    x = np.array([p.position for p in places])
    psi = log_so3(np.array([p.rotation for p in places]))
    gamma = np.empty((len(shape), 3))
    kappa = np.empty((len(shape), 3))
    for g, (n, dn) in enumerate(zip(shape, slope, strict=True)):
        gamma[g] = exp_so3(n @ psi).T @ (dn @ x)
        kappa[g] = tangent3(n @ psi) @ (dn @ psi)
    return gamma, kappa


def _assemble_elements(rows: list[list[Array]]) -> Elements:
    if not rows:
        index = np.empty(0, dtype=np.int64)
        flat = np.empty((0, 0))
        vectors = np.empty((0, 0, 3))
        sections = np.empty((0, 0, 6))
        couplings = np.empty((0, 0, 6, 6))
        of_points = sections, sections, couplings, couplings, vectors, vectors, flat, vectors, vectors, flat
        return Elements(index, np.empty((0, 0), np.int64), *of_points, index)
    parts: list[Any] = []
    for n, column in enumerate(zip(*rows, strict=True)):  # arrays of unequal shape, filled up: node numbers by -1
        shape = np.max([a.shape for a in column], axis=0).astype(int)
        part = np.full((len(rows), *shape), -1.0 if n == 1 else 0.0)
        for k, a in enumerate(column):
            where: tuple[int | slice, ...] = (k, *map(slice, a.shape))
            part[where] = a
        parts.append(part)
    for k in (0, 1, -1):
        parts[k] = parts[k].astype(np.int64)
    padded = Elements(*parts)
    if not padded.damping.any():
        padded = padded._replace(damping=padded.damping[:0])
    if padded.coupling.any() or padded.damping_coupling.any():
        return padded
    return padded._replace(coupling=padded.coupling[:0], damping_coupling=padded.damping_coupling[:0])


@make_owner_cache()
def build(mechanism: Mechanism) -> Mesh:
    """Return the mesh of a mechanism: nodes with masses [kg] and inertias [kg m^2], elements with stiffnesses [N].

    Lumped mass at the Gauss-Lobatto nodes: m_i = rho A w_i, J_i = rho I w_i (order 1: half and half, as in the paper).
    Raises InputError for drives that are not part of the mechanism (`mechanism.expanded`), and for a damping ratio that has not
    become a retardation time (`linearized.modal_damping.resolve_damping_ratio`).
    """
    if mechanism.modal_damping is not None and mechanism.modal_damping.seconds is None:
        raise InputError(
            f"mechanism '{mechanism.name}': its damping is stated as a ratio of a mode, and beams know stresses by rates of "
            "strain only; write flexinv.linearized.modal_damping.resolve_damping_ratio(mechanism) for it"
        )
    builder = _Builder(mechanism, {}, {}, {}, {}, {}, {})
    index = {link.name: k for k, link in enumerate(mechanism.links)}
    for joint in mechanism.joints:
        check_expanded(joint)
        builder.add_joint(joint, index[joint.child])
    columns = zip(*builder.rows, strict=True) if builder.rows else 9 * [()]
    parent, kind, placement, link, axis, q, v, moved, turned = columns
    slide, turn = np.zeros((2, len(moved), 6, 3))
    for n, count in enumerate(map(len, moved)):
        slide[n, :count] = moved[n]
        turn[n, :count] = turned[n]
    whole = [
        np.array(column, dtype=np.int64) for column in (parent, kind, q, v, [len(freedoms) for freedoms in moved], link)
    ]
    return Mesh(
        mechanism, builder.joint_node, builder.tip_node, builder.section_nodes, builder.section_stations, builder.body_node,
        builder.interface_node,
        whole[0], whole[1],
        np.array([p.position for p in placement], dtype=float).reshape(-1, 3),
        np.array([p.rotation for p in placement], dtype=float).reshape(-1, 3, 3),
        np.array(axis, dtype=float).reshape(-1, 3), whole[2], whole[3], whole[4], slide, turn,
        np.array(builder.mass), np.array(builder.inertia).reshape(-1, 3, 3), whole[5], _assemble_elements(builder.elements),
        builder.build_part_shapes(),
    )  # fmt: skip


def find_attachment_node(mesh: MeshPlaces, at: Attachment) -> int:
    """Return the node that carries an attachment (its frame is constant there, placement in [m]); -1 is the world."""
    if at.link == WORLD:
        return -1
    if at.interface:
        return mesh.interface_node[(at.link, at.interface)]
    if at.link in mesh.section_nodes:
        return mesh.find_section_node(at.link, 1.0 if at.station is None else at.station)
    return next(mesh.joint_node[j.name] for j in mesh.mechanism.joints if j.child == at.link)


def find_outboard_nodes(mesh: Mesh, node: int) -> Mask:
    """Return a mask (nodes,) [-] of the nodes that a node carries, itself among them."""
    out: Mask = np.arange(mesh.size) == node
    for n in range(node + 1, mesh.size):
        out[n] = mesh.parent[n] >= 0 and out[mesh.parent[n]]
    return out
