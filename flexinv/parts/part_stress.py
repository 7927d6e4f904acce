"""Stress of a meshed part: that of every shape at the nodes, and of the deformed part by von Mises.

Strains follow from the slopes of the shape functions at the nodes of a cell; where cells meet, the mean of theirs is taken.  So
stress is known to less than displacements are: a finer mesh tells how well.
"""

from __future__ import annotations

import numpy as np

from flexinv.errors import InputError
from flexinv.model.part import MeshedPart
from flexinv.parts.craig_bampton import Reduction
from flexinv.parts.solid_elements import CELLS_AT_ONCE, build_node_slopes, compute_strain_matrices
from flexinv.typing import Array


def compute_stress_shapes(part: MeshedPart, reduced: Reduction) -> Array:
    """Return stresses xx, yy, zz, yz, xz, xy of the nodes for each shape, (n, 6, shapes) [Pa/m].

    Raises InputError for a part of ready matrices, of which no cell has a material.
    """
    if not part.cells:
        raise InputError(f"{part.source or 'mesh'}: ready matrices have no stress; write a material in their place")
    count = reduced.shapes.shape[2]
    total = np.zeros((len(part.points), 6, count))
    cells_of = np.zeros(len(part.points))
    moved = np.zeros((len(part.points), 3, count))
    moved[reduced.used] = reduced.shapes
    for cells in part.cells:
        slopes = build_node_slopes(cells.kind)  # (place, node, xi)
        for first in range(0, len(cells.nodes), CELLS_AT_ONCE):
            nodes = cells.nodes[first : first + CELLS_AT_ONCE]
            local = moved[nodes].reshape(len(nodes), -1, count)  # (cell, node xyz, shape)
            for place, slope in enumerate(slopes):
                jacobian = slope.T @ part.points[nodes]
                gradient = np.linalg.solve(jacobian, np.broadcast_to(slope.T, (len(nodes), 3, nodes.shape[1])))
                stress = cells.material.stiffness @ (compute_strain_matrices(gradient) @ local)
                np.add.at(total, nodes[:, place], stress)
            np.add.at(cells_of, nodes, 1.0)
    return total[reduced.used] / cells_of[reduced.used, None, None]


def compute_von_mises(stress: Array) -> Array:
    """Return the equivalent stress [Pa] of stresses xx, yy, zz, yz, xz, xy on the second last axis (..., 6, k)."""
    xx, yy, zz, yz, xz, xy = np.moveaxis(stress, -2, 0)
    direct = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2)
    return np.asarray(np.sqrt(direct + 3.0 * (yz**2 + xz**2 + xy**2)))
