"""Findings about the cells of meshed links: nodes and cells that are there twice, hinges, locking, cells that are all edge."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy

from crosscheck.findings.finding import Finding, make_error, make_warning
from flexinv.model.part import ON_A_LINE, MeshedPart
from flexinv.typing import Array, Indices, Sparse

# Corners of each kind of cell, the first of its nodes.
CORNERS = {"tetra": 4, "tetra10": 4, "hexahedron": 8, "hexahedron20": 8, "hexahedron27": 8, "wedge": 6}
# Faces of linear bricks and wedges, by their corners.
FACES = {
    "hexahedron": ("0123", "4567", "0145", "1256", "2367", "0347"),
    "wedge": ("012", "345", "0134", "1245", "0235"),
}
# Nodes nearer than this part of the mesh's extent were meant to be one: files carry seven digits.
SAME_PLACE = 1e-7
# Corners that two cells share where they hang together by a face.
FACE_CORNERS = 3
# Part of the cells from which on a kind of cell decides how stiff a mesh is.
MOST_OF_THEM = 0.5
# Longest over shortest way between corners: a mesh of a sheet is up to some 30, one axis in millimetres among metres 1000.
LONG_CELL = 100.0


def check_cells(part: MeshedPart, place: str) -> Iterator[Finding]:
    """Yield the findings of the cells of a part, without its materials."""
    if not part.cells:
        return
    yield from _check_repeated_cells(part, place)
    yield from _check_same_places(part, place)
    yield from _check_hinges(part, place)
    yield from _check_locking(part, place)
    yield from _check_long_cells(part, place)


def _check_repeated_cells(part: MeshedPart, place: str) -> Iterator[Finding]:
    """Cells of the same nodes, and cells that name one node twice."""
    repeated = collapsed = 0
    for count in sorted(set(CORNERS.values())):
        alike = [np.sort(cells.nodes[:, :count], axis=1) for cells in part.cells if CORNERS[cells.kind] == count]
        if alike:
            rows = np.vstack(alike)
            repeated += len(rows) - len(np.unique(rows, axis=0))
            collapsed += int((np.diff(rows, axis=1) == 0).any(axis=1).sum())
    if repeated:
        why = "two cells have the same nodes: mass and stiffness count twice there"
        yield make_error("mesh cells", place, f"{repeated} cells twice", why, "each cell once")
    if collapsed:
        why = "a brick or wedge that is folded to fewer corners has no strain of its own there"
        write = "wedges (C3D6) or tetrahedra for them"
        yield make_warning("mesh cells", place, f"{collapsed} cells that name a node twice", why, write)


def _check_same_places(part: MeshedPart, place: str) -> Iterator[Finding]:
    """Nodes of cells that stand at the same place and are not one."""
    used = np.unique(np.concatenate([cells.nodes.ravel() for cells in part.cells]))
    points = part.points[used]
    pairs = scipy.spatial.cKDTree(points).query_pairs(
        SAME_PLACE * float(np.ptp(points, axis=0).max()), output_type="ndarray"
    )
    if len(pairs):
        first, second = (used[pairs[0]] + 1).tolist()
        given = f"{len(pairs)} pairs of nodes that coincide, {first} and {second} among them"
        why = "the part is cut between them: it opens there, and is softer"
        yield make_warning(
            "mesh nodes", place, given, why, "a mesh whose coincident nodes are merged, if no cut is meant"
        )


def _build_incidence(part: MeshedPart) -> Sparse:
    """Corners of all cells, (cells, points) of ones."""
    rows = [cells.nodes[:, : CORNERS[cells.kind]] for cells in part.cells]
    counts = np.concatenate([np.full(len(row), row.shape[1]) for row in rows])
    columns = np.concatenate([row.ravel() for row in rows])
    places = np.repeat(np.arange(len(counts)), counts), columns
    return scipy.sparse.coo_array((np.ones(len(columns)), places), shape=(len(counts), len(part.points))).tocsr()


def _check_hinges(part: MeshedPart, place: str) -> Iterator[Finding]:
    """Pieces that hang at the rest by nodes of one line or one point: they turn there without force."""
    incidence = _build_incidence(part)
    shared = (incidence @ incidence.T).tocsr()
    shared.data = shared.data >= FACE_CORNERS
    shared.eliminate_zeros()
    pieces, number = scipy.sparse.csgraph.connected_components(shared, directed=False)
    if pieces == 1:
        return
    member = scipy.sparse.coo_array((np.ones(len(number)), (number, np.arange(len(number))))).tocsr()
    touched = (member @ incidence).tocsr()
    touched.data = np.ones(len(touched.data))
    common = np.asarray(touched.sum(axis=0)).ravel() > 1
    for k in range(pieces):
        nodes = touched.indices[touched.indptr[k] : touched.indptr[k + 1]]
        seam = np.sort(nodes[common[nodes]])
        if len(seam) and _is_on_a_line(part.points[seam]):
            seat = f"{len(seam)} nodes on a line" if len(seam) > 1 else "one node"
            given = f"{(number == k).sum()} cells that hang by {seat}, node {seam[0] + 1}"
            why = "they turn there without force, as on a hinge: there are more than six rigid motions"
            write = "cells that share faces, or a joint for a hinge that is meant"
            yield make_error("mesh hinge", place, given, why, write)
            return


def _is_on_a_line(points: Array) -> bool:
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return len(points) < FACE_CORNERS or bool(extents[1] <= ON_A_LINE * extents[0])


def _check_locking(part: MeshedPart, place: str) -> Iterator[Finding]:
    """Linear tetrahedra, and linear bricks of which none is inside the part: one or two across."""
    total = sum(len(cells.nodes) for cells in part.cells)
    linear = sum(len(cells.nodes) for cells in part.cells if cells.kind == "tetra")
    if linear > MOST_OF_THEM * total:
        why = "they lock: a mesh of them is stiffer in bending than the part, the more so the thinner it is"
        write = "a mesh of 10-node tetrahedra (gmsh -order 2, C3D10), or a finer one to see how much"
        yield make_warning("mesh locks", place, f"{linear} of {total} cells are linear tetrahedra", why, write)
    flat = sum(_count_outer_cells(cells.nodes, cells.kind) for cells in part.cells if cells.kind in FACES)
    if flat > MOST_OF_THEM * total:
        given = f"{flat} of {total} cells are linear bricks or wedges, one across the part"
        why = "they lock: one linear cell across is stiffer in bending than the part, the more so the longer it is"
        yield make_warning(
            "mesh locks", place, given, why, "a mesh of 20-node bricks (C3D20), or three and more across"
        )


def _count_outer_cells(nodes: Indices, kind: str) -> int:
    """Cells with two opposite faces, or more, at the surface along one direction: each node is on a face that is met once."""
    faces = [np.sort(nodes[:, [int(corner) for corner in face]], axis=1) for face in FACES[kind]]
    outside = np.zeros(int(nodes.max()) + 1, dtype=bool)
    for size in {face.shape[1] for face in faces}:
        rows, count = np.unique(
            np.vstack([face for face in faces if face.shape[1] == size]), axis=0, return_counts=True
        )
        outside[rows[count == 1].ravel()] = True
    return int(outside[nodes].all(axis=1).sum())


def _check_long_cells(part: MeshedPart, place: str) -> Iterator[Finding]:
    """Cells that are much longer than high."""
    long = total = 0
    for cells in part.cells:
        corners = part.points[cells.nodes[:, : CORNERS[cells.kind]]]
        first, second = np.triu_indices(corners.shape[1], 1)
        apart = np.linalg.norm(corners[:, first] - corners[:, second], axis=2)
        long += int((apart.max(axis=1) > LONG_CELL * apart.min(axis=1)).sum())
        total += len(corners)
    if long:
        given = f"{long} of {total} cells more than {LONG_CELL:g} times as long as thin"
        why = "such flat cells are too stiff, and a mesh of them has as a rule one axis in another unit"
        yield make_warning("mesh cells", place, given, why, "cells of like edges, or the axes of the mesh in one unit")
