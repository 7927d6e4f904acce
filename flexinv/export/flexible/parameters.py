"""Parameters of a mechanism with beams that change while it marches: gravity, losses of drives, payloads of some links.

The mass, inertia and place of a payload (`payload_nodes`) stand in the block once for the march and for the torques, in a plane
also as the plane has them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexinv.analysis.controller import FlexibleState
from flexinv.export.memory_image import MemoryImage
from flexinv.export.names import format_numbers, make_words
from flexinv.export.payload_nodes import PAYLOAD
from flexinv.kinematics.mesh import Mesh
from flexinv.planar.detection import PLACEMENT_ROUNDING
from flexinv.typing import Array


def format_parameters(image: MemoryImage, state: FlexibleState, links: Sequence[str], prefix: str) -> dict[str, str]:
    """Return places in the block and tables, as the templates `parameters` and `payloads` name them [-]."""
    mesh = state.solver.mesh
    nodes, drives, masses, _ = state.parts
    numbers = drives.law, masses.mass, masses.inertia, masses.gravity, nodes.offset
    values = format_spatial_parameters(image, mesh, numbers, links, prefix)
    if state.flat is None:
        return values
    tree = state.flat.model.tree
    plane = state.flat.model.plane
    found = [mesh.body_node[name, PAYLOAD] for name in links]
    return values | {
        "in_plane": "1", "at_plane_gravity": str(image.find_place(tree.gravity)),
        "at_plane_offset": str(image.find_place(tree.offset_p)), "at_plane_inertia": str(image.find_place(tree.inertia)),
        "plane_axes": _format_rows(plane.axes.T),
        "payload_nodes": ",\n".join(_format_payload(node, plane.frames[mesh.parent[node]]) for node in found),
    }  # fmt: skip


def format_spatial_parameters(
    image: MemoryImage, mesh: Mesh, numbers: Sequence[Array], links: Sequence[str], prefix: str
) -> dict[str, str]:
    """Return places and tables of a march in space, as the templates `parameters` and `payloads` name them [-].

    numbers : laws of drives (5, nodes), masses [kg], inertias [kg m^2], gravity [m/s^2], places of nodes in their parents [m]
    """
    law, mass, inertia, gravity, offset = map(image.find_place, numbers)
    driven = mesh.mechanism.actuated
    moving = np.flatnonzero(mesh.v_index >= 0)
    order = np.argsort(np.repeat(mesh.v_index[moving], mesh.freedoms[moving]), kind="stable")
    node_of = np.repeat(moving, mesh.freedoms[moving])[order]
    values = {
        "in_plane": 0, "at_gravity": gravity, "at_law": law, "node_count": mesh.size, "at_mass": mass, "at_inertia": inertia,
        "at_offset": offset, "plane_rounding": float(PLACEMENT_ROUNDING**2).hex(),
        "height_rounding": float((PLACEMENT_ROUNDING * mesh.length) ** 2).hex(),
        "at_plane_gravity": 0, "at_plane_offset": 0, "at_plane_inertia": 0, "plane_axes": "{0.0}",
    }  # fmt: skip
    words = make_words("payloads", list(links))
    return {name: str(value) for name, value in values.items()} | {
        "rate_nodes": ", ".join(
            f"{{{n}, {int(is_driven)}}}" for n, is_driven in zip(node_of.tolist(), driven, strict=True)
        ),
        "payload_nodes": ",\n".join(_format_payload(mesh.body_node[name, PAYLOAD], np.eye(3)) for name in links),
        "payloads_enum": ",\n".join(
            f"    {prefix.upper()}_PAYLOAD_{word} = {i}" for i, word in enumerate(words.values())
        ),
    }


def _format_payload(node: int, axes: Array) -> str:
    """A node, and the axes of the plane in the frame of what carries it."""
    return f"    {{{node}, {{{_format_rows(axes)}}}}}"


def _format_rows(matrix: Array) -> str:
    return ", ".join(f"{{{format_numbers(row)}}}" for row in matrix)
