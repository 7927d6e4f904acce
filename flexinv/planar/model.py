"""Planar model of a mechanism, made from the mesh: all that stays constant during the time integration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexinv.constraints.closures import Rows, build_constraint_rows
from flexinv.dynamics.constraint_rows import DIRECTION, POSITION, Ties, build_layout, build_ties
from flexinv.dynamics.dofs import Topology, build_topology, compute_offsets
from flexinv.elements.planar_beam import POINTS_AT_ONCE, PlanarElements
from flexinv.kernels.memory import copy_aligned
from flexinv.kernels.so3 import log_so3
from flexinv.kinematics.mesh import Mesh
from flexinv.model.joint_kinds import CONTINUOUS
from flexinv.model.owned_cache import make_owner_cache
from flexinv.planar.detection import Plane, convert_to_plane, find_planar_rows, find_plane
from flexinv.planar.index1 import BlockMasses
from flexinv.planar.stepper import Embedding
from flexinv.planar.tree import PlanarTree
from flexinv.typing import Array, Indices, Mask

TURN_BY_90 = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # J, a quarter turn about the normal


@dataclass(frozen=True)
class JointNodes:
    """Nodes with a joint, and where their coordinates stand in q and in qd; whether q is (cos, sin); which are prescribed."""

    node: Indices
    q: Indices
    v: Indices
    turns_on: Mask
    prescribed: Mask

    def collect_coordinates(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return q, q', q'' of the joints, (samples, joints, 3) [m, rad, s], from q (samples, nq), qd, qdd (samples, nv)."""
        out = np.empty((len(q), len(self.node), 3))
        joints = zip(self.q.tolist(), self.v.tolist(), self.turns_on.tolist(), strict=True)
        for k, (place, rate, turns) in enumerate(joints):
            out[:, k, 0] = np.arctan2(q[:, place + 1], q[:, place]) if turns else q[:, place]
            out[:, k, 1] = qd[:, rate]
            out[:, k, 2] = qdd[:, rate]
        return out


@dataclass(frozen=True)
class PlanarModel:
    """Constants of the time integration in a plane, made once for a mesh and its passive joints.

    pick : (planar unknowns, spatial unknowns) components along the plane's axes, turns about its normal
    place : indices of the elements' own unknowns for `planar.solver`
    ties, masses : of which each time integration has a copy; joints : the nodes with a joint
    """

    plane: Plane
    topology: Topology
    tree: PlanarTree
    elements: PlanarElements
    space: Embedding
    pick: Array
    place: tuple[Indices, Indices, Indices]
    ties: Ties
    masses: BlockMasses
    joints: JointNodes


@make_owner_cache()
def build_planar_model(mesh: Mesh, passive: frozenset[str]) -> PlanarModel:
    """Return the arrays of a mesh that lies in a plane [m], [rad], with the joints named in ``passive`` free."""
    plane = find_plane(mesh)
    t = build_topology(mesh, passive)
    assert isinstance(plane, Plane)  # else nobody asks
    rows = build_constraint_rows(mesh)
    row = np.flatnonzero(find_planar_rows(plane, rows)).astype(np.int64)
    tree = _build_tree(mesh, t, plane)
    space = _build_embedding(mesh, plane, row)
    elements = _build_elements(mesh, plane, space)
    pick = _build_pick_matrix(mesh, t, tree, plane, space)
    tied = _build_ties(rows, row, plane, tree)
    node = np.flatnonzero(mesh.v_index >= 0)
    turns_on = mesh.kind[node] == CONTINUOUS
    given = tree.prescribed_column[node] >= 0
    joints = JointNodes(node, mesh.q_index[node], mesh.v_index[node], turns_on, given)
    return PlanarModel(
        plane, t, tree, elements, space, pick, _list_places(tree, elements), tied, _build_masses(tree), joints
    )


def _build_pick_matrix(mesh: Mesh, topology: Topology, tree: PlanarTree, plane: Plane, space: Embedding) -> Array:
    pick = np.zeros((len(tree.scale), len(topology.scale)))
    for n in range(mesh.size):
        here = int(tree.first[n])
        there = int(topology.first[n])
        if tree.independent[n]:
            pick[here : here + 2, there : there + 3] = plane.axes.T[:2]
            pick[here + 2, there + 3 : there + 6] = space.axle[n]
        elif tree.column[n] >= 0:
            pick[here + tree.column[n], there + topology.column[n]] = 1.0
    return pick


