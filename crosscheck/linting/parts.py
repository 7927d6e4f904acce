"""Findings about links that are meshes: what no part can be, and meshes that mislead."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from crosscheck.findings.finding import Finding, make_error, make_warning
from crosscheck.linting.part_cells import check_cells
from crosscheck.linting.part_motions import check_motions
from crosscheck.linting.part_statements import check_statements
from flexinv.errors import InputError
from flexinv.files.parts import LINK_SIZES
from flexinv.model.mechanism import Mechanism
from flexinv.model.part import MeshedPart
from flexinv.parts.part_matrices import PartMatrices, build_part_matrices


def check_parts(mechanism: Mechanism) -> Iterator[Finding]:
    """Yield the findings of every meshed link: cells and matrices that cannot be, odd sizes [m], loose nodes, and so on."""
    for link in mechanism.meshed:
        assert link.part is not None
        place = f"link {link.name}"
        yield from _check_size(link.part, place)
        yield from check_cells(link.part, place)
        yield from check_statements(mechanism, link.name, link.part)
        try:
            found = build_part_matrices(link.part)
        except InputError as problem:
            why = "no part has such a mesh, or such matrices"
            yield make_error("mesh", place, " ".join(str(problem).split()), why, "as it says")
            continue
        yield from _check_loose_nodes(link.part, found, place)
        if not link.part.cells:
            yield from check_motions(found, place)


def _check_size(part: MeshedPart, place: str) -> Iterator[Finding]:
    extent = float(np.ptp(part.points, axis=0).max())
    if not LINK_SIZES[0] <= extent <= LINK_SIZES[1]:
        write = "unit_m = 0.001 for a mesh in millimetres, 1 for one in metres"
        yield make_warning("mesh size", place, f"a mesh {extent:.4g} m long", "a link is rarely so", write)


def _check_loose_nodes(part: MeshedPart, found: PartMatrices, place: str) -> Iterator[Finding]:
    if loose := len(part.points) - len(found.used):
        why = "no cell uses them, and they are left out"
        yield make_warning(
            "mesh nodes", place, f"{loose} nodes without mass", why, "the mesh without them, if so meant"
        )
