"""Findings about links that are meshes: what no part can be, and meshes that mislead."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from crosscheck.findings.finding import Finding, make_error, make_warning
from flexinv.errors import InputError
from flexinv.files.parts import LINK_SIZES
from flexinv.model.mechanism import Mechanism
from flexinv.model.part import MeshedPart
from flexinv.parts.part_matrices import PartMatrices, build_part_matrices

# Part of the cells from which on a kind of cell decides how stiff a mesh is.
MOST_OF_THEM = 0.5


def check_parts(mechanism: Mechanism) -> Iterator[Finding]:
    """Yield the findings of every meshed link: cells and matrices that cannot be, locking, odd sizes [m], loose nodes."""
    for link in mechanism.meshed:
        assert link.part is not None
        place = f"link {link.name}"
        yield from _check_size(link.part, place)
        yield from _check_locking(link.part, place)
        try:
            found = build_part_matrices(link.part)
        except InputError as problem:
            why = "no part has such a mesh, or such matrices"
            yield make_error("mesh", place, " ".join(str(problem).split()), why, "as it says")
            continue
        yield from _check_loose_nodes(link.part, found, place)


def _check_size(part: MeshedPart, place: str) -> Iterator[Finding]:
    extent = float(np.ptp(part.points, axis=0).max())
    if not LINK_SIZES[0] <= extent <= LINK_SIZES[1]:
        write = "unit_m = 0.001 for a mesh in millimetres, 1 for one in metres"
        yield make_warning("mesh size", place, f"a mesh {extent:.4g} m long", "a link is rarely so", write)


def _check_locking(part: MeshedPart, place: str) -> Iterator[Finding]:
    total = sum(len(cells.nodes) for cells in part.cells)
    linear = sum(len(cells.nodes) for cells in part.cells if cells.kind == "tetra")
    if linear > MOST_OF_THEM * total:
        why = "they lock: a mesh of them is stiffer in bending than the part, the more so the thinner it is"
        write = "a mesh of 10-node tetrahedra (gmsh -order 2, C3D10), or a finer one to see how much"
        yield make_warning("mesh locks", place, f"{linear} of {total} cells are linear tetrahedra", why, write)


def _check_loose_nodes(part: MeshedPart, found: PartMatrices, place: str) -> Iterator[Finding]:
    if loose := len(part.points) - len(found.used):
        why = "no cell uses them, and they are left out"
        yield make_warning(
            "mesh nodes", place, f"{loose} nodes without mass", why, "the mesh without them, if so meant"
        )