def _build_tree(mesh: Mesh, topology: Topology, plane: Plane) -> PlanarTree:
    frames = plane.frames
    passive = topology.freedoms > 0
    hangs = np.arange(len(topology.size)) < len(topology.span) - 1  # on the world, with passive freedoms only
    size = np.where(hangs, topology.size, topology.size - 3)  # three freedoms of a node instead of six
    sliding = np.any(mesh.slide, axis=(1, 2))
    offset_p = convert_to_plane(plane, mesh.parent, mesh.offset)  # (node, xyz)
    turn, slide = _find_axes(mesh, plane, sliding)
    offset, span = compute_offsets(size, topology.part)
    column = np.where(passive, topology.column - 3 * ~hangs[topology.block], -1)
    first = offset[topology.block]
    lengths = (first[topology.independent, None] + np.arange(2), (first + column)[passive & sliding])
    first_element, element = _list_elements(mesh, topology, len(span))
    driven = (mesh.v_index >= 0) & ~passive
    return PlanarTree(
        parent=mesh.parent, block=topology.block, independent=topology.independent, size=size, offset=offset,
        width=size[topology.block], first=first, part=topology.part, span=span, first_element=first_element, element=element,
        scale=_build_scales(int(size.sum()), lengths, mesh.length),
        prescribed_column=np.where(driven, np.cumsum(driven) - 1, -1), column=column,
        turn=turn, slide=slide,
        offset_p=np.ascontiguousarray(offset_p[:, :2]), shifted=sliding | offset_p[:, :2].any(axis=1),
        mass=mesh.mass, inertia=np.einsum("ni,nij,nj->n", frames[:, 2], mesh.inertia, frames[:, 2]),
        gravity=plane.axes.T[:2] @ mesh.mechanism.gravity, drives=topology.drives,
    )  # fmt: skip


def _find_axes(mesh: Mesh, plane: Plane, sliding: Mask) -> tuple[Array, Array]:
    """Turns of joints (nodes,), 1 or -1 about the plane's normal, and directions in which they slide (nodes, 2)."""
    axis = convert_to_plane(plane, np.arange(mesh.size), mesh.axis)
    turning = np.any(mesh.turn, axis=(1, 2))
    return np.where(turning, np.sign(axis[:, 2]), 0.0), np.where(sliding[:, None], axis[:, :2], 0.0)


def _list_elements(mesh: Mesh, topology: Topology, ends: int) -> tuple[Indices, Indices]:
    """Elements in the order of the parts of the mechanism that they are in, and the first of each part."""
    part = topology.part[topology.block[mesh.elements.nodes[:, :1].ravel()]]
    return np.searchsorted(np.sort(part), np.arange(ends)), np.argsort(part, kind="stable")


def _build_scales(unknowns: int, lengths: tuple[Indices, ...], length: float) -> Array:
    """The size of each unknown: 1 of an angle, the mechanism's length of those that are ``lengths``."""
    scale = np.ones(unknowns)
    for rows in lengths:
        scale[rows] = length
    return scale


def _build_elements(mesh: Mesh, plane: Plane, space: Embedding) -> PlanarElements:
    e = mesh.elements
    side = space.side
    root = e.nodes[:, :1].ravel()
    frames = plane.frames[root]
    axle = space.axle[root]
    turned = frames[:, None].transpose(0, 1, 3, 2) @ plane.frames[e.nodes]  # (element, node, 3, 3), R_0^T R_i
    bend = np.einsum("kni,ki->kn", log_so3(turned), axle) * (np.arange(e.nodes.shape[1]) <= e.order[:, None])
    stiffness, damping = (
        [
            a[..., 0],
            *(
                _compute_components(a[..., block], axes[: len(a)] ** 2)
                for block, axes in ((np.s_[:3], side), (np.s_[3:], axle))
            ),
        ]
        for a in (e.stiffness, e.damping)
    )
    constants = (
        *stiffness,
        e.weight,
        e.gamma0[..., 0],
        _compute_components(e.gamma0, side),
        _compute_components(e.kappa0, axle),
    )
    return PlanarElements(
        e.order, e.nodes, e.shape, e.slope, bend, np.arctan2(frames[:, 1, 0], frames[:, 0, 0]), np.uint64(POINTS_AT_ONCE),
        _convert_to_blocks(constants), _convert_to_blocks(damping),
        _convert_to_blocks([*_list_couplings(e.coupling, side, axle), *_list_couplings(e.damping_coupling, side, axle)]),
    )  # fmt: skip


def _list_couplings(coupling: Array, side: Array, axle: Array) -> list[Array]:
    """Axial with shear, axial with bending, shear with bending (elements, points) of couplings (elements, points, 6, 6)."""
    stations = slice(0, len(coupling))
    shear = np.einsum("kgij,kj->kgi", coupling[..., :, :3], side[stations])  # resultants by shear in the plane
    bending = np.einsum("kgij,kj->kgi", coupling[..., :, 3:], axle[stations])
    return [shear[..., 0], bending[..., 0], _compute_components(bending[..., :3], side[stations])]


