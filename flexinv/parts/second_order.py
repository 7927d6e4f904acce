"""Forces of second order of a mesh in its own shapes, from the Green strain of its cells.

Of a displacement u = Phi y the strain is E = (G + G^T + G^T G) / 2 with G = du/dx, and the forces on the nodes have a part that
is quadratic in the amplitudes, f = K u + sum y_a y_b N_ab / 2, with stresses S_a = C : sym G_a and T_ab = C : sym (G_a^T G_b):

    N_ab . v = int  T_ab : sym dv/dx  +  S_a : (G_b^T dv/dx)  +  S_b : (G_a^T dv/dx)

What balances them, K H_ab = - N_ab, is by how much a shape shortens the part that bends in it: the displacement of second order.
Source: Wu, Tiso, *Modal derivatives based reduction method for finite deflections in floating frame*, Multibody Syst. Dyn. 36,
2016.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexinv.model.part import Cells, MeshedPart
from flexinv.parts.part_matrices import PartMatrices
from flexinv.parts.solid_elements import CELLS_AT_ONCE, build_rules
from flexinv.typing import Array, Indices

_STRAIN = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])  # where a symmetric tensor's entries stand among six


def compute_second_order_forces(part: MeshedPart, found: PartMatrices, shapes: Array) -> Array:
    """Return N_ab of all pairs of shapes (n, 3, soft) [-] as forces on nodes (3 n, pairs) [N/m^2].

    pairs : as `numpy.triu_indices` has them
    """
    soft = shapes.shape[2]
    first, second = np.triu_indices(soft)
    out = np.zeros((len(part.points), 3, len(first)))
    moved = np.zeros((len(part.points), 3, soft))
    moved[found.used] = shapes
    for cells in part.cells:
        for begin in range(0, len(cells.nodes), CELLS_AT_ONCE):
            nodes = cells.nodes[begin : begin + CELLS_AT_ONCE]
            forces = _compute_cell_forces(part, cells, nodes, moved[nodes], (first, second))
            np.add.at(out, nodes, forces)
    return out[found.used].reshape(3 * len(found.used), -1)


def _compute_cell_forces(
    part: MeshedPart,
    cells: Cells,
    nodes: Indices,
    moved: Array,
    pairs: tuple[NDArray[np.intp], NDArray[np.intp]],
) -> Array:
    """Forces (cells, nodes, 3, pairs) [N/m^2] of some cells; moved : (cells, nodes, 3, soft) displacements of their nodes."""
    rule = build_rules(cells.kind)[0]
    first, second = pairs
    at = part.points[nodes]
    law = cells.material.stiffness
    out = np.zeros((*nodes.shape, 3, len(first)))
    for slope, weight in zip(rule.slope, rule.weight, strict=True):
        jacobian = slope.T @ at
        gradient = np.linalg.solve(
            jacobian, np.broadcast_to(slope.T, (len(nodes), 3, nodes.shape[1]))
        )  # (cell, xyz, node)
        g = np.einsum("cjn,cnks->cskj", gradient, moved)  # (cell, shape, component, by)
        stress = _compute_stress(law, 0.5 * (g + g.swapaxes(2, 3)))
        a = g[:, first]
        b = g[:, second]
        product = a.swapaxes(2, 3) @ b
        across = _compute_stress(law, 0.5 * (product + product.swapaxes(2, 3)))
        whole = across + b @ stress[:, first] + a @ stress[:, second]  # (cell, pair, component, by)
        scaled = (weight * np.linalg.det(jacobian))[:, None, None, None] * whole
        out += np.einsum("cpkj,cjn->cnkp", scaled, gradient)
    return out


def _compute_stress(law: Array, strain: Array) -> Array:
    """Stress (..., 3, 3) [Pa] of a symmetric strain (..., 3, 3) by a law (6, 6)."""
    rows = np.stack([strain[..., 0, 0], strain[..., 1, 1], strain[..., 2, 2]], axis=-1)
    shears = 2.0 * np.stack([strain[..., 1, 2], strain[..., 0, 2], strain[..., 0, 1]], axis=-1)
    six = np.concatenate([rows, shears], axis=-1) @ law.T
    return six[..., _STRAIN]
