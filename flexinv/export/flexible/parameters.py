"""Parameters of a mechanism with beams that change while it marches: gravity, losses of drives, payloads of some links.

A payload is a node of its own: a body without mass, a hair's breadth beside the frame of its link, which the library then moves
and loads.  Its mass, inertia and place stand in the block once for the march and for the torques, in a plane also as the plane
has them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexinv.analysis.controller import FlexibleState
from flexinv.errors import InputError
from flexinv.export.memory_image import MemoryImage
from flexinv.export.names import format_numbers, make_words
from flexinv.model.links import Body, Inertia
from flexinv.model.mechanism import Mechanism
from flexinv.planar.detection import PLACEMENT_ROUNDING
from flexinv.typing import Array
from flexinv.validation import find_nearest_word

PAYLOAD = "payload of the C library"
NEXT_TO_IT = np.array(
    [1e-300, 0.0, 0.0]
)  # [m]: a place that is another one than the link's, and whose coordinates are zero


def add_payload_bodies(mechanism: Mechanism, links: Sequence[str]) -> Mechanism:
    """Return a mechanism with a body without mass [kg] on each of some links, of a beam at its tip; InputError for others."""
    for name in links:
        if name not in mechanism.link_of:
            write = find_nearest_word(name, mechanism.link_of) or next(iter(mechanism.link_of))
            raise InputError(f"export_c: payloads: there is no link {name!r}; write payloads=({write!r},)")
        station = None if mechanism.link_of[name].beam is None else 1.0
        mechanism = mechanism.with_body(name, Body(PAYLOAD, Inertia(0.0, NEXT_TO_IT), station))
    return mechanism


def format_parameters(image: MemoryImage, state: FlexibleState, links: Sequence[str], prefix: str) -> dict[str, str]:
    """Return places in the block and tables, as the templates `parameters` and `payloads` name them [-]."""
    mesh = state.solver.mesh
    nodes, drives, masses, _ = state.parts
    driven = mesh.mechanism.actuated
    moving = np.flatnonzero(mesh.v_index >= 0)
    order = np.argsort(np.repeat(mesh.v_index[moving], mesh.freedoms[moving]), kind="stable")
    node_of = np.repeat(moving, mesh.freedoms[moving])[order]
    values = {
        "in_plane": int(state.flat is not None), "at_gravity": image.find_place(masses.gravity),
        "at_law": image.find_place(drives.law), "node_count": mesh.size, "at_mass": image.find_place(masses.mass),
        "at_inertia": image.find_place(masses.inertia), "at_offset": image.find_place(nodes.offset),
        "plane_rounding": float(PLACEMENT_ROUNDING**2).hex(),
        "height_rounding": float((PLACEMENT_ROUNDING * mesh.length) ** 2).hex(),
        "at_plane_gravity": 0, "at_plane_offset": 0, "at_plane_inertia": 0, "plane_axes": "{0.0}",
    }  # fmt: skip
    if state.flat is not None:
        tree = state.flat.model.tree
        values |= {
            "at_plane_gravity": image.find_place(tree.gravity), "at_plane_offset": image.find_place(tree.offset_p),
            "at_plane_inertia": image.find_place(tree.inertia), "plane_axes": _format_rows(state.flat.model.plane.axes.T),
        }  # fmt: skip
    words = make_words("payloads", list(links))
    return {name: str(value) for name, value in values.items()} | {
        "rate_nodes": ", ".join(f"{{{n}, {int(own)}}}" for n, own in zip(node_of.tolist(), driven, strict=True)),
        "payload_nodes": ",\n".join(_format_payload(state, mesh.body_node[name, PAYLOAD]) for name in links),
        "payloads_enum": ",\n".join(
            f"    {prefix.upper()}_PAYLOAD_{word} = {i}" for i, word in enumerate(words.values())
        ),
    }


def _format_payload(state: FlexibleState, node: int) -> str:
    """A node, and the axes of the plane in the frame of what carries it."""
    axes = np.eye(3)
    if state.flat is not None:
        axes = state.flat.model.plane.frames[state.solver.mesh.parent[node]]
    return f"    {{{node}, {{{_format_rows(axes)}}}}}"


def _format_rows(matrix: Array) -> str:
    return ", ".join(f"{{{format_numbers(row)}}}" for row in matrix)