def _compute_components(vectors: Array, axes: Array) -> Array:
    """Components of vectors (elements, points, 3) along an axis of each element."""
    return np.asarray(np.einsum("kgi,ki->kg", vectors, axes))


def _convert_to_blocks(rows: Sequence[Array]) -> Array:
    """Quantities (elements, points) of all points as the rows of blocks, in the order that `planar_beam` gives them."""
    flat = np.stack(rows).reshape(len(rows), -1)
    flat = np.pad(flat, ((0, 0), (0, -flat.shape[1] % POINTS_AT_ONCE)))
    blocks = flat.reshape(len(rows), flat.shape[1] // POINTS_AT_ONCE, POINTS_AT_ONCE)
    return copy_aligned(blocks.swapaxes(0, 1).reshape(-1))


def _build_embedding(mesh: Mesh, plane: Plane, row: Indices) -> Embedding:
    axes = plane.axes
    frames = plane.frames
    upright = np.diag([0.0, 0.0, 1.0])
    roots = frames[mesh.elements.nodes[:, :1].ravel()]
    parts = np.eye(3) - upright, TURN_BY_90, upright
    across, along, normal = (np.ascontiguousarray(axes @ part @ frames) for part in parts)
    side = np.einsum("kji,kj->ki", roots, roots[:, :, 0] @ TURN_BY_90.T)
    return Embedding(axes, plane.height, across, along, normal, np.ascontiguousarray(frames[:, 2]), side, row)


def _list_places(tree: PlanarTree, element_arrays: PlanarElements) -> tuple[Indices, Indices, Indices]:
    """Rows, row and own of `PlanarFactors`: where the own unknowns of every element stand."""
    elements, count = element_arrays.nodes.shape
    widest = max(int(tree.size.max(initial=0)), 1)
    row = np.zeros((elements, count, widest), dtype=np.int64)
    numbers = []
    for k in range(elements):
        order = int(element_arrays.order[k])
        extra = 3 * int(element_arrays.order[k])
        offsets = {}
        for i, n in enumerate(element_arrays.nodes[k, 1 : order + 1]):
            block = tree.block[n]
            for j in range(tree.size[block]):
                row[k, i + 1, j] = j * order + i if j < 3 else extra
                extra += j >= 3
                offsets[int(row[k, i + 1, j])] = int(tree.offset[block] + j)
        numbers.append([offsets[r] for r in range(extra)])
    most = max((len(offsets) for offsets in numbers), default=0)
    table = np.array([offsets + [0] * (most - len(offsets)) for offsets in numbers], dtype=np.int64).reshape(
        elements, most
    )
    return np.array([len(offsets) for offsets in numbers], dtype=np.int64), row, table


def _build_ties(rows: Rows, row: Indices, plane: Plane, tree: PlanarTree) -> Ties:
    a = rows.a[row]
    b = rows.b[row]
    pairs = (a, rows.place_a), (b, rows.place_b), (a, rows.u), (b, rows.w)
    vectors = [np.ascontiguousarray(convert_to_plane(plane, node, v[row])[:, :2]) for node, v in pairs]
    gear = np.zeros((len(row), len(tree.scale)))
    kind = np.where(rows.direction[row], DIRECTION, POSITION)
    return build_ties(kind, (a, b), vectors, gear, build_layout(tree, (a, b), gear, rows.closure[row]))


def _build_masses(tree: PlanarTree) -> BlockMasses:
    nodes = np.bincount(tree.block, minlength=len(tree.size))
    widest = max(int(tree.size.max(initial=0)), 1)
    alone = (nodes == 1) & (tree.size == 3)
    single = np.flatnonzero(alone[tree.block])
    blocks = np.flatnonzero((tree.size > 0) & ~alone)
    member = np.full((len(blocks), nodes[blocks].max(initial=0)), -1, dtype=np.int64)
    for members, block in zip(member, blocks, strict=True):
        members[: nodes[block]] = np.flatnonzero(tree.block == block)
    inertia = np.stack([tree.mass[single], tree.mass[single], tree.inertia[single]], axis=1)
    over = np.divide(1.0, inertia, out=np.zeros_like(inertia), where=inertia > 0.0)
    mass, rest = np.zeros((2, widest, widest))
    weight = np.zeros(widest)
    left = np.zeros(widest, dtype=bool)
    return BlockMasses(single, over, blocks, member, mass, rest, weight, left, np.zeros((len(tree.parent), 3)))
