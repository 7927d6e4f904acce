"""A coarse net of a part's surface, for drawings: nodes near one another are one knot, and edges join knots that cells join.

Source: Rossignac, Borrel, *Multi-resolution 3D approximations for rendering complex scenes*, 1993 (vertex clustering).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.model.part import MeshedPart
from flexinv.typing import Array, Indices

# Faces of cells by their corners, in VTK's order, each round its edge.
_BRICK_FACES = ("0123", "4567", "0154", "1265", "2376", "3047")
_TETRAHEDRON_FACES = ("021", "013", "123", "203")
FACES = {
    "tetra": _TETRAHEDRON_FACES,
    "tetra10": _TETRAHEDRON_FACES,
    "hexahedron": _BRICK_FACES,
    "hexahedron20": _BRICK_FACES,
    "hexahedron27": _BRICK_FACES,
    "wedge": ("021", "345", "0143", "1254", "2035"),
}
# Sizes of a knot are tried in steps of this ratio.
COARSER = 1.1


class SurfaceNet(NamedTuple):
    """Knots of a net, nodes of the mesh (k,) [-], and its edges (edges, 2), rows of ``knots`` [-]."""

    knots: Indices
    edges: Indices


def build_surface_net(part: MeshedPart, most: int) -> SurfaceNet:
    """Return a net over the surface of a part's cells with at most so many knots [-], one or more."""
    edges = list_surface_edges(part)
    nodes = np.unique(edges)
    places = part.points[nodes]
    cluster = _find_cubes(places, most)
    count = int(cluster.max(initial=-1)) + 1
    weight = np.bincount(cluster, minlength=count)
    middle = np.stack([np.bincount(cluster, places[:, i], minlength=count) / weight for i in range(3)], axis=1)
    apart = np.linalg.norm(places - middle[cluster], axis=1)
    order = np.lexsort((apart, cluster))
    first = np.unique(cluster[order], return_index=True)[1]
    of_node = np.zeros(len(part.points), dtype=np.int64)
    of_node[nodes] = cluster
    joined = np.sort(of_node[edges], axis=1)
    joined = np.unique(joined[joined[:, 0] < joined[:, 1]], axis=0)
    return SurfaceNet(nodes[order[first]], joined.reshape(-1, 2))


def list_surface_edges(part: MeshedPart) -> Indices:
    """Return the edges of all faces that belong to one cell alone, (edges, 2) points of the part [-], each once."""
    faces: dict[int, list[Indices]] = {}
    for cells in part.cells:
        for face in FACES[cells.kind]:
            faces.setdefault(len(face), []).append(cells.nodes[:, [int(corner) for corner in face]])
    edges = []
    for corners, of_size in faces.items():
        whole = np.concatenate(of_size)
        _, first, times = np.unique(np.sort(whole, axis=1), axis=0, return_index=True, return_counts=True)
        outer = whole[first[times == 1]]
        edges += [outer[:, [k, (k + 1) % corners]] for k in range(corners)]
    return np.unique(np.sort(np.concatenate(edges), axis=1), axis=0)


def _find_cubes(places: Array, most: int) -> Indices:
    """Numbers (n,) of the cubes in which places (n, 3) are, cubes as small as their number allows."""
    low = places.min(axis=0)
    size = max(float(np.ptp(places, axis=0).max()), np.finfo(float).tiny)
    edge = size / most
    while True:
        cube = np.floor((places - low) / edge).astype(np.int64)
        kept, number = np.unique(cube, axis=0, return_inverse=True)
        if len(kept) <= most:
            return np.asarray(number).ravel()
        edge *= COARSER
