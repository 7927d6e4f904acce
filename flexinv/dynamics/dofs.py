"""The unknowns of a flexible mechanism: independent nodes, dependent nodes, and the index of each degree of freedom.

*Independent* nodes are the beam sections beyond each root: six unknowns each.  All other nodes *depend* on one of
them (or on the world) through rigid offsets and joints; they are eliminated exactly.  A dependent joint without a
prescribed motion (a passive joint) adds its own freedoms.  An independent node, the nodes that depend on it and the passive
freedoms among them form one *block* of unknowns, with the amplitudes of meshed links that hang on them.  The first blocks hang
on the world, one for each joint there, and have passive freedoms and amplitudes only; a *part* of the mechanism is such a block
with all that hangs on it.  Parts share no element and no inertia: closures and springs alone couple them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.elements.shapes import PartShapes
from flexinv.errors import InputError
from flexinv.kernels.records import send_by_address
from flexinv.kinematics.mesh import Mesh
from flexinv.model.joint_kinds import FREE, SECTION, SPHERICAL
from flexinv.model.owned_cache import make_owner_cache, make_read_only
from flexinv.typing import Array, Indices, Mask


@send_by_address
class Topology(NamedTuple):
    """Nodes, blocks and passive freedoms as the march needs them.

    parent, block : (nodes,); independent : (nodes,) bool
    size, offset : (blocks,) number of unknowns and first unknown of each block; part : (blocks,) of the mechanism
    width, first : (nodes,) the same of the block of each node
    span : (parts + 1,) first unknown of each part; the first block of a part has its number
    freedoms, column : (nodes,) passive freedoms of the node's joint and their first column in the block
    reach : (nodes,) columns of the block up to the last that moves the node
    triple : (nodes,) first of three freedoms that are a rotation vector, -1 without
    slide, turn : (nodes, 6, 3) axes of the passive freedoms, in the parent's and in the node's frame [-]
    drives : (5, nodes) the law of the passive joint, as `mechanism.Mechanism.drive_table`
    scale : (unknowns,) length or 1: a unit step
    mass, inertia, gravity : [kg], [kg m^2], [m/s^2]; length : of the mechanism [m]
    shapes : of meshed links; amplitude : (parts,) column of the first amplitude in the block of the link's frame
    """

    parent: Indices
    block: Indices
    independent: Mask
    size: Indices
    offset: Indices
    width: Indices
    first: Indices
    part: Indices
    span: Indices
    freedoms: Indices
    column: Indices
    reach: Indices
    triple: Indices
    slide: Array
    turn: Array
    drives: Array
    scale: Array
    mass: Array
    inertia: Array
    gravity: Array
    length: float
    shapes: PartShapes
    amplitude: Indices


@make_owner_cache()
def build_topology(mesh: Mesh, passive: frozenset[str]) -> Topology:
    """Return the unknowns of a mesh when the joints named in ``passive`` are free [m], [rad] and all others prescribed.

    Raises InputError for a passive joint that cannot be.
    """
    independent = mesh.kind == SECTION
    block, part = _find_blocks(mesh, independent)
    parts = len(part) - int(independent.sum())
    size = np.where(np.arange(len(part)) < parts, 0, 6)
    freedoms, column, triple = np.zeros((3, mesh.size), dtype=np.int64)
    triple[:] = -1
    slide, turn, drives = *np.zeros((2, mesh.size, 6, 3)), np.zeros((5, mesh.size))
    for node in np.flatnonzero(_find_free(mesh, passive)[mesh.v_index]).tolist():
        freedoms[node] = mesh.freedoms[node]
        column[node] = size[block[node]]
        size[block[node]] += freedoms[node]
        slide[node] = mesh.slide[node] @ mesh.rotation[node].T
        turn[node] = mesh.turn[node]
        triple[node] = {SPHERICAL: 0, FREE: 3}.get(int(mesh.kind[node]), -1)
        drives[:, node] = mesh.mechanism.drive_table[:, mesh.v_index[node]]
    shapes = mesh.shapes
    amplitude = _add_amplitudes(shapes, block, size)
    reach = _find_reach(mesh, independent, column + freedoms, amplitude)
    offset, span = compute_offsets(size, part)
    gravity = np.array(mesh.mechanism.gravity, dtype=float)
    first = offset[block]
    scale = np.ones(
        size.sum()
    )  # convergence is judged on increments over the length of the mechanism, over 1 for rotations
    scale[_list_translations(independent, freedoms, first, first + column, turn)] = mesh.length
    topology = Topology(
        mesh.parent, block, independent, size, offset, size[block], first, part, span, freedoms, column, reach, triple,
        slide, turn, drives, scale, mesh.mass, mesh.inertia, gravity, mesh.length, shapes, amplitude,
    )  # fmt: skip
    scale[list_amplitudes(topology)] = mesh.length
    return topology


def _add_amplitudes(shapes: PartShapes, block: Indices, size: Indices) -> Indices:
    """Add the amplitudes of all parts to the sizes of their blocks; return the column of the first of each."""
    amplitude = np.zeros(len(shapes.root), dtype=np.int64)
    for number, root in enumerate(shapes.root.tolist()):
        amplitude[number] = size[block[root]]
        size[block[root]] += shapes.size[number]
    return amplitude


def _find_reach(mesh: Mesh, independent: Mask, behind: Indices, amplitude: Indices) -> Indices:
    """Columns of its block up to the last that moves each node; ``behind`` : the column after its own passive freedoms."""
    shapes = mesh.shapes
    out = np.where(independent, 6, behind)
    for node, (parent, part) in enumerate(zip(mesh.parent.tolist(), shapes.part.tolist(), strict=True)):
        if part >= 0:
            out[node] = amplitude[part] + shapes.size[part]
        if parent >= 0 and not independent[node]:
            out[node] = max(out[node], out[parent])
    return out


def _find_blocks(mesh: Mesh, independent: Mask) -> tuple[Indices, Indices]:
    """The block of each node, and the part of each block: first those on the world, then one for each independent node."""
    roots = np.flatnonzero(mesh.parent < 0)
    parts = max(len(roots), 1)
    block = np.zeros(mesh.size, dtype=np.int64)
    part = np.arange(parts + int(independent.sum()))
    block[roots] = np.arange(len(roots))
    block[independent] = parts + np.arange(independent.sum())
    for node in np.flatnonzero(mesh.parent >= 0).tolist():
        before = block[mesh.parent[node]]
        if independent[node]:
            part[block[node]] = part[before]
        else:
            block[node] = before
    return block, part


def _list_translations(
    independent: Mask, freedoms: Indices, first: Indices, passive: Indices, turn: Array
) -> list[int]:
    """Unknowns that are translations: three of an independent node, and passive freedoms that turn nothing.

    first, passive : (nodes,) first unknown of a node's block, and of its own freedoms there
    """
    out = [int(at) + k for at in first[independent] for k in range(3)]
    for node in np.flatnonzero(freedoms).tolist():
        slides = np.flatnonzero(~turn[node, : freedoms[node]].any(axis=1))
        out += (passive[node] + slides).tolist()
    return out


def _find_free(mesh: Mesh, passive: frozenset[str]) -> Mask:
    """Mask (nv + 1,) of the velocity coordinates of passive joints; the last is for nodes without a coordinate, -1."""
    free = np.zeros(mesh.mechanism.nv + 1, dtype=bool)
    for joint in mesh.mechanism.joints:
        free[mesh.mechanism.v_slices[joint.name]] = joint.name in passive
        if joint.name in passive and joint.kind == "free" and joint.rotor_inertia:
            raise InputError(
                f"joint {joint.name!r}: rotor_inertia = {joint.rotor_inertia:g} on a free joint without motion, expected 0: "
                "nothing turns a rotor there; give the mass to the link"
            )
    return free


def compute_offsets(size: Indices, part: Indices) -> tuple[Indices, Indices]:
    """Return the first unknown of each block and of each part [-], part by part, from the sizes and parts of the blocks."""
    order = np.argsort(part, kind="stable")
    offset = np.empty_like(size)
    offset[order] = np.cumsum(size[order]) - size[order]
    counts = np.bincount(part, weights=size).astype(np.int64)
    return offset, np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def list_amplitudes(topology: Topology) -> Indices:
    """Return the numbers of the unknowns [-] that are amplitudes of meshed links, part after part."""
    first = topology.first[topology.shapes.root] + topology.amplitude
    spans = [np.arange(at, at + count) for at, count in zip(first, topology.shapes.size, strict=True)]
    return np.concatenate([*spans, np.empty(0)]).astype(np.int64)


def scale_modal_stiffness(topology: Topology, factor: float) -> Topology:
    """Return the topology with meshed links ``factor`` times as stiff [-], their damping as it is."""
    shapes = topology.shapes
    return topology._replace(shapes=shapes._replace(stiffness=make_read_only(factor * shapes.stiffness)))
